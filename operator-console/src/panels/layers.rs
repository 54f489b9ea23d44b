//! Which layer is shown, in which colours.

use eframe::egui::{ComboBox, Ui};
use protocol::layer::{LayerId, Palette, Scheme};

use super::wording::count;
use crate::command::Command;
use crate::model::ConsoleModel;

/// What the panel shows.
#[derive(Clone, Debug, PartialEq)]
pub struct LayersData {
    /// What the robot maps.
    pub layers: Vec<LayerId>,
    /// The layer that is shown.
    pub shown: LayerId,
    /// Its colours.
    pub scheme: Scheme,
    /// How much there is of it.
    pub extent: String,
}

impl LayersData {
    /// The layers of `model`, one of which is shown with `palette`.
    pub fn new(model: &ConsoleModel, palette: &Palette) -> Self {
        let shown = palette.layer();
        let layers = model.info().map(|info| info.layers.as_slice());
        let layers = layers.unwrap_or_default().iter().map(|info| info.layer);
        let store = model.map().store();
        let extent = match (store.cell_m(shown), store.tile_count(shown)) {
            (None, _) => "Not described yet".to_owned(),
            (Some(_), 0) => "Nothing mapped yet".to_owned(),
            (Some(cell_m), tiles) => format!(
                "{} {}, cells of {} m",
                count(tiles as u64),
                if tiles == 1 { "tile" } else { "tiles" },
                (cell_m * 1e4).round() / 1e4
            ),
        };
        Self {
            layers: layers.collect(),
            shown,
            scheme: palette.scheme(),
            extent,
        }
    }
}

/// A layer as the operator reads it.
pub const fn layer_name(layer: LayerId) -> &'static str {
    match layer {
        LayerId::Occupancy => "Occupancy",
        LayerId::Elevation => "Elevation",
        LayerId::Obstacle => "Obstacles",
        LayerId::Cost => "Slope cost",
        LayerId::Rigidity => "Rigidity",
        LayerId::Shore => "Shore",
    }
}

/// A scheme as the operator reads it.
pub const fn scheme_name(scheme: Scheme) -> &'static str {
    match scheme {
        Scheme::Grey => "White to black",
        Scheme::MapServer => "As map_server",
        Scheme::Cividis => "Blue to yellow",
        Scheme::GroundPlane => "Ground plane",
        Scheme::Magma => "Light to dark",
        Scheme::OkabeIto => "Colour-blind safe",
        Scheme::GreenRed => "Green and red",
    }
}

/// Draws the panel.
pub fn layers_ui(ui: &mut Ui, data: &LayersData) -> Option<Command> {
    let mut command = None;
    ui.horizontal_wrapped(|ui| {
        for layer in &data.layers {
            let is_shown = *layer == data.shown;
            if ui.selectable_label(is_shown, layer_name(*layer)).clicked() && !is_shown {
                command = Some(Command::ShowLayer(*layer));
            }
        }
    });
    ui.horizontal(|ui| {
        ComboBox::from_label("Colours")
            .selected_text(scheme_name(data.scheme))
            .width(140.0)
            .show_ui(ui, |ui| {
                for scheme in data.shown.schemes() {
                    let is_shown = *scheme == data.scheme;
                    if ui
                        .selectable_label(is_shown, scheme_name(*scheme))
                        .clicked()
                    {
                        command = Some(Command::ShowScheme(*scheme));
                    }
                }
            });
        if data.scheme == Scheme::Cividis {
            let fit = ui.button("Fit");
            if fit
                .on_hover_text("Spread the colours over the heights of the map")
                .clicked()
            {
                command = Some(Command::FitColors);
            }
        }
    });
    ui.label(&data.extent);
    command
}
