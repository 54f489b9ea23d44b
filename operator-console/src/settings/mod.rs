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

/// Okabe and Ito's colours without black, and without the two that warn on the map: vermilion (obstacles) and orange
/// (collision monitor). They are distinct with every kind of colour vision, on light and dark backgrounds. Blue comes
/// first, as on maps of recordings.
const SERIES: [(u8, u8, u8); 5] = [
    (0x00, 0x72, 0xb2),
    (0x00, 0x9e, 0x73),
    (0xcc, 0x79, 0xa7),
    (0x56, 0xb4, 0xe9),
    (0xf0, 0xe4, 0x42),
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
mod tests {
    use std::fs;
    use std::path::Path;
    use std::thread::sleep;
    use std::time::Duration;

    use network::clock;

    use super::*;
    use crate::workspace::{PanelId, Workspace};

    fn some() -> Settings {
        let mut workspace = Workspace::default();
        workspace.set_wanted(PanelId::Losses, false);
        let mut settings = Settings {
            appearance: Appearance {
                theme: ThemeChoice::Dark,
                scale_percent: 150,
            },
            window: Some(WindowPlace {
                size: [900.0, 600.0],
                corner: Some([10.0, 20.0]),
                is_maximized: false,
            }),
            layout: Some(workspace.layout()),
            opens_exports: false,
            ..Settings::default()
        };
        settings.remember("tcp/10.0.0.5:7447");
        settings.robots.of(&"scout".parse().unwrap());
        settings
    }

    fn read_both(path: &Path) -> (Settings, Option<String>) {
        let read = read(path);
        (read.settings, read.complaint)
    }

    fn files(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn settings_are_read_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/console.json");
        assert_eq!(read(&path), Read::default(), "a first run");
        file::write(&path, &some()).unwrap();
        let read_back = read(&path);
        assert_eq!(read_back.complaint, None);
        assert_eq!(read_back.settings, some());
        assert_eq!(files(path.parent().unwrap()), ["console.json"]);
    }

    #[test]
    fn missing_keys_have_defaults_unknown_are_ignored() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("console.json");
        fs::write(
            &path,
            r#"{"version": 1, "sound": "loud", "appearance": {"theme": "light"}}"#,
        )
        .unwrap();
        let (settings, complaint) = read_both(&path);
        assert_eq!(complaint, None);
        let expected = Appearance {
            theme: ThemeChoice::Light,
            scale_percent: 100,
        };
        assert_eq!(settings.appearance, expected);
        assert_eq!(settings.layout, None);
        assert!(settings.opens_exports);
    }

    #[test]
    fn damaged_or_newer_file_is_renamed_with_reason() {
        for (text, says) in [
            (r#"{"version": 1, "appea"#, "EOF"),
            (r#"{"version": 9}"#, "newer version"),
            (r#"{"version": 1, "appearance": {"theme": "pink"}}"#, "pink"),
            ("{}", "does not say its version"),
            ("", "EOF"),
        ] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("console.json");
            fs::write(&path, text).unwrap();
            let (settings, complaint) = read_both(&path);
            assert_eq!(settings, Settings::default());
            let complaint = complaint.unwrap();
            assert!(complaint.contains(says), "{complaint}");
            let [aside] = &files(folder.path())[..] else {
                panic!("{:?}", files(folder.path()));
            };
            assert!(aside.starts_with("console.unusable-"), "{aside}");
            assert!(complaint.contains(aside), "{complaint}");
            let kept = fs::read_to_string(folder.path().join(aside)).unwrap();
            assert_eq!(kept, text);
        }
    }

    #[test]
    fn invalid_values_are_replaced_separately() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("console.json");
        let mut settings = some();
        settings.appearance.scale_percent = 1000;
        settings.window = Some(WindowPlace {
            size: [5.0, 1e9],
            corner: None,
            is_maximized: false,
        });
        file::write(&path, &settings).unwrap();
        let (settings, complaint) = read_both(&path);
        assert_eq!(settings.appearance.scale_percent, 100);
        assert_eq!(settings.appearance.theme, ThemeChoice::Dark);
        assert_eq!(settings.window, None);
        assert_eq!(settings.addresses, ["tcp/10.0.0.5:7447"]);
        let complaint = complaint.unwrap();
        assert!(
            complaint.contains("1000 %") && complaint.contains("place"),
            "{complaint}"
        );
    }

    #[test]
    fn addresses_and_colours_are_bounded_and_kept() {
        let mut settings = Settings::default();
        for n in 0..100 {
            settings.remember(&format!("tcp/10.0.0.{n}:7447"));
        }
        settings.remember("tcp/10.0.0.90:7447");
        assert_eq!(settings.addresses.len(), MAX_ADDRESSES);
        assert_eq!(settings.addresses.last().unwrap(), "tcp/10.0.0.90:7447");
        let mut robots = RobotColors::default();
        let mut of = |name: &str| robots.of(&name.parse().unwrap());
        let (scout, boat) = (of("scout"), of("boat"));
        assert_ne!(scout, boat);
        let five: std::collections::BTreeSet<_> = ["scout", "boat", "c", "d", "e"]
            .map(|name| of(name).to_array())
            .into();
        assert_eq!(five.len(), 5, "the first five differ");
        assert_eq!(of("scout"), scout);
        for n in 0..1000 {
            of(&format!("robot-{n}"));
        }
        let text = serde_json::to_string(&robots).unwrap();
        assert!(text.len() < 8_000, "{} bytes", text.len());
    }

    fn within_5_s<T>(found: impl Fn() -> Option<T>) -> T {
        let started = clock::now();
        loop {
            if let Some(found) = found() {
                return found;
            }
            assert!(clock::elapsed(started) < Duration::from_secs(5));
            sleep(Duration::from_millis(5));
        }
    }

    /// As after `kill -9`: nothing is dropped.
    #[test]
    fn changes_are_written_within_a_second_and_at_exit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("console.json");
        let mut settings_writer = SettingsWriter::start(path.clone(), Settings::default());
        settings_writer.save(Settings::default());
        settings_writer.save(some());
        within_5_s(|| path.exists().then_some(()));
        assert_eq!(read(&path).settings, some());
        // Only the last of many changes is written, at the end at the latest.
        for percent in 50..=300 {
            let mut settings = some();
            settings.appearance.scale_percent = percent;
            settings_writer.save(settings);
        }
        drop(settings_writer);
        assert_eq!(read(&path).settings.appearance.scale_percent, 300);
        assert_eq!(files(folder.path()), ["console.json"]);
    }

    #[test]
    fn unwritable_folder_is_reported_once() {
        let folder = tempfile::tempdir().unwrap();
        let blocked = folder.path().join("file");
        fs::write(&blocked, "").unwrap();
        let mut settings_writer =
            SettingsWriter::start(blocked.join("console.json"), Settings::default());
        settings_writer.save(some());
        let problem = within_5_s(|| settings_writer.take_problem());
        assert!(problem.contains("cannot be saved"), "{problem}");
        assert_eq!(settings_writer.take_problem(), None);
        settings_writer.save(Settings {
            opens_exports: true,
            ..some()
        });
        // Longer than the writer's period.
        sleep(Duration::from_millis(1500));
        assert_eq!(settings_writer.take_problem(), None, "the same again");
        fs::remove_file(&blocked).unwrap();
        settings_writer.save(some());
        within_5_s(|| blocked.join("console.json").exists().then_some(()));
        fs::remove_dir_all(&blocked).unwrap();
        fs::write(&blocked, "").unwrap();
        settings_writer.save(Settings::default());
        within_5_s(|| settings_writer.take_problem());
    }

    #[test]
    fn bare_file_name_is_in_the_working_directory() {
        let file = tempfile::NamedTempFile::new_in(".").unwrap();
        let name = Path::new(file.path().file_name().unwrap());
        assert_eq!(name.parent(), Some(Path::new("")));
        file::write(name, &some()).unwrap();
        assert_eq!(read(name).settings, some());
    }
}
