//! Which panels there are.

use serde::{Deserialize, Serialize};

/// A panel. Kept in settings by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PanelId {
    /// What the vehicle sees.
    Map,
    /// Who is on the network.
    Robots,
    /// The one that is shown.
    Robot,
    /// What of its map is shown, and how.
    Layers,
    /// Shores and docking sites.
    Shores,
    /// Driving it.
    Driving,
    /// How the link does.
    Link,
    /// What it sees with.
    Sensors,
    /// What it writes down.
    Recording,
    /// What happened.
    Events,
    /// What wants somebody's attention.
    Alerts,
    /// What was dropped and refused.
    Losses,
}

impl PanelId {
    /// All of them, in the order of the menu.
    pub const ALL: [Self; 12] = [
        Self::Map,
        Self::Robots,
        Self::Robot,
        Self::Layers,
        Self::Shores,
        Self::Driving,
        Self::Link,
        Self::Sensors,
        Self::Recording,
        Self::Events,
        Self::Alerts,
        Self::Losses,
    ];

    /// On its tab and in the menu.
    pub const fn title(self) -> &'static str {
        match self {
            Self::Map => "Map",
            Self::Robots => "Robots",
            Self::Robot => "Robot",
            Self::Layers => "Layers",
            Self::Shores => "Shores",
            Self::Driving => "Driving",
            Self::Link => "Link",
            Self::Sensors => "Sensors",
            Self::Recording => "Recording",
            Self::Events => "Events",
            Self::Alerts => "Alerts",
            Self::Losses => "Losses",
        }
    }

    /// Whether the operator can do without it.
    pub const fn can_be_closed(self) -> bool {
        !matches!(self, Self::Map)
    }

    /// Whether there is anything to show in it before a robot is chosen.
    pub const fn needs_a_robot(self) -> bool {
        !matches!(self, Self::Map | Self::Robots | Self::Events | Self::Alerts)
    }

    /// Whether it scrolls by itself, and reaches to its edges.
    pub(super) const fn fills_its_place(self) -> bool {
        matches!(self, Self::Map)
    }

    /// Whether nothing of it is under a bar that scrolls it, wherever it is drawn.
    pub(super) const fn leaves_room_for_bars(self) -> bool {
        matches!(self, Self::Shores | Self::Events)
    }
}
