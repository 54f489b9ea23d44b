//! The map view with a map of 10,000 × 10,000 cells in a real window that is moved by events; prints a table.
//!
//! `cargo bench -p operator-console` on a screen, or under Xvfb; `-- --two-layers` adds obstacles over the heights. A
//! frame lasts until the next one, so it includes input, layout, textures, painting, and the graphics driver.

#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "a benchmark prints a table and has no caller for errors"
)]

use std::time::Duration;

use eframe::egui::{
    CentralPanel, Context, Event, Modifiers, MouseWheelSource, MouseWheelUnit, Panel,
    PointerButton, Pos2, RawInput, ScrollArea, TouchPhase, Ui, ViewportCommand, pos2, vec2,
};
use measurement::time::Monotonic;
use network::clock;
use operator_console::command::Look;
use operator_console::map_view::{MapView, Orientation};
use operator_console::model::{ConsoleModel, Incoming, ModelSettings, RequestId};
use operator_console::panels::connection::LinkStatus;
use operator_console::panels::layers::{LayersData, layers_ui};
use operator_console::theme;
use protocol::keys::Topic;
use protocol::layer::LayerId;
use protocol::message::{
    ChangedTile, Changes, Info, LayerHead, LayerInfo, MapHead, Pose, TileBand,
};
use protocol::tile::codec;
use protocol::tile::{BootId, TileCells};
use protocol::tile_store::{LayerGrid, TileStore};
use protocol::wire::{self, Header};
use serde::Serialize;

struct Bench {
    robot: Robot,
    model: ConsoleModel,
    view: MapView,
    opened: Monotonic,
    complete_after: Option<Duration>,
    steps: Steps,
    is_reported: bool,
}

impl eframe::App for Bench {
    fn raw_input_hook(&mut self, _ctx: &Context, input: &mut RawInput) {
        if self.complete_after.is_some() {
            self.steps.next_frame(&self.view, &mut input.events);
        }
    }

    fn ui(&mut self, ui: &mut Ui, _frame: &mut eframe::Frame) {
        let now = clock::now();
        if let Some(command) = self.steps.take_command() {
            self.view.look(command);
        }
        if let Some(Step::Update(cells)) = self.steps.current() {
            let turn = self.steps.index() + 1;
            self.robot.change_elevation(&mut self.model, cells, turn);
        }
        let started = clock::now();
        self.view.update(&mut self.model);
        Panel::left("side").default_size(290.0).show(ui, |ui| {
            ScrollArea::vertical().show(ui, |ui| {
                let data = LayersData::new(&self.model, &LinkStatus::default(), &self.view, now);
                layers_ui(ui, &data);
            });
        });
        CentralPanel::no_frame().show(ui, |ui| self.view.show(ui, &self.model, now));
        self.steps.worked(clock::elapsed(started));
        if self.complete_after.is_none() && self.view.is_up_to_date() {
            self.complete_after = Some(clock::elapsed(self.opened));
        }
        if self.steps.is_over() && !self.is_reported {
            self.is_reported = true;
            self.report();
            ui.ctx().send_viewport_cmd(ViewportCommand::Close);
        }
        ui.ctx().request_repaint();
    }
}

impl Bench {
    fn report(&self) {
        if let Some(complete_after) = self.complete_after {
            println!(
                "whole map on the screen after its tiles came: {} ms",
                complete_after.as_millis()
            );
            self.steps.report();
            println!(
                "textures {} MiB; resident memory {} MiB, at most {} MiB",
                self.view.textures(),
                memory_mib("VmRSS:"),
                memory_mib("VmHWM:"),
            );
        }
    }
}

fn main() {
    let started = clock::now();
    let has = |option: &str| std::env::args().any(|argument| argument == option);
    let (robot, model) = great_map(has("--two-layers"));
    println!(
        "{} tiles a layer received, {} MB in the store, in {} ms",
        model.map().store().tile_count(LAYER),
        model.map().store().bytes_held() / 1_000_000,
        clock::elapsed(started).as_millis()
    );
    let options = eframe::NativeOptions {
        viewport: eframe::egui::ViewportBuilder::default().with_inner_size([1280.0, 800.0]),
        glow_options: eframe::egui_glow::GlowConfiguration {
            vsync: false,
            ..eframe::egui_glow::GlowConfiguration::default()
        },
        // Dithering costs time for each pixel on a CPU.
        dithering: !has("--plain"),
        ..eframe::NativeOptions::default()
    };
    let create = move |creation: &eframe::CreationContext<'_>| {
        theme::set(&creation.egui_ctx);
        Ok(Box::new(Bench {
            robot,
            model,
            view: MapView::default(),
            opened: clock::now(),
            complete_after: None,
            steps: Steps::default(),
            is_reported: false,
        }) as Box<dyn eframe::App>)
    };
    eframe::run_native("great map", options, Box::new(create)).unwrap();
}

/// Heights have the most codes of all layers, so the most colours.
const LAYER: LayerId = LayerId::Elevation;
const CELL_M: f64 = 0.1;
/// 10,000 cells.
const SIDE_TILES: i32 = 157;
const BOOT: BootId = BootId([7; 16]);
/// As in the console.
const STORE_MB: u32 = 256;

struct Robot {
    seq: u64,
    /// Of the newest tile that has changed.
    revision: u64,
}

/// Optional layer over the heights: free except for walls.
const OVER: LayerId = LayerId::Obstacle;

/// Heights that vary over metres, with walls.
fn code(layer: LayerId, tile: (i32, i32), (x, y): (usize, usize), turn: usize) -> u16 {
    let whole = |n: usize| i64::try_from(n).unwrap();
    let cx = i64::from(tile.0) * 64 + whole(x);
    let cy = i64::from(tile.1) * 64 + whole(y);
    let east = ((cx + 3 * whole(turn)).rem_euclid(900) - 450).abs();
    let hill = east + (cy.rem_euclid(700) - 350).abs();
    let wall = cx % 97 == 0 || cy % 131 == 0;
    let value = match (layer, wall) {
        (OVER, true) => 1.0,
        (OVER, false) => -1.0,
        (_, _) => 0.004 * hill as f32 + if wall { 1.5 } else { 0.0 },
    };
    layer.quantisation().encode(value)
}

/// The robot and the console with its synchronized map.
fn great_map(has_two_layers: bool) -> (Robot, ConsoleModel) {
    let layers = &[LAYER, OVER][..if has_two_layers { 2 } else { 1 }];
    let tile_store_mb = STORE_MB * u32::from(has_two_layers) + STORE_MB;
    let settings = ModelSettings {
        robot: "great".parse().unwrap(),
        session: BootId([1; 16]),
        tile_store_mb,
        layers: LayerId::ALL.into(),
    };
    let mut model = ConsoleModel::new(settings);
    let mut robot = Robot {
        seq: 0,
        revision: 1_000_000,
    };
    let mut store = TileStore::new(BOOT, tile_store_mb);
    for &layer in layers {
        let cell_m = CELL_M;
        store.set_grid(LayerGrid { layer, cell_m }).unwrap();
    }
    robot.announce(&mut model, &store, layers);
    let info = Info {
        vehicle: "bench".to_owned(),
        source: String::new(),
        footprint_m: [1.2, 0.8],
        limits: [1.0, 0.0, 1.0],
        layers: layers
            .iter()
            .map(|&layer| LayerInfo {
                layer,
                cell_m: CELL_M,
            })
            .collect(),
        ..Info::default()
    };
    let reply = Incoming::Reply {
        request: RequestId(1),
        key: Topic::Info.key(model.robot()),
        payload: wire::encode(&robot.header(), &info).unwrap(),
    };
    model.apply(reply, clock::now());
    for &layer in layers {
        for index in 0..SIDE_TILES * SIDE_TILES {
            let tile = (index % SIDE_TILES, index / SIDE_TILES);
            let revision = u64::from(index.unsigned_abs()) + 1;
            robot.push_tile(&mut model, layer, tile, (revision, 0));
        }
    }
    let middle_m = f64::from(SIDE_TILES) * 32.0 * CELL_M;
    let pose = Pose {
        position_m: [middle_m, middle_m, 0.0],
        quaternion_xyzw: [0.0, 0.0, 0.3, 0.953_94],
        speed_mps: 0.0,
        lateral_mps: 0.0,
        turn_rate_radps: 0.0,
        token: None,
    };
    robot.push(&mut model, Topic::Pose, &pose, clock::now());
    (robot, model)
}

impl Robot {
    fn header(&mut self) -> Header {
        self.seq += 1;
        Header {
            boot: BOOT,
            seq: self.seq,
            robot_time_ns: 0,
        }
    }

    fn push<T: Serialize>(
        &mut self,
        model: &mut ConsoleModel,
        topic: Topic,
        body: &T,
        now: Monotonic,
    ) {
        let sample = Incoming::Sample {
            key: topic.key(model.robot()),
            payload: wire::encode(&self.header(), body).unwrap(),
        };
        model.apply(sample, now);
    }

    fn announce(&mut self, model: &mut ConsoleModel, store: &TileStore, layers: &[LayerId]) {
        let head_of = |&layer: &LayerId| LayerHead {
            layer,
            epoch: 0,
            head_revision: store.head_revision(layer),
            tiles: 0,
            root: store.root_digest(layer).unwrap(),
        };
        let head = MapHead {
            layers: layers.iter().map(head_of).collect(),
        };
        self.push(model, Topic::MapHead, &head, clock::now());
    }

    fn push_tile(
        &mut self,
        model: &mut ConsoleModel,
        layer: LayerId,
        tile: (i32, i32),
        (revision, turn): (u64, usize),
    ) {
        let cells = TileCells::from_fn(|x, y| code(layer, tile, (x, y), turn));
        let check = cells.digest().check();
        let now = clock::now();
        for rows in codec::encode(layer, &cells) {
            let band = TileBand {
                epoch: 0,
                revision,
                base: 0,
                check,
                rows,
            };
            let (tx, ty) = tile;
            let tiles = vec![ChangedTile {
                tx,
                ty,
                older_ns: 0,
                band,
            }];
            self.push(model, Topic::Changes(layer), &Changes { tiles }, now);
        }
    }

    /// Changes the height of all `cells` × `cells` cells around the vehicle, in whole tiles.
    fn change_elevation(&mut self, model: &mut ConsoleModel, cells: i32, turn: usize) {
        let tiles = (cells + 63) / 64;
        let first = (SIDE_TILES - tiles) / 2;
        for index in 0..tiles * tiles {
            let tile = (first + index % tiles, first + index / tiles);
            self.revision += 1;
            self.push_tile(model, LAYER, tile, (self.revision, turn));
        }
    }
}

const FRAMES: usize = 300;
/// A fast drag: at 40 points a frame a screen takes half a second.
const DRAG: f32 = 40.0;
const HOLD: Pos2 = pos2(700.0, 300.0);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Rest,
    PanWhole,
    PanMiddle,
    PanClose,
    PanTurned,
    Zoom,
    Still,
    /// So many cells along an edge, all new.
    Update(i32),
}

/// The last four are the sizes of \[LOD\] table 5.4.
const ORDER: [(Step, &str); 11] = [
    (Step::Rest, "whole map, nothing moves"),
    (Step::PanWhole, "pan, whole map"),
    (Step::PanMiddle, "pan, 1 pixel = 4 cells"),
    (Step::PanClose, "pan, 1 pixel = 1 cell"),
    (Step::PanTurned, "pan, 1 pixel = 1 cell, robot up"),
    (Step::Zoom, "zoom in and out by the wheel"),
    (Step::Still, "elevation 401x401, no change"),
    (Step::Update(41), "elevation 41x41, all new"),
    (Step::Update(101), "elevation 101x101, all new"),
    (Step::Update(201), "elevation 201x201, all new"),
    (Step::Update(401), "elevation 401x401, all new"),
];

#[derive(Default)]
struct Steps {
    step: usize,
    index: usize,
    is_held: bool,
    at: Pos2,
    last_frame: Option<Monotonic>,
    frames: Vec<Vec<Duration>>,
    works: Vec<Vec<Duration>>,
    commands: Vec<Look>,
    seconds: Vec<(Duration, Duration)>,
    began: (Monotonic, Duration),
}

impl Steps {
    fn current(&self) -> Option<Step> {
        ORDER.get(self.step).map(|(step, _)| *step)
    }

    const fn index(&self) -> usize {
        self.index
    }

    const fn is_over(&self) -> bool {
        self.step >= ORDER.len()
    }

    fn take_command(&mut self) -> Option<Look> {
        self.commands.pop()
    }

    /// Records the last frame and adds the events of the next.
    fn next_frame(&mut self, view: &MapView, events: &mut Vec<Event>) {
        let now = clock::now();
        let Some(step) = self.current() else { return };
        if self.frames.len() <= self.step {
            self.frames.push(Vec::new());
            self.works.push(Vec::new());
            self.began = (now, process_cpu());
            self.begin(step, view);
        } else if let Some(last) = self.last_frame {
            self.frames[self.step].push(now.since(last));
        }
        self.last_frame = Some(now);
        // Ignore a real pointer.
        events.retain(|event| !matches!(event, Event::PointerMoved(_) | Event::PointerGone));
        match step {
            Step::PanWhole | Step::PanMiddle | Step::PanClose | Step::PanTurned => {
                self.drag(events);
            }
            Step::Zoom => {
                let is_in = self.index % 100 < 50;
                events.push(Event::PointerMoved(HOLD));
                events.push(Event::MouseWheel {
                    unit: MouseWheelUnit::Line,
                    delta: vec2(0.0, if is_in { 1.0 } else { -1.0 }),
                    phase: TouchPhase::Move,
                    source: MouseWheelSource::Wheel,
                    modifiers: Modifiers::NONE,
                });
            }
            Step::Rest | Step::Still | Step::Update(_) => {}
        }
        self.index += 1;
        if self.index >= FRAMES {
            let (since, cpu) = self.began;
            self.seconds
                .push((now.since(since), process_cpu().saturating_sub(cpu)));
            self.release(events);
            self.index = 0;
            self.step += 1;
        }
    }

    /// Main thread time of the map view and its panel in this frame.
    fn worked(&mut self, time: Duration) {
        if let Some(works) = self.works.last_mut() {
            works.push(time);
        }
    }

    fn begin(&mut self, step: Step, view: &MapView) {
        let [low_x, _, high_x, _] = view.visible_m();
        let points_per_cell = 0.1 * 990.0 / (high_x - low_x);
        // As many steps of 1.4 as needed, in one frame that is not counted.
        let mut zoom = |points: f64| {
            let steps = libm::log(points / points_per_cell) / libm::log(1.4);
            let look = if steps > 0.0 { Look::In } else { Look::Out };
            for _ in 0..steps.abs().round() as usize {
                self.commands.push(look);
            }
        };
        match step {
            Step::PanMiddle => zoom(0.25),
            Step::PanClose => zoom(1.0),
            Step::PanTurned => self.commands.push(Look::Up(Orientation::RobotUp)),
            Step::Zoom => {
                self.commands.push(Look::Up(Orientation::NorthUp));
                self.commands.push(Look::Whole);
            }
            Step::Still => {
                zoom(1.0);
                self.commands.push(Look::Follow(true));
            }
            Step::Rest | Step::PanWhole | Step::Update(_) => {}
        }
    }

    /// Drags the map to and fro, released and grabbed again at the edge of the screen.
    fn drag(&mut self, events: &mut Vec<Event>) {
        if !self.is_held {
            self.at = HOLD;
            self.is_held = true;
            events.push(Event::PointerMoved(self.at));
            events.push(button(self.at, true));
            return;
        }
        let towards = if self.index % 120 < 60 { -1.0 } else { 1.0 };
        self.at += vec2(towards * DRAG, 0.4 * towards * DRAG);
        events.push(Event::PointerMoved(self.at));
        if !(320.0..1240.0).contains(&self.at.x) || !(20.0..780.0).contains(&self.at.y) {
            self.release(events);
        }
    }

    fn release(&mut self, events: &mut Vec<Event>) {
        if std::mem::take(&mut self.is_held) {
            events.push(button(self.at, false));
        }
    }

    fn report(&self) {
        println!(
            "| step | frames | p50 ms | p99 ms | max ms | map view p50 ms | p99 ms | CPU of all threads |"
        );
        println!("| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |");
        for (index, (_, name)) in ORDER.iter().enumerate().take(self.seconds.len()) {
            let mut frames = self.frames[index].clone();
            let mut works = self.works[index].clone();
            frames.sort_unstable();
            works.sort_unstable();
            let ms = |times: &[Duration], part: f64| {
                let at = ((times.len() - 1) as f64 * part).round() as usize;
                times[at].as_secs_f64() * 1e3
            };
            let (wall, cpu) = self.seconds[index];
            println!(
                "| {name} | {} | {:.1} | {:.1} | {:.1} | {:.2} | {:.2} | {:.0} % |",
                frames.len(),
                ms(&frames, 0.5),
                ms(&frames, 0.99),
                ms(&frames, 1.0),
                ms(&works, 0.5),
                ms(&works, 0.99),
                100.0 * cpu.as_secs_f64() / wall.as_secs_f64()
            );
        }
    }
}

const fn button(pos: Pos2, pressed: bool) -> Event {
    Event::PointerButton {
        pos,
        button: PointerButton::Primary,
        pressed,
        modifiers: Modifiers::NONE,
    }
}

/// CPU time of all threads, hundredths of a second.
fn process_cpu() -> Duration {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat.rsplit(')').next().unwrap_or_default();
    let ticks = fields.split_whitespace().skip(11).take(2);
    let ticks: u64 = ticks.filter_map(|ticks| ticks.parse::<u64>().ok()).sum();
    Duration::from_millis(10 * ticks)
}

/// A line of `/proc/self/status`.
fn memory_mib(name: &str) -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with(name));
    let kib = line.and_then(|line| line.split_whitespace().nth(1)?.parse::<u64>().ok());
    kib.unwrap_or(0) / 1024
}
