//! Recordings that operators start and stop while the vehicle is driven, by a thread of their own.
//!
//! "Recording durability": files of a minute, on the disk every second; where the disk is nearly full recording ends, with
//! an alarm, and driving goes on. What was recorded when the program crashed, or was killed, goes on with the next run;
//! whoever ends the program in an orderly way ends the recording.

mod marker;
mod state;

use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

pub(super) use state::{Problem, RecordingState};

use marker::Marker;

use super::recorder::{Recorder, Syncs};
use crate::clock::{self, Monotonic};
use crate::free_space::{Space, SpaceOf, space_of};
use crate::measurement::{Measurement, MeasurementData, Stream};
use crate::recording::writer::WriteError;

/// Measurements that wait for the disk at most: some seconds of all sensors.
const CAPACITY: usize = 2048;
/// A file ends after this.
const FILE_PERIOD: Duration = Duration::from_mins(1);
/// The disk is looked at this often.
const LOOK_PERIOD: Duration = Duration::from_secs(1);
/// Transforms that hold for all time and begin every file; no vehicle has as many.
const MAX_TIMELESS: usize = 256;

/// The placing side's end.
pub(super) struct LiveRecording {
    orders: Option<SyncSender<Order>>,
    /// What found no room yet and must not be lost: rare, and short.
    waiting: VecDeque<Order>,
    state: Arc<Mutex<RecordingState>>,
    is_wanted: bool,
    /// It has started by itself.
    is_resumed: bool,
    thread: Option<JoinHandle<()>>,
}

enum Order {
    Streams(Vec<Stream>),
    Measured(Measurement),
    ClockReset,
    Record(bool),
}

impl LiveRecording {
    /// Records into `folder`, which is made, once somebody wants it; at once where the run before was cut off as it recorded.
    ///
    /// # Errors
    /// Where the folder cannot be made or the system gives no thread.
    pub(super) fn new(folder: &Path, robot: &str, vehicle: &str) -> io::Result<Self> {
        Self::on_disk(space_of, folder, robot, vehicle)
    }

    fn on_disk(space_of: SpaceOf, folder: &Path, robot: &str, vehicle: &str) -> io::Result<Self> {
        std::fs::create_dir_all(folder)?;
        let (orders, ordered) = sync_channel(CAPACITY);
        let state = Arc::new(Mutex::new(RecordingState::default()));
        let marker = Marker::of(folder, robot);
        let is_resumed = marker.is_set();
        let writer = Writer {
            space_of,
            folder: folder.to_owned(),
            marker,
            robot: robot.to_owned(),
            vehicle: vehicle.to_owned(),
            streams: Vec::new(),
            timeless: BTreeMap::new(),
            file: None,
            finished: Extent::default(),
            state: Arc::clone(&state),
        };
        let thread = thread::Builder::new()
            .name("recording".to_owned())
            .spawn(move || writer.run(&ordered))?;
        let mut live = Self {
            orders: Some(orders),
            waiting: VecDeque::new(),
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

    /// Streams met since the last call, whose numbers measurements carry.
    pub(super) fn add_streams(&mut self, streams: &[Stream]) {
        if !streams.is_empty() {
            self.order(Order::Streams(streams.to_vec()));
        }
    }

    /// Something came in.
    pub(super) fn add(&mut self, measurement: &Measurement) {
        if self.is_wanted || measurement.is_timeless() {
            self.order(Order::Measured(measurement.clone()));
        }
    }

    /// The clock of the data starts anew.
    pub(super) fn reset_clock(&mut self) {
        self.order(Order::ClockReset);
    }

    /// Starts or stops.
    pub(super) fn record(&mut self, is_wanted: bool) {
        self.is_wanted = is_wanted;
        self.order(Order::Record(is_wanted));
    }

    /// Whether it has started by itself, where the run before was cut off.
    pub(super) const fn is_resumed(&self) -> bool {
        self.is_resumed
    }

    /// The run ends in an orderly way, and recording with it.
    pub(super) fn end(mut self) {
        if let Some(orders) = self.orders.take()
            && orders.send(Order::Record(false)).is_err()
        {
            tracing::error!("the thread that records has ended");
        }
    }

    /// How it is going.
    pub(super) fn state(&self) -> RecordingState {
        lock(&self.state).clone()
    }

    /// Never waits: measurements that find no room are lost and counted, everything else goes as soon as there is some.
    fn order(&mut self, order: Order) {
        self.waiting.push_back(order);
        while let (Some(orders), Some(order)) = (&self.orders, self.waiting.pop_front()) {
            match orders.try_send(order) {
                Ok(()) => {}
                Err(TrySendError::Disconnected(_)) => self.orders = None,
                Err(TrySendError::Full(Order::Measured(_))) => lock(&self.state).lost += 1,
                Err(TrySendError::Full(order)) => {
                    self.waiting.push_front(order);
                    // Those behind it keep their order; what was measured meanwhile is lost.
                    let before = self.waiting.len();
                    self.waiting
                        .retain(|order| !matches!(order, Order::Measured(_)));
                    lock(&self.state).lost += (before - self.waiting.len()) as u64;
                    return;
                }
            }
        }
    }
}

impl Drop for LiveRecording {
    fn drop(&mut self) {
        self.orders = None;
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread that records failed");
        }
    }
}

fn lock(state: &Mutex<RecordingState>) -> MutexGuard<'_, RecordingState> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

struct Writer {
    space_of: SpaceOf,
    folder: PathBuf,
    marker: Marker,
    robot: String,
    vehicle: String,
    streams: Vec<Stream>,
    /// By stream, parent and child.
    timeless: BTreeMap<(u16, String, String), Measurement>,
    file: Option<Open>,
    /// The files of this recording that are finished.
    finished: Extent,
    state: Arc<Mutex<RecordingState>>,
}

struct Open {
    recorder: Recorder,
    path: PathBuf,
    since: Monotonic,
}

/// How much was recorded.
#[derive(Clone, Copy, Debug, Default)]
struct Extent {
    bytes: u64,
    lasted: Duration,
}

impl Writer {
    fn run(mut self, ordered: &Receiver<Order>) {
        let mut looked = Monotonic::now();
        self.show_space();
        loop {
            let done = match ordered.recv_timeout(LOOK_PERIOD) {
                Ok(order) => self.take(order),
                Err(RecvTimeoutError::Timeout) => Ok(()),
                Err(RecvTimeoutError::Disconnected) => break,
            };
            let now = Monotonic::now();
            let looked_at = if now.since(looked) >= LOOK_PERIOD {
                looked = now;
                self.look(now)
            } else {
                Ok(())
            };
            if let Err(error) = done.and(looked_at) {
                self.end_with(error.to_string(), false);
            }
        }
        if let Err(error) = self.close() {
            tracing::error!(%error, "the last recording has no end");
        }
    }

    fn take(&mut self, order: Order) -> Result<(), WriteError> {
        match order {
            Order::Streams(streams) => self.streams.extend(streams),
            Order::ClockReset => {
                if let Some(open) = &mut self.file {
                    open.recorder.reset_clock();
                }
            }
            Order::Record(true) => {
                if self.file.is_none() {
                    self.finished = Extent::default();
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
            Order::Record(false) => {
                self.marker.set(false);
                return self.close();
            }
            Order::Measured(measurement) => {
                self.remember(&measurement);
                let stream = self.streams.get(usize::from(measurement.stream.0));
                if let (Some(open), Some(stream)) = (&mut self.file, stream) {
                    return open.recorder.write(stream, &measurement);
                }
            }
        }
        Ok(())
    }

    fn remember(&mut self, measurement: &Measurement) {
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
            if self.timeless.len() < MAX_TIMELESS || self.timeless.contains_key(&key) {
                self.timeless.insert(key, measurement.clone());
            }
        }
    }

    /// Flushes, begins the next file, and ends where the disk is nearly full.
    fn look(&mut self, now: Monotonic) -> Result<(), WriteError> {
        let space = self.show_space();
        let Some(open) = &mut self.file else {
            return Ok(());
        };
        open.recorder.flush()?;
        let is_over = now.since(open.since) >= FILE_PERIOD;
        self.show_extent(now);
        if let Some(space) = space.filter(Space::is_scarce) {
            self.close()?;
            self.end_with(scarce(&space), true);
            return Ok(());
        }
        if is_over {
            self.close()?;
            self.open()?;
        }
        Ok(())
    }

    fn open(&mut self) -> Result<(), WriteError> {
        if let Some(space) = self.show_space().filter(Space::is_scarce) {
            self.end_with(scarce(&space), true);
            return Ok(());
        }
        let path = self.folder.join(format!(
            "{}-{}.mcap",
            self.robot,
            clock::wall_clock_label().replace(':', "")
        ));
        let mut recorder = Recorder::create(&path, &self.vehicle, Syncs::WhenAsked, None)?;
        let path = recorder.path();
        for measurement in self.timeless.values() {
            if let Some(stream) = self.streams.get(usize::from(measurement.stream.0)) {
                recorder.write(stream, measurement)?;
            }
        }
        self.file = Some(Open {
            recorder,
            path: path.clone(),
            since: Monotonic::now(),
        });
        let mut state = lock(&self.state);
        state.is_running = true;
        state.file = Some(path);
        state.files += 1;
        Ok(())
    }

    /// How much room there is, for people too; `None` where the system does not say.
    fn show_space(&self) -> Option<Space> {
        let space = (self.space_of)(&self.folder)
            .inspect_err(|error| tracing::warn!(%error, "nobody knows how much room the disk has"))
            .ok();
        lock(&self.state).free_bytes = space.map(|space| space.free_bytes);
        space
    }

    /// How much has been recorded at `now`, for people.
    fn show_extent(&self, now: Monotonic) {
        let Extent { bytes, lasted } = self.extent(now);
        let mut state = lock(&self.state);
        (state.bytes, state.lasted) = (bytes, lasted);
    }

    fn extent(&self, now: Monotonic) -> Extent {
        let of_file = self
            .file
            .as_ref()
            .map_or_else(Extent::default, |open| Extent {
                bytes: std::fs::metadata(&open.path).map_or(0, |file| file.len()),
                lasted: now.since(open.since),
            });
        Extent {
            bytes: self.finished.bytes.saturating_add(of_file.bytes),
            lasted: self.finished.lasted.saturating_add(of_file.lasted),
        }
    }

    fn close(&mut self) -> Result<(), WriteError> {
        lock(&self.state).is_running = false;
        let Some(Open {
            recorder,
            path,
            since,
        }) = self.file.take()
        else {
            return Ok(());
        };
        let finished = recorder.finish();
        self.finished.lasted = self.finished.lasted.saturating_add(since.elapsed());
        let bytes = std::fs::metadata(path).map_or(0, |file| file.len());
        self.finished.bytes = self.finished.bytes.saturating_add(bytes);
        self.show_extent(Monotonic::now());
        finished
    }

    fn end_with(&mut self, what: String, is_disk_low: bool) {
        self.file = None;
        self.marker.set(false);
        tracing::error!(problem = what, "recording ended");
        let mut state = lock(&self.state);
        state.is_running = false;
        state.problem = Some(Problem { what, is_disk_low });
    }
}

fn scarce(space: &Space) -> String {
    format!("the disk is nearly full: {space}")
}

#[cfg(test)]
mod tests;
