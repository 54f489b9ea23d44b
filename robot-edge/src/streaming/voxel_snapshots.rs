//! The octree's files as consoles fetch them: made when somebody asks, kept while somebody fetches. Pure.
//!
//! Files, and not voxels as they change: a console draws no voxels, but whoever sits at it wants the same files that the
//! vehicle would write, byte for byte, and that without a second map on the vehicle.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use protocol::message::{MAX_PART_BYTES, VoxelFile, VoxelsPart, VoxelsReply, VoxelsRequest};
use protocol::packed_file::PackedFile;

use crate::clock::Monotonic;
use crate::robot_time::RobotTime;

/// Moments that are kept: one that somebody still fetches, and a newer one for others.
const MAX_KEPT: usize = 2;
/// A moment is new enough for so long.
const FRESH: Duration = Duration::from_secs(10);
/// A moment that nobody has asked for since is kept for so long.
const KEPT: Duration = Duration::from_mins(1);

/// The files of one moment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VoxelSnapshot {
    /// Of its newest measurement.
    pub stamp: RobotTime,
    /// In the order of [`VoxelFile::ALL`].
    pub files: [PackedFile; 2],
}

/// The moments that are kept, and what is wanted.
#[derive(Clone, Debug, Default)]
pub struct VoxelSnapshots {
    is_offered: bool,
    wish: Wish,
    /// Stamp of the newest measurement in the map, as far as is known.
    newest: Option<RobotTime>,
    /// Nothing newer comes for now: what is older than that is not as new as can be.
    is_still: bool,
    /// The newest is last.
    kept: VecDeque<Kept>,
    number: u64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Wish {
    #[default]
    None,
    Open,
    /// Somebody makes it.
    Taken,
    /// It could not be made, at this moment.
    Failed(Monotonic),
}

#[derive(Clone, Debug)]
struct Kept {
    number: u64,
    snapshot: Arc<VoxelSnapshot>,
    made: Monotonic,
    asked: Monotonic,
}

impl VoxelSnapshots {
    /// There is an octree.
    pub const fn offer(&mut self) {
        self.is_offered = true;
    }

    /// The answer to a question, and the stamp of what it tells, nanoseconds; 0 where it tells nothing.
    pub fn answer(&mut self, request: VoxelsRequest, now: Monotonic) -> (i64, VoxelsReply) {
        self.kept.retain(|kept| now.since(kept.asked) < KEPT);
        if !self.is_offered {
            return (0, VoxelsReply::None);
        }
        let (newest, is_still) = (self.newest, self.is_still);
        let found = match request.snapshot {
            Some(number) => self.kept.iter_mut().find(|kept| kept.number == number),
            None => self.kept.back_mut().filter(|kept| {
                let is_fresh = !is_still && now.since(kept.made) < FRESH;
                is_fresh || Some(kept.snapshot.stamp) == newest
            }),
        };
        if let Some(kept) = found {
            kept.asked = now;
            let stamp_ns = kept.snapshot.stamp.as_nanos();
            return (stamp_ns, VoxelsReply::Part(kept.part(request)));
        }
        if request.snapshot.is_some() {
            return (0, VoxelsReply::Gone);
        }
        match self.wish {
            Wish::None => self.wish = Wish::Open,
            Wish::Failed(at) if now.since(at) >= FRESH => self.wish = Wish::Open,
            Wish::Open | Wish::Taken | Wish::Failed(_) => {}
        }
        (0, VoxelsReply::Preparing)
    }

    /// Whether files of the map up to `stamp` are wanted, behind which nothing comes for now where it `is_still`. Whoever hears
    /// so makes them and [puts](Self::put) them.
    pub fn take_wish(&mut self, stamp: RobotTime, is_still: bool) -> bool {
        self.newest = Some(stamp);
        self.is_still = is_still;
        let is_wanted = self.wish == Wish::Open;
        if is_wanted {
            self.wish = Wish::Taken;
        }
        is_wanted
    }

    /// What was wished for; `None` where it could not be made.
    pub fn put(&mut self, snapshot: Option<VoxelSnapshot>, now: Monotonic) {
        let Some(snapshot) = snapshot else {
            self.wish = Wish::Failed(now);
            return;
        };
        self.wish = Wish::None;
        self.number += 1;
        if self.kept.len() >= MAX_KEPT {
            self.kept.pop_front();
        }
        self.kept.push_back(Kept {
            number: self.number,
            snapshot: Arc::new(snapshot),
            made: now,
            asked: now,
        });
    }
}

impl Kept {
    fn part(&self, request: VoxelsRequest) -> VoxelsPart {
        let [tree, points] = &self.snapshot.files;
        let file = match request.file {
            VoxelFile::Tree => tree,
            VoxelFile::Points => points,
        };
        let from = usize::try_from(request.offset).unwrap_or(usize::MAX);
        let rest = file.packed.get(from..).unwrap_or_default();
        VoxelsPart {
            snapshot: self.number,
            file: request.file,
            bytes: file.bytes,
            digest: file.digest,
            packed_bytes: file.packed.len() as u64,
            offset: request.offset,
            packed: rest[..rest.len().min(MAX_PART_BYTES)].to_vec(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn at(s: u64) -> Monotonic {
        Monotonic::from_nanos(s * 1_000_000_000)
    }

    const fn stamp(s: i64) -> RobotTime {
        RobotTime::from_nanos(s * 1_000_000_000)
    }

    fn snapshot(stamp_s: i64, bytes: usize) -> VoxelSnapshot {
        let file = |byte: u8| PackedFile {
            bytes: 2 * bytes as u64,
            digest: [byte; 32],
            packed: (0..bytes).map(|at| at as u8 ^ byte).collect(),
        };
        VoxelSnapshot {
            stamp: stamp(stamp_s),
            files: [file(1), file(2)],
        }
    }

    const fn newest(file: VoxelFile) -> VoxelsRequest {
        VoxelsRequest {
            snapshot: None,
            file,
            offset: 0,
        }
    }

    fn part(reply: VoxelsReply) -> VoxelsPart {
        let VoxelsReply::Part(part) = reply else {
            panic!("{reply:?}")
        };
        part
    }

    #[test]
    fn nothing_is_made_before_it_is_asked_for_and_then_once() {
        let mut voxels = VoxelSnapshots::default();
        let ask = newest(VoxelFile::Tree);
        assert_eq!(voxels.answer(ask, at(0)), (0, VoxelsReply::None));
        assert!(!voxels.take_wish(stamp(1), false));
        voxels.offer();
        for _ in 0..2 {
            assert_eq!(voxels.answer(ask, at(0)), (0, VoxelsReply::Preparing));
        }
        assert!(voxels.take_wish(stamp(1), false));
        assert!(!voxels.take_wish(stamp(2), false));
        assert_eq!(voxels.answer(ask, at(1)), (0, VoxelsReply::Preparing));
        voxels.put(Some(snapshot(1, 10)), at(2));
        let (stamp_ns, reply) = voxels.answer(ask, at(3));
        assert_eq!(stamp_ns, 1_000_000_000);
        assert_eq!(part(reply).snapshot, 1);
        assert!(!voxels.take_wish(stamp(3), false));
    }

    #[test]
    fn a_file_is_fetched_part_by_part() {
        let mut voxels = VoxelSnapshots::default();
        voxels.offer();
        let made = snapshot(1, 2 * MAX_PART_BYTES + 5);
        voxels.put(Some(made.clone()), at(0));
        for (file, expected) in VoxelFile::ALL.into_iter().zip(&made.files) {
            let mut fetched = Vec::new();
            for length in [MAX_PART_BYTES, MAX_PART_BYTES, 5, 0] {
                let request = VoxelsRequest {
                    snapshot: Some(1),
                    file,
                    offset: fetched.len() as u64,
                };
                let part = part(voxels.answer(request, at(0)).1);
                assert_eq!((part.file, part.offset), (file, request.offset));
                assert_eq!((part.bytes, part.digest), (expected.bytes, expected.digest));
                assert_eq!(part.packed_bytes, expected.packed.len() as u64);
                assert_eq!(part.packed.len(), length);
                fetched.extend(part.packed);
            }
            assert_eq!(fetched, expected.packed);
        }
        let beyond = VoxelsRequest {
            snapshot: Some(1),
            file: VoxelFile::Tree,
            offset: u64::MAX,
        };
        assert!(part(voxels.answer(beyond, at(0)).1).packed.is_empty());
    }

    #[test]
    fn a_moment_is_new_enough_for_a_while_or_until_something_comes() {
        let mut voxels = VoxelSnapshots::default();
        voxels.offer();
        let ask = newest(VoxelFile::Points);
        assert!(!voxels.take_wish(stamp(1), false));
        voxels.put(Some(snapshot(1, 10)), at(0));
        assert_eq!(part(voxels.answer(ask, at(30)).1).snapshot, 1);
        assert!(!voxels.take_wish(stamp(2), false));
        assert_eq!(voxels.answer(ask, at(31)).1, VoxelsReply::Preparing);
        assert!(voxels.take_wish(stamp(3), false));
        voxels.put(Some(snapshot(3, 10)), at(32));
        assert!(!voxels.take_wish(stamp(4), false));
        assert_eq!(part(voxels.answer(ask, at(41)).1).snapshot, 2);
        assert_eq!(voxels.answer(ask, at(42)).1, VoxelsReply::Preparing);
    }

    #[test]
    fn two_moments_are_kept_and_none_for_ever() {
        let mut voxels = VoxelSnapshots::default();
        voxels.offer();
        for number in 1..=3 {
            voxels.put(Some(snapshot(number, 10)), at(0));
        }
        let of = |number| VoxelsRequest {
            snapshot: Some(number),
            ..newest(VoxelFile::Tree)
        };
        assert_eq!(voxels.answer(of(1), at(1)).1, VoxelsReply::Gone);
        assert_eq!(part(voxels.answer(of(2), at(59)).1).snapshot, 2);
        assert_eq!(part(voxels.answer(of(2), at(118)).1).snapshot, 2);
        assert_eq!(voxels.answer(of(3), at(118)).1, VoxelsReply::Gone);
        assert_eq!(voxels.answer(of(2), at(178)).1, VoxelsReply::Gone);
    }

    #[test]
    fn what_cannot_be_made_is_not_tried_all_the_time() {
        let mut voxels = VoxelSnapshots::default();
        voxels.offer();
        let ask = newest(VoxelFile::Tree);
        assert_eq!(voxels.answer(ask, at(0)).1, VoxelsReply::Preparing);
        assert!(voxels.take_wish(stamp(0), false));
        voxels.put(None, at(1));
        assert_eq!(voxels.answer(ask, at(10)).1, VoxelsReply::Preparing);
        assert!(!voxels.take_wish(stamp(0), false));
        assert_eq!(voxels.answer(ask, at(11)).1, VoxelsReply::Preparing);
        assert!(voxels.take_wish(stamp(0), false));
    }

    #[test]
    fn where_nothing_comes_any_more_only_the_end_is_new_enough() {
        let mut voxels = VoxelSnapshots::default();
        voxels.offer();
        let ask = newest(VoxelFile::Tree);
        voxels.put(Some(snapshot(1, 10)), at(0));
        assert!(!voxels.take_wish(stamp(2), false));
        assert_eq!(part(voxels.answer(ask, at(1)).1).snapshot, 1);
        assert!(!voxels.take_wish(stamp(2), true));
        assert_eq!(voxels.answer(ask, at(1)).1, VoxelsReply::Preparing);
        assert!(voxels.take_wish(stamp(2), true));
        voxels.put(Some(snapshot(2, 10)), at(2));
        assert_eq!(part(voxels.answer(ask, at(30)).1).snapshot, 2);
    }
}
