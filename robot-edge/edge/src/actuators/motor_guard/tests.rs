//! Real processes, real pipes, a real terminal; only the controller is emulated. The test binary is edge and guard
//! itself: [`guard_as_helper_process`] and [`edge_as_helper_process`] are what they run.
//!
//! Nothing here must be fast. Where motors must stop, they must do so at some time, and then never move again.

use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Mutex;

use rustix::process::{Pid, Signal, WaitOptions, kill_process, test_kill_process, waitpid};

use super::frame::{COMMAND_BYTES, Decoder, Found, Frame as _, MotorCommand, REPORT_BYTES};
use super::*;
use crate::actuators::motor_guard::frame::MotorReport;
use crate::actuators::motor_link::Sharing;
use crate::actuators::report::{
    ControllerFault, ControllerWatchdog, FallbackStop, Fault, Hold, Readiness, Report,
};
use crate::actuators::roboteq::RoboteqConfig;
use crate::actuators::roboteq::emulator::on_terminal::EmulatorOnTerminal;
use crate::actuators::roboteq::serial_link::Port;
use measurement::time::Monotonic;
use network::clock;
use teleop::Velocity;

mod encoders;

/// Longest wait for what must happen.
const PATIENCE: Duration = Duration::from_mins(3);

/// Of tests in which no guard is lost, however busy the computer is.
const NEVER: Duration = Duration::from_hours(1);

const TICK: Duration = Duration::from_millis(10);

const AHEAD: Velocity = Velocity {
    linear_mps: 0.5,
    lateral_mps: 0.0,
    angular_radps: 0.0,
};

/// Half of the full speed of 1 m/s.
const AHEAD_POWERS: [i8; 2] = [64, 64];

const FASTER: Velocity = Velocity {
    linear_mps: 1.0,
    lateral_mps: 0.0,
    angular_radps: 0.0,
};

const FASTER_POWERS: [i8; 2] = [127, 127];

const GUARD: &str = "FORESHORE_TEST_GUARD";
const EDGE: &str = "FORESHORE_TEST_EDGE";

fn config(port: &Path) -> RoboteqConfig {
    toml::from_str(&format!(
        "port = \"{}\"\nleft_channel = \"one\"\ndrive = {{ track_width_m = 0.5, full_speed_mps = 1.0 }}\n\
         encoder_full_speed_mps = 1.27\n",
        port.display()
    ))
    .unwrap()
}

fn this_test_as(name: &str, variable: &str, config: &RoboteqConfig) -> GuardCommand {
    let test = format!("{}::{name}", module_path!().split_once("::").unwrap().1);
    GuardCommand {
        program: std::env::current_exe().unwrap(),
        arguments: vec![test.into(), "--exact".into(), "--nocapture".into()],
        environment: vec![(
            variable.into(),
            serde_json::to_string(config).unwrap().into(),
        )],
        forward_pipe: None,
        obstacle_pipe: None,
    }
}

fn spawn(command: GuardCommand, stdout: Stdio) -> Child {
    Command::new(command.program)
        .args(command.arguments)
        .envs(command.environment)
        .stdin(Stdio::piped())
        .stdout(stdout)
        .spawn()
        .unwrap()
}

const fn alternating(number: u64) -> Velocity {
    if number.is_multiple_of(2) {
        Velocity::ZERO
    } else {
        AHEAD
    }
}

fn guard_command(config: &RoboteqConfig) -> GuardCommand {
    this_test_as("guard_as_helper_process", GUARD, config)
}

fn configured_by(variable: &str) -> Option<RoboteqConfig> {
    let json = std::env::var(variable).ok()?;
    Some(serde_json::from_str(&json).unwrap())
}

/// Not a test: the guard's process.
#[test]
fn guard_as_helper_process() {
    if let Some(config) = configured_by(GUARD) {
        run(std::io::stdin(), std::io::stdout(), &config.into()).unwrap();
        // Before the test harness says more on standard output, which is the pipe.
        std::process::exit(0);
    }
}

/// Not a test: an edge that drives ahead, then faster, and never stops asking for that while its test lives.
#[test]
fn edge_as_helper_process() {
    if let Some(config) = configured_by(EDGE) {
        let mut motors = start(&config);
        drive(&mut motors);
        let stdin = std::io::stdin();
        rustix::io::ioctl_fionbio(&stdin, true).unwrap();
        while rustix::io::read(&stdin, &mut [0; 1]) != Ok(0) {
            motors.apply(FASTER, clock::now()).ok();
            std::thread::sleep(TICK);
        }
    }
}

fn start(config: &RoboteqConfig) -> GuardedMotors {
    GuardedMotors::start_with(guard_command(config), config.clone().into(), NEVER).unwrap()
}

fn driving() -> (EmulatorOnTerminal, GuardedMotors) {
    let controller = EmulatorOnTerminal::start(|_| {});
    let mut motors = start(&config(controller.path()));
    drive(&mut motors);
    (controller, motors)
}

/// Calls `is_so` at every tick until it is; panics with `what` if it never is.
fn wait_until(what: &str, mut is_so: impl FnMut() -> bool) {
    let deadline = clock::now() + PATIENCE;
    while !is_so() {
        assert!(clock::now() < deadline, "waited in vain: {what}");
        std::thread::sleep(TICK);
    }
}

fn apply_until(
    motors: &mut GuardedMotors,
    velocity: Velocity,
    what: &str,
    mut is_so: impl FnMut(Result<Report, Fault>) -> bool,
) {
    wait_until(what, || is_so(motors.apply(velocity, clock::now())));
}

fn wait_until_obeying(motors: &mut GuardedMotors) {
    apply_until(motors, Velocity::ZERO, "it obeys", |known| {
        known.is_ok_and(|report| report.readiness == Readiness::Active)
    });
}

fn press(motors: &mut GuardedMotors, ticks: u32) {
    for _ in 0..ticks {
        // Tests ask elsewhere what is known.
        motors.apply(AHEAD, clock::now()).ok();
        std::thread::sleep(TICK);
    }
}

/// Until the motors run; on a busy computer a gap may stop them, and it begins again.
fn drive(motors: &mut GuardedMotors) {
    wait_until("the motors run", || {
        wait_until_obeying(motors);
        (0..50).any(|_| {
            std::thread::sleep(TICK);
            let known = motors.apply(AHEAD, clock::now());
            known.is_ok_and(|report| report.applied.is_some_and(|applied| !applied.is_zero()))
        })
    });
}

fn signal(pid: u32, signal: Signal) {
    let pid = Pid::from_raw(i32::try_from(pid).unwrap()).unwrap();
    kill_process(pid, signal).unwrap();
}

/// Stops a child, and returns when it is stopped: until then it goes on reading.
fn stop(child: &Child) {
    signal(child.id(), Signal::STOP);
    let pid = Pid::from_child(child);
    let (_, status) = waitpid(Some(pid), WaitOptions::UNTRACED).unwrap().unwrap();
    assert!(status.stopped());
}

/// Ended and reaped: one that is only stopped could continue.
fn wait_until_it_is_gone(pid: u32) {
    let pid = Pid::from_raw(i32::try_from(pid).unwrap()).unwrap();
    wait_until("the guard is gone", || test_kill_process(pid).is_err());
}

fn wait_until_the_port_is_free(path: &Path) {
    wait_until("the port is free", || {
        Port::open(path, Sharing::Exclusive).is_ok()
    });
}

#[test]
fn it_drives_reports_and_stops_when_nothing_is_asked_any_more() {
    let controller = EmulatorOnTerminal::start(|emulator| emulator.encoders = Some([50, 30]));
    let mut motors = start(&config(controller.path()));
    assert_eq!(
        motors.apply(AHEAD, clock::now()).unwrap().readiness,
        Readiness::Starting
    );
    drive(&mut motors);
    apply_until(&mut motors, AHEAD, "measured", |known| {
        known.is_ok_and(|report| report.measured.is_some() && report.battery_v.is_some())
    });
    let report = motors.apply(AHEAD, clock::now()).unwrap();
    assert_eq!(report.watchdog, ControllerWatchdog::Proven);
    assert!((report.battery_v.unwrap() - 25.781_25).abs() < 1e-9);
    // 0.5 m/s to the left, 0.3 m/s to the right, 0.5 m apart.
    let measured = report.measured.unwrap();
    assert!(
        (measured.linear_mps - 0.4).abs() < 1e-9 && (measured.angular_radps + 0.4).abs() < 1e-9
    );

    // The loop hangs.
    controller.assert_stops_for_good();
    let before = controller.outputs().len();
    // It goes on, and the key was down all the time.
    apply_until(&mut motors, AHEAD, "the gap is reported", |known| {
        known.is_ok_and(|report| {
            report.counters.dropouts > 0 && report.readiness == Readiness::Holding(Hold::Silence)
        })
    });
    press(&mut motors, 50);
    assert_eq!(controller.outputs().len(), before, "it held");
    drive(&mut motors);
    drop(motors);
    assert_eq!(controller.with(|emulator| emulator.motors()), [0, 0]);
    wait_until_the_port_is_free(controller.path());
}

#[test]
fn what_is_not_a_number_stops_the_motors() {
    let (controller, mut motors) = driving();
    let nonsense = Velocity {
        linear_mps: f64::NAN,
        lateral_mps: 0.0,
        angular_radps: 0.0,
    };
    assert_eq!(motors.apply(nonsense, clock::now()), Err(Fault::NotANumber));
    controller.assert_stops_for_good();
}

#[test]
fn what_was_decided_too_long_ago_is_not_made_young_on_its_way() {
    let (controller, mut motors) = driving();
    let long_ago = clock::now();
    controller.assert_stops_for_good();
    let changes = controller.outputs().len();
    for number in 0..100 {
        motors.apply(alternating(number), long_ago).ok();
        std::thread::sleep(TICK);
    }
    assert_eq!(controller.outputs().len(), changes);
}

/// An edge in a process of its own that drives; killed at the latest when the test ends.
struct Edge(Child);

impl Edge {
    /// On a busy computer a gap may stop one that only ever asks to drive; then another one tries.
    fn drive(controller: &EmulatorOnTerminal) -> Self {
        let deadline = clock::now() + PATIENCE;
        while clock::now() < deadline {
            let edge = Self::start(controller);
            let until = clock::now() + Duration::from_secs(20);
            while clock::now() < until {
                if controller.with(|emulator| emulator.motors()) == FASTER_POWERS {
                    return edge;
                }
                std::thread::sleep(TICK);
            }
        }
        panic!("no edge drives");
    }

    fn start(controller: &EmulatorOnTerminal) -> Self {
        let command = this_test_as("edge_as_helper_process", EDGE, &config(controller.path()));
        Self(spawn(command, Stdio::null()))
    }
}

impl Drop for Edge {
    fn drop(&mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

#[test]
fn an_edge_that_is_killed_leaves_standing_motors() {
    let controller = EmulatorOnTerminal::start(|_| {});
    let mut edge = Edge::drive(&controller);
    edge.0.kill().unwrap();
    controller.assert_stops_for_good();
    wait_until_the_port_is_free(controller.path());
}

/// Its only child.
fn guard_of(edge: &Edge) -> u32 {
    let threads = std::fs::read_dir(format!("/proc/{}/task", edge.0.id())).unwrap();
    let children = threads
        .map(|thread| std::fs::read_to_string(thread.unwrap().path().join("children")).unwrap());
    children.collect::<String>().trim().parse().unwrap()
}

#[test]
fn a_guard_that_is_stopped_as_its_edge_is_killed_stops_the_motors() {
    let controller = on_a_real_line();
    let mut edge = Edge::drive(&controller);
    let guard = guard_of(&edge);
    // For the kernel, a group with this member is not orphaned by the death of the edge: it does not continue it.
    let mut member = Command::new("sleep")
        .arg("600")
        .process_group(guard.cast_signed())
        .spawn()
        .unwrap();
    signal(guard, Signal::STOP);
    edge.0.kill().unwrap();
    controller.assert_stops_for_good();
    member.kill().unwrap();
    member.wait().unwrap();
}

#[test]
fn a_stopped_edge_leaves_motors_at_zero_after_it_continues() {
    let controller = EmulatorOnTerminal::start(|_| {});
    let edge = Edge::drive(&controller);
    stop(&edge.0);
    controller.assert_stops_for_good();
    signal(edge.0.id(), Signal::CONT);
    controller.assert_stops_for_good();
}

/// Applies the wish to drive on until the motors are said to have been stopped.
fn wait_for_rescue(motors: &mut GuardedMotors) {
    apply_until(motors, AHEAD, "rescued", |known| {
        known == Err(Fault::GuardGone(FallbackStop::Stopped))
    });
}

fn lose_guard_by(signal_of_loss: Signal) {
    let controller = EmulatorOnTerminal::start(|_| {});
    let config = config(controller.path());
    // Silence is the only sign of a guard that is stopped.
    let silence = match signal_of_loss {
        Signal::STOP => Duration::from_secs(5),
        _ => NEVER,
    };
    let mut motors =
        GuardedMotors::start_with(guard_command(&config), config.into(), silence).unwrap();
    drive(&mut motors);
    let pid = motors.guard_pid().unwrap();
    signal(pid, signal_of_loss);
    wait_for_rescue(&mut motors);
    assert_eq!(motors.guard_pid(), None);
    wait_until_it_is_gone(pid);
    controller.assert_stops_for_good();
    for _ in 0..50 {
        let known = motors.apply(AHEAD, clock::now());
        assert!(
            matches!(known, Err(Fault::GuardGone(_))),
            "for good: {known:?}"
        );
        std::thread::sleep(TICK);
    }
    assert_eq!(controller.with(|emulator| emulator.motors()), [0, 0]);
}

#[test]
fn a_guard_that_is_killed_is_replaced_by_zero_and_a_fault() {
    lose_guard_by(Signal::KILL);
}

#[test]
fn a_guard_that_is_stopped_is_replaced_by_zero_and_a_fault() {
    lose_guard_by(Signal::STOP);
}

#[test]
fn a_guard_that_is_asked_to_end_stops_the_motors_first() {
    lose_guard_by(Signal::TERM);
    lose_guard_by(Signal::INT);
    lose_guard_by(Signal::QUIT);
}

#[test]
fn signals_that_are_meant_for_the_edge_leave_the_guard_as_it_is() {
    let (_controller, mut motors) = driving();
    let pid = motors.guard_pid().unwrap();
    for meant_for_the_edge in [Signal::USR1, Signal::USR2, Signal::HUP] {
        signal(pid, meant_for_the_edge);
        press(&mut motors, 20);
        assert_eq!(motors.guard_pid(), Some(pid), "{meant_for_the_edge:?}");
        drive(&mut motors);
    }
}

/// A real line, and a controller whose watchdog acts at the start alone: what stops these motors is not the watchdog.
fn on_a_real_line() -> EmulatorOnTerminal {
    EmulatorOnTerminal::start(|emulator| {
        emulator.has_line_timing = true;
        emulator.watchdog_after = Duration::from_hours(1);
        emulator.watchdog_trial_after = Some(Duration::from_millis(100));
    })
}

#[test]
fn a_stopped_guard_means_zero_within_250_ms_until_it_continues() {
    let controller = on_a_real_line();
    let mut motors = start(&config(controller.path()));
    let mut took = Vec::new();
    for _ in 0..5 {
        apply_until(&mut motors, Velocity::ZERO, "at rest", |known| {
            known.is_ok_and(|report| report.applied == Some(Velocity::ZERO))
        });
        drive(&mut motors);
        let pid = motors.guard_pid().unwrap();
        let stopped = clock::now();
        signal(pid, Signal::STOP);
        apply_until(&mut motors, AHEAD, "zero", |_| {
            controller.with(|emulator| emulator.motors()) == [0, 0]
        });
        took.push(controller.outputs().last().unwrap().at.since(stopped));
        signal(pid, Signal::CONT);
        assert_eq!(motors.guard_pid(), Some(pid), "it was not lost");
    }
    took.sort();
    println!("both motors at zero after {took:?}");
    // The middle one: a busy computer may be late now and then.
    assert!(took[2] < Duration::from_millis(250), "{took:?}");
}

#[test]
fn a_killed_guard_has_stopped_both_motors_or_neither() {
    let mut stopped = 0;
    for _ in 0..5 {
        let controller = on_a_real_line();
        let mut guard = BareGuard::start(&config(controller.path()));
        guard.drive(&controller, 1);
        drop(guard.child.stdin.take());
        // A tenth of what telling one motor after the other takes.
        std::thread::sleep(Duration::from_millis(4));
        guard.child.kill().unwrap();
        std::thread::sleep(Duration::from_millis(150));
        let motors = controller.with(|emulator| emulator.motors());
        assert_eq!(motors[0] == 0, motors[1] == 0, "one side turns: {motors:?}");
        stopped += usize::from(motors == [0, 0]);
    }
    println!("{stopped} of 5 stand");
    assert!(stopped >= 3, "{stopped} of 5");
}

#[test]
fn an_end_with_a_stopped_guard_leaves_motors_at_zero() {
    let controller = EmulatorOnTerminal::start(|emulator| {
        // Not by itself.
        emulator.input_mode = 1;
        emulator.reset(clock::now());
    });
    let mut config = config(controller.path());
    config.require_watchdog = false;
    let mut motors = start(&config);
    drive(&mut motors);
    let pid = motors.guard_pid().unwrap();
    signal(pid, Signal::STOP);
    drop(motors);
    assert_eq!(controller.with(|emulator| emulator.motors()), [0, 0]);
    controller.assert_stops_for_good();
}

#[test]
fn a_program_that_is_no_guard_is_a_fault() {
    let controller = EmulatorOnTerminal::start(|_| {});
    let config = config(controller.path());
    let mut command = guard_command(&config);
    command.program = "/nonexistent/guard".into();
    let mut motors = GuardedMotors::start_with(command, config.into(), NEVER).unwrap();
    wait_for_rescue(&mut motors);
}

#[test]
fn guard_and_supervisor_report_a_missing_port() {
    let mut config = config(Path::new("/dev/nonexistent"));
    let mut motors = start(&config);
    apply_until(&mut motors, AHEAD, "reported", |known| {
        known == Err(Fault::Controller(ControllerFault::Port(2)))
    });
    signal(motors.guard_pid().unwrap(), Signal::KILL);
    apply_until(&mut motors, AHEAD, "reported", |known| {
        known == Err(Fault::GuardGone(FallbackStop::Unreachable))
    });
    config.port = "/dev/null".into();
    let mut motors = start(&config);
    apply_until(&mut motors, AHEAD, "reported", |known| {
        matches!(known, Err(Fault::Controller(ControllerFault::Port(_))))
    });
}

#[test]
fn a_second_owner_is_refused() {
    let controller = EmulatorOnTerminal::start(|_| {});
    let config = config(controller.path());
    let mut first = start(&config);
    wait_until_obeying(&mut first);
    let mut second = start(&config);
    let holder = first.guard_pid().unwrap();
    let refusal = Fault::Controller(ControllerFault::Held(holder));
    apply_until(&mut second, AHEAD, "refused", |known| {
        assert!(
            known == Err(refusal)
                || known.is_ok_and(|report| report.readiness == Readiness::Starting)
        );
        known.is_err()
    });
    assert_eq!(controller.outputs().len(), 1);
    let said = refusal.to_string();
    let command = format!(
        "held by process {holder} ({}",
        std::env::current_exe().unwrap().display()
    );
    assert!(said.contains(&command), "{said}");
    // As soon as the first has let go, it is the second's.
    drop(first);
    drive(&mut second);
}

#[test]
fn a_controller_that_was_reset_stays_standing_until_zero_is_asked_for() {
    let (controller, mut motors) = driving();
    let now = clock::now();
    controller.with(|emulator| emulator.is_in_rc_mode = !emulator.reset(now).is_empty());
    apply_until(&mut motors, AHEAD, "found again", |known| {
        known.is_ok_and(|report| report.readiness == Readiness::Holding(Hold::Controller))
    });
    let held = controller.outputs().len();
    assert_eq!(controller.with(|emulator| emulator.motors()), [0, 0]);
    press(&mut motors, 20);
    assert_eq!(controller.outputs().len(), held);
    drive(&mut motors);
}

#[test]
fn a_power_stage_that_is_off_holds() {
    let (controller, mut motors) = driving();
    controller.with(|emulator| emulator.status = 0x04);
    apply_until(&mut motors, AHEAD, "undervoltage", |known| {
        known.is_ok_and(|report| {
            report.controller.is_off() && report.readiness == Readiness::Holding(Hold::Controller)
        })
    });
    // The battery recovers, and the key was down all the time.
    controller.with(|emulator| emulator.status = 0);
    apply_until(&mut motors, AHEAD, "recovered", |known| {
        known.is_ok_and(|report| !report.controller.is_off())
    });
    controller.assert_stops_for_good();
}

/// A guard that the test speaks to itself.
struct BareGuard {
    child: Child,
    heard: Mutex<(Decoder<REPORT_BYTES>, Option<MotorReport>)>,
}

impl BareGuard {
    fn alone() -> (EmulatorOnTerminal, Self) {
        let controller = EmulatorOnTerminal::start(|_| {});
        let guard = Self::start(&config(controller.path()));
        (controller, guard)
    }

    fn start(config: &RoboteqConfig) -> Self {
        let child = spawn(guard_command(config), Stdio::piped());
        rustix::io::ioctl_fionbio(child.stdout.as_ref().unwrap(), true).unwrap();
        Self {
            child,
            heard: Mutex::new((Decoder::new(), None)),
        }
    }

    fn write(&self, bytes: &[u8]) {
        let pipe = self.child.stdin.as_ref().unwrap();
        assert_eq!(rustix::io::write(pipe, bytes), Ok(bytes.len()));
    }

    fn ask(&self, sequence: u64, velocity: Velocity, decided_at: Monotonic) -> [u8; COMMAND_BYTES] {
        let motor_command = MotorCommand {
            sequence,
            decided_at,
            velocity,
            mode_requests: 0,
        };
        let bytes = motor_command.encode();
        self.write(&bytes);
        bytes
    }

    fn motor_report(&self) -> Option<MotorReport> {
        let mut heard = self.heard.lock().unwrap();
        let (decoder, newest) = &mut *heard;
        let mut buffer = [0; 4096];
        while let Ok(count @ 1..) =
            rustix::io::read(self.child.stdout.as_ref().unwrap(), &mut buffer)
        {
            decoder.push(&buffer[..count], |found| {
                if let Found::Frame(motor_report) = found {
                    *newest = Some(motor_report);
                }
            });
        }
        *newest
    }

    fn wait_until(&self, what: &str, is_so: impl Fn(&MotorReport) -> bool) {
        wait_until(what, || {
            self.motor_report().is_some_and(|known| is_so(&known))
        });
    }

    /// Asks for zero, then for speed, until the motors run; returns the sequence number after that and all frames.
    fn drive(&self, controller: &EmulatorOnTerminal, mut sequence: u64) -> (u64, Vec<u8>) {
        self.wait_until("ready", |motor_report| {
            motor_report.fault.is_none() && motor_report.report.readiness != Readiness::Starting
        });
        let mut frames = Vec::new();
        wait_until("the motors run", || {
            let is_running = controller.with(|emulator| emulator.motors()) == AHEAD_POWERS;
            if !is_running {
                let velocity = if sequence % 64 < 4 {
                    Velocity::ZERO
                } else {
                    AHEAD
                };
                frames.extend(self.ask(sequence, velocity, clock::now()));
                sequence += 1;
            }
            is_running
        });
        (sequence, frames)
    }
}

impl Drop for BareGuard {
    fn drop(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

#[test]
fn frames_that_are_old_repeated_or_of_the_future_move_nothing() {
    let (controller, guard) = BareGuard::alone();
    let (mut sequence, frames) = guard.drive(&controller, 1);
    controller.assert_stops_for_good();
    let changes = controller.outputs().len();

    guard.write(&frames);
    let old = clock::now();
    std::thread::sleep(WATCHDOG + TICK);
    for _ in 0..100 {
        sequence += 1;
        let later = clock::now() + Duration::from_secs(1);
        // Zero opens, where it counts.
        guard.ask(sequence, Velocity::ZERO, old);
        guard.ask(sequence + 1, AHEAD, old);
        guard.ask(sequence + 2, Velocity::ZERO, later);
        guard.ask(sequence + 3, AHEAD, later);
        sequence += 4;
    }
    let refused = u32::try_from(400 + frames.len() / COMMAND_BYTES).unwrap();
    guard.wait_until("refused", |motor_report| {
        motor_report.report.counters.stale >= refused
    });
    controller.assert_stops_for_good();
    assert_eq!(controller.outputs().len(), changes);
    guard.drive(&controller, sequence);
}

#[test]
fn commands_queued_for_a_stopped_guard_move_nothing() {
    let (controller, guard) = BareGuard::alone();
    let (sequence, _) = guard.drive(&controller, 1);
    stop(&guard.child);
    for number in 0..1000 {
        guard.ask(sequence + number, alternating(number), clock::now());
    }
    // By the controller's own watchdog.
    controller.assert_stops_for_good();
    let changes = controller.outputs().len();
    signal(guard.child.id(), Signal::CONT);
    guard.wait_until("refused", |motor_report| {
        motor_report.report.counters.stale >= 1000
    });
    controller.assert_stops_for_good();
    assert_eq!(controller.outputs().len(), changes);
}

#[test]
fn garbage_in_the_pipe_stops_the_motors() {
    let (controller, guard) = BareGuard::alone();
    let (mut sequence, _) = guard.drive(&controller, 1);
    guard.write(&[0xF5; 3 * COMMAND_BYTES + 1]);
    guard.wait_until("garbage", |motor_report| {
        motor_report.report.readiness == Readiness::Holding(Hold::Garbage)
    });
    for _ in 0..20 {
        guard.ask(sequence, AHEAD, clock::now());
        sequence += 1;
        std::thread::sleep(TICK);
    }
    assert!(guard.motor_report().unwrap().report.counters.garbage >= 120);
    controller.assert_stops_for_good();
}

#[test]
fn a_pipe_that_closes_stops_the_motors_and_ends_the_guard_well() {
    let (controller, mut guard) = BareGuard::alone();
    guard.drive(&controller, 1);
    drop(guard.child.stdin.take());
    assert!(guard.child.wait().unwrap().success());
    assert_eq!(
        controller.with(|emulator| emulator.motors()),
        [0, 0],
        "before it ended"
    );
    controller.assert_stops_for_good();
}

#[test]
fn nobody_who_listens_to_it_ends_the_guard_as_well() {
    let (controller, mut guard) = BareGuard::alone();
    guard.drive(&controller, 1);
    drop(guard.child.stdout.take());
    // `Child::wait` would close the other pipe as well.
    wait_until("it ends", || {
        let ended = guard.child.try_wait().unwrap();
        ended.is_some_and(|status| {
            assert!(status.success());
            true
        })
    });
    controller.assert_stops_for_good();
}
