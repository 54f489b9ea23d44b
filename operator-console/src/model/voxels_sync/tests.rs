use robot_edge::robot_time::RobotTime;
use robot_edge::streaming::voxel_snapshots::{VoxelSnapshot, VoxelSnapshots};

use super::*;
use crate::pretend::at;

/// Longer than a part when it is packed, because nothing in it repeats.
fn long_file(seed: u32) -> PackedFile {
    let mut state = seed;
    let bytes: Vec<u8> = (0..40_000)
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
    vehicle.offer();
    let mut sync = VoxelsSync::default();
    let mut number = numbers();
    assert_eq!(sync.progress(), VoxelsProgress::Unwanted);
    assert_eq!(sync.question(at(0), &mut number), None);
    sync.want();
    assert_eq!(sync.progress(), VoxelsProgress::Waiting);
    let (mut now, mut greatest) = (0, (VoxelFile::Tree, 0));
    while sync.is_wanted() {
        now += 10;
        assert!(now < 10_000, "{sync:?}");
        if vehicle.take_wish(RobotTime::from_nanos(5), false) {
            vehicle.put(Some(snapshot(5)), at(now));
        }
        let Some((request, asked)) = sync.question(at(now), &mut number) else {
            continue;
        };
        let (stamp_ns, reply) = vehicle.answer(asked, at(now));
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
    assert_eq!(sync.question(at(now), &mut number), None);
}

#[test]
fn a_moment_that_is_gone_is_begun_anew() {
    let mut sync = VoxelsSync::default();
    let mut number = numbers();
    sync.want();
    let (request, _) = sync.question(at(0), &mut number).unwrap();
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
    let (request, asked) = sync.question(at(0), &mut number).unwrap();
    assert_eq!((asked.snapshot, asked.offset), (Some(7), 20));
    sync.take(VoxelsReply::Gone, 0, request, at(0)).unwrap();
    assert_eq!(sync.question(at(499), &mut number), None);
    let (_, asked) = sync.question(at(500), &mut number).unwrap();
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
        let (request, _) = sync.question(at(0), &mut number).unwrap();
        let said = format!("{part:?}");
        let taken = sync.take(VoxelsReply::Part(part), 1, request, at(0));
        assert_eq!(taken, Err(Refusal::Malformed), "{said}");
        assert_eq!(sync.question(at(499), &mut number), None);
        assert!(sync.question(at(500), &mut number).is_some());
    }
    let mut sync = VoxelsSync::default();
    sync.want();
    let (request, _) = sync.question(at(0), numbers()).unwrap();
    let huge = VoxelsPart {
        packed_bytes: MAX_PACKED_BYTES + 1,
        ..part.clone()
    };
    sync.take(VoxelsReply::Part(huge), 1, request, at(0))
        .unwrap();
    assert_eq!(sync.progress(), VoxelsProgress::TooLong);
    let late = sync.take(VoxelsReply::Part(part), 1, request, at(0));
    assert_eq!(late, Err(Refusal::OldRevision));
}

#[test]
fn silence_is_asked_again_less_and_less_often() {
    let mut sync = VoxelsSync::default();
    let mut number = numbers();
    sync.want();
    let mut now = 0;
    for rest in [500, 1000, 2000, 4000, 8000, 8000] {
        let (request, _) = sync.question(at(now), &mut number).unwrap();
        assert!(sync.ended(request, at(now)));
        assert_eq!(sync.question(at(now + rest - 1), &mut number), None);
        now += rest;
    }
    let (request, _) = sync.question(at(now), &mut number).unwrap();
    assert_eq!(sync.question(at(now + 11_999), &mut number), None);
    let (again, _) = sync.question(at(now + 12_000), &mut number).unwrap();
    assert!(!sync.ended(request, at(now + 12_000)));
    sync.take(VoxelsReply::None, 0, again, at(now + 12_000))
        .unwrap();
    assert_eq!(sync.progress(), VoxelsProgress::None);
}
