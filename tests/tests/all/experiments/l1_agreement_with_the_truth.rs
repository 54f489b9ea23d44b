//! L1 \[LRF\]: in rooms with a horizontal laser, occupied and free cells agree with the truth in at least
//! 99 % of the observed cells away from edges.
//!
//! *Observed* is a cell that is known and decided, free or occupied, in the published map. *Away from edges*
//! is what [`Asked`](super::agreement::Asked) says. The mirror belongs to L2 and scatters light here.

use super::agreement::{Confusion, Truth};
use super::rooms::{SEED, SEEDS, rooms_without_reflections, run, truth_of};

/// Share of cells that must agree.
const AGREEMENT_MIN: f64 = 0.99;
/// Free cells alone. Measured over 20 seeds: 1.
const FREE_AGREEMENT_MIN: f64 = 0.999;
/// Occupied cells alone fall short of 99 %: the document's model lets beams that graze a wall erase it
/// (`docs/experiments.md`). This only keeps what there is. Measured over 20 seeds: 0.942 at the least.
const OCCUPIED_AGREEMENT_MIN: f64 = 0.935;

/// What the map of one seed amounts to.
pub(super) fn confusion(truth: &Truth, seed: u64) -> Confusion {
    let pipeline = run(&rooms_without_reflections(), seed).finish();
    assert_eq!(pipeline.report().scans_mapped, 1159);
    truth.compare(&pipeline.publisher().store())
}

fn check(truth: &Truth, seed: u64) {
    let confusion = confusion(truth, seed);
    println!("seed {seed}\n{confusion}");
    let [all, free, occupied] = [
        (confusion.agreement(), AGREEMENT_MIN),
        (confusion.free_agreement(), FREE_AGREEMENT_MIN),
        (confusion.occupied_agreement(), OCCUPIED_AGREEMENT_MIN),
    ]
    .map(|(share, least)| {
        println!("{share:.5}, at least {least}");
        share >= least
    });
    assert!(all && free && occupied, "seed {seed}:\n{confusion}");
    // Neither kind may pass by being left out, unknown or undecided.
    let (free, occupied) = confusion.compared();
    assert!(free > 25_000 && occupied > 1_100, "{free} {occupied}");
    assert!(confusion.undecided() < 120, "{}", confusion.undecided());
    assert!(confusion.left_out() < 2_500, "{}", confusion.left_out());
}

#[test]
fn occupied_and_free_cells_agree_with_the_truth() {
    check(&truth_of(&rooms_without_reflections()), SEED);
}

#[test]
#[ignore = "20 seeds"]
fn occupied_and_free_cells_agree_with_the_truth_for_20_seeds() {
    let truth = truth_of(&rooms_without_reflections());
    for seed in SEEDS {
        check(&truth, seed);
    }
}
