//! A console that connects after the end of the data and shows no layer gets the trajectory and exports the same maps.

use std::ops::ControlFlow;
use std::time::Duration;

use operator_console::export::{ExportPart, Fetcher, export_parts};
use operator_console::model::{ConsoleModel, LinkState};
use protocol::layer::LayerId;
use robot_edge::clock;
use tempfile::tempdir;

use super::processes::{
    Running, assert_same_maps, connect_to, free_port, open_session, program, wait_until,
};

const TIMEOUT: Duration = Duration::from_secs(20);

#[test]
fn a_late_console_without_layers_exports_the_edges_map() {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let port = free_port();
    // The data ends while the vehicle moves.
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
    let endpoints = connect_to(format!("tcp/127.0.0.1:{port}"));
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
        model.connection().state(clock::now()) == LinkState::Live
            && reach_m(0) > 10.0
            && reach_m(1) > 5.0
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
    let fetcher = Fetcher::begin(&handle, ExportPart::all(), TIMEOUT);
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
    robot.signal("INT");
    robot.ends_well();
    assert_same_maps(&at("edge"), &at("console"));
}
