//! Somebody who drives over a real link, as SPEC.md sections 12 and 13 have it, and keeps a journal of it.
//!
//! It is written from the specification and shares no code with the console: session, signature and keys are all
//! that it takes from the project.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    reason = "a part of tests: what fails here fails the test, with its reason"
)]

mod driving;
mod journal;
mod received;

use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::sleep;
use std::time::Duration;

use protocol::keys::{OperatorId, OperatorTopic, RobotId, operator_key};
use protocol::message::{Drive, Pose, SensorStatus, TeleopStatus};
use protocol::signed::{Command, CommandHeader, Route, SecretKey, sign};
use robot_edge::clock::{self, sleep_until};
use robot_edge::credentials::{Credentials, Identity};
use robot_edge::link::endpoints::Channel;
use robot_edge::link::sessions::{self, Endpoints, Side};
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority, Reliability};
use zenoh::{Session, Wait as _};

use received::{Received, Token, lock};

pub use journal::{Journal, Sent};

/// How long a robot may take to do what it is told; nothing is measured by it.
pub const TIMEOUT: Duration = Duration::from_secs(30);

/// From one command to the next.
pub const PERIOD: Duration = Duration::from_millis(20);

/// A change of input is sent so often, within [`PERIOD`].
const REPETITIONS: u32 = 3;

/// One reply is waited for so long; then the question is asked anew.
const REPLY_TIMEOUT: Duration = Duration::from_secs(1);

/// Where nothing moves for so long, whoever drives lets go and presses again.
const PRESSED_AGAIN: Duration = Duration::from_secs(2);

/// Longer than the neutral time that a press needs before it.
pub const NEUTRAL: Duration = Duration::from_millis(400);

/// What is pressed, m/s and rad/s in `base_link`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Input {
    /// Along x.
    pub linear_mps: f32,
    /// About z.
    pub angular_radps: f32,
}

impl Input {
    /// Nothing.
    pub const NEUTRAL: Self = Self::of(0.0, 0.0);

    /// These speeds.
    pub const fn of(linear_mps: f32, angular_radps: f32) -> Self {
        Self {
            linear_mps,
            angular_radps,
        }
    }
}

/// Somebody who drives.
pub struct Operator {
    /// What they call themselves.
    pub name: OperatorId,
    /// What they sign with.
    pub key: SecretKey,
    /// The grant of the lease that they rely on.
    pub epoch: u64,
    /// Of the last message that they signed.
    pub seq: u64,
    /// Every command sent so far.
    pub journal: Journal,
    robot: RobotId,
    session: Session,
    drive: Publisher<'static>,
    received: Arc<Mutex<Received>>,
    pressed: Input,
    journal_file: Option<File>,
}

impl Operator {
    /// Connects to `robot` at `endpoint` without keys, as soon as there is somebody to connect to.
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

    /// On a link that is open already, signing with that key.
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
            robot,
            session,
            drive,
            received,
            pressed: Input::NEUTRAL,
            journal_file: None,
        }
    }

    /// Writes the journal to a file too, each command before it is sent: it is whole whenever the process is killed.
    pub fn write_journal(&mut self, path: &Path) -> io::Result<()> {
        let mut file = File::create(path)?;
        Journal::begin(&mut file)?;
        self.journal_file = Some(file);
        Ok(())
    }

    /// As [`Operator::connect`], and ready to send commands.
    pub fn ready(endpoint: &str, robot: &str, name: &str) -> Self {
        Self::connect(endpoint, robot, name).with_token()
    }

    /// Waits until it can send commands.
    #[must_use]
    pub fn with_token(self) -> Self {
        self.wait_until("a token", || self.received().token.is_some().then_some(()));
        self
    }

    /// The robot that it drives.
    pub const fn robot(&self) -> &RobotId {
        &self.robot
    }

    /// The session that it drives over.
    pub const fn session(&self) -> &Session {
        &self.session
    }

    /// How driving goes, as last heard.
    pub fn teleop(&self) -> Option<TeleopStatus> {
        self.received().status.as_ref()?.teleop.clone()
    }

    /// How the sensors are doing, as last heard.
    pub fn sensors(&self) -> Vec<SensorStatus> {
        let received = self.received();
        received
            .status
            .as_ref()
            .map(|status| status.sensors.clone())
            .unwrap_or_default()
    }

    /// Where the robot is, by the last pose that came.
    pub fn pose(&self) -> Pose {
        lock(&self.received).pose.expect("a pose").1
    }

    /// How fast the robot turns, as last heard.
    pub fn turn_rate_radps(&self) -> f32 {
        self.received().pose.unwrap().1.turn_rate_radps
    }

    /// Waits until the status is as wanted.
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

    /// Waits for a status that the robot sends from now on, and returns it.
    pub fn wait_for_new_status(&self) -> TeleopStatus {
        self.received().status = None;
        self.wait_for_status("told", |_| true)
    }

    /// Signs a command with the newest token, a new `seq` and the present epoch.
    pub fn signed<T: Command>(&mut self, command: &T) -> Vec<u8> {
        let newest = self.received().token.expect("a token");
        self.signed_with(newest, command)
    }

    /// Sends a `Drive` as it is, for instance once more.
    pub fn put(&self, message: Vec<u8>) {
        // While the link is down there is nobody to send to.
        drop(self.drive.put(message).wait());
    }

    /// Sends what is pressed, as one iteration of a console's input loop does.
    pub fn command(&mut self, input: Input) -> Vec<u8> {
        let newest = self.received().token.expect("a token");
        let message = self.signed_with(
            newest,
            &Drive {
                linear_mps: input.linear_mps,
                angular_radps: input.angular_radps,
                estop: None,
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

    /// Holds this for a time; the last command, for whoever wants to send it again.
    pub fn hold(&mut self, input: Input, time: Duration) -> Vec<u8> {
        let until = clock::now() + time;
        self.hold_until(input, || clock::now() >= until)
    }

    /// Holds this until it is asked not to.
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
            // What was missed is not made up for.
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
                "{name} waits for {what} in vain"
            );
            sleep(PERIOD);
        }
    }
}

/// A session as consoles open them, as soon as somebody answers.
pub fn connected(endpoint: &str, credentials: Option<Credentials>) -> Session {
    let endpoints = Endpoints {
        connect: vec![endpoint.to_owned()],
        credentials,
        ..Endpoints::default()
    };
    let started = clock::now();
    loop {
        match sessions::open(Side::Console, Channel::Control, &endpoints) {
            Ok(session) => return session,
            Err(why) => assert!(clock::elapsed(started) < TIMEOUT, "{why}"),
        }
        sleep(PERIOD);
    }
}
