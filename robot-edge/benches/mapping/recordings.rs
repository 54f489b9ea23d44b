//! Which recordings are measured, what reading them costs, and what the pipeline sees of them: measurements in stamp order, and
//! posed scans.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use edge::config::{self, Config};
use edge::survey::Survey;
use localization::beam_projection::ZeroRange;
use localization::beam_projection::{BodyBox, SensorSettings};
use localization::pose_buffer::InterpolationLimits;
use localization::pose_buffer::JumpLimit;
use localization::registration::{
    MountOrigin, PoseOrigin, PoseStreams, RangeSensorSettings, RegistrationOutput,
    RegistrationSettings, ScanRegistration,
};
use mapping::registered_scan::{BeamOutcome, RegisteredScan, ScanKind, SensorId};
use measurement::pose::Pose;
use measurement::time::RobotDuration;
use measurement::{Measurement, MeasurementData};
use recording::time_sequencer::{Ordered, TimeSequencer};
use recording::{self, Selection};

use crate::rounds::{ROUNDS, Rounds, timed};

/// Small, and always there.
pub(crate) const ROOMS: &str = "rooms.mcap";
/// A raw log of a SICK laser indoors: 7374 scans of 180 beams.
pub(crate) const ACES: &str = "carmen/aces.clf";
/// The longest way, 1.4 km, and the longest beams, up to 80 m: 6917 scans of 180.
pub(crate) const CLINIC: &str = "carmen/fr-clinic_robotlaser.clf";
/// The scans of a CARMEN log as ROS 2 messages.
pub(crate) const INTEL_MCAP: &str = "mcap/intel_corrected.mcap";
/// A ROS 1 bag.
pub(crate) const TWO_LASERS: &str = "rosbag1/two_lasers.bag";

/// The path of a recording; `None`, said aloud, where it is not on this machine.
pub(crate) fn find(name: &str) -> Option<PathBuf> {
    let path = if name == ROOMS {
        PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../recordings")).join(name)
    } else {
        let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data");
        let root = std::env::var_os("FORESHORE_DATA").map_or_else(|| beside.into(), PathBuf::from);
        root.join(name)
    };
    let found = path.is_file().then_some(path);
    if found.is_none() {
        println!("skipped: {name} is not on this machine");
    }
    found
}

/// One table, a row a recording.
pub(crate) fn print_reading() -> anyhow::Result<()> {
    println!("reading: every message decoded, in file order");
    println!("| recording | scans | MB/s | scans/s |");
    println!("| --- | ---: | ---: | ---: |");
    for name in [ROOMS, ACES, CLINIC, INTEL_MCAP, TWO_LASERS] {
        let Some(path) = find(name) else {
            continue;
        };
        let megabytes = path.metadata()?.len() as f64 / 1e6;
        let (mut secs, mut scans) = (Rounds::default(), 0);
        for _ in 0..ROUNDS {
            let (read, time_s) = timed(|| {
                let mut reader = recording::open(&path, Selection::All)?;
                let mut scans = 0;
                while let Some(measurement) = reader.next_measurement()? {
                    scans += usize::from(matches!(measurement.data, MeasurementData::Scan { .. }));
                }
                anyhow::Ok(scans)
            });
            scans = read?;
            secs.add(time_s);
        }
        println!(
            "| {name} | {scans} | {:.0} | {:.0} |",
            secs.map(|secs| megabytes / secs),
            secs.map(|secs| scans as f64 / secs)
        );
    }
    Ok(())
}

/// What `replay` would hand to its placer, in memory.
pub(crate) struct Prepared {
    measurements: Vec<Measurement>,
    settings: RegistrationSettings,
}

/// The configuration that `replay` takes where a recording names no vehicle, with cells of `cell_m`.
pub(crate) fn generic2d(cell_m: f64) -> anyhow::Result<Config> {
    let mut config = config::load("generic2d", &[])?;
    config.mapping.occupancy.cell_m = cell_m;
    Ok(config)
}

impl Prepared {
    /// Reads the only laser of the recording at `path` and the poses for it.
    pub(crate) fn read(path: &Path) -> anyhow::Result<Self> {
        let survey = Survey::of(path, None)?;
        let (stream, scans) = survey.scans.first().context("no scans")?;
        let laser = &survey.stream(*stream).context("no stream")?.stream.name;
        let (origin, selection) = if scans.has_own_poses {
            (PoseOrigin::Log, Selection::Named(vec![laser.clone()]))
        } else {
            let fixed_frame = "odom".into();
            (PoseOrigin::Tf { fixed_frame }, Selection::All)
        };
        let mut reader = recording::open(path, selection)?;
        let mut order = TimeSequencer::default();
        let mut measurements = Vec::new();
        while let Some(measurement) = reader.next_measurement()? {
            order.push(measurement);
        }
        order.finish();
        while let Some(item) = order.pop() {
            match item {
                Ordered::Measurement(measurement) => measurements.push(measurement),
                Ordered::ClockReset { .. } => anyhow::bail!("its clock goes back"),
            }
        }
        let config = generic2d(0.1)?;
        let (seconds, from) = (RobotDuration::from_secs_f64, &config.localization);
        let settings = RegistrationSettings {
            origin,
            base_frame: from.base_frame.as_str().into(),
            limits: InterpolationLimits {
                max_gap: seconds(from.max_gap_s),
                max_extrapolation: seconds(from.max_extrapolation_s),
                jump: JumpLimit {
                    slack_m: from.jump_m,
                    speed_mps: 3.0 * config.vehicle.max_speed_mps,
                },
            },
            pose_history: seconds(from.buffer_s),
            max_pose_wait: seconds(from.max_pose_wait_s),
            continuation: None,
            max_queued: from.max_waiting_scans,
            pose_streams: PoseStreams::default(),
            sensors: vec![RangeSensorSettings {
                stream: None,
                beams: SensorSettings {
                    id: SensorId(0),
                    kind: ScanKind::Beams,
                    range_min_m: None,
                    range_max_m: scans.inferred_miss_range_m(),
                    zero_range: ZeroRange::Invalid,
                    time_offset: RobotDuration::ZERO,
                    thin_m: 0.0,
                    base_from_sensor: Pose::identity(),
                },
                mount: MountOrigin::Tree,
                tilt: None,
            }],
            body: BodyBox {
                length_m: config.vehicle.length_m,
                width_m: config.vehicle.width_m,
                offset_m: config.vehicle.footprint_offset_m,
                lowest_m: config.vehicle.bottom_z_m,
                highest_m: config.vehicle.bottom_z_m + config.vehicle.height_m,
            },
        };
        Ok(Self {
            measurements,
            settings,
        })
    }

    /// The measurements, to be consumed by [`register`].
    pub(crate) fn measurements(&self) -> Vec<Measurement> {
        self.measurements.clone()
    }

    /// A placer that has seen nothing.
    pub(crate) fn registration(&self) -> ScanRegistration {
        ScanRegistration::new(self.settings.clone())
    }

    /// All scans, placed.
    pub(crate) fn registered_scans(&self) -> Vec<RegisteredScan> {
        register(self.registration(), self.measurements())
    }
}

/// Places every scan.
pub(crate) fn register(
    mut registration: ScanRegistration,
    measurements: Vec<Measurement>,
) -> Vec<RegisteredScan> {
    let mut registered = Vec::new();
    for measurement in measurements {
        registration.push(measurement, &mut registered);
    }
    registration.finish(&mut registered);
    let scan = |registered| match registered {
        RegistrationOutput::Scan(scan) => Some(scan),
        RegistrationOutput::Jump(_)
        | RegistrationOutput::Corrected(_)
        | RegistrationOutput::Confidence(_) => None,
    };
    registered.into_iter().filter_map(scan).collect()
}

/// The beams of `scans` that mark cells: hits, as the preset lets a miss say nothing.
pub(crate) fn hits(scans: &[RegisteredScan]) -> usize {
    let beams = scans.iter().flat_map(|scan| &scan.beams);
    beams
        .filter(|beam| beam.outcome == BeamOutcome::Hit)
        .count()
}
