//! A thread that waits in `poll`, and the handle by which others tell it what to do.

use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread::{Builder, JoinHandle};
use std::time::Duration;

use rustix::event::{EventfdFlags, PollFd, Timespec, eventfd, poll};

/// Commands that wait for the thread; each caller waits for its own to be done.
const COMMANDS: usize = 16;

/// The callers' end. The thread ends when this is dropped, and the drop waits for it.
#[derive(Debug)]
pub(super) struct CommandThread<C> {
    commands: Option<SyncSender<(C, Done)>>,
    wake: Arc<OwnedFd>,
    thread: Option<JoinHandle<()>>,
}

/// The thread's end.
#[derive(Debug)]
pub(super) struct Inbox<C> {
    commands: Receiver<(C, Done)>,
    wake: Arc<OwnedFd>,
}

/// What the inbox holds now.
#[derive(Debug)]
pub(super) enum Received<C> {
    /// To be carried out, and then reported.
    Command(C, Done),
    /// Nothing: wait in `poll`.
    Nothing,
    /// The handle is gone: end.
    Disconnected,
}

/// Tells the caller how its command went.
#[derive(Debug)]
pub(super) struct Done(SyncSender<io::Result<()>>);

impl<C: Send + 'static> CommandThread<C> {
    /// Starts `run` on a thread of the given name.
    pub(super) fn start(
        name: &str,
        run: impl FnOnce(Inbox<C>) + Send + 'static,
    ) -> io::Result<Self> {
        let (sender, receiver) = sync_channel(COMMANDS);
        let wake = Arc::new(eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK)?);
        let inbox = Inbox {
            commands: receiver,
            wake: Arc::clone(&wake),
        };
        let thread = Builder::new()
            .name(name.to_owned())
            .spawn(move || run(inbox))?;
        Ok(Self {
            commands: Some(sender),
            wake,
            thread: Some(thread),
        })
    }

    /// Has `command` carried out and returns when it is.
    pub(super) fn call(&self, command: C) -> io::Result<()> {
        let ended = || io::Error::new(io::ErrorKind::BrokenPipe, "the rig's thread has ended");
        let (done, reported) = sync_channel(1);
        let commands = self.commands.as_ref().ok_or_else(ended)?;
        commands
            .send((command, Done(done)))
            .map_err(|_gone| ended())?;
        self.wake()?;
        reported.recv().map_err(|_gone| ended())?
    }

    fn wake(&self) -> io::Result<()> {
        match rustix::io::write(&self.wake, &1_u64.to_ne_bytes()) {
            // The counter is full: the thread is going to wake up as it is.
            Ok(_) | Err(rustix::io::Errno::AGAIN) => Ok(()),
            Err(err) => Err(err.into()),
        }
    }
}

impl<C> Drop for CommandThread<C> {
    fn drop(&mut self) {
        self.commands = None;
        let woken = rustix::io::write(&self.wake, &1_u64.to_ne_bytes());
        if let (Ok(_), Some(thread)) = (woken, self.thread.take()) {
            // A panic of the thread was printed when it happened, and a drop has no way to report it.
            drop(thread.join());
        }
    }
}

impl<C> Inbox<C> {
    /// What becomes readable when there is something to receive.
    pub(super) fn readable(&self) -> BorrowedFd<'_> {
        self.wake.as_fd()
    }

    /// The next command, without waiting.
    pub(super) fn receive(&self) -> Received<C> {
        // Emptied before the channel is looked at: what comes between the two wakes `poll` again.
        let mut counter = [0; 8];
        let woken = rustix::io::read(&self.wake, &mut counter);
        debug_assert!(matches!(woken, Ok(_) | Err(rustix::io::Errno::AGAIN)));
        match self.commands.try_recv() {
            Ok((command, done)) => Received::Command(command, done),
            Err(TryRecvError::Empty) => Received::Nothing,
            Err(TryRecvError::Disconnected) => Received::Disconnected,
        }
    }
}

impl Done {
    pub(super) fn report(self, outcome: io::Result<()>) {
        // The channel has room for it; a caller that has gone does not want it.
        drop(self.0.try_send(outcome));
    }
}

/// Waits until something of `watched` is ready, or `at_most`; returns what is.
pub(super) fn wait<T>(
    watched: Vec<(T, PollFd<'_>)>,
    at_most: Option<Duration>,
) -> io::Result<Vec<T>> {
    let (names, mut descriptors): (Vec<T>, Vec<PollFd<'_>>) = watched.into_iter().unzip();
    let timeout = at_most.and_then(|duration| Timespec::try_from(duration).ok());
    match poll(&mut descriptors, timeout.as_ref()) {
        Ok(_) => {}
        Err(rustix::io::Errno::INTR) => return Ok(Vec::new()),
        Err(err) => return Err(err.into()),
    }
    let ready = names.into_iter().zip(descriptors);
    Ok(ready
        .filter(|(_, descriptor)| !descriptor.revents().is_empty())
        .map(|(name, _)| name)
        .collect())
}
