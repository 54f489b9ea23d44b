//! What the window's loop and the app in it share: the helm of the robot that is shown, and who has the keyboard.
//!
//! Both run on one thread and take turns, so that there is nothing to wait for.

use std::cell::RefCell;

use protocol::message::Info;
use robot_edge::clock::Monotonic;

use crate::cockpit::Cockpit;
use crate::helm::{HelmSight, Intent};
use crate::teleop_input::InputEvent;

/// The hands of the operator on a window.
#[derive(Default)]
pub struct Hands(RefCell<State>);

#[derive(Default)]
struct State {
    cockpit: Option<Cockpit>,
    has_focus: bool,
    is_hidden: bool,
    is_typing: bool,
}

impl Hands {
    /// From now on they drive this, and what they drove before is left.
    pub fn take(&self, cockpit: Option<Cockpit>) {
        let mut state = self.0.borrow_mut();
        state.cockpit = cockpit;
        let attention = [
            InputEvent::Focus(state.has_focus),
            InputEvent::Visible(!state.is_hidden),
            InputEvent::Typing(state.is_typing),
        ];
        if let Some(cockpit) = &mut state.cockpit {
            for event in attention {
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
            InputEvent::Press(_)
            | InputEvent::StillDown(_)
            | InputEvent::Release(_)
            | InputEvent::EStop
            | InputEvent::Step(_)
            | InputEvent::Pad(_)
            | InputEvent::PadGone => {}
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
        self.with(|cockpit| cockpit.set_limits(info.limits));
    }

    /// What the operator is to see; `None` where there is nothing to drive.
    pub fn sight(&self, now: Monotonic) -> Option<HelmSight> {
        self.with(|cockpit| cockpit.sight(now))
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
