//! Velocities to the motors of a ROS 2 system, as the messages that its subscribers take.

use zenoh::qos::Priority;

use super::node::{PublisherSettings, RosLinkError, RosNode, RosPublisher};
use super::subscribers::SubscriberWatch;
use crate::actuators::Velocity;
use crate::actuators::published_velocity::VelocitySink;
use crate::config::motors::VelocityMessage;
use measurement::Twist;
use measurement::time::RobotTime;
use network::clock;
use recording::ros::middleware::{DiscoveredTopic, PublishedType};
use recording::ros::published::{twist, twist_stamped};

/// Whether plain and stamped messages are meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Messages {
    plain: bool,
    stamped: bool,
}

pub struct TwistPublisher {
    message: VelocityMessage,
    /// Frame of the vehicle.
    frame: String,
    plain: RosPublisher,
    stamped: RosPublisher,
    subscribers: SubscriberWatch,
}

impl TwistPublisher {
    pub fn new(
        node: &RosNode,
        topic: &str,
        message: VelocityMessage,
        frame: &str,
    ) -> Result<Self, RosLinkError> {
        let settings = PublisherSettings {
            priority: Priority::RealTime,
            is_kept: false,
            is_bridged: true,
        };
        Ok(Self {
            message,
            frame: frame.to_owned(),
            plain: node.publisher(topic, PublishedType::TWIST, settings)?,
            stamped: node.publisher(topic, PublishedType::TWIST_STAMPED, settings)?,
            subscribers: SubscriberWatch::new(node, topic)?,
        })
    }

    /// What is announced, and what is sent to bridges: their keys do not name the type, and a subscriber would read velocities of the
    /// other type as others. So nothing is sent to them before a subscriber is known, or where both types are taken.
    fn messages(&self) -> [Messages; 2] {
        let subscribers = self.subscribers.get();
        let announced = chosen(self.message, subscribers.values());
        let mut of_bridges = subscribers
            .values()
            .filter(|subscriber| subscriber.key.is_some())
            .peekable();
        let is_known = self.message != VelocityMessage::Auto || of_bridges.peek().is_some();
        let taken = chosen(self.message, of_bridges);
        let bridged = Messages {
            plain: is_known && taken.plain && !taken.stamped,
            stamped: taken.stamped && !taken.plain,
        };
        [announced, bridged]
    }
}

fn chosen<'a>(
    message: VelocityMessage,
    subscribers: impl Iterator<Item = &'a DiscoveredTopic>,
) -> Messages {
    let taken: Vec<_> = subscribers
        .map(|taken| taken.stream.type_name.as_str())
        .collect();
    let takes = |kind: PublishedType| taken.contains(&kind.name);
    let stamped = match message {
        VelocityMessage::Auto => takes(PublishedType::TWIST_STAMPED),
        VelocityMessage::Twist => false,
        VelocityMessage::TwistStamped => true,
    };
    let plain = match message {
        VelocityMessage::Auto => !stamped || takes(PublishedType::TWIST),
        VelocityMessage::Twist => true,
        VelocityMessage::TwistStamped => false,
    };
    Messages { plain, stamped }
}

impl VelocitySink for TwistPublisher {
    fn publish(&mut self, velocity: Velocity) {
        let velocity = Twist {
            linear_mps: [velocity.linear_mps, velocity.lateral_mps, 0.0],
            angular_radps: [0.0, 0.0, velocity.angular_radps],
        };
        let stamp = RobotTime::from_nanos(clock::nanos_since_1970());
        let [announced, bridged] = self.messages();
        // The keys of `rmw_zenoh` name the type, so that each subscriber gets what it takes, even without a token.
        let is_auto = self.message == VelocityMessage::Auto;
        for (publisher, message, is_announced, is_bridged) in [
            (
                &mut self.plain,
                twist(&velocity),
                announced.plain,
                bridged.plain,
            ),
            (
                &mut self.stamped,
                twist_stamped(stamp, &self.frame, &velocity),
                announced.stamped,
                bridged.stamped,
            ),
        ] {
            if let Err(why) = publisher.announce(is_announced) {
                tracing::warn!(%why, "velocities are not listed in the ROS 2 system");
            }
            if is_auto || is_announced {
                publisher.put(message.clone());
            }
            if is_bridged {
                publisher.put_bridged(message);
            }
        }
    }

    fn has_subscriber(&self) -> bool {
        self.plain.has_subscriber() || self.stamped.has_subscriber()
    }
}

#[cfg(test)]
mod tests {
    use std::thread;
    use std::time::Duration;

    use measurement::Stream;
    use zenoh::Wait as _;

    use super::super::node::RosEndpoint;
    use super::super::test_router::{self, announced, free_endpoint};
    use super::*;

    #[test]
    fn subscribers_or_the_configuration_choose_the_message() {
        use VelocityMessage as Message;
        let (plain, stamped) = (PublishedType::TWIST, PublishedType::TWIST_STAMPED);
        for (message, taken, expected) in [
            (Message::Auto, &[][..], (true, false)),
            (Message::Auto, &[plain], (true, false)),
            (Message::Auto, &[stamped], (false, true)),
            (Message::Auto, &[stamped, plain], (true, true)),
            (Message::Auto, &[PublishedType::PATH], (true, false)),
            (Message::Twist, &[stamped], (true, false)),
            (Message::TwistStamped, &[plain], (false, true)),
        ] {
            let taken: Vec<_> = taken
                .iter()
                .map(|kind| DiscoveredTopic {
                    stream: Stream {
                        name: "/cmd_vel".to_owned(),
                        type_name: kind.name.to_owned(),
                    },
                    key: None,
                })
                .collect();
            let chosen = chosen(message, taken.iter());
            assert_eq!((chosen.plain, chosen.stamped), expected, "{message:?}");
        }
    }

    #[test]
    fn the_topic_is_listed_with_the_type_that_is_taken() {
        let endpoint = free_endpoint();
        let router = test_router::start(&endpoint);
        let node = RosNode::open(&RosEndpoint {
            endpoint,
            domain: 7,
        });
        let message = VelocityMessage::Auto;
        let mut publisher =
            TwistPublisher::new(&node.unwrap(), "/cmd_vel", message, "base_link").unwrap();
        let mut is_listed = |type_name: &str| {
            let began = clock::now();
            let expected = [("/cmd_vel".to_owned(), type_name.to_owned())];
            while announced(&router) != expected {
                assert!(
                    clock::elapsed(began) < Duration::from_mins(1),
                    "{type_name}"
                );
                publisher.publish(Velocity::ZERO);
                thread::sleep(Duration::from_millis(5));
            }
        };
        is_listed("geometry_msgs/Twist");
        let token =
            "@ros2_lv/7/aa/0/1/MS/%/%/base/%cmd_vel/geometry_msgs::msg::dds_::TwistStamped_/x/q";
        let taker = router.liveliness().declare_token(token).wait().unwrap();
        is_listed("geometry_msgs/TwistStamped");
        taker.undeclare().wait().unwrap();
        is_listed("geometry_msgs/Twist");
    }
}
