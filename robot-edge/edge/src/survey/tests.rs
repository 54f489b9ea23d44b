use super::*;
use crate::shared_data::shared_data;

fn survey_of(folder: &str, name: &str) -> Option<Survey> {
    let path = shared_data(folder)?.join(name);
    let mut survey = Survey::of(&path).unwrap();
    survey.path = name.into();
    Some(survey)
}

fn survey_text(content: &str) -> Survey {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a log.clf");
    std::fs::write(&path, content).unwrap();
    let mut survey = Survey::of(&path).unwrap();
    survey.path = "a log.clf".into();
    survey
}

#[test]
fn a_log_is_summed_up_on_one_page() {
    let mut content = "PARAM robot_width 40 nohost 0\nNEFF 30\n".to_owned();
    content.extend((0..20).map(|n| {
        let stamp = 100 + n;
        format!(
            "ODOM {n} 0 0 0 0 0 {stamp}.25 h 0\n\
             FLASER 3 1.5 2.5 50 {n} 0 0 {n} 0 0 {stamp}.5 h 0\n"
        )
    }));
    content += "FLASER 3 1.5 2.5\n";
    content += "FLASER 3 1 2 50 0 0 0 0 0 0 119.4 h 0\n";
    assert_eq!(
        survey_text(&content).to_string(),
        "\
a log.clf
  CARMEN log, 1.5 kB
  19.0 s, from 100.500 to 119.500

  topic   type           messages  rate
  PARAM   carmen/PARAM          1  not read: no sensor data that is understood
  NEFF    carmen/NEFF           1  not read: no sensor data that is understood
  ODOM    carmen/ODOM          20  1.00 Hz
  FLASER  carmen/FLASER        22  1.00 Hz

range sensors
  FLASER: 21 scans of 3 beams in frame laser
    -90.0° to 90.0° in steps of 90.000°, beams 0.0 µs apart
    ranges 0 to 80 m; the greatest is 50 m, 21 times
    from 50 m on they repeat: what this laser reports for no return

frames
  ODOM: base_link in odom, 20 poses

faults
  damaged lines, records or chunks, passed over: 1
  stamps that contradicted the order of their lines, changed to fit it: 1
  FLASER: of 21 stamps 1 repeat the one before, 0 go back
    line 43: FLASER: ends before a range
    line 44: the stamp of FLASER goes back by 0.1 s and is held (later ones only counted)

can it be mapped?
  every scan brings its pose
  robot-edge replay 'a log.clf'
"
    );
}

#[test]
fn what_cannot_be_mapped_says_why() {
    let odometry_only = survey_text("ODOM 0 0 0 0 0 0 1 h 0\n");
    assert_eq!(odometry_only.mappable(), Mappable::NoRangeSensor);
    assert!(
        odometry_only
            .to_string()
            .ends_with("no: there is no planar range sensor in it\n")
    );

    let raw = "RAWLASER1 0 -1.5 3 1 80 0 0 2 1 2 0 1 h 1\n";
    let without_poses = survey_text(raw);
    assert_eq!(without_poses.mappable(), Mappable::NoPoseSource);
    assert!(
        without_poses
            .to_string()
            .contains("no: there are no poses of the sensor")
    );

    let with_odometry = survey_text(&format!("{raw}ODOM 0 0 0 0 0 0 1 h 0\n"));
    assert_eq!(
        with_odometry.mappable(),
        Mappable::Yes {
            laser: StreamId(0),
            pose_source: "ODOM gives poses of base_link in odom".to_owned(),
            needs_auto: false,
            must_be_named: false,
        }
    );
}

#[test]
fn of_two_lasers_one_must_be_named() {
    let line = "LASER 2 1 2 0 0 0 0 0 0 1 h 1\n";
    let survey = survey_text(&format!("R{line}F{line}F{line}"));
    assert!(
        survey.to_string().ends_with(
            "  robot-edge replay 'a log.clf' --topic laser=FLASER\n  or with --topic laser=RLASER\n"
        ),
        "{survey}"
    );
}

/// A stream's name, its type, and what its only message holds.
type Message = (&'static str, &'static str, MeasurementData);

/// A vehicle's recording.
struct Recorded {
    vehicle: &'static str,
    streams: Vec<StreamSummary>,
    messages: Vec<MeasurementData>,
    yielded: usize,
    losses: DropCounts,
}

impl Recorded {
    fn by(vehicle: &'static str, messages: &[Message]) -> Self {
        let summary = |(name, type_name, _): &Message| StreamSummary {
            stream: measurement::Stream {
                name: (*name).to_owned(),
                type_name: (*type_name).to_owned(),
            },
            understood: true,
            messages: 1,
            first: None,
            last: None,
        };
        Self {
            vehicle,
            streams: messages.iter().map(summary).collect(),
            messages: messages.iter().map(|(.., data)| data.clone()).collect(),
            yielded: 0,
            losses: DropCounts::default(),
        }
    }

    fn page(&mut self) -> String {
        let survey = Survey::of_reader(Path::new("lake.mcap"), Format::Mcap, self);
        survey.unwrap().to_string()
    }
}

impl RecordingReader for Recorded {
    fn next_measurement(&mut self) -> Result<Option<Measurement>, RecordingError> {
        let index = self.yielded;
        self.yielded += 1;
        Ok(self.messages.get(index).map(|data| Measurement {
            stamp: RobotTime::from_nanos(1_000_000_000),
            stream: StreamId(index as u16),
            frame: "sensor".into(),
            data: data.clone(),
        }))
    }

    fn streams(&self) -> &[StreamSummary] {
        &self.streams
    }

    fn losses(&self) -> &DropCounts {
        &self.losses
    }

    fn loss_notes(&self) -> &[String] {
        &[]
    }

    fn position(&self) -> Position {
        Position {
            bytes_read: 0,
            bytes_total: 1000,
        }
    }

    fn vehicle(&self) -> Option<&str> {
        Some(self.vehicle)
    }
}

fn scan() -> MeasurementData {
    MeasurementData::Scan {
        scan: measurement::scan::Scan {
            ranges_m: vec![1.0, 2.0],
            range_max_m: 20.0,
            ..measurement::scan::Scan::default()
        },
        own_pose: None,
    }
}

fn attitude() -> MeasurementData {
    MeasurementData::Imu(measurement::ImuSample {
        orientation_xyzw: Some([0.0, 0.0, 0.0, 1.0]),
        angular_velocity_radps: [0.0; 3],
        linear_acceleration_mps2: [0.0; 3],
    })
}

const SCAN: &str = "sensor_msgs/LaserScan";
const JOINTS: &str = "sensor_msgs/JointState";
const IMU: &str = "sensor_msgs/Imu";

#[test]
fn the_sensors_of_a_boat_are_mapped_together() {
    let joints = vec![("laser_tilt_joint".to_owned(), 0.1)];
    let fix = measurement::GeodeticFix {
        latitude_deg: 38.51,
        longitude_deg: -9.17,
        altitude_m: 53.0,
        status: 2,
    };
    let messages = [
        ("/sonar", SCAN, scan()),
        ("/scan", SCAN, scan()),
        ("/joint_states", JOINTS, MeasurementData::Joints(joints)),
        ("/imu/data", IMU, attitude()),
        ("/fix", "sensor_msgs/NavSatFix", MeasurementData::Fix(fix)),
    ];
    let page = Recorded::by("riverwatch", &messages).page();
    for lines in [
        "\njoints\n  /joint_states: laser_tilt_joint\n",
        "\nattitudes\n  /imu/data: 1 of 1 give an orientation\n",
        "\nsatellite fixes\n  /fix: 1 of 1 are a fix, the first at 38.510000°, -9.170000°, 53.0 m\n",
    ] {
        assert!(page.contains(lines), "{page}");
    }
    assert!(
        page.ends_with(
            "can it be mapped?\n  satellite fixes of /fix and attitude of /imu/data give poses, as configured for \
             riverwatch\n  as riverwatch, with laser (/scan) and sonar (/sonar)\n  \
             robot-edge replay lake.mcap\n"
        ),
        "{page}"
    );
}

/// Other poses are proposed only where the vehicle leaves it open, or where those that it wants are not there.
#[test]
fn poses_are_those_that_the_vehicle_wants() {
    let wheels = ["left_wheel_joint", "right_wheel_joint"];
    let angles = wheels.map(|wheel| (wheel.to_owned(), 0.1)).to_vec();
    let odometry = MeasurementData::Odometry {
        child: "base_link".into(),
        odom_from_base: measurement::pose::Pose::identity(),
    };
    let all = [
        ("/scan", SCAN, scan()),
        ("/imu/data", IMU, attitude()),
        ("/odom", "nav_msgs/Odometry", odometry),
        ("/joint_states", JOINTS, MeasurementData::Joints(angles)),
    ];
    let check = |vehicle: &'static str, messages: &[Message], says: &str, options: &str| {
        let page = Recorded::by(vehicle, messages).page();
        let end = format!("can it be mapped?\n  {says}\n  robot-edge replay lake.mcap{options}\n");
        assert!(page.ends_with(&end), "{page}");
    };
    check(
        "holos",
        &all,
        "wheels of /joint_states and attitude of /imu/data give poses, as configured for holos",
        "",
    );
    let without_wheels = &all[..3];
    check(
        "holos",
        without_wheels,
        "/odom gives poses of base_link in sensor; holos is configured for another pose source, which is not in it",
        " --set localization.source=auto",
    );
    // The first leaves it open; of the second nothing is known here.
    for vehicle in ["pioneer", "somebody's"] {
        let says = "/odom gives poses of base_link in sensor";
        check(vehicle, &all, says, "");
    }
}

#[test]
fn lasers_of_published_logs_say_nothing_seen_in_their_own_way() {
    let check = |name: &str, greatest: (f32, u64), miss: Option<f32>, unsaid: Option<f32>| {
        let Some(survey) = survey_of("carmen", name) else {
            return;
        };
        let [scan] = &survey.scans[..] else {
            panic!("{name}")
        };
        assert_eq!(scan.max_range.greatest(), Some(greatest), "{name}");
        assert_eq!(scan.max_range.miss_range_m(), miss, "{name}");
        assert_eq!(scan.inferred_miss_range_m(), unsaid, "{name}");
    };
    check("aces.clf", (50.0, 11139), Some(50.0), Some(50.0));
    check("aces-corrected.log", (50.0, 620), Some(50.0), Some(50.0));
    check(
        "infinite-corridor-corrected.log",
        (51.16, 2),
        Some(51.01),
        Some(51.01),
    );
    // The reader's 80 m covers these.
    check("intel-corrected.log", (81.83, 4172), Some(81.83), None);
    check("csail-corrected.log", (81.91, 3907), Some(81.91), None);
    check("belgioioso-corrected.log", (81.91, 699), Some(81.91), None);
    check(
        "fr-clinic_robotlaser.clf",
        (81.91, 150_066),
        Some(81.91),
        None,
    );
}

#[test]
fn bags_are_surveyed() {
    let Some(survey) = survey_of("rosbag1", "lms1xx_with_tf.bag") else {
        return;
    };
    let [scan] = &survey.scans[..] else { panic!() };
    assert_eq!(
        (scan.stamps.count, scan.beams, &*scan.frame),
        (89, (541, 541), "cloud")
    );
    assert!((scan.stamps.rate_hz().unwrap() - 50.0).abs() < 1.0);
    assert_eq!((scan.range_min_m, scan.range_max_m), (0.05, 25.0));
    assert!((scan.angle_max_rad() - 135_f32.to_radians()).abs() < 1e-3);
    let edges: Vec<_> = survey
        .frames
        .edges()
        .map(|(parent, child, edge)| (&**parent, &**child, edge.count, edge.is_static))
        .collect();
    assert_eq!(edges, [("cloud", "radar", 17, false)]);
    assert_eq!(survey.mappable(), Mappable::NoPoseSource);
    let not_understood = survey
        .streams
        .iter()
        .filter(|s| !s.understood && s.messages > 0)
        .count();
    assert_eq!((survey.streams.len(), not_understood), (12, 7));

    let two = survey_of("rosbag1", "two_lasers.bag").unwrap();
    let command = "two_lasers.bag --topic laser=/rear_scan --set localization.source=static\n  or with --topic laser=/front_scan\n";
    assert!(two.to_string().contains(command), "{two}");
    let damaged = survey_of("rosbag1", "damaged_index.bag").unwrap();
    assert!(
        damaged
            .to_string()
            .contains("damaged lines, records or chunks, passed over: 2"),
        "{damaged}"
    );
    assert_eq!(damaged.scans[0].stamps.count, 360);
}

#[test]
fn mcap_files_are_surveyed() {
    let Some(intel) = survey_of("mcap", "intel_corrected.mcap") else {
        return;
    };
    assert_eq!(intel.scans[0].max_range.greatest(), Some((81.83, 4172)));
    assert_eq!(
        intel.mappable(),
        Mappable::Yes {
            laser: intel.scans[0].stream,
            pose_source: "transforms lead from laser to odom".to_owned(),
            needs_auto: false,
            must_be_named: false,
        }
    );
    let turtlebot = survey_of("mcap", "turtlebot_tf_odom.mcap").unwrap();
    assert_eq!(turtlebot.mappable(), Mappable::NoRangeSensor);
    assert_eq!(turtlebot.frames.roots(), [&FrameId::from("map")]);
    let oakd = turtlebot.frames.ancestors("oakd_imu_frame");
    assert_eq!(oakd.len(), 6, "{oakd:?}");
}
