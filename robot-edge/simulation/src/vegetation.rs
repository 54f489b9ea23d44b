//! Grass, canes, twigs, bushes and crowns: many thin stems that a beam meets a few at a time.
//!
//! A stem is a straight round rod from foot to top, a blade of grass or a leaf a rod as thick as it looks
//! from the side. What stands in a world is decided by its file alone: patches are filled from seeds that
//! the file gives, so that the truth of a world does not depend on a run.

pub mod area;
pub mod growth;
pub mod stem;
pub mod wind;

mod bins;

use std::ops::Range;

use nalgebra::{Point3, Vector3};

use crate::vegetation::bins::Bins;
use crate::vegetation::stem::{Spot, Stem};
use crate::vegetation::wind::Wind;
use measurement::pose::Pose;

/// What happens to it when a vehicle drives into it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rigidity {
    /// It bends out of the way, and wind moves it.
    Flexible,
    /// It stops the vehicle, and wind does not move it.
    Rigid,
}

/// One `[[plants]]` of a world file, grown.
#[derive(Clone, Debug, PartialEq)]
pub struct Patch {
    /// What the file calls it; may be empty.
    pub name: String,
    /// Of all its stems.
    pub rigidity: Rigidity,
    /// Which of [`Vegetation::stems`] are its own.
    pub stems: Range<usize>,
}

/// All plants of a world, prepared for beams.
#[derive(Debug)]
pub struct Vegetation {
    stems: Vec<Stem>,
    patches: Vec<Patch>,
    wind: Wind,
    bins: Bins,
}

/// A beam as a cone of light.
#[derive(Clone, Copy, Debug)]
pub struct Cone {
    /// Its tip.
    pub origin: Point3<f64>,
    /// Unit vector.
    pub axis: Vector3<f64>,
    /// Radius of the spot one metre from the tip, metres.
    pub spread: f64,
}

/// A beam of which less than this is left goes no farther.
const SPENT: f64 = 0.005;

impl Vegetation {
    /// Prepares stems, which sway in `wind`; the patches say whose they are.
    pub fn new(stems: Vec<Stem>, patches: Vec<Patch>, wind: Wind) -> Self {
        let bins = Bins::new(&stems, &wind);
        Self {
            stems,
            patches,
            wind,
            bins,
        }
    }

    /// All stems, in the order of their patches.
    pub fn stems(&self) -> &[Stem] {
        &self.stems
    }

    /// The patches, in the file's order.
    pub fn patches(&self) -> &[Patch] {
        &self.patches
    }

    /// What moves them.
    pub fn wind(&self) -> &Wind {
        &self.wind
    }

    /// What light of `cone` falls on within `max_m`, at `time_s` seconds since the beginning, nearest
    /// first. Shares are those of the whole beam, what nearer stems took from it left out.
    ///
    /// Stems shade each other as if they stood at random across the beam: each takes its share of what is
    /// left.
    pub fn lit(&self, cone: &Cone, max_m: f64, time_s: f64) -> Vec<Spot> {
        let gust = self.wind.at(time_s);
        let mut spots: Vec<Spot> = Vec::new();
        let mut left = 1.0;
        self.bins.walk(cone, max_m, |stems, along_m| {
            let first = spots.len();
            let in_bin = stems
                .iter()
                .filter_map(|&stem| Spot::on(self.stems.get(stem as usize)?, cone, &gust))
                // A stem is in all bins that the cone may meet it in, but is lit in one of them.
                .filter(|spot| along_m.contains(&spot.distance_m));
            spots.extend(in_bin);
            let in_bin = spots.get_mut(first..).unwrap_or_default();
            in_bin.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
            for spot in in_bin {
                spot.share *= left;
                left -= spot.share;
            }
            left > SPENT
        });
        spots
    }

    /// What stands in the box between two corners while there is no wind; `None` where nothing does.
    pub fn standing_in(&self, min_m: Point3<f64>, max_m: Point3<f64>) -> Option<Rigidity> {
        self.in_box(min_m, max_m)
            .filter_map(|(stem, _)| self.rigidity(stem))
            .max()
    }

    /// Whether something rigid is in a box of edge lengths `size_m` about the origin of its own frame.
    pub fn has_rigid_in(&self, size_m: Vector3<f64>, world_from_box: &Pose) -> bool {
        let half_m = 0.5 * size_m;
        let turned = world_from_box.rotation.to_rotation_matrix();
        let reach_m = (turned.matrix().abs() * half_m).xy();
        let centre_m = Point3::from(world_from_box.translation.vector).xy();
        let corners = [-half_m, half_m].map(Point3::from);
        let box_from_world = world_from_box.inverse();
        self.bins
            .around([centre_m - reach_m, centre_m + reach_m])
            .filter(|&stem| self.rigidity(stem as usize) == Some(Rigidity::Rigid))
            .filter_map(|stem| self.stems.get(stem as usize))
            .any(|stem| stem.is_in(&box_from_world, corners))
    }

    /// Greatest height that something of that rigidity reaches in a box while there is no wind; `None`
    /// where it has none.
    pub fn highest_m(
        &self,
        min_m: Point3<f64>,
        max_m: Point3<f64>,
        rigidity: Rigidity,
    ) -> Option<f64> {
        self.in_box(min_m, max_m)
            .filter(|(stem, _)| self.rigidity(*stem) == Some(rigidity))
            .filter_map(|(stem, part)| {
                let stem = self.stems.get(stem)?;
                let rise_m = stem.top_m.z - stem.foot_m.z;
                let ends_m = part.map(|share| stem.foot_m.z + share * rise_m);
                Some((ends_m[0].max(ends_m[1]) + stem.radius_m).min(max_m.z))
            })
            .max_by(f64::total_cmp)
    }

    /// The stems that pass a box, and the part of each that does, by its length.
    fn in_box(
        &self,
        min_m: Point3<f64>,
        max_m: Point3<f64>,
    ) -> impl Iterator<Item = (usize, [f64; 2])> + '_ {
        self.bins
            .around([min_m.xy(), max_m.xy()])
            .filter_map(move |stem| {
                let stem = stem as usize;
                Some((stem, self.stems.get(stem)?.part_in(min_m, max_m)?))
            })
    }

    fn rigidity(&self, stem: usize) -> Option<Rigidity> {
        let patch = self
            .patches
            .partition_point(|patch| patch.stems.end <= stem);
        self.patches.get(patch).map(|patch| patch.rigidity)
    }
}

#[cfg(test)]
mod tests;
