//! How a vehicle follows the commanded velocity.

use crate::velocity::{CommandedVelocity, PlanarVelocity};

/// What drives a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drive {
    /// Wheels, each side by its own motor.
    Wheels(WheelDrive),
    /// A thruster on either side of a boat.
    Thrusters(TwinThrusters),
}

/// What goes on from one moment to the next.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub(crate) struct Momentum {
    pub(crate) velocity: PlanarVelocity,
    /// Of the port and the starboard thruster over the boat's mass, m/s²; wheels have none.
    pub(crate) thrusts_mps2: [f64; 2],
}

impl Drive {
    /// The momentum after `duration_s`, a few milliseconds, of `command`.
    pub(crate) fn after(
        &self,
        momentum: Momentum,
        command: CommandedVelocity,
        duration_s: f64,
    ) -> Momentum {
        match self {
            Self::Wheels(wheels) => Momentum {
                velocity: wheels.after(momentum.velocity, command, duration_s),
                ..Momentum::default()
            },
            Self::Thrusters(thrusters) => thrusters.after(momentum, command, duration_s),
        }
    }
}

/// Share of the way to its target that a first-order lag goes in `duration_s`.
fn lag_share(lag_s: f64, duration_s: f64) -> f64 {
    -libm::expm1(-duration_s / lag_s)
}

/// Wheels of two sides, each with a motor and a controller of its speed: differential drives and skid drives.
///
/// The controller makes up for what skidding takes, so that a skid drive differs by slower turning only. Wheels
/// do not slip sideways: it goes sideways only where it is commanded to, with wheels that are set for it. A hill does not
/// slow it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WheelDrive {
    /// Of speed along the ground, metres.
    pub linear: Axis,
    /// Of turning, radians.
    pub angular: Axis,
}

/// How a speed follows what is asked: a first-order lag within limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// Greatest speed in either direction, per second.
    pub max_speed: f64,
    /// Greatest acceleration and deceleration, per second squared.
    pub max_acceleration: f64,
    /// Time constant of the lag, seconds; above 0.
    pub lag_s: f64,
}

/// A speed this near to what is asked is what is asked, m/s or rad/s: friction ends what a lag never would.
const ARRIVED: f64 = 1e-4;

impl WheelDrive {
    fn after(
        &self,
        velocity: PlanarVelocity,
        command: CommandedVelocity,
        duration_s: f64,
    ) -> PlanarVelocity {
        let command = command.at_most(self.linear.max_speed, self.angular.max_speed);
        let (linear, angular) = (&self.linear, &self.angular);
        PlanarVelocity {
            forward_mps: linear.after(velocity.forward_mps, command.linear_mps, duration_s),
            left_mps: linear.after(velocity.left_mps, command.lateral_mps, duration_s),
            turn_rate_radps: angular.after(
                velocity.turn_rate_radps,
                command.angular_radps,
                duration_s,
            ),
        }
    }
}

impl Axis {
    fn after(&self, speed: f64, target: f64, duration_s: f64) -> f64 {
        let gap = target - speed;
        if gap.abs() < ARRIVED {
            return target;
        }
        let most = self.max_acceleration * duration_s;
        speed + (gap * lag_share(self.lag_s, duration_s)).clamp(-most, most)
    }
}

/// A boat with a thruster in each hull, which push straight ahead or astern.
///
/// Nothing on board controls its speed: it is given the thrust that keeps the commanded velocity on a
/// straight line in still water, and comes to that speed as inertia and drag let it. At zero it has no thrust
/// and drifts on. In a bend it makes leeway: surge, sway and yaw of a rigid body without added mass
/// [Fossen 2011, §7.3]. Wind and waves do not push it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwinThrusters {
    /// Speed ahead at full thrust, m/s.
    pub max_speed_mps: f64,
    /// Greatest commanded turn rate, rad/s.
    pub max_turn_rate_radps: f64,
    /// Against going ahead or astern, in m/s² for m/s.
    pub surge_drag: Drag,
    /// Against going sideways, in m/s² for m/s.
    pub sway_drag: Drag,
    /// Against turning, in rad/s² for rad/s.
    pub yaw_drag: Drag,
    /// Turning that a difference of thrusts causes, rad/s² for m/s²: the distance of a thruster from the middle,
    /// times mass over moment of inertia.
    pub lever_radpm: f64,
    /// Greatest thrust astern as a share of that ahead.
    pub astern: f64,
    /// Time constant of a thruster, seconds; above 0.
    pub lag_s: f64,
}

/// What slows: `linear · v + quadratic · v · |v|`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drag {
    /// Per second.
    pub linear_per_s: f64,
    /// Per metre, or per radian.
    pub quadratic: f64,
}

/// Thrusts and speeds smaller than this are none, m/s², m/s or rad/s: drag alone never ends a drift.
const STILL: f64 = 1e-4;

impl TwinThrusters {
    fn after(&self, momentum: Momentum, command: CommandedVelocity, duration_s: f64) -> Momentum {
        let share = lag_share(self.lag_s, duration_s);
        let wanted_mps2 = self.thrusts_mps2(command);
        let thrusts_mps2 = [0, 1].map(|side| {
            let gap = wanted_mps2[side] - momentum.thrusts_mps2[side];
            if gap.abs() < STILL {
                wanted_mps2[side]
            } else {
                momentum.thrusts_mps2[side] + share * gap
            }
        });
        let [port, starboard] = thrusts_mps2;
        let PlanarVelocity {
            forward_mps,
            left_mps,
            turn_rate_radps,
        } = momentum.velocity;
        let surge_mps2 =
            port + starboard - self.surge_drag.at(forward_mps) + turn_rate_radps * left_mps;
        let sway_mps2 = -self.sway_drag.at(left_mps) - turn_rate_radps * forward_mps;
        let yaw_radps2 = self.lever_radpm * (starboard - port) - self.yaw_drag.at(turn_rate_radps);
        let is_pushed = thrusts_mps2 != [0.0, 0.0];
        let settled = |speed: f64| {
            if is_pushed || speed.abs() >= STILL {
                speed
            } else {
                0.0
            }
        };
        Momentum {
            velocity: PlanarVelocity {
                forward_mps: settled(forward_mps + surge_mps2 * duration_s),
                left_mps: settled(left_mps + sway_mps2 * duration_s),
                turn_rate_radps: settled(turn_rate_radps + yaw_radps2 * duration_s),
            },
            thrusts_mps2,
        }
    }

    /// Thrusts to port and to starboard that keep the commanded velocity. Where a thruster cannot give it,
    /// turning comes first.
    fn thrusts_mps2(&self, command: CommandedVelocity) -> [f64; 2] {
        let command = command.at_most(self.max_speed_mps, self.max_turn_rate_radps);
        let most = 0.5 * self.surge_drag.at(self.max_speed_mps);
        let least = -self.astern * most;
        let widest = 0.5 * (most - least);
        let apart = (0.5 * self.yaw_drag.at(command.angular_radps) / self.lever_radpm)
            .clamp(-widest, widest);
        let mean = 0.5 * self.surge_drag.at(command.linear_mps);
        let mean = mean.min(most - apart.abs()).max(least + apart.abs());
        [mean - apart, mean + apart]
    }
}

impl Drag {
    /// What it takes from `speed` each second.
    fn at(&self, speed: f64) -> f64 {
        (self.linear_per_s + self.quadratic * speed.abs()) * speed
    }
}

#[cfg(test)]
mod tests;
