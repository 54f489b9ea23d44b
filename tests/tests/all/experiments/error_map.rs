//! A map and its errors as a small picture.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use png::{BitDepth, ColorType, Encoder};
use protocol::export::Trinary;
use protocol::tile_store::TileStore;

use super::agreement::{Asked, Truth};

/// What a pixel shows, as an index into [`PALETTE`].
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
const PALETTE: [[u8; 3]; 6] = [
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

/// Writes a picture of the published map, errors in colour, north up.
pub(super) fn write(path: &Path, truth: &Truth, store: &TileStore) {
    let cell_m = truth.grid().cell_m();
    let [first, end] = CORNERS_M.map(|corner| corner.map(|m| libm::round(m / cell_m) as i64));
    let [width, height] = [0, 1].map(|axis| (end[axis] - first[axis]) as usize * PIXELS_PER_CELL);
    let mut pixels = vec![Shade::Unknown as u8; width * height];
    for cell in truth.known_cells(store) {
        let shade = match (cell.asked, cell.map) {
            (Asked::Free, Trinary::Occupied) => Shade::Ghost,
            (Asked::Occupied, Trinary::Free) => Shade::Hole,
            (_, Trinary::Free) => Shade::Free,
            (_, Trinary::Occupied) => Shade::Occupied,
            (_, Trinary::Undecided) => Shade::Undecided,
        };
        let [column, row] = [0, 1].map(|axis| {
            let offset = usize::try_from(cell.index[axis] - first[axis]).unwrap();
            offset * PIXELS_PER_CELL
        });
        let top = height - row - PIXELS_PER_CELL;
        for line in pixels
            .chunks_exact_mut(width)
            .skip(top)
            .take(PIXELS_PER_CELL)
        {
            line[column..][..PIXELS_PER_CELL].fill(shade as u8);
        }
    }
    let file = BufWriter::new(File::create(path).unwrap());
    let mut encoder = Encoder::new(file, width as u32, height as u32);
    encoder.set_color(ColorType::Indexed);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_palette(PALETTE.concat());
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&pixels).unwrap();
    writer.finish().unwrap();
}
