use eframe::egui::vec2;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;

use super::*;

fn listed_as(address: &str, state: Option<AddressState>) -> ListedAddress {
    ListedAddress {
        address: address.to_owned(),
        state,
        is_remembered: true,
    }
}

#[test]
fn each_address_has_its_own_state() {
    let owned = |all: &[&str]| all.iter().map(|one| (*one).to_owned()).collect::<Vec<_>>();
    let named = owned(&["tcp/named:7447", "tcp/both:7447"]);
    let remembered = owned(&["tcp/both:7447", "tcp/other:7447", "tcp/missed:7447"]);
    let asked = [
        ("tcp/named:7447", AddressState::Silent),
        ("tcp/both:7447", AddressState::Refused),
        ("tcp/missed:7447", AddressState::Silent),
    ];
    let asked = asked.map(|(address, state)| (address.to_owned(), state));
    let found = FoundRobot {
        robot: "boat".parse().unwrap(),
        endpoint: "tcp/missed:7447".to_owned(),
    };
    let all = listed(&named, remembered.iter(), &asked.into(), &[found]);
    let expected = [
        listed_as("tcp/missed:7447", Some(AddressState::Found)),
        listed_as("tcp/other:7447", None),
        listed_as("tcp/both:7447", Some(AddressState::Refused)),
        ListedAddress {
            is_remembered: false,
            ..listed_as("tcp/named:7447", Some(AddressState::Silent))
        },
    ];
    assert_eq!(all, expected);
}

#[test]
fn address_states_have_advice() {
    let access_denied = |by_quic| AddressState::AccessDenied {
        robot: "scout".parse().unwrap(),
        by_quic,
    };
    for (state, has_keys, tone, label, hint) in [
        (AddressState::Asking, false, Tone::Waiting, "asking…", ""),
        (AddressState::Found, false, Tone::Good, "answers", ""),
        (
            AddressState::Refused,
            false,
            Tone::Warning,
            "connection refused",
            "Is the robot started, and is 7450 the right port?",
        ),
        (
            AddressState::Silent,
            false,
            Tone::Warning,
            "no answer",
            "Is the robot started, and is 7450 the right port? Is its network reached from here?",
        ),
        (
            AddressState::UnknownName,
            false,
            Tone::Warning,
            "unknown host",
            "No computer is called boat. Type its IP address instead.",
        ),
        (
            AddressState::NoRobot,
            false,
            Tone::Warning,
            "no robot there",
            "This is a router, or a robot that is still starting. \
             Or this is a robot's port for tiles: try boat:7449",
        ),
        (
            AddressState::NoRobot,
            true,
            Tone::Warning,
            "no robot there",
            "A router answers, but no robot behind it, or none that lists you as an operator.",
        ),
        (
            access_denied(true),
            true,
            Tone::Warning,
            "denies access",
            "scout answers, but you are not on its list of operators. \
             Access is granted within two seconds of being added.",
        ),
        (
            access_denied(false),
            true,
            Tone::Warning,
            "denies access",
            "scout answers, but you are not on its list of operators. \
             Access is granted within two seconds of being added. \
             Or this is its port for tiles: try boat:7449",
        ),
        (
            AddressState::WrongProtocol,
            false,
            Tone::Warning,
            "does not answer as a robot",
            "A robot with keys is asked at quic/boat:7450, by a console that was started with --keys.",
        ),
        (
            AddressState::WrongProtocol,
            true,
            Tone::Warning,
            "answers without TLS of this fleet",
            "Was the robot started with --keys, and is its certificate of this fleet?",
        ),
        (
            AddressState::Problem("eve is there".to_owned()),
            true,
            Tone::Warning,
            "cannot be asked",
            "eve is there",
        ),
    ] {
        let text = listed_as("tcp/boat:7450", Some(state)).text(has_keys);
        assert_eq!(text, (tone, label, hint.to_owned()));
    }
}

#[test]
fn ipv6_addresses_need_brackets() {
    let hint = no_robot("::1", 7448);
    assert!(hint.ends_with(" try [::1]:7447"), "{hint}");
    assert!(!no_robot("boat", 1).contains("try"), "there is no port 0");
}

#[test]
fn silent_addresses_can_be_forgotten() {
    let addresses = [
        listed_as("tcp/nosuch:7447", Some(AddressState::UnknownName)),
        listed_as("tcp/10.0.0.5:7447", Some(AddressState::Silent)),
        listed_as("tcp/here:7447", Some(AddressState::Found)),
    ];
    let mut window = Harness::builder()
        .with_size(vec2(300.0, 600.0))
        .build_ui_state(
            move |ui, asked: &mut Option<Command>| {
                let command = unanswered_ui(ui, &addresses, false);
                let other = remembered_ui(ui, &addresses);
                *asked = asked.take().or(command).or(other);
            },
            None,
        );
    window.run_steps(2);
    for text in [
        "unknown host",
        "no answer",
        "Other remembered addresses (1)",
    ] {
        let place = window.get_by_label(text).rect();
        assert!(place.right() <= 300.0, "{text}: {place}");
    }
    assert!(window.query_by_label("tcp/here:7447").is_none());
    let second = window.get_all_by_label("Forget").nth(1).unwrap();
    second.click();
    window.run_steps(2);
    let expected = Command::ForgetAddress("tcp/10.0.0.5:7447".to_owned());
    assert_eq!(window.state().clone(), Some(expected));
}
