//! Grass, canes, twigs, bushes and crowns: many thin stems that a beam meets a few at a time.
//!
//! A stem is a straight round rod from foot to top, a blade of grass or a leaf a rod as thick as it looks
//! from the side. What stands in a world is decided by its file alone: patches are filled from seeds that
//! the file gives, so that the truth of a world does not depend on a run.

mod bins;
pub(crate) mod growth;

use std::ops::Range;

use measurement::pose::Pose;
use nalgebra::{Point2, Point3, Vector2, Vector3};
use serde::{Deserialize, Deserializer};

use self::bins::Bins;
use crate::world::values::{Coordinate, Positive, Probability};

/// Behaviour when a vehicle drives into it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rigidity {
    /// It bends out of the way, and wind moves it.
    Flexible,
    /// It stops the vehicle, and wind does not move it.
    Rigid,
}

/// One `[[plants]]` of a world file, grown.
#[derive(Clone, Debug, PartialEq)]
pub struct Patch {
    /// Name in the file; may be empty.
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
    pub(crate) wind: Wind,
    bins: Bins,
}

/// A beam as a cone of light.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cone {
    pub(crate) origin: Point3<f64>,
    /// Unit vector.
    pub(crate) axis: Vector3<f64>,
    /// Radius of the spot one metre from the tip, metres.
    pub(crate) spread: f64,
}

/// A beam of which less than this is left goes no farther.
const SPENT: f64 = 0.005;

impl Vegetation {
    /// Prepares stems, which sway in `wind`; each belongs to a patch.
    pub(crate) fn new(stems: Vec<Stem>, patches: Vec<Patch>, wind: Wind) -> Self {
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

    /// What light of `cone` falls on within `max_m`, at `time_s` seconds since the beginning, nearest
    /// first. Shares are those of the whole beam, what nearer stems took from it left out.
    ///
    /// Stems shade each other as if they stood at random across the beam: each takes its share of what is
    /// left.
    pub(crate) fn lit(&self, cone: &Cone, max_m: f64, time_s: f64) -> Vec<Spot> {
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
    pub(crate) fn has_rigid_in(&self, size_m: Vector3<f64>, world_from_box: &Pose) -> bool {
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

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Area {
    /// From least to greatest x and y.
    Rectangle([Point2<f64>; 2]),
    /// Inside of an outline; of one that crosses itself, what an odd number of turns goes around.
    Polygon(Vec<Point2<f64>>),
    /// What is no farther from a line than half its width.
    Strip {
        along_m: Vec<Point2<f64>>,
        width_m: f64,
    },
}

impl Area {
    pub(crate) fn contains(&self, at: Point2<f64>) -> bool {
        match self {
            Self::Rectangle([min, max]) => {
                (0..2).all(|axis| min[axis] <= at[axis] && at[axis] <= max[axis])
            }
            Self::Polygon(corners) => is_inside(corners, at),
            Self::Strip { along_m, width_m } => along_m
                .windows(2)
                .any(|piece| distance_m(piece[0], piece[1], at) <= 0.5 * width_m),
        }
    }

    pub(crate) fn bounds_m(&self) -> [Point2<f64>; 2] {
        let (corners, grown): (&[_], f64) = match self {
            Self::Rectangle(corners) => (corners, 0.0),
            Self::Polygon(corners) => (corners, 0.0),
            Self::Strip { along_m, width_m } => (along_m, 0.5 * width_m),
        };
        let start = [f64::INFINITY, f64::NEG_INFINITY].map(|m| Point2::new(m, m));
        let [min, max] = corners.iter().fold(start, |[min, max], corner| {
            [min.inf(corner), max.sup(corner)]
        });
        let grown = nalgebra::Vector2::repeat(grown);
        [min - grown, max + grown]
    }
}

/// Whether an outline goes around a point.
pub fn is_inside(outline: &[Point2<f64>], at: Point2<f64>) -> bool {
    let next = outline.iter().cycle().skip(1);
    let crossings = outline
        .iter()
        .zip(next)
        .filter(|(a, b)| (a.y > at.y) != (b.y > at.y))
        .filter(|(a, b)| at.x < a.x + (b.x - a.x) * (at.y - a.y) / (b.y - a.y));
    crossings.count() % 2 == 1
}

fn distance_m(a: Point2<f64>, b: Point2<f64>, at: Point2<f64>) -> f64 {
    let along = b - a;
    let length_squared = along.norm_squared();
    let share = if length_squared > 0.0 {
        ((at - a).dot(&along) / length_squared).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (a + along * share - at).norm()
}

/// A straight round rod.
#[derive(Clone, Debug, PartialEq)]
pub struct Stem {
    /// Its lower end without wind, in the world.
    pub foot_m: Point3<f64>,
    /// Its upper end without wind, in the world.
    pub top_m: Point3<f64>,
    /// Half its thickness, metres.
    pub radius_m: f64,
    /// How far wind of strength 1 moves its foot and its top, metres: 0 and 0 where it is rigid. A foot
    /// that moves is that of a leaf on a stem.
    pub reach_m: [f64; 2],
    /// Where its swinging begins.
    pub phases: Phases,
}

/// What a beam lights of a stem.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Spot {
    /// Along the beam's axis to the middle of what is lit, metres.
    pub(crate) distance_m: f64,
    /// Share of the beam that falls on it.
    pub(crate) share: f64,
}

/// A line has no cross section; this is that of a needle.
const THINNEST_M: f64 = 1e-6;

impl Stem {
    pub(crate) fn ends_m(&self, gust: &Gust) -> [Point3<f64>; 2] {
        if self.reach_m == [0.0, 0.0] {
            return [self.foot_m, self.top_m];
        }
        let offset = gust.offset(&self.phases);
        let moved = |end: Point3<f64>, reach_m: f64| {
            Point3::new(
                end.x + reach_m * offset.x,
                end.y + reach_m * offset.y,
                end.z,
            )
        };
        [
            moved(self.foot_m, self.reach_m[0]),
            moved(self.top_m, self.reach_m[1]),
        ]
    }

    /// The part of it, without wind, that is in a box grown by its radius: shares of its length.
    fn part_in(&self, min_m: Point3<f64>, max_m: Point3<f64>) -> Option<[f64; 2]> {
        part_of([self.foot_m, self.top_m], self.radius_m, [min_m, max_m])
    }

    /// Whether a part of it, without wind, is in a box grown by its radius, whose least and greatest corners
    /// are given in its own frame.
    fn is_in(&self, box_from_world: &Pose, corners_m: [Point3<f64>; 2]) -> bool {
        let ends_m = [self.foot_m, self.top_m].map(|end| box_from_world * end);
        part_of(ends_m, self.radius_m, corners_m).is_some()
    }

    fn swept_m(&self, wind: &Wind) -> [Point2<f64>; 2] {
        let reach_m = self.reach_m[0].max(self.reach_m[1]);
        let grown = Vector2::repeat(self.radius_m + wind.farthest_m(reach_m));
        let (foot, top) = (self.foot_m.xy(), self.top_m.xy());
        [foot.inf(&top) - grown, foot.sup(&top) + grown]
    }
}

/// The part of a rod between `ends_m` that is in a box grown by its radius: shares of its length.
fn part_of(
    [from_m, to_m]: [Point3<f64>; 2],
    radius_m: f64,
    [min_m, max_m]: [Point3<f64>; 2],
) -> Option<[f64; 2]> {
    let grown = Vector3::repeat(radius_m);
    let (least, most) = (min_m - grown - from_m, max_m + grown - from_m);
    clipped(
        (to_m - from_m).into(),
        least.into(),
        most.into(),
        [0.0, 1.0],
    )
}

/// The part of a line in a box, edges included, as multiples of `along` within `part` (clipping by Liang and
/// Barsky). The corners of the box are given from where the line begins.
pub fn clipped<const N: usize>(
    along: [f64; N],
    least: [f64; N],
    most: [f64; N],
    mut part: [f64; 2],
) -> Option<[f64; 2]> {
    for axis in 0..N {
        if along[axis] == 0.0 {
            if least[axis] > 0.0 || most[axis] < 0.0 {
                return None;
            }
        } else {
            let ends = [least[axis] / along[axis], most[axis] / along[axis]];
            part[0] = part[0].max(ends[0].min(ends[1]));
            part[1] = part[1].min(ends[0].max(ends[1]));
        }
    }
    (part[0] <= part[1]).then_some(part)
}

impl Spot {
    /// What `cone` lights of `stem`; `None` if it passes by.
    ///
    /// Across the beam the stem is a strip that may end within the spot. The strip's area is its width
    /// times its length in its middle: off by at most 4 % of the spot where it is a third as wide.
    pub(crate) fn on(stem: &Stem, cone: &Cone, gust: &Gust) -> Option<Self> {
        let [foot, top] = stem.ends_m(gust);
        let along: Vector3<f64> = top - foot;
        let from_tip = foot - cone.origin;
        // Feet of the perpendicular between the axis and the stem's line: `s` along the axis in metres,
        // `u` along the stem by its length.
        let (b, c) = (cone.axis.dot(&along), along.norm_squared());
        let (axis_foot, along_foot) = (cone.axis.dot(&from_tip), along.dot(&from_tip));
        let across_squared = (c - b * b).max(THINNEST_M * THINNEST_M);
        let u = (b * axis_foot - along_foot) / across_squared;
        let s = axis_foot + u * b;
        // Of a stem along the beam the perpendicular may be far beyond its ends.
        let nearest_s = axis_foot + u.clamp(0.0, 1.0) * b;
        let spot_m = (cone.spread * nearest_s).max(THINNEST_M);
        let apart_squared = (from_tip + along * u - cone.axis * s).norm_squared();
        let touch_m = spot_m + stem.radius_m;
        if nearest_s <= 0.0 || apart_squared >= touch_m * touch_m {
            return None;
        }
        let apart_m = libm::sqrt(apart_squared);
        let strip = [
            (apart_m - stem.radius_m).max(-spot_m),
            (apart_m + stem.radius_m).min(spot_m),
        ];
        let middle_m = 0.5 * (strip[0] + strip[1]);
        let half_m = libm::sqrt((spot_m * spot_m - middle_m * middle_m).max(0.0));
        let half = half_m / libm::sqrt(across_squared);
        let lit = [(u - half).max(0.0), (u + half).min(1.0)];
        if lit[0] >= lit[1] {
            return None;
        }
        let length_m = (lit[1] - lit[0]) * libm::sqrt(across_squared);
        let area = length_m * (strip[1] - strip[0]);
        Some(Self {
            distance_m: axis_foot + 0.5 * (lit[0] + lit[1]) * b,
            share: (area / (std::f64::consts::PI * spot_m * spot_m)).min(1.0),
        })
    }
}

/// A breeze that never changes its mean.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub(crate) struct Wind {
    /// Where it blows to: a unit vector.
    #[serde(rename = "towards_deg", deserialize_with = "heading")]
    pub(crate) towards: Vector2<f64>,
    /// How far the top of a plant of stiffness 1 leans on the mean, by its height.
    #[serde(deserialize_with = "Probability::number")]
    pub(crate) lean: f64,
    /// How far that top swings to either side of the mean, by its height.
    #[serde(deserialize_with = "Probability::number")]
    pub(crate) sway: f64,
    /// Of its slow swinging, seconds.
    #[serde(deserialize_with = "Positive::number")]
    pub(crate) period_s: f64,
}

impl Default for Wind {
    fn default() -> Self {
        Self {
            towards: Vector2::x(),
            lean: 0.0,
            sway: 0.0,
            period_s: 1.0,
        }
    }
}

fn heading<'de, D: Deserializer<'de>>(degrees: D) -> Result<Vector2<f64>, D::Error> {
    let towards_rad = Coordinate::number(degrees)?.to_radians();
    Ok(Vector2::new(libm::cos(towards_rad), libm::sin(towards_rad)))
}

/// The wind of one instant: for every component sine and cosine of the angle that it has run through.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gust {
    towards: Vector2<f64>,
    lean: f64,
    sway: f64,
    turned: [[f64; 2]; COMPONENTS],
}

/// Sine and cosine of where every component of a plant's swinging begins.
pub type Phases = [[f32; 2]; COMPONENTS];

/// A plant swings at its own period and at others, so that it never comes back to where it was. The ratios
/// are powers of the golden one, which no small whole numbers approximate; so no two beats coincide.
pub(crate) const COMPONENTS: usize = 3;
const PERIOD_RATIOS: [f64; COMPONENTS] = [1.0, 0.618_033_988_749_895, 2.618_033_988_749_895];
/// They sum up to 1, the most that a top swings.
const WEIGHTS: [f64; COMPONENTS] = [0.6, 0.25, 0.15];

/// How far it swings across the wind, by how far along it.
const ACROSS: f64 = 0.4;

impl Wind {
    pub(crate) fn at(&self, time_s: f64) -> Gust {
        let turned = PERIOD_RATIOS.map(|ratio| {
            let turns = time_s / (self.period_s * ratio);
            let angle_rad = std::f64::consts::TAU * (turns - libm::floor(turns));
            [libm::sin(angle_rad), libm::cos(angle_rad)]
        });
        Gust {
            towards: self.towards,
            lean: self.lean,
            sway: self.sway,
            turned,
        }
    }

    /// No point of a plant of this reach is ever farther from where it stands without wind, metres.
    pub(crate) fn farthest_m(&self, reach_m: f64) -> f64 {
        reach_m * (self.lean + self.sway + ACROSS * self.sway)
    }
}

impl Gust {
    /// How far the top of a plant of these phases is moved, by its reach.
    pub(crate) fn offset(&self, phases: &Phases) -> Vector2<f64> {
        let (mut along, mut across) = (0.0, 0.0);
        for (n, ([sin, cos], weight)) in self.turned.iter().zip(WEIGHTS).enumerate() {
            let [start_sin, start_cos] = phases[n].map(f64::from);
            along += weight * (sin * start_cos + cos * start_sin);
            // The next component's beginning, so that it does not run on a line.
            let [start_sin, start_cos] = phases[(n + 1) % COMPONENTS].map(f64::from);
            across += weight * (sin * start_cos + cos * start_sin);
        }
        let aside = Vector2::new(-self.towards.y, self.towards.x);
        self.towards * (self.lean + self.sway * along) + aside * (ACROSS * self.sway * across)
    }
}

#[cfg(test)]
mod tests;
