use proptest::prelude::*;

use super::*;
use crate::collision_monitor::local_environment::LocalEnvironment;
use crate::collision_monitor::tests::{Setup, vehicle};

/// The surroundings of a vehicle.
struct Scene {
    rules: CollisionMonitorRules,
    directions: DirectionTable,
    environment: LocalEnvironment,
}

impl Scene {
    fn new(setup: &Setup) -> Self {
        let rules = setup.rules();
        Self {
            directions: DirectionTable::new(MotionPlane::Turning {
                radius_m: rules.footprint.radius_m(),
            }),
            environment: LocalEnvironment::new(&rules),
            rules,
        }
    }

    /// As the preset `riverwatch`.
    fn boat() -> Self {
        let mut setup = Setup {
            vehicle: vehicle(4.5, 2.44, 3.0),
            ..Setup::default()
        };
        setup.vehicle.max_turn_rate_radps = 0.2;
        setup.monitor.creep_mps = 0.3;
        setup.monitor.margin_m = 1.0;
        setup.monitor.side_margin_m = 0.3;
        setup.teleop.stop_decel_mps2 = 0.5;
        setup.teleop.stop_decel_radps2 = 0.2;
        setup.teleop.is_boat = true;
        Self::new(&setup)
    }

    fn on_land() -> Self {
        Self::new(&Setup::default())
    }

    /// With a wall across its way, metres ahead of its middle.
    fn before_a_wall(mut self, x_m: f64) -> Self {
        self.environment.hits = (-160..=160).map(|n| [x_m, 0.05 * f64::from(n)]).collect();
        self
    }

    fn solver(&self) -> LimitSolver<'_> {
        let context = SpeedLimitContext {
            rules: &self.rules,
            environment: &self.environment,
            is_stale: false,
        };
        LimitSolver::new(context, &self.directions)
    }

    fn sideways(mut self) -> Self {
        self.directions = DirectionTable::new(MotionPlane::Sideways);
        self
    }

    /// Metres per second ahead; and to the left, of the vehicle or of its outermost point.
    fn travel(&self, [first_mps, second_mps]: [f64; 2]) -> AxisSpeeds {
        let plane = self.directions.plane;
        let velocity = match plane {
            MotionPlane::Turning { radius_m } => Velocity::new(first_mps, second_mps / radius_m),
            MotionPlane::Sideways => Velocity {
                lateral_mps: second_mps,
                ..Velocity::new(first_mps, 0.0)
            },
        };
        AxisSpeeds::of(velocity, plane, &self.rules)
    }
}

/// Full speed straight on is asked: how fast it may be while the vehicle goes at most of that and turns so much.
fn ahead_mps(scene: &Scene, turning_mps: f64) -> f64 {
    let requested = scene.travel([f64::INFINITY, 0.0]);
    let mut solver = scene.solver();
    solver.limit_request(requested);
    let ahead_mps = solver.limits().forward_mps;
    solver.limit_change(scene.travel([0.9 * ahead_mps, turning_mps]), requested);
    solver.limits().forward_mps
}

#[test]
fn a_turn_from_noise_hardly_limits_the_speed_ahead() {
    for (scene, ahead) in [
        (Scene::boat().before_a_wall(9.34), 2.458),
        (Scene::on_land().before_a_wall(0.9), 0.875),
    ] {
        let alone_mps = ahead_mps(&scene, 0.0);
        assert!((alone_mps - ahead).abs() < 0.001, "{alone_mps}");
        for noise_mps in [0.0051, -0.0051, 0.01, -0.01] {
            let beside_mps = ahead_mps(&scene, noise_mps);
            assert!(
                (0.99 * alone_mps..alone_mps).contains(&beside_mps),
                "{noise_mps}: {beside_mps} of {alone_mps}"
            );
        }
    }
}

#[test]
fn what_needs_no_limit_beside_a_turn_gets_none() {
    let scene = Scene::on_land();
    let mut solver = scene.solver();
    let requested = scene.travel([0.3, 0.0]);
    solver.limit_request(requested);
    solver.limit_change(scene.travel([0.5, 0.1]), requested);
    let limits = solver.limits();
    // Not what was asked: the vehicle may be asked for more in the next round.
    assert!((limits.forward_mps - 1.0).abs() < 1e-12, "{limits:?}");
}

fn mps() -> impl Strategy<Value = f64> {
    prop_oneof![3 => -2.0..2.0, 1 => -0.02..0.02, 1 => Just(0.0)]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    /// Whatever is left of one part, the vehicle can stop from it beside the other, which it still has.
    #[test]
    fn from_what_is_left_beside_what_is_kept_it_can_stop(
        hits in prop::collection::vec((-3.0..3.0, -3.0..3.0), 0..30),
        (going_mps, turning_mps) in (mps(), mps()),
        (asked_going_mps, asked_turning_mps) in (mps(), mps()),
        (is_boat, is_sideways) in any::<(bool, bool)>(),
    ) {
        let mut scene = if is_boat { Scene::boat() } else { Scene::on_land() };
        if is_sideways {
            scene = scene.sideways();
        }
        let scale = if is_boat { 4.0 } else { 1.0 };
        scene.environment.hits = hits.into_iter().map(|(x, y)| [scale * x, scale * y]).collect();
        let motion = scene.travel([going_mps, turning_mps]);
        let requested = scene.travel([asked_going_mps, asked_turning_mps]);
        let mut solver = scene.solver();
        solver.limit_request(requested);
        let most_mps = solver.most_mps;
        solver.limit_change(motion, requested);
        for (kept, asked_beside, changing) in [
            (motion.first, requested.first, requested.second),
            (motion.second, requested.second, requested.first),
        ] {
            let [before_mps, left_mps] = [most_mps, solver.most_mps]
                .map(|most_mps| changing.speed_mps.min(most_mps[changing.axis as usize]));
            prop_assert!(left_mps <= before_mps);
            let is_slowing = kept.speed_mps > asked_beside.speed_mps.min(most_mps[asked_beside.axis as usize]);
            if is_slowing && kept.speed_mps >= STANDSTILL_MPS && left_mps >= STANDSTILL_MPS {
                let left = AxisSpeed { speed_mps: left_mps, ..changing };
                prop_assert!(solver.can_stop_from(kept, left), "{left:?} of {before_mps} beside {kept:?}");
            }
        }
    }
}

#[test]
fn headings_lie_between_their_axes() {
    let directions = DirectionTable::new(MotionPlane::Turning { radius_m: 0.5 });
    for (axis, along, turn) in [
        (DriveAxis::Forward, 1.0, 0.0),
        (DriveAxis::Left, 0.0, 2.0),
        (DriveAxis::Back, -1.0, 0.0),
        (DriveAxis::Right, 0.0, -2.0),
    ] {
        for beside in DriveAxis::ALL {
            let direction = directions.direction(axis.towards(beside, 0));
            assert_eq!(
                (direction.along, direction.turn_per_m),
                (along, turn),
                "{axis:?}"
            );
        }
    }
    for going in [DriveAxis::Forward, DriveAxis::Back] {
        for turning in [DriveAxis::Left, DriveAxis::Right] {
            for step in 1..STEPS {
                let direction = directions.direction(going.towards(turning, step));
                let again = directions.direction(turning.towards(going, STEPS - step));
                assert_eq!(direction, again);
                assert_eq!(direction.along > 0.0, going == DriveAxis::Forward);
                assert_eq!(direction.turn_per_m > 0.0, turning == DriveAxis::Left);
                let angle = libm::atan2(direction.swing, direction.along.abs()).to_degrees();
                assert!((angle - 15.0 * step as f64).abs() < 1e-9);
            }
        }
    }
}
