use protocol::keys::Topic;
use protocol::layer::LayerId;
use protocol::message::Status;
use protocol::tile::{TileCells, TileKey};
use protocol::tile_store::{LayerGrid, TileStore};

use super::*;
use crate::test_support::{BOOT, announce_map, at, console, idle_teleop_status, inject};

/// A robot or recording that announces a map with one tile of these layers.
fn announced(robot: &str, wanted: &[LayerId]) -> ConsoleModel {
    let layer = LayerId::Occupancy;
    let mut store = TileStore::new(BOOT, 10);
    store.set_grid(LayerGrid { layer, cell_m: 0.1 }).unwrap();
    let key = TileKey {
        layer,
        tx: 0,
        ty: 0,
    };
    let cells = TileCells::from_fn(|_, _| 251);
    drop(store.publish(key, cells).unwrap());
    let mut model = console(robot, wanted);
    announce_map(&mut model, &store, at(1_000));
    model
}

#[test]
fn docs_contain_the_map_states() {
    let handbook = include_str!("../../../../docs/console.md");
    let handbook = handbook.split_whitespace().collect::<Vec<_>>().join(" ");
    let unknown = console("scout", &[]);
    let equal = announced("scout", &[]);
    let behind = announced("scout", &[LayerId::Occupancy]);
    let mut all = vec![drawing(Tone::Waiting, 0)];
    for model in [unknown, equal, behind] {
        for link in [LinkState::Live, LinkState::Silent] {
            let contact = (link, Duration::from_millis(100));
            all.push(map_state(model.map(), contact, at(1_100)));
        }
    }
    for (_, long, short) in all {
        for words in [long.as_str(), short] {
            assert!(handbook.contains(&format!("*{words}*")), "{words}");
        }
    }
}

#[test]
fn the_map_of_a_recording_is_drawn_not_fetched() {
    let model = announced("recording-1", &[LayerId::Occupancy]);
    let reported = |link: &LinkStatus| {
        let data = ConnectionData::new(&model, link, at(1_100));
        (data.map_tone, data.map, data.map_short)
    };
    let behind = "Behind, asking what is missing".to_owned();
    let robot = LinkStatus::default();
    assert_eq!(reported(&robot), (Tone::Waiting, behind, "Behind"));
    let recording = LinkStatus {
        recording: Some("rooms.mcap".to_owned()),
        ..LinkStatus::default()
    };
    let drawn = (Tone::Waiting, "Being drawn".to_owned(), "Drawing");
    assert_eq!(reported(&recording), drawn);
    for (missing, text) in [
        (1, "Being drawn: 1 tile to come"),
        (1_200, "Being drawn: 1\u{a0}200 tiles to come"),
    ] {
        let expected = (Tone::Waiting, text.to_owned(), "Drawing");
        assert_eq!(drawing(Tone::Waiting, missing), expected);
    }
}

#[test]
fn a_recording_is_not_live() {
    let model = console("recording-1", &[]);
    let link = LinkStatus {
        transport: None,
        recordings: None,
        recording: Some("rooms.mcap".to_owned()),
        failure: None,
        problem: Some("no answer at tcp/127.0.0.1:9".to_owned()),
        is_connected: false,
    };
    let data = ConnectionData::new(&model, &link, Monotonic::default());
    assert_eq!((data.tone, &*data.state), (Tone::Waiting, "Opening"));
    let failed = LinkStatus {
        failure: Some("it has no scans".to_owned()),
        ..link.clone()
    };
    let of_failed = ConnectionData::new(&model, &failed, Monotonic::default());
    let text = (of_failed.tone, &*of_failed.state, &*of_failed.map);
    assert_eq!(text, (Tone::Warning, "Failed", "No map"));
    assert_eq!(of_failed.advice, failed.failure);
    let advice = data.advice.unwrap();
    assert!(!advice.contains("nobody"), "{advice}");
    assert_eq!(data.rows, []);
    assert_eq!(link.name_of(model.robot()), "rooms.mcap");
    let robot = LinkStatus::default().name_of(model.robot());
    assert_eq!(robot, "recording-1");
}

#[test]
fn problem_of_the_bulk_session_is_shown() {
    let mut model = console("scout", &[]);
    inject(&mut model, Topic::Status, &Status::default(), at(1_000));
    let of = |problem: Option<&str>| {
        let link = LinkStatus {
            is_connected: true,
            problem: problem.map(str::to_owned),
            ..LinkStatus::default()
        };
        let data = ConnectionData::new(&model, &link, at(1_100));
        (data.tone, data.state, data.advice)
    };
    assert_eq!(of(None), (Tone::Good, "Live".to_owned(), None));
    let why = "no answer at tcp/boat:7448, where maps come from; trying again";
    let reported = (Tone::Warning, "Live".to_owned(), Some(why.to_owned()));
    assert_eq!(of(Some(why)), reported);
}

#[test]
fn ended_data_is_not_live() {
    let mut model = console("scout", &[]);
    let ended = Status {
        has_ended: true,
        ..Status::default()
    };
    inject(&mut model, Topic::Status, &ended, at(1_000));
    let mut link = LinkStatus::default();
    let data = ConnectionData::new(&model, &link, at(1_100));
    assert_eq!((data.tone, &*data.state), (Tone::Waiting, "Ended"));
    assert!(data.rows.contains(&row("Last message", "0.1 s ago")));
    let advice = "Its data has ended: nothing new will come.";
    assert_eq!(data.advice.as_deref(), Some(advice));
    link.problem = Some("no answer at tcp/boat:7448".to_owned());
    let data = ConnectionData::new(&model, &link, at(1_100));
    assert_eq!((data.tone, &*data.state), (Tone::Warning, "Ended"));
    assert_eq!(data.advice, link.problem);
    let data = ConnectionData::new(&model, &LinkStatus::default(), at(9_000));
    assert_eq!((data.tone, &*data.state), (Tone::Waiting, "Ended"));
    assert_eq!(data.advice.as_deref(), Some("Its data has ended."));
    assert!(data.rows.contains(&row("Last message", "8.0 s ago")));
    let teleop = Some(idle_teleop_status());
    inject(
        &mut model,
        Topic::Status,
        &Status { teleop, ..ended },
        at(9_100),
    );
    let data = ConnectionData::new(&model, &LinkStatus::default(), at(19_000));
    assert_eq!((data.tone, &*data.state), (Tone::Waiting, "Ended"));
}
