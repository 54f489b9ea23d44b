//! Time and size of the tile codec on tiles as mapping makes them.
//!
//! `cargo bench -p protocol --bench tile_codec`

use divan::Bencher;
use protocol::layer::LayerId;
use protocol::tile::TileCells;
use protocol::tile::codec::{Decoder, Encoder};

/// The kinds of tile, by the layer and terrain they stand for.
const KINDS: [&str; 6] = [
    "occupancy",
    "noisy_terrain",
    "obstacle",
    "cost",
    "empty",
    "random",
];

fn main() {
    println!("bytes a tile (64×64 cells; 4 bytes a cell are 16384):");
    let mut encoder = encoder();
    for kind in KINDS {
        let bytes: usize = encoder.encode(&tile(kind).1).iter().map(Vec::len).sum();
        println!("  {kind:14} {bytes:5}  1/{:.0}", 16384.0 / bytes as f64);
    }
    divan::main();
}

#[divan::bench(args = KINDS)]
fn encode(bencher: Bencher<'_, '_>, kind: &str) {
    let (_, cells) = tile(kind);
    let mut encoder = encoder();
    bencher.bench_local(|| encoder.encode(divan::black_box(&cells)));
}

#[divan::bench(args = KINDS)]
fn decode(bencher: Bencher<'_, '_>, kind: &str) {
    let (layer, cells) = tile(kind);
    let bands = encoder().encode(&cells);
    let Ok(mut decoder) = Decoder::new() else {
        return;
    };
    bencher.bench_local(|| decoder.decode(layer, divan::black_box(&bands)));
}

#[divan::bench]
fn digest(bencher: Bencher<'_, '_>) {
    let (_, cells) = tile("noisy_terrain");
    bencher.bench_local(|| divan::black_box(&cells).digest());
}

fn encoder() -> Encoder {
    match Encoder::new() {
        Ok(encoder) => encoder,
        Err(error) => {
            eprintln!("zstd: {error}");
            std::process::exit(1);
        }
    }
}

/// A typical tile: rooms with ragged view shadows, or smooth terrain with 2 cm of noise and 30 % unknown.
fn tile(kind: &str) -> (LayerId, TileCells) {
    let mut noise = Noise(0x9e3779b97f4a7c15);
    let blobs: Vec<(f64, f64, f64)> = (0..14)
        .map(|_| {
            (
                64.0 * noise.uniform(),
                64.0 * noise.uniform(),
                4.0 + 6.0 * noise.uniform(),
            )
        })
        .collect();
    let hidden = |x: usize, y: usize| {
        let near = |&(bx, by, radius): &(f64, f64, f64)| {
            (x as f64 - bx).powi(2) + (y as f64 - by).powi(2) < radius * radius
        };
        blobs.iter().any(near)
    };
    let wall = |x: usize, y: usize| x == 12 || y == 50 || (x == 40 && !(20..28).contains(&y));
    let mut cells = TileCells::unknown();
    let layer = match kind {
        "occupancy" => LayerId::Occupancy,
        "obstacle" => LayerId::Obstacle,
        "cost" => LayerId::Cost,
        _ => LayerId::Elevation,
    };
    for y in 0..64 {
        for x in 0..64 {
            let smooth = 0.3 * libm_free_wave(x, y);
            let height_m = smooth + 0.02 * noise.normal();
            let seen = noise.uniform();
            let value = match kind {
                "occupancy" if wall(x, y) => 0.98,
                "occupancy" if seen < 0.06 => 0.02 + 0.4 * noise.uniform(),
                "occupancy" => 0.02,
                "obstacle" => f64::from(i8::from(wall(x, y)) * 2 - 1),
                "cost" => (0.4 + smooth + 0.05 * noise.normal()).clamp(0.0, 1.0),
                "empty" => f64::NAN,
                _ => height_m,
            };
            cells.codes_mut()[y * 64 + x] = match kind {
                "random" => (noise.next() >> 32) as u16,
                _ if hidden(x, y) => 0,
                _ => layer.quantisation().encode(value as f32),
            };
        }
    }
    (layer, cells)
}

/// A smooth bump map between −1 and 1 from parabolas.
fn libm_free_wave(x: usize, y: usize) -> f64 {
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
