//! What the operator is to see of driving, as plain data.

use std::time::Duration;

use protocol::keys::OperatorId;
use protocol::message::{Arming, Clamp, Guard, Settings, StopReason, TeleopState, TeleopStatus};
use robot_edge::clock::Monotonic;

use super::gauge::{self, Gauge};
use super::untold::untold;
use super::{figures, words};
use crate::helm::{EStopSight, HelmSight, Lease};
use crate::model::{ConsoleModel, LinkState, Stream};
use crate::panels::rows::Row;
use crate::panels::wording::{age, capitalised};
use crate::teleop_input::SpeedStep;
use crate::theme::Tone;

/// Poses come 20 times a second and more: without one for so long, what is shown is not what is.
const POSE_LATE: Duration = Duration::from_millis(600);
/// A status comes twice a second.
const STATUS_LATE: Duration = Duration::from_millis(1800);
/// A vehicle that is slower than this stands, m/s and rad/s.
const MOVING: f32 = 0.05;

/// What the panel shows.
#[derive(Clone, Debug, PartialEq)]
pub struct DrivingData {
    /// How the vehicle is.
    pub tone: Tone,
    /// In a word or two.
    pub headline: String,
    /// What follows from it, or what to do.
    pub advice: Option<String>,
    /// What the words mean, where that is not plain.
    pub hint: Option<&'static str>,
    /// The emergency stop.
    pub estop: EStopFace,
    /// Who drives, in words.
    pub driver: String,
    /// What can be done about that.
    pub lease: LeaseFace,
    /// What the operator did not expect, lately.
    pub notice: Option<String>,
    /// Somebody asks the operator to hand over.
    pub asks: Option<OperatorId>,
    /// How fast keys drive.
    pub step: SpeedStep,
    /// The vehicle's greatest speed, m/s; 0 where it is not known.
    pub top_speed_mps: f32,
    /// Forwards, and turning.
    pub gauges: Option<[Gauge; 2]>,
    /// Why the two differ.
    pub clamp: Option<String>,
    /// Ages, guard, last stop: each with its tone.
    pub rows: Vec<(Tone, Row)>,
    /// The link, in a few figures.
    pub link: Vec<Row>,
    /// What can be set, as it is.
    pub settings: Option<Settings>,
    /// Commands that the robot refused, by reason.
    pub refused: Vec<Row>,
}

/// How the vehicle is, in words.
pub(super) struct Headline {
    pub(super) tone: Tone,
    pub(super) words: String,
    pub(super) advice: Option<String>,
    pub(super) hint: Option<&'static str>,
}

impl Headline {
    const fn new(tone: Tone, words: String, advice: Option<String>) -> Self {
        Self {
            tone,
            words,
            advice,
            hint: None,
        }
    }
}

/// The big button.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum EStopFace {
    /// To be pressed.
    Ready,
    /// Pressed, and not acknowledged.
    Sending(String),
    /// In force: it can be reset.
    InForce {
        /// Which.
        number: u64,
        /// Whether it would be found after a restart: only then it can be reset.
        is_stored: bool,
    },
    /// The robot does not obey this operator: somebody else must press it.
    Refused(String),
}

/// What can be done about who drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LeaseFace {
    /// Nothing at the moment.
    Quiet,
    /// Nobody drives: this operator could.
    Free,
    /// Somebody else does: they can be asked, or, by a supervisor, replaced.
    Others,
    /// This operator waits.
    Waiting,
    /// This operator drives.
    Mine,
}

impl DrivingData {
    /// The state at `now`; `None` where the robot cannot be driven.
    pub fn new(model: &ConsoleModel, helm: &HelmSight, now: Monotonic) -> Option<Self> {
        let teleop = model.status()?.0.teleop.as_ref()?;
        let silence = silence(model, now);
        let status = &model.status()?.0;
        let headline = match silence {
            Some(silence) => lost(silence, helm),
            None if status.has_ended && teleop.state == TeleopState::Idle => ended(),
            None => heard(teleop, helm, moves(model)),
        };
        // Where nobody drives from here nothing is asked for, whatever moves the vehicle.
        let is_driven = teleop.state != TeleopState::Idle;
        let gauges = model
            .info()
            .map(|_| gauge::gauges(teleop, helm.limits, is_driven));
        let gauges = gauges.filter(|_| silence.is_none());
        let is_held_back = gauges.iter().flatten().any(Gauge::is_held_back);
        let clamp = teleop.clamp.filter(|_| is_held_back);
        Some(Self {
            tone: headline.tone,
            headline: headline.words,
            advice: headline.advice,
            hint: headline.hint,
            estop: estop_face(teleop, helm),
            driver: driver(teleop, helm, silence.is_some()),
            lease: lease_face(teleop, helm, silence.is_some() || status.has_ended),
            asks: teleop
                .lease
                .waiting
                .clone()
                .filter(|_| helm.lease.held().is_some()),
            notice: helm
                .notice
                .as_ref()
                .map(|note| capitalised(&words::note(note).0)),
            step: helm.step,
            top_speed_mps: helm.limits[0],
            gauges,
            clamp: clamp
                .filter(|clamp| *clamp != Clamp::Stop)
                .map(|clamp| format!("Held back by {}", words::clamp(clamp))),
            rows: figures::rows(model, teleop, helm, silence),
            link: figures::link_rows(model, now),
            settings: Some(teleop.settings).filter(|_| silence.is_none()),
            refused: figures::refused_rows(teleop),
        })
    }
}

impl DrivingData {
    /// Whether nothing changes but ages that nobody waits for.
    pub const fn is_at_rest(&self) -> bool {
        matches!(self.lease, LeaseFace::Free | LeaseFace::Others)
            && matches!(self.estop, EStopFace::Ready | EStopFace::InForce { .. })
    }
}

/// How long nothing has been heard that tells how the vehicle is, where that is too long.
fn silence(model: &ConsoleModel, now: Monotonic) -> Option<Duration> {
    let quality = model.link_quality();
    let late = |stream, longest| quality.age(stream, now).filter(|age| *age > longest);
    let is_silent = model.connection().state(now) != LinkState::Live;
    late(Stream::Pose, POSE_LATE)
        .or_else(|| late(Stream::Status, STATUS_LATE))
        .or_else(|| model.connection().age(now).filter(|_| is_silent))
}

/// A link that is lost is no pause: nobody here knows what the vehicle does.
fn lost(silence: Duration, helm: &HelmSight) -> Headline {
    let advice = match helm.lease {
        Lease::Held(_) => {
            "It stops by itself when commands stay away, and soon gives up the lease. When it is heard again, let go of all keys, and press Drive where nobody drives."
        }
        Lease::None | Lease::Waiting { .. } => "What it does now is not known here.",
    };
    let words = format!("Link lost for {}", age(silence));
    Headline::new(Tone::Warning, words, Some(advice.to_owned()))
}

/// Where it was and how fast it went are the last that there is.
fn ended() -> Headline {
    let advice = "Nothing new will come of this robot";
    let words = "Its data has ended".to_owned();
    Headline::new(Tone::Waiting, words, Some(advice.to_owned()))
}

/// The speed of a vehicle that moves, forwards, m/s.
fn moves(model: &ConsoleModel) -> Option<f32> {
    let (pose, _) = model.vehicle().pose()?;
    let is_moving = pose.speed_mps.abs() >= MOVING || pose.turn_rate_radps.abs() >= MOVING;
    is_moving.then_some(pose.speed_mps)
}

fn heard(teleop: &TeleopStatus, helm: &HelmSight, moves: Option<f32>) -> Headline {
    if let Some(untold) = untold(teleop, moves) {
        return untold;
    }
    let is_mine = helm.lease.held().is_some();
    let headline = match teleop.state {
        TeleopState::Stopping(_) => "Stopping".to_owned(),
        TeleopState::Fault(_) => "Fault".to_owned(),
        TeleopState::Idle | TeleopState::Held if teleop.is_drifting => "Drifting".to_owned(),
        TeleopState::Idle => "Standing".to_owned(),
        TeleopState::SafeBoot | TeleopState::Held | TeleopState::Driving | TeleopState::EStop => {
            words::state(teleop.state)
        }
    };
    let tone = match teleop.state {
        TeleopState::Driving => Tone::Good,
        TeleopState::Idle | TeleopState::Held if !teleop.is_drifting => Tone::Waiting,
        TeleopState::Stopping(StopReason::Released) | TeleopState::SafeBoot => Tone::Waiting,
        TeleopState::Idle
        | TeleopState::Held
        | TeleopState::Stopping(_)
        | TeleopState::EStop
        | TeleopState::Fault(_) => Tone::Warning,
    };
    let advice = match (teleop.state, helm.ignored) {
        (TeleopState::Stopping(why), _) => Some(capitalised(words::stop(why))),
        (TeleopState::Fault(_), _) => Some(format!(
            "{}. Reset it at the vehicle.",
            words::state(teleop.state)
        )),
        (TeleopState::EStop, _) => Some("Its motors stand until it is reset.".to_owned()),
        (_, Some(why)) if is_mine => {
            let why = words::ignored(why, teleop.last_stop);
            Some(format!("Let go of all keys: {why}"))
        },
        // Whatever is pressed: without this it would be for the operator to guess.
        (TeleopState::Held, None)
            if is_mine && matches!(teleop.guard, Guard::Stale | Guard::Silent) =>
        {
            Some("The guard sees nothing new, so nothing moves: the robot's sensors or its machine are late. When it sees, press anew".to_owned())
        }
        (TeleopState::Held, None)
            if is_mine && !helm.wish.is_neutral() && teleop.arming == Arming::Locked =>
        {
            Some("Let go of all keys, then press anew".to_owned())
        }
        (TeleopState::Held | TeleopState::Driving, _) if is_mine && !helm.is_ready => {
            Some("The keys go to a text or to another window. Click into the map to drive".to_owned())
        }
        (TeleopState::Idle | TeleopState::Held, _) if teleop.is_drifting => {
            Some("No thrust: it coasts, and wind and current move it".to_owned())
        }
        (TeleopState::Held | TeleopState::Driving, _) if is_mine => {
            Some("W A S D or arrows drive while held".to_owned())
        }
        (
            TeleopState::SafeBoot | TeleopState::Idle | TeleopState::Held | TeleopState::Driving,
            _,
        ) => None,
    };
    Headline::new(tone, headline, advice)
}

impl EStopFace {
    /// Of a stop that is on its way, whatever is known of the robot.
    pub fn underway(helm: &HelmSight) -> Option<Self> {
        let words = match helm.estop {
            EStopSight::Sending(since) => format!("Not acknowledged for {}", age(since)),
            EStopSight::Unsendable(since) => {
                format!("Not sent for {}: no robot is heard", age(since))
            }
            EStopSight::Quiet | EStopSight::Refused(_) => return None,
        };
        Some(Self::Sending(words))
    }
}

fn estop_face(teleop: &TeleopStatus, helm: &HelmSight) -> EStopFace {
    if let Some(underway) = EStopFace::underway(helm) {
        return underway;
    }
    match (helm.estop, teleop.estop) {
        (_, Some(estop)) => EStopFace::InForce {
            number: estop.number,
            is_stored: estop.is_stored,
        },
        (EStopSight::Refused(why), None) => EStopFace::Refused(words::refusal(why)),
        (EStopSight::Quiet | EStopSight::Sending(_) | EStopSight::Unsendable(_), None) => {
            EStopFace::Ready
        }
    }
}

fn driver(teleop: &TeleopStatus, helm: &HelmSight, is_lost: bool) -> String {
    let lease = &teleop.lease;
    match (&helm.lease, &lease.holder, &lease.next) {
        (Lease::Held(_), ..) if is_lost => format!("You drove ({})", helm.operator),
        (Lease::Held(_), ..) => format!("You drive ({})", helm.operator),
        (_, Some(holder), _) if *holder == helm.operator => {
            format!("{holder} drives, from another console")
        }
        (_, Some(holder), _) => format!("{holder} drives"),
        (_, None, Some(next)) => format!("Nobody drives; {next} is next"),
        (_, None, None) => "Nobody drives".to_owned(),
    }
}

fn lease_face(teleop: &TeleopStatus, helm: &HelmSight, is_lost: bool) -> LeaseFace {
    match helm.lease {
        Lease::Held(_) => LeaseFace::Mine,
        Lease::Waiting { .. } => LeaseFace::Waiting,
        Lease::None if is_lost || helm.is_asking => LeaseFace::Quiet,
        Lease::None if teleop.lease.holder.is_some() => LeaseFace::Others,
        Lease::None => LeaseFace::Free,
    }
}
