//! The bodies of messages; see [`crate::wire`] for what precedes them and [`crate::keys`] for where they go.

mod map;
mod robot;
mod teleop;

pub use map::*;
pub use robot::*;
pub use teleop::*;

#[cfg(test)]
mod tests;
