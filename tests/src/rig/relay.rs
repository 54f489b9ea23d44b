//! A TCP link over loopback that can stall or break.
//!
//! It copies bytes between two TCP connections, so it never loses or reorders them. See [`super::tun`] for packets.

use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::tcp::{ReadHalf, WriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::Runtime;
use tokio::sync::watch;

use super::{Direction, listen_pair, runtime};

/// Bytes that the relay holds of each direction of a connection; the kernel's buffers hold the rest.
const BUFFER_BYTES: usize = 64 << 10;

#[derive(Clone, Copy, Debug, Default)]
struct State {
    is_cut: bool,
    /// By [`Direction`]; a stalled direction keeps its connections and forwards no byte.
    is_stalled: [bool; 2],
}

/// A link of one or two ports of 127.0.0.1, each to a port of its own. Dropping it cuts the link.
#[derive(Debug)]
pub struct Relay {
    port: u16,
    state: watch::Sender<State>,
    accepted: Arc<AtomicU64>,
    _tasks: Runtime,
}

impl Relay {
    /// Relays `port` to `target`; 0 lets the kernel choose the port.
    pub fn start(port: u16, target: SocketAddr) -> io::Result<Self> {
        let listener = std::net::TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
        Self::on([(listener, target)])
    }

    /// Relays two adjacent ports, control and bulk, to `target_control_port` of loopback and the port after it.
    pub fn pair(target_control_port: u16) -> io::Result<Self> {
        let [control, bulk] = listen_pair()?;
        let target = |port| SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        Self::on([
            (control, target(target_control_port)),
            (bulk, target(target_control_port + 1)),
        ])
    }

    fn on<const N: usize>(ports: [(std::net::TcpListener, SocketAddr); N]) -> io::Result<Self> {
        let (state, accepted) = (watch::Sender::default(), Arc::default());
        let port = ports[0].0.local_addr()?.port();
        let tasks = runtime()?;
        let context = tasks.enter();
        for (listener, target) in ports {
            listener.set_nonblocking(true)?;
            let listener = TcpListener::from_std(listener)?;
            let accepted = Arc::clone(&accepted);
            tokio::spawn(accept(listener, target, state.subscribe(), accepted));
        }
        drop(context);
        Ok(Self {
            port,
            state,
            accepted,
            _tasks: tasks,
        })
    }

    /// The port to connect to; of two, the first.
    pub const fn port(&self) -> u16 {
        self.port
    }

    /// The address to connect to as a Zenoh endpoint: `tcp/127.0.0.1:7447`; of two, the first.
    pub fn endpoint(&self) -> String {
        format!("tcp/127.0.0.1:{}", self.port)
    }

    /// Lets bytes pass, also after a stall or a cut.
    pub fn pass(&self) {
        self.state.send_replace(State::default());
    }

    /// Keeps every connection open and forwards nothing in `directions`. If that is both, new connections wait.
    pub fn stall(&self, directions: &[Direction]) {
        self.state.send_replace(State {
            is_cut: false,
            is_stalled: Direction::ALL.map(|direction| directions.contains(&direction)),
        });
    }

    /// Resets every connection, and new ones as soon as they are made.
    pub fn cut(&self) {
        self.state.send_replace(State {
            is_cut: true,
            is_stalled: [false; 2],
        });
    }

    /// Connections accepted so far, except those that were reset at once.
    pub fn connections_accepted(&self) -> u64 {
        self.accepted.load(Ordering::Acquire)
    }
}

async fn accept(
    listener: TcpListener,
    target: SocketAddr,
    mut state: watch::Receiver<State>,
    accepted: Arc<AtomicU64>,
) -> ! {
    loop {
        // A connection that its client has already given up, or that cannot be configured.
        let Ok((client, _)) = listener.accept().await else {
            continue;
        };
        if client.set_zero_linger().is_err() || state.borrow_and_update().is_cut {
            continue;
        }
        accepted.fetch_add(1, Ordering::AcqRel);
        let (carried, mut cut) = (state.clone(), state.clone());
        tokio::spawn(async move {
            // An error or a cut ends the connection; both sockets are reset.
            tokio::select! {
                _ended = carry(client, target, carried) => {}
                _cut = cut.wait_for(|state| state.is_cut) => {}
            }
        });
    }
}

async fn carry(
    mut client: TcpStream,
    target: SocketAddr,
    mut state: watch::Receiver<State>,
) -> io::Result<()> {
    client.set_nodelay(true)?;
    let passes = |state: &State| state.is_stalled.contains(&false);
    state.wait_for(passes).await.map_err(io::Error::other)?;
    let mut target = TcpStream::connect(target).await?;
    target.set_nodelay(true)?;
    target.set_zero_linger()?;
    let (client_read, client_write) = client.split();
    let (target_read, target_write) = target.split();
    let to_target = forward(
        client_read,
        target_write,
        state.clone(),
        Direction::ToTarget,
    );
    let from_target = forward(target_read, client_write, state, Direction::FromTarget);
    tokio::try_join!(to_target, from_target)?;
    Ok(())
}

async fn forward(
    mut source: ReadHalf<'_>,
    mut sink: WriteHalf<'_>,
    mut state: watch::Receiver<State>,
    direction: Direction,
) -> io::Result<()> {
    let mut buffer = vec![0; BUFFER_BYTES];
    loop {
        let count = source.read(&mut buffer).await?;
        let passes = |state: &State| !state.is_stalled[direction as usize];
        state.wait_for(passes).await.map_err(io::Error::other)?;
        if count == 0 {
            return sink.shutdown().await;
        }
        sink.write_all(&buffer[..count]).await?;
    }
}
