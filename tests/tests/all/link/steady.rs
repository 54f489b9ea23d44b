//! Benchmark of the link while a vehicle maps: bytes, and the age of the map near it. Needs root; prints rows of a table.

use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::rig::tun::Side;
use network::clock;
use protocol::layer::LayerId;
use protocol::tile::TILE_SIDE;

use super::joining::endpoint;
use super::shaped::{inside, namespaces, recording};
use super::{connect_to, open_session};
use crate::processes::Running;
use crate::teleop::robot::at;

/// For the helper process: the robot's endpoint.
const WATCHES: &str = "FORESHORE_TEST_WATCHES";

/// Until a console has joined, and then.
const JOINING: Duration = Duration::from_secs(13);
const MEASURED: Duration = Duration::from_mins(1);

/// The age of tiles nearer to the vehicle is measured, metres.
const NEAR_M: f64 = 20.0;

/// Not a test: a console that prints how old the tiles near the vehicle are when they arrive.
#[test]
fn watching_console_as_helper_process() {
    let Ok(endpoint) = std::env::var(WATCHES) else {
        return;
    };
    let session = open_session(&connect_to(endpoint), &LayerId::ALL, || {});
    let started = clock::now();
    let mut ages = Vec::new();
    while clock::elapsed(started) < JOINING + MEASURED {
        let mut model = session.model();
        let changed = model.take_changed_tiles();
        if let Some((pose, now)) = model.vehicle().pose()
            && clock::elapsed(started) >= JOINING
        {
            let near = changed.into_iter().filter(|key| {
                let cell_m = model.map().store().cell_m(key.layer).unwrap();
                let half_m = 0.5 * cell_m * TILE_SIDE as f64;
                let center_m = key.center_m(cell_m);
                let apart_m = [0, 1]
                    .map(|n: usize| ((center_m[n] - pose.position_m[n]).abs() - half_m).max(0.0));
                apart_m[0] * apart_m[0] + apart_m[1] * apart_m[1] <= NEAR_M * NEAR_M
            });
            let near: Vec<_> = near.collect();
            // A tile can arrive before the pose of its scan.
            let age = |key| model.map().ages().age(key, now.max(clock::now()));
            ages.extend(near.into_iter().map(|key| age(key).unwrap_or_default()));
        }
        drop(model);
        sleep(Duration::from_millis(5));
    }
    ages.sort_unstable();
    let [median_s, p95_s] = [0.5, 0.95].map(|share| at(&ages, share).as_secs_f64());
    println!("ages: {median_s:.2} {p95_s:.2} {}", ages.len());
}

#[test]
#[ignore = "nine minutes, needs root: measures"]
fn steady_cost_while_mapping_in_release() {
    let Some(link) = namespaces(7) else { return };
    println!("| kbit/s with IP headers, a minute | mean | greatest 10 s | age p50, p95, tiles |");
    let mut over = Vec::new();
    let simulated = ["rooms", "street", "yard", "meadow", "lake"];
    let simulated = simulated.map(|world| (world, Some(format!("simulate {world}"))));
    let recorded = [
        ("aces", "aces.clf"),
        ("fr-clinic", "fr-clinic_robotlaser.clf"),
    ];
    let recorded = recorded.map(|(name, log)| {
        let log = recording(&format!("carmen/{log}"));
        (name, log.map(|log| format!("replay {log}")))
    });
    for (name, source) in simulated.into_iter().chain(recorded) {
        let Some(source) = source else { continue };
        let line = format!(
            "robot-edge {source} --rate 1 --keep-serving --quiet --insecure --robot scout --listen {}",
            endpoint()
        );
        let edge = Running::start(&mut inside(&link, Side::A, &line), "edge");
        sleep(Duration::from_secs(1));
        let mut console = link.command(Side::B, std::env::current_exe().unwrap());
        console
            .args("link::steady::watching_console_as_helper_process --exact --nocapture".split(' '))
            .env(WATCHES, endpoint());
        let console = Running::start(&mut console, "a console that watches");
        sleep(JOINING);
        let mut sent = vec![link.sent_bytes()[0]];
        for _ in 0..MEASURED.as_secs() {
            sleep(Duration::from_secs(1));
            sent.push(link.sent_bytes()[0]);
        }
        let printed = console.ends_well();
        let ages = printed.lines().find_map(|line| line.split("ages: ").nth(1));
        let kbps = |bytes: u64, seconds: usize| bytes as f64 * 8e-3 / seconds as f64;
        let mean = kbps(sent[60] - sent[0], 60);
        let greatest = sent.windows(11).map(|of| kbps(of[10] - of[0], 10));
        let greatest = greatest.fold(0.0, f64::max);
        let ages = ages.unwrap_or_else(|| panic!("{printed}"));
        println!("| {name} | {mean:.1} | {greatest:.1} | {ages} |");
        let p95_s: f64 = ages.split(' ').nth(1).unwrap().parse().unwrap();
        if mean > 64.0 || greatest > 96.0 || p95_s > 2.0 {
            over.push(name);
        }
        drop(edge);
        sleep(Duration::from_secs(1));
    }
    assert!(
        over.is_empty(),
        "over 64 or 96 kbit/s, or older than 2 s: {over:?}"
    );
}
