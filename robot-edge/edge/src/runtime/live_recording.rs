//! Recordings that operators start and stop while driving, written by a thread of their own.
//!
//! A file lasts one minute and is synced every second. A nearly full disk ends the recording with an alarm; driving
//! continues. After a crash, the next run resumes the recording; an orderly end of the program ends it.

use std::collections::{BTreeMap, VecDeque};
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use protocol::message::{self, RecordingStatus};

use super::recorder::{Recorder, SyncPolicy};
use crate::lock;
use measurement::byte_limit::{ByteLimit, ReservedBytes};
use measurement::time::Monotonic;
use measurement::{Measurement, MeasurementData, Stream};
use network::clock;
use recording::new_file::sync_folder_of;
use recording::new_file::{DiskSpace, DiskSpaceFn, disk_space};
use recording::writer::WriteError;

/// Maximum number of measurements that wait for the disk, and of their payload bytes: a few seconds of all sensors. A lidar of 64
/// rings and 1024 columns gives 16 MB/s.
const CAPACITY: usize = 2048;
const MAX_BYTES: usize = 64 << 20;
const FILE_PERIOD: Duration = Duration::from_mins(1);
/// Interval of syncs and checks of the disk space.
const CHECK_PERIOD: Duration = Duration::from_secs(1);
/// Maximum number of static transforms, which are written at the start of every file.
const MAX_STATIC_TRANSFORMS: usize = 256;

/// The sending end, in the localization stage.
pub(super) struct LiveRecording {
    commands: Option<SyncSender<WriterCommand>>,
    limit: ByteLimit,
    /// Commands that found no room and must not be lost.
    pending: VecDeque<WriterCommand>,
    state: Arc<Mutex<RecordingState>>,
    is_wanted: bool,
    is_resumed: bool,
    thread: Option<JoinHandle<()>>,
}

enum WriterCommand {
    Streams(Vec<Stream>),
    Measured(Measurement, ReservedBytes),
    ClockReset,
    Record(bool),
}

impl LiveRecording {
    /// Creates `folder`. Records when requested; at once if the previous run crashed while it recorded.
    pub(super) fn new(folder: &Path, robot: &str, vehicle: &str) -> io::Result<Self> {
        Self::on_disk(disk_space, folder, robot, vehicle)
    }

    fn on_disk(
        disk_space: DiskSpaceFn,
        folder: &Path,
        robot: &str,
        vehicle: &str,
    ) -> io::Result<Self> {
        std::fs::create_dir_all(folder)?;
        let (commands, receiver) = sync_channel(CAPACITY);
        let state = Arc::new(Mutex::new(RecordingState::default()));
        let marker = Marker::of(folder, robot);
        let is_resumed = marker.is_set();
        let writer = LiveRecordingWriter {
            disk_space,
            folder: folder.to_owned(),
            marker,
            robot: robot.to_owned(),
            vehicle: vehicle.to_owned(),
            streams: Vec::new(),
            static_transforms: BTreeMap::new(),
            file: None,
            finished: RecordedTotals::default(),
            state: Arc::clone(&state),
        };
        let thread = thread::Builder::new()
            .name("recording".to_owned())
            .spawn(move || writer.run(&receiver))?;
        let mut live = Self {
            commands: Some(commands),
            limit: ByteLimit::new(MAX_BYTES),
            pending: VecDeque::new(),
            state,
            is_wanted: false,
            is_resumed,
            thread: Some(thread),
        };
        if is_resumed {
            live.record(true);
        }
        Ok(live)
    }

    /// Adds streams that were discovered since the last call.
    pub(super) fn add_streams(&mut self, streams: &[Stream]) {
        if !streams.is_empty() {
            self.send(WriterCommand::Streams(streams.to_vec()));
        }
    }

    pub(super) fn add(&mut self, measurement: &Measurement) {
        if self.is_wanted || measurement.is_static_transform() {
            match self.limit.reserve(measurement.data.payload_bytes()) {
                Some(reserved) => self.send(WriterCommand::Measured(measurement.clone(), reserved)),
                None => lock(&self.state).lost += 1,
            }
        }
    }

    pub(super) fn reset_clock(&mut self) {
        self.send(WriterCommand::ClockReset);
    }

    pub(super) fn record(&mut self, is_wanted: bool) {
        self.is_wanted = is_wanted;
        self.send(WriterCommand::Record(is_wanted));
    }

    pub(super) const fn is_resumed(&self) -> bool {
        self.is_resumed
    }

    /// Ends the recording at the orderly end of a run.
    pub(super) fn finish(mut self) {
        if let Some(commands) = self.commands.take()
            && commands.send(WriterCommand::Record(false)).is_err()
        {
            tracing::error!("the thread that records has ended");
        }
    }

    pub(super) fn state(&self) -> RecordingState {
        lock(&self.state).clone()
    }

    /// Never waits. Measurements that find no room are dropped and counted; other commands are sent later.
    fn send(&mut self, command: WriterCommand) {
        self.pending.push_back(command);
        while let (Some(commands), Some(command)) = (&self.commands, self.pending.pop_front()) {
            match commands.try_send(command) {
                Ok(()) => {}
                Err(TrySendError::Disconnected(_)) => self.commands = None,
                Err(TrySendError::Full(WriterCommand::Measured(..))) => lock(&self.state).lost += 1,
                Err(TrySendError::Full(command)) => {
                    self.pending.push_front(command);
                    // Later commands keep their order; later measurements are dropped.
                    let before = self.pending.len();
                    self.pending
                        .retain(|command| !matches!(command, WriterCommand::Measured(..)));
                    lock(&self.state).lost += (before - self.pending.len()) as u64;
                    return;
                }
            }
        }
    }
}

impl Drop for LiveRecording {
    fn drop(&mut self) {
        self.commands = None;
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread that records failed");
        }
    }
}

struct LiveRecordingWriter {
    disk_space: DiskSpaceFn,
    folder: PathBuf,
    marker: Marker,
    robot: String,
    vehicle: String,
    streams: Vec<Stream>,
    /// By stream, parent and child.
    static_transforms: BTreeMap<(u16, String, String), Measurement>,
    file: Option<OpenFile>,
    /// The finished files of this recording.
    finished: RecordedTotals,
    state: Arc<Mutex<RecordingState>>,
}

struct OpenFile {
    recorder: Recorder,
    path: PathBuf,
    since: Monotonic,
}

#[derive(Clone, Copy, Debug, Default)]
struct RecordedTotals {
    bytes: u64,
    duration: Duration,
}

impl LiveRecordingWriter {
    fn run(mut self, receiver: &Receiver<WriterCommand>) {
        let mut last_check = clock::now();
        self.update_free_space();
        loop {
            let done = match receiver.recv_timeout(CHECK_PERIOD) {
                Ok(command) => self.take(command),
                Err(RecvTimeoutError::Timeout) => Ok(()),
                Err(RecvTimeoutError::Disconnected) => break,
            };
            let now = clock::now();
            let checked = if now.since(last_check) >= CHECK_PERIOD {
                last_check = now;
                self.check(now)
            } else {
                Ok(())
            };
            if let Err(error) = done.and(checked) {
                self.stop_with_error(error.to_string(), false);
            }
        }
        if let Err(error) = self.close() {
            tracing::error!(%error, "the last recording has no end");
        }
    }

    fn take(&mut self, command: WriterCommand) -> Result<(), WriteError> {
        match command {
            WriterCommand::Streams(streams) => self.streams.extend(streams),
            WriterCommand::ClockReset => {
                if let Some(open) = &mut self.file {
                    open.recorder.reset_clock();
                }
            }
            WriterCommand::Record(true) => {
                if self.file.is_none() {
                    self.finished = RecordedTotals::default();
                    let mut state = lock(&self.state);
                    *state = RecordingState {
                        free_bytes: state.free_bytes,
                        ..RecordingState::default()
                    };
                    drop(state);
                    self.open()?;
                    self.marker.set(self.file.is_some());
                }
            }
            WriterCommand::Record(false) => {
                self.marker.set(false);
                return self.close();
            }
            WriterCommand::Measured(measurement, _reserved) => {
                self.keep_static_transform(&measurement);
                let stream = self.streams.get(usize::from(measurement.stream.0));
                if let (Some(open), Some(stream)) = (&mut self.file, stream) {
                    return open.recorder.write(stream, &measurement);
                }
            }
        }
        Ok(())
    }

    fn keep_static_transform(&mut self, measurement: &Measurement) {
        if let MeasurementData::Transform {
            child,
            is_static: true,
            ..
        } = &measurement.data
        {
            let key = (
                measurement.stream.0,
                measurement.frame.to_string(),
                child.to_string(),
            );
            if self.static_transforms.len() < MAX_STATIC_TRANSFORMS
                || self.static_transforms.contains_key(&key)
            {
                self.static_transforms.insert(key, measurement.clone());
            }
        }
    }

    /// Flushes, starts the next file, and stops if the disk is nearly full.
    fn check(&mut self, now: Monotonic) -> Result<(), WriteError> {
        let space = self.update_free_space();
        let Some(open) = &mut self.file else {
            return Ok(());
        };
        open.recorder.flush()?;
        let is_over = now.since(open.since) >= FILE_PERIOD;
        self.update_totals(now);
        if let Some(space) = space.filter(DiskSpace::is_low) {
            self.close()?;
            self.stop_with_error(low_space_message(&space), true);
            return Ok(());
        }
        if is_over {
            self.close()?;
            self.open()?;
        }
        Ok(())
    }

    fn open(&mut self) -> Result<(), WriteError> {
        if let Some(space) = self.update_free_space().filter(DiskSpace::is_low) {
            self.stop_with_error(low_space_message(&space), true);
            return Ok(());
        }
        let path = self.folder.join(format!(
            "{}-{}.mcap",
            self.robot,
            clock::wall_clock_label().replace(':', "")
        ));
        let mut recorder = Recorder::create(&path, &self.vehicle, SyncPolicy::OnDemand, None)?;
        let path = recorder.path();
        for measurement in self.static_transforms.values() {
            if let Some(stream) = self.streams.get(usize::from(measurement.stream.0)) {
                recorder.write(stream, measurement)?;
            }
        }
        self.file = Some(OpenFile {
            recorder,
            path: path.clone(),
            since: clock::now(),
        });
        let mut state = lock(&self.state);
        state.is_running = true;
        state.file = Some(path);
        state.files += 1;
        Ok(())
    }

    fn update_free_space(&self) -> Option<DiskSpace> {
        let space = (self.disk_space)(&self.folder)
            .inspect_err(|error| tracing::warn!(%error, "nobody knows how much room the disk has"))
            .ok();
        lock(&self.state).free_bytes = space.map(|space| space.free_bytes);
        space
    }

    fn update_totals(&self, now: Monotonic) {
        let RecordedTotals { bytes, duration } = self.totals(now);
        let mut state = lock(&self.state);
        (state.bytes, state.duration) = (bytes, duration);
    }

    fn totals(&self, now: Monotonic) -> RecordedTotals {
        let of_file = self
            .file
            .as_ref()
            .map_or_else(RecordedTotals::default, |open| RecordedTotals {
                bytes: std::fs::metadata(&open.path).map_or(0, |file| file.len()),
                duration: now.since(open.since),
            });
        RecordedTotals {
            bytes: self.finished.bytes.saturating_add(of_file.bytes),
            duration: self.finished.duration.saturating_add(of_file.duration),
        }
    }

    fn close(&mut self) -> Result<(), WriteError> {
        lock(&self.state).is_running = false;
        let Some(OpenFile {
            recorder,
            path,
            since,
        }) = self.file.take()
        else {
            return Ok(());
        };
        let finished = recorder.finish();
        self.finished.duration = self.finished.duration.saturating_add(clock::elapsed(since));
        let bytes = std::fs::metadata(path).map_or(0, |file| file.len());
        self.finished.bytes = self.finished.bytes.saturating_add(bytes);
        self.update_totals(clock::now());
        finished
    }

    fn stop_with_error(&mut self, what: String, is_disk_low: bool) {
        self.file = None;
        self.marker.set(false);
        tracing::error!(problem = what, "recording ended");
        let mut state = lock(&self.state);
        state.is_running = false;
        state.problem = Some(Problem { what, is_disk_low });
    }
}

fn low_space_message(space: &DiskSpace) -> String {
    format!("the disk is nearly full: {space}")
}

/// A file that exists while an operator records, so that the next run resumes after a crash.
#[derive(Debug)]
pub(super) struct Marker(PathBuf);

impl Marker {
    pub(super) fn of(folder: &Path, robot: &str) -> Self {
        Self(folder.join(format!("{robot}.recording")))
    }

    /// Whether the previous run ended while it recorded.
    pub(super) fn is_set(&self) -> bool {
        self.0.exists()
    }

    /// Creates or removes the file. A failure is only a warning: recording itself goes on.
    pub(super) fn set(&self, is_recording: bool) {
        let written = if is_recording {
            self.write()
        } else {
            match fs::remove_file(&self.0) {
                Err(error) if error.kind() == io::ErrorKind::NotFound => return,
                removed => removed,
            }
        };
        if let Err(error) = written {
            let path = self.0.display();
            tracing::warn!(%path, %error, "whether recording goes on after a crash cannot be noted");
        }
        sync_folder_of(&self.0);
    }

    fn write(&self) -> io::Result<()> {
        let mut file = File::create(&self.0)?;
        file.write_all(
            b"robot-edge records here, and starts again by itself if it finds this file.\n",
        )?;
        file.sync_data()
    }
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct RecordingState {
    pub(super) is_running: bool,
    /// The current or last file.
    pub(super) file: Option<PathBuf>,
    /// Why it stopped by itself; reset at the next start.
    pub(super) problem: Option<Problem>,
    /// Measurements that were dropped since the start.
    pub(super) lost: u64,
    /// Number, size and duration of the files since the start.
    pub(super) files: u32,
    pub(super) bytes: u64,
    pub(super) duration: Duration,
    /// Free space on their disk.
    pub(super) free_bytes: Option<u64>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Problem {
    pub(super) what: String,
    pub(super) is_disk_low: bool,
}

impl RecordingState {
    pub(super) fn status(&self) -> RecordingStatus {
        let state = match &self.problem {
            Some(problem) if problem.is_disk_low => message::RecordingState::StoppedDiskLow,
            Some(_) => message::RecordingState::Failed,
            None if self.is_running => message::RecordingState::Recording,
            None => message::RecordingState::Stopped,
        };
        let name = self.file.as_deref().and_then(Path::file_name);
        RecordingStatus {
            state,
            file: name.map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
            files: self.files,
            duration_s: u32::try_from(self.duration.as_secs()).unwrap_or(u32::MAX),
            bytes: self.bytes,
            free_bytes: self.free_bytes,
            lost: self.lost,
        }
    }
}

#[cfg(test)]
mod tests;
