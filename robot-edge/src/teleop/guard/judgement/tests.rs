use proptest::prelude::*;

use super::*;
use crate::config::VehicleConfig;
use crate::mapping::elevation_config::ObstacleConfig;
use crate::teleop::config::TeleopConfig;
use crate::teleop::guard::GuardConfig;
use crate::teleop::guard::config::GuardRules;
use crate::teleop::guard::surroundings::Surroundings;

/// What is known, and whose.
struct Scene {
    rules: GuardRules,
    compass: Compass,
    around: Surroundings,
}

impl Scene {
    fn new(guard: &GuardConfig, teleop: &TeleopConfig, vehicle: &VehicleConfig) -> Self {
        let rules = GuardRules::new(guard, teleop, vehicle, &ObstacleConfig::default()).unwrap();
        Self {
            compass: Compass::new(rules.footprint.radius_m()),
            around: Surroundings::new(&rules),
            rules,
        }
    }

    /// As the preset `riverwatch`.
    fn boat() -> Self {
        let guard = GuardConfig {
            creep_mps: 0.3,
            margin_m: 1.0,
            side_margin_m: 0.3,
            ..GuardConfig::default()
        };
        let teleop = TeleopConfig {
            stop_decel_mps2: 0.5,
            stop_decel_radps2: 0.2,
            is_boat: true,
            ..TeleopConfig::default()
        };
        Self::new(&guard, &teleop, &vehicle([4.5, 2.44], [3.0, 0.2]))
    }

    /// A robot of 0.8 × 0.6 m, at most 1 m/s and 1 rad/s.
    fn on_land() -> Self {
        let (guard, teleop) = (GuardConfig::default(), TeleopConfig::default());
        Self::new(&guard, &teleop, &vehicle([0.8, 0.6], [1.0, 1.0]))
    }

    /// With a wall across its way, metres ahead of its middle.
    fn before_a_wall(mut self, x_m: f64) -> Self {
        self.around.hits = (-160..=160).map(|n| [x_m, 0.05 * f64::from(n)]).collect();
        self
    }

    fn judgement(&self) -> Judgement<'_> {
        let outlook = Outlook {
            rules: &self.rules,
            around: &self.around,
            is_stale: false,
        };
        Judgement::new(outlook, &self.compass)
    }

    /// Metres per second ahead and of the outermost point to the left.
    fn travel(&self, [going_mps, turning_mps]: [f64; 2]) -> Travel {
        let velocity = Velocity {
            linear_mps: going_mps,
            angular_radps: turning_mps / self.rules.footprint.radius_m(),
        };
        Travel::of(velocity, &self.rules)
    }
}

fn vehicle([length_m, width_m]: [f64; 2], [speed_mps, turn_radps]: [f64; 2]) -> VehicleConfig {
    VehicleConfig {
        length_m,
        width_m,
        max_speed_mps: speed_mps,
        max_turn_rate_radps: turn_radps,
        ..VehicleConfig::default()
    }
}

/// Full speed straight on is asked: how fast it may be while the vehicle goes at most of that and turns so much.
fn ahead_mps(scene: &Scene, turning_mps: f64) -> f64 {
    let asked = scene.travel([f64::INFINITY, 0.0]);
    let mut judgement = scene.judgement();
    judgement.judge_request(asked);
    let ahead_mps = judgement.limits().forward_mps;
    judgement.judge_change(scene.travel([0.9 * ahead_mps, turning_mps]), asked);
    judgement.limits().forward_mps
}

#[test]
fn a_turn_that_is_only_noise_takes_next_to_nothing_of_the_speed_ahead() {
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
    let mut judgement = scene.judgement();
    let asked = scene.travel([0.3, 0.0]);
    judgement.judge_request(asked);
    judgement.judge_change(scene.travel([0.5, 0.1]), asked);
    let limits = judgement.limits();
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
        is_boat in any::<bool>(),
    ) {
        let mut scene = if is_boat { Scene::boat() } else { Scene::on_land() };
        let scale = if is_boat { 4.0 } else { 1.0 };
        scene.around.hits = hits.into_iter().map(|(x, y)| [scale * x, scale * y]).collect();
        let motion = scene.travel([going_mps, turning_mps]);
        let asked = scene.travel([asked_going_mps, asked_turning_mps]);
        let mut judgement = scene.judgement();
        judgement.judge_request(asked);
        let most_mps = judgement.most_mps;
        judgement.judge_change(motion, asked);
        for (kept, asked_beside, changing) in [
            (motion.going, asked.going, asked.turning),
            (motion.turning, asked.turning, asked.going),
        ] {
            let [before_mps, left_mps] = [most_mps, judgement.most_mps]
                .map(|most_mps| changing.speed_mps.min(most_mps[changing.axis as usize]));
            prop_assert!(left_mps <= before_mps);
            let is_slowing = kept.speed_mps > asked_beside.speed_mps.min(most_mps[asked_beside.axis as usize]);
            if is_slowing && kept.speed_mps >= STANDING_MPS && left_mps >= STANDING_MPS {
                let left = Part { speed_mps: left_mps, ..changing };
                prop_assert!(judgement.can_stop_from(kept, left), "{left:?} of {before_mps} beside {kept:?}");
            }
        }
    }
}
