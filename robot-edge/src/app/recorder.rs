//! `--record`: everything that came in, as ROS 2 messages.

use std::path::Path;
use std::time::Duration;

use crate::clock::Monotonic;
use crate::measurement::{Measurement, MeasurementData, OwnPose, Stream};
use crate::recording::writer::{McapWriter, WriteError};
use crate::robot_time::{RobotDuration, RobotTime};

/// A crash of a live run loses no more than this.
const FLUSH_PERIOD: Duration = Duration::from_secs(1);

/// Writes measurements as they come.
pub(super) struct Recorder {
    writer: McapWriter,
    /// Stamp of the last scan that brought its own pose.
    last_own_pose: Option<RobotTime>,
    /// Measurements whose stamps MCAP cannot hold.
    unrecordable: u64,
    /// Only runs in real time are flushed by the clock, so that others give the same file every time.
    flushed_at: Option<Monotonic>,
}

impl Recorder {
    pub(super) fn create(
        path: &Path,
        vehicle: &str,
        in_real_time: bool,
    ) -> Result<Self, WriteError> {
        let writer = McapWriter::create(path, Some(vehicle))?;
        Ok(Self {
            writer,
            last_own_pose: None,
            unrecordable: 0,
            flushed_at: in_real_time.then(Monotonic::now),
        })
    }

    pub(super) fn write(
        &mut self,
        stream: &Stream,
        measurement: &Measurement,
    ) -> Result<(), WriteError> {
        let written = match &measurement.data {
            MeasurementData::Scan {
                own_pose: Some(pose),
                ..
            } => self.write_with_own_pose(stream, measurement, pose),
            MeasurementData::Scan { own_pose: None, .. }
            | MeasurementData::Transform { .. }
            | MeasurementData::Odometry { .. }
            | MeasurementData::Imu(_)
            | MeasurementData::Joints(_)
            | MeasurementData::Fix(_)
            | MeasurementData::Twist(_)
            | MeasurementData::PointCloud(_) => self.writer.write(&ros_stream(stream), measurement),
        };
        match written {
            // One stamp that MCAP cannot hold must not end a drive.
            Err(WriteError::Stamp { .. }) => self.unrecordable += 1,
            written => written?,
        }
        if let Some(at) = self.flushed_at
            && at.elapsed() >= FLUSH_PERIOD
        {
            self.writer.flush()?;
            self.flushed_at = Some(Monotonic::now());
        }
        Ok(())
    }

    /// A `LaserScan` has no place for the pose that a log gives to its own scan: transforms have. Scans of
    /// one stamp would share one pose there, so each gets a stamp of its own.
    fn write_with_own_pose(
        &mut self,
        stream: &Stream,
        scan: &Measurement,
        pose: &OwnPose,
    ) -> Result<(), WriteError> {
        let next = self
            .last_own_pose
            .map_or(RobotTime::MIN, |last| last + RobotDuration::from_nanos(1));
        let stamp = scan.stamp.max(next);
        let tf = Stream {
            name: "/tf".into(),
            type_name: "tf2_msgs/TFMessage".into(),
        };
        let base_from_sensor = pose.odom_from_base.inverse() * pose.odom_from_sensor;
        for (parent, child, parent_from_child) in [
            ("odom", "base_link", pose.odom_from_base),
            ("base_link", &*scan.frame, base_from_sensor),
        ] {
            let child = child.into();
            let data = MeasurementData::Transform {
                child,
                parent_from_child,
                is_static: false,
            };
            let transform = Measurement {
                stamp,
                frame: parent.into(),
                data,
                stream: scan.stream,
            };
            self.writer.write(&tf, &transform)?;
        }
        self.last_own_pose = Some(stamp);
        self.writer.write(
            &ros_stream(stream),
            &Measurement {
                stamp,
                ..scan.clone()
            },
        )
    }

    /// Measurements that the recording does not hold: clouds, and stamps before 1970.
    pub(super) const fn not_written(&self) -> u64 {
        self.writer.not_written() + self.unrecordable
    }

    pub(super) fn finish(self) -> Result<(), WriteError> {
        self.writer.finish()
    }
}

/// CARMEN's message names become topics.
fn ros_stream(stream: &Stream) -> Stream {
    let name = match stream.name.strip_prefix('/') {
        Some(_) => stream.name.clone(),
        None => format!("/{}", stream.name.to_lowercase()),
    };
    Stream {
        name,
        ..stream.clone()
    }
}
