//! Overlays: grid, scale bar, compass, vehicle and shores.

pub(super) mod grid;
mod shore_labels;
pub(super) mod shores;
pub(super) mod vehicle;
