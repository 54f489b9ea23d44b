use std::collections::BTreeMap;

use super::disk_blocks::tests::TestFile;
use super::*;
use proptest::prelude::*;

const SENSOR: SensorId = SensorId(0);

fn config() -> OctreeConfig {
    OctreeConfig {
        enabled: true,
        cell_m: 0.1,
        p_min: 0.1192,
        p_max: 0.971,
        memory_limit_mb: 100,
        fine_m: 40.0,
        disk_limit_mb: 0,
    }
}

fn model() -> RangeSensorModel {
    RangeSensorModel {
        p_hit: 0.7,
        p_miss: 0.4,
        ..RangeSensorModel::default()
    }
}

fn octree(threads: usize) -> Octree {
    Octree::new(&config(), &[model()], threads)
}

fn ray(origin: [f64; 3], end: [f64; 3], is_hit: bool) -> Ray {
    Ray {
        origin: origin.into(),
        end: end.into(),
        is_hit,
    }
}

const fn voxel(x: i32, y: i32, z: i32) -> VoxelIndex {
    VoxelIndex { x, y, z }
}

/// Voxels of a segment without its last one, by Amanatides and Woo (1987) in floating point.
fn crossed(from: [f64; 3], to: [f64; 3]) -> Vec<VoxelIndex> {
    let mut at = from.map(|voxels| voxels.floor() as i32);
    let end = to.map(|voxels| voxels.floor() as i32);
    let delta: [f64; 3] = std::array::from_fn(|axis| to[axis] - from[axis]);
    let mut voxels = Vec::new();
    while at != end {
        voxels.push(voxel(at[0], at[1], at[2]));
        let leaves = |axis: usize| {
            let boundary = f64::from(at[axis] + i32::from(delta[axis] > 0.0));
            if at[axis] == end[axis] {
                f64::INFINITY
            } else {
                (boundary - from[axis]) / delta[axis]
            }
        };
        let axis = (0..3)
            .min_by(|&a, &b| leaves(a).total_cmp(&leaves(b)))
            .unwrap();
        at[axis] += if delta[axis] > 0.0 { 1 } else { -1 };
    }
    voxels
}

/// A map without blocks, marks or packing, and with exact log-odds.
#[derive(Default)]
struct Reference(BTreeMap<VoxelIndex, f64>);

impl Reference {
    fn integrate(&mut self, rays: &[Ray], steps: &LogOddsTable) {
        let update = steps.update(&model());
        let inside = |point: &Point3<f64>| [point.x * 10.0, point.y * 10.0, point.z * 10.0];
        let mut scan: BTreeMap<VoxelIndex, bool> = BTreeMap::new();
        for ray in rays {
            for voxel in crossed(inside(&ray.origin), inside(&ray.end)) {
                scan.entry(voxel).or_insert(false);
            }
            if ray.is_hit {
                let [x, y, z] = inside(&ray.end).map(|at| at.floor() as i32);
                scan.insert(voxel(x, y, z), true);
            }
        }
        for (voxel, is_hit) in scan {
            let value = self.0.entry(voxel).or_insert(128.0);
            let change = if is_hit {
                f64::from(update.hit)
            } else {
                -f64::from(update.miss)
            };
            let (least, greatest) = (steps.values.least, steps.values.greatest);
            *value = (*value + change).clamp(least.into(), greatest.into());
        }
    }
}

fn states(octree: &Octree) -> BTreeMap<VoxelIndex, VoxelState> {
    let mut states = BTreeMap::new();
    for block in octree.known_blocks(|least| least) {
        for (brick, voxels) in (0_i32..).zip(block.bricks) {
            for n in (0..64).filter(|n| voxels.known >> n & 1 == 1) {
                let along = |axis: i32| (brick >> (2 * axis) & 3) << 2 | n >> (2 * axis) & 3;
                let least = block.least;
                let at = voxel(least.x + along(0), least.y + along(1), least.z + along(2));
                let state = match voxels.occupied >> n & 1 {
                    0 => VoxelState::Free,
                    _ => VoxelState::Occupied,
                };
                assert_eq!(states.insert(at, state), None, "{at:?} twice");
            }
        }
    }
    states
}

prop_compose! {
    fn point(reach_m: f64)(x in -reach_m..reach_m, y in -reach_m..reach_m, z in -reach_m..reach_m) -> [f64; 3] {
        [x, y, z]
    }
}

prop_compose! {
    /// Scans of few beams from nearly the same position, so that voxels are updated repeatedly.
    fn scans()(
        scans in prop::collection::vec(
            (point(0.2), prop::collection::vec((point(2.5), any::<bool>()), 1..25)), 1..12)
    ) -> Vec<Vec<Ray>> {
        let of_scan = |(origin, beams): ([f64; 3], Vec<([f64; 3], bool)>)| {
            beams.into_iter().map(|(end, is_hit)| ray(origin, end, is_hit)).collect()
        };
        scans.into_iter().map(of_scan).collect()
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn it_is_the_map_that_the_formulas_give(scans in scans()) {
        let mut octree = octree(1);
        let mut reference = Reference::default();
        // Repeated, so that voxels reach their limits and bricks are pruned.
        for scan in scans.iter().cycle().take(scans.len() * 9) {
            octree.integrate(SENSOR, scan.iter().copied());
            reference.integrate(scan, &octree.steps);
        }
        let expected: BTreeMap<_, _> = reference.0.iter().map(|(&voxel, &value)| {
            (voxel, if value > 128.0 { VoxelState::Occupied } else { VoxelState::Free })
        }).collect();
        prop_assert_eq!(states(&octree), expected);
        for (&voxel, &value) in &reference.0 {
            prop_assert_eq!(f64::from(octree.steps.values.least.max(1)) <= value, true);
            let p = octree.probability(voxel).unwrap();
            let wanted = 1.0 / (1.0 + libm::exp(-octree.steps.log_odds(value as u8)));
            prop_assert!((p - wanted).abs() < 1e-12, "{:?}: {} is not {}", voxel, p, wanted);
        }
    }

    #[test]
    fn two_threads_make_the_same_map(scans in scans()) {
        let (mut one, mut two) = (octree(1), octree(2));
        for scan in &scans {
            one.integrate(SENSOR, scan.iter().copied());
            two.integrate(SENSOR, scan.iter().copied());
            prop_assert_eq!(one.take_changed(), two.take_changed());
        }
        prop_assert_eq!(states(&one), states(&two));
        let values = |octree: &Octree| -> Vec<_> {
            states(octree).keys().map(|&voxel| octree.probability(voxel)).collect()
        };
        prop_assert_eq!(values(&one), values(&two));
    }

    #[test]
    fn a_cloud_is_a_scan_of_the_first_beam_to_each_voxel(
        ends in prop::collection::vec((point(0.4), any::<bool>()), 1..200),
    ) {
        let all: Vec<Ray> =
            ends.iter().map(|&(end, is_hit)| ray([2.05, 0.1, 0.3], end, is_hit)).collect();
        let mut first: Vec<Ray> = Vec::new();
        for ray in &all {
            let end = |ray: &Ray| (VoxelIndex::containing(ray.end, 0.1), ray.is_hit);
            if first.iter().all(|other| end(other) != end(ray)) {
                first.push(*ray);
            }
        }
        for threads in [1, 2] {
            let (mut cloud, mut scan) = (octree(threads), octree(1));
            cloud.integrate_cloud(SENSOR, all.iter().copied());
            scan.integrate(SENSOR, first.iter().copied());
            prop_assert_eq!(states(&cloud), states(&scan));
        }
    }

    /// The changed columns hold all changes, and a coarser level agrees with its voxels.
    #[test]
    fn changes_are_complete_and_coarser_levels_agree(scans in scans(), probe in point(2.5)) {
        let mut octree = octree(1);
        let mut known = BTreeMap::new();
        for scan in &scans {
            octree.integrate(SENSOR, scan.iter().copied());
            let changed = octree.take_changed();
            let is_changed = |voxel: &VoxelIndex| {
                changed.contains(&BrickColumn { x: voxel.x >> 2, y: voxel.y >> 2 })
            };
            let now = states(&octree);
            known.retain(|voxel, _| !is_changed(voxel));
            known.extend(now.iter().filter(|(voxel, _)| is_changed(voxel)).map(|(&v, &s)| (v, s)));
            prop_assert_eq!(&known, &now);
        }
        let probe = VoxelIndex::containing(probe.into(), 0.1);
        for level in 0..9 {
            let part = |at: i32| at >> level;
            let inside = known.iter().filter(|(at, _)| {
                part(at.x) == part(probe.x) && part(at.y) == part(probe.y) && part(at.z) == part(probe.z)
            });
            let expected = inside.map(|(_, &state)| state).max().unwrap_or(VoxelState::Unknown);
            prop_assert_eq!(octree.state_at_level(probe, level), expected, "level {}", level);
        }
    }
}

#[test]
fn columns_of_bricks_hold_the_states_of_their_voxels() {
    let mut octree = octree(1);
    octree.integrate(SENSOR, [ray([0.05, 0.05, 2.55], [0.05, 0.05, -2.55], true)]);
    octree.integrate(
        SENSOR,
        [ray([-0.05, 0.35, 2.55], [-0.05, 0.35, 0.15], true)],
    );
    let read =
        |x, from, to| -> Vec<_> { octree.columns(BrickColumn { x, y: 0 }, from, to).collect() };
    let first = read(0, -26, 26);
    let z: Vec<_> = first.iter().map(|layer| layer.z).collect();
    assert_eq!(
        z,
        [-28, -24, -20, -16, -12, -8, -4, 0, 4, 8, 12, 16, 20, 24]
    );
    assert_eq!(
        (first[0].known, first[0].occupied),
        ([0, 0, 1, 1], [0, 0, 1, 0])
    );
    let other = read(-1, 0, 3);
    assert_eq!(other.len(), 1);
    assert_eq!(
        other[0].known,
        [0, 1 << 15, 1 << 15, 1 << 15],
        "the last of its sixteen columns"
    );
    assert_eq!(other[0].occupied, [0, 1 << 15, 0, 0]);
}

#[test]
fn what_saturates_takes_no_memory() {
    let mut octree = octree(1);
    let beams = || {
        (-60..60).flat_map(|y| {
            (-60..60).map(move |z| {
                let (y, z) = (f64::from(y) * 0.05, f64::from(z) * 0.05);
                ray([-4.0, y, z], [4.0, y, z], false)
            })
        })
    };
    octree.integrate(SENSOR, beams());
    let stored = octree.bytes();
    for _ in 0..8 {
        octree.integrate(SENSOR, beams());
    }
    assert!(
        octree.bytes() <= stored,
        "{} after {stored}",
        octree.bytes()
    );
    let bricks: usize = octree.blocks().map(Block::stored).sum();
    assert!(bricks < 20 * 15 * 15 / 3, "{bricks} bricks are left");
    assert_eq!(octree.state(voxel(3, 3, 3)), VoxelState::Free);
}

#[test]
fn memory_limit_makes_the_farthest_bricks_coarse_and_then_removes_them() {
    for fine_m in [20.0, f64::INFINITY] {
        let config = OctreeConfig {
            memory_limit_mb: 1,
            fine_m,
            ..config()
        };
        let mut octree = Octree::new(&config, &[model()], 1);
        let mut limited = LimitedBricks::default();
        let mut before = Vec::new();
        for n in 0..400 {
            let x = f64::from(n) * 0.5;
            let beams = (0..90).map(|beam| {
                let angle = f64::from(beam) * 0.07;
                let along = [
                    6.0 * libm::cos(angle),
                    6.0 * libm::sin(angle),
                    libm::sin(angle),
                ];
                ray([x, 0.0, 0.0], [x + along[0], along[1], along[2]], true)
            });
            octree.integrate(SENSOR, beams);
            if n == 30 {
                before = states(&octree)
                    .into_iter()
                    .filter(|(at, _)| at.x < 100)
                    .collect();
                octree.take_changed();
            }
            let now = octree.enforce_memory_limit(Point3::new(x, 0.0, 0.0));
            limited.coarse += now.coarse;
            limited.removed += now.removed;
            let bytes = octree.block_bytes();
            assert!(bytes < 1_000_000, "{bytes} after {n} scans");
            let all: usize = octree.blocks().map(Block::bytes).sum();
            assert_eq!(bytes, all);
        }
        assert_eq!(octree.state(voxel(1995, 0, 0)), VoxelState::Free);
        assert!(
            octree.take_changed().contains(&BrickColumn { x: 0, y: 0 }),
            "it became coarse or unknown"
        );
        if fine_m.is_finite() {
            assert!(limited.coarse > 1000 && limited.removed == 0, "{limited:?}");
            // No hit is lost, and much of what was free is.
            let is_hit = |state: &VoxelState| *state == VoxelState::Occupied;
            let hits = before.iter().filter(|(_, state)| is_hit(state));
            for (at, _) in hits {
                assert_eq!(octree.state(*at), VoxelState::Occupied, "{at:?}");
            }
            let free = before
                .iter()
                .filter(|(at, _)| octree.state(*at) == VoxelState::Free);
            let free = free.count();
            assert!(free > before.len() / 3, "{free} of {}", before.len());
        } else {
            assert!(limited.coarse == 0 && limited.removed > 1000, "{limited:?}");
            assert_eq!(octree.state(voxel(5, 0, 0)), VoxelState::Unknown);
        }
    }
}

#[test]
fn far_bricks_are_made_coarse_on_request() {
    let mut octree = octree(1);
    let ends = [[1.05, 0.05, 0.05], [30.05, 0.05, 0.05]];
    octree.integrate(SENSOR, ends.map(|end| ray([0.0; 3], end, true)));
    octree.coarsen_beyond(Point3::origin(), 10.0);
    let occupied: Vec<_> = octree.occupied().map(|(at, _)| at).collect();
    assert_eq!(occupied, [voxel(10, 0, 0), voxel(302, 2, 2)]);
    for (at, state) in [
        (voxel(300, 3, 3), VoxelState::Occupied),
        // Few of its brick's voxels were seen.
        (voxel(290, 0, 0), VoxelState::Unknown),
        (voxel(5, 0, 0), VoxelState::Free),
        (voxel(10, 1, 0), VoxelState::Unknown),
    ] {
        assert_eq!(octree.state(at), state, "{at:?}");
    }
}

#[test]
fn out_of_range_beams_are_counted() {
    let mut octree = octree(1);
    let unplaced = octree.integrate(
        SENSOR,
        [
            ray([0.0; 3], [f64::NAN, 0.0, 0.0], true),
            ray([0.0; 3], [1e9, 0.0, 0.0], true),
            ray([1e12, 0.0, 0.0], [1e12, 1.0, 0.0], true),
            ray([0.05; 3], [1.05, 0.05, 0.05], true),
            ray([0.05; 3], [f64::INFINITY, 0.05, 0.05], false),
        ],
    );
    assert_eq!(unplaced, 4);
    assert_eq!(
        octree.counts(),
        VoxelCounts {
            occupied: 1,
            free: 10
        }
    );
    assert_eq!(octree.integrate(SENSOR, []), 0);
}

#[test]
fn far_beams_at_fine_voxels_share_slots_and_nothing_else() {
    let config = OctreeConfig {
        cell_m: 0.02,
        ..config()
    };
    let mut octree = Octree::new(&config, &[model()], 1);
    let beams = [
        [100.01, 0.01, 0.01],
        [-100.01, 50.01, 0.01],
        [0.01, -100.01, 60.01],
    ];
    octree.integrate(SENSOR, beams.map(|end| ray([0.01; 3], end, true)));
    let mut expected = Reference::default();
    // The reference has voxels of 0.1 m.
    let scaled = beams.map(|end| ray([0.05; 3], end.map(|at| at * 5.0), true));
    expected.integrate(&scaled, &octree.steps);
    assert_eq!(octree.counts().occupied, 3);
    let free = octree.counts().free;
    assert!(
        free.abs_diff(expected.0.len() as u64 - 3) <= 2,
        "{free}, {}",
        expected.0.len()
    );
}

#[test]
fn hits_set_the_surface() {
    let mut octree = octree(1);
    let end = [1.03, 0.07, 0.02];
    let hit = SurfaceHit {
        point: end.into(),
        spot_m: 0.0,
        intra: 0.5,
        inter: f32::NAN,
    };
    octree.add_surfaces([hit], [0.3; 2]);
    assert_eq!(
        octree.surface(voxel(10, 0, 0)),
        None,
        "its scan has not been added"
    );
    octree.integrate(SENSOR, [ray([0.0; 3], end, true)]);
    octree.take_changed();
    octree.add_surfaces([hit], [0.3; 2]);
    let surface = octree.surface(voxel(10, 0, 0)).unwrap();
    let mean = surface.mean();
    assert!(
        (mean - nalgebra::Vector3::new(0.3, 0.7, 0.2)).amax() < 2e-3,
        "{mean}"
    );
    assert_eq!((surface.intra(), surface.inter()), (Some(0.5), None));
    let (mut same, mut above) = (octree.clone(), octree.clone());
    let column = BrickColumn { x: 2, y: 0 };
    assert_eq!(octree.take_changed(), [column]);
    assert_eq!(same.take_changed_in(-9..=0), [column]);
    assert_eq!(above.take_changed_in(16..=99), []);
    assert_eq!(octree.occupied().count(), 1);
}

/// Beams and hits of a scan at `x`.
fn look_around(octree: &mut Octree, x: f64) {
    let beams = (0..90).map(|beam| {
        let angle = f64::from(beam) * 0.07;
        let (y, z) = (6.0 * libm::sin(angle), libm::sin(5.0 * angle + x));
        ray([x, 0.0, 0.0], [x + 6.0 * libm::cos(angle), y, z], true)
    });
    let beams: Vec<_> = beams.collect();
    octree.integrate(SENSOR, beams.iter().copied());
    let hits = beams.iter().map(|beam| SurfaceHit {
        point: beam.end,
        spot_m: 0.01,
        intra: 0.5,
        inter: f32::NAN,
    });
    octree.add_surfaces(hits, [0.1; 2]);
}

fn assert_same_around_origin(octree: &Octree, other: &Octree) {
    for n in -60..60 {
        for m in -60..60 {
            let at = voxel(n, m, 3);
            assert_eq!(octree.probability(at), other.probability(at), "{at:?}");
        }
    }
}

#[test]
fn what_goes_to_disk_comes_back_as_it_was() {
    for fine_m in [20.0, f64::INFINITY] {
        let new = |memory_limit_mb, disk_limit_mb| {
            let config = OctreeConfig {
                memory_limit_mb,
                fine_m,
                disk_limit_mb,
                ..config()
            };
            let mut octree = Octree::new(&config, &[model()], 1);
            let file: Arc<dyn BlockFile> = Arc::new(TestFile::default());
            octree.keep_on_disk(&file);
            octree
        };
        let (mut limited, mut little_disk, mut unlimited) = (new(1, 100), new(1, 1), new(100, 0));
        let (mut on_disk, mut lost) = (0, 0);
        // There and back.
        for n in (0..400).chain((0..400).rev()) {
            let x = f64::from(n) * 0.5;
            for octree in [&mut limited, &mut little_disk, &mut unlimited] {
                look_around(octree, x);
            }
            let center = Point3::new(x, 0.0, 0.0);
            let now = limited.enforce_memory_limit(center);
            on_disk += now.on_disk;
            assert_eq!((now.coarse, now.removed, now.disk_failures), (0, 0, 0));
            assert!(limited.block_bytes() < 1_000_000);
            let now = little_disk.enforce_memory_limit(center);
            lost += now.coarse + now.removed;
            if n == 399 {
                let unlimited_now = unlimited.enforce_memory_limit(center);
                assert_eq!(unlimited_now, LimitedBricks::default());
                let mut copy = limited.clone();
                copy.enforce_memory_limit(Point3::origin());
                assert_same_around_origin(&copy, &unlimited);
                for forget in [
                    |octree: &mut Octree| octree.coarsen_beyond(Point3::origin(), 10.0),
                    Octree::forget_disk,
                ] {
                    let mut copy = copy.clone();
                    forget(&mut copy);
                    assert!(states(&copy) != states(&unlimited));
                }
                assert!(states(&limited) == states(&unlimited));
            }
        }
        assert!(on_disk > 10_000 && lost > 1000, "{on_disk} {lost}");
        assert!(states(&limited) == states(&unlimited));
        assert_eq!(limited.counts(), unlimited.counts());
        let surfaces = |octree: &Octree| {
            let mut of_voxels: Vec<_> = octree.occupied().collect();
            of_voxels.sort_by_key(|(at, _)| *at);
            format!("{of_voxels:?}") // NaN equals itself here
        };
        assert!(surfaces(&limited) == surfaces(&unlimited));
        assert_same_around_origin(&limited, &unlimited);
        limited.erase();
        assert_eq!(states(&limited), BTreeMap::new());
    }
}
