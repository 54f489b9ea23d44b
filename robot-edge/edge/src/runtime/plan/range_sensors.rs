//! Assigns the scans of a recording to range sensors, and finds their mounting poses.

use super::pose_streams::{choose_one, describe_joints, name};
use crate::config::{Config, RangeSensor, TiltConfig};
use crate::exit::UsageError;
use crate::runtime::localization_plan::{PlannedSensor, range_sensors, wanted_sensors};
use crate::survey::Survey;
use crate::survey::range_sensors::Unassigned;
use crate::survey::topics::ScanSurvey;
use localization::registration::{MountOrigin, PoseOrigin};
use measurement::StreamId;

#[derive(Clone, Copy, Debug)]
pub(super) struct FoundSensor<'a> {
    pub(super) sensor: RangeSensor<'a>,
    pub(super) scans: &'a ScanSurvey,
}

/// The recorded sensors, in the order of their names, and the names of the others.
pub(super) fn find_sensors<'a>(
    survey: &'a Survey,
    config: &'a Config,
) -> Result<(Vec<FoundSensor<'a>>, Vec<&'a str>), UsageError> {
    let sensors = range_sensors(config)?;
    let assigned = survey
        .assign_scans(&wanted_sensors(&sensors))
        .map_err(|error| {
            let path = survey.path.display();
            UsageError(match error {
                Unassigned::NoScans => {
                    format!("{path}: {error}; `robot-edge info {path}` lists what it holds")
                }
                Unassigned::NoSuchStream { .. }
                | Unassigned::SeveralStreams { .. }
                | Unassigned::SeveralSensors { .. } => format!("{path}: {error}"),
            })
        })?;
    let (mut found, mut missing) = (Vec::new(), Vec::new());
    for (sensor, scans) in sensors.into_iter().zip(assigned) {
        match scans {
            Some(scans) => found.push(FoundSensor { sensor, scans }),
            None => missing.push(sensor.name),
        }
    }
    Ok((found, missing))
}

/// Chooses the mounting pose of each sensor if poses come from `origin`.
pub(super) fn place(
    survey: &Survey,
    found: &[FoundSensor<'_>],
    origin: &PoseOrigin,
    config: &Config,
) -> Result<Vec<PlannedSensor>, UsageError> {
    let is_alone = found.len() == 1;
    let plan = |found: &FoundSensor<'_>| {
        let FoundSensor { sensor, scans } = found;
        let mount = mount_origin(survey, found, origin, &config.localization.base_frame)?;
        let tilt = sensor
            .config
            .tilt
            .as_ref()
            .filter(|_| mount == MountOrigin::Configured && *origin != PoseOrigin::Log);
        let tilt_stream = match tilt {
            Some(tilt) => Some(tilt_stream(survey, sensor.name, tilt)?),
            None => None,
        };
        Ok(PlannedSensor {
            id: sensor.id,
            // A single sensor accepts every replayed scan.
            stream: (!is_alone).then_some(scans.stream),
            mount,
            tilt_stream,
            range_max_m: None,
        })
    };
    found.iter().map(plan).collect()
}

/// Transforms give the mounting pose if they lead to the map; for a tilting sensor, only if they move it.
fn mount_origin(
    survey: &Survey,
    found: &FoundSensor<'_>,
    origin: &PoseOrigin,
    base_frame: &str,
) -> Result<MountOrigin, UsageError> {
    let PoseOrigin::Tf { fixed_frame } = origin else {
        return Ok(MountOrigin::Configured);
    };
    let (frames, frame) = (&survey.frames, &*found.scans.frame);
    let is_placed = frames.is_ancestor(fixed_frame, frame);
    let is_tilted_elsewhere =
        found.sensor.config.tilt.is_some() && !frames.moves_in(frame, base_frame);
    if is_placed && !is_tilted_elsewhere {
        return Ok(MountOrigin::Tree);
    }
    if frames.is_ancestor(fixed_frame, base_frame) {
        return Ok(MountOrigin::Configured);
    }
    Err(UsageError(format!(
        "{}: no transforms lead from {frame:?}, the frame of {}, or from {base_frame:?} \
         (localization.base_frame) up to {fixed_frame:?}, in which the others are mapped",
        survey.path.display(),
        found.sensor.name
    )))
}

fn tilt_stream(survey: &Survey, sensor: &str, tilt: &TiltConfig) -> Result<StreamId, UsageError> {
    let with_joint = survey
        .joints
        .iter()
        .filter(|j| j.names.contains(&tilt.joint));
    let streams: Vec<_> = with_joint.map(|joints| joints.stream).collect();
    if !streams.is_empty() {
        let option = format!("--set sensors.{sensor}.tilt.topic=");
        let carried = format!("angles of {:?}", tilt.joint);
        return choose_one(survey, &option, &carried, &streams, tilt.topic.as_deref());
    }
    let there_are = match describe_joints(survey) {
        none if none.is_empty() => "there are no joint angles (sensor_msgs/JointState)".to_owned(),
        joints => joints,
    };
    Err(UsageError(format!(
        "{}: nothing says how far {sensor} was tilted: no topic has the joint {:?}, which \
         sensors.{sensor}.tilt.joint names: {there_are}",
        survey.path.display(),
        tilt.joint
    )))
}

/// "the laser", "the laser and the sonar".
pub(super) fn join_names(found: &[FoundSensor<'_>]) -> String {
    let named: Vec<_> = found
        .iter()
        .map(|found| format!("the {}", found.sensor.name))
        .collect();
    match &named[..] {
        [] => String::new(),
        [one] => one.clone(),
        [others @ .., last] => format!("{} and {last}", others.join(", ")),
    }
}

/// Notes about tilting sensors.
pub(super) fn tilt_notes(
    survey: &Survey,
    found: &[FoundSensor<'_>],
    planned: &[PlannedSensor],
) -> Vec<String> {
    let tilted = found.iter().zip(planned).filter_map(|(found, planned)| {
        let joint = &found.sensor.config.tilt.as_ref()?.joint;
        let topic = name(survey, planned.tilt_stream?);
        let sensor = found.sensor.name;
        Some(format!("{sensor}: tilted as {topic} says of joint {joint}"))
    });
    tilted.collect()
}
