//! Where the ROS 2 system is, by the command line and the environment.

use std::env;

use crate::cli::RosOptions;
use crate::config::Config;
use crate::exit::UsageError;
use crate::ros2::RosEndpoint;
use network::endpoints::is_loopback;
use recording::ros::middleware::MAX_DOMAIN;

/// The router of `rmw_zenoh` on this machine.
const DEFAULT_ROS: &str = "tcp/localhost:7447";

/// With a planner, which signs nothing, it must be where only this machine or holders of a certificate reach it.
pub(super) fn ros_endpoint(
    options: &RosOptions,
    config: &Config,
) -> Result<RosEndpoint, UsageError> {
    let endpoint = options.endpoint.as_deref().unwrap_or(DEFAULT_ROS);
    if config.planner.is_some() && !is_loopback(endpoint) && !has_mutual_tls(endpoint) {
        return Err(UsageError(format!(
            "--ros {endpoint}: [planner] takes velocities that nobody signs, so the ROS 2 system must be on this machine (tcp/127.0.0.1:PORT \
             or tcp/localhost:PORT), or behind mutual TLS \
             (tls/HOST:PORT#enable_mtls=true;root_ca_certificate_file=…;connect_certificate_file=…;connect_private_key_file=…). Run a router \
             on this machine that connects to the other one by TLS, or leave [planner] out"
        )));
    }
    Ok(RosEndpoint {
        endpoint: endpoint.to_owned(),
        domain: match options.domain {
            Some(domain) => domain,
            None => ros_domain_id(env::var("ROS_DOMAIN_ID").ok().as_deref())?,
        },
    })
}

/// Whether both ends of the connection prove who they are, by the settings of the endpoint.
fn has_mutual_tls(endpoint: &str) -> bool {
    let (address, config) = endpoint.split_once('#').unwrap_or((endpoint, ""));
    let settings: Vec<_> = config
        .split(';')
        .filter_map(|setting| setting.split_once('='))
        .collect();
    let has = |key: &str| {
        let mut keys = settings.iter().map(|(key, _)| *key);
        keys.any(|given| given.starts_with(key))
    };
    (address.starts_with("tls/") || address.starts_with("quic/"))
        && settings.contains(&("enable_mtls", "true"))
        && has("root_ca_certificate_")
        && has("connect_certificate_")
        && has("connect_private_key_")
}

fn ros_domain_id(variable: Option<&str>) -> Result<u32, UsageError> {
    let Some(text) = variable.filter(|text| !text.is_empty()) else {
        return Ok(0);
    };
    text.parse()
        .ok()
        .filter(|domain| *domain <= MAX_DOMAIN)
        .ok_or_else(|| {
            UsageError(format!(
                "ROS_DOMAIN_ID={text}: a domain is a number from 0 to {MAX_DOMAIN}; --ros-domain says another"
            ))
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_planner_is_on_this_machine_or_behind_mutual_tls() {
        let config = Config {
            planner: Some(crate::config::PlannerConfig::default()),
            ..Config::default()
        };
        let mutual = "tls/10.0.0.2:7447#enable_mtls=true;root_ca_certificate_file=a;connect_certificate_file=b;connect_private_key_file=c";
        for (endpoint, is_taken) in [
            ("tcp/localhost:7447", true),
            ("tcp/127.0.0.2:7447", true),
            ("tcp/[::1]:7447", true),
            ("tcp/192.168.0.2:7447", false),
            ("tcp/localhost.example.org:7447", false),
            ("tls/10.0.0.2:7447", false),
            (
                "tls/10.0.0.2:7447#enable_mtls=true;root_ca_certificate_file=a",
                false,
            ),
            (mutual, true),
            (&mutual.replace("tls/", "quic/"), true),
            (&mutual.replace("tls/", "tcp/"), false),
            (&mutual.replace("=true", "=false"), false),
        ] {
            let options = RosOptions {
                endpoint: Some(endpoint.to_owned()),
                domain: Some(0),
            };
            let taken = ros_endpoint(&options, &config);
            assert_eq!(taken.is_ok(), is_taken, "{endpoint}");
            assert!(
                ros_endpoint(&options, &Config::default()).is_ok(),
                "{endpoint}"
            );
        }
    }

    #[test]
    fn the_domain_is_a_valid_number() {
        assert_eq!(ros_domain_id(None).unwrap(), 0);
        assert_eq!(ros_domain_id(Some("")).unwrap(), 0);
        assert_eq!(ros_domain_id(Some("42")).unwrap(), 42);
        for wrong in ["-1", "233", "lab"] {
            let error = ros_domain_id(Some(wrong)).unwrap_err().to_string();
            assert!(
                error.contains(wrong) && error.contains("0 to 232"),
                "{error}"
            );
        }
    }
}
