//! What consoles say they look at.

use std::sync::Arc;

use protocol::keys::Topic;
use protocol::message::View;
use protocol::wire;
use zenoh::Wait;

use super::LinkError;
use super::open_sessions::{Context, payload};
use crate::clock;

/// A view is small; what is longer is none.
const MAX_VIEW_BYTES: usize = 256;

/// Remembers every view that arrives.
pub(super) fn watch(context: &Arc<Context>) -> Result<(), LinkError> {
    let key = Topic::View.key(&context.robot);
    let publish_state = Arc::clone(&context.publish_state);
    context
        .control
        .declare_subscriber(key.clone())
        .callback(move |sample| {
            let session = sample
                .key_expr()
                .as_str()
                .rsplit('/')
                .next()
                .unwrap_or_default();
            let view = payload(sample.payload())
                .filter(|bytes| bytes.len() <= MAX_VIEW_BYTES && session.len() <= 64)
                .and_then(|bytes| wire::decode::<View>(&bytes).ok());
            match view {
                Some((_, view)) if view.rectangle_m.iter().all(|edge| edge.is_finite()) => {
                    publish_state.set_view(session.to_owned(), view, clock::now());
                }
                Some(_) | None => publish_state.count_rejected(),
            }
        })
        .background()
        .wait()
        .map_err(|why| LinkError::Declare { what: key, why })
}
