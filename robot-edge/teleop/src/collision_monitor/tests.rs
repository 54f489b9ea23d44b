//! The guard in worlds of flat walls and pillars, in a loop with the arbiter's motion.

mod barrier;
mod closed_loop;
mod cost;
mod situations;
mod unknown_space;
mod world;
