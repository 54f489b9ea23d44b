"""An emulated ArduPilot Rover on one UDP or TCP port, by pymavlink, an implementation that is not ours.

It obeys velocities as Rover/GCS_MAVLink_Rover.cpp and mode_guided.cpp do: in mode GUIDED, armed, in the frames that Rover knows, and for
3 s. Lines on standard input are what happens to it; lines on standard output are what it does, with CLOCK_BOOTTIME in milliseconds.
"""

import math
import os
import select
import sys
import time

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as m

GUIDED = 15
TIMEOUT_S = 3.0
# Rover/GCS_MAVLink_Rover.cpp knows no other frames.
FRAMES = (m.MAV_FRAME_LOCAL_NED, m.MAV_FRAME_LOCAL_OFFSET_NED, m.MAV_FRAME_BODY_NED, m.MAV_FRAME_BODY_OFFSET_NED)
# Velocity and yaw rate, nothing else.
VELOCITY_AND_YAW_RATE = 0x5C7


def now_ms():
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME) // 1_000_000


def say(*words):
    print(now_ms(), *words, flush=True)


class Rover:
    def __init__(self, address):
        self.link = mavutil.mavlink_connection(address, source_system=1, source_component=1, dialect="ardupilotmega")
        self.is_armed = False
        self.mode = 0
        self.state = m.MAV_STATE_ACTIVE
        self.can_arm = False
        self.is_silent = False
        self.target = (0.0, 0.0)
        self.target_at = None
        self.periods = {}
        self.due = {}
        self.seen = set()
        self.wrong = set()
        self.shown_obstacles = None

    def send_as(self, system, component, send):
        mav = self.link.mav
        own = mav.srcSystem, mav.srcComponent
        mav.srcSystem, mav.srcComponent = system, component
        send(mav)
        mav.srcSystem, mav.srcComponent = own

    def heartbeat(self, mav, kind=m.MAV_TYPE_GROUND_ROVER):
        base = m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (m.MAV_MODE_FLAG_SAFETY_ARMED if self.is_armed else 0)
        mav.heartbeat_send(kind, m.MAV_AUTOPILOT_ARDUPILOTMEGA, base, self.mode, self.state)

    def arm(self):
        """What a ground station asks for; refused by the vehicle's own rules."""
        if self.can_arm:
            self.is_armed = True
        else:
            self.link.mav.statustext_send(m.MAV_SEVERITY_CRITICAL, b"Arm: RC not found")
        say("armed" if self.is_armed else "refused arming")

    def message(self, message):
        kind = message.get_type()
        if kind == "BAD_DATA":
            say("bad data")
        elif kind == "HEARTBEAT" and ("heartbeat", message.get_srcComponent()) not in self.seen:
            self.seen.add(("heartbeat", message.get_srcComponent()))
            say("heartbeat", message.get_srcSystem(), message.get_srcComponent(), message.type, message.autopilot)
        elif kind == "COMMAND_LONG":
            self.command(message)
        elif kind == "SET_POSITION_TARGET_LOCAL_NED":
            self.velocity(message)
        elif kind == "OBSTACLE_DISTANCE":
            self.obstacles(message)

    def obstacles(self, message):
        """Every ninth of the 72 distances: 45 degrees apart, clockwise from ahead."""
        is_right = message.frame == m.MAV_FRAME_BODY_FRD and message.increment == message.increment_f == 5 and message.angle_offset == 0
        line = " ".join(map(str, (message.min_distance, message.max_distance, *message.distances[::9])))
        if line != self.shown_obstacles:
            self.shown_obstacles = line
            say("obstacles" if is_right else "wrong", line)

    def command(self, message):
        result = m.MAV_RESULT_UNSUPPORTED
        if message.command == m.MAV_CMD_SET_MESSAGE_INTERVAL:
            self.periods[int(message.param1)] = message.param2 / 1e6
            result = m.MAV_RESULT_ACCEPTED
        elif message.command == m.MAV_CMD_DO_SET_MODE:
            say("mode requested", int(message.param2))
            self.mode = int(message.param2)
            result = m.MAV_RESULT_ACCEPTED
        elif message.command == m.MAV_CMD_COMPONENT_ARM_DISARM:
            say("arming requested")
        self.link.mav.command_ack_send(message.command, result)

    def velocity(self, message):
        is_right = (
            message.coordinate_frame in FRAMES
            and message.type_mask == VELOCITY_AND_YAW_RATE
            and (message.target_system, message.target_component) == (1, 1)
        )
        if not is_right:
            if str(message) not in self.wrong:
                self.wrong.add(str(message))
                say("wrong", message)
            return
        if self.mode != GUIDED:
            return
        self.target_at = time.monotonic()
        speed = math.copysign(math.hypot(message.vx, message.vy), message.vx)
        self.drive((round(speed, 3) + 0.0, round(message.yaw_rate, 3) + 0.0))

    def drive(self, target):
        if not self.is_armed or self.mode != GUIDED:
            target = (0.0, 0.0)
        if target != self.target:
            self.target = target
            say("drives", *target)

    def send_due(self):
        now = time.monotonic()

        def is_due(key, period):
            if now < self.due.get(key, 0.0):
                return False
            self.due[key] = now + period
            return True

        if self.target_at is not None and now - self.target_at > TIMEOUT_S:
            self.target_at = None
            say("timeout")
            self.drive((0.0, 0.0))
        self.drive(self.target)
        if self.is_silent:
            return
        mav = self.link.mav
        boot_ms = now_ms() & 0xFFFFFFFF
        if is_due("heartbeat", 1.0):
            self.heartbeat(mav)
        sent = {
            30: lambda: mav.attitude_send(boot_ms, 0.02, 0.03, 1.0, 0.0, 0.0, 0.0),
            24: lambda: mav.gps_raw_int_send(boot_ms * 1000, 6, 473977420, 85455940, 488000, 80, 80, 0, 0, 12, 489000, 20, 30),
            33: lambda: mav.global_position_int_send(boot_ms, 473977420, 85455940, 488123, 0, 0, 0, 0, 9000),
            1: lambda: mav.sys_status_send(0, 0, 0, 0, 12600, -1, -1, 0, 0, 0, 0, 0, 0),
            132: lambda: mav.distance_sensor_send(boot_ms, 20, 5000, 325, 2, 0, 25, 0),
        }
        for number, send in sent.items():
            if number in self.periods and is_due(number, self.periods[number]):
                send()

    def happens(self, words):
        match words:
            case ["mode", number]:
                self.mode = int(number)
                # Rover sends a heartbeat when its mode changes.
                self.due["heartbeat"] = 0.0
            case ["arm"]:
                self.arm()
            case ["can_arm"]:
                self.can_arm = True
            case ["disarm"]:
                self.is_armed = False
            case ["state", name]:
                self.state = getattr(m, f"MAV_STATE_{name}")
            case ["silent", on]:
                self.is_silent = on == "1"
            case ["others"]:
                # Another vehicle, a ground station and another component of this one.
                def other(mav):
                    mav.heartbeat_send(m.MAV_TYPE_GROUND_ROVER, m.MAV_AUTOPILOT_ARDUPILOTMEGA, 129, GUIDED, m.MAV_STATE_ACTIVE)
                    mav.statustext_send(m.MAV_SEVERITY_ALERT, b"of another")

                self.send_as(2, 1, other)
                self.send_as(255, 190, lambda mav: mav.heartbeat_send(m.MAV_TYPE_GCS, m.MAV_AUTOPILOT_INVALID, 0, 0, 0))
                self.send_as(1, 154, lambda mav: mav.heartbeat_send(m.MAV_TYPE_GIMBAL, m.MAV_AUTOPILOT_INVALID, 0, 0, 0))
            case ["garbage"]:
                self.link.write(bytes(range(256)) * 4)
            case _:
                raise SystemExit(f"unknown: {words}")
        say("done", *words)

    def run(self):
        say("ready")
        while True:
            if select.select([sys.stdin], [], [], 0.0)[0]:
                line = sys.stdin.readline()
                if not line:
                    return
                self.happens(line.split())
            message = self.link.recv_match(blocking=True, timeout=0.005)
            if message is not None:
                self.message(message)
            self.send_due()


Rover(sys.argv[1]).run()
