//! Three-dimensional lidars: the clouds of a decoder that is fed with the same packets come, at the right times.

use std::fs;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};

use drivers::DropReason;
use drivers::status::{Loss, Trouble};
use emulators::Emulator;
use emulators::livox::{self, Commands, FRAME, POINTS};
use emulators::packets::{Metadata, Packets};
use lidar::ouster::Ouster;
use lidar::{LidarDecoder, Sensor};
use measurement::MeasurementData;
use measurement::cloud::Cloud;
use measurement::time::RobotTime;

use crate::recorded::{os0, vlp16};
use crate::rig::Rig;
use crate::shared_data::shared_data;

pub(crate) fn free_address() -> SocketAddr {
    let free = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    free.local_addr().unwrap()
}

fn next_cloud(rig: &Rig) -> (Cloud, i64) {
    let reading = rig.next();
    match reading.measurement.data {
        MeasurementData::Cloud(cloud) => (cloud, reading.measurement.stamp.as_nanos()),
        other => panic!("{other:?}"),
    }
}

/// Clouds of a sensor that is switched on after its driver was started, and those of a decoder of its packets.
#[track_caller]
fn compare(rig: &Rig, emulator: &Emulator<Packets>, sensor: Sensor, clouds: usize) {
    let mut decoder = LidarDecoder::new(sensor);
    let mut expected = Vec::new();
    for number in 0.. {
        if expected.len() >= clouds {
            break;
        }
        let (_, bytes) = emulator.with(|packets| packets.packet(number));
        expected.extend(decoder.push(RobotTime::default(), &bytes).unwrap());
    }
    emulator.power(true);
    let mut last_ns = None;
    for (number, revolution) in expected.into_iter().enumerate() {
        let (cloud, stamp_ns) = next_cloud(rig);
        assert_eq!(
            cloud.points.len(),
            revolution.cloud.points.len(),
            "{number}"
        );
        assert!(cloud == revolution.cloud, "{number}");
        let sensor_ns = (revolution.sensor_time_s * 1e9) as i64;
        if let Some((stamp_before_ns, sensor_before_ns)) = last_ns.replace((stamp_ns, sensor_ns)) {
            // The first may have been late; late by more than this is the machine.
            let off_ns = (stamp_ns - stamp_before_ns) - (sensor_ns - sensor_before_ns);
            assert!(off_ns.abs() < 20_000_000, "{number}: {off_ns}");
        }
    }
    let status = rig.status();
    assert_eq!(status.losses.values().sum::<u64>(), 0, "{status:?}");
}

/// Loses three packets, of which two follow each other, and damages another; each is counted once.
#[track_caller]
fn assert_counted_once(rig: &Rig, emulator: &Emulator<Packets>) {
    emulator.with(|packets| {
        let soon = packets.sent() + 20;
        packets.lost.extend([soon, soon + 1, soon + 40]);
        packets.damaged.insert(soon + 20);
    });
    rig.wait("counted", |status| {
        status.lost(Loss::Decoder(DropReason::Lost)) >= 3
    });
    for _ in 0..3 {
        next_cloud(rig);
    }
    let losses: Vec<_> = rig.status().losses.into_iter().collect();
    let expected = [(DropReason::Field, 1), (DropReason::Lost, 3)];
    assert_eq!(
        losses,
        expected.map(|(reason, count)| (Loss::Decoder(reason), count))
    );
}

#[test]
fn a_vlp16_gives_the_clouds_of_its_packets_with_and_without_its_calibration() {
    let Some(packets) = vlp16() else {
        return;
    };
    let calibration = shared_data("velodyne").unwrap().join("VLP16.yaml");
    let host = free_address();
    let emulator = Emulator::to_udp(packets, host);
    for calibration in [
        String::new(),
        format!("calibration = \"{}\"", calibration.display()),
    ] {
        emulator.power(false);
        emulator.with(|packets| {
            packets.lost.clear();
            packets.damaged.clear();
        });
        let rig = Rig::start(&format!(
            "[devices.lidar]\nkind = \"velodyne\"\nudp_listen = \"{host}\"\nidentity = \"VLP-16 at 127.0.0.1\"\n{calibration}"
        ));
        rig.wait("listening", |status| {
            status.state == drivers::status::State::Configuring
        });
        compare(&rig, &emulator, Sensor::Velodyne(Box::default()), 8);
        assert_counted_once(&rig, &emulator);
    }
}

#[test]
fn an_ouster_is_asked_for_its_metadata() {
    let Some((packets, metadata)) = os0() else {
        return;
    };
    let metadata = fs::read_to_string(metadata).unwrap();
    let ouster = Ouster::new(&metadata).unwrap();
    let host = free_address();
    let emulator = Emulator::to_udp(packets, host);
    emulator.power(false);
    let page = Emulator::on_tcp(Metadata::new(metadata));
    let rig = Rig::start(&format!(
        "[devices.lidar]\nkind = \"ouster\"\nudp_listen = \"{host}\"\nhost = \"{}\"\nidentity = \"992137000142\"",
        page.address
    ));
    rig.wait("listening", |status| {
        status.state == drivers::status::State::Configuring
    });
    compare(&rig, &emulator, Sensor::Ouster(Box::new(ouster)), 4);
    assert_eq!(
        rig.status().identity.as_deref(),
        Some("OS-0-32-U1, serial number 992137000142 at 127.0.0.1")
    );
    assert_counted_once(&rig, &emulator);
    assert_eq!(page.with(|page| page.requests), 1);
}

#[test]
fn an_ouster_without_or_with_another_ones_metadata_is_refused() {
    let Some((packets, _)) = os0() else {
        return;
    };
    let folder = shared_data("ouster").unwrap();
    let other = folder.join("os1-128_fw2.3.json");
    let host = free_address();
    let _emulator = Emulator::to_udp(packets, host);
    let page = Emulator::on_tcp(Metadata::new(String::new()));
    page.with(|page| page.metadata = None);
    let refused = |more: &str| {
        let rig = Rig::start(&format!(
            "[devices.lidar]\nkind = \"ouster\"\nudp_listen = \"{host}\"\n{more}"
        ));
        let status = rig.wait("refused", |status| {
            matches!(status.trouble, Some(Trouble::Refused(_)))
        });
        assert_eq!(status.measurements, 0);
        status.trouble.unwrap().to_string()
    };
    assert_eq!(
        refused(&format!("metadata = \"{}\"", other.display())),
        "a packet of the sensor with serial number 992137000142, which is not that of the metadata"
    );
    assert_eq!(
        refused(&format!("host = \"{}\"", page.address)),
        "the sensor's metadata: \"HTTP/1.1 404 Not Found\"; of firmware without /api/v1/sensor/metadata, name a file in `metadata`"
    );
}

#[test]
fn packets_of_another_model_are_refused() {
    let Some(packets) = vlp16() else {
        return;
    };
    let host = free_address();
    let _emulator = Emulator::to_udp(packets, host);
    let rig = Rig::start(&format!(
        "[devices.lidar]\nkind = \"livox\"\nudp_listen = \"{host}\""
    ));
    let status = rig.wait("refused", |status| {
        matches!(status.trouble, Some(Trouble::Refused(_)))
    });
    assert_eq!(
        status.trouble.unwrap().to_string(),
        "a packet of a model, return mode or kind of data that is not known"
    );
}

#[test]
fn a_mid360_is_configured_to_send_here_and_its_room_is_round() {
    let host = free_address();
    let emulator = Emulator::to_udp(livox::Points::default(), host);
    let commands = Emulator::on_udp(Commands::default());
    let rig = Rig::start(&format!(
        "[devices.lidar]\nkind = \"livox\"\nudp_listen = \"{host}\"\nhost = \"{}\"",
        commands.address
    ));
    // A part of a frame.
    next_cloud(&rig);
    commands.with(|commands| {
        assert_eq!(commands.host.map(SocketAddr::from), Some(host));
        assert_eq!(commands.work_mode, Some(1));
    });
    for _ in 0..5 {
        let (cloud, _) = next_cloud(&rig);
        let misses = POINTS / 10;
        assert_eq!(
            cloud.points.len() as u64,
            FRAME * u64::from(POINTS - misses)
        );
        assert_eq!(u64::from(cloud.without_return), FRAME * u64::from(misses));
        let hits = (0..POINTS).filter(|point| point % 10 != 9);
        for (point, number) in cloud.points.iter().zip(hits) {
            let expected = livox::Points::point_mm(number).map(|mm| mm as f32 * 1e-3);
            let off = point
                .position_m
                .iter()
                .zip(expected)
                .map(|(a, b)| (a - b).abs());
            assert!(off.fold(0.0, f32::max) < 1e-5, "{point:?} {expected:?}");
            let after_s = number as f32 * 1.9e-3 / (POINTS - 1) as f32;
            assert!(
                (point.after_s - after_s).abs() < 1e-6,
                "{point:?} {after_s}"
            );
        }
    }
    emulator.with(|points| {
        let soon = points.sent() + 20;
        points.lost.extend([soon, soon + 1]);
        points.damaged.insert(soon + 5);
    });
    rig.wait("counted", |status| status.losses.len() == 2);
    for _ in 0..3 {
        next_cloud(&rig);
    }
    let losses: Vec<_> = rig.status().losses.into_iter().collect();
    let lost = losses
        .iter()
        .find(|(loss, _)| *loss == Loss::Decoder(DropReason::Lost));
    // At the end of a frame the sensor's numbers do not show it.
    assert!(
        lost.is_some_and(|(_, count)| (1..=2).contains(count)),
        "{losses:?}"
    );
    assert!(
        losses.contains(&(Loss::Decoder(DropReason::Checksum), 1)),
        "{losses:?}"
    );

    commands.with(|commands| commands.code = 0x21);
    emulator.power(false);
    let status = rig.wait("refused", |status| {
        matches!(status.trouble, Some(Trouble::Refused(_)))
    });
    let says = "the sensor's configuration: the sensor refuses key 0x0000 with code 33";
    assert_eq!(status.trouble.unwrap().to_string(), says);
}
