//! What the window's loop and the app in it share: the helm of the robot that is shown, and who has the keyboard.
//!
//! Both run on one thread and take turns, so that there is nothing to wait for.

use std::cell::RefCell;

use measurement::time::Monotonic;
use protocol::message::Info;

use crate::teleop_client::{Intent, TeleopClientState, TeleopNotification};
use crate::teleop_input::{InputEvent, PadReading};
use crate::teleop_session::TeleopSession;

/// The hands of the operator on a window.
#[derive(Default)]
pub struct TeleopHandle(RefCell<State>);

#[derive(Default)]
struct State {
    teleop_session: Option<TeleopSession>,
    has_focus: bool,
    is_hidden: bool,
    is_typing: bool,
    /// How the gamepad is held, where there is one: it tells changes only.
    pad: Option<PadReading>,
}

impl State {
    /// What a helm has to know that takes over. What is held comes first: nothing that went down before counts.
    fn as_they_are(&self) -> Vec<InputEvent> {
        let attention = [
            InputEvent::Focus(self.has_focus),
            InputEvent::Visible(!self.is_hidden),
            InputEvent::Typing(self.is_typing),
        ];
        let held = self.pad.map(InputEvent::Pad);
        held.into_iter().chain(attention).collect()
    }
}

impl TeleopHandle {
    /// From now on they drive this, and what they drove before is left.
    pub fn take(&self, teleop_session: Option<TeleopSession>) {
        let mut state = self.0.borrow_mut();
        state.teleop_session = teleop_session;
        let events = state.as_they_are();
        if let Some(teleop_session) = &mut state.teleop_session {
            for event in events {
                teleop_session.apply(event);
            }
        }
    }

    /// An iteration of the loop begins: nothing was taken out of its queue yet.
    pub fn begin(&self, now: Monotonic) {
        self.with(|teleop_session| teleop_session.begin(now));
    }

    /// Something was in the queue.
    pub fn apply(&self, event: InputEvent) {
        let mut state = self.0.borrow_mut();
        match event {
            InputEvent::Focus(has_focus) => state.has_focus = has_focus,
            InputEvent::Visible(is_visible) => state.is_hidden = !is_visible,
            InputEvent::Typing(is_typing) if is_typing == state.is_typing => return,
            InputEvent::Typing(is_typing) => state.is_typing = is_typing,
            InputEvent::Pad(reading) => state.pad = Some(reading),
            InputEvent::PadGone => state.pad = None,
            InputEvent::Press(_)
            | InputEvent::StillDown(_)
            | InputEvent::Release(_)
            | InputEvent::EStop
            | InputEvent::Step(_) => {}
        }
        if let Some(teleop_session) = &mut state.teleop_session {
            teleop_session.apply(event);
        }
    }

    /// The queue is drained; when the next iteration is due.
    pub fn end(&self, now: Monotonic) -> Option<Monotonic> {
        self.with(|teleop_session| {
            teleop_session.end(now);
            teleop_session.due(now)
        })
        .flatten()
    }

    /// What the operator wants besides moving.
    pub fn submit(&self, intent: Intent, now: Monotonic) {
        self.with(|teleop_session| teleop_session.submit(intent, now));
    }

    /// What the robot can do.
    pub fn set_robot_info(&self, info: &Info) {
        self.with(|teleop_session| teleop_session.set_robot_info(info));
    }

    /// What the operator is to see; `None` where there is nothing to drive.
    pub fn state(&self, now: Monotonic) -> Option<TeleopClientState> {
        self.with(|teleop_session| teleop_session.state(now))
    }

    /// What happened at the helm since the last call, oldest first.
    pub fn take_notifications(&self) -> Vec<TeleopNotification> {
        let notifications = self.with(|teleop_session| {
            teleop_session
                .take_notifications()
                .map(|(_, notification)| notification)
                .collect()
        });
        notifications.unwrap_or_default()
    }

    /// Whether there is something to drive.
    pub fn is_taken(&self) -> bool {
        self.0.borrow().teleop_session.is_some()
    }

    /// Whether this console drives.
    pub fn is_driving(&self) -> bool {
        let state = self.0.borrow();
        state
            .teleop_session
            .as_ref()
            .is_some_and(TeleopSession::is_driving)
    }

    /// Whether keys are text at the moment.
    pub fn is_typing(&self) -> bool {
        self.0.borrow().is_typing
    }

    /// The window goes: zero, and the lease back.
    pub fn shut_down(&self) {
        self.with(TeleopSession::shut_down);
    }

    fn with<T>(&self, work: impl FnOnce(&mut TeleopSession) -> T) -> Option<T> {
        self.0.borrow_mut().teleop_session.as_mut().map(work)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::teleop_input::{DriveInput, TeleopInput};

    #[test]
    fn a_dead_man_that_is_held_while_the_robot_changes_moves_nothing() {
        let pad = |is_deadman_held, forward| {
            InputEvent::Pad(PadReading {
                is_deadman_held,
                forward,
                left: 0.0,
            })
        };
        let teleop_handle = TeleopHandle::default();
        teleop_handle.apply(InputEvent::Focus(true));
        teleop_handle.apply(pad(true, 0.0));
        let mut input = TeleopInput::default();
        for event in teleop_handle.0.borrow().as_they_are() {
            input.apply(event);
        }
        input.apply(pad(true, 0.9));
        assert_eq!(input.drive_input(), DriveInput::NEUTRAL);
        input.apply(pad(false, 0.9));
        input.apply(pad(true, 0.9));
        assert!(input.drive_input().forward > 0.0, "pressed anew");
    }
}
