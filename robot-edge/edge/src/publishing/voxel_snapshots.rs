//! The octree files for consoles: made on request, kept while they are downloaded. Pure.
//!
//! A console does not draw voxels, but an operator can save the files that the vehicle would write, without a second
//! map on the vehicle.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use protocol::message::{MAX_PART_BYTES, VoxelFile, VoxelsPart, VoxelsReply, VoxelsRequest};
use protocol::packed_file::PackedFile;

use measurement::time::Monotonic;
use measurement::time::RobotTime;

/// Maximum number of snapshots: one that is being downloaded, and a newer one.
const MAX_CACHED: usize = 2;
/// A snapshot is current for this time.
const MAX_AGE: Duration = Duration::from_secs(10);
/// A snapshot without requests is kept for this time.
const CACHE_TIMEOUT: Duration = Duration::from_mins(1);

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VoxelSnapshot {
    /// Stamp of the newest measurement.
    pub stamp: RobotTime,
    /// In the order of [`VoxelFile::ALL`].
    pub files: [PackedFile; 2],
}

#[derive(Clone, Debug, Default)]
pub struct VoxelSnapshots {
    is_enabled: bool,
    request_state: RequestState,
    /// Stamp of the newest measurement in the map.
    newest: Option<RobotTime>,
    /// No newer data is expected, so that older snapshots are outdated.
    is_paused: bool,
    /// Oldest first.
    cached: VecDeque<CachedSnapshot>,
    number: u64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum RequestState {
    #[default]
    None,
    Requested,
    InProgress,
    Failed(Monotonic),
}

#[derive(Clone, Debug)]
struct CachedSnapshot {
    number: u64,
    snapshot: Arc<VoxelSnapshot>,
    made: Monotonic,
    requested_at: Monotonic,
}

impl VoxelSnapshots {
    pub const fn enable(&mut self) {
        self.is_enabled = true;
    }

    /// The reply to a query and its stamp, nanoseconds; 0 without a snapshot.
    pub fn reply(&mut self, request: VoxelsRequest, now: Monotonic) -> (i64, VoxelsReply) {
        self.cached
            .retain(|cached| now.since(cached.requested_at) < CACHE_TIMEOUT);
        if !self.is_enabled {
            return (0, VoxelsReply::None);
        }
        let (newest, is_paused) = (self.newest, self.is_paused);
        let found = match request.snapshot {
            Some(number) => self
                .cached
                .iter_mut()
                .find(|cached| cached.number == number),
            None => self.cached.back_mut().filter(|cached| {
                let is_fresh = !is_paused && now.since(cached.made) < MAX_AGE;
                is_fresh || Some(cached.snapshot.stamp) == newest
            }),
        };
        if let Some(cached) = found {
            cached.requested_at = now;
            let stamp_ns = cached.snapshot.stamp.as_nanos();
            return (stamp_ns, VoxelsReply::Part(cached.part(request)));
        }
        if request.snapshot.is_some() {
            return (0, VoxelsReply::Gone);
        }
        match self.request_state {
            RequestState::None => self.request_state = RequestState::Requested,
            RequestState::Failed(at) if now.since(at) >= MAX_AGE => {
                self.request_state = RequestState::Requested;
            }
            RequestState::Requested | RequestState::InProgress | RequestState::Failed(_) => {}
        }
        (0, VoxelsReply::Preparing)
    }

    /// Whether files of the map up to `stamp` are wanted. If so, the caller makes and [puts](Self::put) them.
    /// `is_paused`: no newer data is expected.
    pub fn take_request(&mut self, stamp: RobotTime, is_paused: bool) -> bool {
        self.newest = Some(stamp);
        self.is_paused = is_paused;
        let is_wanted = self.request_state == RequestState::Requested;
        if is_wanted {
            self.request_state = RequestState::InProgress;
        }
        is_wanted
    }

    /// Sets the files; `None` if they could not be made.
    pub fn put(&mut self, snapshot: Option<VoxelSnapshot>, now: Monotonic) {
        let Some(snapshot) = snapshot else {
            self.request_state = RequestState::Failed(now);
            return;
        };
        self.request_state = RequestState::None;
        self.number += 1;
        if self.cached.len() >= MAX_CACHED {
            self.cached.pop_front();
        }
        self.cached.push_back(CachedSnapshot {
            number: self.number,
            snapshot: Arc::new(snapshot),
            made: now,
            requested_at: now,
        });
    }
}

impl CachedSnapshot {
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
        assert_eq!(voxels.reply(ask, at(0)), (0, VoxelsReply::None));
        assert!(!voxels.take_request(stamp(1), false));
        voxels.enable();
        for _ in 0..2 {
            assert_eq!(voxels.reply(ask, at(0)), (0, VoxelsReply::Preparing));
        }
        assert!(voxels.take_request(stamp(1), false));
        assert!(!voxels.take_request(stamp(2), false));
        assert_eq!(voxels.reply(ask, at(1)), (0, VoxelsReply::Preparing));
        voxels.put(Some(snapshot(1, 10)), at(2));
        let (stamp_ns, reply) = voxels.reply(ask, at(3));
        assert_eq!(stamp_ns, 1_000_000_000);
        assert_eq!(part(reply).snapshot, 1);
        assert!(!voxels.take_request(stamp(3), false));
    }

    #[test]
    fn a_file_is_fetched_part_by_part() {
        let mut voxels = VoxelSnapshots::default();
        voxels.enable();
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
                let part = part(voxels.reply(request, at(0)).1);
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
        assert!(part(voxels.reply(beyond, at(0)).1).packed.is_empty());
    }

    #[test]
    fn a_moment_is_new_enough_for_a_while_or_until_something_comes() {
        let mut voxels = VoxelSnapshots::default();
        voxels.enable();
        let ask = newest(VoxelFile::Points);
        assert!(!voxels.take_request(stamp(1), false));
        voxels.put(Some(snapshot(1, 10)), at(0));
        assert_eq!(part(voxels.reply(ask, at(30)).1).snapshot, 1);
        assert!(!voxels.take_request(stamp(2), false));
        assert_eq!(voxels.reply(ask, at(31)).1, VoxelsReply::Preparing);
        assert!(voxels.take_request(stamp(3), false));
        voxels.put(Some(snapshot(3, 10)), at(32));
        assert!(!voxels.take_request(stamp(4), false));
        assert_eq!(part(voxels.reply(ask, at(41)).1).snapshot, 2);
        assert_eq!(voxels.reply(ask, at(42)).1, VoxelsReply::Preparing);
    }

    #[test]
    fn two_moments_are_kept_and_none_for_ever() {
        let mut voxels = VoxelSnapshots::default();
        voxels.enable();
        for number in 1..=3 {
            voxels.put(Some(snapshot(number, 10)), at(0));
        }
        let of = |number| VoxelsRequest {
            snapshot: Some(number),
            ..newest(VoxelFile::Tree)
        };
        assert_eq!(voxels.reply(of(1), at(1)).1, VoxelsReply::Gone);
        assert_eq!(part(voxels.reply(of(2), at(59)).1).snapshot, 2);
        assert_eq!(part(voxels.reply(of(2), at(118)).1).snapshot, 2);
        assert_eq!(voxels.reply(of(3), at(118)).1, VoxelsReply::Gone);
        assert_eq!(voxels.reply(of(2), at(178)).1, VoxelsReply::Gone);
    }

    #[test]
    fn what_cannot_be_made_is_not_tried_all_the_time() {
        let mut voxels = VoxelSnapshots::default();
        voxels.enable();
        let ask = newest(VoxelFile::Tree);
        assert_eq!(voxels.reply(ask, at(0)).1, VoxelsReply::Preparing);
        assert!(voxels.take_request(stamp(0), false));
        voxels.put(None, at(1));
        assert_eq!(voxels.reply(ask, at(10)).1, VoxelsReply::Preparing);
        assert!(!voxels.take_request(stamp(0), false));
        assert_eq!(voxels.reply(ask, at(11)).1, VoxelsReply::Preparing);
        assert!(voxels.take_request(stamp(0), false));
    }

    #[test]
    fn where_nothing_comes_any_more_only_the_end_is_new_enough() {
        let mut voxels = VoxelSnapshots::default();
        voxels.enable();
        let ask = newest(VoxelFile::Tree);
        voxels.put(Some(snapshot(1, 10)), at(0));
        assert!(!voxels.take_request(stamp(2), false));
        assert_eq!(part(voxels.reply(ask, at(1)).1).snapshot, 1);
        assert!(!voxels.take_request(stamp(2), true));
        assert_eq!(voxels.reply(ask, at(1)).1, VoxelsReply::Preparing);
        assert!(voxels.take_request(stamp(2), true));
        voxels.put(Some(snapshot(2, 10)), at(2));
        assert_eq!(part(voxels.reply(ask, at(30)).1).snapshot, 2);
    }
}
