//! A brick of 4³ voxels, one byte each: one cache line, updated as one.

use super::log_odds_table::{EVEN, UNKNOWN, Update, Values};
use super::scratch_pages::BrickMarks;
use super::voxel_address::BRICK_VOXELS;

/// The log-odds of 64 voxels, by address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(align(64))]
pub(super) struct Brick(pub(super) [u8; BRICK_VOXELS]);

/// What an update did to a brick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct BrickChange {
    /// A voxel became known, or free, or occupied, that was not before.
    pub(super) states: bool,
    /// All voxels are now alike.
    pub(super) uniform: bool,
}

/// What is known of the 4³ voxels of a brick, a bit for each: x first, then y, then z.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BrickStates {
    /// Something is known of them.
    pub known: u64,
    /// Those of the known that are occupied; the others are free.
    pub occupied: u64,
}

impl Brick {
    /// Applies the marks of a scan.
    ///
    /// Always computed and always stored, so that the compiler makes vectors of it.
    #[inline]
    pub(super) fn apply(
        &mut self,
        marks: BrickMarks,
        update: Update,
        values: Values,
    ) -> BrickChange {
        let (mut states, mut unlike) = (0, 0);
        let before = self.0;
        for (value, is_free) in self.0.iter_mut().zip(bytes_of(marks.free)) {
            *value = if is_free == 0 {
                *value
            } else {
                values.freed(*value, update)
            };
        }
        if marks.hit != 0 {
            for (value, is_hit) in self.0.iter_mut().zip(bytes_of(marks.hit)) {
                *value = if is_hit == 0 {
                    *value
                } else {
                    values.hit(*value, update)
                };
            }
        }
        let first = self.0[0];
        for (&new, old) in self.0.iter().zip(before) {
            let became_known = u8::from(old == UNKNOWN) & u8::from(new != UNKNOWN);
            let changed_sides = u8::from(old > EVEN) ^ u8::from(new > EVEN);
            states |= became_known | changed_sides;
            unlike |= new ^ first;
        }
        BrickChange {
            states: states != 0,
            uniform: unlike == 0,
        }
    }
}

impl Brick {
    pub(super) fn states(&self) -> BrickStates {
        BrickStates {
            known: bits_where(&self.0, |value| value != UNKNOWN),
            occupied: bits_where(&self.0, |value| value > EVEN),
        }
    }
}

/// A bit for each voxel: whether it `is`.
#[inline]
fn bits_where(voxels: &[u8; BRICK_VOXELS], is: impl Fn(u8) -> bool) -> u64 {
    // Brings bit 8·n of eight bytes to bit 56 + n.
    const GATHER: u64 = 0x0102_0408_1020_4080;
    let mut bits = 0;
    for (at, eight) in voxels.as_chunks::<8>().0.iter().enumerate() {
        let ones = u64::from_le_bytes(eight.map(|value| u8::from(is(value))));
        bits |= (ones.wrapping_mul(GATHER) >> 56) << (8 * at);
    }
    bits
}

/// All ones in each byte whose bit is set.
#[inline]
fn bytes_of(bits: u64) -> [u8; BRICK_VOXELS] {
    let mut bytes = [0; BRICK_VOXELS];
    for (eight, of_eight) in bytes
        .as_chunks_mut::<8>()
        .0
        .iter_mut()
        .zip(bits.to_le_bytes())
    {
        for (voxel, byte) in eight.iter_mut().enumerate() {
            *byte = (of_eight >> voxel & 1).wrapping_neg();
        }
    }
    bytes
}
