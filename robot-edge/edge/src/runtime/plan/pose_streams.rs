//! Chooses the streams from which poses are computed.

use crate::config::{
    FixesAndAttitude, GpsConfig, ImuConfig, WheelEncodersConfig, WheelsAndAttitude,
};
use crate::exit::UsageError;
use crate::survey::Survey;
use localization::registration::PoseStreams;
use measurement::StreamId;

/// The streams of wheel angles and attitudes; `None` if either is missing.
pub(super) fn wheel_streams(
    survey: &Survey,
    sensors: &WheelsAndAttitude<'_>,
) -> Result<Option<PoseStreams>, UsageError> {
    if survey.joints.is_empty() || survey.attitudes.is_empty() {
        return Ok(None);
    }
    Ok(Some(PoseStreams {
        wheels: Some(encoders(survey, sensors.encoders)?),
        attitude: Some(attitude(survey, sensors.imu)?),
        fixes: None,
    }))
}

/// The streams of fixes and attitudes; `None` if either is missing.
pub(super) fn fix_streams(
    survey: &Survey,
    sensors: &FixesAndAttitude<'_>,
) -> Result<Option<PoseStreams>, UsageError> {
    if survey.fixes.is_empty() || survey.attitudes.is_empty() {
        return Ok(None);
    }
    Ok(Some(PoseStreams {
        wheels: None,
        attitude: Some(attitude(survey, sensors.imu)?),
        fixes: Some(fixes(survey, sensors.gps)?),
    }))
}

/// The sensors from which poses could be computed, as text.
pub(super) fn describe_available(survey: &Survey) -> Option<String> {
    let listed = |streams: Vec<StreamId>| {
        let names = names(survey, &streams);
        (!names.is_empty()).then(|| names.join(", "))
    };
    let attitudes = listed(oriented(survey))?;
    let joints = listed(survey.joints.iter().map(|joints| joints.stream).collect());
    let fixes = listed(survey.fixes.iter().map(|fixes| fixes.stream).collect());
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

fn encoders(
    survey: &Survey,
    (sensor, config): (&str, &WheelEncodersConfig),
) -> Result<StreamId, UsageError> {
    let [left, right] = [&config.left_joint, &config.right_joint];
    let has_wheels: Vec<_> = survey
        .joints
        .iter()
        .filter(|joints| joints.names.contains(left) && joints.names.contains(right))
        .map(|joints| joints.stream)
        .collect();
    if has_wheels.is_empty() {
        return Err(UsageError(format!(
            "{}: no topic has both joints {left:?} and {right:?}, which sensors.{sensor}.left_joint and \
             right_joint name: {}",
            survey.path.display(),
            describe_joints(survey)
        )));
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

fn attitude(survey: &Survey, (sensor, config): (&str, &ImuConfig)) -> Result<StreamId, UsageError> {
    let oriented = oriented(survey);
    if oriented.is_empty() {
        let all: Vec<_> = survey.attitudes.iter().map(|a| a.stream).collect();
        return Err(UsageError(format!(
            "{}: {} gives turn rates and accelerations but no orientation, from which poses are reckoned",
            survey.path.display(),
            names(survey, &all[..all.len().min(MAX_LISTED)]).join(", ")
        )));
    }
    let (option, carried) = (format!("--topic {sensor}="), "orientations");
    choose_one(survey, &option, carried, &oriented, config.topic.as_deref())
}

fn oriented(survey: &Survey) -> Vec<StreamId> {
    let oriented = survey.attitudes.iter().filter(|a| a.oriented > 0);
    oriented.map(|attitudes| attitudes.stream).collect()
}

fn fixes(survey: &Survey, (sensor, config): (&str, &GpsConfig)) -> Result<StreamId, UsageError> {
    let with_fix = survey.fixes.iter().filter(|fixes| fixes.fixed > 0);
    let with_fix: Vec<_> = with_fix.map(|fixes| fixes.stream).collect();
    if with_fix.is_empty() {
        let all: Vec<_> = survey.fixes.iter().map(|fixes| fixes.stream).collect();
        return Err(UsageError(format!(
            "{}: the receiver of {} never had a fix, so nothing says where the vehicle was",
            survey.path.display(),
            names(survey, &all).join(", ")
        )));
    }
    let (option, carried) = (format!("--topic {sensor}="), "satellite fixes");
    choose_one(survey, &option, carried, &with_fix, config.topic.as_deref())
}

/// Maximum number of names in a message.
pub(super) const MAX_LISTED: usize = 12;

/// Chooses the stream called `topic`, or the only one. `option` is the command line option up to its equals sign.
pub(super) fn choose_one(
    survey: &Survey,
    option: &str,
    carried: &str,
    streams: &[StreamId],
    topic: Option<&str>,
) -> Result<StreamId, UsageError> {
    let path = survey.path.display();
    let listed = || names(survey, streams).join(", ");
    match (topic, streams) {
        (Some(topic), streams) => {
            let called = streams
                .iter()
                .find(|&&stream| name(survey, stream) == topic);
            called.copied().ok_or_else(|| {
                UsageError(format!(
                    "{path}: no {carried} on {topic:?}, which `{option}` or the configuration names; it has {}",
                    listed()
                ))
            })
        }
        (None, &[only]) => Ok(only),
        (None, streams) => Err(UsageError(format!(
            "{path}: several topics carry {carried}: {}. Choose one, for example {option}{}",
            listed(),
            streams.first().map_or("", |&stream| name(survey, stream))
        ))),
    }
}

pub(super) fn name(survey: &Survey, stream: StreamId) -> &str {
    survey
        .stream(stream)
        .map_or("", |summary| &summary.stream.name)
}

pub(super) fn names(survey: &Survey, streams: &[StreamId]) -> Vec<String> {
    let named = streams.iter().take(MAX_LISTED);
    named
        .map(|&stream| name(survey, stream).to_owned())
        .collect()
}

/// The joints of each stream, as text.
pub(super) fn describe_joints(survey: &Survey) -> String {
    let streams = survey.joints.iter().map(|joints| {
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
            name(survey, joints.stream),
            listed.join(", ")
        )
    });
    streams.collect::<Vec<_>>().join("; ")
}
