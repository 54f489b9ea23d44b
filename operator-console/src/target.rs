//! Which robot a command without a window is about.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::anyhow;
use protocol::keys::RobotId;
use robot_edge::clock::{self, Monotonic};
use robot_edge::credentials::Credentials;
use robot_edge::exit::{Interrupted, UsageError};
use robot_edge::link::zenoh_config_file;

use crate::link::{Discovery, FoundRobot};

/// Between two looks at who was found.
const LOOK: Duration = Duration::from_millis(20);

/// A robot, as the command line describes it.
#[derive(Clone, Debug)]
pub(crate) struct Target {
    /// Addresses to ask; where there are none the network is searched.
    pub(crate) connect: Vec<String>,
    /// Which robot; else the only one there is.
    pub(crate) robot: Option<RobotId>,
    /// A Zenoh configuration.
    pub(crate) zenoh_config: Option<PathBuf>,
    /// Who asks, where the link is secured.
    pub(crate) credentials: Option<Credentials>,
    /// How long to look for it.
    pub(crate) timeout: Duration,
}

impl Target {
    /// The robot that is meant: the one that is named, or the only one.
    pub(crate) fn find(&self, is_interrupted: &impl Fn() -> bool) -> anyhow::Result<FoundRobot> {
        // A named robot at one address needs no asking: the link waits for it.
        if let (Some(robot), [endpoint]) = (&self.robot, &self.connect[..]) {
            return Ok(FoundRobot {
                robot: robot.clone(),
                endpoint: endpoint.clone(),
            });
        }
        let zenoh_config = zenoh_config_file(self.zenoh_config.clone());
        let discovery = Discovery::start(
            self.connect.clone(),
            self.connect.is_empty(),
            zenoh_config,
            self.credentials.clone(),
            || {},
        );
        let deadline = Monotonic::now() + self.timeout;
        let mut found = Vec::new();
        let is_found = |found: &[FoundRobot]| match &self.robot {
            Some(robot) => found.iter().any(|found| found.robot == *robot),
            None => !found.is_empty(),
        };
        while !is_found(&found) {
            if deadline.since(Monotonic::now()).is_zero() {
                return Err(self.nobody(&found, discovery.problem().as_deref()));
            }
            if !clock::sleep_until(Monotonic::now() + LOOK, is_interrupted) {
                return Err(Interrupted.into());
            }
            found = discovery.found();
        }
        match &self.robot {
            Some(robot) => found.retain(|found| found.robot == *robot),
            None if found.len() > 1 => {
                let names: Vec<_> = found.iter().map(|found| found.robot.to_string()).collect();
                return Err(UsageError(format!(
                    "there are several robots ({}): name one with --robot",
                    names.join(", ")
                ))
                .into());
            }
            None => {}
        }
        found.into_iter().next().ok_or_else(|| anyhow!("no robot"))
    }

    fn nobody(&self, found: &[FoundRobot], problem: Option<&str>) -> anyhow::Error {
        let names: BTreeSet<_> = found.iter().map(|found| found.robot.to_string()).collect();
        let there_is = match names.len() {
            0 => "no robot".to_owned(),
            _ => format!("only {}", names.into_iter().collect::<Vec<_>>().join(", ")),
        };
        let place = match &self.connect[..] {
            [] => "on the local network".to_owned(),
            addresses => format!("at {}", addresses.join(", ")),
        };
        let problem = problem
            .map(|problem| format!(" ({problem})"))
            .unwrap_or_default();
        anyhow!(
            "there is {there_is} {place}{problem}; start one with `robot-edge`, or name its address with --connect"
        )
    }
}
