//! The emulated controller's line at its real speed: 9600 baud both ways, and a controller that looks every 16 ms.

use std::collections::VecDeque;
use std::time::Duration;

use super::Emulator;
use measurement::time::Monotonic;

/// Start bit, 7 data bits, parity and stop bit at 9600 baud.
const CHARACTER: Duration = Duration::from_nanos(1_041_667);

/// The controller's loop (manual, p. 156). How many commands it takes in one, the manual does not say: here it is one.
const LOOP: Duration = Duration::from_millis(16);

/// Characters on their way, with the moment at which each has arrived.
#[derive(Debug)]
pub(crate) struct LineTiming {
    start: Monotonic,
    to_controller: VecDeque<(Monotonic, u8)>,
    from_controller: VecDeque<(Monotonic, u8)>,
    /// When the newest character of each direction has arrived.
    received: Monotonic,
    sent: Monotonic,
    /// When the last command was done; what came behind it waits until then.
    done: Monotonic,
    /// Part of a command has been taken: its end waits for the controller's loop.
    has_begun: bool,
}

impl LineTiming {
    pub(crate) fn new(now: Monotonic) -> Self {
        Self {
            start: now,
            to_controller: VecDeque::new(),
            from_controller: VecDeque::new(),
            received: now,
            sent: now,
            done: now,
            has_begun: false,
        }
    }

    /// These were written at `now`.
    pub(crate) fn write(&mut self, bytes: &[u8], now: Monotonic) {
        for &byte in bytes {
            self.received = self.received.max(now) + CHARACTER;
            self.to_controller.push_back((self.received, byte));
        }
    }

    /// Runs the controller up to `now`; returns what has arrived from it since the last call.
    pub(crate) fn run(&mut self, emulator: &mut Emulator, now: Monotonic) -> Vec<u8> {
        while let Some(&(arrived, byte)) = self.to_controller.front() {
            let ends_command = byte == b'\r' && self.has_begun;
            let taken = arrived.max(self.done);
            let at = if ends_command {
                self.loop_after(taken)
            } else {
                taken
            };
            if at > now {
                break;
            }
            self.to_controller.pop_front();
            self.has_begun = byte != b'\r';
            if ends_command {
                self.done = at;
            }
            let response = emulator.receive(&[byte], at);
            self.answer(&response, at);
        }
        let response = emulator.pass_time(now);
        self.answer(&response, now);
        let later = self.from_controller.partition_point(|&(at, _)| at <= now);
        let arrived = self.from_controller.drain(..later);
        arrived.map(|(_, byte)| byte).collect()
    }

    fn answer(&mut self, bytes: &[u8], now: Monotonic) {
        for &byte in bytes {
            self.sent = self.sent.max(now) + CHARACTER;
            self.from_controller.push_back((self.sent, byte));
        }
    }

    fn loop_after(&self, moment: Monotonic) -> Monotonic {
        let loops = moment.since(self.start).as_nanos() / LOOP.as_nanos() + 1;
        self.start + LOOP * u32::try_from(loops).unwrap()
    }
}
