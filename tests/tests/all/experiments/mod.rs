//! Every experiment passes: with one seed in the normal run (those that take minutes are ignored), with twenty seeds in
//! the ignored tests. The checks are in `tests/experiments/src/`, the results in
//! `docs/experiments.md`.

use std::sync::atomic::AtomicBool;

use experiments::outcome::Verdict;
use experiments::{EXPERIMENTS, Experiment, Session};

fn passes(id: &str, seeds: u64) {
    let go = AtomicBool::new(false);
    let experiment = Experiment::of_id(id).unwrap();
    let outcome = (experiment.run)(&Session::new(seeds, &go, &|_| ())).unwrap();
    for check in &outcome.checks {
        println!("{id} {check:?}");
    }
    let mut failed = outcome.checks.clone();
    failed.retain(|check| check.verdict == Verdict::Failed);
    assert!(failed.is_empty(), "{id}: {failed:#?}");
    let gates = outcome.checks.iter();
    let gates = gates.filter(|check| check.verdict == Verdict::Passed);
    assert!(gates.count() > 0, "{id} checks nothing");
    let names: std::collections::BTreeSet<_> =
        outcome.pictures().map(|picture| &picture.name).collect();
    assert_eq!(
        names.len(),
        outcome.pictures().count(),
        "two pictures share a name"
    );
    assert!(!names.is_empty(), "{id} has no picture");
}

macro_rules! experiments {
    ($($(#[$slow:meta])? $name:ident: $id:literal),* $(,)?) => {
        /// With seed 1.
        mod one_seed {
            $(#[test]
            $(#[$slow])?
            fn $name() {
                super::passes($id, 1);
            })*
        }

        /// With twenty seeds.
        mod twenty_seeds {
            $(#[test]
            #[ignore = "20 seeds"]
            fn $name() {
                super::passes($id, 20);
            })*
        }

        #[test]
        fn every_experiment_is_listed() {
            assert_eq!(EXPERIMENTS.each_ref().map(|experiment| experiment.id), [$($id),*]);
        }
    };
}

experiments! {
    e1_a_hall_in_cells_of_four_sizes: "E1",
    e2_a_bare_floor_is_the_reference_plane: "E2",
    e3_down_a_ramp_the_ground_plane_is_taken_anew: "E3",
    e4_straight_on_nothing_moves_in_the_map: "E4",
    e5_attitudes_are_compensated: "E5",
    e6_a_turn_drags_no_walls: "E6",
    e7_gentle_slopes_are_ground: "E7",
    e8_grass_is_distinguished_from_obstacles: "E8",
    e9_a_laser_is_turned_to_what_is_unknown: "E9",
    h1_a_time_offset_makes_one_ground_of_two: "H1",
    #[ignore = "minutes"]
    h2_slopes_cost_what_they_are_and_canopies_nothing: "H2",
    #[ignore = "minutes"]
    h3_rocks_and_trunks_stay_lethal_and_grass_and_twigs_give_way: "H3",
    #[ignore = "minutes"]
    h4_shores_are_told_apart: "H4",
    #[ignore = "minutes"]
    h5_a_ramp_is_where_to_dock: "H5",
    h6_a_person_leaves_no_trail: "H6",
    h7_sonar_and_laser_meet_at_the_waterline: "H7",
    #[ignore = "minutes"]
    h8_shores_at_random_have_the_class_of_their_force: "H8",
    l1_occupied_and_free_cells_agree_with_the_truth: "L1",
    l2_what_a_mirror_shows_vanishes_with_further_observations: "L2",
    l3_a_recording_with_motion_capture_is_mapped: "L3",
    #[ignore = "minutes"]
    p1_circles_close_where_odometry_drifts: "P1",
    #[ignore = "minutes"]
    d1_a_bridge_is_passed_below_and_driven_on: "D1",
    #[ignore = "minutes"]
    d2_what_gives_way_in_a_thicket_is_told_by_rings: "D2",
    #[ignore = "minutes"]
    d3_a_jetty_is_no_way_and_a_footbridge_is: "D3",
}
