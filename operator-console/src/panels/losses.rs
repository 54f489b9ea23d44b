//! Counters of dropped messages (robot) and rejected messages (console) by reason.

use eframe::egui::Ui;

use super::formatting::count;
use super::rows::{hinted_rows_ui, row};
use crate::model::ConsoleModel;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LossesData {
    pub robot: Vec<(String, String)>,
    pub console: Vec<(String, String)>,
}

impl LossesData {
    pub fn new(model: &ConsoleModel) -> Self {
        let status = model.status().map(|(status, _)| status);
        let drops = status.map(|status| status.drops.as_slice());
        let refused = status.map_or(0, |status| status.refused);
        let waiting = status.map_or(0, |status| u64::from(status.tiles_waiting));
        let robot = drops
            .unwrap_or_default()
            .iter()
            .map(|reason| (reason.name.as_str(), reason.count))
            .chain([("refused messages", refused), ("tiles waiting", waiting)]);
        let bands = model.map().abandoned_bands();
        let console = model
            .reject_counts()
            .iter()
            .map(|(why, times)| (why.name(), times))
            .chain([("incomplete tiles", bands)]);
        Self {
            robot: rows(robot),
            console: rows(console),
        }
    }
}

fn rows<'a>(counts: impl Iterator<Item = (&'a str, u64)>) -> Vec<(String, String)> {
    counts
        .filter(|(_, times)| *times > 0)
        .map(|(name, times)| row(&name.replace('_', " "), count(times)))
        .collect()
}

pub fn losses_ui(ui: &mut Ui, data: &LossesData) {
    for (who, id, rows) in [
        (
            "Dropped by the robot (scans, beams, messages)",
            "drops",
            &data.robot,
        ),
        ("Rejected by this console", "refusals", &data.console),
    ] {
        ui.strong(who);
        if rows.is_empty() {
            ui.label("Nothing");
        } else {
            hinted_rows_ui(ui, id, rows, &hint);
        }
    }
}

fn hint(name: &str) -> Option<&'static str> {
    let words = match name {
        "isolated" => {
            "Single points of a scan with nothing beside them, such as rain, spray or dust. They are not mapped."
        }
        "invalid range" => {
            "Beams with an invalid range, or shorter than the sensor can measure. They are not mapped."
        }
        "own body" => "Beams that hit the vehicle itself. They are not mapped.",
        "thinned" => "Points of a cloud beside others, thinned as configured. They are not mapped.",
        "out of bounds" | "outside window" => {
            "Points farther away than the map reaches. They are not mapped."
        }
        "late" => "Messages of a sensor that came too late to be put in order.",
        "undecodable" | "damaged" | "cut off" => {
            "Messages or parts of a recording that cannot be read."
        }
        "lost" => "Packets that a sensor sent and that did not come.",
        "bad stamp" => "Messages with an impossible time.",
        "bad pose" => "Positions with invalid numbers.",
        "bad scan" => "Scans without beams, or with invalid angles or times.",
        "wheel jump" => "Turns of a wheel that are longer than the vehicle drives.",
        "no fix" => "The satellite receiver had no position.",
        "bad fix" => "Satellite positions that are not on Earth.",
        "gnss outlier" => "Satellite positions farther away than the vehicle drives.",
        "no pose" | "before first pose" => "Scans of a time without a known position.",
        "pose gap" => "Scans of a time without positions for too long.",
        "pose jump" => "Scans of a time at which the position jumped.",
        "after last pose" => "Scans that are too much newer than the newest position.",
        "queue full" => {
            "Scans that waited for a position while there was no room for more, or for mapping for more than 2 s, and \
             those behind them until it had caught up."
        }
        "lost by source" => {
            "Messages that came and cannot be used, or damaged parts of a recording, each of which may hold many scans: \
             Events and the time line say where."
        }
        "before joining" => {
            "Received before the robot announced its run. Missing tiles are fetched."
        }
        "other boot" => {
            "From another run of the robot, for example around its restart. Missing tiles are fetched."
        }
        "incomplete tiles" => "Tiles of which one half was not received.",
        _ => return None,
    };
    Some(words)
}

#[cfg(test)]
mod tests {
    use super::*;
    use measurement::drops::DropReason;

    use crate::model::RejectReason;

    #[test]
    fn drop_reasons_are_explained() {
        for (reason, text) in [
            (DropReason::Isolated, "Single points"),
            (DropReason::InvalidRange, "shorter than the sensor"),
            (DropReason::OwnBody, "the vehicle itself"),
            (DropReason::Thinned, "thinned as configured"),
            (DropReason::AfterLastPose, "newer than the newest position"),
        ] {
            let (name, _) = super::rows([(reason.as_str(), 1)].into_iter()).remove(0);
            let words = hint(&name);
            assert!(
                words.is_some_and(|words| words.contains(text)),
                "{name}: {words:?}"
            );
        }
        assert_eq!(hint("refused messages"), None);
        let handbook = include_str!("../../../docs/console.md");
        for refusal in [RejectReason::BeforeJoin, RejectReason::OtherBoot] {
            let words = hint(refusal.name()).unwrap();
            assert!(words.ends_with("are fetched."), "{words}");
            let named = format!("*{}*: ", refusal.name());
            assert!(handbook.contains(&named), "{named}");
        }
    }
}
