//! Sensor status, scans and recordings over real sessions.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::operator::Operator;
use measurement::MeasurementData;
use network::clock;
use protocol::keys::{RobotId, Topic};
use protocol::message::{
    Answer, Event, Info, Localization, MapPose, PoseConfidence, RecordingState, Refusal, Scan,
    SensorFault, SensorKind, Setting, Severity, Status,
};
use protocol::wire;
use recording::writer::McapWriter;
use recording::{Selection, open};
use serde::de::DeserializeOwned;
use tempfile::tempdir;
use zenoh::{Session, Wait as _};

use super::send_view;
use crate::processes::{free_port, measurements_in, rooms, simulate, start, tcp, zenoh_session};

const TIMEOUT: Duration = Duration::from_secs(30);

/// Messages of one topic, and their bytes.
type Received<T> = Arc<Mutex<(Vec<T>, usize)>>;

/// A console that wants scans.
struct Watcher {
    control: Session,
    robot: RobotId,
    status: Received<Status>,
    events: Received<Event>,
    localization: Received<Localization>,
    scans: Received<Scan>,
    // Closes last.
    _bulk: Session,
}

fn subscribe<T: DeserializeOwned + Send + 'static>(session: &Session, key: String) -> Received<T> {
    let received: Received<T> = Arc::default();
    let takes = Arc::clone(&received);
    session
        .declare_subscriber(key)
        .callback(move |sample| {
            let bytes = sample.payload().to_bytes();
            let (_, body) = wire::decode(&bytes).unwrap();
            let mut received = takes.lock().unwrap();
            received.0.push(body);
            received.1 += bytes.len();
        })
        .background()
        .wait()
        .unwrap();
    received
}

impl Watcher {
    fn of(port: u16) -> Self {
        let robot: RobotId = "scout".parse().unwrap();
        let [control, bulk] = [port, port + 1].map(|port| zenoh_session("client", &tcp(port)));
        Self {
            status: subscribe(&control, Topic::Status.key(&robot)),
            events: subscribe(&control, Topic::Event.key(&robot)),
            localization: subscribe(&control, Topic::Localization.key(&robot)),
            scans: subscribe(&bulk, Topic::Scan.key(&robot)),
            control,
            robot,
            _bulk: bulk,
        }
    }

    fn send_view(&self, wants_scan: bool) {
        send_view(&self.control, "watcher", wants_scan);
    }

    /// Sends its view until `found` returns a value.
    fn wait_for<T>(&self, what: &str, found: impl Fn(&Self) -> Option<T>) -> T {
        let started = clock::now();
        loop {
            self.send_view(true);
            if let Some(found) = found(self) {
                return found;
            }
            assert!(clock::elapsed(started) < TIMEOUT, "timed out: {what}");
            sleep(Duration::from_millis(100));
        }
    }

    fn last_status(&self) -> Option<Status> {
        self.status.lock().unwrap().0.last().cloned()
    }

    fn event(&self, kind: &str) -> Option<Event> {
        let events = self.events.lock().unwrap();
        events.0.iter().find(|event| event.kind == kind).cloned()
    }

    fn info(&self) -> Option<Info> {
        let replies = self
            .control
            .get(Topic::Info.key(&self.robot))
            .wait()
            .unwrap();
        let reply = replies.recv_timeout(Duration::from_secs(2)).ok()??;
        let sample = reply.into_result().ok()?;
        Some(wire::decode(&sample.payload().to_bytes()).unwrap().1)
    }
}

/// The recording `rooms` with an invalid laser from 4 s, a silent one from 8 s to 14 s, and an end at 20 s.
fn with_a_faulty_laser(folder: &Path) -> PathBuf {
    let path = folder.join("faulty.mcap");
    let mut writer = McapWriter::create(&path, Some("pioneer")).unwrap();
    let mut reader = open(rooms().as_ref(), Selection::All).unwrap();
    let mut first = None;
    while let Some(mut measurement) = reader.next_measurement().unwrap() {
        let since = measurement
            .stamp
            .since(*first.get_or_insert(measurement.stamp));
        let at_s = if measurement.is_static_transform() {
            0.0
        } else {
            since.as_secs_f64()
        };
        if at_s > 20.0 {
            break;
        }
        if let MeasurementData::Scan { scan, .. } = &mut measurement.data {
            if (8.0..14.0).contains(&at_s) {
                continue;
            }
            if (4.0..8.0).contains(&at_s) {
                scan.ranges_m.fill(0.0);
            }
        }
        let stream = &reader.streams()[usize::from(measurement.stream.0)].stream;
        writer.write(&stream.clone(), &measurement).unwrap();
    }
    writer.finish().unwrap();
    path
}

#[test]
fn an_invalid_or_silent_laser_is_reported_in_recording_time() {
    let folder = tempdir().unwrap();
    let port = free_port();
    let recording = with_a_faulty_laser(folder.path());
    let _robot = start(&format!(
        "robot-edge replay {} --rate 2 --keep-serving --robot scout --listen {}",
        recording.display(),
        tcp(port)
    ));
    let watcher = Watcher::of(port);

    let info = watcher.wait_for("info with what the first scan showed", |watcher| {
        watcher.info().filter(|info| info.revision > 0)
    });
    assert!(!info.can_record && !info.is_boat);
    let found: Vec<_> = info
        .sensors
        .iter()
        .map(|sensor| (sensor.name.as_str(), sensor.kind))
        .collect();
    assert_eq!(
        found,
        [
            ("laser", SensorKind::PlanarLaser),
            ("transforms", SensorKind::Transforms)
        ]
    );
    let laser = &info.sensors[0];
    assert_eq!(laser.rate_hz, Some(10.0));
    let view = laser.view.unwrap();
    let half_deg = view.angles_rad[1].to_degrees();
    assert!((119.0..121.0).contains(&half_deg), "{view:?}");
    assert!(laser.mount.is_some());

    let blind = watcher.wait_for("blind", |watcher| watcher.event("sensor_invalid"));
    assert_eq!(blind.message, "laser: measures nothing: covered or broken");
    assert_eq!(blind.severity, Severity::Warning);
    let silent = watcher.wait_for("silent", |watcher| watcher.event("sensor_silent"));
    assert!(
        silent.message.starts_with("laser: silent for 1."),
        "{}",
        silent.message
    );
    assert_eq!(silent.severity, Severity::Alarm);
    let status = watcher.wait_for("silent in the status", |watcher| {
        let status = watcher.last_status()?;
        (status.sensors[0].fault == Some(SensorFault::Silent)).then_some(status)
    });
    assert_eq!(status.info_revision, info.revision);
    assert!(status.sensors[0].age_ms.unwrap() > 1_000, "{status:?}");
    assert_eq!(status.sensors[1].fault, None, "{status:?}");
    let back = watcher.wait_for("back", |watcher| watcher.event("sensor_recovered"));
    assert_eq!(
        (back.message.as_str(), back.severity),
        ("laser: back", Severity::Info)
    );
    let rate_hz = watcher.wait_for("its rate again", |watcher| {
        let status = watcher.last_status()?;
        let laser = &status.sensors[0];
        (laser.fault.is_none() && laser.rate_hz > 9.0).then_some(laser.rate_hz)
    });
    // In recording time, although it is replayed twice as fast.
    assert!(rate_hz < 11.0, "{rate_hz}");
}

/// Who comes late has the closures, too.
#[test]
fn a_console_learns_how_well_scans_determine_the_pose() {
    let port = free_port();
    let _robot = start(&format!(
        "robot-edge replay {} --rate max --keep-serving --robot scout --listen {} --set localization.source=scan+wheels",
        rooms(),
        tcp(port)
    ));
    let watcher = Watcher::of(port);
    // Before the end a scan may show little of what was mapped.
    watcher.wait_for("the end", |watcher| {
        watcher.last_status()?.has_ended.then_some(())
    });
    let before = watcher.localization.lock().unwrap().0.len();
    let newest = watcher.wait_for("with closures, which may be none", |watcher| {
        let received = watcher.localization.lock().unwrap();
        let has_closures = received.0.iter().any(|one| one.closures_m.is_some());
        received.0[before..]
            .last()
            .filter(|_| has_closures)
            .cloned()
    });
    assert_eq!(newest.confidence, PoseConfidence::Determined, "{newest:?}");
    assert!(!newest.is_searching && newest.inliers > 0.8, "{newest:?}");
    assert!((0.001..0.05).contains(&newest.residual_m), "{newest:?}");
    let [xx, _, yy] = newest.covariance_m2;
    assert!(
        (1e-8..1e-2).contains(&xx) && (1e-8..1e-2).contains(&yy),
        "{newest:?}"
    );
    watcher.wait_for("what did not change is not sent again", |watcher| {
        let received = watcher.localization.lock().unwrap();
        received.0.last()?.closures_m.is_none().then_some(())
    });
}

/// A second map of that name is refused. The next run goes on in it where the operator says that the vehicle is.
#[test]
fn an_operator_saves_the_map_and_says_where_the_vehicle_is_in_it() {
    let folder = tempdir().unwrap();
    let port = free_port();
    let (listen, maps) = (tcp(port), folder.path().display());
    let robot = simulate(&format!(
        "--listen {listen} --maps {maps} --set localization.source=scan+wheels"
    ));
    let watcher = Watcher::of(port);
    watcher.wait_for("matched scans", |watcher| {
        watcher.localization.lock().unwrap().0.last().cloned()
    });
    let mut anna = Operator::ready(&tcp(port), "scout", "anna");
    let save = |name: &str| Setting::SaveMap(name.to_owned());
    for name in ["", "../quay", "a/b", &"a".repeat(65)] {
        assert_eq!(
            anna.ask(&save(name)),
            Answer::Refused(Refusal::OutOfRange),
            "{name:?}"
        );
    }
    assert_eq!(anna.ask(&save("quay-2")), Answer::Done);
    let saved = watcher.wait_for("saved", |watcher| watcher.event("map_saved"));
    assert!(
        saved.message.ends_with("quay-2: the map is saved"),
        "{saved:?}"
    );
    assert_eq!(anna.ask(&save("quay-2")), Answer::Done);
    let refused = watcher.wait_for("not again", |watcher| watcher.event("map_not_saved"));
    assert!(refused.message.contains("exists already"), "{refused:?}");
    drop((anna, watcher, robot));

    let port = free_port();
    let robot = simulate(&format!(
        "--listen {} --map {maps}/quay-2 --set localization.source=scan+wheels",
        tcp(port)
    ));
    let watcher = Watcher::of(port);
    let is_searching = |watcher: &Watcher| {
        let received = watcher.localization.lock().unwrap();
        received.0.last().map(|newest| newest.is_searching)
    };
    assert!(watcher.wait_for("searched for", is_searching));
    let mut anna = Operator::ready(&tcp(port), "scout", "anna");
    let near = Setting::Locate(MapPose {
        x_mm: 400,
        y_mm: -300,
        yaw_mrad: 100,
    });
    assert_eq!(anna.ask(&near), Answer::Done);
    watcher.wait_for("it is searched for there", |watcher| {
        watcher.event("location_set")
    });
    watcher.wait_for("found", |watcher| {
        is_searching(watcher).filter(|is_searching| !is_searching)
    });
    let joined = watcher.wait_for("one map", |watcher| watcher.event("loop_closed"));
    assert!(
        joined.message.contains("older map was joined"),
        "{joined:?}"
    );
    let newest = watcher.localization.lock().unwrap().0.last().cloned();
    assert!(newest.is_some_and(|newest| newest.inliers > 0.8));
    assert_eq!(anna.ask(&near), Answer::Done);
    watcher.wait_for("it is found", |watcher| watcher.event("location_not_set"));
    drop((anna, watcher, robot));
}

/// A run killed while it records continues to record after its restart and tells the first console.
#[test]
fn an_operators_recording_continues_after_a_kill() {
    let folder = tempdir().unwrap();
    let port = free_port();
    let start = || {
        let (listen, folder) = (tcp(port), folder.path().display());
        simulate(&format!("--listen {listen} --recordings {folder}"))
    };
    let recording = |watcher: &Watcher, state| {
        let recording = watcher.last_status()?.recording?;
        (recording.state == state && recording.duration_s >= 2).then_some(recording)
    };
    let is_running = |watcher: &Watcher| recording(watcher, RecordingState::Recording);
    let edge = start();
    let watcher = Watcher::of(port);
    let mut anna = Operator::ready(&tcp(port), "scout", "anna");
    assert_eq!(anna.ask(&Setting::Recording(true)), Answer::Done);
    let before = watcher.wait_for("it records", is_running);
    edge.signal("KILL");
    drop((edge, anna, watcher));
    let file = folder.path().join(&before.file);
    let written = std::fs::read(&file).unwrap();

    let edge = start();
    let watcher = Watcher::of(port);
    let after = watcher.wait_for("it records again", is_running);
    assert_ne!(after.file, before.file);
    let event = watcher.wait_for("an event that says so", |watcher| {
        watcher.event("recording")
    });
    assert_eq!(
        event.message,
        "recording goes on: the run before was cut off while an operator recorded"
    );
    // A regular end of the program ends the recording.
    edge.interrupt();
    drop(watcher);
    assert!(std::fs::read(&file).unwrap() == written, "overwritten");
    for name in [&before.file, &after.file] {
        let measurements = measurements_in(&folder.path().join(name));
        assert!(measurements > 50, "{name}: {measurements}");
    }

    let _edge = start();
    let watcher = Watcher::of(port);
    let state = watcher.wait_for("a status", |watcher| watcher.last_status()?.recording);
    assert_eq!((state.state, state.files), (RecordingState::Stopped, 0));
}

#[test]
fn a_simulated_robot_sends_scans_on_request_and_records() {
    let folder = tempdir().unwrap();
    let port = free_port();
    let robot = simulate(&format!(
        "--set vehicle.footprint_offset_m=0.125 --recordings {}/here --listen {}",
        folder.path().display(),
        tcp(port)
    ));
    let watcher = Watcher::of(port);

    let scan = watcher.wait_for("a sweep", |watcher| {
        watcher.scans.lock().unwrap().0.last().cloned()
    });
    assert_eq!(scan.sensor, "laser");
    let points = scan.points_m().unwrap();
    assert!(points.len() > 100, "{}", points.len());
    let square = |metres: f64| metres * metres;
    let is_near = |point: &[f64; 2]| {
        let [dx, dy] = [0, 1].map(|axis| point[axis] - scan.origin_m[axis]);
        square(dx) + square(dy) < square(6.0)
    };
    assert!(points.iter().all(is_near), "beyond the laser's 5.6 m");

    // A sixteenth of 256 kbit/s is 2 kB/s, plus a burst of a quarter of a second and the message that exceeds
    // it.
    let before = watcher.scans.lock().unwrap().1;
    let started = clock::now();
    watcher.wait_for("four seconds", |_| {
        (clock::elapsed(started) > Duration::from_secs(4)).then_some(())
    });
    let taken_s = clock::elapsed(started).as_secs_f64();
    let bytes = watcher.scans.lock().unwrap().1 - before;
    println!("sweeps: {:.1} kbit/s", bytes as f64 * 8e-3 / taken_s);
    assert!(
        (bytes as f64) < 2_000.0 * taken_s + 2_500.0,
        "{bytes} in {taken_s} s"
    );
    assert!(bytes > 2_000, "{bytes}");

    // A view without scans stops them.
    watcher.send_view(false);
    sleep(Duration::from_millis(500));
    let before = watcher.scans.lock().unwrap().0.len();
    for _ in 0..5 {
        watcher.send_view(false);
        sleep(Duration::from_millis(300));
    }
    assert_eq!(watcher.scans.lock().unwrap().0.len(), before);

    let info = watcher.info().unwrap();
    assert!(info.can_record);
    assert_eq!(info.footprint_offset_m.to_bits(), 0.125_f32.to_bits());
    let stopped = watcher.last_status().unwrap().recording.unwrap();
    assert_eq!((stopped.state, stopped.files), (RecordingState::Stopped, 0));
    assert!(stopped.free_bytes.is_some());
    let mut anna = Operator::ready(&tcp(port), "scout", "anna");
    assert_eq!(anna.ask(&Setting::Recording(true)), Answer::Done);
    let running = watcher.wait_for("it records", |watcher| {
        let recording = watcher.last_status()?.recording?;
        let is_on = recording.state == RecordingState::Recording && recording.duration_s >= 1;
        (is_on && recording.bytes > 0).then_some(recording)
    });
    assert!(running.file.starts_with("scout-"), "{running:?}");
    assert_eq!((running.files, running.lost), (1, 0));
    assert_eq!(anna.ask(&Setting::Recording(false)), Answer::Done);
    let stopped = watcher.wait_for("it stopped", |watcher| {
        let recording = watcher.last_status()?.recording?;
        (recording.state == RecordingState::Stopped).then_some(recording)
    });
    let file = folder.path().join("here").join(&stopped.file);
    assert_eq!(stopped.bytes, std::fs::metadata(&file).unwrap().len());
    assert!(watcher.event("recording").is_some());
    robot.interrupt();
    let mut reader = open(&file, Selection::All).unwrap();
    let mut scans = 0;
    while let Some(measurement) = reader.next_measurement().unwrap() {
        scans += u32::from(matches!(measurement.data, MeasurementData::Scan { .. }));
    }
    assert!(scans >= 5, "{scans} sweeps were recorded");
}
