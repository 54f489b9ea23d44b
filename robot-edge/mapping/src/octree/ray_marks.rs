//! What one scan says of each voxel: seen through, or hit. Each voxel has one mark, however many beams meet it.

use super::ray_walk::{FixedPoint, RayWalk, Slab, fixed, voxel};
use super::scratch_pages::{PageRef, ScratchPages, ShardMarks};
use super::shard::SHARDS;
use super::voxel_address::{
    BLOCK_BRICKS, BLOCK_EDGE, BRICK_VOXELS, BlockIndex, LOCAL_BITS, Window,
};

/// Greatest side of the window that holds a scan, voxels.
const MAX_SIDE: u32 = 1 << 16;
/// Greatest coordinate of a block, so that voxels are numbered in 32 bits.
const MAX_BLOCK: f64 = (1 << 26) as f64;
const NO_BLOCK: u64 = u64::MAX;

/// Scratch marks of one scan, or of a part of it.
#[derive(Clone, Debug)]
pub(super) struct RayMarks {
    window: Window,
    scratch_pages: ScratchPages,
}

impl RayMarks {
    pub(super) fn new() -> Self {
        let nowhere = BlockIndex { x: 0, y: 0, z: 0 };
        Self {
            window: Window::new(nowhere, 1),
            scratch_pages: ScratchPages::default(),
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
            self.scratch_pages.open(self.window.block_bits());
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
        let Self {
            window,
            scratch_pages,
        } = self;
        let mut writer = PageWriter::new(window);
        let mut walk = RayWalk::new(window, from, to, |slab, walk| {
            writer.slow(scratch_pages, slab, walk);
        });
        while walk.slabs() > 0 {
            if let Some(slab) = writer.fast(scratch_pages, &mut walk) {
                writer.slow(scratch_pages, slab, &walk);
            }
        }
        for code in walk.last(code(window, to)) {
            writer.mark(scratch_pages, code);
        }
    }

    /// Marks what a beam hit.
    pub(super) fn mark_hit(&mut self, at: FixedPoint) {
        let code = code(&self.window, at);
        let place = self.scratch_pages.place(&self.window, code >> LOCAL_BITS);
        let (brick, bit) = brick_and_bit(code);
        self.scratch_pages.mark_hit(place, brick, bit);
    }

    /// The marks, by shard of the map.
    pub(super) fn shards(&mut self) -> [ShardMarks<'_>; SHARDS] {
        self.scratch_pages.shards(self.window)
    }

    /// Ends a scan, whose marks have been taken.
    pub(super) fn close(&mut self) {
        self.scratch_pages.close();
    }

    /// Memory of the marks, bytes.
    pub(super) fn bytes(&self) -> usize {
        self.scratch_pages.bytes()
    }
}

/// The code of the voxel of a point.
fn code(window: &Window, at: FixedPoint) -> u64 {
    let at = voxel(at);
    (0..3).map(|axis| window.code(axis, at[axis])).sum()
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
struct PageWriter<'a> {
    window: &'a Window,
    block: u64,
    place: PageRef,
}

impl<'a> PageWriter<'a> {
    const fn new(window: &'a Window) -> Self {
        Self {
            window,
            block: NO_BLOCK,
            place: PageRef::NONE,
        }
    }

    /// Marks slabs for as long as they lie in the page; gives back the first that does not.
    #[inline]
    fn fast(&mut self, scratch_pages: &mut ScratchPages, walk: &mut RayWalk) -> Option<Slab> {
        let Some(page) = scratch_pages.page_mut(self.place) else {
            return Some(walk.next_slab());
        };
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
            if slab.crosses_both {
                // In the same block as both.
                let (brick, bit) = brick_and_bit(steps.between(slab));
                page.free[brick] |= bit;
            }
        }
        *walk = steps;
        leaving
    }

    #[inline]
    fn slow(&mut self, scratch_pages: &mut ScratchPages, slab: Slab, walk: &RayWalk) {
        self.mark(scratch_pages, slab.enter);
        if slab.crosses_both {
            self.mark(scratch_pages, walk.between(slab));
        }
        self.mark(scratch_pages, slab.leave);
    }

    #[inline]
    fn mark(&mut self, scratch_pages: &mut ScratchPages, code: u64) {
        let block = code >> LOCAL_BITS;
        if block != self.block {
            self.place = scratch_pages.place(self.window, block);
            self.block = block;
        }
        let (brick, bit) = brick_and_bit(code);
        if let Some(page) = scratch_pages.page_mut(self.place) {
            page.free[brick] |= bit;
        }
    }
}
