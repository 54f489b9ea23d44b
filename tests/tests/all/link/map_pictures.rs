//! The picture of the map in windows has no holes, neither with textures that the graphics driver loses nor with several
//! windows at once on a busy machine.

use std::path::PathBuf;
use std::process::Command;
use std::rc::Rc;
use std::thread::{available_parallelism, sleep};
use std::time::Duration;

use edge::cli::VehicleOptions;
use edge::pacer::Rate;
use eframe::egui::{Context, FullOutput, Plugin, Ui};
use eframe::{App, Frame};
use operator_console::app::{ConsoleApp, Screenshot, ScreenshotOutcome, result_of};
use operator_console::identity::Identity;
use operator_console::playback::ToOpen;
use operator_console::settings::{ConfigPath, Read};
use operator_console::teleop_handle::TeleopHandle;
use operator_console::theme;
use operator_console::window::WindowSettings;
use protocol::tile::BootId;
use tempfile::tempdir;
use winit::platform::x11::EventLoopBuilderExtX11 as _;

use super::desktop::{Screen, skip_without_window};
use super::window::{Colors, Pixels, lacks_a_library};
use crate::processes::{Running, command, free_endpoint, rooms, start};

/// For the helper process: the picture that it takes, and the number of uploads to lose.
const PICTURE: &str = "FORESHORE_TEST_PICTURE";
const LOST: &str = "FORESHORE_TEST_LOST_UPLOADS";

/// Loses so many uploads of whole chunks of the map.
struct LossyUploads(usize);

impl Plugin for LossyUploads {
    fn debug_name(&self) -> &'static str {
        "lossy uploads"
    }

    fn output_hook(&mut self, _ctx: &Context, output: &mut FullOutput) {
        let all = output.textures_delta.set.values_mut();
        all.for_each(|images| {
            images.retain(|image| {
                let is_lost = self.0 > 0 && image.image.size() == [512, 512];
                self.0 -= usize::from(is_lost);
                !is_lost
            });
        });
    }
}

/// Prints the events of the map at the end.
struct PrintsMapEvents(ConsoleApp);

impl App for PrintsMapEvents {
    fn logic(&mut self, ctx: &Context, frame: &mut Frame) {
        self.0.logic(ctx, frame);
    }

    fn ui(&mut self, ui: &mut Ui, frame: &mut Frame) {
        self.0.ui(ui, frame);
    }

    fn on_exit(&mut self, _gl: Option<&eframe::glow::Context>) {
        let entries = self.0.event_log().entries().iter();
        for entry in entries.filter(|entry| entry.kind == "map") {
            println!("event: {}", entry.text);
        }
    }
}

/// Not a test: a console that shows `rooms`.
#[test]
fn window_as_helper_process() {
    let (Some(picture), Ok(lost)) = (std::env::var_os(PICTURE), std::env::var(LOST)) else {
        return;
    };
    let settings = WindowSettings {
        connect: Vec::new(),
        robot: None,
        demo: None,
        recordings: None,
        identity: Identity::without_keys("anna".parse().unwrap()),
        zenoh_config: None,
        credentials: None,
        screenshot: None,
        controls: None,
        open: Some(ToOpen {
            path: PathBuf::from(rooms()),
            setup: VehicleOptions::default(),
            // Chunks whose first uploads were lost get changed tiles before they are compared.
            rate: Rate::Times(20.0),
        }),
        config: ConfigPath::None,
        forgets_settings: false,
    };
    let outcome = ScreenshotOutcome::default();
    let screenshot = Screenshot::new(picture.into(), Duration::from_secs(20), outcome.clone());
    let options = eframe::NativeOptions {
        viewport: eframe::egui::ViewportBuilder::default().with_inner_size([1280.0, 800.0]),
        event_loop_builder: Some(Box::new(|builder| {
            builder.with_any_thread(true);
        })),
        ..eframe::NativeOptions::default()
    };
    let create = move |creation: &eframe::CreationContext<'_>| {
        let ctx = &creation.egui_ctx;
        theme::set(ctx);
        ctx.add_plugin(LossyUploads(lost.parse()?));
        let app = ConsoleApp::new(
            ctx,
            settings,
            BootId([1; 16]),
            Some(screenshot),
            Rc::new(TeleopHandle::default()),
            Read::default(),
            None,
        );
        Ok(Box::new(PrintsMapEvents(app)) as Box<dyn App>)
    };
    eframe::run_native("Foreshore", options, Box::new(create)).unwrap();
    result_of(&outcome).unwrap();
}

#[test]
fn lost_uploads_are_found_drawn_again_and_reported() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempdir().unwrap();
    let shown = |lost: usize| {
        let picture = folder.path().join(format!("{lost}.png"));
        let mut console = Command::new(std::env::current_exe().unwrap());
        console
            .args("link::map_pictures::window_as_helper_process --exact --nocapture".split(' '))
            .env(PICTURE, &picture)
            .env(LOST, lost.to_string());
        screen.show(&mut console);
        let (code, printed) = Running::start(&mut console, "the window").end();
        if code != Some(0) && lacks_a_library(&printed) {
            skip_without_window(&printed);
            return None;
        }
        assert_eq!(code, Some(0), "{printed}");
        Some((Colors::of(&Pixels::of(&picture)), printed))
    };
    let (Some((whole, nothing)), Some((repaired, events))) = (shown(0), shown(4)) else {
        return;
    };
    assert!(!nothing.contains("event: "), "{nothing}");
    let event = "event: A part of the map was not drawn as received, and was drawn again";
    assert!(events.contains(event), "{events}");
    assert!(whole.free > 50_000 && whole.walls > 500, "{whole:?}");
    assert_eq!((repaired.free, repaired.walls), (whole.free, whole.walls));
}

/// Side of the compared squares, pixels.
const SQUARE: usize = 24;

/// The number of squares of which no pixel is as in the other picture.
fn different_squares(picture: &Pixels, other: &Pixels) -> usize {
    assert_eq!(picture.size, other.size);
    let [width, height] = picture.size.map(|side| side / SQUARE);
    let is_different = |square: &usize| {
        let (x, y) = (square % width * SQUARE, square / width * SQUARE);
        let mut pixels = (0..SQUARE * SQUARE).map(|at| (x + at % SQUARE, y + at / SQUARE));
        pixels.all(|(x, y)| picture.at(x, y) != other.at(x, y))
    };
    (0..width * height).filter(is_different).count()
}

/// Four windows that cover each other, opened while the robot maps, beside busy processors. Their pictures are compared
/// with that of a single window when the robot has ended. `FORESHORE_ROUNDS` are the rounds for each world, else 1.
#[test]
#[ignore = "two minutes, all processors busy"]
fn four_windows_at_once_have_no_hole() {
    let rounds = std::env::var("FORESHORE_ROUNDS").map_or(1, |rounds| rounds.parse().unwrap());
    let folder = tempdir().unwrap();
    let mut pictures = 0;
    for world in ["rooms", "street", "yard", "lake"] {
        for round in 0..rounds {
            let Some(screen) = Screen::open() else { return };
            let endpoint = free_endpoint();
            let robot = start(&format!(
                "robot-edge simulate {world} --robot scout --listen {endpoint} --for 60 --rate 4 --keep-serving"
            ));
            let window = |name: &str, after_s: u32| {
                let picture = folder.path().join(format!("{world}-{round}-{name}.png"));
                let mut console = command(&format!(
                    "operator-console --connect {endpoint} --robot scout --screenshot {} --after {after_s}",
                    picture.display()
                ));
                screen.show(&mut console);
                (Running::start(&mut console, name), picture)
            };
            let busy: Vec<_> = (0..4 * available_parallelism().unwrap().get())
                .map(|_| {
                    Running::start(
                        Command::new("sh").args(["-c", "while :; do :; done"]),
                        "busy",
                    )
                })
                .collect();
            let together = ["a", "b", "c", "d"].map(|name| {
                sleep(Duration::from_millis(300));
                window(name, 25)
            });
            let together = together.map(|(console, picture)| {
                console.ends_well();
                picture
            });
            drop(busy);
            let (alone, reference) = window("alone", 10);
            alone.ends_well();
            let reference = Pixels::of(&reference);
            for picture in together {
                let different = different_squares(&Pixels::of(&picture), &reference);
                assert_eq!(different, 0, "{}", picture.display());
                pictures += 1;
            }
            drop(robot);
        }
    }
    println!("{pictures} pictures without a hole");
}
