//! What is drawn on the map: the vehicle, where it was, and a measure.

pub(super) mod scale_bar;
pub(super) mod trail;
pub(super) mod vehicle;
