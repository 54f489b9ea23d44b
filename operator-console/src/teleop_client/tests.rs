#![expect(clippy::float_cmp, reason = "shares of whole presses are exact")]

use protocol::keys::OperatorTopic;
use protocol::message::{
    Answer, Arming, Drive, EStop, EStopStatus, LeaseStatus, Refusal, StopReason, TeleopState,
};
use protocol::signed::{CommandHeader, Envelope, Route};

use super::*;
use crate::teleop_input::{DriveKey, SpeedStep};
use crate::test_support::{BOOT, STORED_ESTOP, at, idle_teleop_status};

mod goals;
mod key_changes;
mod rights;

#[derive(Clone, Debug, PartialEq)]
enum Read {
    Drive(Drive),
    EStop(EStop),
    Lease(LeaseRequest),
    Other(OperatorTopic),
}

/// A robot with the deceleration of the presets.
fn able([speed_mps, turn_rate_radps]: [f32; 2]) -> Info {
    Info {
        limits: [speed_mps, 0.0, turn_rate_radps],
        stop_decel_mps2: 1.0,
        stop_decel_radps2: 4.0,
        ..Info::default()
    }
}

/// A teleop client and a robot that receives everything.
struct Rig {
    teleop_client: TeleopClient,
    ms: u64,
    boot: BootId,
    speaks: bool,
    token_period_ms: u64,
    velocity: [f32; 3],
    last_seq: u64,
    sent: Vec<(u64, CommandHeader, Read)>,
}

impl Rig {
    fn new() -> Self {
        let identity = Identity::without_keys("anna".parse().unwrap());
        let mut teleop_client = TeleopClient::new("scout".parse().unwrap(), identity, 77);
        teleop_client.set_robot_info(&able([1.0, 2.0]));
        teleop_client.apply(InputEvent::Focus(true));
        teleop_client.apply(InputEvent::Step(SpeedStep::new(5).unwrap()));
        Self {
            teleop_client,
            ms: 1000,
            boot: BOOT,
            speaks: true,
            token_period_ms: 20,
            velocity: [0.0; 3],
            last_seq: 0,
            sent: Vec::new(),
        }
    }

    /// A client with the lease by grant 4 after enough neutral commands.
    fn held() -> Self {
        let mut rig = Self::new();
        rig.ask(LeaseRequest::Request);
        rig.run(20);
        rig.answer(Answer::Granted(4));
        rig.run(400);
        rig
    }

    fn newest(&self) -> Option<LatestPose> {
        let n = self.ms / self.token_period_ms;
        self.speaks.then_some(LatestPose {
            boot: self.boot,
            token: Some(AgeToken { n, nonce: n ^ 9 }),
            velocity: self.velocity,
            at: at(n * self.token_period_ms),
        })
    }

    fn turn(&mut self, events: &[InputEvent]) {
        let newest = self.newest();
        self.teleop_client.begin(newest, at(self.ms));
        for event in events {
            self.teleop_client.apply(*event);
        }
        for message in self.teleop_client.end(at(self.ms)) {
            let envelope = Envelope::parse(&message.payload).unwrap();
            let stamp = envelope.unverified_header();
            assert!(stamp.seq > self.last_seq, "the number grows");
            self.last_seq = stamp.seq;
            let key = self.teleop_client.identity.key.public();
            let (robot, operator) = (
                &self.teleop_client.robot,
                &self.teleop_client.identity.operator,
            );
            let route = Route { robot, operator };
            let read = match message.topic {
                OperatorTopic::Drive => Read::Drive(envelope.open(route, &key).unwrap()),
                OperatorTopic::EStop => Read::EStop(envelope.open(route, &key).unwrap()),
                OperatorTopic::Lease => Read::Lease(envelope.open(route, &key).unwrap()),
                OperatorTopic::Reset | OperatorTopic::Set => Read::Other(message.topic),
            };
            assert_eq!(
                message.request.is_none(),
                message.topic == OperatorTopic::Drive
            );
            self.sent.push((self.ms, stamp, read));
        }
    }

    /// Iterations for this time; the loop sleeps until the client is due.
    fn run(&mut self, ms: u64) {
        let until = self.ms + ms;
        while self.ms < until {
            self.turn(&[]);
            self.ms += 1;
            while self.ms < until
                && self
                    .teleop_client
                    .due(at(self.ms))
                    .is_none_or(|due| due > at(self.ms))
            {
                self.ms += 1;
            }
        }
    }

    fn state(&self) -> TeleopClientState {
        self.teleop_client.state(at(self.ms))
    }

    fn notes(&mut self) -> Vec<TeleopNotification> {
        self.teleop_client.take_notifications().into()
    }

    fn drives_after_release(&mut self) {
        self.turn(&[NO_W]);
        self.run(300);
        self.turn(&[W]);
        assert!(self.moves());
    }

    fn ask(&mut self, request: LeaseRequest) {
        self.teleop_client
            .submit(Intent::Lease(request), at(self.ms));
    }

    fn answer(&mut self, answer: Answer) {
        let request = RequestNumber(self.teleop_client.numbers);
        let boot = self.boot;
        let message = TeleopMessage::Answer {
            request,
            boot,
            answer,
        };
        self.teleop_client.receive(message, at(self.ms));
    }

    fn status(&mut self, change: impl FnOnce(&mut TeleopStatus)) {
        let mut status = status();
        change(&mut status);
        let message = TeleopMessage::Status {
            boot: self.boot,
            teleop: Some(Box::new(status)),
        };
        self.teleop_client.receive(message, at(self.ms));
    }

    fn since(&mut self) -> Vec<(u64, CommandHeader, Read)> {
        std::mem::take(&mut self.sent)
    }

    fn speeds(&mut self) -> Vec<(u64, f32)> {
        let sent = self.since().into_iter();
        sent.filter_map(|(ms, _, read)| match read {
            Read::Drive(drive) => Some((ms, drive.linear_mps)),
            Read::EStop(_) | Read::Lease(_) | Read::Other(_) => None,
        })
        .collect()
    }

    fn moves(&mut self) -> bool {
        self.speeds().iter().any(|(_, speed)| *speed != 0.0)
    }
}

fn status() -> TeleopStatus {
    TeleopStatus {
        state: TeleopState::Held,
        lease: LeaseStatus {
            epoch: 4,
            holder: Some("anna".parse().unwrap()),
            next: None,
            waiting: None,
        },
        arming: Arming::Neutral,
        speed_allowed_mps: 1.0,
        ..idle_teleop_status()
    }
}

const W: InputEvent = InputEvent::Press(DriveKey::W);
const NO_W: InputEvent = InputEvent::Release(DriveKey::W);

#[test]
fn nothing_is_sent_before_it_is_asked_for() {
    let mut rig = Rig::new();
    rig.run(500);
    rig.turn(&[W]);
    rig.run(500);
    assert_eq!(rig.since(), []);
    assert_eq!(
        rig.teleop_client.due(at(rig.ms)),
        None,
        "nor does the loop wake for it"
    );
}

#[test]
fn after_the_grant_neutral_is_sent_at_50_hz() {
    let mut rig = Rig::new();
    rig.ask(LeaseRequest::Request);
    rig.run(100);
    let sent = rig.since();
    assert_eq!(sent.len(), 1);
    assert_eq!(sent[0].2, Read::Lease(LeaseRequest::Request));
    rig.answer(Answer::Granted(4));
    rig.run(1000);
    let sent = rig.since();
    assert_eq!(sent.len(), 50);
    for (ms, stamp, read) in sent {
        let neutral = Drive {
            linear_mps: 0.0,
            lateral_mps: 0.0,
            angular_radps: 0.0,
            estop: None,
            docking: None,
            goal: None,
        };
        assert_eq!(read, Read::Drive(neutral));
        assert_eq!((stamp.boot, stamp.epoch), (BOOT, 4));
        assert_eq!(stamp.token.n, ms / 20, "the newest token");
    }
}

#[test]
fn press_and_release_are_sent_three_times_at_once() {
    let mut rig = Rig::held();
    rig.since();
    let pressed = rig.ms;
    rig.turn(&[W]);
    rig.run(60);
    let sent = rig.speeds();
    let expected = [0, 7, 14, 34, 54].map(|ms| (pressed + ms, 1.0));
    assert_eq!(sent, expected);
    let released = rig.ms;
    rig.turn(&[NO_W]);
    rig.run(20);
    assert_eq!(rig.speeds(), [0, 7, 14].map(|ms| (released + ms, 0.0)));
}

#[test]
fn key_pressed_before_the_grant_moves_nothing() {
    let mut rig = Rig::new();
    rig.turn(&[W]);
    rig.ask(LeaseRequest::Request);
    rig.run(20);
    rig.answer(Answer::Granted(4));
    rig.run(500);
    assert!(!rig.moves());
    let state = rig.state();
    assert_eq!(
        (state.ignored, state.keys),
        (Some(InputLockReason::Lease), Vec::new())
    );
    rig.turn(&[NO_W]);
    rig.turn(&[W]);
    assert!(rig.moves());
    assert_eq!(rig.state().keys, [DriveKey::W]);
}

#[test]
fn new_grant_locks_pressed_keys_of_the_holder() {
    let mut rig = Rig::held();
    rig.turn(&[W]);
    rig.run(100);
    rig.ask(LeaseRequest::Request);
    rig.run(20);
    assert!(rig.moves());
    rig.answer(Answer::Granted(5));
    rig.run(500);
    assert!(!rig.moves());
    rig.drives_after_release();
}

#[test]
fn early_press_is_delayed_and_not_lost() {
    let mut rig = Rig::held();
    rig.turn(&[W]);
    rig.run(40);
    rig.turn(&[NO_W]);
    rig.run(40);
    rig.since();
    let again = rig.ms;
    rig.turn(&[W]);
    rig.run(400);
    let first = rig.speeds().into_iter().find(|(_, speed)| *speed > 0.0);
    let held_back = first.unwrap().0 - again;
    assert!((200..=250).contains(&held_back), "{held_back}");
    // While its motors move, the robot accepts it at once. A boat held by the collision monitor coasts with motors at
    // zero.
    for (applied_mps, is_taken) in [(0.5, true), (0.0, false)] {
        rig.turn(&[NO_W]);
        rig.velocity = [0.5, 0.0, 0.0];
        rig.status(|status| {
            status.state = TeleopState::Driving;
            status.applied.linear_mps = applied_mps;
            status.peak_age_ms = Some(40);
        });
        rig.run(40);
        rig.since();
        rig.turn(&[W]);
        assert_eq!(rig.moves(), is_taken, "{applied_mps}");
        rig.run(400);
    }
}

#[test]
fn without_tokens_nothing_is_sent_and_keys_lock() {
    let mut rig = Rig::held();
    rig.turn(&[W]);
    rig.run(100);
    assert!(rig.moves());
    rig.speaks = false;
    let cut = rig.ms;
    rig.run(3000);
    let sent = rig.speeds();
    assert!(sent.iter().all(|(ms, _)| *ms <= cut + 1020), "{sent:?}");
    let moving = sent.iter().filter(|(_, speed)| *speed != 0.0);
    assert!(moving.clone().all(|(ms, _)| *ms <= cut + 620));
    rig.speaks = true;
    rig.run(1000);
    assert!(!rig.moves(), "W is still down");
    rig.drives_after_release();
}

/// While nobody drives tokens come seldom, and the robot refuses an old one.
#[test]
fn request_waits_for_new_token() {
    let mut rig = Rig::new();
    rig.token_period_ms = 200;
    rig.run(130);
    rig.ask(LeaseRequest::Request);
    rig.run(69);
    assert_eq!(rig.since(), []);
    rig.run(20);
    let sent = rig.since();
    let [(ms, header, Read::Lease(LeaseRequest::Request))] = &sent[..] else {
        panic!("{sent:?}");
    };
    assert_eq!(header.token.n, 6);
    assert!((1200..=1210).contains(ms), "{ms}");
    // No further one comes.
    rig.speaks = false;
    rig.answer(Answer::Refused(protocol::message::Refusal::Role));
    rig.run(100);
    rig.ask(LeaseRequest::Request);
    rig.run(1000);
    assert_eq!(rig.since(), []);
    let not_sent = RequestKind::Lease(LeaseRequest::Request);
    let not_sent = TeleopNotification::NotSent(not_sent, NotSentReason::NoToken);
    assert!(rig.teleop_client.notifications.contains(&not_sent));
}

#[test]
fn suspended_loop_sends_nothing_of_queued_input() {
    let mut rig = Rig::held();
    rig.turn(&[W]);
    rig.run(100);
    rig.since();
    rig.ms += 2000;
    // Even a new press from the queue.
    rig.turn(&[NO_W, W]);
    rig.run(500);
    assert!(!rig.moves());
    rig.drives_after_release();
}

/// The token is taken before the queue is drained: if painting hangs in between, the command has its true age.
#[test]
fn command_has_the_token_from_before_its_events() {
    let mut rig = Rig::held();
    rig.since();
    let newest = rig.newest();
    rig.teleop_client.begin(newest, at(rig.ms));
    let n = rig.ms / 20;
    rig.ms += 200;
    rig.teleop_client.apply(W);
    let messages = rig.teleop_client.end(at(rig.ms));
    let envelope = Envelope::parse(&messages[0].payload).unwrap();
    assert_eq!(envelope.unverified_header().token.n, n);
}

#[test]
fn lost_lease_or_robot_ends_commands() {
    for change in [
        |rig: &mut Rig| rig.status(|status| status.lease.holder = None),
        |rig: &mut Rig| rig.status(|status| status.lease.epoch = 5),
        |rig: &mut Rig| rig.boot = BootId([8; 16]),
    ] {
        let mut rig = Rig::held();
        rig.turn(&[W]);
        rig.run(100);
        change(&mut rig);
        rig.since();
        rig.run(1000);
        assert_eq!(rig.since(), []);
        assert_eq!(rig.state().lease, Lease::None);
        let notifications = rig.notes();
        assert!(
            notifications.contains(&TeleopNotification::LeaseLost),
            "{notifications:?}"
        );
    }
}

#[test]
fn involuntary_stop_needs_a_new_press() {
    let mut rig = Rig::held();
    rig.turn(&[W]);
    rig.status(|status| status.state = TeleopState::Driving);
    rig.run(100);
    assert!(rig.moves());
    rig.status(|status| status.last_stop = Some(StopReason::Age));
    rig.run(300);
    rig.since();
    rig.run(500);
    assert!(!rig.moves());
    assert_eq!(rig.state().ignored, Some(InputLockReason::Stopped));
}

#[test]
fn press_after_release_is_no_involuntary_stop() {
    let mut rig = Rig::held();
    rig.turn(&[W]);
    rig.status(|status| status.state = TeleopState::Driving);
    rig.run(100);
    rig.turn(&[NO_W]);
    rig.run(300);
    rig.turn(&[W]);
    rig.status(|status| status.last_stop = Some(StopReason::Released));
    rig.since();
    rig.run(100);
    assert!(rig.moves());
}

#[test]
fn estop_is_sent_by_both_paths_until_acknowledged() {
    for holds in [true, false] {
        let mut rig = if holds { Rig::held() } else { Rig::new() };
        rig.run(20);
        rig.since();
        rig.turn(&[W]);
        let pressed = rig.ms;
        rig.turn(&[InputEvent::EStop]);
        rig.run(1000);
        let sent = rig.since();
        let mut queries = Vec::new();
        for (ms, _, read) in &sent {
            match read {
                Read::EStop(estop) => queries.push((*ms, estop.press)),
                Read::Drive(drive) if *ms > pressed => {
                    assert_eq!(drive.estop, Some(EStop { press: 77 }));
                    assert_eq!(drive.linear_mps, 0.0);
                }
                Read::Drive(_) | Read::Lease(_) | Read::Other(_) => {}
            }
        }
        let expected: Vec<_> = (0..10).map(|n| (pressed + 100 * n, 77)).collect();
        assert_eq!(queries, expected);
        let drives = sent.len() - queries.len();
        assert!(if holds { drives >= 50 } else { drives == 10 }, "{drives}");

        rig.status(|status| {
            status.estop = Some(EStopStatus {
                number: 1,
                is_stored: false,
            });
        });
        assert!(matches!(rig.state().estop, EStopState::Sending(_)));
        rig.answer(Answer::EStopped(1));
        assert_eq!(rig.state().estop, EStopState::Quiet);
        rig.since();
        rig.run(500);
        let sent = rig.since();
        let is_estop = |(_, _, read): &(u64, CommandHeader, Read)| matches!(read, Read::EStop(_));
        assert!(!sent.iter().any(is_estop));
    }
}

#[test]
fn estop_survives_restart_and_missing_robot() {
    let mut rig = Rig::new();
    rig.speaks = false;
    rig.turn(&[InputEvent::EStop]);
    rig.run(1000);
    assert_eq!(rig.since(), []);
    assert!(matches!(rig.state().estop, EStopState::Unsendable(_)));
    rig.speaks = true;
    for boot in [7, 8] {
        rig.boot = BootId([boot; 16]);
        rig.run(100);
        let sent = rig.since();
        assert!(
            sent.iter().any(|(_, stamp, read)| stamp.boot == rig.boot
                && *read == Read::EStop(EStop { press: 77 })),
            "{sent:?}"
        );
    }
    rig.answer(Answer::Refused(Refusal::Role));
    let refused = EStopState::Refused(Refusal::Role);
    assert_eq!(rig.state().estop, refused);
}

#[test]
fn requests_are_sequential_and_time_out() {
    let mut rig = Rig::new();
    rig.ask(LeaseRequest::Request);
    rig.teleop_client.submit(Intent::Reset(3), at(rig.ms));
    rig.run(100);
    assert_eq!(rig.since().len(), 1);
    rig.answer(Answer::Refused(Refusal::Busy));
    rig.run(100);
    assert_eq!(rig.since()[0].2, Read::Other(OperatorTopic::Reset));
    rig.run(5000);
    let notifications = rig.notes();
    let busy = Answer::Refused(Refusal::Busy);
    let expected = [
        TeleopNotification::Answered(RequestKind::Lease(LeaseRequest::Request), busy),
        TeleopNotification::RequestTimedOut(RequestKind::Reset(3)),
    ];
    assert_eq!(notifications, expected);
    rig.speaks = false;
    rig.run(2000);
    rig.ask(LeaseRequest::Request);
    rig.run(100);
    let notifications = rig.notes();
    let not_sent = TeleopNotification::NotSent(
        RequestKind::Lease(LeaseRequest::Request),
        NotSentReason::NoToken,
    );
    assert_eq!(notifications[0], not_sent);
    assert_eq!(rig.since(), []);
}

#[test]
fn waiting_console_drives_by_status() {
    let mut rig = Rig::new();
    rig.status(|status| status.lease.holder = Some("bert".parse().unwrap()));
    rig.ask(LeaseRequest::Request);
    rig.run(20);
    rig.answer(Answer::Waiting);
    rig.run(100);
    rig.status(|status| {
        status.lease.epoch = 5;
    });
    rig.since();
    rig.run(100);
    let (_, stamp, _) = rig.since()[0];
    assert_eq!(stamp.epoch, 5);
}

#[test]
fn closing_console_sends_zero_and_releases() {
    let mut rig = Rig::held();
    rig.turn(&[W]);
    let messages = rig.teleop_client.shutdown_messages();
    let topics: Vec<_> = messages.iter().map(|message| message.topic).collect();
    assert_eq!(topics, [OperatorTopic::Drive, OperatorTopic::Lease]);
    let drive: Drive = Envelope::parse(&messages[0].payload)
        .unwrap()
        .unverified_command()
        .unwrap();
    assert!(drive.is_neutral());
}

#[test]
fn closing_console_withdraws_its_request() {
    let said = |rig: &mut Rig| -> Vec<LeaseRequest> {
        let messages = rig.teleop_client.shutdown_messages();
        let requests = messages.iter().map(|message| {
            assert_eq!(message.topic, OperatorTopic::Lease);
            let envelope = Envelope::parse(&message.payload).unwrap();
            envelope.unverified_command().unwrap()
        });
        requests.collect()
    };
    let mut rig = Rig::new();
    assert_eq!(said(&mut rig), [], "it wanted nothing");
    rig.ask(LeaseRequest::Request);
    rig.run(20);
    assert_eq!(said(&mut rig), [LeaseRequest::Release], "asked for");
    let mut rig = Rig::new();
    rig.status(|status| status.lease.holder = Some("bert".parse().unwrap()));
    rig.ask(LeaseRequest::Request);
    rig.run(20);
    rig.answer(Answer::Waiting);
    rig.run(20);
    assert_eq!(said(&mut rig), [LeaseRequest::Release], "waited for");
    let mut rig = Rig::new();
    rig.teleop_client.submit(Intent::Reset(3), at(rig.ms));
    rig.run(20);
    assert_eq!(said(&mut rig), [], "something else was asked");
}

#[test]
fn notice_is_shown_for_a_while() {
    let mut rig = Rig::held();
    assert_eq!(rig.state().notice, None);
    rig.teleop_client.submit(Intent::Reset(3), at(rig.ms));
    rig.run(20);
    let refused = Answer::Refused(Refusal::NoEStop);
    rig.answer(refused);
    let notice = TeleopNotification::Answered(RequestKind::Reset(3), refused);
    assert_eq!(rig.state().notice, Some(notice));
    rig.run(10_000);
    assert_eq!(rig.state().notice, None);
    // A release needs no notice.
    rig.ask(LeaseRequest::Release);
    assert_eq!(rig.state().notice, None);
    let mut rig = Rig::held();
    rig.status(|status| status.lease.holder = None);
    assert_eq!(rig.state().notice, Some(TeleopNotification::LeaseLost));
}

#[test]
fn reset_explains_the_end_of_the_lease() {
    let stopped = |status: &mut TeleopStatus| {
        status.state = TeleopState::EStop;
        status.estop = Some(STORED_ESTOP);
    };
    let idle = |status: &mut TeleopStatus| {
        status.state = TeleopState::Idle;
        status.lease.holder = None;
    };
    for answer_is_first in [true, false] {
        let mut rig = Rig::held();
        rig.status(stopped);
        rig.teleop_client.submit(Intent::Reset(3), at(rig.ms));
        rig.run(20);
        if answer_is_first {
            rig.answer(Answer::Done);
            rig.status(idle);
        } else {
            rig.status(idle);
            rig.answer(Answer::Done);
        }
        let state = rig.state();
        assert_eq!(state.lease, Lease::None);
        assert_eq!(state.notice, Some(TeleopNotification::LeaseEndedByReset));
        rig.ask(LeaseRequest::Request);
        rig.run(20);
        rig.answer(Answer::Granted(5));
        assert_eq!(rig.state().notice, None);
    }
    // Another operator took over: a loss with a notice.
    let mut rig = Rig::held();
    rig.status(stopped);
    rig.status(|status| {
        status.lease.epoch = 5;
        status.lease.holder = Some("bert".parse().unwrap());
    });
    assert_eq!(rig.state().notice, Some(TeleopNotification::LeaseLost));
}

#[test]
fn last_grant_is_kept_within_one_run() {
    let last = |rig: &Rig| rig.state().last_grant;
    assert_eq!(last(&Rig::new()), None);
    let mut rig = Rig::held();
    rig.ask(LeaseRequest::Release);
    // An older status.
    rig.status(|_| {});
    assert_eq!(rig.state().lease, Lease::None);
    assert_eq!(last(&rig), Some(4));
    rig.boot = BootId([9; 16]);
    rig.status(|_| {});
    assert_eq!(last(&rig), None);
}

/// The owner of the loop provides clock, network and window, so scripts and window produce the same commands.
#[test]
fn teleop_client_and_input_are_pure() {
    let impure = [
        "clock::now",
        "std::thread",
        "std::fs",
        "mpsc",
        "zenoh",
        "egui",
        "winit",
        "crate::link",
    ];
    for (folder, least) in [("teleop_client", 6), ("teleop_input", 1)] {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("src")
            .join(folder);
        let files = std::fs::read_dir(path)
            .unwrap()
            .map(|file| file.unwrap().path());
        let mut seen = 0;
        for file in files.filter(|file| file.is_file() && !file.ends_with("tests.rs")) {
            seen += 1;
            for line in std::fs::read_to_string(&file).unwrap().lines() {
                let code = line.split("//").next().unwrap_or_default();
                let word = impure.into_iter().find(|word| code.contains(word));
                assert_eq!(word, None, "{}: {line}", file.display());
            }
        }
        assert!(seen >= least, "{folder} has moved");
    }
}

#[test]
fn estop_for_undrivable_robot_is_not_repeated() {
    let mut rig = Rig::new();
    rig.teleop_client.submit(Intent::EStop, at(rig.ms));
    rig.run(300);
    assert!(
        !rig.since().is_empty(),
        "repeated while the state is unknown"
    );
    let message = TeleopMessage::Status {
        boot: rig.boot,
        teleop: None,
    };
    rig.teleop_client.receive(message, at(rig.ms));
    rig.since();
    rig.run(1_000);
    assert_eq!(rig.since(), []);
    let state = rig.state();
    assert_eq!(state.estop, EStopState::Quiet);
    assert_eq!(state.notice, Some(TeleopNotification::NotDrivable));
}
