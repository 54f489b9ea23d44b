//! Key expressions: any received key is a topic with exactly that key, or foreign.
#![no_main]

use libfuzzer_sys::fuzz_target;
use protocol::keys::{RobotId, Topic, operator_key, parse_operator_key, view_of};

fuzz_target!(|key: &str| {
    if let Ok(robot) = key.parse::<RobotId>() {
        assert_eq!(robot.to_string(), key);
        let pose = Topic::Pose.key(&robot);
        assert_eq!(Topic::parse(&pose), Some((robot, Topic::Pose)));
    }
    match Topic::parse(key) {
        Some((robot, Topic::View)) => {
            let (_, session) = key.rsplit_once('/').unwrap();
            if let Ok(session) = session.parse() {
                assert_eq!(view_of(&robot, &session), key);
            }
        }
        Some((_, Topic::Operator(_))) => {
            let (robot, operator, topic) = parse_operator_key(key).unwrap();
            assert_eq!(operator_key(&robot, &operator, topic), key);
        }
        Some((robot, topic)) => assert_eq!(topic.key(&robot), key),
        None => {}
    }
});
