//! P1: poses from scans on circles, where odometry drifts.

use std::cell::RefCell;
use std::rc::Rc;

use anyhow::Context as _;
use nalgebra::{Point2, Point3};
use protocol::layer::LayerId;

use super::outcome::{Check, Outcome, Part, Spread};
use super::pictures::Picture;
use super::run::SimulatedRun;
use super::session::{Rules, SEED, Session};
use super::terrain::{self, TerrainWorld, changed};
use edge::runtime::Pipeline;
use mapping::grid::CellIndex;
use measurement::pose::{self, Pose};
use measurement::time::RobotTime;
use measurement::{Measurement, MeasurementData};
use simulation::attitude::Attitude;
use simulation::source::START;
use simulation::{Motion, SimulationOptions, World};

const WORLD: &str = include_str!("p1/circles.toml");

/// Share by which wheels turn farther than the way, and drift of the heading.
const SLIP: f64 = 0.1;
const YAW_DRIFT_RADPS: f64 = 5.0 * std::f64::consts::PI / 180.0 / 60.0;
const END_MAX_CM: f64 = 10.0;
const HEIGHT_MAX_CM: f64 = 5.0;
/// Heights are compared up to here from the way, and where the truth within a cell differs by no more, metres.
const ASIDE_M: f64 = 0.6;
const EVEN_M: f64 = 0.06;

/// As the simulated vehicles have their sensors.
const SETTINGS: [&str; 2] = [
    "localization.source=scan+wheels",
    "sensors.laser.mount.x_m=0.16",
];

/// A laser that is tilted maps heights alone.
const TILTED: [&str; 2] = [
    "localization.source=scan+wheels",
    "mapping.elevation.enabled=true",
];

/// Label, preset, settings, and whether it maps walls, and heights.
const VEHICLES: [(&str, &str, &[&str], [bool; 2]); 3] = [
    ("planar laser", "pioneer", &SETTINGS, [true, false]),
    ("tilting laser", "introbot", &TILTED, [false, true]),
    ("16 rings", "lidar16", SETTINGS.split_at(1).0, [true, true]),
];

/// Odometry whose wheels slip and whose heading drifts.
#[derive(Default)]
struct DriftingOdometry {
    /// Stamp, true pose, and pose as it is said.
    last: Option<(RobotTime, Pose, Pose)>,
}

impl DriftingOdometry {
    fn disturb(&mut self, measurement: &mut Measurement) {
        let stamp = measurement.stamp;
        let (MeasurementData::Transform {
            parent_from_child: pose,
            is_static: false,
            ..
        }
        | MeasurementData::Odometry {
            odom_from_base: pose,
            ..
        }) = &mut measurement.data
        else {
            return;
        };
        let truth = *pose;
        let (before, true_before, said_before) = self.last.unwrap_or((stamp, truth, truth));
        let mut step = true_before.inv_mul(&truth);
        step.translation.vector *= 1.0 + SLIP;
        let mut said = said_before * step;
        // Roll and pitch are those of an attitude sensor.
        let drift_rad = YAW_DRIFT_RADPS * stamp.since(before).as_secs_f64();
        said.rotation = Attitude {
            yaw_rad: Attitude::of(&said.rotation).yaw_rad + drift_rad,
            ..Attitude::of(&truth.rotation)
        }
        .rotation();
        *pose = said;
        self.last = Some((stamp, truth, said));
    }
}

/// What a drive gave.
struct Drive {
    /// Error of the last pose by the map, and by odometry alone, metres.
    end_m: f64,
    odometry_m: f64,
    yaw_deg: f64,
    closures: usize,
    /// Errors of heights on the way.
    heights_m: Vec<f64>,
}

/// The maps of a drive, and its error by odometry at the end, metres.
fn mapped(world: &World, settings: &[&str], seed: u64) -> anyhow::Result<(Pipeline, f64)> {
    let options = SimulationOptions {
        seed,
        ..SimulationOptions::default()
    };
    let odometry = Rc::new(RefCell::new(DriftingOdometry::default()));
    let drifting = Rc::clone(&odometry);
    let run = SimulatedRun::with_settings(world, options, settings)?
        .with_disturbance(move |measurement| drifting.borrow_mut().disturb(measurement));
    let pipeline = run.finish()?;
    let last = odometry.borrow().last;
    let (_, truth, said) = last.context("the vehicle has no odometry")?;
    let off_m = (truth.translation.vector - said.translation.vector).norm();
    Ok((pipeline, off_m))
}

impl Drive {
    fn of(
        world: &World,
        settings: &[&str],
        heights: Option<&TerrainWorld>,
        seed: u64,
    ) -> anyhow::Result<Self> {
        let (pipeline, odometry_m) = mapped(world, settings, seed)?;
        let registration = pipeline.registration();
        let (stamp, odom_from_base) = registration.newest_pose().context("no pose was found")?;
        let truth = Motion::new(world).world_from_base(stamp.since(START).as_secs_f64());
        let off = truth.inv_mul(&(registration.map_from_odom().newest() * odom_from_base));
        let scans = registration.scan_localization().unwrap_or_default();
        Ok(Self {
            end_m: off.translation.vector.norm(),
            yaw_deg: pose::yaw_rad(&off).abs().to_degrees(),
            odometry_m,
            closures: scans.closures.added as usize,
            heights_m: heights
                .map(|world| height_errors_m(world, &pipeline))
                .unwrap_or_default(),
        })
    }
}

/// Errors of heights on the way, metres.
fn height_errors_m(world: &TerrainWorld, pipeline: &Pipeline) -> Vec<f64> {
    let Some((terrain, plane)) = pipeline
        .mapper()
        .terrain()
        .and_then(|terrain| Some((terrain, terrain.ground_plane()?)))
    else {
        return Vec::new();
    };
    let path = world.world.path();
    let steps = (path.duration_s() / 0.1) as u32;
    let way: Vec<_> = (0..steps)
        .map(|step| path.planar_pose(0.1 * f64::from(step)).position_m)
        .collect();
    let errors = world.heights().iter().filter_map(|(cell, truth)| {
        let [x, y] = world.centre_m(cell);
        let is_near = way
            .iter()
            .any(|at| (at - Point2::new(x, y)).norm() < ASIDE_M);
        if !is_near || truth.max_m - truth.min_m > EVEN_M {
            return None;
        }
        let index = CellIndex::containing(Point2::new(x, y), world.cell_m());
        let mean_m = terrain.elevation().grid().get(index)?.mean_m()?;
        let height_m = 0.5 * (truth.min_m + truth.max_m);
        let true_m = plane.height_m(&Point3::new(x, y, height_m));
        Some((f64::from(mean_m) - true_m).abs())
    });
    errors.collect()
}

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let mut outcome = Outcome::default();
    if session.rules() == Rules::Document {
        return Ok(outcome);
    }
    outcome.parts.push(Part::text(include_str!("notes/p1.md")));
    for (label, vehicle, settings, [has_walls, has_heights]) in VEHICLES {
        let text = changed(WORLD, &[("\"lidar16\"", &format!("\"{vehicle}\""))])?;
        let world = World::parse("circles", &text)?;
        let heights = has_heights
            .then(|| TerrainWorld::new(world.clone(), None, Rules::Own, &[]))
            .transpose()?;
        let drives = session.for_each_seed(&format!("P1: {label}"), |seed| {
            Drive::of(&world, settings, heights.as_ref(), seed)
        })?;
        let what = |what: &str| format!("{label}: {what}");
        let cm =
            |figure: fn(&Drive) -> f64| Spread::over(&drives, move |drive| 100.0 * figure(drive));
        outcome.checks.extend([
            Check::shown(
                what("error of odometry at the end"),
                cm(|drive| drive.odometry_m).text(0, " cm"),
            ),
            Check::at_most(
                what("error at the end"),
                (cm(|drive| drive.end_m), 1, " cm"),
                END_MAX_CM,
            ),
            Check::shown(
                what("of its heading"),
                Spread::over(&drives, |drive| drive.yaw_deg).text(2, "°"),
            ),
            Check::shown(
                what("closures"),
                Spread::count(&drives, |drive| drive.closures).text(0, ""),
            ),
        ]);
        if heights.is_some() {
            let most = |drive: &Drive| drive.heights_m.iter().copied().fold(0.0, f64::max);
            let rms = |drive: &Drive| {
                let squares = drive.heights_m.iter().map(|m| m * m).sum::<f64>();
                libm::sqrt(squares / drive.heights_m.len() as f64)
            };
            outcome.checks.extend([
                Check::at_most(
                    what("error of heights on the way, greatest"),
                    (cm(most), 1, " cm"),
                    HEIGHT_MAX_CM,
                ),
                Check::shown(what("rms"), cm(rms).text(1, " cm")),
                Check::shown(
                    what("heights"),
                    Spread::count(&drives, |drive| drive.heights_m.len()).text(0, ""),
                ),
            ]);
        }
        session.step("P1: pictures")?;
        let (pipeline, _) = mapped(&world, settings, SEED)?;
        let vehicle_m = pipeline.mapper().vehicle_in_odom();
        if has_walls {
            let picture = Picture::of_layer(
                &pipeline.publisher().store(),
                LayerId::Occupancy.default_palette(),
                Some([vehicle_m.x, vehicle_m.y]),
                &format!("p1-{vehicle}"),
                label,
            )?;
            let pictures = picture.into_iter().collect();
            outcome.parts.push(Part::Pictures(pictures));
        }
        if has_heights {
            let maps = terrain::maps(&pipeline, &format!("p1-{vehicle}"), label)?;
            outcome.parts.push(Part::Pictures(maps));
        }
    }
    Ok(outcome)
}
