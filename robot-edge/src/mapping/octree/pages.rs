//! Where the marks of one scan are kept: a page of bits for each block of voxels that the scan meets.

use std::collections::HashMap;

use rustc_hash::FxBuildHasher;

use super::codes::{BLOCK_BRICKS, BlockIndex, Window};
use super::shard::SHARDS;

/// Bits of a slot for each axis, at most.
const MAX_SLOT_BITS: u32 = 7;
const NO_PAGE: u32 = u32::MAX;

/// The pages of one scan.
#[derive(Clone, Debug, Default)]
pub(super) struct Pages {
    index: PageIndex,
    shelves: [PageShelf; SHARDS],
}

/// Where the page of a block is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PagePlace {
    shard: usize,
    at: usize,
}

/// Finds pages.
#[derive(Clone, Debug, Default)]
struct PageIndex {
    /// The page of a block, by the lowest bits of its coordinates.
    slots: Vec<u32>,
    /// The page of a block whose slot another one has.
    elsewhere: HashMap<u64, u32, FxBuildHasher>,
    block_bits: u32,
}

/// The pages of the blocks of one shard of the map.
#[derive(Clone, Debug, Default)]
struct PageShelf {
    heads: Vec<PageHead>,
    /// One for each head, and more.
    pages: Vec<Page>,
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

/// Voxels of a brick that a scan saw through and that it hit, a bit for each; none is both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct BrickMarks {
    pub(super) free: u64,
    pub(super) hit: u64,
}

/// The marks of one shard of the map.
#[derive(Debug)]
pub(super) struct ShardMarks<'a> {
    window: Window,
    index: &'a PageIndex,
    shelf: &'a mut PageShelf,
}

/// A block that a scan marked.
#[derive(Debug)]
pub(super) struct MarkedBlock<'a> {
    pub(super) block: BlockIndex,
    /// Bricks that hold a mark, a bit for each.
    pub(super) touched: u64,
    has_hits: bool,
    page: &'a mut Page,
}

impl Pages {
    /// Prepares for a scan in a window of that many bits of a block's coordinate.
    pub(super) fn open(&mut self, block_bits: u32) {
        let index = &mut self.index;
        if block_bits != index.block_bits || index.slots.is_empty() {
            index.block_bits = block_bits;
            index.slots = vec![NO_PAGE; 1 << (3 * block_bits.min(MAX_SLOT_BITS))];
        }
    }

    /// The page of a block of the window, which it gets if it has none.
    pub(super) fn place(&mut self, window: &Window, block: u64) -> PagePlace {
        let Self { index, shelves } = self;
        let slot = index.slot(block);
        let number = index.slots[slot];
        if number == NO_PAGE {
            let place = PagePlace::new(window, shelves, block);
            index.slots[slot] = place.number();
            return place;
        }
        let place = PagePlace::of(number);
        if shelves[place.shard].heads[place.at].block == block {
            return place;
        }
        if let Some(&number) = index.elsewhere.get(&block) {
            return PagePlace::of(number);
        }
        let place = PagePlace::new(window, shelves, block);
        index.elsewhere.insert(block, place.number());
        place
    }

    /// The page at a place.
    #[inline]
    pub(super) fn page_mut(&mut self, place: PagePlace) -> Option<&mut Page> {
        self.shelves[place.shard].pages.get_mut(place.at)
    }

    /// Marks the hit voxel of a bit in a brick of the page at a place.
    pub(super) fn mark_hit(&mut self, place: PagePlace, brick: usize, bit: u64) {
        let shelf = &mut self.shelves[place.shard];
        shelf.pages[place.at].hit[brick] |= bit;
        shelf.heads[place.at].has_hits = true;
    }

    /// The marks, by shard of the map.
    pub(super) fn shards(&mut self, window: Window) -> [ShardMarks<'_>; SHARDS] {
        let index = &self.index;
        self.shelves.each_mut().map(|shelf| ShardMarks {
            window,
            index,
            shelf,
        })
    }

    /// Ends a scan, whose marks have been taken.
    pub(super) fn close(&mut self) {
        for shelf in &mut self.shelves {
            for head in shelf.heads.drain(..) {
                let slot = self.index.slot(head.block);
                self.index.slots[slot] = NO_PAGE;
            }
        }
        self.index.elsewhere.clear();
    }

    /// Their memory, bytes.
    pub(super) fn bytes(&self) -> usize {
        let pages = self.shelves.iter().map(|shelf| shelf.pages.capacity());
        self.index.slots.capacity() * size_of::<u32>() + pages.sum::<usize>() * size_of::<Page>()
    }
}

impl PagePlace {
    /// Of no page.
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

    /// Of a new page.
    fn new(window: &Window, shelves: &mut [PageShelf; SHARDS], block: u64) -> Self {
        let shard = window.block(block).shard();
        let shelf = &mut shelves[shard];
        let at = shelf.heads.len();
        shelf.heads.push(PageHead {
            block,
            has_hits: false,
        });
        if shelf.pages.len() < shelf.heads.len() {
            shelf.pages.push(BLANK);
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

    /// Where the page of a block of this shard is, if it has one.
    fn find(&self, shelf: &PageShelf, block: u64) -> Option<usize> {
        let number = self.slots[self.slot(block)];
        let at = PagePlace::of(number).at;
        let is_here = |head: &PageHead| head.block == block;
        if number == NO_PAGE {
            None
        } else if shelf.heads.get(at).is_some_and(is_here) {
            Some(at)
        } else {
            let number = self.elsewhere.get(&block);
            number.map(|&number| PagePlace::of(number).at)
        }
    }
}

impl ShardMarks<'_> {
    /// The blocks that hold marks, in the order of their first ones.
    pub(super) fn blocks(&self) -> impl Iterator<Item = BlockIndex> + '_ {
        let heads = self.shelf.heads.iter();
        heads.map(|head| self.window.block(head.block))
    }

    /// Takes from another part of the same scan its marks of the blocks that are marked here too.
    pub(super) fn take_common(&mut self, other: &mut Self) {
        let shelf = &mut *self.shelf;
        for (head, page) in other.shelf.heads.iter().zip(&mut other.shelf.pages) {
            if let Some(at) = self.index.find(shelf, head.block) {
                shelf.heads[at].has_hits |= head.has_hits;
                shelf.pages[at].take_from(page);
            }
        }
    }

    /// The blocks that hold marks, in the same order. Whoever takes them clears the marks.
    pub(super) fn marked(&mut self) -> impl Iterator<Item = MarkedBlock<'_>> {
        let window = self.window;
        let PageShelf { heads, pages } = &mut *self.shelf;
        heads
            .iter()
            .zip(pages)
            .map(move |(head, page)| MarkedBlock {
                block: window.block(head.block),
                touched: page.touched(),
                has_hits: head.has_hits,
                page,
            })
    }
}

impl MarkedBlock<'_> {
    /// Takes the marks of a brick, which loses them.
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
    /// Bricks that hold a mark, a bit for each. Looked for afterwards: that costs less than to note it at each mark.
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
