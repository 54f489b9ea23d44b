//! Cells → tiles → the store that exports, digests and consoles read.

pub mod announced_map;
pub mod bandwidth_limiter;
pub mod cells_to_tiles;
pub mod keel_depth;
pub mod output_inputs;
pub mod publisher;
pub mod pushed_tiles;
pub mod replies;
pub mod scan_downsampling;
pub mod tile_queue;
pub mod trajectory;
pub mod voxel_snapshots;
