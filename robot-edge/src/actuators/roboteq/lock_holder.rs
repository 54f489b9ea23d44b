//! The process that holds the lock of a port, by `/proc`.

use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;

use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};

use crate::actuators::MOTOR_GUARD_COMMAND;

/// A process that holds the lock of a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LockHolder {
    /// Its number.
    pub(super) pid: u32,
}

impl LockHolder {
    /// Who holds the lock of `port`; absent where nobody does, or it cannot be known.
    pub(super) fn of(port: &Path) -> Option<Self> {
        let file = fs::metadata(port).ok()?;
        let locks = fs::read_to_string("/proc/locks").ok()?;
        holder_in(&locks, file.dev(), file.ino()).map(|pid| Self { pid })
    }

    /// Whether it is a motor guard whose edge has gone. A guard's parent runs the same program as long as it lives;
    /// then the guard is a child of another process.
    pub(super) fn is_orphaned_guard(self) -> bool {
        let command = fs::read(format!("/proc/{}/cmdline", self.pid)).unwrap_or_default();
        let is_guard =
            command.split(|&byte| byte == 0).nth(1) == Some(MOTOR_GUARD_COMMAND.as_bytes());
        let (Some(own), Some(parent)) = (program(self.pid), parent(self.pid)) else {
            return false;
        };
        is_guard && program(parent) != Some(own)
    }

    /// Ends it, stopped or not, if it still is an orphaned guard; returns whether it was signalled.
    pub(super) fn kill_orphaned_guard(self) -> bool {
        let pid = i32::try_from(self.pid).ok().and_then(Pid::from_raw);
        // Open before the check: the number cannot be another process's then.
        let process = pid.and_then(|pid| pidfd_open(pid, PidfdFlags::empty()).ok());
        process.is_some_and(|process| {
            self.is_orphaned_guard() && pidfd_send_signal(&process, Signal::KILL).is_ok()
        })
    }
}

/// In the text of `/proc/locks` (proc(5)), who holds the `flock` of a file.
fn holder_in(locks: &str, device: u64, inode: u64) -> Option<u32> {
    let (major, minor) = (rustix::fs::major(device), rustix::fs::minor(device));
    let file = format!("{major:02x}:{minor:02x}:{inode}");
    locks.lines().find_map(|line| {
        let mut fields = line.split_ascii_whitespace().skip(1);
        // Who waits for a lock has an arrow in its place.
        let is_held = fields.next() == Some("FLOCK");
        let pid = fields.nth(2)?;
        (is_held && fields.next() == Some(file.as_str()))
            .then(|| pid.parse().ok())
            .flatten()
    })
}

/// The file that a process runs, also where it has been replaced since.
fn program(pid: u32) -> Option<(u64, u64)> {
    let file = fs::metadata(format!("/proc/{pid}/exe")).ok()?;
    Some((file.dev(), file.ino()))
}

fn parent(pid: u32) -> Option<u32> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name in parentheses before it may hold anything.
    let (_, fields) = stat.rsplit_once(')')?;
    fields.split_ascii_whitespace().nth(1)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actuators::roboteq::emulator::on_terminal::EmulatorOnTerminal;
    use crate::actuators::roboteq::port::{Port, Sharing};

    #[test]
    fn a_lock_is_found_by_device_and_inode() {
        let locks = "1: POSIX  ADVISORY  WRITE 5 00:1c:5 0 EOF\n\
                     2: FLOCK  ADVISORY  WRITE 77 00:1c:5 0 EOF\n\
                     2: -> FLOCK  ADVISORY  WRITE 78 00:1c:6 0 EOF\n";
        assert_eq!(holder_in(locks, rustix::fs::makedev(0, 0x1c), 5), Some(77));
        assert_eq!(holder_in(locks, rustix::fs::makedev(0, 0x1c), 6), None);
        assert_eq!(holder_in(locks, rustix::fs::makedev(0, 0x1d), 5), None);
    }

    #[test]
    fn a_holder_that_is_no_guard_is_not_killed() {
        let controller = EmulatorOnTerminal::start(|_| {});
        assert_eq!(LockHolder::of(controller.path()), None);
        let _port = Port::open(controller.path(), Sharing::Exclusive).unwrap();
        let holder = LockHolder::of(controller.path()).unwrap();
        assert_eq!(holder.pid, std::process::id());
        assert!(!holder.kill_orphaned_guard());
    }
}
