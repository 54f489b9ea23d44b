//! The octree beside `OctoMap`, on the same rays: `$FORESHORE_RAYS` names the folder of `introbot.scan` and
//! `riverwatch.scan`, and of the revolutions that [`clouds`] writes, `$FORESHORE_OCTOMAP` a program that feeds such a file to `OctoMap` and is called with
//! `FILE RESOLUTION MAX_RANGE base|lazy SCANS VOXELS.txt`. Format: `VXSCAN01`, little-endian; see [`Rays::read`].
//!
//! Every system runs in a process of its own, so that its peak memory is its own, and one after the other.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

use anyhow::{Context as _, bail, ensure};
use edge::summary::peak_rss_bytes;
use mapping::octree::{Octree, Ray};
use mapping::octree::{OctreeConfig, RangeSensorModel};
use mapping::registered_scan::SensorId;
use nalgebra::Point3;
use serde_json::Value;

use super::clouds;
use super::rounds::{timed, timed_by_the_wall};

/// First argument of a process that measures one map.
pub(crate) const CHILD: &str = "octree-of-rays";

/// What is measured.
struct Case {
    file: &'static str,
    cell_m: f64,
    range_m: f64,
    /// Scans for both.
    both: usize,
    /// How `OctoMap` takes them.
    variants: &'static [&'static str],
    /// Scans for the octree alone.
    all: usize,
}

const CASES: [Case; 4] = [
    Case {
        file: "introbot",
        cell_m: 0.1,
        range_m: 20.0,
        both: 1500,
        variants: &["lazy", "base"],
        all: 1500,
    },
    Case {
        file: "riverwatch",
        cell_m: 0.3,
        range_m: 60.0,
        both: 600,
        variants: &["base"],
        all: 600,
    },
    Case {
        file: "riverwatch",
        cell_m: 0.3,
        range_m: 250.0,
        both: 40,
        variants: &["lazy", "base"],
        all: 600,
    },
    Case {
        file: clouds::FILE,
        cell_m: 0.1,
        range_m: 100.0,
        both: clouds::REVOLUTIONS,
        variants: &["lazy", "base"],
        all: clouds::REVOLUTIONS,
    },
];

pub(crate) fn print() -> anyhow::Result<()> {
    println!("octree and OctoMap, same rays; hit 0.7, miss 0.4, clamped to 0.1192 … 0.971");
    let Some(rays) = env::var_os("FORESHORE_RAYS").map(PathBuf::from) else {
        println!("  skipped: FORESHORE_RAYS names no folder");
        return Ok(());
    };
    let octomap = env::var_os("FORESHORE_OCTOMAP").map(PathBuf::from);
    println!(
        "| rays | system | scans | scans/s | ns per beam | map MB | bytes per known voxel | peak MB |"
    );
    println!("| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |");
    for case in &CASES {
        let path = rays.join(case.file).with_extension("scan");
        if !path.exists() {
            println!("| {}: no such file | | | | | | | |", path.display());
            continue;
        }
        let scratch = tempfile::tempdir()?;
        let scans = case.both;
        let ours = scratch.path().join("ours.txt");
        let mut runs = vec![
            ("one thread", case.all, 1),
            ("two threads, elapsed", case.all, 2),
        ];
        if scans != case.all {
            runs.push(("one thread", scans, 1));
        }
        for (name, scans, threads) in runs {
            let figures = measured(&path, case, scans, threads, &ours)?;
            row(case, name, &figures);
        }
        for (octomap, variant) in octomap
            .iter()
            .flat_map(|octomap| case.variants.iter().map(move |variant| (octomap, variant)))
        {
            let theirs = scratch.path().join("theirs.txt");
            let mut command = Command::new(octomap);
            command
                .arg(&path)
                .args([case.cell_m, case.range_m].map(|value| value.to_string()));
            command.arg(variant).arg(scans.to_string()).arg(&theirs);
            row(case, &format!("OctoMap {variant}"), &json_of(command)?);
            println!("{}", agreement(&theirs, &ours)?);
        }
    }
    Ok(())
}

fn measured(
    path: &Path,
    case: &Case,
    scans: usize,
    threads: usize,
    voxels: &Path,
) -> anyhow::Result<Value> {
    let mut command = Command::new(env::current_exe()?);
    command
        .arg(CHILD)
        .arg(path)
        .args([case.cell_m, case.range_m].map(|value| value.to_string()));
    command
        .args([scans, threads].map(|value| value.to_string()))
        .arg(voxels);
    json_of(command)
}

fn json_of(mut command: Command) -> anyhow::Result<Value> {
    let output = command
        .output()
        .with_context(|| format!("{command:?} does not start"))?;
    ensure!(
        output.status.success(),
        "{command:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    Ok(serde_json::from_slice(&output.stdout)?)
}

fn row(case: &Case, name: &str, figures: &Value) {
    let number = |key: &str| figures[key].as_f64().unwrap_or(f64::NAN);
    let known = number("occupied") + number("free");
    println!(
        "| {} {} m, {} m | {name} | {} | {:.1} | {:.0} | {:.1} | {:.2} | {:.0} |",
        case.file,
        case.cell_m,
        case.range_m,
        number("scans"),
        number("scans_per_s"),
        number("ns_per_beam"),
        number("map_bytes") / 1e6,
        number("map_bytes") / known,
        number("peak_rss_kb") / 1e3
    );
}

/// Measures one map and prints its figures as one line of JSON.
pub(crate) fn child(arguments: &[String]) -> anyhow::Result<()> {
    let [path, cell_m, range_m, scans, threads, voxels] = arguments else {
        bail!("{CHILD} FILE RESOLUTION MAX_RANGE SCANS THREADS VOXELS.txt");
    };
    let (cell_m, threads) = (cell_m.parse()?, threads.parse()?);
    let rays = Rays::read(Path::new(path), range_m.parse()?, scans.parse()?)?;
    let config = OctreeConfig {
        enabled: true,
        cell_m,
        p_min: 0.1192,
        p_max: 0.971,
        memory_limit_mb: 65536,
        ..OctreeConfig::default()
    };
    let model = RangeSensorModel {
        p_hit: 0.7,
        p_miss: 0.4,
        ..RangeSensorModel::default()
    };
    let _pool = (threads > 1).then(|| pool(threads)).transpose()?;
    let mut octree = Octree::new(&config, &[model], threads);
    let is_cloud = Path::new(path)
        .file_stem()
        .is_some_and(|stem| stem == clouds::FILE);
    let mut integrate = || {
        for scan in &rays.scans {
            let rays = scan.iter().copied();
            if is_cloud {
                octree.integrate_cloud(SensorId(0), rays);
            } else {
                octree.integrate(SensorId(0), rays);
            }
        }
    };
    // Of two threads it is the time that passes that counts.
    let ((), seconds) = if threads == 1 {
        timed(&mut integrate)
    } else {
        timed_by_the_wall(&mut integrate)
    };
    let counts = octree.counts();
    let beams: usize = rays.scans.iter().map(Vec::len).sum();
    let peak_kb = peak_rss_bytes().unwrap_or(0) / 1000;
    write_voxels(&octree, Path::new(voxels))?;
    println!(
        "{}",
        serde_json::json!({
            "scans": rays.scans.len(),
            "scans_per_s": rays.scans.len() as f64 / seconds,
            "ns_per_beam": seconds * 1e9 / beams as f64,
            "map_bytes": octree.bytes(),
            "peak_rss_kb": peak_kb,
            "occupied": counts.occupied,
            "free": counts.free,
        })
    );
    Ok(())
}

/// As the program has it: this thread is one of those that share the work.
pub(super) fn pool(threads: usize) -> anyhow::Result<rayon::ThreadPool> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    Ok(pool.use_current_thread().build()?)
}

/// One line `x y z occupied` for each known voxel, as the other program writes it.
fn write_voxels(octree: &Octree, path: &Path) -> anyhow::Result<()> {
    use std::io::Write as _;
    let mut out = std::io::BufWriter::new(fs::File::create(path)?);
    for block in octree.known_blocks(|least| least) {
        let least = block.least;
        for (brick, voxels) in (0_i32..).zip(block.bricks) {
            for n in (0..64).filter(|n| voxels.known >> n & 1 == 1) {
                let along = |axis: i32| (brick >> (2 * axis) & 3) << 2 | n >> (2 * axis) & 3;
                let (x, y, z) = (least.x + along(0), least.y + along(1), least.z + along(2));
                writeln!(out, "{x} {y} {z} {}", voxels.occupied >> n & 1)?;
            }
        }
    }
    Ok(out.flush()?)
}

/// Of all voxels known to either, those that both call the same; and the Jaccard index of the occupied ones.
fn agreement(theirs: &Path, ours: &Path) -> anyhow::Result<String> {
    let (theirs, ours) = (read_voxels(theirs)?, read_voxels(ours)?);
    let (mut same, mut both_known, mut both_occupied) = (0_usize, 0_usize, 0_usize);
    for (voxel, is_occupied) in &theirs {
        if let Some(own) = ours.get(voxel) {
            both_known += 1;
            same += usize::from(own == is_occupied);
            both_occupied += usize::from(*own && *is_occupied);
        }
    }
    let either_known = theirs.len() + ours.len() - both_known;
    let occupied = |voxels: &BTreeMap<u64, bool>| voxels.values().filter(|is| **is).count();
    let either_occupied = occupied(&theirs) + occupied(&ours) - both_occupied;
    Ok(format!(
        "|  | agreement | | {:.4} % of {either_known} voxels known to either | J {:.5} of {either_occupied} occupied | | | |",
        100.0 * same as f64 / either_known as f64,
        both_occupied as f64 / either_occupied as f64
    ))
}

fn read_voxels(path: &Path) -> anyhow::Result<BTreeMap<u64, bool>> {
    let text = fs::read_to_string(path)?;
    let line = |line: &str| {
        let mut fields = line.split_ascii_whitespace().map(str::parse::<i64>);
        let mut next = || fields.next()?.ok();
        let (x, y, z, occupied) = (next()?, next()?, next()?, next()?);
        let part = |at: i64| (at + (1 << 20)) as u64 & ((1 << 21) - 1);
        Some((part(x) << 42 | part(y) << 21 | part(z), occupied == 1))
    };
    text.lines()
        .map(|text| line(text).with_context(|| format!("{text:?}")))
        .collect()
}

/// The rays of a file: a beam without a return is moved to 1.01 of the greatest range, and every beam is cut at the
/// range of the map.
struct Rays {
    scans: Vec<Vec<Ray>>,
}

impl Rays {
    /// `char[8] "VXSCAN01"; u32 scans, beams a scan; f32 range, 0`, then for each scan `f64 stamp; f32 origin[3],
    /// quaternion wxyz[4]; u32 n; f32 xyz[3n]; u8 flag[n]`, of which 0 is a hit. Packed.
    fn read(path: &Path, range_m: f64, most: usize) -> anyhow::Result<Self> {
        let bytes = fs::read(path).with_context(|| path.display().to_string())?;
        let mut rest = bytes
            .strip_prefix(b"VXSCAN01")
            .context("not a file of rays")?;
        let scans = u32::from_le_bytes(take(&mut rest)?) as usize;
        let _beams_and_range: [u8; 12] = take(&mut rest)?;
        let scan = |rest: &mut &[u8]| -> anyhow::Result<Vec<Ray>> {
            let _stamp: [u8; 8] = take(rest)?;
            let origin = point(rest)?;
            let _rotation: [u8; 16] = take(rest)?;
            let n = u32::from_le_bytes(take(rest)?) as usize;
            let ends: Vec<Point3<f64>> = (0..n).map(|_| point(rest)).collect::<Result<_, _>>()?;
            let (flags, after) = rest.split_at_checked(n).context("cut off")?;
            *rest = after;
            Ok(ends
                .into_iter()
                .zip(flags)
                .map(|(end, &flag)| cut(origin, end, flag == 0, range_m))
                .collect())
        };
        let scans = (0..scans.min(most))
            .map(|_| scan(&mut rest))
            .collect::<Result<_, _>>()?;
        Ok(Self { scans })
    }
}

fn cut(origin: Point3<f64>, end: Point3<f64>, is_return: bool, range_m: f64) -> Ray {
    let beam = (end - origin) * if is_return { 1.0 } else { 1.01 };
    let length_m = beam.norm();
    let is_hit = is_return && length_m <= range_m;
    let end = origin + beam * (range_m / length_m).min(1.0);
    Ray {
        origin,
        end,
        is_hit,
    }
}

fn point(rest: &mut &[u8]) -> anyhow::Result<Point3<f64>> {
    let mut next = || -> anyhow::Result<f64> { Ok(f32::from_le_bytes(take(rest)?).into()) };
    Ok(Point3::new(next()?, next()?, next()?))
}

fn take<const N: usize>(rest: &mut &[u8]) -> anyhow::Result<[u8; N]> {
    let (taken, after) = rest.split_first_chunk().context("cut off")?;
    *rest = after;
    Ok(*taken)
}
