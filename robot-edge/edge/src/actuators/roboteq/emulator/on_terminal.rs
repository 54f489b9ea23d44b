//! The emulated controller at the far end of a real pseudo-terminal.

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::os::fd::AsFd as _;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, poll};
use rustix::fs::{Mode, OFlags};
use rustix::process::setpriority_process;
use rustix::pty::OpenptFlags;
use rustix::thread::gettid;
use tempfile::{TempDir, tempdir};

use super::{Emulator, LineTiming, Output};
use network::clock::{self, sleep_until};

const PATIENCE: Duration = Duration::from_mins(3);

pub(crate) struct EmulatorOnTerminal {
    /// Of its own: the system gives the terminal's number to others later, for whom an edge of this test may still look.
    path: PathBuf,
    emulator: Arc<Mutex<Emulator>>,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    /// Held open, or the terminal would hang up between two owners.
    _line: File,
    _folder: TempDir,
}

impl EmulatorOnTerminal {
    pub(crate) fn start(set_up: impl FnOnce(&mut Emulator)) -> Self {
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let far_end = rustix::pty::openpt(flags).unwrap();
        rustix::pty::grantpt(&far_end).unwrap();
        rustix::pty::unlockpt(&far_end).unwrap();
        let name = rustix::pty::ptsname(&far_end, Vec::new()).unwrap();
        let folder = tempdir().unwrap();
        let path = folder.path().join("port");
        symlink(name.to_str().unwrap(), &path).unwrap();
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let line = rustix::fs::open(&path, flags, Mode::empty()).unwrap();
        let mut settings = rustix::termios::tcgetattr(&line).unwrap();
        settings.make_raw();
        rustix::termios::tcsetattr(&line, rustix::termios::OptionalActions::Now, &settings)
            .unwrap();

        let mut emulator = Emulator::new(clock::now());
        // Quicker than the real one, as every start waits for it.
        emulator.watchdog_after = Duration::from_millis(600);
        set_up(&mut emulator);
        let emulator = Arc::new(Mutex::new(emulator));
        let is_over = Arc::new(AtomicBool::new(false));
        let thread = std::thread::spawn({
            let (emulator, is_over) = (Arc::clone(&emulator), Arc::clone(&is_over));
            move || serve(File::from(far_end), &emulator, &is_over)
        });
        Self {
            path,
            emulator,
            is_over,
            thread: Some(thread),
            _line: File::from(line),
            _folder: folder,
        }
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn with<T>(&self, act: impl FnOnce(&mut Emulator) -> T) -> T {
        act(&mut self.emulator.lock().unwrap())
    }

    pub(crate) fn outputs(&self) -> Vec<Output> {
        self.with(|emulator| emulator.outputs.clone())
    }

    pub(crate) fn wait_until(&self, what: &str, is_so: impl Fn(&Emulator) -> bool) {
        let deadline = clock::now() + PATIENCE;
        while !self.with(|emulator| is_so(emulator)) {
            assert!(clock::now() < deadline, "waited in vain: {what}");
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Waits until the motors stand, and then long enough to see that they go on standing.
    pub(crate) fn assert_stops_for_good(&self) {
        self.wait_until("the motors stand", |emulator| emulator.motors() == [0, 0]);
        let changes = self.outputs().len();
        sleep_until(clock::now() + Duration::from_millis(500), || false);
        let outputs = self.outputs();
        assert!(
            outputs[changes - 1..].iter().all(Output::is_zero),
            "the motors started again: {:?}",
            &outputs[changes - 1..]
        );
    }
}

impl Drop for EmulatorOnTerminal {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
    }
}

fn serve(mut far_end: File, emulator: &Mutex<Emulator>, is_over: &AtomicBool) {
    // A real controller does not wait for this machine's processor; without the right, this one does.
    setpriority_process(Some(gettid()), -15).ok();
    let mut timing = {
        let now = clock::now();
        let has_line_timing = emulator.lock().unwrap().has_line_timing;
        has_line_timing.then(|| LineTiming::new(now))
    };
    let tick = rustix::event::Timespec {
        tv_sec: 0,
        tv_nsec: if timing.is_some() {
            1_000_000
        } else {
            5_000_000
        },
    };
    let mut buffer = [0; 256];
    while !is_over.load(Ordering::Acquire) {
        let mut events = [PollFd::from_borrowed_fd(far_end.as_fd(), PollFlags::IN)];
        poll(&mut events, Some(&tick)).unwrap();
        let has_come = events[0].revents().contains(PollFlags::IN);
        let count = if has_come {
            far_end.read(&mut buffer).unwrap()
        } else {
            0
        };
        let response = {
            let (now, mut emulator) = (clock::now(), emulator.lock().unwrap());
            match &mut timing {
                Some(timing) => {
                    timing.write(&buffer[..count], now);
                    timing.run(&mut emulator, now)
                }
                None => emulator.receive(&buffer[..count], now),
            }
        };
        far_end.write_all(&response).unwrap();
    }
}
