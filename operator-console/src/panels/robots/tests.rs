use eframe::egui::vec2;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;

use super::*;

const NOW: Monotonic = Monotonic::from_nanos(60_000_000_000);

fn seen(robot: &str, ago_s: u64, state: Option<FleetState>) -> RobotEntry {
    let found = FoundRobot {
        robot: robot.parse().unwrap(),
        endpoint: format!("tcp/{robot}:7447"),
    };
    let seen = Monotonic::from_nanos((60 - ago_s) * 1_000_000_000);
    RobotEntry {
        discovered: DiscoveredRobot { found, seen, state },
        color: Color32::BLUE,
        alerts: 0,
        uncommanded_motion: None,
    }
}

#[test]
fn advice_of_the_list() {
    let named = "boat".parse().unwrap();
    let advice = |seen: &[RobotEntry], search_target| {
        RobotsData::new(seen, None, search_target, None, NOW)
            .advice
            .unwrap_or_default()
    };
    assert_eq!(advice(&[], SearchTarget::Any), "No robot found yet.");
    let (a, b) = (seen("a", 0, None), seen("b", 0, None));
    assert_eq!(
        advice(&[a.clone(), b.clone()], SearchTarget::Any),
        "Choose one on the left."
    );
    let waiting = advice(std::slice::from_ref(&a), SearchTarget::Named(&named));
    assert!(waiting.contains("Looking for boat"));
    let data = RobotsData::new(&[b.clone(), a, b], None, SearchTarget::Any, None, NOW);
    let names: Vec<_> = data
        .found
        .iter()
        .map(|line| line.found.robot.to_string())
        .collect();
    assert_eq!(names, ["b", "a"], "as first found");
    let second = data.numbered(2).unwrap();
    assert_eq!(second.robot.as_str(), "a");
    assert_eq!((data.numbered(0), data.numbered(3)), (None, None));
}

#[test]
fn search_addresses_are_shown_while_searching() {
    let addresses = ["tcp/a:7447".to_owned(), "tcp/b:7447".to_owned()];
    let texts = |seen: &[RobotEntry], current, search_target: SearchTarget<'_>| {
        let mut data = RobotsData::new(seen, current, search_target, None, NOW);
        let before = data.advice.clone();
        data.set_search_addresses(&addresses);
        (data.advice != before).then_some(data.advice).flatten()
    };
    let only = " Only tcp/a:7447, tcp/b:7447 are asked, as --connect says.";
    assert_eq!(
        texts(&[], None, SearchTarget::Any),
        Some(format!("No robot found yet.{only}"))
    );
    let boat = "boat".parse().unwrap();
    let named = texts(&[], None, SearchTarget::Named(&boat));
    let looking = "Looking for boat. Start it, or type its address.";
    assert_eq!(named, Some(format!("{looking}{only}")));
    let found = [seen("a", 0, None)];
    assert_eq!(texts(&found, None, SearchTarget::Any), None, "one is there");
    let shown = Some((&boat, LinkState::Live));
    assert_eq!(texts(&[], shown, SearchTarget::Any), None, "one is shown");
    let demo = SearchTarget::Demo { failure: None };
    assert_eq!(texts(&[], None, demo), None, "it comes by itself");
}

#[test]
fn a_robot_that_denies_access_is_shown() {
    let boat: RobotId = "boat".parse().unwrap();
    let advice = |seen: &[RobotEntry], told_nothing_by: &[RobotId]| {
        let mut data = RobotsData::new(seen, None, SearchTarget::Any, None, NOW);
        data.set_denied_by(&told_nothing_by.iter().cloned().collect());
        data.advice.unwrap()
    };
    let reported = advice(&[], std::slice::from_ref(&boat));
    assert!(
        reported.starts_with("boat answers, but denies access"),
        "{reported}"
    );
    assert_eq!(advice(&[], &[]), "No robot found yet.");
    let other = [seen("a", 0, None)];
    assert_eq!(advice(&other, &[boat]), "Choose one on the left.");
}

#[test]
fn robot_states() {
    let anna = FleetState::DrivenBy("anna".parse().unwrap());
    let mut fleet = [
        seen("a", 3, Some(FleetState::Free)),
        seen("b", 3, Some(anna)),
        seen("c", 3, Some(FleetState::EStop { has_ended: false })),
        seen("d", 25, Some(FleetState::Free)),
        seen("e", 3, Some(FleetState::Free)),
        seen("f", 3, None),
        seen("g", 3, Some(FleetState::Ended)),
        seen("h", 25, Some(FleetState::Ended)),
        seen("i", 3, Some(FleetState::EStop { has_ended: true })),
        seen("j", 25, Some(FleetState::EStop { has_ended: true })),
        seen("k", 3, Some(FleetState::NotDrivable)),
    ];
    fleet[1].alerts = 1;
    fleet[2].alerts = 2;
    let current = "e".parse().unwrap();
    let current = Some((&current, LinkState::Silent));
    let data = RobotsData::new(&fleet, current, SearchTarget::Any, None, NOW);
    let states: Vec<_> = data
        .found
        .iter()
        .map(|line| (line.state.as_str(), line.tone))
        .collect();
    assert_eq!(
        states,
        [
            ("free", Tone::Good),
            ("anna drives, 1 alert", Tone::Warning),
            ("emergency stop, 2 alerts", Tone::Warning),
            ("silent, last seen 25 s ago", Tone::Warning),
            ("silent, last seen 3.0 s ago", Tone::Warning),
            ("there", Tone::Waiting),
            ("ended", Tone::Waiting),
            ("ended, last seen 25 s ago", Tone::Waiting),
            ("emergency stop", Tone::Warning),
            ("ended, last seen 25 s ago", Tone::Waiting),
            ("cannot be driven", Tone::Waiting),
        ]
    );
}

#[test]
fn a_robot_that_moves_by_itself_is_not_free() {
    let reported = |state, uncommanded_motion, link| {
        let mut seen = seen("a", 3, Some(state));
        seen.uncommanded_motion = uncommanded_motion;
        let current = "a".parse().unwrap();
        let data = RobotsData::new(
            &[seen],
            Some((&current, link)),
            SearchTarget::Any,
            None,
            NOW,
        );
        (data.found[0].state.clone(), data.found[0].tone)
    };
    let text = |words: &str, tone| (words.to_owned(), tone);
    let (live, free) = (LinkState::Live, || FleetState::Free);
    let [by_itself, or_adrift] = [
        UncommandedMotion::Autonomous,
        UncommandedMotion::MaybeDrifting,
    ]
    .map(Some);
    let moving = text("moving by itself", Tone::Waiting);
    assert_eq!(reported(free(), by_itself, live), moving);
    let adrift = text("moving or adrift", Tone::Warning);
    assert_eq!(reported(free(), or_adrift, live), adrift);
    assert_eq!(reported(free(), None, live), text("free", Tone::Good));
    let silent = text("silent, last seen 3.0 s ago", Tone::Warning);
    assert_eq!(reported(free(), by_itself, LinkState::Silent), silent);
    let stopped = text("emergency stop", Tone::Warning);
    assert_eq!(
        reported(FleetState::EStop { has_ended: false }, by_itself, live),
        stopped
    );
}

#[test]
fn only_silent_robots_can_be_forgotten() {
    let fleet = [
        seen("a", 3, Some(FleetState::Free)),
        seen("b", 16, Some(FleetState::Free)),
        seen("c", 3, Some(FleetState::Free)),
    ];
    let reported = |link| {
        let current = "b".parse().unwrap();
        let data = RobotsData::new(&fleet, Some((&current, link)), SearchTarget::Any, None, NOW);
        let b = &data.found[1];
        (b.tone, b.state.clone(), b.is_forgettable)
    };
    for (link, tone, state) in [
        (LinkState::Waiting, Tone::Waiting, "last seen 16 s ago"),
        (
            LinkState::Silent,
            Tone::Warning,
            "silent, last seen 16 s ago",
        ),
    ] {
        assert_eq!(
            reported(link),
            (tone, state.to_owned(), false),
            "it is shown"
        );
    }
    let data = RobotsData::new(&fleet, None, SearchTarget::Any, None, NOW);
    let mut window = Harness::builder()
        .with_size(vec2(180.0, 400.0))
        .build_ui_state(
            move |ui, asked: &mut Option<Command>| {
                let mut entry = AddressEntry::default();
                let command = robots_ui(ui, &data, &mut entry);
                *asked = asked.take().or(command);
            },
            None,
        );
    window.run_steps(2);
    for forget in ["Forget a", "Forget c"] {
        assert!(
            window.query_by_label(forget).is_none(),
            "{forget}: it answers"
        );
    }
    window.get_by_label("Forget b").click();
    window.run_steps(2);
    let expected = Command::ForgetRobot("b".parse().unwrap());
    assert_eq!(window.state().clone(), Some(expected));
}
