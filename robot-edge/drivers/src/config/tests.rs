use super::*;

fn read(text: &str) -> Result<BTreeMap<String, DeviceConfig>, Vec<String>> {
    let mut file: BTreeMap<String, toml::Table> = toml::from_str(text).unwrap();
    let table = file.remove("devices").unwrap();
    let devices = table.clone().try_into().unwrap();
    let given = |name: &str| table[name].as_table().unwrap().keys().map(String::as_str);
    let problems = DeviceConfig::check_all(&devices, given);
    if problems.is_empty() {
        return Ok(devices);
    }
    Err(problems.iter().map(ToString::to_string).collect())
}

/// The settings of a device of this kind, or the only problem.
fn device(kind: &str, more: &str) -> Result<DeviceConfig, String> {
    let devices = read(&format!("[devices.d]\nkind = \"{kind}\"\n{more}"));
    devices
        .map(|mut devices| devices.remove("d").unwrap())
        .map_err(|problems| problems.join("\n"))
}

#[test]
fn a_laser_with_a_sector_and_masks() {
    let laser = device(
        "sick_cola",
        "tcp = \"192.168.0.1:2111\"\nsector_from_deg = -60\nsector_to_deg = 60.0\n\
         masks_deg = \"-60..-55, 10.5..12\"\nrate_hz = 25\nresolution_deg = 0.25\ncoding = \"b\"",
    )
    .unwrap();
    assert_eq!(laser.kind, Kind::SickCola);
    assert_eq!(
        laser.address(),
        Ok(Address::Tcp("192.168.0.1:2111".to_owned()))
    );
    assert_eq!(
        (laser.rate_hz, laser.coding),
        (Some(25.0), Some(ColaCoding::B))
    );
    let beams = laser.beams().unwrap();
    let range = |from: f64, to: f64| AngleRange {
        from_rad: from.to_radians(),
        to_rad: to.to_radians(),
    };
    assert_eq!(beams.sector, Some(range(-60.0, 60.0)));
    assert_eq!(beams.masks, [range(-60.0, -55.0), range(10.5, 12.0)]);
    assert_eq!(laser.range_limits_m(0.5, 20.0).as_slice(), [0.5, 20.0]);
}

#[test]
fn a_sweep_is_whole_or_absent() {
    let servo = "serial = \"/dev/servo\"\nservo = \"mx28\"\nservo_id = 1\njoint = \"tilt\"\n";
    let sweep = |more: &str| device("dynamixel", &format!("{servo}{more}"));
    let whole = "sweep_from_deg = 0\nsweep_to_deg = 19\nsweep_degps = 20";
    assert_eq!(sweep(whole).unwrap().sweep_to_deg, Some(19.0));
    for (more, problem) in [
        (
            "sweep_from_deg = 0\nsweep_to_deg = 19",
            "sweep_degps`: missing",
        ),
        ("sweep_degps = 20", "sweep_from_deg`: missing"),
        (
            "sweep_from_deg = 19\nsweep_to_deg = 19\nsweep_degps = 20",
            "it must be at least 5 more than `sweep_from_deg`",
        ),
        (
            "sweep_from_deg = 0\nsweep_to_deg = 190\nsweep_degps = 20",
            "190 is not allowed; allowed: -150 to 150",
        ),
    ] {
        let found = sweep(more).unwrap_err();
        assert!(found.contains(problem), "{found}");
    }
}

#[test]
fn addresses_of_all_kinds() {
    let serial = |path: &str, baud| Address::Serial {
        path: path.into(),
        baud,
    };
    for (kind, more, expected) in [
        (
            "xsens",
            "serial = \"/dev/imu\"",
            serial("/dev/imu", 115_200),
        ),
        ("nmea", "serial = \"/dev/gps\"", serial("/dev/gps", 4800)),
        (
            "nmea",
            "serial = \"/dev/gps\"\nbaud = 38400",
            serial("/dev/gps", 38_400),
        ),
        (
            "nmea",
            "tcp = \"gps.local:10110\"",
            Address::Tcp("gps.local:10110".to_owned()),
        ),
        (
            "ping1d",
            "udp = \"10.0.0.2:9090\"",
            Address::Udp("10.0.0.2:9090".to_owned()),
        ),
        (
            "imagenex_deltat",
            "udp_listen = \"0.0.0.0:4040\"",
            Address::UdpListen(([0, 0, 0, 0], 4040).into()),
        ),
    ] {
        assert_eq!(
            device(kind, more).unwrap().address(),
            Ok(expected),
            "{more}"
        );
    }
}

#[test]
fn problems_say_what_and_where_and_what_to_do() {
    for (kind, more, expected) in [
        (
            "sick_cola",
            "",
            "`devices.d`: set exactly one of the keys that say where it is: tcp",
        ),
        (
            "nmea",
            "tcp = \"a:1\"\nserial = \"/dev/a\"",
            "`devices.d`: set exactly one of the keys that say where it is: tcp or udp_listen or serial",
        ),
        (
            "sick_cola",
            "serial = \"/dev/a\"",
            "`devices.d.serial`: such a device is reached by tcp",
        ),
        (
            "sick_cola",
            "tcp = \"192.168.0.1\"",
            "`devices.d.tcp`: \"192.168.0.1\" is no host and port, as 192.168.0.1:2111 is",
        ),
        (
            "imagenex_deltat",
            "udp_listen = \"4040\"",
            "`devices.d.udp_listen`: \"4040\" is no address and port, as 0.0.0.0:4040 is",
        ),
        (
            "hokuyo",
            "tcp = \"a:1\"\nbaud = 9600",
            "`devices.d.baud`: only a serial port has it: remove it",
        ),
        (
            "hokuyo",
            "serial = \"/dev/a\"\nbaud = 5",
            "`devices.d.serial`: a port has a name, and `baud` from 300 to 12000000",
        ),
        (
            "xsens",
            "serial = \"/dev/a\"\nresolution_deg = 1",
            "`devices.d.resolution_deg`: this kind of device has no such key",
        ),
        (
            "hokuyo",
            "tcp = \"a:1\"\nsector_from_deg = 1",
            "`devices.d.sector_from_deg`: a sector has both, `sector_from_deg` and `sector_to_deg`",
        ),
        (
            "hokuyo",
            "tcp = \"a:1\"\nmasks_deg = \"1..2, 3-4\"",
            "`devices.d.masks_deg`: \"3-4\" is no range of angles, as -135..-120 is; more are separated by commas",
        ),
        (
            "ping1d",
            "serial = \"/dev/a\"\nsound_speed_mps = 340",
            "`devices.d.sound_speed_mps`: 340 is not allowed; allowed: 1300 to 1700",
        ),
        (
            "hokuyo",
            "tcp = \"a:1\"\nrange_min_m = 5\nrange_max_m = 4",
            "`devices.d.range_max_m`: 4 is not allowed: it must be more than `range_min_m` (5)",
        ),
        (
            "ouster",
            "udp_listen = \"0.0.0.0:7502\"",
            "`devices.d.host`: missing: such a device needs it",
        ),
        (
            "ouster",
            "udp_listen = \"0.0.0.0:7502\"\nhost = \"os-1\"\nmetadata = \"os-1.json\"",
            "`devices.d.metadata`: the metadata are of this file or of `host`: remove one",
        ),
        (
            "livox",
            "udp_listen = \"0.0.0.0:56301\"\nhost = \"192.168.1.1:0\"",
            "`devices.d.host`: this is no name or address of a host, as 192.168.1.201 is, with a port or without",
        ),
        (
            "velodyne",
            "udp_listen = \"0.0.0.0:2368\"\nhost = \"a\"",
            "`devices.d.host`: this kind of device has no such key",
        ),
        (
            "velodyne",
            "udp_listen = \"0.0.0.0:2368\"\nmasks_deg = \"1..2\"",
            "`devices.d.masks_deg`: this kind of device has no such key",
        ),
        (
            "velodyne",
            "tcp = \"a:2368\"",
            "`devices.d.tcp`: such a device is reached by udp_listen",
        ),
        (
            "ntrip",
            "tcp = \"a:1\"",
            "`devices.d.mountpoint`: missing: such a device needs it",
        ),
        (
            "nmea",
            "serial = \"/dev/a\"\ncorrections = \"base\"",
            "`devices.d.corrections`: there is no device of kind \"ntrip\" named \"base\"; there is: ",
        ),
    ] {
        assert_eq!(
            device(kind, more),
            Err(expected.to_owned()),
            "{kind}: {more}"
        );
    }
}

#[test]
fn a_device_is_of_a_kind() {
    assert_eq!(
        read("[devices.d]\ntcp = \"a:1\""),
        Err(vec!["`devices.d.kind`: missing: what is it?".to_owned()])
    );
}

#[test]
fn one_caster_has_one_receiver() {
    let text = "[devices.base]\nkind = \"ntrip\"\ntcp = \"caster:2101\"\nmountpoint = \"M\"\n\
                [devices.a]\nkind = \"nmea\"\nserial = \"/dev/a\"\ncorrections = \"base\"\n";
    assert_eq!(read(text).unwrap().len(), 2);
    let second = "[devices.b]\nkind = \"nmea\"\nserial = \"/dev/b\"\ncorrections = \"base\"\n";
    let problems = read(&format!("{text}{second}")).unwrap_err();
    let expected = |name| {
        format!(
            "`devices.{name}.corrections`: another device has the corrections of \"base\", too: configure a second one"
        )
    };
    assert_eq!(problems, [expected("a"), expected("b")]);
}

#[test]
fn kinds_have_the_names_of_the_configuration() {
    for kind in Kind::ALL {
        let value = toml::Value::from(kind.name());
        assert_eq!(value.try_into::<Kind>(), Ok(kind));
    }
}
