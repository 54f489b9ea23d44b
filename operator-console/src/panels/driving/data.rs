//! What the operator is to see of driving, as plain data.

use std::time::Duration;

use protocol::keys::OperatorId;
use protocol::message::{LeaseStatus, Settings, TeleopState, TeleopStatus};
use robot_edge::clock::Monotonic;

use super::gauge::{self, Gauge};
use super::headline::{Body, awaited, ended, gone, heard, lost};
use super::held_back::held_back;
use super::notice::notice;
use super::tightest::tightest;
use super::{figures, words};
use crate::helm::{EStopSight, HelmSight, Lease};
use crate::model::{ConsoleModel, LinkState, Stream};
use crate::panels::rows::Row;
use crate::panels::wording::age;
use crate::teleop_input::SpeedStep;
use crate::theme::Tone;

/// Poses come 20 times a second and more: without one for so long, what is shown is not what is.
const POSE_LATE: Duration = Duration::from_millis(600);
/// A status comes twice a second.
const STATUS_LATE: Duration = Duration::from_millis(1800);

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
    /// Whether who sits here may only watch.
    pub only_watches: bool,
    /// Whether who sits here is proven to have no right to take over.
    pub never_takes_over: bool,
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
    /// Not for who sits here: they only watch.
    Watching,
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
    /// Who sits here only watches.
    Watching,
}

impl DrivingData {
    /// The state at `now`; `None` where the robot cannot be driven.
    pub fn new(model: &ConsoleModel, helm: &HelmSight, now: Monotonic) -> Option<Self> {
        let teleop = model.status()?.0.teleop.as_ref()?;
        let (status, told_at) = model.status()?;
        // Whoever is live again is not lost, but what was told of it is of its last run.
        let is_live = model.connection().state(now) == LinkState::Live;
        let is_awaited = is_live && model.awaits_status();
        let silence = if is_awaited {
            Some(now.since(*told_at))
        } else {
            silence(model, now)
        };
        let headline = match silence {
            Some(_) if is_awaited => awaited(),
            Some(silence) if model.may_fall_silent() => gone(silence),
            Some(silence) => lost(silence, helm),
            None if status.has_ended && teleop.state == TeleopState::Idle => ended(),
            None => heard(teleop, helm, Body::of(model, now)),
        };
        // Where nobody drives from here nothing is asked for, whatever moves the vehicle.
        let is_driven = teleop.state != TeleopState::Idle;
        let gauges = model
            .info()
            .map(|_| gauge::gauges(teleop, helm.limits, is_driven));
        let gauges = gauges.filter(|_| silence.is_none());
        let shown = gauges.as_ref();
        let tightest = tightest(teleop, model.guard_lately());
        let clamp = shown.and_then(|gauges| held_back(teleop, tightest, gauges, model.is_stuck()));
        Some(Self {
            tone: headline.tone,
            headline: headline.words,
            advice: headline.advice,
            hint: headline.hint,
            estop: estop_face(teleop, helm),
            driver: driver(teleop, helm, silence.is_some()),
            lease: lease_face(teleop, helm, silence.is_some() || status.has_ended),
            only_watches: helm.only_watches(),
            never_takes_over: helm.never_takes_over(),
            asks: teleop
                .lease
                .waiting
                .clone()
                .filter(|_| helm.lease.held().is_some()),
            notice: notice(helm, model.events().iter().map(|(event, _)| event)),
            step: helm.step,
            top_speed_mps: helm.limits[0],
            gauges,
            clamp,
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
        matches!(
            self.lease,
            LeaseFace::Free | LeaseFace::Others | LeaseFace::Watching
        ) && matches!(
            self.estop,
            EStopFace::Ready | EStopFace::Watching | EStopFace::InForce { .. }
        )
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
        _ if helm.only_watches() => EStopFace::Watching,
        (EStopSight::Refused(why), None) => EStopFace::Refused(words::refusal(why)),
        (EStopSight::Quiet | EStopSight::Sending(_) | EStopSight::Unsendable(_), None) => {
            EStopFace::Ready
        }
    }
}

fn driver(teleop: &TeleopStatus, helm: &HelmSight, is_lost: bool) -> String {
    let lease = &teleop.lease;
    let is_mine = helm.lease.held().is_some() || is_own(lease, helm);
    match (&lease.holder, &lease.next) {
        _ if is_mine && is_lost => format!("You drove ({})", helm.operator),
        _ if is_mine => format!("You drive ({})", helm.operator),
        // Its answer may come behind a status that tells of the grant already: whose it is is not known yet.
        (Some(holder), _) if *holder == helm.operator && !helm.is_asking => {
            format!("{holder} drives, from another console")
        }
        (Some(holder), _) => format!("{holder} drives"),
        (None, Some(next)) => format!("Nobody drives; {next} is next"),
        (None, None) => "Nobody drives".to_owned(),
    }
}

/// Whether the robot tells of a grant that is this console's and not another one's of the same name: the one that it
/// has given back or lost since that was told, or the one that it waits for.
fn is_own(lease: &LeaseStatus, helm: &HelmSight) -> bool {
    let is_granted = match helm.lease {
        Lease::Waiting { after, .. } => lease.epoch > after,
        Lease::None | Lease::Held(_) => helm.last_grant == Some(lease.epoch),
    };
    is_granted && lease.holder.as_ref() == Some(&helm.operator)
}

fn lease_face(teleop: &TeleopStatus, helm: &HelmSight, is_lost: bool) -> LeaseFace {
    match helm.lease {
        Lease::Held(_) => LeaseFace::Mine,
        Lease::Waiting { .. } => LeaseFace::Waiting,
        Lease::None if helm.only_watches() => LeaseFace::Watching,
        Lease::None if is_lost || helm.is_asking || is_own(&teleop.lease, helm) => LeaseFace::Quiet,
        Lease::None if teleop.lease.holder.is_some() => LeaseFace::Others,
        Lease::None => LeaseFace::Free,
    }
}
