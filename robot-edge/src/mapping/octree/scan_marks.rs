//! What one scan says of each voxel: seen through, or hit. Each voxel has one mark, however many beams meet it.

use std::collections::HashMap;

use rustc_hash::FxBuildHasher;

use super::codes::{BLOCK_BRICKS, BLOCK_EDGE, BRICK_VOXELS, BlockIndex, LOCAL_BITS, Window};
use super::ray_walk::{FixedPoint, RayWalk, Slab, fixed, voxel};

/// Greatest side of the window that holds a scan, voxels.
const MAX_SIDE: u32 = 1 << 16;
/// Greatest coordinate of a block, so that voxels are numbered in 32 bits.
const MAX_BLOCK: f64 = (1 << 26) as f64;
/// Bits of a slot for each axis, at most.
const MAX_SLOT_BITS: u32 = 7;
const NO_PAGE: u32 = u32::MAX;
const NO_BLOCK: u64 = u64::MAX;

/// Scratch marks of one scan: a page of bytes for each block of voxels that it meets.
#[derive(Clone, Debug)]
pub(super) struct ScanMarks {
    window: Window,
    pages: Pages,
}

#[derive(Clone, Debug, Default)]
struct Pages {
    /// The page of a block, by the lowest bits of its coordinates.
    slots: Vec<u32>,
    /// The page of a block whose slot another one has.
    elsewhere: HashMap<u64, u32, FxBuildHasher>,
    heads: Vec<PageHead>,
    /// One for each head, and more.
    marks: Vec<Page>,
    block_bits: u32,
}

#[derive(Clone, Copy, Debug)]
struct PageHead {
    block: u64,
    /// Bricks that hold a mark, a bit for each.
    touched: u64,
    has_hits: bool,
}

/// A bit for each voxel of a block, a word for each brick.
#[derive(Clone, Copy, Debug)]
struct Page {
    free: [u64; BLOCK_BRICKS],
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

/// A block that a scan marked.
#[derive(Debug)]
pub(super) struct MarkedBlock<'a> {
    pub(super) block: BlockIndex,
    /// Bricks that hold a mark, a bit for each.
    pub(super) touched: u64,
    has_hits: bool,
    marks: &'a mut Page,
}

impl MarkedBlock<'_> {
    /// Takes the marks of a brick, which loses them.
    pub(super) fn take(&mut self, brick: usize) -> BrickMarks {
        let hit = if self.has_hits {
            std::mem::take(&mut self.marks.hit[brick])
        } else {
            0
        };
        // A hit wins.
        let free = std::mem::take(&mut self.marks.free[brick]) & !hit;
        BrickMarks { free, hit }
    }
}

impl ScanMarks {
    pub(super) fn new() -> Self {
        let nowhere = BlockIndex { x: 0, y: 0, z: 0 };
        Self {
            window: Window::new(nowhere, 1),
            pages: Pages::default(),
        }
    }

    /// Begins a scan whose beams lie between two corners, voxels of `odom`; says whether it fits.
    pub(super) fn begin(&mut self, least: [f64; 3], greatest: [f64; 3]) -> bool {
        let block_edge = f64::from(BLOCK_EDGE);
        let first = least.map(|voxels| libm::floor(voxels / block_edge));
        // One voxel more, so that what lies on the far edge is inside.
        let extents = (0..3).map(|axis| greatest[axis] - first[axis] * block_edge + 1.0);
        let fits = extents.clone().all(|extent| extent < f64::from(MAX_SIDE))
            && first.iter().all(|block| block.abs() < MAX_BLOCK);
        if fits {
            let [x, y, z] = first.map(|block| block as i32);
            let side = extents.fold(0.0, f64::max) as u32 + 1;
            self.window = Window::new(BlockIndex { x, y, z }, side);
            self.pages.open(self.window.block_bits());
        }
        fits
    }

    /// A point of `odom`, in voxels, in the window; `None` outside.
    pub(super) fn fixed(&self, point: [f64; 3]) -> Option<FixedPoint> {
        let corner = self.window.corner();
        let inside = std::array::from_fn(|axis| point[axis] - corner[axis]);
        fixed(inside, self.window.side())
    }

    /// Marks what a beam went through, without the voxel that it ends in.
    pub(super) fn mark_free(&mut self, from: FixedPoint, to: FixedPoint) {
        let Self { window, pages } = self;
        let mut writer = PageWriter::new();
        let mut walk = RayWalk::new(window, from, to, |slab| writer.slow(pages, slab));
        while walk.slabs() > 0 {
            if let Some(slab) = writer.fast(pages, &mut walk) {
                writer.slow(pages, slab);
            }
        }
        for code in walk.last(code(window, to)) {
            writer.mark(pages, code);
        }
        writer.flush(pages);
    }

    /// Marks what a beam hit.
    pub(super) fn mark_hit(&mut self, at: FixedPoint) {
        let code = code(&self.window, at);
        let page = self.pages.page(code >> LOCAL_BITS);
        let (brick, bit) = brick_and_bit(code);
        self.pages.marks[page].hit[brick] |= bit;
        let head = &mut self.pages.heads[page];
        head.touched |= 1 << brick;
        head.has_hits = true;
    }

    /// Adds the marks of another part of the same scan, which loses them.
    pub(super) fn take_from(&mut self, other: &mut Self) {
        for (head, marks) in other.pages.iter_mut() {
            let page = self.pages.page(head.block);
            self.pages.heads[page].touched |= head.touched;
            let own = &mut self.pages.marks[page];
            for brick in bits(head.touched) {
                own.free[brick] |= std::mem::take(&mut marks.free[brick]);
                own.hit[brick] |= std::mem::take(&mut marks.hit[brick]);
            }
            self.pages.heads[page].has_hits |= head.has_hits;
        }
        other.pages.close();
    }

    /// The blocks that hold marks, in the order of their first ones.
    pub(super) fn blocks(&self) -> impl Iterator<Item = BlockIndex> + '_ {
        self.pages
            .heads
            .iter()
            .map(|head| self.window.block(head.block))
    }

    /// The blocks that hold marks, in the order of their first ones. Whoever takes them clears the marks.
    pub(super) fn drain(&mut self, mut take: impl FnMut(MarkedBlock<'_>)) {
        for (head, marks) in self.pages.iter_mut() {
            take(MarkedBlock {
                block: self.window.block(head.block),
                touched: head.touched,
                has_hits: head.has_hits,
                marks,
            });
        }
        self.pages.close();
    }

    /// Memory of the marks, bytes.
    pub(super) fn bytes(&self) -> usize {
        self.pages.slots.capacity() * size_of::<u32>()
            + self.pages.marks.capacity() * size_of::<Page>()
    }
}

/// The numbers of the bits that are set.
pub(super) fn bits(mut set: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let bit = set.trailing_zeros() as usize;
        set &= set.wrapping_sub(1);
        (bit < BLOCK_BRICKS).then_some(bit)
    })
}

/// The code of the voxel of a point.
fn code(window: &Window, at: FixedPoint) -> u64 {
    let at = voxel(at);
    (0..3).map(|axis| window.code(axis, at[axis])).sum()
}

impl Pages {
    fn open(&mut self, block_bits: u32) {
        if block_bits != self.block_bits || self.slots.is_empty() {
            self.block_bits = block_bits;
            self.slots = vec![NO_PAGE; 1 << (3 * block_bits.min(MAX_SLOT_BITS))];
        }
    }

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

    /// The page of a block, which it gets if it has none.
    fn page(&mut self, block: u64) -> usize {
        let slot = self.slot(block);
        let page = self.slots[slot];
        if page == NO_PAGE {
            let page = self.new_page(block);
            self.slots[slot] = page;
            return page as usize;
        }
        if self.heads[page as usize].block == block {
            return page as usize;
        }
        if let Some(&page) = self.elsewhere.get(&block) {
            return page as usize;
        }
        let page = self.new_page(block);
        self.elsewhere.insert(block, page);
        page as usize
    }

    fn new_page(&mut self, block: u64) -> u32 {
        let page = self.heads.len();
        self.heads.push(PageHead {
            block,
            touched: 0,
            has_hits: false,
        });
        if self.marks.len() < self.heads.len() {
            self.marks.push(BLANK);
        }
        page as u32
    }

    fn iter_mut(&mut self) -> impl Iterator<Item = (PageHead, &mut Page)> {
        self.heads.iter().copied().zip(&mut self.marks)
    }

    fn close(&mut self) {
        for at in 0..self.heads.len() {
            let slot = self.slot(self.heads[at].block);
            self.slots[slot] = NO_PAGE;
        }
        self.heads.clear();
        self.elsewhere.clear();
    }
}

/// The brick of a voxel in its block, and the bit of the voxel in its brick.
#[inline]
const fn brick_and_bit(code: u64) -> (usize, u64) {
    (
        code as usize / BRICK_VOXELS % BLOCK_BRICKS,
        1 << (code % BRICK_VOXELS as u64),
    )
}

/// Writes into the page that was written last, for as long as it is the same.
struct PageWriter {
    block: u64,
    page: usize,
    touched: u64,
}

impl PageWriter {
    const fn new() -> Self {
        Self {
            block: NO_BLOCK,
            page: 0,
            touched: 0,
        }
    }

    /// Marks slabs for as long as they lie in the page; gives back the first that does not.
    #[inline]
    fn fast(&mut self, pages: &mut Pages, walk: &mut RayWalk) -> Option<Slab> {
        let Some(page) = pages.marks.get_mut(self.page) else {
            return Some(walk.next_slab());
        };
        let mut touched = self.touched;
        let block = self.block;
        let mut leaving = None;
        let mut steps = *walk;
        while steps.slabs() > 0 {
            let slab = steps.next_slab();
            let differs = (slab.enter >> LOCAL_BITS ^ block) | (slab.leave >> LOCAL_BITS ^ block);
            if differs != 0 {
                leaving = Some(slab);
                break;
            }
            let (enter, enter_bit) = brick_and_bit(slab.enter);
            let (leave, leave_bit) = brick_and_bit(slab.leave);
            page.free[enter] |= enter_bit;
            page.free[leave] |= leave_bit;
            touched |= 1 << enter | 1 << leave;
            // In the same block as both.
            if let Some(between) = slab.between {
                let (brick, bit) = brick_and_bit(between);
                page.free[brick] |= bit;
                touched |= 1 << brick;
            }
        }
        *walk = steps;
        self.touched = touched;
        leaving
    }

    #[inline]
    fn slow(&mut self, pages: &mut Pages, slab: Slab) {
        self.mark(pages, slab.enter);
        if let Some(between) = slab.between {
            self.mark(pages, between);
        }
        self.mark(pages, slab.leave);
    }

    #[inline]
    fn mark(&mut self, pages: &mut Pages, code: u64) {
        let block = code >> LOCAL_BITS;
        if block != self.block {
            self.flush(pages);
            self.page = pages.page(block);
            self.block = block;
        }
        let (brick, bit) = brick_and_bit(code);
        pages.marks[self.page].free[brick] |= bit;
        self.touched |= 1 << brick;
    }

    #[inline]
    fn flush(&mut self, pages: &mut Pages) {
        if self.block != NO_BLOCK {
            pages.heads[self.page].touched |= std::mem::take(&mut self.touched);
        }
    }
}
