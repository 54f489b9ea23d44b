"""A ROS 2 node that is not ours receives what the edge publishes, and compares it with the edge's own export.

    python ros2_client.py --port 7447 --export DIR --hashes nav_msgs/Path=RIHS01_... ...

The node is `zenoh-ros2-sdk`; `rosbags` decodes the messages and computes the hashes of their definitions. The client subscribes at
once ("early") and again when nothing has changed for some seconds ("late"), prints "received", and waits until the robot has
written its export to DIR. Then it compares, cell by cell. `bt2vrml` of OctoMap reads the voxels, if it is there.
"""

import argparse
import math
import os
import shutil
import struct
import subprocess
import sys
import time
import traceback
from pathlib import Path

import geotiff
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from zenoh_ros2_sdk import ROS2Subscriber
from zenoh_ros2_sdk.discovery import get_topic_names_and_types
from zenoh_ros2_sdk.qos import QosDurability, QosProfile
from zenoh_ros2_sdk.session import ZenohSession

# Definitions that rosbags lacks: map_msgs 2.4 (ros-planning/navigation_msgs), octomap_msgs 2.0 (OctoMap/octomap_msgs) and
# grid_map_msgs 2.2 (ANYbotics/grid_map, branch jazzy), without their comments, which are no part of the hash.
DEFINITIONS = {
    "map_msgs/msg/OccupancyGridUpdate": """
        std_msgs/Header header
        int32 x
        int32 y
        uint32 width
        uint32 height
        int8[] data""",
    "octomap_msgs/msg/Octomap": """
        std_msgs/Header header
        bool binary
        string id
        float64 resolution
        int8[] data""",
    "grid_map_msgs/msg/GridMapInfo": """
        float64 resolution
        float64 length_x
        float64 length_y
        geometry_msgs/Pose pose""",
    "grid_map_msgs/msg/GridMap": """
        std_msgs/Header header
        grid_map_msgs/GridMapInfo info
        string[] layers
        string[] basic_layers
        std_msgs/Float32MultiArray[] data
        uint16 outer_start_index
        uint16 inner_start_index""",
}
KEPT = ["/map", "/cost_map", "/elevation", "/octomap"]
GRIDS = ["/map", "/cost_map"]
QUIET_S = 12.0  # longer than the period after which the whole grid follows its updates, and than a busy machine pauses
TIMEOUT_S = 300.0


def typestore():
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text.replace("        ", "").strip(), name))
    return store


def check_hashes(store, expected):
    for pair in expected:
        name, value = pair.split("=")
        computed = store.hash_rihs01(name.replace("/", "/msg/"))
        assert computed == value, f"{name}: {value}, by rosbags {computed}"
    print(f"hashes: {len(expected)} as rosbags computes them", flush=True)


def stamp_of(message):
    return message.header.stamp.sec, message.header.stamp.nanosec


class Grid:
    """A grid and its updates, as RViz puts them together. Wholes that follow updates are compared with it: the same unless more
    changed in between."""

    def __init__(self):
        self.message, self.cells, self.stamp = None, None, None
        self.wholes, self.updates, self.same = 0, 0, 0

    def whole(self, message):
        was_updated = self.message is not None and self.stamp != stamp_of(self.message)
        if was_updated and self.stamp == stamp_of(message) and len(self.cells) == len(message.data):
            self.same += bool((self.cells == message.data).all())
        self.message, self.cells, self.stamp = message, message.data.copy(), stamp_of(message)
        self.wholes += 1

    def update(self, message):
        """Topics have no order among each other: an update may come before the whole that it belongs to."""
        if self.message is None or message.x + message.width > self.message.info.width:
            return
        if message.y + message.height > self.message.info.height or stamp_of(message) < self.stamp:
            return
        self.updates += 1
        self.stamp = stamp_of(message)
        width = self.message.info.width
        for row in range(message.height):
            at = (message.y + row) * width + message.x
            self.cells[at : at + message.width] = message.data[row * message.width :][: message.width]


class Node:
    def __init__(self, port, store):
        self.port, self.store = port, store
        session = ZenohSession.get_instance("127.0.0.1", port)
        # Else the package fetches definitions from the network.
        session.store = store
        session._registered_types = {name: name for name in store.types}
        self.changed = time.monotonic()

    def topics(self):
        return dict(get_topic_names_and_types(0, "127.0.0.1", self.port))

    def subscribe(self, topic, type_name, callback, keeps=False):
        def called(message):
            if keeps or topic in KEPT or topic.endswith("_updates"):
                self.changed = time.monotonic()
            callback(message)

        durability = QosDurability.TRANSIENT_LOCAL if keeps else QosDurability.VOLATILE
        return ROS2Subscriber(
            topic,
            type_name,
            called,
            msg_definition="",
            domain_id=0,
            router_port=self.port,
            type_hash=self.store.hash_rihs01(type_name),
            qos=QosProfile(durability=durability, history_depth=1),
        )


def wait_until(what, is_so):
    began = time.monotonic()
    while not is_so():
        assert time.monotonic() - began < TIMEOUT_S, f"waited too long for {what}"
        time.sleep(0.1)


def receive(port, store):
    """Early grids, late messages by topic, and the last message of each topic."""
    node = Node(port, store)
    wait_until("topics", lambda: set(KEPT) <= set(node.topics()))
    topics = node.topics()
    for topic, types in sorted(topics.items()):
        print(f"topic: {topic} {' '.join(types)}", flush=True)
    grids, last = {topic: Grid() for topic in GRIDS}, {}
    subscribers = []
    for topic, (type_name, *_) in topics.items():
        base = topic.removesuffix("_updates")
        if topic in grids:
            callback = grids[topic].whole
        elif base in grids:
            callback = grids[base].update
        else:
            callback = lambda message, topic=topic: last.__setitem__(topic, message)
        subscribers.append(node.subscribe(topic, type_name, callback))
    wait_until("grids", lambda: all(grid.message for grid in grids.values()))
    print("subscribed", flush=True)
    wait_until("rest", lambda: time.monotonic() - node.changed > QUIET_S)
    # The cost map changes with nearly every scan, so that its wholes have more than the updates before them.
    assert grids["/map"].same > 0, "/map: its updates never gave the whole"
    late = {}
    for topic in KEPT:
        take = lambda message, topic=topic: late.__setitem__(topic, message)
        subscribers.append(node.subscribe(topic, topics[topic][0], take, keeps=True))
    wait_until("late messages", lambda: set(late) == set(KEPT))
    for topic, grid in grids.items():
        assert grid.updates > 0, f"{topic}: no update came"
        same = lambda: len(grid.cells) == len(late[topic].data) and (grid.cells == late[topic].data).all()
        wait_until(f"the same {topic}, early and late", same)
        print(f"rebuilt: {topic} {len(grid.cells)} cells of {grid.wholes} wholes and {grid.updates} updates, {grid.same} times the same", flush=True)
    return late, last


def cell_of(message, column, row):
    return message.data[row * message.info.width + column]


def compare_grid(topic, message, width, height, corner, expected):
    """`expected(column, row)` from the lower left, of a rectangle with the corner in metres; all else is unknown."""
    info = message.info
    place = (info.origin.position.x, info.origin.position.y)
    first = [round((corner[axis] - place[axis]) / info.resolution) for axis in range(2)]
    known = 0
    for row in range(info.height):
        for column in range(info.width):
            x, y = column - first[0], row - first[1]
            inside = 0 <= x < width and 0 <= y < height
            wanted = expected(x, y) if inside else -1
            value = cell_of(message, column, row)
            assert value == wanted, f"{topic}: {value} at {x}, {y}, in the export {wanted}"
            known += value != -1
    assert known > 0, f"{topic}: nothing is known"
    print(f"same as the export: {topic} {known} cells known", flush=True)


def read_pgm(export, name):
    """Width, height, lower left corner and pixels of a map of Nav2's map_server."""
    _, size, _, pixels = (export / f"{name}.pgm").read_bytes().split(b"\n", 3)
    width, height = map(int, size.split())
    yaml = dict(line.split(": ", 1) for line in (export / f"{name}.yaml").read_text().splitlines())
    corner = [float(part) for part in yaml["origin"].strip("[]").split(",")]
    return width, height, corner, pixels


def compare_map(message, export):
    """By the rule of map_server, mode trinary."""
    width, height, corner, pixels = read_pgm(export, "occupancy")
    values = {0: 100, 254: 0, 205: -1}
    compare_grid("/map", message, width, height, corner, lambda x, y: values[pixels[(height - 1 - y) * width + x]])


def cost_value(cost):
    if math.isnan(cost):
        return -1
    return 100 if cost >= 1.0 else math.floor(cost * 98.0 + 0.5)


def compare_costs(message, export):
    tiff = geotiff.read(export / "cost.tif")
    corner = (tiff.west, tiff.north - tiff.height * tiff.cell)
    at = lambda x, y: cost_value(tiff.values[(tiff.height - 1 - y) * tiff.width + x])
    compare_grid("/cost_map", message, tiff.width, tiff.height, corner, at)


def compare_heights(message, export):
    """Positions by the convention of grid_map: index 0, 0 has the greatest x and y; the data are column-major."""
    tiff = geotiff.read(export / "elevation.tif")
    (array,) = message.data
    columns, rows = (dim.size for dim in array.layout.dim)
    assert [dim.label for dim in array.layout.dim] == ["column_index", "row_index"]
    assert message.layers == message.basic_layers == ["elevation"]
    assert (rows, columns) == (tiff.width, tiff.height), "another size"
    info, known = message.info, 0
    for column in range(columns):
        for row in range(rows):
            x = info.pose.position.x + info.length_x / 2 - (row + 0.5) * info.resolution
            y = info.pose.position.y + info.length_y / 2 - (column + 0.5) * info.resolution
            at = math.floor((tiff.north - y) / tiff.cell) * tiff.width + math.floor((x - tiff.west) / tiff.cell)
            value, wanted = array.data[column * rows + row], tiff.values[at]
            assert value == wanted or (math.isnan(value) and math.isnan(wanted)), f"{value} at {x}, {y}: {wanted}"
            known += not math.isnan(value)
    print(f"same as the export: /elevation {known} cells known", flush=True)


def compare_obstacles(message, export):
    width, height, corner, pixels = read_pgm(export, "obstacle")
    heights = geotiff.read(export / "elevation.tif")
    raw, found = message.data.tobytes(), set()
    for at in range(message.width):
        x, y, z = struct.unpack_from("<fff", raw, at * message.point_step)
        column, row = math.floor((x - heights.west) / heights.cell), math.floor((heights.north - y) / heights.cell)
        inside = 0 <= column < heights.width and 0 <= row < heights.height
        value = heights.values[row * heights.width + column] if inside else math.nan
        assert z == (0.0 if math.isnan(value) else value), f"{x} {y}: {z}, in the export {value}"
        # The cells of both layers are of one size.
        found.add(tuple(math.floor((p - c) / heights.cell) for p, c in zip((x, y), corner)))
    at = lambda place: pixels[(height - 1 - place[1]) * width + place[0]]
    assert all(at(place) == 0 for place in found), "a point without an obstacle"
    assert len(found) == message.width == pixels.count(0), "not all obstacles"
    print(f"same as the export: /obstacles {len(found)} points", flush=True)


def compare_voxels(message, export):
    tree = message.data.tobytes()
    header, exported = (export / "voxels.bt").read_bytes().split(b"\ndata\n", 1)
    assert (message.binary, message.id) == (True, "OcTree")
    assert tree == exported, "the tree is another"
    nodes = 1 + sum((byte >> pair) & 3 != 0 for byte in tree for pair in (0, 2, 4, 6))
    assert f"size {nodes}\nres {message.resolution:g}" in header.decode(), header
    print(f"same as the export: /octomap {nodes} nodes", flush=True)
    if shutil.which("bt2vrml") is None:
        print("skipped: there is no program bt2vrml (package octomap-tools)", flush=True)
        return
    received = export / "received.bt"
    received.write_bytes(
        f"# Octomap OcTree binary file\nid OcTree\nsize {nodes}\nres {message.resolution}\ndata\n".encode() + tree
    )
    boxes = []
    for file in (received, export / "voxels.bt"):
        subprocess.run(["bt2vrml", file], check=True, capture_output=True)
        # A comment names the file.
        boxes.append([line for line in Path(f"{file}.wrl").read_text().splitlines() if not line.startswith("#")])
    count = sum("Transform" in line for line in boxes[0])
    assert boxes[0] == boxes[1] and count > 0
    print(f"same by OctoMap: {count} boxes", flush=True)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--export", type=Path, required=True)
    parser.add_argument("--hashes", nargs="+", required=True)
    args = parser.parse_args()
    store = typestore()
    check_hashes(store, args.hashes)
    late, last = receive(args.port, store)
    frames = {(transform.header.frame_id, transform.child_frame_id) for transform in last["/tf"].transforms}
    assert frames == {("map", "odom"), ("odom", "base_link")}, frames
    assert last["/foreshore/odometry"].child_frame_id == "base_link"
    print(f"received: a path of {len(last['/foreshore/path'].poses)} poses", flush=True)
    # Written last.
    wait_until("the export", (args.export / "voxels.bt").exists)
    time.sleep(2.0)
    compare_map(late["/map"], args.export)
    compare_costs(late["/cost_map"], args.export)
    compare_heights(late["/elevation"], args.export)
    compare_obstacles(last["/obstacles"], args.export)
    compare_voxels(late["/octomap"], args.export)


if __name__ == "__main__":
    code = 1
    try:
        main()
        code = 0
    except Exception:
        traceback.print_exc()
    # The session of the package has threads that do not end.
    sys.stdout.flush()
    os._exit(code)
