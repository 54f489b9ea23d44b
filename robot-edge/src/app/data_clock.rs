//! How much time of the data has passed.

use crate::measurement::{Measurement, MeasurementData};
use crate::robot_time::{RobotDuration, RobotTime};

/// Time of the data that has passed, over clocks that start anew.
#[derive(Debug, Default)]
pub(super) struct DataClock {
    newest: Option<RobotTime>,
    elapsed: RobotDuration,
}

impl DataClock {
    pub(super) fn see(&mut self, stamp: RobotTime) {
        let newest = *self.newest.get_or_insert(stamp);
        if stamp > newest {
            self.elapsed = self.elapsed + stamp.since(newest);
            self.newest = Some(stamp);
        }
    }

    /// The next stamp is of a clock that started anew.
    pub(super) const fn reset(&mut self) {
        self.newest = None;
    }

    pub(super) const fn elapsed(&self) -> RobotDuration {
        self.elapsed
    }
}

/// Whether the stamp says when the measurement is due. That of a static transform says when somebody first
/// told it, which can be days before.
pub(super) const fn is_timed(measurement: &Measurement) -> bool {
    !matches!(
        measurement.data,
        MeasurementData::Transform {
            is_static: true,
            ..
        }
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_passes_forward_only_and_goes_on_behind_a_reset() {
        let mut clock = DataClock::default();
        for nanos in [100, 150, 120, 160] {
            clock.see(RobotTime::from_nanos(nanos));
        }
        assert_eq!(clock.elapsed(), RobotDuration::from_nanos(60));
        clock.reset();
        for nanos in [-5, 0, 2] {
            clock.see(RobotTime::from_nanos(nanos));
        }
        assert_eq!(clock.elapsed(), RobotDuration::from_nanos(67));
    }
}
