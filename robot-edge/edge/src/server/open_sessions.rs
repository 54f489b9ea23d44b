//! The open sessions of a vehicle: their declarations and threads.

use std::borrow::Cow;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use protocol::keys::{RobotId, Topic};
use protocol::layer::LayerId;
use protocol::message::View;
use protocol::tile::BootId;
use protocol::tile_store::TileStore;
use protocol::wire::{self, Header};
use serde::Serialize;
use zenoh::bytes::ZBytes;
use zenoh::liveliness::LivelinessToken;
use zenoh::query::Query;
use zenoh::{Session, Wait};

use super::edge::LinkServer;
use super::publish_state::PublishState;
use super::streams::{self, BulkPublishers, TopicPublishers};
use super::{commands, queries};
use crate::driving::SharedDriveState;
use crate::lock;
use crate::publishing::announced_map::{AnnouncedMap, Attention};
use measurement::time::Monotonic;
use network::audit::Audit;
use network::clock;
use network::endpoints::Channel;
use network::sessions::{self, Side};
use network::{LinkError, security, without_source_places};

/// Maximum number of queries that wait; a console without a reply asks again.
const MAX_WAITING_QUERIES: usize = 64;

/// Dropping them closes both sessions.
pub(super) struct OpenSessions {
    context: Arc<Context>,
    threads: Vec<JoinHandle<()>>,
    audit: Option<Audit>,
    // Presence ends when the token is dropped.
    _alive: LivelinessToken,
}

/// Shared by the threads of the sessions.
pub(super) struct Context {
    pub(super) robot: RobotId,
    pub(super) control: Session,
    pub(super) bulk: Session,
    pub(super) publish_state: Arc<PublishState>,
    /// The announced map.
    pub(super) store: Arc<Mutex<TileStore>>,
    announced_map: Arc<Mutex<AnnouncedMap>>,
    pub(super) budget_kbps: u32,
    pub(super) drive_state: Option<Arc<SharedDriveState>>,
    /// These sessions are to end; others may follow.
    is_over: AtomicBool,
}

impl Context {
    pub(super) fn is_closing(&self) -> bool {
        self.is_over.load(Ordering::Relaxed) || self.publish_state.is_closing()
    }

    /// Announces the changes that these consoles are to have now, and queues them.
    pub(super) fn announce(&self, views: &[View], now: Monotonic) {
        let attention = Attention {
            vehicle_m: self.publish_state.position_m(),
            views: views.to_vec(),
        };
        let mut announced_map = lock(&self.announced_map);
        let changed = self.publish_state.take_changed_tiles();
        // Nothing is held back of a map that is announced as final.
        let announced = if self.publish_state.has_ended() {
            announced_map.announce_all(changed)
        } else {
            announced_map.update(changed, &attention, now)
        };
        self.publish_state
            .tiles_announced(announced, announced_map.held());
    }
}

impl OpenSessions {
    /// Whether the control session has a router or another peer; consoles are clients.
    pub(super) fn is_router_connected(&self) -> bool {
        let info = self.context.control.info();
        info.routers_zid().wait().next().is_some() || info.peers_zid().wait().next().is_some()
    }

    /// Opens both sessions with their access control, and starts the threads.
    pub(super) fn open(server: &LinkServer) -> Result<Self, LinkError> {
        let (settings, publish_state) = (&server.settings, &server.publish_state);
        let control = sessions::open(Side::Edge, Channel::Control, &settings.endpoints)?;
        let bulk = sessions::open(Side::Edge, Channel::Bulk, &settings.endpoints)?;
        let drive_state = settings
            .driving
            .as_ref()
            .map(|(_, drive_state)| drive_state);
        let context = Arc::new(Context {
            robot: settings.robot.clone(),
            control: control.clone(),
            bulk: bulk.clone(),
            publish_state: Arc::clone(publish_state),
            store: lock(&server.announced_map).announced(),
            announced_map: Arc::clone(&server.announced_map),
            budget_kbps: settings.budget_kbps,
            drive_state: drive_state.map(Arc::clone),
            is_over: AtomicBool::new(false),
        });

        // A thread of its own, so that a slow receiver of tiles does not delay `ping`.
        let (small_queries, small_waiting) = sync_channel(MAX_WAITING_QUERIES);
        let (queries, waiting) = sync_channel(MAX_WAITING_QUERIES);
        for topic in [Topic::Info, Topic::Ping] {
            declare_queries(
                &control,
                &topic.key(&context.robot),
                &small_queries,
                publish_state,
            )?;
        }
        // Layers that are not mapped are declared too: they reply with an empty list.
        for layer in LayerId::ALL {
            for topic in [Topic::Tiles, Topic::Overviews, Topic::Digests].map(|topic| topic(layer))
            {
                declare_queries(&bulk, &topic.key(&context.robot), &queries, publish_state)?;
            }
        }
        for topic in [Topic::Shores, Topic::Voxels, Topic::Trajectory] {
            declare_queries(&bulk, &topic.key(&context.robot), &queries, publish_state)?;
        }
        watch_views(&context)?;
        let inbox = settings.driving.as_ref().map(|(inbox, _)| inbox);
        let pending_replies = inbox
            .map(|inbox| commands::take_commands(&context, inbox))
            .transpose()?;
        let publishers = TopicPublishers::declare(&context)?;
        let bulk_publishers = BulkPublishers::declare(&context)?;
        let key = Topic::Alive.key(&context.robot);
        let alive = control
            .liveliness()
            .declare_token(key.clone())
            .wait()
            .map_err(|why| LinkError::Declare { what: key, why })?;

        let info = Arc::new(settings.info.clone());
        let out = &server.out;
        let mut threads = Vec::new();
        if let Some(pending_replies) = pending_replies {
            let (context, out) = (Arc::clone(&context), out.clone());
            threads.push(thread::spawn(move || {
                commands::send_replies(&context, &out, &pending_replies);
            }));
        }
        threads.extend([
            thread::spawn({
                let (context, out, info) = (Arc::clone(&context), out.clone(), Arc::clone(&info));
                move || queries::serve(&context, &out, &info, &small_waiting)
            }),
            thread::spawn({
                let (context, out) = (Arc::clone(&context), out.clone());
                move || queries::serve(&context, &out, &info, &waiting)
            }),
            thread::spawn({
                let (context, out) = (Arc::clone(&context), out.clone());
                let max_age = Duration::from_millis(settings.info.max_command_age_ms.into());
                move || streams::send_state(&context, &out, &publishers, max_age)
            }),
            thread::spawn({
                let (context, out) = (Arc::clone(&context), out.clone());
                move || streams::send_tiles(&context, &out, &bulk_publishers)
            }),
        ]);
        Ok(Self {
            context,
            threads,
            audit: settings.endpoints.audit.clone(),
            _alive: alive,
        })
    }
}

impl Drop for OpenSessions {
    fn drop(&mut self) {
        // Sends the final status and events, which contain the reason.
        self.context.publish_state.request_status();
        self.context.is_over.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            if thread.join().is_err() {
                tracing::error!("a thread of the link failed");
            }
        }
        let Context { control, bulk, .. } = &*self.context;
        if let Some(audit) = &self.audit {
            security::audit_closed_links(control, Channel::Control, audit);
            security::audit_closed_links(bulk, Channel::Bulk, audit);
        }
        // In parallel: a peer that does not receive may delay closing.
        thread::scope(|scope| {
            for session in [control, bulk] {
                scope.spawn(|| {
                    if let Err(why) = session.close().wait() {
                        let why = without_source_places(&why);
                        tracing::warn!(%why, "a session did not close");
                    }
                });
            }
        });
    }
}

/// Passes queries for `key` to the thread that replies: Zenoh's own threads must not wait.
fn declare_queries(
    session: &Session,
    key: &str,
    queries: &SyncSender<Query>,
    publish_state: &Arc<PublishState>,
) -> Result<(), LinkError> {
    let (queries, publish_state) = (queries.clone(), Arc::clone(publish_state));
    session
        .declare_queryable(key.to_owned())
        .complete(true)
        .callback(move |query| {
            let is_small = |bytes: &ZBytes| bytes.len() <= wire::MAX_MESSAGE_BYTES;
            let is_fit = query.payload().is_none_or(is_small) && query.attachment().is_none();
            // A query that finds no room gets no reply, which means "ask again".
            let is_taken = is_fit && queries.try_send(query).is_ok();
            if !is_taken {
                publish_state.count_rejected();
            }
        })
        .background()
        .wait()
        .map_err(|why| LinkError::Declare {
            what: key.to_owned(),
            why,
        })
}

/// The bytes of a message; `None` if there are too many.
pub(super) fn payload(bytes: &ZBytes) -> Option<Cow<'_, [u8]>> {
    (bytes.len() <= wire::MAX_MESSAGE_BYTES).then(|| bytes.to_bytes())
}

/// Encodes messages with the header of this run.
#[derive(Clone, Debug)]
pub(super) struct Outgoing {
    boot: BootId,
    seq: Arc<AtomicU64>,
}

impl Outgoing {
    pub(super) fn new(boot: BootId) -> Self {
        Self {
            boot,
            seq: Arc::default(),
        }
    }

    /// The bytes of a message; `None` (with a log line) if it is too long.
    pub(super) fn message<T: Serialize>(&self, robot_time_ns: i64, body: &T) -> Option<Vec<u8>> {
        let seq = self.seq.fetch_add(1, Ordering::Relaxed);
        let header = Header {
            boot: self.boot,
            seq,
            robot_time_ns,
        };
        wire::encode(&header, body)
            .inspect_err(|why| tracing::error!(%why, "a message was not sent"))
            .ok()
    }
}

const MAX_VIEW_BYTES: usize = 256;

fn watch_views(context: &Arc<Context>) -> Result<(), LinkError> {
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
