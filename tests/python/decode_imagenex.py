#!/usr/bin/env python3
"""Decodes the shots of a .852 file, independently of the Rust codec.

    python decode_imagenex.py FILE

Written from Imagenex, "Data Storage File Format (.852)" of 16SEP15 and "Model 852 Digital Echo Sounder, Serial Interface
Specification" v1.04. Prints a line for each shot: head id, serial status, range scale in metres, profile range in
centimetres, echo in hexadecimal digits.
"""

import struct
import sys

BYTES_TO_READ = {b"IPX": 13, b"IMX": 265, b"IGX": 513}


def value(low: int, high: int) -> int:
    high_byte = (high & 0x7E) >> 1
    low_byte = (high & 0x01) << 7 | low & 0x7F
    return high_byte << 8 | low_byte


def shots(data: bytes):
    at = 0
    while at < len(data):
        magic, _, total, to_read = struct.unpack_from(">3sBHH", data, at)
        shot = data[at + 100 : at + 100 + to_read]
        count = value(shot[10], shot[11])
        assert magic == b"852" and to_read == BYTES_TO_READ[shot[:3]] == 13 + count and shot[-1] == 0xFC
        assert not any(data[at + 100 + to_read : at + total])
        yield shot[3], shot[4], shot[7], value(shot[8], shot[9]), shot[12:-1].hex()
        at += total


with open(sys.argv[1], "rb") as file:
    for shot in shots(file.read()):
        print(*shot)
