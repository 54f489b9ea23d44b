//! Which robot a command without a window is about.

mod discovery_report;
mod wait_for_robot;

use std::path::PathBuf;
use std::time::Duration;

use anyhow::anyhow;
use protocol::keys::RobotId;
use robot_edge::clock;
use robot_edge::credentials::Credentials;
use robot_edge::exit::{Interrupted, UsageError};
use robot_edge::link::zenoh_config_file;

use crate::link::{Discovery, FoundRobot};

use discovery_report::DiscoveryReport;
use wait_for_robot::DelayedNotice;

pub(crate) use wait_for_robot::WaitForRobot;

/// Between two looks at who was found.
const POLL_PERIOD: Duration = Duration::from_millis(20);

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
    /// Say nothing.
    pub(crate) quiet: bool,
}

impl Target {
    /// A link to `found` is opened: the wait for what it says begins.
    pub(crate) fn wait_for_robot(&self, found: &FoundRobot) -> WaitForRobot {
        WaitForRobot::new(Self {
            connect: vec![found.endpoint.clone()],
            robot: Some(found.robot.clone()),
            ..self.clone()
        })
    }

    /// Asks for robots where this one is to be.
    fn start_discovery(&self) -> Discovery {
        Discovery::start(
            self.connect.clone(),
            self.connect.is_empty(),
            zenoh_config_file(self.zenoh_config.clone()),
            self.credentials.clone(),
            || {},
        )
    }

    fn place(&self) -> String {
        match &self.connect[..] {
            [] => "on the local network".to_owned(),
            addresses => format!("at {}", addresses.join(", ")),
        }
    }

    /// What is looked for, and where, in a line.
    pub(crate) fn looking(&self) -> String {
        let place = self.place();
        match &self.robot {
            Some(robot) => format!("looking for robot {robot} {place}"),
            None => format!("looking for a robot {place}"),
        }
    }

    /// The robot that is meant: the one that is named, or the only one. One that is named at a single address need not
    /// be there: whoever waits for its link is told.
    pub(crate) fn find(&self, is_interrupted: &impl Fn() -> bool) -> anyhow::Result<FoundRobot> {
        // A named robot at one address needs no asking: the link waits for it.
        if let (Some(robot), [endpoint]) = (&self.robot, &self.connect[..]) {
            return Ok(FoundRobot {
                robot: robot.clone(),
                endpoint: endpoint.clone(),
            });
        }
        let discovery = self.start_discovery();
        let started = clock::now();
        let deadline = started + self.timeout;
        let mut notice = DelayedNotice::new(self.timeout, self.quiet, started);
        let mut found = Vec::new();
        let is_found = |found: &[FoundRobot]| match &self.robot {
            Some(robot) => found.iter().any(|found| found.robot == *robot),
            None => !found.is_empty(),
        };
        while !is_found(&found) {
            let now = clock::now();
            if deadline.since(now).is_zero() {
                return Err(anyhow!(DiscoveryReport::of(&discovery).conclusion(self)));
            }
            if notice.is_due(now) {
                notice.print_once(&DiscoveryReport::of(&discovery).waiting(self));
            }
            if !clock::sleep_until(now + POLL_PERIOD, is_interrupted) {
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
}
