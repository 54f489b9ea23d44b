//! For tests: what is recorded, and what is read of it.

use std::path::Path;

use measurement::pose::Pose;
use measurement::time::RobotTime;
use measurement::{Measurement, MeasurementData, Stream, StreamId};
use recording::{Selection, open};

pub(super) fn transform(nanos: i64, child: &str, is_static: bool) -> Measurement {
    Measurement {
        stamp: RobotTime::from_nanos(nanos),
        stream: StreamId(0),
        frame: "odom".into(),
        data: MeasurementData::Transform {
            child: child.into(),
            parent_from_child: Pose::translation(1.0, 2.0, 3.0),
            is_static,
        },
    }
}

pub(super) fn stream() -> Stream {
    Stream {
        name: "/tf".into(),
        type_name: "tf2_msgs/TFMessage".into(),
    }
}

/// Of all that can be read of a recording, ended or not.
pub(super) fn stamps(path: &Path) -> Vec<i64> {
    let mut reader = open(path, Selection::default()).unwrap();
    let mut stamps = Vec::new();
    while let Some(measurement) = reader.next_measurement().unwrap() {
        stamps.push(measurement.stamp.as_nanos());
    }
    stamps
}
