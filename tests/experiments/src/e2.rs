//! E2 [LOD §5.2]: a bare floor is the reference plane.

use protocol::layer::LayerId;

use super::outcome::{Check, Outcome, Part, Spread};
use super::run::known_cells;
use super::session::{SEED, Session};
use super::terrain::agreement::{self, Agreement};
use super::terrain::sweep::Sweep;
use super::terrain::{self, TerrainWorld, obstacle_map};
use mapping::elevation::CellClass;

/// How far from the floor the height of a cell may be, metres.
const GROUND_M: f64 = 0.03;
/// What the beams sweep at least, in cells: 100 m².
const CELLS_MIN: f64 = 2_500.0;

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
    let floor = TerrainWorld::load("floor", None, session.rules())?;
    let plane = floor.plane_at(0.0);
    let sweep = Sweep::of(&floor, &plane, |_| true)?;
    let floors = session.for_each_seed("E2: floor", |seed| {
        let mut pipeline = floor.run(seed, 0.0)?.finish()?;
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
            agreement: Agreement::of(&floor, &plane, &map, &sweep),
        })
    })?;
    session.step("E2: pictures")?;
    let pipeline = floor.run(SEED, 0.0)?.finish()?;
    let mut pictures = terrain::maps(&pipeline, "e2", "floor")?;
    pictures.extend(terrain::elevation_of(&pipeline, "e2", "floor")?);
    Ok(Outcome {
        checks: checks(&floors),
        parts: vec![
            Part::text(include_str!("notes/e2.md")),
            Part::Pictures(pictures),
        ],
    })
}

fn checks(floors: &[Floor]) -> Vec<Check> {
    let farthest = Spread::over(floors, |floor| 100.0 * floor.farthest_m);
    let cells = Spread::count(floors, |floor| floor.cells);
    let mut checks = vec![
        Check::gate(
            "height farthest from the floor",
            farthest.text(1, " cm"),
            format!("within ± {:.0} cm", 100.0 * GROUND_M),
            // What is published is rounded to half a centimetre.
            farthest.most <= 100.0 * GROUND_M + 1e-3,
        ),
        Check::zero(
            "known cells that are not Free",
            Spread::count(floors, |floor| floor.not_free),
        ),
        Check::at_least("known cells", (cells, 0, ""), CELLS_MIN),
        Check::zero(
            "changes of the ground plane",
            Spread::count(floors, |floor| floor.events),
        ),
    ];
    let agreements = floors.iter().map(|floor| &floor.agreement);
    checks.extend(agreement::checks("floor", agreements));
    checks
}
