use super::*;
use crate::config::VehicleConfig;
use crate::driving::lookout::lookout;
use crate::driving::motors::SimulatedMotors;
use crate::mapping::elevation_config::ObstacleConfig;
use crate::teleop::config::TeleopConfig;
use crate::teleop::guard::{GuardConfig, GuardRules};

/// A vehicle whose guard was told nothing yet.
fn guarded(now: Monotonic) -> Driver {
    let (teleop, vehicle) = (TeleopConfig::default(), VehicleConfig::default());
    let obstacle = ObstacleConfig::default();
    let guard = GuardRules::new(&GuardConfig::default(), &teleop, &vehicle, &obstacle).unwrap();
    let mut driver = Driver::new(
        ("scout".parse().unwrap(), BootId([1; 16])),
        Rules::new(&teleop, &vehicle).unwrap(),
        Operators::open(),
        Motors::Simulated(SimulatedMotors::default()),
        Arc::new(Board::default()),
        now,
    );
    driver.sight = Some(lookout(guard, 1).2);
    driver.switches.guard = true;
    driver
}

fn stops(driver: &mut Driver, reason: StopReason, now: Monotonic) -> Vec<(&'static str, String)> {
    let to = Mode::Stopping { reason, since: now };
    let from = Mode::Driving;
    driver.tell(Happening::Mode { from, to }, now);
    driver.board.tell(&mut driver.notices);
    driver.board.take_events()
}

#[test]
fn a_stop_for_want_of_a_guard_says_what_the_guard_lacked() {
    let now = Monotonic::now();
    let mut driver = guarded(now);
    driver.tick(now);
    drop(driver.board.take_events());
    let says = "stopping: the collision guard could not judge, it had no pose yet";
    let told = stops(&mut driver, StopReason::GuardStale, now);
    assert_eq!(told, [("involuntary_stop", says.to_owned())]);
    assert_eq!(driver.switches.last_stop, Some(StopReason::GuardStale));
    // Other stops do not speak of the guard.
    let told = stops(&mut driver, StopReason::Age, now);
    assert_eq!(told.len(), 1);
    assert!(!told[0].1.contains("guard"), "{told:?}");
    // Nor is anything made up where there is none.
    driver.sight = None;
    let told = stops(&mut driver, StopReason::GuardStale, now);
    assert!(told[0].1.ends_with("it said nothing"), "{told:?}");
}
