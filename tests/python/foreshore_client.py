#!/usr/bin/env python3
"""Follows a Foreshore robot over the network and holds the same map as it does.

Written from protocol/SPEC.md alone. Each thing that comes is checked before it is believed, each tile and
each layer against its digest. One thread: Zenoh collects what comes in bounded channels, `Client.step`
empties them.

    python foreshore_client.py --connect tcp/127.0.0.1:7447 --until-ended --out OUT --compare EXPORT

With --until-ended it leaves when the robot's data has ended and every layer is synchronized; it exits with 0 then,
and with 1 if that took longer than --timeout. --out writes what it holds as OUT/LAYER.json: cell size, root
digest, and [tx, ty, revision, digest] of each tile with a known cell. --compare waits until the robot has
written its export into that directory (a robot with --keep-serving does so when it is interrupted) and compares
`occupancy.tif` cell by cell.
"""

import argparse
import json
import math
import os
import queue
import re
import secrets
import sys
import threading
import time
from pathlib import Path

import zenoh

import geotiff
import wire
from map_copy import Request, Layer, MapCopy, Backoff, dequantise
from tiles import SIDE

NAME = re.compile(r"[A-Za-z0-9_-]{1,64}")
VIEW_EVERY_S = 0.5
VIEW_RADIUS_M = 50.0
QUERY_TIMEOUT_S = 8.0
MAX_REPLIES = 256  # kept of one answer
WAITING = 1024  # messages of one subscription that may wait to be read; the oldest give way


class Failure(Exception):
    """The error message before the program ends with 1."""


def bulk_endpoint(control: str) -> str:
    """The endpoint of the session that carries tiles: the next port."""
    parts = re.fullmatch(r"(tcp/.+:)(\d{1,5})([?#].*)?", control)
    if not parts or int(parts[2]) > 65534:
        raise Failure(f"{control} is not an endpoint such as tcp/127.0.0.1:7447")
    return f"{parts[1]}{int(parts[2]) + 1}{parts[3] or ''}"


def open_session(endpoint: str) -> zenoh.Session:
    config = zenoh.Config()
    for key, value in {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "connect/exit_on_failure": False,
        "connect/timeout_ms": -1,
        "connect/retry": {"period_init_ms": 500, "period_max_ms": 500, "period_increase_factor": 1},
        "listen/endpoints": [],
        "scouting/multicast/enabled": False,
    }.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def open_sessions(endpoints: list[str], timeout_s: float | None) -> list[zenoh.Session]:
    """Opens a session to each. `zenoh.open` with these settings blocks until the endpoint listens, so it is
    done in a thread, which is left behind if that takes too long."""
    opened = queue.SimpleQueue()

    def work():
        try:
            opened.put([open_session(endpoint) for endpoint in endpoints])
        except zenoh.ZError as error:
            opened.put(error)

    threading.Thread(target=work, daemon=True).start()
    try:
        sessions = opened.get(timeout=timeout_s)
    except queue.Empty:
        raise Failure(f"no listener at {' and '.join(endpoints)} after {timeout_s:g} s") from None
    if isinstance(sessions, zenoh.ZError):
        raise Failure(f"cannot connect to {' and '.join(endpoints)}: {sessions}")
    return sessions


def layer_of_key(key: str) -> str | None:
    """Layer out of foreshore/ROBOT/map/LAYER/changes."""
    *_, layer, what = key.split("/")
    return layer if layer in wire.LAYER_NAMES and what == "changes" else None


def site_letters(number: int) -> str:
    """The name of a docking site: letters without I and O, as columns of a spreadsheet."""
    alphabet, letters = "ABCDEFGHJKLMNPQRSTUVWXYZ", ""
    while number > 0:
        letters = alphabet[(number - 1) % len(alphabet)] + letters
        number = (number - 1) // len(alphabet)
    return letters


class Query:
    """A question under way, and what has come of its answer."""

    def __init__(self, session: zenoh.Session, key: str, payload: bytes | None = None):
        self.key, self.replies, self.is_done = key, [], False
        self.deadline = time.monotonic() + QUERY_TIMEOUT_S + 1
        self.answers = session.get(
            key,
            zenoh.handlers.FifoChannel(MAX_REPLIES),
            payload=payload,
            consolidation=zenoh.ConsolidationMode.NONE,
            congestion_control=zenoh.CongestionControl.DROP,
            timeout=QUERY_TIMEOUT_S,
        )

    def poll(self) -> bool:
        """Whether the answer has ended."""
        try:
            while not self.is_done and (reply := self.answers.try_recv()) is not None:
                if reply.ok is not None and str(reply.ok.key_expr) == self.key:
                    self.replies.append(reply.ok.payload.to_bytes())
                    self.is_done = len(self.replies) == MAX_REPLIES
        except zenoh.ZError:  # the channel is empty and closed
            self.is_done = True
        self.is_done = self.is_done or time.monotonic() > self.deadline
        return self.is_done


class Client:
    """Two sessions, and the copy of one robot's map."""

    def __init__(self, endpoint: str, robot: str | None = None, say=lambda line: None, timeout_s: float | None = None):
        self.say = say
        self.boot, self.seq = secrets.token_bytes(16), 0  # of what this client sends
        self.name = secrets.token_hex(16)
        self.map = MapCopy()
        self.pose = self.status = None
        self.ended = None  # header of the first status of this boot that said that the data has ended
        self.info_query = self.map_query = self.shores_query = None
        self.next_view = -math.inf
        self.control, self.bulk = open_sessions([endpoint, bulk_endpoint(endpoint)], timeout_s)
        self.alive = self.control.liveliness().declare_subscriber(
            "foreshore/*/alive", zenoh.handlers.RingChannel(WAITING), history=True
        )
        self.robot = None
        self.inputs = []
        self.restart()
        if robot is not None:
            self.follow(robot)

    def close(self):
        self.bulk.close()
        self.control.close()

    def follow(self, robot: str):
        """Rule 1 of section 9: what to subscribe to, then ask for `info`."""
        if not NAME.fullmatch(robot):
            raise Failure(f"{robot!r} is not the name of a robot")
        self.robot = robot
        for session, key, kind, longest, take in [
            (self.control, "map_head", wire.MAP_HEAD, wire.MAX_MESSAGE, self.take_head),
            (self.control, "pose", wire.POSE, wire.MAX_MESSAGE, self.take_pose),
            (self.control, "status", wire.STATUS, wire.MAX_MESSAGE, self.take_status),
            (self.control, "event", wire.EVENT, wire.MAX_MESSAGE, self.take_event),
            (self.bulk, "map/*/changes", wire.CHANGES, wire.MAX_TILE_MESSAGE, self.take_changes),
        ]:
            channel = session.declare_subscriber(self.key(key), zenoh.handlers.RingChannel(WAITING))
            self.inputs.append((channel, kind, longest, take))

    def key(self, rest: str) -> str:
        return f"foreshore/{self.robot}/{rest}"

    def message(self, kind, body) -> bytes:
        self.seq += 1
        return wire.encode(kind, wire.Header(self.boot, self.seq - 1), body)

    def restart(self):
        """Lets go of all that belongs to a boot before: questions under way and what is known of it."""
        self.healing, self.map_query = self.map.healing(time.monotonic), None
        self.info_query, self.info_backoff = None, Backoff()
        self.shores_query = self.shores = None
        self.pose = self.status = self.ended = None

    # ---- what comes in: each is given a header and a body that could be read

    def take_info(self, header, info, key):
        self.map.take_info(header, info)

    def take_head(self, header, head, key):
        if self.map.take_head(header, head):
            self.say(f"boot {header.boot.hex()}")
            self.restart()

    def take_pose(self, header, pose, key):
        if self.map.is_current_boot(header):
            if not all(map(math.isfinite, pose["position_m"])):
                raise wire.Malformed("position that is not finite")
            self.pose = pose
            self.map.position = tuple(pose["position_m"][:2])

    def take_status(self, header, status, key):
        if self.map.is_current_boot(header):
            self.status = status
            if not status["has_ended"]:
                self.ended = None
            elif self.ended is None:
                self.ended = header

    def take_shores(self, header, reply, key):
        if self.map.is_current_boot(header) and reply["shores"] is not None:
            self.shores = reply["shores"]

    def take_event(self, header, event, key):
        if self.map.is_current_boot(header):
            self.say(f"event {event['kind']!r}, {event['severity']}: {event['message']!r}")

    def take_changes(self, header, changes, key):
        if (layer := layer_of_key(key)) is None:
            raise wire.Malformed(f"key {key}")
        if self.map.is_current_boot(header):
            for tile in changes["tiles"]:
                self.map.take_band(layer, (tile["tx"], tile["ty"]), tile["band"])

    def take(self, kind, longest: int, payload: bytes, then, key: str = ""):
        """Reads a message and passes it on; counts what cannot be read."""
        try:
            return then(*wire.decode(kind, payload, longest), key)
        except wire.OtherVersion as error:
            if not self.map.counts["of another version"]:
                self.say(str(error))
            self.map.counts["of another version"] += 1
        except wire.Malformed as error:
            self.say(f"malformed: {error}")
            self.map.counts["malformed"] += 1

    # ---- one round

    def step(self):
        """Takes in what has come, asks for what is missing, and says what is looked at. Does not block."""
        if self.robot is None:
            self.discover_robot()
            return
        for channel, kind, longest, take in self.inputs:
            for _ in range(WAITING):
                if (sample := channel.try_recv()) is None:
                    break
                if sample.kind == zenoh.SampleKind.PUT:
                    self.take(kind, longest, sample.payload.to_bytes(), take, str(sample.key_expr))
        self.request_info()
        self.heal()
        if time.monotonic() >= self.next_view:
            self.send_view()

    def discover_robot(self):
        while (sample := self.alive.try_recv()) is not None:
            robot = str(sample.key_expr).split("/")[1]
            if sample.kind == zenoh.SampleKind.PUT and NAME.fullmatch(robot):
                self.say(f"robot {robot}")
                return self.follow(robot)

    def request_info(self):
        if self.map.info is not None:
            return
        if self.info_query is None:
            if time.monotonic() >= self.info_backoff.until:
                self.info_query = Query(self.control, self.key("info"))
        elif self.info_query.poll():
            replies, self.info_query = self.info_query.replies, None
            for payload in replies[:1]:
                self.take(wire.INFO, wire.MAX_MESSAGE, payload, self.take_info)
            if self.map.info is None:
                self.info_backoff.failed(time.monotonic())

    def request_shores(self) -> bool:
        """Asks for the shores until they came; whether they did."""
        if self.shores is None and self.shores_query is None:
            body = self.message(wire.SHORES_REQUEST, {"newer_than": 0})
            self.shores_query = Query(self.bulk, self.key("shores"), body)
        elif self.shores is None and self.shores_query.poll():
            replies, self.shores_query = self.shores_query.replies, None
            for payload in replies[:1]:
                self.take(wire.SHORES_REPLY, wire.MAX_MESSAGE, payload, self.take_shores)
        return self.shores is not None

    def heal(self):
        """Drives `MapCopy.healing`: at most one question about the map is under way."""
        answer = None
        if self.map_query is not None:
            ask, query = self.map_query
            if not query.poll():
                return
            answer, self.map_query = self.bodies(ask, query.replies), None
        if (ask := self.healing.send(answer)) is not None:
            kind = wire.DIGESTS_REQUEST if ask.what == "digests" else wire.TILES_REQUEST
            query = Query(self.bulk, self.key(f"map/{ask.layer}/{ask.what}"), self.message(kind, ask.body))
            self.map_query = ask, query

    def bodies(self, ask: Request, replies: list[bytes]) -> list[dict]:
        kind, longest = (
            (wire.DIGESTS, wire.MAX_MESSAGE) if ask.what == "digests" else (wire.TILES_REPLY, wire.MAX_TILE_MESSAGE)
        )
        bodies = []

        def take_body(header, body, key):
            if self.map.is_current_boot(header):
                bodies.append(body)

        for payload in replies:
            self.take(kind, longest, payload, take_body)
        return bodies

    def send_view(self):
        x, y = self.map.position
        layers = [layer.name for layer in self.map.mapped()] or wire.LAYER_NAMES
        view = {
            "rectangle_m": [x - VIEW_RADIUS_M, y - VIEW_RADIUS_M, x + VIEW_RADIUS_M, y + VIEW_RADIUS_M],
            "layers": sum(1 << wire.LAYER_NAMES.index(name) for name in layers),
            "revision": self.map.newest_revision(),
            "is_synchronized": self.map.is_synchronized(),
            "wants_scan": False,
        }
        self.control.put(self.key(f"view/{self.name}"), self.message(wire.VIEW, view))
        self.next_view = time.monotonic() + VIEW_EVERY_S

    def has_all(self) -> bool:
        """Whether the robot's data has ended, and what is held is the map of all of it.

        The head before the first status that says so may be of earlier data, and a robot may leave without
        another head. So the newest must have been sent after that status, or tell of the same data.
        """
        head, ended = self.map.head_header, self.ended
        if head is None or ended is None or not self.map.is_synchronized():
            return False
        return head.seq > ended.seq or head.robot_time_ns >= ended.robot_time_ns

    def describe(self) -> str:
        layers = ", ".join(
            f"{layer.name} {len(layer.tiles)} tiles {'synchronized' if layer.is_synchronized() else 'not synchronized'}"
            for layer in self.map.mapped()
        )
        drops = ", ".join(f"{count} {reason}" for reason, count in sorted(self.map.counts.items()))
        end = "; its data has ended" if self.ended else ""
        drops = f" (dropped: {drops})" if drops else ""
        return f"robot {self.robot}: {layers or 'no answer to info yet'}{end}{drops}"


def write_layer(layer: Layer, directory: Path):
    tiles = [
        [*at, tile.revision, tile.digest.hex()] for at, tile in sorted(layer.tiles.items()) if tile.codes is not None
    ]
    content = {"cell_m": layer.cell_m, "root": layer.root().hex(), "tiles": tiles}
    directory.mkdir(parents=True, exist_ok=True)
    (directory / f"{layer.name}.json").write_text(json.dumps(content) + "\n")


def compare(layer: Layer, grid: geotiff.Grid) -> int:
    """Compares an occupancy layer with an exported grid, cell by cell; the number of cells known in both."""
    if grid.cell != layer.cell_m:
        raise Failure(f"cells of {grid.cell} m in the export, of {layer.cell_m} m in the map")
    left, top = round(grid.west / grid.cell), round(grid.north / grid.cell) - 1  # the cell of row 0, column 0
    values = [dequantise(code) for code in range(252)]
    known = 0
    for row in range(grid.height):
        for column in range(grid.width):
            cx, cy = left + column, top - row
            tile = layer.tiles.get((cx // SIDE, cy // SIDE))
            code = tile.codes[SIDE * (cy % SIDE) + cx % SIDE] if tile and tile.codes else 0
            exported = grid.values[row * grid.width + column]
            if exported != values[code] and not (code == 0 and math.isnan(exported)):
                raise Failure(f"cell ({cx}, {cy}): {exported} in the export, {values[code]} (code {code}) in the map")
            known += code != 0
    if known != layer.known_cells():
        raise Failure(f"{layer.known_cells() - known} known cells lie outside of the exported grid")
    return known


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--connect", required=True, metavar="tcp/HOST:PORT", help="the robot's control endpoint")
    parser.add_argument("--robot", metavar="ID", help="which robot [default: the first that is alive]")
    parser.add_argument("--until-ended", action="store_true", help="leave when the data has ended and all is synchronized")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write what is held, one JSON for each layer")
    parser.add_argument(
        "--compare",
        "--export-dir-of-edge",
        type=Path,
        metavar="DIR",
        help="wait for the robot's export in this directory and compare the cells of occupancy",
    )
    parser.add_argument("--timeout", type=float, default=120.0, metavar="S", help="give up after this long [120]")
    parser.add_argument("--verbose", action="store_true", help="say what is held and what is dropped")
    args = parser.parse_args()
    if (args.compare or args.out) and not args.until_ended:
        parser.error("--out and --compare need --until-ended")
    return args


def run(args: argparse.Namespace):
    # An export that is older than this run is that of another.
    began, deadline = time.time(), time.monotonic() + args.timeout

    def say(line: str):
        if args.verbose:
            print(line, file=sys.stderr, flush=True)

    client = Client(args.connect, args.robot, say, args.timeout if args.until_ended else None)

    def follow_until(is_reached, what: str):
        """Follows the robot until `is_reached` returns something."""
        next_line = 0.0
        while not (result := is_reached()):
            if args.until_ended and time.monotonic() > deadline:
                raise Failure(f"not {what} after {args.timeout:g} s; {client.describe()}")
            if client.map.is_full:
                raise Failure(f"the map is larger than this client keeps; {client.describe()}")
            if time.monotonic() >= next_line:
                say(client.describe())
                next_line = time.monotonic() + 1.0
            client.step()
            time.sleep(0.01)
        return result

    def export():
        path = args.compare / "occupancy.tif"
        try:
            return geotiff.read(path) if os.stat(path).st_mtime >= began else None
        except (FileNotFoundError, ValueError):  # not yet, or not yet whole
            return None

    try:
        follow_until(lambda: args.until_ended and client.has_all(), "synchronized with a robot whose data has ended")
        client.send_view()  # a robot that is about to end waits for consoles that are not synchronized
        for layer in client.map.mapped():
            print(f"synchronized: {layer.name} {layer.known_cells()} cells known, root {layer.root().hex()}", flush=True)
            if args.out:
                write_layer(layer, args.out)
        if any(layer.name == "shore" for layer in client.map.mapped()):
            follow_until(client.request_shores, "in possession of the shores")
            clusters = [f"{shore['number']} {shore['class'].lower()}" for shore in client.shores["clusters"]]
            sites = [site_letters(site["number"]) for site in client.shores["sites"]]
            print(f"shores: {', '.join(clusters)}; docking sites: {', '.join(sites)}", flush=True)
        if args.compare:
            occupancy = client.map.layers["occupancy"]
            grid = follow_until(export, f"in possession of a new, readable {args.compare / 'occupancy.tif'}")
            print(f"same as the export: occupancy {compare(occupancy, grid)} cells", flush=True)
        say(client.describe())
    finally:
        client.close()


def main() -> int:
    try:
        run(arguments())
    except Failure as failure:
        print(f"failed: {failure}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
