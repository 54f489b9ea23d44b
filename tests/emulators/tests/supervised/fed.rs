//! Devices that a simulation feeds: what they are given comes back, at its own time.

use std::net::{Ipv4Addr, UdpSocket};
use std::time::Duration;

use emulators::deltat::Deltat;
use emulators::dynamixel::XSeries;
use emulators::ldlrs::LdLrs;
use emulators::lms111::Lms111;
use emulators::mti::{Mti, Sample};
use emulators::nmea::{Nmea, Position};
use emulators::{Device, Emulator};
use measurement::MeasurementData;

use crate::rig::Rig;

const ROUNDS: u32 = 20;

/// Feeds a measurement each `period`; returns what is read. Stamps are as far apart as the measurements.
#[track_caller]
fn read_back<D: Device>(
    emulator: &Emulator<D>,
    config: &str,
    is_ready: impl Fn(&D) -> bool,
    period: Duration,
    feed: impl Fn(&mut D, Duration, u32),
) -> Vec<MeasurementData> {
    let rig = Rig::start(&config.replace("ADDRESS", &emulator.address));
    let give_up_at = emulators::now() + crate::rig::PATIENCE;
    while !emulator.with(|device| is_ready(device)) {
        assert!(emulators::now() < give_up_at, "{:#?}", rig.statuses());
        std::thread::sleep(Duration::from_millis(2));
    }
    let began = emulator.uptime() + Duration::from_millis(300);
    emulator.with(|device| {
        for round in 0..ROUNDS {
            feed(device, began + round * period, round);
        }
    });
    let readings: Vec<_> = (0..ROUNDS).map(|_| rig.next()).collect();
    // The first may have been late; late by more than this is the machine.
    for pair in readings[ROUNDS as usize / 2..].windows(2) {
        let [before, after] = [&pair[0], &pair[1]].map(|it| it.measurement.stamp);
        let off_s = after.since(before).as_secs_f64() - period.as_secs_f64();
        assert!(off_s.abs() < 0.02, "{off_s}");
    }
    readings.into_iter().map(|it| it.measurement.data).collect()
}

/// Beams rise from 2 m by this each, the second has no echo and the third no range.
fn ranges_m(beams: u16, step_m: f32, round: u32) -> Vec<f32> {
    let mut ranges_m: Vec<f32> = (0..beams)
        .map(|beam| 2.0 + step_m * (f32::from(beam) + round as f32))
        .collect();
    (ranges_m[1], ranges_m[2]) = (f32::INFINITY, f32::NAN);
    ranges_m
}

/// What is read; the second and the third beam are `none`.
#[track_caller]
fn assert_ranges(data: &[MeasurementData], step_m: f32, none: [f32; 2], first_deg: f32) {
    for (data, round) in data.iter().zip(0..) {
        let MeasurementData::Scan { scan, .. } = data else {
            panic!("{data:?}");
        };
        assert!((scan.angle_min_rad.to_degrees() - first_deg).abs() < 1e-3);
        let mut expected = ranges_m(scan.ranges_m.len() as u16, step_m, round);
        (expected[1], expected[2]) = (none[0], none[1]);
        for (range_m, expected_m) in scan.ranges_m.iter().zip(&expected) {
            let is_same =
                (range_m - expected_m).abs() < 1e-4 || range_m.to_bits() == expected_m.to_bits();
            assert!(
                is_same || (range_m.is_nan() && expected_m.is_nan()),
                "{range_m} {expected_m}"
            );
        }
    }
}

#[test]
fn lasers_and_a_sonar() {
    let emulator = Emulator::on_tcp(Lms111::default());
    let config = "[devices.laser]\nkind = \"sick_cola\"\ntcp = \"ADDRESS\"\nrate_hz = 25\nresolution_deg = 0.25\n\
                  sector_from_deg = -60\nsector_to_deg = 60";
    let data = read_back(
        &emulator,
        config,
        Lms111::is_subscribed,
        Duration::from_millis(40),
        |device, at, round| device.feed(at, &ranges_m(481, 0.001, round)),
    );
    assert_ranges(&data, 0.001, [f32::INFINITY, f32::NAN], -60.0);

    let emulator = Emulator::on_tcp(LdLrs::default());
    let config = "[devices.laser]\nkind = \"sick_ldlrs\"\ntcp = \"ADDRESS\"";
    let step_m = 1.0 / 256.0;
    let data = read_back(
        &emulator,
        config,
        LdLrs::is_sending,
        Duration::from_millis(200),
        |device, at, round| device.feed(at, &ranges_m(1440, step_m, round)),
    );
    assert_ranges(&data, step_m, [0.0; 2], 180.0);

    let free = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let host = free.local_addr().unwrap();
    drop(free);
    let emulator = Emulator::to_udp(Deltat::default(), host);
    let config = "[devices.sonar]\nkind = \"imagenex_deltat\"\nudp_listen = \"ADDRESS\"";
    let data = read_back(
        &emulator,
        config,
        |_| true,
        Duration::from_millis(100),
        |device, at, round| {
            let mut ranges_m = ranges_m(240, 0.06, round);
            for range_m in &mut ranges_m {
                *range_m += 0.02;
            }
            device.feed(at, &ranges_m);
        },
    );
    let data: Vec<_> = data
        .into_iter()
        .map(|data| match data {
            MeasurementData::Scan { mut scan, own_pose } => {
                // 2.02 m is 34 steps.
                scan.ranges_m
                    .iter_mut()
                    .for_each(|range_m| *range_m -= 0.04);
                MeasurementData::Scan { scan, own_pose }
            }
            other => other,
        })
        .collect();
    assert_ranges(&data, 0.06, [f32::INFINITY; 2], -59.75);
}

#[test]
fn an_attitude_sensor_a_receiver_and_a_servo() {
    let emulator = Emulator::on_serial(Mti::default());
    let config = "[devices.ahrs]\nkind = \"xsens\"\nserial = \"ADDRESS\"";
    let period = Duration::from_millis(10);
    let data = read_back(
        &emulator,
        config,
        Mti::is_measuring,
        period,
        |device, at, round| {
            let sample = Sample {
                attitude_wxyz: [0.6, 0.0, 0.8, 0.0],
                force_mps2: [0.0, 1.0, 9.8],
                rates_radps: [0.1, 0.2, round as f32],
            };
            device.feed(at, sample);
        },
    );
    for (data, round) in data.iter().zip(0..ROUNDS) {
        let MeasurementData::Imu(imu) = data else {
            panic!("{data:?}");
        };
        let [x, y, z, w] = imu.orientation_xyzw.unwrap();
        assert!(x.abs() + z.abs() < 1e-6 && (y - 0.8).abs() + (w - 0.6).abs() < 1e-6);
        assert!((imu.angular_velocity_radps[2] - f64::from(round)).abs() < 1e-6);
        assert!((imu.linear_acceleration_mps2[1] - 1.0).abs() < 1e-6);
    }

    let emulator = Emulator::on_serial(Nmea::default());
    let config = "[devices.gps]\nkind = \"nmea\"\nserial = \"ADDRESS\"";
    let place = |round: u32| Position {
        latitude_deg: 38.51 + 1e-8 * f64::from(round),
        longitude_deg: -9.17 - 1e-8 * f64::from(round),
        height_m: 53.123,
    };
    let period = Duration::from_millis(100);
    let data = read_back(
        &emulator,
        config,
        |_| true,
        period,
        |device, at, round| {
            device.feed(at, place(round));
        },
    );
    for (data, round) in data.iter().zip(0..) {
        let MeasurementData::Fix(fix) = data else {
            panic!("{data:?}");
        };
        let expected = place(round);
        assert!(
            (fix.latitude_deg - expected.latitude_deg).abs() < 2e-9,
            "{fix:?}"
        );
        assert!(
            (fix.longitude_deg - expected.longitude_deg).abs() < 2e-9,
            "{fix:?}"
        );
        assert!(
            (fix.altitude_m - 53.123).abs() < 1e-6 && fix.status == 2,
            "{fix:?}"
        );
    }

    let emulator = Emulator::on_serial(XSeries::default());
    let rig = Rig::start(&format!(
        "[devices.servo]\nkind = \"dynamixel\"\nserial = \"{}\"\nservo = \"x_series\"\nservo_id = 1\njoint = \"tilt\"\n",
        emulator.address
    ));
    let began = emulator.uptime();
    // 0.2 rad/s.
    let angle_rad = move |uptime: Duration| 0.2 * uptime.saturating_sub(began).as_secs_f64();
    emulator.with(|device| device.angle_rad = Some(Box::new(angle_rad)));
    let angle = || {
        let reading = rig.next();
        let MeasurementData::Joints(joints) = reading.measurement.data else {
            panic!();
        };
        (reading.arrived, joints[0].1)
    };
    let (from, first_rad) = angle();
    let (to, last_rad) = (0..50).fold((from, first_rad), |_, _| angle());
    let rate_radps = (last_rad - first_rad) / to.since(from).as_secs_f64();
    assert!((rate_radps - 0.2).abs() < 0.01, "{rate_radps}");
}
