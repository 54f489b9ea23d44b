use std::time::Duration;

use edge::publishing::replies::bands_of;
use protocol::keys::Topic;
use protocol::message::{
    ChangedTile, Changes, EStopStatus, Event, MAX_SENSORS, Scan, Severity, StopReason,
    TeleopStatus, TileBand, TilesReply, View,
};
use protocol::tile::{TileCells, TileKey, codec};
use protocol::tile_store::TileStore;
use protocol::wire::{self, Header};
use serde::Serialize;

use super::*;
use crate::test_support::{
    BOOT, announce_boot, announce_map, at, changes, console, describe_layers, ended_status,
    idle_teleop_status, inject, inject_at, inject_reply, pose_at_rest, push_tile, scout, store_of,
};

fn say<T: Serialize>(model: &mut ConsoleModel, topic: Topic, boot: BootId, body: &T, ms: u64) {
    let header = Header {
        boot,
        seq: ms,
        robot_time_ns: 99,
    };
    let sample = Incoming::Sample {
        key: topic.key(model.robot()),
        payload: wire::encode(&header, body).unwrap(),
    };
    model.apply(sample, at(ms));
}

fn answer_info(model: &mut ConsoleModel, info: &Info, ms: u64) {
    inject_reply(model, RequestId(1), Topic::Info, info, at(ms));
}

fn asks_for_info(model: &mut ConsoleModel, ms: u64) -> bool {
    let key_of_info = Topic::Info.key(model.robot());
    let outgoing = model.outgoing(OpenSessions::BOTH, at(ms));
    let asks = |out: &Outgoing| matches!(out, Outgoing::Get { key, .. } if *key == key_of_info);
    outgoing.iter().any(asks)
}

fn sensor(name: &str) -> SensorStatus {
    SensorStatus {
        name: name.to_owned(),
        messages: 1,
        rate_hz: 1.0,
        age_ms: None,
        dropped: 0,
        fault: None,
    }
}

fn scan() -> Scan {
    Scan::of_points("laser".to_owned(), [1.0, 2.0], [[3.0, 4.0]])
}

#[test]
fn new_info_revision_is_requested() {
    let mut model = scout();
    announce_boot(&mut model, BOOT, at(0));
    assert!(asks_for_info(&mut model, 1));
    answer_info(&mut model, &Info::default(), 2);
    let mut status = Status::default();
    say(&mut model, Topic::Status, BOOT, &status, 3);
    assert!(!asks_for_info(&mut model, 1_000));
    status.info_revision = 1;
    say(&mut model, Topic::Status, BOOT, &status, 1_001);
    assert!(asks_for_info(&mut model, 1_002));
    assert!(!asks_for_info(&mut model, 1_003), "twice a second at most");
    let info = Info {
        revision: 1,
        ..Info::default()
    };
    answer_info(&mut model, &info, 1_004);
    assert!(!asks_for_info(&mut model, 3_000));
}

/// The view that is sent now, if one is due.
fn sent_view(model: &mut ConsoleModel, ms: u64) -> Option<View> {
    let outgoing = model.outgoing(OpenSessions::BOTH, at(ms));
    let view = outgoing.iter().find_map(|out| match out {
        Outgoing::Put { payload, .. } => Some(payload),
        Outgoing::Get { .. } => None,
    });
    let (_, view): (_, View) = wire::decode(view?).unwrap();
    Some(view)
}

#[test]
fn scans_are_kept_while_wanted_and_within_one_run() {
    let wants = |model: &mut ConsoleModel, ms| sent_view(model, ms).unwrap().wants_scan;
    let mut model = scout();
    assert!(!wants(&mut model, 0));
    say(&mut model, Topic::Scan, BOOT, &scan(), 1);
    assert_eq!(model.scans().count(), 0);
    model.want_scan(true);
    assert!(wants(&mut model, 1_000));
    say(&mut model, Topic::Scan, BOOT, &scan(), 1_001);
    let (name, held) = model.scans().next().unwrap();
    assert_eq!((name, &held.points_m[..]), ("laser", &[[3.0, 4.0]][..]));
    assert_eq!((held.stamp_ns, held.received_at), (99, at(1_001)));

    let mut far = scan();
    far.steps_cm = vec![(i32::MAX, 0)];
    say(&mut model, Topic::Scan, BOOT, &far, 1_002);
    assert_eq!(model.reject_counts().count(RejectReason::Malformed), 1);
    assert_eq!(model.scans().count(), 1);

    announce_boot(&mut model, BootId([8; 16]), at(1_003));
    assert_eq!(model.scans().count(), 0, "of the run before");
    say(&mut model, Topic::Scan, BOOT, &scan(), 1_004);
    assert_eq!(model.reject_counts().count(RejectReason::OtherBoot), 1);
    say(&mut model, Topic::Scan, BootId([8; 16]), &scan(), 1_005);
    model.want_scan(false);
    assert_eq!(model.scans().count(), 0);
}

/// Poses and commands use another session than scans and tiles, which may live longer.
#[test]
fn only_control_messages_keep_the_link_live() {
    let mut model = scout();
    model.want_scan(true);
    say(&mut model, Topic::Scan, BOOT, &scan(), 1_000);
    assert_eq!(model.scans().count(), 1);
    let connection = model.connection();
    assert_eq!(connection.state(at(1_001)), LinkState::Waiting);
    say(&mut model, Topic::Status, BOOT, &Status::default(), 2_000);
    say(&mut model, Topic::Scan, BOOT, &scan(), 3_000);
    let second = Duration::from_secs(1);
    assert_eq!(model.connection().age(at(3_000)), Some(second));
    assert_eq!(model.connection().state(at(3_600)), LinkState::Silent);
}

#[test]
fn invalid_numbers_are_rejected() {
    let mut model = scout();
    let endless = SensorStatus {
        rate_hz: f32::INFINITY,
        ..sensor("laser")
    };
    let many = vec![sensor("laser"); MAX_SENSORS + 1];
    let one = vec![sensor("laser")];
    for (ms, sensors, is_valid) in [(1, many, false), (2, vec![endless], false), (3, one, true)] {
        let status = Status {
            sensors,
            ..Status::default()
        };
        say(&mut model, Topic::Status, BOOT, &status, ms);
        assert_eq!(model.status().is_some(), is_valid, "{ms}");
    }
    assert_eq!(model.sensor_statuses(), [sensor("laser")]);
    let info = Info {
        stop_decel_mps2: f32::NAN,
        ..Info::default()
    };
    answer_info(&mut model, &info, 4);
    assert!(model.info().is_none() && model.sensors().is_empty());
    assert_eq!(model.reject_counts().count(RejectReason::Malformed), 3);
}

#[test]
fn control_session_works_without_bulk_session() {
    let control = OpenSessions {
        control: true,
        bulk: false,
    };
    let mut model = scout();
    inject(&mut model, Topic::Pose, &pose_at_rest(), at(0));
    let asked = model.outgoing(control, at(20));
    let last = |out: &Outgoing| match out {
        Outgoing::Get { key, .. } | Outgoing::Put { key, .. } => {
            key.rsplit('/').next().map(str::to_owned)
        }
    };
    let keys: Vec<_> = asked.iter().filter_map(last).collect();
    let view = RobotId::from_bytes([1; 16]).to_string();
    assert_eq!(keys, ["info", &*view, "ping"]);

    // Without a session nothing is requested, but the link is still sampled.
    let before = model.link_quality().samples().len();
    for n in 1..=20 {
        assert_eq!(model.outgoing(OpenSessions::NONE, at(20 + 500 * n)), []);
    }
    let samples = model.link_quality().samples();
    assert_eq!(samples.len(), before + 20);
    let age = samples.back().unwrap().ages[Stream::Pose as usize];
    assert_eq!(age, Some(Duration::from_millis(10_020)));
}

#[test]
fn stop_before_estop_is_recorded() {
    let mut model = scout();
    let status = |last_stop, estop: Option<u64>| Status {
        teleop: Some(TeleopStatus {
            last_stop,
            estop: estop.map(|number| EStopStatus {
                number,
                is_stored: true,
            }),
            ..idle_teleop_status()
        }),
        ..Status::default()
    };
    let estop = Event {
        kind: "estop".to_owned(),
        severity: Severity::Alarm,
        message: "emergency stop 1, by anna".to_owned(),
    };
    let before = |model: &ConsoleModel| model.stop_before_estop()?.last_stop;
    // Keys are released, and the stop is pressed before the next status.
    inject(&mut model, Topic::Status, &status(None, None), at(0));
    inject(&mut model, Topic::Event, &estop, at(100));
    assert_eq!(before(&model), None);
    let released = Some(StopReason::Released);
    let stopped = status(released, Some(1));
    inject(&mut model, Topic::Status, &stopped, at(200));
    assert_eq!(before(&model), released);
    // A status after the reset.
    let old = status(Some(StopReason::Age), None);
    inject(&mut model, Topic::Status, &old, at(300));
    assert_eq!(before(&model), released);
}

/// Tiles come by another session than the map head, and other consoles may want them.
#[test]
fn tiles_before_the_first_head_are_not_wanted_and_count_as_before_join() {
    let mut model = console("scout", &[LayerId::Occupancy]);
    let layer = LayerId::Occupancy;
    let key = TileKey {
        layer,
        tx: 0,
        ty: 0,
    };
    let band = TileBand {
        epoch: 0,
        revision: 1,
        base: 0,
        check: TileCells::unknown().digest().check(),
        rows: vec![0; 40],
    };
    let counts = |model: &ConsoleModel| {
        let count = |why| model.reject_counts().count(why);
        [RejectReason::BeforeJoin, RejectReason::OtherBoot].map(count)
    };
    let wanted = |model: &mut ConsoleModel, ms| sent_view(model, ms).unwrap().layers;
    let tile = Topic::Changes(layer);
    let changes = changes(key, band);
    assert_eq!(wanted(&mut model, 0), 0);
    inject(&mut model, tile, &changes, at(0));
    assert_eq!(counts(&model), [1, 0]);
    announce_boot(&mut model, BootId([8; 16]), at(1));
    assert_eq!(wanted(&mut model, 1), 1 << layer as u32);
    assert_eq!(sent_view(&mut model, 2), None);
    inject(&mut model, tile, &changes, at(2));
    assert_eq!(counts(&model), [1, 1]);
}

/// Two neighbouring tiles, and a console that was told of their layer.
fn two_tiles() -> ([TileKey; 2], TileStore, ConsoleModel) {
    let layer = LayerId::Occupancy;
    let keys = [0, 1].map(|tx| TileKey { layer, tx, ty: 0 });
    let mut store = store_of(&[layer]);
    for key in keys {
        drop(store.publish(key, TileCells::from_fn(|_, _| 100)).unwrap());
    }
    let mut model = console("scout", &[layer]);
    describe_layers(&mut model, &[layer], at(0));
    (keys, store, model)
}

#[test]
fn tiles_of_one_message_have_their_own_ages() {
    let (keys, store, mut model) = two_tiles();
    announce_map(&mut model, &store, at(0));
    let newest_ns = 10_000_000_000;
    inject_at(&mut model, newest_ns, Topic::Pose, &pose_at_rest(), at(0));
    let tiles = keys.into_iter().zip([0, 3_000_000_000]);
    let tiles = tiles.map(|(key, older_ns)| ChangedTile {
        tx: key.tx,
        ty: key.ty,
        older_ns,
        band: bands_of(&store.tile(key).unwrap()).remove(0).1,
    });
    let tiles = tiles.collect();
    let topic = Topic::Changes(keys[0].layer);
    inject_at(&mut model, newest_ns, topic, &Changes { tiles }, at(0));
    let age = |key| model.map().ages().age(key, at(500));
    let expected = [500, 3_500].map(|ms| Some(Duration::from_millis(ms)));
    assert_eq!(keys.map(age), expected);
}

/// On a thin link map heads are late behind tiles, and replies come all the same.
#[test]
fn what_is_missing_is_requested_again_after_silence() {
    for (tiles_ms, expected) in [(&[1_500, 3_000][..], 0), (&[], 1), (&[1_500], 1)] {
        let (keys, store, mut model) = two_tiles();
        let requests = |model: &mut ConsoleModel, ms| {
            announce_map(model, &store, at(ms));
            let outgoing = model.outgoing(OpenSessions::BOTH, at(ms));
            let is_bulk = |out: &&Outgoing| matches!(out, Outgoing::Get { is_bulk: true, .. });
            outgoing.iter().filter(is_bulk).count()
        };
        let first = requests(&mut model, 0);
        assert!(first > 0);
        for ms in tiles_ms {
            push_tile(&mut model, &store, keys[0], at(*ms));
        }
        assert_eq!(
            requests(&mut model, 4_500),
            expected * first,
            "{tiles_ms:?}"
        );
    }
}

#[test]
fn a_console_that_joins_shows_overviews_until_the_tiles_arrive() {
    let layer = LayerId::Occupancy;
    let [here, gone] = [0, 1].map(|tx| TileKey { layer, tx, ty: 0 });
    let mut store = store_of(&[layer]);
    drop(store.publish(here, TileCells::from_fn(|_, _| 100)).unwrap());
    let mut earlier = store.clone();
    drop(
        earlier
            .publish(gone, TileCells::from_fn(|_, _| 50))
            .unwrap(),
    );

    let mut model = console("scout", &[layer]);
    describe_layers(&mut model, &[layer], at(0));
    announce_map(&mut model, &store, at(0));
    inject(&mut model, Topic::Pose, &pose_at_rest(), at(0));
    let requested = |model: &mut ConsoleModel, ms| {
        let outgoing = model.outgoing(OpenSessions::BOTH, at(ms)).into_iter();
        let topics = outgoing.filter_map(|out| match out {
            Outgoing::Get { key, is_bulk, .. } if is_bulk => Topic::parse(&key),
            Outgoing::Get { .. } | Outgoing::Put { .. } => None,
        });
        topics.map(|(_, topic)| topic).collect::<Vec<_>>()
    };
    let first = requested(&mut model, 0);
    let (overviews, tiles) = (Topic::Overviews(layer), Topic::Tiles(layer));
    assert_eq!(first[..2], [overviews, tiles]);
    assert!(!first[1..].contains(&overviews));
    assert!(!requested(&mut model, 1).contains(&overviews));

    let overview = earlier.overview(here).unwrap();
    for rows in codec::encode(layer, &overview.cells) {
        let band = TileBand {
            epoch: 0,
            revision: overview.revision,
            base: 0,
            check: overview.check,
            rows,
        };
        let reply = TilesReply {
            tx: 0,
            ty: 0,
            band,
            following: 0,
        };
        inject_reply(&mut model, RequestId(1), overviews, &reply, at(2));
    }
    let shown = |model: &ConsoleModel, key| {
        let cells = model.map().store().shown(key)?;
        cells.get(0, 0)
    };
    assert_eq!(
        [here, gone].map(|key| shown(&model, key)),
        [Some(100), Some(50)]
    );
    assert_eq!(model.take_changed_tiles(), [here, gone].into());
    assert_eq!(model.map().store().tile_count(layer), 0);

    push_tile(&mut model, &store, here, at(3));
    announce_map(&mut model, &store, at(4));
    requested(&mut model, 4);
    assert!(model.matches_last_head());
    assert_eq!(
        [here, gone].map(|key| shown(&model, key)),
        [Some(100), None]
    );
    assert_eq!(model.take_changed_tiles(), [here, gone].into());
}

fn model_with(status: &Status) -> ConsoleModel {
    let mut model = scout();
    inject(&mut model, Topic::Status, status, at(0));
    model
}

#[test]
fn silence_is_expected_after_end_of_data() {
    let running = Status::default();
    let ended = ended_status();
    let vehicle = Status {
        teleop: Some(idle_teleop_status()),
        ..ended.clone()
    };
    let may = [running, ended, vehicle].map(|status| model_with(&status).is_silence_expected());
    assert_eq!(may, [false, true, true]);
    assert!(!scout().is_silence_expected());
    // Earlier contact counts until the first status.
    let mut left = scout();
    left.set_last_contact(LastContact {
        last: at(0),
        expected_from: at(0),
        had_ended: true,
    });
    assert!(left.is_silence_expected());
    inject(&mut left, Topic::Status, &Status::default(), at(0));
    assert!(!left.is_silence_expected());
}

#[test]
fn loss_is_unknown_without_live_data() {
    let mut live = model_with(&Status::default());
    // Every second one of 5 a second.
    for ms in (0..=3_000).step_by(400) {
        inject(&mut live, Topic::Pose, &pose_at_rest(), at(ms));
    }
    assert_eq!(live.poses_missing(at(3_050)), Some(0.5));
    assert_eq!(live.poses_missing(at(9_000)), None, "it is silent");
    let ended = ended_status();
    inject(&mut live, Topic::Status, &ended, at(3_050));
    assert_eq!(live.poses_missing(at(3_050)), None, "it has ended");
}
