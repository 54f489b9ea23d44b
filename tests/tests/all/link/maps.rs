//! Edge, consoles and a client in another language have the same maps: after cuts, stops and restarts, through routers, and
//! for a console that comes late.

use std::ops::ControlFlow;
use std::path::Path;
use std::process::Command;
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::rig::relay::Relay;
use operator_console::export::{ExportPart, Fetcher, export_parts};
use operator_console::model::ConsoleModel;
use protocol::layer::LayerId;
use tempfile::tempdir;
use zenoh::{Session, Wait as _};

use super::{connect_to, console, edge, is_live, open_session};
use crate::processes::{
    Running, assert_same_files, assert_same_maps, free_endpoint, free_port, rooms, start, tcp,
    wait_until, zenoh_session,
};
use crate::python::{client_folder, python};

/// Routers for control and bulk.
pub(super) fn routers(port: u16) -> [Session; 2] {
    [port, port + 1].map(|port| zenoh_session("router", &tcp(port)))
}

/// Longer than the lease of the link (4 s), so that the session ends.
const SHORT: Duration = Duration::from_secs(6);

/// A replay at `rate`; a console from the start, one that joins in the middle, one whose link is cut for
/// `trouble`, one that is stopped for as long.
fn all_consoles_have_the_edges_map(rate: &str, trouble: Duration) {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let port = free_port();
    let relay = Relay::pair(port).unwrap();

    // The first console starts before its robot.
    let early = console(port, "scout", &at("early"));
    sleep(Duration::from_secs(1));
    let robot = edge(port, rate, &at("edge"));
    let cut = console(relay.port(), "scout", &at("cut"));
    let stopped = console(port, "scout", &at("stopped"));
    sleep(Duration::from_secs(2));
    relay.cut();
    stopped.signal("STOP");
    let late = console(port, "scout", &at("late"));
    sleep(trouble);
    relay.pass();
    stopped.signal("CONT");

    for console in [early, late, cut, stopped] {
        console.ends_well();
    }
    robot.interrupt();
    for name in ["early", "late", "cut", "stopped"] {
        assert_same_maps(&at("edge"), &at(name));
    }
}

#[test]
fn late_cut_off_and_stopped_consoles_have_the_edges_map() {
    all_consoles_have_the_edges_map("10", SHORT);
}

#[test]
#[ignore = "a minute: cut for 10 s"]
fn a_link_cut_for_ten_seconds_recovers() {
    all_consoles_have_the_edges_map("4", Duration::from_secs(10));
}

#[test]
#[ignore = "a minute: stopped for 30 s"]
fn a_console_stopped_for_thirty_seconds_recovers() {
    all_consoles_have_the_edges_map("3", Duration::from_secs(30));
}

#[test]
fn a_console_follows_its_robot_through_a_restart() {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let port = free_port();
    // The cells of the first run have another size and must all be erased.
    let first = start(&format!(
        "robot-edge replay {} --rate 20 --keep-serving --robot scout --set mapping.occupancy.cell_m=0.2 --listen {} --export {}",
        rooms(),
        tcp(port),
        at("first").display()
    ));
    let console = console(port, "scout", &at("console"));
    sleep(Duration::from_secs(3));
    first.signal("KILL");
    drop(first);
    let second = edge(port, "20", &at("second"));
    let printed = console.ends_well();
    second.interrupt();
    assert!(printed.contains("synchronized"), "{printed}");
    assert_same_maps(&at("second"), &at("console"));
    assert!(!at("first").join("occupancy.tif").exists(), "it was killed");
}

#[test]
fn a_replay_that_ends_waits_for_its_consoles() {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let port = free_port();
    let robot = start(&format!(
        "robot-edge replay {} --rate 40 --robot scout --listen {} --export {}",
        rooms(),
        tcp(port),
        at("edge").display()
    ));
    console(port, "scout", &at("console")).ends_well();
    robot.ends_well();
    assert_same_maps(&at("edge"), &at("console"));
}

/// Elevation and obstacle maps, erased because the ground plane is reset.
#[test]
fn maps_erased_during_a_run_are_the_same_in_the_console() {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let port = free_port();
    let ramp = at("ramp.mcap");
    let ramp = ramp.display();
    let record =
        format!("robot-edge simulate ramp --rate max --no-network --quiet --record {ramp}");
    start(&record).ends_well();

    let console = console(port, "scout", &at("console"));
    let printed = start(&format!(
        "robot-edge replay {ramp} --rate 12 --robot scout --listen {} --export {}",
        tcp(port),
        at("edge").display()
    ))
    .ends_well();
    console.ends_well();
    assert!(
        printed.contains("ground_plane: the ground plane was reset"),
        "{printed}"
    );
    // Of the obstacle map there are four.
    assert_same_files(&at("edge"), &at("console"), 10);
}

/// The octree's files are made on the vehicle and fetched in parts.
#[test]
fn voxels_are_the_same_in_the_console() {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let port = free_port();
    let console = console(port, "scout", &at("console"));
    start(&format!(
        "robot-edge simulate yard --duration 8 --rate max --robot scout --quiet --listen {} --export {}",
        tcp(port),
        at("edge").display()
    ))
    .ends_well();
    console.ends_well();
    for name in ["voxels.bt", "points.ply"] {
        assert!(at("console").join(name).exists(), "{name}");
    }
    // Two files each of cost, rigidity, both metrics and the octree, and two of the trajectory.
    assert_same_files(&at("edge"), &at("console"), 12);
}

fn robots_and_consoles_through_a_router(robots: usize, consoles: usize, rate: &str) {
    let folder = tempdir().unwrap();
    let port = free_port();
    let _routers = routers(port);
    let names: Vec<_> = (0..robots).map(|n| format!("robot-{n}")).collect();
    let edges: Vec<_> = names
        .iter()
        .enumerate()
        .map(|(n, name)| {
            // Different maps: tiles of two robots must not be confused.
            start(&format!(
                "robot-edge replay {} --rate {rate} --keep-serving --robot {name} --start {} --connect {} --export {}",
                rooms(),
                10 * n,
                tcp(port),
                folder.path().join(name).display()
            ))
        })
        .collect();
    let watched: Vec<_> = (0..consoles)
        .map(|n| {
            let (robot, export) = (
                &names[n % robots],
                folder.path().join(format!("console-{n}")),
            );
            sleep(Duration::from_millis(200));
            (robot, console(port, robot, &export), export)
        })
        .collect();
    let exports: Vec<_> = watched
        .into_iter()
        .map(|(robot, console, export)| {
            console.ends_well();
            (robot, export)
        })
        .collect();
    for edge in edges {
        edge.interrupt();
    }
    for (robot, export) in exports {
        assert_same_maps(&folder.path().join(robot), &export);
    }
}

/// Control goes on, so that the vehicle knows what is looked at, but what it pushes meanwhile is lost.
#[test]
fn tiles_that_nobody_could_get_leave_no_differences_to_them() {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let port = free_port();
    let [_control, bulk] = routers(port);
    let robot = start(&format!(
        "robot-edge replay {} --rate 4 --keep-serving --robot scout --connect {} --export {}",
        rooms(),
        tcp(port),
        at("edge").display()
    ));
    let console = console(port, "scout", &at("console"));
    sleep(Duration::from_secs(4));
    bulk.close().wait().unwrap();
    // More than a round of announcements.
    sleep(Duration::from_secs(3));
    let _bulk = zenoh_session("router", &tcp(port + 1));
    let printed = console.ends_well();
    robot.interrupt();
    assert!(!printed.contains("that was missed"), "{printed}");
    assert_same_maps(&at("edge"), &at("console"));
}

#[test]
fn consoles_and_robots_meet_at_a_router() {
    robots_and_consoles_through_a_router(2, 2, "20");
}

#[test]
#[ignore = "a minute, thirteen processes"]
fn ten_consoles_and_three_robots_meet_at_a_router() {
    robots_and_consoles_through_a_router(3, 10, "4");
}

/// It connects after the end of the data and shows no layer.
#[test]
fn a_late_console_without_layers_exports_the_edges_map() {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    // The data ends while the vehicle moves.
    let endpoint = free_endpoint();
    let robot = start(&format!(
        "robot-edge simulate rooms --duration 60 --rate max --keep-serving --robot scout --listen {endpoint} --export {}",
        at("edge").display()
    ));
    let endpoints = connect_to(endpoint);
    let early = open_session(&endpoints, &[], || {});
    wait_until("the data ends", || early.model().has_ended());
    drop(early);

    let late = open_session(&endpoints, &[], || {});
    // The trajectory through four rooms.
    wait_until("the trajectory arrives", || {
        let model = late.model();
        let trail_m = model.vehicle().trail();
        let reach_m = |axis: usize| {
            let along = trail_m.iter().map(|point_m| point_m[axis]);
            let (low, high) = along.fold((f64::MAX, f64::MIN), |(low, high), m| {
                (low.min(m), high.max(m))
            });
            high - low
        };
        is_live(&model) && reach_m(0) > 10.0 && reach_m(1) > 5.0
    });
    assert_eq!(
        late.model().vehicle().poses().len(),
        1,
        "it received the last pose only"
    );
    let is_known = |model: &ConsoleModel| {
        let store = model.map().store();
        store.cell_m(LayerId::Occupancy).is_some() && store.cells_known(LayerId::Occupancy) > 0
    };
    assert!(!is_known(&late.model()), "occupancy is hidden");

    let handle = late.handle();
    let fetcher = Fetcher::begin(&handle, ExportPart::all(), Duration::from_secs(20));
    let exported = export_parts(&at("console"), ExportPart::all(), |part, _| {
        fetcher.fetch(part, |_| ControlFlow::Continue(()))
    });
    exported.unwrap().outcome(&at("console")).unwrap();
    assert!(is_known(&late.model()));
    // Ages of tiles are those of their data, not of their arrival.
    let ages_s = {
        let model = late.model();
        let (map, layer) = (model.map(), LayerId::Occupancy);
        let tiles = map.store().tiles(layer);
        let ages = tiles.map(|(key, _)| map.ages().before_newest(key));
        ages.map(|age| age.as_secs_f64()).collect::<Vec<_>>()
    };
    let newest_s = ages_s.iter().copied().fold(f64::MAX, f64::min);
    let oldest_s = ages_s.iter().copied().fold(0.0, f64::max);
    assert!(newest_s < 1.0, "the last scan is in the map: {ages_s:?}");
    assert!((20.0..60.0).contains(&oldest_s), "{ages_s:?}");
    assert!(
        !late.model().map().is_wanted(LayerId::Occupancy),
        "it is hidden again"
    );
    robot.interrupt();
    assert_same_maps(&at("edge"), &at("console"));
}

/// What the client from SPEC.md needs.
const REQUIREMENTS: &str = "requirements.txt";
const IMPORTS: &str = "zenoh, blake3, cryptography";

#[test]
fn the_python_client_agrees_with_the_edge() {
    let Some(python) = python(REQUIREMENTS, IMPORTS) else {
        return;
    };
    let folder = client_folder();
    let vectors = Command::new(&python)
        .arg("-B")
        .arg(folder.join("test_vectors.py"))
        .output()
        .unwrap();
    assert!(
        vectors.status.success(),
        "{}",
        String::from_utf8_lossy(&vectors.stderr)
    );

    let exports = tempdir().unwrap();
    let port = free_port();
    let robot = edge(port, "20", &exports.path().join("edge"));
    sleep(Duration::from_secs(2));
    let mut command = Command::new(&python);
    command.arg("-B").arg(folder.join("foreshore_client.py"));
    command.args(["--connect", &tcp(port), "--until-ended", "--timeout", "60"]);
    command.arg("--compare").arg(exports.path().join("edge"));
    let mut client = Running::start(&mut command, "the Python client");
    let synchronized = client.wait_for_output("synchronized: ");
    println!("{synchronized}");
    assert!(
        synchronized.contains("occupancy 29326 cells known"),
        "{synchronized}"
    );
    // It compares its map with the export of the robot.
    robot.interrupt();
    let printed = client.ends_well();
    assert!(
        printed.contains("same as the export: occupancy 29326 cells"),
        "{printed}"
    );
}

/// "1 sparse, 2 solid; docking sites: B, A", as the Python client prints it.
fn names_of_shores(geojson: &Path) -> String {
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(geojson).unwrap()).unwrap();
    let (mut clusters, mut sites) = (Vec::new(), Vec::new());
    for feature in json["features"].as_array().unwrap() {
        let properties = &feature["properties"];
        match properties["name"].as_str() {
            Some(letters) => sites.push(letters.to_owned()),
            None => clusters.push(format!(
                "{} {}",
                properties["number"],
                properties["class"].as_str().unwrap()
            )),
        }
    }
    format!(
        "{}; docking sites: {}",
        clusters.join(", "),
        sites.join(", ")
    )
}

#[test]
fn shores_have_the_same_names_everywhere() {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let port = free_port();
    let endpoint = tcp(port);
    let robot = start(&format!(
        "robot-edge simulate lake --duration 30 --rate max --keep-serving --robot scout --listen {endpoint} \
         --export {}",
        at("edge").display()
    ));
    let console = |name: &str| {
        start(&format!(
            "operator-console --connect {endpoint} --robot scout --headless --for 60 --export {}",
            at(name).display()
        ))
    };
    for console in ["first", "second"].map(console) {
        console.ends_well();
    }
    console("restarted").ends_well();
    let python_names = python(REQUIREMENTS, IMPORTS).map(|python| {
        let mut command = Command::new(&python);
        command
            .arg("-B")
            .arg(client_folder().join("foreshore_client.py"));
        command.args(["--connect", &endpoint, "--until-ended", "--timeout", "60"]);
        let printed = Running::start(&mut command, "the Python client").ends_well();
        let line = printed
            .lines()
            .find_map(|line| line.strip_prefix("shores: "));
        line.unwrap_or_else(|| panic!("{printed}")).to_owned()
    });
    robot.interrupt();
    let names = names_of_shores(&at("edge/shores.geojson"));
    assert!(
        names.starts_with("1 ") && names.contains("docking sites: "),
        "{names}"
    );
    for console in ["first", "second", "restarted"] {
        assert_eq!(
            names_of_shores(&at(console).join("shores.geojson")),
            names,
            "{console}"
        );
    }
    if let Some(python_names) = python_names {
        assert_eq!(python_names, names);
    }
}
