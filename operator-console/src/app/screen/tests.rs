use std::time::Duration;

use eframe::egui::accesskit::Role;
use eframe::egui::{self, Color32, Key, Modifiers, Vec2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT as _, Queryable};
use protocol::keys::{RobotId, Topic};
use protocol::layer::LayerId;
use protocol::message::{
    Digests, DockingSite, Event, Info, LayerHead, LayerInfo, MapHead, Pose, Reason, Severity,
    ShoreClass, ShoreCluster, Shores, ShoresNews, Status, TileBand, TileSummary,
};
use protocol::tile::codec::Encoder;
use protocol::tile::{TileCells, TileKey};
use protocol::tile_store::{LayerGrid, TileStore};
use robot_edge::robot_time::RobotDuration;
use serde::Serialize;

use super::*;
use crate::alerts::Subject;
use crate::command::Look;
use crate::export::ExportPart;
use crate::link::{FoundRobot, Sighting};
use crate::map_view::{LayerCommand, Orientation, Overlay, ShoreMark, Sight};
use crate::model::{LinkState, OpenSessions, Outgoing, RequestId};
use crate::panels::robots::Sought;
use crate::playback::PlaybackCommand;
use crate::pretend::{BOOT, answers, at, console, says};

const LAYER: LayerId = LayerId::Occupancy;

fn name() -> RobotId {
    "scout-1".parse().unwrap()
}

/// A robot whose map is `store`, and a console that hears what the test lets it hear.
struct Rig {
    screen: Screen,
    model: Option<ConsoleModel>,
    link: LinkSight,
    helm: Option<HelmSight>,
    robots: RobotsData,
    log: EventLog,
    alerts: Alerts,
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
        Self {
            screen: Screen::default(),
            model: None,
            link: LinkSight::default(),
            helm: None,
            robots: RobotsData::new(&[], None, Sought::Any, None, at(1_000)),
            log: EventLog::default(),
            alerts: Alerts::default(),
            now: at(1_000),
            store,
            commands: Vec::new(),
            theme_is_set: false,
        }
    }

    /// A robot is chosen, and nothing is heard of it.
    fn with_robot() -> Self {
        Self {
            model: Some(console(name().as_str(), &[LAYER])),
            robots: RobotsData::new(
                &[],
                Some((&name(), LinkState::Live)),
                Sought::Any,
                None,
                at(1_000),
            ),
            ..Self::new()
        }
    }

    /// A robot that is heard and has announced its map.
    fn live() -> Self {
        let mut rig = Self::with_robot();
        let layer = |layer| LayerInfo { layer, cell_m: 0.1 };
        let info = Info {
            vehicle: "rover".to_owned(),
            source: "world rooms".to_owned(),
            footprint_m: [0.6, 0.4],
            limits: [1.0, 1.0],
            layers: vec![layer(LAYER), layer(LayerId::Elevation)],
            ..Info::default()
        };
        rig.announce();
        rig.answer(RequestId(900), Topic::Info, &info);
        rig.announce();
        rig.stand();
        rig
    }

    /// A robot that is heard and tells of these shores, if of any.
    fn on_water(shores: Option<Shores>) -> Self {
        let mut rig = Self::with_robot();
        let info = Info {
            vehicle: "boat".to_owned(),
            source: String::new(),
            footprint_m: [3.0, 1.6],
            limits: [1.0, 1.0],
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
            let news = ShoresNews {
                revision: 1,
                shores: Some(shores),
            };
            rig.say(Topic::Shores, &news);
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
        let tile = self.store.tile(key).unwrap();
        for rows in Encoder::new().unwrap().encode(&tile.cells) {
            let band = TileBand {
                epoch: tile.epoch,
                revision: tile.revision,
                digest: tile.digest,
                rows,
            };
            self.say(Topic::Tile(key), &band);
        }
    }

    fn announce(&mut self) {
        let head = |layer| LayerHead {
            layer,
            epoch: 0,
            head_revision: self.store.head_revision(layer),
            tiles: self.store.tile_count(layer) as u32,
            root: self.store.root_digest(layer).unwrap(),
        };
        let layers = vec![head(LAYER), head(LayerId::Elevation)];
        self.say(Topic::MapHead, &MapHead { layers });
    }

    fn say<T: Serialize>(&mut self, topic: Topic, body: &T) {
        says(self.model.as_mut().unwrap(), topic, body, self.now);
    }

    fn answer<T: Serialize>(&mut self, request: RequestId, topic: Topic, body: &T) {
        let model = self.model.as_mut().unwrap();
        answers(model, request, topic, body, self.now);
    }

    /// What the console asks now.
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
                        let news = rig.log.hear(model, rig.now, 0);
                        rig.alerts.look(model, Subject::Robot, &news, rig.now);
                    }
                    let robot = rig.model.as_mut().map(|model| RobotSight {
                        model,
                        link: &rig.link,
                        helm: rig.helm.as_ref(),
                        color: Color32::BLUE,
                    });
                    let around = Around {
                        robots: &rig.robots,
                        log: &rig.log,
                        alerts: &rig.alerts,
                        export: None,
                    };
                    rig.screen.begin_frame(ui.ctx());
                    let commands = rig.screen.show(ui, around, robot, rig.now);
                    rig.commands.extend(commands);
                },
                self,
            );
        harness.run_steps(4);
        harness
    }
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

#[test]
fn without_a_robot_the_screen_says_how_to_get_one() {
    let rig = Rig::new();
    check(
        &rig.window(),
        &[
            "Looking for robots",
            "No robot found on this network yet.",
            "operator-console --demo lake",
            "Type an address",
            "Open recording…",
        ],
        &["Live", "In step", "Whole map"],
    );
}

#[test]
fn a_demonstration_that_starts_asks_for_nothing() {
    let mut rig = Rig::new();
    let robots = |failure| RobotsData::new(&[], None, Sought::Demo { failure }, None, at(1_000));
    rig.robots = robots(None);
    check(
        &rig.window(),
        &["Starting the demo…"],
        &["Looking for", "To begin", "--demo"],
    );
    let mut rig = Rig::new();
    rig.robots = robots(Some("the port is taken".to_owned()));
    check(
        &rig.window(),
        &["The demo has ended", "the port is taken", "To begin"],
        &["Starting the demo…"],
    );
}

#[test]
fn an_address_that_is_typed_fast_is_taken_whole() {
    let mut window = Rig::new().window();
    for address in ["tcp/10.0.0.5:7447", "tcp/10.0.0.6:7447"] {
        let enter = [true, false].map(|pressed| egui::Event::Key {
            key: Key::Enter,
            physical_key: None,
            pressed,
            repeat: false,
            modifiers: Modifiers::NONE,
        });
        // All of it in one frame, as on a machine that takes its time.
        window.key_press_modifiers(Modifiers::COMMAND, Key::L);
        window.event(egui::Event::Text(address.to_owned()));
        for event in enter {
            window.event(event);
        }
        window.run_steps(6);
        let commands = std::mem::take(&mut window.state_mut().commands);
        assert_eq!(commands, [Command::AddAddress(address.to_owned())]);
    }
    // What was refused stays to be mended, and gives way to what is typed from the start.
    for (typed, refused) in [("nowhere", true), ("tcp/boat:9", false)] {
        window.key_press_modifiers(Modifiers::COMMAND, Key::L);
        window.run_steps(4);
        window.event(egui::Event::Text(typed.to_owned()));
        window.key_press(Key::Enter);
        window.run_steps(4);
        let commands = std::mem::take(&mut window.state_mut().commands);
        assert_eq!(commands.is_empty(), refused, "{commands:?}");
    }
}

#[test]
fn a_robot_that_has_not_spoken_is_waited_for() {
    let mut rig = Rig::with_robot();
    check(
        &rig.window(),
        &["scout-1", "Waiting", "Connecting to scout-1.", "No map yet"],
        &["Live", "Link lost"],
    );
    rig = Rig::with_robot();
    rig.link.is_connected = true;
    check(
        &rig.window(),
        &["Connected. Waiting for scout-1 to speak."],
        &["Live"],
    );
    rig = Rig::with_robot();
    rig.link.problem = Some("nobody listens at tcp/10.0.0.5:7447".to_owned());
    check(&rig.window(), &["nobody listens at tcp/10.0.0.5:7447"], &[]);
}

#[test]
fn a_live_robot_in_step_is_shown_with_its_figures() {
    let mut rig = Rig::live();
    let key = rig.put(0, 0, 251);
    rig.push(key);
    rig.announce();
    rig.outgoing();
    let status = Status {
        scans_in: 1_200,
        scans_mapped: 1_190,
        drops: vec![Reason {
            name: "no_pose".to_owned(),
            count: 10,
        }],
        ..Status::default()
    };
    rig.say(Topic::Status, &status);
    let event = Event {
        kind: "pose_jump".to_owned(),
        severity: Severity::Warning,
        message: "The pose jumped 3 m".to_owned(),
    };
    rig.say(Topic::Event, &event);
    let mut window = rig.window();
    check(
        &window,
        &[
            "Live",
            "In step",
            "0.0 s old",
            "rover",
            "world rooms",
            "x 1.00  y −2.50 m",
            "0.55 m/s",
            "1\u{2009}190 of 1\u{2009}200 mapped",
            "1 tile, ",
            "Probability of being occupied",
            "Occupancy",
            "Elevation",
        ],
        &["Link lost", "Silent", "missing"],
    );
    window.get_by_label("Losses").click();
    window.run_steps(4);
    check(&window, &["no pose"], &["The pose jumped 3 m"]);
    window.get_by_label("Events").click();
    window.run_steps(4);
    check(
        &window,
        &["robot: pose jump", "The pose jumped 3 m"],
        &["no pose"],
    );
    window.get_by_label("1 alert").click();
    window.run_steps(4);
    check(
        &window,
        &["0.0 s ago, over", "Acknowledge"],
        &["robot: pose jump"],
    );
}

#[test]
fn a_map_that_is_behind_says_how_many_tiles_are_missing() {
    let mut rig = Rig::live();
    rig.outgoing();
    let keys = [rig.put(0, 0, 251), rig.put(1, 0, 1), rig.put(-1, 0, 1)];
    rig.announce();
    for ms in (1_000..9_000).step_by(500) {
        rig.now = at(ms);
        rig.announce();
        let list = rig
            .outgoing()
            .into_iter()
            .find_map(|outgoing| match outgoing {
                Outgoing::Get { request, key, .. } if key.ends_with("/digests") => Some(request),
                Outgoing::Get { .. } | Outgoing::Put { .. } => None,
            });
        if let Some(request) = list {
            let tiles = keys.map(|key| {
                let stored = rig.store.get(key).unwrap();
                TileSummary {
                    tx: key.tx,
                    ty: key.ty,
                    revision: stored.revision(),
                    digest: stored.digest(),
                }
            });
            let digests = Digests {
                epoch: 0,
                head_revision: 3,
                tiles: tiles.to_vec(),
                more: 0,
            };
            rig.answer(request, Topic::Digests(LAYER), &digests);
            break;
        }
    }
    check(&rig.window(), &["Live", "3 tiles missing"], &["In step"]);
}

#[test]
fn a_silent_robot_is_never_taken_for_a_live_one() {
    let mut rig = Rig::live();
    let key = rig.put(0, 0, 251);
    rig.push(key);
    rig.announce();
    rig.outgoing();
    rig.now = at(13_000);
    check(
        &rig.window(),
        &[
            "Silent",
            "Link lost: nothing heard for 12 s",
            "What is shown is old.",
            "Was in step when last heard",
            "As of 12 s ago",
            "12 s old",
            "scout-1 does not answer.",
        ],
        &["Live"],
    );
}

#[test]
fn an_old_position_is_said_to_be_old_although_the_robot_is_heard() {
    let mut rig = Rig::live();
    rig.now = at(6_000);
    rig.announce();
    check(
        &rig.window(),
        &["Live", "Position is 5.0 s old"],
        &["Link lost"],
    );
}

#[test]
fn buttons_keys_and_hands_move_the_map() {
    let mut window = Rig::live().window();
    assert_eq!(window.state().screen.map_view().sight(), Sight::Whole);
    window.get_by_label("Follow").click();
    window.run_steps(2);
    let asked = std::mem::take(&mut window.state_mut().commands);
    assert_eq!(asked, [Command::Look(Look::Follow(true))]);
    window
        .state_mut()
        .screen
        .map_view_mut()
        .look(Look::Follow(true));
    window.run_steps(2);
    let seen = |window: &Harness<'_, Rig>| window.state().screen.map_view().visible_m();
    let [low_x, low_y, high_x, high_y] = seen(&window);
    assert!((0.5 * (low_x + high_x) - 1.0).abs() < 1e-6);
    assert!((0.5 * (low_y + high_y) + 2.5).abs() < 1e-6);

    let middle = window.state().screen.map_view().place().center();
    let beside = middle + vec2(100.0, 0.0);
    window.drag_at(middle);
    window.run_steps(1);
    window.hover_at(beside);
    window.run_steps(1);
    window.drop_at(beside);
    window.run_steps(1);
    assert_eq!(window.state().screen.map_view().sight(), Sight::Free);
    assert!(seen(&window)[0] < low_x - 0.5, "{:?}", seen(&window));

    for (key, look) in [
        (Key::F, Look::Whole),
        (Key::V, Look::Follow(true)),
        (Key::Plus, Look::In),
        (Key::Minus, Look::Out),
        (Key::N, Look::Up(Orientation::RobotUp)),
        (Key::G, Look::Draw(Overlay::Grid, true)),
        (Key::L, Look::Draw(Overlay::Legend, false)),
        (Key::M, Look::Measure(true)),
        (Key::C, Look::Point),
        (Key::Backspace, Look::TakeBack),
    ] {
        window.key_press(key);
        window.run_steps(1);
        let asked = std::mem::take(&mut window.state_mut().commands);
        assert_eq!(asked, [Command::Look(look)], "{key:?}");
    }
}

#[test]
fn a_recording_has_keys_a_name_and_no_link() {
    let mut rig = Rig::live();
    rig.link.recording = Some("rooms.mcap".to_owned());
    let mut window = rig.window();
    check(
        &window,
        &["rooms.mcap", "a recording has no link"],
        &["scout-1", "Round trip", "0.0 s old"],
    );
    let step = |s: i64| PlaybackCommand::Step(RobotDuration::from_millis(1000 * s));
    for (modifiers, key, asked) in [
        (Modifiers::NONE, Key::P, PlaybackCommand::PlayOrPause),
        (Modifiers::NONE, Key::Comma, step(-1)),
        (Modifiers::NONE, Key::Period, step(1)),
        (Modifiers::SHIFT, Key::Comma, step(-10)),
        (Modifiers::SHIFT, Key::Period, step(10)),
        (Modifiers::NONE, Key::OpenBracket, PlaybackCommand::Slower),
        (Modifiers::NONE, Key::CloseBracket, PlaybackCommand::Faster),
        (Modifiers::NONE, Key::R, PlaybackCommand::ToggleLooping),
    ] {
        window.key_press_modifiers(modifiers, key);
        window.run_steps(1);
        let commands = std::mem::take(&mut window.state_mut().commands);
        assert_eq!(commands, [Command::Playback(asked)], "{key:?}");
    }
    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    window.run_steps(4);
    let folder = window.get_by_role_and_label(Role::TextInput, "Folder");
    assert!(folder.value().unwrap().contains("foreshore-rooms-2"));
    // The keyboard is left in a frame in which text may have been typed before.
    let press = |key| egui::Event::Key {
        key,
        physical_key: None,
        pressed: true,
        repeat: false,
        modifiers: Modifiers::NONE,
    };
    let pressed = [Key::P, Key::Escape, Key::R].map(press);
    window.input_mut().events.extend(pressed);
    window.run_steps(4);
    assert_eq!(window.state().commands, []);
}

#[test]
fn the_map_says_what_is_under_the_pointer() {
    let mut rig = Rig::live();
    let key = rig.put(0, 0, 226);
    rig.push(key);
    let mut window = rig.window();
    check(&window, &[], &["laser, log-odds"]);
    let [low_x, _, high_x, _] = window.state().screen.map_view().visible_m();
    window.state_mut().now = at(4_000);
    let on_the_tile = window.state().screen.map_view().place_of([3.2, 3.2]);
    window.hover_at(on_the_tile);
    window.run_steps(4);
    check(&window, &["3.0 s old, laser, log-odds"], &[]);
    check(&window, &["0.90"], &[]);
    assert!(low_x < 0.0 && high_x > 6.4);
    window.remove_cursor();
    window.run_steps(1);
    check(&window, &[], &["laser, log-odds"]);
}

#[test]
fn the_operator_chooses_robots_addresses_and_layers() {
    let found = |robot: &str| FoundRobot {
        robot: robot.parse().unwrap(),
        endpoint: format!("tcp/{robot}:7447"),
    };
    let mut rig = Rig::live();
    let seen = |robot: &str| {
        let sighting = Sighting {
            found: found(robot),
            seen: at(1_000),
            state: None,
        };
        (sighting, Color32::RED)
    };
    rig.robots = RobotsData::new(
        &[seen("scout-1"), seen("boat-7")],
        Some((&name(), LinkState::Live)),
        Sought::Any,
        None,
        at(1_000),
    );
    let mut window = rig.window();
    window.get_by_label("Robots").click();
    window.run_steps(4);
    window.get_by_label("boat-7").click();
    window.run_steps(2);
    window.get_by_label("Elevation").click();
    window.run_steps(2);
    let asked = std::mem::take(&mut window.state_mut().commands);
    assert_eq!(
        asked,
        [
            Command::Connect(found("boat-7")),
            Command::Layer(LayerCommand::Show(LayerId::Elevation, false))
        ]
    );
    // By its number in the list, too; the one that is shown already is not asked for.
    for key in [Key::Num1, Key::Num2] {
        window.key_press_modifiers(Modifiers::COMMAND, key);
        window.run_steps(1);
    }
    let asked = std::mem::take(&mut window.state_mut().commands);
    assert_eq!(asked, [Command::Connect(found("boat-7"))]);
    window.key_press_modifiers(Modifiers::COMMAND, Key::L);
    window.run_steps(3);
    let entry = window.get_by_role_and_label(Role::TextInput, "Address");
    assert!(entry.is_focused(), "Ctrl+L");
    entry.type_text("10.0.0.5");
    window.run_steps(2);
    window.get_by_label("Add").click();
    window.run_steps(2);
    check(&window, &["for example tcp/192.168.1.20:7447"], &[]);
    let entry = window.get_by_role_and_label(Role::TextInput, "Address");
    entry.focus();
    entry.type_text(":7447");
    window.run_steps(2);
    window.get_by_label("Add").click();
    window.run_steps(2);
    let asked = std::mem::take(&mut window.state_mut().commands);
    assert_eq!(asked, [Command::AddAddress("tcp/10.0.0.5:7447".to_owned())]);
}

#[test]
fn another_robot_begins_with_an_empty_map() {
    let mut rig = Rig::live();
    let key = rig.put(0, 0, 251);
    rig.push(key);
    let mut window = rig.window();
    check(&window, &["1 tile, "], &[]);
    let is_fitted =
        |window: &Harness<'_, Rig>| window.state().screen.map_view().sight() == Sight::Whole;
    window
        .state_mut()
        .screen
        .map_view_mut()
        .look(Look::Follow(false));
    assert!(!is_fitted(&window));
    let next = Rig::with_robot();
    window.state_mut().model = next.model;
    window.state_mut().screen.map_view_mut().forget();
    window.run_steps(2);
    check(&window, &["Waiting", "Not described yet"], &["1 tile"]);
    assert!(is_fitted(&window));
    // Once its animations are over, nothing wakes the window but the ages it shows.
    window.run_steps(60);
    let delay = window
        .output()
        .viewport_output
        .values()
        .map(|output| output.repaint_delay);
    assert!(delay.min().unwrap() >= Duration::from_millis(100));
}

fn shore(number: u32, class: ShoreClass, rigid_voxels: u32, center_m: [f32; 2]) -> ShoreCluster {
    ShoreCluster {
        number,
        class,
        voxels: 1_200,
        rigid_voxels,
        center_m,
        outline: Vec::new(),
    }
}

#[test]
fn shores_are_listed_and_a_click_shows_where_they_are() {
    // The boat is at (1, −2.5).
    let clusters = vec![
        shore(12, ShoreClass::Solid, 1_100, [61.0, 77.5]),
        shore(7, ShoreClass::Dense, 492, [4.0, 1.5]),
    ];
    let site = |x_m, mean_cost| DockingSite {
        center_m: [x_m, -2.5],
        heading_rad: 0.0,
        width_m: 6.25,
        mean_cost,
    };
    let sites = vec![site(13.0, 0.2), site(-19.0, 0.31)];
    let mut shores = Shores::gather(0.3, None, clusters, sites);
    shores.clusters_left_out = 3;
    let mut window = Rig::on_water(Some(shores)).window();
    window.get_by_label("Shores").click();
    window.run_steps(4);
    check(
        &window,
        &[
            "Shores",
            "Shore 7, dense, 41 % rigid, 1\u{2009}200 voxels, 5.0 m away",
            "Shore 12, solid, 92 % rigid, 1\u{2009}200 voxels, 100 m away",
            "Docking site A, cost 0.20, 6.2 m wide, 12 m away",
            "Docking site B, cost 0.31, 6.2 m wide, 20 m away",
            // On the map.
            "Shores 1, 2 …; docking sites A, B …",
            "3 smaller shores are not listed.",
        ],
        &["worse docking sites", "Nothing was heard"],
    );
    window.get_by_label_contains("Docking site B").click();
    window.run_steps(2);
    let asked = std::mem::take(&mut window.state_mut().commands);
    let second = window.state().model.as_ref().unwrap().site_names()[1];
    let mark = Look::Mark(ShoreMark::Site(second), [-19.0, -2.5]);
    assert!(asked.contains(&Command::Look(mark)), "{asked:?}");
    let map_view = window.state_mut().screen.map_view_mut();
    map_view.look(mark);
    window.run_steps(1);
    let map_view = window.state().screen.map_view();
    let [low_x, low_y, high_x, high_y] = map_view.visible_m();
    assert_eq!(map_view.sight(), Sight::Free);
    assert!((0.5 * (low_x + high_x) + 19.0).abs() < 1e-3);
    assert!((0.5 * (low_y + high_y) + 2.5).abs() < 1e-3);
}

#[test]
fn shores_that_are_not_known_yet_are_said_not_to_be() {
    let shores = |shores| {
        let mut window = Rig::on_water(shores).window();
        window.get_by_label("Shores").click();
        window.run_steps(4);
        window
    };
    check(
        &shores(None),
        &["Nothing was heard of shores yet."],
        &["No shore in sight."],
    );
    check(
        &shores(Some(Shores::default())),
        &["No shore in sight."],
        &["Nothing was heard of shores yet."],
    );
    check(&Rig::live().window(), &["Live"], &["Shores"]);
}

/// What a screen reader and a test find: the names of all that can be pressed, chosen or typed into, and those without.
fn controls(window: &Harness<'_, Rig>) -> (Vec<String>, Vec<String>) {
    let mut named = Vec::new();
    let mut unnamed = Vec::new();
    let mut waiting = vec![window.root()];
    while let Some(node) = waiting.pop() {
        waiting.extend(node.children());
        let node = node.accesskit_node();
        let is_control = matches!(
            node.role(),
            Role::Button
                | Role::CheckBox
                | Role::ComboBox
                | Role::Link
                | Role::RadioButton
                | Role::Slider
                | Role::SpinButton
                | Role::TextInput
        );
        if !is_control {
            continue;
        }
        match node.label().or_else(|| node.value()) {
            Some(label) if !label.trim().is_empty() => named.push(label),
            Some(_) | None => unnamed.push(format!("{:?} at {:?}", node.role(), node.raw_bounds())),
        }
    }
    (named, unnamed)
}

#[test]
fn every_control_has_a_name() {
    for rig in [Rig::new(), Rig::live(), Rig::on_water(None)] {
        let mut window = rig.window();
        for panel in PanelId::ALL {
            window
                .state_mut()
                .screen
                .workspace_mut()
                .set_wanted(panel, true);
            window.run_steps(2);
            let (named, unnamed) = controls(&window);
            assert_eq!(unnamed, [""; 0], "{panel:?}");
            assert!(named.len() >= 5, "{named:?}");
        }
    }
}

#[test]
fn keys_open_and_close_what_lies_over_the_window() {
    let mut window = Rig::live().window();
    for (modifiers, key, says) in [
        (
            Modifiers::NONE,
            Key::F1,
            "Driving, while you hold the lease",
        ),
        (Modifiers::COMMAND, Key::E, "Trajectory"),
    ] {
        check(&window, &[], &[says]);
        window.key_press_modifiers(modifiers, key);
        window.run_steps(4);
        check(&window, &[says], &[]);
        let (_, unnamed) = controls(&window);
        assert_eq!(unnamed, [""; 0], "{says}");
        window.key_press(Key::Escape);
        window.run_steps(4);
        check(&window, &[], &[says]);
    }
    let scale = |window: &Harness<'_, Rig>| window.state().screen.appearance().scale_percent;
    for (key, percent) in [
        (Key::Plus, 110),
        (Key::Plus, 120),
        (Key::Minus, 110),
        (Key::Num0, 100),
    ] {
        window.key_press_modifiers(Modifiers::COMMAND, key);
        window.run_steps(2);
        assert_eq!(scale(&window), percent);
    }
    let asked = std::mem::take(&mut window.state_mut().commands);
    assert_eq!(asked, []);
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    window.key_press_modifiers(Modifiers::ALT, Key::Num2);
    window.key_press(Key::ArrowLeft);
    // What is typed behind it would be for its dialog.
    window.key_press_modifiers(Modifiers::COMMAND, Key::O);
    window.run_steps(2);
    let asked = std::mem::take(&mut window.state_mut().commands);
    assert_eq!(
        asked,
        [
            Command::Screenshot,
            Command::Layer(LayerCommand::Show(LayerId::Elevation, false)),
            Command::Look(Look::Beside([-0.1, 0.0])),
            Command::AskForRecording,
        ]
    );
}

#[test]
fn an_export_is_chosen_part_by_part() {
    let mut window = Rig::live().window();
    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    window.run_steps(4);
    let folder = window.get_by_role_and_label(Role::TextInput, "Folder");
    assert!(folder.value().unwrap().contains("foreshore-scout-1-"));
    window
        .get_by_role_and_label(Role::CheckBox, "Trajectory")
        .click();
    window.run_steps(2);
    window.get_by_role_and_label(Role::Button, "Export").click();
    window.run_steps(2);
    let asked = std::mem::take(&mut window.state_mut().commands);
    let [Command::Export(wish)] = &asked[..] else {
        panic!("{asked:?}");
    };
    let parts = [LAYER, LayerId::Elevation].map(ExportPart::Layer);
    assert_eq!(wish.parts, parts.into());
    assert!(wish.opens_folder);
}

#[test]
fn an_export_to_the_home_folder_goes_there_and_what_is_unticked_is_kept() {
    let mut window = Rig::live().window();
    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    window.run_steps(4);
    window
        .get_by_role_and_label(Role::CheckBox, "Open the folder when all is in it")
        .click();
    window.run_steps(2);
    window
        .get_by_role_and_label(Role::TextInput, "Folder")
        .focus();
    window.run_steps(2);
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.event(egui::Event::Text("~/maps ".to_owned()));
    window.run_steps(2);
    window.key_press(Key::Enter);
    window.run_steps(2);
    let asked = std::mem::take(&mut window.state_mut().commands);
    let [Command::Export(wish)] = &asked[..] else {
        panic!("{asked:?}");
    };
    assert_eq!(wish.folder, crate::typed_path::home().unwrap().join("maps"));
    assert!(!wish.opens_folder);
    let mut settings = Settings::default();
    window.state().screen.keep(&mut settings);
    assert!(!settings.opens_exports);
    let mut again = Settings::default();
    Screen::of(&settings).keep(&mut again);
    assert!(!again.opens_exports);
}

#[test]
fn all_plots_of_the_link_are_in_sight_at_first() {
    let window = Rig::live().window();
    let mut seen: Vec<egui::Rect> = Vec::new();
    for title in [
        "Round trip, ms",
        "Poses lost, %",
        "Received, kbit/s",
        "Age, s",
    ] {
        let rect = window.get_by_label_contains(title).rect();
        assert!(
            rect.right() <= 1280.0 && rect.bottom() <= 800.0,
            "{title} {rect}"
        );
        assert!(
            rect.width() > 150.0 && rect.height() > 50.0,
            "{title} {rect}"
        );
        assert!(seen.iter().all(|other| !other.intersects(rect)), "{title}");
        seen.push(rect);
    }
}

#[test]
fn the_layout_is_kept_and_found_again() {
    let mut window = Rig::live().window();
    window.get_by_label("Events").click();
    window.run_steps(2);
    let mut settings = Settings::default();
    window.state().screen.keep(&mut settings);
    let text = serde_json::to_string(&settings).unwrap();
    let mut rig = Rig::live();
    rig.screen = Screen::of(&serde_json::from_str(&text).unwrap());
    check(&rig.window(), &["Filter"], &["Round trip, ms"]);
}
