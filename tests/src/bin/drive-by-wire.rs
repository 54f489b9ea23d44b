//! An operator, or a router, as a process of its own: to be stopped, killed, or put into a namespace by tests.
//!
//! ```text
//! drive-by-wire operate ENDPOINT ROBOT NAME JOURNAL.csv INPUT ...
//! drive-by-wire operate-with-keys ENDPOINT ROBOT FOLDER JOURNAL.csv INPUT ...
//! drive-by-wire route ENDPOINT
//! ```
//!
//! An INPUT is `LINEAR_MPS,ANGULAR_RADPS,SECONDS`. They are held one after the other, over and over, until somebody ends
//! the process. `operate` says `holds the lease` as soon as it does, `route` says `routes`.

#![allow(
    clippy::unwrap_used,
    reason = "a part of tests: what fails here fails the test, with its reason"
)]

use std::io::{self, Write};
use std::path::Path;
use std::time::Duration;

use foreshore_tests::operator::{Input, Operator};
use zenoh::{Config, Wait as _};

fn main() {
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    let arguments: Vec<_> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["operate", endpoint, robot, name, journal, ref inputs @ ..] => {
            operate(Operator::ready(endpoint, robot, name), journal, inputs)
        }
        [
            "operate-with-keys",
            endpoint,
            robot,
            folder,
            journal,
            ref inputs @ ..,
        ] => operate(
            Operator::with_keys(endpoint, robot, Path::new(folder)),
            journal,
            inputs,
        ),
        ["route", endpoint] => route(endpoint),
        _ => panic!(
            "operate ENDPOINT ROBOT NAME JOURNAL.csv INPUT ... | operate-with-keys ENDPOINT ROBOT FOLDER JOURNAL.csv \
             INPUT ... | route ENDPOINT"
        ),
    }
}

fn operate(mut operator: Operator, journal: &str, inputs: &[&str]) -> ! {
    let inputs: Vec<_> = inputs.iter().map(|input| parse(input).unwrap()).collect();
    assert!(!inputs.is_empty(), "nothing to do");
    operator.write_journal(Path::new(journal)).unwrap();
    operator.take_lease();
    say("holds the lease");
    loop {
        for (input, time) in &inputs {
            operator.hold(*input, *time);
        }
    }
}

fn route(endpoint: &str) -> ! {
    let mut config = Config::default();
    for (key, value) in [
        ("mode", "\"router\"".to_owned()),
        ("listen/endpoints", format!("[{endpoint:?}]")),
        ("scouting/multicast/enabled", "false".to_owned()),
    ] {
        config.insert_json5(key, &value).unwrap();
    }
    let _router = zenoh::open(config).wait().unwrap();
    say("routes");
    loop {
        std::thread::park();
    }
}

fn parse(input: &str) -> Option<(Input, Duration)> {
    let mut numbers = input.split(',').map(str::parse::<f32>);
    let mut next = || numbers.next()?.ok();
    let (linear_mps, angular_radps, seconds) = (next()?, next()?, next()?);
    let time = Duration::try_from_secs_f32(seconds).ok()?;
    Some((Input::of(linear_mps, angular_radps), time))
}

fn say(words: &str) {
    let mut out = io::stdout();
    writeln!(out, "{words}").unwrap();
    out.flush().unwrap();
}
