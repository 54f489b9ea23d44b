use proptest::prelude::*;

use super::*;

fn parse(bytes: &[u8]) -> Vec<Reply> {
    let mut parser = ReplyParser::default();
    bytes.iter().filter_map(|&byte| parser.push(byte)).collect()
}

fn echo(command: Command) -> Reply {
    Reply::Echo(command.line())
}

fn run(channel: Channel, steps: i8) -> Command {
    Command::Run(channel, Power(steps))
}

#[test]
fn commands_are_those_of_the_manual() {
    for (command, bytes) in [
        // Examples of p. 143.
        (run(Channel::One, 0), "!A00\r"),
        (run(Channel::Two, 127), "!B7F\r"),
        (run(Channel::One, -63), "!a3F\r"),
        (run(Channel::One, -5), "!a05\r"),
        (run(Channel::Two, -127), "!b7F\r"),
        // Example of p. 147.
        (Command::Read(Parameter::InputControlMode), "^00\r"),
        (Command::Read(Parameter::Status), "^89\r"),
        (Command::Voltages, "?E\r"),
        (Command::EncoderSpeeds, "?Z\r"),
    ] {
        assert_eq!(command.bytes().as_bytes(), bytes.as_bytes());
    }
    assert_eq!(wake().as_bytes(), [b'\r'; 10]);
    assert_eq!(stop_without_reply().as_bytes().len(), 15, "it fits");
}

#[test]
fn fractions_are_rounded_and_saturate() {
    for (fraction, steps) in [
        (0.0, 0),
        (1.0, 127),
        (-1.0, -127),
        (0.5, 64),
        (0.0039, 0),
        (0.004, 1),
        (7.0, 127),
        (-7.0, -127),
        (f64::INFINITY, 127),
        (f64::NEG_INFINITY, -127),
        (f64::NAN, 0),
    ] {
        assert_eq!(Power::from_fraction(fraction).get(), steps, "{fraction}");
    }
    for (bits, steps) in [
        (0x00, 0),
        (0x7F, 127),
        (0xFF, -1),
        (0x81, -127),
        (0x80, -127),
    ] {
        assert_eq!(Power::from_bits(bits).get(), steps);
    }
}

#[test]
fn a_dialogue_is_understood() {
    assert_eq!(
        parse(b"!A3F\r+\r?E\r8A\r6B\r^01\r00\r!bFF\r-\r"),
        [
            echo(run(Channel::One, 63)),
            Reply::Acknowledged,
            echo(Command::Voltages),
            Reply::Value(0x8A),
            Reply::Value(0x6B),
            echo(Command::Read(Parameter::MotorControlMode)),
            Reply::Value(0),
            Reply::Echo(Line {
                bytes: *b"!bFF\0\0\0\0\0\0\0\0\0\0\0\0",
                length: 4
            }),
            Reply::Refused,
        ]
    );
}

#[test]
fn what_comes_unasked_breaks_no_echo() {
    assert_eq!(
        parse(b"!AW3F\r\n+\r\r\rOK\r:0011223344556677889900AABB\r?!\x80\r7F\r"),
        [
            Reply::WatchdogTripped,
            echo(run(Channel::One, 63)),
            Reply::Acknowledged,
            Reply::Prompt,
            Reply::Noise,
            Reply::Noise,
            Reply::Value(0x7F),
        ]
    );
}

#[test]
fn voltages_are_those_of_the_formula() {
    assert!((battery_v(0x78) - 25.781_25).abs() < 1e-9);
    assert!((battery_v(0xFF) - 54.785_156_25).abs() < 1e-9);
}

proptest! {
    #[test]
    fn no_bytes_harm_and_the_line_after_them_is_understood(noise in prop::collection::vec(any::<u8>(), 0..300)) {
        let mut parser = ReplyParser::default();
        for &byte in &noise {
            parser.push(byte);
        }
        parser.push(b'\r');
        let rest: Vec<Reply> = b"?E\r8A\r6B\r".iter().filter_map(|&byte| parser.push(byte)).collect();
        prop_assert_eq!(rest, [echo(Command::Voltages), Reply::Value(0x8A), Reply::Value(0x6B)]);
    }

    #[test]
    fn every_command_is_its_own_echo(steps in -127..=127i8, two in any::<bool>()) {
        let command = run(if two { Channel::Two } else { Channel::One }, steps);
        prop_assert_eq!(parse(command.bytes().as_bytes()), [echo(command)]);
        // Two commands never look alike.
        let other = run(Channel::One, steps.wrapping_add(1).max(-127));
        prop_assert_eq!(command.line() == other.line(), command == other);
    }
}

const RUN: Command = Command::Run(Channel::One, Power::ZERO);

fn receive(command: Command, bytes: &[u8]) -> Outcome {
    outcome(Exchange::new(command, Monotonic::from_nanos(0)), bytes)
}

fn outcome(mut exchange: Exchange, bytes: &[u8]) -> Outcome {
    let mut parser = ReplyParser::default();
    bytes
        .iter()
        .filter_map(|&byte| parser.push(byte))
        .map(|reply| exchange.take(reply))
        .find(|&outcome| outcome != Outcome::Waiting)
        .unwrap_or(Outcome::Waiting)
}

#[test]
fn an_answer_follows_its_own_echo() {
    assert_eq!(receive(RUN, b"!A00\r+"), Outcome::Done([0; 2]));
    assert_eq!(receive(RUN, b"!A00\r-"), Outcome::Refused);
    assert_eq!(receive(RUN, b"+\r"), Outcome::Waiting, "whose is it?");
    assert_eq!(receive(RUN, b"-\r+\r!A00\r"), Outcome::Waiting);
    assert_eq!(receive(RUN, b"!A40\r+"), Outcome::Garbled);
    assert_eq!(receive(RUN, b"!A0\r"), Outcome::Garbled);
    assert_eq!(receive(RUN, b"!A00\r12\r"), Outcome::Waiting);
}

#[test]
fn values_are_counted() {
    let status = Command::Read(Parameter::Status);
    assert_eq!(receive(status, b"^89\r05\r+\r"), Outcome::Done([5, 0]));
    assert_eq!(receive(status, b"05\r^89\r"), Outcome::Waiting);
    assert_eq!(receive(Command::Voltages, b"?E\r8A\r"), Outcome::Waiting);
    assert_eq!(
        receive(Command::Voltages, b"11\r?E\r8A\rW6B\r"),
        Outcome::Done([0x8A, 0x6B])
    );
}

#[test]
fn both_motors_must_acknowledge() {
    let stop = Command::StopBoth;
    for done in [
        &b"!A00\r+\r!B00\r+\r"[..],
        b"!A00\r!B0+0\r+",
        b"!A00\r!B00\r++",
    ] {
        assert_eq!(receive(stop, done), Outcome::Done([0; 2]));
    }
    assert_eq!(receive(stop, b"!A00\r+\r!B00\r"), Outcome::Waiting);
    assert_eq!(receive(stop, b"!A00\r+\r+\r"), Outcome::Waiting);
    assert_eq!(receive(stop, b"!A00\r+\r!B00\r-"), Outcome::Refused);
    assert_eq!(receive(stop, b"!B00\r+"), Outcome::Garbled);
    assert_eq!(receive(stop, b"!A00\r+!A00\r+"), Outcome::Garbled);
}

#[test]
fn the_answer_to_what_a_stop_interrupted_is_not_its_own() {
    let interrupting = |command| {
        let last = Exchange::new(command, Monotonic::from_nanos(0));
        Exchange::stop_both(Some(last), Monotonic::from_nanos(1))
    };
    let drive = Command::Run(Channel::Two, Power::from_fraction(1.0));
    for late in [drive, RUN] {
        let echo = [late.bytes().as_bytes(), b"+"].concat();
        let both = [&echo[..], b"!A00\r+!B00\r"].concat();
        assert_eq!(outcome(interrupting(late), &both), Outcome::Waiting);
        let done = [&both[..], b"+"].concat();
        assert_eq!(outcome(interrupting(late), &done), Outcome::Done([0; 2]));
    }
    // Its acknowledgement comes behind the stop's first echo.
    let late = b"!B7F\r!A00\r+!B00\r+";
    assert_eq!(outcome(interrupting(drive), late), Outcome::Waiting);
    let query = interrupting(Command::Voltages);
    assert_eq!(
        outcome(query, b"?E\r8A\r!A00\r6B\r+!B00\r+"),
        Outcome::Done([0; 2])
    );
    assert_eq!(outcome(query, b"?Z\r"), Outcome::Garbled);
}
