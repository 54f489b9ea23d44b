//! Tiles, their codings and digests.

use protocol::layer::LayerId;
use protocol::tile::codec::{decode, encode, encode_differences};
use protocol::tile::{BootId, Tile, TileCells, TileKey};
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

/// *plane* with a part that was raised, and a part that became known.
fn raised() -> TileCells {
    let part = 10..30;
    let plane = plane();
    TileCells::from_fn(|x, y| {
        let code = plane.get(x, y).unwrap();
        if part.contains(&x) && part.contains(&y) && (code != 0 || x < 25) {
            code.max(30000) + 2
        } else {
            code
        }
    })
}

#[test]
fn bands_are_what_is_encoded_and_decoded() {
    for (name, layer, cells, base) in [
        ("posts", LayerId::Obstacle, posts(), None),
        ("plane", LayerId::Elevation, plane(), None),
        ("raised", LayerId::Elevation, raised(), Some(plane())),
    ] {
        let band = hex(&format!("band {name}"));
        assert_eq!(
            band[..4],
            [2, 0, 64, 1 + u8::from(base.is_some())],
            "{name}"
        );
        let decoded = decode(layer, &[&band], base.as_ref()).unwrap();
        assert_eq!(decoded.codes(), cells.codes(), "{name}");
        let encoded = match base {
            Some(base) => encode_differences(layer, &cells, &base).unwrap(),
            None => encode(layer, &cells).remove(0),
        };
        assert_eq!(encoded, band, "{name}");
    }
}

#[test]
fn noise_is_two_bands_of_codes() {
    let bands = encode(LayerId::Elevation, &noise());
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
            check: cells.digest().check(),
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
    let bytes = |value: &Value| serde_json::from_value::<Vec<u8>>(value.clone()).unwrap();
    let changes = json("Changes");
    let changed = &changes["body"]["tiles"][0]["band"];
    assert_eq!(bytes(&changed["rows"]), hex("band raised"));
    assert_eq!(bytes(&changed["check"]), raised().digest().check().0);
    let reply = json("TilesReply");
    assert_eq!(bytes(&reply["body"]["band"]["rows"]), hex("band plane"));
    assert_eq!(
        bytes(&reply["body"]["band"]["check"]),
        hex("digest plane")[..8]
    );
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
