//! The window's event loop with the teleop client.
//!
//! eframe delivers input once a frame, and a frame may take 10 ms and more without a GPU, or for ever behind other
//! windows. So the teleop client does not depend on frames. This loop receives each event before eframe: an iteration
//! takes the newest token, drains the queue, sends, and then lets eframe paint. With the lease it wakes 50 times a
//! second, and painting takes at most half of the time: after a frame of 40 ms the next one waits for as long. If
//! painting hangs, the loop hangs and sends nothing.

use std::rc::Rc;
use std::time::Duration;

use eframe::{EframeWinitApplication, UserEvent};
use measurement::time::Monotonic;
use network::clock;
use winit::application::ApplicationHandler;
use winit::event::{DeviceEvent, DeviceId, ElementState, KeyEvent, StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow};
use winit::keyboard::{KeyCode, ModifiersState, PhysicalKey};
use winit::window::WindowId;

use crate::gamepad::Gamepads;
use crate::teleop_handle::TeleopHandle;
use crate::teleop_input::{DriveKey, InputEvent, SpeedStep};

const SLOW: Duration = Duration::from_millis(100);
/// Polling period of gamepads, which send no window events.
const GAMEPAD_PERIOD: Duration = Duration::from_millis(20);

pub struct InputLoop<'a> {
    window: EframeWinitApplication<'a>,
    teleop_handle: Rc<TeleopHandle>,
    gamepads: Gamepads,
    modifiers: ModifiersState,
    began: Monotonic,
    /// Whether this iteration has sent already, before painting.
    is_sent: bool,
    /// A postponed frame, and the earliest time of the next one.
    postponed: Option<WindowId>,
    paint_from: Monotonic,
}

impl<'a> InputLoop<'a> {
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

    /// Sends, then paints: a command does not wait for a frame.
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

    /// Whether the event is for the teleop client alone.
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

    /// A press may be for the teleop client alone. Releases go to both: with Ctrl released before S, eframe must see
    /// the release of S, or it takes the next Ctrl+S for a repetition.
    fn take_key(&self, event: &KeyEvent, is_synthetic: bool) -> bool {
        let Some(key) = teleop_key(event.physical_key) else {
            return false;
        };
        if !self.teleop_handle.has_session() {
            return false;
        }
        let is_down = event.state == ElementState::Pressed;
        let is_press = is_down && !event.repeat && !is_synthetic;
        let is_plain = !self
            .modifiers
            .intersects(ModifiersState::CONTROL | ModifiersState::ALT | ModifiersState::SUPER);
        match key {
            // While this operator drives, also in a text field: the stop is more urgent.
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
                // Without the lease the arrow keys also move the map.
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
            // Events during painting get an iteration of their own, with a new token.
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

/// Wakes the loop after `rest`, or earlier if eframe needs it.
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

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TeleopKey {
    Drive(DriveKey),
    Step(SpeedStep),
    EStop,
}

const DRIVE: [(KeyCode, DriveKey); 10] = [
    (KeyCode::KeyW, DriveKey::W),
    (KeyCode::KeyA, DriveKey::A),
    (KeyCode::KeyS, DriveKey::S),
    (KeyCode::KeyD, DriveKey::D),
    (KeyCode::ArrowUp, DriveKey::Up),
    (KeyCode::ArrowLeft, DriveKey::Left),
    (KeyCode::ArrowDown, DriveKey::Down),
    (KeyCode::ArrowRight, DriveKey::Right),
    (KeyCode::KeyQ, DriveKey::Q),
    (KeyCode::KeyE, DriveKey::E),
];

const STEPS: [[KeyCode; 2]; SpeedStep::COUNT as usize] = [
    [KeyCode::Digit1, KeyCode::Numpad1],
    [KeyCode::Digit2, KeyCode::Numpad2],
    [KeyCode::Digit3, KeyCode::Numpad3],
    [KeyCode::Digit4, KeyCode::Numpad4],
    [KeyCode::Digit5, KeyCode::Numpad5],
];

/// The function of the key at this position, independent of the layout.
fn teleop_key(key: PhysicalKey) -> Option<TeleopKey> {
    let PhysicalKey::Code(code) = key else {
        return None;
    };
    if code == KeyCode::Space {
        return Some(TeleopKey::EStop);
    }
    let drive = DRIVE.into_iter().find(|(at, _)| *at == code);
    let mut steps = STEPS.iter().zip(SpeedStep::all());
    let step = steps.find(|(at, _)| at.contains(&code));
    drive
        .map(|(_, key)| TeleopKey::Drive(key))
        .or_else(|| step.map(|(_, step)| TeleopKey::Step(step)))
}

#[cfg(test)]
mod tests {
    use winit::keyboard::NativeKeyCode;

    use super::*;

    #[test]
    fn every_drive_key_has_one_position() {
        let keys: Vec<_> = DRIVE.iter().map(|(_, key)| *key).collect();
        assert_eq!(keys, DriveKey::ALL);
        let of = |code| teleop_key(PhysicalKey::Code(code));
        assert_eq!(of(KeyCode::Space), Some(TeleopKey::EStop));
        for key in [KeyCode::Digit4, KeyCode::Numpad4] {
            assert_eq!(of(key), SpeedStep::new(4).map(TeleopKey::Step));
        }
        assert_eq!(of(KeyCode::KeyF), None, "it is the map's");
        let unknown = PhysicalKey::Unidentified(NativeKeyCode::Xkb(38));
        assert_eq!(teleop_key(unknown), None);
    }
}
