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

use std::collections::BTreeMap;
use std::f64::consts::{SQRT_2, TAU};
use std::ops::Range;

use nalgebra::{Point2, Vector2};

use crate::grid::CellIndex;
use crate::rigidity::REACH;
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
    let window = DockingGrid::new(first, width, cell_m, columns, vegetation);
    let shapes = DockingTemplates::new(boat, &window);
    let docking_poses = shapes.docking_poses(&window);
    let marked = covered(&window, &shapes, &docking_poses);
    let sets = match vegetation {
        None => connected(&marked, &window),
        Some(_) => by_shore(&marked, &window),
    };
    let mut set_of = vec![usize::MAX; columns.len()];
    for (set, places) in sets.iter().enumerate() {
        for &at in places {
            set_of[at] = set;
        }
    }
    let mut poses_of = vec![Vec::new(); sets.len()];
    for docking_pose in docking_poses {
        if let Some(poses) = poses_of.get_mut(set_of[docking_pose.centre]) {
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
    let window = DockingGrid::new(first, width, cell_m, columns, site.vegetation);
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
    let poses = steps.iter().scan(0, |poses, step| {
        *poses += step;
        Some(*poses)
    });
    let columns = (0..window.columns().len()).zip(poses);
    columns
        .map(|(at, poses)| poses > 0 && window.is_sought(at))
        .collect()
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

/// A rectangle of columns.
#[derive(Debug)]
struct DockingGrid<'a> {
    first: CellIndex,
    width: usize,
    cell_m: f64,
    columns: &'a [DockingColumn],
    /// The densest vegetation that counts as moderate; `None` if none does.
    vegetation: Option<ShoreClass>,
    /// Per row: number of columns of each kind before each column, and in the whole row.
    before: Vec<Counts>,
    /// Summed area table: clear water and lethal columns before each corner along both axes.
    below: Vec<[u32; 2]>,
}

/// Cells relative to a middle one, from the first of each up to before the second.
#[derive(Clone, Copy, Debug, Default)]
struct CellBox {
    x: [i32; 2],
    y: [i32; 2],
}

/// Kind of a column for a boat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ground {
    ClearWater,
    /// Cost above 0 and below 1.
    Moderate,
    Lethal,
    /// Unknown, or level land.
    Other,
}

/// Number of columns of each kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Counts {
    water: u32,
    moderate: u32,
    lethal: u32,
    /// Above the water and not lethal.
    land: u32,
}

impl<'a> DockingGrid<'a> {
    /// `columns` are row by row, y upwards, `width` in a row; the first is cell `first`. An
    /// incomplete last row is ignored. Vegetation up to `vegetation` counts as moderate.
    fn new(
        first: CellIndex,
        width: usize,
        cell_m: f64,
        columns: &'a [DockingColumn],
        vegetation: Option<ShoreClass>,
    ) -> Self {
        let rows = columns.len().checked_div(width).unwrap_or(0);
        let columns = &columns[..rows * width];
        let mut before = Vec::with_capacity(rows * (width + 1));
        let mut below = vec![[0; 2]; (rows + 1) * (width + 1)];
        for (y, row) in columns.chunks_exact(width.max(1)).enumerate() {
            let mut counts = Counts::default();
            before.push(counts);
            for (x, column) in row.iter().enumerate() {
                counts.add(*column, vegetation);
                before.push(counts);
                let [water, lethal] = below[y * (width + 1) + x + 1];
                below[(y + 1) * (width + 1) + x + 1] =
                    [water + counts.water, lethal + counts.lethal];
            }
        }
        Self {
            first,
            width,
            cell_m,
            columns,
            vegetation,
            before,
            below,
        }
    }

    const fn cell_m(&self) -> f64 {
        self.cell_m
    }

    const fn columns(&self) -> &[DockingColumn] {
        self.columns
    }

    fn ground(&self, at: usize) -> Ground {
        Ground::of(self.columns[at], self.vegetation)
    }

    /// Whether a site may be made of this column: of a gentle slope, or of the densest vegetation
    /// that counts.
    fn is_sought(&self, at: usize) -> bool {
        let found = self.columns[at].vegetation.map(|found| found.class);
        self.ground(at) == Ground::Moderate
            && (self.vegetation.is_none() || found == self.vegetation)
    }

    /// Whether vegetation that counts grows there, or close by and nothing else is in the way: stems
    /// sway, and not each is mapped.
    fn is_passable(&self, at: usize) -> bool {
        let is_vegetation = |at: usize| {
            let found = self.columns[at].vegetation.map(|found| found.class);
            found.is_some() && found <= self.vegetation
        };
        let mut around = vec![at];
        for _ in 0..REACH {
            around = around.iter().flat_map(|&at| self.neighbours(at)).collect();
        }
        self.ground(at) != Ground::Lethal && around.into_iter().any(is_vegetation)
    }

    const fn width(&self) -> usize {
        self.width
    }

    fn rows(&self) -> usize {
        self.columns.len().checked_div(self.width).unwrap_or(0)
    }

    fn cell(&self, at: usize) -> CellIndex {
        CellIndex {
            x: self
                .first
                .x
                .saturating_add_unsigned((at % self.width) as u32),
            y: self
                .first
                .y
                .saturating_add_unsigned((at / self.width) as u32),
        }
    }

    /// Metres in `odom`.
    fn centre(&self, at: usize) -> Point2<f64> {
        self.cell(at).centre(self.cell_m)
    }

    /// Columns that touch one, also across corners, itself included.
    fn neighbours(&self, at: usize) -> impl Iterator<Item = usize> + use<> {
        let (x, y) = (at % self.width, at / self.width);
        let (width, rows) = (self.width, self.rows());
        let ys = y.saturating_sub(1)..(y + 2).min(rows);
        ys.flat_map(move |y| {
            let xs = x.saturating_sub(1)..(x + 2).min(width);
            xs.map(move |x| y * width + x)
        })
    }

    /// Columns of clear water, and lethal ones, in a box around a column, clipped to the window.
    fn water_and_lethal(&self, at: usize, cells: CellBox) -> [u32; 2] {
        let clip = |middle: usize, cells: [i32; 2], end: usize| {
            cells.map(|cells| middle.saturating_add_signed(cells as isize).min(end))
        };
        let [from_x, to_x] = clip(at % self.width, cells.x, self.width);
        let [from_y, to_y] = clip(at / self.width, cells.y, self.rows());
        let before = |x: usize, y: usize| self.below[y * (self.width + 1) + x];
        let (all, left) = (before(to_x, to_y), before(from_x, to_y));
        let (below, both) = (before(to_x, from_y), before(from_x, from_y));
        [0, 1].map(|kind| all[kind] + both[kind] - left[kind] - below[kind])
    }

    /// Indices of columns `from .. to` of a row, clipped to the window.
    fn row_span(&self, y: isize, from: isize, to: isize) -> Range<usize> {
        if y < 0 || y.cast_unsigned() >= self.rows() {
            return 0..0;
        }
        let within = |x: isize| x.max(0).cast_unsigned().min(self.width);
        let row = y.cast_unsigned() * self.width;
        let from = within(from);
        row + from..row + within(to).max(from)
    }

    fn counts(&self, row_span: Range<usize>) -> Counts {
        if row_span.is_empty() {
            return Counts::default();
        }
        // Each row has one count more than columns.
        let row = row_span.start / self.width;
        let (start, end) = (
            self.before[row_span.start + row],
            self.before[row_span.end + row],
        );
        Counts {
            water: end.water - start.water,
            moderate: end.moderate - start.moderate,
            lethal: end.lethal - start.lethal,
            land: end.land - start.land,
        }
    }
}

impl Ground {
    fn of(column: DockingColumn, vegetation: Option<ShoreClass>) -> Self {
        let found = column.vegetation.map(|found| found.class);
        if found.is_some() && found <= vegetation {
            Self::Moderate
        } else if column.is_clear_water {
            Self::ClearWater
        } else if column.cost >= 1.0 {
            Self::Lethal
        } else if column.cost > 0.0 {
            Self::Moderate
        } else {
            Self::Other
        }
    }
}

impl Counts {
    fn add(&mut self, column: DockingColumn, vegetation: Option<ShoreClass>) {
        match Ground::of(column, vegetation) {
            Ground::ClearWater => self.water += 1,
            Ground::Lethal => self.lethal += 1,
            Ground::Moderate => {
                self.moderate += 1;
                self.land += u32::from(column.rises_from_water);
            }
            Ground::Other => self.land += u32::from(column.rises_from_water),
        }
    }
}

impl std::ops::AddAssign for Counts {
    fn add_assign(&mut self, other: Self) {
        self.water += other.water;
        self.moderate += other.moderate;
        self.lethal += other.lethal;
        self.land += other.land;
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

impl CellBox {
    /// All cells that many steps away, also across corners.
    const fn around(steps: i32) -> Self {
        Self {
            x: [-steps, steps + 1],
            y: [-steps, steps + 1],
        }
    }
}

impl DockingTemplates {
    fn new(boat: &BoatFootprint, window: &DockingGrid<'_>) -> Self {
        let cells = |metres: f64| metres / window.cell_m();
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
            let is_slope = window.vegetation.is_none();
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

    const fn headings(&self) -> usize {
        self.shapes.len()
    }

    /// Direction of the bow.
    fn direction(&self, heading: usize) -> Vector2<f64> {
        self.shapes[heading].direction
    }

    /// All docking poses, by position and heading.
    fn docking_poses(&self, window: &DockingGrid<'_>) -> Vec<DockingPose> {
        let mut docking_poses = Vec::new();
        for centre in 0..window.columns().len() {
            // Cheap tests first.
            if !window.is_sought(centre)
                || window.water_and_lethal(centre, self.water_box)[0] == 0
                || window.water_and_lethal(centre, self.clearance_box)[1] > 0
            {
                continue;
            }
            for (heading, shape) in self.shapes.iter().enumerate() {
                let water = window.water_and_lethal(centre, shape.water.bounds)[0];
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
        shape.cell_ranges(window, docking_pose.centre)
    }
}

impl DockingTemplate {
    fn is_docking_pose(&self, window: &DockingGrid<'_>, centre: usize) -> bool {
        let below = self.footprint_mask.counts(window, centre);
        let holds = |below: &Counts| below.moderate >= self.min_moderate;
        let Some(below) = below.filter(holds) else {
            return false;
        };
        let behind = self.water.counts(window, centre);
        let is_open =
            |behind: Counts| behind.water >= self.min_water && behind.moderate < self.min_closed;
        behind.is_some_and(is_open)
            && (below.land >= self.min_land || self.leads_to_land(window, centre))
    }

    /// A sonar measures the bed of shallow water as gentle as a beach. A shoal differs by having no
    /// land behind it.
    fn leads_to_land(&self, window: &DockingGrid<'_>, centre: usize) -> bool {
        let ahead = self.ahead.counts(window, centre);
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

    /// Index ranges of its cells, clipped to the window.
    fn cell_ranges<'a>(
        &'a self,
        window: &'a DockingGrid<'_>,
        centre: usize,
    ) -> impl Iterator<Item = Range<usize>> + 'a {
        let (x, y) = (
            (centre % window.width()).cast_signed(),
            (centre / window.width()).cast_signed(),
        );
        self.row_spans.iter().map(move |row_span| {
            let along = |cells: i32| x + cells as isize;
            window.row_span(
                y + row_span.y as isize,
                along(row_span.from),
                along(row_span.to),
            )
        })
    }

    /// Counts on its cells; `None` if any is lethal.
    fn counts(&self, window: &DockingGrid<'_>, centre: usize) -> Option<Counts> {
        let mut counts = Counts::default();
        for row_span in self.cell_ranges(window, centre) {
            counts += window.counts(row_span);
            if counts.lethal > 0 {
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
            let window = DockingGrid::new(CellIndex { x: 0, y: 0 }, 16, 1.0, &columns, None);
            let shapes = DockingTemplates::new(&boat, &window);
            let all = (0..256).flat_map(|centre| {
                let headings = 0..shapes.headings();
                headings.map(move |heading| DockingPose { centre, heading })
            });
            let docking_poses = all.filter(|docking_pose| {
                window.ground(docking_pose.centre) == Ground::Moderate
                    && shapes.shapes[docking_pose.heading].is_docking_pose(&window, docking_pose.centre)
            });
            prop_assert_eq!(shapes.docking_poses(&window), docking_poses.collect::<Vec<_>>());
        }
    }
}
