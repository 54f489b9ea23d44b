//! Least-squares planes through the tops of columns.

use super::{PATCH_COLUMNS, PATCH_EDGE, Points, Row, WINDOW};
use crate::height_columns::{TILE_COLUMNS, TILE_EDGE};

/// z = a·x + b·y + c.
#[derive(Clone, Copy)]
pub(super) struct Plane {
    a: f32,
    b: f32,
    c: f32,
}

impl Plane {
    /// The least squares plane by sums as those of [`Planes`]; `None` where they are of what lies nearly on one line,
    /// about which a plane could stand at any angle.
    pub(super) fn through([n, x, y, z, xx, xy, yy, xz, yz]: [f32; SUMS]) -> Option<Self> {
        if n < 3.0 {
            return None;
        }
        let mean = [x / n, y / n, z / n];
        let (xx, xy, yy) = (xx - x * mean[0], xy - x * mean[1], yy - y * mean[1]);
        let (xz, yz) = (xz - x * mean[2], yz - y * mean[2]);
        let determinant = xx * yy - xy * xy;
        let is_spread = determinant > MIN_SPREAD * (xx + yy) * (xx + yy);
        is_spread.then(|| {
            let a = (xz * yy - yz * xy) / determinant;
            let b = (yz * xx - xz * xy) / determinant;
            Self {
                a,
                b,
                c: mean[2] - a * mean[0] - b * mean[1],
            }
        })
    }

    /// Rise over run.
    pub(super) fn slope(self) -> f32 {
        libm::sqrtf(self.a * self.a + self.b * self.b)
    }

    /// How much lower it is at most where x and y are both off by one.
    pub(super) fn drop(self) -> f32 {
        self.a.abs() + self.b.abs()
    }

    #[inline]
    pub(super) fn height(self, x: f32, y: f32) -> f32 {
        self.a * x + self.b * y + self.c
    }
}

/// Sums over the windows of the sixteen columns: n, x, y, z, xx, xy, yy, xz, yz.
pub(super) struct Planes([[f32; TILE_COLUMNS]; SUMS]);

/// What a plane is made of, see [`Planes`].
pub(super) const SUMS: usize = 9;
/// Of the spread of points across their main direction, squared, to that along it.
const MIN_SPREAD: f32 = 0.02;

impl Planes {
    /// Through what was hit.
    pub(super) fn of(points: &Points) -> Self {
        let [x, y, z] = &points.top;
        let w = &points.weight;
        let products: [Row; SUMS] = std::array::from_fn(|sum| {
            let mut row = [0.0; PATCH_COLUMNS];
            for n in 0..PATCH_COLUMNS {
                row[n] = w[n]
                    * match sum {
                        0 => 1.0,
                        1 => x[n],
                        2 => y[n],
                        3 => z[n],
                        4 => x[n] * x[n],
                        5 => x[n] * y[n],
                        6 => y[n] * y[n],
                        7 => x[n] * z[n],
                        _ => y[n] * z[n],
                    };
            }
            row
        });
        Self(products.map(|row| window_sums(&row)))
    }

    /// The plane through what was hit around a column.
    pub(super) fn get(&self, column: usize) -> Option<Plane> {
        Plane::through(self.0.map(|sums| sums[column]))
    }
}

/// Sums over the window of each column of the tile.
fn window_sums(row: &Row) -> [f32; TILE_COLUMNS] {
    let mut along = [[0.0; TILE_EDGE]; PATCH_EDGE];
    for (sums, row) in along.iter_mut().zip(row.chunks_exact(PATCH_EDGE)) {
        for step in 0..WINDOW {
            for (x, sum) in sums.iter_mut().enumerate() {
                *sum += row[x + step];
            }
        }
    }
    let mut sums = [0.0; TILE_COLUMNS];
    for (y, sums) in sums.chunks_exact_mut(TILE_EDGE).enumerate() {
        for along in &along[y..y + WINDOW] {
            for (sum, part) in sums.iter_mut().zip(along) {
                *sum += part;
            }
        }
    }
    sums
}
