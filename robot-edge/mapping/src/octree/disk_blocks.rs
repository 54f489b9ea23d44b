//! Blocks that the memory limit made coarse or evicted, as they were, in a file.

use std::collections::HashMap;
use std::fmt::Debug;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rustc_hash::FxBuildHasher;

use crate::octree::block::Block;
use crate::octree::voxel_address::BlockIndex;

/// A file for what memory has no room for.
pub trait BlockFile: Debug + Send + Sync {
    /// Writes bytes at an offset; `false` if that failed.
    fn write(&self, bytes: &[u8], offset: u64) -> bool;
    /// Reads as many bytes from an offset; `false` if that failed.
    fn read(&self, bytes: &mut [u8], offset: u64) -> bool;
}

/// Blocks on disk. Copies share the file, and each place in it as long as one of them needs it.
#[derive(Clone, Debug, Default)]
pub(super) struct DiskBlocks {
    disk: Option<Arc<Disk>>,
    places: HashMap<BlockIndex, Arc<Place>, FxBuildHasher>,
    failures: usize,
}

/// A part of a file.
#[derive(Debug)]
struct Disk {
    file: Arc<dyn BlockFile>,
    end_bytes: u64,
    room: Mutex<Room>,
}

#[derive(Debug)]
struct Room {
    /// Unused places of 2ⁿ bytes, by n.
    unused: Vec<Vec<u64>>,
    /// What follows was never used.
    used_bytes: u64,
}

#[derive(Debug)]
struct Place {
    disk: Arc<Disk>,
    offset: u64,
    bytes: usize,
}

impl DiskBlocks {
    /// In the bytes of `file` from `first` to `end`.
    pub(super) fn new(file: Arc<dyn BlockFile>, first_bytes: u64, end_bytes: u64) -> Self {
        let room = Mutex::new(Room {
            unused: Vec::new(),
            used_bytes: first_bytes,
        });
        Self {
            disk: Some(Arc::new(Disk {
                file,
                end_bytes,
                room,
            })),
            ..Self::default()
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    pub(super) fn contains(&self, index: BlockIndex) -> bool {
        self.places.contains_key(&index)
    }

    pub(super) fn indices(&self) -> impl Iterator<Item = BlockIndex> + '_ {
        self.places.keys().copied()
    }

    /// Stores a block that is not stored; `false` if there is no room for it, or if it cannot be written.
    pub(super) fn store(&mut self, block: &Block) -> bool {
        let Some(disk) = &self.disk else {
            return false;
        };
        let record = block.to_bytes();
        let Some(offset) = disk.take_room(record.len()) else {
            return false;
        };
        let place = Place {
            disk: Arc::clone(disk),
            offset,
            bytes: record.len(),
        };
        let is_written = disk.file.write(&record, offset);
        if is_written {
            self.places.insert(block.index, Arc::new(place));
        } else {
            self.failures += 1;
        }
        is_written
    }

    /// Reads a block; `None` if it is not stored or cannot be read.
    pub(super) fn read(&self, index: BlockIndex) -> Option<Block> {
        self.places.get(&index)?.read(index)
    }

    /// Reads a block and frees its place.
    pub(super) fn take(&mut self, index: BlockIndex) -> Option<Block> {
        let block = self.places.remove(&index)?.read(index);
        self.failures += usize::from(block.is_none());
        block
    }

    /// Forgets the blocks that `is_kept` does not accept.
    pub(super) fn retain(&mut self, is_kept: impl Fn(BlockIndex) -> bool) {
        self.places.retain(|&index, _| is_kept(index));
    }

    /// Blocks that could not be written or read since the last call.
    pub(super) const fn take_failures(&mut self) -> usize {
        std::mem::replace(&mut self.failures, 0)
    }

    /// Memory of the index.
    pub(super) fn bytes(&self) -> usize {
        self.places.capacity() * (size_of::<(BlockIndex, Arc<Place>)>() + 1)
            + self.places.len() * (size_of::<Place>() + 2 * size_of::<usize>())
    }
}

impl Disk {
    fn room(&self) -> MutexGuard<'_, Room> {
        // No panic leaves it half changed.
        self.room.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Where so many bytes go; `None` if there is no room.
    fn take_room(&self, bytes: usize) -> Option<u64> {
        let mut room = self.room();
        let class = class(bytes);
        if room.unused.len() <= class {
            room.unused.resize(class + 1, Vec::new());
        }
        room.unused[class].pop().or_else(|| {
            let offset = room.used_bytes;
            let used_bytes = offset + (1 << class);
            (used_bytes <= self.end_bytes).then(|| {
                room.used_bytes = used_bytes;
                offset
            })
        })
    }
}

impl Place {
    fn read(&self, index: BlockIndex) -> Option<Block> {
        let mut record = vec![0; self.bytes];
        let is_read = self.disk.file.read(&mut record, self.offset);
        is_read.then(|| Block::from_bytes(index, &record))?
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.disk.room().unused[class(self.bytes)].push(self.offset);
    }
}

/// Logarithm of the room that so many bytes take.
const fn class(bytes: usize) -> usize {
    bytes.next_power_of_two().trailing_zeros() as usize
}

#[cfg(test)]
pub(super) mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;

    /// A file in memory, which may fail.
    #[derive(Debug, Default)]
    pub(in crate::octree) struct TestFile {
        bytes: Mutex<Vec<u8>>,
        pub(in crate::octree) fails: AtomicBool,
    }

    impl BlockFile for TestFile {
        fn write(&self, bytes: &[u8], offset: u64) -> bool {
            let mut held = self.bytes.lock().unwrap();
            let end = offset as usize + bytes.len();
            if held.len() < end {
                held.resize(end, 0);
            }
            held[offset as usize..end].copy_from_slice(bytes);
            !self.fails.load(Ordering::Relaxed)
        }

        fn read(&self, bytes: &mut [u8], offset: u64) -> bool {
            let held = self.bytes.lock().unwrap();
            bytes.copy_from_slice(&held[offset as usize..][..bytes.len()]);
            !self.fails.load(Ordering::Relaxed)
        }
    }

    fn block(x: i32) -> Block {
        Block::new(BlockIndex { x, y: 0, z: 0 })
    }

    #[test]
    fn failures_of_the_disk_are_counted() {
        let file = Arc::new(TestFile::default());
        let mut blocks = DiskBlocks::new(file.clone(), 0, 1_000_000);
        assert!(blocks.store(&block(0)) && blocks.store(&block(1)));
        file.fails.store(true, Ordering::Relaxed);
        assert!(!blocks.store(&block(2)));
        let first = block(0).index;
        assert!(blocks.read(first).is_none() && blocks.take(first).is_none());
        assert_eq!((blocks.take_failures(), blocks.take_failures()), (2, 0));
        assert!(!blocks.contains(first) && blocks.contains(block(1).index));
        assert!(!DiskBlocks::default().store(&block(0)), "no file");
    }

    #[test]
    fn a_place_is_used_again_after_its_last_copy() {
        let room = block(0).to_bytes().len().next_power_of_two() as u64;
        let mut blocks = DiskBlocks::new(Arc::new(TestFile::default()), room, 2 * room);
        assert!(blocks.store(&block(0)) && !blocks.store(&block(1)));
        let mut copy = blocks.clone();
        assert!(blocks.take(block(0).index).is_some() && !blocks.store(&block(1)));
        assert!(copy.take(block(0).index).is_some() && blocks.store(&block(1)));
    }
}
