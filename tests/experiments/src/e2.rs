//! E2 [LOD §5.2]: a bare floor is the reference plane.

use protocol::layer::{LayerId, Scheme};

use super::outcome::{Check, Outcome, Part, Spread};
use super::run::known_cells;
use super::session::{SEED, Session};
use super::terrain::agreement::{self, Agreement};
use super::terrain::sweep::Sweep;
use super::terrain::{self, TerrainWorld, obstacle_map};
use mapping::elevation::CellClass;
use simulation::World;

const FLOOR: &str = include_str!("../../../robot-edge/simulation/worlds/floor.toml");
/// The document's robot stands: 1 mm in 5 s.
const STANDING: [(&str, &str); 2] = [
    (
        "waypoints = [{ x_m = 6.0, y_m = 0.0 }, { x_m = 6.0, y_m = 5.0 }]",
        "waypoints = [{ x_m = 0.001, y_m = 0.0 }]",
    ),
    ("speed_mps = 0.5", "speed_mps = 0.0002"),
];
/// And its laser looks to 45° on either side, in steps of 0.25°.
const BEAMS: u32 = 361;

/// A drive, and what is asked of its maps.
struct Scene {
    floor: TerrainWorld,
    /// Before each label of its own.
    label: &'static str,
    /// Label of the comparison with the truth.
    map: &'static str,
    name: &'static str,
    heights: Scheme,
    /// How far from the floor the height of a cell may be, metres.
    ground_m: f64,
    /// What the beams sweep at least, in cells.
    cells_min: f64,
}

/// One map.
struct Floor {
    /// Greatest distance of a cell's height from the floor, metres.
    farthest_m: f64,
    cells: usize,
    not_free: usize,
    events: usize,
    agreement: Agreement,
}

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let mut outcome = Outcome::default();
    outcome.parts.push(Part::text(include_str!("notes/e2.md")));
    let mut standing = World::parse("floor, standing", &terrain::changed(FLOOR, &STANDING)?)?;
    let laser = &mut standing.simulated_vehicle_mut().laser.planar;
    laser.beams = BEAMS;
    laser.angle_min_rad = -0.5 * (BEAMS - 1) as f32 * laser.angle_increment_rad;
    for scene in [
        Scene {
            floor: TerrainWorld::load("floor", None, session.rules())?,
            label: "",
            map: "floor",
            name: "e2",
            heights: Scheme::GroundPlane,
            ground_m: 0.03,
            // 100 m².
            cells_min: 2_500.0,
        },
        Scene {
            floor: TerrainWorld::new(standing, None, session.rules(), &[])?,
            label: "as the document stood, 90°: ",
            map: "as the document stood, 90°",
            name: "e2-standing",
            heights: Scheme::GroundPlane6,
            ground_m: 0.06,
            // A line 16.5 m long.
            cells_min: 75.0,
        },
    ] {
        scene.run(session, &mut outcome)?;
    }
    Ok(outcome)
}

impl Scene {
    fn run(&self, session: &Session<'_>, outcome: &mut Outcome) -> anyhow::Result<()> {
        let plane = self.floor.plane_at(0.0);
        let sweep = Sweep::of(&self.floor, &plane, |_| true)?;
        let floors = session.for_each_seed(&format!("E2: {}", self.map), |seed| {
            let mut pipeline = self.floor.run(seed, 0.0)?.finish()?;
            let events = pipeline.take_map_events().len();
            let store = pipeline.publisher().store();
            let heights = known_cells(&store, LayerId::Elevation)
                .filter_map(|(_, code)| LayerId::Elevation.quantisation().decode(code));
            let map = obstacle_map(&store);
            let not_free = map.values().filter(|class| **class != CellClass::Free);
            Ok(Floor {
                farthest_m: heights.fold(0.0, |most, height| f64::from(height.abs()).max(most)),
                cells: map.len(),
                not_free: not_free.count(),
                events,
                agreement: Agreement::of(&self.floor, &plane, &map, &sweep),
            })
        })?;
        outcome.checks.extend(self.checks(&floors));
        session.step("E2: pictures")?;
        let pipeline = self.floor.run(SEED, 0.0)?.finish()?;
        let mut pictures = terrain::maps_in(self.heights, &pipeline, self.name, self.map)?;
        pictures.extend(terrain::elevation_of(&pipeline, self.name, self.map)?);
        outcome.parts.push(Part::Pictures(pictures));
        Ok(())
    }

    fn checks(&self, floors: &[Floor]) -> Vec<Check> {
        let label = |what: &str| format!("{}{what}", self.label);
        let farthest = Spread::over(floors, |floor| 100.0 * floor.farthest_m);
        let cells = Spread::count(floors, |floor| floor.cells);
        let mut checks = vec![
            Check::gate(
                label("height farthest from the floor"),
                farthest.text(1, " cm"),
                format!("within ± {:.0} cm", 100.0 * self.ground_m),
                // What is published is rounded to half a centimetre.
                farthest.most <= 100.0 * self.ground_m + 1e-3,
            ),
            Check::zero(
                label("known cells that are not Free"),
                Spread::count(floors, |floor| floor.not_free),
            ),
            Check::at_least(label("known cells"), (cells, 0, ""), self.cells_min),
            Check::zero(
                label("changes of the ground plane"),
                Spread::count(floors, |floor| floor.events),
            ),
        ];
        let agreements = floors.iter().map(|floor| &floor.agreement);
        checks.extend(agreement::checks(self.map, agreements));
        checks
    }
}
