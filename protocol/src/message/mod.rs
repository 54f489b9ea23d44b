//! The bodies of messages; see [`crate::wire`] for what precedes them and [`crate::keys`] for where they go.

mod map;
mod operator;
mod recording;
mod refusal;
mod robot;
mod scan;
mod sensors;
mod shores;
mod teleop;
mod trajectory;
mod voxels;

pub use map::{
    Digests, DigestsRequest, LayerHead, MapHead, TileBand, TileSummary, TilesReply, TilesRequest,
    View,
};
pub use operator::{Answer, Drive, EStop, LeaseRequest, Reset, Setting};
pub use recording::{RecordingState, RecordingStatus};
pub use refusal::Refusal;
pub use robot::{AgeToken, DropCount, Event, Info, LayerInfo, Pong, Pose, Severity, Status};
pub use scan::{MAX_SCAN_POINTS, MAX_SCAN_REACH_CM, Scan};
pub use sensors::{
    FieldOfView, MAX_SENSORS, SensorFault, SensorInfo, SensorKind, SensorMount, SensorStatus,
};
pub use shores::{
    Datum, DockingSite, ShoreClass, ShoreCluster, Shores, ShoresReply, ShoresRequest,
};
pub use teleop::{
    Arming, Barrier, BarrierKind, Clamp, CollisionMonitorState, CommandCounters, EStopStatus,
    FaultReason, LeaseEnd, LeaseStatus, RefusedCount, Settings, SpeedLimits, StopReason,
    TeleopState, TeleopStatus, Velocity,
};
pub use trajectory::{MAX_TRAJECTORY_POSES, TrajectoryPart, TrajectoryRequest};
pub use voxels::{MAX_PART_BYTES, VoxelFile, VoxelsPart, VoxelsReply, VoxelsRequest};

#[cfg(test)]
mod tests;
