"""Just enough of GeoTIFF to read a grid of f32 back: one band in tiles, plain or deflated, without a predictor."""

import struct
import zlib
from array import array
from typing import NamedTuple

WIDTH, HEIGHT, BITS, COMPRESSION, BANDS, PREDICTOR = 256, 257, 258, 259, 277, 317
TILE_WIDTH, TILE_HEIGHT, OFFSETS, COUNTS, SAMPLE_FORMAT, PIXEL_SCALE, TIEPOINT = 322, 323, 324, 325, 339, 33550, 33922
_FORMS = {1: "B", 2: "c", 3: "H", 4: "I", 11: "f", 12: "d"}  # field types that are read; others are left out


class Grid(NamedTuple):
    width: int
    height: int
    cell: float
    west: float  # x of the left edge
    north: float  # y of the upper edge: row 0 has the greatest y
    values: array  # of f32, row by row


def read(path) -> Grid:
    """Reads a file; raises `ValueError` if it is not one that this reader knows, or is not whole yet."""
    with open(path, "rb") as file:
        data = file.read()
    try:
        return _read(data)
    except (struct.error, KeyError, IndexError, zlib.error) as error:
        raise ValueError(f"{path} is not a TIFF that can be read: {error!r}") from error


def _read(data: bytes) -> Grid:
    order = {b"II*\0": "<", b"MM\0*": ">"}[data[:4]]
    (start,) = struct.unpack_from(order + "I", data, 4)
    (entries,) = struct.unpack_from(order + "H", data, start)
    fields = {}
    for i in range(entries):
        entry = start + 2 + 12 * i
        tag, kind, count = struct.unpack_from(order + "HHI", data, entry)
        if kind in _FORMS:
            form = struct.Struct(f"{order}{count}{_FORMS[kind]}")
            where = entry + 8 if form.size <= 4 else struct.unpack_from(order + "I", data, entry + 8)[0]
            fields[tag] = form.unpack_from(data, where)

    def one(tag: int, default=None):
        return fields[tag][0] if default is None else fields.get(tag, (default,))[0]

    width, height, compression = one(WIDTH), one(HEIGHT), one(COMPRESSION, 1)
    shape = (one(BITS), one(SAMPLE_FORMAT), one(BANDS, 1), one(PREDICTOR, 1))
    if shape != (32, 3, 1, 1) or compression not in (1, 8, 32946):
        raise ValueError(f"a TIFF of another kind: {shape}, compression {compression}")
    tile_width, tile_height = one(TILE_WIDTH), one(TILE_HEIGHT)
    columns = -(-width // tile_width)
    rows = [b""] * height
    for index, (offset, count) in enumerate(zip(fields[OFFSETS], fields[COUNTS], strict=True)):
        tile = data[offset : offset + count]
        tile = tile if compression == 1 else zlib.decompress(tile)
        first_row, first_column = index // columns * tile_height, index % columns * tile_width
        inside = 4 * min(tile_width, width - first_column)
        for row in range(min(tile_height, height - first_row)):
            rows[first_row + row] += tile[4 * row * tile_width :][:inside]
    scale, tie = fields[PIXEL_SCALE], fields[TIEPOINT]
    west, north = tie[3] - tie[0] * scale[0], tie[4] + tie[1] * scale[1]
    floats = struct.unpack(f"{order}{width * height}f", b"".join(rows))
    if scale[0] != scale[1]:
        raise ValueError(f"cells of {scale[0]} by {scale[1]}")
    return Grid(width, height, scale[0], west, north, array("f", floats))
