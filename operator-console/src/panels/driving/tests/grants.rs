//! Whose grant of the lease a status tells of.

use super::*;

/// What the panel says where the robot tells of a grant to `anna`, and what can be done about it.
fn told(lease: Lease, last_grant: Option<u64>, epoch: u64) -> (String, LeaseButtons) {
    let mut rig = Rig::driving();
    rig.teleop_client.lease = lease;
    rig.teleop_client.last_grant = last_grant;
    rig.teleop.lease.epoch = epoch;
    let data = rig.data();
    (data.driver, data.lease)
}

#[test]
fn who_gave_back_is_no_other_console_until_the_robot_says_that_nobody_drives() {
    let mine = (String::from("You drive (anna)"), LeaseButtons::Quiet);
    assert_eq!(told(Lease::None, Some(4), 4), mine);
    let others = "anna drives, from another console".to_owned();
    let others = (others, LeaseButtons::HeldByOther);
    assert_eq!(told(Lease::None, Some(4), 5), others);
    assert_eq!(told(Lease::None, None, 4), others);
    let mut free = Rig::new();
    free.teleop_client.last_grant = Some(4);
    free.teleop.lease.epoch = 4;
    let data = free.data();
    assert_eq!(
        (data.driver.as_str(), data.lease),
        ("Nobody drives", LeaseButtons::Free)
    );
}

#[test]
fn a_grant_that_was_asked_for_is_no_other_consoles_before_its_answer_is_here() {
    let waiting = Lease::Waiting {
        after: 4,
        since: at(0),
    };
    assert_eq!(told(waiting, None, 5).0, "You drive (anna)");
    let others = "anna drives, from another console";
    assert_eq!(told(waiting, None, 4).0, others, "it was so before");
    let mut rig = Rig::driving();
    rig.teleop_client.lease = Lease::None;
    rig.teleop_client.is_asking = true;
    assert_eq!(rig.data().driver, "anna drives");
}
