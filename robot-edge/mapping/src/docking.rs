//! Docking sites: gentle slopes that rise out of clear water and hold the boat's footprint, and, for
//! an emergency, vegetation that gives way (docs/methods.md, section 4, "Docking sites";
//! \[HYB\] §7.2, §8.2.2, §8.4.2).
//!
//! A *docking pose* is a position and heading at which the footprint covers cells of moderate cost
//! (above 0, below 1), an area of the same size right behind it is clear water, and land is below
//! the boat or right ahead, so that a shoal does not count. A site is a connected set of cells that
//! docking poses cover. Overgrown shores have moderate cells too, but no boat-sized rectangle of
//! them.
//!
//! In Sparse or Dense vegetation a docking pose needs vegetation of at least the boat's width below
//! it, no other lethal cell, and open water behind; what no beam has reached between the plants may
//! be unknown. A site is what docking poses cover of one shore, and costs more than any slope.

mod docking_grid;

use std::collections::BTreeMap;
use std::f64::consts::{SQRT_2, TAU};
use std::ops::Range;

use nalgebra::{Point2, Vector2};

use docking_grid::{CellBox, Counts, DockingGrid};

use crate::grid::CellIndex;
use crate::shore::ShoreClass;

/// Footprint of a boat.
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
    /// From 1; constant between updates of a [`ShoreLayer`](crate::shore_layer::ShoreLayer), 0 before.
    pub number: u32,
    /// Its cells, ascending.
    pub cells: Vec<CellIndex>,
    /// Mean of the cells, metres in `odom`.
    pub centre_in_odom: Point2<f64>,
    /// Direction of the bow on the way in, radians in `odom`, counter-clockwise from x.
    pub heading_rad: f64,
    /// The vegetation that the boat pushes into, Sparse or Dense; `None` for a gentle slope.
    pub vegetation: Option<ShoreClass>,
    /// Mean over its cells: of a slope the cost, above 0 and below 1; of vegetation 1 plus the
    /// density of its shore, at most 2.
    pub price: f64,
    /// Where the way in along the heading begins, metres in `odom`: a boat's length before the
    /// centre.
    pub approach_in_odom: Point2<f64>,
    /// Columns that a boat on the way in may touch, ascending: vegetation no denser than the site's,
    /// and two columns around it where nothing is lethal; as far as the boat's width beside the site.
    /// Empty for a slope.
    pub passable: Vec<CellIndex>,
    /// Extent across the heading of all docking poses of the site, metres: at least the boat's
    /// width.
    pub width_m: f64,
}

/// Mean costs within this difference rank equal, and the width decides: the cost is not more
/// precise.
const COST_RANK: f64 = 0.05;
/// Docking poses within this many heading steps of the most frequent heading count for a site's
/// heading.
const HEADINGS_BESIDE: usize = 2;

/// Docking sites of a window, the best first.
pub fn find_docking_sites(
    first: CellIndex,
    width: usize,
    cell_m: f64,
    columns: &[DockingColumn],
    boat: &BoatFootprint,
) -> Vec<DockingSite> {
    let of = |vegetation| find_sites_in(vegetation, first, width, cell_m, columns, boat);
    let mut sites: Vec<_> = GROUNDS.into_iter().flat_map(of).collect();
    rank(&mut sites);
    sites
}

/// What a site may be in: a gentle slope, or vegetation.
pub(crate) const GROUNDS: [Option<ShoreClass>; 3] =
    [None, Some(ShoreClass::Sparse), Some(ShoreClass::Dense)];

/// Those of [`find_docking_sites`] in one of [`GROUNDS`], in no particular order.
pub(crate) fn find_sites_in(
    vegetation: Option<ShoreClass>,
    first: CellIndex,
    width: usize,
    cell_m: f64,
    columns: &[DockingColumn],
    boat: &BoatFootprint,
) -> Vec<DockingSite> {
    let is_class =
        |column: &DockingColumn| column.vegetation.map(|found| found.class) == vegetation;
    if vegetation.is_some() && !columns.iter().any(is_class) {
        return Vec::new();
    }
    let shapes = DockingTemplates::new(boat, cell_m, vegetation);
    let margin = shapes.margin();
    let window = DockingGrid::new(first, width, cell_m, columns, vegetation, margin);
    let docking_poses = shapes.docking_poses(&window);
    if docking_poses.is_empty() {
        return Vec::new();
    }
    let marked = covered(&window, &shapes, &docking_poses);
    let sets = match vegetation {
        None => connected(&marked, &window),
        Some(_) => by_shore(&marked, &window),
    };
    let mut set_of = vec![u32::MAX; columns.len()];
    for (set, places) in (0..).zip(&sets) {
        for &at in places {
            set_of[at] = set;
        }
    }
    let mut poses_of = vec![Vec::new(); sets.len()];
    for docking_pose in docking_poses {
        if let Some(poses) = poses_of.get_mut(set_of[docking_pose.centre] as usize) {
            poses.push(docking_pose);
        }
    }
    let sets = sets.iter().zip(poses_of);
    sets.filter_map(|(places, poses)| site(&window, &shapes, boat, places, &poses))
        .collect()
}

/// Puts the best first.
///
/// A lower price is better, in steps of 0.05, because the hulls bear the slope; then the wider
/// site, then the lesser first cell.
pub(crate) fn rank(sites: &mut [DockingSite]) {
    sites.sort_by(|a, b| {
        let rank = |site: &DockingSite| (site.price / COST_RANK) as u32;
        let by_width = b.width_m.total_cmp(&a.width_m);
        let by_rank = rank(a).cmp(&rank(b));
        by_rank.then(by_width).then(a.cells.cmp(&b.cells))
    });
}

/// A site in vegetation that the boat has entered, as it is now: among plants that it pushes aside no
/// docking pose is found any more. What is lethal now, and no vegetation of the site's class or a
/// lesser, is not passable.
pub(crate) fn entered_site(
    first: CellIndex,
    width: usize,
    cell_m: f64,
    columns: &[DockingColumn],
    mut site: DockingSite,
) -> DockingSite {
    let window = DockingGrid::new(first, width, cell_m, columns, site.vegetation, 0);
    site.passable.retain(|cell| {
        let place = cell.place_in(first, width);
        place.is_some_and(|at| at < columns.len() && window.is_passable(at))
    });
    site
}

/// Marks the cells that a docking pose covers.
fn covered(
    window: &DockingGrid<'_>,
    shapes: &DockingTemplates,
    docking_poses: &[DockingPose],
) -> Vec<bool> {
    // Poses that cover a column less those that cover the one before it: poses overlap.
    let mut steps = vec![0_i32; window.columns().len() + 1];
    for docking_pose in docking_poses {
        for range in shapes.cells(window, *docking_pose) {
            steps[range.start] += 1;
            steps[range.end] -= 1;
        }
    }
    let mut marked = vec![false; window.columns().len()];
    let (mut next, mut poses) = (0, 0);
    for &at in window.sought() {
        poses += steps[next..=at].iter().sum::<i32>();
        next = at + 1;
        marked[at] = poses > 0;
    }
    marked
}

/// Connected sets of marked cells (also across corners), each ascending.
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

/// Marked columns of one shore each, ascending: scattered plants do not touch.
fn by_shore(marked: &[bool], window: &DockingGrid<'_>) -> Vec<Vec<usize>> {
    let mut sets: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for at in (0..marked.len()).filter(|&at| marked[at]) {
        if let Some(vegetation) = window.columns()[at].vegetation {
            sets.entry(vegetation.shore).or_default().push(at);
        }
    }
    sets.into_values().collect()
}

fn site(
    window: &DockingGrid<'_>,
    shapes: &DockingTemplates,
    boat: &BoatFootprint,
    places: &[usize],
    docking_poses: &[DockingPose],
) -> Option<DockingSite> {
    let heading = main_heading(shapes, docking_poses)?;
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
    let centre = Point2::new(
        mean(&|at| window.centre(at).x),
        mean(&|at| window.centre(at).y),
    );
    let width_m = greatest_m - least_m + boat.width_m;
    let middle = heading * centre.coords.dot(&heading) + across * (0.5 * (least_m + greatest_m));
    let reach = Vector2::new(boat.length_m, 0.5 * width_m + boat.width_m);
    let is_near = |at: usize| {
        let offset = window.centre(at).coords - middle;
        offset.dot(&heading).abs() <= reach.x && offset.dot(&across).abs() <= reach.y
    };
    let (first, middle) = (
        window.cell(0),
        CellIndex::containing(middle.into(), window.cell_m()),
    );
    let [x, y] = [
        middle.x.saturating_sub(first.x),
        middle.y.saturating_sub(first.y),
    ]
    .map(|cells| cells as isize);
    let cells_away = (reach.norm() / window.cell_m()) as isize + 2;
    // A slope has none: nothing is to be searched for.
    let rows = window
        .vegetation
        .map_or(0..0, |_| y - cells_away..y + cells_away);
    let around = rows.flat_map(|y| window.row_span(y, x - cells_away, x + cells_away));
    let passable = around.filter(|&at| is_near(at) && window.is_passable(at));
    let mut passable: Vec<_> = passable.map(|at| window.cell(at)).collect();
    passable.sort_unstable();
    Some(DockingSite {
        number: 0,
        cells,
        centre_in_odom: centre,
        heading_rad: libm::atan2(heading.y, heading.x),
        vegetation: window.vegetation,
        price: mean(&|at| window.columns()[at].price()),
        approach_in_odom: centre - heading * boat.length_m,
        passable,
        width_m,
    })
}

/// Mean direction of the docking poses around the most frequent heading. A spit of land has poses
/// from both sides, whose overall mean points along it.
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

/// Input for one column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DockingColumn {
    /// Slope cost, 0 to 1, for the critical slope of docking; NaN if unknown.
    pub cost: f32,
    /// Water without an obstacle.
    pub is_clear_water: bool,
    /// The hits are above the water level; false for a shoal.
    pub rises_from_water: bool,
    /// What grows there, if it gives way.
    pub vegetation: Option<Vegetation>,
}

/// Vegetation of a column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vegetation {
    /// Sparse or Dense.
    pub class: ShoreClass,
    /// Stems of its shore over those of a Solid one, or its share of rigid voxels: 0 … 1.
    pub density: f32,
    /// Number of its shore.
    pub shore: u32,
}

impl DockingColumn {
    fn price(&self) -> f64 {
        let price = self.vegetation.map(|found| 1.0 + found.density);
        price.unwrap_or(self.cost).into()
    }
}

/// Headings to test, 15° apart.
const HEADINGS: usize = 24;
/// Minimum share of moderate cells below the boat. The rest may be level or unknown, because a
/// tilting laser leaves gaps. None may be lethal.
const MIN_MODERATE_SHARE: f64 = 0.9;
/// Minimum share of clear water behind the boat. The rest may be unknown or the edge of the ramp,
/// which the waterline cuts at an angle. None may be lethal.
const MIN_WATER_SHARE: f64 = 0.8;
/// Greatest size of a boat, cells; it bounds work and memory.
const MAX_CELLS: f64 = 256.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct DockingPose {
    /// Index of the middle cell of its footprint.
    centre: usize,
    /// Index of the heading.
    heading: usize,
}

/// Cells that a boat covers at each heading.
#[derive(Clone, Debug, Default)]
struct DockingTemplates {
    /// One per heading; empty if the boat is too large.
    shapes: Vec<DockingTemplate>,
    /// Clear water is in this box around a docking pose.
    water_box: CellBox,
    /// No lethal cell is.
    clearance_box: CellBox,
}

#[derive(Clone, Debug)]
struct DockingTemplate {
    direction: Vector2<f64>,
    footprint_mask: CellMask,
    /// Same size as the footprint, right behind it.
    water: CellMask,
    /// Same size as the footprint, right ahead of it, where the land may begin.
    ahead: CellMask,
    /// Minimum moderate cells below the footprint.
    min_moderate: u32,
    /// Minimum clear water behind the footprint.
    min_water: u32,
    /// Minimum moderate cells behind that make it no open water.
    min_closed: u32,
    /// Minimum land cells below the footprint or ahead: the boat's width, so that stray hits are no
    /// land.
    min_land: u32,
    /// Maximum clear water ahead if all land is ahead.
    max_water_ahead: u32,
}

/// Cells around a middle one, as spans of rows.
#[derive(Clone, Debug, Default)]
struct CellMask {
    row_spans: Vec<RowSpan>,
    cells: u32,
    bounds: CellBox,
}

/// Columns `from .. to` of row `y`, relative to the middle cell.
#[derive(Clone, Copy, Debug)]
struct RowSpan {
    y: i32,
    from: i32,
    to: i32,
}

impl DockingTemplates {
    fn new(boat: &BoatFootprint, cell_m: f64, vegetation: Option<ShoreClass>) -> Self {
        let cells = |metres: f64| metres / cell_m;
        let (length, width) = (cells(boat.length_m), cells(boat.width_m));
        let fits = |size: f64| size > 0.0 && size <= MAX_CELLS;
        if !(fits(length) && fits(width)) {
            return Self::default();
        }
        let shapes = (0..HEADINGS).map(|heading| {
            let angle_rad = TAU * heading as f64 / HEADINGS as f64;
            let direction = Vector2::new(libm::cos(angle_rad), libm::sin(angle_rad));
            let rectangle = |ahead: f64| CellMask::rectangle(direction, ahead, length, width);
            let [footprint_mask, water, ahead] = [0.0, -length, length].map(rectangle);
            let min_land = libm::ceil(width) as u32;
            let is_slope = vegetation.is_none();
            DockingTemplate {
                direction,
                min_moderate: if is_slope {
                    footprint_mask.share(MIN_MODERATE_SHARE)
                } else {
                    min_land
                },
                min_closed: if is_slope { u32::MAX } else { min_land },
                // A boat shorter than a cell has no cell behind it.
                min_water: water.share(MIN_WATER_SHARE).max(1),
                min_land,
                max_water_ahead: ahead.cells - ahead.share(MIN_WATER_SHARE),
                footprint_mask,
                water,
                ahead,
            }
        });
        let to_water = 1.5 * length + 0.5 * width;
        // Diagonal steps that stay within the circle inscribed in the footprint.
        let to_side = 0.5 * width.min(length) / SQRT_2;
        Self {
            shapes: shapes.collect(),
            water_box: CellBox::around(to_water as i32 + 1),
            clearance_box: CellBox::around(to_side as i32),
        }
    }

    /// Cells of its boxes beyond the window's edge, at most.
    fn margin(&self) -> usize {
        let bounds = self.shapes.iter().map(|shape| shape.water.bounds);
        let boxes = bounds.chain([self.water_box, self.clearance_box]);
        boxes.map(CellBox::reach).max().unwrap_or(0)
    }

    const fn headings(&self) -> usize {
        self.shapes.len()
    }

    /// Direction of the bow.
    fn direction(&self, heading: usize) -> Vector2<f64> {
        self.shapes[heading].direction
    }

    /// All docking poses, by position and heading.
    fn docking_poses(&self, window: &DockingGrid<'_>) -> Vec<DockingPose> {
        let [water_box, clearance_box] =
            [self.water_box, self.clearance_box].map(|cells| window.corners(cells));
        let behind = self.shapes.iter();
        let behind: Vec<_> = behind
            .map(|shape| window.corners(shape.water.bounds))
            .collect();
        let mut docking_poses = Vec::new();
        for &centre in window.sought() {
            let corner = window.corner(centre);
            // Cheap tests first.
            if window.water_and_lethal(corner, water_box)[0] == 0
                || window.water_and_lethal(corner, clearance_box)[1] > 0
            {
                continue;
            }
            for (heading, (shape, behind)) in self.shapes.iter().zip(&behind).enumerate() {
                let water = window.water_and_lethal(corner, *behind)[0];
                if water >= shape.min_water && shape.is_docking_pose(window, centre) {
                    docking_poses.push(DockingPose { centre, heading });
                }
            }
        }
        docking_poses
    }

    /// Index ranges of the cells below a boat.
    fn cells<'a>(
        &'a self,
        window: &'a DockingGrid<'_>,
        docking_pose: DockingPose,
    ) -> impl Iterator<Item = Range<usize>> + 'a {
        let shape = &self.shapes[docking_pose.heading].footprint_mask;
        let spans = shape.spans(window, docking_pose.centre);
        spans.map(|[y, from, to]| window.row_span(y, from, to))
    }
}

impl DockingTemplate {
    fn is_docking_pose(&self, window: &DockingGrid<'_>, centre: usize) -> bool {
        let most_others = self.footprint_mask.cells.checked_sub(self.min_moderate);
        let below = most_others.and_then(|most| self.footprint_mask.counts(window, centre, most));
        let Some(below) = below else {
            return false;
        };
        let behind = self.water.counts(window, centre, u32::MAX);
        let is_open =
            |behind: Counts| behind.water >= self.min_water && behind.moderate < self.min_closed;
        behind.is_some_and(is_open)
            && (below.land >= self.min_land || self.leads_to_land(window, centre))
    }

    /// A sonar measures the bed of shallow water as gentle as a beach. A shoal differs by having no
    /// land behind it.
    fn leads_to_land(&self, window: &DockingGrid<'_>, centre: usize) -> bool {
        let ahead = self.ahead.counts(window, centre, u32::MAX);
        ahead
            .is_some_and(|ahead| ahead.land >= self.min_land && ahead.water <= self.max_water_ahead)
    }
}

impl CellMask {
    /// Cells with centres in a rectangle of `length` along `direction` and `width` across, its
    /// centre `ahead` of the middle cell; all in cells.
    fn rectangle(direction: Vector2<f64>, ahead: f64, length: f64, width: f64) -> Self {
        let reach = libm::ceil(ahead.abs() + 0.5 * (length + width)) as i32;
        let is_inside = |x: i32, y: i32| {
            let cell = Vector2::new(f64::from(x), f64::from(y));
            let (along, across) = (cell.dot(&direction) - ahead, cell.perp(&direction));
            along.abs() <= 0.5 * length && across.abs() <= 0.5 * width
        };
        let mut shape = Self::default();
        for y in -reach..=reach {
            // A rectangle is convex: one span per row.
            let mut inside = (-reach..=reach).filter(|&x| is_inside(x, y));
            if let Some(from) = inside.next() {
                let to = inside.next_back().unwrap_or(from) + 1;
                shape.row_spans.push(RowSpan { y, from, to });
                shape.cells += to.abs_diff(from);
            }
        }
        let spans = &shape.row_spans;
        let from = spans.iter().map(|span| span.from).min();
        let to = spans.iter().map(|span| span.to).max();
        shape.bounds = CellBox {
            x: [from, to].map(Option::unwrap_or_default),
            y: [
                spans.first().map_or(0, |span| span.y),
                spans.last().map_or(0, |span| span.y + 1),
            ],
        };
        shape
    }

    fn share(&self, share: f64) -> u32 {
        libm::ceil(share * f64::from(self.cells)) as u32
    }

    /// Row, first column and the one after the last of each of its spans, in a window around a middle cell; they may lie outside.
    fn spans(
        &self,
        window: &DockingGrid<'_>,
        centre: usize,
    ) -> impl Iterator<Item = [isize; 3]> + use<'_> {
        let (x, y) = (
            (centre % window.width()).cast_signed(),
            (centre / window.width()).cast_signed(),
        );
        self.row_spans.iter().map(move |span| {
            let [from, to] = [span.from, span.to].map(|cells| x + cells as isize);
            [y + span.y as isize, from, to]
        })
    }

    /// Counts on its cells; `None` if any is lethal, or more than `most_others` are not moderate.
    fn counts(&self, window: &DockingGrid<'_>, centre: usize, most_others: u32) -> Option<Counts> {
        let mut counts = Counts::default();
        let mut cells = 0;
        for [y, from, to] in self.spans(window, centre) {
            counts += window.counts(y, from, to);
            cells += (to - from) as u32;
            if counts.lethal > 0 || cells - counts.moderate > most_others {
                return None;
            }
        }
        Some(counts)
    }
}

#[cfg(test)]
mod tests;

#[cfg(test)]
mod docking_pose_tests {
    use proptest::prelude::*;

    use super::*;
    use crate::docking::DockingColumn;
    use crate::grid::CellIndex;

    proptest! {
        /// The cheap tests exclude no docking pose.
        #[test]
        fn no_docking_pose_is_missed(
            kinds in prop::collection::vec(
                prop_oneof![
                    6 => Just((0.0, true, false)),
                    4 => Just((0.5, false, true)),
                    2 => Just((0.5, false, false)),
                    1 => Just((1.0, false, true)),
                    1 => Just((f32::NAN, false, false)),
                ],
                16,
            ),
            length_m in 0.5..5.0_f64,
            width_m in 0.5..5.0_f64,
        ) {
            let boat = BoatFootprint { length_m, width_m };
            // Patches of 4 × 4 columns.
            let columns: Vec<_> = (0..256)
                .map(|at| kinds[at / 64 * 4 + at % 16 / 4])
                .map(|(cost, is_clear_water, rises_from_water)| DockingColumn {
                    cost,
                    is_clear_water,
                    rises_from_water,
                    vegetation: None,
                })
                .collect();
            let shapes = DockingTemplates::new(&boat, 1.0, None);
            let margin = shapes.margin();
            let window = DockingGrid::new(CellIndex { x: 0, y: 0 }, 16, 1.0, &columns, None, margin);
            let all = (0..256).flat_map(|centre| {
                let headings = 0..shapes.headings();
                headings.map(move |heading| DockingPose { centre, heading })
            });
            let docking_poses = all.filter(|docking_pose| {
                window.ground(docking_pose.centre) == docking_grid::Ground::Moderate
                    && shapes.shapes[docking_pose.heading].is_docking_pose(&window, docking_pose.centre)
            });
            prop_assert_eq!(shapes.docking_poses(&window), docking_poses.collect::<Vec<_>>());
        }
    }
}
