//! What the loop tells its velocities.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use crate::actuators::Fault;
#[cfg(target_os = "linux")]
use crate::actuators::motor_guard::GuardedMotors;
use crate::actuators::published_velocity::PublishedVelocity;
#[cfg(target_os = "linux")]
use crate::actuators::report::Readiness;
use crate::clock;
use measurement::time::Monotonic;
use teleop::Velocity;

/// How long a velocity holds for simulated motors, from its decision on. As for motors behind a guard.
const WATCHDOG: Duration = Duration::from_millis(200);

/// The motors of a vehicle.
#[derive(Debug)]
pub enum Motors {
    /// None: it can be watched, and not driven.
    None,
    /// Those of a simulated vehicle.
    Simulated(SimulatedMotors),
    /// Those of another system, which is told by messages.
    Published(PublishedVelocity),
    /// Real ones, behind a process of their own.
    #[cfg(target_os = "linux")]
    Guarded(GuardedMotors),
}

/// What the loop hears of its motors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorState {
    /// Whether they do what they are told.
    pub readiness: MotorReadiness,
    /// How fast the vehicle is, as far as they know.
    pub measured: Option<Velocity>,
}

/// Whether motors do what they are told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MotorReadiness {
    /// Not yet: they are being found and checked.
    Starting,
    /// They do.
    Ready,
    /// They do not, for good.
    Faulty(Fault),
    /// There are none.
    Absent,
}

/// The motors of a simulated vehicle: what the loop tells, the simulation takes.
#[derive(Clone, Debug, Default)]
pub struct SimulatedMotors(Arc<Mutex<SimulatedMotorState>>);

/// What both sides of simulated motors last said.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SimulatedMotorState {
    /// The vehicle no longer goes its own way, as simulated ones do until somebody takes them.
    pub is_engaged: bool,
    /// What the motors are told.
    pub velocity: Velocity,
    /// When that was decided.
    pub decided_at: Monotonic,
    /// How fast the vehicle is.
    pub measured: Option<Velocity>,
}

impl Motors {
    /// Tells them a velocity that was decided at `now`; says what is known of them. It never waits.
    pub fn apply(&mut self, velocity: Velocity, now: Monotonic) -> MotorState {
        match self {
            Self::None => MotorState {
                readiness: MotorReadiness::Absent,
                measured: None,
            },
            Self::Simulated(motors) => MotorState {
                readiness: MotorReadiness::Ready,
                measured: motors.command(velocity, now),
            },
            Self::Published(motors) => MotorState {
                readiness: if motors.apply(velocity, now) {
                    MotorReadiness::Ready
                } else {
                    MotorReadiness::Starting
                },
                measured: None,
            },
            #[cfg(target_os = "linux")]
            Self::Guarded(motors) => match motors.apply(velocity, now) {
                Ok(report) => MotorState {
                    readiness: match report.readiness {
                        Readiness::Starting => MotorReadiness::Starting,
                        // Held motors obey as soon as zero is asked for, which it is until somebody drives.
                        Readiness::Holding(_) | Readiness::Active => MotorReadiness::Ready,
                    },
                    measured: report.measured,
                },
                Err(fault) => MotorState {
                    readiness: MotorReadiness::Faulty(fault),
                    measured: None,
                },
            },
        }
    }

    /// From now on the vehicle does nothing but what it is told.
    pub fn take_over(&mut self) {
        if let Self::Simulated(motors) = self {
            motors.state().is_engaged = true;
        }
    }

    /// Those of a simulated vehicle, where they are these.
    pub(super) fn simulated(&self) -> Option<SimulatedMotors> {
        match self {
            Self::Simulated(motors) => Some(motors.clone()),
            Self::None | Self::Published(_) => None,
            #[cfg(target_os = "linux")]
            Self::Guarded(_) => None,
        }
    }

    /// Whether there are any.
    pub const fn can_drive(&self) -> bool {
        match self {
            Self::None => false,
            Self::Simulated(_) | Self::Published(_) => true,
            #[cfg(target_os = "linux")]
            Self::Guarded(_) => true,
        }
    }
}

impl SimulatedMotors {
    /// Tells them a velocity that was decided at `now`; returns how fast the vehicle is, as far as they know.
    pub(super) fn command(&self, velocity: Velocity, now: Monotonic) -> Option<Velocity> {
        let mut state = self.state();
        state.velocity = velocity;
        state.decided_at = now;
        state.measured
    }

    /// Says how fast the vehicle is, and what the motors are told: zero, where nothing was decided lately.
    pub fn exchange(&self, measured: Velocity) -> SimulatedMotorState {
        let mut state = self.state();
        state.measured = Some(measured);
        if clock::elapsed(state.decided_at) >= WATCHDOG {
            state.velocity = Velocity::ZERO;
        }
        *state
    }

    fn state(&self) -> std::sync::MutexGuard<'_, SimulatedMotorState> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn simulated_motors_go_to_zero_when_nothing_is_decided_any_more() {
        let simulated = SimulatedMotors::default();
        let mut motors = Motors::Simulated(simulated.clone());
        let ahead = Velocity {
            linear_mps: 1.0,
            angular_radps: 0.0,
        };
        let decided = clock::now();
        motors.apply(ahead, decided);
        let state = simulated.exchange(ahead).velocity;
        assert!(state == ahead || clock::elapsed(decided) >= WATCHDOG);
        crate::clock::sleep_until(decided + WATCHDOG, || false);
        assert_eq!(simulated.exchange(ahead).velocity, Velocity::ZERO);
        motors.apply(ahead, decided);
        assert_eq!(
            simulated.exchange(ahead).velocity,
            Velocity::ZERO,
            "too old"
        );
    }
}
