//! The shown robot: identity, position and progress.

use eframe::egui::accesskit::Role;
use eframe::egui::{Button, Id, TextEdit, Ui, WidgetInfo};
use measurement::time::Monotonic;
use network::clock::utc_label;
use protocol::geodesy::{GeodeticPoint, LocalTangentPlane};
use protocol::keys::is_name;
use protocol::message::{PoseConfidence, Setting};

use super::connection::is_shown_synchronized;
use super::data_age::is_position_old;
use super::formatting::{age, capitalised, count, direction, signed, turn};
use super::link::{TimePlot, plots_ui, segments};
use super::rows::{Row, row, rows_ui};
use crate::command::Command;
use crate::model::{ConsoleModel, LinkState, ellipse_95};
use crate::playback::is_recording;
use crate::teleop_client::Intent;

/// Points.
const PLOT_HEIGHT: f32 = 90.0;
const NAME_WIDTH: f32 = 140.0;
const YEAR_2000_S: u64 = 946_684_800;

#[derive(Clone, Debug, PartialEq)]
pub struct RobotData {
    pub rows: Vec<(String, String)>,
    pub note: Option<String>,
    /// Where scans are matched.
    pub residuals: Option<TimePlot>,
    /// The robot takes settings of operators.
    pub takes_settings: bool,
}

impl RobotData {
    pub fn new(model: &ConsoleModel, now: Monotonic) -> Self {
        let mut rows = Vec::new();
        if let Some(info) = model.info() {
            rows.push(row("Vehicle", info.vehicle.clone()));
            if !info.source.is_empty() {
                rows.push(row("Source", info.source.clone()));
            }
        }
        rows.extend(pose_rows(model));
        rows.extend(localization_rows(model));
        if let Some((status, _)) = model.status() {
            rows.extend(
                status
                    .depth_under_keel_m
                    .map(|depth_m| row("Under keel", format!("{} m", signed(depth_m.into(), 1)))),
            );
            let battery_v = status.teleop.as_ref().and_then(|teleop| teleop.battery_v);
            rows.extend(battery_v.map(|volts| row("Battery", format!("{volts:.1} V"))));
            let [mapped, came] = [status.scans_mapped, status.scans_in].map(count);
            if is_recording(model.robot()) {
                // A paused recording also maps the scans that wait for a pose, which its status does not count as
                // mapped. Until they are drawn, the count is that of the previous position.
                let read = is_shown_synchronized(model.map(), now).then(|| format!("{came} read"));
                rows.push(row(
                    "Scans",
                    read.unwrap_or_else(|| "being read".to_owned()),
                ));
            } else {
                rows.push(row("Scans", format!("{mapped} of {came} mapped")));
                rows.push(row("Consoles", status.consoles.to_string()));
            }
        }
        let is_silent = model.connection().state(now) == LinkState::Silent;
        let has_ended = model.reports_ended();
        let note = match (is_silent, model.vehicle().pose()) {
            (true, Some((_, at))) => Some(format!("As of {} ago", age(now.since(at)))),
            (true, None) => Some("No position received".to_owned()),
            (false, Some((_, at))) if is_position_old(model, now) => {
                Some(format!("Position is {} old", age(now.since(at))))
            }
            (false, _) => has_ended.then(|| ended(model.vehicle().stamp_ns())),
        };
        let residuals = model.localization().newest().map(|_| {
            let residuals = model.localization().residuals_m();
            let points = residuals.map(|(at, m)| (*at, Some(100.0 * f64::from(*m))));
            TimePlot {
                title: "Residual of scans, cm",
                least: 5.0,
                lines: vec![("Residual", segments(points, now))],
            }
        });
        Self {
            rows,
            note,
            residuals,
            takes_settings: model.takes_settings(),
        }
    }
}

fn ended(newest_ns: Option<i64>) -> String {
    let newest_s = newest_ns.and_then(|ns| u64::try_from(ns / 1_000_000_000).ok());
    // Clocks that start at zero have no calendar time.
    match newest_s.filter(|newest_s| *newest_s >= YEAR_2000_S) {
        Some(newest_s) => {
            let at = utc_label(newest_s).replace('T', " ").replace('Z', " UTC");
            format!("Its data has ended, by its clock at {at}: nothing new will come")
        }
        None => "Its data has ended: nothing new will come".to_owned(),
    }
}

fn pose_rows(model: &ConsoleModel) -> Vec<Row> {
    let Some((pose, _)) = model.vehicle().pose() else {
        return Vec::new();
    };
    let [x, y, z] = pose.position_m.map(|m| signed(m, 2));
    let heading_deg = model
        .vehicle()
        .heading_rad()
        .unwrap_or_default()
        .to_degrees();
    let datum = model.shores().and_then(|shores| shores.datum);
    // After the end of the data the last speed is not shown as current.
    let has_ended = model.reports_ended();
    let now = |words: String| if has_ended { "–".to_owned() } else { words };
    let is_still = model.is_still();
    let speed = if is_still {
        "standing".to_owned()
    } else {
        format!("{} m/s", signed(f64::from(pose.ground_speed_mps()), 2))
    };
    let mut rows = vec![
        // Narrow panels break the line between x and y.
        row("Position", format!("x\u{a0}{x}  y\u{a0}{y}\u{a0}m")),
        row("Heading", heading(heading_deg, datum.is_some())),
        row("Speed", now(speed)),
    ];
    // A boat is at the height of the water.
    if !model.is_boat() {
        rows.insert(1, row("Height", format!("{z} m")));
    }
    if let Some(datum) = datum {
        let place = LocalTangentPlane::new(datum).geodetic_from_enu(pose.position_m);
        rows.insert(1, row("WGS 84", geodetic(&place)));
    }
    if !is_still {
        let turning = turn(f64::from(pose.turn_rate_radps));
        rows.push(row("Turning", now(turning)));
    }
    rows
}

/// How well scans determine the pose; of the ellipse of 95 % the greater half axis.
fn localization_rows(model: &ConsoleModel) -> Vec<Row> {
    let Some(newest) = model.localization().newest() else {
        return Vec::new();
    };
    let far_m = ellipse_95(newest.covariance_m2).map_or(f64::INFINITY, |([far_m, _], _)| far_m);
    let heading_deg = 1.96 * f64::from(newest.heading_sigma_rad).to_degrees();
    let by_scans = match newest.confidence {
        PoseConfidence::Lost => "lost: a new map begins".to_owned(),
        PoseConfidence::OdometryOnly => "do not fit the map: odometry alone".to_owned(),
        PoseConfidence::UncertainAlong => "do not tell the way along".to_owned(),
        PoseConfidence::Determined if newest.is_searching => "searched in the saved map".to_owned(),
        PoseConfidence::Determined => format!(
            "±\u{a0}{:.0}\u{a0}cm  ±\u{a0}{heading_deg:.1}°",
            100.0 * far_m
        ),
    };
    let fit = format!(
        "{:.0}\u{a0}% on the map, {:.1}\u{a0}cm off",
        100.0 * newest.inliers,
        100.0 * newest.residual_m
    );
    let [added, removed] = newest.closures;
    vec![
        row("By scans", by_scans),
        row("Fit of scans", fit),
        row("Closures", format!("{added}, {removed} taken back")),
    ]
}

/// In degrees; the sixth decimal is 0.1 m.
fn geodetic(place: &GeodeticPoint) -> String {
    let side = |degrees: f64, [positive, negative]: [&str; 2]| {
        let side = if degrees < 0.0 { negative } else { positive };
        format!("{:.6}°\u{a0}{side}", degrees.abs())
    };
    let latitude = side(place.latitude_deg, ["N", "S"]);
    let longitude = side(place.longitude_deg, ["E", "W"]);
    format!("{latitude}  {longitude}")
}

/// `angle_deg`: counter-clockwise from x of `odom`.
fn heading(angle_deg: f64, knows_north: bool) -> String {
    capitalised(&direction(angle_deg, knows_north, "map's x"))
}

/// `advice`: why the link is not live.
pub fn robot_ui(ui: &mut Ui, data: &RobotData, advice: Option<&str>) -> Option<Command> {
    if let Some(note) = &data.note {
        ui.strong(note);
    }
    if let Some(advice) = advice.or_else(|| data.rows.is_empty().then_some("No data yet.")) {
        ui.label(advice);
    }
    rows_ui(ui, "robot", &data.rows);
    if let Some(residuals) = &data.residuals {
        plots_ui(ui, std::slice::from_ref(residuals), PLOT_HEIGHT);
    }
    let can_save = data.takes_settings && data.residuals.is_some();
    can_save.then(|| save_map_ui(ui)).flatten()
}

/// The name of a map, and a button that saves it.
fn save_map_ui(ui: &mut Ui) -> Option<Command> {
    let id = Id::unique("name of the map");
    let mut name: String = ui.data_mut(|data| data.get_temp(id)).unwrap_or_default();
    let asked = ui.horizontal_wrapped(|ui| {
        let field = TextEdit::singleline(&mut name)
            .hint_text("Name")
            .desired_width(NAME_WIDTH);
        ui.add(field)
            .widget_info(|| WidgetInfo::labeled(Role::TextInput, true, "Name of the map"));
        let save = ui.add_enabled(is_name(&name), Button::new("Save map"));
        let save = save
            .on_hover_text("The robot saves the map of its scans, to go on in it with --map")
            .on_disabled_hover_text("A name has letters, digits, _ or -");
        save.clicked()
    });
    let command = asked
        .inner
        .then(|| Command::Drive(Intent::Set(Setting::SaveMap(name.clone()))));
    ui.data_mut(|data| data.insert_temp(id, name));
    command
}

#[cfg(test)]
mod tests {
    use protocol::keys::Topic;
    use protocol::message::{Info, Localization, Pose, Status, TeleopStatus};
    use protocol::tile_store::TileStore;

    use super::*;
    use crate::model::RequestId;
    use crate::test_support::{
        BOOT, announce_map, at, console, ended_status, idle_teleop_status, inject, inject_reply,
        localization, pose_at_rest, scout,
    };

    #[test]
    fn how_well_scans_determine_the_pose_is_said() {
        let mut model = scout();
        assert_eq!(RobotData::new(&model, at(900)).residuals, None);
        for (confidence, is_searching, said) in [
            (
                PoseConfidence::Determined,
                false,
                "±\u{a0}5\u{a0}cm  ±\u{a0}0.2°",
            ),
            (
                PoseConfidence::Determined,
                true,
                "searched in the saved map",
            ),
            (
                PoseConfidence::UncertainAlong,
                false,
                "do not tell the way along",
            ),
            (
                PoseConfidence::OdometryOnly,
                false,
                "do not fit the map: odometry alone",
            ),
            (PoseConfidence::Lost, false, "lost: a new map begins"),
        ] {
            let message = Localization {
                confidence,
                is_searching,
                ..localization()
            };
            inject(&mut model, Topic::Localization, &message, at(1_000));
            let rows = RobotData::new(&model, at(1_100)).rows;
            assert_eq!(rows[0], row("By scans", said));
        }
        let data = RobotData::new(&model, at(1_100));
        assert_eq!(
            data.rows[1..],
            [
                row("Fit of scans", "93\u{a0}% on the map, 1.8\u{a0}cm off"),
                row("Closures", "5, 1 taken back"),
            ]
        );
        let lines = data.residuals.unwrap().lines;
        let points: Vec<_> = lines[0].1.iter().flatten().collect();
        assert_eq!(points.len(), 5);
        assert!(
            points.iter().all(|[_, cm]| (cm - 1.8).abs() < 1e-6),
            "{points:?}"
        );
    }

    #[test]
    fn a_paused_recording_counts_all_drawn_scans() {
        let status = Status {
            scans_in: 1_118,
            scans_mapped: 1_117,
            ..Status::default()
        };
        let model = |robot| {
            let mut model = console(robot, &[]);
            inject(&mut model, Topic::Status, &status, at(1_000));
            model
        };
        let rows = |robot| {
            let mut model = model(robot);
            announce_map(&mut model, &TileStore::new(BOOT, 10), at(1_000));
            RobotData::new(&model, at(1_100)).rows
        };
        let drawn = RobotData::new(&model("recording-1"), at(1_100)).rows;
        assert_eq!(drawn, [row("Scans", "being read")]);
        let read = row("Scans", "1\u{a0}118 read");
        assert_eq!(rows("recording-1"), [read]);
        let mapped = row("Scans", "1\u{a0}117 of 1\u{a0}118 mapped");
        assert_eq!(rows("scout"), [mapped, row("Consoles", "0")]);
    }

    #[test]
    fn turn_rate_text() {
        let mut model = scout();
        let pose = Pose {
            position_m: [1.0, 2.0, 0.0],
            quaternion_xyzw: [0.0, 0.0, 0.0, 1.0],
            speed_mps: -0.5,
            lateral_mps: 0.0,
            turn_rate_radps: -0.21,
            token: None,
        };
        inject(&mut model, Topic::Pose, &pose, at(1_000));
        let rows = RobotData::new(&model, at(1_100)).rows;
        let moves = [row("Speed", "−0.50 m/s"), row("Turning", "12 °/s right")];
        assert_eq!(rows[rows.len() - 2..], moves);
        let ended = ended_status();
        inject(&mut model, Topic::Status, &ended, at(1_100));
        let rows = RobotData::new(&model, at(1_100)).rows;
        assert!(rows.contains(&row("Speed", "–")) && rows.contains(&row("Turning", "–")));
    }

    #[test]
    fn rows_of_a_standing_vehicle_and_of_a_boat() {
        let names = |is_boat, speed_mps| {
            let mut model = scout();
            let info = Info {
                is_boat,
                ..Info::default()
            };
            inject_reply(&mut model, RequestId(0), Topic::Info, &info, at(1_000));
            let pose = Pose {
                speed_mps,
                ..pose_at_rest()
            };
            inject(&mut model, Topic::Pose, &pose, at(1_000));
            inject(&mut model, Topic::Status, &Status::default(), at(1_000));
            let rows = RobotData::new(&model, at(1_100)).rows;
            let speed = rows.iter().find(|(name, _)| name == "Speed").cloned();
            let has = |name| rows.iter().any(|(of, _)| of == name);
            (speed, has("Height"), has("Turning"))
        };
        let standing = Some(row("Speed", "standing"));
        assert_eq!(names(false, -0.01), (standing.clone(), true, false));
        assert_eq!(names(true, 0.0), (standing, false, false));
        let moves = Some(row("Speed", "−0.50 m/s"));
        assert_eq!(names(true, -0.5), (moves, false, true));
    }

    #[test]
    fn battery_and_depth_are_shown_where_known() {
        let mut model = scout();
        let teleop = TeleopStatus {
            battery_v: Some(25.78),
            ..idle_teleop_status()
        };
        for (depth_under_keel_m, teleop, expected) in [
            (None, None, vec![]),
            (Some(1.26), None, vec![row("Under keel", "1.3 m")]),
            (
                Some(-0.1),
                Some(teleop),
                vec![row("Under keel", "−0.1 m"), row("Battery", "25.8 V")],
            ),
        ] {
            let status = Status {
                depth_under_keel_m,
                teleop,
                ..Status::default()
            };
            inject(&mut model, Topic::Status, &status, at(1_000));
            let mut rows = RobotData::new(&model, at(1_100)).rows;
            rows.retain(|(name, _)| name == "Under keel" || name == "Battery");
            assert_eq!(rows, expected);
        }
    }

    #[test]
    fn places_on_earth_have_degrees_and_sides() {
        let place = |latitude_deg, longitude_deg| GeodeticPoint {
            latitude_deg,
            longitude_deg,
            altitude_m: 0.0,
        };
        for (latitude_deg, longitude_deg, words) in [
            (38.5, -9.125, "38.500000°\u{a0}N  9.125000°\u{a0}W"),
            (
                -0.000_001_4,
                179.999_999_9,
                "0.000001°\u{a0}S  180.000000°\u{a0}E",
            ),
        ] {
            assert_eq!(geodetic(&place(latitude_deg, longitude_deg)), words);
        }
    }

    #[test]
    fn ended_data_shows_its_time_if_known() {
        let reported = [
            None,
            Some(-1),
            Some(93_000_000_000),
            Some(1_763_835_642_123_456_789),
        ];
        let without = "Its data has ended: nothing new will come";
        let with =
            "Its data has ended, by its clock at 2025-11-22 18:20:42 UTC: nothing new will come";
        assert_eq!(reported.map(ended), [without, without, without, with]);
    }

    #[test]
    fn heading_is_a_bearing_if_north_is_known() {
        for (angle_deg, on_earth, on_map) in [
            (90.0, "000°", "90° left of map's x"),
            (1.2, "089°", "1° left of map's x"),
            (-0.4, "090°", "Along map's x"),
            (-90.0, "180°", "90° right of map's x"),
            (179.9, "270°", "Against map's x"),
            (-179.9, "270°", "Against map's x"),
            (90.3, "000°", "90° left of map's x"),
        ] {
            assert_eq!(heading(angle_deg, true), on_earth);
            assert_eq!(heading(angle_deg, false), on_map);
        }
    }
}
