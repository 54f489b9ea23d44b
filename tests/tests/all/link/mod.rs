//! Edge and console as processes, over real Zenoh sessions.

mod processes;

mod cost;
mod garbage;
mod live_map;
mod python_client;
mod router;
mod shaped;
mod window;
