//! What mapping costs on recordings: tables of time, memory and bytes. Nothing passes or fails by them.
//!
//! ```sh
//! cargo bench -p robot-edge                   # everything, about a minute and a half
//! cargo bench -p robot-edge -- occupancy      # or only: reading, occupancy, terrain, classify, clouds, rays, voxels, tiles, replay
//! cargo bench -p robot-edge -- endurance      # a run of 100,000 scans, some minutes; never by itself
//! ```
//!
//! `recordings/rooms.mcap` is always measured; recordings of others where they are found, in
//! `$FORESHORE_DATA` or `../shared/data` beside the workspace. What is missing is said.

#![expect(clippy::print_stdout, reason = "a bench reports on standard output")]

mod classify;
mod clouds;
mod occupancy;
mod rays;
mod recordings;
mod replay;
mod rounds;
mod terrain;
mod tiles;
mod voxels;

use std::env;

/// Measures and prints one part.
type Print = fn() -> anyhow::Result<()>;

/// Sides of a cell that are compared, metres.
const CELLS_M: [f64; 2] = [0.10, 0.05];

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    if let [part, rest @ ..] = &arguments[..]
        && part == rays::CHILD
    {
        return rays::child(rest);
    }
    // `cargo test --benches` runs this too, unoptimised.
    if !arguments.iter().any(|argument| argument == "--bench") {
        println!("nothing is measured: run it with `cargo bench`");
        return Ok(());
    }
    let wanted: Vec<&str> = arguments
        .iter()
        .map(String::as_str)
        .filter(|argument| !argument.starts_with("--"))
        .collect();
    println!(
        "one thread, processor time; median of {} rounds (least … greatest)",
        rounds::ROUNDS
    );
    let parts: [(&str, Print); 9] = [
        ("reading", recordings::print_reading),
        ("occupancy", occupancy::print),
        ("terrain", terrain::print),
        ("classify", classify::print),
        ("clouds", clouds::print),
        ("rays", rays::print),
        ("voxels", voxels::print),
        ("tiles", tiles::print),
        ("replay", replay::print),
    ];
    for (name, print) in parts {
        if wanted.is_empty() || wanted.contains(&name) {
            println!();
            print()?;
        }
    }
    // Minutes, so only on demand.
    if wanted.contains(&"endurance") {
        println!();
        voxels::print_endurance()?;
    }
    Ok(())
}
