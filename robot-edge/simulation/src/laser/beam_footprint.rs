//! Beams of some width: mixed pixels at the edges of things.
//!
//! A time-of-flight laser whose spot lies partly on a near surface and partly on a far one reports a range
//! between the two, on neither [Hebert and Krotkov 1992, "3D measurements from imaging laser radars"].
//! A ground that the beam meets at a flat angle or a corner that it looks into is no such edge: the spot is
//! drawn out there, but the surface goes on.
//!
//! Where plants grow, the cone's light is shared out among all that it falls on, see [`received`].

mod received;

use nalgebra::{Point3, Vector3};

use crate::scene::{Echo, Scene};

/// A beam as a cone of light.
pub(super) struct BeamFootprint<'a> {
    pub(super) scene: &'a Scene,
    pub(super) origin: Point3<f64>,
    /// Unit vector.
    pub(super) axis: Vector3<f64>,
    /// Full angle of the cone.
    pub(super) divergence_rad: f64,
    pub(super) max_m: f64,
    /// Since the beginning.
    pub(super) time_s: f64,
    /// In [0, 1), for mirrors and glass.
    pub(super) surface_chance: f64,
}

/// Rays around the axis.
const RIM_RAYS: usize = 8;

/// Echoes nearer to each other than this come as one pulse, metres: a pulse of some 5 ns to half its
/// height is 1.5 m long there and back. Of echoes farther apart the laser takes one.
const PULSE_LENGTH_M: f64 = 1.5;

/// Jumps smaller than this are within a laser's noise, metres.
const SMALLEST_JUMP_M: f64 = 0.03;

/// One ray of the cone and what it meets.
struct Sample {
    direction: Vector3<f64>,
    echo: Option<Echo>,
}

impl BeamFootprint<'_> {
    /// Length of the path that the laser measures; `None` where nothing comes back.
    ///
    /// `chance` in [0, 1) decides with `mixed_pixels`, the probability of a mixed range at an edge, and
    /// then says which mix.
    pub(super) fn path_m(&self, mixed_pixels: f64, chance: f64) -> Option<f64> {
        if let Some(growth) = self.scene.growth() {
            return self.received_m(growth);
        }
        let axis = self.sample(self.axis);
        let alone_m = axis.echo.map(|echo| echo.path_m);
        if chance >= mixed_pixels || self.divergence_rad <= 0.0 {
            return alone_m;
        }
        let rim = self.ring(1.0);
        let Some(jump) = self.greatest_jump(&axis, &rim) else {
            return alone_m;
        };
        let mix = chance / mixed_pixels;
        if jump.far_m - jump.near_m <= PULSE_LENGTH_M {
            return Some(jump.near_m + (jump.far_m - jump.near_m) * mix);
        }
        let is_near = |sample: &&Sample| {
            let between_m = jump.near_m + PULSE_LENGTH_M;
            sample.echo.is_some_and(|echo| echo.path_m < between_m)
        };
        let near = rim.iter().chain([&axis]).filter(is_near).count();
        if mix * ((RIM_RAYS + 1) as f64) < near as f64 {
            Some(jump.near_m)
        } else {
            jump.far_m.is_finite().then_some(jump.far_m)
        }
    }

    fn sample(&self, direction: Vector3<f64>) -> Sample {
        let echo = self.scene.echo(
            self.origin,
            direction,
            self.max_m,
            self.time_s,
            self.surface_chance,
        );
        Sample { direction, echo }
    }

    /// Rays around the axis at a share of the cone's radius.
    fn ring(&self, share: f64) -> [Sample; RIM_RAYS] {
        let least = self.axis.iamin();
        let mut off_axis = Vector3::zeros();
        off_axis[least] = 1.0;
        let across = self.axis.cross(&off_axis).normalize();
        let up = self.axis.cross(&across);
        let radius = share * libm::tan(0.5 * self.divergence_rad);
        std::array::from_fn(|ray| {
            let angle_rad = std::f64::consts::TAU * ray as f64 / RIM_RAYS as f64;
            let aside = across * libm::cos(angle_rad) + up * libm::sin(angle_rad);
            self.sample((self.axis + aside * radius).normalize())
        })
    }

    /// Between the axis and any ray of the rim.
    fn greatest_jump(&self, axis: &Sample, rim: &[Sample]) -> Option<Jump> {
        rim.iter()
            .filter(|ray| self.is_edge_between(axis, ray))
            .map(|ray| {
                let ends_m = [axis, ray].map(|s| s.echo.map_or(f64::INFINITY, |e| e.path_m));
                Jump {
                    near_m: ends_m[0].min(ends_m[1]),
                    far_m: ends_m[0].max(ends_m[1]),
                }
            })
            .max_by(|a, b| (a.far_m - a.near_m).total_cmp(&(b.far_m - b.near_m)))
    }

    /// Whether the surface does not go on from one ray to the other: neither do both meet the same plane,
    /// nor do the planes that they meet cross between them.
    fn is_edge_between(&self, a: &Sample, b: &Sample) -> bool {
        match (a.echo, b.echo) {
            (None, None) => false,
            (Some(echo), None) => plane_m(a, &echo, b.direction) <= self.max_m,
            (None, Some(echo)) => plane_m(b, &echo, a.direction) <= self.max_m,
            (Some(of_a), Some(of_b)) => {
                let along_a_m = of_a.path_m - plane_m(b, &of_b, a.direction);
                let along_b_m = plane_m(a, &of_a, b.direction) - of_b.path_m;
                of_a.is_straight
                    && of_b.is_straight
                    && (along_a_m > 0.0) == (along_b_m > 0.0)
                    && along_a_m.abs().min(along_b_m.abs()) > SMALLEST_JUMP_M
            }
        }
    }
}

struct Jump {
    near_m: f64,
    /// Infinite where there is nothing behind.
    far_m: f64,
}

/// How far it is along another ray to the plane that a sample met; infinite where that ray never meets it.
fn plane_m(of: &Sample, echo: &Echo, direction: Vector3<f64>) -> f64 {
    let distance_m = echo.path_m * of.direction.dot(&echo.normal) / direction.dot(&echo.normal);
    if distance_m > 0.0 {
        distance_m
    } else {
        f64::INFINITY
    }
}
