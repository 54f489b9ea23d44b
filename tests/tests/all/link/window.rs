//! The window on a virtual screen, and errors before it opens.

use tempfile::tempdir;

use super::processes::{Running, program, rooms};
use super::screen::{Screen, skip_without_window};

/// Whether this machine lacks a library that windows need.
fn lacks_a_library(printed: &str) -> bool {
    [
        "libX",
        "libxcb",
        "libxkb",
        "libGL",
        "libEGL",
        "NoGlutinConfigs",
    ]
    .iter()
    .any(|word| printed.contains(word))
}

/// Number of pixels in the colours of free space, walls and the vehicle.
#[derive(Debug)]
struct Colors {
    free: usize,
    walls: usize,
    vehicle: usize,
}

/// The colours of a console's window `after` some seconds; `None`, and a skipped test, without a window.
fn colors_of_window(arguments: &[&str], after: &str) -> Option<Colors> {
    let screen = Screen::open()?;
    let folder = tempdir().unwrap();
    let picture = folder.path().join("window.png");
    let mut command = program("operator-console");
    screen.show(&mut command);
    command
        .args(arguments)
        .args(["--after", after, "--screenshot"])
        .arg(&picture);
    let (code, printed) = Running::start(&mut command, "the window").end();
    if code != Some(0) && lacks_a_library(&printed) {
        skip_without_window(&printed);
        return None;
    }
    assert_eq!(code, Some(0), "{printed}");

    let file = std::io::BufReader::new(std::fs::File::open(&picture).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert!(info.width >= 640 && info.height >= 480, "{info:?}");
    let bytes_per_pixel = info.color_type.samples();
    let count = |is_such: &dyn Fn([u8; 3]) -> bool| {
        let pixels = pixels.chunks_exact(bytes_per_pixel);
        pixels
            .filter(|pixel| is_such([pixel[0], pixel[1], pixel[2]]))
            .count()
    };
    let colors = Colors {
        free: count(&|[r, g, b]| r > 235 && g > 235 && b > 235),
        walls: count(&|[r, g, b]| r < 8 && g < 8 && b < 8),
        vehicle: count(&|[r, g, b]| r > 180 && (60..140).contains(&g) && b < 60),
    };
    println!("{colors:?}");
    Some(colors)
}

#[test]
fn the_demo_shows_its_map_in_a_window() {
    let Some(colors) = colors_of_window(&["--demo", "rooms"], "6") else {
        return;
    };
    // The first room has walls and no obstacles: much white, some black.
    assert!(colors.free > 20_000, "{colors:?}");
    assert!(colors.walls > 500, "{colors:?}");
    assert!(colors.vehicle > 50, "{colors:?}");
}

#[test]
fn a_recording_shows_its_map_in_a_window() {
    let rooms = rooms();
    let arguments = ["--open", rooms.to_str().unwrap(), "--rate", "max"];
    let Some(colors) = colors_of_window(&arguments, "12") else {
        return;
    };
    assert!(colors.free > 50_000, "{colors:?}");
    assert!(colors.walls > 500, "{colors:?}");
    assert!(colors.vehicle > 50, "{colors:?}");
}

#[test]
fn a_file_that_is_no_recording_is_refused_before_the_window() {
    let manifest = concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml");
    let command = &mut program("operator-console");
    let (code, printed) = Running::start(command.args(["--open", manifest]), "the window").end();
    assert_eq!(code, Some(3), "{printed}");
    assert!(
        printed.contains("Cargo.toml") && printed.contains("not a recording"),
        "{printed}"
    );
}

#[test]
fn without_a_screen_the_console_suggests_headless() {
    let mut command = program("operator-console");
    command
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("WAYLAND_SOCKET");
    let settings = tempdir().unwrap();
    command.arg("--config").arg(settings.path().join("a.json"));
    let (code, printed) =
        Running::start(command.args(["--connect", "tcp/127.0.0.1:9"]), "the window").end();
    assert_eq!(code, Some(1), "{printed}");
    assert!(printed.contains("--headless"), "{printed}");
}

#[test]
fn an_unknown_demo_world_is_an_error() {
    let command = &mut program("operator-console");
    let (code, printed) = Running::start(command.args(["--demo", "nowhere"]), "the window").end();
    assert_eq!(code, Some(2), "{printed}");
    assert!(
        printed.contains("nowhere") && printed.contains("rooms"),
        "{printed}"
    );
}

#[test]
fn completions_list_the_options() {
    let command = &mut program("operator-console");
    let output = command.args(["completions", "bash"]).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success());
    for word in [
        "-o default operator-console",
        "--reset-settings",
        "--demo",
        "completions",
    ] {
        assert!(text.contains(word), "{word}");
    }
}
