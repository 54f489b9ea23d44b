//! Filling patches with stems.

use std::ops::Range;

use nalgebra::{Point2, Point3, Unit, Vector2, Vector3};
use serde::Deserialize;

use super::{Area, Phases, Stem};
use crate::noise::NoiseStream;
use crate::world::values::{NotNegative, PlantMetres, Positive, millimetres, points};

/// Least and greatest of numbers that are uniform in between.
pub(crate) type Between = [f64; 2];

pub(crate) enum Growth {
    Stems(Stand),
    Crowns(Crowns),
}

/// Stems side by side: grass, canes, twigs.
#[derive(Clone)]
pub(crate) struct Stand {
    pub(crate) area: Area,
    pub(crate) density_per_m2: f64,
    /// Grouping; without it, places are uniformly random.
    pub(crate) tufts: Option<Tufts>,
    /// Of the top above what the stem stands on.
    pub(crate) height_m: Between,
    pub(crate) thickness_m: Between,
    /// The most that a stem leans without wind, from upright.
    pub(crate) lean_rad: f64,
    pub(crate) shoots: Option<Shoots>,
}

/// Stems that grow from one root.
#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Tufts {
    pub(crate) stems: u32,
    #[serde(deserialize_with = "Positive::number")]
    pub(crate) radius_m: f64,
}

/// Leaves and side twigs of a stem, anywhere on its upper four fifths.
#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Shoots {
    pub(crate) count: u32,
    #[serde(deserialize_with = "PlantMetres::numbers")]
    pub(crate) length_m: Between,
    #[serde(rename = "thickness_mm", deserialize_with = "millimetres")]
    pub(crate) thickness_m: Between,
}

/// Crowns that look closed: upright spheroids with branches inside and leaves all over.
#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Crowns {
    /// One crown each.
    #[serde(deserialize_with = "points")]
    pub(crate) at_m: Vec<Point2<f64>>,
    #[serde(deserialize_with = "PlantMetres::numbers")]
    pub(crate) radius_m: Between,
    /// Of a crown's lowest point above what it stands on: 0 for a bush.
    #[serde(default, deserialize_with = "PlantMetres::numbers")]
    pub(crate) bottom_m: Between,
    /// From its lowest to its highest point.
    #[serde(deserialize_with = "PlantMetres::numbers")]
    pub(crate) height_m: Between,
    pub(crate) branches: u32,
    #[serde(rename = "branch_thickness_mm", deserialize_with = "millimetres")]
    pub(crate) branch_thickness_m: Between,
    /// For every square metre of the crown's surface.
    #[serde(deserialize_with = "NotNegative::number")]
    pub(crate) leaves_per_m2: f64,
    #[serde(deserialize_with = "PlantMetres::numbers")]
    pub(crate) leaf_length_m: Between,
    #[serde(rename = "leaf_thickness_mm", deserialize_with = "millimetres")]
    pub(crate) leaf_thickness_m: Between,
}

/// More than memory and time are given to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum TooMany {
    #[error(
        "more than {MAX_STEMS} stems, shoots, branches and leaves in all plants: make it thinner or smaller"
    )]
    Stems,
    #[error(
        "the rectangles around all plants hold more than {MAX_DRAWS} stems: make it thinner, or give a \
         crooked or slanting patch in parts"
    )]
    Draws,
}

/// At most 130 MB with their bins.
const MAX_STEMS: usize = 500_000;

/// Points that are drawn in the rectangles around patches to fill them.
const MAX_DRAWS: u32 = 5_000_000;

/// From where on a stem shoots grow.
const LOWEST_SHOOT: f64 = 0.2;

/// How deep in a crown leaves hang, by its radius: deeper there is no light for them.
const LEAF_DEPTH: f64 = 0.15;

/// Of a surface over a point, metres; `None` if there is none.
pub(crate) type Height<'a> = &'a dyn Fn(Point2<f64>) -> Option<f64>;

/// Grows one patch after the other.
pub(crate) struct PlantGenerator<'a> {
    bed_m: Height<'a>,
    ground_m: Height<'a>,
    stems: Vec<Stem>,
    draws_left: f64,
}

impl<'a> PlantGenerator<'a> {
    /// Plants are rooted in `bed_m` and their heights count from `ground_m`, which is higher where they
    /// stand in water; where either has no surface nothing grows.
    pub(crate) fn new(bed_m: Height<'a>, ground_m: Height<'a>) -> Self {
        Self {
            bed_m,
            ground_m,
            stems: Vec::new(),
            draws_left: f64::from(MAX_DRAWS),
        }
    }

    /// Grows a patch and gives the places of its stems. `reach` is how far wind of strength 1 moves a top,
    /// by its height: 0 where the plant is rigid.
    pub(crate) fn grow(
        &mut self,
        growth: &Growth,
        reach: f64,
        noise: NoiseStream,
    ) -> Result<Range<usize>, TooMany> {
        let first = self.stems.len();
        let mut bed = StandGenerator {
            generator: self,
            reach,
            noise,
        };
        match growth {
            Growth::Stems(stand) => bed.stand(stand)?,
            Growth::Crowns(crowns) => crowns
                .at_m
                .iter()
                .try_for_each(|&at| bed.crown(crowns, at))?,
        }
        Ok(first..self.stems.len())
    }

    pub(crate) fn into_stems(self) -> Vec<Stem> {
        self.stems
    }

    fn draws(&mut self, expected: f64) -> Result<usize, TooMany> {
        self.draws_left -= expected;
        if self.draws_left < 0.0 {
            return Err(TooMany::Draws);
        }
        Ok(libm::round(expected) as usize)
    }
}

struct StandGenerator<'b, 'a> {
    generator: &'b mut PlantGenerator<'a>,
    reach: f64,
    noise: NoiseStream,
}

impl StandGenerator<'_, '_> {
    fn stand(&mut self, stand: &Stand) -> Result<(), TooMany> {
        let [min, max] = stand.area.bounds_m();
        let expected = stand.density_per_m2 * (max.x - min.x) * (max.y - min.y);
        let stems = self.generator.draws(expected)?;
        let Some(Tufts {
            stems: of,
            radius_m,
        }) = stand.tufts
        else {
            return (0..stems).try_for_each(|_| {
                let at = self.place([min, max]);
                self.root(stand, at)
            });
        };
        let of = of.max(1) as usize;
        for first in (0..stems).step_by(of) {
            let middle = self.place([min, max]);
            for _ in first..stems.min(first + of) {
                // Evenly over the tuft's disc.
                let away_m = radius_m * libm::sqrt(self.between([0.0, 1.0]));
                let heading_rad = self.heading_rad();
                let (x, y) = (libm::cos(heading_rad), libm::sin(heading_rad));
                self.root(stand, middle + Vector2::new(x, y) * away_m)?;
            }
        }
        Ok(())
    }

    fn place(&mut self, [min, max]: [Point2<f64>; 2]) -> Point2<f64> {
        let x = self.between([min.x, max.x]);
        Point2::new(x, self.between([min.y, max.y]))
    }

    /// A stem where there is room for it.
    fn root(&mut self, stand: &Stand, at: Point2<f64>) -> Result<(), TooMany> {
        if stand.area.contains(at)
            && let Some(bed_m) = (self.generator.bed_m)(at)
            && let Some(ground_m) = (self.generator.ground_m)(at)
        {
            let foot_m = Point3::new(at.x, at.y, bed_m);
            return self.stem(stand, foot_m, ground_m - bed_m);
        }
        Ok(())
    }

    fn stem(
        &mut self,
        stand: &Stand,
        foot_m: Point3<f64>,
        submerged_m: f64,
    ) -> Result<(), TooMany> {
        let height_m = submerged_m + self.between(stand.height_m);
        let thickness_m = self.between(stand.thickness_m);
        let tangent = libm::tan(self.between([0.0, stand.lean_rad]));
        let heading_rad = self.heading_rad();
        let up = Vector3::new(
            height_m * tangent * libm::cos(heading_rad),
            height_m * tangent * libm::sin(heading_rad),
            height_m,
        );
        let phases = self.phases();
        let reach_m = self.reach * height_m;
        self.add(Stem {
            foot_m,
            top_m: foot_m + up,
            radius_m: 0.5 * thickness_m,
            reach_m: [0.0, reach_m],
            phases,
        })?;
        let Some(shoots) = stand.shoots else {
            return Ok(());
        };
        for _ in 0..shoots.count {
            let share = self.between([LOWEST_SHOOT, 1.0]);
            let length_m = self.between(shoots.length_m);
            let thickness_m = self.between(shoots.thickness_m);
            let heading_rad = self.heading_rad();
            // Between level and upright.
            let rise_rad = self.between([0.0, std::f64::consts::FRAC_PI_2]);
            let level_m = length_m * libm::cos(rise_rad);
            let along = Vector3::new(
                level_m * libm::cos(heading_rad),
                level_m * libm::sin(heading_rad),
                length_m * libm::sin(rise_rad),
            );
            let foot_m = foot_m + up * share;
            self.add(Stem {
                foot_m,
                top_m: foot_m + along,
                radius_m: 0.5 * thickness_m,
                reach_m: [share * reach_m, share * reach_m + self.reach * length_m],
                phases,
            })?;
        }
        Ok(())
    }

    fn crown(&mut self, crowns: &Crowns, at: Point2<f64>) -> Result<(), TooMany> {
        let radius_m = self.between(crowns.radius_m);
        let bottom_m = self.between(crowns.bottom_m);
        let half_height_m = 0.5 * self.between(crowns.height_m);
        let Some(ground_m) = (self.generator.ground_m)(at) else {
            return Ok(());
        };
        let fork_m = Point3::new(at.x, at.y, ground_m + bottom_m);
        let centre_m = fork_m + Vector3::new(0.0, 0.0, half_height_m);
        let axes_m = Vector3::new(radius_m, radius_m, half_height_m);
        // A crown moves as a whole: its leaves are on branches.
        let phases = self.phases();
        let reach_of = |reach: f64, z: f64| reach * (z - ground_m).max(0.0);
        for _ in 0..crowns.branches {
            let thickness_m = self.between(crowns.branch_thickness_m);
            let end = self.direction().component_mul(&axes_m) * (1.0 - LEAF_DEPTH);
            let top_m = centre_m + end;
            self.add(Stem {
                foot_m: fork_m,
                top_m,
                radius_m: 0.5 * thickness_m,
                reach_m: [fork_m.z, top_m.z].map(|z| reach_of(self.reach, z)),
                phases,
            })?;
        }
        let leaves = crowns.leaves_per_m2 * spheroid_m2(radius_m, half_height_m);
        for _ in 0..self.generator.draws(leaves)? {
            let depth = self.between([0.0, LEAF_DEPTH]);
            let foot_m = centre_m + self.direction().component_mul(&axes_m) * (1.0 - depth);
            let length_m = self.between(crowns.leaf_length_m);
            let thickness_m = self.between(crowns.leaf_thickness_m);
            let top_m = foot_m + self.direction().into_inner() * length_m;
            if foot_m.z.min(top_m.z) < ground_m {
                continue;
            }
            // Leaves flutter, each on its own.
            let phases = self.phases();
            self.add(Stem {
                foot_m,
                top_m,
                radius_m: 0.5 * thickness_m,
                reach_m: [foot_m.z, top_m.z].map(|z| reach_of(self.reach, z)),
                phases,
            })?;
        }
        Ok(())
    }

    fn add(&mut self, stem: Stem) -> Result<(), TooMany> {
        let stems = &mut self.generator.stems;
        if stems.len() == MAX_STEMS {
            return Err(TooMany::Stems);
        }
        stems.push(stem);
        Ok(())
    }

    fn between(&mut self, [least, most]: Between) -> f64 {
        least + (most - least) * self.noise.uniform()
    }

    fn heading_rad(&mut self) -> f64 {
        self.between([0.0, std::f64::consts::TAU])
    }

    fn direction(&mut self) -> Unit<Vector3<f64>> {
        let z = self.between([-1.0, 1.0]);
        let heading_rad = self.heading_rad();
        let level = libm::sqrt(1.0 - z * z);
        Unit::new_unchecked(Vector3::new(
            level * libm::cos(heading_rad),
            level * libm::sin(heading_rad),
            z,
        ))
    }

    fn phases(&mut self) -> Phases {
        std::array::from_fn(|_| {
            let angle_rad = self.heading_rad();
            [libm::sin(angle_rad) as f32, libm::cos(angle_rad) as f32]
        })
    }
}

/// Surface of a spheroid of these half axes, to 1.1 % (Thomsen's formula).
fn spheroid_m2(level_m: f64, upright_m: f64) -> f64 {
    const P: f64 = 1.6075;
    let [level, both] = [level_m * level_m, level_m * upright_m].map(|m2| libm::pow(m2, P));
    4.0 * std::f64::consts::PI * libm::pow((level + 2.0 * both) / 3.0, 1.0 / P)
}
