mod controls;
mod display;

use std::time::Duration;

use eframe::egui::accesskit::Role;
use eframe::egui::{self, Color32, Key, Modifiers, Vec2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT as _, Queryable};
use measurement::time::RobotDuration;
use protocol::keys::{RobotId, Topic};
use protocol::layer::LayerId;
use protocol::message::{
    Digests, DockingSite, DropCount, Event, Info, LayerInfo, Pose, Severity, ShoreClass,
    ShoreCluster, Shores, ShoresReply, Status, TileSummary,
};
use protocol::tile::{TileCells, TileKey};
use protocol::tile_store::{LayerGrid, TileStore};
use serde::Serialize;

use super::*;
use crate::alerts::{AlertSource, FleetAlerts};
use crate::app::ExportProgress;
use crate::command::Look;
use crate::export::ExportPart;
use crate::link::{DiscoveredRobot, FoundRobot};
use crate::map_view::{CameraMode, LayerCommand, Orientation, Overlay, ShoreMark};
use crate::model::{LinkState, OpenSessions, Outgoing, RequestId};
use crate::panels::robots::{RobotEntry, SearchTarget};
use crate::playback::PlaybackCommand;
use crate::test_support::{
    BOOT, announce_map, at, console, inject, inject_reply, push_tile, status_of,
};

const LAYER: LayerId = LayerId::Occupancy;

fn name() -> RobotId {
    "scout-1".parse().unwrap()
}

struct Rig {
    screen: Screen,
    model: Option<ConsoleModel>,
    link: LinkStatus,
    teleop_client: Option<TeleopClientState>,
    robots: RobotsData,
    log: EventLog,
    alerts: FleetAlerts,
    export: Option<ExportProgress>,
    now: Monotonic,
    store: TileStore,
    commands: Vec<Command>,
    theme_is_set: bool,
}

impl Rig {
    fn new() -> Self {
        let mut store = TileStore::new(BOOT, 10);
        for layer in [LAYER, LayerId::Elevation] {
            store.set_grid(LayerGrid { layer, cell_m: 0.1 }).unwrap();
        }
        let mut alerts = FleetAlerts::default();
        alerts.change_to(&name(), at(0));
        Self {
            screen: Screen::default(),
            model: None,
            link: LinkStatus::default(),
            teleop_client: None,
            robots: RobotsData::new(&[], None, SearchTarget::Any, None, at(1_000)),
            log: EventLog::default(),
            alerts,
            export: None,
            now: at(1_000),
            store,
            commands: Vec::new(),
            theme_is_set: false,
        }
    }

    fn with_robot() -> Self {
        Self {
            model: Some(console(name().as_str(), &[LAYER])),
            robots: RobotsData::new(
                &[],
                Some((&name(), LinkState::Live)),
                SearchTarget::Any,
                None,
                at(1_000),
            ),
            ..Self::new()
        }
    }

    fn live() -> Self {
        let mut rig = Self::with_robot();
        let layer = |layer| LayerInfo { layer, cell_m: 0.1 };
        let info = Info {
            vehicle: "rover".to_owned(),
            source: "world rooms".to_owned(),
            footprint_m: [0.6, 0.4],
            limits: [1.0, 0.0, 1.0],
            layers: vec![layer(LAYER), layer(LayerId::Elevation)],
            ..Info::default()
        };
        rig.announce();
        rig.answer(RequestId(900), Topic::Info, &info);
        rig.announce();
        rig.stand();
        rig
    }

    /// The same, ready to be driven by Anna.
    fn drivable() -> Self {
        let mut rig = Self::live();
        rig.teleop_client = Some(crate::test_support::idle_teleop_client());
        let status = status_of(crate::test_support::idle_teleop_status());
        rig.say(Topic::Status, &status);
        rig
    }

    fn on_water(shores: Option<Shores>) -> Self {
        let mut rig = Self::with_robot();
        let info = Info {
            vehicle: "boat".to_owned(),
            source: String::new(),
            footprint_m: [3.0, 1.6],
            limits: [1.0, 0.0, 1.0],
            layers: vec![LayerInfo {
                layer: LayerId::Shore,
                cell_m: 0.3,
            }],
            ..Info::default()
        };
        rig.announce();
        rig.answer(RequestId(900), Topic::Info, &info);
        rig.stand();
        if let Some(shores) = shores {
            let shores_news = ShoresReply {
                revision: 1,
                shores: Some(shores),
            };
            rig.say(Topic::Shores, &shores_news);
        }
        rig
    }

    fn stand(&mut self) {
        self.say(
            Topic::Pose,
            &Pose {
                position_m: [1.0, -2.5, 0.0],
                quaternion_xyzw: [0.0, 0.0, 0.0, 1.0],
                speed_mps: 0.55,
                lateral_mps: 0.0,
                turn_rate_radps: 0.0,
                token: None,
            },
        );
    }

    fn put(&mut self, tx: i32, ty: i32, code: u16) -> TileKey {
        let key = TileKey {
            layer: LAYER,
            tx,
            ty,
        };
        let cells = TileCells::from_fn(|_, _| code);
        drop(self.store.publish(key, cells).unwrap());
        key
    }

    fn push(&mut self, key: TileKey) {
        let model = self.model.as_mut().unwrap();
        push_tile(model, &self.store, key, self.now);
    }

    fn announce(&mut self) {
        announce_map(self.model.as_mut().unwrap(), &self.store, self.now);
    }

    fn say<T: Serialize>(&mut self, topic: Topic, body: &T) {
        inject(self.model.as_mut().unwrap(), topic, body, self.now);
    }

    fn answer<T: Serialize>(&mut self, request: RequestId, topic: Topic, body: &T) {
        let model = self.model.as_mut().unwrap();
        inject_reply(model, request, topic, body, self.now);
    }

    fn outgoing(&mut self) -> Vec<Outgoing> {
        let now = self.now;
        self.model
            .as_mut()
            .unwrap()
            .outgoing(OpenSessions::BOTH, now)
    }

    fn window(self) -> Harness<'static, Self> {
        self.window_of([1280.0, 800.0])
    }

    fn window_of(self, size: [f32; 2]) -> Harness<'static, Self> {
        let mut harness = Harness::builder()
            .with_size(Vec2::from(size))
            .build_ui_state(
                |ui, rig: &mut Self| {
                    if !rig.theme_is_set {
                        crate::theme::set(ui.ctx());
                        ui.ctx()
                            .options_mut(|options| options.zoom_with_keyboard = false);
                        rig.theme_is_set = true;
                    }
                    if let Some(model) = &rig.model {
                        let new_events =
                            rig.log.add_robot_events(model, name().as_str(), rig.now, 0);
                        let alerts = rig.alerts.shown_mut().unwrap();
                        alerts.update(model, AlertSource::Robot, &new_events, rig.now);
                    }
                    let robot = rig.model.as_mut().map(|model| ShownRobot {
                        model,
                        link: &rig.link,
                        teleop_client: rig.teleop_client.as_ref(),
                        color: Color32::BLUE,
                    });
                    let context = ScreenContext {
                        robots: &rig.robots,
                        log: &rig.log,
                        alerts: &rig.alerts,
                        export: rig.export.as_ref(),
                    };
                    rig.screen.begin_frame(ui.ctx());
                    let commands = rig.screen.show(ui, context, robot, rig.now);
                    rig.commands.extend(commands);
                },
                self,
            );
        harness.run_steps(4);
        harness
    }
}

fn asked(window: &mut Harness<'_, Rig>) -> Vec<Command> {
    std::mem::take(&mut window.state_mut().commands)
}

fn check(harness: &Harness<'_, Rig>, labels: &[&str], absent: &[&str]) {
    for label in labels {
        let found = harness.query_all_by_label_contains(label).next();
        assert!(found.is_some(), "{label:?} is not on the screen");
    }
    for label in absent {
        let found = harness.query_all_by_label_contains(label).next();
        assert!(found.is_none(), "{label:?} is on the screen");
    }
}
