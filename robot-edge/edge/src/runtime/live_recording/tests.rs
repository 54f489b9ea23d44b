use measurement::cloud::{Cloud, CloudPoint};
use protocol::message;

use super::*;
use crate::runtime::recorder::tests::{stamps, stream, transform};

#[expect(clippy::unnecessary_wraps, reason = "disks may refuse to say")]
fn enough_space(_folder: &Path) -> io::Result<DiskSpace> {
    Ok(DiskSpace {
        free_bytes: 90_000_000_000,
        total_bytes: 100_000_000_000,
    })
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    files
}

#[test]
fn static_transforms_start_every_file() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path().join("recordings");
    let mut live = LiveRecording::on_disk(enough_space, &folder, "scout", "pioneer").unwrap();
    live.add_streams(&[stream()]);
    live.add(&transform(5, "laser", true));
    live.add(&transform(10, "base_link", false));
    for (start, end) in [(20, 30), (40, 45)] {
        live.record(true);
        for nanos in start..end {
            live.add(&transform(nanos, "base_link", false));
        }
        live.record(false);
        live.add(&transform(35, "base_link", false));
    }
    let state = Arc::clone(&live.state);
    drop(live);
    let state = lock(&state).clone();
    assert_eq!(
        (state.is_running, state.problem.clone(), state.lost),
        (false, None, 0)
    );
    let files = files(&folder);
    assert_eq!(files.len(), 2);
    let last = state.file.clone().unwrap();
    let status = state.status();
    assert_eq!(status.state, message::RecordingState::Stopped);
    assert_eq!(status.file, last.file_name().unwrap().to_str().unwrap());
    assert_eq!((status.files, status.free_bytes), (1, Some(90_000_000_000)));
    assert_eq!(status.bytes, std::fs::metadata(last).unwrap().len());
    let expected =
        |range: std::ops::Range<i64>| -> Vec<i64> { std::iter::once(5).chain(range).collect() };
    let mut found: Vec<_> = files.iter().map(|file| stamps(file)).collect();
    found.sort_by_key(|stamps| stamps.get(1).copied());
    assert_eq!(found, [expected(20..30), expected(40..45)]);
}

#[test]
fn a_missing_folder_ends_the_recording_with_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("recordings");
    let mut live = LiveRecording::on_disk(enough_space, &place, "scout", "pioneer").unwrap();
    std::fs::remove_dir_all(&place).unwrap();
    live.record(true);
    let state = Arc::clone(&live.state);
    drop(live);
    let state = lock(&state).clone();
    assert!(!state.is_running);
    assert!(
        state
            .problem
            .as_ref()
            .unwrap()
            .what
            .contains("cannot write the recording")
    );
    assert_eq!(state.status().state, message::RecordingState::Failed);
}

#[test]
fn a_nearly_full_disk_ends_the_recording_with_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let low_space_message = |_folder: &Path| {
        Ok(DiskSpace {
            free_bytes: 900_000_000,
            total_bytes: 10_000_000_000,
        })
    };
    let mut live =
        LiveRecording::on_disk(low_space_message, folder.path(), "scout", "pioneer").unwrap();
    live.record(true);
    let state = Arc::clone(&live.state);
    drop(live);
    let state = lock(&state).clone();
    let why = "the disk is nearly full: 0.9 of 10.0 GB are free";
    assert!(!state.is_running);
    assert_eq!(
        state.problem.as_ref().map(|problem| &*problem.what),
        Some(why)
    );
    let status = state.status();
    assert_eq!(status.state, message::RecordingState::StoppedDiskLow);
    assert_eq!(
        (status.file.as_str(), status.files, status.free_bytes),
        ("", 0, Some(900_000_000))
    );
    assert!(files(folder.path()).is_empty());
}

#[test]
fn commands_are_kept_when_measurements_are_dropped() {
    let (commands, receiver) = sync_channel(1);
    let mut live = LiveRecording {
        commands: Some(commands),
        limit: ByteLimit::new(MAX_BYTES),
        pending: VecDeque::new(),
        state: Arc::default(),
        is_wanted: true,
        is_resumed: false,
        thread: None,
    };
    live.add(&transform(1, "base_link", false));
    live.add(&transform(2, "base_link", false));
    live.record(false);
    live.record(true);
    live.add(&transform(3, "base_link", false));
    assert_eq!(live.state().lost, 2);
    let mut taken = Vec::new();
    for _ in 0..3 {
        taken.push(match receiver.try_recv().unwrap() {
            WriterCommand::Record(is_on) => i64::from(is_on),
            WriterCommand::Measured(measurement, _) => 100 + measurement.stamp.as_nanos(),
            WriterCommand::Streams(_) | WriterCommand::ClockReset => -1,
        });
        live.reset_clock();
    }
    assert_eq!(taken, [101, 0, 1]);
}

#[test]
fn clouds_that_wait_for_the_disk_are_bounded_by_their_bytes() {
    let (commands, receiver) = sync_channel(CAPACITY);
    let mut live = LiveRecording {
        commands: Some(commands),
        limit: ByteLimit::new(MAX_BYTES),
        pending: VecDeque::new(),
        state: Arc::default(),
        is_wanted: true,
        is_resumed: false,
        thread: None,
    };
    let point = CloudPoint {
        position_m: [1.0; 3],
        after_s: 0.0,
        intensity: 0.0,
        ring: Some(0),
    };
    let cloud = Measurement {
        data: MeasurementData::Cloud(Cloud {
            points: vec![point; 64 * 2048],
            without_return: 0,
        }),
        ..transform(1, "lidar", false)
    };
    let fit = MAX_BYTES / cloud.data.payload_bytes();
    for _ in 0..fit + 3 {
        live.add(&cloud);
    }
    live.add(&transform(2, "base_link", false));
    assert_eq!((fit, live.state().lost), (21, 3));
    assert!(receiver.recv().is_ok());
    live.add(&cloud);
    assert_eq!(live.state().lost, 3);
    // The transform and the last cloud have come, too.
    assert_eq!(receiver.try_iter().count(), fit + 1);
}

/// A run that records, and is cut off: what it leaves behind is what a crash would leave.
#[test]
fn a_recording_of_a_crashed_run_is_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let begin = |disk_space: DiskSpaceFn| {
        let mut live =
            LiveRecording::on_disk(disk_space, folder.path(), "scout", "pioneer").unwrap();
        live.add_streams(&[stream()]);
        live
    };
    let mut live = begin(enough_space);
    assert!(!live.is_resumed(), "nothing was recorded before");
    live.record(true);
    live.add(&transform(1, "base_link", false));
    drop(live);
    // Twice: what goes on by itself is cut off too.
    for nanos in [2, 3] {
        let mut live = begin(enough_space);
        live.add(&transform(nanos, "base_link", false));
        assert!(live.is_resumed());
        drop(live);
    }
    let recorded = |folder: &Path| {
        let files = files(folder).into_iter();
        let files = files.filter(|file| file.extension().is_some_and(|is| is == "mcap"));
        let mut found: Vec<_> = files.map(|file| stamps(&file)).collect();
        found.sort();
        found
    };
    assert_eq!(recorded(folder.path()), [[1], [2], [3]]);
    // Another robot's recordings may be in the same folder.
    let other = LiveRecording::on_disk(enough_space, folder.path(), "barge", "pioneer").unwrap();
    assert!(!other.is_resumed());
    drop(other);

    for does_stop in [true, false] {
        let mut live = begin(enough_space);
        assert!(live.is_resumed());
        if does_stop {
            live.record(false);
            drop(live);
        } else {
            live.finish();
        }
        let mut live = begin(enough_space);
        assert!(!live.is_resumed(), "it was stopped: {does_stop}");
        live.record(true);
        drop(live);
    }

    let low_space_message = |_folder: &Path| {
        Ok(DiskSpace {
            free_bytes: 900_000_000,
            total_bytes: 10_000_000_000,
        })
    };
    let live = begin(low_space_message);
    assert!(live.is_resumed());
    let state = Arc::clone(&live.state);
    drop(live);
    assert!(lock(&state).problem.is_some());
    let live = begin(enough_space);
    assert!(!live.is_resumed(), "the disk has ended it");
}
