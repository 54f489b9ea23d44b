//! The obstacle map against the truth, cell by cell.

use std::collections::BTreeMap;

use super::sweep::Sweep;
use super::{Cell, TerrainWorld, around};
use crate::outcome::{Check, Spread};
use crate::truth::GroundPlane;
use mapping::elevation::CellClass;

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
pub(crate) fn checks<'a>(
    which: &str,
    agreements: impl Iterator<Item = &'a Agreement>,
) -> Vec<Check> {
    let agreements: Vec<&Agreement> = agreements.collect();
    let count = |figure: &dyn Fn(&Agreement) -> u64| {
        Spread::over(&agreements, |agreement| figure(agreement) as f64)
    };
    let share = Spread::over(&agreements, |agreement| 100.0 * agreement.share());
    let compared = count(&|agreement| agreement.compared);
    let missed = count(&|agreement| agreement.missed.len() as u64);
    let swept = count(&|agreement| agreement.swept);
    let mut checks = vec![
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
    ];
    let shown =
        |what: &str, count: Spread| Check::shown(format!("{which}: {what}"), count.text(0, ""));
    checks.extend([
        shown("cells compared", compared),
        shown(
            "cells left aside (near a threshold, glass)",
            count(&|agreement| agreement.aside),
        ),
        shown(
            "free cells with an obstacle that no beam has met",
            count(&|agreement| agreement.unseen),
        ),
        shown(
            "false obstacles",
            count(&|agreement| agreement.false_obstacles.len() as u64),
        ),
        shown(
            "obstacles that are free",
            count(&|agreement| agreement.false_free.len() as u64),
        ),
    ]);
    checks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::outcome::Verdict;
    use crate::session::Rules;
    use crate::terrain::obstacle_map;

    /// Long enough for the laser to have looked at the hall.
    const DURATION_S: f64 = 2.0;

    #[test]
    fn whatever_is_wrong_in_a_map_is_found() {
        let hall = TerrainWorld::load("hall", Some(DURATION_S), Rules::Own).unwrap();
        let plane = hall.plane_at(0.0);
        let sweep = Sweep::of(&hall, &plane, |_| true).unwrap();
        let errorless = hall.errorless_run().unwrap().finish().unwrap();
        let map = obstacle_map(&errorless.publisher().store());
        let agreement = |map: &BTreeMap<Cell, CellClass>| Agreement::of(&hall, &plane, map, &sweep);
        let right = agreement(&map);
        assert!(right.compared > 100 && right.swept > 50, "{right:?}");
        assert_eq!((&right.missed, &right.false_obstacles), (&vec![], &vec![]));

        let find = |class, truly: bool| {
            let is_it = |cell| hall.verdict(cell, &plane).unwrap().is_obstacle == truly;
            let mut cells = map.iter();
            *cells
                .find(|(cell, found)| **found == class && is_it(**cell))
                .unwrap()
                .0
        };
        let free = find(CellClass::Free, false);
        let obstacle = find(CellClass::Obstacle, true);
        let mut wrong = map.clone();
        wrong.insert(free, CellClass::Obstacle);
        wrong.insert(obstacle, CellClass::Free);
        let wrong = agreement(&wrong);
        assert_eq!(wrong.false_obstacles, [free]);
        assert!(wrong.false_free.contains(&obstacle));
        assert!(wrong.share() < right.share());
        assert_eq!(
            wrong.missed, [[0; 2]; 0],
            "the wall beside it is still there"
        );

        let mut gone = map.clone();
        gone.retain(|_, class| *class == CellClass::Free);
        let gone = agreement(&gone);
        assert_eq!(gone.missed.len() as u64, gone.swept);
        let verdicts: Vec<_> = checks("hall", [&right, &gone].into_iter())
            .into_iter()
            .map(|check| check.verdict)
            .collect();
        assert_eq!(
            verdicts[..2],
            [Verdict::Passed, Verdict::Failed],
            "{verdicts:?}"
        );
    }

    #[test]
    fn a_map_of_nothing_agrees_with_nothing() {
        let floor = TerrainWorld::load("floor", Some(0.5), Rules::Own).unwrap();
        let plane = floor.plane_at(0.0);
        let sweep = Sweep::of(&floor, &plane, |_| false).unwrap();
        assert_eq!(sweep.cells().count(), 0);
        let nothing = Agreement::of(&floor, &plane, &BTreeMap::new(), &sweep);
        assert_eq!(
            checks("floor", [&nothing].into_iter())[0].verdict,
            Verdict::Failed
        );
    }
}
