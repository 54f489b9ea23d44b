//! The subscribers of one topic, as they announce themselves.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard};

use zenoh::Wait as _;
use zenoh::pubsub::Subscriber;
use zenoh::sample::SampleKind;

use super::node::{RosLinkError, RosNode};
use crate::lock;
use recording::ros::middleware::{DiscoveredTopic, TopicEnd, parse_token, token_patterns};

/// Maximum number of subscribers that are remembered, far more than one topic has.
const MAX_SUBSCRIBERS: usize = 64;

/// The announced subscribers of a topic, by token: topics of bridges have a key.
pub(super) type Subscribers = BTreeMap<String, DiscoveredTopic>;

pub(super) struct SubscriberWatch {
    subscribers: Arc<Mutex<Subscribers>>,
    _tokens: Vec<Subscriber<()>>,
}

impl SubscriberWatch {
    pub(super) fn new(node: &RosNode, topic: &str) -> Result<Self, RosLinkError> {
        let subscribers: Arc<Mutex<Subscribers>> = Arc::default();
        let listen = |pattern: String| {
            let (subscribers, topic) = (Arc::clone(&subscribers), topic.to_owned());
            node.session
                .liveliness()
                .declare_subscriber(pattern.clone())
                .history(true)
                .callback(move |sample| {
                    let token = sample.key_expr().as_str();
                    let mut subscribers = lock(&subscribers);
                    if sample.kind() == SampleKind::Delete {
                        subscribers.remove(token);
                    } else if let Some(taken) = parse_token(token, TopicEnd::Subscriber)
                        && taken.stream.name == topic
                        && subscribers.len() < MAX_SUBSCRIBERS
                    {
                        subscribers.insert(token.to_owned(), taken);
                    }
                })
                .wait()
                .map_err(RosLinkError::refused(&pattern))
        };
        let tokens = token_patterns(node.domain, TopicEnd::Subscriber)
            .into_iter()
            .map(listen);
        Ok(Self {
            _tokens: tokens.collect::<Result<_, _>>()?,
            subscribers,
        })
    }

    pub(super) fn get(&self) -> MutexGuard<'_, Subscribers> {
        lock(&self.subscribers)
    }
}
