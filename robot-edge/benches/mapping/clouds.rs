//! Three-dimensional lidars: the whole program on the recordings that `$FORESHORE_CLOUDS` names (separated by `:`), and their first
//! revolutions for [`super::rays`].

use std::env;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, ensure};
use edge::config;
use edge::survey::Survey;
use experiments::run::pipeline;
use mapping::registered_scan::{BeamOutcome, RegisteredScan};
use nalgebra::Point3;
use recording::{self, Selection};
use serde_json::Value;

use super::rounds::children_processor_s;

/// Revolutions that are written for the comparison with `OctoMap`, which takes seconds for each.
pub(crate) const REVOLUTIONS: usize = 20;
/// They, in `$FORESHORE_RAYS`.
pub(crate) const FILE: &str = "clouds";

const STAGES: [&str; 3] = ["localization", "mapping", "publish"];

pub(crate) fn print() -> anyhow::Result<()> {
    println!("clouds: the whole program at --rate max, all layers");
    let Some(paths) = env::var_os("FORESHORE_CLOUDS") else {
        println!("  skipped: FORESHORE_CLOUDS names no recordings");
        return Ok(());
    };
    println!(
        "| recording | threads | revolutions | points/s of the sensor | × real time (processor) | × real time (elapsed) \
         | p50, p99 ms: {} | peak MB |",
        STAGES.join(", ")
    );
    println!("| --- | ---: | ---: | ---: | ---: | ---: | --- | ---: |");
    for path in env::split_paths(&paths) {
        for threads in [1, 2] {
            let (summary, processor_s) = replay(&path, threads)?;
            let number = |pointer: String| {
                let value = summary.pointer(&pointer).and_then(Value::as_f64);
                value.with_context(|| format!("the summary has no {pointer}"))
            };
            let of = |pointer: &str| number(pointer.to_owned());
            let times = STAGES.map(|stage| {
                let time = |q: &str| anyhow::Ok(number(format!("/stages/{stage}/{q}_us"))? / 1e3);
                anyhow::Ok(format!("{:.1}, {:.1}", time("p50")?, time("p99")?))
            });
            let times: Vec<String> = times.into_iter().collect::<Result<_, _>>()?;
            let duration_s = of("/duration_s")?;
            println!(
                "| {} | {threads} | {} | {:.0} | {:.1} | {:.1} | {} | {:.0} |",
                path.display(),
                of("/scans/mapped")?,
                of("/beams/in")? / duration_s,
                duration_s / processor_s,
                of("/realtime_factor")?,
                times.join("; "),
                of("/peak_rss_bytes")? / 1e6,
            );
        }
    }
    if let (Some(folder), Some(path)) = (
        env::var_os("FORESHORE_RAYS"),
        env::split_paths(&paths).next(),
    ) {
        let to = PathBuf::from(folder).join(FILE).with_extension("scan");
        write_rays(&path, &to)?;
    }
    Ok(())
}

/// The summary, and the processor time of all threads, seconds.
fn replay(path: &Path, threads: usize) -> anyhow::Result<(Value, f64)> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("summary.json");
    let started_s = children_processor_s();
    let status = Command::new(env!("CARGO_BIN_EXE_robot-edge"))
        .args(["--quiet", "replay", "--no-network", "--set"])
        .arg(format!("mapping.threads={threads}"))
        .arg("--summary")
        .args([file.as_path(), path])
        .status()
        .context("cannot start robot-edge")?;
    ensure!(status.success(), "{}: {status}", path.display());
    let processor_s = children_processor_s() - started_s;
    Ok((serde_json::from_reader(File::open(file)?)?, processor_s))
}

/// Writes the first revolutions as [`super::rays`] reads them.
fn write_rays(from: &Path, to: &Path) -> anyhow::Result<()> {
    let survey = Survey::of(from, None)?;
    let streams: Vec<_> = survey.streams.into_iter().map(|of| of.stream).collect();
    let mut pipeline = pipeline(&config::load("generic3d", &[])?, &streams)?;
    let mut reader = recording::open(from, Selection::All)?;
    let mut scans: Vec<RegisteredScan> = Vec::new();
    while scans.len() < REVOLUTIONS
        && let Some(measurement) = reader.next_measurement()?
    {
        scans.extend(pipeline.push(measurement)?);
    }
    let mut file = BufWriter::new(File::create(to)?);
    file.write_all(b"VXSCAN01")?;
    file.write_all(&(scans.len() as u32).to_le_bytes())?;
    file.write_all(&[0; 12])?;
    for scan in &scans {
        let first = scan.beams.first().context("a cloud without points")?;
        let points = scan.beams.iter().map(|beam| beam.end_in_odom);
        // Stamp and rotation are not read.
        file.write_all(&[0; 8])?;
        write_point(&mut file, first.origin_in_odom)?;
        file.write_all(&[0; 16])?;
        file.write_all(&(scan.beams.len() as u32).to_le_bytes())?;
        for point in points {
            write_point(&mut file, point)?;
        }
        let misses = scan
            .beams
            .iter()
            .map(|beam| beam.outcome == BeamOutcome::Miss);
        let flags: Vec<u8> = misses.map(u8::from).collect();
        file.write_all(&flags)?;
    }
    file.flush()?;
    println!("{} revolutions written to {}", scans.len(), to.display());
    Ok(())
}

fn write_point(file: &mut impl Write, point: Point3<f64>) -> io::Result<()> {
    let mut coordinates = point.iter();
    coordinates.try_for_each(|metres| file.write_all(&(*metres as f32).to_le_bytes()))
}
