//! The window, opened for real on a virtual screen.

use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use tempfile::tempdir;

use super::processes::{Running, program};

/// A virtual screen; `None`, said aloud, where there is none to be had.
struct Screen {
    server: Child,
    display: String,
}

impl Screen {
    fn open() -> Option<Self> {
        // Named after this process: tests of several checkouts may run side by side.
        let display = format!(":{}", 1000 + std::process::id() % 50_000);
        let mut command = Command::new("Xvfb");
        command.args([&display, "-screen", "0", "1280x800x24", "-nolisten", "tcp"]);
        let Ok(server) = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn() else {
            println!("skipped: there is no Xvfb (Debian: apt-get install xvfb)");
            return None;
        };
        let screen = Self { server, display };
        sleep(Duration::from_millis(1500));
        Some(screen)
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        drop(self.server.kill());
        drop(self.server.wait());
    }
}

/// Whether a library that windows need is missing, which is this machine's fault and not the program's.
fn lacks_a_library(said: &str) -> bool {
    [
        "libX",
        "libxcb",
        "libxkb",
        "libGL",
        "libEGL",
        "NoGlutinConfigs",
    ]
    .iter()
    .any(|word| said.contains(word))
}

#[test]
fn the_demo_shows_its_map_in_a_window() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempdir().unwrap();
    let picture = folder.path().join("demo.png");
    let mut command = program("operator-console");
    command
        .env("DISPLAY", &screen.display)
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("WAYLAND_SOCKET");
    command
        .args(["--demo", "rooms", "--after", "6", "--screenshot"])
        .arg(&picture);
    let (code, said) = Running::start(&mut command, "the window").end();
    if code != Some(0) && lacks_a_library(&said) {
        println!("skipped: no window can be opened on this machine: {said}");
        return;
    }
    assert_eq!(code, Some(0), "{said}");

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
    // The first room is free of obstacles but for its walls: much white, some black, and not all of either.
    let free = count(&|[r, g, b]| r > 235 && g > 235 && b > 235);
    let walls = count(&|[r, g, b]| r < 8 && g < 8 && b < 8);
    let vehicle = count(&|[r, g, b]| r > 180 && (60..140).contains(&g) && b < 60);
    println!("{free} free, {walls} occupied, {vehicle} vehicle pixels");
    assert!(free > 50_000, "{free} pixels are free space");
    assert!(walls > 500, "{walls} pixels are walls");
    assert!(vehicle > 50, "{vehicle} pixels are the vehicle");
}

#[test]
fn without_a_screen_the_window_says_what_to_do() {
    let mut command = program("operator-console");
    command
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("WAYLAND_SOCKET");
    let (code, said) =
        Running::start(command.args(["--connect", "tcp/127.0.0.1:9"]), "the window").end();
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("--headless"), "{said}");
}

#[test]
fn a_demo_of_a_world_that_is_none_says_so_at_once() {
    let command = &mut program("operator-console");
    let (code, said) = Running::start(command.args(["--demo", "nowhere"]), "the window").end();
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("nowhere") && said.contains("rooms"), "{said}");
}
