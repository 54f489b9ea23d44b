use std::collections::BTreeMap;

use nalgebra::Point3;
use proptest::prelude::*;

use super::*;
use crate::config::{Config, load};
use localization::registration::{MountOrigin, PoseOrigin, PoseStreams, RegistrationSettings};
use mapping::registered_scan::{BeamOutcome, RegisteredBeam, ScanKind};
use measurement::pose::Pose;
use measurement::scan::Scan;
use measurement::time::{RobotDuration, RobotTime};
use measurement::{GeodeticFix, MeasurementData, StreamId};

const LASER: StreamId = StreamId(1);
/// Of the stamps: what they begin with says nothing.
const EPOCH_NS: i64 = 1_700_000_000_000_000_000;

fn at(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

fn measured(stream: StreamId, ms: u64, data: MeasurementData) -> Measurement {
    Measurement {
        stamp: RobotTime::from_nanos(EPOCH_NS + ms.cast_signed() * 1_000_000),
        stream,
        frame: "laser".into(),
        data,
    }
}

fn sweep(ms: u64, range_m: f32) -> Measurement {
    let scan = Scan {
        angle_min_rad: -1.0,
        angle_increment_rad: 0.4,
        range_min_m: 0.1,
        range_max_m: 8.0,
        ranges_m: vec![f32::NAN, range_m, 0.0, range_m, -1.0],
        ..Scan::default()
    };
    let own_pose = None;
    measured(LASER, ms, MeasurementData::Scan { scan, own_pose })
}

fn fix(ms: u64, status: i8) -> Measurement {
    let fix = GeodeticFix {
        latitude_deg: 38.0,
        longitude_deg: -9.0,
        altitude_m: 1.0,
        status,
        sigma_m: None,
    };
    measured(StreamId(3), ms, MeasurementData::Fix(fix))
}

/// A laser with a nominal rate of `rate_hz`, and the pose sensors.
fn config(preset: &str, settings: &[&str]) -> Config {
    let settings: Vec<_> = settings.iter().map(|set| set.parse().unwrap()).collect();
    load(preset, &settings).unwrap()
}

fn localization(config: &Config, origin: PoseOrigin, mount: MountOrigin) -> RegistrationSettings {
    use crate::runtime::localization_plan::{
        LocalizationPlan, PlannedSensor, registration_settings,
    };
    let sensors = config.range_sensors();
    let sensors = sensors.iter().map(|sensor| PlannedSensor {
        id: sensor.id,
        stream: (sensor.name == "laser").then_some(LASER),
        mount,
        tilt_stream: sensor.config.tilt.as_ref().map(|_| StreamId(9)),
        range_max_m: None,
    });
    let localization = LocalizationPlan {
        origin,
        pose_streams: PoseStreams::default(),
        sensors: sensors.collect(),
    };
    registration_settings(config, &localization)
}

fn laser(rate_hz: Option<f64>) -> SensorMonitor {
    let rate = rate_hz.map(|rate_hz| format!("sensors.laser.rate_hz={rate_hz}"));
    let settings: Vec<_> = rate.iter().map(String::as_str).collect();
    let config = config("generic2d", &settings);
    let localization = localization(&config, PoseOrigin::Static, MountOrigin::Configured);
    SensorMonitor::new(descriptors(&config, &localization))
}

fn assert_near<const N: usize>(found: [f32; N], expected: [f32; N]) {
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-5, "{found} is not {expected}");
    }
}

fn fault(monitor: &SensorMonitor, ms: u64) -> Option<SensorFault> {
    monitor.statuses(at(ms))[0].fault
}

#[test]
fn sensors_of_a_boat_are_reported_with_mounting_and_view() {
    let config = config("riverwatch", &[]);
    let sensors = crate::config::FixesAndAttitude::of(&config.sensors).unwrap();
    let origin = crate::runtime::localization_plan::poses_from_fixes(&config, &sensors);
    let localization = localization(&config, origin, MountOrigin::Configured);
    let (revision, infos) = SensorMonitor::new(descriptors(&config, &localization)).infos();
    assert_eq!(revision, 0);
    let reported: Vec<_> = infos
        .iter()
        .map(|info| (info.name.as_str(), info.kind))
        .collect();
    assert_eq!(
        reported,
        [
            ("laser", SensorKind::TiltingLaser),
            ("laser tilt", SensorKind::TiltEncoder),
            ("sonar", SensorKind::Sonar),
            ("gps", SensorKind::SatelliteReceiver),
            ("imu", SensorKind::Attitude),
        ]
    );
    let (laser, sonar) = (&infos[0], &infos[2]);
    assert_eq!((laser.rate_hz, sonar.rate_hz), (Some(5.0), Some(10.0)));
    assert!(laser.mount.is_some() && sonar.mount.is_some() && infos[1].mount.is_none());
    let view = sonar.view.unwrap();
    assert!(
        (view.angles_rad[1] - 60f32.to_radians()).abs() < 1e-6,
        "{view:?}"
    );
}

#[test]
fn what_the_configuration_does_not_know_the_first_scan_shows() {
    let config = config("generic2d", &[]);
    let localization = localization(&config, PoseOrigin::Odometry, MountOrigin::Tree);
    let mut monitor = SensorMonitor::new(descriptors(&config, &localization));
    let (_, infos) = monitor.infos();
    assert_eq!((infos[0].view, infos[0].mount), (None, None));
    assert_eq!(infos[1].kind, SensorKind::Odometry);

    monitor.take(&sweep(0, 3.0), at(0));
    let (revision, infos) = monitor.infos();
    assert_eq!(revision, 1);
    let view = infos[0].view.unwrap();
    assert_eq!((view.angles_rad, view.range_m), ([-1.0, 0.6], [0.1, 8.0]));

    // It looks to the left, and hangs upside down: its beams turn clockwise.
    for (is_mirrored, expected) in [(false, [-1.0, 0.6]), (true, [-0.6, 1.0])] {
        let mut monitor = monitor.clone();
        let sign = if is_mirrored { -1.0 } else { 1.0 };
        let beam = |index: u32| {
            let angle_rad = std::f64::consts::FRAC_PI_2 + sign * (-1.0 + 0.4 * f64::from(index));
            let origin_in_odom = Point3::new(10.0, 1.0, 0.5);
            let along = [libm::cos(angle_rad), libm::sin(angle_rad)].map(|part| 2.0 * part);
            RegisteredBeam {
                origin_in_odom,
                end_in_odom: Point3::new(10.0 + along[0], 1.0 + along[1], 0.5),
                outcome: BeamOutcome::Hit,
                index,
                range_m: 2.0,
            }
        };
        let scan = RegisteredScan {
            stamp: RobotTime::from_nanos(0),
            sensor: SensorId(0),
            beam_step_rad: 0.5,
            kind: ScanKind::Beams,
            own_body_hits: 0,
            odom_from_base: Pose::translation(9.5, 1.0, 0.25),
            beams: [1, 2, 3].map(beam).into(),
        };
        monitor.on_registered_scan(&scan, false);
        monitor.on_registered_scan(&scan, false);
        let (revision, infos) = monitor.infos();
        assert_eq!(revision, 2, "once is enough");
        let mount = infos[0].mount.unwrap();
        assert_near(mount.position_m, [0.5, 0.0, 0.25]);
        assert!(
            (mount.yaw_rad - std::f32::consts::FRAC_PI_2).abs() < 1e-6,
            "{mount:?}"
        );
        assert_near(infos[0].view.unwrap().angles_rad, expected);
    }
}

#[test]
fn rates_and_ages_are_those_of_the_last_seconds() {
    let mut monitor = laser(Some(10.0));
    for n in 0..100 {
        monitor.take(&sweep(100 * n, 3.0), at(100 * n));
    }
    let status = &monitor.statuses(at(9_940))[0];
    assert_eq!((status.name.as_str(), status.messages), ("laser", 100));
    assert!((status.rate_hz - 10.0).abs() < 0.01, "{}", status.rate_hz);
    assert_eq!((status.age_ms, status.fault), (Some(40), None));
    // Four a second: two and a half seconds later most of the window is of the slower pace.
    for n in 0..10 {
        let ms = 10_000 + 250 * n;
        monitor.take(&sweep(ms, 3.0), at(ms));
    }
    let rate_hz = monitor.statuses(at(12_300))[0].rate_hz;
    assert!((6.0..8.0).contains(&rate_hz), "{rate_hz}");
    assert!(monitor.statuses(at(30_000))[0].rate_hz < f32::EPSILON);
}

#[test]
fn silence_begins_after_a_second_or_five_periods_and_is_reported_once() {
    let mut monitor = laser(Some(10.0));
    assert_eq!(fault(&monitor, 2_999), None);
    assert_eq!(
        fault(&monitor, 3_000),
        Some(SensorFault::Silent),
        "no first word"
    );
    monitor.take(&sweep(3_000, 3.0), at(3_000));
    assert_eq!(fault(&monitor, 4_000), None);
    assert_eq!(fault(&monitor, 4_001), Some(SensorFault::Silent));

    let raised = monitor.check(at(4_200));
    let FaultChange::Raised {
        fault: what,
        message,
        ..
    } = &raised[0]
    else {
        panic!("{raised:?}")
    };
    assert_eq!(
        (*what, message.as_str()),
        (SensorFault::Silent, "laser: silent for 1.2 s")
    );
    assert_eq!(monitor.check(at(5_000)), []);
    // It stutters: one word a while is no news.
    monitor.take(&sweep(5_100, 3.0), at(5_100));
    assert_eq!(monitor.check(at(5_200)), []);
    assert_eq!(monitor.check(at(6_500)), []);
    for n in 0..30 {
        monitor.take(&sweep(7_000 + 100 * n, 3.0), at(7_000 + 100 * n));
    }
    let cleared = monitor.check(at(9_900));
    assert_eq!(cleared.len(), 1, "{cleared:?}");
    let FaultChange::Cleared { sensor, message } = &cleared[0] else {
        panic!("{cleared:?}")
    };
    assert_eq!(
        (sensor.as_str(), message.as_str()),
        ("laser", "laser: back")
    );

    // Of one that speaks every 8 s, the rate is known all the same.
    let mut rare = laser(Some(0.125));
    for n in 0..4 {
        rare.take(&sweep(8_000 * n, 3.0), at(8_000 * n));
    }
    let status = &rare.statuses(at(30_000))[0];
    assert!((status.rate_hz - 0.125).abs() < 1e-6, "{status:?}");
    assert_eq!(status.fault, None);

    // Of one that speaks every 2 s, five periods are silence.
    let mut slow = laser(None);
    for n in 0..5 {
        slow.take(&sweep(2_000 * n, 3.0), at(2_000 * n));
    }
    assert_eq!(fault(&slow, 8_000 + 9_000), None);
    assert_eq!(fault(&slow, 8_000 + 10_100), Some(SensorFault::Silent));
}

#[test]
fn half_the_rate_is_slow_and_an_unknown_rate_never_is() {
    for (nominal_hz, expected) in [(Some(10.0), Some(SensorFault::Slow)), (None, None)] {
        let mut monitor = laser(nominal_hz);
        for n in 0..40 {
            monitor.take(&sweep(250 * n, 3.0), at(250 * n));
        }
        assert_eq!(fault(&monitor, 9_800), expected);
        assert_eq!(
            fault(&monitor, 4_900).filter(|_| nominal_hz.is_none()),
            None
        );
    }
}

#[test]
fn stamps_that_leap_are_a_fault_unless_a_recording_begins_again() {
    let mut monitor = laser(Some(10.0));
    let leap = |monitor: &mut SensorMonitor, ms: u64, stamp_ms: u64| {
        monitor.take(&sweep(stamp_ms, 3.0), at(ms));
    };
    for n in 0..20 {
        leap(&mut monitor, 100 * n, 100 * n);
    }
    assert_eq!(fault(&monitor, 2_000), None);
    let mut repeated = monitor.clone();
    leap(&mut monitor, 2_000, 500);
    assert_eq!(fault(&monitor, 2_050), Some(SensorFault::Clock));
    for n in 1..60 {
        leap(&mut monitor, 2_000 + 100 * n, 500 + 100 * n);
    }
    assert_eq!(fault(&monitor, 6_999), Some(SensorFault::Clock));
    assert_eq!(fault(&monitor, 7_900), None);
    repeated.on_replay_restart();
    leap(&mut repeated, 2_000, 0);
    assert_eq!(fault(&repeated, 2_050), None);
}

#[test]
fn a_covered_laser_and_a_receiver_without_a_fix_measure_nothing() {
    let mut monitor = laser(Some(10.0));
    for n in 0..50 {
        let range_m = if n < 20 { 3.0 } else { 0.0 };
        monitor.take(&sweep(100 * n, range_m), at(100 * n));
        let expected = (n >= 29).then_some(SensorFault::AllInvalid);
        assert_eq!(fault(&monitor, 100 * n), expected, "{n}");
    }
    let raised = monitor.check(at(4_900));
    assert!(
        matches!(&raised[0], FaultChange::Raised { message, .. } if message == "laser: measures nothing: covered or broken"),
        "{raised:?}"
    );
    // Beams that hit nothing up to the horizon have measured that.
    let mut open = laser(Some(10.0));
    for n in 0..50 {
        open.take(&sweep(100 * n, f32::INFINITY), at(100 * n));
    }
    assert_eq!(fault(&open, 4_900), None);

    let config = config("riverwatch", &[]);
    let sensors = crate::config::FixesAndAttitude::of(&config.sensors).unwrap();
    let origin = crate::runtime::localization_plan::poses_from_fixes(&config, &sensors);
    let localization = localization(&config, origin, MountOrigin::Configured);
    let mut boat = SensorMonitor::new(descriptors(&config, &localization));
    for n in 0..30 {
        boat.take(&fix(200 * n, if n < 10 { 0 } else { -1 }), at(200 * n));
    }
    let statuses = boat.statuses(at(5_900));
    let by_name: BTreeMap<_, _> = statuses.iter().map(|s| (s.name.as_str(), s)).collect();
    assert_eq!(by_name["gps"].fault, Some(SensorFault::AllInvalid));
    assert_eq!(by_name["gps"].messages, 30);
    assert_eq!(by_name["imu"].fault, Some(SensorFault::Silent));
}

#[test]
fn a_sonar_that_measures_nothing_may_be_too_near_to_the_bottom() {
    let config = config("riverwatch", &[]);
    let localization = localization(&config, PoseOrigin::Static, MountOrigin::Configured);
    let mut boat = SensorMonitor::new(descriptors(&config, &localization));
    // No stream is configured as the sonar's: the laser's counts as its own too.
    for n in 0..30 {
        boat.take(&sweep(100 * n, 0.0), at(100 * n));
    }
    let raised = boat.check(at(2_900)).into_iter();
    let fault_text = raised.map(|change| match change {
        FaultChange::Raised { message, .. } | FaultChange::Cleared { message, .. } => message,
    });
    assert_eq!(
        fault_text.collect::<Vec<_>>(),
        [
            "laser: measures nothing: covered or broken",
            "sonar: nothing valid: covered, broken, or nearer to the bottom than it measures",
        ]
    );
}

#[test]
fn losses_are_those_of_the_sensor() {
    let mut monitor = laser(None);
    let mut counts = RegistrationCounts::default();
    let mut of_laser = localization::registration::SensorCounts::default();
    of_laser.dropped_scans.add_many(DropReason::PoseGap, 3);
    of_laser.dropped_scans.add(DropReason::NoPose);
    counts.sensors.push(of_laser);
    counts.dropped_poses.add(DropReason::GnssOutlier);
    monitor.count(&counts);
    assert_eq!(monitor.statuses(at(0))[0].dropped, 4);
    assert_eq!(monitor.name(SensorId(0)), Some("laser"));
    assert_eq!(monitor.name(SensorId(1)), None);
}

proptest! {
    /// Whatever comes in whatever order: nothing panics or grows, figures are finite, and a fault that began is reported
    /// before its end.
    #[test]
    fn whatever_comes_the_figures_are_sound(
        steps in prop::collection::vec((0u64..3_000, any::<i64>(), 0f32..10.0, any::<bool>()), 1..300),
    ) {
        let mut monitor = laser(Some(10.0));
        let (mut now, mut is_reported) = (0, false);
        for (gap_ms, stamp_ns, range_m, is_look) in steps {
            now += gap_ms;
            let mut measurement = sweep(0, range_m);
            measurement.stamp = RobotTime::from_nanos(stamp_ns);
            monitor.take(&measurement, at(now));
            let status = &monitor.statuses(at(now))[0];
            prop_assert!(status.rate_hz.is_finite() && status.rate_hz >= 0.0);
            prop_assert_eq!(status.age_ms, Some(0));
            if is_look {
                for change in monitor.check(at(now)) {
                    match change {
                        FaultChange::Raised { .. } => is_reported = true,
                        FaultChange::Cleared { .. } => {
                            prop_assert!(is_reported);
                            is_reported = false;
                        }
                    }
                }
            }
        }
    }

    /// At any steady pace the rate is that pace, at any moment.
    #[test]
    fn a_steady_pace_is_its_rate(rate_hz in 0.5f64..200.0, ask in 0.0f64..1.0) {
        let mut monitor = laser(Some(rate_hz));
        let step = |n: u32| Duration::from_secs_f64(f64::from(n) / rate_hz);
        let count = (12.0 * rate_hz) as u32;
        for n in 0..count {
            let mut measurement = sweep(0, 3.0);
            measurement.stamp = RobotTime::from_nanos(0)
                + RobotDuration::from_secs_f64(step(n).as_secs_f64());
            monitor.take(&measurement, step(n));
        }
        let now = step(count - 1) + Duration::from_secs_f64(ask / rate_hz);
        let status = &monitor.statuses(now)[0];
        prop_assert!((f64::from(status.rate_hz) / rate_hz - 1.0).abs() < 0.01, "{}", status.rate_hz);
        prop_assert_eq!(status.fault, None);
    }
}

#[test]
fn data_that_is_wound_has_no_fault_by_that() {
    let mut monitor = laser(Some(10.0));
    let mut faults = Vec::new();
    let mut lap = |monitor: &mut SensorMonitor, from_ms: u64| {
        for ms in (from_ms..116_000).step_by(100) {
            monitor.take(&sweep(ms, 3.0), at(ms));
            faults.extend(fault(monitor, ms));
        }
    };
    // From the end to the beginning and, both ways, to what lies between.
    lap(&mut monitor, 0);
    for to_ms in [0, 50_000, 90_000] {
        monitor.check(at(116_000));
        monitor.seek(at(to_ms));
        assert!(monitor.is_check_due(at(to_ms)));
        assert_eq!(fault(&monitor, to_ms + 2_900), None, "its first word");
        assert_eq!(fault(&monitor, to_ms + 3_000), Some(SensorFault::Silent));
        lap(&mut monitor, to_ms);
    }
    assert_eq!(faults, []);
    let messages = 1_160 + 1_160 + 660 + 260;
    assert_eq!(monitor.statuses(at(116_000))[0].messages, messages);
}
