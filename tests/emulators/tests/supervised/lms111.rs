//! A SICK LMS111 on TCP, the first device of the vehicles.

use std::time::Duration;

use drivers::DropReason;
use drivers::status::{Loss, State, Trouble};
use emulators::Emulator;
use emulators::lms111::Lms111;
use measurement::scan::Scan;

use crate::rig::{Rig, age};

fn config(emulator: &Emulator<Lms111>, more: &str) -> String {
    let address = &emulator.address;
    format!("[devices.laser]\nkind = \"sick_cola\"\ntcp = \"{address}\"\n{more}")
}

/// The scan number of a whole sweep of the emulated room, whose every beam is checked.
#[track_caller]
fn scan_number(scan: &Scan, first_beam: usize) -> u16 {
    let millimetres = |range: &f32| (range * 1000.0).round() as u16;
    let number = millimetres(&scan.ranges_m[0]) - Lms111::distance_mm(first_beam, 0);
    for (at, range) in scan.ranges_m.iter().enumerate() {
        let distance_mm = Lms111::distance_mm(first_beam + at, number);
        assert_eq!(millimetres(range), distance_mm, "beam {at}");
    }
    number
}

#[test]
fn it_is_read_as_it_is_set() {
    for coding in ["", "coding = \"a\"", "coding = \"b\""] {
        let emulator = Emulator::on_tcp(Lms111::default());
        let rig = Rig::start(&config(&emulator, coding));
        let (scan, _) = rig.next_scan();
        assert_eq!(scan.ranges_m.len(), 541, "270° in steps of 0.5°");
        assert!((scan.angle_min_rad.to_degrees() + 135.0).abs() < 1e-3);
        assert!((scan.angle_increment_rad.to_degrees() - 0.5).abs() < 1e-5);
        assert!((scan.time_increment_s - 0.02 / 720.0).abs() < 1e-9);
        assert_eq!((scan.range_min_m, scan.range_max_m), (0.5, 20.0));
        scan_number(&scan, 0);
        let status = rig.wait("rated", |status| status.rate_hz > 0.0);
        assert!((status.rate_hz - 50.0).abs() < 3.0, "{status:?}");
        assert_eq!(
            status.identity.as_deref(),
            Some("LMS10x_FieldEval V1.80.2, serial number 1234567")
        );
        assert_eq!((status.trouble, status.lost_connections), (None, 0));
        assert!(status.losses.is_empty(), "{:?}", status.losses);
    }
}

#[test]
fn it_is_set_once_and_cut_to_its_sector() {
    let emulator = Emulator::on_tcp(Lms111::default());
    let more = "rate_hz = 25\nresolution_deg = 0.25\nsector_from_deg = -60\nsector_to_deg = 60\n\
                masks_deg = \"-1..0.9\"\nrange_max_m = 5.0";
    let rig = Rig::start(&config(&emulator, more));
    let (scan, first_ns) = rig.next_scan();
    // The emulated device adds 0.0003° to the first angle.
    assert!((scan.angle_min_rad.to_degrees() + 59.9997).abs() < 0.001);
    assert!((scan.angle_increment_rad.to_degrees() - 0.25).abs() < 1e-5);
    assert!((scan.time_increment_s - 0.04 / 1440.0).abs() < 1e-9);
    assert_eq!(scan.ranges_m.len(), 481);
    let masked: Vec<usize> = (0..481)
        .filter(|beam| scan.ranges_m[*beam].is_nan())
        .collect();
    assert_eq!(masked, (236..244).collect::<Vec<_>>());
    // Beams of 1 to 5.99 m; at 5 m and beyond there is no echo.
    assert!(scan.ranges_m[450].is_infinite());
    assert!((scan.ranges_m[100] - 2.0).abs() < 0.011);
    let (_, second_ns) = rig.next_scan();
    assert!(((second_ns - first_ns) - 40_000_000).abs() < 10_000_000);
    let status = rig.status();
    assert!(status.losses.is_empty(), "{:?}", status.losses);
    drop(rig);

    // Another program, the same settings: nothing is written.
    assert_eq!(emulator.with(|device| device.logins), 1);
    let rig = Rig::start(&config(&emulator, more));
    rig.next();
    assert_eq!(emulator.with(|device| device.logins), 1);
}

#[test]
fn stamps_are_those_of_the_first_beam() {
    let emulator = Emulator::on_tcp(Lms111::default());
    let rig = Rig::start(&config(&emulator, ""));
    // 270° + 45° of a turn of 20 ms, and 3.1 ms to the telegram.
    let expected = Duration::from_micros(17_500 + 3100);
    for _ in 0..50 {
        let reading = rig.next();
        let age = age(&reading);
        assert!(age + Duration::from_micros(10) >= expected, "{age:?}");
        assert!(age < expected + Duration::from_millis(200), "{age:?}");
    }
    let clock = rig.status().clock.unwrap();
    assert!(clock.spread_s < 0.2 && clock.resets == 0, "{clock:?}");
}

#[test]
fn its_clock_may_wrap() {
    let emulator = Emulator::on_tcp(Lms111::default());
    emulator.with(|device| device.clock_start_us = 0_u32.wrapping_sub(1_000_000));
    let rig = Rig::start(&config(&emulator, ""));
    let stamps: Vec<i64> = (0..75).map(|_| rig.next_scan().1).collect();
    for pair in stamps.windows(2) {
        let step_ms = (pair[1] - pair[0]) as f64 / 1e6;
        assert!((0.0..500.0).contains(&step_ms), "{step_ms} ms");
    }
    assert_eq!(rig.status().clock.unwrap().resets, 0);
}

#[test]
fn garbage_between_telegrams_is_counted() {
    let emulator = Emulator::on_tcp(Lms111::default());
    emulator.with(|device| device.has_garbage = true);
    let rig = Rig::start(&config(&emulator, ""));
    let numbers: Vec<u16> = (0..20)
        .map(|_| scan_number(&rig.next_scan().0, 0))
        .collect();
    assert!(
        numbers.windows(2).all(|pair| pair[1] == (pair[0] + 1) % 10),
        "{numbers:?}"
    );
    let status = rig.status();
    assert!(
        status.lost(Loss::Decoder(DropReason::Garbage)) >= 20,
        "{status:?}"
    );
    assert_eq!(status.lost_connections, 0);
}

#[test]
fn repeated_scans_are_used_once() {
    let emulator = Emulator::on_tcp(Lms111::default());
    emulator.with(|device| device.repeats = true);
    let rig = Rig::start(&config(&emulator, ""));
    let numbers: Vec<u16> = (0..20)
        .map(|_| scan_number(&rig.next_scan().0, 0))
        .collect();
    assert!(
        numbers.windows(2).all(|pair| pair[1] == (pair[0] + 1) % 10),
        "{numbers:?}"
    );
    assert!(rig.status().lost(Loss::Repeated) >= 19);
}

#[test]
fn replies_to_other_requests_are_none() {
    let emulator = Emulator::on_tcp(Lms111::default());
    emulator.with(|device| device.replies_to_another = true);
    let rig = Rig::start(&config(&emulator, ""));
    let status = rig.wait("in trouble", |status| status.trouble.is_some());
    assert_eq!(status.trouble, Some(Trouble::NoReply("sRN DeviceIdent")));
    assert!(status.lost(Loss::Unexpected) >= 3, "{status:?}");
    assert_eq!(status.measurements, 0);
    emulator.with(|device| device.replies_to_another = false);
    rig.assert_back();
}

#[test]
fn a_setting_that_is_not_taken_is_reported() {
    let emulator = Emulator::on_tcp(Lms111::default());
    emulator.with(|device| device.is_stubborn = true);
    let rig = Rig::start(&config(&emulator, "rate_hz = 25"));
    let status = rig.wait("in trouble", |status| status.trouble.is_some());
    let Some(Trouble::Refused(why)) = status.trouble else {
        panic!("{status:?}");
    };
    assert!(why.contains("rate_hz") && why.contains("5000"), "{why}");
    // A combination that the device does not have.
    let rig = Rig::start(&config(&emulator, "rate_hz = 33"));
    let status = rig.wait("in trouble", |status| status.trouble.is_some());
    let refused = Trouble::Refused("mLMPsetscancfg is refused with code 1".to_owned());
    assert_eq!(status.trouble, Some(refused));
}

#[test]
fn another_device_is_noticed() {
    let emulator = Emulator::on_tcp(Lms111::default());
    let rig = Rig::start(&config(&emulator, ""));
    rig.wait_until_measuring();
    emulator.with(|device| device.serial_number = 7);
    let status = rig.wait("changed", |status| status.identity_changes > 0);
    assert_eq!(status.identity_changes, 1);
    assert!(status.identity.unwrap().ends_with("serial number 7"));
    rig.assert_back();
    assert_eq!(rig.status().identity_changes, 1);
}

#[test]
fn a_device_that_is_not_the_configured_one_is_not_used() {
    let emulator = Emulator::on_tcp(Lms111::default());
    let rig = Rig::start(&config(&emulator, "identity = \"serial number 7654321\""));
    let status = rig.wait("in trouble", |status| status.trouble.is_some());
    let Some(Trouble::WrongIdentity { configured, found }) = status.trouble else {
        panic!("{status:?}");
    };
    assert_eq!(configured, "serial number 7654321");
    assert!(found.ends_with("serial number 1234567"));
    assert_eq!((status.measurements, rig.drain().len()), (0, 0));
    emulator.with(|device| device.serial_number = 7_654_321);
    rig.assert_back();
}

#[test]
fn a_mute_device_is_asked_in_both_codings() {
    let emulator = Emulator::on_tcp(Lms111::default());
    emulator.with(|device| device.is_mute = true);
    let rig = Rig::start(&config(&emulator, ""));
    let status = rig.wait("in trouble", |status| status.trouble.is_some());
    assert_eq!(status.trouble, Some(Trouble::NoReply("sRN DeviceIdent")));
    assert_ne!(status.state, State::Measuring);
    emulator.with(|device| device.is_mute = false);
    rig.wait_until_measuring();
}
