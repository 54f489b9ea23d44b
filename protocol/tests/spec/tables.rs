//! Keys, layers, the header and the limits.

use protocol::keys::{
    OperatorId, OperatorTopic, RobotId, Topic, all_changes, every_robot_alive, operator_key,
    parse_operator_key, view_of,
};
use protocol::layer::{LayerId, Quantisation};
use protocol::message::{
    Drive, MAX_PART_BYTES, MAX_PLAN_POINTS, MAX_SCAN_POINTS, MAX_SCAN_REACH_CM, MAX_SENSORS,
    MAX_TRAJECTORY_POSES, Refusal,
};
use protocol::shores::{MAX_CLUSTERS, MAX_CORNERS, MAX_SITES};
use protocol::signed::{ENVELOPE_BYTES, MAX_SIGNED_BYTES};
use protocol::tile::codec::MAX_BAND_BYTES;
use protocol::wire::{MAX_MESSAGE_BYTES, PROTOCOL};

use super::{SPEC, table};

#[test]
fn keys() {
    let robot: RobotId = "scout-1".parse().unwrap();
    let layer = LayerId::Elevation;
    let topics = [
        Topic::Alive,
        Topic::Info,
        Topic::Ping,
        Topic::Pose,
        Topic::Status,
        Topic::Localization,
        Topic::Plan,
        Topic::Event,
        Topic::MapHead,
        Topic::View,
        Topic::Changes(layer),
        Topic::Digests(layer),
        Topic::Tiles(layer),
        Topic::Overviews(layer),
        Topic::Shores,
        Topic::Voxels,
        Topic::Trajectory,
        Topic::Scan,
    ];
    let mut expected = topics.map(|topic| topic.key(&robot)).to_vec();
    assert_eq!(expected[9], "foreshore/scout-1/view/*");
    expected[9] = view_of(&robot, &"SESSION".parse().unwrap());
    let anna: OperatorId = "anna".parse().unwrap();
    expected.extend(OperatorTopic::ALL.map(|topic| operator_key(&robot, &anna, topic)));
    let rows = table("## 2. Keys");
    let documented: Vec<&str> = rows.iter().map(|row| row[0].trim_matches('`')).collect();
    assert_eq!(documented, expected);
    for (key, topic) in documented.iter().zip(topics) {
        let parsed = (robot.clone(), topic);
        assert_eq!(Topic::parse(key), Some(parsed), "{key}");
    }
    for (key, topic) in documented[topics.len()..].iter().zip(OperatorTopic::ALL) {
        let parsed = (robot.clone(), anna.clone(), topic);
        assert_eq!(parse_operator_key(key), Some(parsed), "{key}");
        let parsed = (robot.clone(), Topic::Operator(topic));
        assert_eq!(Topic::parse(key), Some(parsed), "{key}");
        let of_all = key.replace("anna", "*");
        assert_eq!(Topic::Operator(topic).key(&robot), of_all);
        assert_eq!(Topic::parse(&of_all), None, "a wildcard is no operator");
    }

    for key in [all_changes(&"ROBOT".parse().unwrap()), every_robot_alive()] {
        assert!(SPEC.contains(&format!("`{key}`")), "{key}");
    }
}

#[test]
fn layers_their_numbers_and_codes() {
    let rows = table("## 5. Layers and cells");
    assert_eq!(rows.len(), LayerId::ALL.len());
    for (row, layer) in rows.iter().zip(LayerId::ALL) {
        assert_eq!(row[0], (layer as u8).to_string());
        assert_eq!(row[1], format!("`{layer}`"));
        let greatest: u16 = row[2].parse().unwrap();
        assert!(layer.quantisation().is_code(greatest), "{layer}");
        let beyond = greatest.checked_add(1);
        assert!(
            beyond.is_none_or(|code| !layer.quantisation().is_code(code)),
            "{layer}"
        );
        let meaning = match layer.quantisation() {
            Quantisation::Classes(classes) => classes
                .iter()
                .zip(1..)
                .map(|(class, code)| format!("{code} {}", class.name))
                .collect::<Vec<_>>()
                .join(", "),
            Quantisation::Linear { .. } => {
                let value = |code| f64::from(layer.quantisation().decode(code).unwrap());
                let per_unit = (1.0 / (value(2) - value(1))).round();
                let zero = 1.0 - (value(1) * per_unit).round();
                format!("`(c − {zero}) / {per_unit}`")
            }
        };
        assert!(row[3].contains(&meaning), "{layer}: {meaning}");
    }
}

#[test]
fn version_and_limits() {
    assert!(SPEC.starts_with(&format!("# The wire of Foreshore, protocol {PROTOCOL}\n")));
    for limit in [
        format!("| message, header included | {MAX_MESSAGE_BYTES} bytes |"),
        format!("| band | {MAX_BAND_BYTES} bytes |"),
        format!("| signed message | {MAX_SIGNED_BYTES} bytes |"),
        format!("envelope\nof {ENVELOPE_BYTES} bytes"),
        format!("less than {} m/s", Drive::NEUTRAL_BELOW),
        format!("| shores in one message | {MAX_CLUSTERS} |"),
        format!("| corners of a shore's outline | {MAX_CORNERS} |"),
        format!("| docking sites in one message | {MAX_SITES} |"),
        format!("| `packed` of a `VoxelsPart` | {MAX_PART_BYTES} bytes |"),
        format!("| poses in one `TrajectoryPart` | {MAX_TRAJECTORY_POSES} |"),
        format!("| sensors in one message | {MAX_SENSORS} |"),
        format!("| points in one `Plan` | {MAX_PLAN_POINTS} |"),
        format!(
            "| points in one `Scan` | {MAX_SCAN_POINTS}, each at most {MAX_SCAN_REACH_CM} cm from its origin along x and \
             y |"
        ),
    ] {
        assert!(SPEC.contains(&limit), "{limit}");
    }
    let longest = "a".repeat(64).parse::<RobotId>();
    let too_long = "a".repeat(65).parse::<RobotId>();
    assert!(longest.is_ok() && too_long.is_err());
    assert!(SPEC.contains("| name of a robot, console or operator | 64 characters |"));
}

#[test]
fn refusals_match_the_table() {
    let rows = table("#### `Refusal`");
    assert_eq!(rows.len(), Refusal::ALL.len());
    for (number, (row, refusal)) in rows.iter().zip(Refusal::ALL).enumerate() {
        assert_eq!(refusal as usize, number);
        let words = format!("{refusal}");
        assert_eq!(
            row[..],
            [&*number.to_string(), &format!("`{refusal:?}`"), &words]
        );
    }
}
