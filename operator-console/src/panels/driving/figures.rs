//! The figures of the driving panel: ages, guard, last stop, link, refusals.

use std::time::Duration;

use protocol::message::{BarrierKind, Clamp, Guard, TeleopStatus};
use robot_edge::clock::Monotonic;

use super::guard::{self, guard};
use super::keys::keys;
use super::last_stop::last_stop;
use super::tightest::tightest;
use crate::helm::HelmSight;
use crate::model::{ConsoleModel, LinkState, Stream};
use crate::panels::rows::{Row, row};
use crate::panels::wording::{age, count};
use crate::theme::Tone;

/// Ages beyond half of the greatest that is usual are worth a look.
const OLD_MS: u32 = 200;
/// The speed that the age of commands allows.
const AGE_ALLOWS: &str = "Age allows";
const GUARD: &str = "Guard";
const IN_THE_WAY: &str = "In the way";
const LAST_LOOK: &str = "Last looked at";

pub(super) fn rows(
    model: &ConsoleModel,
    teleop: &TeleopStatus,
    helm: &HelmSight,
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
    let (tone, words) = match (teleop.age_ms, teleop.greatest_age_ms) {
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
    rows.push((tone, row(AGE_ALLOWS, allowed)));
    let (tone, words) = guard(teleop, tightest(teleop, model.guard_lately()), helm.limits);
    rows.push((tone, row(GUARD, words)));
    if helm.lease.held().is_some() {
        let (tone, barrier) = row_of_barrier(model);
        rows.push((tone, barrier));
        if matches!(teleop.guard, Guard::On(_) | Guard::Blind(_)) {
            rows.push((Tone::Good, row_of_sides(teleop)));
        }
    }
    let events = model.events().iter().map(|(event, _)| event);
    if let Some((tone, stop)) = last_stop(teleop, model.before_estop(), events) {
        rows.push((tone, row("Last stop", stop)));
    }
    if helm.lease.held().is_some() {
        let (tone, words) = keys(teleop, helm);
        rows.push((tone, row("Keys", words)));
    }
    let stops = teleop.counters.involuntary_stops;
    if stops > 0 {
        rows.push((Tone::Warning, row("Unasked stops", count(stops))));
    }
    rows
}

/// What the guard holds the vehicle back for: the map has a ring around it.
fn row_of_barrier(model: &ConsoleModel) -> (Tone, Row) {
    let (tone, words) = match model.barrier().map(|barrier| barrier.kind) {
        None => (Tone::Waiting, "–"),
        Some(BarrierKind::Seen) => (Tone::Warning, "seen now (ringed)"),
        Some(BarrierKind::Shallow) => (Tone::Warning, "too shallow (ringed)"),
        Some(BarrierKind::Mapped) => (Tone::Warning, "on the map (ringed)"),
        Some(BarrierKind::Unseen) => (Tone::Warning, "unseen ground (ringed)"),
        Some(BarrierKind::NoEcho) => (Tone::Warning, "no echo from there (ringed)"),
    };
    (tone, row(IN_THE_WAY, words))
}

/// How long ago the ground on each side of the vehicle was looked at.
fn row_of_sides(teleop: &TeleopStatus) -> Row {
    let words: Vec<_> = ["ahead", "left", "behind", "right"]
        .into_iter()
        .zip(teleop.seen_ms)
        .map(|(side, seen_ms)| match seen_ms {
            None => format!("{side} never"),
            Some(..1000) => format!("{side} now"),
            Some(ms) => format!("{side} {} s", ms / 1000),
        })
        .collect();
    row(LAST_LOOK, words.join(", "))
}

/// What is told of a figure to whoever points at it.
pub(super) fn hint(name: &str) -> Option<&'static str> {
    match name {
        AGE_ALLOWS => Some(
            "The older commands are, the slower the robot lets itself be driven: so it goes only a short way on old \
             news. While none are sent, it reckons with the oldest that it would obey.",
        ),
        GUARD => Some(guard::HINT),
        IN_THE_WAY => Some(
            "What the collision guard holds the robot back for on the way that is asked for; an amber ring on the map is \
             around it. What is seen is hit by a beam of the last scans; what is too shallow, by a sonar's; what is mapped \
             was hit before; unseen ground has not been looked at, or too long ago; from where there is no echo, only beams \
             without one say that the way is free.",
        ),
        LAST_LOOK => Some(
            "How long ago a sensor looked at the ground beside the robot, where that is longest ago. The guard lets the robot \
             only creep towards what was looked at too long ago.",
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
