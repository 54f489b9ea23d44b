//! Zenoh's access control, made from roles: what is not named here is denied.
//!
//! A put that is denied still returns `Ok` to its sender, so whatever must arrive is acknowledged by the vehicle.

use std::collections::BTreeSet;

use protocol::keys::{
    OperatorTopic, RobotId, Topic, all_changes, all_of_robot, every_robot_alive, operator_key,
};
use protocol::layer::LayerId;
use serde_json::{Value, json};

use crate::credentials::{Identity, ListedOperator, OperatorList};

/// What people may subscribe to.
fn published_keys(robot: &RobotId) -> Vec<String> {
    let topics = [
        Topic::Pose,
        Topic::Status,
        Topic::Localization,
        Topic::Plan,
        Topic::Event,
        Topic::MapHead,
        Topic::Shores,
        Topic::Scan,
    ];
    let mut keys: Vec<_> = topics.into_iter().map(|topic| topic.key(robot)).collect();
    keys.push(all_changes(robot));
    keys
}

/// What people may ask.
fn query_keys(robot: &RobotId) -> Vec<String> {
    let layers = LayerId::ALL.into_iter().flat_map(|layer| {
        [Topic::Tiles, Topic::Overviews, Topic::Digests].map(|topic| topic(layer))
    });
    let topics = [
        Topic::Info,
        Topic::Ping,
        Topic::Shores,
        Topic::Voxels,
        Topic::Trajectory,
    ];
    topics
        .into_iter()
        .chain(layers)
        .map(|topic| topic.key(robot))
        .collect()
}

/// Presence: of one robot, and of all that there are.
fn liveliness_keys(robot: &RobotId) -> Vec<String> {
    vec![Topic::Alive.key(robot), every_robot_alive()]
}

/// Rules and their subjects, as Zenoh reads them.
#[derive(Default)]
struct AccessControl {
    rules: Vec<Value>,
    rule_names: BTreeSet<String>,
    subjects: Vec<Value>,
    policies: Vec<Value>,
}

impl AccessControl {
    /// Allows `messages` on `keys`, arriving (`ingress`) or leaving (`egress`); the rule's name.
    fn allow(&mut self, what: &str, flow: &str, messages: &[&str], keys: &[String]) -> String {
        let id = format!("{what} ({flow})");
        if self.rule_names.insert(id.clone()) {
            self.rules.push(json!({
                "id": id,
                "permission": "allow",
                "flows": [flow],
                "messages": messages,
                "key_exprs": keys,
            }));
        }
        id
    }

    fn grant(&mut self, identity: &Identity, rules: &[String]) {
        let name = identity.to_string();
        self.subjects.push(json!({
            "id": name,
            "cert_common_names": [name],
            "link_protocols": ["quic", "tls"],
        }));
        self.policies
            .push(json!({ "rules": rules, "subjects": [name] }));
    }

    fn into_value(self) -> Value {
        json!({
            "enabled": true,
            "default_permission": "deny",
            "rules": self.rules,
            "subjects": self.subjects,
            "policies": self.policies,
        })
    }

    /// The names of the rules for everybody who may watch a robot.
    fn observer_rules(&mut self, robot: &RobotId) -> Vec<String> {
        let views = [Topic::View.key(robot)];
        vec![
            self.allow(
                &format!("published by {robot}"),
                "ingress",
                &["declare_subscriber"],
                &published_keys(robot),
            ),
            self.allow(
                &format!("query {robot}"),
                "ingress",
                &["query"],
                &query_keys(robot),
            ),
            self.allow(
                &format!("liveliness of {robot}"),
                "ingress",
                &["liveliness_query", "declare_liveliness_subscriber"],
                &liveliness_keys(robot),
            ),
            self.allow(&format!("view of {robot}"), "ingress", &["put"], &views),
            // What leaves goes to subscribers and queriers, which the rules above decide.
            self.allow(
                &format!("receive from {robot}"),
                "egress",
                &[
                    "put",
                    "reply",
                    "liveliness_token",
                    "declare_subscriber",
                    "declare_queryable",
                ],
                &[all_of_robot(robot)],
            ),
        ]
    }

    /// The names of the rules for what operators send under the keys that `key` gives.
    fn command_rules(&mut self, what: &str, key: impl Fn(OperatorTopic) -> String) -> [String; 2] {
        let requests = OperatorTopic::ALL
            .into_iter()
            .filter(|topic| *topic != OperatorTopic::Drive);
        let requests: Vec<_> = requests.map(&key).collect();
        [
            self.allow(
                &format!("drive, {what}"),
                "ingress",
                &["put"],
                &[key(OperatorTopic::Drive)],
            ),
            self.allow(
                &format!("requests, {what}"),
                "ingress",
                &["query"],
                &requests,
            ),
        ]
    }

    /// What a person of a robot's list may: the rules' names.
    fn operator_rules(&mut self, robot: &RobotId, listed: &ListedOperator) -> Vec<String> {
        let mut rules = self.observer_rules(robot);
        if listed.role.may_drive() {
            let key = |topic| operator_key(robot, &listed.name, topic);
            rules.extend(self.command_rules(&format!("{} to {robot}", listed.name), key));
        }
        rules
    }
}

/// Access control of a vehicle: `people` come directly, or through a router.
pub(crate) fn vehicle_access(robot: &RobotId, people: &OperatorList) -> Value {
    let mut access = AccessControl::default();
    for listed in people.people() {
        let rules = access.operator_rules(robot, listed);
        access.grant(&listed.identity(), &rules);
    }
    let mut rules = access.observer_rules(robot);
    // Which operators are behind it, the router's own access control decides, and their signatures.
    let key = |topic| Topic::Operator(topic).key(robot);
    rules.extend(access.command_rules(&format!("everybody to {robot}"), key));
    access.grant(&Identity::Router, &rules);
    access.into_value()
}

/// Access control of a router between `vehicles` and the people on their lists.
pub(super) fn router_access(vehicles: &[(RobotId, OperatorList)]) -> Value {
    let mut access = AccessControl::default();
    let mut people: Vec<(Identity, Vec<String>)> = Vec::new();
    for (robot, list) in vehicles {
        let all = [all_of_robot(robot)];
        let sends = access.allow(
            &format!("{robot} itself"),
            "ingress",
            &[
                "put",
                "reply",
                "liveliness_token",
                "declare_subscriber",
                "declare_queryable",
            ],
            &all,
        );
        let gets = access.allow(
            &format!("to {robot}"),
            "egress",
            &["put", "query", "declare_subscriber"],
            &all,
        );
        let sought = access.allow(
            &format!("liveliness query of {robot}"),
            "egress",
            &["liveliness_query", "declare_liveliness_subscriber"],
            &liveliness_keys(robot),
        );
        access.grant(&Identity::Vehicle(robot.clone()), &[sends, gets, sought]);
        for listed in list.people() {
            let rules = access.operator_rules(robot, listed);
            let identity = listed.identity();
            match people.iter_mut().find(|(known, _)| *known == identity) {
                Some((_, known)) => known.extend(rules),
                None => people.push((identity, rules)),
            }
        }
    }
    for (identity, rules) in people {
        access.grant(&identity, &rules);
    }
    access.into_value()
}
