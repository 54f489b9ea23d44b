//! A robot that runs anew.

use protocol::tile::BootId;

use super::*;
use crate::test_support::announce_boot;

#[test]
fn a_robot_that_has_restarted_is_waited_for_until_it_says_how_it_is() {
    let rig = Rig::driving();
    let mut model = rig.model();
    let told = |model: &ConsoleModel, ms| {
        let data = DrivingData::new(model, &rig.teleop_client, at(ms)).unwrap();
        (data.tone, data.headline)
    };
    announce_boot(&mut model, BootId([7; 16]), at(1_050));
    assert_eq!(told(&model, 1_100).1, "Driving", "the run that said so");
    let lost = (Tone::Warning, "Link lost for 4.0 s".to_owned());
    assert_eq!(told(&model, 5_000), lost);
    announce_boot(&mut model, BootId([8; 16]), at(5_000));
    let waiting = (Tone::Waiting, "Waiting for status".to_owned());
    assert_eq!(told(&model, 5_000), waiting);
    let data = DrivingData::new(&model, &rig.teleop_client, at(5_000)).unwrap();
    assert_eq!(
        (data.gauges, data.settings),
        (None, None),
        "of the last run"
    );
    assert_eq!(data.driver, "You drove (anna)");
    assert_eq!(data.rows[0].1.1, "as of 4.0 s ago");
    // Lost again, before it has said anything.
    assert_eq!(told(&model, 7_000).0, Tone::Warning);
    assert!(model.awaits_status());
}
