//! A vehicle pushes into the vegetation of the docking site that its driver has chosen, and into nothing else.

use super::*;
use protocol::message::{BarrierKind, DockingChoice, ShoreClass};

const CHOICE: DockingChoice = DockingChoice {
    site: 3,
    vegetation: ShoreClass::Dense,
};
const AHEAD: Velocity = Velocity::new(1.0, 0.0);

/// Middles of cells, one beyond the wall's ends.
fn canes() -> impl Iterator<Item = Point2<f64>> {
    let canes = (0..20).flat_map(|x| (-11..11).map(move |y| (x, y)));
    canes.map(|(x, y)| Point2::new(0.45 + 0.1 * f64::from(x), 0.05 + 0.1 * f64::from(y)))
}

/// A wall of canes 5 cm ahead of the front, mapped as a site 2 m wide, and more walls.
fn scene(mut walls: Walls, docking: Option<DockingChoice>) -> Scene {
    walls.push(wall([0.45, -1.0], [0.45, 1.0]));
    let mut scene = Scene::new(Setup::default(), Laser::ALL_DIRECTIONS, &walls);
    let pose = planar(0.0, 0.0, 0.0);
    let mut map = scene.setup.map(&walls, &pose, (START, SCAN_PERIOD));
    map.set_passable(CHOICE, canes());
    scene.map = Some(map);
    scene.docking = docking;
    scene
}

fn kind(scene: &Scene) -> Option<BarrierKind> {
    scene.monitor.barrier().map(|barrier| barrier.kind)
}

#[test]
fn only_the_chosen_site_of_this_class_is_entered_and_slowly() {
    let mut free = scene(vec![], Some(CHOICE));
    let limits = free.limits(AHEAD);
    assert!((limits.forward_mps - CREEP_MPS).abs() < 1e-9, "{limits:?}");
    assert!(!limits.in_unknown_space, "{limits:?}");
    assert_eq!(kind(&free), Some(BarrierKind::Vegetation));

    let without = scene(vec![], None).limits(AHEAD).forward_mps;
    assert!(without < 1e-9, "it stops 0.1 m before them: {without}");
    for docking in [
        DockingChoice { site: 2, ..CHOICE },
        DockingChoice {
            vegetation: ShoreClass::Sparse,
            ..CHOICE
        },
    ] {
        let mut other = scene(vec![], Some(docking));
        assert!(
            (other.limits(AHEAD).forward_mps - without).abs() < 1e-9,
            "{docking:?}"
        );
        assert_eq!(kind(&other), Some(BarrierKind::Detected));
    }

    // A driver who chose Dense may enter what is Sparse now.
    let mut lighter = scene(vec![], Some(CHOICE));
    let mut map = lighter.map.take().unwrap();
    let sparse = DockingChoice {
        vegetation: ShoreClass::Sparse,
        ..CHOICE
    };
    map.set_passable(sparse, canes());
    lighter.map = Some(map);
    assert!((lighter.limits(AHEAD).forward_mps - CREEP_MPS).abs() < 1e-9);
}

/// In the canes, with the front 0.2 m behind their edge.
fn in_the_canes(walls: Walls, docking: Option<DockingChoice>) -> Scene {
    let mut scene = scene(walls.clone(), docking);
    let pose = planar(0.5, 0.0, 0.0);
    let odometry = scene.odometry.as_mut().unwrap();
    odometry.odom_from_base = pose;
    let mut ahead = walls;
    ahead.push(wall([1.0, -1.0], [1.0, 1.0]));
    let scan = Laser::AHEAD.scan(&ahead, &pose);
    scene.obstacle_scans = vec![scene.setup.obstacle_scan(&scan, START)];
    scene
}

#[test]
fn it_creeps_through_and_stops_for_everything_else() {
    let forward_mps = |mut scene: Scene| (scene.limits(AHEAD).forward_mps, kind(&scene));
    let (through_mps, barrier) = forward_mps(in_the_canes(vec![], Some(CHOICE)));
    assert!((through_mps - CREEP_MPS).abs() < 1e-9, "{through_mps}");
    assert_eq!(barrier, Some(BarrierKind::Vegetation));
    assert!(
        forward_mps(in_the_canes(vec![], None)).0 < 1e-9,
        "not chosen"
    );

    let rock = pillar([1.0, 1.15], 0.1);
    let beside = in_the_canes(rock, Some(CHOICE)).limits(AHEAD);
    assert!((beside.forward_mps - CREEP_MPS).abs() < 1e-9, "{beside:?}");
    let mut behind = in_the_canes(vec![], Some(CHOICE));
    let mut map = behind.map.take().unwrap();
    map.set_passable(CHOICE, [Point2::new(0.95, 0.0)]);
    behind.map = Some(map);
    assert!(forward_mps(behind).0 < 1e-9, "hits outside of the site");

    let mut stale = in_the_canes(vec![], Some(CHOICE));
    stale.map = Some({
        let mut map = stale.map.take().unwrap();
        map.set_measured_at(Monotonic::from_nanos(1));
        map
    });
    assert!(
        forward_mps(stale).0 < 1e-9,
        "a map that is no longer renewed"
    );

    let mut touched = in_the_canes(vec![], Some(CHOICE));
    let contact = RegisteredScan {
        sensor: SensorId(1),
        kind: ScanKind::Contact { width_m: 0.6 },
        beams: vec![RegisteredBeam {
            origin_in_odom: Point3::new(0.9, 0.0, 0.3),
            end_in_odom: Point3::new(0.9, 0.0, 0.3),
            outcome: BeamOutcome::Hit,
            index: 0,
            range_m: 0.0,
        }],
        ..Laser::AHEAD.scan(&vec![], &planar(0.5, 0.0, 0.0))
    };
    let contact = touched.setup.obstacle_scan(&contact, START);
    touched.obstacle_scans.push(contact);
    assert_eq!(forward_mps(touched), (0.0, Some(BarrierKind::Contact)));
}
