//! The third pipe: what encoders say on its way from the guard to a reader, and that nothing at its far end matters to
//! the motors.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};

use drivers::Drivers;
use drivers::supervisor::Reading;
use measurement::{MeasurementData, StreamId};

use super::*;
use crate::actuators::forward_pipe;

/// Of a wheel.
const PULSES_PER_TURN: f64 = 250.0;

/// From the decision for zero, or 200 ms after the last one to drive, until both motors stand.
const LIMIT: Duration = Duration::from_millis(200);

/// The left wheel is on channel 2, the right one is mounted the other way round.
fn config(port: &Path) -> RoboteqConfig {
    toml::from_str(&format!(
        "port = \"{}\"\nleft_channel = \"two\"\nright_is_inverted = true\nencoder_full_speed_mps = 1.27\n\
         drive = {{ track_width_m = 0.5, full_speed_mps = 1.0 }}\n\
         [encoders]\nleft_pulses_per_turn = {PULSES_PER_TURN}\nright_pulses_per_turn = {PULSES_PER_TURN}\n",
        port.display()
    ))
    .unwrap()
}

/// On a real line; the wheels turn once a second at full speed.
fn with_encoders() -> EmulatorOnTerminal {
    EmulatorOnTerminal::start(|emulator| {
        emulator.has_line_timing = true;
        emulator.watchdog_after = Duration::from_hours(1);
        emulator.watchdog_trial_after = Some(Duration::from_millis(100));
        emulator.encoders = Some([50, 30]);
        emulator.full_speed_counts = Some([4.0 * PULSES_PER_TURN; 2]);
    })
}

fn start(controller: &EmulatorOnTerminal, write_end: &Arc<OwnedFd>) -> GuardedMotors {
    let config = config(controller.path());
    let command = GuardCommand {
        forward_pipe: Some(Arc::clone(write_end)),
        obstacle_pipe: None,
        ..guard_command(&config)
    };
    GuardedMotors::start_with(command, config.into(), NEVER).unwrap()
}

/// Reads the encoders of a controller at this read end.
fn read(controller: &EmulatorOnTerminal, read_end: OwnedFd) -> (Drivers, Receiver<Reading>) {
    let (sender, readings) = sync_channel(10_000);
    let mut drivers = Drivers::start(&BTreeMap::new(), clock::now, &sender).unwrap();
    let encoders = config(controller.path()).encoders().unwrap();
    drivers.add_forwarded("wheels", (encoders, read_end), clock::now, &sender);
    (drivers, readings)
}

/// Angles of the left and the right wheel, and what the counts of the emulator say of them, in turns.
fn turns(controller: &EmulatorOnTerminal, reading: &Reading) -> [[f64; 2]; 2] {
    let MeasurementData::Joints(joints) = &reading.measurement.data else {
        panic!("{reading:?}");
    };
    let of = |name| joints.iter().find(|(joint, _)| joint == name).unwrap().1 / TAU;
    let [one, two] = controller
        .with(|emulator| emulator.counts(clock::now()).unwrap())
        .map(|count| f64::from(count) / (4.0 * PULSES_PER_TURN));
    [
        [of("left_wheel_joint"), of("right_wheel_joint")],
        [two, -one],
    ]
}

/// Turns ahead, and stops.
fn drive_for(motors: &mut GuardedMotors, ticks: u32) {
    drive(motors);
    for _ in 0..ticks {
        let curve = Velocity {
            linear_mps: 0.5,
            lateral_mps: 0.0,
            angular_radps: -0.4,
        };
        motors.apply(curve, clock::now()).ok();
        std::thread::sleep(TICK);
    }
    apply_until(motors, Velocity::ZERO, "at rest", |known| {
        known.is_ok_and(|report| report.applied == Some(Velocity::ZERO))
    });
}

fn assert_angles_arrive(controller: &EmulatorOnTerminal, readings: &Receiver<Reading>) {
    // The vehicle stands: those that come a while later are its last ones.
    std::thread::sleep(Duration::from_millis(600));
    let reading = readings.try_iter().last().unwrap();
    assert_eq!(reading.measurement.stream, StreamId(0));
    assert_eq!(&*reading.measurement.frame, "wheels");
    let [measured, expected] = turns(controller, &reading);
    for (measured, expected) in measured.into_iter().zip(expected) {
        assert!((measured - expected).abs() < 1e-9, "{measured} {expected}");
    }
    let [left, right] = measured;
    assert!(left > right && right > 0.2, "{measured:?}");
}

#[test]
fn counts_arrive_as_angles_of_wheels_and_go_on_with_the_next_guard() {
    let controller = with_encoders();
    let (read_end, write_end) = forward_pipe::pipe(forward_pipe::LEAST_BYTES).unwrap();
    let write_end = Arc::new(write_end);
    let (drivers, readings) = read(&controller, read_end);
    let mut motors = start(&controller, &write_end);
    // Angles begin with the first counts.
    wait_until("counts", || {
        motors.apply(Velocity::ZERO, clock::now()).ok();
        readings.try_recv().is_ok()
    });
    drive_for(&mut motors, 200);
    let report = motors.apply(Velocity::ZERO, clock::now()).unwrap();
    assert!(report.measured.is_some(), "speeds are asked as well");
    assert_angles_arrive(&controller, &readings);
    let (_, status) = drivers.statuses().now().next().unwrap();
    // A busy computer may have fewer.
    assert!((3.0..=10.5).contains(&status.rate_hz), "{status:?}");
    drop(motors);
    let mut motors = start(&controller, &write_end);
    wait_until_obeying(&mut motors);
    let before = controller.with(|emulator| emulator.counts_asked);
    wait_until("counts", || {
        motors.apply(Velocity::ZERO, clock::now()).ok();
        controller.with(|emulator| emulator.counts_asked) > before + 10
    });
    let readings_of_second = readings.try_iter().count();
    assert!(readings_of_second >= 3, "{readings_of_second}");
    let report = motors.apply(Velocity::ZERO, clock::now()).unwrap();
    assert_eq!(report.counters.lost_bytes, 0);
}

#[test]
fn without_a_pipe_or_a_guard_nobody_asks_for_counts() {
    let controller = with_encoders();
    let config = config(controller.path());
    let mut motors =
        GuardedMotors::start_with(guard_command(&config), config.into(), NEVER).unwrap();
    drive_for(&mut motors, 50);
    assert_eq!(controller.with(|emulator| emulator.counts_asked), 0);
    drop(motors);
    let (_read_end, write_end) = forward_pipe::pipe(forward_pipe::LEAST_BYTES).unwrap();
    let mut motors = start(&controller, &Arc::new(write_end));
    drive_for(&mut motors, 50);
    signal(motors.guard_pid().unwrap(), Signal::KILL);
    wait_for_rescue(&mut motors);
    let asked = controller.with(|emulator| emulator.counts_asked);
    assert!(asked > 5, "{asked}");
    press(&mut motors, 100);
    assert_eq!(controller.with(|emulator| emulator.counts_asked), asked);
    controller.assert_stops_for_good();
}

/// Stops by a decision and by silence, and starts again: each time within the limit.
fn assert_obeys(controller: &EmulatorOnTerminal, motors: &mut GuardedMotors) {
    let pid = motors.guard_pid().unwrap();
    let (mut asked, mut silent) = (Vec::new(), Vec::new());
    let stands = || controller.with(|emulator| emulator.motors()) == [0, 0];
    for _ in 0..5 {
        drive(motors);
        let decided = clock::now();
        apply_until(motors, Velocity::ZERO, "zero", |_| stands());
        asked.push(controller.outputs().last().unwrap().at.since(decided));
        drive(motors);
        let decided = clock::now();
        motors.apply(AHEAD, decided).ok();
        wait_until("zero", stands);
        let at = controller.outputs().last().unwrap().at;
        silent.push(at.since(decided + WATCHDOG));
    }
    for times in [&mut asked, &mut silent] {
        times.sort();
        // The middle one: a busy computer may be late now and then.
        assert!(times[2] < LIMIT, "{times:?}");
    }
    assert_eq!(motors.guard_pid(), Some(pid));
}

fn lost_bytes(motors: &mut GuardedMotors) -> u32 {
    let known = motors.apply(Velocity::ZERO, clock::now());
    known.map_or(0, |report| report.counters.lost_bytes)
}

#[test]
fn motors_obey_and_stop_while_nobody_reads_the_pipe() {
    let controller = with_encoders();
    let (read_end, write_end) = forward_pipe::pipe(forward_pipe::LEAST_BYTES).unwrap();
    let mut motors = start(&controller, &Arc::new(write_end));
    drive(&mut motors);
    press(&mut motors, 1000);
    wait_until("the pipe is full", || lost_bytes(&mut motors) > 0);
    assert_obeys(&controller, &mut motors);
    // Read again, it gives nothing old, and no number that was made of two.
    let (_drivers, readings) = read(&controller, read_end);
    wait_until("counts", || {
        motors.apply(Velocity::ZERO, clock::now()).ok();
        readings.try_recv().is_ok()
    });
    press(&mut motors, 20);
    let lost = lost_bytes(&mut motors);
    drive_for(&mut motors, 100);
    std::thread::sleep(Duration::from_millis(600));
    let angles: Vec<f64> = readings
        .try_iter()
        .map(|reading| turns(&controller, &reading)[0][0])
        .collect();
    assert!(angles.len() > 5 && angles.is_sorted(), "{angles:?}");
    assert!(angles[angles.len() - 1] < 3.0, "{angles:?}");
    assert_eq!(lost_bytes(&mut motors), lost);
}

#[test]
fn motors_obey_and_stop_after_the_pipe_is_closed() {
    let controller = with_encoders();
    let (read_end, write_end) = forward_pipe::pipe(forward_pipe::LEAST_BYTES).unwrap();
    let mut motors = start(&controller, &Arc::new(write_end));
    drive(&mut motors);
    drop(read_end);
    wait_until("bytes are lost", || lost_bytes(&mut motors) > 0);
    assert_obeys(&controller, &mut motors);
}
