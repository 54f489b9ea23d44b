//! `--record`: everything that came in, as ROS 2 messages.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::sync_thread::SyncThread;
use crate::clock;
use measurement::scan::Scan;
use measurement::time::Monotonic;
use measurement::time::{RobotDuration, RobotTime};
use measurement::{Measurement, MeasurementData, OwnPose, Stream};
use recording::free_space::{DiskSpaceFn, disk_space};
use recording::writer::{McapWriter, RecordingFile, WriteError};

/// A crash of a live run loses no more than this.
const FLUSH_PERIOD: Duration = Duration::from_secs(1);

/// Who puts on the disk, every [`FLUSH_PERIOD`], what was recorded, and ends recording where the disk is nearly full.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SyncPolicy {
    /// Who asks for it: by itself, a recorder gives the same file every time.
    OnDemand,
    /// Who writes, and waits for the disk.
    Inline,
    /// A thread of its own: who writes also tells the guard, and cannot wait.
    Background,
}

/// Writes measurements as they come.
pub(super) struct Recorder {
    writer: McapWriter,
    /// Only runs in real time are flushed by the clock, so that others give the same file every time.
    flushed_at: Option<Monotonic>,
    sync_thread: Option<SyncThread>,
    disk_space: DiskSpaceFn,
    /// Added to all stamps; decided by the earliest where a survey knows it, else by the first.
    stamp_offset: Option<RobotDuration>,
    /// Stamp of the last scan that brought its own pose.
    own_pose_at: Option<RobotTime>,
    separated_scans: u64,
    /// Measurements whose stamps lie before 1970 even so.
    unrecordable: u64,
}

impl Recorder {
    /// `earliest` is the first stamp to come, where it is known beforehand.
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
            // Nothing is in it; and what cannot be removed does no harm.
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
            // One stamp that MCAP cannot hold must not end a drive.
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

    /// Its file, which may have a numbered name.
    pub(super) fn path(&self) -> PathBuf {
        self.writer.path().to_owned()
    }

    /// Hands all of it to the disk.
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

    /// The data's clock starts anew.
    pub(super) const fn reset_clock(&mut self) {
        self.own_pose_at = None;
    }

    /// How the recording differs from what came in, in words.
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
        // Index and end go to the system before anything waits for the disk again, and whatever that says: of what is written,
        // all that can be read should be.
        let finished = self.writer.finish();
        finished.and(self.sync_thread.map_or(Ok(()), SyncThread::finish))
    }

    /// Of two transforms with one stamp only the later one holds, but CARMEN's scans bring their own poses
    /// also where they share a stamp (csail: 404 of 406).
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

    /// A `LaserScan` has no place for the pose that a log gives to its own scan: transforms have.
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

/// What is added to a first stamp before 1970: whole seconds, so that fractions stay readable.
fn offset_to_1970(first: RobotTime) -> RobotDuration {
    const SECOND: u64 = 1_000_000_000;
    let before = if first.as_nanos() < 0 {
        first.as_nanos().unsigned_abs().div_ceil(SECOND) * SECOND
    } else {
        0
    };
    RobotDuration::from_nanos(i64::try_from(before).unwrap_or(i64::MAX))
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

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;
    use crate::app::test_recording::{stamps, stream, transform};
    use recording::free_space::DiskSpace;

    #[test]
    #[cfg_attr(
        not(target_os = "linux"),
        ignore = "the clock begins with the program: nothing is due yet"
    )]
    fn it_ends_where_the_disk_is_nearly_full_and_what_came_before_is_whole() {
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
            // A thread of its own says so when it has looked.
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

    /// As a crash of the program would leave it: what it handed to the system is there.
    #[test]
    #[cfg_attr(
        not(target_os = "linux"),
        ignore = "the clock begins with the program: nothing is due yet"
    )]
    fn what_a_thread_of_its_own_syncs_is_in_the_file_before_its_end() {
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
