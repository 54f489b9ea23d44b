//! Marks of one scan, free or hit, one per voxel, and the integer walk along a beam that sets them
//! (docs/methods.md, section 3).
//!
//! A beam is walked in slabs, the voxel layers across its longest axis. Within a slab each of the
//! other two coordinates crosses at most one boundary, so a slab holds at most three voxels: entry,
//! exit and, if both cross, one in between. The four slabs of a layer of bricks are marked together:
//! a table gives the voxels that each of the two coordinates allows, and the beam's are those that
//! both allow, but for a corner that it passes by where both cross. The voxels are those of
//! Amanatides and Woo (1987), as in `OctoMap`.

use crate::octree::SHARDS;
use crate::octree::scratch_pages::{ScratchPages, ShardMarks};
use crate::octree::voxel_address::{
    BLOCK_BRICKS, BLOCK_EDGE, BRICK_EDGE, BRICK_VOXELS, BlockIndex, LOCAL_BITS, Window,
};

/// Greatest side of a scan's window, voxels.
const MAX_SIDE: u32 = 1 << 16;
/// Greatest coordinate of a block; voxel indices have 32 bits.
const MAX_BLOCK: f64 = (1 << 26) as f64;

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
        let mut walk = RayWalk::new(window, from, to);
        let (start, end) = (walk.column(), walk.column() + walk.slabs);
        if start < end {
            let layer = walk.part_of_layer(start, end.min(BRICK_SLABS));
            layer.write(window, scratch_pages);
        }
        for _ in 1..end / BRICK_SLABS {
            let layer = walk.layer(0, BRICK_SLABS, [walk.e.slope; 4], [walk.f.slope; 4]);
            layer.write(window, scratch_pages);
        }
        if end > BRICK_SLABS && end % BRICK_SLABS > 0 {
            let layer = walk.part_of_layer(0, end % BRICK_SLABS);
            layer.write(window, scratch_pages);
        }
        for code in walk.last(code(window, to)) {
            let (brick, bit) = brick_and_bit(code);
            scratch_pages.page(window, code >> LOCAL_BITS).free[brick] |= bit;
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

/// Slabs of a layer of bricks.
const BRICK_SLABS: u32 = BRICK_EDGE as u32;

/// Marks of a beam in one layer of bricks: at most two along each of the other axes.
#[derive(Clone, Copy, Debug)]
struct Layer {
    /// Codes of the bricks' first voxels; repeated where the beam crosses no boundary of bricks.
    bricks: [u64; 4],
    marks: [u64; 4],
}

impl Layer {
    #[expect(
        clippy::inline_always,
        reason = "in the loop over the layers of a beam"
    )]
    #[inline(always)]
    fn write(&self, window: &Window, scratch_pages: &mut ScratchPages) {
        let [first, .., last] = self.bricks;
        let bricks = self.bricks.into_iter().zip(self.marks);
        let number = |brick: u64| brick_and_bit(brick).0;
        if (first ^ last) >> LOCAL_BITS == 0 {
            let page = scratch_pages.page(window, first >> LOCAL_BITS);
            for (brick, marks) in bricks {
                page.free[number(brick)] |= marks;
            }
        } else {
            for (brick, marks) in bricks {
                // A block without marks needs no page.
                if marks != 0 {
                    scratch_pages.page(window, brick >> LOCAL_BITS).free[number(brick)] |= marks;
                }
            }
        }
    }
}

/// A walk through the slabs of a beam.
#[derive(Clone, Copy, Debug)]
struct RayWalk {
    along: Axis,
    e: Axis,
    f: Axis,
    /// Whole slabs.
    slabs: u32,
}

/// One coordinate of a beam. It is mirrored if it falls, so that it grows.
#[derive(Clone, Copy, Debug)]
struct Axis {
    number: usize,
    /// This axis' bits of the code of the current brick.
    brick: u64,
    mask: u64,
    /// Added to `brick` per brick; for a growing coordinate with ones between the bits of this axis, so that a carry
    /// passes.
    step: u64,
    /// Distance from the beginning of the brick, voxels with 32 bits of fraction.
    at: u64,
    /// Movement per slab.
    slope: u64,
    falls: bool,
    patterns: &'static Patterns,
}

impl RayWalk {
    /// From `from` to `to`.
    #[inline]
    fn new(window: &Window, from: FixedPoint, to: FixedPoint) -> Self {
        let [x, y, z] = std::array::from_fn(|axis| from[axis].abs_diff(to[axis]));
        let order = if x >= y && x >= z {
            [0, 1, 2]
        } else if y >= z {
            [1, 0, 2]
        } else {
            [2, 0, 1]
        };
        let falls = order.map(|axis| to[axis] < from[axis]);
        let per_slab = ONE as f64 / x.max(y).max(z).max(1) as f64;
        let axis = |n: usize| {
            let patterns =
                &PATTERNS[order[0]][order[n]][usize::from(falls[0]) << 1 | usize::from(falls[n])];
            Axis::new(window, order[n], falls[n], (from, to), per_slab, patterns)
        };
        let slabs =
            (from[order[0]] >> FRACTION_BITS).abs_diff(to[order[0]] >> FRACTION_BITS) as u32;
        Self {
            along: axis(0),
            e: axis(1),
            f: axis(2),
            slabs,
        }
    }

    /// Slab of its layer of bricks in which the beam begins.
    #[inline]
    const fn column(&self) -> u32 {
        (self.along.at >> FRACTION_BITS) as u32
    }

    /// The slabs `start..end` of the current layer, of which only the first of the beam is not whole.
    #[inline(never)]
    fn part_of_layer(&mut self, start: u32, end: u32) -> Layer {
        let rest = ONE - u64::from(self.along.at as u32);
        let parts = |slope: u64| {
            std::array::from_fn(|slab| match slab as u32 {
                slab if slab < start || slab >= end => 0,
                slab if slab == start => (slope * rest) >> FRACTION_BITS,
                _ => slope,
            })
        };
        let (e_parts, f_parts) = (parts(self.e.slope), parts(self.f.slope));
        self.layer(start, end, e_parts, f_parts)
    }

    /// Walks through the slabs `start..end` of the current layer.
    #[expect(
        clippy::inline_always,
        reason = "in the loop over the layers of a beam"
    )]
    #[inline(always)]
    fn layer(&mut self, start: u32, end: u32, e_parts: [u64; 4], f_parts: [u64; 4]) -> Layer {
        let (e_brick, f_brick) = (self.e.brick, self.f.brick);
        let from = [self.e.at, self.f.at];
        let (e_crossings, f_crossings) = (self.e.advance(e_parts), self.f.advance(f_parts));
        let [mut e0, mut e1] = self.e.patterns[e_crossings];
        if end - start < BRICK_SLABS {
            let slabs = (start..end).fold(0, |slabs, slab| slabs | self.along.slab(slab));
            (e0, e1) = (e0 & slabs, e1 & slabs);
        }
        let [f0, f1] = self.f.patterns[f_crossings];
        let mut marks = [e0 & f0, e1 & f0, e0 & f1, e1 & f1];
        let both = e_crossings & f_crossings & 15;
        if both != 0 {
            let passed = self.passed(from, both, e_parts, f_parts);
            marks = std::array::from_fn(|brick| marks[brick] & !passed[brick]);
        }
        let along = self.along.brick;
        let (near, far) = (along | f_brick, along | self.f.brick);
        let e_next = self.e.brick;
        let bricks = [near | e_brick, near | e_next, far | e_brick, far | e_next];
        self.along.at = u64::from(end % BRICK_SLABS) << FRACTION_BITS;
        self.along.advance_brick(u64::from(end / BRICK_SLABS));
        Layer { bricks, marks }
    }

    /// By brick: of the four voxels of each slab in which `both` other coordinates cross a boundary, the one that the beam passes by.
    #[inline(never)]
    fn passed(&self, from: [u64; 2], mut both: usize, e: [u64; 4], f: [u64; 4]) -> [u64; 4] {
        let mut passed = [0; 4];
        while both != 0 {
            let slab = 3 - both.trailing_zeros();
            both &= both - 1;
            let walked = |parts: [u64; 4]| parts[..=slab as usize].iter().sum::<u64>();
            let (mut e, mut f) = (from[0] + walked(e), from[1] + walked(f));
            let since = |at: u64, other: &Axis| u64::from(at as u32) * other.slope;
            let e_is_first = since(e, &self.f) > since(f, &self.e);
            e -= u64::from(e_is_first) << FRACTION_BITS;
            f -= u64::from(!e_is_first) << FRACTION_BITS;
            let brick = usize::from(e > IN_BRICK) | usize::from(f > IN_BRICK) << 1;
            passed[brick] |= self.along.slab(slab) & self.e.row(e) & self.f.row(f);
        }
        passed
    }

    /// Voxels of the slab in which the beam ends at `end`, without that voxel.
    #[inline]
    fn last(mut self, end: u64) -> impl Iterator<Item = u64> {
        let at = |walk: &Self| walk.along.code() | walk.e.code() | walk.f.code();
        let enter = at(&self);
        let crosses = |axis: &Axis| axis.code() != end & (axis.mask | 3 << (2 * axis.number));
        let between = (crosses(&self.e) && crosses(&self.f)).then(|| {
            if self.e_is_first() {
                self.e.advance_voxel();
            } else {
                self.f.advance_voxel();
            }
            at(&self)
        });
        std::iter::once(enter)
            .chain(between)
            .filter(move |&code| code != end)
    }

    /// Whether the next boundary of `e` is crossed before that of `f`.
    #[inline]
    fn e_is_first(&self) -> bool {
        let rest = |axis: &Axis| ONE - u64::from(axis.at as u32);
        // Halved to fit.
        (rest(&self.e) >> 1) * self.f.slope < (rest(&self.f) >> 1) * self.e.slope
    }
}

impl Axis {
    #[inline]
    fn new(
        window: &Window,
        number: usize,
        falls: bool,
        (from, to): (FixedPoint, FixedPoint),
        per_slab: f64,
        patterns: &'static Patterns,
    ) -> Self {
        let (from, to) = (from[number], to[number]);
        let unit = Window::unit(number) << BRICK_BITS;
        let mask = window.mask(number) & !(BRICK_VOXELS as u64 - 1);
        // Rounded down, so that the walk never runs ahead of the beam.
        let slope = ((from.abs_diff(to) as f64 * per_slab) as u64).saturating_sub(1);
        Self {
            number,
            brick: window.code(number, (from >> FRACTION_BITS) as u32) & mask,
            mask,
            step: if falls {
                unit.wrapping_neg()
            } else {
                (!mask).wrapping_add(unit)
            },
            at: if falls { !from } else { from } & IN_BRICK,
            slope: slope.min(u64::from(u32::MAX)),
            falls,
            patterns,
        }
    }

    /// Moves along a layer of bricks; returns the index of its [`Patterns`].
    #[expect(
        clippy::inline_always,
        reason = "in the loop over the layers of a beam"
    )]
    #[inline(always)]
    const fn advance(&mut self, parts: [u64; 4]) -> usize {
        let start = self.at;
        let [a, b, c, d] = parts;
        let (first, second) = (start + a, start + a + b);
        let (third, end) = (second + c, second + c + d);
        // 16 times the first coordinate and 8, 4, 2 and 1 times the differences.
        let index = (start >> FRACTION_BITS << 3)
            + (first >> FRACTION_BITS << 2)
            + (second >> FRACTION_BITS << 1)
            + (third >> FRACTION_BITS)
            + (end >> FRACTION_BITS);
        self.at = end & IN_BRICK;
        self.advance_brick(end >> (FRACTION_BITS + 2));
        index as usize & 63
    }

    /// Moves by no brick or one.
    #[expect(
        clippy::inline_always,
        reason = "in the loop over the layers of a beam"
    )]
    #[inline(always)]
    const fn advance_brick(&mut self, bricks: u64) {
        let step = self.step & bricks.wrapping_neg();
        self.brick = self.brick.wrapping_add(step) & self.mask;
    }

    fn advance_voxel(&mut self) {
        let at = self.at + ONE;
        self.at = at & IN_BRICK;
        self.advance_brick(at >> (FRACTION_BITS + 2));
    }

    /// This axis' bits of the code of the current voxel.
    #[inline]
    fn code(&self) -> u64 {
        let in_brick = self.at >> FRACTION_BITS ^ if self.falls { 3 } else { 0 };
        self.brick | in_brick << (2 * self.number)
    }

    /// Voxels of a brick with this coordinate.
    #[inline]
    fn row(&self, at: u64) -> u64 {
        row(self.number, (at >> FRACTION_BITS) as u32, self.falls)
    }

    #[inline]
    fn slab(&self, slab: u32) -> u64 {
        row(self.number, slab, self.falls)
    }
}

const BRICK_BITS: u32 = 6;
const IN_BRICK: u64 = (ONE << 2) - 1;

/// Marks of an axis in a layer of bricks by the beam's coordinate at the beginning (2 bits) and a bit for each slab in which it
/// crosses a boundary, the first slab highest: those in its brick and in the next.
type Patterns = [[u64; 2]; 64];

/// By longest axis, other axis, and whether they fall.
static PATTERNS: [[[Patterns; 4]; 3]; 3] = all_patterns();

#[expect(clippy::large_stack_arrays, reason = "the compiler runs it")]
const fn all_patterns() -> [[[Patterns; 4]; 3]; 3] {
    let mut all = [[[[[0; 2]; 64]; 4]; 3]; 3];
    let mut n = 0;
    while n < 3 * 3 * 4 * 64 * 4 {
        let (slab, start, fall, other, along) =
            (n % 4, n / 4 % 64, n / 256 % 4, n / 1024 % 3, n / 3072);
        let before = (start >> 4) as u32 + ((start as u32 % 16) >> (4 - slab)).count_ones();
        let after = (start >> 4) as u32 + ((start as u32 % 16) >> (3 - slab)).count_ones();
        let slab = row(along, slab as u32, fall & 2 != 0);
        let pattern = &mut all[along][other][fall][start];
        pattern[(before >> 2) as usize] |= slab & row(other, before, fall & 1 != 0);
        pattern[(after >> 2) as usize] |= slab & row(other, after, fall & 1 != 0);
        n += 1;
    }
    all
}

/// Voxels of a brick with this coordinate along an axis.
#[inline]
const fn row(axis: usize, coordinate: u32, falls: bool) -> u64 {
    const FIRST: [u64; 3] = [0x1111_1111_1111_1111, 0x000f_000f_000f_000f, 0xffff];
    let coordinate = if falls { !coordinate } else { coordinate } & 3;
    FIRST[axis] << (coordinate << (2 * axis))
}
