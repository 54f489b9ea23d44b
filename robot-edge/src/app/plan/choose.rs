//! One stream of several that carry the same.

use crate::exit::UsageError;
use crate::survey::Survey;
use measurement::StreamId;

/// Names that a message lists.
pub(super) const MAX_LISTED: usize = 12;

/// Of the streams that carry what a sensor measures, the one called `topic`, or else the only one. `option` sets
/// it on the command line, up to and with its equals sign.
///
/// # Errors
/// Where none or several fit: the message lists them and says what to type.
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

/// The topic of a stream.
pub(super) fn name(survey: &Survey, stream: StreamId) -> &str {
    survey
        .stream(stream)
        .map_or("", |summary| &summary.stream.name)
}

/// The topics of the first streams.
pub(super) fn names(survey: &Survey, streams: &[StreamId]) -> Vec<String> {
    let named = streams.iter().take(MAX_LISTED);
    named
        .map(|&stream| name(survey, stream).to_owned())
        .collect()
}

/// What joints each stream has, in words.
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
