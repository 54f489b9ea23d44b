use super::*;

const LIMITS: Limits = Limits {
    max_age: Duration::from_millis(400),
    stop_decel: [1.0, 4.0],
};

const PRESSED: Input = Input::of(0.2, 0.0);

fn at_ms(millis: u64) -> Monotonic {
    Monotonic::from_nanos(millis * 1_000_000)
}

/// A command every 20 ms: nothing pressed for 400 ms, then a key until 3 s, but for a release from 2 s to 2.3 s. Each
/// carries a token that came 10 ms before.
fn journal() -> Journal {
    let mut journal = Journal::default();
    for seq in 1..150 {
        let at = 20 * seq;
        let is_neutral = at < 400 || (2000..2300).contains(&at);
        journal.push(Sent {
            at: at_ms(at),
            seq,
            epoch: 5,
            token: seq,
            token_received: at_ms(at - 10),
            input: if is_neutral { Input::NEUTRAL } else { PRESSED },
        });
    }
    journal
}

/// A round every 20 ms, 5 ms after the command, whose token was issued 30 ms before. Of the commands from 1 s to 1.6 s
/// nothing arrives.
fn log() -> DriveLog {
    let mut rounds: Vec<Round> = Vec::new();
    for seq in 2..150 {
        let at = 20 * seq + 5;
        let arrived = if (1000..1600).contains(&at) { 49 } else { seq };
        let issued = 20 * arrived - 25;
        let age = at - issued;
        let was = rounds.last().map_or(0.0, |round| round.output[0]);
        let (mode, is) = if age > 400 {
            ("stopping", f64::max(was - 0.02, 0.0))
        } else if at < 400 || (1400..2300).contains(&at) {
            ("held", 0.0)
        } else {
            ("driving", f64::min(was + 0.01, 0.2))
        };
        let asked = if at < 400 || (2000..2300).contains(&at) {
            0.0
        } else {
            0.2
        };
        rounds.push(Round {
            at: at_ms(at),
            mode: mode.to_owned(),
            requested: [asked, 0.0],
            // As the log rounds it.
            output: [(is * 1e6).round() / 1e6, 0.0],
            age: Some(Duration::from_millis(age)),
            epoch: 5,
            seq: Some(arrived),
            clamp: String::new(),
            guard: "on".to_owned(),
        });
    }
    DriveLog { rounds, missing: 0 }
}

fn verdict(log: &DriveLog) -> Evaluation {
    evaluate(log, &[&journal()], &LIMITS)
}

/// The round at that time, changed, must be the first that is at fault.
fn is_faulted(at: u64, change: impl Fn(&mut Round), says: &str) {
    let mut log = log();
    let mut rounds = log.rounds.iter_mut();
    change(rounds.find(|round| round.at == at_ms(at)).unwrap());
    let verdict = verdict(&log);
    let fault = verdict.faults.first().expect(says);
    assert!(fault.contains(says), "{fault}");
    assert!(
        fault.starts_with(&format!("{:?}", Duration::from_millis(at))),
        "{fault}"
    );
}

#[test]
fn a_vehicle_that_keeps_its_word_is_faultless() {
    let verdict = verdict(&log());
    assert_eq!(verdict.faults, [""; 0]);
    let [stop] = verdict.stops[..] else {
        panic!("{:?}", verdict.stops)
    };
    assert_eq!(stop.issued, at_ms(955));
    assert_eq!(stop.fell_after, Duration::from_millis(410));
    assert_eq!(stop.stood_after, Some(Duration::from_millis(180)));
    assert_eq!(stop.ramp, Duration::from_millis(200));
    assert!(verdict.moving_rounds > 60, "{}", verdict.moving_rounds);
}

#[test]
fn whatever_is_wrong_is_seen() {
    is_faulted(
        705,
        |round| round.age = Some(Duration::from_millis(14)),
        "command 35 is 15ms old at least",
    );
    // 19 mm/s less in a round that must take 20 mm/s off.
    is_faulted(1365, |round| round.output[0] += 0.001, "moves it");
    is_faulted(1425, |round| round.output[0] = -0.01, "moves it");
    is_faulted(1425, |round| round.output[1] = 0.5, "moves it");
    is_faulted(705, |round| round.requested[1] = 0.3, "was asked for");
    is_faulted(705, |round| round.seq = Some(999), "nobody sent that");
    is_faulted(705, |round| round.epoch = 4, "nobody sent that");
    is_faulted(
        705,
        |round| "held".clone_into(&mut round.mode),
        "it is held",
    );
    // The key that was down all along.
    is_faulted(
        1705,
        |round| {
            round.output[0] = 0.001;
            "driving".clone_into(&mut round.mode);
        },
        "nothing was pressed for 0ns, after command 49",
    );
    is_faulted(105, |round| round.output[0] = 0.001, "nothing was pressed");
    is_faulted(
        45,
        |round| {
            round.output[0] = 0.001;
            round.seq = None;
            "driving".clone_into(&mut round.mode);
        },
        "by itself",
    );
}
