//! The loop's thread.

use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use protocol::keys::RobotId;
use protocol::tile::BootId;

use super::board::Board;
use super::drive_log::DriveLog;
use super::driver::Driver;
use super::inbox::{Inbox, Outlet};
use super::keeper::Keeper;
use super::local::LocalWishes;
use super::lookout::Sight;
use super::loop_watch::{Heartbeat, UntilItEnds, watch};
use super::motors::Motors;
use super::operators::Operators;
use super::witness::Witness;
use crate::audit::Audit;
use crate::clock::Monotonic;
use crate::service_manager::ServiceManager;
use crate::teleop::emergency_stop::StoredEStop;
use crate::teleop::{Event, Rules};

/// A round ends at the latest after this.
const ROUND: Duration = Duration::from_millis(20);
/// Commands make a round end sooner, but not sooner than this after the last one.
const SHORTEST_ROUND: Duration = Duration::from_millis(2);
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
    /// What the collision guard sees; where there is none, it is off.
    pub sight: Option<Sight>,
    /// What keeps the emergency stop; where there is none, it is forgotten at the end.
    pub keeper: Option<Keeper>,
    /// What somebody at the vehicle wants.
    pub local: LocalWishes,
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
    board: Arc<Board>,
    thread: Option<JoinHandle<()>>,
}

impl Driving {
    /// Starts the loop.
    ///
    /// # Errors
    /// Where the system gives no thread.
    pub fn start(settings: DrivingSettings) -> std::io::Result<Self> {
        let (inbox, outlet) = Inbox::new();
        let board = Arc::new(Board::default());
        let heartbeat = Arc::new(Heartbeat::default());
        let simulated = settings.motors.simulated();
        let thread = thread::Builder::new().name("teleop".to_owned()).spawn({
            let (shown, heartbeat) = (Arc::clone(&board), Arc::clone(&heartbeat));
            move || run(settings, &outlet, shown, &heartbeat)
        })?;
        // Where there is no thread for it, the service manager's watchdog is left.
        thread::Builder::new()
            .name("teleop-watch".to_owned())
            .spawn({
                let board = Arc::clone(&board);
                move || watch(&heartbeat, &board, simulated.as_ref())
            })?;
        Ok(Self {
            inbox,
            board,
            thread: Some(thread),
        })
    }

    /// For the network: where it leaves what operators send, and what the loop shows.
    pub fn handles(&self) -> (Inbox, Arc<Board>) {
        (self.inbox.clone(), Arc::clone(&self.board))
    }
}

impl Drop for Driving {
    fn drop(&mut self) {
        self.board.close();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread that drives failed");
        }
    }
}

fn run(settings: DrivingSettings, outlet: &Outlet, board: Arc<Board>, heartbeat: &Heartbeat) {
    let start = Monotonic::now();
    let DrivingSettings {
        robot,
        boot,
        rules,
        operators,
        motors,
        budget_kbps,
        sight,
        keeper,
        local,
        can_record,
        log,
        audit,
        service_manager,
    } = settings;
    let mut driver = Driver::new((robot, boot), rules, operators, motors, board, start);
    // Gone before the driver, which may wait for its motors.
    let _until_it_ends = UntilItEnds(heartbeat);
    driver.switches.budget_kbps = budget_kbps;
    driver.witness = Witness::new(audit);
    driver.log = log;
    driver.switches.can_record = can_record;
    driver.switches.guard = sight.is_some();
    driver.sight = sight;
    let stored = keeper.as_ref().map_or(StoredEStop::None, Keeper::found);
    driver.keeper = keeper;
    driver.board.show_switches(driver.switches);
    driver.untested = Some(stored);
    // So that the motors begin to be found.
    driver.step(start, Event::Tick);
    service_manager.ready();
    let (mut last, mut fed) = (start, start);
    while !driver.board.is_closing() {
        let mut due = last + ROUND;
        let wait = due.since(Monotonic::now());
        if let Ok(incoming) = outlet.receiver.recv_timeout(wait) {
            driver.receive(incoming, Monotonic::now());
            for incoming in outlet.receiver.try_iter().take(MESSAGES_AT_ONCE) {
                driver.receive(incoming, Monotonic::now());
            }
            due = last + SHORTEST_ROUND;
            // What came right behind the last round waits for the next one, which is soon.
            thread::sleep(due.since(Monotonic::now()));
        }
        driver.overflown(outlet.take_overflown());
        for wish in local.take() {
            driver.local(wish, Monotonic::now());
        }
        let now = Monotonic::now();
        if now >= due {
            driver.tick(now);
            last = now;
            heartbeat.round();
            if now.since(fed) >= FEED_EVERY {
                fed = now;
                service_manager.feed_watchdog();
            }
        }
    }
    driver.stop();
    service_manager.end_watchdog();
}

#[cfg(test)]
#[cfg(unix)]
mod tests {
    use std::io::Read as _;
    use std::os::unix::process::ExitStatusExt as _;
    use std::process::{Command, Stdio};

    use protocol::keys::OperatorTopic;

    use super::*;
    use crate::config::VehicleConfig;
    use crate::driving::Incoming;
    use crate::driving::motors::SimulatedMotors;
    use crate::teleop::config::TeleopConfig;

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
            sight: None,
            keeper: None,
            local: LocalWishes::default(),
            can_record: false,
            log: None,
            audit: None,
            service_manager: ServiceManager::default(),
        });
        let driving = driving.unwrap();
        let (inbox, board) = driving.handles();
        while board.status().is_none() {
            thread::sleep(ROUND);
        }
        match how.as_str() {
            "panic" => offer(&inbox, || panic!("the loop fails")),
            "stall" => offer(&inbox, || thread::sleep(Duration::from_hours(1))),
            // An orderly end, in which nothing ends the process.
            _ => drop(driving),
        }
        let end = Monotonic::now() + Duration::from_secs(if how == "end" { 2 } else { 60 });
        while Monotonic::now() < end {
            for (kind, text) in board.take_events() {
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
        let started = Monotonic::now();
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
        (status.code(), started.elapsed(), said)
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
