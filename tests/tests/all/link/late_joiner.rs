//! A console that comes when the data has ended, and shows no layer, draws the whole way and exports what the robot does.

use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::time::Duration;

use operator_console::export::{ExportPart, Fetcher, export_parts};
use operator_console::link::RobotSession;
use operator_console::model::{ConsoleModel, LinkState, ModelSettings};
use protocol::layer::LayerId;
use protocol::tile::BootId;
use robot_edge::clock;
use robot_edge::link::sessions::Endpoints;
use tempfile::tempdir;

use super::processes::{Running, assert_same_maps, free_port, program};

const TIMEOUT: Duration = Duration::from_secs(20);

#[track_caller]
fn wait_until(session: &RobotSession, what: &str, is_so: impl Fn(&ConsoleModel) -> bool) {
    let is_late = clock::sleep_until(clock::now() + TIMEOUT, || is_so(&session.model()));
    assert!(!is_late, "{what}");
}

#[test]
fn a_late_console_that_shows_no_layer_exports_the_edges_map_and_way() {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let port = free_port();
    // It ends while the vehicle moves.
    let mut command = program("robot-edge");
    command.args([
        "simulate",
        "rooms",
        "--duration",
        "60",
        "--rate",
        "max",
        "--keep-serving",
    ]);
    command.args(["--robot", "scout", "--insecure", "--listen"]);
    command.arg(format!("tcp/127.0.0.1:{port}"));
    command.arg("--export").arg(at("edge"));
    let robot = Running::start(&mut command, "edge");
    let settings = ModelSettings {
        robot: "scout".parse().unwrap(),
        session: BootId([2; 16]),
        tile_store_mb: 64,
        layers: BTreeSet::new(),
    };
    let endpoints = Endpoints {
        connect: vec![format!("tcp/127.0.0.1:{port}")],
        ..Endpoints::default()
    };
    let early = RobotSession::open(settings.clone(), &endpoints, || {}).unwrap();
    wait_until(&early, "the data ends", ConsoleModel::has_ended);
    drop(early);

    let settings = ModelSettings {
        session: BootId([3; 16]),
        ..settings
    };
    let late = RobotSession::open(settings, &endpoints, || {}).unwrap();
    // The vehicle drove through four rooms, and its data has ended when this console comes.
    wait_until(&late, "the way is there", |model| {
        let trail_m = model.vehicle().trail();
        let reach_m = |axis: usize| {
            let along = trail_m.iter().map(|point_m| point_m[axis]);
            let (low, high) = along.fold((f64::MAX, f64::MIN), |(low, high), m| {
                (low.min(m), high.max(m))
            });
            high - low
        };
        model.connection().state(clock::now()) == LinkState::Live
            && reach_m(0) > 10.0
            && reach_m(1) > 5.0
    });
    assert_eq!(
        late.model().vehicle().poses().len(),
        1,
        "it heard only where it ended"
    );
    let is_known = |model: &ConsoleModel| {
        let store = model.map().store();
        store.cell_m(LayerId::Occupancy).is_some() && store.cells_known(LayerId::Occupancy) > 0
    };
    assert!(!is_known(&late.model()), "occupancy is hidden");

    let handle = late.handle();
    let fetcher = Fetcher::begin(&handle, ExportPart::all(), TIMEOUT);
    let exported = export_parts(&at("console"), ExportPart::all(), |part, _| {
        fetcher.fetch(part, |_| ControlFlow::Continue(()))
    });
    exported.unwrap().outcome(&at("console")).unwrap();
    assert!(is_known(&late.model()));
    // What it sees of the map is as old as it is, and not as long ago as it came.
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
    robot.signal("INT");
    robot.ends_well();
    assert_same_maps(&at("edge"), &at("console"));
}
