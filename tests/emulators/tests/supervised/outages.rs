//! Power cycles and pulled cables.

use std::fs;
use std::net::{Ipv4Addr, SocketAddr, TcpStream, UdpSocket};
use std::time::Duration;

use drivers::status::{Loss, State, Trouble};
use emulators::deltat::Deltat;
use emulators::dynamixel::XSeries;
use emulators::hokuyo::Hokuyo;
use emulators::imagenex852::Imagenex852;
use emulators::ldlrs::LdLrs;
use emulators::livox::Points;
use emulators::lms111::Lms111;
use emulators::mti::Mti;
use emulators::nmea::Nmea;
use emulators::packets::Metadata;
use emulators::ping1d::Ping1d;
use emulators::rplidar::Rplidar;
use emulators::ublox::Ublox;
use emulators::{Device, Emulator};
use rustix::net::{AddressFamily, SocketType};

use crate::lidars::free_address;
use crate::recorded::{os0, vlp16};
use crate::rig::{Rig, age, clock};

/// Older data is not passed on; to this comes the time from the first beam to the telegram.
const MAX_AGE: Duration = Duration::from_millis(200 + 250);

/// The device goes and comes in all ways; after each it is used within 2 s, and nothing old is passed.
#[track_caller]
fn survives<D: Device>(emulator: &Emulator<D>, config: &str) {
    let rig = Rig::start(&format!("[devices.device]\n{config}"));
    rig.wait_until_measuring();
    for cycle in 0..3 {
        emulator.power(false);
        let lost = rig.status().lost_connections;
        let status = rig.wait("lost", |status| status.lost_connections > lost);
        assert!(status.trouble.is_some(), "{cycle}");
        assert_ne!(status.state, State::Measuring);
        emulator.power(true);
        rig.assert_back();

        emulator.plug(false);
        let lost = rig.status().lost_connections;
        let status = rig.wait("lost", |status| status.lost_connections > lost);
        assert!(
            matches!(status.trouble, Some(Trouble::Silent(_))),
            "{status:?}"
        );
        emulator.plug(true);
        rig.assert_back();
        for reading in rig.drain() {
            assert!(age(&reading) < MAX_AGE, "{cycle}: {:?}", age(&reading));
        }
    }
    rig.wait_until_measuring();
    assert_eq!(rig.status().identity_changes, 0);
}

#[test]
fn an_lms111() {
    let emulator = Emulator::on_tcp(Lms111::default());
    let address = &emulator.address;
    survives(
        &emulator,
        &format!("kind = \"sick_cola\"\ntcp = \"{address}\"\nrate_hz = 25"),
    );
}

#[test]
fn an_ld_lrs() {
    let emulator = Emulator::on_tcp(LdLrs::default());
    survives(
        &emulator,
        &format!("kind = \"sick_ldlrs\"\ntcp = \"{}\"", emulator.address),
    );
}

#[test]
fn a_hokuyo() {
    let emulator = Emulator::on_tcp(Hokuyo::default());
    survives(
        &emulator,
        &format!("kind = \"hokuyo\"\ntcp = \"{}\"", emulator.address),
    );
}

#[test]
fn a_hokuyo_on_usb() {
    let emulator = Emulator::on_usb(Hokuyo::default());
    survives(
        &emulator,
        &format!("kind = \"hokuyo\"\nserial = \"{}\"", emulator.address),
    );
}

#[test]
fn an_mti() {
    let emulator = Emulator::on_serial(Mti::default());
    survives(
        &emulator,
        &format!("kind = \"xsens\"\nserial = \"{}\"", emulator.address),
    );
}

#[test]
fn an_rplidar() {
    let emulator = Emulator::on_usb(Rplidar::default());
    survives(
        &emulator,
        &format!("kind = \"rplidar\"\nserial = \"{}\"", emulator.address),
    );
}

#[test]
fn an_nmea_receiver() {
    let emulator = Emulator::on_serial(Nmea::default());
    survives(
        &emulator,
        &format!("kind = \"nmea\"\nserial = \"{}\"", emulator.address),
    );
}

#[test]
fn a_ublox() {
    let emulator = Emulator::on_usb(Ublox::default());
    survives(
        &emulator,
        &format!("kind = \"ublox\"\nserial = \"{}\"", emulator.address),
    );
}

#[test]
fn an_imagenex_852() {
    let emulator = Emulator::on_serial(Imagenex852::default());
    survives(
        &emulator,
        &format!("kind = \"imagenex852\"\nserial = \"{}\"", emulator.address),
    );
}

#[test]
fn a_ping1d() {
    let emulator = Emulator::on_udp(Ping1d::default());
    survives(
        &emulator,
        &format!("kind = \"ping1d\"\nudp = \"{}\"", emulator.address),
    );
}

#[test]
fn a_servo() {
    let emulator = Emulator::on_serial(XSeries::default());
    let config = format!(
        "kind = \"dynamixel\"\nserial = \"{}\"\nservo = \"x_series\"\nservo_id = 1\njoint = \"tilt\"",
        emulator.address
    );
    survives(&emulator, &config);
}

#[test]
fn a_deltat() {
    let free = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let host = free.local_addr().unwrap();
    drop(free);
    let emulator = Emulator::to_udp(Deltat::default(), host);
    survives(
        &emulator,
        &format!("kind = \"imagenex_deltat\"\nudp_listen = \"{host}\""),
    );
}

#[test]
fn a_vlp16() {
    let Some(packets) = vlp16() else {
        return;
    };
    let host = free_address();
    let emulator = Emulator::to_udp(packets, host);
    survives(
        &emulator,
        &format!("kind = \"velodyne\"\nudp_listen = \"{host}\""),
    );
}

#[test]
fn an_os0() {
    let Some((packets, metadata)) = os0() else {
        return;
    };
    let host = free_address();
    let emulator = Emulator::to_udp(packets, host);
    let page = Emulator::on_tcp(Metadata::new(fs::read_to_string(metadata).unwrap()));
    survives(
        &emulator,
        &format!(
            "kind = \"ouster\"\nudp_listen = \"{host}\"\nhost = \"{}\"",
            page.address
        ),
    );
}

#[test]
fn a_mid360() {
    let host = free_address();
    let emulator = Emulator::to_udp(Points::default(), host);
    survives(
        &emulator,
        &format!("kind = \"livox\"\nudp_listen = \"{host}\""),
    );
}

/// The connection lasts: what the cable held back comes late, and is not used.
#[test]
fn data_that_was_held_back_is_stale() {
    let emulator = Emulator::on_tcp(Lms111::default());
    let address = &emulator.address;
    let rig = Rig::start(&format!(
        "[devices.laser]\nkind = \"sick_cola\"\ntcp = \"{address}\"\n"
    ));
    rig.wait("rated", |status| status.rate_hz > 0.0);
    emulator.plug(false);
    std::thread::sleep(Duration::from_millis(700));
    rig.drain();
    emulator.plug(true);
    let status = rig.wait("stale", |status| status.lost(Loss::Stale) > 0);
    assert_eq!(status.lost_connections, 0);
    for _ in 0..50 {
        let reading = rig.next();
        assert!(age(&reading) < MAX_AGE, "{:?}", age(&reading));
    }
    // 500 of 700 ms at 50 Hz, as far as the device held them back.
    let stale = rig.status().lost(Loss::Stale);
    assert!((10..=40).contains(&stale), "{stale}");
    assert_eq!(rig.status().clock.unwrap().resets, 0);
}

#[test]
fn a_device_that_is_not_there_at_the_start_is_waited_for() {
    let emulator = Emulator::on_usb(Mti::default());
    emulator.power(false);
    std::thread::sleep(Duration::from_millis(50));
    let serial = &emulator.address;
    let rig = Rig::start(&format!(
        "[devices.imu]\nkind = \"xsens\"\nserial = \"{serial}\"\n"
    ));
    let status = rig.wait("in trouble", |status| status.trouble.is_some());
    let Some(Trouble::Io(why)) = &status.trouble else {
        panic!("{status:?}");
    };
    assert!(why.contains("No such file"), "{why}");
    assert_eq!(status.lost_connections, 0);
    emulator.power(true);
    rig.assert_back();
}

/// A host behind a pulled cable: the system's own time-out is minutes.
#[test]
fn a_connection_is_given_up_within_a_second() {
    let socket = rustix::net::socket(AddressFamily::INET, SocketType::STREAM, None).unwrap();
    let any: SocketAddr = (Ipv4Addr::LOCALHOST, 0).into();
    rustix::net::bind(&socket, &any).unwrap();
    rustix::net::listen(&socket, 0).unwrap();
    let address = rustix::net::getsockname(&socket).unwrap();
    let address = SocketAddr::try_from(address).unwrap();
    // Its queue is full: further requests for a connection are dropped.
    let _queued = TcpStream::connect(address).unwrap();
    let started = clock();
    let rig = Rig::start(&format!(
        "[devices.laser]\nkind = \"hokuyo\"\ntcp = \"{address}\"\n"
    ));
    let status = rig.wait("in trouble", |status| status.trouble.is_some());
    assert_eq!(status.trouble, Some(Trouble::NoConnection));
    let took = clock().since(started);
    assert!((0.7..2.0).contains(&took.as_secs_f64()), "{took:?}");
}
