use proptest::prelude::*;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::*;
use crate::layer::LayerId;
use crate::tile::{BootId, TileDigest};
use crate::tile_store::RootDigest;
use crate::wire::{Header, decode, encode};

const HEADER: Header = Header {
    boot: BootId([1; 16]),
    seq: 0,
    robot_time_ns: 0,
};
/// Bytes of a header.
const BEHIND_HEADER: usize = 2 + 16 + 8 + 8;

/// Round trip, every cut refused, and the bytes of the body.
fn body<T>(message: &T) -> Vec<u8>
where
    T: Serialize + DeserializeOwned + PartialEq + std::fmt::Debug,
{
    let bytes = encode(&HEADER, message).unwrap();
    let (header, read) = decode::<T>(&bytes).unwrap();
    assert_eq!((header, &read), (HEADER, message));
    for length in 0..bytes.len() {
        assert!(
            decode::<T>(&bytes[..length]).is_err(),
            "{message:?} cut at {length}"
        );
    }
    bytes[BEHIND_HEADER..].to_vec()
}

fn band() -> TileBand {
    TileBand {
        epoch: 2,
        revision: 300,
        digest: TileDigest([9; 32]),
        rows: vec![1, 0, 64, 1, 7],
    }
}

#[test]
fn bodies_are_the_documented_bytes() {
    let digest = [9; 32];
    let mut expected = vec![2, 0xAC, 0x02];
    expected.extend(digest);
    expected.extend([5, 1, 0, 64, 1, 7]);
    assert_eq!(body(&band()), expected);

    let layer = LayerHead {
        layer: LayerId::Obstacle,
        epoch: 1,
        head_revision: 7,
        tiles: 3,
        root: RootDigest(digest),
    };
    let mut expected = vec![1, 2, 1, 7, 3];
    expected.extend(digest);
    assert_eq!(
        body(&MapHead {
            layers: vec![layer]
        }),
        expected
    );

    assert_eq!(body(&TilesRequest::NewerThan(300)), [0, 0xAC, 0x02]);
    // Tile numbers are zigzag varints: −1 is 1, 2 is 4.
    assert_eq!(body(&TilesRequest::These(vec![(-1, 2)])), [1, 1, 1, 4]);
    assert_eq!(body(&DigestsRequest { newer_than: 0 }), [0]);
    assert_eq!(body(&ShoresRequest { newer_than: 300 }), [0xAC, 0x02]);
    let nothing_newer = ShoresNews {
        revision: 9,
        shores: None,
    };
    assert_eq!(body(&nothing_newer), [9, 0]);
    let cluster = ShoreCluster {
        number: 7,
        class: ShoreClass::Solid,
        voxels: 300,
        rigid_voxels: 299,
        center_m: [1.0, -2.0],
        outline: vec![(-1, 2)],
    };
    let mut expected = vec![7, 2, 0xAC, 0x02, 0xAB, 0x02];
    expected.extend([0, 0, 0x80, 0x3F, 0, 0, 0, 0xC0, 1, 1, 4]);
    assert_eq!(body(&cluster), expected);
    assert_eq!(body(&Pong), [0; 0]);
}

#[test]
fn every_message_survives_the_wire() {
    let summary = TileSummary {
        tx: -4,
        ty: 5,
        revision: 9,
        digest: TileDigest([3; 32]),
    };
    body(&TilesReply {
        tx: i32::MIN,
        ty: i32::MAX,
        band: band(),
        following: 4,
    });
    body(&Digests {
        epoch: 0,
        head_revision: 9,
        tiles: vec![summary; 3],
        more: 0,
    });
    body(&Pose {
        position_m: [1.0, -2.0, 0.5],
        quaternion_xyzw: [0.0, 0.0, 0.6, 0.8],
        speed_mps: -0.5,
        turn_rate_radps: 0.25,
    });
    body(&Event {
        kind: "jump".to_owned(),
        message: "odometry jumped by 5 m".to_owned(),
    });
    body(&Status {
        drops: vec![Reason {
            name: "pose_gap".to_owned(),
            count: 3,
        }],
        tiles: [5, 600],
        has_ended: true,
        ..Status::default()
    });
    body(&Info {
        vehicle: "pioneer".to_owned(),
        source: "rooms".to_owned(),
        footprint_m: [0.455, 0.381],
        limits: [1.2, 5.24],
        layers: vec![LayerInfo {
            layer: LayerId::Occupancy,
            cell_m: 0.1,
        }],
    });
    body(&ShoresNews {
        revision: 3,
        shores: Some(Shores {
            cell_m: 0.3,
            datum: Some(Datum {
                latitude_deg: 38.5,
                longitude_deg: -9.1,
                altitude_m: 50.0,
            }),
            clusters: Vec::new(),
            clusters_left_out: 1,
            sites: vec![DockingSite {
                center_m: [1.0, 2.0],
                heading_rad: 3.0,
                width_m: 4.0,
                mean_cost: 0.25,
            }],
            sites_left_out: 2,
        }),
    });
    let view = View {
        rectangle_m: [-1e6, -1e6, 1e6, 1e6],
        layers: u32::MAX,
        revision: u64::MAX,
        is_in_step: true,
    };
    assert!(BEHIND_HEADER + body(&view).len() <= 256);
}

proptest! {
    #[test]
    fn no_bytes_panic_or_ask_for_memory(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let mut message = encode(&HEADER, &()).unwrap();
        message.extend(bytes);
        drop(decode::<MapHead>(&message));
        drop(decode::<TilesReply>(&message));
        drop(decode::<TilesRequest>(&message));
        drop(decode::<Digests>(&message));
        drop(decode::<Info>(&message));
        drop(decode::<Status>(&message));
        drop(decode::<Event>(&message));
        drop(decode::<View>(&message));
        drop(decode::<ShoresNews>(&message));
    }
}
