use measurement::time::RobotTime;
use robot_edge::streaming::voxel_snapshots::{VoxelSnapshot, VoxelSnapshots};

use super::*;
use crate::test_support::at;

/// Longer than a part when it is packed, because nothing in it repeats.
fn long_file(seed: u32) -> PackedFile {
    file_of(40_000, seed)
}

fn file_of(bytes: u32, seed: u32) -> PackedFile {
    let mut state = seed;
    let bytes: Vec<u8> = (0..bytes)
        .map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        })
        .collect();
    PackedFile::pack(|out| out.write_all(&bytes)).unwrap()
}

fn snapshot(stamp_ns: i64) -> VoxelSnapshot {
    VoxelSnapshot {
        stamp: RobotTime::from_nanos(stamp_ns),
        files: [1, 2].map(long_file),
    }
}

fn numbers() -> impl FnMut() -> RequestId {
    let mut number = 0;
    move || {
        number += 1;
        RequestId(number)
    }
}

#[test]
fn both_files_are_fetched_from_what_a_vehicle_answers() {
    let mut vehicle = VoxelSnapshots::default();
    vehicle.enable();
    let mut sync = VoxelsSync::default();
    let mut number = numbers();
    assert_eq!(sync.progress(), VoxelsProgress::Unwanted);
    assert_eq!(sync.query(at(0), &mut number), None);
    sync.want();
    assert_eq!(sync.progress(), VoxelsProgress::Waiting);
    let (mut now, mut greatest) = (0, (VoxelFile::Tree, 0));
    while sync.is_wanted() {
        now += 10;
        assert!(now < 10_000, "{sync:?}");
        if vehicle.take_request(RobotTime::from_nanos(5), false) {
            vehicle.put(Some(snapshot(5)), at(now));
        }
        let Some((request, asked)) = sync.query(at(now), &mut number) else {
            continue;
        };
        let (stamp_ns, reply) = vehicle.reply(asked, at(now));
        sync.take(reply, stamp_ns, request, at(now)).unwrap();
        if let VoxelsProgress::Fetching { file, fetched, of } = sync.progress() {
            let index = usize::from(file == VoxelFile::Points);
            let packed = snapshot(5).files[index].packed.len() as u64;
            assert_eq!(of, packed, "{file:?}");
            let progress = (file, fetched);
            assert!(fetched <= of && progress >= greatest, "{fetched} of {of}");
            greatest = progress;
        }
    }
    assert!(greatest.0 == VoxelFile::Points, "{greatest:?}");
    let expected = FetchedVoxels {
        stamp_ns: 5,
        files: snapshot(5).files,
    };
    assert_eq!(sync.progress(), VoxelsProgress::Ready(Arc::new(expected)));
    assert_eq!(sync.query(at(now), &mut number), None);
}

/// Fetches from a vehicle whose answers take so long, one after the other: the most questions that were under way at once,
/// and when all was there, milliseconds.
fn fetched_at(answer_ms: u64, way_ms: u64) -> (usize, u64) {
    let made = VoxelSnapshot {
        stamp: RobotTime::from_nanos(5),
        files: [3, 4].map(|seed| file_of(400_000, seed)),
    };
    let mut vehicle = VoxelSnapshots::default();
    vehicle.enable();
    vehicle.put(Some(made.clone()), at(0));
    let mut sync = VoxelsSync::default();
    let mut number = numbers();
    sync.want();
    let (mut now, mut most) = (0, 0);
    let (mut under_way, mut answered) = (VecDeque::new(), 0);
    while sync.is_wanted() {
        while let Some((request, asked)) = sync.query(at(now), &mut number) {
            answered = answered.max(now + way_ms) + answer_ms;
            under_way.push_back((answered, request, asked));
        }
        most = most.max(under_way.len());
        let (then, request, asked) = under_way.pop_front().unwrap();
        now = then;
        let (stamp_ns, reply) = vehicle.reply(asked, at(now));
        sync.take(reply, stamp_ns, request, at(now)).unwrap();
    }
    let VoxelsProgress::Ready(fetched) = sync.progress() else {
        panic!("{:?}", sync.progress());
    };
    assert_eq!(fetched.files, made.files);
    (most, now)
}

#[test]
fn parts_are_asked_for_ahead_as_far_as_answers_are_quick() {
    // A long way: 50 parts, most of which are not waited for one by one.
    let (most, ms) = fetched_at(1, 80);
    assert_eq!(most, MAX_UNDER_WAY);
    assert!(ms < 50 * 81 / 3, "{ms} ms");
    // A link of 256 kbit/s: nothing else waits behind more than one part.
    assert_eq!(fetched_at(512, 20).0, 1);
    // One of 2 Mbit/s.
    let (most, _) = fetched_at(65, 20);
    assert!((2..=5).contains(&most), "{most}");
}

/// A file whose first parts came, and the questions that are under way by then.
fn begun(vehicle: &mut VoxelSnapshots) -> (VoxelsSync, Vec<(RequestId, VoxelsRequest)>) {
    vehicle.enable();
    let files = [3, 4].map(|seed| file_of(400_000, seed));
    let stamp = RobotTime::from_nanos(5);
    vehicle.put(Some(VoxelSnapshot { stamp, files }), at(0));
    let mut sync = VoxelsSync::default();
    let mut number = numbers();
    sync.want();
    let mut under_way = VecDeque::new();
    for _ in 0..4 {
        under_way.extend(std::iter::from_fn(|| sync.query(at(0), &mut number)));
        let (request, asked) = under_way.pop_front().unwrap();
        let (stamp_ns, reply) = vehicle.reply(asked, at(0));
        sync.take(reply, stamp_ns, request, at(0)).unwrap();
    }
    (sync, under_way.into())
}

#[test]
fn what_was_asked_for_behind_an_answer_that_is_lost_is_asked_for_again() {
    let mut vehicle = VoxelSnapshots::default();
    let (mut sync, under_way) = begun(&mut vehicle);
    let [(lost, asked), (behind, other), ..] = under_way[..] else {
        panic!("{under_way:?}");
    };
    let again = || RequestId(100);
    let mut after_end = sync.clone();
    assert!(after_end.ended(lost, at(0)));
    assert!(!after_end.ended(behind, at(0)));
    assert_eq!(after_end.query(at(499), again), None);
    assert_eq!(
        after_end.query(at(500), again),
        Some((RequestId(100), asked))
    );
    assert_eq!(after_end.query(at(500), again), None);
    // The answer comes before anything says that the one before it will not.
    let (stamp_ns, reply) = vehicle.reply(other, at(0));
    let taken = sync.take(reply, stamp_ns, behind, at(0));
    assert_eq!(taken, Err(RejectReason::OldRevision));
    assert_eq!(sync.query(at(0), again), Some((RequestId(100), asked)));
    assert_eq!(sync.query(at(0), again), None);
}

#[test]
fn a_moment_that_is_gone_is_begun_anew() {
    let mut sync = VoxelsSync::default();
    let mut number = numbers();
    sync.want();
    let (request, _) = sync.query(at(0), &mut number).unwrap();
    let part = VoxelsPart {
        snapshot: 7,
        file: VoxelFile::Tree,
        bytes: 100,
        digest: [0; 32],
        packed_bytes: 50,
        offset: 0,
        packed: vec![0; 20],
    };
    let reply = VoxelsReply::Part(part);
    sync.take(reply, 1, request, at(0)).unwrap();
    let (request, asked) = sync.query(at(0), &mut number).unwrap();
    assert_eq!((asked.snapshot, asked.offset), (Some(7), 20));
    sync.take(VoxelsReply::Gone, 0, request, at(0)).unwrap();
    assert_eq!(sync.query(at(499), &mut number), None);
    let (_, asked) = sync.query(at(500), &mut number).unwrap();
    assert_eq!((asked.snapshot, asked.offset), (None, 0));
}

#[test]
fn what_was_not_asked_for_is_refused() {
    let part = VoxelsPart {
        snapshot: 7,
        file: VoxelFile::Tree,
        bytes: 100,
        digest: [0; 32],
        packed_bytes: 50,
        offset: 0,
        packed: vec![0; 20],
    };
    let wrong = [
        VoxelsPart {
            file: VoxelFile::Points,
            ..part.clone()
        },
        VoxelsPart {
            offset: 1,
            ..part.clone()
        },
        VoxelsPart {
            packed: vec![],
            ..part.clone()
        },
        VoxelsPart {
            packed: vec![0; 51],
            ..part.clone()
        },
        VoxelsPart {
            offset: u64::MAX,
            ..part.clone()
        },
    ];
    for part in wrong {
        let mut sync = VoxelsSync::default();
        let mut number = numbers();
        sync.want();
        let (request, _) = sync.query(at(0), &mut number).unwrap();
        let said = format!("{part:?}");
        let taken = sync.take(VoxelsReply::Part(part), 1, request, at(0));
        assert_eq!(taken, Err(RejectReason::Malformed), "{said}");
        assert_eq!(sync.query(at(499), &mut number), None);
        assert!(sync.query(at(500), &mut number).is_some());
    }
    let mut sync = VoxelsSync::default();
    sync.want();
    let (request, _) = sync.query(at(0), numbers()).unwrap();
    let huge = VoxelsPart {
        packed_bytes: MAX_PACKED_BYTES + 1,
        ..part.clone()
    };
    sync.take(VoxelsReply::Part(huge), 1, request, at(0))
        .unwrap();
    assert_eq!(sync.progress(), VoxelsProgress::TooLong);
    let late = sync.take(VoxelsReply::Part(part), 1, request, at(0));
    assert_eq!(late, Err(RejectReason::OldRevision));
}

#[test]
fn silence_is_asked_again_less_and_less_often() {
    let mut sync = VoxelsSync::default();
    let mut number = numbers();
    sync.want();
    let mut now = 0;
    for rest in [500, 1000, 2000, 4000, 8000, 8000] {
        let (request, _) = sync.query(at(now), &mut number).unwrap();
        assert!(sync.ended(request, at(now)));
        assert_eq!(sync.query(at(now + rest - 1), &mut number), None);
        now += rest;
    }
    let (request, _) = sync.query(at(now), &mut number).unwrap();
    assert_eq!(sync.query(at(now + 11_999), &mut number), None);
    let (again, _) = sync.query(at(now + 12_000), &mut number).unwrap();
    assert!(!sync.ended(request, at(now + 12_000)));
    sync.take(VoxelsReply::None, 0, again, at(now + 12_000))
        .unwrap();
    assert_eq!(sync.progress(), VoxelsProgress::None);
}

#[test]
fn whoever_waits_while_another_run_begins_gets_the_octree_of_that() {
    let mut vehicle = VoxelSnapshots::default();
    vehicle.enable();
    vehicle.put(Some(snapshot(5)), at(0));
    let mut sync = VoxelsSync::default();
    let mut number = numbers();
    sync.forget();
    assert_eq!(sync.progress(), VoxelsProgress::Unwanted);
    sync.want();
    while let Some((request, asked)) = sync.query(at(0), &mut number) {
        let (stamp_ns, reply) = vehicle.reply(asked, at(0));
        sync.take(reply, stamp_ns, request, at(0)).unwrap();
    }
    assert!(matches!(sync.progress(), VoxelsProgress::Ready(_)));
    // Nobody has taken it yet.
    sync.forget();
    assert_eq!(sync.progress(), VoxelsProgress::Waiting);
    let (request, asked) = sync.query(at(0), &mut number).unwrap();
    assert_eq!((asked.snapshot, asked.offset), (None, 0));
    sync.take(VoxelsReply::None, 0, request, at(0)).unwrap();
    sync.forget();
    assert_eq!(sync.progress(), VoxelsProgress::Waiting);
}
