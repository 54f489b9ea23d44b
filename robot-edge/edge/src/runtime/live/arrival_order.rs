//! Live measurements, nearly in the order of their stamps.

use std::collections::BTreeMap;
use std::time::Duration;

use super::delay_estimator::DelayEstimator;
use crate::runtime::source::{SourceItem, SourceLosses};
use measurement::Measurement;
use measurement::time::{Monotonic, RobotDuration, RobotTime};
use network::clock;
use recording::time_sequencer::{Ordered, TimeSequencer};

/// Maximum number of stamps with a known arrival time.
const MAX_ARRIVAL_TIMES: usize = 50_000;

/// Orders the measurements of all streams, and estimates when they were made.
pub(super) struct ArrivalOrder {
    max_wait: Duration,
    order: TimeSequencer,
    delay_estimator: DelayEstimator,
    /// Arrival times of the waiting measurements, by stamp.
    arrival_times: BTreeMap<RobotTime, Monotonic>,
}

impl ArrivalOrder {
    /// A measurement waits so long for older ones. A longer wait corrects more and delays the map. Later ones are mapped
    /// out of order.
    pub(super) fn new(max_wait: Duration) -> Self {
        Self {
            max_wait,
            order: TimeSequencer::live(RobotDuration::from_secs_f64(max_wait.as_secs_f64())),
            delay_estimator: DelayEstimator::default(),
            arrival_times: BTreeMap::new(),
        }
    }

    pub(super) fn push(&mut self, measurement: Measurement, received_at: Monotonic) {
        self.arrival_times
            .entry(measurement.stamp)
            .and_modify(|known| *known = received_at.min(*known))
            .or_insert(received_at);
        if self.arrival_times.len() > MAX_ARRIVAL_TIMES {
            // Stamps far in the future stay longest and are most likely wrong.
            self.arrival_times.pop_last();
        }
        self.order.push(measurement);
    }

    /// Releases measurements that have waited long enough.
    pub(super) fn release(&mut self, now: Monotonic) {
        while let Some(first) = self.order.oldest_buffered_stamp()
            && self
                .arrival_times
                .get(&first)
                .is_none_or(|&received_at| now.since(received_at) >= self.max_wait)
        {
            self.order.release_until(first);
        }
    }

    pub(super) fn next(&mut self) -> Option<SourceItem> {
        let ordered = self.order.pop()?;
        let measured_at = match &ordered {
            Ordered::Measurement(measurement) => {
                let stamp = &measurement.stamp;
                let received_at = self.arrival_times.get(stamp).copied();
                while self
                    .arrival_times
                    .first_key_value()
                    .is_some_and(|(first, _)| first < stamp)
                {
                    self.arrival_times.pop_first();
                }
                // The stamp is trusted only after ordering. A measurement without arrival time must not
                // appear new.
                received_at.map_or(Monotonic::from_nanos(0), |received_at| {
                    self.delay_estimator
                        .measured_at(measurement.stream, *stamp, received_at)
                })
            }
            Ordered::ClockReset { .. } => {
                self.delay_estimator.reset_clock();
                clock::now()
            }
        };
        Some(SourceItem::Live {
            ordered,
            measured_at,
        })
    }

    /// Measurements that came too late to be ordered.
    pub(super) fn lost_total(&self) -> u64 {
        self.order.drops().total()
    }

    pub(super) fn add_losses(&self, lost: &mut SourceLosses) {
        lost.counts.merge(self.order.drops());
        lost.late_scans += self.order.late_scans();
    }
}
