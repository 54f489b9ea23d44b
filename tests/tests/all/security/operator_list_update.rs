//! The list of operators changes while the vehicle runs: removed operators lose access, the others reconnect.

use std::fs;
use std::net::UdpSocket;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{scope, sleep};
use std::time::Duration;

use foreshore_tests::operator::NEUTRAL;
use measurement::time::Monotonic;
use network::clock;
use network::credentials::Credentials;
use network::endpoints::Channel;
use network::sessions::{self, Side};
use operator_console::link::{AddressState, Discovery};
use protocol::message::{Answer, LeaseRequest, Refusal, StopReason, TeleopState};
use zenoh::{Session, Wait as _};

use super::{TURN, audit, operator, person, position, robot, take_off};
use crate::fleet::{Fleet, quic, text};
use crate::processes::{SERVED, free_port, start, wait_until};

/// A connection in setup when the links are closed keeps the port for 30 s, and clients retry with growing pauses.
const TIMEOUT: Duration = Duration::from_secs(90);
/// A removed operator receives nothing after this time.
const REVOKED: Duration = Duration::from_secs(2);

/// Arrival times of poses at a session.
#[derive(Clone, Default)]
struct Poses(Arc<Mutex<Vec<Monotonic>>>);

impl Poses {
    fn of(session: &Session) -> Self {
        let poses = Self::default();
        let taken = poses.clone();
        session
            .declare_subscriber("foreshore/scout/pose")
            .callback(move |_| taken.0.lock().unwrap().push(clock::now()))
            .background()
            .wait()
            .unwrap();
        wait_until("a pose", || !poses.0.lock().unwrap().is_empty());
        poses
    }

    /// Arrival of the last pose, relative to `since`.
    fn last_after(&self, since: Monotonic) -> Duration {
        self.0.lock().unwrap().last().unwrap().since(since)
    }

    /// The longest time between two poses, the second after `since`.
    fn longest_gap(&self, since: Monotonic) -> Duration {
        let poses = self.0.lock().unwrap();
        let pairs = poses.windows(2).filter(|pair| pair[1] > since);
        pairs
            .map(|pair| pair[1].since(pair[0]))
            .max()
            .unwrap_or_default()
    }
}

fn tiles(fleet: &Fleet, name: &str, port: u16) -> Session {
    let endpoints = fleet.endpoints(name, quic(port));
    sessions::open(Side::Console, Channel::Bulk, &endpoints).unwrap()
}

/// Whether the vehicle answers on the bulk session.
fn answers(tiles: &Session) -> bool {
    let question = protocol::wire::encode(
        &protocol::wire::Header {
            boot: protocol::tile::BootId([1; 16]),
            seq: 1,
            robot_time_ns: 0,
        },
        &protocol::message::ShoresRequest { newer_than: 0 },
    );
    let replies = tiles
        .get("foreshore/scout/shores")
        .payload(question.unwrap())
        .timeout(Duration::from_secs(1))
        .wait();
    let replies = replies.map(|replies| replies.iter().any(|reply| reply.result().is_ok()));
    replies.unwrap_or(false)
}

#[test]
fn a_removed_operator_is_cut_off_and_the_driver_reconnects() {
    let (fleet, port) = (Fleet::new(), free_port());
    let edge = robot(&fleet, "--listen", port);
    let mut anna = operator(&fleet, "anna", port);
    let bert = person(&fleet, "bert", port);
    let (of_anna, of_bert) = (Poses::of(anna.session()), Poses::of(&bert));
    let (tiles_of_bert, tiles_of_anna) = (tiles(&fleet, "bert", port), tiles(&fleet, "anna", port));
    assert!(answers(&tiles_of_bert) && answers(&tiles_of_anna));
    // A stopped console must not delay the others.
    let frozen = start(&format!(
        "operator-console --headless --for 100 {} --export {}",
        fleet.console("tv", &quic(port)),
        fleet.scratch("console").display()
    ));
    sleep(Duration::from_secs(2));
    frozen.signal("STOP");

    anna.start_driving(TURN);
    take_off(&fleet, "bert");
    let written = clock::now();
    // She holds the key until she receives a pose again.
    anna.hold(TURN, REVOKED);
    let (last, resumed) = (of_bert.last_after(written), clock::now());
    anna.hold_until(TURN, || {
        assert!(clock::elapsed(resumed) < TIMEOUT, "no pose for Anna");
        of_anna.last_after(resumed) > Duration::ZERO
    });
    let gap = of_anna.longest_gap(written);
    println!("bert's last pose came after {last:.2?}; anna's link was interrupted for {gap:.2?}");
    assert!(last < REVOKED, "{last:?}");
    assert!(!answers(&tiles_of_bert), "Bert still gets tiles");
    let status = anna.wait_for_new_status();
    assert_ne!(status.state, TeleopState::Driving, "without a new press");
    let why = status.last_stop.unwrap();
    assert!(
        matches!(why, StopReason::Age | StopReason::LeaseEnded(_)),
        "{why:?}"
    );
    // Her sessions reconnect.
    anna.start_driving(TURN);
    wait_until("tiles for Anna", || answers(&tiles_of_anna));
    assert_eq!(
        of_bert.last_after(written),
        last,
        "he received a pose again"
    );
    drop(frozen);
    anna.session().close().wait().unwrap();
    edge.interrupt();

    let log = audit(&fleet);
    let at = |kind: &str, says: &str| position(&log, kind, says);
    let order = [
        at("operators", "off it operator:bert"),
        at("access", "all links are closed, and opened anew"),
        at("disconnect", "operator:bert is gone, control"),
        at("access", "links are open by the newer list"),
    ];
    assert!(order.is_sorted(), "{order:?} {log:#?}");
}

#[test]
fn a_reordered_operator_list_interrupts_no_link() {
    let (fleet, port) = (Fleet::new(), free_port());
    let _edge = robot(&fleet, "--listen", port);
    let anna = operator(&fleet, "anna", port);
    let poses = Poses::of(anna.session());
    let path = fleet.vehicle().join("operators.toml");
    let whole = text(&path);
    let (head, people) = whole.split_once("\n[[person]]").unwrap();
    let mut people: Vec<_> = people.trim_end().split("\n[[person]]").collect();
    people.reverse();
    let written = clock::now();
    fs::write(
        &path,
        format!("{head}\n[[person]]{}\n", people.join("\n[[person]]")),
    )
    .unwrap();
    wait_until("the list is read again", || {
        audit(&fleet).iter().any(|(kind, _)| kind == "operators")
    });
    sleep(Duration::from_secs(1));
    let gap = poses.longest_gap(written);
    assert!(gap < Duration::from_millis(500), "{gap:?}");
    assert!(!audit(&fleet).iter().any(|(kind, _)| kind == "access"));
    anna.session().close().wait().unwrap();
}

/// The rules of a router are made by `robot-edge keys`: it forwards poses to a removed operator until it has new rules. The
/// vehicle itself refuses the commands.
#[test]
fn behind_a_router_a_removed_operator_loses_driving_at_once() {
    let (fleet, port) = (Fleet::new(), free_port());
    let old_rules = fleet.router(port);
    let _edge = robot(&fleet, "--connect", port);
    let anna = operator(&fleet, "anna", port);
    let mut bert = operator(&fleet, "bert", port);
    let (of_anna, of_bert) = (Poses::of(anna.session()), Poses::of(bert.session()));
    let written = clock::now();
    take_off(&fleet, "bert");
    let started = clock::now();
    while bert.ask(&LeaseRequest::Request) != Answer::Refused(Refusal::Signature) {
        assert!(clock::elapsed(started) < REVOKED, "he may drive");
    }
    let gap = of_anna.longest_gap(written);
    assert!(
        gap < Duration::from_secs(1),
        "a link was interrupted for {gap:?}"
    );
    assert!(
        of_bert.last_after(written) > Duration::ZERO,
        "he still gets poses"
    );

    // The rules are generated from the lists.
    old_rules.close().wait().unwrap();
    let _new_rules = fleet.router(port);
    let restarted = clock::now();
    wait_until("a pose for Anna", || {
        of_anna.last_after(written) >= restarted.since(written)
    });
    sleep(Duration::from_secs(1));
    assert!(of_bert.last_after(written) < restarted.since(written));
}

/// Another program takes the port while the links are closed.
#[test]
fn the_edge_waits_for_a_port_that_is_taken_meanwhile() {
    let (fleet, port) = (Fleet::new(), free_port());
    let edge = robot(&fleet, "--listen", port);
    let anna = operator(&fleet, "anna", port);
    let list = fleet.vehicle().join("operators.toml");
    let whole = text(&list);
    take_off(&fleet, "bert");
    let without = text(&list);
    let failed = || {
        audit(&fleet)
            .iter()
            .any(|(kind, _)| kind == "access_failed")
    };
    let is_over = AtomicBool::new(false);
    scope(|scope| {
        scope.spawn(|| {
            let mut socket = None;
            while !is_over.load(Ordering::Relaxed) && socket.is_none() {
                socket = UdpSocket::bind(("127.0.0.1", port)).ok();
            }
            while !is_over.load(Ordering::Relaxed) {
                sleep(Duration::from_millis(10));
            }
        });
        // Repeated if the vehicle was faster.
        for change in 0..10 {
            fs::write(&list, if change % 2 == 0 { &whole } else { &without }).unwrap();
            let changed = clock::now();
            while !failed() && clock::elapsed(changed) < Duration::from_secs(4) {
                sleep(Duration::from_millis(20));
            }
            if failed() {
                break;
            }
        }
        is_over.store(true, Ordering::Relaxed);
    });
    assert!(failed(), "the vehicle always got the port first");
    let freed = clock::now();
    anna.wait_for_new_status();
    println!(
        "connected again {:.2?} after the port was free",
        clock::elapsed(freed)
    );
    anna.session().close().wait().unwrap();
    edge.interrupt();
    let log = audit(&fleet);
    let failed = log.iter().position(|(kind, _)| kind == "access_failed");
    let (_, why) = &log[failed.unwrap()];
    assert!(
        why.contains("another program has the port already"),
        "{why}"
    );
    let opened = "links are open by the newer list";
    let opened = log
        .iter()
        .rposition(|(_, message)| message.contains(opened));
    assert!(opened > failed, "{log:#?}");
}

#[test]
fn a_deleted_operator_list_revokes_access_after_ten_seconds() {
    let (fleet, port) = (Fleet::new(), free_port());
    let edge = robot(&fleet, "--listen", port);
    let mut anna = operator(&fleet, "anna", port);
    let poses = Poses::of(anna.session());
    let list = fleet.vehicle().join("operators.toml");
    let whole = text(&list);
    anna.start_driving(TURN);
    fs::remove_file(&list).unwrap();
    let removed = clock::now();
    // Rights last for 10 s.
    anna.hold(TURN, Duration::from_secs(9));
    let is_hers = anna.wait_for_new_status().lease.holder == Some(anna.name.clone());
    assert!(is_hers, "she may drive for 10 s");
    anna.hold(TURN, Duration::from_secs(5));
    let last = poses.last_after(removed);
    println!("the last pose came {last:.2?} after the list was gone");
    assert!(last > Duration::from_secs(9) && last < Duration::from_secs(13));
    fs::write(&list, whole).unwrap();
    let back = clock::now();
    wait_until("a pose for Anna", || {
        poses.last_after(removed) >= back.since(removed)
    });
    anna.hold(TURN, NEUTRAL);
    assert_ne!(anna.wait_for_new_status().state, TeleopState::Driving);
    anna.start_driving(TURN);
    anna.session().close().wait().unwrap();
    edge.interrupt();
    let log = audit(&fleet);
    let printed: Vec<_> = log
        .iter()
        .filter(|(kind, _)| kind == "operators_missing")
        .map(|(_, message)| message.split(" (").next().unwrap())
        .collect();
    assert_eq!(
        printed,
        [
            "the list of operators is missing: nobody may drive in 10 s unless it comes back",
            "the list of operators is missing: nobody may watch or drive",
        ]
    );
    let why = "anna no longer drives: the leave to drive was taken away";
    assert!(log.iter().any(|(_, message)| message == why), "{log:#?}");
}

/// Waits until discovery at `endpoint` with Carl's keys gives the expected state.
fn wait_for_answer(fleet: &Fleet, endpoint: &str, is_expected: impl Fn(&AddressState) -> bool) {
    let keys = Credentials::open(&fleet.person("carl")).unwrap();
    let asked = vec![endpoint.to_owned()];
    let discovery = Discovery::start(asked, false, None, Some(keys), || {});
    wait_until("an answer for Carl", || {
        is_expected(&discovery.asked()[endpoint])
    });
}

#[test]
fn an_unlisted_operator_gets_access_once_listed() {
    let (fleet, port) = (Fleet::new(), free_port());
    let endpoint = quic(port);
    let list = fleet.vehicle().join("operators.toml");
    let without_carl = text(&list);
    let added = fleet.keys("--robot scout --operator carl");
    let printed = String::from_utf8(added.stdout).unwrap();
    let what_to_do = "the vehicle lets them in once it has this, by `robot-edge install-keys`";
    assert!(printed.contains(what_to_do), "{printed}");
    let with_carl = text(&list);
    fs::write(&list, &without_carl).unwrap();
    let options = fleet.edge("--listen", &endpoint);
    let edge = start(&format!("robot-edge simulate rooms {SERVED} {options}"));
    person(&fleet, "anna", port).close().wait().unwrap();

    wait_for_answer(
        &fleet,
        &endpoint,
        |state| matches!(state, AddressState::AccessDenied { robot, .. } if robot.as_str() == "scout"),
    );
    let printed = start(&format!(
        "operator-console --headless --timeout 8 --robot scout {} --export {}",
        fleet.console("carl", &endpoint),
        fleet.scratch("maps").display()
    ))
    .ends_with(1);
    let first = format!("looking for robot scout at {endpoint}\n");
    assert!(printed.starts_with(&first), "{printed}");
    let why = format!("scout answers at {endpoint} but denies access: you are not on");
    // During the wait and at the end.
    assert_eq!(printed.matches(&why).count(), 2, "{printed}");
    assert!(!printed.contains("no answer"), "{printed}");

    let written = clock::now();
    fs::write(&list, &with_carl).unwrap();
    wait_for_answer(&fleet, &endpoint, |state| *state == AddressState::Found);
    println!(
        "found {:.1} s after the list was written",
        clock::elapsed(written).as_secs_f64()
    );
    edge.interrupt();
}
