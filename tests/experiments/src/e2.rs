//! E2 [LOD §5.2]: a bare floor is the reference plane.

use protocol::layer::LayerId;

use super::ExperimentError;
use super::outcome::{Check, Outcome, Part};
use super::published::known_cells;
use super::session::{SEED, Session};
use super::spread::Spread;
use super::terrain::agreement::{self, Agreement};
use super::terrain::sweep::Sweep;
use super::terrain::{TerrainWorld, obstacle_map, views};
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

pub(super) fn run(session: &Session<'_>) -> Result<Outcome, ExperimentError> {
    let floor = TerrainWorld::load("floor", &[], None)?;
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
    let mut pictures = views::maps(&pipeline, "e2", "floor")?;
    pictures.extend(views::elevation_of(&pipeline, "e2", "floor")?);
    Ok(Outcome {
        checks: checks(&floors),
        parts: vec![
            Part::text(include_str!("notes/e2.md")),
            Part::Pictures(pictures),
        ],
    })
}

fn checks(floors: &[Floor]) -> Vec<Check> {
    let spread = |figure: &dyn Fn(&Floor) -> f64| Spread::of(floors.iter().map(figure));
    let farthest = spread(&|floor| 100.0 * floor.farthest_m);
    let not_free = spread(&|floor| floor.not_free as f64);
    let cells = spread(&|floor| floor.cells as f64);
    let events = spread(&|floor| floor.events as f64);
    let agreements: Vec<_> = floors.iter().map(|floor| floor.agreement.clone()).collect();
    let mut checks = vec![
        Check::gate(
            "height farthest from the floor",
            farthest.text(1, " cm"),
            format!("within ± {:.0} cm", 100.0 * GROUND_M),
            // What is published is rounded to half a centimetre.
            farthest.most <= 100.0 * GROUND_M + 1e-3,
        ),
        Check::gate(
            "known cells that are not Free",
            not_free.text(0, ""),
            "0",
            not_free.most == 0.0,
        ),
        Check::gate(
            "known cells",
            cells.text(0, ""),
            format!("≥ {CELLS_MIN}"),
            cells.least >= CELLS_MIN,
        ),
        Check::gate(
            "changes of the ground plane",
            events.text(0, ""),
            "0",
            events.most == 0.0,
        ),
    ];
    checks.extend(agreement::checks("floor", &agreements));
    checks
}
