use super::*;
use crate::message::ShoresReply;
use crate::tile::BootId;
use crate::wire::{Header, MAX_MESSAGE_BYTES, encode};

fn cluster(number: u32, voxels: u32) -> ShoreCluster {
    ShoreCluster {
        number,
        class: ShoreClass::Dense,
        voxels,
        rigid_voxels: voxels / 2,
        center_m: [1.0, 2.0],
        outline: convex_outline([(0, 0)]),
    }
}

fn site(width_m: f32) -> DockingSite {
    DockingSite {
        center_m: [3.0, 4.0],
        heading_rad: 0.5,
        width_m,
        mean_cost: 0.2,
    }
}

#[test]
fn smallest_shores_and_last_sites_are_omitted_and_counted() {
    // The higher the number the smaller, except one.
    let mut clusters: Vec<_> = (1..=403u32)
        .rev()
        .map(|number| cluster(number, 1_000 - number))
        .collect();
    clusters[1].voxels = 5_000;
    let sites: Vec<_> = (0..102u8).map(|n| site(f32::from(n))).collect();
    let shores = Shores::gather(0.3, None, clusters, sites.clone());
    assert_eq!((shores.clusters_left_out, shores.sites_left_out), (3, 2));
    let numbers: Vec<u32> = shores
        .clusters
        .iter()
        .map(|cluster| cluster.number)
        .collect();
    let expected: Vec<u32> = (1..=399).chain([402]).collect();
    assert_eq!(numbers, expected);
    assert_eq!(shores.sites, sites[..100]);
    assert!(shores.is_valid());

    let few = Shores::gather(0.3, None, vec![cluster(9, 4), cluster(2, 8)], Vec::new());
    assert_eq!(few.clusters, [cluster(2, 8), cluster(9, 4)]);
    assert_eq!((few.clusters_left_out, few.sites_left_out), (0, 0));
}

#[test]
fn largest_message_fits() {
    let cluster = |number| ShoreCluster {
        number,
        voxels: u32::MAX,
        rigid_voxels: u32::MAX,
        outline: vec![(i32::MIN, i32::MAX); MAX_CORNERS],
        ..cluster(1, 1)
    };
    let datum = Datum {
        latitude_deg: 90.0,
        longitude_deg: -180.0,
        altitude_m: 100_000.0,
    };
    let clusters = (0..1_000).map(|n| cluster(u32::MAX - n)).collect();
    let mut shores = Shores::gather(0.3, Some(datum), clusters, vec![site(1.0); 1_000]);
    (shores.clusters_left_out, shores.sites_left_out) = (u32::MAX, u32::MAX);
    assert!(shores.is_valid());
    let header = Header {
        boot: BootId([0; 16]),
        seq: 0,
        robot_time_ns: 0,
    };
    let news = ShoresReply {
        revision: u64::MAX,
        shores: Some(shores),
    };
    let bytes = encode(&header, &news).unwrap();
    assert_eq!((bytes.len(), MAX_MESSAGE_BYTES), (60_091, 65_536));
}

#[test]
fn what_is_out_of_bounds_is_not_valid() {
    let good = Shores::gather(
        0.3,
        None,
        vec![cluster(1, 4), cluster(2, 4)],
        vec![site(1.0)],
    );
    assert!(good.is_valid() && Shores::default().is_valid());
    let spoil = |how: fn(&mut Shores)| {
        let mut shores = good.clone();
        how(&mut shores);
        shores.is_valid()
    };
    assert!(!spoil(|shores| shores.clusters[0].rigid_voxels = 5));
    assert!(!spoil(|shores| shores.clusters[1].center_m[1] = f32::NAN));
    assert!(!spoil(|shores| shores.clusters[1].number = 1));
    assert!(!spoil(
        |shores| shores.clusters[0].outline = vec![(0, 0); 13]
    ));
    assert!(!spoil(|shores| shores.sites[0].heading_rad = f32::INFINITY));
    assert!(!spoil(|shores| shores.sites = vec![site(1.0); 101]));
    assert!(!spoil(|shores| shores.cell_m = f64::NAN));
    let datum = |latitude_deg, altitude_m| {
        let datum = Datum {
            latitude_deg,
            longitude_deg: 0.0,
            altitude_m,
        };
        let shores = Shores {
            datum: Some(datum),
            ..good.clone()
        };
        shores.is_valid()
    };
    assert!(datum(-90.0, 0.0) && !datum(90.1, 0.0) && !datum(0.0, f64::NAN));
}

#[test]
fn classes_are_those_of_the_layer() {
    let names = [ShoreClass::Sparse, ShoreClass::Dense, ShoreClass::Solid].map(ShoreClass::name);
    assert_eq!(names, ["sparse", "dense", "solid"]);
    let site = LayerId::Shore.classes()[usize::from(DOCKING_SITE_CODE) - 1];
    assert_eq!(site.name, "docking site");
    let shore = cluster(1, 9);
    assert!((shore.ratio() - 4.0 / 9.0).abs() < 1e-12);
    assert!(cluster(1, 0).ratio().abs() < 1e-12);
}
