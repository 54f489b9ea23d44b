//! A file is put on the disk by a thread of its own, for those who cannot wait for disks.

use std::io;
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};

use recording::writer::WriteError;

/// Who asks. Dropped, it waits for nothing: a sync that is under way ends by itself.
pub(super) struct SyncThread {
    requests: SyncSender<()>,
    failed: Failed,
    thread: JoinHandle<()>,
}

/// What the disk said, as far as that was not told yet.
type Failed = Arc<Mutex<Option<WriteError>>>;

impl SyncThread {
    /// Calls `sync` when asked.
    ///
    /// # Errors
    /// Where no thread can be had.
    pub(super) fn start(
        sync: impl Fn() -> Result<(), WriteError> + Send + 'static,
    ) -> io::Result<Self> {
        // One that waits takes in all that was written until its turn.
        let (requests, received) = sync_channel(1);
        let failed = Failed::default();
        let of_thread = Arc::clone(&failed);
        let run = move || {
            for () in received {
                if let Err(error) = sync() {
                    *lock(&of_thread) = Some(error);
                }
            }
        };
        let thread = thread::Builder::new()
            .name("recording-sync".to_owned())
            .spawn(run)?;
        Ok(Self {
            requests,
            failed,
            thread,
        })
    }

    /// Has synced what was written until now. Never waits.
    ///
    /// # Errors
    /// What the disk has said since the last call.
    pub(super) fn request_sync(&self) -> Result<(), WriteError> {
        let failed = lock(&self.failed).take();
        match self.requests.try_send(()) {
            Ok(()) | Err(TrySendError::Full(()) | TrySendError::Disconnected(())) => {}
        }
        failed.map_or(Ok(()), Err)
    }

    /// Waits for all that was asked for.
    ///
    /// # Errors
    /// What the disk has said since the last call.
    pub(super) fn finish(self) -> Result<(), WriteError> {
        let Self {
            requests,
            failed,
            thread,
        } = self;
        drop(requests);
        if thread.join().is_err() {
            tracing::error!("the thread that syncs a recording failed");
        }
        let failed = lock(&failed).take();
        failed.map_or(Ok(()), Err)
    }
}

fn lock(failed: &Mutex<Option<WriteError>>) -> MutexGuard<'_, Option<WriteError>> {
    failed.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use super::*;

    /// Whoever writes is held up by no disk, however slow.
    #[test]
    fn who_asks_does_not_wait_and_one_sync_takes_in_what_was_asked_for_meanwhile() {
        let (begin, began) = sync_channel(9);
        let (let_go, gate) = sync_channel(9);
        let gate = Mutex::new(gate);
        let synced = Arc::new(AtomicU32::new(0));
        let of_thread = Arc::clone(&synced);
        let thread = SyncThread::start(move || {
            begin.send(()).unwrap();
            gate.lock().unwrap().recv().unwrap();
            of_thread.fetch_add(1, Ordering::SeqCst);
            Ok(())
        });
        let thread = thread.unwrap();
        thread.request_sync().unwrap();
        began.recv().unwrap();
        for _ in 0..5 {
            thread.request_sync().unwrap();
        }
        assert_eq!(synced.load(Ordering::SeqCst), 0, "the disk is at work");
        for _ in 0..6 {
            let_go.send(()).unwrap();
        }
        thread.finish().unwrap();
        assert_eq!(synced.load(Ordering::SeqCst), 2);
    }

    #[test]
    fn what_the_disk_says_is_told_once_at_the_next_call() {
        let (begin, began) = sync_channel(9);
        let thread = SyncThread::start(move || {
            begin.send(()).unwrap();
            Err(WriteError::Mcap {
                path: "drive.mcap".into(),
                source: io::Error::other("the disk is gone").into(),
            })
        });
        let thread = thread.unwrap();
        thread.request_sync().unwrap();
        began.recv().unwrap();
        // It has been said when the next one begins.
        let first = loop {
            let said = thread.request_sync();
            if said.is_err() {
                break said;
            }
            thread::yield_now();
        };
        let first = first.unwrap_err().to_string();
        assert!(first.contains("drive.mcap"), "{first}");
        assert!(thread.finish().is_err(), "the second sync failed too");
    }
}
