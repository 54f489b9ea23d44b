//! Which robot a command without a window is about.

use std::collections::BTreeSet;
use std::io::{self, Write as _};
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
    /// Say nothing.
    pub(crate) quiet: bool,
}

/// Who is there has answered by then, even at the far end of a slow link.
const SOON: Duration = Duration::from_secs(2);

/// Says once that nobody answers, as long as there is time to see to it.
pub(crate) struct Unanswered {
    /// Where nobody answers.
    place: String,
    timeout: Duration,
    since: Monotonic,
    is_told: bool,
}

impl Unanswered {
    /// From `since` on, for `timeout`. `is_quiet`: nothing is to be said.
    fn new(place: String, timeout: Duration, is_quiet: bool, since: Monotonic) -> Self {
        Self {
            place,
            timeout,
            since,
            is_told: is_quiet || timeout <= SOON,
        }
    }

    /// Nobody has answered yet: says so on standard error, if it is time to.
    pub(crate) fn complain(&mut self, now: Monotonic) {
        if let Some(complaint) = self.complaint(now) {
            // What cannot be said keeps nobody from waiting.
            drop(writeln!(io::stderr(), "{complaint}"));
        }
    }

    /// What is to be said at `now`, where nobody has answered yet.
    fn complaint(&mut self, now: Monotonic) -> Option<String> {
        if self.is_told || now.since(self.since) < SOON {
            return None;
        }
        self.is_told = true;
        let timeout_s = self.timeout.as_secs_f64();
        let place = &self.place;
        Some(format!(
            "nobody answers {place} yet: trying for {timeout_s:.0} s"
        ))
    }
}

impl Target {
    /// The wait for an answer begins.
    pub(crate) fn unanswered(&self) -> Unanswered {
        Unanswered::new(self.place(), self.timeout, self.quiet, Monotonic::now())
    }

    fn place(&self) -> String {
        match &self.connect[..] {
            [] => "on the local network".to_owned(),
            addresses => format!("at {}", addresses.join(", ")),
        }
    }

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
        let mut unanswered = self.unanswered();
        let mut found = Vec::new();
        let is_found = |found: &[FoundRobot]| match &self.robot {
            Some(robot) => found.iter().any(|found| found.robot == *robot),
            None => !found.is_empty(),
        };
        while !is_found(&found) {
            if deadline.since(Monotonic::now()).is_zero() {
                return Err(self.nobody(&found, discovery.complaints().as_deref()));
            }
            if !clock::sleep_until(Monotonic::now() + LOOK, is_interrupted) {
                return Err(Interrupted.into());
            }
            found = discovery.found();
            if found.is_empty() {
                unanswered.complain(Monotonic::now());
            }
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
        let place = self.place();
        let problem = problem
            .map(|problem| format!(" ({problem})"))
            .unwrap_or_default();
        anyhow!(
            "there is {there_is} {place}{problem}; start one with `robot-edge`, or name its address with --connect"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn silence_is_told_once_and_soon() {
        const fn at(s: u64) -> Monotonic {
            Monotonic::from_nanos(s * 1_000_000_000)
        }
        let place = || "at tcp/nowhere:7447".to_owned();
        let minute = Duration::from_mins(1);
        let mut unanswered = Unanswered::new(place(), minute, false, at(10));
        assert_eq!(unanswered.complaint(at(11)), None);
        assert_eq!(
            unanswered.complaint(at(12)).as_deref(),
            Some("nobody answers at tcp/nowhere:7447 yet: trying for 60 s")
        );
        assert_eq!(unanswered.complaint(at(13)), None);
        for mut silent in [
            Unanswered::new(place(), minute, true, at(10)),
            Unanswered::new(place(), Duration::from_secs(1), false, at(10)),
        ] {
            assert_eq!(silent.complaint(at(30)), None);
        }
    }
}
