//! Tiles, their codings and digests.

use protocol::layer::LayerId;
use protocol::tile::codec::{Decoder, Encoder};
use protocol::tile::{BootId, TILE_SIDE, Tile, TileCells, TileKey};
use protocol::tile_store::{Applied, LayerGrid, TileStore};
use serde_json::Value;

use super::{hex, json};

fn posts() -> TileCells {
    TileCells::from_fn(|x, y| match (x, y) {
        (48.., _) => 0,
        (x, y) if (x + 3 * y) % 8 == 0 => 2,
        _ => 1,
    })
}

fn plane() -> TileCells {
    let hole = 20..40;
    TileCells::from_fn(|x, y| {
        if hole.contains(&x) && hole.contains(&y) {
            0
        } else {
            30000 + 3 * x as u16 + 7 * y as u16
        }
    })
}

fn noise() -> TileCells {
    let mut state = 1_u32;
    TileCells::from_fn(|_, _| {
        state = state.wrapping_mul(1664525).wrapping_add(1013904223);
        (state >> 16) as u16
    })
}

#[test]
fn bands_are_what_is_encoded_and_decoded() {
    let mut encoder = Encoder::new().unwrap();
    let mut decoder = Decoder::new().unwrap();
    for (name, layer, cells, coding) in [
        ("posts", LayerId::Obstacle, posts(), 1),
        ("plane", LayerId::Elevation, plane(), 2),
    ] {
        let band = hex(&format!("band {name}"));
        assert_eq!(band[..4], [1, 0, 64, coding], "{name}");
        let decoded = decoder.decode(layer, &[&band]).unwrap();
        assert_eq!(decoded.codes(), cells.codes(), "{name}");
        assert_eq!(encoder.encode(&cells), [band], "{name}");
    }
}

#[test]
fn noise_is_two_bands_of_codes() {
    let bands = Encoder::new().unwrap().encode(&noise());
    let lengths: Vec<usize> = bands.iter().map(Vec::len).collect();
    assert_eq!(lengths, [4100, 4100]);
    let beginnings: Vec<u8> = bands.iter().flat_map(|band| band[..4].to_vec()).collect();
    assert_eq!(hex("beginnings noise"), beginnings);
    let hashes: Vec<u8> = bands
        .iter()
        .flat_map(|band| *blake3::hash(band).as_bytes())
        .collect();
    assert_eq!(hex("blake3 noise"), hashes);
}

#[test]
fn a_tile_in_all_three_codings_decodes() {
    let bands = [63, 31, 0].map(|row| hex(&format!("bands plane {row}")));
    let beginnings = bands.each_ref().map(|band| [band[1], band[2], band[3]]);
    assert_eq!(beginnings, [[63, 1, 0], [31, 32, 2], [0, 31, 1]]);
    let decoded = Decoder::new().unwrap().decode(LayerId::Elevation, &bands);
    assert_eq!(decoded.unwrap(), plane());
}

/// The upper left corner of a tile from the numbers in `rows`; unknown elsewhere.
fn corner(rows: &Value) -> TileCells {
    let rows = rows.as_array().unwrap();
    TileCells::from_fn(|x, y| {
        let number = rows.get(y).and_then(|row| row.get(x));
        number.map_or(0, |number| u16::try_from(number.as_u64().unwrap()).unwrap())
    })
}

#[test]
fn symbols_are_those_of_the_codes() {
    let example = json("symbols");
    let codes = corner(&example["codes"]);
    let symbols = corner(&example["symbols"]);
    let rows = 4;
    let words = &symbols.codes()[..rows * TILE_SIDE];
    let low = words.iter().map(|word| *word as u8);
    let high = words.iter().map(|word| (word >> 8) as u8);
    let planes: Vec<u8> = low.chain(high).collect();
    let mut first = vec![1, 0, rows as u8, 2];
    first.extend(zstd::bulk::compress(&planes, 1).unwrap());
    let mut rest = vec![1, rows as u8, 60, 0];
    rest.extend([0; 2 * 60 * TILE_SIDE]);
    let decoded = Decoder::new()
        .unwrap()
        .decode(LayerId::Elevation, &[first, rest])
        .unwrap();
    assert_eq!(decoded.codes(), codes.codes());
}

#[test]
fn tile_digests() {
    for (name, cells) in [
        ("posts", posts()),
        ("plane", plane()),
        ("noise", noise()),
        ("unknown", TileCells::unknown()),
    ] {
        assert_eq!(
            hex(&format!("digest {name}")),
            cells.digest().0,
            "the digest of {name}"
        );
    }
}

#[test]
fn root_digests() {
    let layer = LayerId::Elevation;
    let boot = BootId([7; 16]);
    let mut store = TileStore::new(boot, 1);
    let grid = LayerGrid { layer, cell_m: 0.1 };
    store.set_grid(grid).unwrap();
    let root = |store: &TileStore| store.root_digest(layer).unwrap().0;
    assert_eq!(hex("root empty"), root(&store));

    let tiles = [
        (3, -1, plane()),
        (-2, 5, noise()),
        (0, 0, TileCells::unknown()),
    ];
    for ((tx, ty, cells), revision) in tiles.into_iter().zip(1..) {
        let tile = Tile {
            key: TileKey { layer, tx, ty },
            boot,
            epoch: 0,
            revision,
            stamp_ns: 0,
            digest: cells.digest(),
            cells,
        };
        assert_eq!(store.apply(tile), Ok(Applied::Stored));
    }
    assert_eq!(hex("root digest"), root(&store));
    let hashed = blake3::hash(&hex("root bytes"));
    assert_eq!(*hashed.as_bytes(), root(&store));
}

/// The examples of messages carry the examples of tiles.
#[test]
fn messages_carry_these_tiles() {
    let band = json("TileBand");
    let bytes = |value: &Value| serde_json::from_value::<Vec<u8>>(value.clone()).unwrap();
    assert_eq!(bytes(&band["body"]["rows"]), hex("band posts"));
    assert_eq!(bytes(&band["body"]["digest"]), hex("digest posts"));
    let reply = json("TilesReply");
    assert_eq!(bytes(&reply["body"]["band"]["rows"]), hex("band plane"));
    assert_eq!(bytes(&reply["body"]["band"]["digest"]), hex("digest plane"));
    let digests = &json("Digests")["body"]["tiles"];
    assert_eq!(bytes(&digests[0]["digest"]), hex("digest posts"));
    assert_eq!(bytes(&digests[1]["digest"]), hex("digest unknown"));
    let layers = &json("MapHead")["body"]["layers"];
    assert_eq!(bytes(&layers[0]["root"]), hex("root empty"));

    let layer = LayerId::Obstacle;
    let mut store = TileStore::new(BootId([0; 16]), 1);
    store.set_grid(LayerGrid { layer, cell_m: 0.1 }).unwrap();
    let key = TileKey {
        layer,
        tx: -1,
        ty: 2,
    };
    drop(store.publish(key, posts()).unwrap());
    let root = store.root_digest(layer).unwrap().0;
    assert_eq!(bytes(&layers[1]["root"]), root);
}
