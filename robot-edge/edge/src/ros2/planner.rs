//! The session with a planner: goals to it; velocities and paths of it.
//!
//! Zenoh's callbacks decode a velocity and put it into a slot; the teleop loop takes the newest. A thread of its own
//! publishes goals and thins paths.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use protocol::message::{MAX_PLAN_POINTS, MapPose, Plan};
use zenoh::Wait as _;
use zenoh::qos::Priority;
use zenoh::sample::Sample;

use super::node::{PublisherSettings, RosLinkError, RosNode, RosPublisher};
use super::output::RosTarget;
use super::subscribers::SubscriberWatch;
use crate::config::PlannerConfig;
use crate::driving::planner::PlannerExchange;
use crate::lock;
use crate::publishing::output_inputs::OutputInputs;
use measurement::MeasurementData;
use measurement::pose::{Pose, planar};
use measurement::time::{Monotonic, RobotTime};
use nalgebra::Point3;
use network::clock;
use recording::ros::middleware::{PublishedType, bridge_key, rmw_keys};
use recording::ros::published::pose_stamped;
use recording::ros::{Encoding, MessageType, decode, decode_path};
use teleop::Velocity;

/// A goal waits for this long at most until it is published.
const PERIOD: Duration = Duration::from_millis(20);
/// Consoles get a path this often at most.
const PLAN_PERIOD: Duration = Duration::from_secs(1);
/// A planner that announces nothing is there while its last velocity is younger.
const PRESENCE: Duration = Duration::from_secs(1);
/// Larger paths are dropped: 50,000 poses.
const MAX_PATH_BYTES: usize = 4 << 20;
/// A plain `Twist`, with its encapsulation header. A stamped one is longer; the keys of bridges do not name the type.
const TWIST_BYTES: usize = 4 + 48;

/// What a run says about the planner at its end.
#[derive(Debug, Default)]
struct Drops {
    velocities: AtomicU64,
    paths: AtomicU64,
}

/// What was received from the planner.
#[derive(Debug, Default)]
struct Received {
    velocity_at: Mutex<Option<Monotonic>>,
    path: Mutex<Option<Vec<u8>>>,
    drops: Drops,
}

/// The running session. It ends when it is dropped.
pub struct PlannerSession {
    exchange: PlannerExchange,
    received: Arc<Received>,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl PlannerSession {
    /// `frames`: names of the frames of the map and of odometry.
    pub fn start(
        config: &PlannerConfig,
        frames: [&str; 2],
        target: RosTarget,
        (exchange, inputs): (PlannerExchange, OutputInputs),
    ) -> std::io::Result<Self> {
        let (is_over, received) = (Arc::<AtomicBool>::default(), Arc::<Received>::default());
        let planner = Planner {
            config: config.clone(),
            frames: frames.map(str::to_owned),
            exchange: exchange.clone(),
            inputs,
            received: Arc::clone(&received),
            is_over: Arc::clone(&is_over),
        };
        let thread = thread::Builder::new().name("planner".to_owned());
        let thread = thread.spawn(move || {
            if let Some(node) = target.connect("goals are not sent yet", || planner.is_over())
                && let Err(why) = planner.run(&node)
            {
                tracing::error!(%why, "no goals can be sent");
            }
            planner.exchange.set_present(false);
        })?;
        Ok(Self {
            exchange,
            received,
            is_over,
            thread: Some(thread),
        })
    }

    /// Ends it; what happened, with counts above zero.
    pub fn finish(self) -> Vec<String> {
        let Drops { velocities, paths } = &self.received.drops;
        let drops = [
            (velocities, "velocities could not be read"),
            (paths, "paths could not be read, or are in another frame"),
        ];
        let drops = drops.map(|(count, what)| (what.to_owned(), count.load(Ordering::Relaxed)));
        let ends = self.exchange.goal_ends();
        let ends = ends.map(|(why, count)| (format!("goals ended: {why}"), count));
        let happened = ends.chain(drops).filter(|(_, count)| *count > 0);
        happened
            .map(|(what, count)| format!("{count} {what}"))
            .collect()
    }
}

impl Drop for PlannerSession {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread of the planner's session failed");
        }
    }
}

struct Planner {
    config: PlannerConfig,
    frames: [String; 2],
    exchange: PlannerExchange,
    inputs: OutputInputs,
    received: Arc<Received>,
    is_over: Arc<AtomicBool>,
}

impl Planner {
    fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }

    fn run(&self, node: &RosNode) -> Result<(), RosLinkError> {
        let config = &self.config;
        let settings = PublisherSettings {
            priority: Priority::RealTime,
            is_kept: false,
            is_bridged: true,
        };
        let mut goals =
            node.publisher(&config.goal_topic, PublishedType::POSE_STAMPED, settings)?;
        goals.announce(true)?;
        let takers = SubscriberWatch::new(node, &config.goal_topic)?;
        for kind in [PublishedType::TWIST, PublishedType::TWIST_STAMPED] {
            self.listen(node, &config.velocity_topic, kind, Self::take_velocity)?;
        }
        self.listen(
            node,
            &config.path_topic,
            PublishedType::PATH,
            Self::take_path,
        )?;
        let (mut sent, mut plan_due) = (self.exchange.goal().0, clock::now());
        while clock::sleep_until(clock::now() + PERIOD, || self.is_over()) {
            let now = clock::now();
            let is_received =
                lock(&self.received.velocity_at).is_some_and(|at| now.since(at) < PRESENCE);
            let is_announced = takers
                .get()
                .values()
                .any(|taker| taker.stream.type_name == PublishedType::POSE_STAMPED.name);
            self.exchange.set_present(is_announced || is_received);
            let (number, goal) = self.exchange.goal();
            if number != sent {
                self.send(&mut goals, goal);
                self.exchange.set_plan(Plan::default());
                *lock(&self.received.path) = None;
                (sent, plan_due) = (number, now);
            }
            if goal.is_some() && now >= plan_due {
                let path = lock(&self.received.path).take();
                if let Some(path) = path {
                    plan_due = now + PLAN_PERIOD;
                    match self.plan(&path) {
                        Some(plan) => self.exchange.set_plan(plan),
                        None => count(&self.received.drops.paths),
                    }
                }
            }
        }
        Ok(())
    }

    /// A planner has no topic to end a goal by: it is sent to where the vehicle is, where it has arrived already.
    fn send(&self, goals: &mut RosPublisher, goal: Option<MapPose>) {
        let vehicle = self.inputs.vehicle();
        let own = || vehicle.and_then(|at| Some(at.map_from_odom? * at.odom_from_base));
        let Some(pose) = goal
            .map(|goal| {
                let [x_m, y_m, yaw_rad] =
                    [goal.x_mm, goal.y_mm, goal.yaw_mrad].map(|part| f64::from(part) / 1000.0);
                planar(x_m, y_m, yaw_rad)
            })
            .or_else(own)
        else {
            return;
        };
        // Zero: the newest transform.
        let stamp = vehicle.map_or(RobotTime::from_nanos(0), |at| at.stamp);
        let message = pose_stamped(stamp, &self.frames[0], &pose);
        goals.put(message.clone());
        goals.put_bridged(message);
    }

    /// Subscribes to a topic under `rmw_zenoh`, whatever the hash of the definition, and of a bridge.
    fn listen(
        &self,
        node: &RosNode,
        topic: &str,
        kind: PublishedType,
        take: fn(&Received, &PlannerExchange, &Sample),
    ) -> Result<(), RosLinkError> {
        let [key, _] = rmw_keys(node.domain, topic, kind).unwrap_or_default();
        let key = key
            .rsplit_once('/')
            .map(|(topic, _hash)| format!("{topic}/*"));
        // Of a bridge, both kinds of velocities have one key.
        let bridged = (kind != PublishedType::TWIST_STAMPED).then(|| bridge_key(topic).to_owned());
        for key in key.into_iter().chain(bridged) {
            let (received, exchange) = (Arc::clone(&self.received), self.exchange.clone());
            node.session
                .declare_subscriber(key.clone())
                .callback(move |sample| take(&received, &exchange, &sample))
                .background()
                .wait()
                .map_err(RosLinkError::refused(&key))?;
        }
        Ok(())
    }

    fn take_velocity(received: &Received, exchange: &PlannerExchange, sample: &Sample) {
        let arrived = clock::now();
        match velocity(&sample.payload().to_bytes()) {
            Some(velocity) => {
                *lock(&received.velocity_at) = Some(arrived);
                exchange.offer(velocity, arrived);
            }
            None => count(&received.drops.velocities),
        }
    }

    fn take_path(received: &Received, _exchange: &PlannerExchange, sample: &Sample) {
        if sample.payload().len() <= MAX_PATH_BYTES {
            *lock(&received.path) = Some(sample.payload().to_bytes().into_owned());
        } else {
            count(&received.drops.paths);
        }
    }

    /// The path in the map, thinned; `None` if it cannot be read, or is in another frame than the map and `odom`.
    fn plan(&self, message: &[u8]) -> Option<Plan> {
        let (frame, points_m) = decode_path(Encoding::Cdr, message).ok()?;
        let [map, odom] = &self.frames;
        let map_from_path = if *frame == **map {
            Pose::identity()
        } else if *frame == **odom {
            self.inputs.vehicle()?.map_from_odom?
        } else {
            return None;
        };
        // The last point is the goal, and stays.
        let step = points_m.len().div_ceil(MAX_PLAN_POINTS - 1).max(1);
        let last = points_m.len().saturating_sub(1);
        let kept = points_m.iter().enumerate();
        let kept = kept.filter(|(index, _)| index % step == 0 || *index == last);
        let points_mm = kept.map(|(_, &point_m)| {
            let point = map_from_path * Point3::from(point_m);
            [point.x, point.y].map(|along_m| (1000.0 * along_m).round() as i32)
        });
        Some(Plan {
            points_mm: points_mm.collect(),
        })
    }
}

fn count(drops: &AtomicU64) {
    drops.fetch_add(1, Ordering::Relaxed);
}

/// The velocity in a `Twist` or `TwistStamped`.
fn velocity(message: &[u8]) -> Option<Velocity> {
    let kind = if message.len() <= TWIST_BYTES {
        MessageType::Twist
    } else {
        MessageType::TwistStamped
    };
    let decoded = decode(kind, Encoding::Cdr, false, message).ok()?;
    let MeasurementData::Twist(twist) = &decoded.first()?.as_ref().ok()?.data else {
        return None;
    };
    Some(Velocity {
        linear_mps: twist.linear_mps[0],
        lateral_mps: twist.linear_mps[1],
        angular_radps: twist.angular_radps[2],
    })
}

#[cfg(test)]
mod tests {
    use measurement::Twist;
    use recording::ros::published::{path, twist, twist_stamped};

    use super::*;
    use crate::publishing::output_inputs::VehicleState;

    #[test]
    fn both_messages_are_velocities_and_numbers_that_are_none_stay() {
        let sent = Twist {
            linear_mps: [0.5, -0.25, 9.0],
            angular_radps: [9.0, 9.0, f64::NAN],
        };
        let stamp = RobotTime::from_nanos(7);
        for message in [
            twist(&sent),
            twist_stamped(stamp, "base_link", &sent),
            twist_stamped(stamp, "", &sent),
        ] {
            let read = velocity(&message).unwrap();
            assert_eq!((read.linear_mps, read.lateral_mps), (0.5, -0.25));
            assert!(read.angular_radps.is_nan());
            assert_eq!(velocity(&message[..message.len() - 1]), None);
        }
        assert_eq!(velocity(&[]), None);
    }

    #[test]
    fn a_path_is_thinned_and_turned_into_the_map() {
        let inputs = OutputInputs::default();
        let planner = Planner {
            config: PlannerConfig::default(),
            frames: ["map".to_owned(), "odom".to_owned()],
            exchange: PlannerExchange::default(),
            inputs: inputs.clone(),
            received: Arc::default(),
            is_over: Arc::default(),
        };
        let stamp = RobotTime::from_nanos(0);
        let points = |count: usize| {
            let upright = [0.0, 0.0, 0.0, 1.0];
            (0..count).map(move |n| (stamp, [n as f64, 0.0, 0.0], upright))
        };
        let plan = |frame: &str, count| planner.plan(&path(stamp, frame, points(count)));
        assert_eq!(
            plan("map", 3).unwrap().points_mm,
            [[0, 0], [1000, 0], [2000, 0]]
        );
        assert_eq!(plan("map", 0), Some(Plan::default()));
        let thinned = plan("map", 100_000 / 80).unwrap().points_mm;
        assert!(
            (64..=MAX_PLAN_POINTS).contains(&thinned.len()),
            "{}",
            thinned.len()
        );
        assert_eq!(thinned.last(), Some(&[1_249_000, 0]));
        assert_eq!(plan("odom", 3), None, "nothing is known of it");
        inputs.set_vehicle(VehicleState {
            stamp,
            odom_from_base: planar(0.0, 0.0, 0.0),
            map_from_odom: Some(planar(1.0, 2.0, std::f64::consts::FRAC_PI_2)),
            twist: Twist {
                linear_mps: [0.0; 3],
                angular_radps: [0.0; 3],
            },
        });
        assert_eq!(
            plan("odom", 2).unwrap().points_mm,
            [[1000, 2000], [1000, 3000]]
        );
        assert_eq!(plan("base_link", 2), None);
        assert_eq!(planner.plan(b"no path"), None);
    }
}
