//! A day with the console, from the first window to the last, with real keys and a real pointer, and a picture of each step.

mod desktop;
mod probe;
mod raster;

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
use super::telemetry::{TIMEOUT, Telemetry};
use desktop::{Desktop, settle};
use probe::{Reading, position_m, readings};
use raster::Raster;

const ROBOT: &str = "barge";
/// The inner faces of the yard's walls on the left and on the right: `worlds/yard.toml`.
const WALLS_M: [f64; 2] = [8.55, -8.55];
/// Side of a cell of the yard's maps.
const CELL_M: f64 = 0.1;
/// A step of the pointer is so much on this map, at most.
const STEP_M: f64 = 0.1;
/// Driven so far at least.
const WAY_M: f64 = 0.5;
/// Points of the map that are read, and of which so many must be known.
const PROBES: i16 = 7;
const MIN_KNOWN: usize = 3;

#[test]
fn a_day_with_the_console() {
    // Whoever names an address is shown nobody whom other tests have on this network.
    let yesterdays = format!("tcp/127.0.0.1:{}", free_port());
    let arguments = ["--operator", "anna", "--robot", ROBOT, "--connect"];
    let Some(mut desktop) = Desktop::new(&arguments, &yesterdays) else {
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
    saves_pictures(&desktop);
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
        // What is typed before the field is there waits for it.
        desktop.screen.tap_with(Key::Control, Key::L);
        desktop.screen.write(&relay.endpoint());
        desktop.screen.tap(Key::Enter);
    });
    desktop.controls.beginning("Live");
    desktop.controls.beginning("Synchronized");
    desktop.picture("02_found");
}

/// What stands below the name of a layer in its panel.
fn state_of<'a>(all: &'a [Control], layer: &str) -> Option<&'a str> {
    let name = all
        .iter()
        .find(|control| control.role == "CheckBox" && control.words == layer)?;
    let below = all.iter().filter(|control| {
        let [left, top, right, _] = control.edges;
        control.role == "Label"
            && top >= name.edges[3] - 2
            && left <= name.edges[0] + 20
            && right > name.edges[0]
    });
    let next = below.min_by_key(|control| control.edges[1])?;
    Some(&next.words)
}

fn switches_layers(desktop: &Desktop) {
    let is_hidden = |layer: &'static str, is_hidden: bool| {
        desktop
            .controls
            .wait_for(&format!("{layer} hidden: {is_hidden}"), |all| {
                let state = state_of(all, layer)?;
                (state.starts_with("hidden") == is_hidden).then_some(())
            });
    };
    is_hidden("Rigidity", true);
    desktop
        .controls
        .beginning("Slope cost: 0 flat or clear, 1 lethal");
    desktop.screen.tap_with(Key::Alt, Key::Digit5);
    is_hidden("Rigidity", false);
    desktop.controls.beginning("Rigidity");
    desktop.controls.wait_for("rigidity synchronized", |all| {
        let state = state_of(all, "Rigidity")?;
        state.contains("synchronized").then_some(())
    });
    desktop.picture("03_layers");
    desktop.screen.tap_with(Key::Alt, Key::Digit5);
    is_hidden("Rigidity", true);
}

/// Hands let go of Ctrl before the letter as often as after it; S is a key that drives as well.
fn saves_pictures(desktop: &Desktop) {
    let folder = desktop.home.path().join("pictures");
    let saved = || fs::read_dir(&folder).map_or(0, Iterator::count);
    for count in 1..=3 {
        desktop.screen.press(Key::Control);
        desktop.screen.press(Key::S);
        desktop.screen.release(Key::Control);
        desktop.screen.release(Key::S);
        let started = clock::now();
        while saved() < count {
            assert!(clock::elapsed(started) < TIMEOUT, "{count} pictures");
            settle();
        }
    }
    assert_eq!(saved(), 3);
}

fn starts_recording(desktop: &Desktop) {
    desktop.retry_until_shown("Start recording", || desktop.click("Button", "Recording"));
    desktop.retry_until_shown("Stop recording", || {
        desktop.click("Button", "Start recording");
    });
}

fn drives(desktop: &Desktop, telemetry: &Telemetry) {
    take_lease(&desktop.screen, telemetry);
    telemetry.wait_for_status("held", |status| status.state == TeleopState::Held);
    let (from, _) = telemetry.pose();
    let way_m = || {
        let ([x, y], _) = telemetry.pose();
        nalgebra::distance(&from.into(), &[x, y].into())
    };
    let mut presses = 0;
    // The guard of a laser that tilts knows little just ahead, and may stop it before.
    while way_m() < WAY_M {
        assert!(presses < 10, "{} m", way_m());
        presses += 1;
        let forward = |status: &TeleopStatus| status.applied.linear_mps > 0.1;
        hold_until(&desktop.screen, telemetry, Key::W, forward);
        if presses == 1 {
            desktop.picture("04_driving");
        }
        sleep(Duration::from_secs(1));
        desktop.screen.release(Key::W);
        telemetry.wait_for_status("standing", |status| status.state == TeleopState::Held);
    }
    // A machine that is busy with other tests may be behind with telling where it is.
    telemetry.wait_until_stopped();
    let stood = way_m();
    sleep(Duration::from_secs(1));
    assert!((way_m() - stood).abs() < 0.02, "it stands");
    println!("driven {stood:.2} m with {presses} presses");
    // Given back.
    desktop.screen.tap_with(Key::Control, Key::G);
    telemetry.wait_for_status("nobody's", |status| status.lease.holder.is_none());
}

/// Where the pointer reads on the map, metres in `odom`, once it points there: elsewhere than before.
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
    // The whole map grows while one looks; the vehicle stands.
    desktop.screen.tap(Key::V);
    settle();
    let [left, top, right, bottom] = desktop.map().edges;
    let corner = [left + (right - left) / 4, top + (bottom - top) / 3];
    let other = [right - (right - left) / 4, bottom - (bottom - top) / 3];
    let (from_m, to_m) = (reads_at(desktop, corner), reads_at(desktop, other));
    // North is up: the two are all there is to know of the view.
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

/// How far from grey a part of the screen is on average: the greatest less the least of red, green and blue.
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
    // Without what stands at the edges of the map.
    let middle = [
        left + (right - left) / 4,
        top + (bottom - top) / 4,
        right - (right - left) / 4,
        bottom - (bottom - top) / 4,
    ];
    let live = colourfulness(desktop, middle);
    let cut = clock::now();
    relay.cut().unwrap();
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

/// Where the recording is, seconds, and how long.
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

/// Opens the recording and winds it: paused, the last time forward.
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
            "wound to {wanted_s:.1} s of {length_s:.1} s in {:?}",
            clock::elapsed(clicked)
        );
    }
    desktop.controls.beginning("Synchronized");
}

/// Reads the map in many places, the last of which stays pinned.
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
        // Around the vehicle and ahead of it; not synchronized with cells.
        let at = [
            middle + 23 * column + 3 * row - 40,
            top + (bottom - top) * row / PROBES + 5 * column,
        ];
        let point_m = reads_at(desktop, at);
        // The card rounds: a point at the edge of a cell could be in the next.
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

/// Exports what is shown, and holds it to what was read.
fn exports(desktop: &Desktop, read: &[([f64; 2], Vec<Reading>)]) {
    desktop.screen.tap_with(Key::Control, Key::E);
    desktop.controls.named("Button", "Export");
    settle();
    // The keyboard is where the folder is.
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

/// Puts the window in another order, ends the day, and finds it so the next morning.
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
    let evening = desktop.map().edges;
    desktop.screen.tap_with(Key::Control, Key::Q);
    desktop.wait_for_exit();

    assert!(desktop.start(&relay.endpoint()));
    desktop.controls.beginning("Live");
    desktop.controls.beginning("Synchronized");
    // The layer that was shown last, too.
    desktop.controls.beginning("Traversable");
    desktop.controls.without("Events");
    settle();
    desktop.picture("11_the_next_day");
    assert_eq!(desktop.map().edges, evening);
    desktop.retry_until_shown("Scale: ", || desktop.click("Button", "View"));
    desktop.controls.beginning("Scale: 110 %");
    desktop.screen.tap(Key::Escape);
    settle();
    desktop.screen.tap_with(Key::Control, Key::Q);
    desktop.wait_for_exit();
}
