//! Contents of the driving panel as plain data.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::keys::OperatorId;
use protocol::message::{
    Arming, BarrierKind, Clamp, CollisionMonitorState, Event, LeaseStatus, MapPose, Settings,
    StopReason, TeleopState, TeleopStatus,
};
use protocol::shores::site_letters;

use super::labels::{self, opposing_keys};
use super::limits::{
    Gauge, gauges, is_stopped_by_monitor, limit_reason, monitor_text, strictest_limit,
};
use crate::map_view::Ahead;
use crate::model::{ConsoleModel, LinkState, StopBeforeEStop, Stream};
use crate::panels::connection::round_trip;
use crate::panels::formatting::{age, capitalised, count};
use crate::panels::rows::{Row, row};
use crate::teleop_client::{EStopState, Lease, TeleopClientState, TeleopNotification};
use crate::teleop_input::SpeedStep;
use crate::theme::Tone;

/// Status comes at 2 Hz.
const STATUS_LATE: Duration = Duration::from_millis(1800);
/// Commands of this age are shown as a warning.
const OLD_MS: u32 = 200;
const AGE_LIMIT: &str = "Age limit";
const MONITOR: &str = "Monitor";
const OBSTACLE: &str = "Obstacle";
const LAST_OBSERVED: &str = "Last observed";

#[derive(Clone, Debug, PartialEq)]
pub struct DrivingData {
    pub tone: Tone,
    pub headline: String,
    pub advice: Option<String>,
    pub hint: Option<&'static str>,
    pub estop: EStopButton,
    pub driver: String,
    /// What lies straight ahead on the map, and whether that is an obstacle.
    pub ahead: Option<(Tone, String)>,
    pub lease: LeaseButtons,
    pub is_observer: bool,
    pub cannot_take_over: bool,
    pub notice: Option<String>,
    pub handover_request: Option<OperatorId>,
    pub step: SpeedStep,
    /// m/s; 0 if unknown.
    pub top_speed_mps: f32,
    pub gauges: Option<Vec<Gauge>>,
    pub clamp: Option<String>,
    pub rows: Vec<(Tone, Row)>,
    pub link: Vec<Row>,
    pub settings: Option<Settings>,
    pub refused: Vec<Row>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum EStopButton {
    Ready,
    /// Pressed, not acknowledged yet.
    Sending(String),
    InForce {
        number: u64,
        /// Whether the stop survives a restart of the robot. Only then it can be reset.
        is_stored: bool,
    },
    ReadOnly,
    Refused(String),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LeaseButtons {
    /// None, while a request is under way or the link is lost.
    Quiet,
    Free,
    HeldByOther,
    Waiting,
    Held,
    ReadOnly,
}

impl DrivingData {
    /// `None` if the robot cannot be driven.
    pub fn new(
        model: &ConsoleModel,
        teleop_client: &TeleopClientState,
        now: Monotonic,
    ) -> Option<Self> {
        let (status, status_at) = model.status()?;
        let teleop = status.teleop.as_ref()?;
        // After a restart the link is live, but the status is of the previous run.
        let is_live = model.connection().state(now) == LinkState::Live;
        let silence = if is_live && model.awaits_status() {
            Some(now.since(*status_at))
        } else {
            silence(model, now)
        };
        let headline = labels::headline(model, teleop, teleop_client, silence, now);
        let is_driven = teleop.state != TeleopState::Idle;
        let gauges = model
            .info()
            .map(|_| gauges(teleop, teleop_client.limits, is_driven));
        let gauges = gauges.filter(|_| silence.is_none());
        let shown = gauges.as_ref();
        let strictest_limit = strictest_limit(teleop, model.recent_monitor_states());
        let clamp = shown
            .and_then(|gauges| limit_reason(teleop, strictest_limit, gauges, model.is_stuck()));
        let events = model.events().iter().map(|(event, _)| event);
        Some(Self {
            tone: headline.tone,
            headline: headline.words,
            advice: headline.advice,
            hint: headline.hint,
            estop: estop_button(teleop, teleop_client),
            driver: driver(
                teleop,
                teleop_client,
                silence.is_some(),
                headline.without_driver.as_deref(),
            ),
            ahead: Ahead::new(model)
                .filter(|_| silence.is_none())
                .map(|ahead| (ahead_tone(ahead), ahead.text())),
            lease: lease_buttons(teleop, teleop_client, silence.is_some() || status.has_ended),
            is_observer: teleop_client.is_observer(),
            cannot_take_over: teleop_client.cannot_take_over(),
            handover_request: teleop
                .lease
                .waiting
                .clone()
                .filter(|_| teleop_client.lease.held().is_some()),
            notice: notice(teleop_client, events),
            step: teleop_client.step,
            top_speed_mps: teleop_client.limits[0],
            gauges,
            clamp,
            rows: rows(model, teleop, teleop_client, silence),
            link: link_rows(model, now),
            settings: Some(teleop.settings).filter(|_| silence.is_none()),
            refused: refused_rows(teleop),
        })
    }

    /// Whether nothing but ages changes, so that the window needs fewer repaints.
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

const fn ahead_tone(ahead: Ahead) -> Tone {
    if ahead.obstacle.is_some() {
        Tone::Warning
    } else {
        Tone::Waiting
    }
}

fn silence(model: &ConsoleModel, now: Monotonic) -> Option<Duration> {
    let quality = model.link_quality();
    let late = |stream, longest| quality.age(stream, now).filter(|age| *age > longest);
    let is_silent = model.connection().state(now) != LinkState::Live;
    late(Stream::Pose, quality.pose_late())
        .or_else(|| late(Stream::Status, STATUS_LATE))
        .or_else(|| model.connection().age(now).filter(|_| is_silent))
}

impl EStopButton {
    /// The button while a stop is being sent, also without a connected robot.
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
        _ => EStopButton::Ready,
    }
}

fn driver(
    teleop: &TeleopStatus,
    teleop_client: &TeleopClientState,
    is_lost: bool,
    without_driver: Option<&str>,
) -> String {
    let lease = &teleop.lease;
    let nobody = without_driver.unwrap_or("Nobody drives");
    let is_mine = teleop_client.lease.held().is_some() || is_own_grant(lease, teleop_client);
    match (&lease.holder, &lease.next) {
        _ if is_mine && is_lost => format!("You drove ({})", teleop_client.operator),
        _ if is_mine => format!("You drive ({})", teleop_client.operator),
        // While a request is pending, the status may arrive before the answer: the grant may be this console's.
        (Some(holder), _) if *holder == teleop_client.operator && !teleop_client.is_asking => {
            format!("{holder} drives, from another console")
        }
        (Some(holder), _) => format!("{holder} drives"),
        (None, Some(next)) => format!("{nobody}; {next} is next"),
        (None, None) => nobody.to_owned(),
    }
}

/// Whether the reported grant is this console's, and not that of another console with the same operator name.
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

fn rows(
    model: &ConsoleModel,
    teleop: &TeleopStatus,
    teleop_client: &TeleopClientState,
    silence: Option<Duration>,
) -> Vec<(Tone, Row)> {
    let mut rows = Vec::new();
    if let Some(silence) = silence {
        let words = format!("as of {} ago", age(silence));
        rows.push((Tone::Warning, row("All below", words)));
    }
    let old = |age_ms: u32| match age_ms {
        0..OLD_MS => Tone::Good,
        OLD_MS.. => Tone::Warning,
    };
    // Without commands they have no age, and it limits nothing.
    if let Some(now_ms) = teleop.age_ms {
        let (tone, words) = match teleop.peak_age_ms {
            Some(greatest_ms) if now_ms <= greatest_ms => {
                let words = format!("{now_ms} ms, at most {greatest_ms} ms");
                (old(greatest_ms), words)
            }
            Some(_) | None => (old(now_ms), format!("{now_ms} ms")),
        };
        rows.push((tone, row("Command age", words)));
        let allowed = format!("{:.2} m/s", teleop.speed_allowed_mps);
        let tone = if teleop.clamp == Some(Clamp::Age) {
            Tone::Warning
        } else {
            Tone::Good
        };
        rows.push((tone, row(AGE_LIMIT, allowed)));
    }
    let (tone, words) = monitor_text(
        teleop,
        strictest_limit(teleop, model.recent_monitor_states()),
        teleop_client.limits,
    );
    rows.push((tone, row(MONITOR, words)));
    if teleop_client.lease.held().is_some() {
        let (tone, barrier) = obstacle_row(model);
        rows.push((tone, barrier));
        if matches!(
            teleop.collision_monitor,
            CollisionMonitorState::On(_) | CollisionMonitorState::UnknownSpace(_)
        ) {
            rows.push((Tone::Good, coverage_row(teleop)));
        }
    }
    let events = model.events().iter().map(|(event, _)| event);
    if let Some(docking) = teleop.docking {
        let words = format!(
            "{}: pushes into {} vegetation",
            site_letters(docking.site),
            docking.vegetation.name()
        );
        rows.push((Tone::Warning, row("Docking", words)));
    }
    if let Some(hold) = teleop.motor_hold {
        rows.push((Tone::Warning, row("Motors", hold.to_string())));
    }
    match (teleop.goal.running, teleop.goal.last_end) {
        (Some(MapPose { x_mm, y_mm, .. }), _) => {
            let [x_m, y_m] = [x_mm, y_mm].map(|along_mm| f64::from(along_mm) / 1000.0);
            let is_own = teleop_client.goal.is_some();
            let end = if is_own { "; Esc ends it" } else { "" };
            let text = format!("{x_m:.1}, {y_m:.1}: a planner drives{end}");
            rows.push((Tone::Good, row("Goal", text)));
        }
        (None, Some(why)) => rows.push((Tone::Waiting, row("Goal", format!("ended: {why}")))),
        (None, None) => {}
    }
    if let Some((tone, stop)) = last_stop(teleop, model.stop_before_estop(), events) {
        rows.push((tone, row("Last stop", stop)));
    }
    if teleop_client.lease.held().is_some() {
        let (tone, words) = key_text(teleop, teleop_client);
        rows.push((tone, row("Keys", words)));
    }
    let stops = teleop.counters.involuntary_stops;
    if stops > 0 {
        rows.push((Tone::Warning, row("Involuntary stops", count(stops))));
    }
    rows
}

fn obstacle_row(model: &ConsoleModel) -> (Tone, Row) {
    let (tone, words) = match model.barrier().map(|barrier| barrier.kind) {
        None => (Tone::Waiting, "–"),
        Some(BarrierKind::Detected) => (Tone::Warning, "detected now (ringed)"),
        Some(BarrierKind::Shallow) => (Tone::Warning, "too shallow (ringed)"),
        Some(BarrierKind::Mapped) => (Tone::Warning, "on the map (ringed)"),
        Some(BarrierKind::Unknown) => (Tone::Warning, "unknown ground (ringed)"),
        Some(BarrierKind::NoReturn) => (Tone::Warning, "no echo (ringed)"),
        Some(BarrierKind::Contact) => (Tone::Warning, "touched (ringed)"),
        Some(BarrierKind::Vegetation) => (Tone::Warning, "vegetation of the site (ringed)"),
    };
    (tone, row(OBSTACLE, words))
}

/// Age of the oldest observation of the ground on each side of the vehicle.
fn coverage_row(teleop: &TeleopStatus) -> Row {
    let words: Vec<_> = ["ahead", "left", "behind", "right"]
        .into_iter()
        .zip(teleop.ground_age_ms)
        .map(|(side, ground_age_ms)| match ground_age_ms {
            None => format!("{side} never"),
            Some(..1000) => format!("{side} now"),
            Some(ms) => format!("{side} {} s", ms / 1000),
        })
        .collect();
    row(LAST_OBSERVED, words.join(", "))
}

pub(super) fn hint(name: &str) -> Option<&'static str> {
    match name {
        AGE_LIMIT => Some(
            "The older the commands, the lower the speed limit: the vehicle travels only a short way on old \
             commands.",
        ),
        MONITOR => Some(
            "The collision monitor's speed limit in that direction, so that the vehicle stops before \
             obstacles of its sensors or its map, and before unknown ground. When its \
             data is late, the vehicle stops. Unknown ground has not been observed yet, or \
             not recently: there the vehicle may only creep, or not move at all. \
             That ends when its sensors have observed it. Obstacles are among the \
             points of the last scans (of a sonar: under water), or lethal on the map. It limits \
             operators, not a vehicle that moves by itself. When the limit alternates, this is \
             the least of the last 1.5 s, at times.",
        ),
        OBSTACLE => Some(
            "The obstacle for which the collision monitor limits the commanded motion; an amber ring on the map is \
             around it. Detected: hit by a beam of the last scans; too shallow: hit by a sonar; on the map: an obstacle \
             hit before; unknown ground: not observed, or too long ago; no echo: only beams \
             without a return cover it; vegetation: of the docking site that the driver has chosen, entered at creeping \
             speed.",
        ),
        LAST_OBSERVED => Some(
            "How long ago a sensor observed the ground on each side, at the oldest place. The monitor lets the vehicle \
             only creep towards ground that was observed too long ago.",
        ),
        _ => None,
    }
}

fn key_text(teleop: &TeleopStatus, teleop_client: &TeleopClientState) -> (Tone, &'static str) {
    match teleop.state {
        TeleopState::EStop => (Tone::Warning, "Ignored until the reset"),
        TeleopState::Fault(_) => (Tone::Warning, "Ignored while in fault"),
        TeleopState::SafeBoot => (Tone::Waiting, "Ignored before the self-test"),
        TeleopState::Stopping(_) if teleop.arming == Arming::Pressed => {
            (Tone::Waiting, "Active once it has slowed down")
        }
        TeleopState::Driving
            if teleop.arming == Arming::Pressed && is_stopped_by_monitor(teleop) =>
        {
            (Tone::Warning, "Limited by the monitor")
        }
        _ => arming_text(teleop.arming, teleop_client),
    }
}

fn arming_text(arming: Arming, teleop_client: &TeleopClientState) -> (Tone, &'static str) {
    // The keyboard focus is in another window or in a text field.
    let is_elsewhere = !teleop_client.is_ready && teleop_client.ignored.is_none();
    let arming_label = labels::arming(arming);
    match arming {
        Arming::Locked | Arming::Neutral if is_elsewhere => {
            (Tone::Warning, "No focus: click into the map")
        }
        Arming::Locked => (Tone::Warning, arming_label),
        // Ignored keys are not sent: the vehicle reports neutral.
        Arming::Neutral if teleop_client.ignored.is_some() => {
            (Tone::Warning, labels::arming(Arming::Locked))
        }
        Arming::Neutral if opposing_keys(teleop_client) => (Tone::Waiting, "Cancel each other out"),
        Arming::Neutral => (Tone::Waiting, arming_label),
        Arming::Pressed => (Tone::Good, arming_label),
    }
}

/// The reason of the newest stop; `None` before the first. The status reports stops while driving only, so that an
/// emergency stop is found in the robot's `events` (oldest first).
fn last_stop<'a>(
    teleop: &TeleopStatus,
    stop_before_estop: Option<StopBeforeEStop>,
    events: impl DoubleEndedIterator<Item = &'a Event>,
) -> Option<(Tone, String)> {
    if let Some(estop) = teleop.estop {
        let words = format!("emergency stop {}", estop.number);
        return Some((Tone::Warning, words));
    }
    let is_stopping = matches!(teleop.state, TeleopState::Stopping(_));
    let newest = events.rev().find_map(is_emergency);
    // Events may be lost: a stop in the status after the emergency stop is newer.
    let is_newest = stop_before_estop.is_some_and(|before| before.last_stop == teleop.last_stop);
    if newest == Some(true) && is_newest && !is_stopping {
        return Some((Tone::Warning, "emergency stop, reset since".to_owned()));
    }
    let stop = teleop.last_stop?;
    let tone = match stop {
        StopReason::Released => Tone::Waiting,
        _ => Tone::Warning,
    };
    Some((tone, labels::stop(stop).to_owned()))
}

/// Whether an event is an emergency stop (true) or another stop (false).
fn is_emergency(event: &Event) -> Option<bool> {
    match event.kind.as_str() {
        "estop" => Some(true),
        "involuntary_stop" => Some(false),
        "teleop_state" if event.message.starts_with("stopping") => Some(false),
        _ => None,
    }
}

/// The newest unexpected event. A lost lease includes the reason from the robot's `events`, oldest first.
fn notice<'a>(
    teleop_client: &TeleopClientState,
    events: impl DoubleEndedIterator<Item = &'a Event>,
) -> Option<String> {
    let note = teleop_client.notice.as_ref()?;
    let (words, _) = labels::note(note);
    let words = capitalised(&words);
    match note {
        // The disabled buttons show it already.
        TeleopNotification::ObserverOnly => None,
        TeleopNotification::LeaseLost => Some(match why_ended(&teleop_client.operator, events) {
            Some(why) => format!("{words}: {why}"),
            None => words,
        }),
        _ => Some(words),
    }
}

/// `None` if the newest event of this operator is a grant: the event of its end was lost.
fn why_ended<'a>(
    operator: &OperatorId,
    events: impl DoubleEndedIterator<Item = &'a Event>,
) -> Option<&'a str> {
    let newest = events.rev().find_map(|event| {
        let rest = event.message.strip_prefix(operator.as_str())?;
        match event.kind.as_str() {
            "lease_granted" => rest.starts_with(" drives: ").then_some(None),
            "lease_ended" => rest.strip_prefix(" no longer drives: ").map(Some),
            _ => None,
        }
    });
    newest.flatten()
}

fn link_rows(model: &ConsoleModel, now: Monotonic) -> Vec<Row> {
    let quality = model.link_quality();
    let none = || "–".to_owned();
    let age_of = |stream| {
        let age_of = quality.age(stream, now);
        age_of.map_or_else(none, |time| format!("{} ago", age(time)))
    };
    let poses = format!(
        "{:.0} of {:.0} Hz, {}",
        // The rate is averaged over seconds, and may be above an expected rate that changed meanwhile.
        quality.pose_hz(now).min(quality.expected_hz()),
        quality.expected_hz(),
        age_of(Stream::Pose)
    );
    let missing = quality.missing(now).filter(|share| *share >= 0.005);
    let missing = missing.map(|share| row("Missing", format!("{:.0} % of poses", 100.0 * share)));
    let mut rows = vec![
        row("Round trip", round_trip(model, now)),
        row("Poses", poses),
    ];
    rows.extend(missing);
    rows.push(row("Status", age_of(Stream::Status)));
    rows.push(row("Map state", age_of(Stream::MapHead)));
    rows
}

fn refused_rows(teleop: &TeleopStatus) -> Vec<Row> {
    let refused = teleop.counters.refused.iter();
    refused
        .filter(|refused| refused.count > 0)
        .map(|refused| row(&count(refused.count), refused.reason.to_string()))
        .collect()
}

#[cfg(test)]
mod tests {
    use protocol::message::Severity;

    use super::*;
    use crate::test_support::{STORED_ESTOP, idle_teleop_status};

    fn event(kind: &str, message: &str) -> Event {
        Event {
            kind: kind.to_owned(),
            severity: Severity::Info,
            message: message.to_owned(),
        }
    }

    #[test]
    fn last_stop_is_the_newest_of_status_and_events() {
        let released = event("teleop_state", "stopping after driving");
        let estop = event("estop", "emergency stop 3, by anna");
        let rest = [
            event("teleop_state", "emergency stop after driving"),
            event("estop_reset", "emergency stop 3 reset by anna"),
            event("teleop_state", "held after idle"),
            event("teleop_state", "driving after held"),
        ];
        let mut teleop = idle_teleop_status();
        teleop.last_stop = Some(StopReason::Released);
        let before = |stop| {
            let last_stop = Some(stop);
            Some(StopBeforeEStop { last_stop })
        };
        let shown = |teleop: &TeleopStatus, first: &[&Event]| {
            let events = first.iter().copied().chain(&rest);
            last_stop(teleop, before(StopReason::Released), events)
        };
        let let_go = Some((Tone::Waiting, "keys released".to_owned()));
        let emergency = |words: &str| Some((Tone::Warning, words.to_owned()));
        assert_eq!(shown(&teleop, &[]), let_go);
        let reset = emergency("emergency stop, reset since");
        assert_eq!(shown(&teleop, &[&released, &estop]), reset);
        assert_eq!(shown(&teleop, &[&estop, &released]), let_go);
        let involuntary = event("involuntary_stop", "stopping after driving");
        assert_eq!(shown(&teleop, &[&estop, &involuntary]), let_go);
        // The status changed after the emergency stop.
        let late = |before| last_stop(&teleop, before, [&released, &estop].into_iter());
        assert_eq!(late(before(StopReason::Age)), let_go);
        assert_eq!(
            late(None),
            let_go,
            "no stop before the emergency stop is known"
        );
        teleop.state = TeleopState::Stopping(StopReason::Released);
        assert_eq!(shown(&teleop, &[&released, &estop]), let_go);
        teleop.state = TeleopState::EStop;
        teleop.estop = Some(STORED_ESTOP);
        assert_eq!(shown(&teleop, &[]), emergency("emergency stop 3"));
        assert_eq!(last_stop(&idle_teleop_status(), None, rest.iter()), None);
    }
}
