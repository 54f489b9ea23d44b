//! What of a recording is mapped: which laser, and where its poses come from. Decided before the replay.

use self::wheels::WheelStreams;
use super::placing::poses_from_wheels;
use crate::config::{Config, WheelsAndAttitude};
use crate::exit::UsageError;
use crate::localization::config::{LocalizationConfig, PoseSource};
use crate::localization::placer::{MountOrigin, ODOMETRY_FRAME, PoseOrigin};
use crate::recording::Format;
use crate::recording::survey::Survey;
use crate::recording::survey::scans::ScanSurvey;

mod wheels;

/// What is replayed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Plan {
    /// The laser's topic or message name.
    pub(super) laser: String,
    /// Where poses come from.
    pub(super) origin: PoseOrigin,
    /// The streams that are needed.
    pub(super) streams: Vec<String>,
    /// The range from which on the laser sees nothing, where its messages do not say so, metres.
    pub(super) unsaid_miss_from_m: Option<f32>,
    /// What a person should know of these decisions.
    pub(super) notes: Vec<String>,
}

/// Decides from what is in the recording and what the configuration asks for.
///
/// # Errors
/// Where nothing fits, or several things do: the message lists them and says what to type.
pub(super) fn plan(
    survey: &Survey,
    topic: Option<&str>,
    config: &Config,
) -> Result<Plan, UsageError> {
    let scan = choose_laser(survey, topic)?;
    let laser = stream_name(survey, scan);
    let mut notes = Vec::new();
    let Chosen {
        origin,
        wheel_streams,
    } = choose_origin(survey, scan, config)?;
    let mut names = vec![laser.clone()];
    match &origin {
        PoseOrigin::Log => notes.push(format!(
            "poses: those that {laser} brings for its own scans"
        )),
        PoseOrigin::Tf { fixed_frame, mount } => {
            notes.push(format!("poses: transforms up to frame {fixed_frame}"));
            if *mount == MountOrigin::Configured {
                notes.push(
                    "the laser's mounting: as configured, the transforms do not say".to_owned(),
                );
            }
            names.extend(streams_of_type(
                survey,
                &["tf2_msgs/TFMessage", "tf/tfMessage"],
            ));
        }
        PoseOrigin::Odometry => {
            let odometry = choose_odometry(survey)?;
            notes.push(format!(
                "poses: {odometry}, with the configured mounting of the laser"
            ));
            names.push(odometry);
        }
        PoseOrigin::Wheels(_) => {
            if let Some(WheelStreams { encoders, attitude }) = wheel_streams {
                notes.push(format!(
                    "poses: wheels of {encoders} and attitude of {attitude}, with the configured mounting \
                     of the laser"
                ));
                names.extend([encoders, attitude]);
            }
        }
        PoseOrigin::Static => notes.push("poses: the vehicle stands still".to_owned()),
    }
    let unsaid_miss_from_m = (survey.format == Format::Carmen)
        .then(|| scan.unsaid_miss_from_m())
        .flatten();
    if let Some(range_m) = unsaid_miss_from_m {
        notes.push(format!(
            "{laser} reports {range_m} m where it sees nothing: such beams are misses"
        ));
    }
    if !survey.is_complete() {
        notes.push("decided from the beginning of the recording, which is long".to_owned());
    }
    Ok(Plan {
        laser,
        origin,
        streams: names,
        unsaid_miss_from_m,
        notes,
    })
}

fn choose_laser<'a>(survey: &'a Survey, topic: Option<&str>) -> Result<&'a ScanSurvey, UsageError> {
    let path = survey.path.display();
    let names = || {
        let names: Vec<_> = survey
            .scans
            .iter()
            .map(|scan| stream_name(survey, scan))
            .collect();
        names.join(", ")
    };
    if let Some(topic) = topic {
        let chosen = survey
            .scans
            .iter()
            .find(|scan| stream_name(survey, scan) == topic);
        return chosen.ok_or_else(|| {
            let have = if survey.scans.is_empty() { "no scans at all".to_owned() } else { names() };
            UsageError(format!(
                "{path}: no scans on {topic:?}, which `--topic laser=` or the configuration names; it has {have}"
            ))
        });
    }
    match &survey.scans[..] {
        [] => Err(UsageError(format!(
            "{path}: there is no range sensor in it, so there is nothing to map; `robot-edge info {path}` \
             lists what it holds"
        ))),
        [scan] => Ok(scan),
        [scan, ..] => Err(UsageError(format!(
            "{path}: several topics carry scans: {}. Choose one, for example --topic laser={}",
            names(),
            stream_name(survey, scan)
        ))),
    }
}

/// Where poses come from, and the streams of wheels where it is those.
struct Chosen {
    origin: PoseOrigin,
    wheel_streams: Option<WheelStreams>,
}

fn choose_origin(
    survey: &Survey,
    scan: &ScanSurvey,
    config: &Config,
) -> Result<Chosen, UsageError> {
    let localization = &config.localization;
    let tf = || from_tree(survey, scan, localization);
    let log = || scan.has_own_poses.then_some(PoseOrigin::Log);
    let odometry = || (!survey.odometry.is_empty()).then_some(PoseOrigin::Odometry);
    let mut wheel_streams = None;
    let found = match localization.source {
        PoseSource::Auto => log().or_else(tf).or_else(odometry),
        PoseSource::Log => log(),
        PoseSource::Tf => tf(),
        PoseSource::Odometry => odometry(),
        PoseSource::Static => Some(PoseOrigin::Static),
        PoseSource::Wheels => None,
    };
    let takes_wheels = matches!(localization.source, PoseSource::Auto | PoseSource::Wheels);
    let found = match (found, WheelsAndAttitude::of(&config.sensors)) {
        (None, Ok(sensors)) if takes_wheels => {
            wheel_streams = wheels::choose(survey, &sensors)?;
            let origin = || poses_from_wheels(config, &sensors);
            wheel_streams.is_some().then(origin)
        }
        (found, _) => found,
    };
    let wants_frame = matches!(localization.source, PoseSource::Auto | PoseSource::Tf);
    if let Some(wanted) = &localization.fixed_frame
        && wants_frame
        && found != Some(PoseOrigin::Log)
        && !has_fixed_frame(survey, found.as_ref(), wanted)
    {
        return Err(UsageError(format!(
            "{}: no frame {wanted:?} in which the laser moves (localization.fixed_frame): {}",
            survey.path.display(),
            what_poses_there_are(survey)
        )));
    }
    match found {
        Some(origin) => Ok(Chosen {
            origin,
            wheel_streams,
        }),
        None => Err(nothing_says_where(survey, scan, localization.source)),
    }
}

/// Transforms were followed up to that frame, or there are only odometry messages, which call theirs so.
fn has_fixed_frame(survey: &Survey, found: Option<&PoseOrigin>, wanted: &str) -> bool {
    match found {
        Some(PoseOrigin::Odometry) => survey
            .odometry
            .iter()
            .any(|odometry| *odometry.parent == *wanted),
        Some(PoseOrigin::Wheels(_)) => wanted == ODOMETRY_FRAME,
        Some(PoseOrigin::Log | PoseOrigin::Tf { .. } | PoseOrigin::Static) => true,
        None => false,
    }
}

fn nothing_says_where(survey: &Survey, scan: &ScanSurvey, source: PoseSource) -> UsageError {
    let path = survey.path.display();
    let there_is = what_poses_there_are(survey);
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
        PoseSource::Auto | PoseSource::Static => {
            let leads = match survey.frames.edges().next() {
                Some(_) => format!(
                    ", and none leads from {} up to a frame in which it moves",
                    scan.frame
                ),
                None => String::new(),
            };
            let wheels = wheels::there_are(survey).map_or(String::new(), |there_are| {
                format!(
                    ". {there_are}: poses can be reckoned from them if the vehicle's configuration has a \
                     sensor of kind \"wheel_encoders\" and one of kind \"imu\""
                )
            });
            return UsageError(format!(
                "{path}: nothing in it says where the laser was: {there_is}{leads}{wheels}. If the vehicle \
                 stood still, map it with --set localization.source=static"
            ));
        }
    };
    UsageError(format!(
        "{path}: nothing in it says where the laser was, as localization.source = {wanted:?} wants it: \
         {lacks}; {there_is}. --set localization.source=auto takes what there is"
    ))
}

/// The frame that stands still above the laser (or above the vehicle that carries it), if something moves
/// on the way.
fn from_tree(
    survey: &Survey,
    scan: &ScanSurvey,
    localization: &LocalizationConfig,
) -> Option<PoseOrigin> {
    let base_frame = localization.base_frame.as_str();
    let starts = [
        (&*scan.frame, MountOrigin::Tree),
        (base_frame, MountOrigin::Configured),
    ];
    starts.into_iter().find_map(|(start, mount)| {
        let wanted = localization.fixed_frame.as_deref();
        let fixed_frame = survey.frames.fixed_above(start, base_frame, wanted)?;
        Some(PoseOrigin::Tf { fixed_frame, mount })
    })
}

fn choose_odometry(survey: &Survey) -> Result<String, UsageError> {
    let stream = survey
        .best_odometry()
        .and_then(|odometry| survey.stream(odometry.stream));
    let name = stream.map(|summary| summary.stream.name.clone());
    name.ok_or_else(|| {
        UsageError(format!(
            "{}: there is no odometry in it",
            survey.path.display()
        ))
    })
}

fn what_poses_there_are(survey: &Survey) -> String {
    let edges: Vec<_> = survey
        .frames
        .edges()
        .map(|(parent, child, _)| format!("{parent} → {child}"))
        .take(8)
        .collect();
    let odometry: Vec<_> = survey
        .odometry
        .iter()
        .filter_map(|odometry| {
            let stream = survey.stream(odometry.stream)?;
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

fn stream_name(survey: &Survey, scan: &ScanSurvey) -> String {
    survey
        .stream(scan.stream)
        .map(|summary| summary.stream.name.clone())
        .unwrap_or_default()
}

#[cfg(test)]
mod tests;
