//! The same between an edge's link and sessions of a console.

use std::net::TcpListener;
use std::ops::ControlFlow;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use measurement::time::RobotTime;
use operator_console::export::{ExportPart, Snapshot, export_parts};
use operator_console::link::RobotSession;
use operator_console::model::ModelSettings;
use protocol::export::write_shores;
use protocol::tile::BootId;
use robot_edge::clock;
use robot_edge::driving::operators::PendingOperatorList;
use robot_edge::link::edge::{EdgeLink, EdgeSettings};
use robot_edge::link::publish_state::PublishState;
use robot_edge::link::sessions::Endpoints;

use super::{empty_store, info, robot, settings, shores};

/// A control endpoint of this machine whose port and the next are free.
fn free_endpoint() -> String {
    loop {
        let control = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let port = control.local_addr().unwrap().port();
        if port < u16::MAX && TcpListener::bind(("127.0.0.1", port + 1)).is_ok() {
            return format!("tcp/127.0.0.1:{port}");
        }
    }
}

/// Waits until the console holds shores of so many voxels, 20 s at most.
#[track_caller]
fn wait_for(session: &RobotSession, voxels: u32) {
    let is_there = || {
        let model = session.model();
        let clusters = model.shores().map(|shores| shores.clusters.clone());
        let first = clusters
            .unwrap_or_default()
            .first()
            .map(|cluster| cluster.voxels);
        first == Some(voxels) && model.is_synchronized(clock::now())
    };
    let was_there = !clock::sleep_until(clock::now() + Duration::from_secs(20), is_there);
    assert!(was_there, "no shores of {voxels} voxels");
}

#[test]
fn shores_arrive_and_both_sides_export_the_same() {
    let endpoint = free_endpoint();
    let boot = BootId([7; 16]);
    let publish_state = Arc::new(PublishState::default());
    let edge = EdgeSettings {
        driving: None,
        robot: robot(),
        boot,
        endpoints: Endpoints {
            listen: vec![endpoint.clone()],
            ..Endpoints::default()
        },
        newer_operators: PendingOperatorList::default(),
        budget_kbps: 256,
        info: info(),
    };
    let store = Arc::new(Mutex::new(empty_store(boot)));
    let link = EdgeLink::open(edge, store, Arc::clone(&publish_state)).unwrap();
    let stamp = RobotTime::from_nanos(5);
    publish_state.set_shores(stamp, Arc::new(shores(100)));
    let endpoints = Endpoints {
        connect: vec![endpoint],
        ..Endpoints::default()
    };
    let first = RobotSession::open(settings(), &endpoints, || {}).unwrap();
    wait_for(&first, 100);
    publish_state.set_shores(stamp, Arc::new(shores(200)));
    wait_for(&first, 200);
    let late = ModelSettings {
        session: BootId([2; 16]),
        ..settings()
    };
    let late = RobotSession::open(late, &endpoints, || {}).unwrap();
    wait_for(&late, 200);

    let dir = tempfile::tempdir().unwrap();
    let by_edge = write_shores(&dir.path().join("edge"), &shores(200)).unwrap();
    let by_console = dir.path().join("console");
    let exported = export_parts(&by_console, ExportPart::all(), |part, _| {
        ControlFlow::Continue(Ok(Snapshot::of(&late.handle().lock(), part)))
    });
    let files = exported.unwrap().files;
    assert!(
        files.contains(&by_console.join("shores.geojson")),
        "{files:?}"
    );
    let read = |path| std::fs::read_to_string(path).unwrap();
    let text = read(by_edge);
    assert!(text.contains("WGS-84: longitude") && text.contains("\"voxels\":200"));
    assert_eq!(text, read(by_console.join("shores.geojson")));
    drop(link);
}
