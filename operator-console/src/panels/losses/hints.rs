//! What the reasons mean, for whoever points at them. Their names are `measurement::drops::DropReason`'s and this
//! console's.

/// Of a reason as the panel names it; `None` of those that are plain, and of those of newer robots.
pub(super) fn hint(name: &str) -> Option<&'static str> {
    let words = match name {
        "isolated" => {
            "Single points of a scan with nothing beside them, such as rain, spray or dust. They are not mapped."
        }
        "invalid range" => {
            "Beams whose distance is no number, or shorter than the sensor can measure. They are not mapped."
        }
        "own body" => "Beams that hit the vehicle itself. They are not mapped.",
        "out of bounds" | "outside window" => {
            "Points farther away than the map reaches. They are not mapped."
        }
        "late" => "Messages of a sensor that came too late to be put in order.",
        "undecodable" | "damaged" | "cut off" => {
            "Messages or parts of a recording that cannot be read."
        }
        "bad stamp" => "Messages with a time that cannot be.",
        "bad pose" => "Positions that are no numbers.",
        "bad scan" => "Scans without beams, or with angles or times that are no numbers.",
        "wheel jump" => "Turns of a wheel that are longer than the vehicle drives.",
        "no fix" => "The satellite receiver had no position.",
        "bad fix" => "Satellite positions that are not on Earth.",
        "gnss outlier" => "Satellite positions farther away than the vehicle drives.",
        "no pose" | "before first pose" => {
            "Scans of a time at which nobody knew where the vehicle was."
        }
        "pose gap" => "Scans of a time at which positions were missing for too long.",
        "pose jump" => "Scans of a time at which the position jumped.",
        "after last pose" => "Scans that are too much newer than the newest position.",
        "queue full" => {
            "Scans that waited for a position while there was no room for more, or for mapping for more than 2 s, and \
             those behind them until it had caught up."
        }
        "lost by source" => {
            "Messages that came and cannot be used, or damaged parts of a recording, each of which may hold many scans: \
             Events and the time line say where."
        }
        "before joining" => {
            "Came before the robot had told which run of it this is. What the map lacks of it is fetched."
        }
        "other boot" => {
            "Of a run of the robot that is over, or that it has not yet told of. What the map lacks is fetched."
        }
        "incomplete tiles" => "Parts of the map of which one half never came.",
        _ => return None,
    };
    Some(words)
}

#[cfg(test)]
mod tests {
    use measurement::drops::DropReason;

    use super::*;
    use crate::model::RejectReason;

    #[test]
    fn what_robots_drop_is_explained_by_the_name_that_they_send() {
        for (reason, says) in [
            (DropReason::Isolated, "Single points"),
            (DropReason::InvalidRange, "shorter than the sensor"),
            (DropReason::OwnBody, "the vehicle itself"),
            (DropReason::AfterLastPose, "newer than the newest position"),
        ] {
            let (name, _) = super::super::rows([(reason.as_str(), 1)].into_iter()).remove(0);
            let words = hint(&name);
            assert!(
                words.is_some_and(|words| words.contains(says)),
                "{name}: {words:?}"
            );
        }
        assert_eq!(hint("refused messages"), None);
        let handbook = include_str!("../../../../docs/console.md");
        for refusal in [RejectReason::BeforeJoin, RejectReason::OtherBoot] {
            let words = hint(refusal.name()).unwrap();
            assert!(words.ends_with("is fetched."), "{words}");
            let named = format!("*{}*: ", refusal.name());
            assert!(handbook.contains(&named), "{named}");
        }
    }
}
