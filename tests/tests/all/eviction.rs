//! Tiles evicted from the mapping memory stay in the tile store.

use std::collections::{BTreeMap, BTreeSet};

use protocol::layer::{LayerId, UNKNOWN};
use protocol::tile::{TileCells, TileKey};
use robot_edge::publishing::cells_to_tiles;
use robot_edge::runtime::Pipeline;
use simulation::{SimulationOptions, World};

use crate::simulated_run::{measurements, pipeline, vehicle_config};

const LIMIT_MB: u32 = 1;

/// The tiles in the mapping memory.
fn held(pipeline: &Pipeline) -> BTreeSet<TileKey> {
    let tiles = pipeline.mapper().occupancy().unwrap().grid().tiles();
    tiles
        .map(|tile| cells_to_tiles::key(LayerId::Occupancy, tile.index))
        .collect()
}

/// The published tiles.
fn published(pipeline: &Pipeline) -> BTreeMap<TileKey, TileCells> {
    let store = pipeline.publisher().store();
    let tiles = store.tiles(LayerId::Occupancy);
    tiles
        .map(|(key, stored)| (key, stored.cells().unwrap().clone()))
        .collect()
}

fn revisions(pipeline: &Pipeline) -> BTreeMap<TileKey, u64> {
    let store = pipeline.publisher().store();
    let tiles = store.tiles(LayerId::Occupancy);
    tiles
        .map(|(key, stored)| (key, stored.revision()))
        .collect()
}

/// Tiles of a pipeline, observed after each publication.
#[derive(Default)]
struct Watch {
    publications: u64,
    held: BTreeSet<TileKey>,
    revisions: BTreeMap<TileKey, u64>,
    evicted: BTreeSet<TileKey>,
    /// Evicted and observed again later: they were blank in the mapping memory.
    seen_again: BTreeSet<TileKey>,
    evictions: u64,
}

impl Watch {
    fn look(&mut self, pipeline: &Pipeline) {
        let publications = pipeline.report().publish_time.runs();
        if publications == self.publications {
            return;
        }
        assert_eq!(
            publications,
            self.publications + 1,
            "a publication was missed"
        );
        self.publications = publications;
        let bytes = pipeline.mapper().occupancy().unwrap().bytes();
        assert!(bytes <= LIMIT_MB as usize * 1_000_000, "{bytes}");
        let (held, revisions) = (held(pipeline), revisions(pipeline));
        for (&key, &revision) in &revisions {
            let touched = self.revisions.get(&key) != Some(&revision);
            let is_held = held.contains(&key);
            if self.evicted.contains(&key) && (touched || is_held) {
                self.seen_again.insert(key);
            }
            if (self.held.contains(&key) || touched) && !is_held {
                self.evicted.insert(key);
                self.evictions += 1;
            }
        }
        (self.held, self.revisions) = (held, revisions);
    }
}

/// Maps with [`LIMIT_MB`] and without and compares the published tiles; returns the observation and the pipeline's
/// count of evictions.
fn check(cell_m: f64, duration_s: f64) -> (Watch, u64) {
    let world = World::load("rooms").unwrap();
    let options = SimulationOptions {
        seed: 1,
        duration_s: Some(duration_s),
        ..SimulationOptions::default()
    };
    let cell = format!("mapping.occupancy.cell_m={cell_m}");
    let limit = format!("mapping.occupancy.memory_limit_mb={LIMIT_MB}");
    let mut limited = pipeline(&vehicle_config(&world, &[&cell, &limit]));
    let mut unlimited = pipeline(&vehicle_config(&world, &[&cell]));
    let mut watch = Watch::default();
    for measurement in measurements(&world, options) {
        limited.push(measurement.clone()).unwrap();
        unlimited.push(measurement).unwrap();
        watch.look(&limited);
    }
    for pipeline in [&mut limited, &mut unlimited] {
        pipeline.finish().unwrap();
        let counters = pipeline.publisher().store().counters();
        assert_eq!(counters.tiles_evicted, 0, "the store has room for all");
    }
    watch.look(&limited);
    assert_eq!(unlimited.publisher().traffic().evicted_from_mapping, 0);

    let (ours, all) = (published(&limited), published(&unlimited));
    assert!(ours.keys().eq(all.keys()));
    for (key, cells) in ours {
        let known = |cells: &TileCells| cells.codes().map(|code| code != UNKNOWN);
        assert_eq!(known(&cells), known(&all[&key]), "{key}: known cells");
        if !watch.seen_again.contains(&key) {
            assert_eq!(cells, all[&key], "{key}: values");
        }
    }
    (watch, limited.publisher().traffic().evicted_from_mapping)
}

/// The memory holds twice what is in sight: only tiles that are left behind are evicted.
#[test]
fn evicted_tiles_stay_published_as_they_were() {
    let (watch, counted) = check(0.02, 116.0);
    assert_eq!(counted, watch.evictions);
    let untouched = watch.evicted.difference(&watch.seen_again).count();
    assert!(untouched > 50, "{untouched}");
    assert!(watch.seen_again.len() > 20, "{}", watch.seen_again.len());
}

/// The memory holds half of what is in sight: tiles are evicted in the second in which they change.
#[test]
fn tiles_are_published_before_they_are_evicted() {
    let (watch, counted) = check(0.01, 20.0);
    // A tile that was reloaded and evicted without a change is not visible outside.
    assert!(
        (watch.evictions..watch.evictions + 5).contains(&counted),
        "{counted}"
    );
    assert!(counted > 2 * watch.evicted.len() as u64, "{counted}");
}
