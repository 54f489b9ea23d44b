//! `simulate`: a simulated world as the source.

use std::io::Write;
use std::sync::atomic::AtomicBool;

use super::network::NetworkPlan;
use super::outputs::SETUP;
use super::placing::{main_laser, placer_settings};
use super::run::Run;
use super::source::Simulated;
use crate::cli::Simulate;
use crate::config::{self, Config};
use crate::exit::{Exit, UsageError};
use crate::localization::config::PoseSource;
use crate::localization::placer::{MountOrigin, PoseOrigin};
use crate::simulation::{SimulatedSource, SimulationOptions, World};
use crate::summary::Event;

pub(super) fn simulate(
    command: &Simulate,
    quiet: bool,
    interrupt: &AtomicBool,
    out: &mut dyn Write,
) -> anyhow::Result<Exit> {
    let options = &command.mapping;
    let world = World::load(&command.world)?;
    let vehicle = options
        .vehicle
        .as_deref()
        .unwrap_or_else(|| world.vehicle());
    let config = config::load(vehicle, &options.overrides())?;
    let source = SimulatedSource::new(
        &world,
        SimulationOptions {
            seed: command.seed,
            duration_s: command.duration_s,
            ..SimulationOptions::default()
        },
    )
    .map_err(|err| UsageError(err.to_string()))?;
    let run = Run {
        source: command.world.clone(),
        title: world.name().to_owned(),
        placer: placer_settings(&config, main_laser(&config)?, pose_origin(&config)?),
        config: &config,
        rate: command.rate,
        network: NetworkPlan::new(&options.network, options.robot.as_ref(), &config)?,
        record: options.record.clone(),
        export: options.export.clone(),
        summary: options.summary.clone(),
        quiet,
        earliest: None,
        events: vec![Event {
            stamp_s: None,
            kind: SETUP.to_owned(),
            message: format!(
                "{vehicle}, in world {} with seed {}",
                world.name(),
                command.seed
            ),
        }],
    };
    run.go(&mut Simulated(source), interrupt, out)
}

/// A simulated vehicle says where it is in two ways.
fn pose_origin(config: &Config) -> Result<PoseOrigin, UsageError> {
    let fixed_frame = config.localization.fixed_frame.as_deref().unwrap_or("odom");
    match config.localization.source {
        PoseSource::Auto | PoseSource::Tf => Ok(PoseOrigin::Tf {
            mount: MountOrigin::Tree, fixed_frame: fixed_frame.into() }),
        PoseSource::Odometry => Ok(PoseOrigin::Odometry),
        PoseSource::Static => Ok(PoseOrigin::Static),
        PoseSource::Log => Err(UsageError(
            "localization.source = \"log\" is for CARMEN logs: a simulated scan carries no pose of its \
             own; use \"auto\""
                .to_owned(),
        )),
    }
}
