//! A UDP link over loopback that can be late, lossy, disordered or gone, and that can be attacked.
//!
//! Each sender has a flow of its own to the target, as behind an address translator.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::runtime::Runtime;

use super::channel::{Channel, Datagram, MAX_DATAGRAM_BYTES};
use super::{Conditions, Direction, runtime};

/// A port of 127.0.0.1 whose datagrams go to another address. Dropping it cuts the link.
#[derive(Debug)]
pub struct UdpRelay {
    port: u16,
    flows: Arc<Mutex<Flows>>,
    /// By [`Direction`].
    channels: [Arc<Channel>; 2],
    _tasks: Runtime,
}

#[derive(Debug, Default)]
struct Flows {
    all: Vec<Flow>,
    last_used: usize,
}

/// One client, and the socket that stands for it at the target.
#[derive(Debug)]
struct Flow {
    client: SocketAddr,
    to_target: UdpSocket,
}

impl UdpRelay {
    /// Relays `port` to `target`; 0 lets the kernel choose the port. `seed` decides which datagrams are lost or changed.
    pub fn start(port: u16, target: SocketAddr, seed: u64) -> io::Result<Self> {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, port))?;
        socket.set_nonblocking(true)?;
        let port = socket.local_addr()?.port();
        let tasks = runtime()?;
        let context = tasks.enter();
        let from_clients = tokio::net::UdpSocket::from_std(socket.try_clone()?)?;
        let flows = Arc::new(Mutex::new(Flows::default()));
        let socket = Arc::new(socket);
        // The kernel may refuse a datagram; then it is lost.
        let to_target = {
            let flows = Arc::clone(&flows);
            move |datagram: &Datagram| {
                let flow = &lock(&flows).all[datagram.flow];
                drop(flow.to_target.send(&datagram.bytes));
            }
        };
        let from_target = {
            let flows = Arc::clone(&flows);
            move |datagram: &Datagram| {
                let client = lock(&flows).all[datagram.flow].client;
                drop(socket.send_to(&datagram.bytes, client));
            }
        };
        let channels = [
            Channel::start(seed, to_target),
            Channel::start(seed.wrapping_add(1), from_target),
        ];
        tokio::spawn(receive_from_clients(
            from_clients,
            target,
            Arc::clone(&flows),
            channels.clone(),
        ));
        drop(context);
        Ok(Self {
            port,
            flows,
            channels,
            _tasks: tasks,
        })
    }

    pub fn address(&self) -> SocketAddr {
        SocketAddr::from((Ipv4Addr::LOCALHOST, self.port))
    }

    /// Changes one direction. Datagrams under way keep their arrival time.
    pub fn set(&self, direction: Direction, conditions: Conditions) {
        self.channels[direction as usize].set(conditions);
    }

    /// Changes both directions; see [`UdpRelay::set`].
    pub fn set_both(&self, conditions: Conditions) {
        for direction in Direction::ALL {
            self.set(direction, conditions);
        }
    }

    /// Sends datagrams as the sender of `direction` would, on the flow that was used last; there must be one.
    pub fn inject(&self, direction: Direction, datagrams: Vec<Vec<u8>>) {
        let flow = lock(&self.flows).last_used;
        for bytes in datagrams {
            self.channels[direction as usize].inject(Datagram { flow, bytes });
        }
    }

    /// The last 200 datagrams that were received, unchanged, the oldest first.
    pub fn captured(&self, direction: Direction) -> Vec<Vec<u8>> {
        self.channels[direction as usize].captured()
    }

    /// Datagrams that were dropped because the link was gone.
    pub fn blackholed(&self, direction: Direction) -> u64 {
        self.channels[direction as usize].blackholed()
    }
}

async fn receive_from_clients(
    clients: tokio::net::UdpSocket,
    target: SocketAddr,
    flows: Arc<Mutex<Flows>>,
    [to_target, from_target]: [Arc<Channel>; 2],
) -> ! {
    let mut buffer = vec![0; MAX_DATAGRAM_BYTES];
    loop {
        // An error reports a client that is gone; others may still send.
        let Ok((count, client)) = clients.recv_from(&mut buffer).await else {
            continue;
        };
        if let Ok(flow) = flow_of(&flows, client, target, &from_target) {
            let bytes = buffer[..count].to_vec();
            to_target.receive(Datagram { flow, bytes });
        }
    }
}

/// The flow of a client; a new client gets a new one.
fn flow_of(
    flows: &Mutex<Flows>,
    client: SocketAddr,
    target: SocketAddr,
    from_target: &Arc<Channel>,
) -> io::Result<usize> {
    let mut flows = lock(flows);
    let known = flows.all.iter().position(|flow| flow.client == client);
    let flow = known.unwrap_or(flows.all.len());
    if known.is_none() {
        let to_target = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
        to_target.set_nonblocking(true)?;
        to_target.connect(target)?;
        let answers = tokio::net::UdpSocket::from_std(to_target.try_clone()?)?;
        let from_target = Arc::clone(from_target);
        tokio::spawn(async move {
            let mut buffer = vec![0; MAX_DATAGRAM_BYTES];
            loop {
                // An error reports that the target did not listen; it may listen later.
                if let Ok(count) = answers.recv(&mut buffer).await {
                    let bytes = buffer[..count].to_vec();
                    from_target.receive(Datagram { flow, bytes });
                }
            }
        });
        flows.all.push(Flow { client, to_target });
    }
    flows.last_used = flow;
    Ok(flow)
}

fn lock(flows: &Mutex<Flows>) -> MutexGuard<'_, Flows> {
    flows.lock().unwrap_or_else(PoisonError::into_inner)
}
