//! Settings of the map view, stored between runs.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use super::layer_stack::LayerStack;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CameraMode {
    #[default]
    FitMap,
    FollowVehicle,
    Free,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Orientation {
    /// y of `odom`, which is north if the robot knows it.
    #[default]
    NorthUp,
    RobotUp,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Overlay {
    Grid,
    Compass,
    Legend,
    Sensors,
}

impl Orientation {
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::NorthUp => Self::RobotUp,
            Self::RobotUp => Self::NorthUp,
        }
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ViewSettings {
    pub camera_mode: CameraMode,
    pub orientation: Orientation,
    pub overlays: BTreeSet<Overlay>,
    pub stack: LayerStack,
}

impl ViewSettings {
    pub fn has(&self, overlay: Overlay) -> bool {
        self.overlays.contains(&overlay)
    }

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
    fn settings_round_trip_with_defaults() {
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
