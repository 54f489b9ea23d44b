//! Chooses the range sensors and the source of poses of a recording, before the replay.

use self::streams::FoundSensor;
use super::choice::{Choice, ChoiceNeeded};
use super::localization_plan::{
    LocalizationPlan, match_scans, poses_from_attitude, poses_from_fixes, poses_from_wheels,
};
use crate::config::{Config, FixesAndAttitude, WheelsAndAttitude, the_gps, the_imu};
use crate::exit::UsageError;
use crate::survey::Survey;
use crate::survey::topics::ScanSurvey;
use localization::registration::{MountOrigin, ODOMETRY_FRAME, PoseOrigin, PoseStreams};
use localization::{LocalizationConfig, PoseSource};
use recording::Format;

mod streams;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Plan {
    /// Name of each range sensor and its topic or message name.
    pub(super) sensors: Vec<(String, String)>,
    pub(super) localization_plan: LocalizationPlan,
    pub(super) streams: Vec<String>,
    /// Range from which on the only laser has no return, if its messages do not give it, metres.
    pub(super) inferred_miss_range_m: Option<f32>,
    pub(super) notes: Vec<String>,
}

/// Chooses by the contents of the recording and the configuration. An error lists the candidates and the options to
/// choose one.
pub(super) fn plan(survey: &Survey, config: &Config) -> anyhow::Result<Plan> {
    let (found, missing) = streams::find_sensors(survey, config)?;
    let ChosenPoses {
        origin,
        mut pose_streams,
    } = choose_origin(survey, &found, config)?;
    let mut sensors = streams::place(survey, &found, &origin, config)?;
    let matched = match_scans(config, &sensors, &origin)?;
    let topics = found.iter().map(|found| survey.topic_name(found.stream));
    let mut streams: Vec<_> = topics.clone().map(str::to_owned).collect();
    let mut notes = Vec::new();
    for sensor in missing {
        notes.push(format!("{sensor}: it has no scans of this sensor"));
    }
    let lasers = streams::join_names(&found);
    match &origin {
        PoseOrigin::Log => notes.push(format!(
            "poses: those that {} brings for its own scans",
            streams.join(" and ")
        )),
        PoseOrigin::Tf { fixed_frame } => {
            notes.push(format!("poses: transforms up to frame {fixed_frame}"));
            for (found, planned) in found.iter().zip(&sensors) {
                if planned.mount == MountOrigin::Configured {
                    notes.push(format!(
                        "the {}'s mounting: as configured, the transforms do not say",
                        found.sensor.name
                    ));
                }
            }
            streams.extend(streams_of_type(
                survey,
                &["tf2_msgs/TFMessage", "tf/tfMessage"],
            ));
        }
        PoseOrigin::Odometry => {
            let odometry = choose_odometry(survey)?;
            notes.push(format!(
                "poses: {odometry}, with the configured mounting of {lasers}"
            ));
            streams.push(odometry);
        }
        PoseOrigin::Wheels(_) | PoseOrigin::Gps(_) => {
            let named = |stream| survey.topic_name(stream).to_owned();
            let PoseStreams {
                wheels,
                attitude,
                fixes,
            } = pose_streams;
            let of = match (wheels.map(named), fixes.map(named)) {
                (Some(wheels), _) => format!("wheels of {wheels}"),
                (None, Some(fixes)) => format!("satellite fixes of {fixes}"),
                (None, None) => String::new(),
            };
            let attitude_of = attitude.map(named).unwrap_or_default();
            notes.push(format!(
                "poses: {of} and attitude of {attitude_of}, with the configured mounting of {lasers}"
            ));
            streams.extend([wheels, fixes, attitude].into_iter().flatten().map(named));
        }
        PoseOrigin::Attitude(_) => {
            let attitude = pose_streams
                .attitude
                .map(|stream| survey.topic_name(stream));
            let attitude = attitude.unwrap_or_default().to_owned();
            notes.push(format!("poses: attitude of {attitude}"));
            streams.push(attitude);
        }
        PoseOrigin::Static if matched.is_some() => {}
        PoseOrigin::Static => notes.push("poses: the vehicle stands still".to_owned()),
        PoseOrigin::Scans { .. } => {}
    }
    if let Some(scans) = &matched {
        let of = found.iter().find(|found| found.sensor.id == scans.sensor);
        notes.push(format!(
            "poses: scans of the {} are matched, and loops are closed",
            of.map_or("", |of| of.sensor.name)
        ));
    }
    if matched.is_some()
        && let Some(gps) = the_gps(&config.sensors)
        && let Some(fixes) = streams::receiver(survey, gps)?
    {
        pose_streams.fixes = Some(fixes);
        let name = survey.topic_name(fixes).to_owned();
        notes.push(format!(
            "positions of {name} hold the map where it is on Earth"
        ));
        streams.push(name);
    }
    let tilts = sensors.iter().filter_map(|sensor| sensor.tilt_stream);
    streams.extend(tilts.map(|stream| survey.topic_name(stream).to_owned()));
    notes.extend(streams::tilt_notes(survey, &found, &sensors));
    let mut inferred_miss_range_m = None;
    let is_alone = found.len() == 1;
    for (found, planned) in found.iter().zip(&mut sensors) {
        let is_carmen = survey.format == Format::Carmen;
        let unsaid = found.scans.and_then(ScanSurvey::inferred_miss_range_m);
        let unsaid = unsaid.filter(|_| is_carmen);
        let Some(range_m) = unsaid else { continue };
        // The reader has one limit, so that several lasers get theirs here.
        if is_alone {
            inferred_miss_range_m = unsaid;
        } else {
            planned.range_max_m = unsaid;
        }
        notes.push(format!(
            "{} reports {range_m} m where it sees nothing: such beams are misses",
            survey.topic_name(found.stream)
        ));
    }
    if !survey.is_complete() {
        notes.push("decided from the beginning of the recording, which is long".to_owned());
    }
    let named = found.iter().map(|found| found.sensor.name.to_owned());
    Ok(Plan {
        sensors: named.zip(topics.map(str::to_owned)).collect(),
        localization_plan: LocalizationPlan {
            origin: match matched {
                Some(scans) => PoseOrigin::Scans {
                    prior: Box::new(origin),
                    scans: Box::new(scans),
                },
                None => origin,
            },
            pose_streams,
            sensors,
        },
        streams: unique(streams),
        inferred_miss_range_m,
        notes,
    })
}

fn unique(names: Vec<String>) -> Vec<String> {
    let mut once = Vec::with_capacity(names.len());
    for name in names {
        if !once.contains(&name) {
            once.push(name);
        }
    }
    once
}

struct ChosenPoses {
    origin: PoseOrigin,
    pose_streams: PoseStreams,
}

fn choose_origin(
    survey: &Survey,
    found: &[FoundSensor<'_>],
    config: &Config,
) -> anyhow::Result<ChosenPoses> {
    let localization = &config.localization;
    let wheels = || poses_by_wheels(survey, config);
    let fixes = || poses_by_fixes(survey, config);
    let ready_made = |origin| ChosenPoses {
        origin,
        pose_streams: PoseStreams::default(),
    };
    let tf = || poses_by_tf(survey, found, localization);
    let log = || {
        let has_own = |scans: &ScanSurvey| scans.has_own_poses;
        let all = found.iter().all(|found| found.scans.is_some_and(has_own));
        all.then_some(PoseOrigin::Log)
    };
    let odometry = || (!survey.odometry.is_empty()).then_some(PoseOrigin::Odometry);
    let chosen = match localization.source {
        PoseSource::Auto => match log().or_else(tf).or_else(odometry).map(ready_made) {
            Some(chosen) => Some(chosen),
            None => match wheels()? {
                Some(chosen) => Some(chosen),
                None => fixes()?,
            },
        },
        PoseSource::Log => log().map(ready_made),
        PoseSource::Tf => tf().map(ready_made),
        PoseSource::Odometry => odometry().map(ready_made),
        PoseSource::Static | PoseSource::Scan => Some(ready_made(PoseOrigin::Static)),
        PoseSource::Wheels => wheels()?,
        PoseSource::Gps | PoseSource::ScanGps => fixes()?,
        PoseSource::ScanWheels => match log().or_else(odometry).or_else(tf).map(ready_made) {
            Some(chosen) => Some(chosen),
            None => wheels()?,
        },
        PoseSource::ScanImu => attitude(survey, config)?,
    };
    let origin = chosen.as_ref().map(|chosen| &chosen.origin);
    let wants_frame = matches!(localization.source, PoseSource::Auto | PoseSource::Tf);
    if let Some(wanted) = &localization.fixed_frame
        && wants_frame
        && origin != Some(&PoseOrigin::Log)
        && !has_fixed_frame(survey, origin, wanted)
    {
        return Err(UsageError(format!(
            "{}: no frame {wanted:?} in which {} moves (localization.fixed_frame): {}",
            survey.path.display(),
            streams::join_names(found),
            describe_pose_sources(survey)
        ))
        .into());
    }
    chosen.ok_or_else(|| no_pose_source(survey, found, localization.source))
}

fn poses_by_wheels(survey: &Survey, config: &Config) -> anyhow::Result<Option<ChosenPoses>> {
    match WheelsAndAttitude::of(&config.sensors) {
        Ok(sensors) if !survey.joints.is_empty() && !survey.attitudes.is_empty() => {
            Ok(Some(ChosenPoses {
                origin: poses_from_wheels(config, &sensors),
                pose_streams: PoseStreams {
                    wheels: Some(streams::encoders(survey, sensors.encoders)?),
                    attitude: Some(streams::attitude(survey, sensors.imu)?),
                    fixes: None,
                },
            }))
        }
        Ok(_) | Err(_) => Ok(None),
    }
}

fn attitude(survey: &Survey, config: &Config) -> anyhow::Result<Option<ChosenPoses>> {
    let Some(imu) = the_imu(&config.sensors).filter(|_| !survey.attitudes.is_empty()) else {
        return Ok(None);
    };
    Ok(Some(ChosenPoses {
        origin: poses_from_attitude(config, imu.1),
        pose_streams: PoseStreams {
            attitude: Some(streams::attitude(survey, imu)?),
            ..PoseStreams::default()
        },
    }))
}

fn poses_by_fixes(survey: &Survey, config: &Config) -> anyhow::Result<Option<ChosenPoses>> {
    match FixesAndAttitude::of(&config.sensors) {
        Ok(sensors) if !survey.fixes.is_empty() && !survey.attitudes.is_empty() => {
            Ok(Some(ChosenPoses {
                origin: poses_from_fixes(config, &sensors),
                pose_streams: PoseStreams {
                    wheels: None,
                    attitude: Some(streams::attitude(survey, sensors.imu)?),
                    fixes: Some(streams::fixes(survey, sensors.gps)?),
                },
            }))
        }
        Ok(_) | Err(_) => Ok(None),
    }
}

/// Transforms reach that frame, or there are only odometry messages, which define it.
fn has_fixed_frame(survey: &Survey, found: Option<&PoseOrigin>, wanted: &str) -> bool {
    match found {
        Some(PoseOrigin::Odometry) => survey
            .odometry
            .iter()
            .any(|(_, odometry)| *odometry.parent == *wanted),
        Some(PoseOrigin::Wheels(_) | PoseOrigin::Gps(_) | PoseOrigin::Attitude(_)) => {
            wanted == ODOMETRY_FRAME
        }
        Some(
            PoseOrigin::Log | PoseOrigin::Tf { .. } | PoseOrigin::Static | PoseOrigin::Scans { .. },
        ) => true,
        None => false,
    }
}

const SOURCE: &str = "localization.source=";

fn no_pose_source(survey: &Survey, found: &[FoundSensor<'_>], source: PoseSource) -> anyhow::Error {
    let choice = |question, message, label: &str, source| {
        let choice = Choice::new(label.to_owned(), SOURCE, source);
        ChoiceNeeded {
            message,
            question,
            choices: choice.into_iter().collect(),
        }
        .into()
    };
    let path = survey.path.display();
    let there_is = describe_pose_sources(survey);
    let lasers = streams::join_names(found);
    let (wanted, lacks) = match source {
        PoseSource::Log => ("log", "its scans bring no poses of their own"),
        PoseSource::Tf => ("tf", "no transforms lead up to a frame in which it moves"),
        PoseSource::Odometry => ("odometry", "there is no odometry"),
        PoseSource::Wheels => (
            "wheels",
            match (survey.joints.is_empty(), survey.attitudes.is_empty()) {
                (true, true) => "there are neither angles of wheels nor attitudes",
                (true, false) => "there are no angles of wheels (sensor_msgs/JointState)",
                (false, _) => "there are no attitudes (sensor_msgs/Imu)",
            },
        ),
        PoseSource::ScanWheels => (
            "scan+wheels",
            "there are neither odometry, transforms nor angles of wheels",
        ),
        PoseSource::ScanImu => (
            "scan+imu",
            if survey.attitudes.is_empty() {
                "there are no attitudes (sensor_msgs/Imu)"
            } else {
                "the vehicle's configuration has not one sensor of kind \"imu\""
            },
        ),
        PoseSource::Gps | PoseSource::ScanGps => (
            "gps",
            match (survey.fixes.is_empty(), survey.attitudes.is_empty()) {
                (true, true) => "there are neither satellite fixes nor attitudes",
                (true, false) => "there are no satellite fixes (sensor_msgs/NavSatFix)",
                (false, _) => "there are no attitudes (sensor_msgs/Imu)",
            },
        ),
        PoseSource::Auto | PoseSource::Static | PoseSource::Scan => {
            let leads = match survey.frames.edges().next() {
                Some(_) => format!(
                    ", and none leads from {} up to a frame in which it moves",
                    found.first().map_or("", |found| found.frame)
                ),
                None => String::new(),
            };
            let wheels = streams::describe_available(survey)
                .map_or(String::new(), |there_are| format!(". {there_are}"));
            let question =
                format!("Nothing in it says where {lasers} was: {there_is}{leads}{wheels}.");
            let message = format!(
                "{path}: nothing in it says where {lasers} was: {there_is}{leads}{wheels}. If the vehicle \
                 stood still, map it with --set {SOURCE}static"
            );
            return choice(question, message, "The vehicle stood still", "static");
        }
    };
    let question =
        format!("The settings want poses of source {wanted:?}, but {lacks}; {there_is}.");
    let message = format!(
        "{path}: nothing in it says where {lasers} was, as localization.source = {wanted:?} wants it: \
         {lacks}; {there_is}. --set {SOURCE}auto takes what there is"
    );
    choice(question, message, "Use what there is", "auto")
}

/// The fixed frame above a range sensor, or above the vehicle that carries it, if a transform between them moves.
fn poses_by_tf(
    survey: &Survey,
    found: &[FoundSensor<'_>],
    localization: &LocalizationConfig,
) -> Option<PoseOrigin> {
    let base_frame = localization.base_frame.as_str();
    let wanted = localization.fixed_frame.as_deref();
    let starts = found.iter().flat_map(|found| [found.frame, base_frame]);
    starts
        .filter_map(|start| survey.frames.fixed_ancestor(start, base_frame, wanted))
        .map(|fixed_frame| PoseOrigin::Tf { fixed_frame })
        .next()
}

fn choose_odometry(survey: &Survey) -> Result<String, UsageError> {
    let stream = survey
        .best_odometry()
        .and_then(|(stream, _)| survey.stream(*stream));
    let name = stream.map(|summary| summary.stream.name.clone());
    name.ok_or_else(|| {
        UsageError(format!(
            "{}: there is no odometry in it",
            survey.path.display()
        ))
    })
}

fn describe_pose_sources(survey: &Survey) -> String {
    let edges: Vec<_> = survey
        .frames
        .edges()
        .map(|(parent, child, _)| format!("{parent} → {child}"))
        .take(8)
        .collect();
    let odometry: Vec<_> = survey
        .odometry
        .iter()
        .filter_map(|(stream, odometry)| {
            let stream = survey.stream(*stream)?;
            Some(format!("{} in {}", stream.stream.name, odometry.parent))
        })
        .take(8)
        .collect();
    match (&edges[..], &odometry[..]) {
        ([], []) => "there are neither transforms nor odometry".to_owned(),
        ([], odometry) => format!("there is odometry ({})", odometry.join(", ")),
        (edges, []) => format!("there are transforms ({}), no odometry", edges.join(", ")),
        (edges, odometry) => format!(
            "there are transforms ({}) and odometry ({})",
            edges.join(", "),
            odometry.join(", ")
        ),
    }
}

fn streams_of_type(survey: &Survey, types: &[&str]) -> Vec<String> {
    let streams = survey.streams.iter().map(|summary| &summary.stream);
    streams
        .filter(|stream| types.contains(&stream.type_name.as_str()))
        .map(|stream| stream.name.clone())
        .collect()
}

#[cfg(test)]
mod tests;
