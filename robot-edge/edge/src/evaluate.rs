//! The command `evaluate`: a trajectory against relations between its poses.

use std::collections::BTreeMap;
use std::fs;
use std::io::Write;
use std::path::Path;

use anyhow::Context as _;
use nalgebra::{Isometry2, Vector2};

use crate::cli::EvaluateRelations;
use crate::exit::{Exit, UsageError};
use localization::scan_matching::relations::{Relation, Spread};
use measurement::pose::{self, Pose};
use measurement::time::{RobotDuration, RobotTime};

/// A relation's pose is that of the trajectory with the nearest stamp, up to this time from it.
const TOLERANCE: RobotDuration = RobotDuration::from_millis(50);

/// Prints mean and standard deviation of the errors of translation and rotation, for each kind of relations in the file.
pub(crate) fn relations(command: &EvaluateRelations, out: &mut dyn Write) -> anyhow::Result<Exit> {
    let poses = read_trajectory(&command.trajectory)?;
    let text = read(&command.relations)?;
    let nearest = |stamp: RobotTime| {
        let after = poses.range(stamp..).next();
        let before = poses.range(..stamp).next_back();
        let distance = |(own, _): &(&RobotTime, &Isometry2<f64>)| own.since(stamp).as_nanos().abs();
        let nearest = after.into_iter().chain(before).min_by_key(distance)?;
        (distance(&nearest) <= TOLERANCE.as_nanos()).then_some(nearest.1)
    };
    let mut errors: BTreeMap<&str, Vec<(f64, f64)>> = BTreeMap::new();
    let mut without = 0_u64;
    for relation in text.lines().filter_map(Relation::parse) {
        let kind = match relation.remarks.last().map(String::as_str) {
            Some("c") => "consecutive",
            Some("r") => "revisited",
            _ => "all",
        };
        let [first, second] = relation.stamps.map(nearest);
        match first.zip(second) {
            Some((first, second)) => {
                let of_kind = errors.entry(kind).or_default();
                of_kind.push(relation.error(first, second));
            }
            None => without += 1,
        }
    }
    if errors.is_empty() {
        return Err(UsageError(format!(
            "{}: none of its relations is between poses of {} ({without} are between others): a line is two stamps in seconds, x, y, z, \
             roll, pitch, yaw",
            command.relations.display(),
            command.trajectory.display()
        ))
        .into());
    }
    for (kind, errors) in errors {
        let m = Spread::of(&errors.iter().map(|error| error.0).collect::<Vec<_>>());
        let rad = Spread::of(&errors.iter().map(|error| error.1).collect::<Vec<_>>());
        writeln!(
            out,
            "{kind}: {} relations, {:.4} ± {:.4} m, {:.3} ± {:.3}°",
            m.count,
            m.mean,
            m.deviation,
            rad.mean.to_degrees(),
            rad.deviation.to_degrees()
        )?;
    }
    if without > 0 {
        writeln!(out, "{without} relations have no pose within 0.05 s")?;
    }
    Ok(Exit::Done)
}

fn read(path: &Path) -> anyhow::Result<String> {
    fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()))
}

/// Poses of a TUM file, seen from above.
fn read_trajectory(path: &Path) -> anyhow::Result<BTreeMap<RobotTime, Isometry2<f64>>> {
    let text = read(path)?;
    let lines = text.lines().enumerate();
    let lines = lines.filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
    lines
        .map(|(at, line)| {
            pose_of(line).ok_or_else(|| {
                UsageError(format!(
                    "{}, line {}: this is no pose of a TUM file: `stamp x y z qx qy qz qw`",
                    path.display(),
                    at + 1
                ))
                .into()
            })
        })
        .collect()
}

fn pose_of(line: &str) -> Option<(RobotTime, Isometry2<f64>)> {
    let fields = line.split_ascii_whitespace().map(str::parse::<f64>);
    let fields: Vec<f64> = fields.collect::<Result<_, _>>().ok()?;
    let &[stamp_s, x, y, z, qx, qy, qz, qw, ..] = &fields[..] else {
        return None;
    };
    let pose: Pose = pose::from_parts([x, y, z], [qx, qy, qz, qw])?;
    let yaw_rad = pose::yaw_rad(&pose);
    Some((
        RobotTime::from_secs_f64(stamp_s)?,
        Isometry2::new(Vector2::new(x, y), yaw_rad),
    ))
}
