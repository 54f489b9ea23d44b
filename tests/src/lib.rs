//! Parts of the end-to-end tests, which are in `tests/all/`.

pub mod drive_log;
pub mod operator;
#[cfg(target_os = "linux")]
pub mod rig;
