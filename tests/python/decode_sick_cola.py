#!/usr/bin/env python3
"""Decodes the scans of SICK captures (CoLa B), independently of the Rust codec.

    python decode_sick_cola.py CAPTURE

Written from SICK's tables of LMDscandata (operating instructions of the LMS500, 8013796, pages 82 to 84). The capture is
JSON of tshark. Prints a line for each scan: all its values, as numbers. A value that is not as the tables say ends it.
"""

import json
import struct
import sys


class Fields:
    def __init__(self, data: bytes):
        self.data, self.at = data, 0

    def take(self, layout: str) -> list[int]:
        values = struct.unpack_from(">" + layout, self.data, self.at)
        self.at += struct.calcsize(">" + layout)
        return list(values)


def scan(payload: bytes) -> list[int]:
    fields = Fields(payload)
    version, _device, *words = fields.take("HHIBBHHII4B")
    assert version == 1
    reserved, frequency, _measurements, encoders = fields.take("HIIH")
    assert (reserved, encoders) == (0, 0)
    words.append(frequency)
    for sample in "HB":
        (channels,) = fields.take("H")
        for _ in range(channels):
            *header, count = fields.take("5BIIIHH")
            words += header + fields.take(f"{count}{sample}")
    position, name, comment, time = fields.take("4H")
    assert (position, name, comment, time) == (0, 0, 0, 1)
    words += fields.take("H5BI")
    assert fields.take("H") == [0] and fields.at == len(payload)
    return words


with open(sys.argv[1], encoding="utf-8") as file:
    packets = json.load(file)
for packet in packets:
    data = bytes.fromhex(packet["_source"]["layers"]["tcp"]["tcp.payload"].replace(":", ""))
    mark, length = data[:4], int.from_bytes(data[4:8], "big")
    assert mark == b"\2\2\2\2" and len(data) == length + 9
    checksum = 0
    for byte in data[8:]:
        checksum ^= byte
    assert checksum == 0
    if data[8:].startswith(b"sSN LMDscandata "):
        print(*scan(data[24:-1]))
