use proptest::prelude::*;

use super::*;
use crate::actuators::motor_guard::frame::{MotorReport, every_fault};
use crate::actuators::report::{ControllerWatchdog, Counters, Hold, Readiness, Report};

fn motor_command(sequence: u64, linear_mps: f64) -> MotorCommand {
    MotorCommand {
        sequence,
        decided_at: Monotonic::from_nanos(123_456_789_012),
        velocity: Velocity {
            linear_mps,
            angular_radps: -0.25,
        },
    }
}

fn find(bytes: &[u8]) -> (Vec<MotorCommand>, usize) {
    let (mut frames, mut garbage) = (Vec::new(), 0);
    Decoder::new().push(bytes, |found| match found {
        Found::Frame(frame) => frames.push(frame),
        Found::Garbage => garbage += 1,
    });
    (frames, garbage)
}

#[test]
fn the_bytes_are_those_of_the_table() {
    let bytes = motor_command(0x0102, 1.5).encode();
    assert_eq!(&bytes[..12], [0xF5, 0x4D, 1, 1, 2, 1, 0, 0, 0, 0, 0, 0]);
    assert_eq!(bytes[12..20], 123_456_789_012_u64.to_le_bytes());
    assert_eq!(bytes[20..28], 1.5_f64.to_le_bytes());
    assert_eq!(bytes[28..36], (-0.25_f64).to_le_bytes());
    assert_eq!(bytes[36..], crc32fast::hash(&bytes[..36]).to_le_bytes());
}

#[test]
fn frames_fill_their_length() {
    fn fills<const N: usize, F: Frame<N>>(frame: &F) {
        let mut room = vec![0; N - CRC_BYTES - MAGIC.len() - 1];
        let mut body = Writer(&mut room);
        frame.write(&mut body);
        assert!(body.is_full());
    }
    fills(&motor_command(1, 0.0));
    fills(&motor_report(Readiness::Starting, None));
}

fn motor_report(
    readiness: Readiness,
    fault: Option<crate::actuators::report::ControllerFault>,
) -> MotorReport {
    MotorReport {
        sequence: 77,
        report: Report {
            readiness,
            measured: Some(motor_command(0, 0.5).velocity),
            battery_v: Some(24.5),
            watchdog: ControllerWatchdog::Proven,
            counters: Counters {
                dropouts: 1,
                stale: 2,
                garbage: 3,
                reconnects: u32::MAX,
            },
            ..Report::unknown(Monotonic::from_nanos(99))
        },
        fault,
    }
}

#[test]
fn what_is_told_comes_back() {
    let holds = [Hold::Start, Hold::Silence, Hold::Garbage, Hold::Controller];
    let readiness = holds
        .map(Readiness::Holding)
        .into_iter()
        .chain([Readiness::Starting, Readiness::Active]);
    for readiness in readiness {
        for fault in every_fault(0x3F_12C5) {
            let motor_report = motor_report(readiness, fault);
            assert_eq!(
                MotorReport::decode(&motor_report.encode()),
                Some(motor_report)
            );
        }
    }
    assert_eq!(every_fault(0).count(), 9);
}

#[test]
fn a_code_that_means_nothing_is_no_frame() {
    for at in [61, 62, 65] {
        let mut bytes = motor_report(Readiness::Starting, None).encode();
        bytes[at] = 200;
        let crc = crc32fast::hash(&bytes[..84]).to_le_bytes();
        bytes[84..].copy_from_slice(&crc);
        assert_eq!(MotorReport::decode(&bytes), None, "{at}");
    }
}

#[test]
fn a_frame_that_was_cut_off_does_not_take_the_next_one_with_it() {
    let whole = motor_command(2, 0.0).encode();
    for cut in 1..COMMAND_BYTES {
        let bytes = [&motor_command(1, 0.0).encode()[..cut], &whole].concat();
        assert_eq!(find(&bytes), (vec![motor_command(2, 0.0)], cut));
    }
}

proptest! {
    #[test]
    fn frames_are_found_between_any_garbage(
        garbage in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..120), 4),
        split in 1..100usize,
    ) {
        let frames: Vec<MotorCommand> = (1..=3).map(|n| motor_command(n, n as f64)).collect();
        let mut stream = garbage[0].clone();
        for (frame, after) in frames.iter().zip(&garbage[1..]) {
            stream.extend(frame.encode());
            stream.extend(after);
        }
        // Garbage could begin like a frame: the rest of one settles it.
        stream.extend([0; COMMAND_BYTES]);
        let (mut found, mut decoder) = (Vec::new(), Decoder::<COMMAND_BYTES>::new());
        for part in stream.chunks(split) {
            decoder.push(part, |one: Found<MotorCommand>| if let Found::Frame(frame) = one { found.push(frame) });
        }
        prop_assert_eq!(found, frames);
    }

    #[test]
    fn no_flipped_bits_make_another_frame(flips in prop::collection::vec(0..COMMAND_BYTES * 8, 1..4)) {
        let good = motor_command(7, 1.0).encode();
        let mut bad = good;
        for &bit in &flips {
            bad[bit / 8] ^= 1 << (bit % 8);
        }
        prop_assert_eq!(MotorCommand::decode(&bad).is_some(), bad == good);
    }

    #[test]
    fn any_velocity_and_moment_survive(
        sequence in any::<u64>(), at in any::<u64>(), linear in any::<u64>(), angular in any::<u64>(),
    ) {
        let motor_command = MotorCommand {
            sequence,
            decided_at: Monotonic::from_nanos(at),
            velocity: Velocity {
                linear_mps: f64::from_bits(linear),
                angular_radps: f64::from_bits(angular),
            },
        };
        let bytes = motor_command.encode();
        let back = MotorCommand::decode(&bytes).unwrap();
        prop_assert_eq!(back.encode(), bytes, "bit by bit, also what is not a number");
    }
}
