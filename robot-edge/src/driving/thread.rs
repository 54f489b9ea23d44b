//! The loop's thread.

use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use protocol::keys::RobotId;
use protocol::tile::BootId;

use super::audit_recorder::AuditRecorder;
use super::drive_log::DriveLog;
use super::drive_loop::DriveLoop;
use super::estop_store::EStopStore;
use super::inbox::{Inbox, InboxReceiver};
use super::local_commands::LocalCommands;
use super::loop_watchdog::{EndMarker, Heartbeat, run_watchdog};
use super::monitor_input::MonitorRunner;
use super::motors::Motors;
use super::operators::Operators;
use super::shared_drive_state::SharedDriveState;
use crate::audit::Audit;
use crate::clock;
use crate::service_manager::ServiceManager;
use teleop::emergency_stop::StoredEStop;
use teleop::{ArbiterInput, Rules};

/// A round ends at the latest after this.
const ROUND: Duration = Duration::from_millis(20);
/// Commands make a round end sooner, but not sooner than this after the last one.
const MIN_ROUND: Duration = Duration::from_millis(2);
/// Messages taken before a round may end: no flood delays it.
const MESSAGES_AT_ONCE: usize = 32;

/// The service manager's watchdog is fed so often, by rounds alone: four times within the unit's `WatchdogSec`.
const FEED_EVERY: Duration = Duration::from_millis(500);

/// What drives.
#[derive(Debug)]
pub struct DrivingSettings {
    /// Who the vehicle is.
    pub robot: RobotId,
    /// This run.
    pub boot: BootId,
    /// How it obeys.
    pub rules: Rules,
    /// Whom.
    pub operators: Operators,
    /// With what.
    pub motors: Motors,
    /// Bytes for tiles, kbit/s, until somebody sets another number.
    pub budget_kbps: u32,
    /// What the collision monitor sees; where there is none, it is off.
    pub monitor_runner: Option<MonitorRunner>,
    /// What keeps the emergency stop; where there is none, it is forgotten at the end.
    pub estop_store: Option<EStopStore>,
    /// What somebody at the vehicle wants.
    pub local_commands: LocalCommands,
    /// Whether somebody takes wishes for recordings from the board.
    pub can_record: bool,
    /// Where every round is logged.
    pub log: Option<DriveLog>,
    /// Where what happens is written down, if it is.
    pub audit: Option<Audit>,
    /// Who is notified that the loop runs.
    pub service_manager: ServiceManager,
}

/// The running loop. Dropping it tells the motors zero.
#[derive(Debug)]
pub struct Driving {
    inbox: Inbox,
    drive_state: Arc<SharedDriveState>,
    thread: Option<JoinHandle<()>>,
}

impl Driving {
    /// Starts the loop.
    ///
    /// # Errors
    /// Where the system gives no thread.
    pub fn start(settings: DrivingSettings) -> std::io::Result<Self> {
        let (inbox, inbox_receiver) = Inbox::new();
        let drive_state = Arc::new(SharedDriveState::default());
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

    /// For the network: where it leaves what operators send, and what the loop shows.
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
        log,
        audit,
        service_manager,
    } = settings;
    let mut drive_loop =
        DriveLoop::new((robot, boot), rules, operators, motors, drive_state, start);
    // Gone before the driver, which may wait for its motors.
    let _end_marker = EndMarker(heartbeat);
    drive_loop.runtime_settings.budget_kbps = budget_kbps;
    drive_loop.audit_recorder = AuditRecorder::new(audit);
    drive_loop.log = log;
    drive_loop.runtime_settings.can_record = can_record;
    drive_loop.runtime_settings.collision_monitor = monitor_runner.is_some();
    drive_loop.monitor_runner = monitor_runner;
    let stored = estop_store
        .as_ref()
        .map_or(StoredEStop::None, EStopStore::previous);
    drive_loop.estop_store = estop_store;
    drive_loop
        .drive_state
        .publish_settings(drive_loop.runtime_settings);
    drive_loop.pending_self_test = Some(stored);
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
            // What came right behind the last round waits for the next one, which is soon.
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
            if now.since(fed) >= FEED_EVERY {
                fed = now;
                service_manager.notify_watchdog();
            }
        }
    }
    drive_loop.stop();
    service_manager.disable_watchdog();
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
    use teleop::config::TeleopConfig;

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
        let rules = Rules::new(&TeleopConfig::default(), &VehicleConfig::default());
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
            log: None,
            audit: None,
            service_manager: ServiceManager::default(),
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
    fn a_loop_that_panics_or_stands_still_ends_the_process_and_says_so() {
        for (how, says) in [
            ("panic", "the teleop loop has failed"),
            ("stall", "stands still"),
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
}
