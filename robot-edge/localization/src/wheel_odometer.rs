//! How far the wheels have rolled.

use measurement::drops::DropReason;
use measurement::time::RobotTime;

/// Which joints the wheels are, and what they can do.
#[derive(Clone, Debug, PartialEq)]
pub struct WheelSettings {
    /// Name of the left wheel's joint.
    pub left_joint: String,
    /// Name of the right wheel's joint.
    pub right_joint: String,
    /// Metres per radian of either wheel.
    pub radius_m: f64,
    /// No wheel rolls faster, metres per second.
    pub max_speed_mps: f64,
}

/// Adds up the wheels' angles: the mean of both sides, as [LOD §5.4] takes it, for a vehicle whose wheels
/// do not tell how it curves.
#[derive(Clone, Debug)]
pub struct WheelOdometer {
    settings: WheelSettings,
    last: Option<(RobotTime, [f64; 2])>,
    travelled_m: f64,
}

/// What a step may be longer than the greatest speed allows: a pulse of a coarse encoder, or the jitter of a
/// stamp.
const SLACK_M: f64 = 0.02;

impl WheelOdometer {
    /// At zero.
    pub const fn new(settings: WheelSettings) -> Self {
        Self {
            settings,
            last: None,
            travelled_m: 0.0,
        }
    }

    /// Takes the angles of all joints of one message (radians); gives how far the vehicle has come since the
    /// first, backwards negative, metres. `None` where the message does not hold both wheels.
    ///
    /// # Errors
    /// [`DropReason::Late`] where it is not behind the newest. [`DropReason::WheelJump`] where an angle is not
    /// finite or turned farther than a wheel can, as at a counter that wraps or is reset: the vehicle stays
    /// where it was, and what comes next counts from there.
    pub fn push(
        &mut self,
        stamp: RobotTime,
        joints: &[(String, f64)],
    ) -> Result<Option<f64>, DropReason> {
        let angle = |wanted: &str| {
            let joint = joints.iter().find(|(name, _)| name == wanted);
            joint.map(|(_, angle_rad)| *angle_rad)
        };
        let wheels = (
            angle(&self.settings.left_joint),
            angle(&self.settings.right_joint),
        );
        let (Some(left_rad), Some(right_rad)) = wheels else {
            return Ok(None);
        };
        let angles_rad = [left_rad, right_rad];
        if self.last.is_some_and(|(newest, _)| stamp <= newest) {
            return Err(DropReason::Late);
        }
        if !angles_rad.iter().all(|angle_rad| angle_rad.is_finite()) {
            return Err(DropReason::WheelJump);
        }
        if let Some((before, [left_before_rad, right_before_rad])) =
            self.last.replace((stamp, angles_rad))
        {
            let left_m = (left_rad - left_before_rad) * self.settings.radius_m;
            let right_m = (right_rad - right_before_rad) * self.settings.radius_m;
            let time_s = stamp.since(before).as_secs_f64();
            let most_m = SLACK_M + self.settings.max_speed_mps * time_s;
            if left_m.abs().max(right_m.abs()) > most_m {
                return Err(DropReason::WheelJump);
            }
            self.travelled_m += 0.5 * (left_m + right_m);
        }
        Ok(Some(self.travelled_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn odometer() -> WheelOdometer {
        WheelOdometer::new(WheelSettings {
            left_joint: "left".to_owned(),
            right_joint: "right".to_owned(),
            radius_m: 0.5,
            max_speed_mps: 3.0,
        })
    }

    fn push(
        odometer: &mut WheelOdometer,
        secs: f64,
        left_rad: f64,
        right_rad: f64,
    ) -> Result<Option<f64>, DropReason> {
        let joints = [("arm", 7.0), ("right", right_rad), ("left", left_rad)];
        odometer
            .push(
                RobotTime::from_secs_f64(secs).unwrap(),
                &joints.map(|(name, angle_rad)| (name.to_owned(), angle_rad)),
            )
            .map(|distance_m| distance_m.map(|distance_m| (distance_m * 1e9).round() / 1e9))
    }

    #[test]
    fn the_way_is_the_mean_of_both_wheels() {
        let mut odometer = odometer();
        assert_eq!(push(&mut odometer, 1.0, 100.0, -50.0), Ok(Some(0.0)));
        assert_eq!(push(&mut odometer, 1.1, 100.5, -49.75), Ok(Some(0.1875)));
        assert_eq!(push(&mut odometer, 1.2, 100.25, -50.25), Ok(Some(0.0)));
        let stamp = RobotTime::from_secs_f64(1.3).unwrap();
        let one_wheel = [("left".to_owned(), 3.0), ("arm".to_owned(), f64::NAN)];
        assert_eq!(odometer.push(stamp, &one_wheel), Ok(None));
        assert_eq!(odometer.push(stamp, &[]), Ok(None));
    }

    #[test]
    fn wheels_that_cannot_turn_so_far_do_not_move_the_vehicle() {
        let mut odometer = odometer();
        let jump = Err(DropReason::WheelJump);
        assert_eq!(push(&mut odometer, 1.0, 6.2, 6.2), Ok(Some(0.0)));
        // The right counter wraps at one turn.
        assert_eq!(push(&mut odometer, 1.1, 6.4, 0.1), jump);
        assert_eq!(push(&mut odometer, 1.2, 6.6, 0.3), Ok(Some(0.1)));
        assert_eq!(push(&mut odometer, 1.3, f64::NAN, 0.4), jump);
        assert_eq!(push(&mut odometer, 1.35, 6.7, f64::NEG_INFINITY), jump);
        // What it rolled in the meantime is in the angles that follow.
        assert_eq!(push(&mut odometer, 1.4, 6.8, 0.5), Ok(Some(0.2)));
        assert_eq!(push(&mut odometer, 1.5, 1e308, 0.5), jump);
        assert_eq!(push(&mut odometer, 1.6, -1e308, 0.5), jump);
    }

    #[test]
    fn a_step_at_the_limit_counts() {
        let mut odometer = odometer();
        let ten_at_once = |speed_mps: f64| (SLACK_M + speed_mps * 0.1) / 0.5;
        push(&mut odometer, 1.0, 0.0, 0.0).unwrap();
        let most_rad = ten_at_once(2.999);
        assert!(push(&mut odometer, 1.1, most_rad, most_rad).is_ok());
        let more_rad = most_rad + ten_at_once(3.001);
        assert!(push(&mut odometer, 1.2, more_rad, most_rad).is_err());
    }

    #[test]
    fn stamps_that_go_back_are_late() {
        let mut odometer = odometer();
        push(&mut odometer, 1.0, 0.0, 0.0).unwrap();
        push(&mut odometer, 1.1, 0.2, 0.2).unwrap();
        assert_eq!(push(&mut odometer, 1.05, 0.1, 0.1), Err(DropReason::Late));
        assert_eq!(push(&mut odometer, 1.1, 0.1, 0.1), Err(DropReason::Late));
        assert_eq!(push(&mut odometer, 1.2, 0.4, 0.4), Ok(Some(0.2)));
    }
}
