//! The bodies of messages; see [`crate::wire`] for what precedes them and [`crate::keys`] for where they go.

mod map;
mod operator;
mod refusal;
mod robot;
mod shores;
mod teleop;

pub use map::{
    Digests, DigestsRequest, LayerHead, MapHead, TileBand, TileSummary, TilesReply, TilesRequest,
    View,
};
pub use operator::{Answer, Drive, EStop, LeaseRequest, Reset, Setting};
pub use refusal::Refusal;
pub use robot::{AgeToken, Event, Info, LayerInfo, Pong, Pose, Reason, Status};
pub use shores::{Datum, DockingSite, ShoreClass, ShoreCluster, Shores, ShoresNews, ShoresRequest};
pub use teleop::{
    Arming, Clamp, CommandCounters, EStopStatus, FaultReason, Guard, GuardLimits, LeaseEnd,
    LeaseStatus, RefusedCount, Settings, StopReason, TeleopState, TeleopStatus, Velocity,
};

#[cfg(test)]
mod tests;
