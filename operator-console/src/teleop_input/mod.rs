//! What the operator's hands ask for: hold to drive, let go to stop, and nothing by itself.
//!
//! Pure: events in, a [`Wish`] out; no clock, window or device. The rule of the design ("Teleop", States) is kept here
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
pub struct Wish {
    /// Forwards.
    pub forward: f32,
    /// To the left.
    pub left: f32,
}

impl Wish {
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
pub enum Loss {
    /// Keys went elsewhere.
    Focus,
    /// The window could not be seen.
    Sight,
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
    Renewed,
    /// The emergency stop.
    EStop,
    /// The robot stopped by itself, and told why.
    Stopped,
    /// This program did not run for a while.
    Frozen,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Hold {
    #[default]
    Up,
    /// Down, and counts for nothing until it is let go.
    Dead,
    Live,
}

/// Whether what the hands do is meant for the robot.
#[derive(Clone, Copy, Debug)]
struct Attention {
    has_focus: bool,
    is_visible: bool,
    is_typing: bool,
}

impl Attention {
    const fn is_whole(self) -> bool {
        self.has_focus && self.is_visible && !self.is_typing
    }
}

/// The operator's hands.
#[derive(Clone, Debug)]
pub struct TeleopInput {
    keys: [Hold; DriveKey::ALL.len()],
    deadman: Hold,
    stick: Wish,
    step: SpeedStep,
    attention: Attention,
    /// Since when presses do not count; `None` while they do.
    locked_by: Option<Loss>,
    is_estop_pressed: bool,
}

impl Default for TeleopInput {
    /// Nobody's hands: a window says when it has the keyboard.
    fn default() -> Self {
        Self {
            keys: [Hold::Up; DriveKey::ALL.len()],
            deadman: Hold::Up,
            stick: Wish::NEUTRAL,
            step: SpeedStep::default(),
            attention: Attention {
                has_focus: false,
                is_visible: true,
                is_typing: false,
            },
            locked_by: Some(Loss::Focus),
            is_estop_pressed: false,
        }
    }
}

impl TeleopInput {
    /// Takes an event, in the order in which they happened.
    pub fn apply(&mut self, event: InputEvent) {
        match event {
            InputEvent::Press(key) => {
                if self.keys[key as usize] == Hold::Up {
                    self.keys[key as usize] = self.new_hold();
                }
            }
            InputEvent::StillDown(key) => {
                if self.keys[key as usize] == Hold::Up {
                    self.keys[key as usize] = Hold::Dead;
                }
            }
            InputEvent::Release(key) => self.keys[key as usize] = Hold::Up,
            InputEvent::EStop => {
                self.is_estop_pressed = true;
                self.lose(Loss::EStop);
            }
            InputEvent::Step(step) => self.step = step,
            InputEvent::Pad(reading) => self.take_pad(reading),
            InputEvent::PadGone => {
                let was_live = self.deadman == Hold::Live;
                self.deadman = Hold::Up;
                self.stick = Wish::NEUTRAL;
                if was_live {
                    self.lose(Loss::Gamepad);
                }
            }
            InputEvent::Focus(has_focus) => {
                self.attention.has_focus = has_focus;
                if !has_focus {
                    // Where keys go up from now on is told to somebody else.
                    self.keys = [Hold::Up; DriveKey::ALL.len()];
                    self.lose(Loss::Focus);
                }
            }
            InputEvent::Visible(is_visible) => {
                self.attention.is_visible = is_visible;
                if !is_visible {
                    self.lose(Loss::Sight);
                }
            }
            InputEvent::Typing(is_typing) => {
                self.attention.is_typing = is_typing;
                if is_typing {
                    self.lose(Loss::Typing);
                }
            }
        }
        self.unlock_if_all_is_let_go();
    }

    /// From now on nothing that is down counts.
    pub fn lose(&mut self, loss: Loss) {
        for hold in self.keys.iter_mut().chain([&mut self.deadman]) {
            if *hold == Hold::Live {
                *hold = Hold::Dead;
            }
        }
        self.locked_by = Some(loss);
        self.unlock_if_all_is_let_go();
    }

    /// What is asked for now.
    pub fn wish(&self) -> Wish {
        if !self.attention.is_whole() {
            return Wish::NEUTRAL;
        }
        let mut live = self.keys().peekable();
        let pull = if live.peek().is_some() {
            let sum = live.map(DriveKey::pull).fold([0.0; 2], add);
            // Both forward keys are no more than one.
            sum.map(|pull: f32| pull.clamp(-1.0, 1.0))
        } else if self.deadman == Hold::Live {
            [self.stick.forward, self.stick.left]
        } else {
            [0.0; 2]
        };
        let [forward, left] = pull.map(|pull| pull * self.step.share());
        Wish { forward, left }
    }

    /// The keys that are held and count, whatever they ask for together.
    pub fn keys(&self) -> impl Iterator<Item = DriveKey> {
        let is_live = |key: &DriveKey| self.keys[*key as usize] == Hold::Live;
        DriveKey::ALL.into_iter().filter(is_live)
    }

    /// Why what is down counts for nothing; `None` where it counts, or nothing is down.
    pub fn ignored_because(&self) -> Option<Loss> {
        self.locked_by.filter(|_| self.is_something_down())
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
        self.stick = Wish {
            forward: without_dead_zone(reading.forward),
            left: without_dead_zone(reading.left),
        };
        self.deadman = match (reading.is_deadman_held, self.deadman) {
            (false, _) => Hold::Up,
            (true, Hold::Up) => self.new_hold(),
            (true, held) => held,
        };
    }

    /// What becomes of a key that goes down now.
    const fn new_hold(&self) -> Hold {
        if self.locked_by.is_none() && self.attention.is_whole() {
            Hold::Live
        } else {
            Hold::Dead
        }
    }

    fn is_something_down(&self) -> bool {
        let mut holds = self.keys.iter().chain([&self.deadman]);
        holds.any(|hold| *hold != Hold::Up)
    }

    fn unlock_if_all_is_let_go(&mut self) {
        if self.attention.is_whole() && !self.is_something_down() {
            self.locked_by = None;
        }
    }
}

fn add([a, b]: [f32; 2], [c, d]: [f32; 2]) -> [f32; 2] {
    [a + c, b + d]
}

#[cfg(test)]
mod tests;
