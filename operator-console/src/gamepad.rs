//! Gamepads, where this program was built with them and there are any. Neither is the rule.

#[cfg(feature = "gamepad")]
mod gilrs_pads;

#[cfg(feature = "gamepad")]
pub use gilrs_pads::Gamepads;

#[cfg(not(feature = "gamepad"))]
pub use without::Gamepads;

#[cfg(not(feature = "gamepad"))]
mod without {
    use crate::teleop_input::InputEvent;

    /// No gamepads: this program was built without the feature `gamepad`.
    pub struct Gamepads;

    impl Gamepads {
        /// Says nothing: whoever wants gamepads knows how the program was built.
        pub const fn open() -> Self {
            Self
        }

        /// None.
        pub fn events(&mut self) -> impl Iterator<Item = InputEvent> {
            std::iter::empty()
        }

        /// Never.
        pub const fn is_any(&self) -> bool {
            false
        }
    }
}
