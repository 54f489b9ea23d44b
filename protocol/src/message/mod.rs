//! The bodies of messages; see [`crate::wire`] for what precedes them and [`crate::keys`] for where they go.

mod map;
mod robot;

pub use map::{
    Digests, DigestsRequest, LayerHead, MapHead, TileBand, TileSummary, TilesReply, TilesRequest,
    View,
};
pub use robot::{Event, Info, LayerInfo, Pong, Pose, Reason, Status};

#[cfg(test)]
mod tests;
