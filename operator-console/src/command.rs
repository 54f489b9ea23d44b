//! Commands of the operator. Panels and map return them; the app executes them.

use std::collections::BTreeSet;
use std::path::PathBuf;

use protocol::keys::RobotId;

use crate::alerts::Alarm;
use crate::export::ExportPart;
use crate::link::FoundRobot;
use crate::map_view::{LayerCommand, Orientation, Overlay, PosePurpose, ShoreMark};
use crate::playback::PlaybackCommand;
use crate::teleop_client::Intent;

#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    Connect(FoundRobot),
    AddAddress(String),
    Layer(LayerCommand),
    Look(Look),
    Drive(Intent),
    Open(PathBuf),
    Playback(PlaybackCommand),
    ForgetAddress(String),
    /// Remove a silent robot from the list, with its alerts.
    ForgetRobot(RobotId),
    Acknowledge(RobotId, Alarm),
    AcknowledgeAll,
    Screenshot,
    Export(ExportRequest),
    CancelExport,
    OpenFolder(PathBuf),
    AskForRecording,
    Quit,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExportRequest {
    pub folder: PathBuf,
    pub parts: BTreeSet<ExportPart>,
    pub opens_folder: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Look {
    Whole,
    Follow(bool),
    /// Centre a point of `odom`, metres.
    At([f64; 2]),
    In,
    Out,
    /// Move by shares of the view's width and height: right and down.
    Beside([f32; 2]),
    Up(Orientation),
    Draw(Overlay, bool),
    Measure(bool),
    /// Draw a pose: where the vehicle is in the saved map, or its goal.
    SetPose(Option<PosePurpose>),
    Point,
    UndoPoint,
    /// Highlight a shore or docking site and centre it (metres in `odom`).
    Mark(ShoreMark, [f64; 2]),
    Hover(Option<ShoreMark>),
}
