//! Which streams of a recording poses are made of where nothing says them ready-made.

use super::choose::{MAX_LISTED, choose_one, describe_joints, names};
use crate::config::{
    FixesAndAttitude, GpsConfig, ImuConfig, WheelEncodersConfig, WheelsAndAttitude,
};
use crate::exit::UsageError;
use crate::survey::Survey;
use localization::registration::PoseStreams;
use measurement::StreamId;

/// The streams of wheel angles and of attitudes; `None` where the recording has no angles or no attitudes at
/// all.
///
/// # Errors
/// Where none fits the configuration, or several do: the message lists them and says what to type.
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

/// The streams of fixes and of attitudes; `None` where the recording has no fixes or no attitudes at all.
///
/// # Errors
/// As [`wheel_streams`].
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

/// What poses could be made of, in words.
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
