//! The voxels that a beam crosses: every one of them, in order, in whole numbers.
//!
//! The beam is walked in slabs, the voxel layers across its longest axis. Within a slab each of the other two
//! coordinates crosses at most one boundary, so the slab holds at most three of the beam's voxels: where it
//! enters, where it leaves, and, where both cross, one in between. Taking the first two always, often the same
//! one, costs less than asking. The voxels are those of \[Amanatides and Woo 1987\], as in `OctoMap`.

use super::codes::Window;

/// Bits of the fraction of a voxel.
const FRACTION_BITS: u32 = 32;
const ONE: u64 = 1 << FRACTION_BITS;

/// A point inside a window of voxels, whole voxels and 32 bits of fraction, along x, y, z.
pub(super) type FixedPoint = [u64; 3];

/// `point`, in voxels from the window's least corner, if it lies inside the window of `side` voxels.
pub(super) fn fixed(point: [f64; 3], side: u32) -> Option<FixedPoint> {
    let within = |voxels: &f64| (0.0..f64::from(side)).contains(voxels); // false for NaN
    point
        .iter()
        .all(within)
        .then(|| point.map(|voxels| (voxels * ONE as f64) as u64))
}

/// The voxel of `point`.
pub(super) fn voxel(point: FixedPoint) -> [u32; 3] {
    point.map(|coordinate| (coordinate >> FRACTION_BITS) as u32)
}

/// The codes of the voxels of one slab.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slab {
    pub(super) enter: u64,
    pub(super) leave: u64,
    /// Where both other coordinates cross a boundary.
    pub(super) between: Option<u64>,
}

/// A walk through the slabs of a beam.
#[derive(Clone, Copy, Debug)]
pub(super) struct RayWalk {
    along: Axis,
    e: Axis,
    f: Axis,
    /// Whole slabs to come.
    slabs: u32,
}

/// One coordinate of a beam.
#[derive(Clone, Copy, Debug)]
struct Axis {
    /// Of the present voxel, as part of its code; the bits of this axis alone.
    code: u64,
    /// The bits of this axis.
    mask: u64,
    /// Ones between them where the coordinate grows, so that a carry passes.
    fill: u64,
    /// Added to the code from voxel to voxel.
    step: u64,
    /// How far the beam is behind the last boundary, in the direction of the beam, as a fraction of a voxel.
    fraction: u32,
    /// How far it moves in a slab, as a fraction of a voxel.
    slope: u32,
}

impl RayWalk {
    /// From `from` to `to`, without the voxel of `to` itself. The first slab is told to `first`, the last one
    /// remains for [`RayWalk::last`].
    #[inline]
    pub(super) fn new(
        window: &Window,
        from: FixedPoint,
        to: FixedPoint,
        first: impl FnOnce(Slab),
    ) -> Self {
        let length = |axis: usize| from[axis].abs_diff(to[axis]);
        let mut order = [0, 1, 2];
        order.sort_by_key(|&axis| std::cmp::Reverse(length(axis)));
        let longest = length(order[0]).max(1);
        let axis = |n: usize| Axis::new(window, order[n], (from, to), longest);
        let (along, e, f) = (axis(0), axis(1), axis(2));
        let slabs =
            (from[order[0]] >> FRACTION_BITS).abs_diff(to[order[0]] >> FRACTION_BITS) as u32;
        let mut walk = Self { along, e, f, slabs };
        if slabs > 0 {
            let rest = ONE - u64::from(along.fraction);
            let part = |slope: u32| ((u64::from(slope) * rest) >> FRACTION_BITS) as u32;
            first(walk.advance(part(e.slope), part(f.slope)));
            walk.slabs -= 1;
        }
        walk
    }

    /// Whole slabs to come.
    #[inline]
    pub(super) const fn slabs(&self) -> u32 {
        self.slabs
    }

    /// The next whole slab.
    #[inline]
    pub(super) fn next_slab(&mut self) -> Slab {
        self.slabs -= 1;
        self.advance(self.e.slope, self.f.slope)
    }

    /// The voxels of the slab in which the beam ends at `end`, without that voxel.
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

    #[inline]
    fn advance(&mut self, e_part: u32, f_part: u32) -> Slab {
        let (e_fraction, e_crosses) = self.e.fraction.overflowing_add(e_part);
        let (f_fraction, f_crosses) = self.f.fraction.overflowing_add(f_part);
        let (e, f) = (self.e.code, self.f.code);
        let e_is_first = e_crosses && f_crosses && self.e_is_first();
        self.e.advance(e_crosses);
        self.f.advance(f_crosses);
        let along = self.along.code;
        let both = if e_is_first {
            self.e.code | f
        } else {
            e | self.f.code
        };
        let between = (e_crosses && f_crosses).then_some(along | both);
        let slab = Slab {
            enter: along | e | f,
            leave: along | self.e.code | self.f.code,
            between,
        };
        self.along.advance(true);
        self.e.fraction = e_fraction;
        self.f.fraction = f_fraction;
        slab
    }

    /// Whether, of the next boundaries of both, that of `e` comes first.
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
        longest: u64,
    ) -> Self {
        let (from, to) = (from[axis], to[axis]);
        let code = window.code(axis, (from >> FRACTION_BITS) as u32);
        let (mask, unit) = (window.mask(axis), Window::unit(axis));
        let grows = to >= from;
        // Rounded down, so that a beam never gets ahead of itself; a whole voxel a slab is nearly one.
        let slope = (u128::from(from.abs_diff(to)) << FRACTION_BITS) / u128::from(longest);
        let fraction = from as u32;
        Self {
            code,
            mask,
            fill: if grows { !mask } else { 0 },
            step: if grows { unit } else { unit.wrapping_neg() },
            fraction: if grows { fraction } else { !fraction },
            slope: slope.min(u128::from(u32::MAX)) as u32,
        }
    }

    /// Moves to the next voxel if `crosses`.
    #[inline]
    const fn advance(&mut self, crosses: bool) {
        let step = self.step & (crosses as u64).wrapping_neg();
        self.code = (self.code | self.fill).wrapping_add(step) & self.mask;
    }
}
