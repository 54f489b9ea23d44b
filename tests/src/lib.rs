//! What the end-to-end tests are built from; the tests themselves are in `tests/all/`.

pub mod drive_log;
pub mod operator;
#[cfg(target_os = "linux")]
pub mod rig;
