//! How an operator comes to drive: asks, takes the lease, lets go, presses.

use super::received::lock;
use super::{Input, NEUTRAL, Operator, PERIOD, PRESSED_AGAIN, REPLY_TIMEOUT, TIMEOUT};
use protocol::keys::operator_key;
use protocol::message::{Answer, LeaseRequest, Refusal, TeleopState};
use protocol::signed::Command;
use protocol::wire;
use robot_edge::clock;
use std::sync::Arc;
use std::thread::sleep;
use std::time::Duration;
use zenoh::Wait as _;

impl Operator {
    /// Asks until there is an answer, with a new token and `seq` each time.
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

    /// Asks for the lease until it is granted, or for `TIMEOUT`.
    pub fn take_lease(&mut self) {
        let started = clock::now();
        loop {
            match self.ask(&LeaseRequest::Request) {
                Answer::Granted(epoch) => {
                    self.epoch = epoch;
                    return;
                }
                // The link has just come back: the newest token has not, or what was held back takes the rate.
                Answer::Refused(Refusal::TooOld | Refusal::UnknownToken | Refusal::TooMany)
                    if clock::elapsed(started) < TIMEOUT =>
                {
                    sleep(PERIOD);
                }
                // It has to stand first. What is granted and not heard of in time has to be asked for again.
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

    /// Takes the lease where it is not held, lets go of everything, presses, and waits until it drives.
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
                "it does not set off: {teleop:?}"
            );
        }
    }
}
