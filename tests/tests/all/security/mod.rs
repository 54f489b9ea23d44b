//! Access rights at real listeners, with the files that `robot-edge keys` makes.

mod router;

mod issuing;

mod commands;
mod flood;
mod installing;
mod matrix;
mod operator_list_update;
mod secured_link;
#[cfg(target_os = "linux")]
mod udp_swallowed;
mod unauthorized_peers;
mod unlisted;
