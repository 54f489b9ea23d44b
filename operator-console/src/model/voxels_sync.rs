//! Fetches the octree's files part by part for an export.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::{MAX_PART_BYTES, VoxelFile, VoxelsPart, VoxelsReply, VoxelsRequest};
use protocol::packed_file::PackedFile;

use super::messages::{RejectReason, RequestId};
use super::retry::{ANSWER_TIMEOUT, Backoff};

/// Delay before files that the robot still makes are requested again.
const PREPARING: Duration = Duration::from_millis(500);
/// Limit of open requests. Several at once share the delay of the link and of the window's frames.
const MAX_UNDER_WAY: usize = 8;
/// A slower reply means that the link is saturated: more requests would delay tiles.
const QUICK: Duration = Duration::from_millis(200);
/// Limit of a packed file. An octree of the greatest configurable memory is smaller.
const MAX_PACKED_BYTES: u64 = 512 << 20;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FetchedVoxels {
    /// Stamp of the newest measurement in the files, nanoseconds on the robot's clock.
    pub stamp_ns: i64,
    /// In the order of [`VoxelFile::ALL`].
    pub files: [PackedFile; 2],
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum VoxelsProgress {
    #[default]
    Unwanted,
    Waiting,
    Fetching {
        file: VoxelFile,
        fetched: u64,
        of: u64,
    },
    Ready(Arc<FetchedVoxels>),
    None,
    TooLong,
}

#[derive(Clone, Debug, Default)]
pub(super) struct VoxelsSync {
    pub(super) progress: VoxelsProgress,
    fetching: Option<VoxelsFetch>,
    /// Determines when the next request may be sent.
    query: Backoff,
    under_way: VecDeque<PendingQuery>,
    /// Allowed open requests beyond the first.
    ahead: usize,
    /// Time of the last change of `ahead`. Replies to earlier requests do not change it.
    ahead_since: Monotonic,
}

#[derive(Clone, Copy, Debug)]
struct PendingQuery {
    request: RequestId,
    what: VoxelsRequest,
    at: Monotonic,
}

#[derive(Clone, Debug, Default)]
struct VoxelsFetch {
    /// Snapshot of the files, and the stamp of its newest measurement, nanoseconds.
    snapshot: Option<(u64, i64)>,
    /// Complete files and the incomplete one.
    files: Vec<PackedFile>,
    packed_bytes: u64,
}

impl VoxelsSync {
    pub(super) fn want(&mut self) {
        *self = Self {
            progress: VoxelsProgress::Waiting,
            fetching: Some(VoxelsFetch::default()),
            ..Self::default()
        };
    }

    /// Another run of the robot began: earlier results are void.
    pub(super) fn forget(&mut self) {
        if self.progress != VoxelsProgress::Unwanted {
            self.want();
        }
    }

    pub(super) const fn is_wanted(&self) -> bool {
        self.fetching.is_some()
    }

    /// The next request; called until it returns `None`.
    pub(super) fn query(
        &mut self,
        now: Monotonic,
        number: impl FnOnce() -> RequestId,
    ) -> Option<(RequestId, VoxelsRequest)> {
        if !self.is_wanted() || !self.query.is_due(now) {
            return None;
        }
        let oldest = self.under_way.front();
        if oldest.is_some_and(|asked| now.since(asked.at) >= ANSWER_TIMEOUT) {
            self.query_again();
        }
        let fetching = self.fetching.as_ref()?;
        let what = match self.under_way.back() {
            None => fetching.next(),
            Some(_) if self.under_way.len() > self.ahead => return None,
            Some(last) => fetching.behind(last.what)?,
        };
        let request = number();
        let at = now;
        self.under_way.push_back(PendingQuery { request, what, at });
        Some((request, what))
    }

    /// Takes a reply with data up to `stamp_ns`.
    pub(super) fn take(
        &mut self,
        reply: VoxelsReply,
        stamp_ns: i64,
        request: RequestId,
        now: Monotonic,
    ) -> Result<(), RejectReason> {
        let oldest = self.under_way.front().copied();
        let Some(asked) = oldest.filter(|asked| asked.request == request) else {
            // The replies before it were lost.
            if self.is_under_way(request) {
                self.query_again();
            }
            return Err(RejectReason::OldRevision);
        };
        self.under_way.pop_front();
        let fetching = self.fetching.as_mut().ok_or(RejectReason::OldRevision)?;
        match reply {
            VoxelsReply::None => self.end(VoxelsProgress::None),
            VoxelsReply::Preparing => self.query.not_before = now + PREPARING,
            VoxelsReply::Gone => {
                self.want();
                self.query.fail(now);
                return Ok(());
            }
            VoxelsReply::Part(part) => {
                if part.packed_bytes > MAX_PACKED_BYTES {
                    self.end(VoxelsProgress::TooLong);
                    return Ok(());
                }
                let taken = fetching.take(part, stamp_ns);
                if taken.is_err() {
                    self.query_again();
                    self.query.fail(now);
                    return taken;
                }
                if asked.at >= self.ahead_since {
                    self.ahead_since = now;
                    self.ahead = if now.since(asked.at) > QUICK {
                        self.ahead / 2
                    } else {
                        (self.ahead + 1).min(MAX_UNDER_WAY - 1)
                    };
                }
                let expected = fetching.next();
                self.progress = fetching.progress();
                if let Some(files) = fetching.take_all() {
                    self.end(VoxelsProgress::Ready(Arc::new(files)));
                }
                let next = self.under_way.front();
                if next.is_some_and(|next| next.what != expected) {
                    // The part was shorter than requested.
                    self.query_again();
                }
            }
        }
        self.query.succeed();
        Ok(())
    }

    fn end(&mut self, progress: VoxelsProgress) {
        self.progress = progress;
        self.fetching = None;
    }

    /// No more replies to a request will come; true if it was sent here.
    pub(super) fn ended(&mut self, request: RequestId, now: Monotonic) -> bool {
        let is_unanswered = self.is_under_way(request);
        if is_unanswered {
            self.query_again();
            self.query.fail(now);
        }
        is_unanswered
    }

    fn is_under_way(&self, request: RequestId) -> bool {
        self.under_way.iter().any(|asked| asked.request == request)
    }

    /// Drops the open requests and starts again one part at a time.
    fn query_again(&mut self) {
        self.under_way.clear();
        self.ahead = 0;
    }
}

impl VoxelsFetch {
    fn progress(&self) -> VoxelsProgress {
        let last = self.files.last();
        VoxelsProgress::Fetching {
            file: VoxelFile::ALL[usize::from(self.files.len() == VoxelFile::ALL.len())],
            fetched: last.map_or(0, |file| file.packed.len() as u64),
            of: self.packed_bytes,
        }
    }

    fn is_last_whole(&self) -> bool {
        let last = self.files.last();
        last.is_some_and(|file| file.packed.len() as u64 >= self.packed_bytes)
    }

    fn next(&self) -> VoxelsRequest {
        let whole = self.files.len() - usize::from(!self.files.is_empty() && !self.is_last_whole());
        let begun = self.files.get(whole);
        VoxelsRequest {
            snapshot: self.snapshot.map(|(snapshot, _)| snapshot),
            file: VoxelFile::ALL[usize::from(whole > 0)],
            offset: begun.map_or(0, |file| file.packed.len() as u64),
        }
    }

    /// The request after `asked` in the same file. Its length is known from the first part.
    fn behind(&self, asked: VoxelsRequest) -> Option<VoxelsRequest> {
        let is_begun = !self.files.is_empty() && !self.is_last_whole();
        let offset = asked.offset + MAX_PART_BYTES as u64;
        (is_begun && offset < self.packed_bytes).then_some(VoxelsRequest { offset, ..asked })
    }

    fn take(&mut self, part: VoxelsPart, stamp_ns: i64) -> Result<(), RejectReason> {
        let expected = self.next();
        let is_asked_for = part.file == expected.file
            && part.offset == expected.offset
            && expected.snapshot.is_none_or(|asked| asked == part.snapshot);
        let end = part.offset.saturating_add(part.packed.len() as u64);
        let is_part = !part.packed.is_empty()
            && part.packed.len() <= MAX_PART_BYTES
            && end <= part.packed_bytes;
        if !is_asked_for || !is_part {
            return Err(RejectReason::Malformed);
        }
        if part.offset == 0 {
            self.packed_bytes = part.packed_bytes;
            self.files.push(PackedFile {
                bytes: part.bytes,
                digest: part.digest,
                packed: part.packed,
            });
        } else {
            let last = self.files.last_mut().ok_or(RejectReason::Malformed)?;
            let is_same = last.bytes == part.bytes
                && last.digest == part.digest
                && self.packed_bytes == part.packed_bytes;
            if !is_same {
                return Err(RejectReason::Malformed);
            }
            last.packed.extend(part.packed);
        }
        self.snapshot = Some((part.snapshot, stamp_ns));
        Ok(())
    }

    fn take_all(&mut self) -> Option<FetchedVoxels> {
        if self.files.len() < VoxelFile::ALL.len() || !self.is_last_whole() {
            return None;
        }
        let files = std::mem::take(&mut self.files).try_into().ok()?;
        let (_, stamp_ns) = self.snapshot?;
        Some(FetchedVoxels { stamp_ns, files })
    }
}

#[cfg(test)]
mod tests {
    use edge::publishing::voxel_snapshots::{VoxelSnapshot, VoxelSnapshots};
    use measurement::time::RobotTime;

    use super::*;
    use crate::test_support::at;

    /// Longer than a part when packed, as nothing repeats.
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

    /// The vehicle answers a request.
    fn answer(
        sync: &mut VoxelsSync,
        vehicle: &mut VoxelSnapshots,
        (request, asked): (RequestId, VoxelsRequest),
        ms: u64,
    ) -> Result<(), RejectReason> {
        let (stamp_ns, reply) = vehicle.reply(asked, at(ms));
        sync.take(reply, stamp_ns, request, at(ms))
    }

    fn part() -> VoxelsPart {
        VoxelsPart {
            snapshot: 7,
            file: VoxelFile::Tree,
            bytes: 100,
            digest: [0; 32],
            packed_bytes: 50,
            offset: 0,
            packed: vec![0; 20],
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
    fn both_files_are_fetched_from_a_vehicle() {
        let mut vehicle = VoxelSnapshots::default();
        vehicle.enable();
        let mut sync = VoxelsSync::default();
        let mut number = numbers();
        assert_eq!(sync.progress, VoxelsProgress::Unwanted);
        assert_eq!(sync.query(at(0), &mut number), None);
        sync.want();
        assert_eq!(sync.progress, VoxelsProgress::Waiting);
        let (mut now, mut greatest) = (0, (VoxelFile::Tree, 0));
        while sync.is_wanted() {
            now += 10;
            assert!(now < 10_000, "{sync:?}");
            if vehicle.take_request(RobotTime::from_nanos(5), false) {
                vehicle.put(Some(snapshot(5)), at(now));
            }
            let Some(query) = sync.query(at(now), &mut number) else {
                continue;
            };
            answer(&mut sync, &mut vehicle, query, now).unwrap();
            if let VoxelsProgress::Fetching { file, fetched, of } = sync.progress {
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
        assert_eq!(sync.progress, VoxelsProgress::Ready(Arc::new(expected)));
        assert_eq!(sync.query(at(now), &mut number), None);
    }

    /// Fetches from a vehicle with this reply time; returns the greatest number of open requests and the total time,
    /// milliseconds.
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
            while let Some(query) = sync.query(at(now), &mut number) {
                answered = answered.max(now + way_ms) + answer_ms;
                under_way.push_back((answered, query));
            }
            most = most.max(under_way.len());
            let (then, query) = under_way.pop_front().unwrap();
            now = then;
            answer(&mut sync, &mut vehicle, query, now).unwrap();
        }
        let VoxelsProgress::Ready(fetched) = sync.progress.clone() else {
            panic!("{:?}", sync.progress);
        };
        assert_eq!(fetched.files, made.files);
        (most, now)
    }

    #[test]
    fn read_ahead_adapts_to_the_reply_time() {
        // High latency: 50 parts, most of them requested ahead.
        let (most, ms) = fetched_at(1, 80);
        assert_eq!(most, MAX_UNDER_WAY);
        assert!(ms < 50 * 81 / 3, "{ms} ms");
        // A link of 256 kbit/s: at most one part delays other data.
        assert_eq!(fetched_at(512, 20).0, 1);
        // 2 Mbit/s.
        let (most, _) = fetched_at(65, 20);
        assert!((2..=5).contains(&most), "{most}");
    }

    /// A file after its first parts, and the open requests.
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
            let query = under_way.pop_front().unwrap();
            answer(&mut sync, vehicle, query, 0).unwrap();
        }
        (sync, under_way.into())
    }

    #[test]
    fn requests_after_a_lost_reply_are_repeated() {
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
        // The reply before it is lost without a notice.
        let taken = answer(&mut sync, &mut vehicle, (behind, other), 0);
        assert_eq!(taken, Err(RejectReason::OldRevision));
        assert_eq!(sync.query(at(0), again), Some((RequestId(100), asked)));
        assert_eq!(sync.query(at(0), again), None);
    }

    #[test]
    fn expired_snapshot_restarts_the_fetch() {
        let mut sync = VoxelsSync::default();
        let mut number = numbers();
        sync.want();
        let (request, _) = sync.query(at(0), &mut number).unwrap();
        let reply = VoxelsReply::Part(part());
        sync.take(reply, 1, request, at(0)).unwrap();
        let (request, asked) = sync.query(at(0), &mut number).unwrap();
        assert_eq!((asked.snapshot, asked.offset), (Some(7), 20));
        sync.take(VoxelsReply::Gone, 0, request, at(0)).unwrap();
        assert_eq!(sync.query(at(499), &mut number), None);
        let (_, asked) = sync.query(at(500), &mut number).unwrap();
        assert_eq!((asked.snapshot, asked.offset), (None, 0));
    }

    #[test]
    fn unrequested_replies_are_rejected() {
        let changes: [fn(&mut VoxelsPart); 5] = [
            |part| part.file = VoxelFile::Points,
            |part| part.offset = 1,
            |part| part.packed.clear(),
            |part| part.packed = vec![0; 51],
            |part| part.offset = u64::MAX,
        ];
        for change in changes {
            let mut part = part();
            change(&mut part);
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
            ..part()
        };
        sync.take(VoxelsReply::Part(huge), 1, request, at(0))
            .unwrap();
        assert_eq!(sync.progress, VoxelsProgress::TooLong);
        let late = sync.take(VoxelsReply::Part(part()), 1, request, at(0));
        assert_eq!(late, Err(RejectReason::OldRevision));
    }

    #[test]
    fn unanswered_requests_back_off() {
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
        assert_eq!(sync.progress, VoxelsProgress::None);
    }

    #[test]
    fn new_run_restarts_the_fetch() {
        let mut vehicle = VoxelSnapshots::default();
        vehicle.enable();
        vehicle.put(Some(snapshot(5)), at(0));
        let mut sync = VoxelsSync::default();
        let mut number = numbers();
        sync.forget();
        assert_eq!(sync.progress, VoxelsProgress::Unwanted);
        sync.want();
        while let Some(query) = sync.query(at(0), &mut number) {
            answer(&mut sync, &mut vehicle, query, 0).unwrap();
        }
        assert!(matches!(sync.progress, VoxelsProgress::Ready(_)));
        // No request was sent yet.
        sync.forget();
        assert_eq!(sync.progress, VoxelsProgress::Waiting);
        let (request, asked) = sync.query(at(0), &mut number).unwrap();
        assert_eq!((asked.snapshot, asked.offset), (None, 0));
        sync.take(VoxelsReply::None, 0, request, at(0)).unwrap();
        sync.forget();
        assert_eq!(sync.progress, VoxelsProgress::Waiting);
    }
}
