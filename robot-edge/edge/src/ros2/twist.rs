//! Velocities to a ROS 2 system: `geometry_msgs/Twist`, for whichever way it speaks Zenoh.

use std::time::Duration;

use zenoh::Wait as _;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};

use super::session::RosLinkError;
use crate::actuators::Velocity;
use crate::actuators::published_velocity::VelocitySink;
use measurement::Twist;
use measurement::time::Monotonic;
use measurement::time::RobotTime;
use network::clock::{self, seconds_since_1970};
use recording::ros::middleware::Attachment;
use recording::ros::twist_message;

/// One topic, under each key that it may have.
pub struct TwistPublisher {
    publishers: Vec<Publisher<'static>>,
    gid: [u8; 16],
    sequence: i64,
    since: Monotonic,
}

/// Until the router has said who listens, Zenoh takes it that somebody does.
const MATCHING_DELAY: Duration = Duration::from_secs(1);

impl TwistPublisher {
    pub(super) fn new(
        session: &zenoh::Session,
        keys: impl IntoIterator<Item = String>,
        gid: [u8; 16],
    ) -> Result<Self, RosLinkError> {
        let publisher = |key: String| {
            session
                .declare_publisher(key.clone())
                .congestion_control(CongestionControl::Drop)
                .priority(Priority::RealTime)
                .express(true)
                .wait()
                .map_err(|why| RosLinkError::Declare { what: key, why })
        };
        Ok(Self {
            publishers: keys.into_iter().map(publisher).collect::<Result<_, _>>()?,
            gid,
            sequence: 0,
            since: clock::now(),
        })
    }
}

impl VelocitySink for TwistPublisher {
    fn publish(&mut self, velocity: Velocity) {
        self.sequence += 1;
        let seconds = i64::try_from(seconds_since_1970()).unwrap_or(0);
        let attachment = Attachment {
            sequence: self.sequence,
            published: RobotTime::from_nanos(seconds.saturating_mul(1_000_000_000)),
            gid: self.gid,
        };
        let payload = twist_message(&Twist {
            linear_mps: [velocity.linear_mps, 0.0, 0.0],
            angular_radps: [0.0, 0.0, velocity.angular_radps],
        });
        for publisher in &self.publishers {
            let put = publisher
                .put(payload.clone())
                .attachment(attachment.encode());
            if let Err(why) = put.wait() {
                tracing::warn!(%why, "a velocity was not published");
            }
        }
    }

    fn has_subscriber(&self) -> bool {
        clock::elapsed(self.since) >= MATCHING_DELAY
            && self.publishers.iter().any(|publisher| {
                let status = publisher.matching_status().wait();
                status.is_ok_and(|status| status.matching())
            })
    }
}
