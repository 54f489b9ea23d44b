//! The program itself: `robot-edge replay --rate max`, from starting the process to its end.

use std::fs::File;
use std::path::Path;
use std::process::Command;

use anyhow::Context as _;
use serde_json::Value;

use crate::CELLS_M;
use crate::recordings::{self, ACES, CLINIC, ROOMS};
use crate::rounds::{ROUNDS, Rounds, children_processor_s, timed_by_the_wall};

/// One table, a row a recording and cell size.
pub(crate) fn print() -> anyhow::Result<()> {
    println!("replay: the whole program at --rate max");
    println!(
        "| recording | processor time, s | million beams/s | by the wall, s | peak memory, MB | bytes of tiles, 4 bytes a cell over them \
         | digest |"
    );
    println!("| --- | ---: | ---: | ---: | ---: | ---: | --- |");
    for name in [ROOMS, ACES, CLINIC] {
        let Some(path) = recordings::find(name) else {
            continue;
        };
        // Ten seconds a round are too long for what the others show too.
        let sizes = if name == CLINIC { 1 } else { CELLS_M.len() };
        for cell_m in CELLS_M.into_iter().take(sizes) {
            let (mut secs, mut wall_s) = (Rounds::default(), Rounds::default());
            for _ in 0..ROUNDS {
                let started_s = children_processor_s();
                let (done, time_s) = timed_by_the_wall(|| replay(&path, cell_m, None));
                done?;
                secs.add(children_processor_s() - started_s);
                wall_s.add(time_s);
            }
            let summary = summary(&path, cell_m)?;
            let number = |pointer| {
                let value = summary.pointer(pointer).and_then(Value::as_f64);
                value.with_context(|| format!("the summary has no {pointer}"))
            };
            let beams = number("/beams/in")?;
            let (bytes, raw_bytes) = (number("/tiles/bytes")?, number("/tiles/raw_bytes")?);
            let digest = summary.pointer("/layers/occupancy/digest");
            let digest = digest.and_then(Value::as_str).context("no digest")?;
            println!(
                "| {name}, {cell_m:.2} m | {secs:.2} | {:.2} | {wall_s:.2} | {:.1} | {:.2} MB, {:.1} | {digest:.8} |",
                secs.map(|secs| beams / secs / 1e6),
                number("/peak_rss_bytes")? / 1e6,
                bytes / 1e6,
                raw_bytes / bytes,
            );
        }
    }
    Ok(())
}

fn replay(path: &Path, cell_m: f64, summary: Option<&Path>) -> anyhow::Result<()> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_robot-edge"));
    command
        .args(["--quiet", "replay", "--no-network", "--set"])
        .arg(format!("mapping.occupancy.cell_m={cell_m}"))
        .arg(path);
    if let Some(summary) = summary {
        command.arg("--summary").arg(summary);
    }
    let status = command.status().context("cannot start robot-edge")?;
    anyhow::ensure!(status.success(), "{}: {status}", path.display());
    Ok(())
}

/// The summary of one more run, in which tiles are encoded too.
fn summary(path: &Path, cell_m: f64) -> anyhow::Result<Value> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("summary.json");
    replay(path, cell_m, Some(&file))?;
    Ok(serde_json::from_reader(File::open(file)?)?)
}
