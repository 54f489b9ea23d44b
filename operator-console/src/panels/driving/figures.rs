//! The figures of the driving panel: ages, guard, last stop, link, refusals.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::{BarrierKind, Clamp, CollisionMonitorState, TeleopStatus};

use super::guard::{self, guard};
use super::keys::keys;
use super::last_stop::last_stop;
use super::strictest_limit::strictest_limit;
use crate::model::{ConsoleModel, LinkState, Stream};
use crate::panels::formatting::{age, count};
use crate::panels::rows::{Row, row};
use crate::teleop_client::TeleopClientState;
use crate::theme::Tone;

/// Ages beyond half of the greatest that is usual are worth a look.
const OLD_MS: u32 = 200;
/// The speed that the age of commands allows.
const AGE_LIMIT: &str = "Age limit";
const GUARD: &str = "Guard";
const OBSTACLE: &str = "Obstacle";
const LAST_OBSERVED: &str = "Last observed";

pub(super) fn rows(
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
    let (tone, words) = match (teleop.age_ms, teleop.peak_age_ms) {
        // What is older than the oldest that was obeyed is obeyed no more.
        (Some(now_ms), Some(greatest_ms)) if now_ms <= greatest_ms => {
            let words = format!("{now_ms} ms, at most {greatest_ms} ms");
            (old(greatest_ms.max(now_ms)), words)
        }
        (Some(now_ms), Some(_) | None) => (old(now_ms), format!("{now_ms} ms")),
        (None, _) => (Tone::Waiting, "none are sent".to_owned()),
    };
    rows.push((tone, row("Command age", words)));
    let allowed = format!("{:.2} m/s", teleop.speed_allowed_mps);
    let tone = if teleop.clamp == Some(Clamp::Age) {
        Tone::Warning
    } else {
        Tone::Good
    };
    rows.push((tone, row(AGE_LIMIT, allowed)));
    let (tone, words) = guard(
        teleop,
        strictest_limit(teleop, model.recent_monitor_states()),
        teleop_client.limits,
    );
    rows.push((tone, row(GUARD, words)));
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
    if let Some((tone, stop)) = last_stop(teleop, model.stop_before_estop(), events) {
        rows.push((tone, row("Last stop", stop)));
    }
    if teleop_client.lease.held().is_some() {
        let (tone, words) = keys(teleop, teleop_client);
        rows.push((tone, row("Keys", words)));
    }
    let stops = teleop.counters.involuntary_stops;
    if stops > 0 {
        rows.push((Tone::Warning, row("Involuntary stops", count(stops))));
    }
    rows
}

/// What the guard holds the vehicle back for: the map has a ring around it.
fn obstacle_row(model: &ConsoleModel) -> (Tone, Row) {
    let (tone, words) = match model.barrier().map(|barrier| barrier.kind) {
        None => (Tone::Waiting, "–"),
        Some(BarrierKind::Detected) => (Tone::Warning, "detected now (ringed)"),
        Some(BarrierKind::Shallow) => (Tone::Warning, "too shallow (ringed)"),
        Some(BarrierKind::Mapped) => (Tone::Warning, "on the map (ringed)"),
        Some(BarrierKind::Unknown) => (Tone::Warning, "unknown ground (ringed)"),
        Some(BarrierKind::NoReturn) => (Tone::Warning, "no echo (ringed)"),
    };
    (tone, row(OBSTACLE, words))
}

/// How long ago the ground on each side of the vehicle was looked at.
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

/// What is told of a figure to whoever points at it.
pub(super) fn hint(name: &str) -> Option<&'static str> {
    match name {
        AGE_LIMIT => Some(
            "The older the commands, the lower the speed limit: the vehicle travels only a short way on old \
             commands. While none are sent, the oldest accepted age counts.",
        ),
        GUARD => Some(guard::HINT),
        OBSTACLE => Some(
            "The obstacle for which the collision monitor limits the commanded motion; an amber ring on the map is \
             around it. Detected: hit by a beam of the last scans; too shallow: hit by a sonar; on the map: an obstacle \
             hit before; unknown ground: not observed, or too long ago; no echo: only beams \
             without a return cover it.",
        ),
        LAST_OBSERVED => Some(
            "How long ago a sensor observed the ground on each side, at the oldest place. The monitor lets the vehicle \
             only creep towards ground that was observed too long ago.",
        ),
        _ => None,
    }
}

pub(super) fn link_rows(model: &ConsoleModel, now: Monotonic) -> Vec<Row> {
    let quality = model.link_quality();
    let none = || "–".to_owned();
    let is_live = model.connection().state(now) == LinkState::Live;
    let round_trip = model.connection().round_trip().filter(|_| is_live);
    let round_trip = round_trip.map_or_else(none, |time| match time.as_millis() {
        0 => "< 1 ms".to_owned(),
        ms => format!("{ms} ms"),
    });
    let age_of = |stream| {
        let age_of = quality.age(stream, now);
        age_of.map_or_else(none, |time| format!("{} ago", age(time)))
    };
    let poses = format!(
        "{:.0} of {:.0} Hz, {}",
        // It counts some seconds, of which the first may have been of another rate.
        quality.pose_hz(now).min(quality.expected_hz()),
        quality.expected_hz(),
        age_of(Stream::Pose)
    );
    let missing = quality.missing(now);
    let missing = missing.map_or_else(none, |share| format!("{:.0} % of poses", 100.0 * share));
    vec![
        row("Round trip", round_trip),
        row("Poses", poses),
        row("Missing", missing),
        row("Status", age_of(Stream::Status)),
        row("Map state", age_of(Stream::MapHead)),
    ]
}

pub(super) fn refused_rows(teleop: &TeleopStatus) -> Vec<Row> {
    let refused = teleop.counters.refused.iter();
    refused
        .filter(|refused| refused.count > 0)
        .map(|refused| row(&count(refused.count), refused.reason.to_string()))
        .collect()
}
