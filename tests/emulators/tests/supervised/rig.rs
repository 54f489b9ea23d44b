//! Supervisors in a test.

use std::sync::OnceLock;
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::{Duration, Instant};

use drivers::Drivers;
use drivers::status::{DeviceStatus, State};
use drivers::supervisor::Reading;
use measurement::scan::Scan;
use measurement::time::Monotonic;
use measurement::{MeasurementData, StreamId};

/// So long tests wait for what must come.
pub(crate) const PATIENCE: Duration = Duration::from_secs(10);
/// A device that is back is used within this.
pub(crate) const BACK_WITHIN: Duration = Duration::from_secs(2);

pub(crate) struct Rig {
    pub(crate) drivers: Drivers,
    readings: Receiver<Reading>,
}

/// Nanoseconds since the first call, after some hours.
pub(crate) fn clock() -> Monotonic {
    static START: OnceLock<Instant> = OnceLock::new();
    let start = START.get_or_init(emulators::now);
    Monotonic::from_nanos(0) + Duration::from_hours(3) + emulators::now().duration_since(*start)
}

impl Rig {
    pub(crate) fn start(config: &str) -> Self {
        let table: toml::Table = config.parse().unwrap();
        let configs = table["devices"].clone().try_into().unwrap();
        let (sender, readings) = sync_channel(10_000);
        Self {
            drivers: Drivers::start(&configs, clock, &sender).unwrap(),
            readings,
        }
    }

    /// The next measurement.
    #[track_caller]
    pub(crate) fn next(&self) -> Reading {
        self.next_within(PATIENCE)
    }

    #[track_caller]
    pub(crate) fn next_within(&self, wait: Duration) -> Reading {
        match self.readings.recv_timeout(wait) {
            Ok(reading) => reading,
            Err(error) => panic!("{error}: {:#?}", self.statuses()),
        }
    }

    /// The next measurement that is a scan, and its stamp, nanoseconds.
    #[track_caller]
    pub(crate) fn next_scan(&self) -> (Scan, i64) {
        let reading = self.next();
        let stamp_ns = reading.measurement.stamp.as_nanos();
        match reading.measurement.data {
            MeasurementData::Scan { scan, .. } => (scan, stamp_ns),
            other => panic!("{other:?}"),
        }
    }

    /// All measurements that have come.
    pub(crate) fn drain(&self) -> Vec<Reading> {
        self.readings.try_iter().collect()
    }

    pub(crate) fn statuses(&self) -> Vec<(&str, DeviceStatus)> {
        self.drivers.statuses().now().collect()
    }

    /// Of the first device.
    pub(crate) fn status(&self) -> DeviceStatus {
        self.statuses().remove(0).1
    }

    /// Waits until the first device is so.
    #[track_caller]
    pub(crate) fn wait(&self, what: &str, is_so: impl Fn(&DeviceStatus) -> bool) -> DeviceStatus {
        let give_up_at = emulators::now() + PATIENCE;
        loop {
            let status = self.status();
            if is_so(&status) {
                return status;
            }
            assert!(emulators::now() < give_up_at, "not {what}: {status:#?}");
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    #[track_caller]
    pub(crate) fn wait_until_measuring(&self) -> DeviceStatus {
        self.wait("measuring", |status| {
            status.state == State::Measuring && status.measurements > 0
        })
    }

    /// Waits for measurements after a device came back; fails if they take longer than allowed.
    #[track_caller]
    pub(crate) fn assert_back(&self) {
        self.drain();
        let back_at = clock();
        let reading = self.next_within(BACK_WITHIN);
        assert_eq!(reading.measurement.stream, StreamId(0));
        assert!(reading.arrived >= back_at);
    }
}

/// The age of a measurement when it arrived.
pub(crate) fn age(reading: &Reading) -> Duration {
    let age_ns = reading.arrived.nanos() - reading.measurement.stamp.as_nanos();
    Duration::from_nanos(u64::try_from(age_ns).expect("a stamp in the future"))
}
