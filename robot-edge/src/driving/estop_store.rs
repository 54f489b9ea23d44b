//! Keeps the emergency stop on disk, by a thread of its own: the loop waits for no disk.

use std::io;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::{self, JoinHandle};

use super::estop_file::EStopFile;
use teleop::EStopId;
use teleop::emergency_stop::StoredEStop;

/// What waits for the disk at most. The arbiter asks again for what found no room.
const CAPACITY: usize = 8;

/// The loop's end of the thread that keeps the emergency stop.
#[derive(Debug)]
pub struct EStopStore {
    previous: StoredEStop,
    requests: Option<SyncSender<Option<EStopId>>>,
    stored: Receiver<Option<EStopId>>,
    /// The disk is to say that none is in force, and has not yet.
    clear_pending: bool,
    thread: Option<JoinHandle<()>>,
}

impl EStopStore {
    /// Reads what the run before left, and keeps from now on.
    ///
    /// # Errors
    /// Where the system gives no thread.
    pub fn start(mut file: EStopFile) -> io::Result<Self> {
        let previous = file.read();
        let (requests, requested) = sync_channel(CAPACITY);
        let (done, stored) = sync_channel(CAPACITY);
        let thread = thread::Builder::new()
            .name("estop-store".to_owned())
            .spawn(move || run(&mut file, &requested, &done))?;
        Ok(Self {
            previous,
            requests: Some(requests),
            stored,
            clear_pending: false,
            thread: Some(thread),
        })
    }

    /// What the run before left.
    pub(super) const fn previous(&self) -> StoredEStop {
        self.previous
    }

    /// This one is in force.
    pub(super) fn store(&mut self, id: EStopId) {
        // It is asked for until it is stored.
        let _is_on_its_way = self.submit(Some(id));
        self.clear_pending = false;
    }

    /// None is in force any more.
    pub(super) fn clear(&mut self) {
        self.clear_pending = !self.submit(None);
    }

    /// Emergency stops that were stored since the last call.
    pub(super) fn take_stored(&mut self) -> Option<EStopId> {
        if self.clear_pending {
            self.clear();
        }
        self.stored.try_iter().flatten().last()
    }

    fn submit(&self, estop: Option<EStopId>) -> bool {
        match self
            .requests
            .as_ref()
            .map(|requests| requests.try_send(estop))
        {
            Some(Ok(())) => true,
            Some(Err(TrySendError::Full(_) | TrySendError::Disconnected(_))) | None => false,
        }
    }
}

impl Drop for EStopStore {
    fn drop(&mut self) {
        self.requests = None;
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread that keeps the emergency stop failed");
        }
    }
}

fn run(
    file: &mut EStopFile,
    requested: &Receiver<Option<EStopId>>,
    done: &SyncSender<Option<EStopId>>,
) {
    while let Ok(estop) = requested.recv() {
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
        let start = || EStopStore::start(EStopFile::open(dir.path()).unwrap()).unwrap();
        let mut estop_store = start();
        assert_eq!(estop_store.previous(), StoredEStop::None);
        estop_store.store(EStopId(3));
        let mut stored = None;
        while stored.is_none() {
            stored = estop_store.take_stored();
            thread::sleep(Duration::from_millis(1));
        }
        assert_eq!(stored, Some(EStopId(3)));
        assert_eq!(start().previous(), StoredEStop::Latched(EStopId(3)));
        estop_store.clear();
        drop(estop_store);
        assert_eq!(start().previous(), StoredEStop::None);
    }

    #[test]
    fn clearing_is_repeated_until_there_is_room() {
        let dir = tempfile::tempdir().unwrap();
        let (requests, requested) = sync_channel(1);
        let (done, stored) = sync_channel(1);
        let mut estop_store = EStopStore {
            previous: StoredEStop::None,
            requests: Some(requests),
            stored,
            clear_pending: false,
            thread: None,
        };
        estop_store.store(EStopId(1));
        estop_store.clear();
        assert!(estop_store.clear_pending, "no room yet");
        let mut file = EStopFile::open(dir.path()).unwrap();
        file.write(requested.recv().unwrap()).unwrap();
        assert_eq!(estop_store.take_stored(), None);
        assert!(!estop_store.clear_pending);
        drop(estop_store);
        run(&mut file, &requested, &done);
        assert_eq!(file.read(), StoredEStop::None);
    }
}
