//! The task of one device: connect, configure, read, and begin again for ever.
//!
//! The only code with a clock and a connection. A device that is off, silent, faulty or another one is
//! reported in its [`DeviceStatus`], and tried again within a second.

use std::io;
use std::net::IpAddr;
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, TrySendError};
use std::time::Duration;

use measurement::byte_limit::{ByteLimit, ReservedBytes};
use measurement::time::{Monotonic, RobotDuration, RobotTime};
use measurement::{FrameId, Measurement, MeasurementData, StreamId};
use tokio::sync::{mpsc, watch};
use tokio::time::{sleep, timeout};

use crate::beam_selection::BeamSelection;
use crate::clock_mapping::{ClockMapping, DeviceTime, MAX_AGE};
use crate::device::{Device, Event, MessageOf, Preparation, Sample, Step};
use crate::status::{DeviceStatus, Loss, State, Trouble};
use crate::transport::{Address, Transport};
use crate::{Decoder, Dropped};

/// With [`MAX_PAUSE`] below the 2 s within which a device that is back is used.
const CONNECT_TIMEOUT: Duration = Duration::from_millis(800);
const FIRST_PAUSE: Duration = Duration::from_millis(100);
const MAX_PAUSE: Duration = Duration::from_millis(500);
const REPLY_TIMEOUT: Duration = Duration::from_millis(500);
const PREPARATION_TIMEOUT: Duration = Duration::from_secs(1);
/// A longer reply is none that a device sends.
const MAX_REPLY: usize = 1024 * 1024;
/// After so long a reply to a request for a measurement is lost, and the next one is sent.
const POLL_TIMEOUT: Duration = Duration::from_millis(100);
/// Sending of a request.
const ATTEMPTS: u32 = 3;
const BUSY_PAUSE: Duration = Duration::from_millis(200);
const WRITE_TIMEOUT: Duration = Duration::from_millis(500);
const RATE_WINDOW: Duration = Duration::from_secs(1);
/// The longest datagram.
const READ_BYTES: usize = 64 * 1024;

/// The vehicle's steady clock.
pub type Clock = fn() -> Monotonic;

/// A measurement of a device. Its stamp is of the vehicle's steady clock.
#[derive(Debug)]
pub struct Reading {
    /// The measurement; its stream is the device's number, its frame the device's name.
    pub measurement: Measurement,
    /// When it arrived.
    pub arrived: Monotonic,
    _reserved: ReservedBytes,
}

/// Where the tasks of all devices send their readings. Who receives them bounds their number; this bounds their payload, with
/// clouds above all.
#[derive(Clone, Debug)]
pub(crate) struct Readings {
    pub(crate) sender: SyncSender<Reading>,
    pub(crate) limit: ByteLimit,
}

/// What the supervisor needs to know of a device besides its protocol.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Its name, which its measurements have as frame.
    pub name: FrameId,
    /// Its number.
    pub stream: StreamId,
    /// Where it is.
    pub address: Address,
    /// Beams that are used.
    pub beams: BeamSelection,
    /// What its identity must contain, if that was configured.
    pub identity: Option<String>,
}

/// The end of a pair of devices of which one works for the other.
#[derive(Debug)]
pub(crate) struct Link {
    pub(crate) to: mpsc::Sender<Arc<[u8]>>,
    pub(crate) from: mpsc::Receiver<Arc<[u8]>>,
}

/// The task of one device.
pub(crate) struct Supervisor<D> {
    device: D,
    settings: Settings,
    clock: Clock,
    readings: Readings,
    link: Option<Link>,
    status: watch::Sender<DeviceStatus>,
    mapping: ClockMapping,
    rate: Rate,
    /// The sender of the datagrams.
    sender: Option<IpAddr>,
    /// The device has measured since it was connected.
    has_measured: bool,
    is_wanted: bool,
}

impl<D: Device> Supervisor<D> {
    pub(crate) fn new(
        device: D,
        settings: Settings,
        clock: Clock,
        readings: Readings,
        link: Option<Link>,
    ) -> (Self, watch::Receiver<DeviceStatus>) {
        let (status, receiver) = watch::channel(DeviceStatus::default());
        let supervisor = Self {
            device,
            settings,
            clock,
            readings,
            link,
            status,
            mapping: ClockMapping::default(),
            rate: Rate::new(clock()),
            sender: None,
            has_measured: false,
            is_wanted: true,
        };
        (supervisor, receiver)
    }

    /// Until nobody takes the measurements.
    pub(crate) async fn run(mut self) {
        let mut pause = FIRST_PAUSE;
        while self.is_wanted {
            let trouble = self.connect_and_read().await;
            let name = &self.settings.name;
            tracing::debug!(%name, %trouble, "device lost");
            let has_measured = std::mem::take(&mut self.has_measured);
            if has_measured {
                pause = FIRST_PAUSE;
            }
            self.status.send_modify(|status| {
                status.state = State::Connecting;
                status.trouble = Some(trouble);
                status.rate_hz = 0.0;
                status.lost_connections += u64::from(has_measured);
            });
            sleep(pause).await;
            pause = (2 * pause).min(MAX_PAUSE);
        }
    }

    async fn connect_and_read(&mut self) -> Trouble {
        if let Some(preparation) = self.device.preparation() {
            let name = preparation.name();
            match timeout(PREPARATION_TIMEOUT, prepare(preparation)).await {
                Ok(Ok(())) => {}
                Ok(Err(trouble)) => return trouble,
                Err(_elapsed) => return Trouble::NoReply(name),
            }
        }
        let mut transport = match open(&self.settings.address).await {
            Ok(transport) => transport,
            Err(trouble) => return trouble,
        };
        self.sender = None;
        let mut session = Session {
            decoder: self.device.connect(),
            dropped: Dropped::default(),
            phase: Phase::Send {
                step: 0,
                attempt: 0,
            },
        };
        self.mapping.reconnect();
        self.rate = Rate::new((self.clock)());
        self.status
            .send_modify(|status| status.state = State::Configuring);
        let trouble = self.session(&mut transport, &mut session).await;
        self.count_dropped(&mut session);
        trouble.err().unwrap_or(Trouble::Closed)
    }

    /// Ends with trouble, or if nobody takes the measurements.
    async fn session(
        &mut self,
        transport: &mut Transport,
        session: &mut Session<D>,
    ) -> Result<(), Trouble> {
        let mut buffer = vec![0; READ_BYTES];
        while self.is_wanted {
            let deadline = self.advance(transport, &mut session.phase).await?;
            let wait = deadline.since((self.clock)());
            let input = tokio::select! {
                read = timeout(wait, transport.read(&mut buffer)) => match read {
                    Ok(read) => Input::Bytes(read.map_err(|error| Trouble::Io(error.to_string()))?),
                    Err(_elapsed) => Input::Nothing,
                },
                bytes = Link::receive(&mut self.link) => Input::ToDevice(bytes),
            };
            match input {
                Input::Nothing => {}
                Input::Bytes(0) => return Err(Trouble::Closed),
                Input::Bytes(length) => {
                    let arrived = (self.clock)();
                    if self.sender.is_none()
                        && matches!(self.settings.address, Address::UdpListen(_))
                    {
                        self.sender = transport.sender();
                    }
                    session
                        .decoder
                        .push(buffer.get(..length).unwrap_or_default());
                    while let Some(message) = session.decoder.next_message() {
                        self.take(message, arrived, &mut session.phase)?;
                    }
                    self.count_dropped(session);
                }
                // Corrections are useless later: a device that is not ready gets none.
                Input::ToDevice(bytes) => {
                    if matches!(session.phase, Phase::Run { .. }) {
                        write(transport, &bytes).await?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Sends what is due. When the next thing is.
    async fn advance(
        &mut self,
        transport: &mut Transport,
        phase: &mut Phase,
    ) -> Result<Monotonic, Trouble> {
        loop {
            let now = (self.clock)();
            match *phase {
                Phase::Send { step, attempt } => {
                    *phase = match self.device.step(step) {
                        Step::Ask(request) => {
                            write(transport, &request.bytes).await?;
                            Phase::Await {
                                step,
                                name: request.name,
                                attempt,
                                until: (self.clock)() + REPLY_TIMEOUT,
                            }
                        }
                        Step::Tell(bytes) => {
                            write(transport, &bytes).await?;
                            Phase::begin(step + 1)
                        }
                        Step::Skip => Phase::begin(step + 1),
                        Step::Done => Phase::Run {
                            max_silence: self.device.max_warm_up(),
                            alive_at: now,
                            poll_at: now,
                            asked: None,
                        },
                    };
                }
                Phase::Await {
                    name,
                    attempt,
                    until,
                    ..
                } if until <= now && attempt + 1 >= ATTEMPTS => {
                    return Err(Trouble::NoReply(name));
                }
                Phase::Await {
                    step,
                    attempt,
                    until,
                    ..
                } if until <= now => {
                    *phase = Phase::Send {
                        step,
                        attempt: attempt + 1,
                    };
                }
                Phase::Pause { step, until } if until <= now => *phase = Phase::begin(step),
                Phase::Await { until, .. } | Phase::Pause { until, .. } => return Ok(until),
                Phase::Run {
                    max_silence,
                    alive_at,
                    ref mut poll_at,
                    ref mut asked,
                } => {
                    let silent_at = alive_at + max_silence;
                    if silent_at <= now {
                        return Err(Trouble::Silent(max_silence));
                    }
                    let Some(period) = self.device.poll_period() else {
                        return Ok(silent_at);
                    };
                    // On a line for both directions a request would meet the reply to the last one.
                    let is_awaited = asked.is_some_and(|at| now.since(at) < POLL_TIMEOUT);
                    if *poll_at <= now && !is_awaited {
                        *poll_at = now + period;
                        *asked = self.device.measures_when_asked().then_some(now);
                        write(transport, &self.device.poll()).await?;
                    }
                    let next = match *asked {
                        Some(at) if *poll_at <= now => at + POLL_TIMEOUT,
                        _ => *poll_at,
                    };
                    return Ok(silent_at.min(next));
                }
            }
        }
    }

    fn take(
        &mut self,
        message: MessageOf<D>,
        arrived: Monotonic,
        phase: &mut Phase,
    ) -> Result<(), Trouble> {
        let awaited = match phase {
            Phase::Await { step, .. } => Some(*step),
            Phase::Send { .. } | Phase::Pause { .. } | Phase::Run { .. } => None,
        };
        let mut events = Vec::new();
        self.device.take(message, awaited, &mut events);
        for event in events {
            match (event, awaited) {
                (Event::Accepted, Some(step)) => *phase = Phase::begin(step + 1),
                (Event::NotYet, Some(step)) => {
                    let until = arrived + BUSY_PAUSE;
                    *phase = Phase::Pause { step, until };
                }
                (Event::Accepted | Event::NotYet | Event::Unexpected, _) => {
                    self.lose(Loss::Unexpected);
                }
                (Event::Done, _) => drop(phase.take_asked()),
                (Event::Refused(why), _) => return Err(Trouble::Refused(why)),
                (Event::Restarted, _) => {
                    *phase = Phase::begin(0);
                    // Its clock has started again, too.
                    self.mapping.reconnect();
                    self.status
                        .send_modify(|status| status.state = State::Configuring);
                }
                (Event::Identity(identity), _) => self.identify(identity)?,
                (Event::Repeated, _) => self.lose(Loss::Repeated),
                (Event::Forward(bytes), _) => {
                    self.alive(arrived, phase);
                    if let Some(link) = &self.link
                        && link.to.try_send(bytes.into()).is_err()
                    {
                        self.lose(Loss::QueueFull);
                    }
                }
                (Event::Sample(sample), _) => {
                    self.alive(arrived, phase);
                    // What comes before the device is configured is not what was asked for.
                    if matches!(phase, Phase::Run { .. }) {
                        self.pass(sample, phase.take_asked(), arrived);
                    }
                }
            }
        }
        Ok(())
    }

    /// The device measures.
    fn alive(&mut self, arrived: Monotonic, phase: &mut Phase) {
        if let Phase::Run {
            max_silence,
            alive_at,
            ..
        } = phase
        {
            *max_silence = self.device.max_silence();
            *alive_at = arrived;
            self.has_measured = true;
            self.status.send_modify(|status| {
                status.state = State::Measuring;
                status.trouble = None;
            });
        }
    }

    fn identify(&mut self, mut identity: String) -> Result<(), Trouble> {
        if let Some(sender) = self.sender {
            identity = format!("{identity} at {sender}");
        }
        if let Some(configured) = &self.settings.identity
            && !identity.contains(configured.as_str())
        {
            return Err(Trouble::WrongIdentity {
                configured: configured.clone(),
                found: identity,
            });
        }
        let old = self.status.borrow().identity.clone();
        let is_changed = old.as_ref().is_some_and(|old| *old != identity);
        self.status.send_modify(|status| {
            status.identity = Some(identity.clone());
            status.identity_changes += u64::from(is_changed);
        });
        match old.filter(|_| is_changed) {
            Some(old) => {
                self.mapping = ClockMapping::default();
                let new = identity;
                Err(Trouble::IdentityChanged { old, new })
            }
            None => Ok(()),
        }
    }

    /// Gives data to the receiver, unless it is old. `asked`: the request that it was measured at.
    fn pass(&mut self, sample: Sample, asked: Option<Monotonic>, arrived: Monotonic) {
        let sent = match asked.map(DeviceTime::own).or(sample.sent) {
            Some(time) => self.mapping.map(time, arrived),
            None => Some(arrived),
        };
        let Some(sent) = sent else {
            return self.lose(Loss::Repeated);
        };
        let late = arrived.since(sent);
        // The request or the reply was late: in the middle the error is at most half of it.
        let (max_late, delay) = match self.device.poll_period().filter(|_| asked.is_some()) {
            Some(period) => (period / 4, late / 2),
            None => (MAX_AGE, Duration::ZERO),
        };
        if late > max_late {
            return self.lose(Loss::Stale);
        }
        let sent = sent + delay;
        let mut data = sample.data;
        let mut stamp = RobotTime::from_nanos(sent.nanos()) - duration(sample.age);
        if let MeasurementData::Scan { scan, .. } = &mut data {
            let is_possible = scan.sweep_duration().is_some();
            match self.settings.beams.apply(scan).filter(|_| is_possible) {
                Some(skipped) => stamp = stamp + skipped,
                None => return self.lose(Loss::BadScan),
            }
        }
        let Some(reserved) = self.readings.limit.reserve(data.payload_bytes()) else {
            return self.lose(Loss::QueueFull);
        };
        let stream = StreamId(self.settings.stream.0 + self.device.output(&data));
        let reading = Reading {
            measurement: Measurement {
                stamp,
                stream,
                frame: self.settings.name.clone(),
                data,
            },
            arrived,
            _reserved: reserved,
        };
        match self.readings.sender.try_send(reading) {
            Ok(()) => {}
            Err(TrySendError::Full(_)) => return self.lose(Loss::QueueFull),
            Err(TrySendError::Disconnected(_)) => self.is_wanted = false,
        }
        let rate_hz = self.rate.count(arrived);
        let clock = self.mapping.status();
        self.status.send_modify(|status| {
            status.measurements = status.measurements.saturating_add(1);
            status.measured_at = Some(arrived);
            status.rate_hz = rate_hz.unwrap_or(status.rate_hz);
            status.clock = clock;
        });
    }

    fn lose(&self, loss: Loss) {
        self.status.send_modify(|status| status.lose(loss, 1));
    }

    /// What the decoder has dropped since the last time.
    fn count_dropped(&self, session: &mut Session<D>) {
        let dropped = session.decoder.dropped();
        if *dropped != session.dropped {
            self.status.send_modify(|status| {
                for (reason, count) in dropped.iter() {
                    let new = count.saturating_sub(session.dropped.count(reason));
                    status.lose(Loss::Decoder(reason), new);
                }
            });
            session.dropped = dropped.clone();
        }
    }
}

impl Link {
    /// Bytes for the device; never, without a link or when the other end is gone.
    async fn receive(link: &mut Option<Self>) -> Arc<[u8]> {
        if let Some(link) = link
            && let Some(bytes) = link.from.recv().await
        {
            return bytes;
        }
        std::future::pending().await
    }
}

async fn open(address: &Address) -> Result<Transport, Trouble> {
    match timeout(CONNECT_TIMEOUT, Transport::open(address)).await {
        Ok(Ok(transport)) => Ok(transport),
        Ok(Err(error)) => Err(Trouble::Io(error.to_string())),
        Err(_elapsed) => Err(Trouble::NoConnection),
    }
}

async fn prepare(preparation: &mut dyn Preparation) -> Result<(), Trouble> {
    let name = preparation.name();
    let io = |error: io::Error| Trouble::Io(format!("{name}: {error}"));
    let address = preparation.address();
    let mut transport = open(&address).await?;
    let own = transport.own_address().map_err(io)?;
    write(&mut transport, &preparation.request(own)).await?;
    let (mut reply, mut buffer) = (Vec::new(), vec![0; READ_BYTES]);
    loop {
        let length = transport.read(&mut buffer).await.map_err(io)?;
        reply.extend_from_slice(buffer.get(..length).unwrap_or_default());
        let is_whole = length == 0 || matches!(address, Address::Udp(_));
        if is_whole || reply.len() > MAX_REPLY {
            break;
        }
    }
    let taken = preparation.take(&reply);
    taken.map_err(|why| Trouble::Refused(format!("{name}: {why}")))
}

async fn write(transport: &mut Transport, bytes: &[u8]) -> Result<(), Trouble> {
    match timeout(WRITE_TIMEOUT, transport.write(bytes)).await {
        Ok(Ok(())) => Ok(()),
        Ok(Err(error)) => Err(Trouble::Io(error.to_string())),
        Err(_elapsed) => Err(Trouble::Silent(WRITE_TIMEOUT)),
    }
}

fn duration(duration: Duration) -> RobotDuration {
    RobotDuration::from_nanos(i64::try_from(duration.as_nanos()).unwrap_or(i64::MAX))
}

/// One connection.
struct Session<D: Device> {
    decoder: D::Decoder,
    /// What the decoder had dropped when that was last counted.
    dropped: Dropped,
    phase: Phase,
}

/// What a connection waits for.
#[derive(Clone, Copy, Debug)]
enum Phase {
    /// A step is due.
    Send { step: usize, attempt: u32 },
    /// The reply to a request.
    Await {
        step: usize,
        name: &'static str,
        attempt: u32,
        until: Monotonic,
    },
    /// The device is busy.
    Pause { step: usize, until: Monotonic },
    /// Measurements.
    Run {
        max_silence: Duration,
        alive_at: Monotonic,
        poll_at: Monotonic,
        /// The last request of a device that measures when it is asked, until its reply comes.
        asked: Option<Monotonic>,
    },
}

impl Phase {
    const fn begin(step: usize) -> Self {
        Self::Send { step, attempt: 0 }
    }

    const fn take_asked(&mut self) -> Option<Monotonic> {
        match self {
            Self::Run { asked, .. } => asked.take(),
            Self::Send { .. } | Self::Await { .. } | Self::Pause { .. } => None,
        }
    }
}

enum Input {
    Nothing,
    Bytes(usize),
    ToDevice(Arc<[u8]>),
}

/// Counts measurements in windows of a second or more.
#[derive(Debug)]
struct Rate {
    since: Monotonic,
    count: u32,
}

impl Rate {
    const fn new(since: Monotonic) -> Self {
        Self { since, count: 0 }
    }

    /// The rate if a window is over.
    fn count(&mut self, now: Monotonic) -> Option<f64> {
        self.count += 1;
        let passed = now.since(self.since);
        (passed >= RATE_WINDOW).then(|| {
            let rate_hz = f64::from(self.count) / passed.as_secs_f64();
            *self = Self::new(now);
            rate_hz
        })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::sync_channel;

    use measurement::cloud::{Cloud, CloudPoint};

    use super::*;
    use crate::config::DeviceConfig;
    use crate::packet_lidar::PacketLidar;

    fn clock() -> Monotonic {
        Monotonic::from_nanos(0)
    }

    #[test]
    fn clouds_that_wait_are_bounded_by_their_bytes() {
        let point = CloudPoint {
            position_m: [1.0; 3],
            after_s: 0.0,
            intensity: 0.0,
            ring: Some(0),
        };
        let cloud = Sample {
            data: MeasurementData::Cloud(Cloud {
                points: vec![point; 100],
                without_return: 0,
            }),
            sent: None,
            age: Duration::ZERO,
        };
        let (sender, received) = sync_channel(99);
        let readings = Readings {
            sender,
            limit: ByteLimit::new(2 * cloud.data.payload_bytes() + 1),
        };
        let lidar = PacketLidar::new(&DeviceConfig::default()).unwrap();
        let settings = Settings {
            name: "lidar".into(),
            stream: StreamId(0),
            address: Address::Udp(String::new()),
            beams: BeamSelection::default(),
            identity: None,
        };
        let (mut supervisor, status) = Supervisor::new(lidar, settings, clock, readings, None);
        for _ in 0..3 {
            supervisor.pass(cloud.clone(), None, clock());
        }
        assert_eq!(status.borrow().lost(Loss::QueueFull), 1);
        drop(received.recv().unwrap());
        supervisor.pass(cloud, None, clock());
        assert_eq!(status.borrow().lost(Loss::QueueFull), 1);
        assert_eq!(status.borrow().measurements, 3);
        assert_eq!(received.try_iter().count(), 2);
    }
}
