//! The teleop client with its link, and the handle by which the window's input loop and the app share it.
//!
//! Input loop and app run on one thread in turns, so neither waits for the other.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::time::Duration;

use measurement::time::Monotonic;
use network::random_id;
use protocol::keys::RobotId;
use protocol::message::Info;

use crate::identity::Identity;
use crate::link::DrivingLink;
use crate::teleop_client::{Intent, TeleopClient, TeleopClientState, TeleopNotification};
use crate::teleop_input::{InputEvent, PadReading};

/// How long a window that closes waits until its last messages are sent.
const SHUTDOWN_FLUSH: Duration = Duration::from_millis(150);

/// One operator, one robot, and the link between them. The loops of the window and of scripts run it.
pub struct TeleopSession {
    pub client: TeleopClient,
    link: DrivingLink,
}

impl TeleopSession {
    pub fn new(robot: RobotId, identity: Identity, link: DrivingLink) -> anyhow::Result<Self> {
        let random = u128::from_le_bytes(random_id()?) as u64;
        Ok(Self {
            client: TeleopClient::new(robot, identity, random),
            link,
        })
    }

    /// Begins an iteration, before the queue of events is drained.
    pub fn begin(&mut self, now: Monotonic) {
        self.client.begin(self.link.newest(), now);
    }

    pub fn end(&mut self, now: Monotonic) {
        for message in self.link.messages() {
            self.client.receive(message, now);
        }
        for message in self.client.end(now) {
            self.link.send(message);
        }
    }

    /// Sends zero velocity and releases the lease. The robot stops without these messages too, but later.
    pub fn shut_down(&mut self) {
        let messages = self.client.shutdown_messages();
        if messages.is_empty() {
            return;
        }
        for message in messages {
            self.link.send(message);
        }
        self.link.flush(SHUTDOWN_FLUSH);
    }
}

impl Drop for TeleopSession {
    fn drop(&mut self) {
        self.shut_down();
    }
}

/// The teleop session of the robot that is shown, and the state of the window's input devices.
#[derive(Default)]
pub struct TeleopHandle(RefCell<State>);

#[derive(Default)]
struct State {
    session: Option<TeleopSession>,
    has_focus: bool,
    is_hidden: bool,
    is_typing: bool,
    /// The last reading of the gamepad, which reports changes only.
    pad: Option<PadReading>,
}

impl State {
    /// The events that bring a new session up to date. The gamepad comes first: a button pressed before does not count.
    fn initial_events(&self) -> Vec<InputEvent> {
        let attention = [
            InputEvent::Focus(self.has_focus),
            InputEvent::Visible(!self.is_hidden),
            InputEvent::Typing(self.is_typing),
        ];
        let pad = self.pad.map(InputEvent::Pad);
        pad.into_iter().chain(attention).collect()
    }
}

impl TeleopHandle {
    /// Replaces the session. The old one releases its robot.
    pub fn set_session(&self, session: Option<TeleopSession>) {
        let mut state = self.0.borrow_mut();
        state.session = session;
        let events = state.initial_events();
        if let Some(session) = &mut state.session {
            for event in events {
                session.client.apply(event);
            }
        }
    }

    /// Begins an iteration of the loop, before its queue of events is drained.
    pub fn begin(&self, now: Monotonic) {
        self.with(|session| session.begin(now));
    }

    pub fn apply(&self, event: InputEvent) {
        let mut state = self.0.borrow_mut();
        match event {
            InputEvent::Focus(has_focus) => state.has_focus = has_focus,
            InputEvent::Visible(is_visible) => state.is_hidden = !is_visible,
            InputEvent::Typing(is_typing) if is_typing == state.is_typing => return,
            InputEvent::Typing(is_typing) => state.is_typing = is_typing,
            InputEvent::Pad(reading) => state.pad = Some(reading),
            InputEvent::PadGone => state.pad = None,
            _ => {}
        }
        if let Some(session) = &mut state.session {
            session.client.apply(event);
        }
    }

    /// Ends an iteration of the loop and returns when the next one is due.
    pub fn end(&self, now: Monotonic) -> Option<Monotonic> {
        self.with(|session| {
            session.end(now);
            session.client.due(now)
        })
        .flatten()
    }

    pub fn submit(&self, intent: Intent, now: Monotonic) {
        self.with(|session| session.client.submit(intent, now));
    }

    pub fn set_robot_info(&self, info: &Info) {
        self.with(|session| session.client.set_robot_info(info));
    }

    pub fn state(&self, now: Monotonic) -> Option<TeleopClientState> {
        self.with(|session| session.client.state(now))
    }

    pub fn take_notifications(&self) -> VecDeque<TeleopNotification> {
        let notifications = self.with(|session| session.client.take_notifications());
        notifications.unwrap_or_default()
    }

    pub fn has_session(&self) -> bool {
        self.0.borrow().session.is_some()
    }

    pub fn is_driving(&self) -> bool {
        let state = self.0.borrow();
        let session = state.session.as_ref();
        session.is_some_and(|session| session.client.is_driving())
    }

    pub fn is_typing(&self) -> bool {
        self.0.borrow().is_typing
    }

    pub fn shut_down(&self) {
        self.with(TeleopSession::shut_down);
    }

    fn with<T>(&self, work: impl FnOnce(&mut TeleopSession) -> T) -> Option<T> {
        self.0.borrow_mut().session.as_mut().map(work)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::teleop_input::{DriveInput, TeleopInput};

    #[test]
    fn deadman_held_while_robot_changes_moves_nothing() {
        let pad = |is_deadman_held, forward| {
            InputEvent::Pad(PadReading {
                sideways: 0.0,
                is_deadman_held,
                forward,
                left: 0.0,
            })
        };
        let teleop_handle = TeleopHandle::default();
        teleop_handle.apply(InputEvent::Focus(true));
        teleop_handle.apply(pad(true, 0.0));
        let mut input = TeleopInput::default();
        for event in teleop_handle.0.borrow().initial_events() {
            input.apply(event);
        }
        input.apply(pad(true, 0.9));
        assert_eq!(input.drive_input(), DriveInput::NEUTRAL);
        input.apply(pad(false, 0.9));
        input.apply(pad(true, 0.9));
        assert!(input.drive_input().forward > 0.0, "pressed again");
    }
}
