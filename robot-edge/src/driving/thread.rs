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
use super::motors::Motors;
use super::operators::Operators;
use super::witness::Witness;
use crate::audit::Audit;
use crate::clock::Monotonic;
use crate::teleop::emergency_stop::StoredEStop;
use crate::teleop::{Event, Rules};

/// A round ends at the latest after this.
const ROUND: Duration = Duration::from_millis(20);
/// Commands make a round end sooner, but not sooner than this after the last one.
const SHORTEST_ROUND: Duration = Duration::from_millis(2);
/// Messages taken before a round may end: no flood delays it.
const MESSAGES_AT_ONCE: usize = 32;

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
        let shown = Arc::clone(&board);
        let thread = thread::Builder::new()
            .name("teleop".to_owned())
            .spawn(move || run(settings, &outlet, shown))?;
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

fn run(settings: DrivingSettings, outlet: &Outlet, board: Arc<Board>) {
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
    } = settings;
    let mut driver = Driver::new((robot, boot), rules, operators, motors, board, start);
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
    let mut last = start;
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
        }
    }
    driver.stop();
}
