//! H7 [HYB §8.1.2]: sonar and laser are placed in agreement: a face goes on below the waterline where it ends above.

use std::collections::BTreeMap;

use super::outcome::{Check, Outcome, Part, Spread, Table};
use super::pictures::Picture;
use super::run::{SimulatedRun, config_by};
use super::session::{SEED, Session};
use super::shores::WaterWorld;
use mapping::registered_scan::{BeamOutcome, RegisteredScan, SensorId};
use nalgebra::{Point3, Vector3};
use protocol::layer::LayerId;
use simulation::{SimulationOptions, World};

const WORLD: &str = include_str!("h7/quay.toml");
/// Order in the vehicle's configuration.
const LASER: SensorId = SensorId(0);
/// Hits farther from a face belong to something else, metres. More than any offset that is looked for.
const NEAR_M: f64 = 0.5;
/// Of the faces that much along x is looked at, metres: not their ends.
const ALONG_M: [f64; 2] = [-10.0, 18.0];
/// Heights of the laser's hits and of the sonar's, metres above the water: all that both see beside the waterline.
const ABOVE_M: [f64; 2] = [0.05, 2.0];
const BELOW_M: [f64; 2] = [-2.5, -0.05];
/// Length along a face over which hits are averaged, metres.
const STRETCH_M: f64 = 1.0;
/// Hits of either sensor on a stretch below which it is left out.
const HITS_MIN: usize = 20;
/// Greatest offset of a face, metres. A receiver good to 2 cm and an attitude good to 0.1° (1 cm at 7 m), at two times,
/// make 3 cm; a sixth of a voxel is the most that keeps both parts of a face in one row of voxels.
const OFFSET_MAX_M: f64 = 0.05;
/// Stretches that there must be.
const STRETCHES_MIN: f64 = 20.0;
/// How far the laser's mount is wrong for a check of the check, metres, and what must be found of it.
const WRONG_M: f64 = 0.2;
const WRONG_SETTING: &str = "sensors.laser.mount.y_m=0.2";
const WRONG_FOUND_MIN_M: f64 = 0.15;

/// A plane that goes on on both sides of the waterline.
struct Face {
    name: &'static str,
    /// On the waterline, and out of the solid; in the world.
    point: Point3<f64>,
    out: Vector3<f64>,
}

/// Offsets of one face in one drive, metres: of each stretch how much farther out the sonar has it than the laser.
type Offsets = Vec<f64>;

/// One drive, by face.
struct Drive {
    right: Vec<Offsets>,
    wrong: Vec<Offsets>,
}

fn faces() -> [Face; 2] {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    [
        Face {
            name: "quay wall, upright",
            point: Point3::new(0.0, 6.0, 0.0),
            out: Vector3::new(0.0, -1.0, 0.0),
        },
        Face {
            name: "revetment, 1 in 1",
            point: Point3::new(0.0, -6.0, 0.0),
            out: Vector3::new(0.0, half, half),
        },
    ]
}

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let quay = WaterWorld::of(World::parse("quay", WORLD)?, session.rules())?;
    let drives = session.for_each_seed("H7: quay", |seed| {
        let offsets = |settings: &[&str]| offsets(&quay, session, seed, settings);
        Ok(Drive {
            right: offsets(&[])?,
            wrong: offsets(&[WRONG_SETTING])?,
        })
    })?;
    session.step("H7: pictures")?;
    let pipeline = quay.run(SEED)?.finish()?;
    let store = pipeline.publisher().store();
    let picture = |layer: LayerId, name, caption| {
        let palette = layer.default_palette().fitted(0.0, 4.0);
        Picture::of_layer(&store, palette, None, name, caption)
    };
    let pictures = [
        picture(LayerId::Depth, "h7-depth", "depth")?,
        picture(LayerId::Cost, "h7-cost", "slope cost")?,
    ];
    Ok(Outcome {
        checks: checks(&drives),
        parts: vec![
            Part::text(include_str!("notes/h7.md")),
            Part::Table(table(&drives)),
            Part::Pictures(pictures.into_iter().flatten().collect()),
        ],
    })
}

fn offsets(
    quay: &WaterWorld,
    session: &Session<'_>,
    seed: u64,
    settings: &[&str],
) -> anyhow::Result<Vec<Offsets>> {
    let options = SimulationOptions {
        seed,
        ..SimulationOptions::default()
    };
    let config = config_by(&quay.world, session.rules(), settings)?;
    let mut run = SimulatedRun::new(&quay.world, options, &config)?;
    let faces = faces();
    // Of each face and stretch the distances of the laser's and of the sonar's hits.
    let mut hits: Vec<BTreeMap<i64, [Vec<f64>; 2]>> = vec![BTreeMap::new(); faces.len()];
    run.advance_with(run.duration_s(), |_, scan| {
        for (face, hits) in faces.iter().zip(&mut hits) {
            face.add(quay, scan, hits);
        }
    })?;
    let offsets = hits.into_iter().map(|stretches| {
        let stretches = stretches.into_values();
        let measured = stretches.filter(|hits| hits.iter().all(|hits| hits.len() >= HITS_MIN));
        let medians = measured.map(|hits| hits.map(|hits| Spread::of(hits).median));
        medians.map(|[laser, sonar]| sonar - laser).collect()
    });
    Ok(offsets.collect())
}

impl Face {
    fn add(
        &self,
        quay: &WaterWorld,
        scan: &RegisteredScan,
        stretches: &mut BTreeMap<i64, [Vec<f64>; 2]>,
    ) {
        let is_laser = scan.sensor == LASER;
        let heights_m = if is_laser { ABOVE_M } else { BELOW_M };
        let within = |value: f64, [least, most]: [f64; 2]| (least..most).contains(&value);
        let hits = scan.beams.iter();
        let hits = hits.filter(|beam| beam.outcome == BeamOutcome::Hit);
        for point in hits.map(|beam| quay.point_in_world(beam.end_in_odom)) {
            let away_m = (point - self.point).dot(&self.out);
            if away_m.abs() < NEAR_M && within(point.x, ALONG_M) && within(point.z, heights_m) {
                let stretch = (point.x / STRETCH_M).floor() as i64;
                stretches.entry(stretch).or_default()[usize::from(!is_laser)].push(away_m);
            }
        }
    }
}

fn checks(drives: &[Drive]) -> Vec<Check> {
    let mut checks = Vec::new();
    for (number, face) in faces().iter().enumerate() {
        let median = |offsets: &Offsets| Spread::of(offsets.iter().copied()).median;
        let of = |drive: &Drive| median(&drive.right[number]).abs();
        let wrong = |drive: &Drive| median(&drive.wrong[number]).abs();
        let name = face.name;
        checks.push(Check::at_most(
            format!("{name}: sonar's part off the laser's"),
            (Spread::over(drives, of), 3, " m"),
            OFFSET_MAX_M,
        ));
        checks.push(Check::at_least(
            format!("{name}: stretches of {STRETCH_M} m that both see"),
            (
                Spread::count(drives, |drive| drive.right[number].len()),
                0,
                "",
            ),
            STRETCHES_MIN,
        ));
        if number == 0 {
            checks.push(Check::at_least(
                format!("{name}: off with the laser's mount {WRONG_M} m wrong"),
                (Spread::over(drives, wrong), 3, " m"),
                WRONG_FOUND_MIN_M,
            ));
        }
    }
    checks
}

fn table(drives: &[Drive]) -> Table {
    let rows = faces().into_iter().enumerate().map(|(number, face)| {
        let all = drives.iter().flat_map(|drive| &drive.right[number]);
        (face.name, 3, Spread::of(all.copied()))
    });
    Table::of_spreads(rows)
}
