//! Publishing, the tile codec on the tiles that a recording publishes, and memory.

use anyhow::Context as _;
use edge::publishing::publisher::Publisher;
use mapping::Mapper;
use mapping::registered_scan::RegisteredScan;
use measurement::time::{RobotDuration, RobotTime};
use protocol::layer::LayerId;
use protocol::tile::BootId;
use protocol::tile::codec;

use crate::CELLS_M;
use crate::recordings::{self, ACES, Prepared, ROOMS, generic2d};
use crate::rounds::{ROUNDS, Rounds, timed};

/// Two tables, a row a recording and cell size: what tiles cost, and what memory the map takes.
pub(crate) fn print() -> anyhow::Result<()> {
    let mut runs = Vec::new();
    for name in [ROOMS, ACES] {
        if let Some(path) = recordings::find(name) {
            let scans = Prepared::read(&path)?.registered_scans();
            for cell_m in CELLS_M {
                runs.push((format!("{name}, {cell_m:.2} m"), Run::of(&scans, cell_m)?));
            }
        }
    }
    println!("tiles: every version of every tile, published once a second of the data");
    println!(
        "| recording | tiles | bytes a tile | 4 bytes a cell over that | publish, µs a tile \
         | encode, µs: median, 99 % | decode, µs: median, 99 % |"
    );
    println!("| --- | ---: | ---: | ---: | ---: | ---: | ---: |");
    for (name, run) in &runs {
        println!(
            "| {name} | {} | {:.0} | {:.1} | {:.2} | {:.1}, {:.1} | {:.1}, {:.1} |",
            run.tiles,
            run.encoded_bytes as f64 / run.tiles as f64,
            run.raw_bytes as f64 / run.encoded_bytes as f64,
            run.publish_s.map(|secs| 1e6 * secs / run.tiles as f64),
            run.encode_us.quantile(0.5),
            run.encode_us.quantile(0.99),
            run.decode_us.quantile(0.5),
            run.decode_us.quantile(0.99),
        );
    }
    println!();
    println!("memory at the end: bytes per square metre of known cells");
    println!("| recording | mapped, m² | grid | scratch of the scan | tile store |");
    println!("| --- | ---: | ---: | ---: | ---: |");
    for (name, run) in &runs {
        let per_m2 = |bytes: usize| bytes as f64 / run.known_m2;
        println!(
            "| {name} | {:.0} | {:.0} ({:.2} MB) | {:.0} ({:.2} MB) | {:.0} ({:.2} MB) |",
            run.known_m2,
            per_m2(run.grid_bytes),
            run.grid_bytes as f64 / 1e6,
            per_m2(run.scratch_bytes),
            run.scratch_bytes as f64 / 1e6,
            per_m2(run.store_bytes),
            run.store_bytes as f64 / 1e6,
        );
    }
    Ok(())
}

/// What mapping a recording publishes.
struct Run {
    tiles: u64,
    encoded_bytes: usize,
    raw_bytes: u64,
    /// All publications of a round.
    publish_s: Rounds,
    /// Each tile of the last round.
    encode_us: Rounds,
    decode_us: Rounds,
    known_m2: f64,
    grid_bytes: usize,
    scratch_bytes: usize,
    store_bytes: usize,
}

impl Run {
    fn of(scans: &[RegisteredScan], cell_m: f64) -> anyhow::Result<Self> {
        let mut publish_s = Rounds::default();
        for _ in 1..ROUNDS {
            publish_s.add(map(scans, cell_m, |_| Ok(()))?.publish_s);
        }
        let (mut encode_us, mut decode_us) = (Vec::new(), Vec::new());
        let (mut encoded_bytes, mut newest) = (0, 0);
        let mapped = map(scans, cell_m, |publisher| {
            let store = publisher.store();
            for (_, tile) in store.newer_than(LayerId::Occupancy, newest) {
                let Some(cells) = tile.cells() else { continue };
                let (bands, time_s) = timed(|| codec::encode(LayerId::Occupancy, cells));
                encode_us.push(1e6 * time_s);
                let (decoded, time_s) = timed(|| codec::decode(LayerId::Occupancy, &bands, None));
                decode_us.push(1e6 * time_s);
                anyhow::ensure!(decoded? == *cells, "a tile came back changed");
                encoded_bytes += bands.iter().map(Vec::len).sum::<usize>();
            }
            newest = store.head_revision(LayerId::Occupancy);
            Ok(())
        })?;
        publish_s.add(mapped.publish_s);

        let (mapper, publisher) = (&mapped.mapper, &mapped.publisher);
        let traffic = publisher.traffic();
        anyhow::ensure!(
            traffic.published == encode_us.len() as u64,
            "a published tile was not encoded"
        );
        let occupancy = mapper.occupancy().context("no occupancy grid")?;
        Ok(Self {
            tiles: traffic.published,
            encoded_bytes,
            raw_bytes: traffic.raw_bytes,
            publish_s,
            encode_us: encode_us.into_iter().collect(),
            decode_us: decode_us.into_iter().collect(),
            known_m2: publisher.store().cells_known(LayerId::Occupancy) as f64 * cell_m * cell_m,
            grid_bytes: occupancy.bytes(),
            scratch_bytes: occupancy.scratch_bytes(),
            store_bytes: publisher.store().bytes(LayerId::Occupancy) as usize,
        })
    }
}

struct Mapped {
    mapper: Mapper,
    publisher: Publisher,
    publish_s: f64,
}

/// Maps `scans` and publishes as the pipeline does; `published` sees the store after each time.
fn map(
    scans: &[RegisteredScan],
    cell_m: f64,
    mut published: impl FnMut(&Publisher) -> anyhow::Result<()>,
) -> anyhow::Result<Mapped> {
    let config = generic2d(cell_m)?;
    let period = RobotDuration::from_secs_f64(config.streaming.publish_period_s);
    let mut mapper = Mapper::new(
        &config.mapping,
        config.vehicle.shape(),
        &config.range_models(),
    );
    let tile_store_mb = config.streaming.tile_store_mb;
    let mut publisher = Publisher::new(BootId([0; 16]), tile_store_mb, &mapper, false)?;
    let mut published_at: Option<RobotTime> = None;
    let mut publish_s = 0.0;
    for (index, scan) in scans.iter().enumerate() {
        mapper.integrate(scan);
        let due = published_at.is_none_or(|at| scan.stamp.since(at) >= period);
        if due || index + 1 == scans.len() {
            published_at = Some(scan.stamp);
            let (done, time_s) = timed(|| publisher.publish(&mut mapper, scan.stamp));
            done?;
            publish_s += time_s;
            published(&publisher)?;
        }
    }
    Ok(Mapped {
        mapper,
        publisher,
        publish_s,
    })
}
