//! Poses from planar scans: scan matching, submaps, loop closure (docs/methods.md, section 0).

mod active_submap;
mod block_solver;
mod last_scan;
pub mod loop_closure;
mod optimizer;
pub mod pose_graph;
pub mod position_fixes;
pub mod relations;
pub mod relocalization;
pub mod scan_points;
pub mod search_grid;
pub mod slam;
pub mod slam_map;
pub mod slam_settings;
pub mod submap;
#[cfg(test)]
pub(crate) mod test_world;
