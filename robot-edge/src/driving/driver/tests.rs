use std::sync::mpsc::sync_channel;

use protocol::keys::OperatorTopic::{Drive as ByDrive, EStop as ByEStop};
use protocol::message::{AgeToken, EStop, Refusal as No};
use protocol::signed::{SecretKey, Stamp, sign};

use super::*;
use crate::config::VehicleConfig;
use crate::credentials::OperatorList;
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
    driver.sight = Some(lookout(guard, 1, None).2);
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

/// An emergency stop of an observer comes within the drive command and as a request, in either order: whichever is heard
/// first, the other is refused for the role too, not answered as what is over already.
#[test]
fn a_press_of_whoever_may_not_stop_the_vehicle_is_refused_for_that_by_whichever_way_it_comes() {
    let now = Monotonic::now();
    let eve = SecretKey::from_seed(&[5; 32]);
    let key = eve.public().to_pem().unwrap();
    let list = format!(
        "version = 1\n[[person]]\nname = \"eve\"\nrole = \"observer\"\nkey = \"\"\"\n{key}\"\"\"\n"
    );
    let mut driver = guarded(now);
    driver.operators = Operators::listed(&OperatorList::parse(&list).unwrap());
    driver.tick(now);
    let name: OperatorName = "eve".parse().unwrap();
    let mut seq = 0;
    let mut hears = |topic, press| {
        seq += 1;
        let stamp = Stamp {
            boot: BootId([1; 16]),
            token: AgeToken { n: 0, nonce: 0 },
            epoch: 0,
            seq,
        };
        let estop = EStop { press };
        let drive = Drive {
            linear_mps: 0.0,
            angular_radps: 0.0,
            estop: Some(estop),
        };
        let robot = "scout".parse().unwrap();
        let route = Route {
            robot: &robot,
            operator: &name,
        };
        let bytes = if topic == ByDrive {
            sign(&eve, route, &stamp, &drive)
        } else {
            sign(&eve, route, &stamp, &estop)
        };
        let (sender, answers) = sync_channel(1);
        let reply: Option<Reply> = (topic == ByEStop).then(|| {
            let reply: Reply = Box::new(move |answer| sender.send(answer).unwrap());
            reply
        });
        let (bytes, operator) = (bytes.unwrap(), name.clone());
        driver.receive(
            Incoming {
                topic,
                operator,
                bytes,
                reply,
            },
            now,
        );
        assert_eq!(driver.state.mode(), Mode::SafeBoot, "nothing was stopped");
        answers.try_recv().ok()
    };
    for press in [1, 2] {
        assert_eq!(hears(ByDrive, press), None);
        for _ in 0..2 {
            assert_eq!(hears(ByEStop, press), Some(Answer::Refused(No::Role)));
        }
    }
}
