//! How everything looks.

use std::ops::RangeInclusive;

use eframe::egui::{Context, Theme, ThemePreference};
use serde::{Deserialize, Serialize};

/// Light or dark.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ThemeChoice {
    /// As the system has it.
    #[default]
    System,
    /// For the night.
    Dark,
    /// For the sun.
    Light,
}

/// Theme and scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Appearance {
    /// Light or dark.
    pub theme: ThemeChoice,
    /// How large everything is, percent of what the system says.
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
    /// All of them.
    pub const ALL: [Self; 3] = [Self::System, Self::Dark, Self::Light];

    /// In the menu.
    pub const fn label(self) -> &'static str {
        match self {
            Self::System => "As the system",
            Self::Dark => "Dark",
            Self::Light => "Light",
        }
    }

    /// The other look than the one that is `seen`, whatever was chosen.
    pub const fn other_than(seen: Theme) -> Self {
        match seen {
            Theme::Dark => Self::Light,
            Theme::Light => Self::Dark,
        }
    }
}

impl Appearance {
    /// Scales that can be chosen, percent.
    pub const SCALES: RangeInclusive<u16> = 50..=300;
    /// Between one scale and the next, percent.
    const STEP: u16 = 10;

    /// Whether the scale is one.
    pub fn is_valid(&self) -> bool {
        Self::SCALES.contains(&self.scale_percent)
    }

    /// One step larger, or smaller.
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

    /// Makes the window look so.
    pub fn apply(&self, ctx: &Context) {
        ctx.set_theme(match self.theme {
            ThemeChoice::System => ThemePreference::System,
            ThemeChoice::Dark => ThemePreference::Dark,
            ThemeChoice::Light => ThemePreference::Light,
        });
        ctx.set_zoom_factor(f32::from(self.scale_percent) / 100.0);
    }
}
