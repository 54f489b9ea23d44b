//! A brick whose known voxels have at most three values, in two bits a voxel.
//!
//! Far from the vehicle few beams pass, and most bricks there stay so for ever: a third of the memory, and an
//! update is some twenty operations on 64 voxels at once.

use super::brick::{Brick, BrickChange, BrickStates};
use super::log_odds_table::{EVEN, UNKNOWN, Update, Values};
use super::scratch_pages::BrickMarks;
use super::voxel_address::BRICK_VOXELS;

/// 64 voxels, of up to three known values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PackedBrick {
    /// The low and the high bit of each voxel's place in `values`, counted from 1; 0 is unknown.
    planes: [u64; 2],
    values: [u8; 3],
}

impl PackedBrick {
    /// Nothing known, or all voxels alike.
    pub(super) const fn filled(value: u8) -> Self {
        let low = if value == UNKNOWN { 0 } else { u64::MAX };
        Self {
            planes: [low, 0],
            values: [value, UNKNOWN, UNKNOWN],
        }
    }

    /// The value of a voxel.
    pub(super) const fn value(&self, voxel: usize) -> u8 {
        let place = (self.planes[0] >> voxel & 1) | (self.planes[1] >> voxel & 1) << 1;
        match place {
            0 => UNKNOWN,
            place => self.values[place as usize - 1],
        }
    }

    /// All voxels, one byte each.
    pub(super) fn unpack(&self) -> Brick {
        let palette = [UNKNOWN, self.values[0], self.values[1], self.values[2]];
        let [low, high] = self.planes;
        let mut voxels = [0; BRICK_VOXELS];
        for (voxel, value) in voxels.iter_mut().enumerate() {
            *value = palette[((low >> voxel & 1) | (high >> voxel & 1) << 1) as usize];
        }
        Brick(voxels)
    }

    pub(super) fn states(&self) -> BrickStates {
        let [low, high] = self.planes;
        let sets = [low & !high, !low & high, low & high];
        let occupied = sets.into_iter().zip(self.values).map(
            |(set, value)| {
                if value > EVEN { set } else { 0 }
            },
        );
        BrickStates {
            known: low | high,
            occupied: occupied.fold(0, |a, b| a | b),
        }
    }

    /// Applies the marks of a scan; `None` where there are too many values then.
    #[inline]
    pub(super) fn applied(
        &self,
        marks: BrickMarks,
        update: Update,
        values: Values,
    ) -> Option<(Self, BrickChange)> {
        let mut new = Palette::default();
        let mut states = false;
        let [low, high] = self.planes;
        let sets = [!low & !high, low & !high, !low & high, low & high];
        let olds = [UNKNOWN, self.values[0], self.values[1], self.values[2]];
        for (set, old) in sets.into_iter().zip(olds) {
            if set == 0 {
                continue;
            }
            let (free, hit) = (set & marks.free, set & marks.hit);
            new.add(set & !free & !hit, old);
            for (seen, value) in [
                (free, values.freed(old, update)),
                (hit, values.hit(old, update)),
            ] {
                new.add(seen, value);
                states |= seen != 0 && (old == UNKNOWN || (old > EVEN) != (value > EVEN));
            }
        }
        let uniform = new.sets[0] == u64::MAX;
        new.packed()
            .map(|packed| (packed, BrickChange { states, uniform }))
    }

    /// The value of the first voxel that is known.
    pub(super) const fn first_value(&self) -> u8 {
        self.values[0]
    }
}

#[derive(Default)]
struct Palette {
    sets: [u64; 3],
    values: [u8; 3],
    overflows: bool,
}

impl Palette {
    #[inline]
    fn add(&mut self, set: u64, value: u8) {
        if set == 0 || value == UNKNOWN {
            return;
        }
        for (own, own_value) in self.sets.iter_mut().zip(&mut self.values) {
            if *own == 0 || *own_value == value {
                *own |= set;
                *own_value = value;
                return;
            }
        }
        self.overflows = true;
    }

    fn packed(&self) -> Option<PackedBrick> {
        let [a, b, c] = self.sets;
        (!self.overflows).then_some(PackedBrick {
            planes: [a | c, b | c],
            values: self.values,
        })
    }
}
