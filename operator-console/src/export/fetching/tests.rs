use protocol::keys::Topic;
use protocol::layer::LayerId;
use protocol::message::{Info, LayerInfo, MapHead, Pose, Status, VoxelsReply};
use protocol::tile_store::{LayerGrid, TileStore};
use robot_edge::clock;

use super::*;
use crate::model::{OpenSessions, Outgoing, RequestId};
use crate::test_support::{BOOT, announce_map, at, console, inject, inject_reply};

/// Fetches the only part of an export.
fn fetch(
    model: &ModelHandle,
    part: ExportPart,
    patience: Duration,
    watch: impl FnMut(Fetching) -> ControlFlow<()>,
) -> ControlFlow<(), anyhow::Result<Snapshot>> {
    Fetcher::begin(model, [part], patience).fetch(part, watch)
}

#[test]
fn what_is_fetched_is_told_and_moves_the_bar() {
    for (fetching, words, share) in [
        (Fetching::Requested, "asked for, the robot makes it", 0.0),
        (Fetching::Tiles(12), "12 tiles to come", 0.0),
        (
            Fetching::Poses([500, 2000]),
            "500 of 2000 poses fetched",
            0.25,
        ),
        (
            Fetching::Voxels(VoxelFile::Tree, [50, 100]),
            "voxels.bt, 0.0 of 0.0 MB fetched",
            0.25,
        ),
        (
            Fetching::Voxels(VoxelFile::Points, [1_300_000, 5_200_000]),
            "points.ply, 1.3 of 5.2 MB fetched",
            0.625,
        ),
    ] {
        assert_eq!(fetching.to_string(), words);
        assert_eq!(fetching.share().to_bits(), f32::to_bits(share), "{words}");
    }
}

#[test]
fn a_robot_that_is_not_heard_is_not_waited_for() {
    let model = ModelHandle::of(crate::test_support::scout());
    let hour = Duration::from_hours(1);
    let fetch = |part| fetch(&model, part, hour, |_| unreachable!());
    let ControlFlow::Continue(Ok(way)) = fetch(ExportPart::Trajectory) else {
        panic!();
    };
    let why = "only what was received here: no data from the robot";
    assert_eq!(way.lacks.as_deref(), Some(why));
    let ControlFlow::Continue(Err(why)) = fetch(ExportPart::Voxels) else {
        panic!();
    };
    assert_eq!(
        why.to_string(),
        "no data from the robot. Export it again later"
    );
    let outlines = fetch(ExportPart::Shores);
    assert_eq!(model.lock().trajectory(), TrajectoryProgress::Unwanted);
    assert_eq!(model.lock().voxels(), VoxelsProgress::Unwanted);
    assert!(
        matches!(outlines, ControlFlow::Continue(Ok(_))),
        "there are none"
    );
}

/// The model's questions for the octree.
fn asked(model: &ModelHandle, now: Monotonic) -> Vec<RequestId> {
    let asked = model.lock().outgoing(OpenSessions::BOTH, now);
    let requests = asked.into_iter().filter_map(|asked| match asked {
        Outgoing::Get { request, key, .. } if key.ends_with("/voxels") => Some(request),
        Outgoing::Get { .. } | Outgoing::Put { .. } => None,
    });
    requests.collect()
}

#[test]
fn the_octree_is_asked_for_once_when_the_export_begins() {
    let (hour, now) = (Duration::from_hours(1), clock::now());
    let mut scout = crate::test_support::scout();
    let head = MapHead { layers: Vec::new() };
    inject(&mut scout, Topic::MapHead, &head, now);
    let model = ModelHandle::of(scout);
    let parts = [ExportPart::Shores, ExportPart::Voxels];
    let fetcher = Fetcher::begin(&model, parts, hour);
    let [request] = asked(&model, now)[..] else {
        panic!("it is asked for at once");
    };
    let fetch = |part| fetcher.fetch(part, |_| unreachable!());
    // While the robot makes it, other parts are fetched.
    let outlines = fetch(ExportPart::Shores);
    assert!(matches!(outlines, ControlFlow::Continue(Ok(_))));
    let none = VoxelsReply::None;
    inject_reply(&mut model.lock(), request, Topic::Voxels, &none, now);
    let octree = fetch(ExportPart::Voxels);
    assert!(matches!(octree, ControlFlow::Continue(Ok(_))));
    assert_eq!(model.lock().voxels(), VoxelsProgress::Unwanted);
    assert_eq!(asked(&model, now + hour), []);
}

#[test]
fn who_leaves_an_export_keeps_nothing_of_the_octree() {
    let model = ModelHandle::of(crate::test_support::scout());
    let begin = |part| Fetcher::begin(&model, [part], Duration::ZERO);
    let fetcher = begin(ExportPart::Voxels);
    assert_eq!(model.lock().voxels(), VoxelsProgress::Waiting);
    drop(fetcher);
    assert_eq!(model.lock().voxels(), VoxelsProgress::Unwanted);
    let _other = begin(ExportPart::Trajectory);
    assert_eq!(model.lock().voxels(), VoxelsProgress::Unwanted);
}

#[test]
fn what_is_not_shown_any_more_is_not_waited_for() {
    let mut scout = crate::test_support::scout();
    let head = MapHead { layers: Vec::new() };
    inject(&mut scout, Topic::MapHead, &head, clock::now());
    let model = ModelHandle::of(scout);
    let mut looks = 0;
    let hour = Duration::from_hours(1);
    let fetched = fetch(&model, ExportPart::Trajectory, hour, |_| {
        looks += 1;
        model.leave();
        ControlFlow::Continue(())
    });
    let ControlFlow::Continue(Ok(way)) = fetched else {
        panic!();
    };
    let why = "only what was received here: something else is shown by now";
    assert_eq!((looks, way.lacks.as_deref()), (1, Some(why)));
}

#[test]
fn the_whole_map_of_a_robot_that_has_ended_and_is_gone_is_whole() {
    let (layer, cell_m) = (LayerId::Occupancy, 0.1);
    let mut store = TileStore::new(BOOT, 10);
    store.set_grid(LayerGrid { layer, cell_m }).unwrap();
    let mut model = console("scout", &[layer]);
    let info = Info {
        layers: vec![LayerInfo { layer, cell_m }],
        ..Info::default()
    };
    let ended = Status {
        has_ended: true,
        ..Status::default()
    };
    let pose = Pose {
        position_m: [1.0, 2.0, 0.0],
        quaternion_xyzw: [0.0, 0.0, 0.0, 1.0],
        speed_mps: 0.0,
        turn_rate_radps: 0.0,
        token: None,
    };
    // Long ago.
    announce_map(&mut model, &store, at(1));
    inject_reply(&mut model, RequestId(1), Topic::Info, &info, at(1));
    inject(&mut model, Topic::Pose, &pose, at(1));
    inject(&mut model, Topic::Status, &ended, at(1));
    announce_map(&mut model, &store, at(1));
    model.outgoing(OpenSessions::BOTH, at(1));
    assert!(model.has_ended());
    let model = ModelHandle::of(model);
    let part = ExportPart::Layer(layer);
    let fetched = fetch(&model, part, Duration::ZERO, |_| unreachable!());
    let ControlFlow::Continue(Ok(map)) = fetched else {
        panic!();
    };
    assert_eq!(map.lacks, None);
}

/// How long a robot is waited for that was heard just now and answers nothing.
fn waits(patience: Duration) -> Duration {
    let mut model = crate::test_support::scout();
    let head = MapHead { layers: Vec::new() };
    crate::test_support::inject(&mut model, Topic::MapHead, &head, clock::now());
    let model = ModelHandle::of(model);
    let started = clock::now();
    let fetched = fetch(&model, ExportPart::Trajectory, patience, |_| {
        ControlFlow::Continue(())
    });
    let ControlFlow::Continue(Ok(way)) = fetched else {
        panic!();
    };
    let why = "only what was received here: the robot sends no more of it";
    assert_eq!(way.lacks.as_deref(), Some(why));
    clock::elapsed(started)
}

#[test]
fn a_robot_that_stalls_is_waited_for() {
    // The link counts as silent after 0.4 s, or 1.5 s.
    let patience = Duration::from_millis(1_800);
    assert!(waits(patience) >= patience);
}

#[test]
fn what_begins_anew_is_no_progress() {
    let rising = [Fetching::Requested, Fetching::Tiles(9), Fetching::Tiles(8)];
    let of_voxels = [
        Fetching::Voxels(VoxelFile::Tree, [5, 9]),
        Fetching::Voxels(VoxelFile::Tree, [6, 9]),
        Fetching::Voxels(VoxelFile::Points, [0, 9]),
    ];
    for rising in [rising, of_voxels] {
        assert!(rising.is_sorted_by(|a, b| a.progress() < b.progress()));
    }
    assert!(Fetching::Poses([500, 600]).progress() > Fetching::Poses([0, 600]).progress());
}
