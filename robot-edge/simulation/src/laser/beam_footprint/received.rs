//! What a beam measures where plants grow.
//!
//! A spot falls on some stems, through gaps on others and on what is behind. Each sends back its share of
//! the light; the receiver takes echoes within the length of a pulse for one, at their common centre, and
//! gives the range of the first that is strong enough. So one thin cane in a wide spot is not seen, several
//! are, and a beam reaches into grass as far as its gaps do.
//!
//! Shares are of the area of the spot: light falls evenly on it, and all surfaces send back as much of it.
//! That a spot's echo grows weaker with the square of its distance is left out, as everywhere in this
//! simulation, where a wall is seen up to the range of the data sheet.

use super::{BeamFootprint, RIM_RAYS, Sample};
use crate::scene::{Growth, Receiver};
use crate::vegetation::Cone;

/// Light that comes back.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Return {
    path_m: f64,
    /// Of the beam's light.
    share: f64,
}

/// Where rays around the axis stand for the rest of the spot, by its radius, and the axis' own part: so
/// chosen that the mean over an even disc is exact for everything up to the third power.
const RING_RADIUS: f64 = 0.816_496_580_927_726;
const AXIS_SHARE: f64 = 0.25;

impl BeamFootprint<'_> {
    /// The range that the receiver gives; `None` where no echo is strong enough. Plants are seen straight
    /// only, not in mirrors.
    pub(super) fn received_m(&self, growth: &Growth) -> Option<f64> {
        let solids = self.solids();
        let is_closed = solids.iter().map(|r| r.share).sum::<f64>() > 1.0 - 1e-9;
        let farthest_m = solids
            .last()
            .filter(|_| is_closed)
            .map_or(self.max_m, |last| last.path_m);
        let cone = Cone {
            origin: self.origin,
            axis: self.axis,
            spread: libm::tan(0.5 * self.divergence_rad),
        };
        let reach_m = self.scene.reach_m(self.origin, self.axis, farthest_m);
        let lit = growth.vegetation.lit(&cone, reach_m, self.time_s);
        let mut solids = solids.into_iter().peekable();
        let (mut returns, mut through, mut open) = (Vec::new(), 1.0, 1.0);
        for spot in lit {
            while let Some(solid) = solids.next_if(|solid| solid.path_m < spot.distance_m) {
                open -= solid.share;
                returns.push(solid.dimmed(through));
            }
            returns.push(Return {
                path_m: spot.distance_m,
                share: spot.share * open,
            });
            through -= spot.share;
        }
        returns.extend(solids.map(|solid| solid.dimmed(through)));
        first_noticed_m(&returns, growth.receiver)
    }

    /// Shares of the spot that fall on solids, nearest first. A surface that goes on across the spot gives
    /// its range along the axis.
    fn solids(&self) -> Vec<Return> {
        let axis = self.sample(self.axis);
        let mut on_axis = AXIS_SHARE;
        let ring_share = (1.0 - AXIS_SHARE) / RIM_RAYS as f64;
        let of_ray = |ray: &Sample, share| {
            ray.echo.map(|echo| Return {
                path_m: echo.path_m,
                share,
            })
        };
        let mut returns = Vec::with_capacity(RIM_RAYS + 1);
        if self.divergence_rad > 0.0 {
            for ray in self.ring(RING_RADIUS) {
                if self.is_edge_between(&axis, &ray) {
                    returns.extend(of_ray(&ray, ring_share));
                } else {
                    on_axis += ring_share;
                }
            }
        } else {
            on_axis = 1.0;
        }
        returns.extend(of_ray(&axis, on_axis));
        returns.sort_by(|a, b| a.path_m.total_cmp(&b.path_m));
        returns
    }
}

impl Return {
    fn dimmed(self, through: f64) -> Self {
        Self {
            share: self.share * through,
            ..self
        }
    }
}

/// The centre of the first echoes that come at once and are strong enough; `returns` are sorted.
fn first_noticed_m(returns: &[Return], receiver: Receiver) -> Option<f64> {
    let mut rest = returns;
    while let Some(first) = rest.first() {
        let end_m = first.path_m + receiver.separation_m;
        let (at_once, later) = rest.split_at(rest.partition_point(|r| r.path_m <= end_m));
        let share: f64 = at_once.iter().map(|r| r.share).sum();
        if share >= receiver.min_share {
            let moment: f64 = at_once.iter().map(|r| r.share * r.path_m).sum();
            return Some(moment / share);
        }
        rest = later;
    }
    None
}

#[cfg(test)]
mod tests;
