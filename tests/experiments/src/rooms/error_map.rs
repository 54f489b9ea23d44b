//! A map and its errors as a small picture.

use protocol::export::Trinary;
use protocol::tile_store::TileStore;

use super::agreement::{Expected, Truth};
use crate::pictures::{Drawing, Image, Picture};

/// What a pixel shows, as an index into [`COLORS`].
#[derive(Clone, Copy)]
enum Shade {
    Unknown,
    Free,
    Occupied,
    Undecided,
    Ghost,
    Hole,
}

/// Okabe and Ito's vermillion and blue stand out from every grey and from each other.
const COLORS: [[u8; 3]; 6] = [
    [180, 192, 206],
    [255, 255, 255],
    [40, 40, 40],
    [150, 150, 150],
    [213, 94, 0],
    [0, 114, 178],
];
const PIXELS_PER_CELL: usize = 4;
/// The building with a little ground around it, metres.
const CORNERS_M: [[f64; 2]; 2] = [[-3.0, -4.0], [18.4, 12.6]];

/// The published map, errors in colour, north up.
pub(crate) fn picture(truth: &Truth, store: &TileStore, name: &str, caption: &str) -> Picture {
    let cell_m = truth.grid().cell_m();
    let [first, end] = CORNERS_M.map(|corner| corner.map(|m| libm::round(m / cell_m) as i64));
    let [width, height] = [0, 1].map(|axis| (end[axis] - first[axis]) as usize * PIXELS_PER_CELL);
    let mut pixels = vec![Shade::Unknown as u8; width * height];
    for cell in truth.known_cells(store) {
        let shade = match (cell.expected, cell.map) {
            (Expected::Free, Trinary::Occupied) => Shade::Ghost,
            (Expected::Occupied, Trinary::Free) => Shade::Hole,
            (_, Trinary::Free) => Shade::Free,
            (_, Trinary::Occupied) => Shade::Occupied,
            (_, Trinary::Undecided) => Shade::Undecided,
        };
        let [column, row] = [0, 1].map(|axis| usize::try_from(cell.index[axis] - first[axis]).ok());
        let (Some(column), Some(row)) = (column, row) else {
            continue;
        };
        let (left, bottom) = (column * PIXELS_PER_CELL, row * PIXELS_PER_CELL);
        let Some(top) = height.checked_sub(bottom + PIXELS_PER_CELL) else {
            continue;
        };
        for line in pixels
            .chunks_exact_mut(width)
            .skip(top)
            .take(PIXELS_PER_CELL)
        {
            if let Some(part) = line.get_mut(left..left + PIXELS_PER_CELL) {
                part.fill(shade as u8);
            }
        }
    }
    Picture {
        name: name.to_owned(),
        caption: caption.to_owned(),
        image: Image::Drawing(Drawing {
            width: width as u32,
            colors: COLORS.to_vec(),
            pixels,
        }),
    }
}
