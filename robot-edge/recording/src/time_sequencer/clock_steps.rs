//! Which stamps are believed: one that jumps alone, and a clock that starts anew.

use super::{Ordered, moves_clock};
use super::{Source, Step, Suspect, TimeSequencer};
use measurement::Measurement;
use measurement::time::RobotTime;

impl TimeSequencer {
    /// Believes a measurement, or puts it aside.
    pub(super) fn check_stamp(&mut self, source: Source, arrival: u64, measurement: Measurement) {
        let step = self.step(&source, measurement.stamp);
        let suspect = self
            .suspects
            .iter()
            .position(|suspect| suspect.source == source)
            .map(|index| self.suspects.remove(index));
        let confirmed = suspect.as_ref().is_some_and(|suspect| suspect.step == step);
        if let Some(suspect) = suspect {
            match (suspect.step, confirmed) {
                (Step::Ahead, true) if measurement.stamp < suspect.measurement.stamp => {
                    self.accept(source.clone(), arrival, measurement);
                    let Suspect {
                        arrival,
                        measurement,
                        ..
                    } = suspect;
                    return self.check_stamp(source, arrival, measurement);
                }
                (Step::Ahead, true) => {
                    self.accept(source.clone(), suspect.arrival, suspect.measurement);
                    return self.check_stamp(source, arrival, measurement);
                }
                (Step::Back, true) => {
                    self.start_epoch(suspect.measurement.stamp);
                    let mut first = vec![suspect];
                    first.extend(self.suspects.extract_if(.., |s| s.step == Step::Back));
                    first.sort_unstable_by_key(|s| s.arrival);
                    for suspect in first {
                        self.accept(suspect.source, suspect.arrival, suspect.measurement);
                    }
                    return self.check_stamp(source, arrival, measurement);
                }
                (Step::Back, false) => self.drop_late(&suspect.measurement),
                // It keeps its place in the order but does not move the clock.
                (Step::Ahead | Step::Usual, _) => self.insert(suspect.arrival, suspect.measurement),
            }
        }
        if step == Step::Usual {
            self.accept(source, arrival, measurement);
        } else {
            self.suspects.push(Suspect {
                source,
                step,
                arrival,
                measurement,
            });
        }
    }

    pub(super) fn step(&self, source: &Source, stamp: RobotTime) -> Step {
        let newest_of_source = self.epoch.newest_of.get(source);
        if newest_of_source.is_some_and(|&newest| stamp < newest - self.window) {
            return Step::Back;
        }
        let is_ahead = |newest| stamp > newest + self.window;
        if moves_clock(source) && self.epoch.newest.is_some_and(is_ahead) {
            return Step::Ahead;
        }
        Step::Usual
    }

    /// Takes a measurement's stamp for true.
    pub(super) fn accept(&mut self, source: Source, arrival: u64, measurement: Measurement) {
        let stamp = measurement.stamp;
        if moves_clock(&source) {
            self.epoch.newest = self.epoch.newest.max(Some(stamp));
        }
        let newest_of_source = self.epoch.newest_of.entry(source).or_insert(stamp);
        let is_in_order = stamp >= *newest_of_source;
        *newest_of_source = stamp.max(*newest_of_source);
        if self.releases_late
            && is_in_order
            && self
                .epoch
                .last_released
                .is_some_and(|last_released| stamp < last_released)
        {
            self.out.push_back(Ordered::Measurement(measurement));
        } else {
            self.insert(arrival, measurement);
        }
    }

    /// What the clock has come near to is no longer ahead.
    pub(super) fn accept_suspects_in_reach(&mut self) {
        let Some(newest) = self.epoch.newest else {
            return;
        };
        let reach = newest + self.window;
        while let Some(index) = self
            .suspects
            .iter()
            .position(|s| s.step == Step::Ahead && s.measurement.stamp <= reach)
        {
            let suspect = self.suspects.remove(index);
            self.accept(suspect.source, suspect.arrival, suspect.measurement);
        }
    }
}
