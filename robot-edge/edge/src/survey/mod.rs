//! What is in a recording: one pass over it, for `robot-edge info` and for choosing what to map.

use std::path::{Path, PathBuf};

use self::frames::FrameSurvey;
use self::topics::{AttitudeSurvey, FixSurvey, JointSurvey, ScanSurvey, StampSurvey};
use measurement::drops::DropCounts;
use measurement::time::{RobotDuration, RobotTime};
use measurement::{FrameId, Measurement, MeasurementData, StreamId};
use recording::{Format, Position, RecordingError, RecordingReader, Selection, StreamSummary};

mod frames;
pub mod range_sensors;
mod report;
pub(crate) mod topics;

pub use report::Mappable;

/// Of longer files only the beginning is surveyed.
pub const MAX_SURVEYED_BYTES: u64 = 256 << 20;

/// Streams of one kind that are distinguished.
const MAX_SOURCES: usize = 64;

/// What is in a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Survey {
    /// The file.
    pub path: PathBuf,
    /// Its format.
    pub format: Format,
    /// How far it was read.
    pub position: Position,
    /// All streams; a [`StreamId`] is an index into them.
    pub streams: Vec<StreamSummary>,
    /// The stamps of the measurements of each stream.
    pub stamps: Vec<StampSurvey>,
    /// The streams of scans.
    pub scans: Vec<ScanSurvey>,
    /// The frames that transforms connect.
    pub frames: FrameSurvey,
    /// The streams of odometry.
    pub odometry: Vec<OdometrySurvey>,
    /// The streams of joint angles.
    pub joints: Vec<JointSurvey>,
    /// The streams of attitudes.
    pub attitudes: Vec<AttitudeSurvey>,
    /// The streams of satellite fixes.
    pub fixes: Vec<FixSurvey>,
    /// The vehicle that the metadata names.
    pub vehicle: Option<String>,
    /// What could not be read.
    pub losses: DropCounts,
    /// The first losses in words.
    pub loss_notes: Vec<String>,
    /// Stamps that contradicted the order of their stream and were changed.
    pub stamp_repairs: u64,
}

/// The poses of one stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OdometrySurvey {
    /// Which stream.
    pub stream: StreamId,
    /// Frame of the poses.
    pub parent: FrameId,
    /// Frame of the vehicle.
    pub child: FrameId,
    /// How many.
    pub count: u64,
}

impl Survey {
    /// Surveys the recording at `path`, up to [`MAX_SURVEYED_BYTES`] of it.
    pub fn of(path: &Path) -> Result<Self, RecordingError> {
        let format = Format::of(path)?;
        let mut reader = recording::open(path, Selection::All)?;
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

    /// The stream called by `id`.
    pub fn stream(&self, id: StreamId) -> Option<&StreamSummary> {
        self.streams.get(usize::from(id.0))
    }

    /// Name of a stream; empty if it is not known.
    fn topic_name(&self, id: StreamId) -> &str {
        self.stream(id).map_or("", |summary| &summary.stream.name)
    }

    /// The odometry to map with: `nav_msgs/Odometry` is what REP-105 means by it; else the most frequent.
    pub fn best_odometry(&self) -> Option<&OdometrySurvey> {
        self.odometry.iter().max_by_key(|odometry| {
            let kind = self
                .stream(odometry.stream)
                .map(|summary| &*summary.stream.type_name);
            (kind == Some("nav_msgs/Odometry"), odometry.count)
        })
    }

    /// Whether the whole file was read.
    pub const fn is_complete(&self) -> bool {
        self.position.bytes_read < MAX_SURVEYED_BYTES
            || self.position.bytes_read >= self.position.bytes_total
    }

    /// First and last stamp: of the scans where there are any, else of all that moves.
    pub fn time_span(&self) -> Option<(RobotTime, RobotTime)> {
        let scans = self.scans.iter().map(|scan| &scan.stamps);
        let of_scans = span(scans);
        of_scans.or_else(|| span(self.stamps.iter()))
    }

    /// Time from first to last stamp.
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
                if let Some(survey) = self.scan_survey(*stream, frame, scan) {
                    survey.add(*stamp, scan, own_pose.is_some());
                }
            }
            MeasurementData::Transform {
                child, is_static, ..
            } => self.frames.add(frame, child, *stamp, *is_static),
            MeasurementData::Odometry { child, .. } => self.add_odometry(*stream, frame, child),
            MeasurementData::Imu(sample) => {
                let known = of_stream(
                    &mut self.attitudes,
                    |a| a.stream == *stream,
                    || AttitudeSurvey::new(*stream),
                );
                if let Some(survey) = known {
                    survey.add(sample);
                }
            }
            MeasurementData::Joints(joints) => {
                let known = of_stream(
                    &mut self.joints,
                    |j| j.stream == *stream,
                    || JointSurvey::new(*stream),
                );
                if let Some(survey) = known {
                    survey.add(joints);
                }
            }
            MeasurementData::Fix(fix) => {
                let known = of_stream(
                    &mut self.fixes,
                    |f| f.stream == *stream,
                    || FixSurvey::new(*stream),
                );
                if let Some(survey) = known {
                    survey.add(fix);
                }
            }
            MeasurementData::Twist(_) | MeasurementData::PointCloud(_) => {}
        }
        if !measurement.is_static_transform() {
            self.stamps[index].add(*stamp);
        }
    }

    fn scan_survey(
        &mut self,
        stream: StreamId,
        frame: &FrameId,
        scan: &measurement::scan::Scan,
    ) -> Option<&mut ScanSurvey> {
        of_stream(
            &mut self.scans,
            |survey| survey.stream == stream,
            || ScanSurvey::new(stream, frame.clone(), scan),
        )
    }

    fn add_odometry(&mut self, stream: StreamId, parent: &FrameId, child: &FrameId) {
        let known = self
            .odometry
            .iter_mut()
            .find(|survey| survey.stream == stream);
        if let Some(survey) = known {
            survey.count += 1;
        } else if self.odometry.len() < MAX_SOURCES {
            self.odometry.push(OdometrySurvey {
                stream,
                parent: parent.clone(),
                child: child.clone(),
                count: 1,
            });
        }
    }
}

/// What is known of a stream; nothing where there are too many.
fn of_stream<T>(
    known: &mut Vec<T>,
    is_it: impl Fn(&T) -> bool,
    new: impl FnOnce() -> T,
) -> Option<&mut T> {
    let index = known.iter().position(is_it).unwrap_or(known.len());
    if index == known.len() && index < MAX_SOURCES {
        known.push(new());
    }
    known.get_mut(index)
}

fn span<'a>(stamps: impl Iterator<Item = &'a StampSurvey>) -> Option<(RobotTime, RobotTime)> {
    stamps
        .filter_map(|stamps| Some((stamps.first?, stamps.last?)))
        .reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
}

#[cfg(test)]
mod tests;
