//! What the operator asks of the program. Panels and map only say what is wanted; the app does it.

use std::collections::BTreeSet;
use std::path::PathBuf;

use protocol::keys::RobotId;

use crate::alerts::Alarm;
use crate::export::ExportPart;
use crate::link::FoundRobot;
use crate::map_view::{LayerCommand, Orientation, Overlay, ShoreMark};
use crate::playback::PlaybackCommand;
use crate::teleop_client::Intent;

/// A wish of the operator.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Show this robot instead of any other.
    Connect(FoundRobot),
    /// Ask this address for robots, too. It is a control endpoint.
    AddAddress(String),
    /// Something about a layer of the map.
    Layer(LayerCommand),
    /// Look elsewhere.
    Look(Look),
    /// Something about driving.
    Drive(Intent),
    /// Show this recording instead of any robot.
    Open(PathBuf),
    /// Something about the recording that is shown.
    Playback(PlaybackCommand),
    /// Ask this address no longer, and remember it no longer.
    ForgetAddress(String),
    /// List this robot no longer, which is silent, and have no alerts of it.
    ForgetRobot(RobotId),
    /// An alert of this robot was seen.
    Acknowledge(RobotId, Alarm),
    /// All alerts were seen, of every robot.
    AcknowledgeAll,
    /// Save a picture of the window where the system keeps pictures.
    Screenshot,
    /// Write maps to files.
    Export(ExportRequest),
    /// Leave the export that is under way.
    CancelExport,
    /// Show a folder in the system's own program for that.
    OpenFolder(PathBuf),
    /// Ask which recording to show.
    AskForRecording,
    /// End the program.
    Quit,
}

/// What to export, and where to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExportRequest {
    /// The folder; it is made where it is missing.
    pub folder: PathBuf,
    /// What to write.
    pub parts: BTreeSet<ExportPart>,
    /// Whether to show the folder when all is in it.
    pub opens_folder: bool,
}

/// How to look at the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Look {
    /// Keep the whole map in sight.
    Whole,
    /// Keep the vehicle in the middle, or no longer.
    Follow(bool),
    /// Put a point of `odom` in the middle, metres.
    At([f64; 2]),
    /// Closer.
    In,
    /// Farther.
    Out,
    /// At what is this far away on the screen, in widths and heights of the view: to the right, and down.
    Beside([f32; 2]),
    /// What is up.
    Up(Orientation),
    /// Draw it over the layers, or do not.
    Draw(Overlay, bool),
    /// Let clicks measure, or end that.
    Measure(bool),
    /// Measure to what is in the middle, or read it.
    Point,
    /// As if the last point had not been pointed at.
    UndoPoint,
    /// Let a shore or docking site stand out, and put its middle (metres in `odom`) in the middle.
    Mark(ShoreMark, [f64; 2]),
    /// Let it stand out, too, while the hand is over it in a list; `None`: it is no longer.
    Hover(Option<ShoreMark>),
}
