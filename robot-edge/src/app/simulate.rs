//! `simulate`: a simulated world as the source.

use std::io::Write;
use std::sync::atomic::AtomicBool;

use super::network::NetworkPlan;
use super::outputs::SETUP;
use super::placing::{main_laser, placer_settings, poses_from_wheels};
use super::run::Run;
use super::source::Simulated;
use crate::cli::Simulate;
use crate::config::{self, Config, WheelsAndAttitude};
use crate::exit::{Exit, UsageError};
use crate::localization::config::PoseSource;
use crate::localization::placer::{MountOrigin, PoseOrigin};
use crate::measurement::Stream;
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
        placer: placer_settings(
            &config,
            main_laser(&config)?,
            pose_origin(&config, source.streams())?,
        ),
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

/// A simulated vehicle says where it is in every way there is, except that its scans carry no pose.
pub(crate) fn pose_origin(config: &Config, streams: &[Stream]) -> Result<PoseOrigin, UsageError> {
    let fixed_frame = config.localization.fixed_frame.as_deref().unwrap_or("odom");
    match config.localization.source {
        PoseSource::Auto | PoseSource::Tf => Ok(PoseOrigin::Tf {
            fixed_frame: fixed_frame.into(),
            mount: MountOrigin::Tree,
        }),
        PoseSource::Odometry => Ok(PoseOrigin::Odometry),
        PoseSource::Static => Ok(PoseOrigin::Static),
        PoseSource::Wheels => from_wheels(config, streams),
        PoseSource::Log => Err(UsageError(
            "localization.source = \"log\" is for CARMEN logs: a simulated scan carries no pose of its \
             own; use \"auto\""
                .to_owned(),
        )),
    }
}

fn from_wheels(config: &Config, streams: &[Stream]) -> Result<PoseOrigin, UsageError> {
    let has = |type_name| streams.iter().any(|stream| stream.type_name == type_name);
    let sensors = WheelsAndAttitude::of(&config.sensors);
    match sensors {
        Ok(sensors) if has("sensor_msgs/JointState") && has("sensor_msgs/Imu") => {
            Ok(poses_from_wheels(config, &sensors))
        }
        Ok(_) | Err(_) => Err(UsageError(
            "localization.source = \"wheels\": this simulated vehicle has no wheel encoders or no attitude \
             sensor; use \"auto\""
                .to_owned(),
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Override, load};

    fn origin(settings: &[&str], types: &[&str]) -> Result<PoseOrigin, String> {
        let overrides: Vec<Override> = settings.iter().map(|set| set.parse().unwrap()).collect();
        let stream = |type_name: &&str| Stream {
            name: String::new(),
            type_name: (*type_name).to_owned(),
        };
        let streams: Vec<_> = types.iter().map(stream).collect();
        pose_origin(&load("generic2d", &overrides).unwrap(), &streams)
            .map_err(|error| error.to_string())
    }

    #[test]
    fn a_simulated_run_takes_poses_from_where_it_is_told_to() {
        let tf = PoseOrigin::Tf {
            fixed_frame: "odom".into(),
            mount: MountOrigin::Tree,
        };
        assert_eq!(origin(&[], &[]), Ok(tf.clone()));
        assert_eq!(origin(&["localization.source=tf"], &[]), Ok(tf));
        let odometry = origin(&["localization.source=odometry"], &[]);
        assert_eq!(odometry, Ok(PoseOrigin::Odometry));
        let still = origin(&["localization.source=static"], &[]);
        assert_eq!(still, Ok(PoseOrigin::Static));
        let log = origin(&["localization.source=log"], &[]).unwrap_err();
        assert!(log.contains("is for CARMEN logs"), "{log}");

        let wheels = [
            "localization.source=wheels",
            "sensors.wheels={kind = 'wheel_encoders', wheel_radius_m = 0.2}",
            "sensors.ahrs={kind = 'imu'}",
        ];
        let both = ["sensor_msgs/JointState", "sensor_msgs/Imu"];
        let Ok(PoseOrigin::Wheels(settings)) = origin(&wheels, &both) else {
            panic!("{:?}", origin(&wheels, &both));
        };
        assert!((settings.wheels.radius_m - 0.2).abs() < f64::EPSILON);
        let none = origin(&wheels, &both[..1]).unwrap_err();
        assert!(
            none.contains("this simulated vehicle has no wheel encoders"),
            "{none}"
        );
    }
}
