use clap::Parser as _;

use super::*;
use crate::cli::{Cli, Command};

/// Runs `robot-edge setup OPTIONS --out FILE` with these answers, or without a terminal; what it printed, or its error, and
/// what it wrote.
fn run(options: &str, answers: Option<&str>, is_there: bool) -> (Result<String, String>, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.toml");
    if is_there {
        fs::write(&path, "old").unwrap();
    }
    let words = ["robot-edge", "setup", "--out", path.to_str().unwrap()];
    let words = words.into_iter().chain(options.split_whitespace());
    let Command::Setup(command) = Cli::try_parse_from(words).unwrap().command else {
        panic!("{options}");
    };
    let mut answers = answers.map(str::as_bytes);
    let input = answers.as_mut().map(|answers| answers as &mut dyn BufRead);
    let mut out = Vec::new();
    let place = format!("{}/", folder.path().display());
    let printed = match setup(&command, input, &mut out) {
        Ok(exit) => {
            assert_eq!(exit, Exit::Done);
            Ok(String::from_utf8(out).unwrap().replace(&place, ""))
        }
        Err(error) => {
            assert_eq!(Exit::of(error.as_ref()), Exit::Usage, "{options}: {error}");
            Err(error.to_string().replace(&place, ""))
        }
    };
    (printed, fs::read_to_string(&path).unwrap_or_default())
}

/// Without the comment at its top.
fn settings(text: &str) -> Table {
    assert!(
        text.starts_with("# Written by `robot-edge setup`."),
        "{text}"
    );
    text.parse().unwrap()
}

const LASER: &str = "--device laser=sick_cola,tcp=192.168.0.1:2111";

#[test]
fn options_become_a_configuration_without_a_question() {
    for (options, written) in [
        (
            format!("--vehicle introbot --listen quic/0.0.0.0:7447 {LASER}"),
            "preset = 'introbot'\n\
             devices.laser = { kind = 'sick_cola', tcp = '192.168.0.1:2111' }\n\
             link = { listen = 'quic/0.0.0.0:7447', keys = '/etc/foreshore/keys' }",
        ),
        (
            // Another sensor, numbers as text, a list with commas, a router.
            "--vehicle generic2d --size 1.2,0.8,0.6 --connect tls/router.example:7447 --keys k --mount front=0.6,0,0.3,0,0,180 \
             --mount laser=0.1,0,0.2 --device front=hokuyo,serial=/dev/foreshore/hokuyo,identity=123,baud=19200,\
             masks_deg=-135..-120,95..100 \
             --device caster=ntrip,tcp=caster.example:2101,mountpoint=M,user=u,password=1234"
                .to_owned(),
            "preset = 'generic2d'\n\
             vehicle = { length_m = 1.2, width_m = 0.8, height_m = 0.6 }\n\
             [sensors]\n\
             laser.mount = { x_m = 0.1, y_m = 0.0, z_m = 0.2 }\n\
             front.kind = 'laser_scan'\n\
             front.mount = { x_m = 0.6, y_m = 0.0, z_m = 0.3, roll_deg = 0.0, pitch_deg = 0.0, yaw_deg = 180.0 }\n\
             [devices.front]\n\
             kind = 'hokuyo'\n\
             serial = '/dev/foreshore/hokuyo'\n\
             identity = '123'\n\
             baud = 19200\n\
             masks_deg = '-135..-120,95..100'\n\
             [devices.caster]\n\
             kind = 'ntrip'\n\
             tcp = 'caster.example:2101'\n\
             mountpoint = 'M'\n\
             user = 'u'\n\
             password = '1234'\n\
             [link]\n\
             connect = 'tls/router.example:7447'\n\
             keys = 'k'",
        ),
        (
            // An attitude sensor needs no place, a listener for this machine no keys.
            "--vehicle pioneer --listen tcp/127.0.0.1:7447 --device ahrs=xsens,serial=/dev/foreshore/xsens".to_owned(),
            "preset = 'pioneer'\n\
             sensors.ahrs.kind = 'imu'\n\
             devices.ahrs = { kind = 'xsens', serial = '/dev/foreshore/xsens' }\n\
             link.listen = 'tcp/127.0.0.1:7447'",
        ),
    ] {
        let (printed, text) = run(&options, None, false);
        printed.unwrap();
        assert_eq!(settings(&text), written.parse().unwrap(), "{options}");
    }
}

#[test]
fn the_next_commands_are_named() {
    let (printed, _) = run(
        &format!("--vehicle introbot --listen quic/[::]:7447 {LASER}"),
        None,
        false,
    );
    assert_eq!(
        printed.unwrap(),
        "v.toml: written; `robot-edge check v.toml` says what it means\n\
         sensor ahrs: no device has this name\n\
         Install its keys:  robot-edge install-keys FOLDER /etc/foreshore/keys\n\
         Start it:          robot-edge run --vehicle v.toml\n\
         FOLDER is vehicles/NAME in the folder that `robot-edge keys` makes.\n"
    );
    let mut out = Vec::new();
    let config = config::load("pioneer", &[]).unwrap();
    write_next_steps(Path::new(SERVICE_CONFIG), &Table::new(), &config, &mut out).unwrap();
    let start = "Start the service: systemctl enable --now --no-block foreshore-nft robot-edge\n";
    assert!(
        out.ends_with(start.as_bytes()),
        "{}",
        String::from_utf8_lossy(&out)
    );
}

#[test]
fn what_is_missing_or_wrong_is_named_and_nothing_is_written() {
    const LISTEN: &str = "--listen quic/[::]:7447";
    for (options, says) in [
        (String::new(), "--vehicle is missing"),
        (
            "--vehicle pioneer".to_owned(),
            "--listen or --connect is missing",
        ),
        (format!("--vehicle generic2d {LISTEN}"), "--size is missing"),
        (
            format!("--vehicle pioneer {LISTEN} --device rear=rplidar,serial=/dev/ttyUSB0"),
            "--mount rear=X,Y,Z is missing",
        ),
        (
            format!("--vehicle pioneer {LISTEN} --device laser=sick,tcp=a:1"),
            "`devices.laser.kind`: expected one of \"sick_cola\"",
        ),
        (
            format!("--vehicle pioneer {LISTEN} --device laser=sick_cola,serial=/dev/ttyUSB0"),
            "`devices.laser.serial`: such a device is reached by tcp",
        ),
        (
            format!("--vehicle pioneer {LISTEN} --device laser=sick_cola,tpc=a:1"),
            "`devices.laser.tpc`: unknown key",
        ),
        (
            format!("--vehicle pioneer {LISTEN} --device laser=xsens,serial=/dev/ttyUSB0"),
            "of kind imu, and the sensor laser of pioneer is of kind laser_scan: give the device another name",
        ),
        (
            format!("--vehicle pioneer {LISTEN} {LASER} {LASER}"),
            "two devices of the name laser",
        ),
        (
            format!("--vehicle pioneer {LISTEN} --mount lidar=0,0,0"),
            "`sensors.lidar`: the vehicle has no sensor of this name; it has: laser",
        ),
        (
            "--vehicle pioneer --listen tcp/0.0.0.0:7447".to_owned(),
            "with --keys it is quic/HOST:PORT",
        ),
    ] {
        let (printed, text) = run(&options, None, false);
        let error = printed.unwrap_err();
        assert!(error.contains(says), "{options}: {error}");
        assert_eq!(text, "", "{options}");
    }
}

#[test]
fn a_file_is_overwritten_only_by_force() {
    let options = "--vehicle pioneer --listen quic/[::]:7447";
    let (printed, text) = run(options, None, true);
    assert_eq!(
        printed,
        Err("v.toml: is there already; --force overwrites it".to_owned())
    );
    assert_eq!(text, "old");
    let (printed, text) = run(&format!("{options} --force"), None, true);
    printed.unwrap();
    assert_eq!(settings(&text)["preset"].as_str(), Some("pioneer"));
}

#[test]
fn a_dialog_asks_until_the_answers_are_right() {
    let answers = "robot\nintrobot\n1.6,0.9\n1.6,0.9,0.7\n\
                   laser\nsick_cola\n\nserial=/dev/ttyUSB0\ntcp=192.168.0.1:2111\n\
                   hokuyo\nlaser\nrear\ntcp=192.168.0.10:10940\n\n\
                   -0.5,0,0.3,0,0,180\ntcp/0.0.0.0:7447\n\n\n";
    let (printed, text) = run("", Some(answers), false);
    let printed = printed.unwrap();
    for says in [
        "introbot          Introbot, four wheels",
        "there is no vehicle `robot`",
        "as 1.2,0.8,0.6; empty: as the preset: a size is three numbers",
        "there is: sick_cola, sick_ldlrs, hokuyo",
        "Its name [laser]: set exactly one of the keys that say where it is: tcp\n",
        "`devices.laser.serial`: such a device is reached by tcp",
        "Its name [hokuyo]: laser is taken",
        "Listen for consoles at [quic/[::]:7447]: ",
        "Folder of its keys [/etc/foreshore/keys]: v.toml: written",
    ] {
        assert!(printed.contains(says), "{says}: {printed}");
    }
    let written = "preset = 'introbot'\n\
                   vehicle = { length_m = 1.6, width_m = 0.9, height_m = 0.7 }\n\
                   devices.laser = { kind = 'sick_cola', tcp = '192.168.0.1:2111' }\n\
                   devices.rear = { kind = 'hokuyo', tcp = '192.168.0.10:10940' }\n\
                   link = { listen = 'quic/[::]:7447', keys = '/etc/foreshore/keys' }\n\
                   [sensors.rear]\n\
                   kind = 'laser_scan'\n\
                   mount = { x_m = -0.5, y_m = 0.0, z_m = 0.3, roll_deg = 0.0, pitch_deg = 0.0, yaw_deg = 180.0 }";
    assert_eq!(settings(&text), written.parse().unwrap());
}

#[test]
fn an_input_that_ends_writes_nothing() {
    let (printed, text) = run("--vehicle introbot", Some("\n"), false);
    assert!(
        printed
            .unwrap_err()
            .contains("the input ended before the last question")
    );
    assert_eq!(text, "");
}
