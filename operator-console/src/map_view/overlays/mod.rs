//! What is drawn on the map: grid, vehicle and where it would stop, where it was, what its sensors see, shores
//! by number, docking sites by letter, and measures.

pub(super) mod barrier;
pub(super) mod compass;
pub(super) mod grid;
pub(super) mod ruler;
pub(super) mod scale_bar;
pub(super) mod sensors;
mod shore_labels;
pub(super) mod shores;
pub(super) mod stopping;
pub(super) mod trail;
pub(super) mod vehicle;
