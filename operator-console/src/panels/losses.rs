//! What was dropped by the robot and what was refused here, by reason.

mod hints;

use eframe::egui::Ui;

use super::formatting::count;
use super::rows::{hinted_rows_ui, row};
use crate::model::ConsoleModel;

/// What the panel shows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LossesData {
    /// Reasons and counts of the robot.
    pub robot: Vec<(String, String)>,
    /// Reasons and counts of this console.
    pub console: Vec<(String, String)>,
}

impl LossesData {
    /// The counters as they are.
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
        let halves = model.map().abandoned_halves();
        let console = model
            .reject_counts()
            .iter()
            .map(|(why, times)| (why.name(), times))
            .chain([("incomplete tiles", halves)]);
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

/// Draws the panel.
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
            hinted_rows_ui(ui, id, rows, &hints::hint);
        }
    }
}

#[cfg(test)]
mod tests {
    use eframe::egui::vec2;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;

    #[test]
    fn headings_say_of_what_losses_are_and_stay_within_a_narrow_panel() {
        let data = LossesData {
            robot: rows([("own_body", 1_234)].into_iter()),
            console: Vec::new(),
        };
        let mut window = Harness::builder()
            .with_size(vec2(200.0, 200.0))
            .build_ui(move |ui| losses_ui(ui, &data));
        crate::theme::set(&window.ctx);
        window.run_steps(3);
        let heading = window.get_by_label("Dropped by the robot (scans, beams, messages)");
        let below = window.get_by_label("own body").rect();
        assert!(heading.rect().right() <= 200.0, "{}", heading.rect());
        assert!(heading.rect().bottom() <= below.top(), "{below}");
        window.get_by_label("1\u{a0}234");
    }
}
