//! The bodies of messages; see [`crate::wire`] for what precedes them and [`crate::keys`] for where they go.

mod map;
mod robot;
mod teleop;

pub use map::*;
pub use robot::*;
pub use teleop::*;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use serde::Serialize;
    use serde::de::DeserializeOwned;

    use super::*;
    use crate::keys::OperatorId;
    use crate::tile::BootId;
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

    /// Scans must leave bandwidth for tiles.
    #[test]
    fn a_scan_is_small() {
        let walls = |range_m: f64| {
            let beam = move |n: usize| {
                let angle_rad = std::f64::consts::TAU * n as f64 / MAX_SCAN_POINTS as f64;
                [libm::cos(angle_rad), libm::sin(angle_rad)].map(|part| range_m * part)
            };
            let scan =
                Scan::of_points("laser".to_owned(), [0.0; 2], (0..MAX_SCAN_POINTS).map(beam));
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
                lateral_mps: 0.0,
                angular_radps: -2.0,
            },
            clamp: Some(Clamp::Ramp),
            collision_monitor: CollisionMonitorState::UnknownSpace(SpeedLimits {
                forward_mps: 1.0,
                reverse_mps: f32::INFINITY,
                left_mps: 0.0,
                right_mps: 0.0,
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
            battery_v: Some(1.0),
            docking: Some(DockingChoice {
                site: 300,
                vegetation: ShoreClass::Dense,
            }),
            motor_hold: Some(MotorHold::Mode(300)),
            goal: GoalStatus {
                has_planner: true,
                running: Some(MapPose {
                    x_mm: -150,
                    y_mm: 1,
                    yaw_mrad: 0,
                }),
                last_end: Some(GoalEnd::PlannerSilent),
            },
        }
    }

    /// What the examples of `SPEC.md` lack: an emergency stop, and a speed without limit.
    #[test]
    fn the_status_of_driving_is_the_documented_bytes() {
        const ONE: [u8; 4] = [0, 0, 0x80, 0x3F];
        const MINUS_TWO: [u8; 4] = [0, 0, 0, 0xC0];
        const ZERO: [u8; 4] = [0; 4];

        let expected = [
            &[6, 1, 1, 4, 5, 1][..], // state, last_stop, is_drifting
            &[0xAC, 2, 0, 1, 4],     // lease: epoch, holder, next
            b"anna",
            &[0, 2, 0, 1, 0xAC, 2], // waiting, arming, age_ms, peak_age_ms
            &[ONE, ZERO, ZERO, ZERO, ONE, ZERO, MINUS_TWO].concat(),
            &[1, 1, 3], // clamp, guard
            &[ONE, [0, 0, 0x80, 0x7F], ZERO, ZERO, MINUS_TWO, ZERO].concat(),
            &[1, 0xAC, 2, 1],       // estop
            &[0xAC, 2, 2, 1, 5, 7], // counters
            &[0x80, 2, 0, 1],       // settings
            &[1],                   // barrier
            &[ONE, MINUS_TWO].concat(),
            &[1],
            &[1, 0xAC, 2, 0, 1, 5, 0], // ground_age_ms
            &[1],                      // battery_v
            &ONE,
            &[1, 0xAC, 2, 1],             // docking
            &[1, 4, 0xAC, 2],             // motor_hold
            &[1, 1, 0xAB, 2, 2, 0, 1, 4], // goal
        ];
        assert_eq!(body(&teleop()), expected.concat());
        let nothing_in_the_way = TeleopStatus {
            barrier: None,
            ground_age_ms: [None; 4],
            battery_v: None,
            docking: None,
            motor_hold: None,
            goal: GoalStatus::default(),
            ..teleop()
        };
        assert!(body(&nothing_in_the_way).ends_with(&[0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]));
    }

    #[test]
    fn neutral_is_next_to_nothing() {
        let drive = |linear_mps, angular_radps| Drive {
            linear_mps,
            lateral_mps: 0.0,
            angular_radps,
            estop: None,
            docking: None,
            goal: None,
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
            lateral_mps: 0.0,
            turn_rate_radps: 1.0,
            token: Some(AgeToken {
                n: 50 * 3600 * 24,
                nonce: u64::MAX,
            }),
        };
        assert_eq!(BEHIND_HEADER + body(&pose).len(), 99);
        let view = View {
            rectangle_m: [-1e6, -1e6, 1e6, 1e6],
            layers: u32::MAX,
            revision: u64::MAX,
            is_synchronized: true,
            wants_scan: true,
        };
        assert!(BEHIND_HEADER + body(&view).len() <= 256);

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
        assert_eq!(body(&teleop()).len(), 128);
        assert_eq!(body(&full).len(), 605);
    }

    proptest! {
        #[test]
        fn no_bytes_panic_or_ask_for_memory(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let mut message = encode(&HEADER, &()).unwrap();
            message.extend(bytes);
            drop(decode::<MapHead>(&message));
            drop(decode::<TilesReply>(&message));
            drop(decode::<Changes>(&message));
            drop(decode::<TilesRequest>(&message));
            drop(decode::<Digests>(&message));
            drop(decode::<Info>(&message));
            drop(decode::<Status>(&message));
            drop(decode::<Event>(&message));
            drop(decode::<View>(&message));
            drop(decode::<ShoresReply>(&message));
            drop(decode::<Scan>(&message));
            drop(decode::<Pose>(&message));
            drop(decode::<Plan>(&message));
            drop(decode::<Drive>(&message));
            drop(decode::<LeaseRequest>(&message));
            drop(decode::<Setting>(&message));
            drop(decode::<Answer>(&message));
            drop(decode::<TeleopStatus>(&message));
        }
    }
}
