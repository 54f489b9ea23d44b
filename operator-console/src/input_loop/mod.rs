//! The window's event loop, with the helm in it.
//!
//! eframe gives an app its input once a frame, and a frame may take as long as it likes: without a GPU 10 ms and more,
//! behind other windows for ever. So the helm does not live in frames. This loop sees each event before eframe does: an
//! iteration takes the newest token, drains the queue, sends, and then lets eframe paint if it wants to. While the lease
//! is held it wakes 50 times a second by itself, painting or not, and painting gets at most every other moment: where a
//! frame takes 40 ms, the next has to wait for as long. Where painting hangs, the loop hangs and sends nothing.

mod keys;

use std::rc::Rc;
use std::time::Duration;

use eframe::{EframeWinitApplication, UserEvent};
use measurement::time::Monotonic;
use robot_edge::clock;
use winit::application::ApplicationHandler;
use winit::event::{DeviceEvent, DeviceId, ElementState, KeyEvent, StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow};
use winit::keyboard::ModifiersState;
use winit::window::WindowId;

use crate::gamepad::Gamepads;
use crate::teleop_handle::TeleopHandle;
use crate::teleop_input::InputEvent;

use keys::{TeleopKey, teleop_key};

/// An iteration that takes longer is worth a line in the log.
const SLOW: Duration = Duration::from_millis(100);
/// A gamepad has no events in the window's queue: it is looked at this often while one is there.
const GAMEPAD_PERIOD: Duration = Duration::from_millis(20);

/// eframe's loop, and the helm's around it.
pub struct InputLoop<'a> {
    window: EframeWinitApplication<'a>,
    teleop_handle: Rc<TeleopHandle>,
    gamepads: Gamepads,
    modifiers: ModifiersState,
    began: Monotonic,
    /// Whether this iteration has sent already, before it painted.
    is_sent: bool,
    /// A frame that has to wait, and the moment before which none is painted.
    postponed: Option<WindowId>,
    paint_from: Monotonic,
}

impl<'a> InputLoop<'a> {
    /// `teleop_handle` are those that the app in `window` knows too.
    pub fn new(window: EframeWinitApplication<'a>, teleop_handle: Rc<TeleopHandle>) -> Self {
        Self {
            window,
            teleop_handle,
            gamepads: Gamepads::open(),
            modifiers: ModifiersState::empty(),
            began: clock::now(),
            is_sent: false,
            postponed: None,
            paint_from: Monotonic::default(),
        }
    }

    /// Sends what the events so far mean, then paints: nobody's command waits for a frame.
    fn paint(&mut self, event_loop: &ActiveEventLoop, id: WindowId) {
        let now = clock::now();
        if self.teleop_handle.is_driving() && now < self.paint_from {
            self.postponed = Some(id);
            return;
        }
        self.postponed = None;
        self.send(now);
        self.is_sent = true;
        self.window
            .window_event(event_loop, id, WindowEvent::RedrawRequested);
        let painted = clock::now();
        self.paint_from = painted + painted.since(now);
    }

    fn send(&mut self, now: Monotonic) -> Option<Monotonic> {
        for event in self.gamepads.events() {
            self.teleop_handle.apply(event);
        }
        self.teleop_handle.end(now)
    }

    /// Whether the event is the helm's alone.
    fn take(&mut self, event: &WindowEvent) -> bool {
        if let WindowEvent::KeyboardInput {
            event,
            is_synthetic,
            ..
        } = event
        {
            return self.take_key(event, *is_synthetic);
        }
        if let WindowEvent::Focused(has_focus) = event {
            self.teleop_handle.apply(InputEvent::Focus(*has_focus));
        } else if let WindowEvent::Occluded(is_hidden) = event {
            self.teleop_handle.apply(InputEvent::Visible(!is_hidden));
        } else if let WindowEvent::ModifiersChanged(modifiers) = event {
            self.modifiers = modifiers.state();
        } else if matches!(event, WindowEvent::CloseRequested | WindowEvent::Destroyed) {
            self.teleop_handle.shut_down();
        }
        false
    }

    /// Presses may be the helm's alone. Releases are everybody's: who lets go of Ctrl before S, and whose window never
    /// hears of the S, would find the next Ctrl+S taken for one that repeats.
    fn take_key(&self, event: &KeyEvent, is_synthetic: bool) -> bool {
        let Some(key) = teleop_key(event.physical_key) else {
            return false;
        };
        if !self.teleop_handle.is_taken() {
            return false;
        }
        let is_down = event.state == ElementState::Pressed;
        let is_press = is_down && !event.repeat && !is_synthetic;
        let is_plain = !self
            .modifiers
            .intersects(ModifiersState::CONTROL | ModifiersState::ALT | ModifiersState::SUPER);
        match key {
            // While this operator drives, even where text is typed: nothing is more urgent. Else paths have spaces.
            TeleopKey::EStop => {
                let is_text = self.teleop_handle.is_typing() && !self.teleop_handle.is_driving();
                if is_press && !is_text {
                    self.teleop_handle.apply(InputEvent::EStop);
                }
                is_down && !is_text
            }
            TeleopKey::Drive(key) => {
                self.teleop_handle
                    .apply(match (is_down, is_press && is_plain) {
                        (false, _) => InputEvent::Release(key),
                        (true, true) => InputEvent::Press(key),
                        (true, false) => InputEvent::StillDown(key),
                    });
                // Nobody drives with them now: the helm has heard of it all the same, and the map may be moved.
                let is_for_the_map = key.is_arrow() && !self.teleop_handle.is_driving();
                is_down && is_plain && !self.teleop_handle.is_typing() && !is_for_the_map
            }
            TeleopKey::Step(step) => {
                let is_meant = is_plain && !self.teleop_handle.is_typing();
                if is_press && is_meant {
                    self.teleop_handle.apply(InputEvent::Step(step));
                }
                is_down && is_meant
            }
        }
    }
}

impl ApplicationHandler<UserEvent> for InputLoop<'_> {
    fn new_events(&mut self, event_loop: &ActiveEventLoop, cause: StartCause) {
        self.began = clock::now();
        self.teleop_handle.begin(self.began);
        self.window.new_events(event_loop, cause);
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, id: WindowId, event: WindowEvent) {
        if matches!(event, WindowEvent::RedrawRequested) {
            self.paint(event_loop, id);
        } else if !self.take(&event) {
            self.window.window_event(event_loop, id, event);
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        self.window.about_to_wait(event_loop);
        if let Some(id) = self.postponed {
            self.paint(event_loop, id);
        }
        let now = clock::now();
        let took = now.since(self.began);
        if took > SLOW {
            tracing::debug!(ms = took.as_millis(), "a slow iteration");
        }
        if std::mem::take(&mut self.is_sent) {
            // What came while it painted is looked at in an iteration of its own, with a token of its own.
            wake_within(event_loop, Duration::ZERO);
            return;
        }
        let due = self.send(now);
        let gamepad_due = self.gamepads.is_any().then(|| now + GAMEPAD_PERIOD);
        let paint_due = self.postponed.map(|_| self.paint_from);
        if let Some(due) = [due, gamepad_due, paint_due].into_iter().flatten().min() {
            wake_within(event_loop, due.since(now));
        }
    }

    fn exiting(&mut self, event_loop: &ActiveEventLoop) {
        self.teleop_handle.shut_down();
        self.window.exiting(event_loop);
    }

    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        self.window.resumed(event_loop);
    }

    fn suspended(&mut self, event_loop: &ActiveEventLoop) {
        self.teleop_handle.apply(InputEvent::Focus(false));
        self.window.suspended(event_loop);
    }

    fn user_event(&mut self, event_loop: &ActiveEventLoop, event: UserEvent) {
        self.window.user_event(event_loop, event);
    }

    fn device_event(&mut self, event_loop: &ActiveEventLoop, id: DeviceId, event: DeviceEvent) {
        self.window.device_event(event_loop, id, event);
    }

    fn memory_warning(&mut self, event_loop: &ActiveEventLoop) {
        self.window.memory_warning(event_loop);
    }
}

/// eframe has said when it wants to be woken, if at all; this may be earlier.
fn wake_within(event_loop: &ActiveEventLoop, rest: Duration) {
    let ours = ControlFlow::wait_duration(rest);
    let earlier = match (event_loop.control_flow(), ours) {
        (ControlFlow::Poll, _) => ControlFlow::Poll,
        (ControlFlow::WaitUntil(theirs), ControlFlow::WaitUntil(ours)) => {
            ControlFlow::WaitUntil(theirs.min(ours))
        }
        (ControlFlow::Wait | ControlFlow::WaitUntil(_), ours) => ours,
    };
    event_loop.set_control_flow(earlier);
}
