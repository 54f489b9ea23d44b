"""Tiles, bands and digests: SPEC.md, sections 5 to 7."""

import struct
import sys
from array import array

import zstandard
from blake3 import blake3

from wire import LAYER_NAMES, Malformed

SIDE = 64
CELLS = SIDE * SIDE
MAX_BAND = 8064
GREATEST_CODE = dict(zip(LAYER_NAMES, [251, 65535, 2, 251, 2, 4, 251, 251, 65535], strict=True))
UNKNOWN = blake3(bytes(2 * CELLS)).digest()  # digest of a tile without a known cell

# A frame may name a window, not only a content, that is far larger than what it holds.
_UNZSTD = zstandard.ZstdDecompressor(max_window_size=1 << 23)


def _unpack_zstd(frame: bytes, size: int) -> bytes:
    """What one zstd frame holds, if that is exactly `size` bytes."""
    try:
        # The library believes a size in the frame, whatever limit it is given: look at it first.
        said = zstandard.get_frame_parameters(frame).content_size
        if said not in (size, zstandard.CONTENTSIZE_UNKNOWN):
            raise Malformed(f"zstd frame of {said} bytes instead of {size}")
        data = _UNZSTD.decompress(frame, max_output_size=size, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise Malformed(f"zstd: {error}") from error
    if len(data) != size:
        raise Malformed(f"zstd frame of {len(data)} bytes instead of {size}")
    return data


def decode_symbols(symbols: list[int]) -> list[int]:
    """The codes of a band out of its differences to a prediction (coding 2)."""
    codes = []
    before = [32768] * SIDE  # the row before; for the first row only its first cell is used
    for start in range(0, len(symbols), SIDE):
        row = []
        left = above_left = before[0]
        for x, symbol in enumerate(symbols[start : start + SIDE]):
            above = before[x]
            if start == 0:
                prediction = left
            else:
                low, high = (left, above) if left < above else (above, left)
                prediction = min(max(left + above - above_left, low), high)
            if symbol == 0:
                codes.append(0)
                left = prediction
            else:
                z = symbol - 1
                left = prediction + (-(z + 1) // 2 if z & 1 else z // 2)
                left += 65535 if left < 1 else -65535 if left > 65535 else 0
                codes.append(left)
            row.append(left)
            above_left = above
        before = row
    return codes


def decode_band(band: bytes, greatest_code: int) -> tuple[int, array]:
    """The number of the band's first row, and the codes of its rows."""
    if not 4 <= len(band) <= MAX_BAND:
        raise Malformed(f"band of {len(band)} bytes")
    version, first, rows, coding = band[:4]
    if version != 1 or not 1 <= rows <= SIDE - first or coding > 2:
        raise Malformed(f"band version {version}, first row {first}, rows {rows}, coding {coding}")
    n = rows * SIDE
    planes = band[4:] if coding == 0 else _unpack_zstd(band[4:], 2 * n)
    if len(planes) != 2 * n:
        raise Malformed(f"{len(planes)} bytes for {n} cells")
    words = [low | high << 8 for low, high in zip(planes[:n], planes[n:])]
    codes = array("H", decode_symbols(words) if coding == 2 else words)
    if max(codes) > greatest_code:
        raise Malformed(f"code {max(codes)}, greatest is {greatest_code}")
    return first, codes


def tile_digest(codes: array) -> bytes:
    """The digest of a tile's 4096 codes."""
    if sys.byteorder == "big":
        codes = array("H", codes)
        codes.byteswap()
    return blake3(codes.tobytes()).digest()


def root_digest(layer: str, cell_m: float, digests: dict[tuple[int, int], bytes]) -> bytes:
    """The root digest of a layer, out of the tile digests by (tx, ty)."""
    name = layer.encode("ascii")
    hasher = blake3(bytes([len(name)]) + name + struct.pack("<d", cell_m))
    for at in sorted(digests):
        if digests[at] != UNKNOWN:
            hasher.update(struct.pack("<ii", *at) + digests[at])
    return hasher.digest()
