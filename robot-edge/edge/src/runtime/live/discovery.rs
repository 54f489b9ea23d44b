//! Waits for the sensors of a ROS 2 system that the configuration names.

use std::sync::atomic::AtomicBool;
use std::time::Duration;

use super::LiveSource;
use crate::config::{Config, RangeSensor};
use crate::exit::{Interrupted, UsageError};
use crate::ros2::{Inbox, RosEndpoint, RosLink, RosLinkError};
use crate::runtime::is_set;
use crate::runtime::localization_plan::range_sensors;
use crate::runtime::plan::{Plan, plan};
use crate::survey::Survey;
use mapping::registered_scan::ScanKind;
use measurement::time::Monotonic;
use network::clock::{self, sleep_until};

/// Time that rarer topics get after all others are complete.
const SETTLE_TIME: Duration = Duration::from_secs(2);
const POLL_INTERVAL: Duration = Duration::from_millis(250);
/// Interval of requests for static transforms until they arrive.
const HISTORY_RETRY_INTERVAL: Duration = Duration::from_secs(1);
const RETRY: Duration = Duration::from_millis(250);
const MAX_LISTED: usize = 40;

#[derive(Clone, Copy, Debug)]
pub(in crate::runtime) struct TopicDiscovery<'a> {
    pub(in crate::runtime) at: &'a RosEndpoint,
    pub(in crate::runtime) wait: Duration,
    pub(in crate::runtime) config: &'a Config,
}

/// Connects, waits for the sensors, and chooses the mapped streams. An error lists the received topics.
pub(in crate::runtime) fn find(
    discovery: TopicDiscovery<'_>,
    interrupt: &AtomicBool,
) -> anyhow::Result<(LiveSource, Plan)> {
    let began = clock::now();
    let deadline = began + discovery.wait;
    let sensors = range_sensors(discovery.config)?;
    let takes_clouds = has_lidar(&sensors);
    // What a planner takes and sends measures nothing.
    let planner = discovery.config.planner.iter();
    let ignored: Vec<_> = planner
        .flat_map(|planner| [&planner.goal_topic, &planner.velocity_topic])
        .cloned()
        .collect();
    let what = (takes_clouds, &ignored[..]);
    let (link, inbox) = connect(discovery.at, what, deadline, interrupt)?;
    let mut live = LiveSource::new(link, inbox);
    let mut asked: Option<Monotonic> = None;
    let mut first: Option<Monotonic> = None;
    live.expect_topics(&sensors);
    let all = sensors.len();
    loop {
        let is_answered = live.has_static_transforms();
        if !is_answered && asked.is_none_or(|asked| clock::elapsed(asked) >= HISTORY_RETRY_INTERVAL)
        {
            live.link().request_history()?;
            asked = Some(clock::now());
        }
        if live.probe(POLL_INTERVAL) {
            first.get_or_insert_with(clock::now);
        }
        if is_set(interrupt) {
            return Err(Interrupted.into());
        }
        let is_over = deadline.since(clock::now()).is_zero();
        if !is_over && first.is_none_or(|first| clock::elapsed(first) < SETTLE_TIME) {
            continue;
        }
        let survey = live.survey(&discovery.at.endpoint)?;
        match decide(&survey, discovery.config) {
            Ok(plan) if is_over || plan.sensors.len() == all => return Ok((live, plan)),
            Err(error) if is_over => return Err(with_topics(&error, &discovery, &live, &survey)),
            Ok(_) | Err(_) => {}
        }
    }
}

fn connect(
    at: &RosEndpoint,
    (takes_clouds, ignored): (bool, &[String]),
    deadline: Monotonic,
    interrupt: &AtomicBool,
) -> anyhow::Result<(RosLink, Inbox)> {
    let mut is_reported = false;
    loop {
        match RosLink::open(at, takes_clouds, ignored) {
            Ok(opened) => return Ok(opened),
            Err(RosLinkError::Open { .. }) if !deadline.since(clock::now()).is_zero() => {
                if !std::mem::replace(&mut is_reported, true) {
                    let rest_s = deadline.since(clock::now()).as_secs_f64();
                    tracing::warn!(
                        "no answer at {} yet: trying for {rest_s:.0} s more",
                        at.endpoint
                    );
                }
                sleep_until(clock::now() + RETRY, || is_set(interrupt));
                if is_set(interrupt) {
                    return Err(Interrupted.into());
                }
            }
            Err(error @ RosLinkError::Open { .. }) => {
                return Err(anyhow::Error::new(error).context(format!(
                    "{}: no ROS 2 system. Start its Zenoh router (`ros2 run rmw_zenoh_cpp rmw_zenohd`) or \
                     zenoh-bridge-ros2dds, or say with --ros where it is",
                    at.endpoint
                )));
            }
            Err(error) => return Err(UsageError(error.to_string()).into()),
        }
    }
}

fn has_lidar(sensors: &[RangeSensor<'_>]) -> bool {
    let mut kinds = sensors.iter().map(|sensor| sensor.config.scan_kind);
    kinds.any(|kind| kind == ScanKind::Cloud)
}

fn decide(survey: &Survey, config: &Config) -> anyhow::Result<Plan> {
    if survey.lacks_range_sensor() {
        let lacks = if has_lidar(&range_sensors(config)?) {
            "no clouds (sensor_msgs/PointCloud2)"
        } else {
            "no scans (sensor_msgs/LaserScan)"
        };
        let place = survey.path.display();
        return Err(UsageError(format!("{place}: {lacks} came")).into());
    }
    plan(survey, config)
}

fn with_topics(
    error: &anyhow::Error,
    discovery: &TopicDiscovery<'_>,
    live: &LiveSource,
    survey: &Survey,
) -> anyhow::Error {
    let received = survey.streams.iter().map(|summary| {
        let stream = &summary.stream;
        let messages = summary.messages;
        format!(
            "\n  {} ({}): {messages} messages",
            stream.name, stream.type_name
        )
    });
    let silent = live.link().announced().into_iter().filter(|announced| {
        let has_data = |known: &recording::StreamSummary| known.stream == *announced;
        !survey.streams.iter().any(has_data)
    });
    let silent = silent.map(|stream| {
        format!(
            "\n  {} ({}): announced, no messages received",
            stream.name, stream.type_name
        )
    });
    let topics: Vec<_> = received.chain(silent).collect();
    let listed: String = topics.iter().take(MAX_LISTED).map(String::as_str).collect();
    let more = match topics.len().saturating_sub(MAX_LISTED) {
        0 => String::new(),
        more => format!("\n  and {more} more"),
    };
    let wait_s = discovery.wait.as_secs_f64();
    let domain = discovery.at.domain;
    let what = if topics.is_empty() {
        format!(
            "no topic was received or announced in {wait_s} s; does it run in domain {domain} (--ros-domain)?"
        )
    } else {
        format!("in {wait_s} s, in domain {domain} and from bridges, there were:{listed}{more}")
    };
    UsageError(format!("{error}; {what}")).into()
}
