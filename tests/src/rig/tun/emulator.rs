//! The thread between the two TUN devices.

use std::io;
use std::sync::{Arc, Mutex, PoisonError};

use robot_edge::clock;
use rustix::event::{PollFd, PollFlags};
use tun_rs::SyncDevice;

use super::{Conditions, MTU_BYTES, Side, Traffic};
use crate::rig::bottleneck::Bottleneck;
use crate::rig::command_thread::{Inbox, Received, wait};
use crate::rig::rng::SeededRng;

/// Packets read from one device before the other has its turn.
const PACKETS_IN_A_ROW: usize = 64;

/// What a caller wants.
#[derive(Clone, Copy, Debug)]
pub(super) enum LinkCommand {
    Set(Side, Conditions),
    /// Nothing: it is carried out between two rounds, when the counters agree with the devices.
    Settle,
}

/// What is ready.
#[derive(Clone, Copy, Debug)]
enum Watch {
    Inbox,
    Device(Side),
}

pub(super) struct Emulator {
    devices: [SyncDevice; 2],
    directions: [Direction; 2],
    traffic: Arc<Mutex<[Traffic; 2]>>,
}

/// The way from one side to the other.
struct Direction {
    conditions: Conditions,
    line: Bottleneck<Packet>,
    rng: SeededRng,
}

struct Packet {
    bytes: Vec<u8>,
    is_lost: bool,
}

impl Emulator {
    pub(super) fn new(
        devices: [SyncDevice; 2],
        seed: u64,
        traffic: Arc<Mutex<[Traffic; 2]>>,
    ) -> Self {
        Self {
            devices,
            directions: Side::ALL.map(|side| Direction::new(seed, side)),
            traffic,
        }
    }

    /// Carries packets until the handle is dropped.
    pub(super) fn run(mut self, inbox: &Inbox<LinkCommand>) {
        loop {
            match inbox.receive() {
                Received::Command(command, done) => {
                    self.handle_command(command);
                    done.report(Ok(()));
                    continue;
                }
                Received::Nothing => {}
                Received::Disconnected => break,
            }
            self.deliver();
            let Ok(ready) = self.ready(inbox) else {
                break;
            };
            for watch in ready {
                match watch {
                    Watch::Inbox => {}
                    // A device that is gone stays ready for ever.
                    Watch::Device(side) => {
                        if self.take_in(side).is_err() {
                            return;
                        }
                    }
                }
            }
        }
    }

    fn handle_command(&mut self, command: LinkCommand) {
        match command {
            LinkCommand::Set(side, conditions) => {
                let mut traffic = lock(&self.traffic);
                self.directions[side.index()].set(conditions, &mut traffic[side.index()]);
            }
            LinkCommand::Settle => {}
        }
    }

    fn ready(&self, inbox: &Inbox<LinkCommand>) -> io::Result<Vec<Watch>> {
        let mut watched = vec![(
            Watch::Inbox,
            PollFd::from_borrowed_fd(inbox.readable(), PollFlags::IN),
        )];
        for (side, device) in Side::ALL.into_iter().zip(&self.devices) {
            watched.push((Watch::Device(side), PollFd::new(device, PollFlags::IN)));
        }
        let events = self.directions.iter();
        let next = events.filter_map(|way| way.line.next_event()).min();
        wait(watched, next.map(|moment| moment.since(clock::now())))
    }

    /// Takes in what the kernel of `side` sends. Fails where the device is gone.
    fn take_in(&mut self, side: Side) -> io::Result<()> {
        let mut traffic = lock(&self.traffic);
        let mut buffer = [0; MTU_BYTES as usize];
        for _ in 0..PACKETS_IN_A_ROW {
            let count = match self.devices[side.index()].recv(&mut buffer) {
                Ok(count) => count,
                Err(err) if is_for_later(&err) => break,
                Err(err) => return Err(err),
            };
            let packet = buffer.get(..count).unwrap_or_default();
            self.directions[side.index()].take_in(packet, &mut traffic[side.index()]);
        }
        Ok(())
    }

    /// Hands over what has come to the other end.
    fn deliver(&mut self) {
        let now = clock::now();
        let mut traffic = lock(&self.traffic);
        for side in Side::ALL {
            let traffic = &mut traffic[side.index()];
            while let Some(packet) = self.directions[side.index()].line.take(now) {
                let size = packet.bytes.len();
                if packet.is_lost {
                    traffic.lost.add(size);
                    continue;
                }
                match self.devices[side.other().index()].send(&packet.bytes) {
                    Ok(_) => traffic.delivered.add(size),
                    Err(_refused) => traffic.refused.add(size),
                }
            }
        }
    }
}

impl Direction {
    fn new(seed: u64, side: Side) -> Self {
        let conditions = Conditions::default();
        Self {
            conditions,
            line: Bottleneck::new(conditions.line),
            rng: SeededRng::new(seed, side.index()),
        }
    }

    fn set(&mut self, conditions: Conditions, traffic: &mut Traffic) {
        if conditions.blackhole {
            for packet in self.line.drain() {
                traffic.blackholed.add(packet.bytes.len());
            }
        }
        self.line.set_line(clock::now(), conditions.line);
        self.conditions = conditions;
    }

    fn take_in(&mut self, packet: &[u8], traffic: &mut Traffic) {
        let size = packet.len();
        traffic.sent.add(size);
        // Always two draws, so that the same packets get lost whatever else is set.
        let is_lost = self.rng.draw() < self.conditions.loss;
        let extra_delay = self.conditions.jitter.mul_f64(self.rng.draw());
        if self.conditions.blackhole {
            traffic.blackholed.add(size);
            return;
        }
        let bytes = packet.to_vec();
        let packet = Packet { bytes, is_lost };
        let now = clock::now();
        if !self.line.offer(now, size, extra_delay, packet) {
            traffic.overflowed.add(size);
        }
    }
}

fn is_for_later(err: &io::Error) -> bool {
    matches!(
        err.kind(),
        io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted
    )
}

fn lock(traffic: &Mutex<[Traffic; 2]>) -> std::sync::MutexGuard<'_, [Traffic; 2]> {
    traffic.lock().unwrap_or_else(PoisonError::into_inner)
}
