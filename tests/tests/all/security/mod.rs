//! Who may do what, through real listeners with exactly the files that `robot-edge keys` makes.

mod router;

mod issuing;

mod commands;
mod flood;
mod installing;
mod matrix;
mod newer_list;
mod secured_link;
mod strangers;
#[cfg(target_os = "linux")]
mod udp_swallowed;
mod unlisted;
