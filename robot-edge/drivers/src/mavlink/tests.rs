//! Frames are those that pymavlink 2.4.50 packs for the same fields.

use std::f64::consts::FRAC_PI_2;

use measurement::MeasurementData;
use proptest::prelude::*;

use super::session::{Autopilot, AutopilotState, AutopilotStatus};
use super::*;
use crate::device::{Device as _, Event};
use crate::test_decoding::{damage, decode, decode_one, hex};
use crate::{Decoder as _, Dropped};

/// Rover in mode GUIDED, armed; from system 1, component 1, as all that follow.
const GUIDED_ROVER: &str = "fd0900000001010000000f0000000b03810403306e";
/// Boat in mode HOLD, not armed, `MAV_STATE_CRITICAL`.
const CRITICAL_BOAT: &str = "fd090000010101000000040000000a03010503f98e";
const COPTER: &str = "fd0900000201010000000400000002038104033242";
/// At 123.456 s: roll 0.1, pitch 0.2, yaw 1; rates 0.01, 0.02, 0.03.
const ATTITUDE: &str =
    "fd1c00000301011e000040e20100cdcccc3dcdcc4c3e0000803f0ad7233c0ad7a33c8fc2f53c98f4";
const RTK_FIX: &str =
    "fd1e000004010118000001000000000000000000000000000000000000000000000000000000060caef8";
/// 47.397742° N, 8.545594° E, 488.123 m.
const POSITION: &str =
    "fd1c00000501012100006ce201004c52401c44f41705bb720700e80300000000000000002823dffe";
/// 4.25 m.
const WATER_DEPTH: &str = "fd2600000601011e2b000100000000000000000000000000000000000000000000000000000000008840000040410001e493";
/// Downward, 3.25 m of 0.2 to 50 m.
const RANGE: &str = "fd0d000007010184000001000000140088134501020019a25e";
/// 12.6 V.
const BATTERY: &str =
    "fd1f000008010101000000000000000000000000000000003831ffff000000000000000000000000ffb991";
const TEXT: &str = "fd0c0000090101fd00000450726541726d3a20475053ff22";
/// To `MAV_CMD_DO_SET_MODE`: failed.
const MODE_FAILED: &str = "fd0300000a01014d0000b000048c50";

fn take(autopilot: &mut Autopilot, frame: &str) -> Vec<Event> {
    let mut events = Vec::new();
    let message = decode_one(MavlinkDecoder::default(), &hex(frame));
    autopilot.take(message, None, &mut events);
    events
}

fn state(frames: &[&str], system: u8) -> (AutopilotState, Vec<String>) {
    let status = AutopilotStatus::default();
    let mut autopilot = Autopilot::new(system, status.clone());
    for frame in frames {
        take(&mut autopilot, frame);
    }
    (status.try_state().unwrap(), status.try_take_texts())
}

#[test]
fn what_is_sent_is_what_pymavlink_packs() {
    let mut encoder = Encoder::new((245, 191), 1);
    let mut distances = [u16::MAX; 72];
    (distances[0], distances[1], distances[71]) = (250, 5001, 1);
    for (sent, packed) in [
        (
            encoder.velocity(0.5, 0.25, 5000),
            "fd35000000f5bf540000881300000000000000000000000000000000003f000000000000000000000000000000000000000000000000000080bec7050101081808",
        ),
        (
            encoder.heartbeat(),
            "fd09000001f5bf000000000000001208000403fd2b",
        ),
        (
            encoder.request_rate(),
            "fd20000002f5bf4c00000000f041005043470000000000000000000000000000000000000000ff0101010d66",
        ),
        (
            encoder.request_guided(),
            "fd20000003f5bf4c00000000803f000070410000000000000000000000000000000000000000b00001012458",
        ),
        (
            encoder.obstacle_distance(distances, 5000, 5_000_000),
            concat!(
                "fda7000004f5bf4a0100404b4c0000000000fa008913ffffffffffffffffffffffffffffffffffffffffffffffffff",
                "ffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffff",
                "ffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffff",
                "ffffffffffffffffffffffffffffffffffffff01000100881300050000a040000000000c5615",
            ),
        ),
    ] {
        assert_eq!(sent, hex(packed));
    }
}

#[test]
fn every_wanted_message_is_requested_in_turn() {
    let mut encoder = Encoder::new((1, 191), 1);
    let mut requested =
        || match decode_one(MavlinkDecoder::default(), &encoder.request_rate()).content {
            MavMessage::COMMAND_LONG(command) => command.param1 as u32,
            other => panic!("{other:?}"),
        };
    let expected = [30, 33, 24, 1, 132, 11_038, 30, 33];
    assert_eq!(expected.map(|_| requested()), expected);
}

#[test]
fn heartbeats_say_what_it_is_and_whether_it_obeys() {
    let one = AutopilotState {
        heartbeats: 1,
        ..AutopilotState::default()
    };
    for (frame, expected) in [
        (
            GUIDED_ROVER,
            AutopilotState {
                is_rover: true,
                is_armed: true,
                mode: GUIDED,
                ..one
            },
        ),
        (
            CRITICAL_BOAT,
            AutopilotState {
                is_rover: true,
                mode: 4,
                has_failsafe: true,
                ..one
            },
        ),
        (
            COPTER,
            AutopilotState {
                is_armed: true,
                mode: 4,
                ..one
            },
        ),
    ] {
        assert_eq!(state(&[frame], 1).0, expected, "{frame}");
    }
    let frame = hex(GUIDED_ROVER);
    assert_eq!(
        [1, 2].map(|system| comes_from(system, &frame)),
        [true, false]
    );
    let other_system = state(&[GUIDED_ROVER, BATTERY, TEXT], 2);
    assert_eq!(other_system, (AutopilotState::default(), Vec::new()));
    let mut own_component = hex(GUIDED_ROVER);
    own_component[6] = 190;
    let crc = mavlink::calculate_crc(&own_component[1..19], 50).to_le_bytes();
    own_component[19..].copy_from_slice(&crc);
    let mut autopilot = Autopilot::new(1, AutopilotStatus::default());
    let message = decode_one(MavlinkDecoder::default(), &own_component);
    let mut events = Vec::new();
    autopilot.take(message, None, &mut events);
    assert_eq!(events, [], "another component of its system");
}

#[test]
fn battery_texts_and_refusals_are_passed_on_within_bounds() {
    let (state, texts) = state(&[BATTERY, TEXT, MODE_FAILED], 1);
    assert!((state.battery_v.unwrap() - 12.6).abs() < 1e-9);
    assert_eq!(
        texts,
        ["PreArm: GPS", "mode GUIDED was refused (MAV_RESULT_FAILED)"]
    );
    let (_, texts) = self::state(&[TEXT; 20], 1);
    assert_eq!(texts.len(), 9);
    assert_eq!(texts[8], "12 more texts came at once and are not shown");
}

#[test]
fn attitude_is_turned_to_axes_forward_left_up() {
    let mut autopilot = Autopilot::new(1, AutopilotStatus::default());
    let events = take(&mut autopilot, ATTITUDE);
    let [Event::Sample(sample)] = events.as_slice() else {
        panic!("{events:?}");
    };
    assert_eq!(sample.sent.unwrap().nanos, 123_456_000_000);
    assert_eq!(autopilot.output(&sample.data), 0);
    let MeasurementData::Imu(imu) = &sample.data else {
        panic!("{sample:?}");
    };
    let [x, y, z, w] = imu.orientation_xyzw.unwrap();
    // Euler angles of a quaternion, z then y then x.
    let roll = libm::atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y));
    let pitch = libm::asin(2.0 * (w * y - z * x));
    let yaw = libm::atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z));
    for (angle, expected) in [(roll, 0.1), (pitch, -0.2), (yaw, FRAC_PI_2 - 1.0)] {
        assert!((angle - expected).abs() < 1e-6, "{roll} {pitch} {yaw}");
    }
    for (rate, expected) in imu.angular_velocity_radps.iter().zip([0.01, -0.02, -0.03]) {
        assert!((rate - expected).abs() < 1e-6, "{imu:?}");
    }
}

#[test]
fn a_position_needs_a_fix() {
    let mut autopilot = Autopilot::new(1, AutopilotStatus::default());
    assert_eq!(take(&mut autopilot, POSITION), []);
    assert_eq!(take(&mut autopilot, RTK_FIX), []);
    let events = take(&mut autopilot, POSITION);
    let [Event::Sample(sample)] = events.as_slice() else {
        panic!("{events:?}");
    };
    let MeasurementData::Fix(fix) = &sample.data else {
        panic!("{sample:?}");
    };
    assert!((fix.latitude_deg - 47.397_742).abs() < 1e-9);
    assert!((fix.longitude_deg - 8.545_594).abs() < 1e-9);
    assert!((fix.altitude_m - 488.123).abs() < 1e-9);
    assert_eq!((fix.status, autopilot.output(&sample.data)), (2, 1));
}

#[test]
fn depths_are_taken_once() {
    let mut autopilot = Autopilot::new(1, AutopilotStatus::default());
    let depth_m = |events: Vec<Event>| match events.as_slice() {
        [Event::Sample(sample)] => match &sample.data {
            MeasurementData::Scan { scan, .. } => Some(scan.ranges_m.clone()),
            other => panic!("{other:?}"),
        },
        _ => None,
    };
    assert_eq!(depth_m(take(&mut autopilot, RANGE)), Some(vec![3.25]));
    assert_eq!(depth_m(take(&mut autopilot, WATER_DEPTH)), Some(vec![4.25]));
    assert_eq!(depth_m(take(&mut autopilot, RANGE)), None);
}

#[test]
fn bad_bytes_are_counted_by_reason() {
    let frame = hex(GUIDED_ROVER);
    let mut broken = frame.clone();
    broken[12] ^= 1;
    let mut unknown = frame.clone();
    unknown[9] = 0xEE;
    let mut enumeration = frame.clone();
    // No such type of vehicle.
    enumeration[14] = 200;
    let crc = mavlink::calculate_crc(&enumeration[1..19], 50).to_le_bytes();
    enumeration[19..].copy_from_slice(&crc);
    for (bytes, reason, count) in [
        (broken, DropReason::Checksum, 1),
        (unknown, DropReason::UnknownKind, 1),
        (enumeration, DropReason::Field, 1),
        (b"garbage".to_vec(), DropReason::Garbage, 7),
    ] {
        let both = [bytes, frame.clone()].concat();
        let (messages, dropped) = decode(MavlinkDecoder::default(), &both);
        assert_eq!(messages.len(), 1, "{reason}: {dropped:?}");
        assert_eq!(dropped.count(reason), count, "{reason}: {dropped:?}");
    }
    // MAVLink 1 is not read.
    let (messages, dropped) = decode(
        MavlinkDecoder::default(),
        &hex("fe09000101000000000004038103"),
    );
    assert_eq!(
        (messages.len(), dropped.count(DropReason::Garbage)),
        (0, 14)
    );
    let mut decoder = MavlinkDecoder::default();
    decoder.push(&frame[..frame.len() - 1]);
    assert_eq!(decoder.next_message(), None);
    assert_eq!(decoder.dropped(), &Dropped::default());
}

proptest! {
    #[test]
    fn any_damage_is_data(damage in damage(&[START, 0, 1, 255])) {
        let frames = [GUIDED_ROVER, ATTITUDE, POSITION, WATER_DEPTH, TEXT].map(hex).concat();
        let mut autopilot = Autopilot::new(1, AutopilotStatus::default());
        for message in damage.decode(MavlinkDecoder::default, frames) {
            autopilot.take(message, None, &mut Vec::new());
        }
    }
}
