//! `--record`: writes all measurements as ROS 2 messages.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;
use std::{fs, io};

use crate::lock;
use measurement::scan::Scan;
use measurement::time::{Monotonic, RobotDuration, RobotTime};
use measurement::{Measurement, MeasurementData, OwnPose, Stream};
use network::clock;
use recording::new_file::{DiskSpaceFn, disk_space};
use recording::writer::{McapWriter, RecordingFile, WriteError};

/// Maximum loss of a live run in a crash.
const FLUSH_PERIOD: Duration = Duration::from_secs(1);

/// How recorded data is synced to the disk every [`FLUSH_PERIOD`]. A nearly full disk ends the recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SyncPolicy {
    /// Only on request, so that a replay gives identical files.
    OnDemand,
    /// The writing thread syncs and waits for the disk.
    Inline,
    /// A thread of its own syncs: the writing thread also feeds the collision monitor.
    Background,
}

pub(super) struct Recorder {
    writer: McapWriter,
    /// Present in runs in real time.
    flushed_at: Option<Monotonic>,
    sync_thread: Option<SyncThread>,
    disk_space: DiskSpaceFn,
    /// Added to all stamps; derived from the earliest stamp, or from the first one if that is unknown.
    stamp_offset: Option<RobotDuration>,
    /// Stamp of the last scan with its own pose.
    own_pose_at: Option<RobotTime>,
    separated_scans: u64,
    /// Measurements with stamps before 1970 after the offset.
    unrecordable: u64,
}

impl Recorder {
    /// `earliest` is the earliest stamp, if it is known.
    pub(super) fn create(
        path: &Path,
        vehicle: &str,
        sync_policy: SyncPolicy,
        earliest: Option<RobotTime>,
    ) -> Result<Self, WriteError> {
        Self::on_disk(disk_space, (path, vehicle), sync_policy, earliest)
    }

    fn on_disk(
        disk_space: DiskSpaceFn,
        (path, vehicle): (&Path, &str),
        sync_policy: SyncPolicy,
        earliest: Option<RobotTime>,
    ) -> Result<Self, WriteError> {
        let writer = McapWriter::create(path, Some(vehicle))?;
        if sync_policy != SyncPolicy::OnDemand
            && let Err(low) = writer.on_disk().check_space(disk_space)
        {
            let path = writer.path().to_owned();
            drop(writer);
            // The file is empty. If it cannot be removed, it does no harm.
            drop(fs::remove_file(path));
            return Err(low);
        }
        let sync_thread = match sync_policy {
            SyncPolicy::OnDemand | SyncPolicy::Inline => None,
            SyncPolicy::Background => {
                let on_disk = writer.on_disk();
                let started = SyncThread::start(move || sync_to_disk(&on_disk, disk_space));
                Some(started.map_err(|why| writer.failed(why))?)
            }
        };
        Ok(Self {
            writer,
            flushed_at: (sync_policy != SyncPolicy::OnDemand).then(clock::now),
            sync_thread,
            disk_space,
            stamp_offset: earliest.map(offset_to_1970),
            own_pose_at: None,
            separated_scans: 0,
            unrecordable: 0,
        })
    }

    pub(super) fn write(
        &mut self,
        stream: &Stream,
        measurement: &Measurement,
    ) -> Result<(), WriteError> {
        match self.write_shifted(&ros_stream(stream), measurement) {
            // A stamp that MCAP cannot represent must not end a drive.
            Err(WriteError::Stamp { .. }) => self.unrecordable += 1,
            written => written?,
        }
        if let Some(at) = self.flushed_at
            && clock::elapsed(at) >= FLUSH_PERIOD
        {
            self.writer.flush_to_os()?;
            if let Some(sync_thread) = &self.sync_thread {
                sync_thread.request_sync()?;
            } else {
                sync_to_disk(&self.writer.on_disk(), self.disk_space)?;
            }
            self.flushed_at = Some(clock::now());
        }
        Ok(())
    }

    /// The path of the file, which may have a number appended.
    pub(super) fn path(&self) -> PathBuf {
        self.writer.path().to_owned()
    }

    pub(super) fn flush(&mut self) -> Result<(), WriteError> {
        self.writer.flush()
    }

    fn write_shifted(
        &mut self,
        stream: &Stream,
        measurement: &Measurement,
    ) -> Result<(), WriteError> {
        let stamp = measurement.stamp;
        let stamp_offset = *self
            .stamp_offset
            .get_or_insert_with(|| offset_to_1970(stamp));
        if let MeasurementData::Scan {
            scan,
            own_pose: Some(pose),
        } = &measurement.data
        {
            return self.write_scan_with_pose(
                stream,
                measurement,
                stamp + stamp_offset,
                scan,
                pose,
            );
        }
        if stamp_offset == RobotDuration::ZERO {
            return self.writer.write(stream, measurement);
        }
        let shifted = Measurement {
            stamp: stamp + stamp_offset,
            ..measurement.clone()
        };
        self.writer.write(stream, &shifted)
    }

    pub(super) const fn reset_clock(&mut self) {
        self.own_pose_at = None;
    }

    /// Differences between the recording and the input, one sentence each.
    pub(super) fn notes(&self) -> Vec<String> {
        let stamp_offset_s = self.stamp_offset.map_or(0.0, RobotDuration::as_secs_f64);
        let stamp_offset = (stamp_offset_s > 0.0).then(|| {
            format!(
                "all stamps are {stamp_offset_s} s later in the recording: MCAP has no times before 1970"
            )
        });
        let separated_scans = (self.separated_scans > 0).then(|| {
            format!(
                "{} scans with the stamp of the scan before are 1 ns behind it in the recording, so that each \
                 keeps its pose",
                self.separated_scans
            )
        });
        let missing = self.writer.not_written() + self.unrecordable;
        let missing = (missing > 0).then(|| {
            format!(
                "{missing} measurements are not in the recording: clouds, or stamps before 1970"
            )
        });
        [stamp_offset, separated_scans, missing]
            .into_iter()
            .flatten()
            .collect()
    }

    pub(super) fn finish(self) -> Result<(), WriteError> {
        // The index is written before the sync thread ends, even if that fails, so that the written data is
        // readable.
        let finished = self.writer.finish();
        finished.and(self.sync_thread.map_or(Ok(()), SyncThread::finish))
    }

    /// Of two transforms with one stamp only the later one is valid, but scans of CARMEN have their own poses even
    /// if they share a stamp (csail: 404 of 406).
    fn unique_stamp(&mut self, stamp: RobotTime) -> RobotTime {
        let unique = match self.own_pose_at {
            Some(before) if stamp <= before => {
                self.separated_scans += 1;
                before + RobotDuration::from_nanos(1)
            }
            Some(_) | None => stamp,
        };
        self.own_pose_at = Some(unique);
        unique
    }

    /// A `LaserScan` has no field for the pose of the scan, so that transforms carry it.
    fn write_scan_with_pose(
        &mut self,
        stream: &Stream,
        measurement: &Measurement,
        stamp: RobotTime,
        scan: &Scan,
        pose: &OwnPose,
    ) -> Result<(), WriteError> {
        let stamp = self.unique_stamp(stamp);
        let measured = |frame: &str, data| Measurement {
            stamp,
            stream: measurement.stream,
            frame: frame.into(),
            data,
        };
        let tf = Stream {
            name: "/tf".into(),
            type_name: "tf2_msgs/TFMessage".into(),
        };
        let base_from_sensor = pose.odom_from_base.inverse() * pose.odom_from_sensor;
        for (parent, child, parent_from_child) in [
            ("odom", "base_link", pose.odom_from_base),
            ("base_link", &*measurement.frame, base_from_sensor),
        ] {
            let data = MeasurementData::Transform {
                child: child.into(),
                parent_from_child,
                is_static: false,
            };
            self.writer.write(&tf, &measured(parent, data))?;
        }
        let data = MeasurementData::Scan {
            scan: scan.clone(),
            own_pose: None,
        };
        self.writer
            .write(stream, &measured(&measurement.frame, data))
    }
}

fn sync_to_disk(on_disk: &RecordingFile, disk_space: DiskSpaceFn) -> Result<(), WriteError> {
    on_disk.sync()?;
    on_disk.check_space(disk_space)
}

/// The offset of a first stamp before 1970, in whole seconds, so that fractions stay readable.
fn offset_to_1970(first: RobotTime) -> RobotDuration {
    const SECOND: u64 = 1_000_000_000;
    let before = if first.as_nanos() < 0 {
        first.as_nanos().unsigned_abs().div_ceil(SECOND) * SECOND
    } else {
        0
    };
    RobotDuration::from_nanos(i64::try_from(before).unwrap_or(i64::MAX))
}

/// Converts message names of CARMEN to topics.
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

/// Syncs a file on a thread of its own. Dropping it does not wait.
pub(super) struct SyncThread {
    requests: SyncSender<()>,
    failed: Failed,
    thread: JoinHandle<()>,
}

/// The last error that was not returned yet.
type Failed = Arc<Mutex<Option<WriteError>>>;

impl SyncThread {
    pub(super) fn start(
        sync: impl Fn() -> Result<(), WriteError> + Send + 'static,
    ) -> io::Result<Self> {
        // A pending request covers everything written before its turn.
        let (requests, received) = sync_channel(1);
        let failed = Failed::default();
        let of_thread = Arc::clone(&failed);
        let run = move || {
            for () in received {
                if let Err(error) = sync() {
                    *lock(&of_thread) = Some(error);
                }
            }
        };
        let thread = thread::Builder::new()
            .name("recording-sync".to_owned())
            .spawn(run)?;
        Ok(Self {
            requests,
            failed,
            thread,
        })
    }

    /// Requests a sync of everything written so far, without waiting. Returns the error of an earlier one.
    pub(super) fn request_sync(&self) -> Result<(), WriteError> {
        let failed = lock(&self.failed).take();
        match self.requests.try_send(()) {
            Ok(()) | Err(TrySendError::Full(()) | TrySendError::Disconnected(())) => {}
        }
        failed.map_or(Ok(()), Err)
    }

    /// Waits for the requested syncs.
    pub(super) fn finish(self) -> Result<(), WriteError> {
        let Self {
            requests,
            failed,
            thread,
        } = self;
        drop(requests);
        if thread.join().is_err() {
            tracing::error!("the thread that syncs a recording failed");
        }
        let failed = lock(&failed).take();
        failed.map_or(Ok(()), Err)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;
    use measurement::pose::Pose;
    use measurement::{MeasurementData, StreamId};
    use recording::new_file::DiskSpace;
    use recording::{Selection, open};

    pub(in crate::runtime) fn transform(nanos: i64, child: &str, is_static: bool) -> Measurement {
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

    pub(in crate::runtime) fn stream() -> Stream {
        Stream {
            name: "/tf".into(),
            type_name: "tf2_msgs/TFMessage".into(),
        }
    }

    /// Of all that can be read of a recording, ended or not.
    pub(in crate::runtime) fn stamps(path: &Path) -> Vec<i64> {
        let mut reader = open(path, Selection::default()).unwrap();
        let mut stamps = Vec::new();
        while let Some(measurement) = reader.next_measurement().unwrap() {
            stamps.push(measurement.stamp.as_nanos());
        }
        stamps
    }

    #[test]
    #[cfg_attr(
        not(target_os = "linux"),
        ignore = "the clock begins with the program: nothing is due yet"
    )]
    fn a_nearly_full_disk_ends_it_and_the_file_is_readable() {
        const GB: u64 = 1_000_000_000;
        static FREE_BYTES: AtomicU64 = AtomicU64::new(0);
        let disk_space: DiskSpaceFn = |_| {
            Ok(DiskSpace {
                free_bytes: FREE_BYTES.load(Ordering::Relaxed),
                total_bytes: 10 * GB,
            })
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("drive.mcap");
        let create =
            |sync_policy| Recorder::on_disk(disk_space, (&path, "pioneer"), sync_policy, None);
        let low = create(SyncPolicy::Background).err().unwrap().to_string();
        let says = "drive.mcap: recording ends: the disk is nearly full: 0.0 of 10.0 GB are free";
        assert!(low.ends_with(says), "{low}");
        assert!(!path.exists(), "nothing is in it");

        for (sync_policy, number) in [(SyncPolicy::Inline, 1), (SyncPolicy::Background, 2)] {
            FREE_BYTES.store(2 * GB, Ordering::Relaxed);
            let mut recorder = create(sync_policy).unwrap();
            let mut nanos = 0;
            let mut write = |recorder: &mut Recorder| {
                recorder.flushed_at = Some(Monotonic::from_nanos(0));
                nanos += 1;
                recorder.write(&stream(), &transform(nanos, "base_link", false))
            };
            write(&mut recorder).unwrap();
            FREE_BYTES.store(GB - 1, Ordering::Relaxed);
            // The sync thread reports it after its next check.
            let low = loop {
                if let Err(low) = write(&mut recorder) {
                    break low;
                }
            };
            assert!(matches!(low, WriteError::DiskLow { .. }), "{low}");
            let path = recorder.path();
            drop(recorder);
            assert_eq!(path.ends_with("drive.mcap"), number == 1);
            assert_eq!(stamps(&path), (1..=nanos).collect::<Vec<_>>());
        }
        FREE_BYTES.store(0, Ordering::Relaxed);
        assert!(
            create(SyncPolicy::OnDemand).is_ok(),
            "what is as long as its source"
        );
    }

    /// As after a crash of the program: data that was passed to the operating system is in the file.
    #[test]
    #[cfg_attr(
        not(target_os = "linux"),
        ignore = "the clock begins with the program: nothing is due yet"
    )]
    fn data_is_in_the_file_before_it_is_finished() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("drive.mcap");
        let mut recorder =
            Recorder::create(&path, "pioneer", SyncPolicy::Background, None).unwrap();
        for nanos in [10, 20] {
            recorder.flushed_at = Some(Monotonic::from_nanos(0));
            let measurement = transform(nanos, "base_link", false);
            recorder.write(&stream(), &measurement).unwrap();
        }
        assert_eq!(stamps(&path), [10, 20]);
        recorder
            .write(&stream(), &transform(30, "base_link", false))
            .unwrap();
        recorder.finish().unwrap();
        assert_eq!(stamps(&path), [10, 20, 30]);
    }
}

#[cfg(test)]
mod sync_thread_tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use super::*;

    #[test]
    fn requests_do_not_wait_and_one_sync_serves_several() {
        let (begin, began) = sync_channel(9);
        let (let_go, gate) = sync_channel(9);
        let gate = Mutex::new(gate);
        let synced = Arc::new(AtomicU32::new(0));
        let of_thread = Arc::clone(&synced);
        let thread = SyncThread::start(move || {
            begin.send(()).unwrap();
            gate.lock().unwrap().recv().unwrap();
            of_thread.fetch_add(1, Ordering::SeqCst);
            Ok(())
        });
        let thread = thread.unwrap();
        thread.request_sync().unwrap();
        began.recv().unwrap();
        for _ in 0..5 {
            thread.request_sync().unwrap();
        }
        assert_eq!(synced.load(Ordering::SeqCst), 0, "the disk is at work");
        for _ in 0..6 {
            let_go.send(()).unwrap();
        }
        thread.finish().unwrap();
        assert_eq!(synced.load(Ordering::SeqCst), 2);
    }

    #[test]
    fn an_error_is_returned_once_by_the_next_call() {
        let (begin, began) = sync_channel(9);
        let thread = SyncThread::start(move || {
            begin.send(()).unwrap();
            Err(WriteError::Mcap {
                path: "drive.mcap".into(),
                source: io::Error::other("the disk is gone").into(),
            })
        });
        let thread = thread.unwrap();
        thread.request_sync().unwrap();
        began.recv().unwrap();
        let first = loop {
            let said = thread.request_sync();
            if said.is_err() {
                break said;
            }
            thread::yield_now();
        };
        let first = first.unwrap_err().to_string();
        assert!(first.contains("drive.mcap"), "{first}");
        assert!(thread.finish().is_err(), "the second sync failed too");
    }
}
