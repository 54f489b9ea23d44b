//! Settings of the map view, stored between runs: camera, overlays, and the order and look of the layers.

use std::collections::BTreeSet;

use protocol::layer::{LayerId, Scheme};
use serde::{Deserialize, Serialize};

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
    /// Numbers of shores and letters of docking sites.
    pub has_labels: bool,
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
            has_labels: true,
            stack: LayerStack::default(),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StackLayer {
    pub layer: LayerId,
    pub is_shown: bool,
    pub opacity: f32,
    pub scheme: Scheme,
}

/// Each layer once, lowest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(from = "Vec<StackLayer>", into = "Vec<StackLayer>")]
pub struct LayerStack(Vec<StackLayer>);

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LayerCommand {
    Show(LayerId, bool),
    Only(LayerId),
    Opacity(LayerId, f32),
    Above(LayerId, LayerId),
    Below(LayerId, LayerId),
    Scheme(LayerId, Scheme),
    Fit(LayerId),
    /// Draw numbers of shores and letters of docking sites.
    Labels(bool),
}

const ORDER: [LayerId; LayerId::ALL.len()] = [
    LayerId::Occupancy,
    LayerId::Elevation,
    LayerId::Depth,
    LayerId::Cost,
    LayerId::Obstacle,
    LayerId::Intra,
    LayerId::Inter,
    LayerId::Rigidity,
    LayerId::Shore,
];

impl StackLayer {
    fn new(layer: LayerId) -> Self {
        Self {
            layer,
            // These colour the voxels of the shores and of the slope cost: both at once are not readable.
            is_shown: !matches!(layer, LayerId::Rigidity | LayerId::Intra | LayerId::Inter),
            // Heights are visible through obstacles.
            opacity: if layer == LayerId::Obstacle {
                0.75
            } else {
                1.0
            },
            scheme: layer.schemes()[0],
        }
    }

    fn sanitized(self) -> Self {
        let sound = Self::new(self.layer);
        Self {
            opacity: if self.opacity.is_finite() {
                self.opacity.clamp(0.0, 1.0)
            } else {
                sound.opacity
            },
            scheme: if self.layer.schemes().contains(&self.scheme) {
                self.scheme
            } else {
                sound.scheme
            },
            ..self
        }
    }
}

impl Default for LayerStack {
    fn default() -> Self {
        Self(ORDER.map(StackLayer::new).to_vec())
    }
}

impl From<Vec<StackLayer>> for LayerStack {
    /// Repairs settings of other versions: adds missing layers on top, removes repeated ones, clamps numbers.
    fn from(layers: Vec<StackLayer>) -> Self {
        let mut stack: Vec<StackLayer> = Vec::with_capacity(ORDER.len());
        for layer in layers.into_iter().chain(ORDER.map(StackLayer::new)) {
            if stack.iter().all(|held| held.layer != layer.layer) {
                stack.push(layer.sanitized());
            }
        }
        Self(stack)
    }
}

impl From<LayerStack> for Vec<StackLayer> {
    fn from(stack: LayerStack) -> Self {
        stack.0
    }
}

impl LayerStack {
    pub fn layers(&self) -> &[StackLayer] {
        &self.0
    }

    pub fn get(&self, layer: LayerId) -> StackLayer {
        let held = self.0.iter().find(|held| held.layer == layer);
        held.copied().unwrap_or_else(|| StackLayer::new(layer))
    }

    /// Layers that this robot does not map keep their state for other robots.
    pub fn show_only(&mut self, layer: LayerId, offered: &BTreeSet<LayerId>) {
        for held in &mut self.0 {
            if offered.contains(&held.layer) || held.layer == layer {
                held.is_shown = held.layer == layer;
            }
        }
    }

    /// Applies a command about layers alone: not `Only` and `Fit`, which need the map, nor `Labels`.
    pub fn apply(&mut self, command: LayerCommand) {
        match command {
            LayerCommand::Show(layer, is_shown) => {
                self.change(layer, |held| held.is_shown = is_shown);
            }
            LayerCommand::Opacity(layer, opacity) => self.change(layer, |held| {
                held.opacity = opacity;
                *held = held.sanitized();
            }),
            LayerCommand::Scheme(layer, scheme) => self.change(layer, |held| {
                held.scheme = scheme;
                *held = held.sanitized();
            }),
            LayerCommand::Above(layer, other) => self.put(layer, other, 1),
            LayerCommand::Below(layer, other) => self.put(layer, other, 0),
            LayerCommand::Only(_) | LayerCommand::Fit(_) | LayerCommand::Labels(_) => {}
        }
    }

    fn change(&mut self, layer: LayerId, change: impl FnOnce(&mut StackLayer)) {
        if let Some(held) = self.0.iter_mut().find(|held| held.layer == layer) {
            change(held);
        }
    }

    fn put(&mut self, layer: LayerId, other: LayerId, over: usize) {
        let place = |stack: &[StackLayer], layer| stack.iter().position(|held| held.layer == layer);
        if layer != other
            && let Some(from) = place(&self.0, layer)
        {
            let held = self.0.remove(from);
            let to = place(&self.0, other).map_or(self.0.len(), |at| at + over);
            self.0.insert(to, held);
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

    fn order(stack: &LayerStack) -> Vec<LayerId> {
        stack.layers().iter().map(|held| held.layer).collect()
    }

    #[test]
    fn layers_are_shown_hidden_and_moved() {
        let mut stack = LayerStack::default();
        assert_eq!(order(&stack), ORDER);
        stack.apply(LayerCommand::Show(LayerId::Rigidity, true));
        assert!(stack.get(LayerId::Rigidity).is_shown);
        stack.apply(LayerCommand::Above(LayerId::Elevation, LayerId::Obstacle));
        stack.apply(LayerCommand::Below(LayerId::Shore, LayerId::Occupancy));
        let moved = [
            LayerId::Shore,
            LayerId::Occupancy,
            LayerId::Depth,
            LayerId::Cost,
            LayerId::Obstacle,
            LayerId::Elevation,
            LayerId::Intra,
            LayerId::Inter,
            LayerId::Rigidity,
        ];
        assert_eq!(order(&stack), moved);
        stack.apply(LayerCommand::Above(LayerId::Cost, LayerId::Cost));
        assert_eq!(order(&stack), moved);
        stack.show_only(LayerId::Cost, &LayerId::ALL.into());
        let shown: Vec<_> = stack.layers().iter().filter(|held| held.is_shown).collect();
        assert_eq!(shown, [&stack.get(LayerId::Cost)]);
    }

    #[test]
    fn show_only_keeps_layers_of_other_robots() {
        let mut stack = LayerStack::default();
        let of_a_boat = [LayerId::Occupancy, LayerId::Cost, LayerId::Shore];
        stack.show_only(LayerId::Cost, &of_a_boat.into());
        let shown = stack.layers().iter().filter(|held| held.is_shown);
        let shown: Vec<_> = shown.map(|held| held.layer).collect();
        let expected = [
            LayerId::Elevation,
            LayerId::Depth,
            LayerId::Cost,
            LayerId::Obstacle,
        ];
        assert_eq!(shown, expected);
    }

    #[test]
    fn opacity_and_scheme_stay_in_range() {
        let mut stack = LayerStack::default();
        let layer = LayerId::Elevation;
        for (asked, becomes) in [(0.25, 0.25), (7.0, 1.0), (-1.0, 0.0), (f32::NAN, 1.0)] {
            stack.apply(LayerCommand::Opacity(layer, asked));
            assert_eq!(
                stack.get(layer).opacity.to_bits(),
                f32::to_bits(becomes),
                "{asked}"
            );
        }
        stack.apply(LayerCommand::Scheme(layer, Scheme::GroundPlane));
        assert_eq!(stack.get(layer).scheme, Scheme::GroundPlane);
        stack.apply(LayerCommand::Scheme(layer, Scheme::Magma));
        assert_eq!(
            stack.get(layer).scheme,
            Scheme::Cividis,
            "not of this layer"
        );
    }

    #[test]
    fn stored_stacks_are_repaired() {
        let mut stack = LayerStack::default();
        stack.apply(LayerCommand::Above(LayerId::Occupancy, LayerId::Shore));
        stack.apply(LayerCommand::Opacity(LayerId::Cost, 0.5));
        let text = toml::to_string(&Kept {
            stack: stack.clone(),
        })
        .unwrap();
        assert_eq!(toml::from_str::<Kept>(&text).unwrap().stack, stack);

        let bad = r#"
        [[stack]]
        layer = "cost"
        is_shown = false
        opacity = 40.0
        scheme = "green-red"
        [[stack]]
        layer = "cost"
        is_shown = true
        opacity = 0.1
        scheme = "magma"
    "#;
        let sanitized = toml::from_str::<Kept>(bad).unwrap().stack;
        let cost = sanitized.get(LayerId::Cost);
        assert_eq!(
            (cost.is_shown, cost.opacity, cost.scheme),
            (false, 1.0, Scheme::Magma)
        );
        assert_eq!(order(&sanitized).len(), LayerId::ALL.len());
        assert_eq!(order(&sanitized)[0], LayerId::Cost);
    }

    #[derive(Serialize, Deserialize)]
    struct Kept {
        stack: LayerStack,
    }
}
