//! The alerts of the robot that is shown, and what nobody has acknowledged of those that were shown before.

use std::collections::BTreeMap;
use std::mem;

use protocol::keys::RobotId;

use crate::alerts::Alerts;
use crate::playback::is_recording;

/// Alerts by robot.
#[derive(Debug, Default)]
pub(super) struct RobotAlerts {
    /// Of the robot that is shown.
    pub(super) shown: Alerts,
    /// Which that is.
    of: Option<RobotId>,
    others: BTreeMap<RobotId, Alerts>,
}

impl RobotAlerts {
    /// Another robot is shown: what nobody has acknowledged of it is there again. A recording's alerts end with it.
    pub(super) fn change_to(&mut self, robot: &RobotId) {
        let alerts = mem::take(&mut self.shown);
        if let Some(before) = self.of.replace(robot.clone())
            && !is_recording(&before)
        {
            self.others.insert(before, alerts);
        }
        self.shown = self.others.remove(robot).unwrap_or_default();
    }
}

#[cfg(test)]
mod tests {
    use protocol::keys::Topic;
    use protocol::message::{EStopStatus, Status};

    use super::*;
    use crate::alerts::{Alarm, Subject};
    use crate::pretend::{at, console, says, standing};

    /// An emergency stop is in force at the robot that is shown.
    fn stop(alerts: &mut RobotAlerts, robot: &RobotId) {
        let mut model = console(robot.as_str(), &[]);
        let mut teleop = standing();
        teleop.estop = Some(EStopStatus {
            number: 3,
            is_stored: true,
        });
        let status = Status {
            teleop: Some(teleop),
            ..Status::default()
        };
        says(&mut model, Topic::Status, &status, at(1_000));
        let begun = alerts
            .shown
            .look(&model, Subject::Robot, &[], at(1_100))
            .len();
        assert_eq!(begun, 1);
    }

    #[test]
    fn what_nobody_acknowledged_comes_back_with_its_robot() {
        let [boat, scout, recording] =
            ["boat", "scout", "recording-1a2b3c"].map(|name| name.parse().unwrap());
        let mut alerts = RobotAlerts::default();
        alerts.change_to(&boat);
        stop(&mut alerts, &boat);
        alerts.change_to(&scout);
        assert_eq!(alerts.shown.iter().count(), 0, "they are the boat's");
        alerts.change_to(&boat);
        assert_eq!(alerts.shown.unseen(), 1);
        // By another link.
        alerts.change_to(&boat);
        assert_eq!(alerts.shown.unseen(), 1);
        alerts.shown.acknowledge(&Alarm::EStop);
        alerts.change_to(&scout);
        alerts.change_to(&boat);
        assert_eq!(alerts.shown.unseen(), 0, "somebody has seen it");

        alerts.change_to(&recording);
        stop(&mut alerts, &recording);
        alerts.change_to(&scout);
        alerts.change_to(&recording);
        assert_eq!(alerts.shown.iter().count(), 0, "it is opened anew");
    }
}
