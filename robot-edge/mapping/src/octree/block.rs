//! A block of 16³ voxels and its bricks of 4³ voxels.
//!
//! A brick is uniform, full (one byte per voxel, one cache line) or packed: two bits per voxel for
//! at most three known values. Few beams reach bricks far from the vehicle, and most of them stay
//! packed: a third of the memory, and an update is some twenty operations on 64 voxels at once.

use crate::octree::log_odds_table::{EVEN, UNKNOWN, Update, Values};
use crate::octree::scratch_pages::{BrickMarks, MarkedBlock};
use crate::octree::surface::SurfaceVoxel;
use crate::octree::voxel_address::{BLOCK_BRICKS, BRICK_VOXELS, BlockIndex};

#[derive(Clone, Debug)]
pub(super) struct Block {
    pub(super) index: BlockIndex,
    /// Kind and index of each brick, see [`Child`].
    children: [u8; BLOCK_BRICKS],
    /// Brick columns with untaken changes, a bit for each.
    changed: u16,
    /// In no particular order.
    bricks: Vec<Brick>,
    packed: Vec<PackedBrick>,
    /// Voxels with hits, ascending by address.
    surface: Vec<(u16, SurfaceVoxel)>,
}

/// Representation of a brick.
#[derive(Clone, Copy, Debug)]
enum Child {
    /// All voxels have this value.
    Uniform(u8),
    /// Index among the full bricks.
    Full(usize),
    /// Index among the packed bricks.
    Packed(usize),
}

const ALL_UNKNOWN: u8 = 255;
const ALL_LEAST: u8 = 254;
const ALL_GREATEST: u8 = 253;
const FIRST_PACKED: u8 = 64;

/// Of [`Block::to_bytes`].
const PACKED_BYTES: usize = 2 * 8 + 3;
const SURFACE_BYTES: usize = 2 + SurfaceVoxel::BYTES;

impl Block {
    pub(super) fn new(index: BlockIndex) -> Self {
        Self {
            index,
            children: [ALL_UNKNOWN; BLOCK_BRICKS],
            changed: 0,
            bricks: Vec::new(),
            packed: Vec::new(),
            surface: Vec::new(),
        }
    }

    /// As [`Block::from_bytes`] reads it, without untaken changes: the children, the numbers of what follows, then that.
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = self.children.to_vec();
        bytes.extend([self.bricks.len() as u8, self.packed.len() as u8]);
        bytes.extend((self.surface.len() as u16).to_le_bytes());
        bytes.extend(self.bricks.iter().flat_map(|brick| brick.0));
        for PackedBrick { planes, values } in &self.packed {
            bytes.extend(planes.iter().flat_map(|plane| plane.to_le_bytes()));
            bytes.extend(values);
        }
        for (at, surface) in &self.surface {
            bytes.extend(at.to_le_bytes());
            bytes.extend(surface.to_bytes());
        }
        bytes
    }

    /// `None` if the bytes are not those of [`Block::to_bytes`].
    pub(super) fn from_bytes(index: BlockIndex, bytes: &[u8]) -> Option<Self> {
        let (&children, bytes) = bytes.split_first_chunk()?;
        let ([bricks, packed], bytes) = bytes.split_first_chunk()?;
        let (surface, bytes) = bytes.split_first_chunk()?;
        let surface = usize::from(u16::from_le_bytes(*surface)) * SURFACE_BYTES;
        let (bricks, bytes) = bytes.split_at_checked(usize::from(*bricks) * BRICK_VOXELS)?;
        let (packed, bytes) = bytes.split_at_checked(usize::from(*packed) * PACKED_BYTES)?;
        let bricks = bricks.as_chunks().0.iter();
        let packed = packed.as_chunks::<PACKED_BYTES>().0.iter();
        let surfaces = bytes.as_chunks::<SURFACE_BYTES>().0.iter();
        Some(Self {
            index,
            children,
            changed: 0,
            bricks: bricks.map(|&voxels| Brick(voxels)).collect(),
            packed: packed.map(PackedBrick::from_bytes).collect(),
            surface: (surface == bytes.len()).then(|| {
                let at = |[low, high, ..]: &[u8; SURFACE_BYTES]| u16::from_le_bytes([*low, *high]);
                surfaces
                    .map(|bytes| (at(bytes), SurfaceVoxel::from_bytes(&bytes[2..])))
                    .collect()
            })?,
        })
    }

    /// Replaces what is known of it by `other`, all of whose columns have changed then. Returns whether these are the first
    /// untaken changes.
    pub(super) fn replace(&mut self, other: Self) -> bool {
        let was_changed = self.changed != 0;
        *self = Self {
            changed: u16::MAX,
            ..other
        };
        !was_changed
    }

    /// Whether it holds more than a value for each brick.
    pub(super) const fn is_fine(&self) -> bool {
        !(self.bricks.is_empty() && self.packed.is_empty() && self.surface.is_empty())
    }

    pub(super) fn value(&self, address: usize, values: Values) -> u8 {
        let voxel = address % BRICK_VOXELS;
        match self.child(address / BRICK_VOXELS, values) {
            Child::Uniform(value) => value,
            Child::Full(place) => self.bricks[place].0[voxel],
            Child::Packed(place) => self.packed[place].value(voxel),
        }
    }

    /// Applies the marks of a scan and clears them. Returns whether these are the first untaken
    /// changes.
    pub(super) fn apply(
        &mut self,
        marked: &mut MarkedBlock<'_>,
        update: Update,
        values: Values,
    ) -> bool {
        let was_changed = self.changed != 0;
        std::hint::black_box(self.fetch(marked.touched));
        for number in bits(marked.touched) {
            let marks = marked.take(number);
            let change = match self.child(number, values) {
                // Most bricks near the vehicle are as free as possible.
                Child::Uniform(value) if value == values.least && marks.hit == 0 => BrickChange {
                    states: false,
                    uniform: false,
                },
                Child::Uniform(value) => {
                    let place = push(&mut self.packed, PackedBrick::filled(value));
                    self.children[number] = place as u8 + FIRST_PACKED;
                    self.apply_packed(number, place, marks, update, values)
                }
                Child::Packed(place) => self.apply_packed(number, place, marks, update, values),
                Child::Full(place) => self.bricks[place].apply(marks, update, values),
            };
            if change.states {
                self.changed |= 1 << (number % 16);
            }
            if change.uniform {
                self.prune(number, values);
            }
        }
        self.changed != 0 && !was_changed
    }

    pub(super) fn surface(&self, address: usize) -> Option<&SurfaceVoxel> {
        let found = self
            .surface
            .binary_search_by_key(&(address as u16), |&(at, _)| at);
        found.ok().map(|place| &self.surface[place].1)
    }

    /// Whether a voxel of a brick was ever hit, as far as that is remembered.
    pub(super) fn has_surfaces(&self, number: usize) -> bool {
        let first = (number * BRICK_VOXELS) as u16;
        let at = self.surface.partition_point(|(at, _)| *at < first);
        let next = self.surface.get(at);
        next.is_some_and(|(at, _)| usize::from(*at) < (number + 1) * BRICK_VOXELS)
    }

    /// For adding a hit; its brick column has changed. The flag is set if it is the first untaken
    /// change.
    pub(super) fn surface_mut(&mut self, address: usize) -> (&mut SurfaceVoxel, bool) {
        let was_changed = self.changed != 0;
        self.changed |= 1 << (address / BRICK_VOXELS % 16);
        let address = address as u16;
        let place = match self.surface.binary_search_by_key(&address, |&(at, _)| at) {
            Ok(place) => place,
            Err(place) => {
                self.surface.insert(place, (address, SurfaceVoxel::NONE));
                place
            }
        };
        (&mut self.surface[place].1, !was_changed)
    }

    /// Known and occupied voxels of a brick.
    pub(super) fn states(&self, number: usize, values: Values) -> BrickStates {
        let all = |is: bool| if is { u64::MAX } else { 0 };
        match self.child(number, values) {
            Child::Uniform(value) => BrickStates {
                known: all(value != UNKNOWN),
                occupied: all(value > EVEN),
            },
            Child::Full(place) => self.bricks[place].states(),
            Child::Packed(place) => self.packed[place].states(),
        }
    }

    /// Makes each brick one voxel: occupied if any of it is, as a coarser level of an `OctoMap`, free if a quarter is, as much as a layer. The
    /// surfaces are forgotten. Returns whether these are the first untaken changes.
    pub(super) fn coarsen(&mut self, values: Values) -> bool {
        let was_changed = self.changed != 0;
        for number in 0..BLOCK_BRICKS {
            let states = self.states(number, values);
            let free = states.known & !states.occupied;
            let (child, coarse) = if states.occupied != 0 {
                (ALL_GREATEST, [u64::MAX; 2])
            } else if free.count_ones() as usize >= BRICK_VOXELS / 4 {
                (ALL_LEAST, [u64::MAX, 0])
            } else {
                (ALL_UNKNOWN, [0; 2])
            };
            self.children[number] = child;
            if [states.known, states.occupied] != coarse {
                self.changed |= 1 << (number % 16);
            }
        }
        self.bricks = Vec::new();
        self.packed = Vec::new();
        self.surface = Vec::new();
        self.changed != 0 && !was_changed
    }

    /// Takes the brick columns with changes, a bit for each, x first.
    pub(super) const fn take_changed(&mut self) -> u16 {
        std::mem::replace(&mut self.changed, 0)
    }

    /// Number of bricks that are not uniform.
    pub(super) const fn stored(&self) -> usize {
        self.bricks.len() + self.packed.len()
    }

    pub(super) fn bytes(&self) -> usize {
        let surface = self.surface.capacity() * size_of::<(u16, SurfaceVoxel)>();
        let bricks = self.bricks.capacity() * BRICK_VOXELS;
        let packed = self.packed.capacity() * size_of::<PackedBrick>();
        size_of::<Self>() + bricks + packed + surface
    }

    fn child(&self, number: usize, values: Values) -> Child {
        match self.children[number] {
            ALL_UNKNOWN => Child::Uniform(UNKNOWN),
            ALL_LEAST => Child::Uniform(values.least),
            ALL_GREATEST => Child::Uniform(values.greatest),
            place @ ..FIRST_PACKED => Child::Full(place.into()),
            place => Child::Packed((place - FIRST_PACKED).into()),
        }
    }

    /// Prefetches the block, as [`Block::fetch`] its bricks.
    #[inline]
    pub(super) fn fetch_header(&self) -> u8 {
        self.children[0] ^ self.packed.capacity() as u8
    }

    /// Prefetch: reads one byte of each brick, so that the processor loads them in parallel. In a
    /// large map none is in its caches.
    #[inline]
    fn fetch(&self, numbers: u64) -> u8 {
        let byte = |number: usize| match self.children[number] {
            place @ ..FIRST_PACKED => self.bricks[usize::from(place)].0[0],
            place @ FIRST_PACKED..ALL_GREATEST => {
                self.packed[usize::from(place - FIRST_PACKED)].first_value()
            }
            ALL_GREATEST.. => 0,
        };
        bits(numbers).fold(0, |sum, number| sum ^ byte(number))
    }

    #[inline]
    fn apply_packed(
        &mut self,
        number: usize,
        place: usize,
        marks: BrickMarks,
        update: Update,
        values: Values,
    ) -> BrickChange {
        let packed = self.packed[place];
        if let Some((new, change)) = packed.applied(marks, update, values) {
            self.packed[place] = new;
            return change;
        }
        self.remove_packed(place);
        let mut brick = packed.unpack();
        let change = brick.apply(marks, update, values);
        self.children[number] = push(&mut self.bricks, brick) as u8;
        change
    }

    /// Replaces a uniform brick at a limit of the log-odds by its value.
    fn prune(&mut self, number: usize, values: Values) {
        let child = self.child(number, values);
        let value = match child {
            Child::Uniform(_) => return,
            Child::Full(place) => self.bricks[place].0[0],
            Child::Packed(place) => self.packed[place].first_value(),
        };
        let uniform = if value == values.least {
            ALL_LEAST
        } else if value == values.greatest {
            ALL_GREATEST
        } else {
            return;
        };
        match child {
            Child::Uniform(_) => {}
            Child::Full(place) => {
                self.bricks.swap_remove(place);
                self.move_child(self.bricks.len() as u8, place as u8);
            }
            Child::Packed(place) => self.remove_packed(place),
        }
        self.children[number] = uniform;
    }

    fn remove_packed(&mut self, place: usize) {
        self.packed.swap_remove(place);
        self.move_child(
            self.packed.len() as u8 + FIRST_PACKED,
            place as u8 + FIRST_PACKED,
        );
    }

    fn move_child(&mut self, from: u8, to: u8) {
        if let Some(child) = self.children.iter_mut().find(|child| **child == from) {
            *child = to;
        }
    }
}

/// Adds a brick; returns its index.
fn push<T>(bricks: &mut Vec<T>, brick: T) -> usize {
    if bricks.len() == bricks.capacity() {
        // In small steps: doubling would waste a quarter of the memory of a large map.
        bricks.reserve_exact(GROWTH);
    }
    bricks.push(brick);
    bricks.len() - 1
}

fn bits(mut set: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let bit = set.trailing_zeros() as usize;
        set &= set.wrapping_sub(1);
        (bit < BLOCK_BRICKS).then_some(bit)
    })
}

/// Steps by which the bricks of a block grow.
const GROWTH: usize = 4;

/// Log-odds of 64 voxels, by address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(align(64))]
pub(super) struct Brick(pub(super) [u8; BRICK_VOXELS]);

/// Effect of an update on a brick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct BrickChange {
    /// The state (unknown, free, occupied) of a voxel changed.
    pub(super) states: bool,
    /// All voxels are equal now.
    pub(super) uniform: bool,
}

/// States of the 4³ voxels of a brick, a bit for each: x first, then y, then z.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BrickStates {
    /// Something is known of them.
    pub known: u64,
    /// Of the known voxels; the others are free.
    pub occupied: u64,
}

impl Brick {
    /// Applies the marks of a scan.
    ///
    /// Computes and stores unconditionally, so that it is vectorised.
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

/// A bit for each voxel: the result of `is`.
#[inline]
fn bits_where(voxels: &[u8; BRICK_VOXELS], is: impl Fn(u8) -> bool) -> u64 {
    // Moves bit 8·n of eight bytes to bit 56 + n.
    const GATHER: u64 = 0x0102_0408_1020_4080;
    let mut bits = 0;
    for (at, eight) in voxels.as_chunks::<8>().0.iter().enumerate() {
        let ones = u64::from_le_bytes(eight.map(|value| u8::from(is(value))));
        bits |= (ones.wrapping_mul(GATHER) >> 56) << (8 * at);
    }
    bits
}

/// Not zero in each byte whose bit is set.
#[inline]
fn bytes_of(bits: u64) -> [u8; BRICK_VOXELS] {
    // A copy in each of eight bytes, and of it a bit.
    const COPIES: u64 = 0x0101_0101_0101_0101;
    const BIT_OF_EACH: u64 = 0x8040_2010_0804_0201;
    let mut bytes = [0; BRICK_VOXELS];
    let eights = bytes.as_chunks_mut::<8>().0.iter_mut();
    for (eight, of_eight) in eights.zip(bits.to_le_bytes()) {
        *eight = ((u64::from(of_eight) * COPIES) & BIT_OF_EACH).to_le_bytes();
    }
    bytes
}

/// 64 voxels with up to three known values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PackedBrick {
    /// Low and high bit of each voxel's index in `values`, from 1; 0 is unknown.
    planes: [u64; 2],
    values: [u8; 3],
}

impl PackedBrick {
    fn from_bytes(bytes: &[u8; PACKED_BYTES]) -> Self {
        let (planes, values) = bytes.as_chunks();
        Self {
            planes: std::array::from_fn(|plane| u64::from_le_bytes(planes[plane])),
            values: std::array::from_fn(|value| values[value]),
        }
    }

    /// A uniform brick, known or unknown.
    pub(super) const fn filled(value: u8) -> Self {
        let low = if value == UNKNOWN { 0 } else { u64::MAX };
        Self {
            planes: [low, 0],
            values: [value, UNKNOWN, UNKNOWN],
        }
    }

    pub(super) const fn value(&self, voxel: usize) -> u8 {
        let place = (self.planes[0] >> voxel & 1) | (self.planes[1] >> voxel & 1) << 1;
        match place {
            0 => UNKNOWN,
            place => self.values[place as usize - 1],
        }
    }

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

    /// Applies the marks of a scan; `None` if there are more than three values then.
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

    /// Value of the first known voxel.
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
