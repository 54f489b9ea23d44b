#!/usr/bin/env python3
"""Decodes RPLIDAR capsules with the arithmetic of the vendor's SDK, independently of the Rust codec.

Written from handler_capsules.cpp of Slamtec/rplidar_ros at 1597018, integers as in C. Prints the CRC-32 of all
samples (angle u16, distance u32, little-endian, zeros to whole words) of pseudo-random capsules: the numbers in
robot-edge/drivers/src/rplidar/tests.rs.
"""

import struct
import zlib


def capsule(seed: int, start_q6: int, length: int) -> bytes:
    """The filling is a linear congruential generator, upper byte."""
    data = bytearray()
    for _ in range(length - 4):
        seed = (seed * 1664525 + 1013904223) & 0xFFFFFFFF
        data.append(seed >> 24)
    return b"\xa0\x50" + struct.pack("<H", start_q6) + bytes(data)


def signed(bits: int, width: int) -> int:
    return bits - (1 << width) if bits >> (width - 1) else bits


def scale(scaled: int) -> tuple[int, int]:
    for base, target, level in [(3328, 1 << 14, 4), (1792, 1 << 12, 3), (1280, 1 << 11, 2), (512, 1 << 9, 1), (0, 0, 0)]:
        if scaled >= base:
            return target + ((scaled - base) << level), level
    raise ValueError


def samples(kind: str, previous: bytes, following: bytes) -> list[tuple[int, int]]:
    start, = struct.unpack_from("<H", previous, 2)
    end, = struct.unpack_from("<H", following, 2)
    diff_q8 = (end - start << 2) + (360 << 8 if start > end else 0)
    raw = start << 10
    out = []

    def angle(offset: int) -> int:
        return (raw - offset >> 10) % (360 << 6)

    if kind == "express":
        step = diff_q8 << 3
        for at in range(16):
            first, second, low = struct.unpack_from("<HHB", previous, 4 + 5 * at)
            for word, nibble in ((first, low & 15), (second, low >> 4)):
                out.append((angle((nibble | (word & 3) << 4) << 13), word & 0xFFFC))
                raw += step
    elif kind == "dense":
        step = (diff_q8 << 8) // 40
        for distance in struct.unpack_from("<40H", previous, 4):
            out.append((angle(0), distance << 2))
            raw += step
    else:
        step = (diff_q8 << 3) // 3
        words = struct.unpack_from("<32I", previous, 4) + struct.unpack_from("<I", following, 4)
        for word, next_word in zip(words, words[1:]):
            major, level1 = scale(word & 0xFFF)
            major2, level2 = scale(next_word & 0xFFF)
            base1 = major
            if not major and major2:
                base1, level1 = major2, level2
            distances = [major << 2]
            for predict, base, level in ((signed(word >> 12 & 0x3FF, 10), base1, level1), (signed(word >> 22, 10), major2, level2)):
                invalid = predict in (-512, 511)
                # The SDK gives a negative distance here; the codec none.
                distances.append(0 if invalid else max((predict << level) + base, 0) << 2)
            for distance in distances:
                offset = int(7.5 * 3.1415926535 * (1 << 16) / 180.0)
                if distance >= 200:
                    k2 = 98361 // distance
                    offset = int(8 * 3.1415926535 * (1 << 16) / 180) - (k2 << 6) - k2**3 // 98304
                out.append((angle(int(offset * 180 / 3.14159265)), distance))
                raw += step
    return out


for kind, length in (("express", 84), ("ultra", 132), ("dense", 84)):
    data = b""
    for seed in range(100):
        start_q6, end_q6 = seed * 229 % 23040, (seed * 229 + 1000 + seed) % 23040
        for node in samples(kind, capsule(seed, start_q6, length), capsule(seed + 1, end_q6, length)):
            data += struct.pack("<HI", *node)
    print(kind, hex(zlib.crc32(data + bytes(4 - len(data) % 4))))
