"""A minimal planner that is not ours: A* over the map of the edge, and a pursuit of the path.

    python ros2_planner.py --port 7447

A node of `zenoh-ros2-sdk`: it takes `/goal_pose`, `/map` and `/foreshore/odometry`, and publishes `/plan` and, 20 times a second while it
has a goal, `/cmd_vel_nav`. At a goal it sends zero and falls silent. Lines on standard input are what goes wrong with it: `nan`, `flood`,
or `sane` again. Frames: without corrections, `odom` is the map.
"""

import argparse
import heapq
import math
import os
import sys
import threading
import time

import numpy as np
from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk import ROS2Publisher, ROS2Subscriber
from zenoh_ros2_sdk.qos import QosDurability, QosProfile
from zenoh_ros2_sdk.session import ZenohSession

PERIOD_S = 0.05
REPLAN_S = 1.0
SPEED_MPS = 0.5
TURN_RADPS = 1.0
# From the middle of the robot to where it must not come near an obstacle: half its width, the margin of the collision monitor, a cell.
BLOCKED_M = 0.3
# Farther from obstacles is better up to here.
WIDE_M = 0.8
LOOK_AHEAD_M = 0.4
REACHED_M = 0.15


def turned(angle):
    return math.atan2(math.sin(angle), math.cos(angle))


class Costs:
    """Cost of each cell of an occupancy grid, infinite where the robot does not fit. Unknown cells are free and dear."""

    def __init__(self, grid):
        info = grid.info
        self.cell = info.resolution
        self.origin = info.origin.position.x, info.origin.position.y
        cells = np.asarray(grid.data, dtype=np.int8).reshape(info.height, info.width)
        # Beyond the grid nothing is known: a goal may lie there.
        self.pad = round(20.0 / self.cell)
        cells = np.pad(cells, self.pad, constant_values=-1)
        steps = self.steps_from(cells >= 50, round(WIDE_M / self.cell))
        self.costs = 1.0 + 4.0 * np.clip(1.0 - steps * self.cell / WIDE_M, 0.0, 1.0)
        self.costs[cells < 0] += 2.0
        self.costs[steps * self.cell < BLOCKED_M] = np.inf

    @staticmethod
    def steps_from(blocked, most):
        """Distance to the next blocked cell, in cells, at most `most`."""
        steps = np.full(blocked.shape, float(most))
        ys, xs = np.nonzero(blocked)
        for dy in range(-most, most + 1):
            for dx in range(-most, most + 1):
                distance = math.hypot(dx, dy)
                if distance < most:
                    y, x = ys + dy, xs + dx
                    inside = (y >= 0) & (y < steps.shape[0]) & (x >= 0) & (x < steps.shape[1])
                    np.minimum.at(steps, (y[inside], x[inside]), distance)
        return steps

    def cell_of(self, x, y):
        column = math.floor((x - self.origin[0]) / self.cell) + self.pad
        row = math.floor((y - self.origin[1]) / self.cell) + self.pad
        return row, column

    def point_of(self, row, column):
        return self.origin[0] + (column - self.pad + 0.5) * self.cell, self.origin[1] + (row - self.pad + 0.5) * self.cell

    def path(self, start, goal):
        """Points from the one to the other; empty where there is no way."""
        start, goal = self.cell_of(*start), self.cell_of(*goal)
        height, width = self.costs.shape
        if not all(0 <= row < height and 0 <= column < width for row, column in (start, goal)):
            return []
        costs = self.costs
        came, cost_to = {}, {start: 0.0}
        heap = [(0.0, start)]
        while heap:
            _, at = heapq.heappop(heap)
            if at == goal:
                break
            for dy, dx in ((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
                beside = at[0] + dy, at[1] + dx
                if not (0 <= beside[0] < height and 0 <= beside[1] < width):
                    continue
                step = costs[beside]
                # Out of a place that is too near to an obstacle there must be a way.
                if not math.isfinite(step):
                    if math.hypot(beside[0] - start[0], beside[1] - start[1]) * self.cell > BLOCKED_M:
                        continue
                    step = 20.0
                total = cost_to[at] + step * math.hypot(dx, dy)
                if total < cost_to.get(beside, math.inf):
                    cost_to[beside], came[beside] = total, at
                    heapq.heappush(heap, (total + math.hypot(goal[0] - beside[0], goal[1] - beside[1]), beside))
        if goal not in cost_to:
            return []
        cells = [goal]
        while cells[-1] != start:
            cells.append(came[cells[-1]])
        return [self.point_of(*cell) for cell in reversed(cells)]


class Planner:
    def __init__(self, port):
        store = get_typestore(Stores.ROS2_JAZZY)
        session = ZenohSession.get_instance("127.0.0.1", port)
        # Else the package fetches definitions from the network.
        session.store = store
        session._registered_types = {name: name for name in store.types}
        self.types, self.port = store.types, port
        self.hash_of = store.hash_rihs01
        self.pose = self.goal = self.grid = None
        self.path, self.mode = [], "sane"
        self.velocities = self.end(ROS2Publisher, "/cmd_vel_nav", "geometry_msgs/msg/Twist")
        self.plans = self.end(ROS2Publisher, "/plan", "nav_msgs/msg/Path")
        self.ends = [
            self.end(ROS2Subscriber, "/foreshore/odometry", "nav_msgs/msg/Odometry", self.take_pose),
            self.end(ROS2Subscriber, "/map", "nav_msgs/msg/OccupancyGrid", self.take_grid, keeps=True),
            self.end(ROS2Subscriber, "/goal_pose", "geometry_msgs/msg/PoseStamped", self.take_goal),
        ]

    def end(self, kind, topic, type_name, *callback, keeps=False):
        durability = QosDurability.TRANSIENT_LOCAL if keeps else QosDurability.VOLATILE
        args = (topic, type_name, *callback)
        return kind(
            *args,
            msg_definition="",
            domain_id=0,
            router_port=self.port,
            type_hash=self.hash_of(type_name),
            qos=QosProfile(durability=durability, history_depth=1),
        )

    def take_pose(self, message):
        at, q = message.pose.pose.position, message.pose.pose.orientation
        self.pose = at.x, at.y, math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))

    def take_grid(self, message):
        self.grid = message

    def take_goal(self, message):
        at = message.pose.position
        assert message.header.frame_id == "map", message.header.frame_id
        self.path, self.goal = [], (at.x, at.y)
        print(f"goal {at.x:.3f} {at.y:.3f}", flush=True)

    def publish_path(self, path):
        t = self.types
        header = t["std_msgs/msg/Header"](stamp=t["builtin_interfaces/msg/Time"](sec=0, nanosec=0), frame_id="odom")
        upright = t["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
        place = t["geometry_msgs/msg/Point"]
        pose = lambda point: t["geometry_msgs/msg/Pose"](position=place(x=point[0], y=point[1], z=0.0), orientation=upright)
        poses = [t["geometry_msgs/msg/PoseStamped"](header=header, pose=pose(point)) for point in path]
        self.plans.publish(header=header, poses=poses)

    def plan_always(self):
        """On a thread of its own: velocities do not wait for it."""
        while True:
            time.sleep(0.02)
            goal, pose, grid = self.goal, self.pose, self.grid
            if goal is None or pose is None or grid is None:
                continue
            path = Costs(grid).path(pose[:2], goal)
            if self.goal is goal:
                self.path = path
                self.publish_path(path)
            began = time.monotonic()
            while self.goal is goal and self.path and time.monotonic() - began < REPLAN_S:
                time.sleep(0.02)

    def pursuit(self, pose, path):
        """Speed and turn rate towards a point of the path ahead."""
        x, y, yaw = pose
        distances = [math.hypot(px - x, py - y) for px, py in path]
        nearest = distances.index(min(distances))
        ahead = next((i for i in range(nearest, len(path)) if distances[i] >= LOOK_AHEAD_M), len(path) - 1)
        error = turned(math.atan2(path[ahead][1] - y, path[ahead][0] - x) - yaw)
        turn = max(-TURN_RADPS, min(TURN_RADPS, 2.0 * error))
        speed = 0.0 if abs(error) > 0.5 else min(SPEED_MPS, 0.1 + distances[-1]) * math.cos(2.0 * error)
        return max(speed, 0.0), turn

    def send(self, speed, turn):
        vector = self.types["geometry_msgs/msg/Vector3"]
        self.velocities.publish(linear=vector(x=speed, y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=turn))

    def drive(self):
        while True:
            time.sleep(PERIOD_S)
            goal, pose, path = self.goal, self.pose, self.path
            if goal is None or pose is None:
                continue
            if math.hypot(goal[0] - pose[0], goal[1] - pose[1]) < REACHED_M:
                self.goal, self.path = None, []
                self.send(0.0, 0.0)
                print("reached", flush=True)
            elif self.mode == "flood":
                ends = time.monotonic() + 2.0
                while time.monotonic() < ends:
                    self.send(SPEED_MPS, 0.0)
                self.goal, self.mode = None, "sane"
            elif self.mode == "nan":
                self.send(math.nan, 0.0)
            elif path:
                self.send(*self.pursuit(pose, path))
            else:
                self.send(0.0, 0.0)

    def run(self):
        for work in (self.plan_always, self.drive):
            threading.Thread(target=work, daemon=True).start()
        print("ready", flush=True)
        for line in sys.stdin:
            self.mode = line.strip()
            print(f"mode {self.mode}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--port", type=int, required=True)
    Planner(parser.parse_args().port).run()
    # The session of the package has threads that do not end.
    os._exit(0)
