//! The angle that a joint shall turn to.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Shared by who decides on the angle and who turns the joint; clones are the same goal.
#[derive(Clone, Debug)]
pub struct JointGoal {
    joint: Arc<str>,
    /// Bits of an `f64`; not-a-number: none yet.
    angle_rad: Arc<AtomicU64>,
}

impl JointGoal {
    /// Of the joint with this name, as in `sensor_msgs/JointState`; without an angle.
    pub fn new(joint: &str) -> Self {
        Self {
            joint: joint.into(),
            angle_rad: Arc::new(AtomicU64::new(f64::NAN.to_bits())),
        }
    }

    /// Name of the joint.
    pub fn joint(&self) -> &str {
        &self.joint
    }

    /// Angle of the joint, radians.
    pub fn set(&self, angle_rad: f64) {
        self.angle_rad.store(angle_rad.to_bits(), Ordering::Relaxed);
    }

    /// Angle of the joint, radians; `None` until one was set.
    pub fn angle_rad(&self) -> Option<f64> {
        let angle_rad = f64::from_bits(self.angle_rad.load(Ordering::Relaxed));
        angle_rad.is_finite().then_some(angle_rad)
    }
}
