//! What is in a recording: one pass over it, for `robot-edge info` and for choosing what to map.

use std::path::{Path, PathBuf};

use self::frames::FrameSurvey;
use self::topics::{AttitudeSurvey, FixSurvey, JointSurvey, ScanSurvey, StampSurvey};
use measurement::drops::DropCounts;
use measurement::time::{RobotDuration, RobotTime};
use measurement::{FrameId, Measurement, MeasurementData, Stream, StreamId};
use recording::poses::PoseFile;
use recording::ros::MessageType;
use recording::{Format, Position, RecordingError, RecordingReader, Selection, StreamSummary};

mod frames;
pub mod range_sensors;
mod report;
pub(crate) mod topics;

pub use report::{Mappable, recover_advice};

/// Of longer files only the beginning is surveyed.
pub const MAX_SURVEYED_BYTES: u64 = 256 << 20;

/// Streams of one kind that are distinguished.
const MAX_SOURCES: usize = 64;

/// What is in a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Survey {
    pub path: PathBuf,
    pub format: Format,
    /// How far it was read.
    pub position: Position,
    /// All streams; a [`StreamId`] is an index into them.
    pub streams: Vec<StreamSummary>,
    pub stamps: Vec<StampSurvey>,
    pub scans: ByStream<ScanSurvey>,
    /// Frames of the streams of `sensor_msgs/Range` and `sensor_msgs/PointCloud2`.
    pub range_frames: ByStream<FrameId>,
    pub frames: FrameSurvey,
    pub odometry: ByStream<OdometrySurvey>,
    pub joints: ByStream<JointSurvey>,
    pub attitudes: ByStream<AttitudeSurvey>,
    pub fixes: ByStream<FixSurvey>,
    /// The vehicle that the metadata names.
    pub vehicle: Option<String>,
    pub losses: DropCounts,
    pub loss_notes: Vec<String>,
    /// Stamps that contradicted the order of their stream and were changed.
    pub stamp_repairs: u64,
}

/// Streams in the order of their first messages.
pub type ByStream<T> = Vec<(StreamId, T)>;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OdometrySurvey {
    /// Frame of the poses.
    pub parent: FrameId,
    /// Frame of the vehicle.
    pub child: FrameId,
    pub count: u64,
}

impl Survey {
    /// Surveys the recording at `path`, up to [`MAX_SURVEYED_BYTES`] of it.
    pub fn of(path: &Path, poses: Option<PoseFile>) -> Result<Self, RecordingError> {
        let format = Format::of(path)?;
        let mut reader = recording::open_surveyed(path, Selection::All, None, poses)?;
        Self::of_reader(path, format, reader.as_mut())
    }

    /// Surveys what `reader` yields of the file at `path`, up to [`MAX_SURVEYED_BYTES`] of it.
    pub fn of_reader(
        path: &Path,
        format: Format,
        reader: &mut dyn RecordingReader,
    ) -> Result<Self, RecordingError> {
        let mut survey = Self {
            path: path.to_owned(),
            format,
            position: reader.position(),
            streams: Vec::new(),
            stamps: Vec::new(),
            scans: Vec::new(),
            range_frames: Vec::new(),
            frames: FrameSurvey::default(),
            odometry: Vec::new(),
            joints: Vec::new(),
            attitudes: Vec::new(),
            fixes: Vec::new(),
            vehicle: None,
            losses: DropCounts::default(),
            loss_notes: Vec::new(),
            stamp_repairs: 0,
        };
        while reader.position().bytes_read < MAX_SURVEYED_BYTES
            && let Some(measurement) = reader.next_measurement()?
        {
            survey.add(&measurement);
        }
        survey.position = reader.position();
        survey.streams = reader.streams().to_vec();
        survey
            .stamps
            .resize_with(survey.streams.len(), StampSurvey::default);
        survey.vehicle = reader.vehicle().map(str::to_owned);
        survey.losses = reader.losses().clone();
        survey.loss_notes = reader.loss_notes().to_vec();
        survey.stamp_repairs = reader.stamp_repairs();
        Ok(survey)
    }

    pub fn stream(&self, id: StreamId) -> Option<&StreamSummary> {
        self.streams.get(usize::from(id.0))
    }

    /// Name of a stream; empty if it is not known.
    pub fn topic_name(&self, id: StreamId) -> &str {
        self.stream(id).map_or("", |summary| &summary.stream.name)
    }

    /// The odometry to map with: `nav_msgs/Odometry` is what REP-105 means by it; else the most frequent.
    pub fn best_odometry(&self) -> Option<&(StreamId, OdometrySurvey)> {
        self.odometry.iter().max_by_key(|(stream, odometry)| {
            let kind = self
                .stream(*stream)
                .map(|summary| &*summary.stream.type_name);
            (kind == Some("nav_msgs/Odometry"), odometry.count)
        })
    }

    /// The streams that have the angles of all these joints.
    pub fn streams_with_joints(&self, joints: &[&String]) -> Vec<StreamId> {
        let has_all = |survey: &JointSurvey| joints.iter().all(|&name| survey.names.contains(name));
        streams(&self.joints, has_all)
    }

    pub fn streams_with_orientation(&self) -> Vec<StreamId> {
        streams(&self.attitudes, |attitudes| attitudes.oriented > 0)
    }

    /// The streams of satellite fixes that are valid.
    pub fn streams_with_fix(&self) -> Vec<StreamId> {
        streams(&self.fixes, |fixes| fixes.fixed > 0)
    }

    /// Whether the whole file was read.
    pub const fn is_complete(&self) -> bool {
        self.position.bytes_read < MAX_SURVEYED_BYTES
            || self.position.bytes_read >= self.position.bytes_total
    }

    /// The streams of clouds.
    pub fn clouds(&self) -> impl Iterator<Item = &Stream> {
        let streams = self.streams.iter().filter(|summary| summary.messages > 0);
        let streams = streams.map(|summary| &summary.stream);
        streams.filter(|stream| is_of_lidar(&stream.type_name))
    }

    /// Whether it has neither scans nor clouds.
    pub fn lacks_range_sensor(&self) -> bool {
        self.scans.is_empty() && self.clouds().next().is_none()
    }

    /// First and last stamp: of the scans where there are any, else of all that moves.
    pub fn time_span(&self) -> Option<(RobotTime, RobotTime)> {
        let scans = self.scans.iter().map(|(_, scan)| &scan.stamps);
        let of_scans = span(scans);
        of_scans.or_else(|| span(self.stamps.iter()))
    }

    pub fn duration(&self) -> RobotDuration {
        self.time_span()
            .map_or(RobotDuration::ZERO, |(first, last)| last.since(first))
    }

    fn add(&mut self, measurement: &Measurement) {
        let Measurement {
            stamp,
            stream,
            frame,
            data,
        } = measurement;
        let index = usize::from(stream.0);
        if self.stamps.len() <= index {
            self.stamps.resize_with(index + 1, StampSurvey::default);
        }
        match data {
            MeasurementData::Scan { scan, own_pose } => {
                let new = || ScanSurvey::new(frame.clone(), scan);
                if let Some(survey) = of_stream(&mut self.scans, *stream, new) {
                    survey.add(*stamp, scan, own_pose.is_some());
                }
            }
            MeasurementData::Transform {
                child, is_static, ..
            } => self.frames.add(frame, child, *stamp, *is_static),
            MeasurementData::Odometry { child, .. } => {
                let new = || OdometrySurvey {
                    parent: frame.clone(),
                    child: child.clone(),
                    count: 0,
                };
                if let Some(survey) = of_stream(&mut self.odometry, *stream, new) {
                    survey.count += 1;
                }
            }
            MeasurementData::Imu(sample) => {
                if let Some(survey) =
                    of_stream(&mut self.attitudes, *stream, AttitudeSurvey::default)
                {
                    survey.add(sample);
                }
            }
            MeasurementData::Joints(joints) => {
                if let Some(survey) = of_stream(&mut self.joints, *stream, JointSurvey::default) {
                    survey.add(joints);
                }
            }
            MeasurementData::Fix(fix) => {
                if let Some(survey) = of_stream(&mut self.fixes, *stream, FixSurvey::default) {
                    survey.add(fix);
                }
            }
            MeasurementData::Range(_) | MeasurementData::Cloud(_) => {
                of_stream(&mut self.range_frames, *stream, || frame.clone());
            }
            MeasurementData::Twist(_) | MeasurementData::Bool(_) => {}
        }
        if !measurement.is_static_transform() {
            self.stamps[index].add(*stamp);
        }
    }
}

/// Whether streams of this type become clouds.
pub fn is_of_lidar(type_name: &str) -> bool {
    type_name == recording::LIDAR_PACKETS
        || MessageType::from_type_name(type_name).is_some_and(MessageType::is_cloud)
}

/// What is known of a stream; nothing where there are too many.
fn of_stream<T>(
    known: &mut ByStream<T>,
    stream: StreamId,
    new: impl FnOnce() -> T,
) -> Option<&mut T> {
    let place = known.iter().position(|(of, _)| *of == stream);
    let index = place.unwrap_or(known.len());
    if index == known.len() && index < MAX_SOURCES {
        known.push((stream, new()));
    }
    known.get_mut(index).map(|(_, survey)| survey)
}

fn streams<T>(known: &[(StreamId, T)], fits: impl Fn(&T) -> bool) -> Vec<StreamId> {
    let fitting = known.iter().filter(|(_, survey)| fits(survey));
    fitting.map(|&(stream, _)| stream).collect()
}

fn span<'a>(stamps: impl Iterator<Item = &'a StampSurvey>) -> Option<(RobotTime, RobotTime)> {
    stamps
        .filter_map(|stamps| Some((stamps.first?, stamps.last?)))
        .reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
}

#[cfg(test)]
pub(crate) mod tests;
