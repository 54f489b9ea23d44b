//! What each device measures, value by value.

use std::f64::consts::FRAC_PI_2;
use std::net::{Ipv4Addr, UdpSocket};
use std::time::Duration;

use drivers::DropReason;
use drivers::status::{Loss, State, Trouble};
use emulators::Emulator;
use emulators::deltat::Deltat;
use emulators::dynamixel::XSeries;
use emulators::hokuyo::Hokuyo;
use emulators::imagenex852::Imagenex852;
use emulators::ldlrs::LdLrs;
use emulators::mti::{Mti, yaw_rad};
use emulators::nmea::Nmea;
use emulators::ntrip::{Caster, rtcm};
use emulators::ping1d::Ping1d;
use emulators::rplidar::Rplidar;
use emulators::ublox::Ublox;
use measurement::{GeodeticFix, MeasurementData};

use crate::rig::{PATIENCE, Rig};

fn serial(kind: &str, address: &str, more: &str) -> Rig {
    Rig::start(&format!(
        "[devices.device]\nkind = \"{kind}\"\nserial = \"{address}\"\n{more}"
    ))
}

#[test]
fn an_mti_is_configured_and_read() {
    let emulator = Emulator::on_serial(Mti::default());
    let rig = serial("xsens", &emulator.address, "rate_hz = 50");
    let mut last_yaw_rad = None;
    for _ in 0..50 {
        let MeasurementData::Imu(imu) = rig.next().measurement.data else {
            panic!();
        };
        let rates = imu.angular_velocity_radps;
        let near = |a: f64, b: f64| (a - b).abs() < 1e-6;
        assert!(near(rates[0], 0.01) && near(rates[1], 0.02) && near(rates[2], -0.03));
        let force = imu.linear_acceleration_mps2;
        assert!((force[2] - 9.81).abs() < 1e-6 && near(force[1], -0.2));
        let [x, y, z, w] = imu.orientation_xyzw.unwrap();
        let yaw = 2.0 * libm::atan2(z, w);
        assert!(near(x, 0.0) && near(y, 0.0));
        if let Some(last) = last_yaw_rad {
            let step = f64::from(yaw_rad(2) - yaw_rad(1));
            let is_next = near(yaw - last, step) || yaw < last;
            assert!(is_next, "{last} {yaw}");
        }
        last_yaw_rad = Some(yaw);
    }
    let status = rig.wait("rated", |status| status.rate_hz > 0.0);
    assert_eq!(status.identity.as_deref(), Some("MTi 03601234"));
    assert!((status.rate_hz - 50.0).abs() < 3.0, "{status:?}");
    let clock = status.clock.unwrap();
    assert_eq!(clock.resets, 0);
    assert_eq!(status.lost(Loss::Repeated), 0);
}

#[test]
fn an_mti_that_starts_again_by_itself_is_configured_again() {
    // Its power is gone for less than the supervisor waits.
    let emulator = Emulator::on_serial(Mti::default());
    let rig = serial("xsens", &emulator.address, "");
    rig.wait_until_measuring();
    emulator.power(false);
    std::thread::sleep(Duration::from_millis(100));
    emulator.power(true);
    rig.wait("configured again", |status| {
        status.state == State::Configuring || status.measurements > 50
    });
    rig.assert_back();
    assert_eq!(rig.status().lost_connections, 0);
}

#[test]
fn garbage_on_a_serial_line_is_counted() {
    let emulator = Emulator::on_serial(Mti::default());
    emulator.with(|device| device.has_garbage = true);
    let rig = serial("xsens", &emulator.address, "");
    for _ in 0..100 {
        assert!(matches!(
            rig.next().measurement.data,
            MeasurementData::Imu(_)
        ));
    }
    let status = rig.status();
    assert!(
        status.lost(Loss::Decoder(DropReason::Checksum)) >= 50,
        "{status:?}"
    );
}

#[test]
fn a_port_that_another_program_holds_is_reported() {
    let emulator = Emulator::on_serial(Mti::default());
    let first = serial("xsens", &emulator.address, "");
    first.wait_until_measuring();
    let second = serial("xsens", &emulator.address, "");
    let status = second.wait("in trouble", |status| status.trouble.is_some());
    let text = "another program uses this port".to_owned();
    assert_eq!(status.trouble, Some(Trouble::Io(text)));
    drop(first);
    second.assert_back();
}

#[test]
fn a_hokuyo_is_read() {
    let emulator = Emulator::on_tcp(Hokuyo::default());
    // Its clock wraps soon.
    emulator.with(|device| device.clock_start_ms = (1 << 24) - 700);
    let address = &emulator.address;
    let rig = Rig::start(&format!(
        "[devices.laser]\nkind = \"hokuyo\"\ntcp = \"{address}\"\n"
    ));
    let mut last_ns = None;
    for _ in 0..40 {
        let (scan, stamp_ns) = rig.next_scan();
        assert_eq!(scan.ranges_m.len(), 1081);
        assert!((scan.angle_min_rad.to_degrees() + 135.0).abs() < 1e-3);
        let turn = (scan.ranges_m[0] * 1000.0).round() as u64 - 2000;
        for (step, range) in scan.ranges_m.iter().enumerate() {
            let distance_mm = Hokuyo::distance_mm(step, turn);
            if distance_mm < 20 {
                assert!(range.is_nan(), "{step}");
            } else {
                assert_eq!((range * 1000.0).round() as u32, distance_mm, "{step}");
            }
        }
        if let Some(last_ns) = last_ns {
            let step_ms = (stamp_ns - last_ns) as f64 / 1e6;
            assert!((0.0..500.0).contains(&step_ms), "{step_ms}");
        }
        last_ns = Some(stamp_ns);
    }
    let status = rig.status();
    assert_eq!(
        status.identity.as_deref(),
        Some("UST-10LX, serial number H1234567")
    );
    assert_eq!(status.clock.unwrap().resets, 0);
    assert!(status.losses.is_empty(), "{:?}", status.losses);
}

#[test]
fn a_faulty_laser_is_reported() {
    let emulator = Emulator::on_tcp(Hokuyo::default());
    emulator.with(|device| device.is_faulty = true);
    let address = &emulator.address;
    let rig = Rig::start(&format!(
        "[devices.laser]\nkind = \"hokuyo\"\ntcp = \"{address}\"\n"
    ));
    let status = rig.wait("in trouble", |status| status.trouble.is_some());
    let text = "BM is refused: the laser is faulty".to_owned();
    assert_eq!(status.trouble, Some(Trouble::Refused(text)));
}

#[test]
fn an_ld_lrs_is_read() {
    let emulator = Emulator::on_tcp(LdLrs::default());
    // Its clock wraps soon.
    emulator.with(|device| device.clock_start_ms = 64_000);
    let address = &emulator.address;
    let rig = Rig::start(&format!(
        "[devices.laser]\nkind = \"sick_ldlrs\"\ntcp = \"{address}\"\n"
    ));
    for _ in 0..10 {
        let (scan, _) = rig.next_scan();
        assert_eq!(scan.ranges_m.len(), 1440);
        assert!((scan.angle_increment_rad.to_degrees() - 0.25).abs() < 1e-5);
        assert!((scan.time_increment_s - 0.2 / 1440.0).abs() < 1e-9);
        let turn = (scan.ranges_m[0] * 256.0).round() as u16 - 2560;
        for (beam, range) in scan.ranges_m.iter().enumerate() {
            let distance = LdLrs::distance(beam as u16, turn);
            assert_eq!((range * 256.0).round() as u16, distance, "{beam}");
        }
    }
    let status = rig.status();
    assert_eq!(
        status.identity.as_deref(),
        Some("LD-LRS, serial number 08151234")
    );
    assert_eq!(status.clock.unwrap().resets, 0);
}

#[test]
fn an_rplidar_is_read() {
    let emulator = Emulator::on_usb(Rplidar::default());
    let rig = serial("rplidar", &emulator.address, "");
    for _ in 0..5 {
        let (scan, _) = rig.next_scan();
        assert_eq!(scan.ranges_m.len(), 400);
        assert!(
            (scan.angle_increment_rad.to_degrees() + 0.9).abs() < 1e-4,
            "clockwise"
        );
        for (sample, range) in scan.ranges_m.iter().enumerate() {
            let distance_mm = Rplidar::distance_mm(sample as u64);
            assert_eq!((range * 1000.0).round() as u16, distance_mm, "{sample}");
        }
    }
    let identity = rig.status().identity.unwrap();
    assert!(identity.contains("0x18") && identity.ends_with("30313233343536373839414243444546"));
}

/// What both emulated receivers say.
#[track_caller]
fn assert_is_the_place(fix: &GeodeticFix) {
    assert!((fix.latitude_deg - 47.375).abs() < 1e-7, "{fix:?}");
    assert!((fix.longitude_deg - 8.5375).abs() < 1e-7, "{fix:?}");
    assert!((fix.altitude_m - 458.0).abs() < 1e-6, "{fix:?}");
    assert_eq!(fix.status, 2);
}

#[test]
fn an_nmea_receiver_and_sounder_is_read() {
    let emulator = Emulator::on_serial(Nmea::default());
    let rig = serial("nmea", &emulator.address, "");
    let mut depths = 0;
    for _ in 0..20 {
        match rig.next().measurement.data {
            MeasurementData::Fix(fix) => assert_is_the_place(&fix),
            MeasurementData::Scan { scan, .. } => {
                depths += 1;
                assert_eq!(scan.ranges_m.len(), 1, "DBT says the same again");
                assert!((3.0..7.0).contains(&scan.ranges_m[0]));
            }
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(depths, 10);
    emulator.with(|device| device.has_wrong_sums = true);
    let status = rig.wait("lost", |status| status.lost_connections > 0);
    assert!(
        status.lost(Loss::Decoder(DropReason::Checksum)) > 5,
        "{status:?}"
    );
}

#[test]
fn a_ublox_is_configured_and_read() {
    let emulator = Emulator::on_usb(Ublox::default());
    let rig = serial("ublox", &emulator.address, "rate_hz = 10");
    for _ in 0..10 {
        match rig.next().measurement.data {
            MeasurementData::Fix(fix) => assert_is_the_place(&fix),
            other => panic!("{other:?}"),
        }
    }
    let status = rig.wait("rated", |status| status.rate_hz > 0.0);
    assert!((status.rate_hz - 10.0).abs() < 1.0, "{status:?}");
    emulator.with(|device| device.refuses = true);
    let second = Emulator::on_usb(Ublox::default());
    second.with(|device| device.refuses = true);
    let rig = serial("ublox", &second.address, "");
    let status = rig.wait("in trouble", |status| status.trouble.is_some());
    assert!(
        matches!(status.trouble, Some(Trouble::Refused(_))),
        "{status:?}"
    );
}

/// Corrections go from the caster to the receiver, and positions the other way.
#[test]
fn corrections_reach_the_receiver() {
    let caster = Emulator::on_tcp(Caster::new("RTCM3"));
    let receiver = Emulator::on_serial(Nmea::default());
    let rig = Rig::start(&format!(
        "[devices.gps]\nkind = \"nmea\"\nserial = \"{}\"\ncorrections = \"caster\"\n\
         [devices.caster]\nkind = \"ntrip\"\ntcp = \"{}\"\nmountpoint = \"RTCM3\"\n",
        receiver.address, caster.address
    ));
    let give_up_at = emulators::now() + PATIENCE;
    let frames = loop {
        let received = receiver.with(|device| device.received.clone());
        if received.len() >= 36 && !caster.with(|device| device.positions.is_empty()) {
            break received;
        }
        assert!(
            emulators::now() < give_up_at,
            "{received:?}, {:#?}",
            rig.statuses()
        );
        std::thread::sleep(Duration::from_millis(10));
    };
    let first = frames[8];
    for (at, frame) in frames.chunks_exact(12).enumerate() {
        assert_eq!(frame, rtcm(first.wrapping_add(at as u8)));
    }
    let position = caster.with(|device| device.positions[0].clone());
    assert!(position.starts_with("$GPGGA,0000"), "{position}");
    assert!(
        position.contains(",4722.50000,N,00832.25000,E,1,"),
        "{position}"
    );
}

#[test]
fn a_caster_that_refuses_is_reported() {
    let caster = Emulator::on_tcp(Caster::new("RTCM3"));
    let config = |mountpoint: &str| {
        let address = &caster.address;
        format!(
            "[devices.caster]\nkind = \"ntrip\"\ntcp = \"{address}\"\nmountpoint = \"{mountpoint}\"\n"
        )
    };
    let rig = Rig::start(&config("OTHER"));
    let status = rig.wait("in trouble", |status| status.trouble.is_some());
    assert!(
        matches!(&status.trouble, Some(Trouble::Refused(why)) if why.contains("sourcetable")),
        "{status:?}"
    );
    // user:secret
    caster.with(|device| device.authorization = Some("dXNlcjpzZWNyZXQ=".to_owned()));
    let rig = Rig::start(&config("RTCM3"));
    let status = rig.wait("in trouble", |status| status.trouble.is_some());
    assert!(
        matches!(&status.trouble, Some(Trouble::Refused(why)) if why.contains("401")),
        "{status:?}"
    );
    let login = config("RTCM3") + "user = \"user\"\npassword = \"secret\"\n";
    let rig = Rig::start(&login);
    rig.wait("measuring", |status| status.state == State::Measuring);
}

#[test]
fn an_imagenex_852_is_asked_for_shots() {
    let emulator = Emulator::on_serial(Imagenex852::default());
    let rig = serial(
        "imagenex852",
        &emulator.address,
        "rate_hz = 20\nsound_speed_mps = 1450\n",
    );
    for shot in 1..=10 {
        let (scan, _) = rig.next_scan();
        let range_m = f64::from(Imagenex852::range_cm(shot)) / 100.0 * 1450.0 / 1500.0;
        assert!(
            (f64::from(scan.ranges_m[0]) - range_m).abs() < 1e-4,
            "{shot}"
        );
        assert_eq!((scan.range_min_m, scan.range_max_m), (0.5, 30.0));
    }
    emulator.with(|device| device.has_no_echo = true);
    rig.drain();
    rig.next();
    assert!(rig.next_scan().0.ranges_m[0].is_infinite());
}

#[test]
fn a_ping1d_is_asked_for_distances() {
    for sound_speed in [None, Some("sound_speed_mps = 1450.5")] {
        let emulator = Emulator::on_udp(Ping1d::default());
        let address = &emulator.address;
        let more = sound_speed.unwrap_or_default();
        let rig = Rig::start(&format!(
            "[devices.sounder]\nkind = \"ping1d\"\nudp = \"{address}\"\n{more}\n"
        ));
        for ping in 1..=5 {
            let (scan, _) = rig.next_scan();
            let millimetres = (scan.ranges_m[0] * 1000.0).round() as u32;
            assert_eq!(millimetres, Ping1d::distance_mm(ping));
        }
        let expected = if sound_speed.is_some() {
            1_450_500
        } else {
            1_500_000
        };
        assert_eq!(emulator.with(|device| device.sound_speed_mmps), expected);
        assert_eq!(
            rig.status().identity.as_deref(),
            Some("Ping1D, firmware 3.29.0")
        );
    }
    let emulator = Emulator::on_udp(Ping1d::default());
    emulator.with(|device| device.device_type = 2);
    let address = &emulator.address;
    let rig = Rig::start(&format!(
        "[devices.sounder]\nkind = \"ping1d\"\nudp = \"{address}\"\n"
    ));
    let status = rig.wait("in trouble", |status| status.trouble.is_some());
    assert!(
        matches!(status.trouble, Some(Trouble::Refused(_))),
        "{status:?}"
    );
}

#[test]
fn a_deltat_is_read() {
    let free = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let host = free.local_addr().unwrap();
    drop(free);
    let emulator = Emulator::to_udp(Deltat::default(), host);
    emulator.with(|device| device.repeats = true);
    let rig = Rig::start(&format!(
        "[devices.sonar]\nkind = \"imagenex_deltat\"\nudp_listen = \"{host}\"\n"
    ));
    for _ in 0..5 {
        let (scan, _) = rig.next_scan();
        assert_eq!(scan.ranges_m.len(), 480);
        assert!(
            (f64::from(scan.angle_min_rad) + FRAC_PI_2 / 1.5).abs() < 1e-6,
            "-60°"
        );
        let steps = |range: &f32| (range / 0.06).round() as u16;
        let ping = u32::from(steps(&scan.ranges_m[0]) - 100);
        for (beam, range) in scan.ranges_m.iter().enumerate() {
            match Deltat::range(beam as u16, ping) {
                0 => assert!(range.is_infinite(), "{beam}"),
                expected => assert_eq!(steps(range), expected, "{beam}"),
            }
        }
    }
    assert!(rig.status().lost(Loss::Repeated) >= 4);
}

#[test]
fn a_servo_says_where_it_is() {
    let emulator = Emulator::on_serial(XSeries::default());
    let more = "servo = \"x_series\"\nservo_id = 1\njoint = \"laser_tilt_joint\"\n";
    let rig = serial("dynamixel", &emulator.address, more);
    let angle = |rig: &Rig| match rig.next().measurement.data {
        MeasurementData::Joints(joints) => {
            assert_eq!(joints[0].0, "laser_tilt_joint");
            joints[0].1
        }
        other => panic!("{other:?}"),
    };
    assert!(angle(&rig).abs() < 1e-9);
    emulator.with(|device| device.position = 3072);
    rig.drain();
    angle(&rig);
    assert!((angle(&rig) - FRAC_PI_2).abs() < 1e-9);
}

#[test]
fn a_servo_turns_to_the_goal_of_its_joint_within_its_sweep() {
    let emulator = Emulator::on_serial(XSeries::default());
    let more = "servo = \"x_series\"\nservo_id = 1\njoint = \"tilt\"\n\
                sweep_from_deg = 0\nsweep_to_deg = 45\nsweep_degps = 180\n";
    let rig = serial("dynamixel", &emulator.address, more);
    rig.wait_until_measuring();
    let [goal] = rig.drivers.goals() else {
        panic!("one joint");
    };
    assert_eq!(goal.joint(), "tilt");
    for (goal_deg, reached_deg) in [(10.0_f64, 10.0), (30.0, 30.0), (80.0, 45.0), (-5.0, 0.0)] {
        goal.set(goal_deg.to_radians());
        rig.wait("there", |_| {
            let position = emulator.with(|device| device.position);
            (f64::from(position - 2048) * 360.0 / 4096.0 - reached_deg).abs() < 0.1
        });
    }
    // It stays, and its angle is read.
    rig.drain();
    for _ in 0..10 {
        let MeasurementData::Joints(joints) = rig.next().measurement.data else {
            panic!("no angle");
        };
        assert!(joints[0].1.abs() < 0.002, "{joints:?}");
    }
    let goals = emulator.with(|device| device.goals.clone());
    assert_eq!(goals[goals.len() - 4..], [2162, 2389, 2560, 2048]);
}

#[test]
fn a_servo_sweeps_between_its_ends_and_its_latency_is_measured() {
    let emulator = Emulator::on_serial(XSeries::default());
    let more = "servo = \"x_series\"\nservo_id = 1\njoint = \"tilt\"\n\
                sweep_from_deg = -10\nsweep_to_deg = 20\nsweep_degps = 90\n";
    let rig = serial("dynamixel", &emulator.address, more);
    rig.wait_until_measuring();
    rig.wait("to and fro", |_| {
        emulator.with(|device| device.goals.len()) >= 5
    });
    let goals = emulator.with(|device| device.goals.clone());
    assert_eq!(goals[..4], [1934, 2276, 1934, 2276]);
    let angles = rig.drain().into_iter().map(|reading| {
        let MeasurementData::Joints(joints) = reading.measurement.data else {
            panic!("no angle");
        };
        joints[0].1.to_degrees()
    });
    let (least, most) = angles.fold((0.0_f64, 0.0_f64), |(least, most), angle| {
        (least.min(angle), most.max(angle))
    });
    assert!((-10.1..-8.0).contains(&least), "{least}");
    assert!((18.0..20.1).contains(&most), "{most}");
    let status = rig.status();
    // On a busy machine some replies are late.
    assert!(
        status.losses.keys().all(|loss| *loss == Loss::Stale),
        "{status:?}"
    );
    let latency_s = status.clock.unwrap().offset_s;
    assert!((1e-5..0.05).contains(&latency_s), "{latency_s}");

    // Overheated: it holds no more.
    emulator.with(|device| device.error = 0x80);
    rig.wait("refused", |status| {
        let text = status.trouble.as_ref().map(ToString::to_string);
        text.is_some_and(|text| text.contains("the servo has a fault: Hardware"))
    });
}
