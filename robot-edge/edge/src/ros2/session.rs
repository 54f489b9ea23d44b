//! Subscriptions and announcements of the ROS 2 session.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use zenoh::Wait as _;
use zenoh::query::{QueryTarget, ReplyKeyExpr};
use zenoh::sample::{Sample, SampleKind};

use super::inbox::{Inbox, InboxSender, RosMessage};
use super::node::{RosEndpoint, RosLinkError, RosNode};
use crate::lock;
use measurement::Stream;
use network::clock;
use recording::ros::MessageType;
use recording::ros::middleware::{
    Attachment, DiscoveredTopic, TopicEnd, parse_token, rmw_pattern, rmw_stream,
    static_transform_history, token_patterns,
};

/// Limit for replies with static transforms.
const HISTORY_TIMEOUT: Duration = Duration::from_secs(2);
/// Maximum number of announcements, far more than the publishers of a robot.
const MAX_ANNOUNCED: usize = 4096;

/// A connection to a ROS 2 system. Clones share it; it ends with the last one.
#[derive(Clone)]
pub struct RosLink {
    node: RosNode,
    sender: InboxSender,
    announced: Arc<Mutex<Announcements>>,
    takes_clouds: bool,
    ignored: Arc<[String]>,
}

impl std::fmt::Debug for RosLink {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RosLink")
            .field("node", &self.node)
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
    ignored: Arc<[String]>,
}

impl RosLink {
    /// Connects, and subscribes to all mappable topics but `ignored`; to those of clouds, which are large, only with
    /// `takes_clouds`.
    pub fn open(
        at: &RosEndpoint,
        takes_clouds: bool,
        ignored: &[String],
    ) -> Result<(Self, Inbox), RosLinkError> {
        let (sender, inbox) = Inbox::new();
        let ignored: Arc<[String]> = ignored.into();
        let link = Self {
            node: RosNode::open(at)?,
            sender,
            announced: Arc::new(Mutex::new(Announcements {
                takes_clouds,
                ignored: Arc::clone(&ignored),
                ..Announcements::default()
            })),
            takes_clouds,
            ignored,
        };
        link.subscribe_to_rmw()?;
        link.listen_to_announcements()?;
        Ok((link, inbox))
    }

    /// Requests static transforms from their publishers. The replies arrive as messages.
    pub fn request_history(&self) -> Result<(), RosLinkError> {
        for key in static_transform_history(self.node.domain)
            .iter()
            .map(String::as_str)
        {
            let (sender, domain) = (self.sender.clone(), self.node.domain);
            self.node
                .session
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
                .map_err(RosLinkError::refused(key))?;
        }
        Ok(())
    }

    /// Subscribes to the topics that bridges announced since the last call. It must not run in the callback, for
    /// which Zenoh waits.
    pub fn subscribe_to_announced(&self) -> Result<(), RosLinkError> {
        let new = std::mem::take(&mut lock(&self.announced).new_keys);
        for (key, stream) in new {
            let sender = self.sender.clone();
            self.node
                .session
                .declare_subscriber(key.clone())
                .callback(move |sample| offer(&sender, &sample, || Some(stream.clone())))
                .background()
                .wait()
                .map_err(RosLinkError::refused(&key))?;
        }
        Ok(())
    }

    pub const fn node(&self) -> &RosNode {
        &self.node
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
            let Some(pattern) = rmw_pattern(self.node.domain, type_name) else {
                continue;
            };
            let (sender, domain) = (self.sender.clone(), self.node.domain);
            let ignored = Arc::clone(&self.ignored);
            self.node
                .session
                .declare_subscriber(pattern.clone())
                .callback(move |sample| {
                    let stream = rmw_stream(domain, sample.key_expr().as_str());
                    // Before the queue: what is ignored takes no room in it.
                    if let Some(stream) = stream.filter(|stream| !ignored.contains(&stream.name)) {
                        offer(&sender, &sample, || Some(stream));
                    }
                })
                .background()
                .wait()
                .map_err(RosLinkError::refused(&pattern))?;
        }
        Ok(())
    }

    fn listen_to_announcements(&self) -> Result<(), RosLinkError> {
        for pattern in token_patterns(self.node.domain, TopicEnd::Publisher) {
            let announcements = Arc::clone(&self.announced);
            self.node
                .session
                .liveliness()
                .declare_subscriber(pattern.clone())
                .history(true)
                .callback(move |sample| {
                    lock(&announcements).take(sample.key_expr().as_str(), sample.kind());
                })
                .background()
                .wait()
                .map_err(RosLinkError::refused(&pattern))?;
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
        let Some(announced) = parse_token(token, TopicEnd::Publisher) else {
            return;
        };
        if self.ignored.contains(&announced.stream.name) {
            return;
        }
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
