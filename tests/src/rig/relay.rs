//! A TCP link over loopback that can stall or break.
//!
//! It copies bytes between two TCP connections, so it never loses or reorders them. See [`super::tun`] for packets.

use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use rustix::net::sockopt;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::tcp::{ReadHalf, WriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::Runtime;
use tokio::sync::watch;

use super::ports::Reservation;
use super::{lock, runtime};

/// Bytes that the relay holds of each direction of a connection; the kernel's buffers hold the rest.
const BUFFER_BYTES: usize = 64 << 10;

/// Which way bytes go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the side that connects to the relay.
    ToTarget,
    /// To the side that connects to the relay.
    FromTarget,
}

impl Direction {
    /// Both.
    pub const ALL: [Self; 2] = [Self::ToTarget, Self::FromTarget];
}

/// A link of one or two ports of 127.0.0.1, each to a port of its own. Dropping it cuts the link.
#[derive(Debug)]
pub struct Relay {
    ports: Vec<(Reservation, SocketAddr)>,
    /// By [`Direction`]; a stalled direction keeps its connections and forwards no byte.
    is_stalled: watch::Sender<[bool; 2]>,
    accepted: Arc<AtomicU64>,
    /// Listeners and connections; `None` while the link is cut.
    tasks: Mutex<Option<Runtime>>,
}

impl Relay {
    /// Relays a port that the kernel chooses to `target`.
    pub fn to(target: SocketAddr) -> io::Result<Self> {
        Self::start(vec![(Reservation::any()?, target)])
    }

    /// Relays `port` to `target`.
    pub fn at(port: u16, target: SocketAddr) -> io::Result<Self> {
        Self::start(vec![(Reservation::of(port)?, target)])
    }

    /// Relays two adjacent ports, control and bulk, to `target_control_port` of loopback and the port after it.
    pub fn pair(target_control_port: u16) -> io::Result<Self> {
        let (control, bulk) = Reservation::pair()?;
        let target = |port| SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        Self::start(vec![
            (control, target(target_control_port)),
            (bulk, target(target_control_port + 1)),
        ])
    }

    fn start(ports: Vec<(Reservation, SocketAddr)>) -> io::Result<Self> {
        let relay = Self {
            ports,
            is_stalled: watch::Sender::new([false; 2]),
            accepted: Arc::default(),
            tasks: Mutex::new(None),
        };
        relay.pass()?;
        Ok(relay)
    }

    /// The port to connect to; of two, the first.
    pub fn port(&self) -> u16 {
        self.ports[0].0.port()
    }

    /// The address to connect to; of two, the first.
    pub fn address(&self) -> SocketAddr {
        SocketAddr::from((Ipv4Addr::LOCALHOST, self.port()))
    }

    /// The address to connect to as a Zenoh endpoint: `tcp/127.0.0.1:7447`.
    pub fn endpoint(&self) -> String {
        format!("tcp/{}", self.address())
    }

    /// Lets bytes pass, also after a stall or a cut.
    pub fn pass(&self) -> io::Result<()> {
        self.is_stalled.send_replace([false; 2]);
        let mut tasks = lock(&self.tasks);
        if tasks.is_some() {
            return Ok(());
        }
        let runtime = runtime()?;
        let context = runtime.enter();
        for (reserved, target) in &self.ports {
            let listener = TcpListener::from_std(reserved.listen()?)?;
            let accept = accept(
                listener,
                *target,
                self.is_stalled.subscribe(),
                Arc::clone(&self.accepted),
            );
            runtime.spawn(accept);
        }
        drop(context);
        *tasks = Some(runtime);
        Ok(())
    }

    /// Keeps every connection open and forwards nothing in `directions`. If that is both, new connections wait.
    pub fn stall(&self, directions: &[Direction]) {
        self.is_stalled
            .send_replace(Direction::ALL.map(|direction| directions.contains(&direction)));
    }

    /// Resets every connection and refuses new ones.
    pub fn cut(&self) {
        // Waits until every socket is closed.
        drop(lock(&self.tasks).take());
    }

    /// Connections accepted so far.
    pub fn connections_accepted(&self) -> u64 {
        self.accepted.load(Ordering::Acquire)
    }
}

async fn accept(
    listener: TcpListener,
    target: SocketAddr,
    is_stalled: watch::Receiver<[bool; 2]>,
    accepted: Arc<AtomicU64>,
) -> ! {
    loop {
        // A connection that its client has already given up.
        let Ok((client, _)) = listener.accept().await else {
            continue;
        };
        accepted.fetch_add(1, Ordering::AcqRel);
        // An error ends the connection; both sockets are reset.
        tokio::spawn(relay(client, target, is_stalled.clone()));
    }
}

/// Forwards both directions until both streams have ended.
async fn relay(
    mut client: TcpStream,
    target: SocketAddr,
    mut is_stalled: watch::Receiver<[bool; 2]>,
) -> io::Result<()> {
    client.set_nodelay(true)?;
    client.set_zero_linger()?;
    let gone = |_relay_dropped| io::Error::from(io::ErrorKind::BrokenPipe);
    let passes = |is_stalled: &[bool; 2]| is_stalled.contains(&false);
    is_stalled.wait_for(passes).await.map_err(gone)?;
    let mut target = TcpStream::connect(target).await?;
    target.set_nodelay(true)?;
    target.set_zero_linger()?;
    let (client_read, client_write) = client.split();
    let (target_read, target_write) = target.split();
    tokio::try_join!(
        forward(
            client_read,
            target_write,
            is_stalled.clone(),
            Direction::ToTarget
        ),
        forward(target_read, client_write, is_stalled, Direction::FromTarget),
    )?;
    for ended in [&client, &target] {
        sockopt::set_socket_linger(ended, None)?;
    }
    Ok(())
}

async fn forward(
    mut source: ReadHalf<'_>,
    mut sink: WriteHalf<'_>,
    mut is_stalled: watch::Receiver<[bool; 2]>,
    direction: Direction,
) -> io::Result<()> {
    let mut buffer = vec![0; BUFFER_BYTES];
    loop {
        let count = source.read(&mut buffer).await?;
        let passes = |is_stalled: &[bool; 2]| !is_stalled[direction as usize];
        if is_stalled.wait_for(passes).await.is_err() {
            return Ok(());
        }
        if count == 0 {
            return sink.shutdown().await;
        }
        sink.write_all(&buffer[..count]).await?;
    }
}

#[cfg(test)]
mod tests {
    use std::io::{ErrorKind, Read as _, Write as _};
    use std::net::{Shutdown, TcpListener, TcpStream};
    use std::time::Duration;

    use super::Direction::{FromTarget, ToTarget};
    use super::{Direction, Ipv4Addr, Relay};

    /// Longer than any step here takes.
    const TIMEOUT: Duration = Duration::from_secs(20);

    /// Without data for this long, a socket counts as silent.
    const QUIET_PERIOD: Duration = Duration::from_millis(150);

    fn connect(relay: &Relay, listener: &TcpListener) -> [TcpStream; 2] {
        let client = TcpStream::connect(relay.address()).unwrap();
        let (target, _) = listener.accept().unwrap();
        [client, target].map(|stream| {
            stream.set_read_timeout(Some(TIMEOUT)).unwrap();
            stream
        })
    }

    fn read(mut stream: &TcpStream, count: usize) -> Vec<u8> {
        let mut bytes = vec![0; count];
        stream.read_exact(&mut bytes).unwrap();
        bytes
    }

    fn is_silent(stream: &TcpStream) -> bool {
        stream.set_read_timeout(Some(QUIET_PERIOD)).unwrap();
        let outcome = { stream }.read(&mut [0]);
        stream.set_read_timeout(Some(TIMEOUT)).unwrap();
        outcome.is_err_and(|err| err.kind() == ErrorKind::WouldBlock)
    }

    #[test]
    fn a_tcp_relay_stalls_and_then_delivers_everything() {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let relay = Relay::to(listener.local_addr().unwrap()).unwrap();
        let [client, target] = connect(&relay, &listener);
        for stalled in [&Direction::ALL[..], &[ToTarget]] {
            (&client).write_all(b"before").unwrap();
            assert_eq!(read(&target, 6), b"before");
            relay.stall(stalled);
            (&client).write_all(&[7; 4000]).unwrap();
            (&target).write_all(&[8; 3000]).unwrap();
            assert!(is_silent(&target));
            if stalled.contains(&FromTarget) {
                assert!(is_silent(&client));
            }
            relay.pass().unwrap();
            assert!(read(&target, 4000) == [7; 4000]);
            assert!(read(&client, 3000) == [8; 3000]);
        }
    }

    #[test]
    fn a_tcp_relay_that_is_cut_resets_and_refuses_until_it_passes() {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let relay = Relay::to(listener.local_addr().unwrap()).unwrap();
        for round in 1..=3 {
            let [client, target] = connect(&relay, &listener);
            (&client).write_all(b"hello").unwrap();
            assert_eq!(read(&target, 5), b"hello");
            relay.cut();
            for mut end in [&client, &target] {
                let broken = end.read(&mut [0]).unwrap_err();
                assert_eq!(broken.kind(), ErrorKind::ConnectionReset);
            }
            let refused = TcpStream::connect(relay.address()).unwrap_err();
            assert_eq!(refused.kind(), ErrorKind::ConnectionRefused);
            assert_eq!(relay.connections_accepted(), round);
            relay.pass().unwrap();
        }
    }

    #[test]
    fn a_tcp_relay_forwards_the_end_of_each_stream() {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let relay = Relay::to(listener.local_addr().unwrap()).unwrap();
        let [mut client, mut target] = connect(&relay, &listener);
        client.write_all(b"question").unwrap();
        client.shutdown(Shutdown::Write).unwrap();
        let mut received = String::new();
        target.read_to_string(&mut received).unwrap();
        target.write_all(b"answer").unwrap();
        drop(target);
        client.read_to_string(&mut received).unwrap();
        assert_eq!(received, "questionanswer");
    }
}
