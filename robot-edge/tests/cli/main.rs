//! The program as its users run it: real processes over real files, judged by exit code, words and maps.

#![cfg(test)]

mod carmen_and_mcap;
mod determinism;
mod experiments;
mod exported_map;
mod info;
#[cfg(unix)]
mod interrupt;
#[cfg(target_os = "linux")]
mod motor_guard;
mod outputs;
mod own_clip;
mod process;
mod record;
mod recordings_of_others;
mod recover;
#[path = "../../recording/src/shared_data.rs"]
mod shared_data;
#[path = "../../../tests/tests/all/skip.rs"]
mod skip;
mod terrain;
mod usage;
mod voxels;
mod wheels;
