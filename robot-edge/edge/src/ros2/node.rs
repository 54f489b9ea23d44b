//! This program as a node of a ROS 2 system: its session, its publishers, and the tokens that announce them.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use zenoh::bytes::ZBytes;
use zenoh::key_expr::KeyExpr;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::{Query, Queryable};
use zenoh::sample::Locality;
use zenoh::{Config, Session, Wait as _};

use measurement::time::{Monotonic, RobotTime};
use network::clock;
use network::{random_id, without_source_places};
use recording::ros::middleware::{
    Attachment, PublishedType, bridge_key, history_key, node_token, publisher_token, rmw_keys,
};

/// Name of the node.
const NODE: &str = "foreshore";

const CONNECT_TIMEOUT: Duration = Duration::from_secs(1);
/// Interval of attempts, also after a restart of the router.
const RETRY_PERIOD: Duration = Duration::from_millis(500);
/// Larger messages are ignored.
const MAX_MESSAGE_BYTES: usize = 16 << 20;

/// Until the router has reported the subscribers, Zenoh assumes that there is one.
const MATCHING_DELAY: Duration = Duration::from_secs(1);

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

impl RosLinkError {
    pub(super) fn refused(what: &str) -> impl FnOnce(zenoh::Error) -> Self {
        move |why| Self::Declare {
            what: what.to_owned(),
            why,
        }
    }
}

/// The node. Clones share it; it ends with the last one.
#[derive(Clone)]
pub struct RosNode {
    pub(super) session: Session,
    pub(super) domain: u32,
    /// Number of the newest publisher.
    newest_id: Arc<AtomicU32>,
    _token: Arc<LivelinessToken>,
}

impl std::fmt::Debug for RosNode {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RosNode")
            .field("domain", &self.domain)
            .finish_non_exhaustive()
    }
}

impl RosNode {
    /// Connects and announces the node.
    pub fn open(at: &RosEndpoint) -> Result<Self, RosLinkError> {
        let session =
            zenoh::open(config(&at.endpoint)?)
                .wait()
                .map_err(|why| RosLinkError::Open {
                    endpoint: at.endpoint.clone(),
                    why,
                })?;
        let token = node_token(at.domain, &session.zid().to_string(), NODE);
        let declared = session.liveliness().declare_token(token.clone()).wait();
        Ok(Self {
            _token: Arc::new(declared.map_err(RosLinkError::refused(&token))?),
            session,
            domain: at.domain,
            newest_id: Arc::default(),
        })
    }

    /// A publisher of a topic, which is not announced yet. Its messages do not come back to this session.
    pub fn publisher(
        &self,
        topic: &str,
        kind: PublishedType,
        settings: PublisherSettings,
    ) -> Result<RosPublisher, RosLinkError> {
        let refused = || RosLinkError::refused(topic);
        let publisher = |key: String| {
            self.session
                .declare_publisher(key.clone())
                // As rmw_zenoh does for a bounded history: a slow subscriber delays no other.
                .congestion_control(CongestionControl::Drop)
                .priority(settings.priority)
                .express(settings.priority == Priority::RealTime)
                .allowed_destination(Locality::Remote)
                .wait()
                .map_err(RosLinkError::refused(&key))
        };
        let no_type = || refused()(format!("{} is no name of a type", kind.name).into());
        let keys = rmw_keys(self.domain, topic, kind).ok_or_else(no_type)?;
        let zid = self.session.zid().to_string();
        let id = 1 + self.newest_id.fetch_add(1, Ordering::Relaxed);
        let node = (self.domain, zid.as_str(), NODE);
        Ok(RosPublisher {
            session: self.session.clone(),
            token_key: publisher_token(node, id, (topic, kind), settings.is_kept)
                .ok_or_else(no_type)?,
            token: None,
            history_keys: keys.clone().map(|key| history_key(&key, &zid, id)),
            publishers: keys.into_iter().map(publisher).collect::<Result<_, _>>()?,
            bridged: settings
                .is_bridged
                .then(|| publisher(bridge_key(topic).to_owned()))
                .transpose()?,
            gid: random_id().map_err(|why| refused()(why.into()))?,
            sequence: 0,
            since: clock::now(),
        })
    }
}

#[derive(Clone, Copy, Debug)]
pub struct PublisherSettings {
    pub priority: Priority,
    /// The last message is kept for who subscribes late; see [`RosPublisher::keep`].
    pub is_kept: bool,
    /// Whether there may be a bridge to DDS; see [`RosPublisher::put_bridged`].
    pub is_bridged: bool,
}

/// One topic of one type, under each key that `rmw_zenoh` may have for it.
pub struct RosPublisher {
    session: Session,
    publishers: Vec<Publisher<'static>>,
    bridged: Option<Publisher<'static>>,
    token_key: String,
    token: Option<LivelinessToken>,
    history_keys: [String; 2],
    gid: [u8; 16],
    sequence: i64,
    since: Monotonic,
}

impl RosPublisher {
    /// Lists the topic in the ROS 2 system, or lists it no more.
    pub fn announce(&mut self, is_listed: bool) -> Result<(), RosLinkError> {
        if !is_listed {
            self.token = None;
        } else if self.token.is_none() {
            let declared = self
                .session
                .liveliness()
                .declare_token(self.token_key.clone());
            let refused = RosLinkError::refused(&self.token_key);
            self.token = Some(declared.wait().map_err(refused)?);
        }
        Ok(())
    }

    /// Lets `answer` handle the queries of who subscribes late, each with the key of the reply; it must not wait. Queries are
    /// answered while the result lives.
    pub fn keep(
        &self,
        answer: impl Fn(HistoryQuery) + Clone + Send + Sync + 'static,
    ) -> Result<Vec<Queryable<()>>, RosLinkError> {
        let keys = self.publishers.iter().zip(&self.history_keys);
        let queryables = keys.map(|(publisher, asked)| {
            let (answer, key) = (answer.clone(), publisher.key_expr().clone());
            self.session
                .declare_queryable(asked.clone())
                .callback(move |query| {
                    answer(HistoryQuery {
                        key: key.clone(),
                        query,
                    });
                })
                .wait()
                .map_err(RosLinkError::refused(asked))
        });
        queryables.collect()
    }

    /// Sends a message to the subscribers of `rmw_zenoh`.
    pub fn put(&mut self, message: impl Into<ZBytes>) {
        let (message, attachment) = (message.into(), self.attachment());
        for publisher in &self.publishers {
            put(publisher, &message, attachment);
        }
    }

    /// Sends a message to bridges, whose keys do not name its type.
    pub fn put_bridged(&mut self, message: impl Into<ZBytes>) {
        let attachment = self.attachment();
        if let Some(publisher) = &self.bridged {
            put(publisher, &message.into(), attachment);
        }
    }

    /// Replies with the last message.
    pub fn reply(&mut self, query: &HistoryQuery, message: impl Into<ZBytes>) {
        let attachment = self.attachment().encode();
        let reply = query.query.reply(query.key.clone(), message);
        if let Err(why) = reply.attachment(attachment).wait() {
            let why = without_source_places(&why);
            tracing::warn!(%why, "a late subscriber was not answered");
        }
    }

    pub fn has_subscriber(&self) -> bool {
        clock::elapsed(self.since) >= MATCHING_DELAY
            && self
                .publishers
                .iter()
                .chain(&self.bridged)
                .any(|publisher| {
                    let status = publisher.matching_status().wait();
                    status.is_ok_and(|status| status.matching())
                })
    }

    fn attachment(&mut self) -> Attachment {
        self.sequence += 1;
        Attachment {
            sequence: self.sequence,
            published: RobotTime::from_nanos(clock::nanos_since_1970()),
            gid: self.gid,
        }
    }
}

fn put(publisher: &Publisher<'_>, message: &ZBytes, attachment: Attachment) {
    let put = publisher
        .put(message.clone())
        .attachment(attachment.encode());
    if let Err(why) = put.wait() {
        let why = without_source_places(&why);
        tracing::warn!(%why, key = %publisher.key_expr(), "a message was not published");
    }
}

/// A query for the last message of a topic.
pub struct HistoryQuery {
    key: KeyExpr<'static>,
    query: Query,
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
