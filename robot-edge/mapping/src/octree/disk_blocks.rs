//! Blocks that the memory limit made coarse or evicted, as they were, in a temporary file.

use std::collections::HashMap;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt as _;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rustc_hash::FxBuildHasher;

use crate::octree::block::Block;
use crate::octree::voxel_address::BlockIndex;

/// Blocks on disk. Copies share the file, and each place in it as long as one of them needs it.
#[derive(Clone, Debug, Default)]
pub(super) struct DiskBlocks {
    disk: Arc<Disk>,
    places: HashMap<BlockIndex, Arc<Place>, FxBuildHasher>,
    error: Option<io::ErrorKind>,
}

#[derive(Debug, Default)]
struct Disk {
    limit_bytes: u64,
    file: Mutex<DiskFile>,
}

/// A file that goes with this value.
#[derive(Debug, Default)]
struct DiskFile {
    /// Made when it is needed.
    file: Option<File>,
    /// Unused places of 2ⁿ bytes, by n.
    unused: Vec<Vec<u64>>,
    end: u64,
}

#[derive(Debug)]
struct Place {
    disk: Arc<Disk>,
    offset: u64,
    bytes: usize,
}

impl DiskBlocks {
    pub(super) fn new(limit_bytes: u64) -> Self {
        let disk = Disk {
            limit_bytes,
            ..Disk::default()
        };
        Self {
            disk: Arc::new(disk),
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

    /// Stores a block that is not stored; `false` if there is no room for it, or after an error.
    pub(super) fn store(&mut self, block: &Block) -> bool {
        match self.disk.write(&block.to_bytes()) {
            Ok(place) => {
                let place = place.map(|(offset, bytes)| Place {
                    disk: Arc::clone(&self.disk),
                    offset,
                    bytes,
                });
                let is_stored = place.is_some();
                self.places
                    .extend(place.map(|place| (block.index, Arc::new(place))));
                is_stored
            }
            Err(error) => {
                self.error = Some(error.kind());
                false
            }
        }
    }

    /// Reads a block; `None` if it is not stored or cannot be read.
    pub(super) fn read(&self, index: BlockIndex) -> Option<Block> {
        self.places.get(&index)?.read(index).ok()
    }

    /// Reads a block and frees its place.
    pub(super) fn take(&mut self, index: BlockIndex) -> Option<Block> {
        let block = self.places.remove(&index)?.read(index);
        block.map_err(|error| self.error = Some(error.kind())).ok()
    }

    /// Forgets the blocks that `is_kept` does not accept.
    pub(super) fn retain(&mut self, is_kept: impl Fn(BlockIndex) -> bool) {
        self.places.retain(|&index, _| is_kept(index));
    }

    /// The newest error since the last call.
    pub(super) const fn take_error(&mut self) -> Option<io::ErrorKind> {
        self.error.take()
    }

    /// Memory of the index.
    pub(super) fn bytes(&self) -> usize {
        self.places.capacity() * (size_of::<(BlockIndex, Arc<Place>)>() + 1)
            + self.places.len() * (size_of::<Place>() + 2 * size_of::<usize>())
    }
}

impl Disk {
    fn lock(&self) -> MutexGuard<'_, DiskFile> {
        // No panic leaves it half changed.
        self.file.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the place and the number of bytes; `None` if there is no room.
    fn write(&self, record: &[u8]) -> io::Result<Option<(u64, usize)>> {
        let mut disk = self.lock();
        let class = class(record.len());
        if disk.unused.len() <= class {
            disk.unused.resize(class + 1, Vec::new());
        }
        let offset = *disk.unused[class].last().unwrap_or(&disk.end);
        let end = disk.end.max(offset + (1 << class));
        if end > self.limit_bytes {
            return Ok(None);
        }
        if disk.file.is_none() {
            disk.file = Some(tempfile::tempfile()?);
        }
        if let Some(file) = &disk.file {
            file.write_all_at(record, offset)?;
        }
        disk.unused[class].pop();
        disk.end = end;
        Ok(Some((offset, record.len())))
    }
}

impl Place {
    fn read(&self, index: BlockIndex) -> io::Result<Block> {
        let mut record = vec![0; self.bytes];
        let disk = self.disk.lock();
        let file = disk.file.as_ref().ok_or(io::ErrorKind::NotFound)?;
        file.read_exact_at(&mut record, self.offset)?;
        let block = Block::from_bytes(index, &record);
        block.ok_or_else(|| io::ErrorKind::InvalidData.into())
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.disk.lock().unused[class(self.bytes)].push(self.offset);
    }
}

/// Logarithm of the room that so many bytes take.
const fn class(bytes: usize) -> usize {
    bytes.next_power_of_two().trailing_zeros() as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(x: i32) -> Block {
        Block::new(BlockIndex { x, y: 0, z: 0 })
    }

    #[test]
    fn errors_of_the_disk_are_kept() {
        let mut blocks = DiskBlocks::new(1_000_000);
        assert!(blocks.store(&block(0)) && blocks.store(&block(1)));
        blocks.disk.lock().file = Some(File::open("/dev/null").unwrap());
        assert!(!blocks.store(&block(2)) && blocks.take_error().is_some());
        let first = block(0).index;
        assert!(blocks.read(first).is_none() && blocks.take(first).is_none());
        assert_eq!(blocks.take_error(), Some(io::ErrorKind::UnexpectedEof));
        assert_eq!((blocks.take_error(), blocks.contains(first)), (None, false));
    }

    #[test]
    fn a_place_is_used_again_after_its_last_copy() {
        let room = block(0).to_bytes().len().next_power_of_two() as u64;
        let mut blocks = DiskBlocks::new(room);
        assert!(blocks.store(&block(0)) && !blocks.store(&block(1)));
        let mut copy = blocks.clone();
        assert!(blocks.take(block(0).index).is_some() && !blocks.store(&block(1)));
        assert!(copy.take(block(0).index).is_some() && blocks.store(&block(1)));
    }
}
