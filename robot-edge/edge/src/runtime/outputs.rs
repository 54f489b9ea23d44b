//! The outputs of a run: maps, trajectory, summary.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;

use anyhow::Context as _;
use protocol::export::{
    Caption, Footprint, StampedPose, Trinary, export_all, shore_labels, write_covariances,
    write_path, write_shores, write_trajectory,
};
use protocol::layer::LayerId;
use protocol::tile_store::TileStore;

use super::maps::Maps;
use super::pipeline::Pipeline;
use super::source::SourceLosses;
use super::source_reader::SourceEnd;
use crate::cli::MappingOptions;
use crate::events::merge_alike;
use crate::exit::UsageError;
use crate::export::voxels::{export_voxels, voxel_digest};
use crate::publishing::publisher::Publisher;
use crate::ros2::Drops;
use crate::summary::{
    Beams, Event, LayerFigures, ScanMatching, Scans, Summary, Tiles, Voxels, peak_rss_bytes,
};
use crate::survey::recover_advice;
use localization::scan_localization::ScanLocalizationReport;
use mapping::vehicle::VehicleConfig;
use measurement::drops::{DropCounts, DropReason};
use recording::{Format, name_missing};

/// Writes the maps and the trajectory to `dir`, each even if another one fails. Returns the file names.
pub(super) fn export(
    dir: &Path,
    pipeline: &Pipeline,
    trajectory: &[StampedPose],
    (title, vehicle): (&str, &VehicleConfig),
) -> anyhow::Result<Vec<String>> {
    let maps = &pipeline.mapping.maps;
    let shores = maps.shores();
    let labels = shores.as_ref().map(shore_labels).unwrap_or_default();
    let caption = Caption {
        title,
        vehicle_m: Some(vehicle_position_m(pipeline)),
        path: trajectory,
        footprint: Some(footprint(vehicle)),
        datum: pipeline.localization.registration.datum(),
        labels: &labels,
    };
    let exported = export_all(dir, &maps.publisher().store(), &caption);
    let path = dir.join("trajectory.tum");
    write_trajectory(&path, trajectory.iter().copied())?;
    let voxels = maps
        .mapper()
        .voxels()
        .map(|voxels| export_voxels(dir, voxels.octree(), &maps.publisher().store()))
        .transpose();
    let mut files = exported?.files;
    files.push(path);
    files.push(write_path(dir, trajectory, caption.datum)?);
    let covariances = pipeline.localization.registration.covariances();
    if !covariances.is_empty() {
        let path = dir.join("trajectory_covariance.txt");
        let rows = covariances.iter().map(|(stamp, of)| {
            let parts = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
            (stamp.as_nanos(), parts.map(|at| of[at]))
        });
        write_covariances(&path, rows)?;
        files.push(path);
    }
    if let Some(shores) = shores {
        files.push(write_shores(dir, &shores)?);
    }
    let mut lines: Vec<_> = files
        .iter()
        .map(|file| file.display().to_string())
        .collect();
    if let Some(voxels) = voxels? {
        lines.extend(voxels.files.iter().map(|file| file.display().to_string()));
        if voxels.voxels_omitted > 0 {
            lines.push(format!(
                "voxels.bt lacks {} voxels that lie farther from odom's origin than an OctoMap reaches",
                voxels.voxels_omitted
            ));
        }
    }
    Ok(lines)
}

/// The footprint as published.
fn footprint(vehicle: &VehicleConfig) -> Footprint {
    let published = |length_m: f64| f64::from(length_m as f32);
    Footprint {
        length_m: published(vehicle.length_m),
        width_m: published(vehicle.width_m),
        offset_m: published(vehicle.footprint_offset_m),
    }
}

/// The vehicle position as published, so that exported pictures equal those of consoles.
fn vehicle_position_m(pipeline: &Pipeline) -> [f64; 2] {
    let maps = &pipeline.mapping.maps;
    let newest = pipeline.localization.registration.newest_pose();
    let [x, y, _] = match newest.filter(|(stamp, _)| Some(*stamp) >= maps.last_scan()) {
        Some((_, pose)) => (maps.map_from_odom() * pose).translation.vector.into(),
        None => maps.mapper().vehicle_in_odom().coords.into(),
    };
    [x, y]
}

/// Kind of events that report decisions before the run.
pub(super) const SETUP: &str = "setup";

/// The figures of the run that do not depend on its command.
pub(super) fn summary(pipeline: &Pipeline) -> Summary {
    let maps = &pipeline.mapping.maps;
    let registration = pipeline.localization.registration.counts();
    let report = maps.report();
    let traffic = maps.publisher().traffic();
    let mut dropped_scans = registration.dropped_scans;
    dropped_scans.merge(&report.dropped_scans);
    let mut dropped_beams = registration.dropped_beams;
    dropped_beams.merge(&report.dropped_beams);
    let stages = [
        ("localization", &pipeline.localization.timer),
        ("mapping", &report.mapping_time),
        ("publish", &report.publish_time),
    ];
    let mut summary = Summary {
        scans: Scans {
            came_in: registration.scans_in,
            mapped: report.scans_mapped,
            dropped: dropped_scans,
        },
        beams: Beams {
            came_in: registration.beams_in,
            hits: report.hits,
            misses: report.misses,
            dropped: dropped_beams,
        },
        losses: registration.dropped_poses,
        stages: stages
            .map(|(name, timer)| (name.to_owned(), timer.times()))
            .into(),
        layers: layers(maps),
        voxels: voxels(maps),
        tiles: Tiles {
            published: traffic.published,
            bytes: traffic.bytes,
            raw_bytes: traffic.raw_bytes,
        },
        scan_matching: pipeline
            .localization
            .registration
            .scan_localization()
            .map(scan_matching),
        peak_rss_bytes: peak_rss_bytes(),
        ..Summary::default()
    };
    summary.add_evictions(maps.publisher());
    summary
}

fn scan_matching(report: ScanLocalizationReport) -> ScanMatching {
    let last = report.newest.map(|(_, pose)| pose);
    ScanMatching {
        determined: report.full,
        uncertain_along: report.uncertain_along,
        odometry_only: report.odometry_only,
        lost: report.lost,
        dropped: report.dropped,
        closures: report.closures.added,
        closures_removed: report.closures.removed,
        positions: report.positions.0,
        positions_contradicted: report.positions.1,
        is_searching: report.is_searching,
        last_covariance: last.map(|pose| pose.covariance.transpose().into()),
        last_residual_m: last.map(|pose| pose.residual_m),
    }
}

impl Summary {
    pub(super) fn add_source_end(&mut self, end: &SourceEnd, interrupted: bool) {
        let SourceLosses {
            counts,
            late_scans,
            stamp_repairs,
            notes,
        } = &end.lost;
        let path = Path::new(&self.recording);
        let format = Format::of(path).ok();
        let advice = format.and_then(|format| recover_advice(format, counts, path));
        // Late scans were received, but could not be ordered.
        self.scans.came_in += late_scans;
        self.scans.dropped.add_many(DropReason::Late, *late_scans);
        self.losses.merge(counts);
        for (reason, n) in counts.iter() {
            self.add_event("loss", format!("the recording lost {n} × {reason}"));
        }
        for note in notes.iter().chain(&advice) {
            self.add_event("note", note.clone());
        }
        if *stamp_repairs > 0 {
            self.add_event(
                "stamps",
                format!(
                    "{stamp_repairs} stamps contradicted the order of the log and were changed"
                ),
            );
        }
        let skipped = end.skipped;
        if skipped.gaps + skipped.steps_back > 0 {
            let secs = skipped.gap_time.as_secs_f64();
            let (gaps, back) = (skipped.gaps, skipped.steps_back);
            self.add_event(
                "pause",
                format!("{gaps} gaps of {secs:.0} s in all and {back} steps back in the stamps were not waited for"),
            );
        }
        if skipped.lags > 0 {
            self.add_event(
                "lag",
                format!(
                    "{} times mapping could not keep up with the rate",
                    skipped.lags
                ),
            );
        }
        if interrupted {
            self.add_event("interrupted", "stopped before the end".to_owned());
        }
    }

    pub(super) fn add_recorder_notes(&mut self, notes: Vec<String>) {
        for note in notes {
            self.add_event("record", note);
        }
    }

    pub(super) fn add_ros_drops(&mut self, drops: &Drops) {
        for ((topic, reason), count) in drops {
            self.add_event("ros2_output", format!("{topic}: {count} {reason}"));
        }
    }

    pub(super) fn add_goals(&mut self, happened: Vec<String>) {
        for message in happened {
            self.add_event("goal", message);
        }
    }

    fn add_evictions(&mut self, publisher: &Publisher) {
        let mapping = publisher.traffic().evicted_from_mapping;
        let store = publisher.store().counters();
        if mapping > 0 {
            self.add_event(
                "evicted",
                format!("{mapping} tiles left the mapping memory (mapping.occupancy.memory_limit_mb); exports hold them"),
            );
        }
        if store.tiles_evicted > 0 {
            self.add_event(
                "evicted",
                format!(
                    "{} tiles left the tile store (streaming.tile_store_mb) and are in no export",
                    store.tiles_evicted
                ),
            );
        }
    }

    fn add_event(&mut self, kind: &str, message: String) {
        self.events.push(Event {
            stamp_s: None,
            kind: kind.to_owned(),
            message,
        });
    }
}

pub(super) fn print_summary(
    summary: &Summary,
    files: &[String],
    out: &mut dyn Write,
) -> io::Result<()> {
    // Decisions were printed before the run.
    let events = summary.events.iter().filter(|event| event.kind != SETUP);
    let events: Vec<_> = events
        .map(|event| format!("{}: {}", event.kind, event.message))
        .collect();
    for line in merge_alike(events.iter().map(String::as_str)) {
        writeln!(out, "{line}")?;
    }
    let scans = &summary.scans;
    write!(out, "{} of {} scans mapped", scans.mapped, scans.came_in)?;
    print_drops(&scans.dropped, out)?;
    write!(out, "; {} beams", summary.beams.came_in)?;
    print_drops(&summary.beams.dropped, out)?;
    writeln!(
        out,
        "; {:.1} s of data in {:.2} s",
        summary.duration_s, summary.wall_s
    )?;
    for (name, layer) in &summary.layers {
        writeln!(
            out,
            "{name}: {} cells known, digest {}",
            layer.cells_known, layer.digest
        )?;
    }
    if let Some(voxels) = &summary.voxels {
        writeln!(
            out,
            "voxels: {} occupied, {} free, digest {}",
            voxels.occupied, voxels.free, voxels.digest
        )?;
    }
    for file in files {
        writeln!(out, "{file}")?;
    }
    if files.is_empty() && summary.scans.mapped > 0 {
        writeln!(
            out,
            "no picture was written: --export FOLDER writes the maps as pictures and for GIS and ROS"
        )?;
    }
    Ok(())
}

fn print_drops(drops: &DropCounts, out: &mut dyn Write) -> io::Result<()> {
    let reasons: Vec<_> = drops
        .iter()
        .map(|(reason, n)| format!("{n} {reason}"))
        .collect();
    if reasons.is_empty() {
        Ok(())
    } else {
        write!(out, " (dropped: {})", reasons.join(", "))
    }
}

fn layers(maps: &Maps) -> BTreeMap<String, LayerFigures> {
    let store = maps.publisher().store();
    let grids = store.grids();
    grids
        .map(|grid| {
            let layer = grid.layer;
            let figures = LayerFigures {
                cells_known: store.cells_known(layer),
                counts: counts(&store, layer),
                digest: store
                    .root_digest(layer)
                    .map(|digest| digest.to_string())
                    .unwrap_or_default(),
                bytes: store.bytes(layer),
            };
            (layer.name().to_owned(), figures)
        })
        .collect()
}

fn voxels(maps: &Maps) -> Option<Voxels> {
    let octree = maps.mapper().voxels()?.octree();
    let counts = octree.counts();
    Some(Voxels {
        occupied: counts.occupied,
        free: counts.free,
        bytes: octree.bytes() as u64,
        disk_bricks: maps.report().limited.on_disk,
        coarse_bricks: maps.report().limited.coarse,
        evicted_bricks: maps.report().limited.removed,
        digest: voxel_digest(octree),
    })
}

/// Cells by class; for occupancy the three classes of Nav2's `map_server`.
fn counts(store: &TileStore, layer: LayerId) -> BTreeMap<String, u64> {
    if layer == LayerId::Occupancy {
        let mut counts = BTreeMap::new();
        let quantisation = layer.quantisation();
        let cells = store.tiles(layer).filter_map(|(_, tile)| tile.cells());
        for code in cells.flat_map(|cells| cells.codes().iter().copied()) {
            if let Some(p) = quantisation.decode(code) {
                *counts.entry(Trinary::of(p).name().to_owned()).or_default() += 1;
            }
        }
        return counts;
    }
    store
        .class_counts(layer)
        .into_iter()
        .map(|(name, count)| (name.to_owned(), count))
        .collect()
}

/// Refuses outputs that would overwrite the recording.
pub(super) fn check_not_source(
    recording: &Path,
    options: &MappingOptions,
) -> Result<(), UsageError> {
    for (option, output) in [
        ("--record", &options.record),
        ("--summary", &options.summary),
    ] {
        if let Some(output) = output
            && is_same_file(recording, output)
        {
            return Err(UsageError(format!(
                "{}: {option} names the recording that is replayed: name another file",
                output.display()
            )));
        }
    }
    Ok(())
}

/// Creates the export folder, and checks that it and the summary can be written.
pub(super) fn prepare(export: Option<&Path>, summary: Option<&Path>) -> anyhow::Result<()> {
    if let Some(dir) = export {
        fs::create_dir_all(dir)
            .with_context(|| format!("{}: cannot make the folder to export to", dir.display()))?;
        try_folder(dir).with_context(|| format!("{}: cannot write the maps", dir.display()))?;
    }
    if let Some(path) = summary {
        try_file(path)
            .map_err(|error| name_missing(path, error))
            .with_context(|| format!("{}: cannot write the summary", path.display()))?;
    }
    Ok(())
}

/// Checks that a temporary file can be created beside `path`.
fn try_file(path: &Path) -> io::Result<()> {
    match fs::metadata(path) {
        Ok(existing) if existing.is_dir() => Err(io::ErrorKind::IsADirectory.into()),
        // Pipes and terminals are written directly; a check would already be output.
        Ok(existing) if !existing.is_file() => Ok(()),
        Ok(_) | Err(_) => match path.parent() {
            Some(folder) if folder != Path::new("") => try_folder(folder),
            Some(_) | None => try_folder(Path::new(".")),
        },
    }
}

fn try_folder(folder: &Path) -> io::Result<()> {
    let trial = folder.join(format!(".robot-edge.{}.tmp", std::process::id()));
    File::create_new(&trial)?;
    fs::remove_file(&trial)
}

/// Whether both paths are the same file, including links.
#[cfg(unix)]
fn is_same_file(one: &Path, other: &Path) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    let identity = |path: &Path| fs::metadata(path).map(|data| (data.dev(), data.ino())).ok();
    identity(one).is_some_and(|one| identity(other) == Some(one))
}

/// Whether both paths are the same file; hard links are not detected.
#[cfg(not(unix))]
fn is_same_file(one: &Path, other: &Path) -> bool {
    let identity = |path: &Path| fs::canonicalize(path).ok();
    identity(one).is_some_and(|one| identity(other) == Some(one))
}
