//! What is drawn on the map: the vehicle, where it was, shores by number, docking sites, and a measure.

pub(super) mod scale_bar;
pub(super) mod shores;
pub(super) mod trail;
pub(super) mod vehicle;
