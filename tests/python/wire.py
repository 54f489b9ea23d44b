"""Messages as bytes: SPEC.md, sections 3, 4, 12 and 13.

A message's body is a plain value: structs are dicts, sequences and tuples are lists, layers are names,
an enum with content is a dict of one entry. What it looks like as bytes is said by a type: an object with
`write(out, value)` and `read(reader)`. The tables of messages at the end mirror those of the specification.
"""

import struct
from typing import NamedTuple

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

PROTOCOL = 5
MAX_MESSAGE = 65536
MAX_TILE_MESSAGE = 8192
MAX_SIGNED = 256


class Malformed(Exception):
    """What came is not what the specification describes: to be counted and dropped."""


class OtherVersion(Malformed):
    """A message of another version of the protocol, which must not be read any further."""


class Reader:
    """Bytes that are read from the front. Never reads, and never lets allocate, beyond their end."""

    def __init__(self, data: bytes):
        self.data, self.at = data, 0

    def left(self) -> int:
        return len(self.data) - self.at

    def take(self, n: int) -> bytes:
        if n > self.left():
            raise Malformed(f"{n} bytes announced, {self.left()} left")
        self.at += n
        return self.data[self.at - n : self.at]


class UInt:
    """An unsigned varint of at most `bits` bits."""

    def __init__(self, bits: int):
        self.bits, self.longest = bits, -(-bits // 7)

    def write(self, out: bytearray, value: int):
        if not 0 <= value < 1 << self.bits:
            raise ValueError(f"{value} does not fit {self.bits} bits")
        while value > 0x7F:
            out.append(value & 0x7F | 0x80)
            value >>= 7
        out.append(value)

    def read(self, reader: Reader) -> int:
        value = 0
        for i in range(self.longest):
            byte = reader.take(1)[0]
            value |= (byte & 0x7F) << (7 * i)
            if byte < 0x80:
                if value >> self.bits:
                    raise Malformed(f"number beyond {self.bits} bits")
                return value
        raise Malformed("varint without an end")


class Int:
    """A signed number: zigzag, then varint."""

    def __init__(self, bits: int):
        self.bits, self.unsigned = bits, UInt(bits)

    def write(self, out: bytearray, value: int):
        self.unsigned.write(out, (value << 1) ^ (value >> (self.bits - 1)))

    def read(self, reader: Reader) -> int:
        z = self.unsigned.read(reader)
        return (z >> 1) ^ -(z & 1)


class Fixed:
    """What `struct` can pack: floating point numbers, little-endian."""

    def __init__(self, form: str):
        self.form = struct.Struct(form)

    def write(self, out: bytearray, value):
        out += self.form.pack(value)

    def read(self, reader: Reader):
        return self.form.unpack(reader.take(self.form.size))[0]


class Bool:
    def write(self, out: bytearray, value: bool):
        out.append(1 if value else 0)

    def read(self, reader: Reader) -> bool:
        byte = reader.take(1)[0]
        if byte > 1:
            raise Malformed(f"bool {byte}")
        return byte == 1


class Raw:
    """Exactly `n` bytes, or with n = None a length and that many."""

    def __init__(self, n: int | None = None):
        self.n = n

    def write(self, out: bytearray, value: bytes):
        if self.n is None:
            U32.write(out, len(value))
        elif self.n != len(value):
            raise ValueError(f"{len(value)} bytes instead of {self.n}")
        out += value

    def read(self, reader: Reader) -> bytes:
        return reader.take(U64.read(reader) if self.n is None else self.n)


class Text:
    def write(self, out: bytearray, value: str):
        BYTES.write(out, value.encode())

    def read(self, reader: Reader) -> str:
        try:
            return BYTES.read(reader).decode()
        except UnicodeDecodeError as error:
            raise Malformed("string that is not UTF-8") from error


class List:
    """A sequence of elements of one type."""

    def __init__(self, of):
        self.of = of

    def write(self, out: bytearray, value: list):
        U32.write(out, len(value))
        for element in value:
            self.of.write(out, element)

    def read(self, reader: Reader) -> list:
        n = U64.read(reader)
        if n > reader.left():  # no element takes less than a byte
            raise Malformed(f"{n} elements announced, {reader.left()} bytes left")
        return [self.of.read(reader) for _ in range(n)]


class Tuple:
    """One element of each of the types, without a length."""

    def __init__(self, *of):
        self.of = of

    def write(self, out: bytearray, value):
        for kind, element in zip(self.of, value, strict=True):
            kind.write(out, element)

    def read(self, reader: Reader) -> list:
        return [kind.read(reader) for kind in self.of]


class Struct:
    def __init__(self, **fields):
        self.fields = fields

    def write(self, out: bytearray, value: dict):
        for name, kind in self.fields.items():
            kind.write(out, value[name])

    def read(self, reader: Reader) -> dict:
        return {name: kind.read(reader) for name, kind in self.fields.items()}


class Option:
    """One element or none."""

    def __init__(self, of):
        self.of = of

    def write(self, out: bytearray, value):
        BOOL.write(out, value is not None)
        if value is not None:
            self.of.write(out, value)

    def read(self, reader: Reader):
        return self.of.read(reader) if BOOL.read(reader) else None


class Enum:
    """One of several variants, by number. A variant without content (None) is its name."""

    def __init__(self, **variants):
        self.variants = list(variants.items())

    def write(self, out: bytearray, value):
        name, content = (value, None) if isinstance(value, str) else next(iter(value.items()))
        number = [variant for variant, _ in self.variants].index(name)
        U32.write(out, number)
        if kind := self.variants[number][1]:
            kind.write(out, content)

    def read(self, reader: Reader):
        number = U32.read(reader)
        if number >= len(self.variants):
            raise Malformed(f"enum number {number}")
        name, kind = self.variants[number]
        return {name: kind.read(reader)} if kind else name


U16, U32, U64, I32, I64 = UInt(16), UInt(32), UInt(64), Int(32), Int(64)
F32, F64, BOOL, BYTES, TEXT = Fixed("<f"), Fixed("<d"), Bool(), Raw(), Text()
DIGEST, CHECK = Raw(32), Raw(8)
LAYER_NAMES = ["occupancy", "elevation", "obstacle", "cost", "rigidity", "shore", "intra", "inter", "depth"]
LAYER = Enum(**dict.fromkeys(LAYER_NAMES))

SENSOR_KIND = Enum(
    **dict.fromkeys(
        "PlanarLaser TiltingLaser Sonar WheelEncoders Attitude SatelliteReceiver Odometry Transforms"
        " TiltEncoder Ultrasonic Bumper".split()
    )
)
INFO = Struct(
    vehicle=TEXT,
    source=TEXT,
    footprint_m=Tuple(F32, F32),
    limits=Tuple(F32, F32, F32),
    layers=List(Struct(layer=LAYER, cell_m=F64)),
    revision=U32,
    program=TEXT,
    is_boat=BOOL,
    stop_decel_mps2=F32,
    stop_decel_radps2=F32,
    max_command_age_ms=U32,
    can_record=BOOL,
    sensors=List(
        Struct(
            name=TEXT,
            kind=SENSOR_KIND,
            mount=Option(Struct(position_m=Tuple(F32, F32, F32), yaw_rad=F32)),
            view=Option(Struct(angles_rad=Tuple(F32, F32), range_m=Tuple(F32, F32))),
            rate_hz=Option(F32),
        )
    ),
    footprint_offset_m=F32,
)
PONG = Struct()
POSE = Struct(
    position_m=Tuple(F64, F64, F64),
    quaternion_xyzw=Tuple(F32, F32, F32, F32),
    speed_mps=F32,
    lateral_mps=F32,
    turn_rate_radps=F32,
    token=Option(Struct(n=U64, nonce=Raw(8))),
)
REFUSAL = Enum(
    **dict.fromkeys(
        "Malformed TooMany UnknownOperator Signature Role OtherBoot UnknownToken WrongNonce TooOld NotHolder"
        " OtherEpoch OldSequence NotFinite NotReady Busy NotWaiting NoEStop OtherEStop EStopNotStored EStopSince"
        " OutOfRange Unavailable".split()
    )
)
LEASE_END = Enum(**dict.fromkeys("Released Expired Renewed HandedOver TakenOver Revoked Reset Fault".split()))
STOP_REASON = Enum(Released=None, Age=None, NotFinite=None, CollisionMonitorStale=None, LeaseEnded=LEASE_END, MotorsHeld=None, PlannerSilent=None, PlannerFloods=None)
FAULT_REASON = Enum(SelfTest=None, Actuator=None)
VELOCITY = Struct(linear_mps=F32, lateral_mps=F32, angular_radps=F32)
SPEED_LIMITS = Struct(forward_mps=F32, reverse_mps=F32, left_mps=F32, right_mps=F32, left_radps=F32, right_radps=F32)
SHORE_CLASS = Enum(Sparse=None, Dense=None, Solid=None)
MAP_POSE = Struct(x_mm=Int(32), y_mm=Int(32), yaw_mrad=Int(32))
GOAL_END = Enum(
    **dict.fromkeys("TakenOver Cancelled LeaseEnded Age PlannerSilent NotFinite EStop CollisionMonitorStale Motors PlannerFloods".split())
)
DOCKING_CHOICE = Struct(site=U32, vegetation=SHORE_CLASS)
BARRIER = Struct(position_m=Tuple(F32, F32), kind=Enum(Detected=None, Mapped=None, Unknown=None, Shallow=None, NoReturn=None, Contact=None, Vegetation=None))
TELEOP_STATUS = Struct(
    state=Enum(
        SafeBoot=None, Idle=None, Held=None, Driving=None, Stopping=STOP_REASON, EStop=None, Fault=FAULT_REASON
    ),
    last_stop=Option(STOP_REASON),
    is_drifting=BOOL,
    lease=Struct(epoch=U64, holder=Option(TEXT), next=Option(TEXT), waiting=Option(TEXT)),
    arming=Enum(Locked=None, Neutral=None, Pressed=None),
    age_ms=Option(U32),
    peak_age_ms=Option(U32),
    speed_allowed_mps=F32,
    requested=VELOCITY,
    applied=VELOCITY,
    clamp=Option(Enum(Speed=None, Ramp=None, Age=None, CollisionMonitor=None, Stop=None, Locomotion=None)),
    collision_monitor=Enum(Silent=None, Off=None, On=SPEED_LIMITS, UnknownSpace=SPEED_LIMITS, Stale=None),
    estop=Option(Struct(number=U64, is_stored=BOOL)),
    counters=Struct(accepted=U64, involuntary_stops=U64, refused=List(Struct(reason=REFUSAL, count=U64))),
    settings=Struct(budget_kbps=U32, collision_monitor=BOOL, recording=BOOL),
    barrier=Option(BARRIER),
    ground_age_ms=Tuple(Option(U32), Option(U32), Option(U32), Option(U32)),
    battery_v=Option(F32),
    docking=Option(DOCKING_CHOICE),
    motor_hold=Option(Enum(NoLink=None, NoHeartbeat=None, NotARover=None, Disarmed=None, Mode=U32, Failsafe=None)),
    goal=Struct(has_planner=BOOL, running=Option(MAP_POSE), last_end=Option(GOAL_END)),
)
STATUS = Struct(
    data_time_ns=I64,
    scans_in=U64,
    scans_mapped=U64,
    drops=List(Struct(name=TEXT, count=U64)),
    tiles=Tuple(U64, U64),
    tiles_waiting=U32,
    consoles=U16,
    refused=U64,
    has_ended=BOOL,
    teleop=Option(TELEOP_STATUS),
    info_revision=U32,
    sensors=List(
        Struct(
            name=TEXT,
            messages=U64,
            rate_hz=F32,
            age_ms=Option(U32),
            dropped=U64,
            fault=Option(Enum(Silent=None, Clock=None, AllInvalid=None, Slow=None, Blocked=None)),
        )
    ),
    recording=Option(
        Struct(
            state=Enum(Stopped=None, Recording=None, StoppedDiskLow=None, Failed=None),
            file=TEXT,
            files=U32,
            duration_s=U32,
            bytes=U64,
            free_bytes=Option(U64),
            lost=U64,
        )
    ),
    depth_under_keel_m=Option(F32),
    devices=List(
        Struct(
            name=TEXT,
            state=Enum(Connecting=None, Configuring=None, Measuring=None),
            trouble=TEXT,
            identity=TEXT,
            rate_hz=F32,
            age_ms=Option(U32),
            reconnects=U32,
            lost=U64,
            clock=Option(Struct(offset_s=F64, spread_s=F32, resets=U32)),
        )
    ),
)
PLAN = Struct(points_mm=List(Tuple(Int(32), Int(32))))
LOCALIZATION = Struct(
    confidence=Enum(Determined=None, UncertainAlong=None, OdometryOnly=None, Lost=None),
    is_searching=BOOL,
    covariance_m2=Tuple(F32, F32, F32),
    heading_sigma_rad=F32,
    inliers=F32,
    residual_m=F32,
    closures=Tuple(U32, U32),
    closures_m=Option(List(Tuple(F32, F32, F32, F32))),
)
EVENT = Struct(kind=TEXT, severity=Enum(Info=None, Warning=None, Alarm=None), message=TEXT)
MAP_HEAD = Struct(layers=List(Struct(layer=LAYER, epoch=U32, head_revision=U64, tiles=U32, root=DIGEST)))
VIEW = Struct(rectangle_m=Tuple(F32, F32, F32, F32), layers=U32, revision=U64, is_synchronized=BOOL, wants_scan=BOOL)
TILE_BAND = Struct(epoch=U32, revision=U64, base=U64, check=CHECK, rows=BYTES)
CHANGES = Struct(tiles=List(Struct(tx=I32, ty=I32, older_ns=U64, band=TILE_BAND)))
DIGESTS_REQUEST = Struct(newer_than=U64)
DIGESTS = Struct(
    epoch=U32,
    head_revision=U64,
    tiles=List(Struct(tx=I32, ty=I32, revision=U64, digest=DIGEST)),
    more=U32,
)
TILES_REQUEST = Enum(NewerThan=U64, ByKey=List(Tuple(I32, I32)))
TILES_REPLY = Struct(tx=I32, ty=I32, band=TILE_BAND, following=U32)
SHORES_REQUEST = Struct(newer_than=U64)
SHORES = Struct(
    cell_m=F64,
    datum=Option(Struct(latitude_deg=F64, longitude_deg=F64, altitude_m=F64)),
    clusters=List(
        Struct(
            number=U32,
            **{"class": SHORE_CLASS},
            voxels=U32,
            rigid_voxels=U32,
            center_m=Tuple(F32, F32),
            outline=List(Tuple(I32, I32)),
        )
    ),
    clusters_left_out=U32,
    sites=List(
        Struct(
            number=U32,
            center_m=Tuple(F32, F32),
            heading_rad=F32,
            width_m=F32,
            vegetation=Option(SHORE_CLASS),
            price=F32,
            approach_m=Tuple(F32, F32),
        )
    ),
    sites_left_out=U32,
)
SHORES_REPLY = Struct(revision=U64, shores=Option(SHORES))
SCAN = Struct(sensor=TEXT, origin_m=Tuple(F64, F64), steps_cm=List(Tuple(I32, I32)))
TRAJECTORY_REQUEST = Struct(trajectory=Option(U64), **{"from": U64}, step=U32)
TRAJECTORY_PART = Struct(trajectory=U64, poses=U64, rows=List(Tuple(*[I64] * 8)))
VOXEL_FILE = Enum(Tree=None, Points=None)
VOXELS_REQUEST = Struct(snapshot=Option(U64), file=VOXEL_FILE, offset=U64)
VOXELS_REPLY = Enum(
    **{"None": None},
    Preparing=None,
    Gone=None,
    Part=Struct(
        snapshot=U64,
        file=VOXEL_FILE,
        bytes=U64,
        digest=DIGEST,
        packed_bytes=U64,
        offset=U64,
        packed=BYTES,
    ),
)
ESTOP = Struct(press=U64)
DRIVE = Struct(
    linear_mps=F32,
    lateral_mps=F32,
    angular_radps=F32,
    estop=Option(ESTOP),
    docking=Option(DOCKING_CHOICE),
    goal=Option(MAP_POSE),
)
RESET = Struct(estop=U64)
LEASE_REQUEST = Enum(Request=None, Release=None, HandOver=TEXT, Refuse=TEXT, TakeOver=None)
SETTING = Enum(BudgetKbps=U32, CollisionMonitor=BOOL, Recording=BOOL, SaveMap=TEXT, Locate=MAP_POSE)
ANSWER = Enum(Done=None, Granted=U64, Waiting=None, EStopped=U64, Refused=REFUSAL)


class Header(NamedTuple):
    boot: bytes
    seq: int
    robot_time_ns: int = 0


_HEADER = struct.Struct("<16sQq")


def encode(kind, header: Header, body) -> bytes:
    """A whole message of the type `kind`."""
    out = bytearray(PROTOCOL.to_bytes(2, "little") + _HEADER.pack(*header))
    kind.write(out, body)
    return bytes(out)


def decode(kind, message: bytes, longest: int = MAX_MESSAGE) -> tuple[Header, object]:
    """Header and body of a whole message. Raises `Malformed`, and nothing else, if it is not one."""
    if len(message) > longest:
        raise Malformed(f"{len(message)} bytes, {longest} allowed")
    reader = Reader(message)
    if (protocol := int.from_bytes(reader.take(2), "little")) != PROTOCOL:
        raise OtherVersion(f"protocol {protocol} instead of {PROTOCOL}: update the older side")
    header = Header(*_HEADER.unpack(reader.take(_HEADER.size)))
    body = kind.read(reader)
    if reader.left():
        raise Malformed(f"{reader.left()} bytes behind the body")
    return header, body


class CommandHeader(NamedTuple):
    """What makes a signed message good for one moment."""

    boot: bytes  # of the robot
    n: int
    nonce: bytes
    epoch: int
    seq: int


_COMMAND_HEADER = struct.Struct("<16sQ8sQQ")
_ENVELOPE = 2 + _COMMAND_HEADER.size + 64


def signed_bytes(robot: str, operator: str, topic: str, stamp: CommandHeader, body: bytes) -> bytes:
    """What the signature of a message to `op/OPERATOR/TOPIC` is made over."""
    n_and_nonce = struct.pack("<Q8s", stamp.n, stamp.nonce)
    parts = [
        f"foreshore signed message, protocol {PROTOCOL}".encode(),
        robot.encode(),
        stamp.boot,
        f"foreshore/{robot}/op/{operator}/{topic}".encode(),
        operator.encode(),
        struct.pack("<Q", stamp.epoch),
        struct.pack("<Q", stamp.seq),
        n_and_nonce,
        body,
    ]
    return b"".join(len(part).to_bytes(4, "little") + part for part in parts)


def sign(key: Ed25519PrivateKey, kind, robot: str, operator: str, topic: str, stamp: CommandHeader, body) -> bytes:
    """A whole signed message with a body of the type `kind`."""
    out = bytearray()
    kind.write(out, body)
    signature = key.sign(signed_bytes(robot, operator, topic, stamp, bytes(out)))
    return PROTOCOL.to_bytes(2, "little") + _COMMAND_HEADER.pack(*stamp) + signature + bytes(out)


def open_signed(key: Ed25519PublicKey, kind, robot: str, operator: str, topic: str, message: bytes):
    """CommandHeader and body of a signed message. Raises `Malformed`, and nothing else, if it is not one of that key."""
    if not _ENVELOPE <= len(message) <= MAX_SIGNED:
        raise Malformed(f"{len(message)} bytes are no signed message")
    if (protocol := int.from_bytes(message[:2], "little")) != PROTOCOL:
        raise OtherVersion(f"protocol {protocol} instead of {PROTOCOL}: update the older side")
    stamp = CommandHeader(*_COMMAND_HEADER.unpack(message[2 : 2 + _COMMAND_HEADER.size]))
    signature, body = message[2 + _COMMAND_HEADER.size : _ENVELOPE], message[_ENVELOPE:]
    try:
        key.verify(signature, signed_bytes(robot, operator, topic, stamp, body))
    except InvalidSignature as error:
        raise Malformed("wrong signature") from error
    reader = Reader(body)
    command = kind.read(reader)
    if reader.left():
        raise Malformed(f"{reader.left()} bytes behind the body")
    return stamp, command
