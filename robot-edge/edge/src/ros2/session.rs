//! Subscriptions, announcements and published velocities of the ROS 2 session.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::{QueryTarget, ReplyKeyExpr};
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Config, Session, Wait as _};

use super::inbox::{Inbox, InboxSender, RosMessage};
use crate::actuators::Velocity;
use crate::actuators::published_velocity::VelocitySink;
use crate::lock;
use measurement::time::{Monotonic, RobotTime};
use measurement::{Stream, Twist};
use network::clock::{self, seconds_since_1970};
use network::{random_id, without_source_places};
use recording::ros::middleware::Attachment;
use recording::ros::middleware::{
    DiscoveredTopic, parse_token, rmw_pattern, rmw_stream, static_transform_history,
    token_patterns, twist_keys,
};
use recording::ros::{MessageType, twist_message};

const CONNECT_TIMEOUT: Duration = Duration::from_secs(1);
/// Interval of attempts, also after a restart of the router.
const RETRY_PERIOD: Duration = Duration::from_millis(500);
/// Limit for replies with static transforms.
const HISTORY_TIMEOUT: Duration = Duration::from_secs(2);
/// Larger messages are ignored.
const MAX_MESSAGE_BYTES: usize = 16 << 20;
/// Maximum number of announcements, far more than the publishers of a robot.
const MAX_ANNOUNCED: usize = 4096;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RosEndpoint {
    /// Its Zenoh router or bridge.
    pub endpoint: String,
    /// Its domain; the keys of bridges contain none.
    pub domain: u32,
}

#[derive(Debug, thiserror::Error)]
pub enum RosLinkError {
    #[error("Zenoh does not take {key} = {value}: {why}", why = without_source_places(why))]
    Setting {
        key: &'static str,
        value: String,
        why: zenoh::Error,
    },
    #[error("no answer at {endpoint}: {why}", why = without_source_places(why))]
    Open { endpoint: String, why: zenoh::Error },
    #[error("Zenoh refused {what}: {why}", why = without_source_places(why))]
    Declare { what: String, why: zenoh::Error },
}

/// A connection to a ROS 2 system. Clones share it; it ends with the last one.
#[derive(Clone)]
pub struct RosLink {
    session: Session,
    domain: u32,
    sender: InboxSender,
    announced: Arc<Mutex<Announcements>>,
    takes_clouds: bool,
}

impl std::fmt::Debug for RosLink {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RosLink")
            .field("domain", &self.domain)
            .finish_non_exhaustive()
    }
}

#[derive(Default)]
struct Announcements {
    by_token: BTreeMap<String, DiscoveredTopic>,
    /// Announced keys of bridges without subscription.
    new_keys: Vec<(String, Stream)>,
    known_keys: Vec<String>,
    takes_clouds: bool,
}

impl RosLink {
    /// Connects, and subscribes to all mappable topics; to those of clouds, which are large, only with `takes_clouds`.
    pub fn open(at: &RosEndpoint, takes_clouds: bool) -> Result<(Self, Inbox), RosLinkError> {
        let session =
            zenoh::open(config(&at.endpoint)?)
                .wait()
                .map_err(|why| RosLinkError::Open {
                    endpoint: at.endpoint.clone(),
                    why,
                })?;
        let (sender, inbox) = Inbox::new();
        let link = Self {
            session,
            domain: at.domain,
            sender,
            announced: Arc::new(Mutex::new(Announcements {
                takes_clouds,
                ..Announcements::default()
            })),
            takes_clouds,
        };
        link.subscribe_to_rmw()?;
        link.listen_to_announcements()?;
        Ok((link, inbox))
    }

    /// Requests static transforms from their publishers. The replies arrive as messages.
    pub fn request_history(&self) -> Result<(), RosLinkError> {
        for key in static_transform_history(self.domain)
            .iter()
            .map(String::as_str)
        {
            let (sender, domain) = (self.sender.clone(), self.domain);
            self.session
                .get(key)
                .target(QueryTarget::All)
                .accept_replies(ReplyKeyExpr::Any)
                .timeout(HISTORY_TIMEOUT)
                .callback(move |reply| {
                    if let Ok(sample) = reply.result() {
                        let key = sample.key_expr().as_str();
                        let stream = rmw_stream(domain, key).unwrap_or_else(|| Stream {
                            name: format!("/{key}"),
                            type_name: "tf2_msgs/TFMessage".to_owned(),
                        });
                        offer(&sender, sample, || Some(stream));
                    }
                })
                .wait()
                .map_err(|why| refused(key, why))?;
        }
        Ok(())
    }

    /// Subscribes to the topics that bridges announced since the last call. It must not run in the callback, for
    /// which Zenoh waits.
    pub fn subscribe_to_announced(&self) -> Result<(), RosLinkError> {
        let new = std::mem::take(&mut lock(&self.announced).new_keys);
        for (key, stream) in new {
            let sender = self.sender.clone();
            self.session
                .declare_subscriber(key.clone())
                .callback(move |sample| offer(&sender, &sample, || Some(stream.clone())))
                .background()
                .wait()
                .map_err(|why| refused(&key, why))?;
        }
        Ok(())
    }

    pub fn twist_publisher(&self, topic: &str) -> Result<TwistPublisher, RosLinkError> {
        let gid = random_id().map_err(|why| refused(topic, why.into()))?;
        TwistPublisher::new(&self.session, twist_keys(self.domain, topic), gid)
    }

    /// The announced topics, sorted by name.
    pub fn announced(&self) -> Vec<Stream> {
        let announcements = lock(&self.announced);
        let streams = announcements.by_token.values();
        let mut streams: Vec<_> = streams.map(|announced| announced.stream.clone()).collect();
        streams.sort_by(|a, b| (&a.name, &a.type_name).cmp(&(&b.name, &b.type_name)));
        streams.dedup();
        streams
    }

    /// The keys of `rmw_zenoh` contain the type, so that no announcement is needed.
    fn subscribe_to_rmw(&self) -> Result<(), RosLinkError> {
        for (kind, type_name) in MessageType::all() {
            if !is_mapped(kind, self.takes_clouds) {
                continue;
            }
            let Some(pattern) = rmw_pattern(self.domain, type_name) else {
                continue;
            };
            let (sender, domain) = (self.sender.clone(), self.domain);
            self.session
                .declare_subscriber(pattern.clone())
                .callback(move |sample| {
                    offer(&sender, &sample, || {
                        rmw_stream(domain, sample.key_expr().as_str())
                    });
                })
                .background()
                .wait()
                .map_err(|why| refused(&pattern, why))?;
        }
        Ok(())
    }

    fn listen_to_announcements(&self) -> Result<(), RosLinkError> {
        for pattern in token_patterns(self.domain) {
            let announcements = Arc::clone(&self.announced);
            self.session
                .liveliness()
                .declare_subscriber(pattern.clone())
                .history(true)
                .callback(move |sample| {
                    lock(&announcements).take(sample.key_expr().as_str(), sample.kind());
                })
                .background()
                .wait()
                .map_err(|why| refused(&pattern, why))?;
        }
        Ok(())
    }
}

impl Announcements {
    fn take(&mut self, token: &str, kind: SampleKind) {
        if kind == SampleKind::Delete {
            self.by_token.remove(token);
            return;
        }
        let Some(announced) = parse_token(token) else {
            return;
        };
        if self.by_token.len() >= MAX_ANNOUNCED || self.known_keys.len() >= MAX_ANNOUNCED {
            return;
        }
        let kind = MessageType::from_type_name(&announced.stream.type_name);
        let is_mapped = kind.is_some_and(|kind| is_mapped(kind, self.takes_clouds));
        if let Some(key) = &announced.key
            && is_mapped
            && !self.known_keys.contains(key)
        {
            self.known_keys.push(key.clone());
            self.new_keys.push((key.clone(), announced.stream.clone()));
        }
        self.by_token.insert(token.to_owned(), announced);
    }
}

const fn is_mapped(kind: MessageType, takes_clouds: bool) -> bool {
    takes_clouds || !kind.is_cloud()
}

fn offer(sender: &InboxSender, sample: &Sample, stream: impl FnOnce() -> Option<Stream>) {
    let received_at = clock::now();
    if sample.kind() != SampleKind::Put {
        return;
    }
    let payload = sample.payload();
    sender.offer(payload.len(), || {
        let attachment = sample.attachment().map(|bytes| bytes.to_bytes());
        let attachment = attachment.and_then(|bytes| Attachment::decode(&bytes));
        Some(RosMessage {
            stream: stream()?,
            payload: payload.to_bytes().into_owned(),
            published: attachment.map(|attachment| attachment.published),
            received_at,
        })
    });
}

fn refused(what: &str, why: zenoh::Error) -> RosLinkError {
    RosLinkError::Declare {
        what: what.to_owned(),
        why,
    }
}

fn config(endpoint: &str) -> Result<Config, RosLinkError> {
    let mut config = Config::default();
    let text = |text: &str| serde_json::Value::from(text).to_string();
    let retry_ms = RETRY_PERIOD.as_millis();
    for (key, value) in [
        ("mode", text("client")),
        ("connect/endpoints", format!("[{}]", text(endpoint))),
        (
            "connect/timeout_ms",
            CONNECT_TIMEOUT.as_millis().to_string(),
        ),
        (
            "connect/retry",
            format!(
                "{{ period_init_ms: {retry_ms}, period_max_ms: {retry_ms}, period_increase_factor: 1 }}"
            ),
        ),
        ("listen/endpoints", "[]".to_owned()),
        ("scouting/multicast/enabled", false.to_string()),
        ("scouting/gossip/enabled", false.to_string()),
        (
            "transport/link/rx/max_message_size",
            MAX_MESSAGE_BYTES.to_string(),
        ),
        ("transport/shared_memory/enabled", false.to_string()),
        ("adminspace/enabled", false.to_string()),
    ] {
        if let Err(why) = config.insert_json5(key, &value) {
            return Err(RosLinkError::Setting { key, value, why });
        }
    }
    Ok(config)
}

/// One topic, under each key that it may have.
pub struct TwistPublisher {
    publishers: Vec<Publisher<'static>>,
    gid: [u8; 16],
    sequence: i64,
    since: Monotonic,
}

/// Until the router has reported the subscribers, Zenoh assumes that there is one.
const MATCHING_DELAY: Duration = Duration::from_secs(1);

impl TwistPublisher {
    pub(super) fn new(
        session: &zenoh::Session,
        keys: impl IntoIterator<Item = String>,
        gid: [u8; 16],
    ) -> Result<Self, RosLinkError> {
        let publisher = |key: String| {
            session
                .declare_publisher(key.clone())
                .congestion_control(CongestionControl::Drop)
                .priority(Priority::RealTime)
                .express(true)
                .wait()
                .map_err(|why| RosLinkError::Declare { what: key, why })
        };
        Ok(Self {
            publishers: keys.into_iter().map(publisher).collect::<Result<_, _>>()?,
            gid,
            sequence: 0,
            since: clock::now(),
        })
    }
}

impl VelocitySink for TwistPublisher {
    fn publish(&mut self, velocity: Velocity) {
        self.sequence += 1;
        let seconds = i64::try_from(seconds_since_1970()).unwrap_or(0);
        let attachment = Attachment {
            sequence: self.sequence,
            published: RobotTime::from_nanos(seconds.saturating_mul(1_000_000_000)),
            gid: self.gid,
        };
        let payload = twist_message(&Twist {
            linear_mps: [velocity.linear_mps, velocity.lateral_mps, 0.0],
            angular_radps: [0.0, 0.0, velocity.angular_radps],
        });
        for publisher in &self.publishers {
            let put = publisher
                .put(payload.clone())
                .attachment(attachment.encode());
            if let Err(why) = put.wait() {
                let why = without_source_places(&why);
                tracing::warn!(%why, "a velocity was not published");
            }
        }
    }

    fn has_subscriber(&self) -> bool {
        clock::elapsed(self.since) >= MATCHING_DELAY
            && self.publishers.iter().any(|publisher| {
                let status = publisher.matching_status().wait();
                status.is_ok_and(|status| status.matching())
            })
    }
}
