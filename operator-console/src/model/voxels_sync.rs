//! The octree's files, fetched part by part when somebody wants them. Pure: the present is a parameter.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::{MAX_PART_BYTES, VoxelFile, VoxelsPart, VoxelsReply, VoxelsRequest};
use protocol::packed_file::PackedFile;

use super::incoming::RequestId;
use super::reject_reason::RejectReason;
use super::retry::{ANSWER_TIMEOUT, RetryTimer};

/// Until files that are being made are asked for again.
const PREPARING: Duration = Duration::from_millis(500);
/// Questions that are under way at most: the link, and a window that draws, are waited for once for all of them.
const MAX_UNDER_WAY: usize = 8;
/// An answer that takes longer than this comes over a link that has no more to give: what is asked for beyond it would only
/// hold up tiles.
const QUICK: Duration = Duration::from_millis(200);
/// Longest file, packed. An octree of the greatest memory that a vehicle may be given makes less.
const MAX_PACKED_BYTES: u64 = 512 << 20;

/// The files of one moment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FetchedVoxels {
    /// Stamp of the newest measurement in them, nanoseconds on the robot's clock.
    pub stamp_ns: i64,
    /// In the order of [`VoxelFile::ALL`].
    pub files: [PackedFile; 2],
}

/// How far fetching is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum VoxelsProgress {
    /// Nobody wants the files.
    Unwanted,
    /// They are asked for, or being made.
    Waiting,
    /// Parts of the files come, one file after the other.
    Fetching {
        /// The file that comes.
        file: VoxelFile,
        /// Bytes of it that came, packed.
        fetched: u64,
        /// Bytes that it has, packed.
        of: u64,
    },
    /// Here they are.
    Ready(Arc<FetchedVoxels>),
    /// The robot has no octree.
    None,
    /// They are longer than a console takes.
    TooLong,
}

/// Fetches the files of one run of a robot.
#[derive(Clone, Debug, Default)]
pub(super) struct VoxelsSync {
    phase: Phase,
    /// When the next question may be asked.
    query: RetryTimer,
    /// What was asked, in the order in which it is answered.
    under_way: VecDeque<PendingQuery>,
    /// Questions that may be under way beyond the first.
    ahead: usize,
    /// Since when. Answers to what was asked before say nothing of it.
    ahead_since: Monotonic,
}

#[derive(Clone, Copy, Debug)]
struct PendingQuery {
    request: RequestId,
    what: VoxelsRequest,
    at: Monotonic,
}

#[derive(Clone, Debug, Default)]
enum Phase {
    #[default]
    Unwanted,
    Fetching(Fetching),
    Ready(Arc<FetchedVoxels>),
    None,
    TooLong,
}

#[derive(Clone, Debug, Default)]
struct Fetching {
    /// Once it is known.
    moment: Option<Moment>,
    /// Those that are whole, and the one that is not yet.
    files: Vec<PackedFile>,
    /// Length of the last of them.
    packed_bytes: u64,
}

#[derive(Clone, Copy, Debug)]
struct Moment {
    snapshot: u64,
    stamp_ns: i64,
}

impl VoxelsSync {
    /// The files are wanted as they are now, whatever was fetched before.
    pub(super) fn want(&mut self) {
        *self = Self {
            phase: Phase::Fetching(Fetching::default()),
            ..Self::default()
        };
    }

    /// Nobody wants the files any more.
    pub(super) fn drop_all(&mut self) {
        *self = Self::default();
    }

    /// Another run of the robot began: what came of the last one, or that it had no octree, says nothing of this.
    pub(super) fn forget(&mut self) {
        if !matches!(self.phase, Phase::Unwanted) {
            self.want();
        }
    }

    /// Whether somebody waits for files.
    pub(super) const fn is_wanted(&self) -> bool {
        matches!(self.phase, Phase::Fetching(_))
    }

    pub(super) fn progress(&self) -> VoxelsProgress {
        match &self.phase {
            Phase::Unwanted => VoxelsProgress::Unwanted,
            Phase::Fetching(fetching) if fetching.moment.is_none() => VoxelsProgress::Waiting,
            Phase::Fetching(fetching) => fetching.progress(),
            Phase::Ready(files) => VoxelsProgress::Ready(Arc::clone(files)),
            Phase::None => VoxelsProgress::None,
            Phase::TooLong => VoxelsProgress::TooLong,
        }
    }

    /// What to ask now, until it is nothing; `number` numbers the question.
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
        let Phase::Fetching(fetching) = &self.phase else {
            return None;
        };
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

    /// An answer to `request`, of data up to `stamp_ns`.
    pub(super) fn take(
        &mut self,
        reply: VoxelsReply,
        stamp_ns: i64,
        request: RequestId,
        now: Monotonic,
    ) -> Result<(), RejectReason> {
        let oldest = self.under_way.front().copied();
        let Some(asked) = oldest.filter(|asked| asked.request == request) else {
            // What lies before it has not come, and will not.
            if self.is_under_way(request) {
                self.query_again();
            }
            return Err(RejectReason::OldRevision);
        };
        self.under_way.pop_front();
        let Phase::Fetching(fetching) = &mut self.phase else {
            return Err(RejectReason::OldRevision);
        };
        match reply {
            VoxelsReply::None => self.phase = Phase::None,
            VoxelsReply::Preparing => self.query.wait_until(now + PREPARING),
            VoxelsReply::Gone => {
                self.want();
                self.query.fail(now);
                return Ok(());
            }
            VoxelsReply::Part(part) => {
                if part.packed_bytes > MAX_PACKED_BYTES {
                    self.phase = Phase::TooLong;
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
                if let Some(files) = fetching.take_all() {
                    self.phase = Phase::Ready(Arc::new(files));
                }
                let next = self.under_way.front();
                if next.is_some_and(|next| next.what != expected) {
                    // The part was shorter than what is asked for.
                    self.query_again();
                }
            }
        }
        self.query.succeed();
        Ok(())
    }

    /// No more answers to a question will come; true if it was asked here.
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

    /// What is under way is of no use any more: it is asked for again, one part at a time first.
    fn query_again(&mut self) {
        self.under_way.clear();
        self.ahead = 0;
    }
}

impl Fetching {
    fn progress(&self) -> VoxelsProgress {
        let last = self.files.last();
        VoxelsProgress::Fetching {
            file: if self.files.len() < VoxelFile::ALL.len() {
                VoxelFile::Tree
            } else {
                VoxelFile::Points
            },
            fetched: last.map_or(0, |file| file.packed.len() as u64),
            of: self.packed_bytes,
        }
    }

    fn is_last_whole(&self) -> bool {
        let last = self.files.last();
        last.is_some_and(|file| file.packed.len() as u64 >= self.packed_bytes)
    }

    /// Which file, and where in it.
    fn next(&self) -> VoxelsRequest {
        let whole = self.files.len() - usize::from(!self.files.is_empty() && !self.is_last_whole());
        let begun = self.files.get(whole);
        VoxelsRequest {
            snapshot: self.moment.map(|moment| moment.snapshot),
            file: if whole == 0 {
                VoxelFile::Tree
            } else {
                VoxelFile::Points
            },
            offset: begun.map_or(0, |file| file.packed.len() as u64),
        }
    }

    /// What lies behind something that is under way, in the same file. How long that is, its first part says.
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
        self.moment = Some(Moment {
            snapshot: part.snapshot,
            stamp_ns,
        });
        Ok(())
    }

    /// Both files, where they are whole.
    fn take_all(&mut self) -> Option<FetchedVoxels> {
        if self.files.len() < VoxelFile::ALL.len() || !self.is_last_whole() {
            return None;
        }
        let files = std::mem::take(&mut self.files).try_into().ok()?;
        let stamp_ns = self.moment?.stamp_ns;
        Some(FetchedVoxels { stamp_ns, files })
    }
}

#[cfg(test)]
mod tests;
