//! What the loop tells its velocities.

use std::sync::{Arc, Mutex, PoisonError};

use crate::actuators::Fault;
#[cfg(target_os = "linux")]
use crate::actuators::motor_guard::GuardedMotors;
use crate::actuators::published_velocity::PublishedVelocity;
#[cfg(target_os = "linux")]
use crate::actuators::report::Readiness;
use crate::clock::Monotonic;
use crate::teleop::Velocity;

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
pub struct SimulatedMotors(Arc<Mutex<Told>>);

/// What both sides of simulated motors last said.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Told {
    /// The vehicle no longer goes its own way, as simulated ones do until somebody takes them.
    pub is_taken_over: bool,
    /// What the motors are told.
    pub velocity: Velocity,
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
            Self::Simulated(motors) => {
                let mut told = motors.told();
                told.velocity = velocity;
                MotorState {
                    readiness: MotorReadiness::Ready,
                    measured: told.measured,
                }
            }
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
                        Readiness::Holding(_) | Readiness::Obeying => MotorReadiness::Ready,
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
            motors.told().is_taken_over = true;
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
    /// Says how fast the vehicle is, and what the motors are told.
    pub fn exchange(&self, measured: Velocity) -> Told {
        let mut told = self.told();
        told.measured = Some(measured);
        *told
    }

    fn told(&self) -> std::sync::MutexGuard<'_, Told> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
