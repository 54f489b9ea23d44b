//! Storage for the marks of one scan: a page of bits for each block that the scan meets.

use std::collections::HashMap;

use rustc_hash::FxBuildHasher;

use crate::octree::SHARDS;
use crate::octree::voxel_address::{BLOCK_BRICKS, BlockIndex, Window};

/// Greatest number of slot bits per axis.
const MAX_SLOT_BITS: u32 = 7;
const NO_PAGE: u32 = u32::MAX;

/// Pages of one scan.
#[derive(Clone, Debug, Default)]
pub(super) struct ScratchPages {
    index: PageIndex,
    page_lists: [PageList; SHARDS],
}

/// Index of a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PageRef {
    shard: usize,
    at: usize,
}

#[derive(Clone, Debug, Default)]
struct PageIndex {
    /// Page by the lowest bits of the block's coordinates: as many as the largest window needed.
    slots: Vec<u32>,
    /// Pages of blocks whose slot is occupied.
    overflow: HashMap<u64, u32, FxBuildHasher>,
    block_bits: u32,
}

/// Pages of one shard.
#[derive(Clone, Debug, Default)]
struct PageList {
    heads: Vec<PageHead>,
    /// Kept for their allocation; at least one for each head.
    scratch_pages: Vec<Page>,
}

#[derive(Clone, Copy, Debug)]
struct PageHead {
    block: u64,
    has_hits: bool,
}

/// A bit for each voxel of a block, a word for each brick.
#[derive(Clone, Copy, Debug)]
pub(super) struct Page {
    pub(super) free: [u64; BLOCK_BRICKS],
    hit: [u64; BLOCK_BRICKS],
}

const BLANK: Page = Page {
    free: [0; BLOCK_BRICKS],
    hit: [0; BLOCK_BRICKS],
};

/// Free and hit voxels of a brick, a bit for each; disjoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct BrickMarks {
    pub(super) free: u64,
    pub(super) hit: u64,
}

#[derive(Debug)]
pub(super) struct ShardMarks<'a> {
    window: Window,
    index: &'a PageIndex,
    page_list: &'a mut PageList,
}

#[derive(Debug)]
pub(super) struct MarkedBlock<'a> {
    pub(super) block: BlockIndex,
    /// Bricks with a mark, a bit for each.
    pub(super) touched: u64,
    has_hits: bool,
    page: &'a mut Page,
}

impl ScratchPages {
    /// Prepares for a scan in a window with that many bits per block coordinate.
    pub(super) fn open(&mut self, block_bits: u32) {
        let index = &mut self.index;
        index.block_bits = block_bits;
        // All slots are free between scans, whatever their window was.
        let slots = 1 << (3 * block_bits.min(MAX_SLOT_BITS));
        if index.slots.len() < slots {
            index.slots = vec![NO_PAGE; slots];
        }
    }

    /// The page of a block of the window, created if necessary.
    pub(super) fn place(&mut self, window: &Window, block: u64) -> PageRef {
        let Self { index, page_lists } = self;
        let slot = index.slot(block);
        let number = index.slots[slot];
        if number == NO_PAGE {
            let place = PageRef::new(window, page_lists, block);
            index.slots[slot] = place.number();
            return place;
        }
        let place = PageRef::of(number);
        if page_lists[place.shard].heads[place.at].block == block {
            return place;
        }
        if let Some(&number) = index.overflow.get(&block) {
            return PageRef::of(number);
        }
        let place = PageRef::new(window, page_lists, block);
        index.overflow.insert(block, place.number());
        place
    }

    #[inline]
    pub(super) fn page_mut(&mut self, place: PageRef) -> Option<&mut Page> {
        self.page_lists[place.shard].scratch_pages.get_mut(place.at)
    }

    pub(super) fn mark_hit(&mut self, place: PageRef, brick: usize, bit: u64) {
        let page_list = &mut self.page_lists[place.shard];
        page_list.scratch_pages[place.at].hit[brick] |= bit;
        page_list.heads[place.at].has_hits = true;
    }

    pub(super) fn shards(&mut self, window: Window) -> [ShardMarks<'_>; SHARDS] {
        let index = &self.index;
        self.page_lists.each_mut().map(|page_list| ShardMarks {
            window,
            index,
            page_list,
        })
    }

    /// Ends a scan after its marks were taken.
    pub(super) fn close(&mut self) {
        for page_list in &mut self.page_lists {
            for head in page_list.heads.drain(..) {
                let slot = self.index.slot(head.block);
                self.index.slots[slot] = NO_PAGE;
            }
        }
        self.index.overflow.clear();
    }

    pub(super) fn bytes(&self) -> usize {
        let scratch_pages = self
            .page_lists
            .iter()
            .map(|page_list| page_list.scratch_pages.capacity());
        self.index.slots.capacity() * size_of::<u32>()
            + scratch_pages.sum::<usize>() * size_of::<Page>()
    }
}

impl PageRef {
    pub(super) const NONE: Self = Self {
        shard: 0,
        at: usize::MAX,
    };

    const fn of(number: u32) -> Self {
        Self {
            shard: number as usize % SHARDS,
            at: number as usize / SHARDS,
        }
    }

    const fn number(self) -> u32 {
        (self.at * SHARDS + self.shard) as u32
    }

    fn new(window: &Window, page_lists: &mut [PageList; SHARDS], block: u64) -> Self {
        let shard = window.block(block).shard();
        let page_list = &mut page_lists[shard];
        let at = page_list.heads.len();
        page_list.heads.push(PageHead {
            block,
            has_hits: false,
        });
        if page_list.scratch_pages.len() < page_list.heads.len() {
            page_list.scratch_pages.push(BLANK);
        }
        Self { shard, at }
    }
}

impl PageIndex {
    fn slot(&self, block: u64) -> usize {
        if self.block_bits <= MAX_SLOT_BITS {
            return block as usize;
        }
        let part = |axis: u32| {
            let coordinate = block >> (axis * self.block_bits);
            (coordinate & ((1 << MAX_SLOT_BITS) - 1)) << (axis * MAX_SLOT_BITS)
        };
        (part(0) | part(1) | part(2)) as usize
    }

    fn find(&self, page_list: &PageList, block: u64) -> Option<usize> {
        let number = self.slots[self.slot(block)];
        let at = PageRef::of(number).at;
        let is_here = |head: &PageHead| head.block == block;
        if number == NO_PAGE {
            None
        } else if page_list.heads.get(at).is_some_and(is_here) {
            Some(at)
        } else {
            let number = self.overflow.get(&block);
            number.map(|&number| PageRef::of(number).at)
        }
    }
}

impl ShardMarks<'_> {
    /// Blocks with marks, in the order of their first ones.
    pub(super) fn blocks(&self) -> impl Iterator<Item = BlockIndex> + '_ {
        let heads = self.page_list.heads.iter();
        heads.map(|head| self.window.block(head.block))
    }

    /// Moves the marks of the blocks that are marked in both from `other` to here.
    pub(super) fn take_common(&mut self, other: &mut Self) {
        let page_list = &mut *self.page_list;
        for (head, page) in other
            .page_list
            .heads
            .iter()
            .zip(&mut other.page_list.scratch_pages)
        {
            if let Some(at) = self.index.find(page_list, head.block) {
                page_list.heads[at].has_hits |= head.has_hits;
                page_list.scratch_pages[at].take_from(page);
            }
        }
    }

    /// Blocks with marks, in the same order. The caller must clear the marks.
    pub(super) fn marked(&mut self) -> impl Iterator<Item = MarkedBlock<'_>> {
        let window = self.window;
        let PageList {
            heads,
            scratch_pages,
        } = &mut *self.page_list;
        heads
            .iter()
            .zip(scratch_pages)
            .map(move |(head, page)| MarkedBlock {
                block: window.block(head.block),
                touched: page.touched(),
                has_hits: head.has_hits,
                page,
            })
    }
}

impl MarkedBlock<'_> {
    /// Takes and clears the marks of a brick.
    pub(super) fn take(&mut self, brick: usize) -> BrickMarks {
        let hit = if self.has_hits {
            std::mem::take(&mut self.page.hit[brick])
        } else {
            0
        };
        // A hit wins.
        let free = std::mem::take(&mut self.page.free[brick]) & !hit;
        BrickMarks { free, hit }
    }
}

impl Page {
    /// Bricks with a mark, a bit for each. Computed afterwards, which is cheaper than recording it
    /// at each mark.
    fn touched(&self) -> u64 {
        let bricks = self.free.iter().zip(&self.hit).enumerate();
        bricks.fold(0, |touched, (brick, (free, hit))| {
            touched | u64::from(free | hit != 0) << brick
        })
    }

    fn take_from(&mut self, other: &mut Self) {
        for (own, other) in self.free.iter_mut().zip(&mut other.free) {
            *own |= std::mem::take(other);
        }
        for (own, other) in self.hit.iter_mut().zip(&mut other.hit) {
            *own |= std::mem::take(other);
        }
    }
}
