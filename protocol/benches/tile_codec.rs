//! Time and size of the tile codec on typical tiles.
//!
//! `cargo bench -p protocol --bench tile_codec`

#![expect(
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "a bench reports on standard output and stops where it cannot start"
)]

use divan::Bencher;
use protocol::layer::LayerId;
use protocol::tile::TileCells;
use protocol::tile::codec;

/// A kind of tile.
#[derive(Clone, Copy, Debug)]
enum Kind {
    /// Rooms: saturated free space with changing cells, thin walls.
    Occupancy,
    /// Smooth terrain with 2 cm of noise.
    NoisyTerrain,
    /// The rooms as classes.
    Obstacle,
    /// A noisy slope cost.
    Cost,
    /// All unknown.
    Empty,
    /// Random bits, the largest possible.
    Random,
}

const KINDS: [Kind; 6] = [
    Kind::Occupancy,
    Kind::NoisyTerrain,
    Kind::Obstacle,
    Kind::Cost,
    Kind::Empty,
    Kind::Random,
];

fn main() {
    for kind in KINDS {
        let (layer, cells) = tile(kind);
        let bytes: usize = codec::encode(layer, &cells).iter().map(Vec::len).sum();
        let known = 100 * cells.known() / 4096;
        let factor = 4.0 * 4096.0 / bytes as f64;
        println!("{kind:?}: {known} % known, {bytes} bytes, 1/{factor:.1} of 4 bytes a cell");
    }
    divan::main();
}

#[divan::bench(args = KINDS)]
fn encode(bencher: Bencher<'_, '_>, kind: Kind) {
    let (layer, cells) = tile(kind);
    bencher.bench_local(|| codec::encode(layer, divan::black_box(&cells)));
}

#[divan::bench(args = KINDS)]
fn decode(bencher: Bencher<'_, '_>, kind: Kind) {
    let (layer, cells) = tile(kind);
    let bands = codec::encode(layer, &cells);
    bencher.bench_local(|| codec::decode(layer, divan::black_box(&bands), None).unwrap());
}

#[divan::bench]
fn digest(bencher: Bencher<'_, '_>) {
    let (_, cells) = tile(Kind::NoisyTerrain);
    bencher.bench_local(|| divan::black_box(&cells).digest());
}

/// A typical tile of its kind, about 30 % of it unknown.
fn tile(kind: Kind) -> (LayerId, TileCells) {
    let layer = match kind {
        Kind::Occupancy => LayerId::Occupancy,
        Kind::Obstacle => LayerId::Obstacle,
        Kind::Cost => LayerId::Cost,
        Kind::NoisyTerrain | Kind::Empty | Kind::Random => LayerId::Elevation,
    };
    let mut noise = Noise(0x9e3779b97f4a7c15);
    let shadows: [(f64, f64, f64); 12] = std::array::from_fn(|_| {
        let radius = 4.0 + 6.0 * noise.uniform();
        (64.0 * noise.uniform(), 64.0 * noise.uniform(), radius)
    });
    let cells = TileCells::from_fn(|x, y| {
        let hidden = shadows.iter().any(|(shadow_x, shadow_y, radius)| {
            let (dx, dy) = (x as f64 - shadow_x, y as f64 - shadow_y);
            dx * dx + dy * dy < radius * radius
        });
        let wall = x == 12 || y == 50 || (x == 40 && !(20..28).contains(&y));
        let unsettled = noise.uniform() < 0.06;
        let value = match kind {
            Kind::Occupancy if wall => 0.98,
            Kind::Occupancy if unsettled => 0.02 + 0.4 * noise.uniform(),
            Kind::Occupancy => 0.02,
            Kind::Obstacle => f64::from(i8::from(wall) * 2 - 1),
            Kind::Cost => 0.4 + 0.3 * hills(x, y) + 0.05 * noise.normal(),
            Kind::NoisyTerrain => 0.3 * hills(x, y) + 0.02 * noise.normal(),
            Kind::Random => 300.0 * (noise.uniform() - 0.5),
            Kind::Empty => f64::NAN,
        };
        let value = if hidden && !matches!(kind, Kind::Random) {
            f64::NAN
        } else {
            value
        };
        layer.quantisation().encode(value as f32)
    });
    (layer, cells)
}

/// A smooth surface between −1 and 1, of parabolas.
fn hills(x: usize, y: usize) -> f64 {
    let arch = |i: usize| {
        let t = (i % 40) as f64 / 20.0 - 1.0;
        1.0 - t * t
    };
    arch(x + y / 3) - arch(y + 11)
}

/// xorshift64*, so that the tiles are the same everywhere.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545f4914f6cdd1d)
    }

    fn uniform(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Standard normal to a few per cent: the sum of twelve uniforms.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}
