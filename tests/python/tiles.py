"""Tiles, bands and digests: SPEC.md, sections 5 to 7."""

import struct
import sys
from array import array

from blake3 import blake3

from wire import LAYER_NAMES, Malformed

SIDE = 64
CELLS = SIDE * SIDE
MAX_BAND = 8064
GREATEST_CODE = dict(zip(LAYER_NAMES, [251, 65535, 2, 251, 2, 4, 251, 251, 65535], strict=True))
BY_BITS = {"occupancy", "obstacle", "rigidity", "shore", "intra"}  # layers whose values are coded bit by bit
UNKNOWN = blake3(bytes(2 * CELLS)).digest()  # digest of a tile without a known cell


class NoBase(Exception):
    """A band holds differences to a revision that is not held."""


class Bits:
    """Reads the bits of a modelled band. A probability is a list [zero, seen], kept under the name of its context."""

    def __init__(self, payload: bytes):
        self.payload, self.at = payload, 4
        self.code, self.range = int.from_bytes(payload[:4].ljust(4, b"\0"), "big"), 0xFFFFFFFF
        self.learned = {}

    def even(self) -> int:
        return self._read([32768, 0])

    def __call__(self, *context) -> int:
        return self._read(self.learned.setdefault(context, [32768, 0]))

    def _read(self, probability: list[int]) -> int:
        zero, seen = probability
        bound = (self.range >> 16) * zero
        if self.code < bound:
            bit, self.range = 0, bound
        else:
            bit, self.code, self.range = 1, self.code - bound, self.range - bound
        goal = 0 if bit else 65535
        zero += (goal - zero) * (131072 // (2 * seen + 3)) >> 16
        probability[:] = min(max(zero, 64), 65471), min(seen + 1, 30)
        while self.range < 1 << 24:
            self.range = self.range << 8 & 0xFFFFFFFF
            following = self.payload[self.at] if self.at < len(self.payload) else 0
            self.code = (self.code << 8 | following) & 0xFFFFFFFF
            self.at += 1
        return bit


def decode_modelled(payload: bytes, layer: str, base: array | None) -> array:
    """The codes of a whole tile; `base` is what a tile with coding 2 differs from."""
    bits, cells, last, became = Bits(payload), array("H", bytes(2 * CELLS)), 0, {}
    for at in range(CELLS):
        x, y = at % SIDE, at // SIDE
        west = cells[at - 1] if x else cells[at - SIDE] if y else 0
        north = cells[at - SIDE] if y else west
        north_west = cells[at - SIDE - 1] if x and y else north
        north_east = cells[at - SIDE + 1] if y and x < SIDE - 1 else north
        west_2 = cells[at - 2] if x > 1 else west
        north_2 = cells[at - 2 * SIDE] if y > 1 else north

        def neighbour(or_unknown: bool) -> int | None:
            unknown = (west == 0, north == 0)
            if or_unknown or west:
                like = (west == north, west == north_west, north == north_east, west_2 == west, north_2 == north)
                if not bits("west", like, unknown):
                    return west
            if north != west and (or_unknown or north):
                if not bits("north", north_west == west, north_west == north, north == north_east, unknown):
                    return north
            return None

        def near() -> tuple[int, int]:
            w, n = west or north or last, north or west or last
            if not north_west:
                return (w + n) // 2, abs(w - n)
            predicted = min(max(w + n - north_west, min(w, n)), max(w, n))
            return predicted, abs(w - n) + abs(w - north_west)

        before = base[at] if base else None
        if base is None:
            code = neighbour(True)
            if code is None:
                code = 0 if west and north and bits("unknown") else value(bits, layer, *near(), 0)
        else:
            inside = (x > 0, y > 0, y > 0 and x < SIDE - 1, y > 0 and x > 0, x > 1, y > 1)
            backs = (1, SIDE, SIDE - 1, SIDE + 1, 2, 2 * SIDE)
            steps = [cells[at - back] - base[at - back] if is_in else 0 for is_in, back in zip(inside, backs)]
            changed = tuple(step != 0 for step in steps)
            east = x == SIDE - 1 or base[at + 1] == before
            south = y == SIDE - 1 or base[at + SIDE] == before
            if not bits("differs", changed, before == 0, east, south):
                code = before
            elif before == 0:
                code = neighbour(False)
                if code is None:
                    code = value(bits, layer, *near(), 0)
            elif bits("vanishes"):
                code = 0
            else:
                code = became.get(before & 255)
                if not code or bits("follows", changed[:2]):
                    step = steps[0] or steps[1]
                    code = value(bits, layer, before, abs(step), (step > 0) - (step < 0) + 1)
                    became[before & 255] = code
        cells[at] = code
        last = code or last
    if bits.at < len(payload):
        raise Malformed(f"{len(payload) - bits.at} bytes more than the cells need")
    return cells


def value(bits: Bits, layer: str, prediction: int, unevenness: int, sign: int) -> int:
    if layer in BY_BITS:
        path = 1
        for _ in range(8):
            path = path << 1 | bits("value", path)
        return path & 255
    is_negative, length, uneven = bits("sign", sign), 0, min(unevenness.bit_length(), 7)
    while length < 17 and bits("longer", uneven, length):
        length += 1
    m = 1
    for place in range(length):
        if place == 0:
            m = m << 1 | bits("next", length)
        elif place == 1:
            m = m << 1 | bits("next", length, m & 1)
        else:
            m = m << 1 | bits.even()
    return (prediction + (-m if is_negative else m - 1)) & 0xFFFF


def decode_band(band: bytes, layer: str, base: array | None) -> tuple[int, array]:
    """The number of the band's first row, and the codes of its rows. Raises `NoBase` if it needs one."""
    if not 4 <= len(band) <= MAX_BAND:
        raise Malformed(f"band of {len(band)} bytes")
    version, first, rows, coding = band[:4]
    if version != 2 or not 1 <= rows <= SIDE - first or coding > 2:
        raise Malformed(f"band version {version}, first row {first}, rows {rows}, coding {coding}")
    if coding == 0:
        n = rows * SIDE
        if len(band) != 4 + 2 * n:
            raise Malformed(f"{len(band) - 4} bytes for {n} cells")
        codes = array("H", [low | high << 8 for low, high in zip(band[4 : 4 + n], band[4 + n :])])
    elif rows != SIDE:
        raise Malformed(f"{rows} modelled rows")
    elif coding == 2 and base is None:
        raise NoBase
    else:
        codes = decode_modelled(band[4:], layer, base if coding == 2 else None)
    if max(codes) > GREATEST_CODE[layer]:
        raise Malformed(f"code {max(codes)}, greatest is {GREATEST_CODE[layer]}")
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
