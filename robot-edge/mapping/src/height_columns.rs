//! Columns of the octree: where the ground is in each, and what stands on it (\[HYB\] §5.1).

use super::cost_config::Surface;
use super::octree::{BrickColumn, Octree, SurfaceVoxel};
use super::voxel::VoxelIndex;

/// Columns along the edge of a tile: those of a column of bricks.
pub(super) const TILE_EDGE: usize = 4;
/// [`TILE_EDGE`] for indices, which are signed.
pub(super) const TILE_EDGE_COLUMNS: i32 = 4;
/// Columns of a tile.
pub(super) const TILE_COLUMNS: usize = 16;

/// What is known of a column.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColumnKind {
    /// Nothing in the interval that counts.
    #[default]
    Unknown,
    /// The ground was hit.
    Sampled,
    /// The lowest known voxel is free: the ground is taken to lie just beneath it.
    Inferred,
    /// Water without an obstacle at its surface: seen through down to there.
    Water,
    /// Seen over from the water, not down to it: nobody knows what is beneath.
    Occluded,
    /// Beside water: nothing was seen through beneath what was hit, which may be land that rises from it.
    Bank,
}

/// One column of voxels, reduced to two levels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Column {
    /// What is known.
    pub kind: ColumnKind,
    /// z of the ground's voxel.
    pub ground_z: i32,
    /// z of the highest occupied voxel that stands in the vehicle's way; that of the ground where there is none.
    pub top_z: i32,
    /// Where in the ground's voxel the ground is: x and y from the column's least corner, z of `odom`, metres. Of
    /// [`ColumnKind::Bank`] the lowest that was hit, of [`ColumnKind::Water`] and [`ColumnKind::Occluded`] the upper
    /// side of the lowest voxel that was seen through: a beam may have passed just beneath that side, and the ground
    /// be all but as high.
    pub ground_m: [f32; 3],
    /// The same of the top.
    pub top_m: [f32; 3],
    /// Radius of the smallest spot of light that hit the top, metres; 0 where nothing hit it.
    pub top_spot_m: f32,
}

/// How columns are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ColumnRules {
    /// What the vehicle moves on.
    pub surface: Surface,
    /// Lowest voxel that is looked at; on water that of the vehicle's lowest point.
    pub from_z: i32,
    /// Highest voxel that may be the ground.
    pub to_z: i32,
    /// Highest voxel that the water's surface may lie in; only on water.
    pub water_z: i32,
    /// Height of the vehicle, voxels.
    pub height: i32,
}

impl ColumnRules {
    /// Highest voxel that is looked at.
    pub const fn highest_z(&self) -> i32 {
        self.to_z + self.height
    }
}

/// Reads the sixteen columns of a column of bricks, rows of growing y.
pub fn read_columns(
    octree: &Octree,
    at: BrickColumn,
    rules: &ColumnRules,
) -> [Column; TILE_COLUMNS] {
    let mut levels = match rules.surface {
        Surface::Land => Levels::new(u16::MAX, rules.from_z),
        Surface::Water => Levels::on_water(rules.from_z),
    };
    let highest = rules.highest_z();
    for layers in octree.columns(at, rules.from_z, highest) {
        if levels.are_found(layers.z, rules) {
            break;
        }
        for (n, (&known, &occupied)) in (0..).zip(layers.known.iter().zip(&layers.occupied)) {
            let z = layers.z + n;
            if (rules.from_z..=highest).contains(&z) {
                levels.add(z, known, occupied, rules);
            }
        }
    }
    std::array::from_fn(|column| {
        let (x, y) = offset(column);
        let at = |z| VoxelIndex {
            x: at.x * 4 + x,
            y: at.y * 4 + y,
            z,
        };
        match levels.kind(column, rules) {
            ColumnKind::Unknown => Column::default(),
            kind @ (ColumnKind::Sampled
            | ColumnKind::Inferred
            | ColumnKind::Water
            | ColumnKind::Occluded
            | ColumnKind::Bank) => {
                let (ground_z, top_z) = (levels.ground_z[column], levels.top_z[column]);
                let lowest = levels.lowest_z[column];
                Column {
                    kind,
                    ground_z,
                    top_z,
                    ground_m: match kind {
                        ColumnKind::Bank => surface_m(octree, at(lowest)),
                        ColumnKind::Water | ColumnKind::Occluded => {
                            [0.5, 0.5, f64::from(lowest) + 1.0]
                                .map(|n| (n * octree.cell_m()) as f32)
                        }
                        ColumnKind::Unknown | ColumnKind::Sampled | ColumnKind::Inferred => {
                            surface_m(octree, at(ground_z))
                        }
                    },
                    top_m: surface_m(octree, at(top_z)),
                    top_spot_m: spot_m(octree, at(top_z)),
                }
            }
        }
    })
}

/// Where a column lies in its tile.
pub(super) fn offset(column: usize) -> (i32, i32) {
    let column = (column % TILE_COLUMNS) as u8;
    let edge = TILE_EDGE as u8;
    (i32::from(column % edge), i32::from(column / edge))
}

/// Where the surface in a voxel is: the mean of its hits, else its centre. x and y from its least corner.
fn surface_m(octree: &Octree, voxel: VoxelIndex) -> [f32; 3] {
    let cell_m = octree.cell_m();
    let mean = octree
        .surface(voxel)
        .map_or([0.5; 3], |surface| surface.mean().into());
    let [x, y, z]: [f64; 3] = mean;
    [x, y, f64::from(voxel.z) + z].map(|voxels| (voxels * cell_m) as f32)
}

/// Radius of the smallest spot of light that hit a voxel.
fn spot_m(octree: &Octree, voxel: VoxelIndex) -> f32 {
    let spot = octree.surface(voxel).map_or(0.0, SurfaceVoxel::spot);
    (spot * octree.cell_m()) as f32
}

/// Ground and top of sixteen columns while their layers are read upwards.
struct Levels {
    /// Columns whose ground is still to be found, a bit for each.
    pending: u16,
    /// Columns whose ground was hit.
    hit: u16,
    /// Columns of which something is known in the interval that counts.
    known: u16,
    /// Columns on water whose lowest known voxel was hit, or the one above it.
    bank: u16,
    /// Columns on water of which a voxel is known.
    begun: u16,
    /// The highest ground of any column so far.
    highest_ground_z: i32,
    ground_z: [i32; TILE_COLUMNS],
    top_z: [i32; TILE_COLUMNS],
    /// On water, the lowest known voxel; where the next one was hit, that.
    lowest_z: [i32; TILE_COLUMNS],
}

impl Levels {
    const fn new(pending: u16, z: i32) -> Self {
        Self {
            pending,
            hit: 0,
            known: 0,
            bank: 0,
            begun: 0,
            highest_ground_z: z,
            ground_z: [z; TILE_COLUMNS],
            top_z: [z; TILE_COLUMNS],
            lowest_z: [z; TILE_COLUMNS],
        }
    }

    /// The ground is the water's surface everywhere.
    const fn on_water(z: i32) -> Self {
        Self::new(0, z)
    }

    /// Whether nothing from a layer upwards can change what was found: most of what is read is air above the vehicle.
    const fn are_found(&self, z: i32, rules: &ColumnRules) -> bool {
        let is_land = matches!(rules.surface, Surface::Land);
        is_land && self.pending == 0 && z > self.highest_ground_z + rules.height
    }

    fn add(&mut self, z: i32, known: u16, occupied: u16, rules: &ColumnRules) {
        let found = if z <= rules.to_z {
            known & self.pending
        } else {
            0
        };
        for column in columns(found) {
            let is_hit = occupied >> column & 1 == 1;
            self.ground_z[column] = if is_hit { z } else { z - 1 };
            self.top_z[column] = self.ground_z[column];
            self.highest_ground_z = self.highest_ground_z.max(self.ground_z[column]);
        }
        self.pending &= !found;
        if rules.surface == Surface::Water {
            self.find_lowest(z, known, occupied);
        }
        let reached = |ground_z: i32| z <= ground_z + rules.height;
        for column in columns(known & !self.pending) {
            if reached(self.ground_z[column]) {
                self.known |= 1 << column;
                if occupied >> column & 1 == 1 {
                    self.top_z[column] = z;
                    if z == self.ground_z[column] {
                        self.hit |= 1 << column;
                    }
                }
            }
        }
    }

    /// Of a slope that beams graze, one may pass through the lower part of a column and another hit its upper part.
    fn find_lowest(&mut self, z: i32, known: u16, occupied: u16) {
        for column in columns(known) {
            let bit = 1 << column;
            let is_first = self.begun & bit == 0;
            if is_first {
                self.begun |= bit;
                self.lowest_z[column] = z;
            }
            let is_next = z == self.lowest_z[column] + 1 && self.bank & bit == 0;
            if occupied & bit != 0 && (is_first || is_next) {
                self.bank |= bit;
                self.lowest_z[column] = z;
            }
        }
    }

    const fn kind(&self, column: usize, rules: &ColumnRules) -> ColumnKind {
        let (is_known, is_hit) = (self.known >> column & 1 == 1, self.hit >> column & 1 == 1);
        let is_bank = self.bank >> column & 1 == 1;
        match (is_known, is_hit, rules.surface) {
            (false, _, _) => ColumnKind::Unknown,
            (true, true, _) => ColumnKind::Sampled,
            (true, false, Surface::Land) => ColumnKind::Inferred,
            (true, false, Surface::Water) if is_bank => ColumnKind::Bank,
            (true, false, Surface::Water) if self.lowest_z[column] <= rules.water_z => {
                ColumnKind::Water
            }
            (true, false, Surface::Water) => ColumnKind::Occluded,
        }
    }
}

/// The numbers of the bits that are set.
fn columns(mut set: u16) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let column = set.trailing_zeros() as usize;
        set &= set.wrapping_sub(1);
        (column < TILE_COLUMNS).then_some(column)
    })
}
