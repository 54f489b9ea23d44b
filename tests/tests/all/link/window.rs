//! The window on a virtual screen, and errors before it opens.

use std::path::Path;

use tempfile::tempdir;

use super::desktop::{Screen, skip_without_window};
use crate::processes::{Running, command, rooms, start};

/// Whether this machine lacks a library that windows need.
pub(super) fn lacks_a_library(printed: &str) -> bool {
    let libraries = [
        "libX",
        "libxcb",
        "libxkb",
        "libGL",
        "libEGL",
        "NoGlutinConfigs",
    ];
    libraries.iter().any(|word| printed.contains(word))
}

/// Number of pixels in the colours of free space, walls and the vehicle.
#[derive(Debug)]
pub(crate) struct Colors {
    pub(crate) free: usize,
    pub(crate) walls: usize,
    vehicle: usize,
}

/// A picture of a window.
pub(crate) struct Pixels {
    /// Width and height.
    pub(super) size: [usize; 2],
    rgb: Vec<[u8; 3]>,
}

impl Pixels {
    pub(crate) fn of(picture: &Path) -> Self {
        let file = std::io::BufReader::new(std::fs::File::open(picture).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert!(info.width >= 640 && info.height >= 480, "{info:?}");
        let pixels = pixels.chunks_exact(info.color_type.samples());
        Self {
            size: [info.width as usize, info.height as usize],
            rgb: pixels.map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect(),
        }
    }

    /// `x` to the right, `y` down.
    pub(super) fn at(&self, x: usize, y: usize) -> [u8; 3] {
        self.rgb[y * self.size[0] + x]
    }
}

impl Colors {
    pub(crate) fn of(pixels: &Pixels) -> Self {
        let count = |is_such: &dyn Fn([u8; 3]) -> bool| {
            pixels.rgb.iter().filter(|pixel| is_such(**pixel)).count()
        };
        let colors = Self {
            free: count(&|[r, g, b]| r > 235 && g > 235 && b > 235),
            walls: count(&|[r, g, b]| r < 8 && g < 8 && b < 8),
            vehicle: count(&|[r, g, b]| {
                r < 40 && (90..140).contains(&g) && (150..200).contains(&b)
            }),
        };
        println!("{colors:?}");
        colors
    }
}

/// The colours of a console's window; `None`, and a skipped test, without a window.
fn colors_of_window(options: &str) -> Option<Colors> {
    let screen = Screen::open()?;
    let folder = tempdir().unwrap();
    let picture = folder.path().join("window.png");
    let mut console = command(&format!(
        "operator-console {options} --screenshot {}",
        picture.display()
    ));
    screen.show(&mut console);
    let (code, printed) = Running::start(&mut console, options).end();
    if code != Some(0) && lacks_a_library(&printed) {
        skip_without_window(&printed);
        return None;
    }
    assert_eq!(code, Some(0), "{printed}");
    Some(Colors::of(&Pixels::of(&picture)))
}

/// The demo's first room has walls and no obstacles: much white, some black.
#[test]
fn a_window_shows_the_map_of_the_demo_and_of_a_recording() {
    let recording = format!("--open {} --rate max --after 12", rooms());
    for (options, free) in [("--demo rooms --after 6", 20_000), (&recording, 50_000)] {
        let Some(colors) = colors_of_window(options) else {
            return;
        };
        assert!(colors.free > free, "{options}: {colors:?}");
        assert!(colors.walls > 500, "{options}: {colors:?}");
        assert!(colors.vehicle > 50, "{options}: {colors:?}");
    }
}

#[test]
fn errors_before_the_window_say_what_is_wrong() {
    let manifest = concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml");
    for (options, code, says) in [
        (
            format!("--open {manifest}"),
            3,
            ["Cargo.toml", "not a recording"],
        ),
        ("--demo nowhere".to_owned(), 2, ["nowhere", "rooms"]),
    ] {
        let printed = start(&format!("operator-console {options}")).ends_with(code);
        for words in says {
            assert!(printed.contains(words), "{options}: {printed}");
        }
    }
}

#[test]
fn without_a_screen_the_console_suggests_headless() {
    let settings = tempdir().unwrap();
    let mut console = command(&format!(
        "operator-console --connect tcp/127.0.0.1:9 --config {}/a.json",
        settings.path().display()
    ));
    for display in ["DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"] {
        console.env_remove(display);
    }
    let printed = Running::start(&mut console, "the window").ends_with(1);
    assert!(printed.contains("--headless"), "{printed}");
}

#[test]
fn completions_list_the_options() {
    let printed = start("operator-console completions bash").ends_well();
    for word in [
        "-o default operator-console",
        "--reset-settings",
        "--demo",
        "completions",
    ] {
        assert!(printed.contains(word), "{word}");
    }
}
