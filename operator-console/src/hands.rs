//! What the window's loop and the app in it share: the helm of the robot that is shown, and who has the keyboard.
//!
//! Both run on one thread and take turns, so that there is nothing to wait for.

use std::cell::RefCell;

use protocol::message::Info;
use robot_edge::clock::Monotonic;

use crate::cockpit::Cockpit;
use crate::helm::{HelmSight, Intent, Note};
use crate::teleop_input::{InputEvent, PadReading};

/// The hands of the operator on a window.
#[derive(Default)]
pub struct Hands(RefCell<State>);

#[derive(Default)]
struct State {
    cockpit: Option<Cockpit>,
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

impl Hands {
    /// From now on they drive this, and what they drove before is left.
    pub fn take(&self, cockpit: Option<Cockpit>) {
        let mut state = self.0.borrow_mut();
        state.cockpit = cockpit;
        let events = state.as_they_are();
        if let Some(cockpit) = &mut state.cockpit {
            for event in events {
                cockpit.apply(event);
            }
        }
    }

    /// An iteration of the loop begins: nothing was taken out of its queue yet.
    pub fn begin(&self, now: Monotonic) {
        self.with(|cockpit| cockpit.begin(now));
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
        if let Some(cockpit) = &mut state.cockpit {
            cockpit.apply(event);
        }
    }

    /// The queue is drained; when the next iteration is due.
    pub fn end(&self, now: Monotonic) -> Option<Monotonic> {
        self.with(|cockpit| {
            cockpit.end(now);
            cockpit.due(now)
        })
        .flatten()
    }

    /// What the operator wants besides moving.
    pub fn want(&self, intent: Intent, now: Monotonic) {
        self.with(|cockpit| cockpit.want(intent, now));
    }

    /// What the robot can do.
    pub fn hear_of(&self, info: &Info) {
        self.with(|cockpit| cockpit.hear_of(info));
    }

    /// What the operator is to see; `None` where there is nothing to drive.
    pub fn sight(&self, now: Monotonic) -> Option<HelmSight> {
        self.with(|cockpit| cockpit.sight(now))
    }

    /// What happened at the helm since the last call, oldest first.
    pub fn take_notes(&self) -> Vec<Note> {
        let notes = self.with(|cockpit| cockpit.take_notes().map(|(_, note)| note).collect());
        notes.unwrap_or_default()
    }

    /// Whether there is something to drive.
    pub fn is_taken(&self) -> bool {
        self.0.borrow().cockpit.is_some()
    }

    /// Whether this console drives.
    pub fn is_driving(&self) -> bool {
        let state = self.0.borrow();
        state.cockpit.as_ref().is_some_and(Cockpit::is_driving)
    }

    /// Whether keys are text at the moment.
    pub fn is_typing(&self) -> bool {
        self.0.borrow().is_typing
    }

    /// The window goes: zero, and the lease back.
    pub fn leave(&self) {
        self.with(Cockpit::leave);
    }

    fn with<T>(&self, work: impl FnOnce(&mut Cockpit) -> T) -> Option<T> {
        self.0.borrow_mut().cockpit.as_mut().map(work)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::teleop_input::{TeleopInput, Wish};

    #[test]
    fn a_dead_man_that_is_held_while_the_robot_changes_moves_nothing() {
        let pad = |is_deadman_held, forward| {
            InputEvent::Pad(PadReading {
                is_deadman_held,
                forward,
                left: 0.0,
            })
        };
        let hands = Hands::default();
        hands.apply(InputEvent::Focus(true));
        hands.apply(pad(true, 0.0));
        let mut input = TeleopInput::default();
        for event in hands.0.borrow().as_they_are() {
            input.apply(event);
        }
        input.apply(pad(true, 0.9));
        assert_eq!(input.wish(), Wish::NEUTRAL);
        input.apply(pad(false, 0.9));
        input.apply(pad(true, 0.9));
        assert!(input.wish().forward > 0.0, "pressed anew");
    }
}
