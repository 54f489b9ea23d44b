//! Goals: a planner that is not ours drives the simulated robot through `rooms`, and goes wrong.

use std::cell::Cell;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::time::Duration;

use foreshore_tests::drive_log::DriveLog;
use foreshore_tests::operator::{Input, NEUTRAL, Operator};
use measurement::time::Monotonic;
use nalgebra::{Point3, Quaternion, UnitQuaternion, Vector2, Vector3};
use network::clock;
use protocol::message::{GoalEnd, MapPose, Pose, TeleopState};
use simulation::World;
use simulation::scene::Scene;
use tempfile::{TempDir, tempdir};

use super::ros_system::{RosMiddleware, RosSystem};
use crate::processes::{Running, SERVED, free_port, start, tcp};
use crate::python::{client_folder, python};

const VEHICLE: &str = r#"preset = "pioneer"
[ros2_output]
map = { topic = "/map", rate_hz = 2.0, max_kb = 16000 }
tf = { topic = "/tf", rate_hz = 20.0, max_kb = 1 }
odometry = { topic = "/foreshore/odometry", rate_hz = 20.0, max_kb = 1 }
[planner]
"#;

/// Through every room, metres.
const GOALS: [[f64; 2]; 20] = [
    [2.5, 4.3],
    [2.5, -1.9],
    [6.1, -1.9],
    [6.9, 0.8],
    [10.0, 0.8],
    [14.3, 0.8],
    [14.3, 4.3],
    [14.3, 8.7],
    [9.2, 8.7],
    [7.4, 7.6],
    [2.6, 7.6],
    [0.6, 8.9],
    [1.7, 7.2],
    [1.7, 4.3],
    [6.0, 4.3],
    [12.6, 4.3],
    [16.0, 4.5],
    [10.0, 4.3],
    [-1.0, 4.3],
    [2.5, 1.5],
];

/// The planner is satisfied at 0.15 m, by an older pose.
const REACHED_M: f64 = 0.3;
/// Half of the Pioneer's length and width, metres.
const HALF_M: [f64; 2] = [0.2275, 0.1905];
/// Every solid is higher, metres.
const HEIGHT_M: f64 = 0.2;
/// Longer than the way to any goal takes on a busy machine.
const TIMEOUT: Duration = Duration::from_mins(4);

/// The process of the planner; killed with the test.
struct Planner {
    child: Child,
    input: ChildStdin,
}

impl Planner {
    fn start(python: &Path, port: u16) -> Self {
        let mut child = Command::new(python)
            .arg("-B")
            .arg(client_folder().join("ros2_planner.py"))
            .args(["--port", &port.to_string()])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        assert!(
            lines.any(|line| line.unwrap() == "ready"),
            "the planner has ended"
        );
        // It must not block at a full pipe.
        std::thread::spawn(move || lines.for_each(drop));
        let input = child.stdin.take().unwrap();
        Self { child, input }
    }

    fn go_wrong(&mut self, how: &str) {
        if how == "kill" {
            self.child.kill().unwrap();
        } else {
            writeln!(self.input, "{how}").unwrap();
        }
    }
}

impl Drop for Planner {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

struct Rig {
    python: PathBuf,
    port: u16,
    scene: Scene,
    anna: Operator,
    /// Looks on while Anna drives.
    bert: Operator,
    planner: Planner,
    robot: Running,
    _system: RosSystem,
    folder: TempDir,
}

impl Rig {
    /// `None` without the packages of the planner.
    fn start() -> Option<Self> {
        let python = python("ros2_requirements.txt", "rosbags, zenoh, zenoh_ros2_sdk")?;
        let folder = tempdir().unwrap();
        let vehicle = folder.path().join("v.toml");
        std::fs::write(&vehicle, VEHICLE).unwrap();
        let (port, endpoint) = (free_port(), tcp(free_port()));
        let system = RosSystem::start(port, RosMiddleware::Rmw { domain: 0 });
        let robot = start(&format!(
            "robot-edge simulate rooms {SERVED} --robot scout --vehicle {} --listen {endpoint} --ros {} --ros-domain 0 \
             --drive-log {} --summary {}",
            vehicle.display(),
            system.endpoint(),
            folder.path().join("drive.csv").display(),
            folder.path().join("summary.json").display()
        ));
        let [anna, bert] = ["anna", "bert"].map(|name| Operator::ready(&endpoint, "scout", name));
        let status = anna.wait_for_status("a status", |_| true);
        assert!(!status.goal.has_planner, "before there is one");
        let planner = Planner::start(&python, port);
        anna.wait_for_status("a planner", |teleop| teleop.goal.has_planner);
        let world = World::load("rooms").unwrap();
        let mut rig = Self {
            scene: Scene::new(world.solids()),
            python,
            port,
            anna,
            bert,
            planner,
            robot,
            _system: system,
            folder,
        };
        rig.anna.take_lease();
        Some(rig)
    }

    /// Names a goal until `is_over`, or until it ends; returns the end.
    fn go(&mut self, [x, y]: [f64; 2], is_over: impl Fn(&Operator) -> bool) -> Option<GoalEnd> {
        self.anna.goal = None;
        self.anna.hold(Input::NEUTRAL, NEUTRAL);
        let goal = MapPose {
            x_mm: (1000.0 * x) as i32,
            y_mm: (1000.0 * y) as i32,
            yaw_mrad: 0,
        };
        self.anna.goal = Some(goal);
        let (bert, scene, has_run) = (&self.bert, &self.scene, Cell::new(false));
        let end = Cell::new(None);
        let started = clock::now();
        self.anna.hold_until(Input::NEUTRAL, || {
            assert_clear(scene, &bert.pose());
            let status = bert.teleop().unwrap().goal;
            if status.running == Some(goal) {
                has_run.set(true);
            } else if has_run.get() {
                end.set(status.last_end);
            }
            assert!(clock::elapsed(started) < TIMEOUT, "{:?}", bert.teleop());
            end.get().is_some() || is_over(bert)
        });
        end.get()
    }

    /// Distance from there, metres.
    fn missing_m(&self, [x, y]: [f64; 2]) -> f64 {
        let [at_x, at_y, _] = self.bert.pose().position_m;
        Vector2::new(x - at_x, y - at_y).norm()
    }

    /// Drives to each goal. On a busy machine a command or a velocity may come too late: then it is named again.
    fn reach(&mut self, goals: &[[f64; 2]]) {
        let mut again = 0;
        for (number, &goal) in (1..).zip(goals) {
            let mut end = self.go(goal, |_| false);
            while self.missing_m(goal) > REACHED_M {
                assert!(
                    matches!(end, Some(GoalEnd::PlannerSilent | GoalEnd::Age)) && again < 20,
                    "goal {number}: {end:?}, {} m away",
                    self.missing_m(goal)
                );
                again += 1;
                end = self.go(goal, |_| false);
            }
            assert_eq!(end, Some(GoalEnd::PlannerSilent), "goal {number}");
            println!("goal {number}: {:.2} m away", self.missing_m(goal));
        }
        println!("{} goals without contact, {again} named again", goals.len());
    }

    fn log(&self) -> DriveLog {
        let csv = std::fs::read_to_string(self.folder.path().join("drive.csv")).unwrap();
        DriveLog::parse(&csv).unwrap()
    }
}

/// Nothing is inside of the footprint.
fn assert_clear(scene: &Scene, pose: &Pose) {
    let [x, y, _] = pose.position_m;
    let [i, j, k, w] = pose.quaternion_xyzw.map(f64::from);
    let attitude = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k));
    for side in [[1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [-1.0, 1.0]] {
        for sign in [1.0, -1.0] {
            let outline = Vector3::new(sign * side[0] * HALF_M[0], sign * side[1] * HALF_M[1], 0.0);
            let (direction, middle) = (attitude * outline, Point3::new(x, y, HEIGHT_M));
            let hit = scene.cast(middle, direction.normalize(), 5.0, 0.0);
            let free_m = hit.map_or(f64::INFINITY, |hit| hit.distance_m);
            assert!(
                free_m > outline.norm(),
                "contact at {x:.2}, {y:.2}: {free_m:.3} m"
            );
        }
    }
}

#[test]
fn a_planner_drives_through_rooms_to_three_goals() {
    if let Some(mut rig) = Rig::start() {
        rig.reach(&GOALS[..3]);
        drop(rig.robot.interrupt());
        let summary = std::fs::read_to_string(rig.folder.path().join("summary.json")).unwrap();
        assert!(
            summary.contains("goals ended: the planner is silent"),
            "{summary}"
        );
    }
}

#[test]
#[ignore = "minutes: a simulated robot drives 100 m in real time"]
fn twenty_goals_are_reached_without_contact() {
    if let Some(mut rig) = Rig::start() {
        rig.reach(&GOALS);
    }
}

/// A planner that goes wrong while the vehicle drives to a goal stops it, and later goals start again.
#[test]
fn a_planner_that_dies_floods_or_sends_no_numbers_stops_the_vehicle() {
    let Some(mut rig) = Rig::start() else {
        return;
    };
    for (how, why) in [
        ("nan", GoalEnd::NotFinite),
        ("flood", GoalEnd::PlannerFloods),
        ("kill", GoalEnd::PlannerSilent),
    ] {
        let moves = |bert: &Operator| bert.teleop().unwrap().applied.linear_mps > 0.3;
        // Back and forth along the corridor.
        let goal = if rig.bert.pose().position_m[0] < 5.0 {
            [12.0, 4.3]
        } else {
            [-1.0, 4.3]
        };
        let mut end = rig.go(goal, moves);
        for _ in 0..10 {
            // On a busy machine.
            if end.is_some() {
                end = rig.go(goal, moves);
            }
        }
        assert_eq!(end, None, "{how}: it does not get going");
        let wrong_at = clock::now();
        rig.planner.go_wrong(how);
        let bert = &rig.bert;
        let started = clock::now();
        rig.anna.hold_until(Input::NEUTRAL, || {
            assert!(
                clock::elapsed(started) < TIMEOUT,
                "{how}: {:?}",
                bert.teleop()
            );
            bert.teleop().unwrap().goal.running.is_none()
        });
        assert_eq!(rig.bert.teleop().unwrap().goal.last_end, Some(why), "{how}");
        // The planner goes on, and the goal is still named: nothing moves.
        rig.anna.hold(Input::NEUTRAL, Duration::from_secs(3));
        let teleop = rig.bert.teleop().unwrap();
        assert_eq!(
            (teleop.state, teleop.goal.running),
            (TeleopState::Held, None),
            "{how}"
        );
        let log = rig.log();
        let (stopping, standing, pause) = stop_after(&log, wrong_at);
        println!(
            "{how}: stopping after {stopping:?}, standing after {standing:?}, longest round {pause:?}"
        );
        // 200 ms, a round and the way of the words; on a busy machine more.
        assert!(stopping < Duration::from_secs(1), "{how}: {stopping:?}");
        assert!(
            standing < stopping + Duration::from_millis(900),
            "{how}: {standing:?}"
        );
        if how == "kill" {
            rig.anna
                .wait_for_status("no planner", |teleop| !teleop.goal.has_planner);
            rig.planner = Planner::start(&rig.python, rig.port);
            rig.anna
                .wait_for_status("a planner", |teleop| teleop.goal.has_planner);
        } else {
            rig.planner.go_wrong("sane");
        }
    }
}

/// When it began to stop and when it stood, after that moment, and the longest time between two rounds since then.
fn stop_after(log: &DriveLog, moment: Monotonic) -> (Duration, Duration, Duration) {
    let since: Vec<_> = log
        .rounds
        .iter()
        .filter(|round| round.at >= moment)
        .collect();
    let first = |is_so: &dyn Fn(usize) -> bool| {
        let found = (0..since.len()).find(|&index| is_so(index)).unwrap();
        (since[found].at.since(moment), found)
    };
    let (stopping, at) = first(&|index| since[index].mode != "driving");
    let (standing, stood) = first(&|index| since[index].is_stopped());
    assert!(at <= stood, "it stood before it was to stop");
    assert!(
        since[stood..].iter().all(|round| round.is_stopped()),
        "it moved again"
    );
    let pauses = since.windows(2).map(|pair| pair[1].at.since(pair[0].at));
    (stopping, standing, pauses.max().unwrap_or_default())
}
