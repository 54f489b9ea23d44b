//! Parser of scripts: a time and an action in each line.

use std::time::Duration;

use protocol::keys::OperatorId;
use protocol::message::{LeaseRequest, MapPose, Setting, TeleopState};

use crate::teleop_client::Intent;
use crate::teleop_input::{DriveKey, InputEvent, PadReading, SpeedStep};

pub const LANGUAGE: &str = "\
A script has one action a line, behind the second at which it happens; `#` begins a comment.
  0.0 lease request             also: release, take-over, consent NAME, refuse NAME
  0.5 press forward             also: back, left, right
  2.0 release forward           also: all
  2.5 speed 3                   1 (slowest) to 5
  3.0 pad 0.5 -0.2              a gamepad's stick, forwards and to the left; pad off
  3.5 focus off                 as if the window lost focus; focus on
  4.0 freeze 1.5                the program stands still for so many seconds
  4.5 dock B                    creeps into the vegetation of docking site B while it drives; dock off
  4.7 goal 4.0 -1.5 90          sends the planner on the vehicle there, metres and degrees; goal off
  5.0 estop
  6.0 await estop 5             waits for a state, at most so many seconds, and shifts what follows;
                                where it does not come, the script ends there
  6.0 reset                     ends the active emergency stop
  7.0 budget 128                kbit/s for tiles; collision-monitor on|off; recording on|off; save-map NAME;
                                set-pose X Y YAW: about where the robot is in its --map, metres and degrees
States that `await` knows, and what the output says of them:
  idle                          \"Nobody drives\"
  held                          \"Standing\": somebody has the lease
  driving                       \"Driving\", also where it is \"limited by the collision monitor\"
  stopping                      \"Stopping\", and why
  estop                         \"Emergency stop\"
  fault                         \"Fault\", and why
  lease                         \"lease held\": this console has it, whatever the vehicle does
At its end all keys are released, and the answer to what was asked for last is waited for (5 s at most).
Options that choose the robot go before it: operator-console --demo rooms --headless drive --script FILE";

/// Limit of a script, bytes: a day with one action a second.
const MAX_BYTES: usize = 4 << 20;
const MAX_TIME_S: f64 = 7.0 * 86_400.0;
const AWAIT: Duration = Duration::from_secs(10);

#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Since the start, without the time spent in `await`.
    pub at: Duration,
    pub line: usize,
    pub action: Action,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    Input(Vec<InputEvent>),
    Intent(Intent),
    /// Letters of a docking site in vegetation.
    Dock(String),
    Reset,
    Freeze(Duration),
    Await(State, Duration),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    Idle,
    Held,
    Driving,
    Stopping,
    EStop,
    Fault,
    /// Whether this console has the lease, in any state of the vehicle.
    Lease,
}

impl State {
    const ALL: [Self; 7] = [
        Self::Idle,
        Self::Held,
        Self::Driving,
        Self::Stopping,
        Self::EStop,
        Self::Fault,
        Self::Lease,
    ];

    pub const fn word(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Held => "held",
            Self::Driving => "driving",
            Self::Stopping => "stopping",
            Self::EStop => "estop",
            Self::Fault => "fault",
            Self::Lease => "lease",
        }
    }

    pub const fn is(self, state: TeleopState) -> bool {
        matches!(
            (self, state),
            (Self::Idle, TeleopState::Idle)
                | (Self::Held, TeleopState::Held)
                | (Self::Driving, TeleopState::Driving)
                | (Self::Stopping, TeleopState::Stopping(_))
                | (Self::EStop, TeleopState::EStop)
                | (Self::Fault, TeleopState::Fault(_))
        )
    }
}

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ScriptError {
    #[error("line {line}: {why}")]
    Line { line: usize, why: String },
    #[error("it is longer than {MAX_BYTES} bytes")]
    TooLong,
}

pub fn parse(text: &str) -> Result<Vec<Step>, ScriptError> {
    if text.len() > MAX_BYTES {
        return Err(ScriptError::TooLong);
    }
    let mut steps: Vec<Step> = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let line_number = index + 1;
        let wrong = |why: String| ScriptError::Line {
            line: line_number,
            why,
        };
        let mut words = line
            .split('#')
            .next()
            .unwrap_or_default()
            .split_whitespace();
        let Some(time) = words.next() else {
            continue;
        };
        let at = time_of(time).map_err(wrong)?;
        if steps.last().is_some_and(|last| at < last.at) {
            return Err(wrong(format!("{time} is earlier than the line before")));
        }
        let words: Vec<_> = words.collect();
        let action = action_of(&words).map_err(wrong)?;
        steps.push(Step {
            at,
            line: line_number,
            action,
        });
    }
    Ok(steps)
}

fn time_of(word: &str) -> Result<Duration, String> {
    let seconds = word.parse::<f64>().ok();
    seconds
        .filter(|seconds| (0.0..=MAX_TIME_S).contains(seconds))
        .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
        .ok_or_else(|| format!("{word:?} is no time: seconds, 0 or more, come first"))
}

fn action_of(words: &[&str]) -> Result<Action, String> {
    Ok(match words {
        ["lease", rest @ ..] => Action::Intent(Intent::Lease(lease_of(rest)?)),
        ["press", key] => Action::Input(vec![InputEvent::Press(key_of(key)?)]),
        ["release", "all"] => Action::Input(DriveKey::ALL.map(InputEvent::Release).to_vec()),
        ["release", key] => Action::Input(vec![InputEvent::Release(key_of(key)?)]),
        ["speed", number] => {
            let step = number.parse().ok().and_then(SpeedStep::new);
            let step = step.ok_or_else(|| format!("{number:?} is no speed: 1 to 5"))?;
            Action::Intent(Intent::Step(step))
        }
        ["pad", "off"] => Action::Input(vec![InputEvent::PadGone]),
        ["pad", forward, left] => Action::Input(vec![InputEvent::Pad(PadReading {
            sideways: 0.0,
            is_deadman_held: true,
            forward: deflection_of(forward)?,
            left: deflection_of(left)?,
        })]),
        ["focus", switch] => Action::Input(vec![InputEvent::Focus(switch_of(switch)?)]),
        ["freeze", time] => Action::Freeze(time_of(time)?),
        ["dock", "off"] => Action::Intent(Intent::Dock(None)),
        ["dock", site] => Action::Dock((*site).to_owned()),
        ["goal", "off"] => Action::Intent(Intent::Goal(None)),
        ["goal", x, y, yaw] => Action::Intent(Intent::Goal(Some(pose_of([x, y, yaw])?))),
        ["estop"] => Action::Intent(Intent::EStop),
        ["reset"] => Action::Reset,
        ["await", state] => Action::Await(state_of(state)?, AWAIT),
        ["await", state, time] => Action::Await(state_of(state)?, time_of(time)?),
        ["budget", kbps] => {
            let kbps = kbps
                .parse()
                .map_err(|_why| format!("{kbps:?} is no number of kbit/s"))?;
            Action::Intent(Intent::Set(Setting::BudgetKbps(kbps)))
        }
        ["collision-monitor", switch] => {
            Action::Intent(Intent::Set(Setting::CollisionMonitor(switch_of(switch)?)))
        }
        ["recording", switch] => {
            Action::Intent(Intent::Set(Setting::Recording(switch_of(switch)?)))
        }
        ["save-map", name] => Action::Intent(Intent::Set(Setting::SaveMap((*name).to_owned()))),
        ["set-pose", x, y, yaw] => {
            Action::Intent(Intent::Set(Setting::Locate(pose_of([x, y, yaw])?)))
        }
        [] => return Err("there is no action behind the time".to_owned()),
        words => {
            return Err(format!(
                "{:?} is no action; `operator-console drive --help` lists them",
                words.join(" ")
            ));
        }
    })
}

/// Metres and degrees.
fn pose_of([x, y, yaw]: [&str; 3]) -> Result<MapPose, String> {
    Ok(MapPose {
        x_mm: thousandths(x, 1.0)?,
        y_mm: thousandths(y, 1.0)?,
        yaw_mrad: thousandths(yaw, std::f64::consts::PI / 180.0)?,
    })
}

fn lease_of(words: &[&str]) -> Result<LeaseRequest, String> {
    let name = |name: &str| {
        name.parse::<OperatorId>()
            .map_err(|why| format!("{name:?} is no operator: {why}"))
    };
    Ok(match words {
        ["request"] => LeaseRequest::Request,
        ["release"] => LeaseRequest::Release,
        ["take-over"] => LeaseRequest::TakeOver,
        ["consent", operator] => LeaseRequest::HandOver(name(operator)?),
        ["refuse", operator] => LeaseRequest::Refuse(name(operator)?),
        words => {
            return Err(format!(
                "lease {:?}: it is request, release, take-over, consent NAME or refuse NAME",
                words.join(" ")
            ));
        }
    })
}

fn key_of(word: &str) -> Result<DriveKey, String> {
    Ok(match word {
        "forward" => DriveKey::W,
        "back" => DriveKey::S,
        "left" => DriveKey::A,
        "right" => DriveKey::D,
        "sideways-left" => DriveKey::Q,
        "sideways-right" => DriveKey::E,
        other => {
            return Err(format!(
                "{other:?} is no key: forward, back, left, right, sideways-left or sideways-right"
            ));
        }
    })
}

fn deflection_of(word: &str) -> Result<f32, String> {
    let deflection = word.parse::<f32>().ok();
    deflection
        .filter(|deflection| (-1.0..=1.0).contains(deflection))
        .ok_or_else(|| format!("{word:?} is no deflection: −1 to 1"))
}

fn switch_of(word: &str) -> Result<bool, String> {
    match word {
        "on" => Ok(true),
        "off" => Ok(false),
        other => Err(format!("{other:?}: it is on or off")),
    }
}

/// In thousandths of the unit that is `unit` times that of the number.
fn thousandths(word: &str, unit: f64) -> Result<i32, String> {
    let number = word.parse::<f64>().ok();
    let thousandths = number.map(|number| libm::round(1000.0 * unit * number));
    thousandths
        .filter(|n| n.abs() <= f64::from(i32::MAX))
        .map(|n| n as i32)
        .ok_or_else(|| format!("{word:?} is no length in metres and no angle in degrees"))
}

fn state_of(word: &str) -> Result<State, String> {
    let mut states = State::ALL.into_iter();
    states.find(|state| state.word() == word).ok_or_else(|| {
        format!("{word:?} is no state: idle, held, driving, stopping, estop, fault or lease")
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use protocol::message::{FaultReason, StopReason};

    use super::*;
    use crate::panels::driving::labels;
    use crate::teleop_client::TeleopNotification;

    #[test]
    fn example_in_help_is_a_valid_script() {
        let examples = LANGUAGE.lines().skip(1).filter_map(|line| {
            let example = line.get(..32.min(line.len())).unwrap_or(line).trim();
            example
                .starts_with(|first: char| first.is_ascii_digit())
                .then(|| format!("{example}\n"))
        });
        let examples: String = examples.collect();
        let steps = parse(&examples).unwrap();
        assert_eq!(steps.len(), 13, "{examples}");
        assert_eq!(steps[7].action, Action::Dock("B".to_owned()));
        assert_eq!(steps[1].at, Duration::from_millis(500));
        let press = Action::Input(vec![InputEvent::Press(DriveKey::W)]);
        assert_eq!((steps[1].line, &steps[1].action), (2, &press));
        assert_eq!(
            steps[10].action,
            Action::Await(State::EStop, Duration::from_secs(5))
        );
    }

    #[test]
    fn help_explains_each_state() {
        let begins = |words: String| {
            let begin = words.split([':', ',']).next().unwrap_or_default();
            format!("\"{begin}\"")
        };
        let says = |state| begins(labels::state(state));
        let (lease, _) = labels::note(&TeleopNotification::LeaseGained(4));
        let fault = TeleopState::Fault(FaultReason::Actuator);
        let stopping = TeleopState::Stopping(StopReason::Released);
        for (state, says) in [
            (State::Idle, says(TeleopState::Idle)),
            (State::Held, says(TeleopState::Held)),
            (State::Driving, says(TeleopState::Driving)),
            (State::Stopping, says(stopping)),
            (State::EStop, says(TeleopState::EStop)),
            (State::Fault, says(fault)),
            (State::Lease, begins(lease)),
        ] {
            let word = state.word();
            let begin = format!("  {word} ");
            let line = LANGUAGE.lines().find(|line| line.starts_with(&begin));
            assert!(line.unwrap().contains(&says), "{line:?}: {says}");
            assert_eq!(state_of(word), Ok(state));
        }
    }

    #[test]
    fn comments_and_empty_lines_are_none_of_it() {
        let steps = parse("# a\n\n  1 estop # b\n2 lease consent bert\n").unwrap();
        assert_eq!(steps[0].line, 3);
        let consent = LeaseRequest::HandOver("bert".parse().unwrap());
        assert_eq!(steps[1].action, Action::Intent(Intent::Lease(consent)));
        assert_eq!(parse(""), Ok(Vec::new()));
    }

    #[test]
    fn errors_name_the_line() {
        for (script, says) in [
            ("0 estop\nnow estop", "line 2: \"now\" is no time"),
            ("-1 estop", "line 1: \"-1\" is no time"),
            ("NaN estop", "no time"),
            ("1e300 estop", "no time"),
            ("1 estop\n0.5 estop", "line 2: 0.5 is earlier"),
            ("1", "no action behind the time"),
            ("1 honk", "\"honk\" is no action"),
            ("1 press up", "forward, back, left, right, sideways-left"),
            ("1 speed 6", "1 to 5"),
            ("1 pad 2 0", "−1 to 1"),
            ("1 lease steal", "take-over"),
            ("1 lease consent a/b", "no operator"),
            ("1 collision-monitor maybe", "on or off"),
            ("1 await bliss", "idle, held"),
            ("1 budget lots", "kbit/s"),
        ] {
            let error = parse(script).unwrap_err().to_string();
            assert!(error.contains(says), "{script}: {error}");
        }
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "([0-9.e-]{0,5} ?(press|lease|pad|await|#|estop|freeze)? ?[a-z0-9./-]{0,9}\n?){0,9}") {
            drop(parse(&text));
        }
    }
}
