//! What can be asked for by keys.

use protocol::layer::LayerId;

use super::table::binding_of;
use super::words;

/// Something that can be asked for by a key, and mostly from a menu as well.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Action {
    /// Show or hide a layer.
    Layer(LayerId),
    /// Keep the whole map in sight.
    WholeMap,
    /// Keep the vehicle in the middle, or no longer.
    Follow,
    /// North up, or robot up.
    Turn,
    /// A grid over the map, or none.
    Grid,
    /// Legends on the map, or none.
    Legend,
    /// Let clicks measure, or end that.
    Measure,
    /// Measure to the middle of the map, or read what is there.
    Point,
    /// As if the last point had not been pointed at.
    UndoPoint,
    /// Closer.
    ZoomIn,
    /// Farther.
    ZoomOut,
    /// Look at what lies beyond an edge of the map view.
    Pan(Edge),
    /// Show the robot of this number in the list, from 1.
    Robot(u8),
    /// Type the address of a robot.
    TypeAddress,
    /// Ask for the lease, or give it back.
    Lease,
    /// Acknowledge every alert.
    AcknowledgeAll,
    /// Save a picture of the window.
    Screenshot,
    /// Write the maps to files.
    Export,
    /// Open a recording.
    OpenRecording,
    /// Let the recording stand still, or go on.
    PlayOrPause,
    /// Show a second before in the recording.
    StepBack,
    /// Show a second later.
    StepForward,
    /// Show ten seconds before.
    JumpBack,
    /// Show ten seconds later.
    JumpForward,
    /// Play the recording slower.
    Slower,
    /// Play it faster.
    Faster,
    /// Switch on or off that the recording begins anew at its end.
    Loop,
    /// End the program.
    Quit,
    /// Go to the next panel.
    NextPanel,
    /// Go to the panel before.
    PreviousPanel,
    /// Put all panels back where they were at first.
    ResetLayout,
    /// Light where it is dark, dark where it is light.
    ToggleTheme,
    /// Everything larger.
    ScaleUp,
    /// Everything smaller.
    ScaleDown,
    /// Everything as large as the system says.
    ScaleReset,
    /// The list of all keys.
    ShortcutSheet,
    /// Which program this is.
    About,
    /// Close what lies over the window.
    CloseDialog,
}

/// An edge of the map view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Edge {
    /// What is above comes into sight.
    Top,
    /// What is on the left.
    Left,
    /// What is below.
    Bottom,
    /// What is on the right.
    Right,
}

impl Action {
    /// What it does, as menus and the sheet say it.
    pub fn words(self) -> &'static str {
        binding_of(self).map_or("", |binding| binding.words)
    }

    /// Its first key in words, for menus and tooltips; empty where it has none.
    pub fn keys(self) -> String {
        binding_of(self)
            .and_then(|binding| binding.keys.first())
            .map(|keys| words(*keys))
            .unwrap_or_default()
    }

    /// Whether a text field is there afterwards, for what is typed next.
    pub(super) const fn opens_text(self) -> bool {
        matches!(self, Self::TypeAddress | Self::OpenRecording)
    }

    /// Whether it is done again and again while its key is held.
    pub(super) const fn repeats(self) -> bool {
        matches!(
            self,
            Self::Pan(_)
                | Self::ZoomIn
                | Self::ZoomOut
                | Self::StepBack
                | Self::StepForward
                | Self::JumpBack
                | Self::JumpForward
                | Self::NextPanel
                | Self::PreviousPanel
                | Self::ScaleUp
                | Self::ScaleDown
        )
    }
}
