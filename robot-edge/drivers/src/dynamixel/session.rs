//! How a connection with a Dynamixel servo goes: it is asked for its angle, and turned to the other end of its sweep
//! once it is at one, or to an angle between them once somebody has a goal for its joint.

use std::time::Duration;

use measurement::MeasurementData;

use super::{AX_12A, DynamixelDecoder, MX_28, Model, Status, X_SERIES};
use crate::config::{DeviceConfig, Servo};
use crate::device::{Device, Event, Sample, Step};
use crate::joint_goal::JointGoal;

const RATE_HZ: f64 = 50.0;
/// A servo under load stops a little before its goal.
const REACHED_RAD: f64 = 0.02;
/// Goals that differ by less are the same.
const SAME_RAD: f64 = 0.002;

/// A servo that tilts a sensor.
#[derive(Debug)]
pub struct Dynamixel {
    model: Model,
    id: u8,
    joint: String,
    period: Duration,
    sweep: Option<Sweep>,
    /// The last request was for an angle to turn to.
    has_turned: bool,
}

/// To and fro, or to the goal.
#[derive(Debug)]
struct Sweep {
    ends_rad: [f64; 2],
    velocity_radps: f64,
    /// The end that it turns to where there is no goal.
    end: usize,
    goal: JointGoal,
    /// The angle that it was asked to turn to, radians, once it has confirmed that.
    confirmed_rad: Option<f64>,
    asked_rad: f64,
}

impl Sweep {
    fn goal_rad(&self) -> f64 {
        let [from_rad, to_rad] = self.ends_rad;
        let goal_rad = self.goal.angle_rad();
        goal_rad.map_or(self.ends_rad[self.end], |goal_rad| {
            goal_rad.clamp(from_rad, to_rad)
        })
    }

    fn is_new(&self) -> bool {
        let goal_rad = self.goal_rad();
        self.confirmed_rad
            .is_none_or(|confirmed_rad| (confirmed_rad - goal_rad).abs() > SAME_RAD)
    }
}

impl Dynamixel {
    /// As configured. `None` if the configuration lacks something.
    pub fn new(config: &DeviceConfig) -> Option<Self> {
        let sweep = (
            config.sweep_from_deg,
            config.sweep_to_deg,
            config.sweep_degps,
        );
        let sweep = match sweep {
            (Some(from_deg), Some(to_deg), Some(degps)) => Some(Sweep {
                ends_rad: [from_deg, to_deg].map(f64::to_radians),
                velocity_radps: degps.to_radians(),
                end: 0,
                goal: JointGoal::new(config.joint.as_deref()?),
                confirmed_rad: None,
                asked_rad: 0.0,
            }),
            _ => None,
        };
        Some(Self {
            model: match config.servo? {
                Servo::Ax12a => AX_12A,
                Servo::Mx28 => MX_28,
                Servo::XSeries => X_SERIES,
            },
            id: u8::try_from(config.servo_id?).ok()?,
            joint: config.joint.clone()?,
            period: Duration::from_secs_f64(1.0 / config.rate_hz.unwrap_or(RATE_HZ)),
            sweep,
            has_turned: false,
        })
    }

    /// That of its joint, where it can be turned.
    pub fn goal(&self) -> Option<&JointGoal> {
        self.sweep.as_ref().map(|sweep| &sweep.goal)
    }
}

impl Device for Dynamixel {
    type Decoder = DynamixelDecoder;

    fn connect(&mut self) -> DynamixelDecoder {
        if let Some(sweep) = &mut self.sweep {
            sweep.confirmed_rad = None;
        }
        DynamixelDecoder::new(self.model.protocol)
    }

    fn step(&self, step: usize) -> Step {
        match (step, &self.sweep) {
            (0, _) => Step::ask(
                "ping",
                self.model.protocol.ping(self.id).unwrap_or_default(),
            ),
            (1, Some(_)) => Step::ask(
                "torque enable",
                self.model.write_torque_enable(self.id).unwrap_or_default(),
            ),
            (2, Some(sweep)) => Step::ask(
                "profile velocity",
                self.model
                    .write_profile_velocity(self.id, sweep.velocity_radps)
                    .unwrap_or_default(),
            ),
            _ => Step::Done,
        }
    }

    fn take(&mut self, status: Status, awaited: Option<usize>, events: &mut Vec<Event>) {
        let sweep = self.sweep.as_mut();
        let event = if status.id != self.id {
            Event::Unexpected
        } else if let (Some(fault), true) = (status.faults.first(), status.parameters.is_empty()) {
            // Of a reply to a write: it does not turn.
            Event::Refused(format!("the servo has a fault: {fault:?}"))
        } else if awaited.is_some() {
            Event::Accepted
        } else if let Some(angle_rad) = self.model.position_rad(&status) {
            if let Some(sweep) = sweep
                && (angle_rad - sweep.ends_rad[sweep.end]).abs() < REACHED_RAD
            {
                sweep.end = 1 - sweep.end;
            }
            Event::Sample(Sample {
                sent: None,
                age: Duration::ZERO,
                data: MeasurementData::Joints(vec![(self.joint.clone(), angle_rad)]),
            })
        } else if let Some(sweep) = sweep.filter(|_| status.parameters.is_empty()) {
            sweep.confirmed_rad = Some(sweep.asked_rad);
            Event::Done
        } else {
            Event::Unexpected
        };
        events.push(event);
    }

    fn poll_period(&self) -> Option<Duration> {
        Some(self.period)
    }

    fn measures_when_asked(&self) -> bool {
        true
    }

    fn poll(&mut self) -> Vec<u8> {
        // Between two goals its angle is read, however fast they change.
        let turns = self
            .sweep
            .as_mut()
            .filter(|sweep| sweep.is_new() && !self.has_turned);
        self.has_turned = turns.is_some();
        let request = match turns {
            Some(sweep) => {
                sweep.asked_rad = sweep.goal_rad();
                self.model.write_goal_position(self.id, sweep.asked_rad)
            }
            None => self.model.read_position(self.id),
        };
        request.unwrap_or_default()
    }
}
