//! The voxels that a beam crosses: every one of them, in order, in whole numbers.
//!
//! The beam is walked in slabs, the voxel layers across its longest axis. Within a slab each of the other two
//! coordinates crosses at most one boundary, so the slab holds at most three of the beam's voxels: where it
//! enters, where it leaves, and, where both cross, one in between. Taking the first two always, often the same
//! one, costs less than asking. The voxels are those of \[Amanatides and Woo 1987\], as in `OctoMap`.

use super::voxel_address::Window;

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
    /// Whether there is one more, [`RayWalk::between`].
    pub(super) crosses_both: bool,
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
    /// Added to the code from voxel to voxel; ones between the bits of this axis where the coordinate grows, so
    /// that a carry passes.
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

    /// The voxel between the two of the slab that was walked last, where both other coordinates cross a boundary.
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

    /// Whether, of the last boundaries of both, that of `e` came first: it is farther behind.
    #[inline]
    fn e_was_first(&self) -> bool {
        let since = |of: &Axis, other: &Axis| u64::from(of.fraction) * u64::from(other.slope);
        since(&self.e, &self.f) > since(&self.f, &self.e)
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
        per_slab: f64,
    ) -> Self {
        let (from, to) = (from[axis], to[axis]);
        let code = window.code(axis, (from >> FRACTION_BITS) as u32);
        let (mask, unit) = (window.mask(axis), Window::unit(axis));
        let grows = to >= from;
        // One less than computed, so that a beam never gets ahead of itself.
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

    /// Moves by a fraction of a voxel; says whether that crosses a boundary.
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
