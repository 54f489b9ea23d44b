//! A part of the map that is updated on its own: so two threads can update all of it.

use std::collections::HashMap;

use rustc_hash::FxBuildHasher;

use super::BrickColumn;
use super::block::Block;
use super::log_odds_table::{Update, Values};
use super::scratch_pages::ShardMarks;
use super::surface::SurfaceVoxel;
use super::voxel_address::BlockIndex;

/// Parts of a map.
pub(super) const SHARDS: usize = 2;

/// Every other block of the map.
#[derive(Clone, Debug, Default)]
pub(super) struct Shard {
    blocks: Vec<Block>,
    places: HashMap<BlockIndex, u32, FxBuildHasher>,
    /// Of all blocks.
    block_bytes: usize,
    /// Places of the blocks that a scan marks.
    marked: Vec<u32>,
    /// Blocks in which something has changed since that was taken, or that are gone.
    changed: Vec<BlockIndex>,
    gone: Vec<BlockIndex>,
}

impl Shard {
    /// The block at an index.
    pub(super) fn block(&self, index: BlockIndex) -> Option<&Block> {
        let place = self.places.get(&index);
        place.map(|&place| &self.blocks[place as usize])
    }

    /// All blocks, in no order.
    pub(super) fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// Applies the marks of a scan, made in one part or in two, and clears them.
    pub(super) fn apply(&mut self, marks: &mut [ShardMarks<'_>], update: Update, values: Values) {
        if let [own, others @ ..] = marks {
            for other in others {
                own.take_common(other);
            }
        }
        for part in marks {
            self.find_blocks(part);
            for (mut marked, &place) in part.marked().zip(&self.marked) {
                let block = &mut self.blocks[place as usize];
                let before = block.bytes();
                if block.apply(&mut marked, update, values) {
                    self.changed.push(marked.block);
                }
                self.block_bytes = self.block_bytes + block.bytes() - before;
            }
        }
    }

    /// The surface voxel at an address of a block, to add a hit to it; nothing where there is no such block.
    pub(super) fn with_surface(
        &mut self,
        index: BlockIndex,
        address: usize,
        add: impl FnOnce(&mut SurfaceVoxel),
    ) {
        let Some(&place) = self.places.get(&index) else {
            return;
        };
        let block = &mut self.blocks[place as usize];
        let before = block.bytes();
        let (surface, is_first) = block.surface_mut(address);
        add(surface);
        self.block_bytes = self.block_bytes + block.bytes() - before;
        if is_first {
            self.changed.push(index);
        }
    }

    /// Takes the columns of bricks in which something has changed, in no order.
    pub(super) fn take_changed(&mut self, columns: &mut Vec<BrickColumn>) {
        let mut add = |block: BlockIndex, changed: u16| {
            let bricks = (0..16).filter(|brick| changed >> brick & 1 == 1);
            columns.extend(bricks.map(|brick| BrickColumn {
                x: block.x * 4 + brick % 4,
                y: block.y * 4 + brick / 4,
            }));
        };
        for index in std::mem::take(&mut self.changed) {
            if let Some(&place) = self.places.get(&index) {
                add(index, self.blocks[place as usize].take_changed());
            }
        }
        for index in std::mem::take(&mut self.gone) {
            add(index, u16::MAX);
        }
    }

    /// Removes the blocks that are not to be kept; says how many bricks were stored in them.
    pub(super) fn retain(&mut self, is_kept: impl Fn(&Block) -> bool) -> usize {
        let (kept, evicted): (Vec<_>, Vec<_>) = std::mem::take(&mut self.blocks)
            .into_iter()
            .partition(is_kept);
        self.block_bytes = kept.iter().map(Block::bytes).sum();
        self.places = (0..)
            .zip(&kept)
            .map(|(place, block)| (block.index, place))
            .collect();
        self.blocks = kept;
        self.gone.extend(evicted.iter().map(|block| block.index));
        let stored = evicted.iter().map(Block::stored);
        stored.map(|(full, packed)| full + packed).sum()
    }

    /// Of the blocks, bytes.
    pub(super) const fn block_bytes(&self) -> usize {
        self.block_bytes
    }

    /// Of what finds them, bytes.
    pub(super) fn index_bytes(&self) -> usize {
        self.places.capacity() * (size_of::<(BlockIndex, u32)>() + 1)
    }

    /// Finds or makes the block of each page of marks.
    fn find_blocks(&mut self, marks: &ShardMarks<'_>) {
        self.marked.clear();
        let mut fetched = 0;
        for index in marks.blocks() {
            let place = *self.places.entry(index).or_insert_with(|| {
                self.blocks.push(Block::new(index));
                self.block_bytes += size_of::<Block>();
                (self.blocks.len() - 1) as u32
            });
            fetched ^= self.blocks[place as usize].fetch_header();
            self.marked.push(place);
        }
        // Or it would not be read at all.
        std::hint::black_box(fetched);
    }
}
