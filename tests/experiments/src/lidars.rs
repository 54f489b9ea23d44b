//! The lidars with rings of experiments D1 and D2.

use simulation::World;

use super::outcome::{Check, Outcome};
use super::terrain::changed;

/// Label and preset. Gates are those of the first; of the other the figures are shown.
const LIDARS: [(&str, &str); 2] = [("64 rings", "lidar64"), ("16 rings", "lidar16")];

/// A world with each lidar, and its label. The world's own has 64 rings.
pub(super) fn worlds(name: &str, text: &str) -> anyhow::Result<Vec<(&'static str, World)>> {
    let vehicle = |preset: &str| format!("vehicle = \"{preset}\"");
    let own = vehicle(LIDARS[0].1);
    let worlds = LIDARS.into_iter().map(|(label, preset)| {
        let text = changed(text, &[(&own, &vehicle(preset))])?;
        Ok((label, World::parse(name, &text)?))
    });
    worlds.collect()
}

/// Adds the checks of a lidar.
pub(super) fn add_checks(
    outcome: &mut Outcome,
    label: &str,
    checks: impl IntoIterator<Item = Check>,
) {
    let has_gates = label == LIDARS[0].0;
    let checks = checks.into_iter().map(|check| {
        if has_gates {
            check
        } else {
            check.without_gate()
        }
    });
    outcome.checks.extend(checks);
}
