//! Operator input of keys and gamepad: hold to drive, release to stop.
//!
//! Converts events to a [`DriveInput`]. After any interruption (focus, visibility, link, lease, emergency stop …) a key
//! that is still pressed does not count until everything is released and it is pressed again. The vehicle enforces the
//! same rule.

/// Requested motion as shares of the vehicle's greatest speed and turn rate: −1 … 1, always finite.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DriveInput {
    pub forward: f32,
    /// Sideways, positive to the left.
    pub sideways: f32,
    /// Turn, positive to the left.
    pub left: f32,
}

impl DriveInput {
    pub const NEUTRAL: Self = Self {
        forward: 0.0,
        sideways: 0.0,
        left: 0.0,
    };

    pub fn is_neutral(self) -> bool {
        self == Self::NEUTRAL
    }
}

/// Why pressed keys and sticks do not count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InputLockReason {
    Focus,
    WindowHidden,
    /// A text field had the keyboard.
    Typing,
    Gamepad,
    Link,
    /// The robot was restarted, or another one is driven.
    Robot,
    /// This console has no lease, or the key was pressed before the grant.
    Lease,
    /// The holder renewed the lease: it is another grant.
    LeaseRenewed,
    EStop,
    /// The robot stopped by itself and reported why.
    Stopped,
    LoopStalled,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum KeyState {
    #[default]
    Up,
    /// Pressed, but does not count until released.
    Ignored,
    Active,
}

/// Whether the input is meant for the robot.
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

#[derive(Clone, Debug)]
pub struct TeleopInput {
    keys: [KeyState; DriveKey::ALL.len()],
    deadman: KeyState,
    stick: DriveInput,
    /// Whether the robot can.
    goes_sideways: bool,
    step: SpeedStep,
    input_focus: InputFocus,
    /// Why presses do not count; `None` while they do.
    locked_by: Option<InputLockReason>,
    is_estop_pressed: bool,
}

impl Default for TeleopInput {
    /// A window reports when it gets the keyboard.
    fn default() -> Self {
        Self {
            keys: [KeyState::Up; DriveKey::ALL.len()],
            deadman: KeyState::Up,
            stick: DriveInput::NEUTRAL,
            goes_sideways: false,
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
    /// Takes an event, in order of occurrence.
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
                    // Releases from now on go to another window.
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

    /// Ignores everything that is pressed now.
    pub fn lock_input(&mut self, loss: InputLockReason) {
        for hold in self.keys.iter_mut().chain([&mut self.deadman]) {
            if *hold == KeyState::Active {
                *hold = KeyState::Ignored;
            }
        }
        self.locked_by = Some(loss);
        self.unlock_if_all_released();
    }

    pub fn drive_input(&self) -> DriveInput {
        if !self.input_focus.is_whole() {
            return DriveInput::NEUTRAL;
        }
        let mut live = self.keys().peekable();
        let direction = if live.peek().is_some() {
            let sum = live.map(DriveKey::direction).fold([0.0; 3], add);
            // Two forward keys count as one.
            sum.map(|direction: f32| direction.clamp(-1.0, 1.0))
        } else if self.deadman == KeyState::Active {
            [self.stick.forward, self.stick.sideways, self.stick.left]
        } else {
            [0.0; 3]
        };
        let [forward, sideways, left] = direction.map(|direction| direction * self.step.share());
        DriveInput {
            forward,
            sideways: if self.goes_sideways { sideways } else { 0.0 },
            left,
        }
    }

    pub const fn set_goes_sideways(&mut self, goes_sideways: bool) {
        self.goes_sideways = goes_sideways;
    }

    pub fn keys(&self) -> impl Iterator<Item = DriveKey> {
        let is_live = |key: &DriveKey| self.keys[*key as usize] == KeyState::Active;
        DriveKey::ALL.into_iter().filter(is_live)
    }

    pub fn lock_reason(&self) -> Option<InputLockReason> {
        self.locked_by.filter(|_| self.is_any_pressed())
    }

    pub const fn is_ready(&self) -> bool {
        self.locked_by.is_none()
    }

    pub const fn step(&self) -> SpeedStep {
        self.step
    }

    pub const fn take_estop(&mut self) -> bool {
        std::mem::replace(&mut self.is_estop_pressed, false)
    }

    fn take_pad(&mut self, reading: PadReading) {
        self.stick = DriveInput {
            forward: without_dead_zone(reading.forward),
            sideways: without_dead_zone(reading.sideways),
            left: without_dead_zone(reading.left),
        };
        self.deadman = match (reading.is_deadman_held, self.deadman) {
            (false, _) => KeyState::Up,
            (true, KeyState::Up) => self.new_key_state(),
            (true, held) => held,
        };
    }

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

fn add(one: [f32; 3], other: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|axis| one[axis] + other[axis])
}

/// A drive key by its position: W A S D of a QWERTY keyboard, whatever their labels, and the arrows; Q and E go sideways.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum DriveKey {
    W,
    A,
    S,
    D,
    Up,
    Left,
    Down,
    Right,
    Q,
    E,
}

impl DriveKey {
    pub const ALL: [Self; 10] = [
        Self::W,
        Self::A,
        Self::S,
        Self::D,
        Self::Up,
        Self::Left,
        Self::Down,
        Self::Right,
        Self::Q,
        Self::E,
    ];

    pub const fn is_arrow(self) -> bool {
        matches!(self, Self::Up | Self::Left | Self::Down | Self::Right)
    }

    /// Forward, sideways to the left, turning to the left.
    const fn direction(self) -> [f32; 3] {
        match self {
            Self::W | Self::Up => [1.0, 0.0, 0.0],
            Self::S | Self::Down => [-1.0, 0.0, 0.0],
            Self::A | Self::Left => [0.0, 0.0, 1.0],
            Self::D | Self::Right => [0.0, 0.0, -1.0],
            Self::Q => [0.0, 1.0, 0.0],
            Self::E => [0.0, -1.0, 0.0],
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum InputEvent {
    Press(DriveKey),
    /// A repetition, or pressed before the window got the keyboard: does not count, but must be released.
    StillDown(DriveKey),
    Release(DriveKey),
    EStop,
    Step(SpeedStep),
    Pad(PadReading),
    PadGone,
    Focus(bool),
    Visible(bool),
    Typing(bool),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PadReading {
    pub is_deadman_held: bool,
    /// Raw deflections of the sticks, −1 … 1.
    pub forward: f32,
    pub sideways: f32,
    pub left: f32,
}

/// A released stick may be off centre by this much.
const DEAD_ZONE: f32 = 0.15;

/// Removes the dead zone: 0 within it, then linear to ±1; 0 if not finite.
fn without_dead_zone(deflection: f32) -> f32 {
    if !deflection.is_finite() {
        return 0.0;
    }
    let beyond = (deflection.abs() - DEAD_ZONE) / (1.0 - DEAD_ZONE);
    beyond.clamp(0.0, 1.0).copysign(deflection)
}

/// A share of the vehicle's greatest speed and turn rate, in five steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct SpeedStep(u8);

impl SpeedStep {
    pub const COUNT: u8 = 5;

    pub const fn new(number: u8) -> Option<Self> {
        match number {
            1..=Self::COUNT => Some(Self(number)),
            _ => None,
        }
    }

    pub fn all() -> impl Iterator<Item = Self> {
        (1..=Self::COUNT).map(Self)
    }

    pub const fn number(self) -> u8 {
        self.0
    }

    pub fn share(self) -> f32 {
        f32::from(self.0) / f32::from(Self::COUNT)
    }
}

impl Default for SpeedStep {
    /// Second slowest.
    fn default() -> Self {
        Self(2)
    }
}

#[cfg(test)]
mod tests;

#[cfg(test)]
mod gamepad_tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn dead_zone_is_zero_and_ends_are_full() {
        for (deflection, expected) in [
            (0.0, 0.0),
            (0.15, 0.0),
            (-0.15, 0.0),
            (0.575, 0.5),
            (1.0, 1.0),
            (-1.0, -1.0),
            (-7.0, -1.0),
            (f32::NAN, 0.0),
            (f32::INFINITY, 0.0),
        ] {
            let got = without_dead_zone(deflection);
            assert!((got - expected).abs() < 1e-6, "{deflection}: {got}");
        }
    }

    proptest! {
        #[test]
        fn more_deflection_is_never_less(bits in any::<[u32; 2]>()) {
            let [a, b] = bits.map(f32::from_bits);
            let (a_out, b_out) = (without_dead_zone(a), without_dead_zone(b));
            prop_assert!(a_out.abs() <= 1.0 && b_out.abs() <= 1.0);
            if a.is_finite() && b.is_finite() && a <= b {
                prop_assert!(a_out <= b_out, "{a} {b}: {a_out} {b_out}");
            }
        }
    }
}

#[cfg(test)]
mod speed_step_tests {
    use super::*;

    #[test]
    fn steps_are_five_shares_of_the_greatest_speed() {
        let shares: Vec<_> = SpeedStep::all().map(SpeedStep::share).collect();
        assert_eq!(shares, [0.2, 0.4, 0.6, 0.8, 1.0]);
        assert_eq!(SpeedStep::new(0), None);
        assert_eq!(SpeedStep::new(6), None);
    }
}
