use std::collections::BTreeSet;

use super::*;
use proptest::prelude::*;

const fn at(x: i32, y: i32, z: i32) -> VoxelIndex {
    VoxelIndex { x, y, z }
}

/// Compares every pair.
fn brute_force(voxels: &[VoxelIndex], squared: i64) -> Vec<u32> {
    let mut clusters = vec![u32::MAX; voxels.len()];
    let mut count = 0;
    for seed in 0..voxels.len() {
        if clusters[seed] != u32::MAX {
            continue;
        }
        let mut open = vec![seed];
        clusters[seed] = count;
        while let Some(from) = open.pop() {
            for (to, voxel) in voxels.iter().enumerate() {
                let (a, b) = (voxels[from], *voxel);
                let apart = [a.x - b.x, a.y - b.y, a.z - b.z].map(|d| i64::from(d).pow(2));
                if clusters[to] == u32::MAX && apart.iter().sum::<i64>() <= squared {
                    clusters[to] = count;
                    open.push(to);
                }
            }
        }
        count += 1;
    }
    clusters
}

#[test]
fn just_within_the_tolerance_is_within() {
    // 3 m of 0.3 m: ten voxels, straight or as 6-8-0.
    let voxels = [at(0, 0, 0), at(0, 10, 0), at(6, 18, 0), at(17, 18, 0)];
    assert_eq!(euclidean_clusters(&voxels, 0.3, 3.0), [0, 0, 0, 1]);
    assert_eq!(euclidean_clusters(&voxels, 0.3, 2.99), [0, 1, 2, 3]);
    // 0.7 / 0.1 is 6.999…
    let seven = [at(0, 0, 0), at(0, 0, 7)];
    assert_eq!(euclidean_clusters(&seven, 0.1, 0.7), [0, 0]);
}

#[test]
fn without_tolerance_each_is_alone() {
    let voxels = [at(0, 0, 0), at(0, 0, 1), at(0, 1, 0)];
    for tolerance_m in [0.0, -1.0, 0.29, f64::NAN] {
        assert_eq!(euclidean_clusters(&voxels, 0.3, tolerance_m), [0, 1, 2]);
    }
    assert_eq!(euclidean_clusters(&[], 0.3, 3.0), [0; 0]);
}

#[test]
fn the_edges_of_the_index_are_far_apart() {
    let (least, greatest) = (i32::MIN, i32::MAX);
    let voxels = [
        at(least, least, least),
        at(least, least, least + 10),
        at(greatest, greatest, greatest),
    ];
    assert_eq!(euclidean_clusters(&voxels, 0.3, 3.0), [0, 0, 1]);
    assert_eq!(euclidean_clusters(&voxels, 0.3, 1e300), [0, 0, 1]);
}

proptest! {
    #[test]
    fn clusters_are_those_of_all_pairs(
        voxels in prop::collection::btree_set((-40..40i32, -40..40i32, -12..12i32), 0..150),
        tolerance_m in prop_oneof![Just(3.0), Just(0.3), Just(0.43), 0.3..9.0_f64],
    ) {
        let voxels: Vec<_> = voxels.into_iter().map(|(x, y, z)| at(x, y, z)).collect();
        let squared = (tolerance_m / 0.3 * (tolerance_m / 0.3) + 1e-6) as i64;
        prop_assert_eq!(
            euclidean_clusters(&voxels, 0.3, tolerance_m),
            brute_force(&voxels, squared)
        );
    }
}

/// Dense walls a voxel too far apart, and one link between them.
#[test]
fn one_voxel_links_two_walls() {
    let wall = |x: i32| (0..60).flat_map(move |y| (0..8).map(move |z| at(x, y, z)));
    let mut voxels: BTreeSet<_> = wall(0).chain(wall(11)).collect();
    let clusters = |voxels: &BTreeSet<VoxelIndex>| {
        let voxels: Vec<_> = voxels.iter().copied().collect();
        let clusters = euclidean_clusters(&voxels, 0.3, 3.0);
        clusters.iter().max().map_or(0, |greatest| greatest + 1)
    };
    assert_eq!(clusters(&voxels), 2);
    voxels.insert(at(5, 30, 4));
    assert_eq!(clusters(&voxels), 1);
}
