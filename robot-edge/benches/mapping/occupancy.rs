//! Placing beams and the occupancy update alone: posed scans in memory, nothing published.

use mapping::occupancy_grid::OccupancyGrid;
use mapping::registered_scan::{BeamOutcome, RegisteredScan};
use mapping::scan_marks::{FixedPoint, RayWalk};

use crate::CELLS_M;
use crate::recordings::{self, ACES, CLINIC, Prepared, ROOMS, generic2d, hits, register};
use crate::rounds::{ROUNDS, Rounds, timed};

/// One table, a row a recording.
pub(crate) fn print() -> anyhow::Result<()> {
    println!("placing and occupancy: million beams per second, of beams that hit");
    println!(
        "| recording | beams | placing | update, 0.10 m | update, 0.05 m | time at 0.05 m over 0.10 m \
         | cells a beam, 0.10 m | ns a cell, 0.10 m and 0.05 m |"
    );
    println!("| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |");
    for name in [ROOMS, ACES, CLINIC] {
        if let Some(path) = recordings::find(name) {
            print_row(name, &Prepared::read(&path)?)?;
        }
    }
    Ok(())
}

fn print_row(name: &str, prepared: &Prepared) -> anyhow::Result<()> {
    let scans = prepared.registered_scans();
    let mut placing_s = Rounds::default();
    let mut update_s = [Rounds::default(), Rounds::default()];
    let mut ratio = Rounds::default();
    for _ in 0..ROUNDS {
        let measurements = prepared.measurements();
        let (registered, time_s) = timed(|| register(prepared.registration(), measurements));
        anyhow::ensure!(
            registered == scans,
            "{name}: placed otherwise in another round"
        );
        placing_s.add(time_s);
        // Both sizes in each round, so that a slow spell of the machine meets both.
        let mut of_round = [0.0; 2];
        for (size, &cell_m) in CELLS_M.iter().enumerate() {
            let mut grid = OccupancyGrid::new(&generic2d(cell_m)?.mapping.occupancy);
            let (hits_marked, time_s) = timed(|| {
                scans
                    .iter()
                    .map(|scan| grid.integrate(scan).hits as usize)
                    .sum::<usize>()
            });
            anyhow::ensure!(hits_marked == hits(&scans), "{name}: beams were refused");
            update_s[size].add(time_s);
            of_round[size] = time_s;
        }
        ratio.add(of_round[1] / of_round[0]);
    }
    let beams = hits(&scans) as f64;
    let rate = |secs: &Rounds| secs.map(|secs| beams / secs / 1e6);
    let crossed = CELLS_M.map(|cell_m| cells_crossed(&scans, cell_m) as f64);
    let ns_a_cell = |size: usize| 1e9 * update_s[size].median() / crossed[size];
    println!(
        "| {name} | {beams} | {:.1} | {:.2} | {:.2} | {ratio:.2} | {:.0} | {:.2}, {:.2} |",
        rate(&placing_s),
        rate(&update_s[0]),
        rate(&update_s[1]),
        crossed[0] / beams,
        ns_a_cell(0),
        ns_a_cell(1),
    );
    Ok(())
}

/// Steps from cell to cell that all hits of `scans` take, their ends included.
fn cells_crossed(scans: &[RegisteredScan], cell_m: f64) -> u64 {
    let hits = scans
        .iter()
        .flat_map(|scan| &scan.beams)
        .filter(|beam| beam.outcome == BeamOutcome::Hit);
    let ends = hits.filter_map(|beam| {
        let (origin, end) = (beam.origin_in_odom, beam.end_in_odom);
        FixedPoint::from_metres(origin.x, origin.y, cell_m)
            .zip(FixedPoint::from_metres(end.x, end.y, cell_m))
    });
    ends.map(|(start, end)| u64::from(RayWalk::new(start, end).steps) + 1)
        .sum()
}
