//! `InterScan`: how much the range of a beam changes from one scan to the next.
//!
//! \[HYB\] §6.2 (*Hybrid 3D perception on land and water*), equation 6.3. The moving average over voxels is
//! not made here.

use super::cost_config::MetricsConfig;
use super::registered_scan::{BeamOutcome, RegisteredScan, SensorId};
use measurement::time::{RobotDuration, RobotTime};

/// Compares each scan with the one before it of the same sensor.
#[derive(Clone, Debug)]
pub struct InterScan {
    max_range_m: f32,
    full_m: f64,
    /// One entry per sensor, ordered by it.
    previous: Vec<PreviousScan>,
}

/// What is kept of the last scan of a sensor.
#[derive(Clone, Debug)]
struct PreviousScan {
    sensor: SensorId,
    stamp: RobotTime,
    /// From the scan before that one; `None` where there was none.
    period: Option<RobotDuration>,
    beam_step_rad: f64,
    /// Number and range in metres of every beam that hit something, by number.
    hits: Vec<(u32, f32)>,
}

/// Scans that are farther apart than this many times the last period are not consecutive,
const MAX_PERIODS: i64 = 3;
/// and none that are farther apart than this.
const MAX_PAUSE: RobotDuration = RobotDuration::from_millis(1_000);

impl InterScan {
    /// A metric with these settings that has seen no scan.
    pub fn new(config: &MetricsConfig) -> Self {
        Self {
            max_range_m: config.max_range_m as f32,
            full_m: config.inter_full_m,
            previous: Vec::new(),
        }
    }

    /// Fills `values` with one value, 0 to 1, for each entry of `scan.beams`: 0.39 is a change by 10 cm where
    /// 1 is one by 25.5 cm or more. It is NaN where this beam or the same one of the previous scan is no hit,
    /// and of a hit beyond the greatest range.
    ///
    /// What the previous scan hit beyond the greatest range counts: a beam that now hits a cane and before
    /// went through to the far shore says that the cane is thin.
    pub fn measure(&mut self, scan: &RegisteredScan, values: &mut Vec<f32>) {
        values.clear();
        values.resize(scan.beams.len(), f32::NAN);
        let place = self
            .previous
            .binary_search_by_key(&scan.sensor, |previous| previous.sensor);
        match place {
            Ok(at) => {
                let previous = &mut self.previous[at];
                if previous.is_followed_by(scan) {
                    let hits = &previous.hits;
                    compare(scan, hits, self.max_range_m, self.full_m, values);
                }
                previous.take(scan);
            }
            Err(at) => self.previous.insert(at, PreviousScan::first(scan)),
        }
    }

    /// Forgets every previous scan.
    pub fn reset(&mut self) {
        self.previous.clear();
    }
}

impl PreviousScan {
    fn first(scan: &RegisteredScan) -> Self {
        Self {
            sensor: scan.sensor,
            stamp: scan.stamp,
            period: None,
            beam_step_rad: scan.beam_step_rad,
            hits: hits(scan).collect(),
        }
    }

    /// Whether the beams of `scan` can be compared with these, number by number.
    fn is_followed_by(&self, scan: &RegisteredScan) -> bool {
        let pause = scan.stamp.since(self.stamp);
        let periods = self.period.map_or(i64::MAX, |period| {
            period.as_nanos().saturating_mul(MAX_PERIODS)
        });
        let is_next =
            pause > RobotDuration::ZERO && pause <= MAX_PAUSE && pause.as_nanos() <= periods;
        // Beams of the same number look the same way: the last one by less than half a step beside.
        let last = scan.beams.last().map_or(0, |beam| beam.index);
        let shift_rad = (scan.beam_step_rad - self.beam_step_rad).abs() * f64::from(last);
        is_next && shift_rad < 0.5 * self.beam_step_rad
    }

    fn take(&mut self, scan: &RegisteredScan) {
        let pause = scan.stamp.since(self.stamp);
        // Of a clock that went back nothing is known about the period; after a long pause it may have changed.
        self.period = (pause > RobotDuration::ZERO).then_some(pause);
        self.stamp = scan.stamp;
        self.beam_step_rad = scan.beam_step_rad;
        self.hits.clear();
        self.hits.extend(hits(scan));
    }
}

fn hits(scan: &RegisteredScan) -> impl Iterator<Item = (u32, f32)> {
    let hits = scan.beams.iter();
    let hits = hits.filter(|beam| beam.outcome == BeamOutcome::Hit);
    hits.map(|beam| (beam.index, beam.range_m))
}

fn compare(
    scan: &RegisteredScan,
    previous: &[(u32, f32)],
    max_range_m: f32,
    full_m: f64,
    values: &mut [f32],
) {
    let mut previous = previous.iter().copied().peekable();
    for (beam, value) in scan.beams.iter().zip(values) {
        while previous.next_if(|(index, _)| *index < beam.index).is_some() {}
        let Some(&(index, range_m)) = previous.peek() else {
            return;
        };
        let is_hit = beam.outcome == BeamOutcome::Hit && beam.range_m <= max_range_m;
        if index == beam.index && is_hit {
            let change_m = (f64::from(beam.range_m) - f64::from(range_m)).abs();
            *value = (change_m / full_m).min(1.0) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::intra_scan::tests::scan_of;
    use super::*;

    const MISS: f32 = f32::INFINITY;
    const LEFT_OUT: f32 = f32::NAN;

    /// Percent of each beam, −1 where it has no value.
    fn measured(metric: &mut InterScan, scan: &RegisteredScan) -> Vec<i32> {
        let mut values = vec![7.0; 2];
        metric.measure(scan, &mut values);
        assert_eq!(values.len(), scan.beams.len());
        let percent = |value: &f32| {
            if value.is_nan() {
                -1
            } else {
                (100.0 * value).round() as i32
            }
        };
        values.iter().map(percent).collect()
    }

    fn metric() -> InterScan {
        InterScan::new(&MetricsConfig::default())
    }

    #[test]
    fn a_change_is_told_of_hits_of_both_scans() {
        let mut metric = metric();
        let first = scan_of(0.0, &[5.0, 5.0, MISS, 5.0, LEFT_OUT, 5.0, 21.0]);
        assert_eq!(
            measured(&mut metric, &first),
            [-1; 6],
            "nothing to compare with"
        );
        let next = scan_of(0.04, &[5.1, LEFT_OUT, 5.0, 4.0, 5.0, MISS, 19.9]);
        // 10 cm is the document's 0.39.
        assert_eq!(measured(&mut metric, &next), [39, -1, 100, -1, -1, 100]);
        let third = scan_of(0.08, &[5.1, 3.0, 5.0, 4.0, 5.0, 1.0, 20.1]);
        assert_eq!(measured(&mut metric, &third), [0, -1, 0, 0, 0, -1, -1]);
    }

    #[test]
    fn a_pause_starts_anew_and_a_slower_sensor_goes_on() {
        let mut metric = metric();
        let ranges = [5.0, 5.0];
        let mut at = |stamp_s: f64| measured(&mut metric, &scan_of(stamp_s, &ranges))[0];
        assert_eq!(at(0.0), -1);
        assert_eq!(at(0.04), 0);
        assert_eq!(at(0.16), 0, "three periods");
        assert_eq!(at(0.20), 0);
        assert_eq!(at(0.40), -1, "five periods");
        assert_eq!(at(0.60), 0, "from now on at 5 Hz");
        assert_eq!(at(0.60), -1, "no time has passed");
        assert_eq!(at(0.80), 0);
        assert_eq!(at(0.10), -1, "back in time");
        assert_eq!(at(0.30), 0);
        assert_eq!(at(1.40), -1, "more than a second");
    }

    #[test]
    fn beams_that_look_elsewhere_are_not_compared() {
        let mut metric = metric();
        measured(&mut metric, &scan_of(0.0, &[5.0; 100]));
        let mut coarse = scan_of(0.04, &[5.0; 100]);
        coarse.beam_step_rad *= 1.01;
        assert_eq!(measured(&mut metric, &coarse), [-1; 100]);
        // As a message's f32 rounds it.
        let mut rounded = scan_of(0.08, &[5.0; 100]);
        rounded.beam_step_rad = coarse.beam_step_rad * (1.0 + 1e-7);
        assert_eq!(measured(&mut metric, &rounded), [0; 100]);
    }

    #[test]
    fn sensors_are_kept_apart() {
        let mut metric = metric();
        let scan = |stamp_s: f64, sensor: u8, range_m: f32| RegisteredScan {
            sensor: SensorId(sensor),
            ..scan_of(stamp_s, &[range_m])
        };
        measured(&mut metric, &scan(0.0, 2, 5.0));
        assert_eq!(measured(&mut metric, &scan(0.01, 1, 7.0)), [-1]);
        assert_eq!(measured(&mut metric, &scan(0.04, 2, 5.051)), [20]);
        assert_eq!(measured(&mut metric, &scan(0.05, 1, 7.0)), [0]);
        metric.reset();
        assert_eq!(measured(&mut metric, &scan(0.08, 2, 5.0)), [-1]);
    }
}
