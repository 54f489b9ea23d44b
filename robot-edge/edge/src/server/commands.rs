//! Passes operator messages from Zenoh to the drive loop, and its replies back.

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};

use protocol::keys::{OperatorTopic, Topic, parse_operator_key};
use protocol::message::Answer;
use protocol::signed::MAX_SIGNED_BYTES;
use zenoh::Wait;
use zenoh::bytes::ZBytes;
use zenoh::query::Query;

use super::open_sessions::{Context, Outgoing};
use super::queries::POLL_TIMEOUT;
use crate::driving::{Inbox, Incoming, Reply};
use network::LinkError;

/// Maximum number of replies that wait; an operator without a reply asks again.
const MAX_WAITING_REPLIES: usize = 64;

pub(super) type PendingReply = (Query, Answer);

/// Passes all operator messages to the loop. The receiver yields its replies: the loop must not wait for the network.
pub(super) fn take_commands(
    context: &Context,
    inbox: &Inbox,
) -> Result<Receiver<PendingReply>, LinkError> {
    let declare = |what: &str, why| LinkError::Declare {
        what: what.to_owned(),
        why,
    };
    let key = Topic::Operator(OperatorTopic::Drive).key(&context.robot);
    let (drives, publish_state) = (inbox.clone(), context.publish_state.clone());
    context
        .control
        .declare_subscriber(key.clone())
        .callback(move |sample| {
            let key = sample.key_expr().as_str();
            match incoming(key, sample.payload(), None) {
                Some(incoming) => drives.offer(incoming),
                None => publish_state.count_rejected(),
            }
        })
        .background()
        .wait()
        .map_err(|why| declare(&key, why))?;

    let (replies, pending_replies) = sync_channel(MAX_WAITING_REPLIES);
    for topic in OperatorTopic::ALL {
        if topic == OperatorTopic::Drive {
            continue;
        }
        let key = Topic::Operator(topic).key(&context.robot);
        let (inbox, replies, publish_state) = (
            inbox.clone(),
            replies.clone(),
            context.publish_state.clone(),
        );
        context
            .control
            .declare_queryable(key.clone())
            .complete(true)
            .callback(move |query| {
                let empty = ZBytes::new();
                let payload = query.payload().unwrap_or(&empty).clone();
                let key = query.key_expr().as_str().to_owned();
                match incoming(&key, &payload, Some(reply_sender(query, &replies))) {
                    Some(incoming) => inbox.offer(incoming),
                    None => publish_state.count_rejected(),
                }
            })
            .background()
            .wait()
            .map_err(|why| declare(&key, why))?;
    }
    Ok(pending_replies)
}

/// Sends the replies of the loop until the network closes.
pub(super) fn send_replies(
    context: &Context,
    out: &Outgoing,
    pending_replies: &Receiver<PendingReply>,
) {
    while !context.is_closing() {
        let (query, answer) = match pending_replies.recv_timeout(POLL_TIMEOUT) {
            Ok(pending_replies) => pending_replies,
            Err(RecvTimeoutError::Timeout) => continue,
            Err(RecvTimeoutError::Disconnected) => return,
        };
        let Some(message) = out.message(context.publish_state.stamp_ns(), &answer) else {
            continue;
        };
        if let Err(why) = query.reply(query.key_expr().clone(), message).wait() {
            tracing::debug!(%why, "whoever asked is gone");
        }
    }
}

fn reply_sender(query: Query, replies: &SyncSender<PendingReply>) -> Reply {
    let replies = replies.clone();
    Box::new(move |answer| {
        if replies.try_send((query, answer)).is_err() {
            tracing::warn!("too many answers wait; one was not given");
        }
    })
}

/// A message of an operator; `None` if the key or the length is invalid.
fn incoming(key: &str, payload: &ZBytes, reply: Option<Reply>) -> Option<Incoming> {
    let (_, operator, topic) = parse_operator_key(key)?;
    (payload.len() <= MAX_SIGNED_BYTES).then(|| Incoming {
        topic,
        operator,
        bytes: payload.to_bytes().into_owned(),
        reply,
    })
}
