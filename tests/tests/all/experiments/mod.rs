//! The experiments of *Mapping using a laser range finder* \[LRF\] in the world `rooms`, against its truth.
//!
//! Ranges are noisy by 1 cm and 0.5 % of beams drop out, as `algorithms.md` §8 asks; its attitude noise does
//! not apply, for the laser is planar and the truth of its pose is given. The normal run takes one seed, the
//! ignored tests twenty.

mod agreement;
mod rooms;

mod l1_agreement_with_the_truth;
mod l2_reflections;

mod erosion;
mod error_map;
mod report;
