//! The thread of the teleop loop, and the watchdog that ends the process if the loop fails.
//!
//! Without the loop no operator can drive, stop or reset the vehicle. A service manager then starts the process again.
//! The motor guard sends zero to real motors long before.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use protocol::keys::RobotId;
use protocol::tile::BootId;

use crate::driving::audit_recorder::AuditRecorder;
use crate::driving::drive_log::DriveLog;
use crate::driving::drive_loop::DriveLoop;
use crate::driving::estop_store::EStopStore;
use crate::driving::inbox::{Inbox, InboxReceiver, LocalCommands};
use crate::driving::monitor_input::MonitorRunner;
use crate::driving::motors::{Motors, SimulatedMotors};
use crate::driving::operators::Operators;
use crate::driving::planner::PlannerExchange;
use crate::driving::shared_drive_state::{DriveEvent, SharedDriveState};
use crate::service_manager::ServiceManager;
use network::audit::Audit;
use network::clock::{self, sleep_until};
use teleop::{ArbiterInput, Rules, StoredEStop, Velocity};

/// Longest duration of a round.
const ROUND: Duration = Duration::from_millis(20);
/// A command ends a round early, but not before this.
const MIN_ROUND: Duration = Duration::from_millis(2);
/// Messages handled per round at most, so that a flood does not delay it.
const MESSAGES_AT_ONCE: usize = 32;

/// Period of the service manager's watchdog messages, sent by rounds only: four times within the unit's `WatchdogSec`.
const WATCHDOG_PERIOD: Duration = Duration::from_millis(500);

#[derive(Debug)]
pub struct DrivingSettings {
    pub robot: RobotId,
    /// Identifies this run of the program.
    pub boot: BootId,
    pub rules: Rules,
    pub operators: Operators,
    pub motors: Motors,
    pub budget_kbps: u32,
    /// The collision monitor; without it, it is off.
    pub monitor_runner: Option<MonitorRunner>,
    /// Stores the emergency stop; without it, the stop is lost at the end of the process.
    pub estop_store: Option<EStopStore>,
    pub local_commands: LocalCommands,
    pub can_record: bool,
    pub can_save_maps: bool,
    pub log: Option<DriveLog>,
    pub audit: Option<Audit>,
    pub service_manager: ServiceManager,
    /// The planner that drives to goals, where one is configured.
    pub planner: Option<PlannerExchange>,
}

/// The running loop. Dropping it sends zero to the motors.
#[derive(Debug)]
pub struct Driving {
    inbox: Inbox,
    drive_state: Arc<SharedDriveState>,
    thread: Option<JoinHandle<()>>,
}

impl Driving {
    /// Starts the loop.
    pub fn start(settings: DrivingSettings) -> std::io::Result<Self> {
        let (inbox, inbox_receiver) = Inbox::new();
        let drive_state = Arc::new(SharedDriveState::new(settings.planner.clone()));
        let heartbeat = Arc::new(Heartbeat::default());
        let simulated = settings.motors.simulated();
        let thread = thread::Builder::new().name("teleop".to_owned()).spawn({
            let (shown, heartbeat) = (Arc::clone(&drive_state), Arc::clone(&heartbeat));
            move || run(settings, &inbox_receiver, shown, &heartbeat)
        })?;
        // Where there is no thread for it, the service manager's watchdog is left.
        thread::Builder::new()
            .name("teleop-watch".to_owned())
            .spawn({
                let drive_state = Arc::clone(&drive_state);
                move || run_watchdog(&heartbeat, &drive_state, simulated.as_ref())
            })?;
        Ok(Self {
            inbox,
            drive_state,
            thread: Some(thread),
        })
    }

    /// For the network: the inbox for messages of operators, and the published state.
    pub fn handles(&self) -> (Inbox, Arc<SharedDriveState>) {
        (self.inbox.clone(), Arc::clone(&self.drive_state))
    }
}

impl Drop for Driving {
    fn drop(&mut self) {
        self.drive_state.close();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread that drives failed");
        }
    }
}

fn run(
    settings: DrivingSettings,
    inbox_receiver: &InboxReceiver,
    drive_state: Arc<SharedDriveState>,
    heartbeat: &Heartbeat,
) {
    let start = clock::now();
    let DrivingSettings {
        robot,
        boot,
        rules,
        operators,
        motors,
        budget_kbps,
        monitor_runner,
        estop_store,
        local_commands,
        can_record,
        can_save_maps,
        log,
        audit,
        service_manager,
        planner,
    } = settings;
    let mut drive_loop =
        DriveLoop::new((robot, boot), rules, operators, motors, drive_state, start);
    // Dropped before the loop, whose motors may take time.
    let _end_marker = EndMarker(heartbeat);
    drive_loop.runtime_settings.budget_kbps = budget_kbps;
    drive_loop.audit_recorder = AuditRecorder::new(audit);
    drive_loop.log = log;
    drive_loop.runtime_settings.can_record = can_record;
    drive_loop.can_save_maps = can_save_maps;
    drive_loop.runtime_settings.collision_monitor = monitor_runner.is_some();
    drive_loop.monitor_runner = monitor_runner;
    let stored = estop_store
        .as_ref()
        .map_or(StoredEStop::None, EStopStore::previous);
    drive_loop.estop_store = estop_store;
    drive_loop.planner = planner;
    drive_loop
        .drive_state
        .publish_settings(drive_loop.runtime_settings);
    drive_loop.motor_check.pending_self_test = Some(stored);
    // So that the motors begin to be found.
    drive_loop.step(start, ArbiterInput::Tick);
    service_manager.ready();
    let (mut last, mut fed) = (start, start);
    while !drive_loop.drive_state.is_closing() {
        let mut due = last + ROUND;
        let wait = due.since(clock::now());
        if let Ok(incoming) = inbox_receiver.receiver.recv_timeout(wait) {
            drive_loop.receive(incoming, clock::now());
            for incoming in inbox_receiver.receiver.try_iter().take(MESSAGES_AT_ONCE) {
                drive_loop.receive(incoming, clock::now());
            }
            due = last + MIN_ROUND;
            // A message right after a round waits for the next round.
            thread::sleep(due.since(clock::now()));
        }
        drive_loop.dropped(inbox_receiver.take_dropped());
        for command in local_commands.take() {
            drive_loop.execute_local(command, clock::now());
        }
        let now = clock::now();
        if now >= due {
            drive_loop.tick(now);
            last = now;
            heartbeat.round();
            if now.since(fed) >= WATCHDOG_PERIOD {
                fed = now;
                service_manager.notify_watchdog();
            }
        }
    }
    drive_loop.stop();
    service_manager.disable_watchdog();
}

/// Checks are counted, not time: while the process is stopped or the machine suspended, there are none.
const CHECK_PERIOD: Duration = Duration::from_millis(100);

/// The loop has stalled after this many checks in a row without a new round; rounds are 20 ms apart.
const MISSED_CHECKS: u32 = 10;

/// Time for the delivery of the event to consoles.
const EVENT_DELIVERY_TIME: Duration = Duration::from_millis(500);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LoopFailure {
    /// Its thread has ended unexpectedly.
    Ended,
    /// It has no rounds.
    Stalled,
}

impl fmt::Display for LoopFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Ended => "the teleop loop has failed: the robot program ends",
            Self::Stalled => {
                "the teleop loop has had no round for a second: the robot program ends"
            }
        })
    }
}

#[derive(Debug, Default)]
pub(super) struct Heartbeat {
    rounds: AtomicU64,
    has_ended: AtomicBool,
}

impl Heartbeat {
    pub(super) fn round(&self) {
        self.rounds.fetch_add(1, Ordering::Relaxed);
    }
}

/// Marks the end of the loop, also after a panic.
#[derive(Debug)]
pub(super) struct EndMarker<'a>(pub(super) &'a Heartbeat);

impl Drop for EndMarker<'_> {
    fn drop(&mut self) {
        self.0.has_ended.store(true, Ordering::Release);
    }
}

#[derive(Debug, Default)]
struct ProgressMonitor {
    rounds: u64,
    missed_checks: u32,
}

impl ProgressMonitor {
    fn check(&mut self, heartbeat: &Heartbeat) -> Option<LoopFailure> {
        if heartbeat.has_ended.load(Ordering::Acquire) {
            return Some(LoopFailure::Ended);
        }
        let rounds = heartbeat.rounds.load(Ordering::Relaxed);
        self.missed_checks = if rounds == self.rounds {
            self.missed_checks + 1
        } else {
            0
        };
        self.rounds = rounds;
        (self.missed_checks >= MISSED_CHECKS).then_some(LoopFailure::Stalled)
    }
}

/// Returns when the loop has ended as it was asked to; where it fails, ends the process.
pub(super) fn run_watchdog(
    heartbeat: &Heartbeat,
    drive_state: &Arc<SharedDriveState>,
    simulated: Option<&SimulatedMotors>,
) {
    let mut progress = ProgressMonitor::default();
    let failure = loop {
        sleep_until(clock::now() + CHECK_PERIOD, || false);
        match progress.check(heartbeat) {
            Some(LoopFailure::Ended) if drive_state.is_closing() => return,
            Some(failure) => break failure,
            None => {}
        }
    };
    if let Some(motors) = simulated {
        motors.command(Velocity::ZERO, clock::now());
    }
    drive_state.publish_events(&mut [DriveEvent::LoopFailed(failure)].into());
    // Writing to a stopped terminal blocks.
    drop(
        std::thread::Builder::new()
            .name("final-log".to_owned())
            .spawn(move || tracing::error!("{failure}")),
    );
    sleep_until(clock::now() + EVENT_DELIVERY_TIME, || false);
    // Not `exit`: its handlers could wait for the loop.
    std::process::abort();
}

#[cfg(test)]
#[cfg(unix)]
mod tests {
    use std::io::Read as _;
    use std::os::unix::process::ExitStatusExt as _;
    use std::process::{Command, Stdio};

    use protocol::keys::OperatorTopic;

    use super::*;
    use crate::driving::Incoming;
    use crate::driving::motors::SimulatedMotors;
    use mapping::vehicle::VehicleConfig;
    use teleop::TeleopConfig;

    const FAILS: &str = "FORESHORE_TEST_LOOP_FAILS";

    /// A request whose answer does this to the loop.
    fn offer(inbox: &Inbox, answered: impl FnOnce() + Send + 'static) {
        inbox.offer(Incoming {
            topic: OperatorTopic::Lease,
            operator: "anna".parse().unwrap(),
            bytes: Vec::new(),
            reply: Some(Box::new(move |_refused| answered())),
        });
    }

    /// Not a test: a process whose loop fails, and which else would live on.
    #[test]
    fn failing_process() {
        let Ok(how) = std::env::var(FAILS) else {
            return;
        };
        let rules = Rules::new(
            &TeleopConfig::default(),
            &VehicleConfig::default(),
            &teleop::LocomotionConfig::default(),
        );
        let driving = Driving::start(DrivingSettings {
            robot: "scout".parse().unwrap(),
            boot: BootId([1; 16]),
            rules: rules.unwrap(),
            operators: Operators::open(),
            motors: Motors::Simulated(SimulatedMotors::default()),
            budget_kbps: 1000,
            monitor_runner: None,
            estop_store: None,
            local_commands: LocalCommands::default(),
            can_record: false,
            can_save_maps: false,
            log: None,
            audit: None,
            service_manager: ServiceManager::default(),
            planner: None,
        });
        let driving = driving.unwrap();
        let (inbox, drive_state) = driving.handles();
        while drive_state.status().is_none() {
            thread::sleep(ROUND);
        }
        match how.as_str() {
            "panic" => offer(&inbox, || panic!("the loop fails")),
            "stall" => offer(&inbox, || thread::sleep(Duration::from_hours(1))),
            // An orderly end, in which nothing ends the process.
            _ => drop(driving),
        }
        let end = clock::now() + Duration::from_secs(if how == "end" { 2 } else { 60 });
        while clock::now() < end {
            for (kind, text) in drive_state.take_events() {
                if kind == "fault" {
                    eprintln!("{text}");
                }
            }
            thread::sleep(ROUND);
        }
        std::process::exit(0);
    }

    /// How a process ends whose loop fails so, how long it lived, and what it said.
    fn end_of(how: &str) -> (Option<i32>, Duration, String) {
        let name = format!(
            "{}::failing_process",
            module_path!().split_once("::").unwrap().1
        );
        let started = clock::now();
        let mut process = Command::new(std::env::current_exe().unwrap())
            .args([&name, "--exact", "--nocapture"])
            .env(FAILS, how)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = String::new();
        process
            .stderr
            .take()
            .unwrap()
            .read_to_string(&mut said)
            .unwrap();
        let status = process.wait().unwrap();
        assert_eq!(status.code().is_none(), status.signal().is_some());
        (status.code(), clock::elapsed(started), said)
    }

    #[test]
    fn a_failed_loop_ends_the_process_with_a_message() {
        for (how, says) in [
            ("panic", "the teleop loop has failed"),
            ("stall", "has had no round"),
        ] {
            let (code, lived, said) = end_of(how);
            assert_ne!(code, Some(0), "{how}: {said}");
            assert!(
                lived < Duration::from_secs(30),
                "{how}: it lived for {lived:?}"
            );
            assert!(said.contains(says), "{how}: {said}");
        }
        assert_eq!(end_of("end").0, Some(0));
    }

    #[test]
    fn only_ten_looks_in_a_row_without_a_round_are_a_stall() {
        let (heartbeat, mut progress) = (Heartbeat::default(), ProgressMonitor::default());
        heartbeat.round();
        for _ in 0..3 {
            heartbeat.round();
            for _ in 0..10 {
                assert_eq!(progress.check(&heartbeat), None);
            }
        }
        assert_eq!(progress.check(&heartbeat), Some(LoopFailure::Stalled));
    }

    #[test]
    fn an_end_is_seen_at_the_next_look() {
        let (heartbeat, mut progress) = (Heartbeat::default(), ProgressMonitor::default());
        drop(EndMarker(&heartbeat));
        assert_eq!(progress.check(&heartbeat), Some(LoopFailure::Ended));
    }
}
