//! Poses from clouds: of a capture beside those that came with it, of a simulated drive beside the truth.
//!
//! `cargo run --release -p localization --example evaluate_cloud_matching -- capture=FILE [poses=FILE]`
//! `cargo run --release -p localization --example evaluate_cloud_matching -- world=NAME [prior=none|attitude|odometry|wheels] [seed=1]
//! [duration=SECONDS] [laser=tilting|tilted]`: without a laser, a lidar 0.8 m above the ground; introbot's, or holos'
#![expect(clippy::print_stdout, reason = "the output of the example")]

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use localization::attitude::AttitudeSettings;
use localization::beam_projection::{BodyBox, SensorSettings, ZeroRange};
use localization::cloud_matching::{CloudMatcher, CloudPose, Revolution};
use localization::pose_buffer::{InterpolationLimits, JumpLimit};
use localization::registration::{
    MountOrigin, PoseOrigin, PoseStreams, RangeSensorSettings, RegistrationOutput,
    RegistrationSettings, ScanRegistration,
};
use localization::scan_localization::{MotionPrior, ScanLocalizationSettings};
use localization::scan_matching::slam_settings::SlamSettings;
use localization::tilt::TiltSettings;
use mapping::registered_scan::{BeamOutcome, RegisteredScan, ScanKind, SensorId};
use measurement::pose::{self, Pose};
use measurement::time::{RobotDuration, RobotTime};
use measurement::{ImuSample, Measurement, MeasurementData};
use nalgebra::{Translation3, UnitQuaternion, Vector3};
use recording::poses::PoseFile;
use recording::{Selection, open};
use simulation::noise::NoiseStream;
use simulation::{SimulatedSource, SimulationOptions, World};

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let options: Vec<String> = std::env::args().skip(1).collect();
    let options: HashMap<&str, &str> = options
        .iter()
        .filter_map(|word| word.split_once('='))
        .collect();
    match (options.get("capture"), options.get("world")) {
        (Some(capture), _) => evaluate_capture(capture, options.get("poses").copied()),
        (_, Some(world)) => evaluate_world(world, &options),
        _ => Err("capture=FILE or world=NAME".into()),
    }
}

fn evaluate_capture(capture: &str, poses: Option<&str>) -> Result<(), Failure> {
    let given = match poses
        .map(|file| PoseFile::read(Path::new(file)))
        .transpose()?
    {
        Some(PoseFile::ForEachCloud(poses)) => poses,
        _ => Vec::new(),
    };
    let mut reader = open(Path::new(capture), Selection::All)?;
    let mut matcher = CloudMatcher::default();
    let mut first = None;
    let mut at = 0;
    while let Some(measurement) = reader.next_measurement()? {
        let MeasurementData::Cloud(cloud) = &measurement.data else {
            continue;
        };
        let Some((begin, end)) = cloud.span(measurement.stamp) else {
            continue;
        };
        let begin_ms = used_ms();
        let found = matcher.push(
            &Revolution {
                cloud,
                stamp: measurement.stamp,
                base_from_sensor: Pose::identity(),
                prior: [(begin, Pose::identity()), (end, Pose::identity())],
                motion: MotionPrior::None,
                has_gravity: false,
                is_stripe: false,
            },
            |_| false,
        );
        let ms = used_ms() - begin_ms;
        let way_m = found.odom_from_base.translation.vector;
        let sigma = sigmas(&found);
        println!(
            "{at}: {} points, {ms:.1} ms, at {:.4} {:.4} {:.4} m, turned by {:.3}°, sigma {:.4} m {:.4}°{}",
            cloud.points.len(),
            way_m.x,
            way_m.y,
            way_m.z,
            found.odom_from_base.rotation.angle().to_degrees(),
            sigma.0,
            sigma.1.to_degrees(),
            if found.is_determined() {
                ""
            } else {
                ", not determined"
            },
        );
        if let Some(pose) = given.get(at) {
            let (first_found, first_given) = *first.get_or_insert((found.odom_from_base, *pose));
            let error = first_given
                .inv_mul(pose)
                .inv_mul(&first_found.inv_mul(&found.odom_from_base));
            println!(
                "   given {:.4?} m, {:.3}°: off by {:.4} m, {:.3}°",
                first_given.inv_mul(pose).translation.vector.as_slice(),
                first_given.inv_mul(pose).rotation.angle().to_degrees(),
                error.translation.vector.norm(),
                error.rotation.angle().to_degrees()
            );
        }
        at += 1;
    }
    Ok(())
}

fn sigmas(found: &CloudPose) -> (f64, f64) {
    let most = |from| {
        (from..from + 3)
            .map(|at| found.covariance[(at, at)])
            .fold(0.0, f64::max)
    };
    (f64::sqrt(most(0)), f64::sqrt(most(3)))
}

/// Wheels turn so much too far, and headings drift.
const SLIP: f64 = 0.1;
const DRIFT_RADPS: f64 = 5.0 / 60.0 / 180.0 * std::f64::consts::PI;

/// What a vehicle would measure that moved as the simulated one: none of it is the truth.
struct Errors {
    /// Odometry follows roll and pitch of the attitude sensor.
    is_3d: bool,
    begin: Option<RobotTime>,
    truth: Pose,
    odometry: Pose,
    noise: [NoiseStream; 2],
}

impl Errors {
    /// Odometry by wheels in the plane, and roll, pitch and yaw by an attitude sensor.
    fn apply(&mut self, stamp: RobotTime, truth: &Pose) -> (Pose, ImuSample) {
        let begin = *self.begin.get_or_insert(stamp);
        if begin == stamp {
            self.truth = *truth;
        }
        let step = self.truth.inv_mul(truth);
        self.truth = *truth;
        let drift_rad = DRIFT_RADPS * stamp.since(begin).as_secs_f64();
        // What is left of 0.1° where the average over 0.1 s is not taken later.
        let noise_deg = if self.is_3d { 0.03_f64 } else { 0.1 };
        let noise = self.noise.each_mut();
        let [roll_rad, pitch_rad] = noise.map(|noise| noise_deg.to_radians() * noise.normal());
        let attitude = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), drift_rad)
            * truth.rotation
            * UnitQuaternion::from_euler_angles(roll_rad, pitch_rad, 0.0);
        let along = if self.is_3d {
            attitude
        } else {
            pose::planar(0.0, 0.0, pose::yaw_rad(truth) + drift_rad).rotation
        };
        let way_m = along * Vector3::new(step.translation.vector.x * (1.0 + SLIP), 0.0, 0.0);
        self.odometry = Pose::from_parts((self.odometry.translation.vector + way_m).into(), along);
        let sample = ImuSample {
            orientation_xyzw: Some(attitude.coords.into()),
            angular_velocity_radps: [0.0; 3],
            linear_acceleration_mps2: [0.0; 3],
        };
        (self.odometry, sample)
    }
}

fn evaluate_world(world: &str, options: &HashMap<&str, &str>) -> Result<(), Failure> {
    let number = |key: &str, default: f64| {
        options
            .get(key)
            .map_or(Ok(default), |text| text.parse::<f64>())
    };
    let seed = number("seed", 1.0)? as u64;
    let world = World::load(world)?;
    let attitude = AttitudeSettings {
        time_offset: RobotDuration::ZERO,
        base_from_imu: UnitQuaternion::identity(),
        smoothing: RobotDuration::from_millis(100),
    };
    let (prior, motion) = match options.get("prior").copied().unwrap_or("none") {
        "attitude" => (PoseOrigin::Attitude(attitude), MotionPrior::Heading),
        "odometry" | "wheels" => (PoseOrigin::Odometry, MotionPrior::Full),
        _ => (PoseOrigin::Static, MotionPrior::None),
    };
    let is_3d = options.get("prior") == Some(&"wheels");
    let has_gravity = motion == MotionPrior::Heading || is_3d;
    let laser = options.get("laser").copied();
    let mut settings = settings(PoseOrigin::Scans {
        prior: Box::new(prior),
        scans: Box::new(ScanLocalizationSettings {
            sensor: SensorId(0),
            is_tilted: laser.is_some(),
            prior: motion,
            has_gravity,
            has_height: false,
            receiver: None,
            slam: SlamSettings::default(),
        }),
    });
    let sensor = &mut settings.sensors[0];
    let beams = &mut sensor.beams;
    let mount = |x_m, z_m, down_deg: f64| {
        let down = UnitQuaternion::from_euler_angles(0.0, down_deg.to_radians(), 0.0);
        Pose::from_parts(Translation3::new(x_m, 0.0, z_m), down)
    };
    match laser {
        Some("tilted") => {
            (beams.kind, beams.base_from_sensor) = (ScanKind::Beams, mount(0.25, 1.08, 7.5));
        }
        Some(_) => {
            (beams.kind, beams.base_from_sensor) = (ScanKind::Beams, mount(0.65, 0.65, 0.0));
            sensor.tilt = Some(TiltSettings {
                joint: "laser_tilt_joint".to_owned(),
                stream: None,
                scale: 1.0,
                offset_rad: 0.0,
                time_offset: RobotDuration::ZERO,
            });
        }
        None => {}
    }
    let mut registration = ScanRegistration::new(settings);
    let options = SimulationOptions {
        seed,
        duration_s: options
            .get("duration")
            .map(|text| text.parse())
            .transpose()?,
        ..SimulationOptions::default()
    };
    let mut source = SimulatedSource::new(&world, options)?;
    let mut errors = Errors {
        is_3d,
        begin: None,
        truth: Pose::identity(),
        odometry: Pose::identity(),
        noise: ["roll", "pitch"].map(|name| NoiseStream::new(seed, name)),
    };
    let (mut truths, mut out) = (BTreeMap::new(), Vec::new());
    let (mut alone, mut alone_ms, mut by_clouds) = (CloudMatcher::default(), 0.0, Vec::new());
    let (mut revolutions, mut longest_ms, mut total_ms) = (0, 0.0_f64, 0.0);
    let mut scans: Vec<RegisteredScan> = Vec::new();
    let take = |out: &mut Vec<RegistrationOutput>, scans: &mut Vec<RegisteredScan>| {
        for output in out.drain(..) {
            match output {
                RegistrationOutput::Scan(scan) => scans.push(scan),
                RegistrationOutput::Confidence(change) => println!("{change:?}"),
                _ => {}
            }
        }
    };
    while let Some(measurement) = source.next_measurement() {
        let Measurement {
            stamp,
            stream,
            frame,
            data,
        } = measurement;
        let mut push = |data| {
            let is_cloud = matches!(
                data,
                MeasurementData::Cloud(_) | MeasurementData::Scan { .. }
            );
            let begin_ms = used_ms();
            registration.push(
                Measurement {
                    stamp,
                    stream,
                    frame: frame.clone(),
                    data,
                },
                &mut out,
            );
            let ms = used_ms() - begin_ms;
            revolutions += i32::from(is_cloud);
            total_ms += ms;
            longest_ms = longest_ms.max(ms);
        };
        match data {
            MeasurementData::Odometry {
                child,
                odom_from_base,
            } => {
                truths.insert(stamp, odom_from_base);
                let (odometry, sample) = errors.apply(stamp, &odom_from_base);
                push(MeasurementData::Odometry {
                    child,
                    odom_from_base: odometry,
                });
                push(MeasurementData::Imu(sample));
            }
            MeasurementData::Cloud(cloud) => {
                if let (MotionPrior::None, Some((begin, end))) = (motion, cloud.span(stamp)) {
                    let revolution = Revolution {
                        cloud: &cloud,
                        stamp,
                        base_from_sensor: Pose::translation(0.0, 0.0, 0.8),
                        prior: [(begin, Pose::identity()), (end, Pose::identity())],
                        motion,
                        has_gravity,
                        is_stripe: false,
                    };
                    let begin_ms = used_ms();
                    by_clouds.push((begin, alone.push(&revolution, |_| false)));
                    alone_ms += used_ms() - begin_ms;
                }
                push(MeasurementData::Cloud(cloud));
            }
            MeasurementData::Scan { .. } | MeasurementData::Joints(_) => push(data),
            _ => {}
        }
        take(&mut out, &mut scans);
    }
    registration.finish(&mut out);
    take(&mut out, &mut scans);
    let map_from_odom = registration.map_from_odom();
    let report = registration.scan_localization().ok_or("no report")?;
    println!(
        "{revolutions} revolutions, {:.1} ms each, {longest_ms:.1} ms at most; full {}, along {}, odometry {}, lost {}, {:?}",
        total_ms / f64::from(revolutions),
        report.full,
        report.uncertain_along,
        report.odometry_only,
        report.lost,
        report.closures
    );
    println!(
        "odometry alone: off by {:.2} m at the end",
        error_of(&errors.truth, &errors.odometry, &truths)
    );
    let of_clouds = by_clouds
        .iter()
        .map(|(stamp, pose)| (*stamp, pose.odom_from_base));
    if let Some(text) = errors_text(of_clouds, &truths) {
        let undetermined = by_clouds
            .iter()
            .filter(|(_, pose)| !pose.is_determined())
            .count();
        let ms = alone_ms / by_clouds.len() as f64;
        println!("clouds alone: {text}; {ms:.1} ms each, {undetermined} not determined");
    }
    for (name, is_closed) in [("before closing", false), ("closed", true)] {
        let poses = scans.iter().filter_map(|scan| {
            let map = if is_closed {
                map_from_odom.at((0, scan.stamp))
            } else {
                Some(Pose::identity())
            };
            Some((scan.stamp, map? * scan.odom_from_base))
        });
        println!(
            "{name}: {}",
            errors_text(poses, &truths).unwrap_or_default()
        );
        let steps_m = seam_m(&scans, |scan| {
            if is_closed {
                map_from_odom.at((0, scan.stamp))
            } else {
                Some(Pose::identity())
            }
        });
        let share = |share: f64| steps_m[(share * (steps_m.len() - 1) as f64) as usize];
        if !steps_m.is_empty() {
            println!(
                "  seam: {} cells, median {:.3} m, 95 % {:.3} m",
                steps_m.len(),
                share(0.5),
                share(0.95)
            );
        }
    }
    Ok(())
}

/// Errors of poses, from where the first is.
fn errors_text(
    poses: impl Iterator<Item = (RobotTime, Pose)>,
    truths: &BTreeMap<RobotTime, Pose>,
) -> Option<String> {
    let mut first = None;
    let errors = poses.map(|(stamp, pose)| {
        let truth = truth_at(truths, stamp);
        let (pose_first, truth_first) = *first.get_or_insert((pose, truth));
        let (truth, found) = (truth_first.inv_mul(&truth), pose_first.inv_mul(&pose));
        let error_m = found.translation.vector - truth.translation.vector;
        let down = |pose: &Pose| pose.rotation.inverse() * Vector3::z();
        let tilt_deg = down(&truth).angle(&down(&found)).to_degrees();
        let turned_deg = pose::yaw_rad(&truth.inv_mul(&found)).to_degrees();
        [error_m.xy().norm(), error_m.z, tilt_deg, turned_deg]
    });
    let errors: Vec<_> = errors.collect();
    let end = errors.last()?;
    let most = |at: usize| {
        errors
            .iter()
            .map(|error| error[at].abs())
            .fold(0.0, f64::max)
    };
    Some(format!(
        "at the end {:.3} m in the plane, {:+.3} m in height, {:.2}° of tilt, {:+.2}° of heading; at most {:.3} m, {:.3} m, {:.2}°, {:.2}°",
        end[0],
        end[1],
        end[2],
        end[3],
        most(0),
        most(1),
        most(2),
        most(3)
    ))
}

fn error_of(truth: &Pose, odometry: &Pose, truths: &BTreeMap<RobotTime, Pose>) -> f64 {
    let start = truths
        .values()
        .next()
        .copied()
        .unwrap_or_else(Pose::identity);
    let turned = pose::planar(0.0, 0.0, pose::yaw_rad(&start));
    (turned.inv_mul(odometry).translation.vector - start.inv_mul(truth).translation.vector).norm()
}

fn truth_at(truths: &BTreeMap<RobotTime, Pose>, stamp: RobotTime) -> Pose {
    let (Some(before), Some(after)) = (
        truths.range(..=stamp).next_back(),
        truths.range(stamp..).next(),
    ) else {
        return Pose::identity();
    };
    let span_s = after.0.since(*before.0).as_secs_f64();
    let share = if span_s > 0.0 {
        stamp.since(*before.0).as_secs_f64() / span_s
    } else {
        0.0
    };
    before.1.lerp_slerp(after.1, share)
}

/// Differences of heights between the first 15 s and the last 15 s, of level cells of 0.2 m that both show, in increasing order.
fn seam_m(
    scans: &[RegisteredScan],
    map_from_odom: impl Fn(&RegisteredScan) -> Option<Pose>,
) -> Vec<f64> {
    let (Some(first), Some(last)) = (scans.first(), scans.last()) else {
        return Vec::new();
    };
    let mut cells: BTreeMap<(i64, i64), [Vec<f64>; 2]> = BTreeMap::new();
    for scan in scans {
        let part = match (
            scan.stamp.since(first.stamp).as_secs_f64(),
            last.stamp.since(scan.stamp).as_secs_f64(),
        ) {
            (begun, _) if begun < 15.0 => 0,
            (_, left) if left < 15.0 => 1,
            _ => continue,
        };
        let Some(map_from_odom) = map_from_odom(scan) else {
            continue;
        };
        let beams = scan.beams.iter();
        for beam in beams.filter(|beam| beam.outcome == BeamOutcome::Hit && beam.range_m < 10.0) {
            let point = map_from_odom * beam.end_in_odom;
            let cell = [point.x, point.y].map(|metres| (metres / 0.2).floor() as i64);
            cells.entry(cell.into()).or_default()[part].push(point.z);
        }
    }
    let level_m = |heights_m: &Vec<f64>| {
        let low = heights_m.iter().copied().fold(f64::INFINITY, f64::min);
        let high = heights_m.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let mean = heights_m.iter().sum::<f64>() / heights_m.len() as f64;
        (heights_m.len() >= 5 && high - low < 0.15).then_some(mean)
    };
    let steps = cells
        .values()
        .filter_map(|[a, b]| Some((level_m(a)? - level_m(b)?).abs()));
    let mut steps: Vec<_> = steps.collect();
    steps.sort_by(f64::total_cmp);
    steps
}

/// A vehicle with a lidar 0.8 m above the ground.
fn settings(origin: PoseOrigin) -> RegistrationSettings {
    RegistrationSettings {
        origin,
        base_frame: "base_link".into(),
        limits: InterpolationLimits {
            max_gap: RobotDuration::from_millis(500),
            max_extrapolation: RobotDuration::from_millis(100),
            jump: JumpLimit {
                slack_m: 1.0,
                speed_mps: 3.0,
            },
        },
        pose_history: RobotDuration::from_millis(10_000),
        max_pose_wait: RobotDuration::from_millis(100),
        max_queued: 256,
        pose_streams: PoseStreams::default(),
        sensors: vec![RangeSensorSettings {
            stream: None,
            beams: SensorSettings {
                id: SensorId(0),
                kind: ScanKind::Cloud,
                range_min_m: Some(0.5),
                range_max_m: Some(120.0),
                zero_range: ZeroRange::Invalid,
                time_offset: RobotDuration::ZERO,
                thin_m: 0.0,
                base_from_sensor: Pose::from_parts(
                    Translation3::new(0.0, 0.0, 0.8),
                    UnitQuaternion::identity(),
                ),
            },
            mount: MountOrigin::Configured,
            tilt: None,
        }],
        body: BodyBox {
            length_m: 0.99,
            width_m: 0.67,
            offset_m: 0.0,
            lowest_m: 0.0,
            highest_m: 0.9,
        },
        continuation: None,
    }
}

/// Time of the processor that this thread took.
fn used_ms() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let used_ns = text
        .split(' ')
        .next()
        .and_then(|used| used.parse::<f64>().ok());
    used_ns.unwrap_or(0.0) / 1e6
}
