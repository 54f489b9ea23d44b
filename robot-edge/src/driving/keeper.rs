//! Keeps the emergency stop on disk, by a thread of its own: the loop waits for no disk.

use std::io;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::{self, JoinHandle};

use super::estop_file::EStopFile;
use crate::teleop::EStopId;
use crate::teleop::emergency_stop::StoredEStop;

/// What waits for the disk at most. The arbiter asks again for what found no room.
const CAPACITY: usize = 8;

/// The loop's end of the thread that keeps the emergency stop.
#[derive(Debug)]
pub struct Keeper {
    found: StoredEStop,
    orders: Option<SyncSender<Option<EStopId>>>,
    kept: Receiver<Option<EStopId>>,
    /// The disk is to say that none is in force, and has not yet.
    is_to_clear: bool,
    thread: Option<JoinHandle<()>>,
}

impl Keeper {
    /// Reads what the run before left, and keeps from now on.
    ///
    /// # Errors
    /// Where the system gives no thread.
    pub fn start(mut file: EStopFile) -> io::Result<Self> {
        let found = file.read();
        let (orders, ordered) = sync_channel(CAPACITY);
        let (done, kept) = sync_channel(CAPACITY);
        let thread = thread::Builder::new()
            .name("estop-keeper".to_owned())
            .spawn(move || keep(&mut file, &ordered, &done))?;
        Ok(Self {
            found,
            orders: Some(orders),
            kept,
            is_to_clear: false,
            thread: Some(thread),
        })
    }

    /// What the run before left.
    pub(super) const fn found(&self) -> StoredEStop {
        self.found
    }

    /// This one is in force.
    pub(super) fn store(&mut self, id: EStopId) {
        // It is asked for until it is stored.
        let _is_on_its_way = self.order(Some(id));
        self.is_to_clear = false;
    }

    /// None is in force any more.
    pub(super) fn clear(&mut self) {
        self.is_to_clear = !self.order(None);
    }

    /// Emergency stops that were stored since the last call.
    pub(super) fn take_stored(&mut self) -> Option<EStopId> {
        if self.is_to_clear {
            self.clear();
        }
        self.kept.try_iter().flatten().last()
    }

    fn order(&self, estop: Option<EStopId>) -> bool {
        match self.orders.as_ref().map(|orders| orders.try_send(estop)) {
            Some(Ok(())) => true,
            Some(Err(TrySendError::Full(_) | TrySendError::Disconnected(_))) | None => false,
        }
    }
}

impl Drop for Keeper {
    fn drop(&mut self) {
        self.orders = None;
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread that keeps the emergency stop failed");
        }
    }
}

fn keep(
    file: &mut EStopFile,
    ordered: &Receiver<Option<EStopId>>,
    done: &SyncSender<Option<EStopId>>,
) {
    while let Ok(estop) = ordered.recv() {
        match file.write(estop) {
            // A loop that takes nothing has ended.
            Ok(()) => drop(done.try_send(estop)),
            Err(error) => tracing::error!(
                path = %file.path().display(),
                %error,
                "the emergency stop cannot be stored; it holds, and is not acknowledged"
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn what_is_stored_is_found_by_the_next_run() {
        let dir = tempfile::tempdir().unwrap();
        let start = || Keeper::start(EStopFile::open(dir.path()).unwrap()).unwrap();
        let mut keeper = start();
        assert_eq!(keeper.found(), StoredEStop::None);
        keeper.store(EStopId(3));
        let mut stored = None;
        while stored.is_none() {
            stored = keeper.take_stored();
            thread::sleep(Duration::from_millis(1));
        }
        assert_eq!(stored, Some(EStopId(3)));
        assert_eq!(start().found(), StoredEStop::Latched(EStopId(3)));
        keeper.clear();
        drop(keeper);
        assert_eq!(start().found(), StoredEStop::None);
    }

    #[test]
    fn clearing_is_repeated_until_there_is_room() {
        let dir = tempfile::tempdir().unwrap();
        let (orders, ordered) = sync_channel(1);
        let (done, kept) = sync_channel(1);
        let mut keeper = Keeper {
            found: StoredEStop::None,
            orders: Some(orders),
            kept,
            is_to_clear: false,
            thread: None,
        };
        keeper.store(EStopId(1));
        keeper.clear();
        assert!(keeper.is_to_clear, "no room yet");
        let mut file = EStopFile::open(dir.path()).unwrap();
        file.write(ordered.recv().unwrap()).unwrap();
        assert_eq!(keeper.take_stored(), None);
        assert!(!keeper.is_to_clear);
        drop(keeper);
        keep(&mut file, &ordered, &done);
        assert_eq!(file.read(), StoredEStop::None);
    }
}
