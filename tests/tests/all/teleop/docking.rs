//! A boat before canes: they stop it, unless its driver has chosen the docking site in them.

use std::path::Path;
use std::time::Duration;

use foreshore_tests::operator::{Input, NEUTRAL, Operator, connected_to};
use network::clock;
use network::endpoints::Channel;
use protocol::message::{BarrierKind, DockingChoice, TeleopState, TeleopStatus};

use zenoh::Session;

use super::robot::Robot;
use crate::processes::free_endpoint;

/// Where the canes begin, metres ahead of the start.
const CANES_M: f64 = 12.0;
/// From the middle of the boat to its bow, metres.
const BOW_M: f64 = 2.25;

const TIMEOUT: Duration = Duration::from_mins(2);
const AHEAD: Input = Input::of(0.5, 0.0);

/// Along x of the world. The origin of `odom` is the antenna, 0.5 m behind the middle.
fn bow_m(operator: &Operator) -> f64 {
    operator.pose().position_m[0] - 0.5 + BOW_M
}

/// Holds `AHEAD`, pressed again after a stop, until `is_so`.
fn drive_until(anna: &mut Operator, bert: &Operator, is_so: impl Fn(&TeleopStatus) -> bool) {
    let started = clock::now();
    while !bert.teleop().as_ref().is_some_and(&is_so) {
        assert!(clock::elapsed(started) < TIMEOUT, "{:?}", bert.teleop());
        anna.start_driving(AHEAD);
        let is_over = |teleop: &TeleopStatus| {
            is_so(teleop)
                || teleop.state != TeleopState::Driving
                || clock::elapsed(started) > TIMEOUT
        };
        anna.hold_until(AHEAD, || bert.teleop().as_ref().is_some_and(is_over));
    }
}

/// The docking site in vegetation nearest to the way ahead.
fn site_ahead(operator: &Operator, bulk: &Session) -> Option<DockingChoice> {
    let shores = operator.shores(bulk)?;
    let sites = shores
        .sites
        .iter()
        .filter_map(|site| Some((site, site.choice()?)));
    let nearest = sites
        .min_by(|(one, _), (other, _)| one.center_m[1].abs().total_cmp(&other.center_m[1].abs()));
    nearest.map(|(_, choice)| choice)
}

#[test]
fn a_boat_pushes_into_the_canes_that_its_driver_has_chosen() {
    let world = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robot-edge/tests/cli/canes.toml");
    let endpoint = free_endpoint();
    let options = format!("--listen {endpoint}");
    let robot = Robot::start_with(world.to_str().unwrap(), &endpoint, &options, |_| ());
    let [mut anna, bert] = ["anna", "bert"].map(|name| robot.operator(name));
    let bulk = connected_to(Channel::Bulk, &endpoint, None);

    // Without a choice the canes stop it.
    let is_stopped = |teleop: &TeleopStatus| {
        let kind = teleop.barrier.map(|barrier| barrier.kind);
        matches!(kind, Some(BarrierKind::Detected | BarrierKind::Mapped))
            && teleop.applied.linear_mps.abs() < 1e-3
    };
    drive_until(&mut anna, &bert, is_stopped);
    anna.hold(AHEAD, Duration::from_secs(3));
    let gap_m = CANES_M - bow_m(&anna);
    // Thin stems are seen late, and a boat coasts.
    assert!((-1.0..2.5).contains(&gap_m), "{gap_m} m");

    let before_m = bow_m(&anna);
    // The metrics of a tilting laser take some sweeps.
    let choice = (0..100).find_map(|_| {
        anna.hold(Input::NEUTRAL, Duration::from_millis(300));
        site_ahead(&bert, &bulk)
    });
    let choice = choice.expect("a docking site in the canes");
    anna.docking = Some(choice);
    // It stops and goes: what is new to it is an obstacle until it is classified.
    let is_inside = |teleop: &TeleopStatus| {
        assert!(teleop.state != TeleopState::Driving || teleop.applied.linear_mps < 0.31);
        let kind = teleop.barrier.map(|barrier| barrier.kind);
        teleop.docking == Some(choice)
            && kind == Some(BarrierKind::Vegetation)
            && bow_m(&bert) > before_m.max(CANES_M) + 0.3
    };
    drive_until(&mut anna, &bert, is_inside);

    // Without the choice they hold it again.
    anna.docking = None;
    anna.hold(Input::NEUTRAL, NEUTRAL);
    anna.hold(AHEAD, Duration::from_secs(3));
    let held = anna.wait_for_status("held", is_stopped);
    assert_eq!(held.docking, None);
    robot.verdict(&[&anna.journal]);
}
