//! Writes MCAP with ROS 2 messages and their schemas, which Foxglove and `ros2 bag` open.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};

use super::mcap::{METADATA_NAME, VEHICLE_KEY};
use crate::name_missing;
use crate::new_file::{self, NewFile};
use crate::new_file::{DiskSpace, DiskSpaceFn};
use crate::ros::{self, MessageType};
use measurement::{Measurement, Stream};

/// Uncompressed size at which a chunk is closed: what a cut-off file can lose at most is one chunk.
const CHUNK_BYTES: u64 = 768 << 10;

/// Why a recording cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The file.
    #[error("{path}: cannot write the recording: {source}", path = path.display())]
    Mcap {
        /// The file.
        path: PathBuf,
        /// The error of the system or the format.
        source: mcap::McapError,
    },
    /// A stamp before 1970, which MCAP's unsigned times cannot hold.
    #[error("{path}: cannot record a measurement of {stamp}: MCAP has no times before 1970", path = path.display())]
    Stamp {
        /// Which file.
        path: PathBuf,
        /// The stamp.
        stamp: measurement::time::RobotTime,
    },
    /// Other things need what is left of the disk.
    #[error("{path}: recording ends: the disk is nearly full: {space}", path = path.display())]
    DiskLow {
        /// Which file.
        path: PathBuf,
        /// What is left.
        space: DiskSpace,
    },
}

impl WriteError {
    fn mcap<E: Into<mcap::McapError>>(path: &Path) -> impl Fn(E) -> Self + Copy {
        move |error| Self::Mcap {
            path: path.to_owned(),
            source: error.into(),
        }
    }
}

/// A recording's file; another thread can sync it.
#[derive(Clone, Debug)]
pub struct RecordingFile(Arc<NewFile>);

/// Writes one file: chunks with checksums, an index at the end. The same input gives the same bytes.
pub struct McapWriter {
    writer: mcap::Writer<BufWriter<File>>,
    /// The same file.
    on_disk: RecordingFile,
    /// By topic and type: channel, and messages written.
    channels: BTreeMap<(String, &'static str), (u16, u32)>,
    not_written: u64,
}

impl McapWriter {
    /// Creates the file, under a numbered name where there is such a file ([`new_file::create`]). `vehicle` goes into its
    /// metadata, so that a replay needs no `--vehicle`.
    pub fn create(path: &Path, vehicle: Option<&str>) -> Result<Self, WriteError> {
        let same = new_file::create(path)
            .map_err(|error| WriteError::mcap(path)(name_missing(path, error)))?;
        let file = same.file.try_clone().map_err(WriteError::mcap(path))?;
        let options = WriteOptions::new()
            .profile("ros2")
            .library(concat!("foreshore ", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            // One thread: frames of several threads differ from machine to machine.
            .compression_threads(0)
            .chunk_size(Some(CHUNK_BYTES));
        let writer = options.create(BufWriter::new(file));
        let mut writer = writer.map_err(WriteError::mcap(path))?;
        if let Some(vehicle) = vehicle {
            let metadata = mcap::records::Metadata {
                name: METADATA_NAME.to_owned(),
                metadata: BTreeMap::from([(VEHICLE_KEY.to_owned(), vehicle.to_owned())]),
            };
            let written = writer.write_metadata(&metadata);
            written.map_err(WriteError::mcap(path))?;
        }
        Ok(Self {
            writer,
            on_disk: RecordingFile(Arc::new(same)),
            channels: BTreeMap::new(),
            not_written: 0,
        })
    }

    /// Writes one measurement as a message on the topic `stream.name`.
    pub fn write(&mut self, stream: &Stream, measurement: &Measurement) -> Result<(), WriteError> {
        let Some((kind, data)) = ros::encode(measurement, &stream.type_name) else {
            self.not_written += 1;
            return Ok(());
        };
        let stamp = measurement.stamp;
        let time = u64::try_from(stamp.as_nanos()).map_err(|_negative| WriteError::Stamp {
            path: self.path().to_owned(),
            stamp,
        })?;
        let error = WriteError::mcap(&self.on_disk.0.path);
        let (channel_id, sequence) =
            channel(&mut self.writer, &mut self.channels, &stream.name, kind).map_err(error)?;
        let header = MessageHeader {
            channel_id,
            sequence,
            log_time: time,
            publish_time: time,
        };
        self.writer
            .write_to_known_channel(&header, &data)
            .map_err(error)
    }

    /// Closes the chunk and hands all of it to the disk: what was written before survives a power cut.
    pub fn flush(&mut self) -> Result<(), WriteError> {
        self.flush_to_os()?;
        self.on_disk.sync()
    }

    /// Closes the chunk and hands all of it to the system, which puts it on the disk in its own time, or as [`RecordingFile::sync`]
    /// demands.
    pub fn flush_to_os(&mut self) -> Result<(), WriteError> {
        let flushed = self.writer.flush();
        flushed.map_err(WriteError::mcap(self.path()))
    }

    /// The file, for another thread to sync.
    pub fn on_disk(&self) -> RecordingFile {
        self.on_disk.clone()
    }

    /// The file's name, which may be numbered.
    pub fn path(&self) -> &Path {
        &self.on_disk.0.path
    }

    /// It cannot be written, for this reason.
    pub fn failed(&self, why: io::Error) -> WriteError {
        self.on_disk.failed(why)
    }

    /// Measurements of kinds that are not recorded (clouds).
    pub const fn not_written(&self) -> u64 {
        self.not_written
    }

    /// Writes index and end mark.
    pub fn finish(mut self) -> Result<(), WriteError> {
        let finished = self.writer.finish();
        finished.map_err(WriteError::mcap(self.path()))?;
        let written = self.writer.into_inner().into_inner();
        written.map_err(|error| self.on_disk.failed(error.into_error()))?;
        self.on_disk.sync()
    }
}

impl RecordingFile {
    /// Waits until all that was handed to the system is on the disk: it survives a power cut.
    pub fn sync(&self) -> Result<(), WriteError> {
        self.0.sync().map_err(|why| self.failed(why))
    }

    /// Whether recording may go on.
    pub fn check_space(&self, disk_space: DiskSpaceFn) -> Result<(), WriteError> {
        self.0.low_space(disk_space).map_or(Ok(()), |space| {
            Err(WriteError::DiskLow {
                path: self.0.path.clone(),
                space,
            })
        })
    }

    fn failed(&self, why: io::Error) -> WriteError {
        WriteError::mcap(&self.0.path)(why)
    }
}

/// The channel of a topic and type, made at its first message, and the number of this message on it.
fn channel(
    writer: &mut mcap::Writer<BufWriter<File>>,
    channels: &mut BTreeMap<(String, &'static str), (u16, u32)>,
    topic: &str,
    kind: MessageType,
) -> Result<(u16, u32), mcap::McapError> {
    // Types that are encoded have a schema; a channel without one could not be read.
    let (type_name, definition) = ros::ros2msg(kind).unwrap_or_default();
    if let Some((id, messages)) = channels.get_mut(&(topic.to_owned(), type_name)) {
        *messages += 1;
        return Ok((*id, *messages));
    }
    let schema = writer.add_schema(type_name, "ros2msg", definition.as_bytes())?;
    let metadata = BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]);
    let id = writer.add_channel(schema, topic, "cdr", &metadata)?;
    channels.insert((topic.to_owned(), type_name), (id, 1));
    Ok((id, 1))
}
