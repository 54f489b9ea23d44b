use crate::corruption_tests::Random;
use measurement::cloud::{Cloud, CloudPoint};
use measurement::scan::Scan;
use measurement::{GeodeticFix, ImuSample, Measurement, RangeReading, StreamId, Twist, pose};
use proptest::prelude::*;

use super::*;

fn measurement(data: MeasurementData) -> Measurement {
    let stamp = RobotTime::from_nanos(1_600_000_002_198_299_885);
    Measurement {
        stamp,
        stream: StreamId(0),
        frame: "odom".into(),
        data,
    }
}

const CONE: RangeReading = RangeReading {
    radiation_type: 1,
    field_of_view_rad: 0.5,
    range_min_m: 0.2,
    range_max_m: 3.0,
    range_m: 1.25,
};

fn samples() -> Vec<Measurement> {
    let scan = Scan {
        angle_min_rad: -1.5,
        angle_increment_rad: 0.5,
        time_increment_s: 0.001,
        range_min_m: 0.02,
        range_max_m: 5.6,
        ranges_m: vec![1.0, f32::INFINITY, 0.25],
    };
    let pose = pose::from_parts([1.0, -2.0, 3.0], [0.0, 0.6, 0.0, 0.8]).unwrap();
    let imu = ImuSample {
        orientation_xyzw: None,
        angular_velocity_radps: [0.1, 0.2, 0.3],
        linear_acceleration_mps2: [0.0, 0.0, 9.81],
    };
    let fix = GeodeticFix {
        latitude_deg: 38.7,
        longitude_deg: -9.1,
        altitude_m: 42.0,
        status: 2,
        sigma_m: Some(0.5),
    };
    let twist = Twist {
        linear_mps: [0.5, 0.0, 0.0],
        angular_radps: [0.0, 0.0, -0.1],
    };
    let child = || "base_link".into();
    [
        MeasurementData::Scan {
            scan,
            own_pose: None,
        },
        MeasurementData::Transform {
            child: child(),
            parent_from_child: pose,
            is_static: false,
        },
        MeasurementData::Odometry {
            child: child(),
            odom_from_base: pose,
        },
        MeasurementData::Imu(imu),
        MeasurementData::Imu(ImuSample {
            orientation_xyzw: Some([0.0, 0.6, 0.0, 0.8]),
            ..imu
        }),
        MeasurementData::Joints(vec![("tilt".to_owned(), 0.3), ("pan".to_owned(), -1.0)]),
        MeasurementData::Fix(fix),
        MeasurementData::Twist(twist),
        MeasurementData::Range(CONE),
        MeasurementData::Cloud(Cloud {
            points: vec![
                CloudPoint {
                    position_m: [1.0, -2.0, 0.5],
                    after_s: 0.05,
                    intensity: 12.0,
                    ring: Some(15),
                },
                CloudPoint {
                    position_m: [1.5, -2.0, 0.5],
                    after_s: 0.1,
                    intensity: 0.0,
                    ring: None,
                },
            ],
            without_return: 1,
        }),
    ]
    .map(measurement)
    .to_vec()
}

#[test]
fn what_is_written_is_read_back() {
    for sample in samples() {
        let (kind, bytes) = encode(&sample, "").unwrap();
        let decoded = decode(kind, Encoding::Cdr, false, &bytes).unwrap();
        let expected = Decoded {
            stamp: Some(sample.stamp),
            frame: sample.frame,
            data: sample.data,
        };
        assert_eq!(decoded, [Ok(expected)], "{kind:?}");
        assert!(ros2msg(kind).is_some(), "{kind:?} has no schema");
    }
}

#[test]
fn a_pose_of_a_stream_of_poses_stays_one() {
    let is_pose = |sample: &Measurement| matches!(sample.data, MeasurementData::Odometry { .. });
    let pose = samples().into_iter().find(is_pose).unwrap();
    let (kind, bytes) = encode(&pose, "geometry_msgs/PoseStamped").unwrap();
    assert_eq!(kind, MessageType::PoseStamped);
    let decoded = decode(kind, Encoding::Cdr, false, &bytes).unwrap();
    let data = decoded
        .into_iter()
        .map(|decoded| decoded.map(|decoded| decoded.data));
    assert_eq!(data.collect::<Vec<_>>(), [Ok(pose.data)]);
    assert!(ros2msg(kind).is_some());
}

#[test]
fn a_message_cut_anywhere_is_refused() {
    for sample in samples() {
        let (kind, bytes) = encode(&sample, "").unwrap();
        // The last fields of some types are not read (covariances, velocities).
        let unread = [
            (MessageType::Odometry, 8 * (36 + 6 + 36)),
            (MessageType::Imu, 8 * 9),
            (MessageType::JointState, 8),
            (MessageType::NavSatFix, 8 * 9 + 1),
            (MessageType::LaserScan, 4),
        ];
        let unread = unread
            .iter()
            .find(|(other, _)| *other == kind)
            .map_or(0, |(_, bytes)| *bytes);
        let read = bytes.len() - unread;
        for length in 0..read {
            let cut = decode(kind, Encoding::Cdr, false, &bytes[..length]);
            assert!(cut.is_err(), "{kind:?} cut at {length} of {read}");
        }
    }
}

/// A ROS 1 `LaserScan`, byte by byte as `roscpp` serialises it.
#[test]
fn ros_1_and_both_byte_orders_are_read() {
    let mut ros1 = Vec::new();
    for word in [7u32, 12, 500_000_000, 6] {
        ros1.extend(word.to_le_bytes());
    }
    ros1.extend(b"/laser");
    let floats = [-1.0f32, 1.0, 1.0, 0.0, 0.1, 0.02, 5.6];
    ros1.extend(floats.iter().flat_map(|value| value.to_le_bytes()));
    ros1.extend(2u32.to_le_bytes());
    ros1.extend([2.5f32, 3.5].iter().flat_map(|value| value.to_le_bytes()));
    ros1.extend(0u32.to_le_bytes());

    let mut big = vec![0, 0, 0, 0];
    for word in [12u32, 500_000_000, 6] {
        big.extend(word.to_be_bytes());
    }
    big.extend(b"laser\0\0\0"); // ends with a zero; the next number stands at a multiple of 4
    big.extend(floats.iter().flat_map(|value| value.to_be_bytes()));
    big.extend(2u32.to_be_bytes());
    big.extend([2.5f32, 3.5].iter().flat_map(|value| value.to_be_bytes()));

    for (encoding, bytes) in [(Encoding::Ros1, ros1), (Encoding::Cdr, big)] {
        let decoded = decode(MessageType::LaserScan, encoding, false, &bytes)
            .unwrap()
            .remove(0)
            .unwrap();
        assert_eq!(decoded.stamp, Some(RobotTime::from_nanos(12_500_000_000)));
        assert_eq!(&*decoded.frame, "laser");
        let MeasurementData::Scan { scan, .. } = decoded.data else {
            panic!("not a scan")
        };
        assert_eq!((scan.angle_min_rad, scan.range_max_m), (-1.0, 5.6));
        assert_eq!(scan.ranges_m, [2.5, 3.5]);
    }
}

#[test]
fn one_bad_transform_does_not_cost_the_others() {
    let sample = samples().remove(1);
    let (kind, good) = encode(&sample, "").unwrap();
    let mut bad = good.clone();
    let last = bad.len() - 8;
    bad[last..].copy_from_slice(&f64::NAN.to_le_bytes());
    // Two transforms. The names of the second start 4 bytes earlier in a word of 8, so that 6 bytes of
    // padding stand before its numbers instead of 2.
    let mut both = bad;
    both[4..8].copy_from_slice(&2u32.to_le_bytes());
    both.extend(&good[8..42]);
    both.extend([0; 6]);
    both.extend(&good[44..]);
    let decoded = decode(kind, Encoding::Cdr, true, &both).unwrap();
    assert_eq!(decoded[0], Err(DecodeError::BadPose));
    assert!(matches!(
        decoded[1].as_ref().unwrap().data,
        MeasurementData::Transform {
            is_static: true,
            ..
        }
    ));
}

#[test]
fn a_zero_stamp_is_no_stamp_and_foreign_cdr_is_refused() {
    let unstamped = Measurement {
        stamp: RobotTime::from_nanos(0),
        ..samples().remove(7)
    };
    let (kind, mut bytes) = encode(&unstamped, "").unwrap();
    let decoded = decode(kind, Encoding::Cdr, false, &bytes)
        .unwrap()
        .remove(0)
        .unwrap();
    assert_eq!(decoded.stamp, None);
    bytes[1] = 3;
    assert_eq!(
        decode(kind, Encoding::Cdr, false, &bytes),
        Err(DecodeError::Encapsulation([0, 3]))
    );
}

/// A field: name, offset, datatype.
type Field = (&'static str, u32, u8);

const XYZ: [Field; 3] = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)];

/// A ROS 1 cloud behind a header which says the sizes.
fn cloud(
    [height, width, point_step, row_step]: [u32; 4],
    fields: &[Field],
    big_endian: bool,
    data: &[u8],
) -> Vec<u8> {
    let mut out = Vec::new();
    for word in [0, 1_700_000_000, 0, 0, height, width, fields.len() as u32] {
        out.extend(word.to_le_bytes());
    }
    for (name, offset, datatype) in fields {
        out.extend((name.len() as u32).to_le_bytes());
        out.extend(name.as_bytes());
        out.extend(offset.to_le_bytes());
        out.push(*datatype);
        out.extend(1u32.to_le_bytes());
    }
    out.push(u8::from(big_endian));
    for word in [point_step, row_step, data.len() as u32] {
        out.extend(word.to_le_bytes());
    }
    out.extend(data);
    out.push(1);
    out
}

fn read_cloud(bytes: &[u8]) -> Result<Cloud, DecodeError> {
    let mut decoded = decode(MessageType::PointCloud2, Encoding::Ros1, false, bytes)?;
    match decoded.remove(0)?.data {
        MeasurementData::Cloud(cloud) => Ok(cloud),
        other => panic!("{other:?}"),
    }
}

/// The fields as the drivers of these sensors write them.
#[test]
fn clouds_of_any_layout_are_read() {
    let position = |scale: f32| [1.0, 2.0, -3.0].map(|metres: f32| (metres * scale).to_le_bytes());
    let xyz = position(1.0).concat();
    let with = |more: &[&[u8]]| [&[&xyz[..]], more].concat().concat();
    let ns = 1_500_000u32.to_le_bytes();
    let velodyne = with(&[
        &7.0f32.to_le_bytes(),
        &3u16.to_le_bytes(),
        &0.0015f32.to_le_bytes(),
    ]);
    let ouster = with(&[&[0; 4], &7.0f32.to_le_bytes(), &ns, &[3, 0]]);
    let hesai = with(&[
        &7.0f32.to_le_bytes(),
        &1_700_000_000.001_5_f64.to_le_bytes(),
        &3u16.to_le_bytes(),
    ]);
    let livox = with(&[
        &7.0f32.to_le_bytes(),
        &[0, 3],
        &1_700_000_000_001_500_000_f64.to_le_bytes(),
    ]);
    let livox_old = with(&[&ns, &[7, 3]]);
    let doubles = [1.0, 2.0, -3.0].map(f64::to_be_bytes).concat();
    let doubles = [
        &doubles[..],
        &7i16.to_be_bytes(),
        &1_500_000u32.to_be_bytes(),
        &[3],
    ]
    .concat();
    let layouts: [(&str, &[Field], bool, Vec<u8>); 6] = [
        (
            "velodyne",
            &[("intensity", 12, 7), ("ring", 16, 4), ("time", 18, 7)],
            false,
            velodyne,
        ),
        (
            "ouster",
            &[("intensity", 16, 7), ("t", 20, 6), ("ring", 24, 2)],
            false,
            ouster,
        ),
        (
            "hesai",
            &[("intensity", 12, 7), ("timestamp", 16, 8), ("ring", 24, 4)],
            false,
            hesai,
        ),
        (
            "livox",
            &[
                ("intensity", 12, 7),
                ("tag", 16, 2),
                ("line", 17, 2),
                ("timestamp", 18, 8),
            ],
            false,
            livox,
        ),
        (
            "livox's own",
            &[
                ("offset_time", 12, 6),
                ("intensity", 16, 2),
                ("line", 17, 2),
            ],
            false,
            livox_old,
        ),
        (
            "big-endian",
            &[
                ("x", 0, 8),
                ("y", 8, 8),
                ("z", 16, 8),
                ("intensity", 24, 3),
                ("t", 26, 6),
                ("channel", 30, 1),
            ],
            true,
            doubles,
        ),
    ];
    for (name, fields, big_endian, point) in layouts {
        let fields = if fields[0].0 == "x" {
            fields.to_vec()
        } else {
            [&XYZ, fields].concat()
        };
        let step = point.len() as u32;
        let bytes = cloud([1, 1, step, step], &fields, big_endian, &point);
        let read = read_cloud(&bytes).unwrap();
        assert_eq!(read.points.len(), 1, "{name}");
        let CloudPoint {
            position_m,
            after_s,
            intensity,
            ring,
        } = read.points[0];
        assert_eq!(
            (position_m, intensity, ring),
            ([1.0, 2.0, -3.0], 7.0, Some(3)),
            "{name}"
        );
        assert!((after_s - 0.0015).abs() < 1e-6, "{name}: {after_s}");
    }
}

#[test]
fn rows_may_be_padded_and_points_may_be_missing() {
    let point = |x: f32| [x, 0.5, -1.0].map(f32::to_le_bytes).concat();
    let [nan, origin] = [f32::NAN, 0.0].map(|value| [value; 3].map(f32::to_le_bytes).concat());
    let rows = [point(1.0), nan, vec![9; 4], point(2.0), origin, vec![9; 4]].concat();
    let cloud = read_cloud(&cloud([2, 2, 12, 28], &XYZ, false, &rows)).unwrap();
    let points = cloud
        .points
        .iter()
        .map(|point| (point.position_m[0], point.ring));
    assert_eq!(points.collect::<Vec<_>>(), [(1.0, Some(0)), (2.0, Some(1))]);
    assert_eq!(cloud.without_return, 2);
}

#[test]
fn a_cloud_that_lies_is_refused_with_the_reason() {
    let data = [0; 48];
    let short = "its data is shorter than its height, width, row_step and point_step say";
    for (sizes, fields, reason) in [
        ([1, 4, 12, 48], &XYZ[..2], "it has no fields x, y and z"),
        ([1, 5, 12, 60], &XYZ[..], short),
        ([1, 4, 12, 36], &XYZ[..], short),
        ([u32::MAX, u32::MAX, 12, u32::MAX], &XYZ[..], short),
        (
            [1, 4, 8, 48],
            &XYZ[..],
            "a field ends beyond its point_step",
        ),
        (
            [1, 4, 12, 48],
            &[("x", 0, 7), ("y", 2, 7), ("z", 8, 7)],
            "its fields overlap",
        ),
        (
            [1, 4, 12, 48],
            &[("x", 0, 9), ("y", 4, 7), ("z", 8, 7)],
            "a field has an unknown datatype",
        ),
        (
            [1, 4, 12, 48],
            &[("x", u32::MAX, 7), ("y", 4, 7), ("z", 8, 7)],
            "a field ends beyond its point_step",
        ),
    ] {
        let read = read_cloud(&cloud(sizes, fields, false, &data));
        assert_eq!(
            read,
            Err(DecodeError::BadCloud(reason)),
            "{sizes:?} {fields:?}"
        );
    }
    assert_eq!(
        read_cloud(&cloud([0, 0, 0, 0], &[], false, &[])),
        Err(DecodeError::BadCloud("it has no fields x, y and z"))
    );
    assert_eq!(
        read_cloud(&cloud([1, 0, 12, 0], &XYZ, false, &[])),
        Ok(Cloud::default())
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    #[test]
    fn nothing_panics_on_any_bytes(
        kind in prop::sample::select(MessageType::NAMES.map(|(kind, _)| kind).to_vec()),
        encoding in prop::sample::select(vec![Encoding::Ros1, Encoding::Cdr]),
        mut bytes in prop::collection::vec(any::<u8>(), 0..600),
        plausible in any::<bool>(),
    ) {
        if plausible && bytes.len() >= 4 {
            bytes[..4].copy_from_slice(&[0, 1, 0, 0]);
        }
        drop(decode(kind, encoding, false, &bytes));
    }

    #[test]
    fn nothing_panics_on_changed_messages(
        sample in 0usize..10,
        flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
    ) {
        let (kind, mut bytes) = encode(&samples()[sample], "").unwrap();
        for (at, value) in flips {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        drop(decode(kind, Encoding::Cdr, false, &bytes));
    }

    #[test]
    fn nothing_panics_on_changed_clouds(
        flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let fields = [&XYZ[..], &[("ring", 12, 4)]].concat();
        let mut bytes = cloud([2, 5, 14, 70], &fields, false, &[1; 140]);
        for (at, value) in flips {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        drop(decode(MessageType::PointCloud2, Encoding::Ros1, false, &bytes));
    }
}

#[test]
fn a_twist_without_a_stamp_is_six_numbers() {
    let twist = measurement::Twist {
        linear_mps: [0.5, 0.0, 0.0],
        angular_radps: [0.0, 0.0, -1.0],
    };
    let message = published::twist(&twist);
    let numbers = [0.5f64, 0.0, 0.0, 0.0, 0.0, -1.0].map(f64::to_le_bytes);
    assert_eq!(message, [&[0, 1, 0, 0][..], &numbers.concat()].concat());
    let decoded = decode(MessageType::Twist, Encoding::Cdr, false, &message).unwrap();
    let decoded = decoded.into_iter().next().unwrap().unwrap();
    assert_eq!(decoded.stamp, None);
    assert_eq!(decoded.data, MeasurementData::Twist(twist));
}

/// A `sensor_msgs/Range` as `roscpp` serialises it, with these numbers from the field of view on.
fn ros1_range(numbers: [f32; 4]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for word in [7u32, 12, 500_000_000, 4] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(b"/us1");
    bytes.push(1); // infrared
    bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
    bytes
}

#[test]
fn a_range_is_read_as_both_systems_write_it() {
    let numbers = [0.5f32, 0.2, 3.0, 1.25];
    let mut jazzy = vec![0, 1, 0, 0];
    for word in [12u32, 500_000_000, 4] {
        jazzy.extend(word.to_le_bytes());
    }
    jazzy.extend(b"us1\0\x01\0\0\0"); // the frame, infrared, padding
    jazzy.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
    jazzy.extend(0.01f32.to_le_bytes()); // the variance
    let mut humble = jazzy.clone();
    humble.truncate(jazzy.len() - 4);
    for (encoding, bytes) in [
        (Encoding::Ros1, ros1_range(numbers)),
        (Encoding::Cdr, jazzy),
        (Encoding::Cdr, humble),
    ] {
        let decoded = decode(MessageType::Range, encoding, false, &bytes).unwrap();
        let decoded = decoded.into_iter().next().unwrap().unwrap();
        assert_eq!(decoded.stamp, Some(RobotTime::from_nanos(12_500_000_000)));
        assert_eq!(&*decoded.frame, "us1");
        assert_eq!(decoded.data, MeasurementData::Range(CONE));
    }
}

#[test]
fn cones_that_cannot_be_are_refused_and_any_range_is_read() {
    let read = |numbers: [f32; 4]| {
        let decoded = decode(
            MessageType::Range,
            Encoding::Ros1,
            false,
            &ros1_range(numbers),
        );
        decoded.unwrap().remove(0).map(|decoded| decoded.data)
    };
    let pi = std::f32::consts::PI;
    for [field_of_view, range_min, range_max] in [
        [f32::NAN, 0.2, 3.0],
        [-0.1, 0.2, 3.0],
        [pi + 0.01, 0.2, 3.0],
        [f32::INFINITY, 0.2, 3.0],
        [0.5, -0.2, 3.0],
        [0.5, f32::NAN, 3.0],
        [0.5, 0.2, f32::NAN],
        [0.5, 3.0, 0.2],
        [0.5, 0.0, 0.0],
    ] {
        let refused = read([field_of_view, range_min, range_max, 1.0]);
        assert_eq!(
            refused,
            Err(DecodeError::BadCone),
            "{field_of_view} {range_min} {range_max}"
        );
    }
    // What a range means is not a question of its bytes; a fixed-distance ranger has equal limits.
    for numbers in [
        [0.0, 0.2, 3.0, f32::NEG_INFINITY],
        [pi, 0.8, 0.8, f32::INFINITY],
        [0.5, 0.2, f32::INFINITY, 99.0],
    ] {
        let Ok(MeasurementData::Range(reading)) = read(numbers) else {
            panic!("{numbers:?}")
        };
        assert_eq!(reading.range_m.to_bits(), numbers[3].to_bits());
    }
}

#[test]
fn a_bool_without_a_stamp_is_one_byte() {
    for value in [false, true] {
        let sample = measurement(MeasurementData::Bool(value));
        let (kind, bytes) = encode(&sample, "").unwrap();
        assert_eq!(
            (kind, &bytes[..]),
            (MessageType::Bool, &[0, 1, 0, 0, u8::from(value)][..])
        );
        assert!(ros2msg(kind).is_some());
        for (encoding, bytes) in [(Encoding::Cdr, &bytes[..]), (Encoding::Ros1, &bytes[4..])] {
            let decoded = decode(kind, encoding, false, bytes).unwrap().remove(0);
            let expected = Decoded {
                stamp: None,
                frame: "".into(),
                data: MeasurementData::Bool(value),
            };
            assert_eq!(decoded, Ok(expected));
        }
        assert!(decode(kind, Encoding::Cdr, false, &bytes[..4]).is_err());
    }
}

#[test]
fn both_forms_of_a_name_are_one_type() {
    for name in ["sensor_msgs/LaserScan", "sensor_msgs/msg/LaserScan"] {
        assert_eq!(
            MessageType::from_type_name(name),
            Some(MessageType::LaserScan)
        );
    }
    assert_eq!(
        MessageType::from_type_name("tf/tfMessage"),
        Some(MessageType::TfMessage)
    );
    assert_eq!(MessageType::from_type_name("sick_scan/RadarScan"), None);
}

/// `FUZZ_INPUTS`, ten million if not set.
#[test]
#[ignore = "a minute: damaged clouds"]
fn no_cloud_panics_in_release() {
    let inputs = std::env::var("FUZZ_INPUTS").map_or(10_000_000, |text| text.parse().unwrap());
    let is_cloud = |sample: &Measurement| matches!(sample.data, MeasurementData::Cloud(_));
    let whole = samples().into_iter().find(is_cloud).unwrap();
    let (kind, whole) = encode(&whole, "").unwrap();
    let mut random = Random(1);
    let (mut clouds, mut points) = (0_u64, 0);
    let mut bytes = Vec::new();
    for _ in 0..inputs {
        bytes.clone_from(&whole);
        for _ in 0..random.below(4) {
            let at = random.below(bytes.len() as u64) as usize;
            bytes[at] = [0, 1, 0xFF, random.below(256) as u8][random.below(4) as usize];
        }
        if random.below(16) == 0 {
            bytes.truncate(random.below(bytes.len() as u64) as usize);
        }
        let encoding = [Encoding::Cdr, Encoding::Ros1][usize::from(random.below(16) == 0)];
        for decoded in decode(kind, encoding, false, &bytes)
            .into_iter()
            .flatten()
            .flatten()
        {
            let MeasurementData::Cloud(cloud) = decoded.data else {
                panic!("{decoded:?}");
            };
            assert!(cloud.points.len() <= bytes.len(), "{}", cloud.points.len());
            clouds += 1;
            points += cloud.points.len();
        }
    }
    println!("{inputs} inputs: {clouds} clouds, {points} points");
}
