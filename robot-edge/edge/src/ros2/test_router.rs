//! A router in the tests of this module.

use std::net::TcpListener;

use recording::ros::middleware::{TopicEnd, parse_token};
use zenoh::{Config, Session, Wait as _};

/// An endpoint of this machine that nothing listens on.
pub(super) fn free_endpoint() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    format!("tcp/{}", listener.local_addr().unwrap())
}

pub(super) fn start(endpoint: &str) -> Session {
    let mut config = Config::default();
    for (key, value) in [
        ("mode", "\"router\"".to_owned()),
        ("listen/endpoints", format!("[\"{endpoint}\"]")),
        ("scouting/multicast/enabled", "false".to_owned()),
    ] {
        config.insert_json5(key, &value).unwrap();
    }
    zenoh::open(config).wait().unwrap()
}

/// The announced topics and types of domain 7, sorted.
pub(super) fn announced(router: &Session) -> Vec<(String, String)> {
    let tokens = router.liveliness().get("@ros2_lv/7/**").wait().unwrap();
    let topics = tokens.into_iter().filter_map(|reply| {
        let token = reply.result().ok()?.key_expr().to_string();
        let topic = parse_token(&token, TopicEnd::Publisher)?;
        Some((topic.stream.name, topic.stream.type_name))
    });
    let mut topics: Vec<_> = topics.collect();
    topics.sort();
    topics
}
