//! Settings that are saved between runs: layout, appearance, window, addresses, colours of robots.
//!
//! The file may be edited by hand. Missing keys have defaults, unknown keys are ignored, invalid values are replaced by
//! defaults and reported.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use eframe::egui::{Color32, Context, Theme, ThemePreference};
use protocol::keys::RobotId;
use serde::{Deserialize, Serialize};

use crate::map_view::ViewSettings;
use crate::workspace::Layout;

mod file;

pub use file::{ConfigPath, Read, SettingsWriter, default_file, read};

/// Format version. A file with a greater version is not used.
pub const VERSION: u32 = 1;
pub const MAX_ADDRESSES: usize = 16;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    pub version: u32,
    pub appearance: Appearance,
    pub window: Option<WindowPlace>,
    pub layout: Option<Layout>,
    /// Typed control endpoints, newest last.
    pub addresses: Vec<String>,
    pub robots: RobotColors,
    pub map: Option<ViewSettings>,
    /// Whether to open the folder of a finished export.
    pub opens_exports: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WindowPlace {
    /// Inner size, in the system's points.
    pub size: [f32; 2],
    /// Upper left corner of the frame, in the system's points; `None` if unknown.
    #[serde(default)]
    pub corner: Option<[f32; 2]>,
    #[serde(default)]
    pub is_maximized: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            version: VERSION,
            appearance: Appearance::default(),
            window: None,
            layout: None,
            addresses: Vec::new(),
            robots: RobotColors::default(),
            map: None,
            opens_exports: true,
        }
    }
}

impl Settings {
    /// Adds an address; above [`MAX_ADDRESSES`] the oldest is removed.
    pub fn remember(&mut self, address: &str) {
        self.addresses.retain(|known| known != address);
        self.addresses.push(address.to_owned());
        let surplus = self.addresses.len().saturating_sub(MAX_ADDRESSES);
        self.addresses.drain(..surplus);
    }

    pub fn forget(&mut self, address: &str) {
        self.addresses.retain(|known| known != address);
    }

    /// Replaces invalid values by defaults; returns what was replaced.
    fn repair(&mut self) -> Vec<String> {
        let mut mended = Vec::new();
        if !self.appearance.is_valid() {
            mended.push(format!(
                "the scale of {} % is not between {} % and {} %",
                self.appearance.scale_percent,
                Appearance::SCALES.start(),
                Appearance::SCALES.end()
            ));
            self.appearance.scale_percent = Appearance::default().scale_percent;
        }
        if self.window.take_if(|place| !place.is_valid()).is_some() {
            mended.push("the window's place is on no screen".to_owned());
        }
        if self.layout.take_if(|layout| !layout.is_whole()).is_some() {
            mended.push("the layout lacks panels".to_owned());
        }
        let surplus = self.addresses.len().saturating_sub(MAX_ADDRESSES);
        self.addresses.drain(..surplus);
        self.robots.limit();
        mended
    }
}

impl WindowPlace {
    /// Whether a screen could contain such a window.
    pub fn is_valid(&self) -> bool {
        let mut sides = self.size.iter();
        let is_size = sides.all(|side| (200.0..20_000.0).contains(side));
        let is_corner = |corner: [f32; 2]| corner.iter().all(|at| at.abs() < 20_000.0);
        is_size && self.corner.is_none_or(is_corner)
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ThemeChoice {
    #[default]
    System,
    Dark,
    Light,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Appearance {
    pub theme: ThemeChoice,
    pub scale_percent: u16,
}

impl Default for Appearance {
    fn default() -> Self {
        Self {
            theme: ThemeChoice::System,
            scale_percent: 100,
        }
    }
}

impl ThemeChoice {
    pub const ALL: [Self; 3] = [Self::System, Self::Dark, Self::Light];

    pub const fn label(self) -> &'static str {
        match self {
            Self::System => "As the system",
            Self::Dark => "Dark",
            Self::Light => "Light",
        }
    }

    pub const fn other_than(seen: Theme) -> Self {
        match seen {
            Theme::Dark => Self::Light,
            Theme::Light => Self::Dark,
        }
    }
}

impl Appearance {
    pub const SCALES: RangeInclusive<u16> = 50..=300;
    const STEP: u16 = 10;

    pub fn is_valid(&self) -> bool {
        Self::SCALES.contains(&self.scale_percent)
    }

    #[must_use]
    pub fn scaled(self, is_larger: bool) -> Self {
        let percent = if is_larger {
            self.scale_percent + Self::STEP
        } else {
            self.scale_percent - Self::STEP
        };
        Self {
            scale_percent: percent.clamp(*Self::SCALES.start(), *Self::SCALES.end()),
            ..self
        }
    }

    pub fn apply(&self, ctx: &Context) {
        ctx.set_theme(match self.theme {
            ThemeChoice::System => ThemePreference::System,
            ThemeChoice::Dark => ThemePreference::Dark,
            ThemeChoice::Light => ThemePreference::Light,
        });
        ctx.set_zoom_factor(f32::from(self.scale_percent) / 100.0);
    }
}

/// Okabe and Ito's colours without black, ordered so that neighbours differ most. They are distinct with every kind of
/// colour vision, on light and dark backgrounds. Vermilion comes first, as on maps of recordings; orange, the nearest
/// to it, last.
const SERIES: [(u8, u8, u8); 7] = [
    (0xd5, 0x5e, 0x00),
    (0x00, 0x72, 0xb2),
    (0x00, 0x9e, 0x73),
    (0xcc, 0x79, 0xa7),
    (0x56, 0xb4, 0xe9),
    (0xf0, 0xe4, 0x42),
    (0xe6, 0x9f, 0x00),
];
const MAX_ROBOTS: usize = 256;

#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct RobotColors(BTreeMap<String, u8>);

impl RobotColors {
    /// The robot's colour; a new robot gets the least used one.
    pub fn of(&mut self, robot: &RobotId) -> Color32 {
        let known = self.0.get(robot.as_str()).copied();
        let index = known.unwrap_or_else(|| {
            let uses = |index: &u8| self.0.values().filter(|used| *used == index).count();
            let index = (0..SERIES.len() as u8).min_by_key(uses).unwrap_or(0);
            self.0.insert(robot.as_str().to_owned(), index);
            self.limit();
            index
        });
        let (red, green, blue) = SERIES[usize::from(index) % SERIES.len()];
        Color32::from_rgb(red, green, blue)
    }

    fn limit(&mut self) {
        while self.0.len() > MAX_ROBOTS {
            self.0.pop_first();
        }
    }
}

#[cfg(test)]
mod tests;
