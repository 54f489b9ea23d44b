//! How the operator has the map: what settings keep between runs.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use super::layer_stack::LayerStack;

/// What the camera keeps in sight by itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CameraMode {
    /// The whole map, as it grows.
    #[default]
    FitMap,
    /// The vehicle, in the middle.
    FollowVehicle,
    /// Nothing: the operator looks where he wants.
    Free,
}

/// What is up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Orientation {
    /// y of `odom`: north, where the robot knows where on Earth it is.
    #[default]
    NorthUp,
    /// Where the robot heads.
    RobotUp,
}

/// What may be drawn over the layers, or not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Overlay {
    /// Lines at round metres.
    Grid,
    /// Where north is.
    Compass,
    /// The legends of the layers that are drawn.
    Legend,
    /// What the sensors see, and saw last.
    Sensors,
}

impl Orientation {
    /// The other one.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::NorthUp => Self::RobotUp,
            Self::RobotUp => Self::NorthUp,
        }
    }
}

/// The look of the map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ViewSettings {
    /// Kept in sight. Where the operator looked by himself, the whole map the next time.
    pub camera_mode: CameraMode,
    /// What is up.
    pub orientation: Orientation,
    /// What is drawn over the layers.
    pub overlays: BTreeSet<Overlay>,
    /// The layers.
    pub stack: LayerStack,
}

impl ViewSettings {
    /// Whether it is drawn.
    pub fn has(&self, overlay: Overlay) -> bool {
        self.overlays.contains(&overlay)
    }

    /// Draws it from now on, or no longer.
    pub fn draw(&mut self, overlay: Overlay, is_on: bool) {
        if is_on {
            self.overlays.insert(overlay);
        } else {
            self.overlays.remove(&overlay);
        }
    }
}

impl Default for ViewSettings {
    fn default() -> Self {
        Self {
            camera_mode: CameraMode::FitMap,
            orientation: Orientation::NorthUp,
            overlays: [Overlay::Compass, Overlay::Legend, Overlay::Sensors].into(),
            stack: LayerStack::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_kept_as_text_and_what_is_missing_is_as_it_would_be() {
        let look = ViewSettings {
            camera_mode: CameraMode::FollowVehicle,
            orientation: Orientation::RobotUp,
            overlays: [Overlay::Grid].into(),
            ..ViewSettings::default()
        };
        let text = toml::to_string(&look).unwrap();
        assert!(text.contains("orientation = \"robot-up\""), "{text}");
        assert_eq!(toml::from_str::<ViewSettings>(&text).unwrap(), look);
        assert_eq!(
            toml::from_str::<ViewSettings>("").unwrap(),
            ViewSettings::default()
        );
    }
}
