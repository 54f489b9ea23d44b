//! The program as its users run it: real processes over real files, judged by exit code, words and maps.

#![cfg(test)]

mod clouds;
mod foxglove;
#[path = "../../../tests/tests/all/gdal.rs"]
mod gdal;
mod info;
#[cfg(unix)]
mod interrupt;
mod matched_scans;
mod outputs;
mod own_clip;
mod process;
#[path = "../../../tests/tests/all/python.rs"]
mod python;
mod record;
mod recordings;
#[path = "../../recording/src/shared_data.rs"]
mod shared_data;
#[path = "../../../tests/tests/all/skip.rs"]
mod skip;
mod ultrasound;
mod usage;
mod wheels;
mod worlds;
