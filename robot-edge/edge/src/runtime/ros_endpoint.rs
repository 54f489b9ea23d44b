//! Where the ROS 2 system is, by the command line and the environment.

use std::env;

use crate::cli::RosOptions;
use crate::exit::UsageError;
use crate::ros2::RosEndpoint;
use recording::ros::middleware::MAX_DOMAIN;

/// The router of `rmw_zenoh` on this machine.
const DEFAULT_ROS: &str = "tcp/localhost:7447";

pub(super) fn ros_endpoint(options: &RosOptions) -> Result<RosEndpoint, UsageError> {
    let endpoint = options.endpoint.as_deref().unwrap_or(DEFAULT_ROS);
    Ok(RosEndpoint {
        endpoint: endpoint.to_owned(),
        domain: match options.domain {
            Some(domain) => domain,
            None => ros_domain_id(env::var("ROS_DOMAIN_ID").ok().as_deref())?,
        },
    })
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
