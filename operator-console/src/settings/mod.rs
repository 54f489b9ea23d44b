//! What the console remembers between runs: layout, looks, window, addresses, colours of robots.
//!
//! A settings file is written by this program and may be edited by hand. What is missing in it has its default, what is
//! not known is ignored, and what makes no sense is replaced by its default and said.

mod appearance;
mod file;
mod repeat_filter;
mod robot_colors;
mod writer;

use serde::{Deserialize, Serialize};

pub use appearance::{Appearance, ThemeChoice};
pub use file::{ConfigPath, Read, default_file, read};
pub use robot_colors::RobotColors;
pub use writer::SettingsWriter;

use crate::map_view::ViewSettings;
use crate::workspace::Layout;

/// What is written by this version. A file of a greater one is not touched.
pub const VERSION: u32 = 1;
/// Addresses that are remembered.
pub const MAX_ADDRESSES: usize = 16;

/// Everything that is remembered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    /// Of the format.
    pub version: u32,
    /// Theme and scale.
    pub appearance: Appearance,
    /// Size and place of the window.
    pub window: Option<WindowPlace>,
    /// Where panels are; `None` for where they are at first.
    pub layout: Option<Layout>,
    /// Addresses that were typed, the newest last; control endpoints.
    pub addresses: Vec<String>,
    /// Colours of robots, by name.
    pub robots: RobotColors,
    /// How the map was looked at.
    pub map: Option<ViewSettings>,
    /// Whether the folder of an export is shown when all is in it.
    pub opens_exports: bool,
}

/// Where the window was.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WindowPlace {
    /// Width and height of what is inside its frame, in points of the system.
    pub size: [f32; 2],
    /// Upper left corner of its frame, in points of the system; `None` where the system does not tell.
    #[serde(default)]
    pub corner: Option<[f32; 2]>,
    /// Whether it filled the screen.
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
    /// Remembers an address, the oldest beyond [`MAX_ADDRESSES`] no longer.
    pub fn remember(&mut self, address: &str) {
        self.addresses.retain(|known| known != address);
        self.addresses.push(address.to_owned());
        let surplus = self.addresses.len().saturating_sub(MAX_ADDRESSES);
        self.addresses.drain(..surplus);
    }

    /// Forgets an address.
    pub fn forget(&mut self, address: &str) {
        self.addresses.retain(|known| known != address);
    }

    /// Puts defaults where a file says what makes no sense; what that was, in words.
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
        if self.window.is_some_and(|place| !place.is_valid()) {
            mended.push("the window's place is on no screen".to_owned());
            self.window = None;
        }
        if self
            .layout
            .as_ref()
            .is_some_and(|layout| !layout.is_whole())
        {
            mended.push("the layout lacks panels".to_owned());
            self.layout = None;
        }
        let surplus = self.addresses.len().saturating_sub(MAX_ADDRESSES);
        self.addresses.drain(..surplus);
        self.robots.limit();
        mended
    }
}

impl WindowPlace {
    /// Whether there could be a screen with such a window.
    pub fn is_valid(&self) -> bool {
        let is_size = self
            .size
            .iter()
            .all(|side| (200.0..20_000.0).contains(side));
        let is_corner = |corner: [f32; 2]| corner.iter().all(|at| at.abs() < 20_000.0);
        is_size && self.corner.is_none_or(is_corner)
    }
}

#[cfg(test)]
mod tests;
