//! Cells → tiles → the store that exports, digests and consoles read.

pub mod answers;
pub mod budget;
pub mod cells_to_tiles;
pub mod config;
pub mod flow;
pub mod last_scan;
pub mod outbox;
pub mod publisher;
pub mod shores;
pub mod trajectory;
pub mod voxel_snapshots;
