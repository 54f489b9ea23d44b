//! A block of 16³ voxels: the bricks of it that are not all alike, and what the others are.

use super::brick::{Brick, BrickChange, BrickStates};
use super::log_odds_table::{EVEN, UNKNOWN, Update, Values};
use super::packed_brick::PackedBrick;
use super::scratch_pages::{BrickMarks, MarkedBlock};
use super::surface::SurfaceVoxel;
use super::voxel_address::{BLOCK_BRICKS, BRICK_VOXELS, BlockIndex};

/// 16³ voxels.
#[derive(Clone, Debug)]
pub(super) struct Block {
    pub(super) index: BlockIndex,
    /// For each brick where it is: see [`Child`].
    children: [u8; BLOCK_BRICKS],
    /// Columns of bricks in which the state of a voxel has changed since that was taken, a bit for each.
    changed: u16,
    bricks: BrickList<Brick>,
    packed: BrickList<PackedBrick>,
    /// Voxels that were hit, by address.
    surface: Vec<(u16, SurfaceVoxel)>,
}

/// What a brick of a block is.
#[derive(Clone, Copy, Debug)]
enum Child {
    /// All voxels have this value.
    Uniform(u8),
    /// At this place among the bricks.
    Full(usize),
    /// At this place among the packed bricks.
    Packed(usize),
}

const ALL_UNKNOWN: u8 = 255;
const ALL_LEAST: u8 = 254;
const ALL_GREATEST: u8 = 253;
const FIRST_PACKED: u8 = 64;

/// Bricks in no order, each with its number in the block.
#[derive(Clone, Debug)]
struct BrickList<T> {
    bricks: Vec<T>,
    numbers: Vec<u8>,
}

impl Block {
    pub(super) fn new(index: BlockIndex) -> Self {
        Self {
            index,
            children: [ALL_UNKNOWN; BLOCK_BRICKS],
            changed: 0,
            bricks: BrickList::default(),
            packed: BrickList::default(),
            surface: Vec::new(),
        }
    }

    /// The value of the voxel at an address.
    pub(super) fn value(&self, address: usize, values: Values) -> u8 {
        let voxel = address % BRICK_VOXELS;
        match self.child(address / BRICK_VOXELS, values) {
            Child::Uniform(value) => value,
            Child::Full(place) => self.bricks.bricks[place].0[voxel],
            Child::Packed(place) => self.packed.bricks[place].value(voxel),
        }
    }

    /// Applies the marks of a scan, and clears them. Says whether columns of bricks have changed where none had.
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
                // Most bricks near the vehicle are as free as can be.
                Child::Uniform(value) if value == values.least && marks.hit == 0 => BrickChange {
                    states: false,
                    uniform: false,
                },
                Child::Uniform(value) => {
                    self.children[number] = self.packed.push(number, PackedBrick::filled(value));
                    self.children[number] += FIRST_PACKED;
                    let place = self.packed.bricks.len() - 1;
                    self.apply_packed(number, place, marks, update, values)
                }
                Child::Packed(place) => self.apply_packed(number, place, marks, update, values),
                Child::Full(place) => self.bricks.bricks[place].apply(marks, update, values),
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

    /// What hits in the voxel at an address were like.
    pub(super) fn surface(&self, address: usize) -> Option<&SurfaceVoxel> {
        let found = self
            .surface
            .binary_search_by_key(&(address as u16), |&(at, _)| at);
        found.ok().map(|place| &self.surface[place].1)
    }

    /// The same, to add one; its column of bricks has changed. Says whether it is the first that has.
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

    /// Which voxels of a brick are known and which are occupied.
    pub(super) fn states(&self, number: usize, values: Values) -> BrickStates {
        let all = |is: bool| if is { u64::MAX } else { 0 };
        match self.child(number, values) {
            Child::Uniform(value) => BrickStates {
                known: all(value != UNKNOWN),
                occupied: all(value > EVEN),
            },
            Child::Full(place) => self.bricks.bricks[place].states(),
            Child::Packed(place) => self.packed.bricks[place].states(),
        }
    }

    /// Takes the columns of bricks that have changed, a bit for each, x first.
    pub(super) const fn take_changed(&mut self) -> u16 {
        std::mem::replace(&mut self.changed, 0)
    }

    /// Bricks that are stored, in full and packed.
    pub(super) fn stored(&self) -> (usize, usize) {
        (self.bricks.bricks.len(), self.packed.bricks.len())
    }

    /// Its memory, bytes.
    pub(super) fn bytes(&self) -> usize {
        let surface = self.surface.capacity() * size_of::<(u16, SurfaceVoxel)>();
        size_of::<Self>() + self.bricks.bytes() + self.packed.bytes() + surface
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

    /// Reads of the block itself what [`Block::apply`] needs, for the same reason as [`Block::fetch`].
    #[inline]
    pub(super) fn fetch_header(&self) -> u8 {
        self.children[0] ^ self.packed.numbers.capacity() as u8
    }

    /// Reads one byte of each brick, so that the processor fetches all of them at once and not one after another:
    /// in a large map none is in its caches.
    #[inline]
    fn fetch(&self, numbers: u64) -> u8 {
        let byte = |number: usize| match self.children[number] {
            place @ ..FIRST_PACKED => self.bricks.bricks[usize::from(place)].0[0],
            place @ FIRST_PACKED..ALL_GREATEST => {
                self.packed.bricks[usize::from(place - FIRST_PACKED)].first_value()
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
        let packed = self.packed.bricks[place];
        if let Some((new, change)) = packed.applied(marks, update, values) {
            self.packed.bricks[place] = new;
            return change;
        }
        self.remove_packed(place);
        let mut brick = packed.unpack();
        let change = brick.apply(marks, update, values);
        self.children[number] = self.bricks.push(number, brick);
        change
    }

    /// Stores a brick no longer whose voxels are all alike, if they can change no more in that direction.
    fn prune(&mut self, number: usize, values: Values) {
        let child = self.child(number, values);
        let value = match child {
            Child::Uniform(_) => return,
            Child::Full(place) => self.bricks.bricks[place].0[0],
            Child::Packed(place) => self.packed.bricks[place].first_value(),
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
                if let Some(moved) = self.bricks.remove(place) {
                    self.children[moved] = place as u8;
                }
            }
            Child::Packed(place) => self.remove_packed(place),
        }
        self.children[number] = uniform;
    }

    fn remove_packed(&mut self, place: usize) {
        if let Some(moved) = self.packed.remove(place) {
            self.children[moved] = place as u8 + FIRST_PACKED;
        }
    }
}

impl<T> Default for BrickList<T> {
    fn default() -> Self {
        Self {
            bricks: Vec::new(),
            numbers: Vec::new(),
        }
    }
}

impl<T> BrickList<T> {
    /// Adds a brick; returns its place.
    fn push(&mut self, number: usize, brick: T) -> u8 {
        let place = self.bricks.len();
        if place == self.bricks.capacity() {
            // By a little: doubling would leave a quarter of the memory of a large map unused.
            self.bricks.reserve_exact(GROWTH);
            self.numbers.reserve_exact(GROWTH);
        }
        self.bricks.push(brick);
        self.numbers.push(number as u8);
        place as u8
    }

    /// Removes the brick at a place; returns the number of the brick that is there now.
    fn remove(&mut self, place: usize) -> Option<usize> {
        self.bricks.swap_remove(place);
        self.numbers.swap_remove(place);
        self.numbers.get(place).map(|&moved| moved.into())
    }

    fn bytes(&self) -> usize {
        self.bricks.capacity() * size_of::<T>() + self.numbers.capacity()
    }
}

/// The numbers of the bits that are set.
fn bits(mut set: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let bit = set.trailing_zeros() as usize;
        set &= set.wrapping_sub(1);
        (bit < BLOCK_BRICKS).then_some(bit)
    })
}

/// Bricks for which a shelf gets room at a time.
const GROWTH: usize = 4;
