use proptest::prelude::*;

use super::super::emulator::{EmulatedFault, Emulator, Output};
use super::*;

const ON_THE_WAY: Duration = Duration::from_millis(6);

struct Bench {
    driver: Driver,
    emulator: Emulator,
    now: Monotonic,
    to_driver: Vec<(Monotonic, Vec<u8>)>,
    to_emulator: Vec<(Monotonic, Vec<u8>)>,
    sent: Vec<(Monotonic, Line)>,
}

fn queries(has_encoders: bool) -> EncoderQueries {
    EncoderQueries {
        speeds: has_encoders,
        counts: has_encoders,
    }
}

impl Bench {
    fn new(has_encoders: bool, set_up: impl FnOnce(&mut Emulator)) -> Self {
        let now = Monotonic::from_nanos(1_000_000_000);
        let mut emulator = Emulator::new(now);
        set_up(&mut emulator);
        Self {
            driver: Driver::new(queries(has_encoders), true, now),
            emulator,
            now,
            to_driver: Vec::new(),
            to_emulator: Vec::new(),
            sent: Vec::new(),
        }
    }

    fn ready() -> Self {
        Self::ready_with(false)
    }

    fn ready_with(has_encoders: bool) -> Self {
        let mut bench = Self::new(has_encoders, |emulator| {
            emulator.encoders = Some([20, -3]);
            emulator.full_speed_counts = Some([2000.0, -2000.0]);
        });
        bench.run_ms(4000);
        assert_eq!(bench.status().state, State::Ready);
        bench
    }

    /// How many of these were sent since `from`.
    fn sent_since(&self, from: usize, line: &str) -> usize {
        let sent = self.sent[from..].iter();
        sent.filter(|(_, sent)| sent.as_bytes() == line.as_bytes())
            .count()
    }

    fn status(&self) -> Status {
        self.driver.status(self.now)
    }

    fn command(&mut self, one: i8, two: i8) {
        self.driver
            .command([one, two].map(|steps| Power::from_bits(steps.cast_unsigned())));
    }

    fn run_ms(&mut self, ms: u64) {
        self.run_ms_with(ms, <[u8]>::to_vec);
    }

    /// `on_the_line` is done to all bytes, in both directions.
    fn run_ms_with(&mut self, ms: u64, mut on_the_line: impl FnMut(&[u8]) -> Vec<u8>) {
        for _ in 0..ms {
            self.now = self.now + Duration::from_millis(1);
            let now = self.now;
            let is_due = self.driver.deadline() <= now || self.driver.must_stop();
            while let Some(transmission) = self.driver.transmit(now) {
                assert!(is_due, "nobody would have woken it: {transmission:?}");
                let bytes = transmission.bytes.as_bytes();
                self.sent.push((now, transmission.bytes));
                if transmission.flush {
                    self.to_emulator.clear();
                    self.to_driver.clear();
                }
                self.to_emulator
                    .push((now + ON_THE_WAY, on_the_line(bytes)));
            }
            assert!(self.driver.deadline() > now, "it would be woken at once");
            let response = self
                .emulator
                .receive(&arrived(&mut self.to_emulator, now), now);
            if !response.is_empty() {
                self.to_driver
                    .push((now + ON_THE_WAY, on_the_line(&response)));
            }
            let bytes = arrived(&mut self.to_driver, now);
            self.driver.receive(&bytes, now);
            assert!(
                self.driver.deadline().since(now) <= WATCHDOG_WAIT,
                "somebody must wake it"
            );
        }
    }
}

fn arrived(queue: &mut Vec<(Monotonic, Vec<u8>)>, now: Monotonic) -> Vec<u8> {
    let is_later = |&(at, _): &(Monotonic, Vec<u8>)| at > now;
    let later = queue.iter().position(is_later).unwrap_or(queue.len());
    queue.drain(..later).flat_map(|(_, bytes)| bytes).collect()
}

#[test]
fn it_is_found_stopped_checked_and_ready_also_from_rc_mode() {
    for is_in_rc_mode in [false, true] {
        let mut bench = Bench::new(false, |emulator| {
            emulator.is_in_rc_mode = is_in_rc_mode;
            emulator.input_mode = if is_in_rc_mode { 0 } else { 2 };
        });
        bench.command(50, 50);
        bench.run_ms(500);
        assert_eq!(bench.status().state, State::Starting);
        bench.run_ms(3000);
        let status = bench.status();
        assert_eq!(
            (status.state, status.watchdog),
            (State::Ready, ControllerWatchdog::Proven)
        );
        assert!((status.battery_v.unwrap() - 25.781_25).abs() < 1e-9);
        assert_eq!((status.reconnects, status.encoders), (0, None));
        assert_eq!(
            bench.emulator.outputs.len(),
            1,
            "what was asked before counts for nothing"
        );
    }
}

#[test]
fn motors_that_run_at_the_start_are_stopped_at_once() {
    let mut bench = Bench::new(false, |emulator| {
        emulator.receive(b"!A40\r!b40\r!A1", Monotonic::from_nanos(1_000_000_000));
    });
    assert_eq!(bench.emulator.motors(), [64, -64]);
    bench.run_ms(10);
    assert_eq!(bench.emulator.motors(), [0, 0]);
}

#[test]
fn commands_are_done_and_a_stop_is_quick() {
    for has_encoders in [false, true] {
        obeys_quickly(Bench::ready_with(has_encoders));
    }
}

fn obeys_quickly(mut bench: Bench) {
    bench.command(64, -10);
    bench.run_ms(50);
    assert_eq!(bench.emulator.motors(), [64, -10]);
    assert_eq!(
        bench.status().acknowledged,
        Some([Power::from_bits(64), Power::from_bits(0xF6)])
    );
    for _ in 0..50 {
        bench.command(100, 100);
        bench.run_ms(20);
        let asked = bench.now;
        bench.command(0, 0);
        assert!(!bench.driver.has_stopped_since(asked));
        // The exchange on its way, and two more.
        bench.run_ms(50);
        assert_eq!(bench.emulator.motors(), [0, 0]);
        assert!(bench.driver.has_stopped_since(asked));
    }
}

#[test]
fn a_stop_is_one_write_for_both_motors_whatever_is_on_its_way() {
    for has_encoders in [false, true] {
        stops_in_one_write(Bench::ready_with(has_encoders));
    }
}

fn stops_in_one_write(mut bench: Bench) {
    for ms in 0..80 {
        bench.command(100, -100);
        bench.run_ms(150 + ms);
        let (asked, sent) = (bench.now, bench.sent.len());
        bench.command(0, 0);
        bench.run_ms(1);
        assert_eq!(bench.sent[sent..], [(bench.now, Command::StopBoth.bytes())]);
        bench.run_ms(6);
        assert_eq!(bench.emulator.motors(), [0, 0]);
        assert!(
            !bench.driver.has_stopped_since(asked),
            "not acknowledged yet"
        );
        bench.run_ms(10);
        assert!(bench.driver.has_stopped_since(asked));
        let status = bench.status();
        assert_eq!((status.state, status.reconnects), (State::Ready, 0));
    }
}

#[test]
fn a_one_command_controller_gets_zeros_one_by_one() {
    for (is_from_the_start, ms) in [(true, 60), (false, 180)] {
        let mut bench = Bench::new(false, |emulator| {
            if is_from_the_start {
                emulator.fault = EmulatedFault::SingleCommand;
            }
        });
        bench.run_ms(4000);
        bench.emulator.fault = EmulatedFault::SingleCommand;
        for _ in 0..10 {
            bench.command(100, 100);
            bench.run_ms(200);
            assert_eq!(bench.emulator.motors(), [100, 100]);
            let asked = bench.now;
            bench.command(0, 0);
            bench.run_ms(ms);
            assert_eq!(bench.emulator.motors(), [0, 0]);
            assert!(bench.driver.has_stopped_since(asked));
        }
        let status = bench.status();
        assert_eq!((status.state, status.reconnects), (State::Ready, 0));
    }
}

#[test]
fn speeds_are_repeated_with_one_command_in_flight() {
    let mut bench = Bench::ready();
    bench.command(30, 30);
    bench.run_ms(100);
    let (executed, sent) = (bench.emulator.executed, bench.sent.len());
    bench.run_ms(1000);
    assert!(
        bench.emulator.executed - executed >= 20,
        "ten pairs a second at least"
    );
    let gaps = bench.sent[sent..]
        .windows(2)
        .map(|pair| pair[1].0.since(pair[0].0));
    assert!(
        gaps.min().unwrap() >= ON_THE_WAY * 2,
        "each waits for its answer"
    );
}

/// Counts of table 33 (p. 168), after a second at full speed.
#[test]
fn the_emulator_counts_as_the_manual_says() {
    for (count, text) in [
        (0.0, "0"),
        (5.0, "5"),
        (8.0, "08"),
        (250.0, "0FA"),
        (-1.0, "F"),
        (-6.0, "A"),
        (-9.0, "F7"),
        (-235.0, "F15"),
        (91_011_186.0, "56CB872"),
        (-7_986_091.0, "862455"),
        (-2_147_483_648.0, "80000000"),
        (2_147_483_648.0, "80000000"),
    ] {
        let mut emulator = Emulator::new(at(0));
        emulator.watchdog_after = Duration::from_hours(1);
        emulator.full_speed_counts = Some([0.0, count]);
        emulator.receive(b"!B7F\r", at(0));
        let reply = emulator.receive(b"?Q1\r", at(1000));
        assert_eq!(String::from_utf8(reply).unwrap(), format!("?Q1\r{text}\r"));
        assert_eq!(emulator.receive(b"?Q0\r", at(1000)), b"?Q0\r0\r");
        // It stands, and comes back.
        emulator.receive(b"!B00\r", at(1000));
        emulator.receive(b"!b7F\r", at(3000));
        assert_eq!(emulator.counts(at(4000)), Some([0, 0]));
    }
}

#[test]
fn both_counts_are_asked_several_times_a_second_beside_everything_else() {
    for (has_encoders, counts, speeds) in [(false, 0..=0, 0..=0), (true, 5..=10, 3..=5)] {
        let mut bench = Bench::ready_with(has_encoders);
        for is_steady in [true, false] {
            let sent = bench.sent.len();
            for round in 0..500_u64 {
                let steps = if is_steady {
                    60
                } else {
                    (round % 100) as i8 + 1
                };
                bench.command(steps, steps);
                bench.run_ms(20);
            }
            let each_second = |line| bench.sent_since(sent, line) / 10;
            for (line, expected) in [
                ("?Q0\r", &counts),
                ("?Q1\r", &counts),
                ("?Z\r", &speeds),
                ("^89\r", &(3..=5)),
                ("?E\r", &(0..=1)),
            ] {
                let rate = each_second(line);
                assert!(
                    expected.contains(&rate),
                    "{line:?} {rate} {is_steady} {has_encoders}"
                );
            }
            let pairs = bench.sent_since(sent, "!A3C\r") / 10;
            assert!(pairs >= 9 || !is_steady, "{pairs}");
        }
        assert_eq!(
            (bench.status().state, bench.status().reconnects),
            (State::Ready, 0)
        );
    }
}

/// At every moment of the line's turn.
#[test]
fn a_new_command_waits_for_one_question_at_most() {
    let mut bench = Bench::ready_with(true);
    for ms in 0..400 {
        bench.command(30, 30);
        bench.run_ms(150 + ms % 110);
        let is_asking = bench.driver.exchange.is_some_and(|exchange| {
            !matches!(exchange.command, Command::Run(..) | Command::StopBoth)
        });
        let sent = bench.sent.len();
        bench.command(90, 90);
        bench.run_ms(80);
        let own = Command::Run(Channel::One, Power::from_bits(90)).bytes();
        let before = bench.sent[sent..]
            .iter()
            .take_while(|(_, line)| *line != own);
        let questions = before
            .filter(|(_, line)| line.as_bytes()[0] != b'!')
            .count();
        assert!(usize::from(is_asking) + questions <= 1, "{ms}");
        assert!(bench.sent_since(sent, "!A5A\r") > 0);
    }
}

#[test]
fn counts_that_nobody_answers_do_not_fill_the_line() {
    for is_refused in [true, false] {
        let mut bench = Bench::ready_with(true);
        if is_refused {
            bench.emulator.full_speed_counts = None;
        }
        let sent = bench.sent.len();
        for _ in 0..500 {
            bench.command(60, 60);
            bench.run_ms_with(20, |bytes| match bytes {
                [b'?', b'Q', ..] if !is_refused => Vec::new(),
                _ => bytes.to_vec(),
            });
        }
        let asked = bench.sent_since(sent, "?Q0\r") + bench.sent_since(sent, "?Q1\r");
        assert!((10..=25).contains(&asked), "{asked}");
        assert!(bench.sent_since(sent, "!A3C\r") >= 100);
        assert_eq!(
            (bench.status().state, bench.status().reconnects),
            (State::Ready, 0)
        );
        assert_eq!(bench.emulator.motors(), [60, 60]);
    }
}

#[test]
fn encoders_and_faults_are_reported() {
    let mut bench = Bench::new(true, |emulator| emulator.encoders = Some([20, -3]));
    bench.run_ms(4500);
    assert_eq!(
        bench.status().encoders,
        Some([Power::from_bits(20), Power::from_bits(0xFD)])
    );
    bench.emulator.status = 0x84;
    bench.run_ms(600);
    let flags = bench.status().flags;
    assert!(flags.is_off());
    assert_eq!(flags.to_string(), "undervoltage, emergency stop pressed");
    assert!(!ControllerFlags(0x10).is_off(), "bit 4 is unused");
    bench.emulator.encoders = None;
    bench.run_ms(1000);
    assert_eq!(
        (bench.status().encoders, bench.status().state),
        (None, State::Ready)
    );
}

#[test]
fn a_controller_that_would_do_something_else_is_not_driven() {
    for (mode, state) in [
        (0x00, State::Ready),
        (0xC4, State::Ready),
        (0x01, State::Faulty(ControllerFault::MotorMode(1))),
        (0xC5, State::Faulty(ControllerFault::MotorMode(0xC5))),
        (0x02, State::Faulty(ControllerFault::MotorMode(2))),
    ] {
        let mut bench = Bench::new(false, |emulator| emulator.motor_mode = mode);
        bench.run_ms(4000);
        assert_eq!(bench.status().state, state);
        bench.command(20, 20);
        bench.run_ms(500);
        assert_eq!(bench.emulator.motors() == [20, 20], state == State::Ready);
    }
}

#[test]
fn a_controller_without_watchdog_is_refused_by_default() {
    for (require_watchdog, state) in [
        (true, State::Faulty(ControllerFault::NoWatchdog(1))),
        (false, State::Ready),
    ] {
        let mut bench = Bench::new(false, |emulator| {
            emulator.input_mode = 1;
            emulator.reset(Monotonic::from_nanos(1_000_000_000));
        });
        bench.driver.require_watchdog = require_watchdog;
        bench.run_ms(4000);
        assert_eq!(
            (bench.status().state, bench.status().watchdog),
            (state, ControllerWatchdog::Absent)
        );
        bench.command(20, 20);
        bench.run_ms(500);
        assert_eq!(
            bench.emulator.motors(),
            if require_watchdog { [0, 0] } else { [20, 20] }
        );
    }
}

#[test]
fn a_cut_cable_is_a_fault_and_drops_earlier_commands() {
    let mut bench = Bench::ready();
    bench.command(80, 80);
    bench.run_ms(100);
    bench.emulator.fault = EmulatedFault::RxCut;
    bench.run_ms(400);
    assert_eq!(bench.status().state, State::Faulty(ControllerFault::Silent));
    assert_eq!(bench.status().acknowledged, None);
    bench.run_ms(700);
    assert_eq!(
        bench.emulator.motors(),
        [0, 0],
        "by the controller's own watchdog"
    );
    bench.command(80, 80);
    bench.emulator.fault = EmulatedFault::None;
    bench.run_ms(5000);
    assert_eq!(
        (bench.status().state, bench.status().reconnects),
        (State::Ready, 1)
    );
    assert_eq!(bench.emulator.motors(), [0, 0]);
    bench.command(80, 80);
    bench.run_ms(50);
    assert_eq!(bench.emulator.motors(), [80, 80]);
}

#[test]
fn a_silent_controller_is_commanded_to_stop() {
    let mut bench = Bench::ready();
    bench.command(80, 80);
    bench.run_ms(100);
    bench.emulator.fault = EmulatedFault::TxCut;
    bench.run_ms(420);
    assert_eq!(
        bench.emulator.motors(),
        [0, 0],
        "told blindly, before its watchdog"
    );
    assert_eq!(bench.status().state, State::Faulty(ControllerFault::Silent));
}

/// As where an adapter holds characters back, or this process got no processor.
#[test]
fn answers_that_come_late_once_are_no_fault() {
    let mut bench = Bench::ready();
    for _ in 0..100 {
        bench.command(50, 40);
        bench.run_ms(1);
    }
    for held_back_ms in [0, 90, 110, 150, 190] {
        for _ in 0..20 {
            bench.run_ms(1);
            if !bench.to_driver.is_empty() {
                break;
            }
        }
        for (at, _) in &mut bench.to_driver {
            *at = *at + Duration::from_millis(held_back_ms);
        }
        for _ in 0..600 {
            bench.run_ms(1);
            assert_eq!(bench.status().state, State::Ready, "{held_back_ms}");
        }
    }
    assert_eq!(bench.status().reconnects, 0);
    assert_eq!(bench.emulator.motors(), [50, 40]);
}

/// A fault is kept until somebody resets it: one start in vain, as of a controller that boots, must not be one.
#[test]
fn a_fault_is_only_a_controller_that_is_not_found_twice() {
    for (mute_ms, is_fault) in [(400, false), (u64::MAX, true)] {
        let mut bench = Bench::new(false, |emulator| emulator.fault = EmulatedFault::TxCut);
        let mut states = Vec::new();
        for ms in 0..4000 {
            if ms == mute_ms {
                bench.emulator.fault = EmulatedFault::None;
            }
            bench.run_ms(1);
            states.push(bench.status().state);
        }
        states.dedup();
        let last = if is_fault {
            State::Faulty(ControllerFault::Silent)
        } else {
            State::Ready
        };
        assert_eq!(states, [State::Starting, last]);
    }
}

#[test]
fn a_reset_is_noticed() {
    let mut bench = Bench::ready();
    bench.command(80, 80);
    bench.run_ms(100);
    let response = bench.emulator.reset(bench.now);
    bench.to_driver.push((bench.now, response));
    bench.run_ms(3000);
    assert!(
        bench
            .emulator
            .outputs
            .iter()
            .rev()
            .take(1)
            .all(Output::is_zero)
    );
    assert_eq!(bench.status().reconnects, 1);
}

#[test]
fn a_line_that_garbles_is_not_driven_on() {
    let mut bench = Bench::ready();
    // 0x41, 65 steps, is taken for 0x71, 113 steps.
    bench.emulator.fault = EmulatedFault::GarblesByte(b'4', b'7');
    bench.command(0x41, 0x41);
    bench.run_ms(200);
    assert_eq!(
        bench.status().state,
        State::Faulty(ControllerFault::GarbledLine)
    );
    assert_eq!(bench.emulator.motors(), [0, 0]);
}

#[test]
fn a_controller_that_refuses_is_reported() {
    let mut bench = Bench::ready();
    bench.emulator.fault = EmulatedFault::RejectsCommands;
    bench.command(20, 20);
    bench.run_ms(300);
    assert_eq!(
        bench.status().state,
        State::Faulty(ControllerFault::Refusing)
    );
}

/// With a bad line a single refusal once left the controller faulty for good.
#[test]
fn a_motor_mode_that_is_refused_is_read_again() {
    let question = Command::Read(Parameter::MotorControlMode).bytes();
    for (refusals, state) in [
        (1, State::Ready),
        (4, State::Ready),
        (u32::MAX, State::Faulty(ControllerFault::Unreadable)),
    ] {
        let mut bench = Bench::new(false, |_| {});
        let mut left = refusals;
        bench.run_ms_with(8000, |bytes| {
            match bytes.strip_prefix(question.as_bytes()) {
                Some([_, ..]) if left > 0 => {
                    left -= 1;
                    [question.as_bytes(), b"-\r"].concat()
                }
                _ => bytes.to_vec(),
            }
        });
        assert_eq!(bench.status().state, state, "{refusals}");
        assert!(bench.emulator.outputs.iter().all(Output::is_zero));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    /// Whatever is lost or comes in between: it neither stops working for good, nor goes on when commanded to stop.
    #[test]
    fn a_bad_line_ends_in_a_stop_and_heals(
        faults in prop::collection::vec((0..12u8, any::<u8>()), 200..400),
        speeds in prop::collection::vec(any::<(i8, i8)>(), 20),
        has_encoders in any::<bool>(),
    ) {
        let mut bench = Bench::ready_with(has_encoders);
        let mut faults = faults.into_iter().cycle();
        for &(one, two) in &speeds {
            bench.command(one, two);
            bench.run_ms_with(40, |bytes| {
                bytes.iter().flat_map(|&byte| match faults.next() {
                    // With even parity one wrong bit loses the character, and never makes another of it.
                    Some((0, _)) => vec![],
                    Some((1, noise)) => vec![noise | 0x80, byte],
                    _ => vec![byte],
                }).collect()
            });
        }
        bench.command(0, 0);
        bench.run_ms(700);
        prop_assert_eq!(bench.emulator.motors(), [0, 0]);
        let changes = bench.emulator.outputs.len();
        bench.run_ms(6000);
        prop_assert!(bench.emulator.outputs[changes..].iter().all(Output::is_zero));
        prop_assert_eq!(bench.status().state, State::Ready);
        bench.command(20, 20);
        bench.run_ms(60);
        prop_assert_eq!(bench.emulator.motors(), [20, 20]);
    }

    #[test]
    fn no_bytes_harm_the_driver(noise in prop::collection::vec(any::<u8>(), 0..400), split in 1..20usize) {
        let mut bench = Bench::ready();
        for part in noise.chunks(split) {
            bench.driver.receive(part, bench.now);
            bench.run_ms(3);
        }
        bench.driver.receive(b"\r", bench.now);
        bench.run_ms(8000);
        prop_assert_eq!(bench.status().state, State::Ready);
        prop_assert!(bench.emulator.outputs.iter().all(Output::is_zero));
    }
}

const STOP: [Power; 2] = [Power::ZERO; 2];

fn at(ms: u64) -> Monotonic {
    Monotonic::from_nanos(1_000_000_000 + ms * 1_000_000)
}

fn ahead() -> [Power; 2] {
    [Power::from_fraction(0.5); 2]
}

/// With every question due, and a pair just said.
fn busy() -> Scheduler {
    let mut scheduler = Scheduler::new(queries(true), at(0));
    let tasks = [10, 11].map(|ms| scheduler.next(ahead(), [None; 2], at(ms)));
    assert_eq!(tasks, [Some(Task::RunOne), Some(Task::RunTwo)]);
    scheduler
}

#[test]
fn one_question_comes_between_two_pairs() {
    let mut scheduler = busy();
    let acknowledged = ahead().map(Some);
    let mut tasks = Vec::new();
    for ms in 12..250 {
        tasks.extend(scheduler.next(ahead(), acknowledged, at(ms)));
    }
    let polls = tasks
        .iter()
        .filter(|task| !matches!(task, Task::RunOne | Task::RunTwo));
    assert_eq!(tasks[0], Task::Status);
    assert_eq!(tasks[1..3], [Task::RunOne, Task::RunTwo]);
    assert_eq!(tasks[3], Task::Speeds);
    assert!(polls.count() >= 4, "{tasks:?}");
}

#[test]
fn no_question_delays_a_stop() {
    let acknowledged = ahead().map(Some);
    let mut scheduler = busy();
    assert_eq!(
        scheduler.next(STOP, acknowledged, at(19)),
        None,
        "a pair was said just now"
    );
    assert_eq!(
        scheduler.next(STOP, acknowledged, at(20)),
        Some(Task::RunOne)
    );
    assert_eq!(
        scheduler.next(STOP, acknowledged, at(21)),
        Some(Task::RunTwo)
    );
    let mut scheduler = busy();
    assert_eq!(
        scheduler.next(ahead(), [None; 2], at(20)),
        Some(Task::Status)
    );
    // Nor the repetition of what has failed.
    let mut scheduler = busy();
    scheduler.repeat(at(12));
    let tasks = [21, 22, 23].map(|ms| scheduler.next(ahead(), [None; 2], at(ms)));
    assert_eq!(tasks, [None, Some(Task::RunOne), Some(Task::RunTwo)]);
}

#[test]
fn zero_is_repeated_to_a_standing_vehicle() {
    let mut scheduler = busy();
    let pairs =
        (12..1012).filter(|&ms| scheduler.next(STOP, STOP.map(Some), at(ms)) == Some(Task::RunOne));
    assert!((19..=21).contains(&pairs.count()));
}
