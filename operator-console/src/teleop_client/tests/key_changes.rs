//! Change of keys at a boat before reeds, with the teleop client on one end of a link and the vehicle's rules on the
//! other; and keys that are pressed when the lease ends or is renewed.

use mapping::vehicle::VehicleConfig;
use teleop::{
    Action, ArbiterEvent, ArbiterInput, ArbiterState, CollisionMonitorOutput, LeaseVerb, Mode,
    Rules, SpeedLimits, StoredEStop, TeleopConfig, step,
};

use super::*;

const S: InputEvent = InputEvent::Press(DriveKey::S);
const NO_S: InputEvent = InputEvent::Release(DriveKey::S);
/// Speed of the boat with motors at zero, m/s: it coasts and drifts.
const COASTS_MPS: f32 = 0.2;
const ROUND_MS: u64 = 20;
const STATUS_MS: u64 = 500;
const BOOT_ID: u128 = 7;
const ANNA: teleop::OperatorId = teleop::OperatorId(0);

enum Published {
    Pose(AgeToken),
    Status(Box<TeleopStatus>),
}

struct Shore {
    teleop_client: TeleopClient,
    rules: Rules,
    boat: ArbiterState,
    monitor: CollisionMonitorOutput,
    way_ms: u64,
    ms: u64,
    newest: Option<LatestPose>,
    to_boat: VecDeque<(u64, ArbiterInput)>,
    to_console: VecDeque<(u64, Published)>,
    published: Option<TeleopState>,
    last_stop: Option<StopReason>,
    outputs: Vec<(u64, f64)>,
    /// Whether a command other than neutral was sent since.
    has_asked: bool,
}

impl Shore {
    /// Anna has the lease, and has pressed nothing for long enough.
    fn held(way_ms: u64, monitor: CollisionMonitorOutput) -> Self {
        let identity = Identity::without_keys("anna".parse().unwrap());
        let mut teleop_client = TeleopClient::new("scout".parse().unwrap(), identity, 77);
        teleop_client.set_robot_info(&Info {
            stop_decel_mps2: 0.5,
            ..able([1.0, 1.0])
        });
        teleop_client.apply(InputEvent::Focus(true));
        teleop_client.apply(InputEvent::Step(SpeedStep::new(5).unwrap()));
        let teleop = TeleopConfig {
            is_boat: true,
            max_latency_travel_m: 0.6,
            stop_decel_mps2: 0.5,
            ..TeleopConfig::default()
        };
        let mut shore = Self {
            teleop_client,
            rules: Rules::new(
                &teleop,
                &VehicleConfig::default(),
                &teleop::LocomotionConfig::default(),
            )
            .unwrap(),
            boat: ArbiterState::new(BOOT_ID),
            monitor,
            way_ms,
            ms: 1000,
            newest: None,
            to_boat: VecDeque::new(),
            to_console: VecDeque::new(),
            published: None,
            last_stop: None,
            outputs: Vec::new(),
            has_asked: false,
        };
        let stored = StoredEStop::None;
        let has_passed = true;
        shore.happen(ArbiterInput::SelfTest { has_passed, stored });
        shore.run(300);
        shore
            .teleop_client
            .submit(Intent::Lease(LeaseRequest::Request), at(shore.ms));
        shore.run(700);
        shore
    }

    fn driven(way_ms: u64, monitor: CollisionMonitorOutput) -> Self {
        let mut shore = Self::held(way_ms, monitor);
        shore.turn(&[W]);
        shore.run(3000);
        assert_eq!(shore.boat.mode(), Mode::Driving);
        shore.forget();
        shore
    }

    fn forget(&mut self) {
        self.outputs.clear();
        self.has_asked = false;
    }

    fn happen(&mut self, event: ArbiterInput) {
        let (boat, actions) = step(&self.rules, self.boat, at(self.ms), event);
        self.boat = boat;
        if event == ArbiterInput::Tick {
            self.outputs.push((self.ms, actions.output.linear_mps));
        }
        let arrives = self.ms + self.way_ms;
        for action in actions.iter() {
            match action {
                Action::PublishToken(token) => {
                    let (n, nonce) = (token.n, token.nonce);
                    let pose = Published::Pose(AgeToken { n, nonce });
                    self.to_console.push_back((arrives, pose));
                }
                Action::Notify(ArbiterEvent::ModeChanged {
                    to: Mode::Stopping { reason, .. },
                    ..
                }) => self.last_stop = Some(reason),
                Action::Answer { .. }
                | Action::AcknowledgeEStop(_)
                | Action::StoreEStop(_)
                | Action::ClearEStop(_)
                | Action::Notify(_) => {}
            }
        }
    }

    fn status(&self) -> TeleopStatus {
        let report = self.boat.report(&self.rules, at(self.ms));
        TeleopStatus {
            state: match report.mode {
                Mode::SafeBoot => TeleopState::SafeBoot,
                Mode::Idle => TeleopState::Idle,
                Mode::Held => TeleopState::Held,
                Mode::Driving => TeleopState::Driving,
                Mode::Stopping { reason, .. } => TeleopState::Stopping(reason),
                Mode::EStop | Mode::Fault(_) => panic!("no emergency stop"),
            },
            last_stop: self.last_stop,
            lease: LeaseStatus {
                epoch: report.lease.epoch,
                holder: report.lease.holder.map(|_| "anna".parse().unwrap()),
                ..LeaseStatus::default()
            },
            arming: report.arming,
            peak_age_ms: report.peak_age.map(|age| age.as_millis() as u32),
            applied: Velocity {
                linear_mps: report.applied.linear_mps as f32,
                lateral_mps: 0.0,
                angular_radps: report.applied.angular_radps as f32,
            },
            ..idle_teleop_status()
        }
    }

    /// A round of the vehicle's loop. It publishes a status on a change of state and twice a second.
    fn round(&mut self) {
        self.happen(ArbiterInput::Token { nonce: self.ms });
        self.happen(ArbiterInput::CollisionMonitor(self.monitor));
        self.happen(ArbiterInput::Tick);
        let status = self.status();
        if self.published != Some(status.state) || self.ms.is_multiple_of(STATUS_MS) {
            self.published = Some(status.state);
            let arrives = self.ms + self.way_ms;
            let published = Published::Status(Box::new(status));
            self.to_console.push_back((arrives, published));
        }
    }

    fn turn(&mut self, events: &[InputEvent]) {
        let now = at(self.ms);
        self.teleop_client.begin(self.newest, now);
        for event in events {
            self.teleop_client.apply(*event);
        }
        for message in self.teleop_client.end(now) {
            let envelope = Envelope::parse(&message.payload).unwrap();
            let stamp = envelope.unverified_header();
            let token = teleop::AgeToken {
                boot_id: BOOT_ID,
                n: stamp.token.n,
                nonce: stamp.token.nonce,
            };
            if let Some(request) = message.request {
                self.grant(request, token);
                continue;
            }
            let drive: Drive = envelope.unverified_command().unwrap();
            self.has_asked |= !drive.is_neutral();
            let command = teleop::DriveCommand {
                operator: ANNA,
                epoch: stamp.epoch,
                seq: stamp.seq,
                token,
                requested: teleop::Velocity {
                    linear_mps: drive.linear_mps.into(),
                    lateral_mps: 0.0,
                    angular_radps: drive.angular_radps.into(),
                },
                estop: false,
                docking: drive.docking,
                goal: drive.goal,
            };
            let role = teleop::Role::Operator;
            let arrives = self.ms + self.way_ms;
            let event = ArbiterInput::Command { role, command };
            self.to_boat.push_back((arrives, event));
        }
    }

    /// Grants the lease at once.
    fn grant(&mut self, request: RequestNumber, token: teleop::AgeToken) {
        self.happen(ArbiterInput::Lease {
            caller: teleop::Caller {
                operator: ANNA,
                role: teleop::Role::Operator,
                request: teleop::RequestId(request.0),
            },
            token,
            verb: LeaseVerb::Request,
        });
        let message = TeleopMessage::Answer {
            request,
            boot: BOOT,
            answer: Answer::Granted(1),
        };
        self.teleop_client.receive(message, at(self.ms));
    }

    fn run(&mut self, ms: u64) {
        for _ in 0..ms {
            self.ms += 1;
            let now = self.ms;
            while let Some((_, event)) = self.to_boat.pop_front_if(|(ms, _)| *ms <= now) {
                self.happen(event);
            }
            if now.is_multiple_of(ROUND_MS) {
                self.round();
            }
            while let Some((_, published)) = self.to_console.pop_front_if(|(ms, _)| *ms <= now) {
                self.receive(published);
            }
            let due = self.teleop_client.due(at(now));
            if due.is_none_or(|due| due <= at(now)) {
                self.turn(&[]);
            }
        }
    }

    fn receive(&mut self, published: Published) {
        let now = at(self.ms);
        match published {
            Published::Pose(token) => {
                self.newest = Some(LatestPose {
                    boot: BOOT,
                    token: Some(token),
                    velocity: [COASTS_MPS, 0.0, 0.0],
                    at: now,
                });
            }
            Published::Status(status) => {
                let (boot, teleop) = (BOOT, Some(status));
                self.teleop_client
                    .receive(TeleopMessage::Status { boot, teleop }, now);
            }
        }
    }

    fn backed_off(&self) -> Option<u64> {
        let first = self.outputs.iter().find(|(_, mps)| *mps < 0.0);
        first.map(|(ms, _)| *ms)
    }

    fn stands(&self) -> bool {
        self.outputs.iter().all(|(_, mps)| *mps == 0.0)
    }
}

/// Reeds ahead: speed limit forward, m/s.
fn reeds(forward_mps: f64) -> CollisionMonitorOutput {
    CollisionMonitorOutput::Limits(SpeedLimits {
        forward_mps,
        reverse_mps: 1.0,
        left_mps: 0.0,
        right_mps: 0.0,
        left_radps: 1.0,
        right_radps: 1.0,
        in_unknown_space: false,
        overspeed: teleop::Velocity::ZERO,
    })
}

#[test]
fn reversing_from_obstacle_needs_no_full_release() {
    for (way_ms, forward_mps) in [(2, 0.0), (2, 0.1), (75, 0.0), (75, 0.1)] {
        for gap_ms in [1, 20, 50, 100, 150, 190, 230, 300] {
            let mut shore = Shore::driven(way_ms, reeds(forward_mps));
            shore.turn(&[NO_W]);
            shore.run(gap_ms);
            let pressed = shore.ms;
            shore.turn(&[S]);
            shore.run(1000);
            let case = format!("{way_ms} ms away, {forward_mps} m/s ahead, {gap_ms} ms between");
            let backed_off = shore.backed_off().expect(&case);
            let later = backed_off - pressed;
            assert!(later <= 400 + way_ms, "{case}: {later} ms later");
        }
    }
}

#[test]
fn keys_that_overlap_back_off_too() {
    let mut shore = Shore::driven(2, reeds(0.0));
    shore.turn(&[S]);
    shore.run(60);
    shore.turn(&[NO_W]);
    shore.run(400);
    assert!(shore.backed_off().is_some());
}

#[test]
fn key_released_while_delayed_moves_nothing() {
    let mut shore = Shore::driven(2, reeds(0.0));
    shore.turn(&[NO_W]);
    shore.forget();
    shore.run(50);
    shore.turn(&[S]);
    shore.run(100);
    shore.turn(&[NO_S]);
    shore.run(1000);
    assert!(shore.stands() && !shore.has_asked);
}

#[test]
fn key_held_through_involuntary_stop_moves_nothing() {
    let mut shore = Shore::driven(2, CollisionMonitorOutput::Off);
    shore.monitor = CollisionMonitorOutput::Stale;
    shore.run(2500);
    assert_eq!(shore.last_stop, Some(StopReason::CollisionMonitorStale));
    shore.monitor = reeds(1.0);
    shore.forget();
    shore.run(2000);
    // A key pressed beside it does not drive either.
    shore.turn(&[S]);
    shore.run(1000);
    assert!(shore.stands() && !shore.has_asked);
    shore.turn(&[NO_W, NO_S]);
    shore.run(50);
    shore.turn(&[S]);
    shore.run(400);
    assert!(shore.backed_off().is_some());
}

#[test]
fn short_release_in_free_water_is_no_stop() {
    for way_ms in [2, 75] {
        let mut shore = Shore::driven(way_ms, CollisionMonitorOutput::Off);
        shore.turn(&[NO_W]);
        shore.run(60);
        shore.turn(&[W]);
        shore.run(1000);
        let slowest = shore
            .outputs
            .iter()
            .fold(1.0, |least, (_, mps)| f64::min(least, *mps));
        assert!(slowest > 0.9, "{way_ms} ms away: {slowest} m/s");
    }
}

/// A key that was pressed after the grant drives.
fn driving() -> Rig {
    let mut rig = Rig::held();
    rig.turn(&[W]);
    rig.run(100);
    assert!(rig.moves());
    rig.notes();
    rig
}

#[test]
fn lease_end_with_pressed_key_has_one_notice() {
    type End = fn(&mut Rig);
    let ends: [(End, TeleopNotification); 3] = [
        (
            |rig| rig.ask(LeaseRequest::Release),
            TeleopNotification::LeaseReleased,
        ),
        (
            |rig| rig.status(|status| status.lease.holder = None),
            TeleopNotification::LeaseLost,
        ),
        (
            |rig| rig.status(|status| status.lease.epoch = 5),
            TeleopNotification::LeaseLost,
        ),
    ];
    for (end, note) in ends {
        let mut rig = driving();
        end(&mut rig);
        rig.run(100);
        assert_eq!(rig.notes(), [note]);
        assert!(!rig.moves());
    }
}

#[test]
fn key_pressed_at_first_grant_is_locked_by_lease() {
    for waits in [false, true] {
        let mut rig = Rig::new();
        rig.ask(LeaseRequest::Request);
        rig.run(20);
        if waits {
            rig.answer(Answer::Waiting);
            rig.run(20);
        }
        rig.notes();
        // It comes before the queue with this event is drained.
        rig.teleop_client.apply(W);
        if waits {
            rig.status(|status| status.lease.epoch = 5);
        } else {
            rig.answer(Answer::Granted(5));
        }
        let lost = TeleopNotification::InputLocked(InputLockReason::Lease);
        assert!(rig.notes().contains(&lost), "{waits}");
    }
}

#[test]
fn key_of_renewed_lease_is_locked_by_renewal() {
    let mut rig = driving();
    rig.ask(LeaseRequest::Request);
    rig.run(20);
    rig.answer(Answer::Granted(5));
    let granted = TeleopNotification::Answered(
        RequestKind::Lease(LeaseRequest::Request),
        Answer::Granted(5),
    );
    let lost = TeleopNotification::InputLocked(InputLockReason::LeaseRenewed);
    assert_eq!(
        rig.notes(),
        [granted, lost, TeleopNotification::LeaseGained(5)]
    );
    rig.run(500);
    assert_eq!(rig.state().ignored, Some(InputLockReason::LeaseRenewed));
}
