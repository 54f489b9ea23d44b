//! The vehicle's end of the link: Zenoh sessions on one side, the tile store and the published state on the other.
//!
//! Zenoh has its own runtime. The server itself consists of blocking threads, for none of which mapping waits: state,
//! tiles, small replies, requested tiles, and one that reopens the sessions.

mod commands;
pub mod edge;
mod open_sessions;
pub mod publish_state;
mod queries;
mod streams;
mod token_pace;
