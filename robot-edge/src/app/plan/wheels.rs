//! Which streams of a recording poses are reckoned from.

use crate::config::WheelsAndAttitude;
use crate::exit::UsageError;
use crate::measurement::StreamId;
use crate::recording::survey::Survey;

/// The streams of wheel angles and of attitudes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct WheelStreams {
    pub(super) encoders: String,
    pub(super) attitude: String,
}

/// Joints and topics that a message lists.
const MAX_LISTED: usize = 12;

/// Chooses among what is in the recording; `None` where it has no angles or no attitudes at all.
///
/// # Errors
/// Where none fits the configuration, or several do: the message lists them and says what to type.
pub(super) fn choose(
    survey: &Survey,
    sensors: &WheelsAndAttitude<'_>,
) -> Result<Option<WheelStreams>, UsageError> {
    if survey.joints.is_empty() || survey.attitudes.is_empty() {
        return Ok(None);
    }
    Ok(Some(WheelStreams {
        encoders: encoders(survey, sensors)?,
        attitude: attitude(survey, sensors)?,
    }))
}

/// What poses could be reckoned from, in words.
pub(super) fn there_are(survey: &Survey) -> Option<String> {
    let names = |streams: Vec<StreamId>| {
        let names: Vec<_> = streams
            .into_iter()
            .take(MAX_LISTED)
            .map(|stream| name(survey, stream))
            .collect();
        (!names.is_empty()).then(|| names.join(", "))
    };
    let joints = names(survey.joints.iter().map(|joints| joints.stream).collect())?;
    let oriented = survey
        .attitudes
        .iter()
        .filter(|attitudes| attitudes.oriented > 0);
    let attitudes = names(oriented.map(|attitudes| attitudes.stream).collect())?;
    Some(format!(
        "There are joint angles ({joints}) and attitudes ({attitudes})"
    ))
}

fn encoders(survey: &Survey, sensors: &WheelsAndAttitude<'_>) -> Result<String, UsageError> {
    let (sensor, config) = sensors.encoders;
    let wanted = [&config.left_joint, &config.right_joint];
    let has_wheels: Vec<_> = survey
        .joints
        .iter()
        .filter(|joints| wanted.iter().all(|joint| joints.names.contains(*joint)))
        .map(|joints| name(survey, joints.stream))
        .collect();
    if !has_wheels.is_empty() {
        let carried = "angles of both wheels";
        return choose_one(
            survey,
            sensor,
            carried,
            &has_wheels,
            config.topic.as_deref(),
        );
    }
    let [left, right] = wanted;
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
    Err(UsageError(format!(
        "{}: no topic has both joints {left:?} and {right:?}, which sensors.{sensor}.left_joint and \
         right_joint name: {}",
        survey.path.display(),
        streams.collect::<Vec<_>>().join("; ")
    )))
}

fn attitude(survey: &Survey, sensors: &WheelsAndAttitude<'_>) -> Result<String, UsageError> {
    let (sensor, config) = sensors.imu;
    let streams = survey.attitudes.iter();
    let oriented: Vec<_> = streams
        .clone()
        .filter(|attitudes| attitudes.oriented > 0)
        .map(|attitudes| name(survey, attitudes.stream))
        .collect();
    if oriented.is_empty() {
        let names: Vec<_> = streams
            .map(|attitudes| name(survey, attitudes.stream))
            .collect();
        return Err(UsageError(format!(
            "{}: {} gives turn rates and accelerations but no orientation, from which poses are reckoned",
            survey.path.display(),
            names.join(", ")
        )));
    }
    choose_one(
        survey,
        sensor,
        "orientations",
        &oriented,
        config.topic.as_deref(),
    )
}

/// Of the streams that carry what `sensor` measures, the one called `topic`, or else the only one.
fn choose_one(
    survey: &Survey,
    sensor: &str,
    carried: &str,
    streams: &[String],
    topic: Option<&str>,
) -> Result<String, UsageError> {
    let path = survey.path.display();
    match (topic, streams) {
        (Some(topic), streams) if streams.iter().any(|name| name == topic) => Ok(topic.to_owned()),
        (Some(topic), streams) => Err(UsageError(format!(
            "{path}: no {carried} on {topic:?}, which `--topic {sensor}=` or the configuration names; it has \
             {}",
            streams.join(", ")
        ))),
        (None, [only]) => Ok(only.clone()),
        (None, streams) => Err(UsageError(format!(
            "{path}: several topics carry {carried}: {}. Choose one, for example --topic {sensor}={}",
            streams.join(", "),
            streams.first().map_or("", String::as_str)
        ))),
    }
}

fn name(survey: &Survey, stream: StreamId) -> String {
    survey
        .stream(stream)
        .map(|summary| summary.stream.name.clone())
        .unwrap_or_default()
}
