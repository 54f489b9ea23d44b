//! What the end-to-end tests are built from; the tests themselves are in `tests/all/`.

#[cfg(target_os = "linux")]
pub mod rig;
