//! An operator who drives over a real link by SPEC.md sections 12 and 13 and keeps a journal.
//!
//! It shares no code with the console; from the project it uses sessions, signatures and keys
//! only.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    reason = "part of the tests: a panic here fails the test"
)]

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::sleep;
use std::time::Duration;

use measurement::time::Monotonic;
use network::clock::{self, sleep_until};
use network::credentials::{Credentials, Identity};
use network::endpoints::Channel;
use network::sessions::{self, Endpoints, Side};
use protocol::keys::{OperatorId, OperatorTopic, RobotId, Topic, operator_key};
use protocol::message::{
    AgeToken, Answer, DockingChoice, Drive, LeaseRequest, MapPose, Pose, Refusal, SensorStatus,
    Shores, ShoresReply, ShoresRequest, Status, TeleopState, TeleopStatus,
};
use protocol::signed::{Command, CommandHeader, Route, SecretKey, sign};
use protocol::tile::BootId;
use protocol::wire::{self, Header};
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority, Reliability};
use zenoh::{Session, Wait as _};

/// Longer than any step takes.
pub const TIMEOUT: Duration = Duration::from_secs(30);

/// From one command to the next.
pub const PERIOD: Duration = Duration::from_millis(20);

/// Commands per [`PERIOD`] when the input changes.
const REPETITIONS: u32 = 3;

/// Timeout of a reply; then the request is repeated.
const REPLY_TIMEOUT: Duration = Duration::from_secs(1);

/// If the vehicle does not move for this long, the operator releases and presses again.
const PRESSED_AGAIN: Duration = Duration::from_secs(2);

/// Longer than the neutral time that a press needs.
pub const NEUTRAL: Duration = Duration::from_millis(400);

/// Requested speeds, m/s and rad/s in `base_link`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Input {
    /// Along x.
    pub linear_mps: f32,
    /// Along y.
    pub lateral_mps: f32,
    /// About z.
    pub angular_radps: f32,
}

impl Input {
    pub const NEUTRAL: Self = Self::of(0.0, 0.0);

    pub const fn of(linear_mps: f32, angular_radps: f32) -> Self {
        Self {
            linear_mps,
            lateral_mps: 0.0,
            angular_radps,
        }
    }
}

pub struct Operator {
    pub name: OperatorId,
    pub key: SecretKey,
    /// Their grant of the lease.
    pub epoch: u64,
    /// Number of the last signed message.
    pub seq: u64,
    pub journal: Journal,
    /// The docking site that its commands name.
    pub docking: Option<DockingChoice>,
    /// The goal that its commands name.
    pub goal: Option<MapPose>,
    robot: RobotId,
    session: Session,
    drive: Publisher<'static>,
    received: Arc<Mutex<Received>>,
    pressed: Input,
    journal_file: Option<File>,
}

impl Operator {
    /// Connects to `robot` at `endpoint` without keys; tries again until it answers.
    pub fn connect(endpoint: &str, robot: &str, name: &str) -> Self {
        let name: OperatorId = name.parse().unwrap();
        let key = SecretKey::without_secret(&name);
        Self::on(connected(endpoint, None), robot, name, key)
    }

    /// As [`Operator::ready`], with the keys of a person's folder.
    pub fn with_keys(endpoint: &str, robot: &str, folder: &Path) -> Self {
        let credentials = Credentials::open(folder).unwrap();
        let Identity::Person(name, _) = credentials.identity().clone() else {
            panic!("these are the keys of {}", credentials.identity())
        };
        let key = credentials.signing_key().unwrap();
        let session = connected(endpoint, Some(credentials));
        Self::on(session, robot, name, key).with_token()
    }

    /// Uses an open session and signs with `key`.
    pub fn on(session: Session, robot: &str, name: OperatorId, key: SecretKey) -> Self {
        let robot: RobotId = robot.parse().unwrap();
        let received = Received::subscribe(&session, &robot);
        let drive = session
            .declare_publisher(operator_key(&robot, &name, OperatorTopic::Drive))
            .congestion_control(CongestionControl::Drop)
            .priority(Priority::RealTime)
            .express(true)
            // Over QUIC a datagram, which is never sent again.
            .reliability(Reliability::BestEffort)
            .wait()
            .unwrap();
        Self {
            key,
            name,
            epoch: 0,
            seq: 0,
            journal: Journal::default(),
            docking: None,
            goal: None,
            robot,
            session,
            drive,
            received,
            pressed: Input::NEUTRAL,
            journal_file: None,
        }
    }

    /// Writes the journal to a file too, each command before it is sent, so that a kill loses none.
    pub fn write_journal(&mut self, path: &Path) -> io::Result<()> {
        let mut file = File::create(path)?;
        Journal::begin(&mut file)?;
        self.journal_file = Some(file);
        Ok(())
    }

    /// As [`Operator::connect`]; ready to send commands.
    pub fn ready(endpoint: &str, robot: &str, name: &str) -> Self {
        Self::connect(endpoint, robot, name).with_token()
    }

    #[must_use]
    pub fn with_token(self) -> Self {
        self.wait_until("a token", || self.received().token.is_some().then_some(()));
        self
    }

    pub const fn robot(&self) -> &RobotId {
        &self.robot
    }

    pub const fn session(&self) -> &Session {
        &self.session
    }

    pub fn teleop(&self) -> Option<TeleopStatus> {
        self.received().status.as_ref()?.teleop.clone()
    }

    /// What the robot knows of shores; over a session to its port for maps.
    pub fn shores(&self, bulk: &Session) -> Option<Shores> {
        let header = Header {
            boot: BootId([0; 16]),
            seq: 0,
            robot_time_ns: 0,
        };
        let request = wire::encode(&header, &ShoresRequest { newer_than: 0 }).unwrap();
        let query = bulk.get(Topic::Shores.key(&self.robot));
        let replies = query.payload(request).timeout(REPLY_TIMEOUT).wait().ok()?;
        let reply = replies.recv().ok()?;
        let payload = reply.result().ok()?.payload().to_bytes();
        wire::decode::<ShoresReply>(&payload).unwrap().1.shores
    }

    pub fn sensors(&self) -> Vec<SensorStatus> {
        let received = self.received();
        received
            .status
            .as_ref()
            .map(|status| status.sensors.clone())
            .unwrap_or_default()
    }

    pub fn pose(&self) -> Pose {
        lock(&self.received).pose.expect("a pose").1
    }

    pub fn turn_rate_radps(&self) -> f32 {
        self.received().pose.unwrap().1.turn_rate_radps
    }

    pub fn wait_for_status(
        &self,
        what: &str,
        is_so: impl Fn(&TeleopStatus) -> bool,
    ) -> TeleopStatus {
        let started = clock::now();
        loop {
            let teleop = self.teleop();
            if let Some(teleop) = teleop.as_ref().filter(|teleop| is_so(teleop)) {
                return teleop.clone();
            }
            assert!(clock::elapsed(started) < TIMEOUT, "not {what}: {teleop:?}");
            sleep(PERIOD);
        }
    }

    pub fn wait_for_new_status(&self) -> TeleopStatus {
        self.received().status = None;
        self.wait_for_status("a status", |_| true)
    }

    /// Sends a request until it is answered, with a new token and `seq` each time.
    pub fn ask<T: Command>(&mut self, command: &T) -> Answer {
        let key = operator_key(&self.robot, &self.name, T::TOPIC);
        let started = clock::now();
        while clock::elapsed(started) < TIMEOUT {
            let message = self.signed(command);
            let query = self.session.get(key.clone()).payload(message);
            let replies = query.timeout(REPLY_TIMEOUT).wait();
            let reply = replies.ok().and_then(|replies| replies.recv().ok());
            if let Some(Ok(sample)) = reply.as_ref().map(zenoh::query::Reply::result) {
                return wire::decode(&sample.payload().to_bytes()).unwrap().1;
            }
            sleep(PERIOD);
        }
        panic!("no answer to {key}");
    }

    /// Requests the lease until it is granted, or for `TIMEOUT`.
    pub fn take_lease(&mut self) {
        let started = clock::now();
        loop {
            match self.ask(&LeaseRequest::Request) {
                Answer::Granted(epoch) => {
                    self.epoch = epoch;
                    return;
                }
                // After a reconnect the token may be old, or delayed commands use up the rate.
                Answer::Refused(Refusal::TooOld | Refusal::UnknownToken | Refusal::TooMany)
                    if clock::elapsed(started) < TIMEOUT =>
                {
                    sleep(PERIOD);
                }
                // The vehicle must stop first. A grant that is not received in time is requested again.
                Answer::Waiting if clock::elapsed(started) < TIMEOUT => {
                    let asked = clock::now();
                    while clock::elapsed(asked) < Duration::from_secs(1) {
                        let lease = self.teleop().map(|teleop| teleop.lease);
                        let granted =
                            lease.filter(|lease| lease.holder.as_ref() == Some(&self.name));
                        if let Some(lease) = granted {
                            self.epoch = lease.epoch;
                            return;
                        }
                        sleep(PERIOD);
                    }
                }
                answer @ (Answer::Done
                | Answer::Waiting
                | Answer::EStopped(_)
                | Answer::Refused(_)) => {
                    panic!("{answer:?}: {:?}", self.teleop())
                }
            }
        }
    }

    /// Requests the lease unless it is held, sends neutral, then `input`, and waits until the vehicle drives.
    pub fn start_driving(&mut self, input: Input) {
        let lease = self.wait_for_new_status().lease;
        if lease.holder.as_ref() == Some(&self.name) || lease.next.as_ref() == Some(&self.name) {
            let granted = self.wait_for_status("granted", |teleop| {
                teleop.lease.holder.as_ref() == Some(&self.name)
            });
            self.epoch = granted.lease.epoch;
        } else {
            self.take_lease();
        }
        let received = Arc::clone(&self.received);
        let started = clock::now();
        loop {
            self.hold(Input::NEUTRAL, NEUTRAL);
            lock(&received).status = None;
            let pressed = clock::now();
            let teleop = || lock(&received).status.as_ref()?.teleop.clone();
            let drives = || teleop().is_some_and(|teleop| teleop.state == TeleopState::Driving);
            self.hold_until(input, || {
                drives() || clock::elapsed(pressed) > PRESSED_AGAIN
            });
            if drives() {
                return;
            }
            let teleop = teleop();
            assert!(
                clock::elapsed(started) < TIMEOUT,
                "it does not start: {teleop:?}"
            );
            // On a bad link it may have ended meanwhile.
            if teleop.is_some_and(|teleop| teleop.lease.holder.as_ref() != Some(&self.name)) {
                self.take_lease();
            }
        }
    }

    /// Signs a command with the newest token, a new `seq` and the present epoch.
    pub fn signed<T: Command>(&mut self, command: &T) -> Vec<u8> {
        let newest = self.received().token.expect("a token");
        self.signed_with(newest, command)
    }

    pub fn put(&self, message: Vec<u8>) {
        // Fails while the link is down.
        drop(self.drive.put(message).wait());
    }

    /// Sends one command, as one iteration of a console's input loop.
    pub fn command(&mut self, input: Input) -> Vec<u8> {
        let newest = self.received().token.expect("a token");
        let message = self.signed_with(
            newest,
            &Drive {
                linear_mps: input.linear_mps,
                lateral_mps: input.lateral_mps,
                angular_radps: input.angular_radps,
                estop: None,
                docking: self.docking,
                goal: self.goal,
            },
        );
        let sent = Sent {
            at: clock::now(),
            seq: self.seq,
            epoch: self.epoch,
            token: newest.token.n,
            token_received: newest.received,
            input,
        };
        if let Some(file) = &mut self.journal_file {
            Journal::write(file, &sent).unwrap();
        }
        self.journal.push(sent);
        self.put(message.clone());
        message
    }

    /// Holds `input` for a time; returns the last message.
    pub fn hold(&mut self, input: Input, time: Duration) -> Vec<u8> {
        let until = clock::now() + time;
        self.hold_until(input, || clock::now() >= until)
    }

    /// Holds `input` until `is_over`.
    pub fn hold_until(&mut self, input: Input, is_over: impl Fn() -> bool) -> Vec<u8> {
        let mut next = clock::now();
        loop {
            let mut last = self.command(input);
            if input != self.pressed {
                for repetition in 1..REPETITIONS {
                    sleep_until(next + PERIOD * repetition / (REPETITIONS + 1), || false);
                    last = self.command(input);
                }
                self.pressed = input;
            }
            // Missed commands are not sent later.
            next = (next + PERIOD).max(clock::now());
            sleep_until(next, || false);
            if is_over() {
                return last;
            }
        }
    }

    /// The next stamp, with the newest token.
    pub fn stamp(&mut self) -> CommandHeader {
        let newest = self.received().token.expect("a token");
        self.stamp_with(newest)
    }

    fn stamp_with(&mut self, newest: Token) -> CommandHeader {
        self.seq += 1;
        CommandHeader {
            boot: newest.boot,
            token: newest.token,
            epoch: self.epoch,
            seq: self.seq,
        }
    }

    fn signed_with<T: Command>(&mut self, newest: Token, command: &T) -> Vec<u8> {
        let stamp = self.stamp_with(newest);
        let route = Route {
            robot: &self.robot,
            operator: &self.name,
        };
        sign(&self.key, route, &stamp, command).unwrap()
    }

    fn received(&self) -> MutexGuard<'_, Received> {
        lock(&self.received)
    }

    fn wait_until<T>(&self, what: &str, find: impl Fn() -> Option<T>) -> T {
        let started = clock::now();
        loop {
            if let Some(found) = find() {
                return found;
            }
            let name = &self.name;
            assert!(
                clock::elapsed(started) < TIMEOUT,
                "{name}: timed out waiting for {what}"
            );
            sleep(PERIOD);
        }
    }
}

/// Number of commands refused for that reason.
pub fn refused(teleop: &TeleopStatus, reason: Refusal) -> u64 {
    let refused = teleop.counters.refused.iter();
    let mut of_reason = refused.filter(|refused| refused.reason == reason);
    of_reason.next().map_or(0, |refused| refused.count)
}

/// A console's session; tries again until the endpoint answers.
pub fn connected(endpoint: &str, credentials: Option<Credentials>) -> Session {
    connected_to(Channel::Control, endpoint, credentials)
}

/// The same to either port of the robot whose port for control is `endpoint`.
pub fn connected_to(channel: Channel, endpoint: &str, credentials: Option<Credentials>) -> Session {
    let endpoints = Endpoints {
        connect: vec![endpoint.to_owned()],
        credentials,
        ..Endpoints::default()
    };
    let started = clock::now();
    loop {
        match sessions::open(Side::Console, channel, &endpoints) {
            Ok(session) => return session,
            Err(why) => assert!(clock::elapsed(started) < TIMEOUT, "{why}"),
        }
        sleep(PERIOD);
    }
}

/// The last messages of the robot.
#[derive(Default)]
struct Received {
    pose: Option<(BootId, Pose)>,
    token: Option<Token>,
    status: Option<Status>,
}

/// The newest token and its time of arrival.
#[derive(Clone, Copy)]
struct Token {
    boot: BootId,
    token: AgeToken,
    received: Monotonic,
}

impl Received {
    fn subscribe(session: &Session, robot: &RobotId) -> Arc<Mutex<Self>> {
        let received = Arc::new(Mutex::new(Self::default()));
        for topic in [Topic::Pose, Topic::Status] {
            let received = Arc::clone(&received);
            session
                .declare_subscriber(topic.key(robot))
                .callback(move |sample| {
                    let bytes = sample.payload().to_bytes();
                    let mut received = lock(&received);
                    // Undecodable messages on these keys are ignored.
                    if topic != Topic::Pose {
                        received.status = wire::decode(&bytes).ok().map(|(_, status)| status);
                    } else if let Ok((header, pose)) = wire::decode(&bytes) {
                        received.pose(header.boot, pose);
                    }
                })
                .background()
                .wait()
                .unwrap();
        }
        received
    }

    fn pose(&mut self, boot: BootId, pose: Pose) {
        self.pose = Some((boot, pose));
        let Some(token) = pose.token else { return };
        let is_news = self
            .token
            .is_none_or(|last| last.boot != boot || last.token.n < token.n);
        if is_news {
            self.token = Some(Token {
                boot,
                token,
                received: clock::now(),
            });
        }
    }
}

fn lock(received: &Mutex<Received>) -> MutexGuard<'_, Received> {
    received.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The first line of a journal as CSV.
const COLUMNS: &str = "t_ns,seq,epoch,token,token_t_ns,linear_mps,lateral_mps,angular_radps";

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sent {
    /// When it was built.
    pub at: Monotonic,
    pub seq: u64,
    /// The grant of the lease that it names.
    pub epoch: u64,
    /// Number of its token.
    pub token: u64,
    /// When that token was first received: later than it was issued.
    pub token_received: Monotonic,
    pub input: Input,
}

/// All commands of one operator, by rising [`Sent::seq`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Journal {
    sent: Vec<Sent>,
}

impl Journal {
    pub fn push(&mut self, sent: Sent) {
        debug_assert!(self.sent.last().is_none_or(|last| last.seq < sent.seq));
        self.sent.push(sent);
    }

    pub fn sent(&self) -> &[Sent] {
        &self.sent
    }

    pub fn find(&self, seq: u64) -> Option<&Sent> {
        let at = self.sent.binary_search_by_key(&seq, |sent| sent.seq).ok()?;
        self.sent.get(at)
    }

    pub fn between(&self, after: u64, before: u64) -> &[Sent] {
        let from = self.sent.partition_point(|sent| sent.seq <= after);
        let to = self.sent.partition_point(|sent| sent.seq < before);
        self.sent.get(from..to).unwrap_or_default()
    }

    /// Writes the first line of a CSV file.
    pub fn begin(out: &mut impl Write) -> io::Result<()> {
        writeln!(out, "{COLUMNS}")
    }

    /// Writes one command as a line of it.
    pub fn write(out: &mut impl Write, sent: &Sent) -> io::Result<()> {
        let Sent {
            at,
            seq,
            epoch,
            token,
            token_received,
            input,
        } = sent;
        let [at, received] = [*at, *token_received].map(nanos);
        let Input {
            linear_mps,
            lateral_mps,
            angular_radps,
        } = input;
        let line = format!(
            "{at},{seq},{epoch},{token},{received},{linear_mps},{lateral_mps},{angular_radps}\n"
        );
        out.write_all(line.as_bytes())
    }

    /// Reads such a file and ignores an incomplete last line.
    ///
    /// Fails at the first other invalid line, with its number.
    pub fn parse(csv: &str) -> Result<Self, String> {
        let mut lines = csv.split_inclusive('\n');
        let first = lines.next().unwrap_or_default().trim_end();
        if first != COLUMNS {
            return Err(format!("line 1 is {first:?}, not {COLUMNS:?}"));
        }
        let mut sent = Vec::new();
        for (number, line) in (2..).zip(lines) {
            let Some(line) = line.strip_suffix('\n') else {
                break;
            };
            sent.push(parse_line(line).ok_or_else(|| format!("line {number}: {line:?}"))?);
        }
        Ok(Self { sent })
    }
}

fn parse_line(line: &str) -> Option<Sent> {
    let mut fields = line.split(',');
    let mut whole = || fields.next()?.parse::<u64>().ok();
    let (at, seq, epoch) = (whole()?, whole()?, whole()?);
    let (token, received) = (whole()?, whole()?);
    let mut speed = || fields.next()?.parse::<f32>().ok();
    let input = Input {
        linear_mps: speed()?,
        lateral_mps: speed()?,
        angular_radps: speed()?,
    };
    fields.next().is_none().then(|| Sent {
        at: Monotonic::from_nanos(at),
        seq,
        epoch,
        token,
        token_received: Monotonic::from_nanos(received),
        input,
    })
}

fn nanos(moment: Monotonic) -> u128 {
    moment.since(Monotonic::default()).as_nanos()
}
