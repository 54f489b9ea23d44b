//! Gamepads, if the program is built with the feature `gamepad`.

#[cfg(feature = "gamepad")]
mod gilrs_pads {
    use gilrs::{Axis, Button, EventType, GamepadId, Gilrs};

    use crate::teleop_input::{InputEvent, PadReading};

    /// Right shoulder.
    const DEADMAN: Button = Button::RightTrigger;
    /// The right one of the four buttons.
    const ESTOP: Button = Button::East;
    const MAX_EVENTS: usize = 256;

    /// The gamepads of this computer. The last one whose dead-man button was pressed drives.
    pub struct Gamepads {
        gilrs: Option<Gilrs>,
        touched: Option<GamepadId>,
        last_reading: Option<PadReading>,
    }

    impl Gamepads {
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
                // Sticks and releases are polled below.
                if let EventType::ButtonPressed(button, _) = event.event {
                    if button == ESTOP {
                        events.push(InputEvent::EStop);
                    }
                    // Another gamepad takes over with its dead-man button only, and not while one is held.
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
                sideways: -pad.value(Axis::RightStickX),
                left: -pad.value(Axis::LeftStickX),
            };
            if self.last_reading != Some(reading) {
                self.last_reading = Some(reading);
                events.push(InputEvent::Pad(reading));
            }
            events.into_iter()
        }

        pub fn is_any(&self) -> bool {
            let mut gamepads = self.gilrs.iter().flat_map(Gilrs::gamepads);
            gamepads.next().is_some()
        }
    }
}

#[cfg(feature = "gamepad")]
pub use gilrs_pads::Gamepads;

#[cfg(not(feature = "gamepad"))]
pub use no_pads::Gamepads;

#[cfg(not(feature = "gamepad"))]
mod no_pads {
    use crate::teleop_input::InputEvent;

    pub struct Gamepads;

    impl Gamepads {
        pub const fn open() -> Self {
            Self
        }

        pub fn events(&mut self) -> impl Iterator<Item = InputEvent> {
            std::iter::empty()
        }

        pub const fn is_any(&self) -> bool {
            false
        }
    }
}
