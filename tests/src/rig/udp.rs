//! A UDP link over loopback that can be late, lossy, disordered or gone, and that can be attacked.
//!
//! Each sender has a flow of its own to the target, as behind an address translator.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::{Arc, Mutex};

use tokio::runtime::Runtime;

use super::channel::{Channels, Datagram, MAX_DATAGRAM_BYTES};
use super::relay::Direction;
use super::{Conditions, Traffic, lock, runtime};

/// A port of 127.0.0.1 whose datagrams go to another address. Dropping it cuts the link.
#[derive(Debug)]
pub struct UdpRelay {
    port: u16,
    link: Arc<Link>,
    _tasks: Runtime,
}

#[derive(Debug)]
struct Link {
    socket: UdpSocket,
    target: SocketAddr,
    channels: Channels,
    flows: Mutex<Flows>,
}

#[derive(Debug, Default)]
struct Flows {
    all: Vec<Flow>,
    last_used: Option<usize>,
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
        let link = Arc::new(Link {
            socket,
            target,
            channels: Channels::new(seed),
            flows: Mutex::default(),
        });
        tasks.spawn(Arc::clone(&link).receive_from_clients(from_clients));
        tasks.spawn(Arc::clone(&link).deliver());
        drop(context);
        Ok(Self {
            port,
            link,
            _tasks: tasks,
        })
    }

    /// The address to send to.
    pub fn address(&self) -> SocketAddr {
        SocketAddr::from((Ipv4Addr::LOCALHOST, self.port))
    }

    /// Changes one direction. Datagrams under way keep their arrival time.
    ///
    /// Fails if a likelihood is not between 0 and 1.
    pub fn set(&self, direction: Direction, conditions: Conditions) -> io::Result<()> {
        self.link.channels.set(direction as usize, conditions)
    }

    /// Changes both directions; see [`UdpRelay::set`].
    pub fn set_both(&self, conditions: Conditions) -> io::Result<()> {
        self.link.channels.set_both(conditions)
    }

    /// Sends datagrams as the sender of `direction` would, on the flow that was used last.
    ///
    /// Fails if no flow exists yet.
    pub fn inject(&self, direction: Direction, datagrams: Vec<Vec<u8>>) -> io::Result<()> {
        let flow = lock(&self.link.flows).last_used;
        let flow = flow.ok_or_else(|| io::Error::other("no datagram has been received yet"))?;
        for bytes in datagrams {
            let datagram = Datagram { flow, bytes };
            self.link.channels.inject(direction as usize, datagram);
        }
        Ok(())
    }

    /// The last 200 datagrams that were received, unchanged, the oldest first.
    pub fn captured(&self, direction: Direction) -> Vec<Vec<u8>> {
        self.link.channels.captured(direction as usize)
    }

    /// Counters of `direction`.
    pub fn traffic(&self, direction: Direction) -> Traffic {
        self.link.channels.traffic(direction as usize)
    }
}

impl Link {
    async fn receive_from_clients(self: Arc<Self>, clients: tokio::net::UdpSocket) -> ! {
        let mut buffer = vec![0; MAX_DATAGRAM_BYTES];
        loop {
            // An error reports a client that is gone; others may still send.
            let Ok((count, client)) = clients.recv_from(&mut buffer).await else {
                continue;
            };
            if let Ok(flow) = self.flow_of(client) {
                let bytes = buffer[..count].to_vec();
                let datagram = Datagram { flow, bytes };
                self.channels
                    .receive(Direction::ToTarget as usize, datagram);
            }
        }
    }

    /// The flow of a client; a new client gets a new one.
    fn flow_of(self: &Arc<Self>, client: SocketAddr) -> io::Result<usize> {
        let mut flows = lock(&self.flows);
        let known = flows.all.iter().position(|flow| flow.client == client);
        let flow = known.unwrap_or(flows.all.len());
        if known.is_none() {
            let to_target = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
            to_target.set_nonblocking(true)?;
            to_target.connect(self.target)?;
            let from_target = tokio::net::UdpSocket::from_std(to_target.try_clone()?)?;
            tokio::spawn(Arc::clone(self).receive_from_target(from_target, flow));
            flows.all.push(Flow { client, to_target });
        }
        flows.last_used = Some(flow);
        Ok(flow)
    }

    async fn receive_from_target(self: Arc<Self>, target: tokio::net::UdpSocket, flow: usize) -> ! {
        let mut buffer = vec![0; MAX_DATAGRAM_BYTES];
        loop {
            // An error reports that the target did not listen; it may listen later.
            if let Ok(count) = target.recv(&mut buffer).await {
                let bytes = buffer[..count].to_vec();
                let datagram = Datagram { flow, bytes };
                self.channels
                    .receive(Direction::FromTarget as usize, datagram);
            }
        }
    }

    async fn deliver(self: Arc<Self>) -> ! {
        let send = |direction: usize, datagram: &Datagram| {
            let flows = lock(&self.flows);
            let flow = &flows.all[datagram.flow];
            if direction == Direction::ToTarget as usize {
                flow.to_target.send(&datagram.bytes)
            } else {
                self.socket.send_to(&datagram.bytes, flow.client)
            }
        };
        self.channels.deliver(send).await
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::Direction::{FromTarget, ToTarget};
    use super::*;
    use crate::rig::Line;
    use robot_edge::clock;

    /// Longer than any step here takes.
    const TIMEOUT: Duration = Duration::from_secs(20);

    /// Without data for this long, a socket counts as silent.
    const QUIET_PERIOD: Duration = Duration::from_millis(150);

    fn udp_socket() -> UdpSocket {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        socket.set_read_timeout(Some(TIMEOUT)).unwrap();
        socket
    }

    fn receive(socket: &UdpSocket) -> (Vec<u8>, SocketAddr) {
        let mut buffer = [0; 2000];
        let (count, from) = socket.recv_from(&mut buffer).unwrap();
        (buffer[..count].to_vec(), from)
    }

    /// Datagrams until none arrives for [`QUIET_PERIOD`].
    fn receive_all(socket: &UdpSocket) -> Vec<Vec<u8>> {
        socket.set_read_timeout(Some(QUIET_PERIOD)).unwrap();
        let mut buffer = [0; 2000];
        let next = || {
            socket
                .recv(&mut buffer)
                .ok()
                .map(|count| buffer[..count].to_vec())
        };
        let received = std::iter::from_fn(next).collect();
        socket.set_read_timeout(Some(TIMEOUT)).unwrap();
        received
    }

    fn numbered(count: u8) -> Vec<Vec<u8>> {
        (0..count).map(|number| vec![number; 20]).collect()
    }

    #[test]
    fn a_udp_relay_separates_flows_and_repeats_what_it_captured() {
        let target = udp_socket();
        let relay = UdpRelay::start(0, target.local_addr().unwrap(), 0).unwrap();
        relay.inject(ToTarget, numbered(1)).unwrap_err();
        let clients = [udp_socket(), udp_socket()];
        let flows = clients.each_ref().map(|client| {
            client.connect(relay.address()).unwrap();
            client.send(b"hello").unwrap();
            receive(&target).1
        });
        for (client, flow) in clients.iter().zip(flows) {
            target.send_to(b"answer", flow).unwrap();
            assert_eq!(receive(client).0, b"answer");
        }
        assert_ne!(flows[0], flows[1]);
        assert_eq!(relay.captured(ToTarget), [b"hello", b"hello"]);
        relay.inject(ToTarget, vec![b"forged".to_vec()]).unwrap();
        assert_eq!(receive(&target), (b"forged".to_vec(), flows[1]));
        relay.inject(FromTarget, vec![b"forged".to_vec()]).unwrap();
        assert_eq!(receive(&clients[1]).0, b"forged");
    }

    #[test]
    fn a_udp_relay_delays_holds_and_swallows() {
        let target = udp_socket();
        let relay = UdpRelay::start(0, target.local_addr().unwrap(), 0).unwrap();
        let client = udp_socket();
        client.connect(relay.address()).unwrap();
        let set = |conditions| relay.set(ToTarget, conditions).unwrap();
        let send = || {
            for datagram in numbered(100) {
                client.send(&datagram).unwrap();
            }
        };
        let line = |delay_ms, rate_bytes_per_s| Conditions {
            line: Line {
                delay: Duration::from_millis(delay_ms),
                rate_bytes_per_s,
                queue_bytes: 1 << 20,
            },
            ..Conditions::default()
        };

        set(line(30, None));
        let start = clock::now();
        client.send(b"late").unwrap();
        assert_eq!(receive(&target).0, b"late");
        assert!(clock::elapsed(start) >= Duration::from_millis(30));

        set(line(0, Some(0)));
        send();
        assert_eq!(receive_all(&target), [[0; 0]; 0]);
        set(Conditions::default());
        assert_eq!(receive_all(&target), numbered(100));

        set(Conditions {
            blackhole: true,
            ..Conditions::default()
        });
        send();
        assert_eq!(receive_all(&target), [[0; 0]; 0]);
        assert_eq!(relay.traffic(ToTarget).blackholed.packets, 100);

        for tampering in [-0.1, 1.1, f64::NAN] {
            let conditions = Conditions {
                tampering,
                ..Conditions::default()
            };
            let refused = relay.set_both(conditions).unwrap_err();
            assert!(refused.to_string().contains("tampering"), "{refused}");
        }
    }
}
