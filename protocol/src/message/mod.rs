//! The bodies of messages; see [`crate::wire`] for what precedes them and [`crate::keys`] for where they go.

mod map;
mod robot;
mod shores;

pub use map::{
    Digests, DigestsRequest, LayerHead, MapHead, TileBand, TileSummary, TilesReply, TilesRequest,
    View,
};
pub use robot::{Event, Info, LayerInfo, Pong, Pose, Reason, Status};
pub use shores::{Datum, DockingSite, ShoreClass, ShoreCluster, Shores, ShoresNews, ShoresRequest};

#[cfg(test)]
mod tests;
