use super::*;
use measurement::drops::DropReason;

fn survey_text(content: &str) -> Survey {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a log.clf");
    std::fs::write(&path, content).unwrap();
    let mut survey = Survey::of(&path, None).unwrap();
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
  19.0 s, stamps 100.500 to 119.500 s of a clock without a date

  topic   type           messages  rate
  PARAM   carmen/PARAM          1  not read: no sensor data that is understood
  NEFF    carmen/NEFF           1  not read: no sensor data that is understood
  ODOM    carmen/ODOM          20  1.00 Hz
  FLASER  carmen/FLASER        22  1.11 Hz

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
  yes: every scan brings its pose
  robot-edge replay 'a log.clf' --export maps
"
    );
}

#[test]
fn a_clock_that_cannot_be_used_is_reported() {
    let scans = ["5.5", "5.5", "5.5", "5.5", "1000000"];
    let scans = scans.map(|stamp| format!("FLASER 2 1 2 50 0 0 0 0 0 {stamp} h 0\n"));
    let page = survey_text(&scans.concat()).to_string();
    for line in [
        "\n  times are not known: its clock cannot be used (see faults)\n",
        "\n  FLASER  carmen/FLASER         5  -\n",
        "\n  FLASER: of 5 stamps 3 repeat the one before, 0 go back\n",
        "\n  FLASER: its clock cannot be used: scans are mapped in the order of the file\n",
    ] {
        assert!(page.contains(line), "{page}");
    }
}

#[test]
fn a_cut_off_file_names_the_command_that_saves_what_is_left() {
    let mut recorded = Recorded::new(&[("/scan", SCAN, scan())], "laser", 1);
    recorded.losses.add(DropReason::CutOff);
    let page = recorded.survey("cut off.mcap").to_string();
    let advice = "    to save what is left: robot-edge recover 'cut off.mcap' saved.mcap\n";
    assert!(page.contains(advice), "{page}");
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
            "  or with --topic laser=RLASER in the place of --topic laser=FLASER\n  robot-edge replay 'a log.clf' --topic \
             laser=FLASER --export maps\n"
        ),
        "{survey}"
    );
}

/// A stream's name, its type, and what each of its messages holds.
pub(crate) type Topic = (&'static str, &'static str, MeasurementData);

/// A recording with so many messages on each of its topics, in turn, 0.1 s apart.
pub(crate) struct Recorded {
    topics: Vec<Topic>,
    frame: &'static str,
    rounds: usize,
    vehicle: Option<&'static str>,
    streams: Vec<StreamSummary>,
    yielded: usize,
    losses: DropCounts,
}

impl Recorded {
    pub(crate) fn new(topics: &[Topic], frame: &'static str, rounds: usize) -> Self {
        let summary = |(name, type_name, _): &Topic| StreamSummary {
            stream: measurement::Stream {
                name: (*name).to_owned(),
                type_name: (*type_name).to_owned(),
            },
            understood: true,
            messages: rounds as u64,
            first: None,
            last: None,
        };
        Self {
            topics: topics.to_vec(),
            frame,
            rounds,
            vehicle: None,
            streams: topics.iter().map(summary).collect(),
            yielded: 0,
            losses: DropCounts::default(),
        }
    }

    pub(crate) fn survey(&mut self, path: &str) -> Survey {
        Survey::of_reader(Path::new(path), Format::Mcap, self).unwrap()
    }
}

impl RecordingReader for Recorded {
    fn next_measurement(&mut self) -> Result<Option<Measurement>, RecordingError> {
        let (round, index) = (
            self.yielded / self.topics.len(),
            self.yielded % self.topics.len(),
        );
        self.yielded += 1;
        Ok((round < self.rounds).then(|| Measurement {
            stamp: RobotTime::from_nanos(i64::try_from(round).unwrap() * 100_000_000),
            stream: StreamId(index as u16),
            frame: self.frame.into(),
            data: self.topics[index].2.clone(),
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
        self.vehicle
    }
}

/// The page of a vehicle's recording with one message on each topic.
fn page(vehicle: &'static str, topics: &[Topic]) -> String {
    let mut recorded = Recorded::new(topics, "sensor", 1);
    recorded.vehicle = Some(vehicle);
    recorded.survey("lake.mcap").to_string()
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
        sigma_m: None,
    };
    let messages = [
        ("/sonar", SCAN, scan()),
        ("/scan", SCAN, scan()),
        ("/joint_states", JOINTS, MeasurementData::Joints(joints)),
        ("/imu/data", IMU, attitude()),
        ("/fix", "sensor_msgs/NavSatFix", MeasurementData::Fix(fix)),
    ];
    let page = page("riverwatch", &messages);
    for lines in [
        "\njoints\n  /joint_states: laser_tilt_joint\n",
        "\nattitudes\n  /imu/data: 1 of 1 give an orientation\n",
        "\nsatellite fixes\n  /fix: 1 of 1 are a fix, the first at 38.510000°, -9.170000°, 53.0 m\n",
    ] {
        assert!(page.contains(lines), "{page}");
    }
    assert!(
        page.ends_with(
            "can it be mapped?\n  yes: satellite fixes of /fix and attitude of /imu/data give poses, as configured for \
             riverwatch\n  as riverwatch, with laser (/scan) and sonar (/sonar)\n  \
             robot-edge replay lake.mcap --export maps\n"
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
    let check = |vehicle: &'static str, messages: &[Topic], says: &str, options: &str| {
        let page = page(vehicle, messages);
        let end = format!(
            "can it be mapped?\n  yes: {says}\n  robot-edge replay lake.mcap{options} --export maps\n"
        );
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
