//! An emulated AX3500 for tests, after the same manual as [`super::wire`].

use std::collections::VecDeque;
use std::time::Duration;

use measurement::time::Monotonic;

// The end-to-end tests include this file, which requires an explicit path.
#[cfg(target_os = "linux")]
#[path = "emulator/on_terminal.rs"]
pub(crate) mod on_terminal;

#[derive(Clone, Debug)]
#[expect(clippy::struct_excessive_bools, reason = "each is a state of its own")]
pub(crate) struct Emulator {
    pub(crate) is_in_rc_mode: bool,
    /// Parameter 00; 2 means that the watchdog is on.
    pub(crate) input_mode: u8,
    /// Parameter 01.
    pub(crate) motor_mode: u8,
    /// Parameter 89.
    pub(crate) status: u8,
    pub(crate) battery: u8,
    /// As measured; absent: there is no encoder module.
    pub(crate) encoders: Option<[i8; 2]>,
    /// Counts of each encoder in a second at command 127; absent: there is no encoder module.
    pub(crate) full_speed_counts: Option<[f64; 2]>,
    pub(crate) watchdog_after: Duration,
    /// Where it acts sooner when it is tried at the start, right after parameters were read: tests need not wait, and
    /// what stops the motors later is not the watchdog.
    pub(crate) watchdog_trial_after: Option<Duration>,
    /// On a terminal, characters and commands take the time that they take on a real line.
    pub(crate) has_line_timing: bool,
    pub(crate) fault: EmulatedFault,
    pub(crate) outputs: Vec<Output>,
    pub(crate) executed: usize,
    /// Counts that were asked for.
    pub(crate) counts_asked: usize,
    /// When the counters were zero.
    counts_since: Monotonic,
    watchdog_is_on: bool,
    is_watchdog_tried: bool,
    last_received: Monotonic,
    returns_in_a_row: u8,
    line: Vec<u8>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum EmulatedFault {
    None,
    /// The wire to it is cut.
    RxCut,
    /// The wire from it is cut.
    TxCut,
    /// It takes the one for the other, and echoes so.
    GarblesByte(u8, u8),
    RejectsCommands,
    /// What comes right behind a command is lost.
    SingleCommand,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Output {
    pub(crate) at: Monotonic,
    /// By channel, −127 … 127.
    pub(crate) motors: [i8; 2],
}

impl Output {
    pub(crate) fn is_zero(&self) -> bool {
        self.motors == [0, 0]
    }
}

impl Emulator {
    /// Configured as it should be: RS-232 with watchdog, separate speeds.
    pub(crate) fn new(now: Monotonic) -> Self {
        Self {
            is_in_rc_mode: false,
            input_mode: 2,
            motor_mode: 0,
            status: 0,
            battery: 0x78,
            encoders: None,
            full_speed_counts: None,
            watchdog_after: Duration::from_secs(1),
            watchdog_trial_after: None,
            has_line_timing: false,
            fault: EmulatedFault::None,
            outputs: vec![Output {
                at: now,
                motors: [0, 0],
            }],
            executed: 0,
            counts_asked: 0,
            counts_since: now,
            watchdog_is_on: true,
            is_watchdog_tried: false,
            last_received: now,
            returns_in_a_row: 0,
            line: Vec::new(),
        }
    }

    /// As by its button: motors off, counters at zero, the modes by its parameters.
    pub(crate) fn reset(&mut self, now: Monotonic) -> Vec<u8> {
        self.is_in_rc_mode = matches!(self.input_mode, 0 | 3);
        self.watchdog_is_on = self.input_mode == 2;
        self.line.clear();
        self.output([0, 0], now);
        self.counts_since = now;
        if self.is_in_rc_mode {
            Vec::new()
        } else {
            b"OK\r".to_vec()
        }
    }

    pub(crate) fn motors(&self) -> [i8; 2] {
        self.outputs.last().unwrap().motors
    }

    pub(crate) fn receive(&mut self, bytes: &[u8], now: Monotonic) -> Vec<u8> {
        let mut response = self.pass_time(now);
        if self.fault == EmulatedFault::RxCut {
            return response;
        }
        for &byte in bytes {
            self.last_received = now;
            let byte = match self.fault {
                EmulatedFault::GarblesByte(this, that) if byte == this => that,
                EmulatedFault::None
                | EmulatedFault::RxCut
                | EmulatedFault::TxCut
                | EmulatedFault::GarblesByte(..)
                | EmulatedFault::RejectsCommands
                | EmulatedFault::SingleCommand => byte,
            };
            if self.is_in_rc_mode {
                self.receive_in_rc_mode(byte, &mut response);
                continue;
            }
            response.push(byte);
            if byte == b'\r' {
                let line = std::mem::take(&mut self.line);
                response.extend(self.execute(&line, now));
                if self.fault == EmulatedFault::SingleCommand && !line.is_empty() {
                    break;
                }
            } else {
                self.line.push(byte);
            }
        }
        if self.fault == EmulatedFault::TxCut {
            Vec::new()
        } else {
            response
        }
    }

    pub(crate) fn pass_time(&mut self, now: Monotonic) -> Vec<u8> {
        let is_watching = self.watchdog_is_on && !self.is_in_rc_mode;
        let trial = self.watchdog_trial_after.filter(|_| self.is_watchdog_tried);
        if !is_watching || now.since(self.last_received) < trial.unwrap_or(self.watchdog_after) {
            return Vec::new();
        }
        self.last_received = now;
        self.output([0, 0], now);
        if self.fault == EmulatedFault::TxCut {
            Vec::new()
        } else {
            vec![b'W']
        }
    }

    fn receive_in_rc_mode(&mut self, byte: u8, response: &mut Vec<u8>) {
        self.returns_in_a_row = if byte == b'\r' {
            self.returns_in_a_row + 1
        } else {
            0
        };
        if self.returns_in_a_row == 10 {
            self.returns_in_a_row = 0;
            self.is_in_rc_mode = false;
            self.watchdog_is_on = true;
            response.extend(b"OK\r");
        }
    }

    fn execute(&mut self, line: &[u8], now: Monotonic) -> Vec<u8> {
        let value = |value: u8| format!("{value:02X}\r").into_bytes();
        let values = |of: [u8; 2]| [value(of[0]), value(of[1])].concat();
        self.is_watchdog_tried = line == b"^01";
        match line {
            [] => Vec::new(),
            [b'!', letter @ (b'A' | b'a' | b'B' | b'b'), high, low]
                if self.fault != EmulatedFault::RejectsCommands =>
            {
                let Some(magnitude) = byte_of(*high, *low).filter(|&magnitude| magnitude <= 127)
                else {
                    return b"-\r".to_vec();
                };
                let steps = i8::try_from(magnitude).unwrap();
                let steps = if letter.is_ascii_lowercase() {
                    -steps
                } else {
                    steps
                };
                let mut motors = self.motors();
                motors[usize::from(letter.eq_ignore_ascii_case(&b'b'))] = steps;
                self.executed += 1;
                self.output(motors, now);
                b"+\r".to_vec()
            }
            b"^00" => value(self.input_mode),
            b"^01" => value(self.motor_mode),
            b"^89" => value(self.status),
            b"?E" | b"?e" => values([self.battery, 0x6B]),
            b"?Z" | b"?z" => match self.encoders {
                Some(speeds) => values(speeds.map(i8::cast_unsigned)),
                None => b"-\r".to_vec(),
            },
            [b'?', b'Q' | b'q', encoder @ (b'0' | b'1')] => {
                self.counts_asked += 1;
                match self.counts(now) {
                    Some(counts) => shortened(counts[usize::from(encoder - b'0')]).into_bytes(),
                    None => b"-\r".to_vec(),
                }
            }
            _ => b"-\r".to_vec(),
        }
    }

    /// Absolute counts of both encoders, 32 bits, which wrap (manual, p. 159); the wheels turn as commanded, at once.
    pub(crate) fn counts(&self, now: Monotonic) -> Option<[i32; 2]> {
        let full_speed_counts = self.full_speed_counts?;
        let ends = self.outputs.iter().skip(1).map(|output| output.at);
        let mut counts = [0.0; 2];
        for (output, end) in self.outputs.iter().zip(ends.chain([now])) {
            let seconds = end.since(output.at.max(self.counts_since)).as_secs_f64();
            for (channel, count) in counts.iter_mut().enumerate() {
                let speed = f64::from(output.motors[channel]) / 127.0;
                *count += speed * full_speed_counts[channel] * seconds;
            }
        }
        Some(counts.map(|count| count as i64 as i32))
    }

    fn output(&mut self, motors: [i8; 2], now: Monotonic) {
        if self.motors() != motors {
            self.outputs.push(Output { at: now, motors });
        }
    }
}

/// The fewest hexadecimal digits whose first tells the sign, 8 to F that of a negative number (manual, p. 167).
fn shortened(count: i32) -> String {
    let holds = |digits: &u32| (i64::from(count) + (8 << (4 * (digits - 1)))) >> (4 * digits) == 0;
    let digits = (1..8).find(holds).unwrap_or(8);
    let bits = u64::from(count.cast_unsigned()) & ((1 << (4 * digits)) - 1);
    format!("{bits:0width$X}\r", width = digits as usize)
}

fn byte_of(high: u8, low: u8) -> Option<u8> {
    let digits = [high, low];
    let text = std::str::from_utf8(&digits).ok()?;
    u8::from_str_radix(text, 16).ok()
}

/// Start bit, 7 data bits, parity and stop bit at 9600 baud.
const CHARACTER: Duration = Duration::from_nanos(1_041_667);

/// The controller's loop (manual, p. 156). How many commands it takes in one, the manual does not say: here it is one.
const LOOP: Duration = Duration::from_millis(16);

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
