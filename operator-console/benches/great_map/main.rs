//! The map view with a map of 10,000 × 10,000 cells, in a real window that is moved by events: a table.
//!
//! `cargo bench -p operator-console` on a screen, or under Xvfb; with `-- --two-layers` obstacles lie over the heights.
//! Frames are counted from one to the next, so they hold everything: input, layout, textures, painting, and the graphics
//! driver.
#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "a benchmark prints its table, and has nobody to hand errors to"
)]

mod map;
mod steps;

use std::time::Duration;

use eframe::egui::{CentralPanel, Context, Panel, RawInput, ScrollArea, Ui, ViewportCommand};
use measurement::time::Monotonic;
use operator_console::map_view::MapView;
use operator_console::model::ConsoleModel;
use operator_console::panels::connection::LinkStatus;
use operator_console::panels::layers::{LayersData, layers_ui};
use operator_console::theme;
use robot_edge::clock;

use map::Robot;
use steps::{Step, Steps};

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
        if self.steps.current() == Some(Step::Update) {
            self.robot
                .change_elevation(&mut self.model, self.steps.index(), now);
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
                steps::memory_mib("VmRSS:"),
                steps::memory_mib("VmHWM:"),
            );
        }
    }
}

fn main() {
    let started = clock::now();
    let has = |option: &str| std::env::args().any(|argument| argument == option);
    let (robot, model) = map::great_map(has("--two-layers"));
    println!(
        "{} tiles a layer received, {} MB in the store, in {} ms",
        model.map().store().tile_count(map::LAYER),
        model.map().store().bytes_held() / 1_000_000,
        clock::elapsed(started).as_millis()
    );
    let options = eframe::NativeOptions {
        viewport: eframe::egui::ViewportBuilder::default().with_inner_size([1280.0, 800.0]),
        glow_options: eframe::egui_glow::GlowConfiguration {
            vsync: false,
            ..eframe::egui_glow::GlowConfiguration::default()
        },
        // Dithering is worked out for every pixel, which counts where a CPU does it.
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
