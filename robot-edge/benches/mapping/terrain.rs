//! A scan of 481 beams through placing, elevation and obstacle map: time by size of the window, and memory
//! beside that of the document.

use edge::config::{self, Config, WheelsAndAttitude};
use edge::runtime::localization_plan::{
    LocalizationPlan, PlannedSensor, poses_from_wheels, registration_settings,
};
use localization::registration::{MountOrigin, PoseStreams, RegistrationOutput, ScanRegistration};
use mapping::Mapper;
use mapping::registered_scan::SensorId;
use mapping::terrain::Terrain;
use measurement::Measurement;
use measurement::time::Monotonic;
use network::clock;
use simulation::{SimulatedSource, SimulationOptions, World};

use crate::rounds::{ROUNDS, Rounds};

/// Cells along an edge and their side in metres: three windows of 20 × 20 m, and [LOD] table 5.3's memory
/// of both maps in bytes.
const WINDOWS: [(u32, f64, u32); 3] = [
    (101, 0.2, 40_804 + 10_201),
    (201, 0.1, 161_604 + 40_401),
    (401, 0.05, 643_204 + 160_801),
];

/// One table, a row a world and window.
pub(crate) fn print() -> anyhow::Result<()> {
    println!(
        "elevation and obstacles: µs a scan of 481 beams, wall time, p50 and p99 over the run; median of rounds"
    );
    println!(
        "| world | cells | placing p50 | maps p50 | maps p99 | both p50 | both p99 | bytes of both maps | [LOD] table 5.3 |"
    );
    println!("| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |");
    for name in ["street", "hall", "floor"] {
        let world = World::load(name)?;
        let mut source = SimulatedSource::new(&world, SimulationOptions::default())?;
        let run: Vec<_> = std::iter::from_fn(|| source.next_measurement()).collect();
        // All sizes in each round, so that a slow spell of the machine meets each of them.
        let mut times: [[Rounds; 5]; 3] = Default::default();
        let mut bytes = [0; 3];
        for _ in 0..ROUNDS {
            for (size, &(cells, cell_m, _)) in WINDOWS.iter().enumerate() {
                let figures;
                (figures, bytes[size]) = measure(&holos(cells, cell_m)?, run.clone())?;
                for (rounds, figure) in times[size].iter_mut().zip(figures) {
                    rounds.add(figure);
                }
            }
        }
        for ((cells, _, document), (times, bytes)) in WINDOWS.iter().zip(times.iter().zip(bytes)) {
            let medians = times
                .each_ref()
                .map(|times| format!("{:.1}", times.median()));
            let medians = medians.join(" | ");
            println!("| {name} | {cells} × {cells} | {medians} | {bytes} | {document} |");
        }
    }
    Ok(())
}

fn holos(cells: u32, cell_m: f64) -> anyhow::Result<Config> {
    let settings = [
        format!("mapping.elevation.cells={cells}"),
        format!("mapping.elevation.cell_m={cell_m}"),
        format!("mapping.obstacle.cells={cells}"),
    ];
    let settings: Result<Vec<_>, _> = settings.iter().map(|setting| setting.parse()).collect();
    Ok(config::load("holos", &settings?)?)
}

/// One round: placing p50, maps p50 and p99, both p50 and p99, µs; and the memory of both maps, bytes.
fn measure(config: &Config, run: Vec<Measurement>) -> anyhow::Result<([f64; 5], usize)> {
    let sensors = WheelsAndAttitude::of(&config.sensors).map_err(|(encoders, imus)| {
        anyhow::anyhow!("{encoders} encoders, {imus} attitude sensors")
    })?;
    let origin = poses_from_wheels(config, &sensors);
    let placing = LocalizationPlan {
        origin,
        pose_streams: PoseStreams::default(),
        sensors: vec![PlannedSensor {
            id: SensorId(0),
            stream: None,
            mount: MountOrigin::Configured,
            tilt_stream: None,
            range_max_m: None,
        }],
    };
    let mut registration = ScanRegistration::new(registration_settings(config, &placing));
    let mut mapper = Mapper::new(
        &config.mapping,
        config.vehicle.shape(),
        &config.range_models(),
    );
    let (mut placing_us, mut maps_us, mut both_us) = (Vec::new(), Vec::new(), Vec::new());
    let mut registered = Vec::new();
    // Of everything since the last scan: poses are placed for the scans that need them.
    let mut placing = 0.0;
    for measurement in run {
        let started = clock::now();
        registration.push(measurement, &mut registered);
        placing += us_since(started);
        for registered in registered.drain(..) {
            if let RegistrationOutput::Scan(scan) = registered {
                let started = clock::now();
                mapper.integrate(&scan);
                let maps = us_since(started);
                placing_us.push(placing);
                maps_us.push(maps);
                both_us.push(placing + maps);
                placing = 0.0;
            }
        }
    }
    let [placing, maps, both] = [placing_us, maps_us, both_us].map(Rounds::from_iter);
    let figures = [
        placing.quantile(0.5),
        maps.quantile(0.5),
        maps.quantile(0.99),
        both.quantile(0.5),
        both.quantile(0.99),
    ];
    Ok((figures, mapper.terrain().map_or(0, Terrain::bytes)))
}

fn us_since(started: Monotonic) -> f64 {
    1e6 * clock::elapsed(started).as_secs_f64()
}
