//! What the bits of a modelled tile mean (SPEC, section 6): each cell is predicted from its neighbours that came before it, and from
//! the same tile at an earlier revision.

use super::range_coder::{BitCoder, Probability};
use crate::layer::{LayerId, UNKNOWN};
use crate::tile::{TILE_CELLS, TILE_SIDE};

type Codes = [u16; TILE_CELLS];

/// Probabilities of one tile, each by its context.
struct Model {
    differs: [Probability; 512],
    vanishes: Probability,
    follows: [Probability; 4],
    is_west: [Probability; 128],
    is_north: [Probability; 32],
    is_unknown: Probability,
    values: Values,
    /// What a cell became whose code in the base had these lowest eight bits, the last time; 0 for none.
    became: [u16; 256],
}

/// How a code is coded that equals no neighbour.
struct Values {
    /// Bit by bit, where few codes occur; else as the difference to a prediction.
    are_few: bool,
    /// By the bits before it.
    bits: [Probability; 256],
    differences: Differences,
}

struct Differences {
    /// Whether it has more bits, by how uneven the neighbours are, and the bits so far.
    longer: [[Probability; 17]; 8],
    /// The two bits after the greatest, by the number of bits.
    next: [[Probability; 3]; 17],
    sign: [Probability; 3],
}

/// Codes all cells of a tile in row order; a decoder fills `cells`.
pub(super) fn code_cells(
    coder: &mut impl BitCoder,
    layer: LayerId,
    cells: &mut Codes,
    base: Option<&Codes>,
) {
    let mut model = Model::new(layer);
    let mut last_known = 0;
    for at in 0..TILE_CELLS {
        let around = Around::of(cells, at);
        let code = match base {
            Some(base) => {
                let changed = Changes::of(cells, base, at);
                model.changed_cell(coder, cells[at], base[at], &changed, &around, last_known)
            }
            None => model.cell(coder, cells[at], &around, last_known),
        };
        cells[at] = code;
        if code != UNKNOWN {
            last_known = code;
        }
    }
}

/// Codes of the cells that came before one: to its west and north (the row of next lower y), …
struct Around {
    west: u16,
    north: u16,
    north_west: u16,
    north_east: u16,
    west_2: u16,
    north_2: u16,
}

impl Around {
    #[inline]
    fn of(cells: &Codes, at: usize) -> Self {
        let (x, y) = (at % TILE_SIDE, at / TILE_SIDE);
        let if_inside = |is_inside: bool, back: usize, otherwise: u16| {
            if is_inside {
                cells[at - back]
            } else {
                otherwise
            }
        };
        let north = if_inside(y > 0, TILE_SIDE, UNKNOWN);
        let west = if_inside(x > 0, 1, north);
        let north = if y > 0 { north } else { west };
        Self {
            west,
            north,
            north_west: if_inside(x > 0 && y > 0, TILE_SIDE + 1, north),
            north_east: if_inside(x + 1 < TILE_SIDE && y > 0, TILE_SIDE - 1, north),
            west_2: if_inside(x > 1, 2, west),
            north_2: if_inside(y > 1, 2 * TILE_SIDE, north),
        }
    }

    /// A code near the neighbours', and how uneven they are.
    fn prediction(&self, last_known: u16) -> (i32, i32) {
        let either =
            |one: u16, other: u16| [one, other, last_known].into_iter().find(|c| *c != UNKNOWN);
        let west = i32::from(either(self.west, self.north).unwrap_or(UNKNOWN));
        let north = i32::from(either(self.north, self.west).unwrap_or(UNKNOWN));
        if self.north_west == UNKNOWN {
            return (i32::midpoint(west, north), (west - north).abs());
        }
        let north_west = i32::from(self.north_west);
        // The median edge predictor of LOCO-I (Weinberger, Seroussi and Sapiro 2000, §III-A).
        let plane = west + north - north_west;
        let prediction = plane.clamp(west.min(north), west.max(north));
        (prediction, (west - north).abs() + (west - north_west).abs())
    }
}

/// What differs from the base, of the cells that came before one.
struct Changes {
    /// West, north, north east, north west, west of west, north of north, each a bit; then whether the base is unknown here, and the
    /// same to the east and to the south.
    context: usize,
    /// By how much the western or northern neighbour changed.
    step: i32,
}

impl Changes {
    #[inline]
    fn of(cells: &Codes, base: &Codes, at: usize) -> Self {
        let (x, y) = (at % TILE_SIDE, at / TILE_SIDE);
        let east_is_inside = x + 1 < TILE_SIDE;
        let step = |is_inside: bool, back: usize| {
            if is_inside {
                i32::from(cells[at - back]) - i32::from(base[at - back])
            } else {
                0
            }
        };
        let steps = [
            step(x > 0, 1),
            step(y > 0, TILE_SIDE),
            step(y > 0 && east_is_inside, TILE_SIDE - 1),
            step(y > 0 && x > 0, TILE_SIDE + 1),
            step(x > 1, 2),
            step(y > 1, 2 * TILE_SIDE),
        ];
        let is_same = |is_inside: bool, on: usize| !is_inside || base[at + on] == base[at];
        let bits = steps.map(|step| step != 0).into_iter().chain([
            base[at] == UNKNOWN,
            is_same(east_is_inside, 1),
            is_same(y + 1 < TILE_SIDE, TILE_SIDE),
        ]);
        Self {
            context: context(bits),
            step: if steps[0] == 0 { steps[1] } else { steps[0] },
        }
    }
}

/// The number whose bits these are, lowest first.
#[inline]
fn context(bits: impl IntoIterator<Item = bool>) -> usize {
    let bits = bits.into_iter().enumerate();
    bits.fold(0, |context, (place, bit)| {
        context | usize::from(bit) << place
    })
}

impl Model {
    fn new(layer: LayerId) -> Self {
        let are_few = match layer {
            LayerId::Occupancy
            | LayerId::Obstacle
            | LayerId::Rigidity
            | LayerId::Shore
            | LayerId::Intra => true,
            LayerId::Elevation | LayerId::Cost | LayerId::Inter | LayerId::Depth => false,
        };
        Self {
            differs: [Probability::EVEN; 512],
            vanishes: Probability::EVEN,
            follows: [Probability::EVEN; 4],
            is_west: [Probability::EVEN; 128],
            is_north: [Probability::EVEN; 32],
            is_unknown: Probability::EVEN,
            values: Values {
                are_few,
                bits: [Probability::EVEN; 256],
                differences: Differences {
                    longer: [[Probability::EVEN; 17]; 8],
                    next: [[Probability::EVEN; 3]; 17],
                    sign: [Probability::EVEN; 3],
                },
            },
            became: [UNKNOWN; 256],
        }
    }

    /// Codes a cell of a tile without a base.
    #[inline]
    fn cell(
        &mut self,
        coder: &mut impl BitCoder,
        code: u16,
        around: &Around,
        last_known: u16,
    ) -> u16 {
        if let Some(code) = self.neighbour(coder, code, around, true) {
            return code;
        }
        let (west, north) = (around.west, around.north);
        if west != UNKNOWN && north != UNKNOWN && coder.bit(&mut self.is_unknown, code == UNKNOWN) {
            return UNKNOWN;
        }
        self.values
            .known(coder, code, around.prediction(last_known), 0)
    }

    /// Codes a cell with the code that it had in the base.
    #[inline]
    fn changed_cell(
        &mut self,
        coder: &mut impl BitCoder,
        code: u16,
        before: u16,
        changes: &Changes,
        around: &Around,
        last_known: u16,
    ) -> u16 {
        if !coder.bit(&mut self.differs[changes.context], code != before) {
            return before;
        }
        if before == UNKNOWN {
            let neighbour = self.neighbour(coder, code, around, false);
            return neighbour.unwrap_or_else(|| {
                self.values
                    .known(coder, code, around.prediction(last_known), 0)
            });
        }
        if coder.bit(&mut self.vanishes, code == UNKNOWN) {
            return UNKNOWN;
        }
        let became = &mut self.became[usize::from(before as u8)];
        if *became != UNKNOWN && !coder.bit(&mut self.follows[changes.context % 4], code != *became)
        {
            return *became;
        }
        let sign = (changes.step.signum() + 1) as usize;
        let prediction = (i32::from(before), changes.step);
        let code = self.values.known(coder, code, prediction, sign);
        *became = code;
        code
    }

    /// Codes whether a cell is like its western or northern neighbour; `None` if it is like neither. With `or_unknown` it may be
    /// unknown.
    #[inline]
    fn neighbour(
        &mut self,
        coder: &mut impl BitCoder,
        code: u16,
        around: &Around,
        or_unknown: bool,
    ) -> Option<u16> {
        let Around {
            west,
            north,
            north_west,
            north_east,
            west_2,
            north_2,
        } = *around;
        let unknown = [west == UNKNOWN, north == UNKNOWN];
        if or_unknown || west != UNKNOWN {
            let like = [
                west == north,
                west == north_west,
                north == north_east,
                west_2 == west,
                north_2 == north,
            ];
            let context = context(like.into_iter().chain(unknown));
            if !coder.bit(&mut self.is_west[context], code != west) {
                return Some(west);
            }
        }
        if north != west && (or_unknown || north != UNKNOWN) {
            let like = [north_west == west, north_west == north, north == north_east];
            let context = context(like.into_iter().chain(unknown));
            if !coder.bit(&mut self.is_north[context], code != north) {
                return Some(north);
            }
        }
        None
    }
}

impl Values {
    /// Codes a code. `prediction`: a code near it, and by how much such predictions are off.
    fn known(
        &mut self,
        coder: &mut impl BitCoder,
        code: u16,
        (prediction, unevenness): (i32, i32),
        sign: usize,
    ) -> u16 {
        if self.are_few {
            let mut path = 1_usize;
            for bit in (0..8).rev() {
                let is_set = coder.bit(&mut self.bits[path], code >> bit & 1 == 1);
                path = path << 1 | usize::from(is_set);
            }
            return u16::from(path as u8);
        }
        let difference = i32::from(code) - prediction;
        let length = 32 - unevenness.unsigned_abs().leading_zeros();
        let length = length.min(7) as usize;
        let difference = self.differences.code(coder, difference, length, sign);
        (prediction + difference) as u16
    }
}

impl Differences {
    /// Codes the sign, and the magnitude, of positive ones and 0 plus 1: the bits below its greatest one, after their number.
    fn code(
        &mut self,
        coder: &mut impl BitCoder,
        difference: i32,
        uneven: usize,
        sign: usize,
    ) -> i32 {
        let is_negative = coder.bit(&mut self.sign[sign], difference < 0);
        let magnitude = if difference < 0 {
            -difference
        } else {
            difference + 1
        };
        let bits = magnitude.max(1).ilog2() as usize;
        let mut length = 0;
        while length < 17 && coder.bit(&mut self.longer[uneven][length], length < bits) {
            length += 1;
        }
        let mut read = 1;
        for place in (0..length).rev() {
            let is_set = magnitude >> place & 1 == 1;
            let is_set = match length - place {
                1 => coder.bit(&mut self.next[length - 1][0], is_set),
                2 => coder.bit(&mut self.next[length - 1][1 + (read & 1)], is_set),
                _ => coder.bit(&mut { Probability::EVEN }, is_set),
            };
            read = read << 1 | usize::from(is_set);
        }
        let read = (read as u32).cast_signed();
        if is_negative { -read } else { read - 1 }
    }
}
