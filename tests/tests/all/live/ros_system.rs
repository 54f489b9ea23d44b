//! A ROS 2 system seen from Zenoh: `rmw_zenoh` behind its router, or `zenoh-bridge-ros2dds`.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::thread::sleep;
use std::time::Duration;

use measurement::scan::Scan;
use measurement::time::RobotTime;
use measurement::{Measurement, MeasurementData, StreamId};
use network::clock;
use recording::ros;
use recording::ros::middleware::{Attachment, PublishedType};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::CongestionControl;
use zenoh::query::Queryable;
use zenoh::sample::Sample;
use zenoh::{Session, Wait as _};

use crate::processes::{tcp, wait_until};

/// Type hash of every published topic; the edge must ignore it.
const HASH: &str = "RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828";

const GID: [u8; 16] = *b"sixteen bytes...";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RosMiddleware {
    Rmw { domain: u32 },
    Bridge,
}

/// A router and every publisher behind it.
pub(super) struct RosSystem {
    port: u16,
    session: Session,
    ros_middleware: RosMiddleware,
    topics: BTreeMap<String, Topic>,
    kept: Vec<Queryable<()>>,
    listeners: Vec<Subscriber<()>>,
    takers: Vec<LivelinessToken>,
}

/// A velocity as a ROS 2 node receives it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Twist {
    pub(super) sequence: i64,
    pub(super) linear_x: f64,
    pub(super) angular_z: f64,
}

impl Twist {
    /// As `rmw_zenoh` reads it, which drops messages without an attachment; `is_stamped`: it begins with a stamp and the
    /// frame `base_link`.
    fn of(sample: &Sample, ros_middleware: RosMiddleware, is_stamped: bool) -> Self {
        let message = sample.payload().to_bytes();
        let header = if is_stamped { 24 } else { 0 };
        assert_eq!(
            (message.len(), &message[..4]),
            (52 + header, &[0, 1, 0, 0][..])
        );
        if is_stamped {
            let stamp_s = u32::from_le_bytes(message[4..8].try_into().unwrap());
            assert!(clock::seconds_since_1970().abs_diff(stamp_s.into()) < 60);
            assert_eq!(&message[12..26], b"\x0a\0\0\0base_link\0");
        }
        let number = |index: usize| {
            let bytes = &message[4 + header + 8 * index..][..8];
            f64::from_le_bytes(bytes.try_into().unwrap())
        };
        let attachment = sample.attachment().map(|bytes| bytes.to_bytes());
        let sequence = match ros_middleware {
            RosMiddleware::Rmw { .. } => Attachment::decode(&attachment.unwrap()).unwrap().sequence,
            RosMiddleware::Bridge => 0,
        };
        for other in [1, 2, 3, 4] {
            assert_eq!(number(other).to_bits(), 0);
        }
        Self {
            sequence,
            linear_x: number(0),
            angular_z: number(5),
        }
    }

    pub(super) const fn is_zero(&self) -> bool {
        self.linear_x.to_bits() == 0 && self.angular_z.to_bits() == 0
    }
}

struct Topic {
    publisher: Publisher<'static>,
    sent: i64,
    _token: LivelinessToken,
}

impl RosSystem {
    pub(super) fn start(port: u16, ros_middleware: RosMiddleware) -> Self {
        let mut config = zenoh::Config::default();
        for (key, value) in [
            ("mode", "\"router\"".to_owned()),
            ("listen/endpoints", format!("[\"tcp/127.0.0.1:{port}\"]")),
            ("scouting/multicast/enabled", "false".to_owned()),
            ("scouting/gossip/enabled", "false".to_owned()),
        ] {
            config.insert_json5(key, &value).unwrap();
        }
        Self {
            port,
            session: zenoh::open(config).wait().unwrap(),
            ros_middleware,
            topics: BTreeMap::new(),
            kept: Vec::new(),
            listeners: Vec::new(),
            takers: Vec::new(),
        }
    }

    pub(super) fn endpoint(&self) -> String {
        tcp(self.port)
    }

    /// A node begins to publish on this topic; `type_name` as in `sensor_msgs/msg/LaserScan`.
    pub(super) fn announce(&mut self, topic: &str, type_name: &str) {
        let session = &self.session;
        let token = session
            .liveliness()
            .declare_token(self.token("MP", topic, type_name));
        let publisher = session
            .declare_publisher(self.key(topic, type_name))
            .congestion_control(CongestionControl::Block);
        let topic_of = Topic {
            publisher: publisher.wait().unwrap(),
            sent: 0,
            _token: token.wait().unwrap(),
        };
        self.topics.insert(topic.to_owned(), topic_of);
    }

    /// A message kept for late subscribers, which query it.
    pub(super) fn keep(&mut self, topic: &str, type_name: &str, message: &[u8]) {
        let key = self.key(topic, type_name);
        let zid = self.session.zid();
        let asked = match self.ros_middleware {
            RosMiddleware::Rmw { .. } => format!("{key}/@adv/pub/{zid}/7/_"),
            RosMiddleware::Bridge => format!("@ros2_pub_cache/{zid}/{key}"),
        };
        let message = message.to_vec();
        let queryable = self
            .session
            .declare_queryable(asked)
            .callback(move |query| {
                query.reply(key.clone(), message.clone()).wait().unwrap();
            })
            .wait()
            .unwrap();
        self.kept.push(queryable);
    }

    pub(super) fn wait_for_subscriber(&self, topic: &str) {
        let publisher = &self.topics[topic].publisher;
        wait_until(&format!("a subscriber of {topic}"), || {
            publisher.matching_status().wait().unwrap().matching()
        });
    }

    /// Publishes a message: CDR behind its encapsulation header.
    pub(super) fn publish(&mut self, topic: &str, message: &[u8]) {
        let to = self.topics.get_mut(topic).unwrap();
        to.sent += 1;
        let put = to.publisher.put(message);
        let put = match self.ros_middleware {
            RosMiddleware::Rmw { .. } => {
                let attachment = Attachment {
                    sequence: to.sent,
                    published: RobotTime::from_nanos(1),
                    gid: GID,
                };
                put.attachment(attachment.encode())
            }
            RosMiddleware::Bridge => put,
        };
        put.wait().unwrap();
    }

    /// Subscribes to velocities of this type, and announces that; returns them in order of arrival.
    pub(super) fn subscribe_twist(
        &mut self,
        topic: &str,
        type_name: &str,
    ) -> Arc<Mutex<Vec<Twist>>> {
        let received = Arc::new(Mutex::new(Vec::new()));
        let token = self.token("MS", topic, type_name);
        let token = self.session.liveliness().declare_token(token).wait();
        self.takers.push(token.unwrap());
        let is_stamped = type_name.ends_with("Stamped");
        let subscriber = self
            .session
            .declare_subscriber(self.key(topic, type_name))
            .callback({
                let (received, ros_middleware) = (Arc::clone(&received), self.ros_middleware);
                move |sample| {
                    received
                        .lock()
                        .unwrap()
                        .push(Twist::of(&sample, ros_middleware, is_stamped));
                }
            })
            .wait()
            .unwrap();
        self.listeners.push(subscriber);
        received
    }

    /// Publishes scans at 10 Hz from number `from`; returns the next number.
    pub(super) fn sweep_until(&mut self, from: u32, is_over: impl Fn() -> bool) -> u32 {
        let mut tick = from;
        while !is_over() {
            self.publish("/scan", &scan_message(tick));
            sleep(Duration::from_millis(100));
            tick += 1;
        }
        tick
    }

    fn key(&self, topic: &str, type_name: &str) -> String {
        let bare = topic.trim_start_matches('/');
        match self.ros_middleware {
            RosMiddleware::Rmw { domain } => {
                // A node subscribes to the hash of its definition only.
                let hash = match type_name {
                    "geometry_msgs/msg/Twist" => PublishedType::TWIST.hash,
                    "geometry_msgs/msg/TwistStamped" => PublishedType::TWIST_STAMPED.hash,
                    _ => HASH,
                };
                format!("{domain}/{bare}/{}/{hash}", dds(type_name))
            }
            RosMiddleware::Bridge => bare.to_owned(),
        }
    }

    fn token(&self, end: &str, topic: &str, type_name: &str) -> String {
        let zid = self.session.zid();
        match self.ros_middleware {
            RosMiddleware::Rmw { domain } => format!(
                "@ros2_lv/{domain}/{zid}/0/{}/{end}/%/%/robot/{}/{}/{HASH}/1:2:1,10:,:,:,,",
                self.topics.len() + 1,
                topic.replace('/', "%"),
                dds(type_name)
            ),
            RosMiddleware::Bridge => format!(
                "@/{zid}/@ros2_lv/{end}/{}/{}/:::1,10",
                topic.trim_start_matches('/').replace('/', "§"),
                type_name.replace('/', "§")
            ),
        }
    }
}

/// `sensor_msgs/msg/LaserScan` → `sensor_msgs::msg::dds_::LaserScan_`.
fn dds(type_name: &str) -> String {
    let (package, name) = type_name.split_once("/msg/").unwrap();
    format!("{package}::msg::dds_::{name}_")
}

fn scan_message(tick: u32) -> Vec<u8> {
    let scan = Measurement {
        stamp: RobotTime::from_nanos(1_790_000_000_000_000_000 + i64::from(tick) * 100_000_000),
        stream: StreamId(0),
        frame: "laser".into(),
        data: MeasurementData::Scan {
            scan: Scan {
                angle_min_rad: -3.0,
                angle_increment_rad: 0.05,
                time_increment_s: 0.0,
                range_min_m: 0.1,
                range_max_m: 10.0,
                ranges_m: vec![5.0; 120],
            },
            own_pose: None,
        },
    };
    ros::encode(&scan, "").unwrap().1
}
