//! The vehicle's side of the link: what it declares, and the threads that serve it.

use std::borrow::Cow;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};

use protocol::keys::{RobotId, Topic};
use protocol::layer::LayerId;
use protocol::message::Info;
use protocol::tile::BootId;
use protocol::tile::codec::Encoder;
use protocol::tile_store::TileStore;
use protocol::wire;
use zenoh::bytes::ZBytes;
use zenoh::liveliness::LivelinessToken;
use zenoh::query::Query;
use zenoh::{Session, Wait};

use super::endpoints::Channel;
use super::outgoing::Outgoing;
use super::sessions::{self, Endpoints, Side};
use super::shared::Shared;
use super::streams::{self, StatePublishers};
use super::{LinkError, commands, queries, views};
use crate::driving::{Board, Inbox};

/// Questions that wait for an answer at most; whoever asks beyond that asks again.
const MAX_QUERIES: usize = 64;

/// What a robot is called and how it is reached.
#[derive(Clone, Debug)]
pub struct EdgeSettings {
    /// Its name.
    pub robot: RobotId,
    /// This run.
    pub boot: BootId,
    /// Where.
    pub endpoints: Endpoints,
    /// Tiles' share of the link, kilobits (10³ bits) per second.
    pub budget_kbps: u32,
    /// Who it is.
    pub info: Info,
    /// What drives it, if it can be driven.
    pub driving: Option<(Inbox, Arc<Board>)>,
}

/// An open link. Dropping it closes it.
pub struct EdgeLink {
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
    control: Session,
    bulk: Session,
    // Presence ends with the token.
    _alive: LivelinessToken,
}

/// What every thread of the link holds.
pub(super) struct Context {
    pub(super) robot: RobotId,
    pub(super) control: Session,
    pub(super) bulk: Session,
    pub(super) shared: Arc<Shared>,
    pub(super) store: Arc<Mutex<TileStore>>,
    pub(super) budget_kbps: u32,
    pub(super) board: Option<Arc<Board>>,
}

impl EdgeLink {
    /// Opens both sessions and starts to serve `store` and `shared`.
    ///
    /// # Errors
    /// Where a session cannot be opened or Zenoh refuses a declaration.
    pub fn open(
        settings: EdgeSettings,
        store: Arc<Mutex<TileStore>>,
        shared: Arc<Shared>,
    ) -> Result<Self, LinkError> {
        let control = sessions::open(Side::Edge, Channel::Control, &settings.endpoints)?;
        let bulk = sessions::open(Side::Edge, Channel::Bulk, &settings.endpoints)?;
        let context = Arc::new(Context {
            robot: settings.robot,
            control: control.clone(),
            bulk: bulk.clone(),
            shared: Arc::clone(&shared),
            store,
            budget_kbps: settings.budget_kbps,
            board: settings
                .driving
                .as_ref()
                .map(|(_, board)| Arc::clone(board)),
        });

        // Apart, so that whoever is slow to take tiles holds up no answer to `ping`.
        let (small_questions, small_waiting) = sync_channel(MAX_QUERIES);
        let (questions, waiting) = sync_channel(MAX_QUERIES);
        for topic in [Topic::Info, Topic::Ping] {
            take_questions(
                &control,
                &topic.key(&context.robot),
                &small_questions,
                &shared,
            )?;
        }
        // Layers that the robot does not map too: their answer is an empty list, and not silence.
        for layer in LayerId::ALL {
            for topic in [Topic::Tiles(layer), Topic::Digests(layer)] {
                take_questions(&bulk, &topic.key(&context.robot), &questions, &shared)?;
            }
        }
        for topic in [Topic::Shores, Topic::Voxels, Topic::Trajectory] {
            take_questions(&bulk, &topic.key(&context.robot), &questions, &shared)?;
        }
        views::watch(&context)?;
        let inbox = settings.driving.map(|(inbox, _)| inbox);
        let answered = inbox
            .map(|inbox| commands::take_commands(&context, &inbox))
            .transpose()?;
        let publishers = StatePublishers::declare(&context)?;
        let key = Topic::Alive.key(&context.robot);
        let alive = control
            .liveliness()
            .declare_token(key.clone())
            .wait()
            .map_err(|why| LinkError::Declare { what: key, why })?;

        let out = Outgoing::new(settings.boot);
        let encoder = || Encoder::new().map_err(LinkError::Encoder);
        let (answering, answering_small, pushing) = (encoder()?, encoder()?, encoder()?);
        let info = Arc::new(settings.info);
        let mut threads = Vec::new();
        if let Some(answered) = answered {
            let (context, out) = (Arc::clone(&context), out.clone());
            threads.push(thread::spawn(move || {
                commands::send_answers(&context, &out, &answered);
            }));
        }
        threads.extend([
            thread::spawn({
                let (context, out, info) = (Arc::clone(&context), out.clone(), Arc::clone(&info));
                move || queries::serve(&context, &out, &info, answering_small, &small_waiting)
            }),
            thread::spawn({
                let (context, out) = (Arc::clone(&context), out.clone());
                move || queries::serve(&context, &out, &info, answering, &waiting)
            }),
            thread::spawn({
                let (context, out) = (Arc::clone(&context), out.clone());
                move || streams::send_state(&context, &out, &publishers)
            }),
            thread::spawn(move || streams::send_tiles(&context, &out, pushing)),
        ]);
        Ok(Self {
            shared,
            threads,
            control,
            bulk,
            _alive: alive,
        })
    }

    /// What mapping hands to the link.
    pub const fn shared(&self) -> &Arc<Shared> {
        &self.shared
    }
}

impl Drop for EdgeLink {
    fn drop(&mut self) {
        self.shared.close();
        for thread in self.threads.drain(..) {
            if thread.join().is_err() {
                tracing::error!("a thread of the link failed");
            }
        }
        for session in [&self.control, &self.bulk] {
            if let Err(why) = session.close().wait() {
                tracing::warn!(%why, "a session did not close");
            }
        }
    }
}

/// Lets questions for `key` through to the thread that answers them: Zenoh's own threads must not wait.
fn take_questions(
    session: &Session,
    key: &str,
    questions: &SyncSender<Query>,
    shared: &Arc<Shared>,
) -> Result<(), LinkError> {
    let (questions, shared) = (questions.clone(), Arc::clone(shared));
    session
        .declare_queryable(key.to_owned())
        .complete(true)
        .callback(move |query| {
            // What waits must not be large.
            let is_small = |bytes: &ZBytes| bytes.len() <= wire::MAX_MESSAGE_BYTES;
            let is_fit = query.payload().is_none_or(is_small) && query.attachment().is_none();
            // What finds no room gets no reply, which means "ask again".
            let is_taken = is_fit && questions.try_send(query).is_ok();
            if !is_taken {
                shared.refuse();
            }
        })
        .background()
        .wait()
        .map_err(|why| LinkError::Declare {
            what: key.to_owned(),
            why,
        })
}

/// The bytes of a message, if they are not too many to be one.
pub(super) fn payload(bytes: &ZBytes) -> Option<Cow<'_, [u8]>> {
    (bytes.len() <= wire::MAX_MESSAGE_BYTES).then(|| bytes.to_bytes())
}
