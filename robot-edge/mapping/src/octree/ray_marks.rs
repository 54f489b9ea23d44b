//! Marks of one scan, free or hit, one per voxel, and the integer walk along a beam that sets them
//! (docs/methods.md, section 3).
//!
//! A beam is walked in slabs, the voxel layers across its longest axis. Within a slab each of the
//! other two coordinates crosses at most one boundary, so a slab holds at most three voxels: entry,
//! exit and, if both cross, one in between. Marking entry and exit unconditionally, although they
//! are often equal, is cheaper than a branch. The voxels are those of Amanatides and Woo (1987), as
//! in `OctoMap`.

use crate::octree::SHARDS;
use crate::octree::scratch_pages::{PageRef, ScratchPages, ShardMarks};
use crate::octree::voxel_address::{
    BLOCK_BRICKS, BLOCK_EDGE, BRICK_VOXELS, BlockIndex, LOCAL_BITS, Window,
};

/// Greatest side of a scan's window, voxels.
const MAX_SIDE: u32 = 1 << 16;
/// Greatest coordinate of a block; voxel indices have 32 bits.
const MAX_BLOCK: f64 = (1 << 26) as f64;
const NO_BLOCK: u64 = u64::MAX;

/// Scratch marks of one scan, or of a thread's part of it.
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

    /// Begins a scan whose beams are between two corners, voxels of `odom`; returns whether it
    /// fits.
    pub(super) fn begin(&mut self, least: [f64; 3], greatest: [f64; 3]) -> bool {
        let block_edge = f64::from(BLOCK_EDGE);
        let first = least.map(|voxels| libm::floor(voxels / block_edge));
        // One voxel more, so that points on the far edge are inside.
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

    /// Converts from voxels of `odom` to the window; `None` outside.
    pub(super) fn fixed(&self, point: [f64; 3]) -> Option<FixedPoint> {
        let corner = self.window.corner();
        let inside = std::array::from_fn(|axis| point[axis] - corner[axis]);
        fixed(inside, self.window.side())
    }

    /// Marks the voxels of a beam, without its last one.
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

    pub(super) fn mark_hit(&mut self, at: FixedPoint) {
        let code = code(&self.window, at);
        let place = self.scratch_pages.place(&self.window, code >> LOCAL_BITS);
        let (brick, bit) = brick_and_bit(code);
        self.scratch_pages.mark_hit(place, brick, bit);
    }

    pub(super) fn shards(&mut self) -> [ShardMarks<'_>; SHARDS] {
        self.scratch_pages.shards(self.window)
    }

    /// Ends a scan after its marks were taken.
    pub(super) fn close(&mut self) {
        self.scratch_pages.close();
    }

    pub(super) fn bytes(&self) -> usize {
        self.scratch_pages.bytes()
    }
}

/// Code of the voxel of a point, see [`Window`].
fn code(window: &Window, at: FixedPoint) -> u64 {
    let at = voxel(at);
    (0..3).map(|axis| window.code(axis, at[axis])).sum()
}

/// The brick of a voxel in its block, and its bit in the brick.
#[inline]
const fn brick_and_bit(code: u64) -> (usize, u64) {
    (
        code as usize / BRICK_VOXELS % BLOCK_BRICKS,
        1 << (code % BRICK_VOXELS as u64),
    )
}

/// Writes to the current page as long as the voxels are in it.
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

    /// Marks slabs in the current page; returns the first slab outside.
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

const FRACTION_BITS: u32 = 32;
const ONE: u64 = 1 << FRACTION_BITS;

/// A point inside a window, voxels with 32 bits of fraction, x, y, z.
pub(super) type FixedPoint = [u64; 3];

/// Converts `point`, in voxels from the window's least corner; `None` outside of the window of
/// `side` voxels.
pub(super) fn fixed(point: [f64; 3], side: u32) -> Option<FixedPoint> {
    let within = |voxels: &f64| (0.0..f64::from(side)).contains(voxels); // false for NaN
    point
        .iter()
        .all(within)
        .then(|| point.map(|voxels| (voxels * ONE as f64) as u64))
}

pub(super) fn voxel(point: FixedPoint) -> [u32; 3] {
    point.map(|coordinate| (coordinate >> FRACTION_BITS) as u32)
}

/// Codes of the voxels of one slab.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slab {
    pub(super) enter: u64,
    pub(super) leave: u64,
    /// Whether [`RayWalk::between`] is one more voxel.
    pub(super) crosses_both: bool,
}

/// A walk through the slabs of a beam.
#[derive(Clone, Copy, Debug)]
pub(super) struct RayWalk {
    along: Axis,
    e: Axis,
    f: Axis,
    /// Remaining whole slabs.
    slabs: u32,
}

/// One coordinate of a beam.
#[derive(Clone, Copy, Debug)]
struct Axis {
    /// This axis' bits of the current voxel's code.
    code: u64,
    mask: u64,
    /// Added to the code per voxel; for a growing coordinate with ones between the bits of this
    /// axis, so that a carry passes.
    step: u64,
    /// Distance from the last boundary, in the direction of the beam, as a fraction of a voxel.
    fraction: u32,
    /// Movement per slab, as a fraction of a voxel.
    slope: u32,
}

impl RayWalk {
    /// From `from` to `to`, without the voxel of `to`. Calls `first` with the first slab; the last
    /// one is left for [`RayWalk::last`].
    #[inline]
    pub(super) fn new(
        window: &Window,
        from: FixedPoint,
        to: FixedPoint,
        first: impl FnOnce(Slab, &Self),
    ) -> Self {
        let [x, y, z] = std::array::from_fn(|axis| from[axis].abs_diff(to[axis]));
        let order = if x >= y && x >= z {
            [0, 1, 2]
        } else if y >= z {
            [1, 0, 2]
        } else {
            [2, 0, 1]
        };
        let per_slab = ONE as f64 / x.max(y).max(z).max(1) as f64;
        let axis = |n: usize| Axis::new(window, order[n], (from, to), per_slab);
        let (along, e, f) = (axis(0), axis(1), axis(2));
        let slabs =
            (from[order[0]] >> FRACTION_BITS).abs_diff(to[order[0]] >> FRACTION_BITS) as u32;
        let mut walk = Self { along, e, f, slabs };
        if slabs > 0 {
            let rest = ONE - u64::from(along.fraction);
            let part = |slope: u32| ((u64::from(slope) * rest) >> FRACTION_BITS) as u32;
            let slab = walk.advance(part(e.slope), part(f.slope));
            first(slab, &walk);
            walk.slabs -= 1;
        }
        walk
    }

    #[inline]
    pub(super) const fn slabs(&self) -> u32 {
        self.slabs
    }

    #[inline]
    pub(super) fn next_slab(&mut self) -> Slab {
        self.slabs -= 1;
        self.advance(self.e.slope, self.f.slope)
    }

    /// Voxels of the slab in which the beam ends at `end`, without that voxel.
    #[inline]
    pub(super) fn last(mut self, end: u64) -> impl Iterator<Item = u64> {
        let at = |walk: &Self| walk.along.code | walk.e.code | walk.f.code;
        let enter = at(&self);
        let crosses = |axis: &Axis| axis.code != end & axis.mask;
        let between = (crosses(&self.e) && crosses(&self.f)).then(|| {
            if self.e_is_first() {
                self.e.advance(true);
            } else {
                self.f.advance(true);
            }
            at(&self)
        });
        std::iter::once(enter)
            .chain(between)
            .filter(move |&code| code != end)
    }

    /// The voxel between the two of the last slab, if both other coordinates cross a boundary.
    #[inline]
    pub(super) fn between(&self, slab: Slab) -> u64 {
        let later = if self.e_was_first() {
            self.f.mask
        } else {
            self.e.mask
        };
        (slab.leave & !later) | (slab.enter & later)
    }

    #[inline]
    fn advance(&mut self, e_part: u32, f_part: u32) -> Slab {
        let enter = self.along.code | self.e.code | self.f.code;
        let e_crosses = self.e.advance_by(e_part);
        let f_crosses = self.f.advance_by(f_part);
        let leave = self.along.code | self.e.code | self.f.code;
        self.along.advance(true);
        Slab {
            enter,
            leave,
            crosses_both: e_crosses & f_crosses,
        }
    }

    /// Whether the last boundary of `e` was crossed before that of `f`.
    #[inline]
    fn e_was_first(&self) -> bool {
        let since = |of: &Axis, other: &Axis| u64::from(of.fraction) * u64::from(other.slope);
        since(&self.e, &self.f) > since(&self.f, &self.e)
    }

    /// Whether the next boundary of `e` is crossed before that of `f`.
    #[inline]
    fn e_is_first(&self) -> bool {
        let rest = |axis: &Axis| ONE - u64::from(axis.fraction);
        // Halved to fit.
        (rest(&self.e) >> 1) * u64::from(self.f.slope)
            < (rest(&self.f) >> 1) * u64::from(self.e.slope)
    }
}

impl Axis {
    #[inline]
    fn new(
        window: &Window,
        axis: usize,
        (from, to): (FixedPoint, FixedPoint),
        per_slab: f64,
    ) -> Self {
        let (from, to) = (from[axis], to[axis]);
        let code = window.code(axis, (from >> FRACTION_BITS) as u32);
        let (mask, unit) = (window.mask(axis), Window::unit(axis));
        let grows = to >= from;
        // Rounded down, so that the walk never runs ahead of the beam.
        let slope = ((from.abs_diff(to) as f64 * per_slab) as u64).saturating_sub(1);
        let fraction = from as u32;
        Self {
            code,
            mask,
            step: if grows {
                (!mask).wrapping_add(unit)
            } else {
                unit.wrapping_neg()
            },
            fraction: if grows { fraction } else { !fraction },
            slope: slope.min(u64::from(u32::MAX)) as u32,
        }
    }

    /// Moves by a fraction of a voxel; returns whether it crosses a boundary.
    #[inline]
    const fn advance_by(&mut self, part: u32) -> bool {
        let (fraction, crosses) = self.fraction.overflowing_add(part);
        self.fraction = fraction;
        self.advance(crosses);
        crosses
    }

    /// Moves to the next voxel if `crosses`.
    #[inline]
    const fn advance(&mut self, crosses: bool) {
        let step = self.step & (crosses as u64).wrapping_neg();
        self.code = self.code.wrapping_add(step) & self.mask;
    }
}
