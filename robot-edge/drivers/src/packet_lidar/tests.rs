use super::*;

fn lidar(text: &str) -> Result<PacketLidar, (&'static str, String)> {
    PacketLidar::new(&toml::from_str(text).unwrap())
}

/// A Mid-360's packet with one point.
fn livox_packet(time_ns: u64, number: u16) -> Vec<u8> {
    let mut packet = vec![0; 50];
    packet[1] = 50;
    packet[5] = 1;
    packet[7..9].copy_from_slice(&number.to_le_bytes());
    packet[10] = 1;
    packet[28..36].copy_from_slice(&time_ns.to_le_bytes());
    packet[37] = 8;
    packet
}

/// What a connection's datagrams mean.
fn events(lidar: &mut PacketLidar, datagrams: &[Vec<u8>]) -> (Vec<Event>, Dropped) {
    let mut decoder = lidar.connect();
    let mut events = Vec::new();
    for datagram in datagrams {
        decoder.push(datagram);
        while let Some(message) = decoder.next_message() {
            lidar.take(message, None, &mut events);
        }
    }
    (events, decoder.dropped().clone())
}

#[test]
fn a_revolution_has_the_time_of_the_packet_that_completed_it_and_its_age() {
    let mut livox = lidar("kind = 'livox'\nudp_listen = '0.0.0.0:56301'").unwrap();
    let packets = [(1_020, 0), (1_050, 1), (1_110, 2), (1_150, 4)];
    let packets = packets.map(|(ms, number)| livox_packet(ms * 1_000_000, number));
    let (events, dropped) = events(&mut livox, &packets);
    let [Event::Sample(sample)] = &events[..] else {
        panic!("{events:?}");
    };
    assert_eq!(
        sample.sent,
        Some(DeviceTime {
            nanos: 1_110_000_000,
            period_ns: i64::MAX
        })
    );
    assert!((sample.age.as_secs_f64() - 0.09).abs() < 1e-9);
    let MeasurementData::Cloud(cloud) = &sample.data else {
        panic!("{sample:?}");
    };
    assert_eq!(cloud.points.len(), 2);
    assert!((cloud.points[0].position_m[0] - 2.048).abs() < 1e-6);
    assert_eq!(dropped.iter().collect::<Vec<_>>(), [(DropReason::Lost, 1)]);
}

#[test]
fn a_clock_that_is_set_gives_no_wrong_age() {
    let mut livox = lidar("kind = 'livox'\nudp_listen = '0.0.0.0:56301'").unwrap();
    for after_ms in [50, 900_000] {
        let packets = [(500_020, 0), (500_050, 1), (after_ms, 2)];
        let packets = packets.map(|(ms, number)| livox_packet(ms * 1_000_000, number));
        let (events, _) = events(&mut livox, &packets);
        let [Event::Sample(sample)] = &events[..] else {
            panic!("{events:?}");
        };
        assert!(
            (sample.age.as_secs_f64() - 0.03).abs() < 1e-6,
            "{:?}",
            sample.age
        );
    }
}

#[test]
fn another_sensor_is_refused_and_a_damaged_packet_counted() {
    let mut livox = lidar("kind = 'livox'\nudp_listen = '0.0.0.0:56301'").unwrap();
    let good = livox_packet(0, 0);
    let mut damaged = good.clone();
    damaged[24] = 1;
    for (bad, reason, says) in [
        (
            vec![0; 10],
            DropReason::Length,
            "a packet of 10 bytes, where the sensor sends 36",
        ),
        (
            damaged,
            DropReason::Checksum,
            "a packet with a wrong checksum",
        ),
        (
            vec![9; 50],
            DropReason::UnknownKind,
            "a packet of a model, return mode or kind of data that is not known",
        ),
    ] {
        let (refused, dropped) = events(&mut livox, std::slice::from_ref(&bad));
        assert_eq!(refused, [Event::Refused(says.to_owned())]);
        assert_eq!(dropped.count(reason), 1);
        let (counted, dropped) = events(&mut livox, &[good.clone(), bad]);
        assert_eq!((counted, dropped.count(reason)), (vec![], 1));
    }
}

#[test]
fn files_that_cannot_be_used_are_named_with_their_key() {
    for (text, key, says) in [
        (
            "kind = 'ouster'\nmetadata = '/nowhere/a.json'",
            "metadata",
            "/nowhere/a.json: No such file",
        ),
        (
            "kind = 'ouster'\nmetadata = '/dev/null'",
            "metadata",
            "/dev/null: the metadata is no JSON",
        ),
        (
            "kind = 'velodyne'\ncalibration = '/dev/null'",
            "calibration",
            "/dev/null: it has 0 lasers",
        ),
    ] {
        let (found, why) = lidar(text).map(drop).unwrap_err();
        assert_eq!(found, key);
        assert!(why.contains(says), "{why}");
    }
}
