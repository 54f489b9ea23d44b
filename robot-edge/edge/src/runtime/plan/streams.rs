//! Chooses the streams of range sensors and of the sensors that poses are computed from.

use crate::config::{Config, GpsConfig, ImuConfig, RangeSensor, TiltConfig, WheelEncodersConfig};
use crate::exit::UsageError;
use crate::runtime::choice::{Choice, ChoiceNeeded};
use crate::runtime::localization_plan::{PlannedSensor, range_sensors};
use crate::survey::Survey;
use crate::survey::range_sensors::Unassigned;
use crate::survey::topics::ScanSurvey;
use localization::registration::{MountOrigin, PoseOrigin};
use measurement::StreamId;

#[derive(Clone, Copy, Debug)]
pub(super) struct FoundSensor<'a> {
    pub(super) sensor: RangeSensor<'a>,
    pub(super) stream: StreamId,
    /// Frame of its messages; empty where they have none.
    pub(super) frame: &'a str,
    /// `None` if it does not sweep.
    pub(super) scans: Option<&'a ScanSurvey>,
}

/// The recorded sensors, in the order of their names, and the names of the others.
pub(super) fn find_sensors<'a>(
    survey: &'a Survey,
    config: &'a Config,
) -> anyhow::Result<(Vec<FoundSensor<'a>>, Vec<&'a str>)> {
    let sensors = range_sensors(config)?;
    let assigned = survey
        .assign(&sensors)
        .map_err(|unassigned| explain(survey, &unassigned))?;
    let (mut found, mut missing) = (Vec::new(), Vec::new());
    for (sensor, stream) in sensors.into_iter().zip(assigned) {
        let Some(stream) = stream else {
            missing.push(sensor.name);
            continue;
        };
        let scans = of_stream(&survey.scans, stream);
        let frame = scans
            .map(|scans| &scans.frame)
            .or_else(|| of_stream(&survey.range_frames, stream));
        found.push(FoundSensor {
            sensor,
            stream,
            frame: frame.map_or("", |frame| frame),
            scans,
        });
    }
    Ok((found, missing))
}

fn of_stream<T>(known: &[(StreamId, T)], stream: StreamId) -> Option<&T> {
    let (_, of) = known.iter().find(|(of, _)| *of == stream)?;
    Some(of)
}

fn explain(survey: &Survey, unassigned: &Unassigned) -> anyhow::Error {
    let path = survey.path.display();
    let choice = |sensor: &String, stream: &String, label: String| {
        Choice::new(label, &format!("--topic {sensor}="), stream)
    };
    let (question, choices): (_, Vec<_>) = match unassigned {
        Unassigned::NoScans => {
            return UsageError(format!(
                "{path}: {unassigned}; `robot-edge info {path}` lists what it holds"
            ))
            .into();
        }
        Unassigned::NoSuchStream {
            sensor, streams, ..
        }
        | Unassigned::SeveralStreams { sensor, streams } => {
            let choices = streams.iter();
            let choices = choices.filter_map(|stream| choice(sensor, stream, stream.clone()));
            (format!("Which topic is the {sensor}?"), choices.collect())
        }
        Unassigned::SeveralSensors { sensors, streams } => {
            let pairs = sensors
                .iter()
                .flat_map(|sensor| streams.iter().map(move |stream| (sensor, stream)));
            let choices = pairs.filter_map(|(sensor, stream)| {
                choice(sensor, stream, format!("{stream} is the {sensor}"))
            });
            ("Whose scans are these?".to_owned(), choices.collect())
        }
    };
    ChoiceNeeded {
        message: format!("{path}: {unassigned}"),
        question,
        choices,
    }
    .into()
}

/// Chooses the mounting pose of each sensor if poses come from `origin`.
pub(super) fn place(
    survey: &Survey,
    found: &[FoundSensor<'_>],
    origin: &PoseOrigin,
    config: &Config,
) -> anyhow::Result<Vec<PlannedSensor>> {
    let is_alone = found.len() == 1;
    let plan = |found: &FoundSensor<'_>| {
        let sensor = &found.sensor;
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
            stream: (!is_alone).then_some(found.stream),
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
    let (frames, frame) = (&survey.frames, found.frame);
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

fn tilt_stream(survey: &Survey, sensor: &str, tilt: &TiltConfig) -> anyhow::Result<StreamId> {
    let streams = survey.streams_with_joints(&[&tilt.joint]);
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
    ))
    .into())
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

pub(super) fn tilt_notes(
    survey: &Survey,
    found: &[FoundSensor<'_>],
    planned: &[PlannedSensor],
) -> Vec<String> {
    let tilted = found.iter().zip(planned).filter_map(|(found, planned)| {
        let joint = &found.sensor.config.tilt.as_ref()?.joint;
        let topic = survey.topic_name(planned.tilt_stream?);
        let sensor = found.sensor.name;
        Some(format!("{sensor}: tilted as {topic} says of joint {joint}"))
    });
    tilted.collect()
}

/// The sensors from which poses could be computed, as text.
pub(super) fn describe_available(survey: &Survey) -> Option<String> {
    let listed = |streams: Vec<StreamId>| {
        let names = names(survey, &streams);
        (!names.is_empty()).then(|| names.join(", "))
    };
    let attitudes = listed(survey.streams_with_orientation())?;
    let joints = listed(all(&survey.joints));
    let fixes = listed(all(&survey.fixes));
    let needs = |kind: &str| {
        format!(
            "poses can be reckoned from them if the vehicle's configuration has a sensor of kind \"{kind}\" \
             and one of kind \"imu\""
        )
    };
    let wheels = joints.map(|joints| {
        format!(
            "There are joint angles ({joints}) and attitudes ({attitudes}): {}",
            needs("wheel_encoders")
        )
    });
    let satellites = fixes.map(|fixes| {
        format!(
            "There are satellite fixes ({fixes}) and attitudes ({attitudes}): {}",
            needs("gps")
        )
    });
    match (wheels, satellites) {
        (Some(wheels), Some(satellites)) => Some(format!("{wheels}. {satellites}")),
        (one, other) => one.or(other),
    }
}

pub(super) fn encoders(
    survey: &Survey,
    (sensor, config): (&str, &WheelEncodersConfig),
) -> anyhow::Result<StreamId> {
    let [left, right] = [&config.left_joint, &config.right_joint];
    let has_wheels = survey.streams_with_joints(&[left, right]);
    if has_wheels.is_empty() {
        return Err(UsageError(format!(
            "{}: no topic has both joints {left:?} and {right:?}, which sensors.{sensor}.left_joint and \
             right_joint name: {}",
            survey.path.display(),
            describe_joints(survey)
        ))
        .into());
    }
    let (option, carried) = (format!("--topic {sensor}="), "angles of both wheels");
    choose_one(
        survey,
        &option,
        carried,
        &has_wheels,
        config.topic.as_deref(),
    )
}

pub(super) fn attitude(
    survey: &Survey,
    (sensor, config): (&str, &ImuConfig),
) -> anyhow::Result<StreamId> {
    let oriented = survey.streams_with_orientation();
    if oriented.is_empty() {
        let all = all(&survey.attitudes);
        return Err(UsageError(format!(
            "{}: {} gives turn rates and accelerations but no orientation, from which poses are reckoned",
            survey.path.display(),
            names(survey, &all[..all.len().min(MAX_LISTED)]).join(", ")
        ))
        .into());
    }
    let (option, carried) = (format!("--topic {sensor}="), "orientations");
    choose_one(survey, &option, carried, &oriented, config.topic.as_deref())
}

fn all<T>(streams: &[(StreamId, T)]) -> Vec<StreamId> {
    streams.iter().map(|&(stream, _)| stream).collect()
}

pub(super) fn fixes(
    survey: &Survey,
    (sensor, config): (&str, &GpsConfig),
) -> anyhow::Result<StreamId> {
    let with_fix = survey.streams_with_fix();
    if with_fix.is_empty() {
        return Err(UsageError(format!(
            "{}: the receiver of {} never had a fix, so nothing says where the vehicle was",
            survey.path.display(),
            names(survey, &all(&survey.fixes)).join(", ")
        ))
        .into());
    }
    let (option, carried) = (format!("--topic {sensor}="), "satellite fixes");
    choose_one(survey, &option, carried, &with_fix, config.topic.as_deref())
}

/// The stream of a receiver's fixes, if there are any.
pub(super) fn receiver(
    survey: &Survey,
    (sensor, config): (&str, &GpsConfig),
) -> anyhow::Result<Option<StreamId>> {
    let all = all(&survey.fixes);
    if all.is_empty() {
        return Ok(None);
    }
    let (option, topic) = (format!("--topic {sensor}="), config.topic.as_deref());
    choose_one(survey, &option, "satellite fixes", &all, topic).map(Some)
}

/// Maximum number of names in a message.
const MAX_LISTED: usize = 12;

/// Chooses the stream called `topic`, or the only one. `option` is the command line option up to its equals sign.
fn choose_one(
    survey: &Survey,
    option: &str,
    carried: &str,
    streams: &[StreamId],
    topic: Option<&str>,
) -> anyhow::Result<StreamId> {
    let path = survey.path.display();
    let listed = || names(survey, streams).join(", ");
    match (topic, streams) {
        (Some(topic), streams) => {
            let called = streams
                .iter()
                .find(|&&stream| survey.topic_name(stream) == topic);
            called.copied().ok_or_else(|| {
                UsageError(format!(
                    "{path}: no {carried} on {topic:?}, which `{option}` or the configuration names; it has {}",
                    listed()
                ))
                .into()
            })
        }
        (None, &[only]) => Ok(only),
        (None, streams) => {
            let named = names(survey, streams);
            let choices = named.iter();
            let choices = choices.filter_map(|name| Choice::new(name.clone(), option, name));
            Err(ChoiceNeeded {
                message: format!(
                    "{path}: several topics carry {carried}: {}. Choose one, for example {option}{}",
                    named.join(", "),
                    named.first().map_or("", String::as_str)
                ),
                question: format!("Several topics carry {carried}. Which one?"),
                choices: choices.collect(),
            }
            .into())
        }
    }
}

fn names(survey: &Survey, streams: &[StreamId]) -> Vec<String> {
    let named = streams.iter().take(MAX_LISTED);
    let named = named.map(|&stream| survey.topic_name(stream).to_owned());
    named.collect()
}

fn describe_joints(survey: &Survey) -> String {
    let streams = survey.joints.iter().map(|(stream, joints)| {
        let listed: Vec<_> = joints
            .names
            .iter()
            .map(String::as_str)
            .take(MAX_LISTED)
            .collect();
        let more = if joints.names.len() > MAX_LISTED {
            ", …"
        } else {
            ""
        };
        format!(
            "{} has {}{more}",
            survey.topic_name(*stream),
            listed.join(", ")
        )
    });
    streams.collect::<Vec<_>>().join("; ")
}
