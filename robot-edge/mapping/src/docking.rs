//! Where a boat could dock: gentle slopes that rise out of clear water and are large enough for it.
//!
//! \[HYB\] §8.2.2 (*Hybrid 3D perception on land and water*) leaves the choice to navigation. Here a *berth* is
//! a place and heading of the boat where its footprint lies on cells of moderate cost, above 0 and below
//! lethal, the water it comes through, as wide and as long as itself right behind it, is clear, and it lies on
//! land, or land begins right ahead: a shoal with water around it is none. A site is what berths that touch cover. Asking for the whole footprint keeps overgrown shores out: among their lethal
//! cells there are moderate ones, but no rectangle of them as wide as the boat.

use nalgebra::{Point2, Vector2};

use super::docking_grid::{DockingGrid, Ground};
use super::docking_pose::{DockingPose, DockingTemplates};
use super::grid::CellIndex;

/// The outline of a boat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoatFootprint {
    /// From bow to stern, metres.
    pub length_m: f64,
    /// Across, metres.
    pub width_m: f64,
}

/// Connected cells on which the boat can land.
#[derive(Clone, Debug, PartialEq)]
pub struct DockingSite {
    /// Its cells, ascending.
    pub cells: Vec<CellIndex>,
    /// Their mean, metres in `odom`.
    pub centre_in_odom: Point2<f64>,
    /// Where the bow points on the way in, radians in `odom`, counter-clockwise from x.
    pub heading_rad: f64,
    /// Mean cost of its cells, above 0 and below 1.
    pub mean_cost: f64,
    /// Across the heading, from the outer side of the leftmost berth to that of the rightmost, metres: at
    /// least the boat's own width.
    pub width_m: f64,
}

/// Mean costs that differ by less are of one rank, metres of width decide: the slope cost is no more exact.
const COST_RANK: f64 = 0.05;
/// Berths whose headings differ by no more than so many steps from that of most count for a site's heading.
const HEADINGS_BESIDE: usize = 2;

/// The docking sites of a window, the best first.
///
/// Gentler slopes are better, in steps of 0.05 of mean cost, because it is the slope that the hulls have to
/// bear; of the same step the wider site, which leaves more room for error; then that of the least cell.
pub fn find_docking_sites(window: &DockingGrid<'_>, boat: &BoatFootprint) -> Vec<DockingSite> {
    let shapes = DockingTemplates::new(boat, window.cell_m());
    let docking_poses = shapes.docking_poses(window);
    let mut sites: Vec<_> = connected(&covered(window, &shapes, &docking_poses), window)
        .into_iter()
        .filter_map(|cells| site(window, &shapes, boat, &cells, &docking_poses))
        .collect();
    sites.sort_by(|a, b| {
        let rank = |site: &DockingSite| (site.mean_cost / COST_RANK) as u32;
        let by_width = b.width_m.total_cmp(&a.width_m);
        let by_rank = rank(a).cmp(&rank(b));
        by_rank.then(by_width).then(a.cells.cmp(&b.cells))
    });
    sites
}

/// Which cells of moderate cost any berth covers.
fn covered(
    window: &DockingGrid<'_>,
    shapes: &DockingTemplates,
    docking_poses: &[DockingPose],
) -> Vec<bool> {
    let mut covered = vec![false; window.columns().len()];
    for docking_pose in docking_poses {
        for at in shapes.cells(window, *docking_pose) {
            covered[at] = window.ground(at) == Ground::Moderate;
        }
    }
    covered
}

/// The sets of marked cells that touch, also at corners; each ascending by place.
fn connected(marked: &[bool], window: &DockingGrid<'_>) -> Vec<Vec<usize>> {
    let mut open = marked.to_vec();
    let mut sets = Vec::new();
    for seed in 0..open.len() {
        if !std::mem::take(&mut open[seed]) {
            continue;
        }
        let mut set = vec![seed];
        let mut next = 0;
        while let Some(&from) = set.get(next) {
            next += 1;
            for beside in window.neighbours(from) {
                if std::mem::take(&mut open[beside]) {
                    set.push(beside);
                }
            }
        }
        set.sort_unstable();
        sets.push(set);
    }
    sets
}

fn site(
    window: &DockingGrid<'_>,
    shapes: &DockingTemplates,
    boat: &BoatFootprint,
    places: &[usize],
    docking_poses: &[DockingPose],
) -> Option<DockingSite> {
    let docking_poses = docking_poses.iter().copied();
    let docking_poses =
        docking_poses.filter(|docking_pose| places.binary_search(&docking_pose.centre).is_ok());
    let docking_poses: Vec<_> = docking_poses.collect();
    let heading = main_heading(shapes, &docking_poses)?;
    let across = Vector2::new(-heading.y, heading.x);
    let (mut least_m, mut greatest_m) = (f64::INFINITY, f64::NEG_INFINITY);
    let alike =
        |docking_pose: &&DockingPose| shapes.direction(docking_pose.heading).dot(&heading) > 0.5;
    for docking_pose in docking_poses.iter().filter(alike) {
        let offset_m = window.centre(docking_pose.centre).coords.dot(&across);
        least_m = least_m.min(offset_m);
        greatest_m = greatest_m.max(offset_m);
    }
    let mean = |value: &dyn Fn(usize) -> f64| {
        places.iter().map(|&at| value(at)).sum::<f64>() / places.len() as f64
    };
    let mut cells: Vec<_> = places.iter().map(|&at| window.cell(at)).collect();
    cells.sort_unstable();
    Some(DockingSite {
        cells,
        centre_in_odom: Point2::new(
            mean(&|at| window.centre(at).x),
            mean(&|at| window.centre(at).y),
        ),
        heading_rad: libm::atan2(heading.y, heading.x),
        mean_cost: mean(&|at| window.columns()[at].cost.into()),
        width_m: greatest_m - least_m + boat.width_m,
    })
}

/// The mean direction of the berths whose headings are about that of most: a spit of land has berths from
/// both sides, and the mean of all of them points along it.
fn main_heading(shapes: &DockingTemplates, docking_poses: &[DockingPose]) -> Option<Vector2<f64>> {
    let headings = shapes.headings();
    let mut counts = vec![0_u32; headings];
    for docking_pose in docking_poses {
        counts[docking_pose.heading] += 1;
    }
    let beside = |heading: usize| {
        let first = heading + headings - HEADINGS_BESIDE;
        (first..=first + 2 * HEADINGS_BESIDE).map(move |heading| heading % headings)
    };
    let around = |heading: usize| beside(heading).map(|heading| counts[heading]).sum::<u32>();
    let most =
        (0..headings).max_by_key(|&heading| (around(heading), std::cmp::Reverse(heading)))?;
    let sum: Vector2<f64> = beside(most)
        .map(|heading| shapes.direction(heading) * f64::from(counts[heading]))
        .sum();
    sum.try_normalize(0.5)
}

#[cfg(test)]
mod tests;
