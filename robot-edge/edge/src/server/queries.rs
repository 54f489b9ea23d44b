//! Replies to queries: info, digests, tiles, shores, trajectory, octree files.

use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::Duration;

use protocol::keys::Topic;
use protocol::message::{Info, Pong, ShoresRequest};
use protocol::wire;
use serde::Serialize;
use serde::de::DeserializeOwned;
use zenoh::Wait;
use zenoh::query::Query;

use super::open_sessions::{Context, Outgoing, payload};
use crate::publishing::replies;
use network::clock;

/// Polling interval for the end of the network.
pub(super) const POLL_TIMEOUT: Duration = Duration::from_millis(250);

/// Replies to one query after another until the network closes.
pub(super) fn serve(context: &Context, out: &Outgoing, info: &Info, waiting: &Receiver<Query>) {
    while !context.is_closing() {
        let query = match waiting.recv_timeout(POLL_TIMEOUT) {
            Ok(query) => query,
            Err(RecvTimeoutError::Timeout) => continue,
            Err(RecvTimeoutError::Disconnected) => return,
        };
        let replies = answer(context, out, info, &query);
        if replies.is_none() {
            context.publish_state.count_rejected();
        }
        for reply in replies.into_iter().flatten() {
            let key = query.key_expr().clone();
            if let Err(why) = query.reply(key, reply).wait() {
                tracing::debug!(%why, "whoever asked is gone");
                break;
            }
        }
    }
}

/// The replies to `query`; `None` if it is invalid.
fn answer(context: &Context, out: &Outgoing, info: &Info, query: &Query) -> Option<Vec<Vec<u8>>> {
    let store = &context.store;
    let (_, topic) = Topic::parse(query.key_expr().as_str())?;
    let stamp_ns = context.publish_state.stamp_ns();
    Some(match topic {
        Topic::Info => messages(out, stamp_ns, &[context.publish_state.info(info)]),
        Topic::Ping => messages(out, stamp_ns, &[Pong]),
        Topic::Tiles(layer) => {
            let near_m = context.publish_state.position_m().unwrap_or_default();
            stamped(out, &replies::tiles(store, layer, &request(query)?, near_m))
        }
        Topic::Overviews(layer) => {
            stamped(out, &replies::overviews(store, layer, &request(query)?))
        }
        Topic::Digests(layer) => messages(
            out,
            stamp_ns,
            &[replies::digests(store, layer, request(query)?)],
        ),
        Topic::Shores => {
            let ShoresRequest { newer_than } = request(query)?;
            let (stamp_ns, news) = context.publish_state.shores_newer_than(newer_than);
            messages(out, stamp_ns, &[news])
        }
        Topic::Voxels => {
            let (stamp_ns, reply) = context.publish_state.voxels(request(query)?, clock::now());
            messages(out, stamp_ns, &[reply])
        }
        Topic::Trajectory => {
            let (stamp_ns, part) = context
                .publish_state
                .trajectory()
                .snapshot()
                .reply(request(query)?);
            messages(out, stamp_ns, &[part])
        }
        Topic::Alive
        | Topic::Pose
        | Topic::Status
        | Topic::Localization
        | Topic::Plan
        | Topic::Event
        | Topic::MapHead
        | Topic::View
        | Topic::Scan
        | Topic::Changes(_)
        | Topic::Operator(_) => return None,
    })
}

/// Messages, each with a stamp of its own, nanoseconds.
fn stamped<T: Serialize>(out: &Outgoing, bodies: &[(i64, T)]) -> Vec<Vec<u8>> {
    let messages = bodies.iter();
    let messages = messages.filter_map(|(stamp_ns, body)| out.message(*stamp_ns, body));
    messages.collect()
}

fn messages<T: Serialize>(out: &Outgoing, stamp_ns: i64, bodies: &[T]) -> Vec<Vec<u8>> {
    bodies
        .iter()
        .filter_map(|body| out.message(stamp_ns, body))
        .collect()
}

fn request<T: DeserializeOwned>(query: &Query) -> Option<T> {
    let bytes = payload(query.payload()?)?;
    let request =
        wire::decode(&bytes).inspect_err(|why| tracing::debug!(%why, "a question is refused"));
    request.ok().map(|(_, request)| request)
}
