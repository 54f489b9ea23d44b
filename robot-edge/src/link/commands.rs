//! What operators send: from Zenoh to the loop that drives, and its answers back.

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

use protocol::keys::{OperatorTopic, Topic, parse_operator_key};
use protocol::message::Answer;
use protocol::signed::MAX_SIGNED_BYTES;
use zenoh::Wait;
use zenoh::bytes::ZBytes;
use zenoh::query::Query;

use super::LinkError;
use super::open_sessions::Context;
use super::outgoing::Outgoing;
use crate::driving::{Inbox, Incoming, Reply};

/// Answers that wait to be sent at most; whoever hears none asks again.
const MAX_ANSWERS: usize = 64;
/// Longest wait before it is asked whether the link closes.
const NAP: Duration = Duration::from_millis(100);

/// An answer on its way out.
pub(super) type Answered = (Query, Answer);

/// Hands all that operators send to the loop. Its answers come out at the other end: the loop must not wait for them.
pub(super) fn take_commands(
    context: &Context,
    inbox: &Inbox,
) -> Result<Receiver<Answered>, LinkError> {
    let declare = |what: &str, why| LinkError::Declare {
        what: what.to_owned(),
        why,
    };
    let key = Topic::Operator(OperatorTopic::Drive).key(&context.robot);
    let (drives, shared) = (inbox.clone(), context.shared.clone());
    context
        .control
        .declare_subscriber(key.clone())
        .callback(move |sample| {
            let key = sample.key_expr().as_str();
            match incoming(key, sample.payload(), None) {
                Some(incoming) => drives.offer(incoming),
                None => shared.refuse(),
            }
        })
        .background()
        .wait()
        .map_err(|why| declare(&key, why))?;

    let (answers, answered) = sync_channel(MAX_ANSWERS);
    for topic in OperatorTopic::ALL {
        if topic == OperatorTopic::Drive {
            continue;
        }
        let key = Topic::Operator(topic).key(&context.robot);
        let (inbox, answers, shared) = (inbox.clone(), answers.clone(), context.shared.clone());
        context
            .control
            .declare_queryable(key.clone())
            .complete(true)
            .callback(move |query| {
                let empty = ZBytes::new();
                let payload = query.payload().unwrap_or(&empty).clone();
                let key = query.key_expr().as_str().to_owned();
                match incoming(&key, &payload, Some(reply_to(query, &answers))) {
                    Some(incoming) => inbox.offer(incoming),
                    None => shared.refuse(),
                }
            })
            .background()
            .wait()
            .map_err(|why| declare(&key, why))?;
    }
    Ok(answered)
}

/// Sends the answers of the loop until the link closes.
pub(super) fn send_answers(context: &Context, out: &Outgoing, answered: &Receiver<Answered>) {
    while !context.is_closing() {
        let (query, answer) = match answered.recv_timeout(NAP) {
            Ok(answered) => answered,
            Err(RecvTimeoutError::Timeout) => continue,
            Err(RecvTimeoutError::Disconnected) => return,
        };
        let Some(message) = out.message(context.shared.stamp_ns(), &answer) else {
            continue;
        };
        if let Err(why) = query.reply(query.key_expr().clone(), message).wait() {
            tracing::debug!(%why, "whoever asked is gone");
        }
    }
}

fn reply_to(query: Query, answers: &SyncSender<Answered>) -> Reply {
    let answers = answers.clone();
    Box::new(move |answer| {
        if answers.try_send((query, answer)).is_err() {
            tracing::warn!("too many answers wait; one was not given");
        }
    })
}

/// A message of an operator, if its key is one's and it is short enough.
fn incoming(key: &str, payload: &ZBytes, reply: Option<Reply>) -> Option<Incoming> {
    let (_, operator, topic) = parse_operator_key(key)?;
    (payload.len() <= MAX_SIGNED_BYTES).then(|| Incoming {
        topic,
        operator,
        bytes: payload.to_bytes().into_owned(),
        reply,
    })
}
