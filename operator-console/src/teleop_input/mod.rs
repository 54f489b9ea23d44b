//! What the operator's hands ask for: hold to drive, let go to stop, and nothing by itself.
//!
//! Pure: events in, a [`DriveInput`] out; no clock, window or device. The rule of the design ("Teleop", States) is kept here
//! as well as on the vehicle: after any loss (focus, sight, link, lease, emergency stop …) a key that is still down asks
//! for nothing until everything was let go and it is pressed anew.

mod event;
mod gamepad;
mod speed_step;

pub use event::{DriveKey, InputEvent};
pub use gamepad::PadReading;
pub use speed_step::SpeedStep;

use gamepad::without_dead_zone;

/// What is asked for, as shares of the vehicle's greatest speed and turn rate: −1 … 1, always finite.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DriveInput {
    /// Forwards.
    pub forward: f32,
    /// To the left.
    pub left: f32,
}

impl DriveInput {
    /// Nothing is asked for.
    pub const NEUTRAL: Self = Self {
        forward: 0.0,
        left: 0.0,
    };

    /// Whether nothing is asked for.
    pub fn is_neutral(self) -> bool {
        self == Self::NEUTRAL
    }
}

/// Why what is held down counts for nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InputLockReason {
    /// Keys went elsewhere.
    Focus,
    /// The window could not be seen.
    WindowHidden,
    /// Keys were text.
    Typing,
    /// The gamepad went away.
    Gamepad,
    /// The robot was not heard.
    Link,
    /// The robot was restarted, or another one is driven.
    Robot,
    /// Somebody else drives, or nobody does, or it was down before the grant.
    Lease,
    /// The lease was asked for anew by who had it: this is another grant.
    LeaseRenewed,
    /// The emergency stop.
    EStop,
    /// The robot stopped by itself, and told why.
    Stopped,
    /// This program did not run for a while.
    LoopStalled,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum KeyState {
    #[default]
    Up,
    /// Down, and counts for nothing until it is let go.
    Ignored,
    Active,
}

/// Whether what the hands do is meant for the robot.
#[derive(Clone, Copy, Debug)]
struct InputFocus {
    has_focus: bool,
    is_visible: bool,
    is_typing: bool,
}

impl InputFocus {
    const fn is_whole(self) -> bool {
        self.has_focus && self.is_visible && !self.is_typing
    }
}

/// The operator's hands.
#[derive(Clone, Debug)]
pub struct TeleopInput {
    keys: [KeyState; DriveKey::ALL.len()],
    deadman: KeyState,
    stick: DriveInput,
    step: SpeedStep,
    input_focus: InputFocus,
    /// Since when presses do not count; `None` while they do.
    locked_by: Option<InputLockReason>,
    is_estop_pressed: bool,
}

impl Default for TeleopInput {
    /// Nobody's hands: a window says when it has the keyboard.
    fn default() -> Self {
        Self {
            keys: [KeyState::Up; DriveKey::ALL.len()],
            deadman: KeyState::Up,
            stick: DriveInput::NEUTRAL,
            step: SpeedStep::default(),
            input_focus: InputFocus {
                has_focus: false,
                is_visible: true,
                is_typing: false,
            },
            locked_by: Some(InputLockReason::Focus),
            is_estop_pressed: false,
        }
    }
}

impl TeleopInput {
    /// Takes an event, in the order in which they happened.
    pub fn apply(&mut self, event: InputEvent) {
        match event {
            InputEvent::Press(key) => {
                if self.keys[key as usize] == KeyState::Up {
                    self.keys[key as usize] = self.new_key_state();
                }
            }
            InputEvent::StillDown(key) => {
                if self.keys[key as usize] == KeyState::Up {
                    self.keys[key as usize] = KeyState::Ignored;
                }
            }
            InputEvent::Release(key) => self.keys[key as usize] = KeyState::Up,
            InputEvent::EStop => {
                self.is_estop_pressed = true;
                self.lock_input(InputLockReason::EStop);
            }
            InputEvent::Step(step) => self.step = step,
            InputEvent::Pad(reading) => self.take_pad(reading),
            InputEvent::PadGone => {
                let was_live = self.deadman == KeyState::Active;
                self.deadman = KeyState::Up;
                self.stick = DriveInput::NEUTRAL;
                if was_live {
                    self.lock_input(InputLockReason::Gamepad);
                }
            }
            InputEvent::Focus(has_focus) => {
                self.input_focus.has_focus = has_focus;
                if !has_focus {
                    // Where keys go up from now on is told to somebody else.
                    self.keys = [KeyState::Up; DriveKey::ALL.len()];
                    self.lock_input(InputLockReason::Focus);
                }
            }
            InputEvent::Visible(is_visible) => {
                self.input_focus.is_visible = is_visible;
                if !is_visible {
                    self.lock_input(InputLockReason::WindowHidden);
                }
            }
            InputEvent::Typing(is_typing) => {
                self.input_focus.is_typing = is_typing;
                if is_typing {
                    self.lock_input(InputLockReason::Typing);
                }
            }
        }
        self.unlock_if_all_released();
    }

    /// From now on nothing that is down counts.
    pub fn lock_input(&mut self, loss: InputLockReason) {
        for hold in self.keys.iter_mut().chain([&mut self.deadman]) {
            if *hold == KeyState::Active {
                *hold = KeyState::Ignored;
            }
        }
        self.locked_by = Some(loss);
        self.unlock_if_all_released();
    }

    /// What is asked for now.
    pub fn drive_input(&self) -> DriveInput {
        if !self.input_focus.is_whole() {
            return DriveInput::NEUTRAL;
        }
        let mut live = self.keys().peekable();
        let direction = if live.peek().is_some() {
            let sum = live.map(DriveKey::direction).fold([0.0; 2], add);
            // Both forward keys are no more than one.
            sum.map(|direction: f32| direction.clamp(-1.0, 1.0))
        } else if self.deadman == KeyState::Active {
            [self.stick.forward, self.stick.left]
        } else {
            [0.0; 2]
        };
        let [forward, left] = direction.map(|direction| direction * self.step.share());
        DriveInput { forward, left }
    }

    /// The keys that are held and count, whatever they ask for together.
    pub fn keys(&self) -> impl Iterator<Item = DriveKey> {
        let is_live = |key: &DriveKey| self.keys[*key as usize] == KeyState::Active;
        DriveKey::ALL.into_iter().filter(is_live)
    }

    /// Why what is down counts for nothing; `None` where it counts, or nothing is down.
    pub fn lock_reason(&self) -> Option<InputLockReason> {
        self.locked_by.filter(|_| self.is_any_pressed())
    }

    /// Whether a press would count.
    pub const fn is_ready(&self) -> bool {
        self.locked_by.is_none()
    }

    /// How fast keys drive.
    pub const fn step(&self) -> SpeedStep {
        self.step
    }

    /// Whether the emergency stop was pressed since the last call.
    pub const fn take_estop(&mut self) -> bool {
        std::mem::replace(&mut self.is_estop_pressed, false)
    }

    fn take_pad(&mut self, reading: PadReading) {
        self.stick = DriveInput {
            forward: without_dead_zone(reading.forward),
            left: without_dead_zone(reading.left),
        };
        self.deadman = match (reading.is_deadman_held, self.deadman) {
            (false, _) => KeyState::Up,
            (true, KeyState::Up) => self.new_key_state(),
            (true, held) => held,
        };
    }

    /// What becomes of a key that goes down now.
    const fn new_key_state(&self) -> KeyState {
        if self.locked_by.is_none() && self.input_focus.is_whole() {
            KeyState::Active
        } else {
            KeyState::Ignored
        }
    }

    fn is_any_pressed(&self) -> bool {
        let mut holds = self.keys.iter().chain([&self.deadman]);
        holds.any(|hold| *hold != KeyState::Up)
    }

    fn unlock_if_all_released(&mut self) {
        if self.input_focus.is_whole() && !self.is_any_pressed() {
            self.locked_by = None;
        }
    }
}

fn add([a, b]: [f32; 2], [c, d]: [f32; 2]) -> [f32; 2] {
    [a + c, b + d]
}

#[cfg(test)]
mod tests;
