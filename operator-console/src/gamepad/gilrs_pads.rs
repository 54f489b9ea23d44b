//! Gamepads by `gilrs`, which knows how some hundreds of them name their buttons.

use gilrs::{Axis, Button, EventType, GamepadId, Gilrs};

use crate::teleop_input::{InputEvent, PadReading};

/// The dead-man button: the right shoulder.
const DEADMAN: Button = Button::RightTrigger;
/// The emergency stop: the right one of the four.
const ESTOP: Button = Button::East;
/// Events taken at once: more are nobody's hands.
const MAX_EVENTS: usize = 256;

/// The gamepads of this computer; the one that was touched last drives.
pub struct Gamepads {
    gilrs: Option<Gilrs>,
    touched: Option<GamepadId>,
    last_reading: Option<PadReading>,
}

impl Gamepads {
    /// Looks for gamepads. Where there can be none, that is said once in the log.
    pub fn open() -> Self {
        let gilrs = Gilrs::new()
            .inspect_err(|why| tracing::info!(%why, "there are no gamepads"))
            .ok();
        Self {
            gilrs,
            touched: None,
            last_reading: None,
        }
    }

    /// What happened to them since the last call.
    pub fn events(&mut self) -> impl Iterator<Item = InputEvent> {
        let mut events = Vec::new();
        let Some(gilrs) = &mut self.gilrs else {
            return events.into_iter();
        };
        for _ in 0..MAX_EVENTS {
            let Some(event) = gilrs.next_event() else {
                break;
            };
            if event.event == EventType::Disconnected && self.touched == Some(event.id) {
                self.touched = None;
                self.last_reading = None;
                events.push(InputEvent::PadGone);
            }
            // Sticks and releases are read as they are, below.
            if let EventType::ButtonPressed(button, _) = event.event {
                if button == ESTOP {
                    events.push(InputEvent::EStop);
                }
                // Another pad takes over only by its dead-man button, and not while one is held.
                let is_held = self
                    .last_reading
                    .is_some_and(|last_reading| last_reading.is_deadman_held);
                if button == DEADMAN && !is_held {
                    self.touched = Some(event.id);
                }
            }
        }
        let Some(pad) = self.touched.and_then(|id| gilrs.connected_gamepad(id)) else {
            return events.into_iter();
        };
        let reading = PadReading {
            is_deadman_held: pad.is_pressed(DEADMAN),
            forward: pad.value(Axis::LeftStickY),
            left: -pad.value(Axis::LeftStickX),
        };
        if self.last_reading != Some(reading) {
            self.last_reading = Some(reading);
            events.push(InputEvent::Pad(reading));
        }
        events.into_iter()
    }

    /// Whether one is there.
    pub fn is_any(&self) -> bool {
        let mut gamepads = self.gilrs.iter().flat_map(Gilrs::gamepads);
        gamepads.next().is_some()
    }
}
