//! Cells → tiles → the store that exports, digests and consoles read.

pub mod cells_to_tiles;
pub mod config;
pub mod publisher;
