//! The obstacle map against the truth, cell by cell.

use std::collections::BTreeMap;

use super::sweep::Sweep;
use super::{Cell, TerrainWorld, around};
use crate::outcome::Check;
use crate::spread::Spread;
use mapping::elevation::CellClass;
use simulation::truth::GroundPlane;

/// Cells whose true height is so near a threshold are left aside, metres.
pub(crate) const ASIDE_M: f64 = 0.015;
/// Share of the compared cells that must be as they truly are.
const AGREEMENT_MIN: f64 = 0.99;

/// How one obstacle map agrees with the truth.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Agreement {
    /// Known cells that are compared.
    pub(crate) compared: u64,
    /// Known cells whose true height is near a threshold, or that hold glass.
    pub(crate) aside: u64,
    /// Cells that are free and hold an obstacle that no beam, were it without error, would have met: the
    /// laser has seen only the ground beside it.
    pub(crate) unseen: u64,
    /// Cells that are obstacles and should be free.
    pub(crate) false_obstacles: Vec<Cell>,
    /// Cells that are free and should be obstacles.
    pub(crate) false_free: Vec<Cell>,
    /// Obstacles and ditches that the laser swept, in cells.
    pub(crate) swept: u64,
    /// Those of them that the map does not show, neither in their cell nor in one beside it.
    pub(crate) missed: Vec<Cell>,
}

impl Agreement {
    /// Compares what is known, and looks for what the laser swept. The truth is what is seen from above in the
    /// whole cell, above `plane`.
    pub(crate) fn of(
        world: &TerrainWorld,
        plane: &GroundPlane,
        map: &BTreeMap<Cell, CellClass>,
        sweep: &Sweep,
    ) -> Self {
        let mut agreement = Self::default();
        for (&cell, &class) in map {
            let verdict = world.verdict(cell, plane);
            let near = verdict.is_some_and(|verdict| verdict.margin_m <= ASIDE_M);
            if near || world.is_glass(cell, plane) {
                agreement.aside += 1;
                continue;
            }
            let truly = verdict.is_some_and(|verdict| verdict.is_obstacle);
            if truly && class == CellClass::Free && !sweep.hit_an_obstacle(cell) {
                agreement.unseen += 1;
                continue;
            }
            agreement.compared += 1;
            match (class, truly) {
                (CellClass::Obstacle, false) => agreement.false_obstacles.push(cell),
                (CellClass::Free, true) => agreement.false_free.push(cell),
                (CellClass::Obstacle, true)
                | (CellClass::Free, false)
                | (CellClass::Unknown, _) => {}
            }
        }
        for cell in sweep.protruding() {
            agreement.swept += 1;
            let is_shown = around(cell).any(|at| map.get(&at) == Some(&CellClass::Obstacle));
            if !is_shown {
                agreement.missed.push(cell);
            }
        }
        let places = |cells: &[Cell]| -> Vec<[f64; 2]> {
            cells.iter().map(|&cell| world.centre_m(cell)).collect()
        };
        tracing::debug!(
            world = world.world.name(),
            false_obstacles = ?places(&agreement.false_obstacles),
            false_free = ?places(&agreement.false_free),
            missed = ?places(&agreement.missed),
        );
        agreement
    }

    /// Share of the compared cells that are as they truly are.
    pub(crate) fn share(&self) -> f64 {
        let wrong = self.false_obstacles.len() + self.false_free.len();
        1.0 - wrong as f64 / self.compared.max(1) as f64
    }
}

/// What is asked of every obstacle map, over several seeds. `which` says which map it is.
pub(crate) fn checks(which: &str, agreements: &[Agreement]) -> Vec<Check> {
    let figure = |figure: &dyn Fn(&Agreement) -> f64| Spread::of(agreements.iter().map(figure));
    let share = figure(&|agreement| 100.0 * agreement.share());
    let compared = figure(&|agreement| agreement.compared as f64);
    let missed = figure(&|agreement| agreement.missed.len() as f64);
    let swept = figure(&|agreement| agreement.swept as f64);
    let wrong =
        |what: &str, spread: Spread| Check::shown(format!("{which}: {what}"), spread.text(0, ""));
    vec![
        Check::gate(
            format!("{which}: obstacle map agrees with the truth"),
            share.text(2, " %"),
            format!("≥ {:.0} %", 100.0 * AGREEMENT_MIN),
            share.least >= 100.0 * AGREEMENT_MIN && compared.least > 0.0,
        ),
        Check::gate(
            format!("{which}: swept obstacles and ditches of 15 cm that are missed"),
            format!("{} of {} cells", missed.text(0, ""), swept.text(0, "")),
            "0",
            missed.most == 0.0,
        ),
        wrong("cells compared", compared),
        wrong(
            "cells left aside (near a threshold, glass)",
            figure(&|agreement| agreement.aside as f64),
        ),
        wrong(
            "free cells with an obstacle that no beam has met",
            figure(&|agreement| agreement.unseen as f64),
        ),
        wrong(
            "false obstacles",
            figure(&|agreement| agreement.false_obstacles.len() as f64),
        ),
        wrong(
            "obstacles that are free",
            figure(&|agreement| agreement.false_free.len() as f64),
        ),
    ]
}

#[cfg(test)]
mod tests;
