#!/usr/bin/env python3
"""Holds this client against the examples of protocol/SPEC.md, and its rules against a robot that exists only here.

    python test_vectors.py
"""

import json
import math
import random
import re
import struct
import unittest
from array import array
from pathlib import Path

from blake3 import blake3
from cryptography.hazmat.primitives.serialization import load_pem_private_key, load_pem_public_key

import tiles
import wire
from foreshore_client import bulk_endpoint, layer_of_key
from map_copy import Layer, MapCopy, dequantise, one_page

SPEC = Path(__file__).resolve().parents[2] / "protocol" / "SPEC.md"
KINDS = {
    "Info": wire.INFO,
    "Pong": wire.PONG,
    "Pose": wire.POSE,
    "Status": wire.STATUS,
    "Status.driven": wire.STATUS,
    "Localization": wire.LOCALIZATION,
    "Plan": wire.PLAN,
    "Event": wire.EVENT,
    "MapHead": wire.MAP_HEAD,
    "View": wire.VIEW,
    "Changes": wire.CHANGES,
    "DigestsRequest": wire.DIGESTS_REQUEST,
    "Digests": wire.DIGESTS,
    "TilesRequest.NewerThan": wire.TILES_REQUEST,
    "TilesRequest.ByKey": wire.TILES_REQUEST,
    "TilesReply": wire.TILES_REPLY,
    "ShoresRequest": wire.SHORES_REQUEST,
    "ShoresReply": wire.SHORES_REPLY,
    "ShoresReply.nothing": wire.SHORES_REPLY,
    "Scan": wire.SCAN,
    "VoxelsRequest": wire.VOXELS_REQUEST,
    "TrajectoryRequest": wire.TRAJECTORY_REQUEST,
    "TrajectoryPart": wire.TRAJECTORY_PART,
    **{f"VoxelsReply.{name}": wire.VOXELS_REPLY for name in ("None", "Preparing", "Gone", "Part")},
    **{f"Answer.{name}": wire.ANSWER for name in ("Done", "Granted", "Waiting", "EStopped", "Refused")},
}
SIGNED = {
    "Drive": (wire.DRIVE, "drive"),
    "Drive.goal": (wire.DRIVE, "drive"),
    "EStop": (wire.ESTOP, "estop"),
    "Reset": (wire.RESET, "reset"),
    **{
        f"LeaseRequest.{name}": (wire.LEASE_REQUEST, "lease")
        for name in ("Request", "Release", "HandOver", "Refuse", "TakeOver")
    },
    **{f"Setting.{name}": (wire.SETTING, "set") for name in ("BudgetKbps", "CollisionMonitor", "Recording", "SaveMap", "Locate")},
}


def blocks() -> dict[tuple[str, str], str]:
    """The fenced blocks of the specification by language and name."""
    fenced = re.finditer(r"^```(json|hex) ([^\n]+)\n(.*?)^```$", SPEC.read_text(encoding="utf-8"), re.M | re.S)
    return {(block[1], block[2]): block[3] for block in fenced}


BLOCKS = blocks()


def unhex(name: str) -> bytes:
    return bytes.fromhex(re.sub(r"#.*", "", BLOCKS["hex", name]))


def values(name: str):
    """A JSON block; "hex:…" is raw bytes, and no body is an empty one."""

    def raw(value):
        if isinstance(value, str) and value.startswith("hex:"):
            return bytes.fromhex(value[4:])
        if isinstance(value, dict):
            return {key: raw(content) for key, content in value.items()}
        if isinstance(value, list):
            return [raw(content) for content in value]
        return value

    return raw(json.loads(BLOCKS["json", name]))


def example(name: str) -> tuple[wire.Header, object]:
    message = values(name)
    return wire.Header(**message["header"]), {} if message["body"] is None else message["body"]


def posts() -> array:
    return array("H", [0 if x >= 48 else 2 if (x + 3 * y) % 8 == 0 else 1 for y in range(64) for x in range(64)])


def plane() -> array:
    hole = range(20, 40)
    return array("H", [0 if x in hole and y in hole else 30000 + 3 * x + 7 * y for y in range(64) for x in range(64)])


def noise() -> array:
    state, codes = 1, array("H")
    for _ in range(tiles.CELLS):
        state = (1664525 * state + 1013904223) % (1 << 32)
        codes.append(state >> 16)
    return codes


def plain_bands(codes: array) -> list[bytes]:
    """A tile in two bands of coding 0."""
    bands = []
    for first in 0, 32:
        part = codes[first * 64 : (first + 32) * 64]
        bands.append(bytes([2, first, 32, 0]) + bytes(c & 0xFF for c in part) + bytes(c >> 8 for c in part))
    return bands


def raised() -> array:
    """`plane` with a part that was raised, and a part that became known."""
    codes, part = plane(), range(10, 30)
    for y in part:
        for x in part:
            if codes[64 * y + x] or x < 25:
                codes[64 * y + x] = max(codes[64 * y + x], 30000) + 2
    return codes


class Messages(unittest.TestCase):
    def same(self, decoded, said):
        """Equal but for what f32 rounds."""
        if isinstance(said, dict):
            self.assertEqual(list(decoded), list(said))
            for key in said:
                self.same(decoded[key], said[key])
        elif isinstance(said, list):
            self.assertEqual(len(decoded), len(said))
            for pair in zip(decoded, said):
                self.same(*pair)
        elif isinstance(said, float):
            self.assertTrue(math.isclose(decoded, said, rel_tol=1e-7), f"{decoded} {said}")
        else:
            self.assertEqual(decoded, said)

    def test_every_example_is_known(self):
        messages = {name for language, name in BLOCKS if language == "json" and name != "symbols"}
        self.assertEqual(messages, set(KINDS) | set(SIGNED))

    def test_examples(self):
        for name, kind in KINDS.items():
            with self.subTest(name):
                header, body = example(name)
                self.assertEqual(wire.encode(kind, header, body), unhex(name))
                said_header, said = wire.decode(kind, unhex(name))
                self.assertEqual(said_header, header)
                self.same(said, body)

    def test_what_is_cut_off_or_too_long_is_malformed(self):
        for name, kind in KINDS.items():
            message = unhex(name)
            for wrong in [*(message[:n] for n in range(len(message))), message + b"\0"]:
                with self.subTest(name, bytes=len(wrong)), self.assertRaises(wire.Malformed):
                    wire.decode(kind, wrong)
        with self.assertRaises(wire.Malformed):
            wire.decode(wire.PONG, unhex("Pong"), longest=33)

    def test_signed_examples(self):
        spec = SPEC.read_text(encoding="utf-8")
        secret, public = (
            load(re.search(rf"-----BEGIN {kind} KEY-----.*?-----END {kind} KEY-----\n", spec, re.S)[0].encode(), **options)
            for kind, load, options in [
                ("PRIVATE", load_pem_private_key, {"password": None}),
                ("PUBLIC", load_pem_public_key, {}),
            ]
        )
        for name, (kind, topic) in SIGNED.items():
            said, message = values(name), unhex(name)
            stamp, body = wire.CommandHeader(**said["stamp"]), said["body"]
            robot, operator = said["robot"], said["operator"]
            with self.subTest(name):
                self.assertEqual(wire.sign(secret, kind, robot, operator, topic, stamp, body), message)
                self.assertEqual(wire.open_signed(public, kind, robot, operator, topic, message), (stamp, body))
            damaged = bytearray(message)
            damaged[-1] ^= 1
            for wrong in [
                (robot, operator, topic, bytes(damaged)),
                ("scout-2", operator, topic, message),
                (robot, "berta", topic, message),
                (robot, operator, "drive" if topic == "set" else "set", message),
                (robot, operator, topic, message[:-1]),
            ]:
                with self.subTest(name, wrong=wrong), self.assertRaises(wire.Malformed):
                    wire.open_signed(public, kind, *wrong)
        drive = values("Drive")
        signed = wire.signed_bytes(drive["robot"], drive["operator"], "drive", wire.CommandHeader(**drive["stamp"]), unhex("Drive")[114:])
        self.assertEqual(signed, unhex("signed bytes"))
        public.verify(unhex("signature"), signed)

    def test_damage_raises_nothing_but_malformed(self):
        random.seed(1)
        for name, kind in KINDS.items():
            for _ in range(300):
                message = bytearray(unhex(name))
                for _ in range(random.randint(1, 4)):
                    message[random.randrange(len(message))] = random.randrange(256)
                try:
                    wire.decode(kind, bytes(message))
                except wire.Malformed:
                    pass

    def test_numbers(self):
        def read(kind, data: str):
            reader = wire.Reader(bytes.fromhex(data))
            value = kind.read(reader)
            self.assertEqual(reader.left(), 0)
            return value

        self.assertEqual(read(wire.U32, "ac 02"), 300)
        self.assertEqual([read(wire.I32, f"{z:02x}") for z in range(5)], [0, -1, 1, -2, 2])
        self.assertEqual(read(wire.U64, "ff" * 9 + "01"), (1 << 64) - 1)
        self.assertEqual(read(wire.I64, "ff" * 9 + "01"), -1 << 63)
        self.assertEqual(read(wire.I32, "ff ff ff ff 0f"), -1 << 31)
        for kind, data in [
            (wire.U16, "ff ff 04"),  # 65536 and more
            (wire.U16, "80 80 80 00"),
            (wire.U32, "ff ff ff ff 10"),
            (wire.U64, "ff" * 9 + "02"),
            (wire.BOOL, "02"),
            (wire.Option(wire.U64), "02 00"),
            (wire.LAYER, "09"),
            (wire.TEXT, "01 ff"),
            (wire.BYTES, "ff ff ff ff 0f 00"),
            (wire.MAP_HEAD, "ff ff ff ff 0f 00"),
        ]:
            with self.subTest(data), self.assertRaises(wire.Malformed):
                read(kind, data)

    def test_another_version_is_not_read_further(self):
        for message in b"\4\0", b"\6\0" + unhex("Pong")[2:] + b"more":
            with self.assertRaises(wire.OtherVersion):
                wire.decode(wire.PONG, message)

    def test_keys_and_endpoints(self):
        self.assertEqual(layer_of_key("foreshore/scout-1/map/elevation/changes"), "elevation")
        for rest in "elevation/tiles", "height/changes", "changes":
            self.assertIsNone(layer_of_key("foreshore/scout-1/map/" + rest))
        self.assertEqual(bulk_endpoint("tcp/[::1]:7447#iface=eth0"), "tcp/[::1]:7448#iface=eth0")


class Tiles(unittest.TestCase):
    def whole(self, bands: list[bytes], layer: str = "elevation", base: array | None = None) -> array:
        codes = array("H", [0]) * tiles.CELLS
        for band in bands:
            first, part = tiles.decode_band(band, layer, base)
            codes[first * 64 : first * 64 + len(part)] = part
        return codes

    def test_bands(self):
        self.assertEqual(self.whole([unhex("band posts")], "obstacle"), posts())
        self.assertEqual(self.whole([unhex("band plane")]), plane())
        self.assertEqual(self.whole([unhex("band raised")], base=plane()), raised())
        with self.assertRaises(tiles.NoBase):
            self.whole([unhex("band raised")])
        self.assertEqual(self.whole(plain_bands(noise())), noise())

    def test_bands_of_noise(self):
        bands = plain_bands(noise())
        self.assertEqual(b"".join(band[:4] for band in bands), unhex("beginnings noise"))
        self.assertEqual(b"".join(blake3(band).digest() for band in bands), unhex("blake3 noise"))

    def test_tile_digests(self):
        unknown = array("H", [0]) * tiles.CELLS
        for name, codes in ("posts", posts()), ("plane", plane()), ("noise", noise()), ("unknown", unknown):
            self.assertEqual(tiles.tile_digest(codes), unhex(f"digest {name}"), name)
        self.assertEqual(tiles.UNKNOWN, unhex("digest unknown"))

    def test_root_digests(self):
        digests = {(3, -1): unhex("digest plane"), (-2, 5): unhex("digest noise"), (0, 0): tiles.UNKNOWN}
        self.assertEqual(blake3(unhex("root bytes")).digest(), unhex("root digest"))
        self.assertEqual(tiles.root_digest("elevation", 0.1, digests), unhex("root digest"))
        self.assertEqual(tiles.root_digest("elevation", 0.1, {}), unhex("root empty"))
        head = example("MapHead")[1]["layers"]
        self.assertEqual(tiles.root_digest("elevation", 0.1, {}), head[0]["root"])
        self.assertEqual(tiles.root_digest("obstacle", 0.1, {(-1, 2): unhex("digest posts")}), head[1]["root"])

    def test_wrong_bands(self):
        good = unhex("band posts")
        for what, band in [
            ("bytes behind", good + bytes(9)),
            ("other version", b"\1" + good[1:]),
            ("no rows", b"\2\0\0\0"),
            ("too many rows", b"\2\1\x40" + good[3:]),
            ("other coding", good[:3] + b"\3" + good[4:]),
            ("part of the rows, modelled", b"\2\0\x20" + good[3:]),
            ("fewer bytes than cells", b"\2\0\x20\0" + bytes(100)),
            ("too long", b"\2\0\x40\0" + bytes(8192)),
            ("codes beyond the layer's greatest", b"\2\0\1\0" + b"\3" * 64 + bytes(64)),
        ]:
            with self.subTest(what), self.assertRaises(wire.Malformed):
                tiles.decode_band(band, "obstacle", None)

    def test_damaged_bands_raise_nothing_but_malformed(self):
        random.seed(2)
        for _ in range(60):
            band = bytearray(unhex(random.choice(["band raised", "band plane"])))
            band[random.randrange(len(band))] = random.randrange(256)
            try:
                tiles.decode_band(bytes(band), "elevation", plane())
            except wire.Malformed:
                pass

    def test_probabilities(self):
        self.assertTrue(math.isnan(dequantise(0)))
        self.assertEqual((dequantise(1), dequantise(251)), (0.0, 1.0))
        self.assertEqual(struct.pack("<f", dequantise(26)), struct.pack("<f", 0.1))


class Robot:
    """What a robot says, for one layer of obstacles."""

    def __init__(self, boot: bytes = bytes(16)):
        self.boot, self.seq, self.epoch, self.revision, self.held = boot, 0, 0, 0, {}
        self.page = 100  # tiles in a list of digests

    def header(self) -> wire.Header:
        self.seq += 1
        return wire.Header(self.boot, self.seq)

    def put(self, at, codes: array):
        self.revision += 1
        self.held[at] = (self.revision, tiles.tile_digest(codes), codes)

    def info(self):
        return self.header(), {"layers": [{"layer": "obstacle", "cell_m": 0.1}]}

    def head(self):
        root = tiles.root_digest("obstacle", 0.1, {at: digest for at, (_, digest, _) in self.held.items()})
        said = {"layer": "obstacle", "epoch": self.epoch, "head_revision": self.revision, "tiles": 0, "root": root}
        return self.header(), {"layers": [said]}

    def bands(self, at) -> list[dict]:
        revision, digest, codes = self.held[at]
        band = {"epoch": self.epoch, "revision": revision, "base": 0, "check": digest[:8]}
        return [band | {"rows": rows} for rows in plain_bands(codes)]

    def answer(self, ask) -> list[dict]:
        if ask.what == "digests":
            by_revision = sorted(self.held.items(), key=lambda held: held[1][0])
            newer = [(at, tile) for at, tile in by_revision if tile[0] > ask.body["newer_than"]]
            newer, more = newer[: self.page], len(newer[self.page :])  # no more fits an answer
            return [
                {
                    "epoch": self.epoch,
                    "head_revision": self.revision,
                    "tiles": [{"tx": at[0], "ty": at[1], "revision": tile[0], "digest": tile[1]} for at, tile in newer],
                    "more": more,
                }
            ]
        these = [tuple(at) for at in ask.body["ByKey"] if tuple(at) in self.held][:2]  # no more fits an answer
        return [{"tx": at[0], "ty": at[1], "band": band} for at in these for band in self.bands(at)]


def painted(shade: int) -> array:
    return array("H", [shade]) * tiles.CELLS


class Rules(unittest.TestCase):
    def setUp(self):
        self.now = 0.0
        self.robot, self.map = Robot(), MapCopy()
        self.layer: Layer
        self.meet()

    def meet(self):
        self.map.take_head(*self.robot.head())
        self.map.take_info(*self.robot.info())
        self.layer = self.map.layers["obstacle"]

    def hear(self):
        self.map.take_head(*self.robot.head())

    def push(self, at):
        for band in self.robot.bands(at):
            self.map.take_band("obstacle", at, band)

    def heal(self, answer=None) -> list:
        """Runs the healing until it has nothing to ask; what it asked for."""
        healing, asks = self.map.healing(lambda: self.now), []
        ask = next(healing)
        while ask is not None:
            asks.append(ask)
            ask = healing.send((answer or self.robot.answer)(ask))
        return asks

    def in_step(self):
        self.assertTrue(self.map.is_synchronized())
        held = {at: tile[:2] for at, tile in self.layer.tiles.items() if tile.digest != tiles.UNKNOWN}
        self.assertEqual(held, {at: t[:2] for at, t in self.robot.held.items() if t[1] != tiles.UNKNOWN})

    def test_pushed_tiles(self):
        self.robot.put((0, 0), posts())
        self.push((0, 0))
        self.push((0, 0))  # a repetition
        self.hear()
        self.assertEqual(self.heal(), [])
        self.in_step()
        self.assertEqual(self.layer.known_cells(), 48 * 64)

    def test_joining_late(self):
        for x in range(5):
            self.robot.put((x, -x), posts())
        self.robot.put((9, 9), painted(0))
        self.map.position = (30.0, -30.0)
        self.hear()
        asks = self.heal()
        self.assertEqual([ask.what for ask in asks], ["digests", "tiles", "tiles", "tiles"])
        self.assertEqual(asks[1].body["ByKey"][0], [4, -4])  # the nearest
        self.in_step()

    def test_lost_tiles_are_asked_for_after_a_second_head(self):
        self.robot.put((0, 0), posts())
        self.push((0, 0))
        self.hear()
        self.robot.put((0, 1), posts())
        self.robot.put((0, 0), painted(0))
        self.hear()
        self.assertEqual(self.heal(), [])
        self.hear()
        self.assertEqual([ask.what for ask in self.heal()], ["digests", "tiles"])
        self.in_step()
        self.assertEqual(self.layer.newer_than, self.robot.revision)

    def test_forgotten_tiles_are_dropped(self):
        self.robot.put((0, 0), posts())
        self.robot.put((0, 1), posts())
        self.push((0, 0))
        self.push((0, 1))
        del self.robot.held[0, 0]
        self.hear()
        self.hear()
        self.layer.newer_than = 2  # does not tell of what is not there any more
        self.heal()
        self.assertFalse(self.map.is_synchronized())
        self.hear()
        self.heal()
        self.in_step()

    def test_silence_is_not_an_empty_map(self):
        self.robot.put((0, 0), posts())
        self.push((0, 0))
        self.robot.put((0, 0), painted(1))
        for _ in range(3):
            self.hear()
        self.assertEqual(len(self.heal(lambda ask: [])), 1)
        self.assertEqual(len(self.layer.tiles), 1)
        self.now = 0.4
        self.assertEqual(self.heal(), [])
        self.now = 0.6
        self.heal()
        self.in_step()

    def test_an_old_boot_does_not_come_back(self):
        self.robot.put((0, 0), posts())
        self.push((0, 0))
        old, self.robot = self.robot, Robot(b"b" * 16)
        self.assertTrue(self.map.take_head(*self.robot.head()))
        self.assertFalse(self.map.take_head(*old.head()))
        self.assertFalse(self.map.take_info(*old.info()))
        self.assertEqual((self.map.boot, self.map.mapped()), (self.robot.boot, []))
        self.meet()
        self.in_step()

    def test_epochs(self):
        self.robot.put((0, 0), posts())
        old = self.robot.bands((0, 0))
        self.push((0, 0))
        self.robot.epoch, self.robot.held = 1, {}
        self.robot.put((5, 5), posts())
        self.push((5, 5))
        for band in old:
            self.map.take_band("obstacle", (0, 0), band | {"revision": 99})
        self.hear()
        self.in_step()

    def test_differences_need_the_tile_that_they_are_to(self):
        # All 4096 bits say that nothing differs.
        same = {"epoch": 0, "revision": 2, "base": 1, "check": unhex("digest posts")[:8], "rows": b"\2\0\x40\2"}
        self.map.take_band("obstacle", (0, 0), same)
        self.assertEqual((self.layer.tiles, self.layer.mismatched_heads), ({}, 2))
        self.assertEqual(self.map.counts["differences to a tile that was missed"], 1)
        self.robot.put((0, 0), posts())
        self.push((0, 0))
        self.map.take_band("obstacle", (0, 0), same)
        self.assertEqual((self.layer.revision((0, 0)), self.layer.tiles[0, 0].codes), (2, posts()))

    def test_wrong_tiles_are_not_held(self):
        self.robot.put((0, 0), posts())
        first, second = self.robot.bands((0, 0))
        self.map.take_band("obstacle", (0, 0), first)
        with self.assertRaises(wire.Malformed):
            self.map.take_band("obstacle", (0, 0), second | {"rows": plain_bands(painted(1))[1]})
        self.assertEqual((self.layer.tiles, self.layer.partial), ({}, {}))
        # A wrong check that is never completed does not keep the right tile out.
        self.map.take_band("obstacle", (0, 0), first | {"check": bytes(8)})
        self.push((0, 0))
        self.hear()
        self.in_step()

    def test_lists_come_in_pages(self):
        for tile in range(7):
            self.robot.put((tile, -tile), painted(1 + tile % 2))
        self.robot.page = 2
        self.hear()
        self.hear()
        asks = self.heal()
        self.assertEqual([ask.what for ask in asks][:5], ["digests"] * 4 + ["tiles"])
        self.in_step()
        self.assertEqual(len(self.layer.tiles), 7)

    def test_incomplete_answers_are_not_taken(self):
        page = {"epoch": 0, "head_revision": 1, "tiles": [], "more": 0}
        self.assertIsNone(one_page([]))
        self.assertIsNone(one_page([page, page]))
        self.assertIsNone(one_page([page | {"more": 1}]))
        self.assertIsNotNone(one_page([page]))


if __name__ == "__main__":
    unittest.main()
