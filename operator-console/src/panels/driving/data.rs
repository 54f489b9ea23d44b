//! What the operator is to see of driving, as plain data.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::keys::OperatorId;
use protocol::message::{LeaseStatus, Settings, TeleopState, TeleopStatus};

use super::gauge::{self, Gauge};
use super::headline::{
    VehicleState, data_ended, data_ended_silent, link_lost, live, status_pending,
};
use super::limit_reason::limit_reason;
use super::notice::notice;
use super::strictest_limit::strictest_limit;
use super::{figures, labels};
use crate::model::{ConsoleModel, LinkState, Stream};
use crate::panels::formatting::age;
use crate::panels::rows::Row;
use crate::teleop_client::{EStopState, Lease, TeleopClientState};
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
    pub estop: EStopButton,
    /// Who drives, in words.
    pub driver: String,
    /// What can be done about that.
    pub lease: LeaseButtons,
    /// Whether who sits here may only watch.
    pub is_observer: bool,
    /// Whether who sits here is proven to have no right to take over.
    pub cannot_take_over: bool,
    /// What the operator did not expect, lately.
    pub notice: Option<String>,
    /// Somebody asks the operator to hand over.
    pub handover_request: Option<OperatorId>,
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
pub enum EStopButton {
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
    ReadOnly,
    /// The robot does not obey this operator: somebody else must press it.
    Refused(String),
}

/// What can be done about who drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LeaseButtons {
    /// Nothing at the moment.
    Quiet,
    /// Nobody drives: this operator could.
    Free,
    /// Somebody else does: they can be asked, or, by a supervisor, replaced.
    HeldByOther,
    /// This operator waits.
    Waiting,
    /// This operator drives.
    Held,
    /// Who sits here only watches.
    ReadOnly,
}

impl DrivingData {
    /// The state at `now`; `None` where the robot cannot be driven.
    pub fn new(
        model: &ConsoleModel,
        teleop_client: &TeleopClientState,
        now: Monotonic,
    ) -> Option<Self> {
        let teleop = model.status()?.0.teleop.as_ref()?;
        let (status, status_at) = model.status()?;
        // Whoever is live again is not lost, but what was told of it is of its last run.
        let is_live = model.connection().state(now) == LinkState::Live;
        let is_status_pending = is_live && model.awaits_status();
        let silence = if is_status_pending {
            Some(now.since(*status_at))
        } else {
            silence(model, now)
        };
        let headline = match silence {
            Some(_) if is_status_pending => status_pending(),
            Some(silence) if model.is_silence_expected() => data_ended_silent(silence),
            Some(silence) => link_lost(silence, teleop_client),
            None if status.has_ended && teleop.state == TeleopState::Idle => data_ended(),
            None => live(teleop, teleop_client, VehicleState::of(model, now)),
        };
        // Where nobody drives from here nothing is asked for, whatever moves the vehicle.
        let is_driven = teleop.state != TeleopState::Idle;
        let gauges = model
            .info()
            .map(|_| gauge::gauges(teleop, teleop_client.limits, is_driven));
        let gauges = gauges.filter(|_| silence.is_none());
        let shown = gauges.as_ref();
        let strictest_limit = strictest_limit(teleop, model.recent_monitor_states());
        let clamp = shown
            .and_then(|gauges| limit_reason(teleop, strictest_limit, gauges, model.is_stuck()));
        Some(Self {
            tone: headline.tone,
            headline: headline.words,
            advice: headline.advice,
            hint: headline.hint,
            estop: estop_button(teleop, teleop_client),
            driver: driver(teleop, teleop_client, silence.is_some()),
            lease: lease_buttons(teleop, teleop_client, silence.is_some() || status.has_ended),
            is_observer: teleop_client.is_observer(),
            cannot_take_over: teleop_client.cannot_take_over(),
            handover_request: teleop
                .lease
                .waiting
                .clone()
                .filter(|_| teleop_client.lease.held().is_some()),
            notice: notice(teleop_client, model.events().iter().map(|(event, _)| event)),
            step: teleop_client.step,
            top_speed_mps: teleop_client.limits[0],
            gauges,
            clamp,
            rows: figures::rows(model, teleop, teleop_client, silence),
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
            LeaseButtons::Free | LeaseButtons::HeldByOther | LeaseButtons::ReadOnly
        ) && matches!(
            self.estop,
            EStopButton::Ready | EStopButton::ReadOnly | EStopButton::InForce { .. }
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

impl EStopButton {
    /// Of a stop that is on its way, whatever is known of the robot.
    pub fn underway(teleop_client: &TeleopClientState) -> Option<Self> {
        let words = match teleop_client.estop {
            EStopState::Sending(since) => format!("Not acknowledged for {}", age(since)),
            EStopState::Unsendable(since) => {
                format!("Not sent for {}: no robot connected", age(since))
            }
            EStopState::Quiet | EStopState::Refused(_) => return None,
        };
        Some(Self::Sending(words))
    }
}

fn estop_button(teleop: &TeleopStatus, teleop_client: &TeleopClientState) -> EStopButton {
    if let Some(underway) = EStopButton::underway(teleop_client) {
        return underway;
    }
    match (teleop_client.estop, teleop.estop) {
        (_, Some(estop)) => EStopButton::InForce {
            number: estop.number,
            is_stored: estop.is_stored,
        },
        _ if teleop_client.is_observer() => EStopButton::ReadOnly,
        (EStopState::Refused(why), None) => EStopButton::Refused(labels::refusal(why)),
        (EStopState::Quiet | EStopState::Sending(_) | EStopState::Unsendable(_), None) => {
            EStopButton::Ready
        }
    }
}

fn driver(teleop: &TeleopStatus, teleop_client: &TeleopClientState, is_lost: bool) -> String {
    let lease = &teleop.lease;
    let is_mine = teleop_client.lease.held().is_some() || is_own_grant(lease, teleop_client);
    match (&lease.holder, &lease.next) {
        _ if is_mine && is_lost => format!("You drove ({})", teleop_client.operator),
        _ if is_mine => format!("You drive ({})", teleop_client.operator),
        // Its answer may come behind a status that tells of the grant already: whose it is is not known yet.
        (Some(holder), _) if *holder == teleop_client.operator && !teleop_client.is_asking => {
            format!("{holder} drives, from another console")
        }
        (Some(holder), _) => format!("{holder} drives"),
        (None, Some(next)) => format!("Nobody drives; {next} is next"),
        (None, None) => "Nobody drives".to_owned(),
    }
}

/// Whether the robot tells of a grant that is this console's and not another one's of the same name: the one that it
/// has given back or lost since that was told, or the one that it waits for.
fn is_own_grant(lease: &LeaseStatus, teleop_client: &TeleopClientState) -> bool {
    let is_granted = match teleop_client.lease {
        Lease::Waiting { after, .. } => lease.epoch > after,
        Lease::None | Lease::Held(_) => teleop_client.last_grant == Some(lease.epoch),
    };
    is_granted && lease.holder.as_ref() == Some(&teleop_client.operator)
}

fn lease_buttons(
    teleop: &TeleopStatus,
    teleop_client: &TeleopClientState,
    is_lost: bool,
) -> LeaseButtons {
    match teleop_client.lease {
        Lease::Held(_) => LeaseButtons::Held,
        Lease::Waiting { .. } => LeaseButtons::Waiting,
        Lease::None if teleop_client.is_observer() => LeaseButtons::ReadOnly,
        Lease::None
            if is_lost || teleop_client.is_asking || is_own_grant(&teleop.lease, teleop_client) =>
        {
            LeaseButtons::Quiet
        }
        Lease::None if teleop.lease.holder.is_some() => LeaseButtons::HeldByOther,
        Lease::None => LeaseButtons::Free,
    }
}
