//! The console end to end, with real keys, a real pointer and a picture of each step: what only the whole window shows.

mod desktop;
mod probe;

use std::fs;
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::rig::relay::Relay;
use protocol::message::{TeleopState, TeleopStatus};
use robot_edge::clock;
use tempfile::tempdir;

use super::controls::Control;
use super::driver::{hold_until, take_lease};
use super::processes::{Running, free_port, program};
use super::screen::Key;
use super::telemetry::Telemetry;
use desktop::{Desktop, settle};
use probe::{Raster, Reading, position_m, readings};

const ROBOT: &str = "barge";
/// The inner faces of the yard's walls on the left and on the right: `worlds/yard.toml`.
const WALLS_M: [f64; 2] = [8.55, -8.55];
const CELL_M: f64 = 0.1;
/// Greatest width of a pixel on this map.
const STEP_M: f64 = 0.1;
/// Points of the map that are read in each row.
const PROBES: i16 = 7;
/// Values that must be known.
const MIN_KNOWN: usize = 3;

#[test]
fn a_day_with_the_console() {
    // An address switches discovery off, so robots of other tests do not appear.
    let unused = format!("tcp/127.0.0.1:{}", free_port());
    let arguments = ["--operator", "anna", "--robot", ROBOT, "--connect"];
    let Some(mut desktop) = Desktop::new(&arguments, &unused) else {
        return;
    };
    let recordings = tempdir().unwrap();
    let port = free_port();
    let relay = Relay::pair(port).unwrap();
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let mut command = program("robot-edge");
    command.args([
        "simulate",
        "yard",
        "--rate",
        "1",
        "--keep-serving",
        "--quiet",
        "--robot",
        ROBOT,
    ]);
    command.args(["--listen", &endpoint, "--recordings"]);
    let _edge = Running::start(command.arg(recordings.path()), "edge");
    let telemetry = Telemetry::of(ROBOT, &endpoint);

    finds_the_robot(&desktop, &relay);
    starts_recording(&desktop);
    switches_layers(&desktop);
    drives(&desktop, &telemetry);
    measures(&desktop);
    loses_the_link(&desktop, &relay);
    let recording = stops_recording(&desktop, recordings.path());
    scrubs(&desktop, &recording);
    let read = probes(&desktop);
    exports(&desktop, &read);
    comes_back(&mut desktop, &relay);
}

fn finds_the_robot(desktop: &Desktop, relay: &Relay) {
    desktop.controls.beginning("Looking for robots");
    desktop.controls.beginning(&format!("Looking for {ROBOT}"));
    desktop.picture("01_open");
    desktop.retry_until_shown("Remembered addresses", || {
        desktop.screen.tap_with(Key::Control, Key::L);
        desktop.screen.write(&relay.endpoint());
        desktop.screen.tap(Key::Enter);
    });
    desktop.controls.beginning("Live");
    desktop.controls.beginning("Synchronized");
    desktop.picture("02_found");
}

fn switches_layers(desktop: &Desktop) {
    let legend = "Slope cost: 0 flat or clear, 1 lethal";
    desktop.controls.beginning(legend);
    desktop.screen.tap_with(Key::Alt, Key::Digit5);
    desktop.controls.beginning("Traversable");
    desktop.controls.beginning("Synchronized");
    desktop.picture("03_layers");
    desktop.screen.tap_with(Key::Alt, Key::Digit5);
}

fn starts_recording(desktop: &Desktop) {
    desktop.retry_until_shown("Start recording", || desktop.click("Button", "Recording"));
    desktop.retry_until_shown("Stop recording", || {
        desktop.click("Button", "Start recording");
    });
}

/// Drives long enough for a recording of several seconds.
fn drives(desktop: &Desktop, telemetry: &Telemetry) {
    take_lease(&desktop.screen, telemetry);
    let forward = |status: &TeleopStatus| status.applied.linear_mps > 0.1;
    hold_until(&desktop.screen, telemetry, Key::W, forward);
    desktop.picture("04_driving");
    sleep(Duration::from_secs(1));
    desktop.screen.release(Key::W);
    telemetry.wait_for_status("held", |status| status.state == TeleopState::Held);
    // The pose may lag behind on a busy machine.
    telemetry.wait_until_stopped();
    desktop.screen.tap_with(Key::Control, Key::G);
    telemetry.wait_for_status("released", |status| status.lease.holder.is_none());
}

/// Moves the pointer; returns the position that the map shows for it, metres in `odom`.
fn reads_at(desktop: &Desktop, at: [i16; 2]) -> [f64; 2] {
    let before = position_m(&desktop.controls.all());
    desktop.screen.point(at);
    let first = desktop.controls.wait_for("another place", |all| {
        position_m(all).filter(|position_m| Some(*position_m) != before)
    });
    settle();
    assert_eq!(
        position_m(&desktop.controls.all()),
        Some(first),
        "the map moves"
    );
    first
}

fn measures(desktop: &Desktop) {
    desktop.screen.tap(Key::V);
    settle();
    let [left, top, right, bottom] = desktop.map().edges;
    let corner = [left + (right - left) / 4, top + (bottom - top) / 3];
    let other = [right - (right - left) / 4, bottom - (bottom - top) / 3];
    let (from_m, to_m) = (reads_at(desktop, corner), reads_at(desktop, other));
    // North is up, so two points define the view.
    let pixels_per_m = f64::from(other[0] - corner[0]) / (to_m[0] - from_m[0]);
    assert!(
        pixels_per_m > 1.0 / STEP_M,
        "{pixels_per_m} pixels per metre"
    );
    let place = |[x_m, y_m]: [f64; 2]| {
        let [dx, dy] =
            [x_m - from_m[0], from_m[1] - y_m].map(|m| (m * pixels_per_m).round() as i16);
        [corner[0] + dx, corner[1] + dy]
    };
    desktop.screen.tap(Key::M);
    for y_m in WALLS_M {
        desktop.screen.click(place([12.0, y_m]));
        settle();
    }
    let label = desktop.controls.beginning("Map, measured: ").words;
    desktop.picture("05_measured");
    desktop.screen.tap(Key::Escape);
    let words = label.trim_start_matches("Map, measured: ");
    let length_m: f64 = words.split(' ').next().unwrap().parse().unwrap();
    println!(
        "from wall to wall: {words}; it is {} m",
        WALLS_M[0] - WALLS_M[1]
    );
    assert!(
        (length_m - (WALLS_M[0] - WALLS_M[1])).abs() < 2.0 * STEP_M,
        "{label}"
    );
}

/// Mean colour of a part of the screen: greatest less least of red, green and blue.
fn colourfulness(desktop: &Desktop, edges: [i16; 4]) -> f64 {
    let ([width, _], pixels) = desktop.screen.pixels();
    let [left, top, right, bottom] = edges.map(|edge| usize::try_from(edge).unwrap());
    let mut sum = 0.0;
    for y in top..bottom {
        for pixel in &pixels[y * usize::from(width) + left..y * usize::from(width) + right] {
            let (most, least) = (pixel.iter().max().unwrap(), pixel.iter().min().unwrap());
            sum += f64::from(most - least);
        }
    }
    sum / ((right - left) * (bottom - top)) as f64
}

fn loses_the_link(desktop: &Desktop, relay: &Relay) {
    let [left, top, right, bottom] = desktop.map().edges;
    let middle = [
        left + (right - left) / 4,
        top + (bottom - top) / 4,
        right - (right - left) / 4,
        bottom - (bottom - top) / 4,
    ];
    let live = colourfulness(desktop, middle);
    let cut = clock::now();
    relay.cut();
    let banner = desktop.controls.beginning("Link lost: no data for");
    println!(
        "from the cut to the banner in the window: {:?}; {}",
        clock::elapsed(cut),
        banner.words
    );
    desktop.controls.beginning("Silent");
    sleep(Duration::from_secs(3));
    let old = colourfulness(desktop, middle);
    println!("colours of the map: {live:.1} live, {old:.1} without a link");
    assert!(old < 0.6 * live, "{old} of {live}");
    desktop.picture("06_link_lost");
    relay.pass().unwrap();
    desktop.controls.without("Link lost");
    desktop.controls.beginning("Live");
    desktop.controls.beginning("Synchronized");
    desktop.picture("07_back");
}

fn stops_recording(desktop: &Desktop, folder: &Path) -> PathBuf {
    desktop.retry_until_shown("Start recording", || {
        desktop.click("Button", "Stop recording");
    });
    let mut files: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|end| end == "mcap"))
        .collect();
    files.sort();
    files.remove(0)
}

/// Position in the recording and its length, seconds.
fn position_s(all: &[Control]) -> Option<[f64; 2]> {
    let clock_s = |words: &str| {
        let mut parts = words.split(':').map(str::parse::<f64>);
        parts.try_fold(0.0, |sum, part| Some(60.0 * sum + part.ok()?))
    };
    all.iter().find_map(|control| {
        let words = control.words.strip_prefix("Position in the recording: ")?;
        let (position, length) = words.split_once(" of ")?;
        Some([clock_s(position)?, clock_s(length)?])
    })
}

/// Opens the recording, pauses it and seeks in it, the last time forward.
fn scrubs(desktop: &Desktop, recording: &Path) {
    desktop.screen.tap_with(Key::Control, Key::O);
    desktop.controls.beginning("MCAP, ROS 1 bag");
    settle();
    desktop.screen.write(recording.to_str().unwrap());
    desktop.screen.tap(Key::Enter);
    let [_, length_s] = desktop.controls.wait_for("a time line", position_s);
    desktop.screen.tap(Key::P);
    desktop.controls.named("Button", "Play");
    let slider = desktop.controls.beginning("Position in the recording");
    let [left, top, right, _] = slider.edges;
    for share in [0.9, 0.3, 0.8] {
        let x = f64::from(left) + share * f64::from(right - left);
        desktop.screen.click([x as i16, top + 11]);
        let (wanted_s, clicked) = (share * length_s, clock::now());
        desktop
            .controls
            .wait_for(&format!("{wanted_s:.1} s"), |all| {
                let [position_s, _] = position_s(all)?;
                ((position_s - wanted_s).abs() < 0.02 * length_s + 0.2).then_some(())
            });
        println!(
            "sought to {wanted_s:.1} s of {length_s:.1} s in {:?}",
            clock::elapsed(clicked)
        );
    }
    desktop.controls.beginning("Synchronized");
}

/// Reads the map at many points; the last one stays pinned.
fn probes(desktop: &Desktop) -> Vec<([f64; 2], Vec<Reading>)> {
    desktop.screen.tap_with(Key::Alt, Key::Digit5);
    desktop.controls.beginning("Traversable");
    desktop.screen.tap(Key::V);
    desktop.screen.tap(Key::Equals);
    settle();
    let [_, top, _, bottom] = desktop.map().edges;
    let [middle, _] = desktop.map().middle();
    let places = (1..PROBES).flat_map(|row| (0..PROBES).map(move |column| (column, row)));
    let mut read = Vec::new();
    for (column, row) in places {
        // Around the vehicle and ahead of it, at varying places within a cell.
        let at = [
            middle + 23 * column + 3 * row - 40,
            top + (bottom - top) * row / PROBES + 5 * column,
        ];
        let point_m = reads_at(desktop, at);
        // The card rounds, so a point near an edge may belong to the next cell.
        let is_within = point_m.iter().all(|m| {
            let share = (m / CELL_M).rem_euclid(1.0);
            (0.1..0.9).contains(&share)
        });
        if is_within {
            read.push((point_m, readings(&desktop.controls.all())));
        }
    }
    let [x, y] = desktop.map().middle();
    desktop.screen.click([x + 60, y]);
    desktop.controls.named("Button", "Unpin");
    desktop.picture("08_recording");
    desktop.screen.tap(Key::Escape);
    read
}

/// Exports the maps and compares them with the values that were read.
fn exports(desktop: &Desktop, read: &[([f64; 2], Vec<Reading>)]) {
    desktop.screen.tap_with(Key::Control, Key::E);
    desktop.controls.named("Button", "Export");
    settle();
    // The text field of the folder has the keyboard.
    desktop.screen.tap(Key::Enter);
    desktop.controls.named("Button", "Open folder");
    desktop.picture("09_exported");
    let mut known = 0;
    for (point_m, readings) in read {
        assert_eq!(readings.len(), 2, "{point_m:?}: {readings:?}");
        for reading in readings {
            let raster = Raster::read(&desktop.find(&format!("/{}.tif", reading.layer.name())));
            let exported = raster.at(*point_m);
            assert!(
                reading.agrees_with(exported),
                "{point_m:?}: {reading:?}, exported {exported}"
            );
            known += usize::from(reading.value != "unknown");
        }
    }
    println!(
        "read and exported alike: {} points, {known} values known",
        read.len()
    );
    assert!(known >= MIN_KNOWN, "{read:?}");
    desktop.screen.tap(Key::Escape);
}

/// Changes layout and scale, restarts the console and expects both as they were.
fn comes_back(desktop: &mut Desktop, relay: &Relay) {
    desktop.retry_until_shown("Live", || desktop.click("Button", "Close recording"));
    desktop.controls.beginning("Synchronized");
    desktop.screen.tap_with(Key::Control, Key::Equals);
    desktop.retry_until_shown("Reset layout", || desktop.click("Button", "View"));
    desktop.click("CheckBox", "Events");
    desktop.controls.without("Reset layout");
    desktop.controls.without("Events");
    settle();
    desktop.picture("10_another_layout");
    let before = desktop.map().edges;
    desktop.screen.tap_with(Key::Control, Key::Q);
    desktop.wait_for_exit();

    assert!(desktop.start(&relay.endpoint()));
    desktop.controls.beginning("Live");
    desktop.controls.beginning("Synchronized");
    // The visible layers are remembered too.
    desktop.controls.beginning("Traversable");
    desktop.controls.without("Events");
    settle();
    desktop.picture("11_the_next_day");
    assert_eq!(desktop.map().edges, before);
    desktop.retry_until_shown("Scale: ", || desktop.click("Button", "View"));
    desktop.controls.beginning("Scale: 110 %");
    desktop.screen.tap(Key::Escape);
    settle();
    desktop.screen.tap_with(Key::Control, Key::Q);
    desktop.wait_for_exit();
}
