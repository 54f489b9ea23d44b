//! Views of an octree: from above, and a section from the side.

use std::collections::BTreeMap;

use nalgebra::Point2;
use protocol::layer::LayerId;

use super::pictures::{Drawing, Image, Picture, elevation, store_of};
use mapping::grid::VoxelIndex;
use mapping::octree::{Octree, VoxelState};

/// The highest occupied voxel of every column that is no higher than `below_m`, by the height of its middle.
pub(super) fn from_above(
    octree: &Octree,
    name: &str,
    caption: &str,
    below_m: f64,
) -> anyhow::Result<Vec<Picture>> {
    let cell_m = octree.cell_m();
    let mut tops: BTreeMap<[i64; 2], f64> = BTreeMap::new();
    for (voxel, _) in octree.occupied() {
        let height_m = voxel.centre(cell_m).z;
        if height_m <= below_m {
            let top = tops.entry([voxel.x.into(), voxel.y.into()]);
            let top = top.or_insert(height_m);
            *top = top.max(height_m);
        }
    }
    let [low, high] = tops.values().fold(
        [f64::INFINITY, f64::NEG_INFINITY],
        |[low, high], &height| [low.min(height), high.max(height)],
    );
    let quantisation = LayerId::Elevation.quantisation();
    let cells = tops
        .into_iter()
        .map(|(cell, height_m)| (cell, quantisation.encode(height_m as f32)));
    let store = store_of(LayerId::Elevation, cell_m, cells)?;
    let palette = elevation().fitted(low as f32, high as f32);
    let picture = Picture::of_layer(&store, palette, None, name, caption)?;
    Ok(picture.into_iter().collect())
}

/// A slice of the octree along x, seen from the right.
#[derive(Clone, Copy)]
pub(super) struct Section {
    /// Least x and z, metres.
    pub(super) from_m: [f64; 2],
    /// Greatest x and z, metres.
    pub(super) to_m: [f64; 2],
    /// Least and greatest y, metres.
    pub(super) across_m: [f64; 2],
}

impl Section {
    /// Occupied where any voxel across the slice is, else free where any is; the true ground in the slice's middle
    /// over it.
    pub(super) fn picture(
        &self,
        octree: &Octree,
        ground_m: &dyn Fn(Point2<f64>) -> Option<f64>,
        name: &str,
        caption: &str,
    ) -> Picture {
        const COLORS: [[u8; 3]; 4] = [
            [180, 192, 206],
            [245, 245, 240],
            [40, 40, 40],
            [0, 114, 178],
        ];
        let cell_m = octree.cell_m();
        let cell = |m: f64| libm::floor(m / cell_m) as i64;
        let mut canvas = Canvas::new(
            self.from_m.map(cell),
            self.to_m.map(cell),
            &COLORS,
            PIXELS_PER_CELL,
        );
        let [right, left] = self.across_m.map(cell);
        for at in canvas.cells() {
            let across = (right..=left).map(|y| VoxelIndex {
                x: at[0] as i32,
                y: y as i32,
                z: at[1] as i32,
            });
            let state = across.map(|voxel| octree.state(voxel)).max();
            canvas.set(
                at,
                match state {
                    None | Some(VoxelState::Unknown) => 0,
                    Some(VoxelState::Free) => 1,
                    Some(VoxelState::Occupied) => 2,
                },
            );
        }
        let middle_m = 0.5 * (self.across_m[0] + self.across_m[1]);
        canvas.line(3, |x_cells| {
            let at = Point2::new(x_cells * cell_m, middle_m);
            ground_m(at).map(|height_m| height_m / cell_m)
        });
        canvas.picture(name, caption)
    }
}

/// Cells in a few colours, the first at the lower left.
pub(super) struct Canvas {
    first: [i64; 2],
    size: [usize; 2],
    colors: Vec<[u8; 3]>,
    pixels: Vec<u8>,
    pixels_per_cell: usize,
}

pub(super) const PIXELS_PER_CELL: usize = 3;

impl Canvas {
    /// From cell `first` to cell `last`, all of the first colour.
    pub(super) fn new(
        first: [i64; 2],
        last: [i64; 2],
        colors: &[[u8; 3]],
        pixels_per_cell: usize,
    ) -> Self {
        let size = [0, 1].map(|axis| usize::try_from(last[axis] - first[axis] + 1).unwrap_or(1));
        let size = size.map(|cells| cells.clamp(1, MAX_CELLS) * pixels_per_cell);
        Self {
            first,
            size,
            colors: colors.to_vec(),
            pixels: vec![0; size[0] * size[1]],
            pixels_per_cell,
        }
    }

    pub(super) fn cells(&self) -> impl Iterator<Item = [i64; 2]> + use<> {
        let first = self.first;
        let size = self.size.map(|n| n / self.pixels_per_cell);
        let size = size.map(|n| i64::try_from(n).unwrap_or(i64::MAX));
        (0..size[1]).flat_map(move |y| (0..size[0]).map(move |x| [first[0] + x, first[1] + y]))
    }

    /// Gives a cell the colour of a number.
    pub(super) fn set(&mut self, cell: [i64; 2], color: u8) {
        let [x, y] = [0, 1].map(|axis| usize::try_from(cell[axis] - self.first[axis]));
        if let (Ok(x), Ok(y)) = (x, y) {
            let side = self.pixels_per_cell;
            for part in 0..side * side {
                self.dot(x * side + part % side, y * side + part / side, color);
            }
        }
    }

    /// A line over the cells: `height` at a place along x, both in cells.
    pub(super) fn line(&mut self, color: u8, height: impl Fn(f64) -> Option<f64>) {
        let per_cell = self.pixels_per_cell as f64;
        for x in 0..self.size[0] {
            let at = self.first[0] as f64 + (x as f64 + 0.5) / per_cell;
            let above = height(at).map(|at| libm::floor((at - self.first[1] as f64) * per_cell));
            if let Some(y) = above.filter(|y| *y >= 0.0) {
                self.dot(x, y as usize, color);
            }
        }
    }

    pub(super) fn picture(self, name: &str, caption: &str) -> Picture {
        Picture {
            name: name.to_owned(),
            caption: caption.to_owned(),
            image: Image::Drawing(Drawing {
                width: self.size[0] as u32,
                colors: self.colors,
                pixels: self.pixels,
            }),
        }
    }

    /// A pixel, from the lower left.
    fn dot(&mut self, x: usize, y: usize, color: u8) {
        let [width, height] = self.size;
        if x < width && y < height {
            self.pixels[(height - 1 - y) * width + x] = color;
        }
    }
}

/// Along an edge.
const MAX_CELLS: usize = 2000;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_canvas_has_its_first_cell_at_the_lower_left() {
        let mut canvas = Canvas::new([-1, 5], [0, 6], &[[0; 3]; 3], 3);
        assert_eq!(canvas.cells().count(), 4);
        canvas.set([-1, 5], 1);
        canvas.set([7, 5], 1);
        canvas.line(2, |x| (x > 0.0).then_some(6.99));
        let Image::Drawing(drawing) = canvas.picture("a", "b").image else {
            panic!("no drawing");
        };
        assert_eq!(drawing.width, 6);
        let rows: Vec<&[u8]> = drawing.pixels.chunks_exact(6).collect();
        assert_eq!(rows[0], [0, 0, 0, 2, 2, 2]);
        assert_eq!(rows[2], [0; 6]);
        assert_eq!(rows[3], [1, 1, 1, 0, 0, 0]);
        assert_eq!(rows[5], [1, 1, 1, 0, 0, 0]);
    }
}
