//! Poses of a sensor that come beside a recording, in a file of their own.

use std::collections::VecDeque;
use std::path::Path;

use measurement::drops::DropCounts;
use measurement::pose::{self, Pose};
use measurement::time::{RobotDuration, RobotTime};
use measurement::{FrameId, Measurement, MeasurementData, Stream, StreamId};
use nalgebra::{Matrix3, Matrix3x4, Rotation3, UnitQuaternion};

use super::{Position, RecordingError, RecordingReader, StreamSummary};

/// Name of their stream.
const STREAM: &str = "/poses";
/// Frame that they refer to.
const FIXED_FRAME: &str = "odom";
/// Poses are passed on so long before the measurements of their time.
const AHEAD: RobotDuration = RobotDuration::from_millis(500);
/// Assumed length of the last revolution, which no other one follows.
const REVOLUTION: RobotDuration = RobotDuration::from_millis(100);

/// The poses of a file.
#[derive(Clone, Debug, PartialEq)]
pub enum PoseFile {
    /// Rows of 12 numbers, as of KITTI: the upper three rows of the matrix that moves points of a cloud into the frame of the
    /// map, one for each cloud in order.
    ForEachCloud(Vec<Pose>),
    /// Rows of 8 numbers, as of TUM: time (s), x, y, z (m), quaternion x, y, z, w.
    Stamped(Vec<(RobotTime, Pose)>),
}

impl PoseFile {
    /// Reads the file at `path`. Empty lines and lines that begin with `#` are left out.
    pub fn read(path: &Path) -> Result<Self, RecordingError> {
        let text = std::fs::read_to_string(path).map_err(RecordingError::io(path))?;
        let damaged = |line: usize, what: &str| RecordingError::Damaged {
            path: path.to_owned(),
            offset: line as u64,
            what: format!("line {line}: {what}"),
            remedy: "Each line has 12 numbers (KITTI: rows of a matrix, one line for each cloud) or 8 (TUM: time, position, \
                     quaternion)",
        };
        let (mut of_clouds, mut stamped) = (Vec::new(), Vec::new());
        for (line, text) in (1..).zip(text.lines()) {
            if text.trim().is_empty() || text.starts_with('#') {
                continue;
            }
            let numbers = text.split_whitespace().map(str::parse);
            let numbers: Result<Vec<f64>, _> = numbers.collect();
            let numbers = numbers.map_err(|error| damaged(line, &error.to_string()))?;
            match numbers[..] {
                [time_s, x, y, z, qx, qy, qz, qw] => {
                    let pose = pose::from_parts([x, y, z], [qx, qy, qz, qw]);
                    let stamp = RobotTime::from_secs_f64(time_s);
                    let known = stamp.zip(pose);
                    stamped.push(known.ok_or_else(|| {
                        damaged(line, "no pose: its time or quaternion cannot be")
                    })?);
                }
                [..] if numbers.len() == 12 => {
                    let pose = of_matrix(&numbers);
                    of_clouds.push(
                        pose.ok_or_else(|| damaged(line, "no pose: its matrix is no rotation"))?,
                    );
                }
                _ => return Err(damaged(line, &format!("{} numbers", numbers.len()))),
            }
        }
        match (of_clouds.is_empty(), stamped.is_empty()) {
            (false, true) => Ok(Self::ForEachCloud(of_clouds)),
            (true, false) => {
                stamped.sort_by_key(|(stamp, _)| *stamp);
                Ok(Self::Stamped(stamped))
            }
            (true, true) => Err(damaged(1, "there are no poses")),
            (false, false) => Err(damaged(1, "some lines have 12 numbers, others 8")),
        }
    }
}

/// Deviation of a matrix from a rotation that rounding explains.
const ROTATION_TOLERANCE: f64 = 1e-3;

fn of_matrix(rows: &[f64]) -> Option<Pose> {
    let matrix = Matrix3x4::from_row_slice(rows);
    let rotation: Matrix3<f64> = matrix.fixed_columns::<3>(0).into_owned();
    let deviation = (rotation * rotation.transpose() - Matrix3::identity()).norm();
    let is_pose = deviation < ROTATION_TOLERANCE
        && rotation.determinant() > 0.0
        && matrix.iter().all(|number| number.is_finite());
    is_pose.then(|| {
        let rotation = Rotation3::from_matrix_unchecked(rotation);
        let mut rotation = UnitQuaternion::from_rotation_matrix(&rotation);
        rotation.renormalize();
        Pose::from_parts(matrix.column(3).into_owned().into(), rotation)
    })
}

/// A recording with the poses of a file as transforms from `odom` to the frame of its clouds.
pub struct WithPoses {
    inner: Box<dyn RecordingReader>,
    poses: PoseFile,
    /// Clouds, or stamped poses, so far.
    taken: usize,
    last_cloud: Option<RobotTime>,
    frame: FrameId,
    ready: VecDeque<Measurement>,
    streams: Vec<StreamSummary>,
    is_finished: bool,
}

impl WithPoses {
    /// Adds poses to what `inner` yields.
    pub fn new(inner: Box<dyn RecordingReader>, poses: PoseFile) -> Self {
        Self {
            inner,
            poses,
            taken: 0,
            last_cloud: None,
            frame: "".into(),
            ready: VecDeque::new(),
            streams: vec![StreamSummary {
                stream: Stream {
                    name: STREAM.to_owned(),
                    type_name: "tf2_msgs/TFMessage".to_owned(),
                },
                understood: true,
                messages: 0,
                first: None,
                last: None,
            }],
            is_finished: false,
        }
    }

    fn add_pose(&mut self, stamp: RobotTime, pose: Pose) {
        let summary = &mut self.streams[0];
        summary.messages += 1;
        summary.first = summary.first.or(Some(stamp));
        summary.last = Some(stamp);
        self.ready.push_back(Measurement {
            stamp,
            stream: StreamId(0),
            frame: FIXED_FRAME.into(),
            data: MeasurementData::Transform {
                child: FrameId::clone(&self.frame),
                parent_from_child: pose,
                is_static: false,
            },
        });
    }

    /// Puts the poses up to a measurement's time, and the measurement, into what is ready.
    fn take(&mut self, mut measurement: Measurement) {
        // Their own stream is the first.
        measurement.stream.0 += 1;
        let is_cloud = matches!(measurement.data, MeasurementData::Cloud(_));
        if is_cloud {
            self.frame = FrameId::clone(&measurement.frame);
        }
        match &self.poses {
            PoseFile::ForEachCloud(poses) => {
                if is_cloud && let Some(pose) = poses.get(self.taken).copied() {
                    self.taken += 1;
                    self.last_cloud = Some(measurement.stamp);
                    self.add_pose(measurement.stamp, pose);
                }
            }
            PoseFile::Stamped(poses) if !self.frame.is_empty() => {
                let until = measurement.stamp + AHEAD;
                let due: Vec<_> = poses[self.taken..]
                    .iter()
                    .take_while(|(stamp, _)| *stamp <= until)
                    .copied()
                    .collect();
                self.taken += due.len();
                for (stamp, pose) in due {
                    self.add_pose(stamp, pose);
                }
            }
            PoseFile::Stamped(_) => {}
        }
        self.ready.push_back(measurement);
    }

    /// The vehicle goes on during the last cloud as before it.
    fn finish(&mut self) {
        if let (PoseFile::ForEachCloud(poses), Some(stamp)) = (&self.poses, self.last_cloud)
            && let [.., before, last] = poses[..self.taken]
        {
            self.add_pose(stamp + REVOLUTION, last * (before.inverse() * last));
        }
    }
}

impl RecordingReader for WithPoses {
    fn next_measurement(&mut self) -> Result<Option<Measurement>, RecordingError> {
        loop {
            if let Some(measurement) = self.ready.pop_front() {
                return Ok(Some(measurement));
            }
            if self.is_finished {
                return Ok(None);
            }
            let next = self.inner.next_measurement()?;
            self.streams.truncate(1);
            self.streams.extend_from_slice(self.inner.streams());
            if let Some(measurement) = next {
                self.take(measurement);
            } else {
                self.is_finished = true;
                self.finish();
            }
        }
    }

    fn streams(&self) -> &[StreamSummary] {
        &self.streams
    }

    fn losses(&self) -> &DropCounts {
        self.inner.losses()
    }

    fn loss_notes(&self) -> &[String] {
        self.inner.loss_notes()
    }

    fn position(&self) -> Position {
        self.inner.position()
    }

    fn stamp_repairs(&self) -> u64 {
        self.inner.stamp_repairs()
    }

    fn vehicle(&self) -> Option<&str> {
        self.inner.vehicle()
    }
}
