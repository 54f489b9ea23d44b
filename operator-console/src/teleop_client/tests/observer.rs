//! An operator with the role of an observer: nothing is sent, and each attempt is answered by a notice.

use protocol::message::Setting;
use teleop::Role;

use super::*;

/// The client of an operator with this role, connected to a robot.
fn teleop_client(role: Option<Role>) -> TeleopClient {
    let identity = Identity {
        role,
        ..Identity::without_keys("tv".parse().unwrap())
    };
    let mut teleop_client = TeleopClient::new("scout".parse().unwrap(), identity, 7);
    let newest = LatestPose {
        boot: BOOT,
        token: Some(AgeToken { n: 1, nonce: 2 }),
        velocity: [0.0; 2],
        at: at(1_000),
    };
    teleop_client.begin(Some(newest), at(1_000));
    teleop_client.apply(InputEvent::Focus(true));
    teleop_client
}

/// Number of sent messages, and the notifications.
fn end(teleop_client: &mut TeleopClient) -> (usize, Vec<TeleopNotification>) {
    let sent = teleop_client.end(at(1_010)).len();
    (sent, teleop_client.take_notifications().into())
}

#[test]
fn observer_sends_nothing_and_gets_a_notice() {
    let rejected = (0, vec![TeleopNotification::ObserverOnly]);
    for intent in [
        Intent::EStop,
        Intent::Lease(LeaseRequest::Request),
        Intent::Reset(3),
        Intent::Set(Setting::CollisionMonitor(false)),
    ] {
        let mut teleop_client = teleop_client(Some(Role::Observer));
        teleop_client.submit(intent.clone(), at(1_005));
        assert_eq!(end(&mut teleop_client), rejected, "{intent:?}");
        assert_eq!(teleop_client.state(at(1_010)).estop, EStopState::Quiet);
        assert_eq!(end(&mut teleop_client), (0, Vec::new()), "once a press");
    }
    for (key, expected) in [
        (DriveKey::W, rejected),
        // It moves the map without a lease.
        (DriveKey::Up, (0, Vec::new())),
    ] {
        let mut teleop_client = teleop_client(Some(Role::Observer));
        teleop_client.apply(InputEvent::Press(key));
        assert_eq!(end(&mut teleop_client), expected, "{key:?}");
    }
}

#[test]
fn possible_operators_can_stop() {
    for role in [None, Some(Role::Operator), Some(Role::Supervisor)] {
        let mut teleop_client = teleop_client(role);
        teleop_client.submit(Intent::EStop, at(1_005));
        let (sent, notifications) = end(&mut teleop_client);
        assert!(sent > 0, "{role:?}");
        assert_eq!(
            notifications,
            [TeleopNotification::EStopPressed],
            "{role:?}"
        );
    }
}
