//! `replay`: a recording as the source, from start to end or interactively.

use std::io::Write;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use super::driving::DrivePlan;
use super::localization_plan::{range_sensors, registration_settings};
use super::network_plan::NetworkPlan;
use super::outputs::{self, SETUP};
use super::plan::{Plan, plan};
use super::player;
use super::run::Run;
use super::source::{self, ReplaySource};
use crate::cli::{MappingOptions, Replay};
use crate::config::advice::advise;
use crate::config::presets::GENERIC;
use crate::config::{self, Config};
use crate::exit::{Exit, UsageError};
use crate::replay_control::{Length, ReplayControl};
use crate::summary::Event;
use crate::survey::Survey;
use localization::registration::PoseOrigin;
use measurement::time::RobotDuration;
use recording::poses::PoseFile;
use recording::{self, Selection};

pub(super) fn replay(
    command: &Replay,
    quiet: bool,
    interrupt: &AtomicBool,
    out: &mut dyn Write,
) -> anyhow::Result<Exit> {
    let (survey, config, plan) = survey_recording(command)?;
    let (run, mut source) = create_run(command, quiet, &survey, &config, plan)?;
    run.execute(&mut source, interrupt, out)
}

/// Replays a recording as `control` commands, until `interrupt` is set. Ignores `start`, `duration`, `loop`, `record`,
/// `export` and `summary` of the command.
pub fn play(
    command: &Replay,
    control: &ReplayControl,
    interrupt: &AtomicBool,
) -> anyhow::Result<()> {
    let mapping = MappingOptions {
        record: None,
        export: None,
        summary: None,
        ..command.mapping.clone()
    };
    let command = &Replay {
        recording: command.recording.clone(),
        poses: command.poses.clone(),
        rate: command.rate,
        repeat: false,
        start_s: 0.0,
        duration_s: None,
        mapping,
    };
    let (survey, config, plan) = survey_recording(command)?;
    let (run, mut source) = create_run(command, true, &survey, &config, plan)?;
    if survey.has_no_clock() {
        control.set_no_clock();
    } else if let Some(length) = length(&survey, &mut source)? {
        control.set_length(length);
    }
    player::play(&run, source, control, interrupt)
}

fn poses_of(command: &Replay) -> Result<Option<PoseFile>, recording::RecordingError> {
    command.poses.as_deref().map(PoseFile::read).transpose()
}

/// Surveys the recording and chooses the vehicle and the streams.
pub(super) fn survey_recording(command: &Replay) -> anyhow::Result<(Survey, Config, Plan)> {
    let options = &command.mapping;
    // Errors of the command line are reported before the recording is read.
    if let Some(vehicle) = &options.setup.vehicle {
        config::load(vehicle, &options.setup.overrides())?;
    }
    outputs::check_not_source(&command.recording, options)?;
    let survey = Survey::of(&command.recording, poses_of(command)?)?;
    check_readable(&survey)?;
    let (vehicle, why) = match (&options.setup.vehicle, &survey.vehicle) {
        (Some(vehicle), _) => (vehicle.as_str(), "as asked for"),
        (None, Some(vehicle)) => (vehicle.as_str(), "named in the recording"),
        (None, None) => (
            GENERIC.name,
            "the recording names no vehicle; --vehicle chooses another",
        ),
    };
    let overrides = options.setup.overrides();
    let config = config::load(vehicle, &overrides)?;
    range_sensors(&config)?;
    check_start(&survey, command.start_s)?;
    let mut plan = plan(&survey, &config)?;
    let sensors = plan.sensors.iter();
    let sensors = sensors.map(|(name, topic)| format!("{name}: {topic}"));
    let advice = advise(vehicle, &overrides, &config, false);
    let vehicle = std::iter::once(format!("{vehicle} ({why})"));
    plan.notes = vehicle
        .chain(sensors)
        .chain(plan.notes)
        .chain(advice)
        .collect();
    Ok((survey, config, plan))
}

pub(super) fn create_run<'a>(
    command: &'a Replay,
    quiet: bool,
    survey: &Survey,
    config: &'a Config,
    plan: Plan,
) -> anyhow::Result<(Run<'a>, ReplaySource)> {
    let options = &command.mapping;
    let events = plan.notes.into_iter().map(|message| Event {
        stamp_s: None,
        kind: SETUP.to_owned(),
        message,
    });
    let run = Run {
        source: command.recording.display().to_string(),
        title: file_name(&command.recording),
        config,
        registration: registration_settings(config, &plan.localization_plan),
        rate: command.rate,
        is_live: false,
        network: NetworkPlan::new(&options.network, options.robot.as_ref(), config)?,
        drive: DrivePlan::none(),
        record: options.record.clone(),
        foxglove: options.foxglove_address()?,
        export: options.export.clone(),
        map: &options.map,
        summary: options.summary.clone(),
        quiet,
        earliest: survey.stamps.iter().filter_map(|stamps| stamps.first).min(),
        events: events.collect(),
        devices: None,
        tilt: None,
        ros: None,
    };
    let what = source::Replay {
        own_poses: *plan.localization_plan.origin.prior() == PoseOrigin::Log,
        start: RobotDuration::from_secs_f64(command.start_s),
        duration: command.duration_s.map(RobotDuration::from_secs_f64),
        repeat: command.repeat,
        streams: plan.streams.clone(),
    };
    // `--record` needs all streams; otherwise only the mapped ones are read.
    let selection = match options.record {
        Some(_) => Selection::All,
        None => Selection::Named(plan.streams),
    };
    let path = command.recording.clone();
    let poses = poses_of(command)?;
    let open = move || {
        let miss_range_m = plan.inferred_miss_range_m;
        recording::open_surveyed(&path, selection.clone(), miss_range_m, poses.clone())
    };
    Ok((run, ReplaySource::new(Box::new(open), what)?))
}

/// The length of the recording, as far as the survey knows it. A recording that was surveyed completely is read once
/// more, so that the length equals the end of the replay: mapped data may follow the last scan, and clock resets count.
pub(super) fn length(
    survey: &Survey,
    source: &mut ReplaySource,
) -> Result<Option<Length>, recording::RecordingError> {
    if survey.lacks_range_sensor() {
        return Ok(None);
    }
    if survey.is_complete() {
        return Ok(Some(Length {
            duration: source.length()?,
            is_estimate: false,
        }));
    }
    let part = survey.position.bytes_read as f64 / survey.position.bytes_total as f64;
    Ok(Some(Length {
        duration: RobotDuration::from_secs_f64(survey.duration().as_secs_f64() / part),
        is_estimate: true,
    }))
}

fn check_start(survey: &Survey, start_s: f64) -> Result<(), UsageError> {
    let length_s = survey.duration().as_secs_f64();
    if survey.is_complete() && !survey.scans.is_empty() && start_s > length_s {
        return Err(UsageError(format!(
            "{}: --start {start_s} is behind its end: its last scan is {length_s:.1} s behind its first",
            survey.path.display()
        )));
    }
    Ok(())
}

/// Title of the pictures.
fn file_name(path: &Path) -> String {
    path.file_name()
        .unwrap_or(path.as_os_str())
        .to_string_lossy()
        .into_owned()
}

fn check_readable(survey: &Survey) -> Result<(), recording::RecordingError> {
    let messages: u64 = survey.streams.iter().map(|summary| summary.messages).sum();
    if messages > 0 || survey.losses.total() == 0 {
        return Ok(());
    }
    Err(recording::RecordingError::Damaged {
        path: survey.path.clone(),
        offset: 0,
        what: survey
            .loss_notes
            .first()
            .cloned()
            .unwrap_or_else(|| "nothing can be read".to_owned()),
        remedy: "Nothing in it can be read",
    })
}
