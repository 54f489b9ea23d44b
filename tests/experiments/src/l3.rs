//! L3 \[LRF\]: a recording with the poses of a motion-capture system, as the document's own.
//!
//! The recording is a file: scans of the laser and `geometry_msgs/PoseStamped` of the cameras, at their own rate,
//! which come later than what they are of.

use std::path::Path;

use recording::Selection;
use recording::writer::McapWriter;

use super::outcome::{Check, Outcome, Part, Spread, Table};
use super::pictures::Picture;
use super::rooms::{self, Confusion, Truth};
use super::run::{config_by, pipeline};
use super::session::Session;
use measurement::pose::Pose;
use measurement::time::RobotDuration;
use measurement::{Measurement, MeasurementData, Stream, StreamId};
use nalgebra::{Translation3, UnitQuaternion, Vector3};
use simulation::noise::NoiseStream;
use simulation::source::START;
use simulation::{Motion, SimulatedSource, SimulationOptions, World};

/// Poses a second, so that they and the ten scans a second share no stamps.
const RATE_HZ: f64 = 96.0;
/// From a moment until its pose is there, seconds: cameras, triangulation and network.
const DELAY_S: f64 = 0.03;
/// Standard deviations of a tracked marker plate: 1 mm, 0.1°.
const NOISE_M: f64 = 0.001;
const NOISE_DEG: f64 = 0.1;
/// As in L1: of all compared cells, and of those that must be free.
const AGREEMENT_MIN: f64 = 99.0;
const FREE_AGREEMENT_MIN: f64 = 99.9;
/// Asked of the settings that keep walls.
const OCCUPIED_AGREEMENT_MIN: f64 = 98.0;

/// Poses come from the recording, and the laser is where the simulated one is.
const MOCAP: [&str; 2] = [
    "localization.source=odometry",
    "sensors.laser.mount.x_m=0.16",
];
/// Seeing through a cell counts as much as a hit.
const EVEN: &str = "mapping.occupancy.p_free=0.4";

/// How a recording is made and mapped.
struct Case {
    label: &'static str,
    /// Poses are stamped when they come, not when they are of.
    stamped_late: bool,
    settings: &'static [&'static str],
}

const CASES: [Case; 4] = [
    Case {
        label: "pioneer preset",
        stamped_late: false,
        settings: &[],
    },
    Case {
        label: "p_free = 0.4",
        stamped_late: false,
        settings: &[EVEN],
    },
    Case {
        label: "p_free = 0.4, poses stamped 30 ms late",
        stamped_late: true,
        settings: &[EVEN],
    },
    Case {
        label: "the same, time_offset_s = 0.03",
        stamped_late: true,
        settings: &[EVEN, "sensors.laser.time_offset_s=0.03"],
    },
];

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let world = rooms::without_reflections()?;
    let truth = rooms::truth_of(&world)?;
    let mut table = Table::new(&[
        "mapped with",
        "agreement, %",
        "free, %",
        "occupied, %",
        "scans in the map",
    ]);
    let (mut outcome, mut pictures) = (Outcome::default(), Vec::new());
    for case in &CASES {
        let runs = session.for_each_seed(&format!("L3: {}", case.label), |seed| {
            let dir = tempfile::tempdir()?;
            let file = dir.path().join("mocap.mcap");
            record(&world, seed, case.stamped_late, &file)?;
            map(&file, &world, session, case, &truth)
        })?;
        if !case.stamped_late {
            pictures.extend(runs.first().map(|(.., picture)| picture.clone()));
        }
        let share = |figure: fn(&Confusion) -> f64| {
            Spread::over(&runs, |(confusion, ..)| 100.0 * figure(confusion))
        };
        let agreement = share(Confusion::agreement);
        let free = share(Confusion::free_agreement);
        let occupied = share(Confusion::occupied_agreement);
        let scans = Spread::over(&runs, |(_, scans, _)| *scans as f64);
        table.push([
            case.label.to_owned(),
            agreement.text(2, ""),
            free.text(2, ""),
            occupied.text(2, ""),
            scans.text(0, ""),
        ]);
        let what = |what: &str| format!("{}: {what}", case.label);
        match (case.stamped_late, case.settings) {
            (false, []) => outcome.checks.extend([
                Check::at_least(what("agreement"), (agreement, 2, " %"), AGREEMENT_MIN),
                Check::at_least(
                    what("free cells alone"),
                    (free, 2, " %"),
                    FREE_AGREEMENT_MIN,
                ),
                Check::shown(what("occupied cells alone"), occupied.text(2, " %")),
            ]),
            (false, _) => outcome.checks.push(Check::at_least(
                what("occupied cells alone"),
                (occupied, 2, " %"),
                OCCUPIED_AGREEMENT_MIN,
            )),
            (true, _) => outcome.checks.push(Check::shown(
                what("occupied cells alone"),
                occupied.text(2, " %"),
            )),
        }
    }
    outcome.parts = vec![
        Part::text(include_str!("notes/l3.md")),
        Part::Table(table),
        Part::text("Colours as in L1, seed 1:"),
        Part::Pictures(pictures),
    ];
    Ok(outcome)
}

/// Writes scans and poses in the order in which they come.
fn record(world: &World, seed: u64, stamped_late: bool, file: &Path) -> anyhow::Result<()> {
    let options = SimulationOptions {
        seed,
        ..SimulationOptions::default()
    };
    let mut source = SimulatedSource::new(world, options)?;
    let streams = source.streams().to_vec();
    let poses = Stream {
        name: "/mocap/pioneer/pose".to_owned(),
        type_name: "geometry_msgs/PoseStamped".to_owned(),
    };
    let motion = Motion::new(world);
    let mut noise = NoiseStream::new(seed, "experiments/mocap");
    let mut writer = McapWriter::create(file, Some(world.vehicle()))?;
    let mut number = 0;
    while let Some(measurement) = source.next_measurement() {
        let at_s = measurement.stamp.since(START).as_secs_f64();
        loop {
            let pose_s = f64::from(number) / RATE_HZ;
            if pose_s + DELAY_S > at_s {
                break;
            }
            number += 1;
            let stamp_s = pose_s + if stamped_late { DELAY_S } else { 0.0 };
            let pose = Measurement {
                stamp: START + RobotDuration::from_secs_f64(stamp_s),
                stream: StreamId(0),
                frame: "mocap".into(),
                data: MeasurementData::Odometry {
                    child: "base_link".into(),
                    odom_from_base: tracked(&motion.world_from_base(pose_s), &mut noise),
                },
            };
            writer.write(&poses, &pose)?;
        }
        if let (MeasurementData::Scan { .. }, Some(stream)) = (
            &measurement.data,
            streams.get(usize::from(measurement.stream.0)),
        ) {
            writer.write(stream, &measurement)?;
        }
    }
    Ok(writer.finish()?)
}

/// What the cameras make of a pose.
fn tracked(truth: &Pose, noise: &mut NoiseStream) -> Pose {
    let mut vector = |deviation: f64| Vector3::from_fn(|_, _| deviation * noise.normal());
    let shift = Translation3::from(vector(NOISE_M));
    let turn = UnitQuaternion::from_scaled_axis(vector(NOISE_DEG.to_radians()));
    Pose::from_parts(shift * truth.translation, truth.rotation * turn)
}

fn map(
    file: &Path,
    world: &World,
    session: &Session<'_>,
    case: &Case,
    truth: &Truth,
) -> anyhow::Result<(Confusion, u64, Picture)> {
    let mut reader = recording::open(file, Selection::All)?;
    let mut measurements = Vec::new();
    while let Some(measurement) = reader.next_measurement()? {
        measurements.push(measurement);
    }
    let streams: Vec<_> = reader
        .streams()
        .iter()
        .map(|known| known.stream.clone())
        .collect();
    let config = config_by(world, session.rules(), &[&MOCAP, case.settings].concat())?;
    let mut pipeline = pipeline(&config, &streams)?;
    for measurement in measurements {
        pipeline.push(measurement)?;
    }
    pipeline.finish()?;
    let store = pipeline.publisher().store();
    let name = if case.settings.is_empty() {
        "l3-preset"
    } else {
        "l3-even"
    };
    let picture = rooms::error_map(truth, &store, name, case.label);
    Ok((
        truth.compare(&store),
        pipeline.report().scans_mapped,
        picture,
    ))
}
