use proptest::prelude::*;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::*;
use crate::layer::LayerId;
use crate::name::OperatorId;
use crate::tile::{BootId, TileDigest};
use crate::tile_store::RootDigest;
use crate::wire::{Header, decode, encode};

const HEADER: Header = Header {
    boot: BootId([1; 16]),
    seq: 0,
    robot_time_ns: 0,
};
/// Bytes of a header.
const BEHIND_HEADER: usize = 2 + 16 + 8 + 8;

/// Tests the round trip and that every cut is refused; returns the bytes of the body.
fn body<T>(message: &T) -> Vec<u8>
where
    T: Serialize + DeserializeOwned + PartialEq + std::fmt::Debug,
{
    let bytes = encode(&HEADER, message).unwrap();
    let (header, read) = decode::<T>(&bytes).unwrap();
    assert_eq!((header, &read), (HEADER, message));
    for length in 0..bytes.len() {
        assert!(
            decode::<T>(&bytes[..length]).is_err(),
            "{message:?} cut at {length}"
        );
    }
    bytes[BEHIND_HEADER..].to_vec()
}

fn band() -> TileBand {
    TileBand {
        epoch: 2,
        revision: 300,
        digest: TileDigest([9; 32]),
        rows: vec![1, 0, 64, 1, 7],
    }
}

#[test]
fn bodies_are_the_documented_bytes() {
    let digest = [9; 32];
    let mut expected = vec![2, 0xAC, 0x02];
    expected.extend(digest);
    expected.extend([5, 1, 0, 64, 1, 7]);
    assert_eq!(body(&band()), expected);

    let layer = LayerHead {
        layer: LayerId::Obstacle,
        epoch: 1,
        head_revision: 7,
        tiles: 3,
        root: RootDigest(digest),
    };
    let mut expected = vec![1, 2, 1, 7, 3];
    expected.extend(digest);
    assert_eq!(
        body(&MapHead {
            layers: vec![layer]
        }),
        expected
    );

    assert_eq!(body(&TilesRequest::NewerThan(300)), [0, 0xAC, 0x02]);
    // Tile numbers are zigzag varints: −1 is 1, 2 is 4.
    assert_eq!(body(&TilesRequest::ByKey(vec![(-1, 2)])), [1, 1, 1, 4]);
    assert_eq!(body(&DigestsRequest { newer_than: 0 }), [0]);
    assert_eq!(body(&ShoresRequest { newer_than: 300 }), [0xAC, 0x02]);
    let nothing_newer = ShoresReply {
        revision: 9,
        shores: None,
    };
    assert_eq!(body(&nothing_newer), [9, 0]);
    let cluster = ShoreCluster {
        number: 7,
        class: ShoreClass::Solid,
        voxels: 300,
        rigid_voxels: 299,
        center_m: [1.0, -2.0],
        outline: vec![(-1, 2)],
    };
    let mut expected = vec![7, 2, 0xAC, 0x02, 0xAB, 0x02];
    expected.extend([0, 0, 0x80, 0x3F, 0, 0, 0, 0xC0, 1, 1, 4]);
    assert_eq!(body(&cluster), expected);
    assert_eq!(body(&Pong), [0; 0]);
}

#[test]
fn every_message_survives_the_wire() {
    let summary = TileSummary {
        tx: -4,
        ty: 5,
        revision: 9,
        digest: TileDigest([3; 32]),
    };
    body(&TilesReply {
        tx: i32::MIN,
        ty: i32::MAX,
        band: band(),
        following: 4,
    });
    body(&Digests {
        epoch: 0,
        head_revision: 9,
        tiles: vec![summary; 3],
        more: 0,
    });
    body(&Pose {
        position_m: [1.0, -2.0, 0.5],
        quaternion_xyzw: [0.0, 0.0, 0.6, 0.8],
        speed_mps: -0.5,
        turn_rate_radps: 0.25,
        token: Some(AgeToken {
            n: u64::MAX,
            nonce: u64::MAX,
        }),
    });
    body(&Event {
        kind: "jump".to_owned(),
        severity: Severity::Warning,
        message: "odometry jumped by 5 m".to_owned(),
    });
    body(&Status {
        drops: vec![DropCount {
            name: "pose_gap".to_owned(),
            count: 3,
        }],
        tiles: [5, 600],
        has_ended: true,
        sensors: vec![sensor_status(); MAX_SENSORS],
        recording: Some(recording()),
        ..Status::default()
    });
    body(&Info {
        vehicle: "pioneer".to_owned(),
        source: "rooms".to_owned(),
        footprint_m: [0.455, 0.381],
        limits: [1.2, 5.24],
        layers: vec![LayerInfo {
            layer: LayerId::Occupancy,
            cell_m: 0.1,
        }],
        revision: 2,
        program: "0.1.0".to_owned(),
        is_boat: true,
        stop_decel_mps2: 1.0,
        stop_decel_radps2: 4.0,
        max_command_age_ms: 400,
        can_record: true,
        sensors: vec![sensor_info()],
        footprint_offset_m: 0.125,
    });
    body(&ShoresReply {
        revision: 3,
        shores: Some(Shores {
            cell_m: 0.3,
            datum: Some(Datum {
                latitude_deg: 38.5,
                longitude_deg: -9.1,
                altitude_m: 50.0,
            }),
            clusters: Vec::new(),
            clusters_left_out: 1,
            sites: vec![DockingSite {
                center_m: [1.0, 2.0],
                heading_rad: 3.0,
                width_m: 4.0,
                mean_cost: 0.25,
            }],
            sites_left_out: 2,
        }),
    });
    let view = View {
        rectangle_m: [-1e6, -1e6, 1e6, 1e6],
        layers: u32::MAX,
        revision: u64::MAX,
        is_synchronized: true,
        wants_scan: true,
    };
    assert!(BEHIND_HEADER + body(&view).len() <= 256);
}

fn sensor_info() -> SensorInfo {
    SensorInfo {
        name: "laser".to_owned(),
        kind: SensorKind::TiltingLaser,
        mount: Some(SensorMount {
            position_m: [1.0, 0.0, -2.0],
            yaw_rad: 1.0,
        }),
        view: Some(FieldOfView {
            angles_rad: [-2.0, 1.0],
            range_m: [0.0, 1.0],
        }),
        rate_hz: None,
    }
}

fn sensor_status() -> SensorStatus {
    SensorStatus {
        name: "gps".to_owned(),
        messages: 300,
        rate_hz: 1.0,
        age_ms: Some(300),
        dropped: 7,
        fault: Some(SensorFault::AllInvalid),
    }
}

fn recording() -> RecordingStatus {
    RecordingStatus {
        state: RecordingState::StoppedDiskLow,
        file: "a.mcap".to_owned(),
        files: 2,
        duration_s: 300,
        bytes: 300,
        free_bytes: None,
        lost: 1,
    }
}

#[test]
fn sensor_and_recording_bodies_match_golden_bytes() {
    const ONE: [u8; 4] = [0, 0, 0x80, 0x3F];
    const MINUS_TWO: [u8; 4] = [0, 0, 0, 0xC0];
    const ZERO: [u8; 4] = [0; 4];

    let expected = [
        &b"\x05laser\x01\x01"[..],
        &[ONE, ZERO, MINUS_TWO, ONE].concat(),
        &[1],
        &[MINUS_TWO, ONE, ZERO, ONE].concat(),
        &[0],
    ];
    assert_eq!(body(&sensor_info()), expected.concat());
    let expected = [
        &b"\x03gps"[..],
        &[0xAC, 2],
        &ONE,
        &[1, 0xAC, 2, 7, 1, 2], // age_ms, dropped, fault
    ];
    assert_eq!(body(&sensor_status()), expected.concat());
    let expected = [&[2, 6][..], b"a.mcap", &[2, 0xAC, 2, 0xAC, 2, 0, 1]];
    assert_eq!(body(&recording()), expected.concat());

    let event = Event {
        kind: "a".to_owned(),
        severity: Severity::Alarm,
        message: "b".to_owned(),
    };
    assert_eq!(body(&event), *b"\x01a\x02\x01b");
    let view = View {
        rectangle_m: [1.0; 4],
        layers: 3,
        revision: 300,
        is_synchronized: false,
        wants_scan: true,
    };
    let expected = [&[ONE; 4].concat()[..], &[3, 0xAC, 2, 0, 1]];
    assert_eq!(body(&view), expected.concat());
    let scan = Scan {
        sensor: "s".to_owned(),
        origin_m: [1.0, 0.0],
        // Zigzag: −1 is 1, 150 is 300.
        steps_cm: vec![(-1, 150)],
    };
    let expected = [
        &b"\x01s"[..],
        &[0, 0, 0, 0, 0, 0, 0xF0, 0x3F],
        &[0; 8],
        &[1, 1, 0xAC, 2],
    ];
    assert_eq!(body(&scan), expected.concat());
}

/// Scans must leave bandwidth for tiles.
#[test]
fn a_scan_is_small() {
    let walls = |range_m: f64| {
        let beam = move |n: usize| {
            let angle_rad = std::f64::consts::TAU * n as f64 / MAX_SCAN_POINTS as f64;
            [libm::cos(angle_rad), libm::sin(angle_rad)].map(|part| range_m * part)
        };
        let scan = Scan::of_points("laser".to_owned(), [0.0; 2], (0..MAX_SCAN_POINTS).map(beam));
        BEHIND_HEADER + body(&scan).len()
    };
    assert_eq!([walls(5.0), walls(30.0), walls(250.0)], [779, 779, 1435]);
    // Alternating near and very far beams.
    let comb = (0..MAX_SCAN_POINTS).map(|n| [if n % 2 == 0 { 0.0 } else { 300.0 }, 300.0]);
    let comb = Scan::of_points("a".repeat(64), [0.0; 2], comb);
    let bytes = BEHIND_HEADER + body(&comb).len();
    assert!(bytes < 2048, "{bytes}");
}

fn anna() -> OperatorId {
    "anna".parse().unwrap()
}

fn teleop() -> TeleopStatus {
    TeleopStatus {
        state: TeleopState::Fault(FaultReason::Actuator),
        last_stop: Some(StopReason::LeaseEnded(LeaseEnd::Revoked)),
        is_drifting: true,
        lease: LeaseStatus {
            epoch: 300,
            holder: None,
            next: Some(anna()),
            waiting: None,
        },
        arming: Arming::Pressed,
        age_ms: None,
        peak_age_ms: Some(300),
        speed_allowed_mps: 1.0,
        requested: Velocity::default(),
        applied: Velocity {
            linear_mps: 1.0,
            angular_radps: -2.0,
        },
        clamp: Some(Clamp::Ramp),
        collision_monitor: CollisionMonitorState::UnknownSpace(SpeedLimits {
            forward_mps: 1.0,
            reverse_mps: f32::INFINITY,
            left_radps: -2.0,
            right_radps: 0.0,
        }),
        estop: Some(EStopStatus {
            number: 300,
            is_stored: true,
        }),
        counters: CommandCounters {
            accepted: 300,
            involuntary_stops: 2,
            refused: vec![RefusedCount {
                reason: Refusal::OtherBoot,
                count: 7,
            }],
        },
        settings: Settings {
            budget_kbps: 256,
            collision_monitor: false,
            recording: true,
        },
        barrier: Some(Barrier {
            position_m: [1.0, -2.0],
            kind: BarrierKind::Mapped,
        }),
        ground_age_ms: [Some(300), None, Some(5), None],
    }
}

#[test]
fn the_bodies_of_driving_are_the_documented_bytes() {
    const ONE: [u8; 4] = [0, 0, 0x80, 0x3F];
    const MINUS_TWO: [u8; 4] = [0, 0, 0, 0xC0];
    const ZERO: [u8; 4] = [0; 4];

    let token = AgeToken {
        n: 300,
        nonce: 0x0807_0605_0403_0201,
    };
    assert_eq!(body(&token), [0xAC, 2, 1, 2, 3, 4, 5, 6, 7, 8]);

    let drive = |estop| Drive {
        linear_mps: 1.0,
        angular_radps: -2.0,
        estop,
    };
    let speeds = [ONE, MINUS_TWO].concat();
    assert_eq!(body(&drive(None)), [&speeds[..], &[0]].concat());
    let pressed = body(&drive(Some(EStop { press: 300 })));
    assert_eq!(pressed, [&speeds[..], &[1, 0xAC, 2]].concat());

    assert_eq!(body(&EStop { press: 300 }), [0xAC, 2]);
    assert_eq!(body(&Reset { estop: 300 }), [0xAC, 2]);
    assert_eq!(body(&LeaseRequest::Request), [0]);
    assert_eq!(body(&LeaseRequest::Release), [1]);
    assert_eq!(body(&LeaseRequest::HandOver(anna())), *b"\x02\x04anna");
    assert_eq!(body(&LeaseRequest::Refuse(anna())), *b"\x03\x04anna");
    assert_eq!(body(&LeaseRequest::TakeOver), [4]);
    assert_eq!(body(&Setting::BudgetKbps(300)), [0, 0xAC, 2]);
    assert_eq!(body(&Setting::CollisionMonitor(true)), [1, 1]);
    assert_eq!(body(&Setting::Recording(false)), [2, 0]);
    assert_eq!(body(&Answer::Done), [0]);
    assert_eq!(body(&Answer::Granted(300)), [1, 0xAC, 2]);
    assert_eq!(body(&Answer::Waiting), [2]);
    assert_eq!(body(&Answer::EStopped(300)), [3, 0xAC, 2]);
    assert_eq!(body(&Answer::Refused(Refusal::Unavailable)), [4, 21]);

    let expected = [
        &[6, 1, 1, 4, 5, 1][..], // state, last_stop, is_drifting
        &[0xAC, 2, 0, 1, 4],     // lease: epoch, holder, next
        b"anna",
        &[0, 2, 0, 1, 0xAC, 2], // waiting, arming, age_ms, peak_age_ms
        &[ONE, ZERO, ZERO, ONE, MINUS_TWO].concat(),
        &[1, 1, 3], // clamp, guard
        &[ONE, [0, 0, 0x80, 0x7F], MINUS_TWO, ZERO].concat(),
        &[1, 0xAC, 2, 1],       // estop
        &[0xAC, 2, 2, 1, 5, 7], // counters
        &[0x80, 2, 0, 1],       // settings
        &[1],                   // barrier
        &[ONE, MINUS_TWO].concat(),
        &[1],
        &[1, 0xAC, 2, 0, 1, 5, 0], // ground_age_ms
    ];
    assert_eq!(body(&teleop()), expected.concat());
    let nothing_in_the_way = TeleopStatus {
        barrier: None,
        ground_age_ms: [None; 4],
        ..teleop()
    };
    assert!(body(&nothing_in_the_way).ends_with(&[0, 1, 0, 0, 0, 0, 0]));
}

/// Enums are append-only: numbers never change.
#[test]
fn variants_have_the_documented_numbers() {
    fn check<T: Serialize + DeserializeOwned + PartialEq + std::fmt::Debug>(variants: &[T]) {
        for (number, variant) in variants.iter().enumerate() {
            assert_eq!(body(variant)[0], number as u8, "{variant:?}");
        }
        let header = encode(&HEADER, &(variants.len() as u8)).unwrap();
        assert!(decode::<T>(&header).is_err(), "{variants:?} are not all");
    }
    let limits = SpeedLimits {
        forward_mps: 1.0,
        reverse_mps: 1.0,
        left_radps: 1.0,
        right_radps: 1.0,
    };
    check(&[
        TeleopState::SafeBoot,
        TeleopState::Idle,
        TeleopState::Held,
        TeleopState::Driving,
        TeleopState::Stopping(StopReason::Released),
        TeleopState::EStop,
        TeleopState::Fault(FaultReason::SelfTest),
    ]);
    check(&[
        StopReason::Released,
        StopReason::Age,
        StopReason::NotFinite,
        StopReason::CollisionMonitorStale,
        StopReason::LeaseEnded(LeaseEnd::Released),
    ]);
    check(&[
        LeaseEnd::Released,
        LeaseEnd::Expired,
        LeaseEnd::Renewed,
        LeaseEnd::HandedOver,
        LeaseEnd::TakenOver,
        LeaseEnd::Revoked,
        LeaseEnd::Reset,
        LeaseEnd::Fault,
    ]);
    check(&[FaultReason::SelfTest, FaultReason::Actuator]);
    check(&[Arming::Locked, Arming::Neutral, Arming::Pressed]);
    check(&[
        Clamp::Speed,
        Clamp::Ramp,
        Clamp::Age,
        Clamp::CollisionMonitor,
        Clamp::Stop,
    ]);
    check(&[
        CollisionMonitorState::Silent,
        CollisionMonitorState::Off,
        CollisionMonitorState::On(limits),
        CollisionMonitorState::UnknownSpace(limits),
        CollisionMonitorState::Stale,
    ]);
    check(&[
        BarrierKind::Detected,
        BarrierKind::Mapped,
        BarrierKind::Unknown,
        BarrierKind::Shallow,
        BarrierKind::NoReturn,
    ]);
    check(&Refusal::ALL);
    check(&SensorKind::ALL);
    check(&SensorFault::ALL);
    check(&[
        RecordingState::Stopped,
        RecordingState::Recording,
        RecordingState::StoppedDiskLow,
        RecordingState::Failed,
    ]);
    check(&[Severity::Info, Severity::Warning, Severity::Alarm]);
}

#[test]
fn neutral_is_next_to_nothing() {
    let drive = |linear_mps, angular_radps| Drive {
        linear_mps,
        angular_radps,
        estop: None,
    };
    assert!(drive(0.0, -0.0).is_neutral() && drive(9e-4, -9e-4).is_neutral());
    for speed in [1e-3, -0.5, f32::NAN, f32::INFINITY] {
        assert!(!drive(speed, 0.0).is_neutral() && !drive(0.0, speed).is_neutral());
    }
}

/// Messages at 50 Hz while driving, and at 2 Hz.
#[test]
fn messages_of_driving_are_small() {
    let pose = Pose {
        position_m: [1.0; 3],
        quaternion_xyzw: [0.5; 4],
        speed_mps: 1.0,
        turn_rate_radps: 1.0,
        token: Some(AgeToken {
            n: 50 * 3600 * 24,
            nonce: u64::MAX,
        }),
    };
    assert_eq!(BEHIND_HEADER + body(&pose).len(), 95);

    let longest: OperatorId = "a".repeat(64).parse().unwrap();
    let full = TeleopStatus {
        lease: LeaseStatus {
            epoch: u64::MAX,
            holder: Some(longest.clone()),
            next: Some(longest.clone()),
            waiting: Some(longest),
        },
        age_ms: Some(u32::MAX),
        ground_age_ms: [Some(u32::MAX); 4],
        counters: CommandCounters {
            accepted: u64::MAX,
            involuntary_stops: u64::MAX,
            refused: Refusal::ALL
                .map(|reason| RefusedCount {
                    reason,
                    count: u64::MAX,
                })
                .into(),
        },
        ..teleop()
    };
    assert_eq!(body(&teleop()).len(), 91);
    assert_eq!(body(&full).len(), 568);
}

proptest! {
    #[test]
    fn no_bytes_panic_or_ask_for_memory(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let mut message = encode(&HEADER, &()).unwrap();
        message.extend(bytes);
        drop(decode::<MapHead>(&message));
        drop(decode::<TilesReply>(&message));
        drop(decode::<TilesRequest>(&message));
        drop(decode::<Digests>(&message));
        drop(decode::<Info>(&message));
        drop(decode::<Status>(&message));
        drop(decode::<Event>(&message));
        drop(decode::<View>(&message));
        drop(decode::<ShoresReply>(&message));
        drop(decode::<Scan>(&message));
        drop(decode::<Pose>(&message));
        drop(decode::<Drive>(&message));
        drop(decode::<LeaseRequest>(&message));
        drop(decode::<Setting>(&message));
        drop(decode::<Answer>(&message));
        drop(decode::<TeleopStatus>(&message));
    }
}
