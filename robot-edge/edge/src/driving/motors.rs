//! The motors that the loop commands.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::actuators::Fault;
#[cfg(target_os = "linux")]
use crate::actuators::motor_guard::GuardedMotors;
use crate::actuators::published_velocity::PublishedVelocity;
#[cfg(target_os = "linux")]
use crate::actuators::report::Readiness;
#[cfg(target_os = "linux")]
use crate::driving::autopilot::AutopilotMonitor;
use crate::lock;
use measurement::time::Monotonic;
use network::clock;
use protocol::message::MotorHold;
use teleop::Velocity;

/// Validity of a velocity for simulated motors, from its decision on; the same as for real ones.
const WATCHDOG: Duration = Duration::from_millis(200);

#[derive(Debug)]
pub enum Motors {
    /// None: the vehicle can be watched but not driven.
    None,
    Simulated(SimulatedMotors),
    /// Those of another system, commanded by messages.
    Published(PublishedVelocity),
    /// Real ones, behind a process of their own.
    #[cfg(target_os = "linux")]
    Guarded(GuardedMotors),
    /// Those of an autopilot, behind the same process.
    #[cfg(target_os = "linux")]
    Autopilot(GuardedMotors, AutopilotMonitor),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorState {
    pub readiness: MotorReadiness,
    pub measured: Option<Velocity>,
    pub battery_v: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MotorReadiness {
    Starting,
    Ready,
    /// They obey no velocity now, as the autopilot says, or the fault of the link with it.
    Held(MotorHold, Option<Fault>),
    Faulty(Fault),
    Absent,
}

#[derive(Clone, Debug, Default)]
pub struct SimulatedMotors(Arc<Mutex<SimulatedMotorState>>);

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SimulatedMotorState {
    /// The vehicle obeys the loop. Before, it follows its simulated route.
    pub is_engaged: bool,
    pub velocity: Velocity,
    pub decided_at: Monotonic,
    pub measured: Option<Velocity>,
}

impl Motors {
    /// Sends a velocity decided at `now`; returns the state of the motors. It never waits.
    pub fn apply(&mut self, velocity: Velocity, now: Monotonic) -> MotorState {
        match self {
            Self::None => MotorState {
                readiness: MotorReadiness::Absent,
                measured: None,
                battery_v: None,
            },
            Self::Simulated(motors) => MotorState {
                readiness: MotorReadiness::Ready,
                measured: motors.command(velocity, now),
                battery_v: None,
            },
            Self::Published(motors) => MotorState {
                readiness: if motors.apply(velocity, now) {
                    MotorReadiness::Ready
                } else {
                    MotorReadiness::Starting
                },
                measured: None,
                battery_v: None,
            },
            #[cfg(target_os = "linux")]
            Self::Guarded(motors) => match motors.apply(velocity, now) {
                Ok(report) => MotorState {
                    readiness: match report.readiness {
                        Readiness::Starting => MotorReadiness::Starting,
                        // Held motors obey after a zero command, which the loop sends until an operator drives.
                        Readiness::Holding(_) | Readiness::Active => MotorReadiness::Ready,
                    },
                    measured: report.measured,
                    battery_v: report.battery_v,
                },
                Err(fault) => MotorState {
                    readiness: MotorReadiness::Faulty(fault),
                    measured: None,
                    battery_v: None,
                },
            },
            #[cfg(target_os = "linux")]
            Self::Autopilot(motors, autopilot) => {
                let applied = motors.apply(velocity, now);
                let hold = autopilot.hold(now);
                MotorState {
                    readiness: match (applied, hold) {
                        // It may come back at any time: no reason for a fault that only a restart ends.
                        (Err(fault @ Fault::Controller(_)), _) => {
                            MotorReadiness::Held(MotorHold::NoLink, Some(fault))
                        }
                        (Err(fault), _) => MotorReadiness::Faulty(fault),
                        (Ok(_), Some(hold)) => MotorReadiness::Held(hold, None),
                        (Ok(_), None) => MotorReadiness::Ready,
                    },
                    measured: None,
                    battery_v: autopilot.battery_v(),
                }
            }
        }
    }

    /// An operator has taken the lease: an autopilot is asked to obey, if that is configured.
    pub fn lease_taken(&self) {
        #[cfg(target_os = "linux")]
        if let Self::Autopilot(motors, autopilot) = self
            && autopilot.requests_guided
        {
            motors.request_mode();
        }
    }

    /// What an autopilot has said since the last call.
    pub fn take_texts(&mut self, now: Monotonic) -> Vec<String> {
        #[cfg(target_os = "linux")]
        if let Self::Autopilot(_, autopilot) = self {
            return autopilot.take_texts(now);
        }
        Vec::new()
    }

    /// From now on the vehicle obeys only the loop.
    pub fn take_over(&mut self) {
        if let Self::Simulated(motors) = self {
            lock(&motors.0).is_engaged = true;
        }
    }

    pub(super) fn simulated(&self) -> Option<SimulatedMotors> {
        match self {
            Self::Simulated(motors) => Some(motors.clone()),
            Self::None | Self::Published(_) => None,
            #[cfg(target_os = "linux")]
            Self::Guarded(_) | Self::Autopilot(..) => None,
        }
    }

    pub const fn can_drive(&self) -> bool {
        match self {
            Self::None => false,
            Self::Simulated(_) | Self::Published(_) => true,
            #[cfg(target_os = "linux")]
            Self::Guarded(_) | Self::Autopilot(..) => true,
        }
    }
}

impl SimulatedMotors {
    /// Sets the velocity decided at `now`; returns the measured one, if known.
    pub(super) fn command(&self, velocity: Velocity, now: Monotonic) -> Option<Velocity> {
        let mut state = lock(&self.0);
        state.velocity = velocity;
        state.decided_at = now;
        state.measured
    }

    /// Sets the measured velocity; returns the commanded one: zero if it is too old.
    pub fn exchange(&self, measured: Velocity) -> SimulatedMotorState {
        let mut state = lock(&self.0);
        state.measured = Some(measured);
        if clock::elapsed(state.decided_at) >= WATCHDOG {
            state.velocity = Velocity::ZERO;
        }
        *state
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn simulated_motors_go_to_zero_without_new_velocity() {
        let simulated = SimulatedMotors::default();
        let mut motors = Motors::Simulated(simulated.clone());
        let ahead = Velocity {
            linear_mps: 1.0,
            lateral_mps: 0.0,
            angular_radps: 0.0,
        };
        let decided = clock::now();
        motors.apply(ahead, decided);
        let state = simulated.exchange(ahead).velocity;
        assert!(state == ahead || clock::elapsed(decided) >= WATCHDOG);
        network::clock::sleep_until(decided + WATCHDOG, || false);
        assert_eq!(simulated.exchange(ahead).velocity, Velocity::ZERO);
        motors.apply(ahead, decided);
        assert_eq!(
            simulated.exchange(ahead).velocity,
            Velocity::ZERO,
            "too old"
        );
    }
}
