use measurement::cloud::{Cloud, CloudPoint};
use measurement::pose::Pose;
use measurement::{StreamId, Twist};
use proptest::prelude::*;

use super::{MAX_BUFFERED, *};

/// A measurement that carries its arrival number.
fn item(stream: u16, stamp_ms: i64, number: usize) -> Measurement {
    Measurement {
        stamp: ms(stamp_ms),
        stream: StreamId(stream),
        frame: "".into(),
        data: MeasurementData::Twist(Twist {
            linear_mps: [number as f64, 0.0, 0.0],
            angular_radps: [0.0; 3],
        }),
    }
}

fn transform(stamp_ms: i64, child: &str, is_static: bool) -> Measurement {
    Measurement {
        stamp: ms(stamp_ms),
        stream: StreamId(9),
        frame: "base_link".into(),
        data: MeasurementData::Transform {
            child: child.into(),
            parent_from_child: Pose::identity(),
            is_static,
        },
    }
}

const fn ms(stamp_ms: i64) -> RobotTime {
    RobotTime::from_nanos(stamp_ms * 1_000_000)
}

fn number(measurement: &Measurement) -> usize {
    let MeasurementData::Twist(twist) = &measurement.data else {
        panic!("{measurement:?}");
    };
    twist.linear_mps[0] as usize
}

/// Everything that comes out, and how many were late.
fn order(items: Vec<Measurement>) -> (Vec<Ordered>, u64) {
    let mut order = TimeSequencer::default();
    for item in items {
        order.push(item);
    }
    order.finish();
    let out = std::iter::from_fn(|| order.pop()).collect();
    assert_eq!(order.drops.total(), order.drops.get(DropReason::Late));
    (out, order.drops.total())
}

/// Stream and stamp in ms.
type Items = &'static [(u16, i64)];
/// Stamps in ms that come out, `R` for a reset, and the number of late ones.
type Expected = (&'static str, u64);

#[test]
fn stamps_come_out_in_order() {
    let cases: [(&str, Items, Expected); 11] = [
        (
            "disorder within the window is put right",
            &[(0, 100), (1, 40), (0, 900), (1, 300), (0, 1500), (1, 700)],
            ("40 100 300 700 900 1500", 0),
        ),
        (
            "what comes after its turn is late",
            &[(0, 0), (0, 900), (0, 1800), (0, 2700), (1, 1700), (1, 500)],
            ("0 900 1700 1800 2700", 1),
        ),
        (
            "one stamp far in the future costs nothing else",
            &[
                (0, 0),
                (1, 100),
                (0, 9_000_000),
                (0, 300),
                (1, 200),
                (0, 1500),
                (1, 1400),
                (0, 2300),
                (1, 2200),
            ],
            ("0 100 200 300 1400 1500 2200 2300 9000000", 0),
        ),
        (
            "two in the future cost a reset at most",
            &[
                (0, 0),
                (0, 9_000_000),
                (0, 9_000_001),
                (0, 100),
                (0, 200),
                (0, 1300),
                (1, 1200),
            ],
            ("0 9000000 9000001 R9000001>100 100 200 1200 1300", 0),
        ),
        (
            "a first stamp in the future costs a reset at most",
            &[(0, 9_000_000), (1, 0), (0, 10), (1, 20), (0, 30), (1, 25)],
            ("0 20 9000000 R9000000>10 10 25 30", 0),
        ),
        (
            "a pause is followed",
            &[
                (0, 0),
                (1, 5),
                (0, 60_000),
                (1, 59_900),
                (0, 60_500),
                (1, 60_400),
            ],
            ("0 5 59900 60000 60400 60500", 0),
        ),
        (
            "a sensor may be slower than the window",
            &[(0, 0), (0, 9000), (0, 18_000), (0, 27_000)],
            ("0 9000 18000 27000", 0),
        ),
        (
            "one old stamp is late",
            &[(0, 5000), (0, 0), (0, 5100), (0, 5200)],
            ("5000 5100 5200", 1),
        ),
        (
            "a clock reset is followed",
            &[
                (0, 5000),
                (1, 5100),
                (0, 5200),
                (0, 20),
                (1, 10),
                (0, 120),
                (1, 110),
            ],
            ("5000 5100 5200 R5200>20 10 20 110 120", 0),
        ),
        (
            "an old stamp at the end is no reset",
            &[(0, 5000), (0, 20)],
            ("5000", 1),
        ),
        (
            "old stamps of two streams are a reset",
            &[(0, 5000), (1, 5000), (0, 20), (1, 10)],
            ("5000 5000 R5000>20 10 20", 0),
        ),
    ];
    for (what, items, expected) in cases {
        let items = items.iter().zip(0..);
        let items = items.map(|(&(stream, stamp), number)| item(stream, stamp, number));
        let (out, late) = order(items.collect());
        let millis = |stamp: RobotTime| stamp.as_nanos() / 1_000_000;
        let out = out.iter().map(|ordered| match ordered {
            Ordered::Measurement(m) => millis(m.stamp).to_string(),
            Ordered::ClockReset { from, to } => format!("R{}>{}", millis(*from), millis(*to)),
        });
        let out: Vec<String> = out.collect();
        assert_eq!((out.join(" ").as_str(), late), expected, "{what}");
    }
}

#[test]
fn items_leave_once_the_window_has_passed() {
    let mut order = TimeSequencer::default();
    for (n, stamp) in [0, 500, 999].into_iter().enumerate() {
        order.push(item(0, stamp, n));
    }
    assert_eq!(order.pop(), None);
    order.push(item(0, 1000, 3));
    assert_eq!(order.pop(), Some(Ordered::Measurement(item(0, 0, 0))));
    assert_eq!(order.pop(), None);
}

#[test]
fn an_old_transform_said_again_and_again_is_no_reset() {
    let mut items = vec![transform(0, "antenna", false)];
    for n in 1..50 {
        items.push(item(0, n * 100, 0));
        items.push(transform(0, "antenna", false));
    }
    let (out, late) = order(items);
    assert!(out.iter().all(|o| matches!(o, Ordered::Measurement(_))));
    assert_eq!(out.len() as u64 + late, 99);
    assert_eq!(late, 49 - 10, "the first second's are in time");
}

#[test]
fn transforms_dated_into_the_future_leave_the_window_to_others() {
    let mut items = Vec::new();
    for n in 1..50 {
        items.push(item(0, n * 100, 0));
        items.push(transform(n * 100 + 1500, "odom", false));
        items.push(item(1, n * 100 - 900, 0));
    }
    let (out, late) = order(items);
    assert_eq!((out.len(), late), (147, 0));
}

#[test]
fn static_transforms_pass_at_once() {
    let mut order = TimeSequencer::default();
    order.push(item(0, 5000, 0));
    let fixed = transform(0, "laser", true);
    order.push(fixed.clone());
    assert_eq!(order.pop(), Some(Ordered::Measurement(fixed)));
    assert_eq!(order.pop(), None);
    assert_eq!(order.drops.total(), 0);
}

#[test]
fn the_oldest_leave_early_where_too_many_wait() {
    let mut order = TimeSequencer::default();
    for n in 0..MAX_BUFFERED + 10 {
        order.push(item(0, 0, n));
    }
    let out: Vec<_> = std::iter::from_fn(|| order.pop()).collect();
    assert_eq!(out.len(), 10);
    assert_eq!(out[9], Ordered::Measurement(item(0, 0, 9)));
}

#[test]
fn scans_with_poses_pass_at_once() {
    let mut scan = item(1, -446, 0);
    scan.data = MeasurementData::Scan {
        scan: measurement::scan::Scan::default(),
        own_pose: Some(measurement::OwnPose {
            odom_from_sensor: Pose::identity(),
            odom_from_base: Pose::identity(),
        }),
    };
    let (out, late) = order(vec![
        item(0, 0, 0),
        item(0, 5000, 1),
        item(0, 10_000, 2),
        scan.clone(),
        item(0, 10_001, 3),
    ]);
    assert_eq!(late, 0);
    assert!(out.contains(&Ordered::Measurement(scan)));
    assert_eq!(out.len(), 5);
}

proptest! {
    #[test]
    fn order_holds_for_any_stamps(
        stamps in prop::collection::vec((0_u16..3, prop_oneof![0_i64..8000, 0_i64..200, 0_i64..100_000]), 0..80)
    ) {
        let count = stamps.len();
        let items = stamps.iter().enumerate().map(|(n, &(stream, stamp))| item(stream, stamp, n));
        let (out, late) = order(items.collect());
        let mut last = None;
        let mut seen = vec![false; count];
        for ordered in &out {
            match ordered {
                Ordered::Measurement(m) => {
                    let key = (m.stamp, number(m));
                    prop_assert!(Some(key) > last, "{:?} after {:?}", key, last);
                    last = Some(key);
                    prop_assert!(!std::mem::replace(&mut seen[number(m)], true));
                }
                Ordered::ClockReset { .. } => last = None,
            }
        }
        let lost = seen.iter().filter(|&&seen| !seen).count();
        prop_assert_eq!(lost as u64, late);
    }

    #[test]
    fn disorder_up_to_the_window_loses_nothing(
        steps in prop::collection::vec((0_u16..3, 0_i64..400, 0_i64..=1000), 0..80)
    ) {
        let mut now = 0;
        let items: Vec<_> = steps.iter().enumerate().map(|(n, &(stream, step, delay))| {
            now += step;
            item(stream, now - delay, n)
        }).collect();
        let mut expected = items.clone();
        expected.sort_by_key(|m| m.stamp);
        let (out, late) = order(items);
        prop_assert_eq!(late, 0);
        let expected: Vec<_> = expected.into_iter().map(Ordered::Measurement).collect();
        prop_assert_eq!(out, expected);
    }
}

#[test]
fn live_data_waits_briefly_and_late_data_is_released() {
    let mut order = TimeSequencer::live(RobotDuration::from_millis(50));
    let out = |order: &mut TimeSequencer| {
        let mut stamps = Vec::new();
        while let Some(Ordered::Measurement(measurement)) = order.pop() {
            stamps.push(measurement.stamp.as_nanos() / 1_000_000);
        }
        stamps
    };
    for (stream, stamp) in [(0, 100), (1, 90), (0, 120), (0, 150)] {
        order.push(item(stream, stamp, 0));
    }
    assert_eq!(
        out(&mut order),
        [90, 100],
        "the clock has passed them by 50 ms"
    );
    order.push(item(1, 70, 0));
    assert_eq!(out(&mut order), [] as [i64; 0], "behind its own source");
    assert_eq!(order.drops().total(), 1);
    order.push(item(2, 70, 0));
    assert_eq!(out(&mut order), [70], "late, and wanted all the same");
    assert_eq!(order.drops().total(), 1);
    // No more input: the buffered items are released.
    order.release_until(ms(120));
    assert_eq!(out(&mut order), [120]);
    order.release_until(ms(150));
    assert_eq!(out(&mut order), [150]);
    // A stamp far ahead is no more believed than in a recording.
    order.push(item(0, 9_000, 0));
    order.push(item(1, 200, 0));
    assert_eq!(order.oldest_buffered_stamp(), Some(ms(200)));
    order.release_until(ms(200));
    assert_eq!(out(&mut order), [200]);
    // Nor does it go on when the next of its source says otherwise.
    order.push(item(0, 300, 0));
    assert_eq!(order.oldest_buffered_stamp(), Some(ms(300)));
    order.release_until(ms(300));
    assert_eq!(order.oldest_buffered_stamp(), None);
    assert_eq!(out(&mut order), [300]);
}

fn cloud(points: usize) -> Measurement {
    Measurement {
        stamp: RobotTime::default(),
        stream: StreamId(0),
        frame: "".into(),
        data: MeasurementData::Cloud(Cloud {
            points: vec![
                CloudPoint {
                    position_m: [0.0; 3],
                    after_s: 0.0,
                    intensity: 0.0,
                    ring: None,
                };
                points
            ],
            without_return: 0,
        }),
    }
}

#[test]
fn items_and_bytes_are_bounded() {
    let mut room = ReorderBuffer::default();
    for arrival in 0..MAX_BUFFERED as u64 {
        room.insert(arrival, cloud(0));
    }
    assert!(!room.is_over_limit());
    room.insert(u64::MAX, cloud(0));
    assert!(room.is_over_limit());

    let mut room = ReorderBuffer::default();
    let points = MAX_BUFFERED_BYTES / size_of::<CloudPoint>();
    room.insert(0, cloud(points));
    assert!(!room.is_over_limit());
    room.insert(1, cloud(1));
    assert!(room.is_over_limit());
    assert_eq!(room.pop_first(), Some(cloud(points)));
    assert!(!room.is_over_limit());
}
