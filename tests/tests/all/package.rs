//! The Debian package, installed into a fresh Debian. It needs root, cargo-deb, mmdebstrap and Debian's packages; that for
//! arm64 cargo-zigbuild, zig, the target's standard library and qemu-user.

use std::fs::{self, Permissions};
use std::os::unix::fs::{PermissionsExt as _, symlink};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use emulators::Emulator;
use emulators::lms111::Lms111;
use emulators::mti::Mti;
use serde_json::Value;
use tempfile::tempdir;

use crate::fleet::quic;
use crate::link::desktop::Screen;
use crate::link::window::{Colors, Pixels};
use crate::processes::{Running, command, free_port, rooms};
use crate::skip::skip;

const RELEASE: &str = "bookworm";
/// A Debian in a folder.
struct Debian(PathBuf);

impl Debian {
    /// Runs a shell command in it; its output, with errors.
    fn try_run(&self, command: &str) -> (bool, String) {
        let script = format!("exec 2>&1; {command}");
        let output = Command::new("chroot")
            .arg(&self.0)
            .args(["sh", "-ec", &script])
            .env("DEBIAN_FRONTEND", "noninteractive")
            .env("LC_ALL", "C.UTF-8")
            .env("PATH", "/usr/sbin:/usr/bin:/sbin:/bin")
            .stdin(Stdio::null())
            .output()
            .unwrap();
        let printed = String::from_utf8_lossy(&output.stdout)
            .trim_end()
            .to_owned();
        (output.status.success(), printed)
    }

    fn run(&self, command: &str) -> String {
        let (is_ok, printed) = self.try_run(command);
        assert!(is_ok, "{command}: {printed}");
        printed
    }

    /// Shows a folder of this machine at the same place inside.
    fn mount(&self, folder: &str) -> Mount {
        let inside = self.path(folder);
        let mounted = Command::new("mount")
            .arg("--bind")
            .arg(folder)
            .arg(&inside)
            .status();
        assert!(mounted.unwrap().success(), "{folder}");
        Mount(inside)
    }

    fn path(&self, inside: &str) -> PathBuf {
        self.0.join(inside.trim_start_matches('/'))
    }
}

struct Mount(PathBuf);

impl Drop for Mount {
    fn drop(&mut self) {
        let unmounted = Command::new("umount").arg(&self.0).status();
        assert!(
            unmounted.is_ok_and(|status| status.success()),
            "{}",
            self.0.display()
        );
    }
}

/// The package for this machine, or for another target, built in the folder of this test's own program.
fn package(target_name: Option<&str>) -> PathBuf {
    let program = std::env::current_exe().unwrap();
    let target = program.ancestors().nth(3).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robot-edge/deploy/package");
    let output = Command::new(script)
        .args(target_name)
        .env("CARGO_TARGET_DIR", target)
        .stderr(Stdio::inherit())
        .output()
        .unwrap();
    assert!(output.status.success(), "{output:?}");
    let printed = String::from_utf8(output.stdout).unwrap();
    PathBuf::from(printed.lines().last().unwrap())
}

/// Whether all of these programs are installed; else the test says that it is skipped.
fn has_all(programs_and_remedies: &[(&str, &str)]) -> bool {
    programs_and_remedies.iter().all(|(program, remedy)| {
        let asked = Command::new(program).arg("--version").output();
        let has = asked.is_ok_and(|output| output.status.success());
        if !has {
            skip(&format!("there is no {program}"), remedy);
        }
        has
    })
}

const CARGO_DEB: (&str, &str) = ("cargo-deb", "cargo install cargo-deb");
const MMDEBSTRAP: (&str, &str) = ("mmdebstrap", "package mmdebstrap");

#[test]
#[ignore = "builds for ten minutes and installs a Debian"]
fn the_package_installs_on_a_fresh_debian() {
    if !has_all(&[CARGO_DEB, MMDEBSTRAP]) {
        return;
    }
    let folder = tempdir().unwrap();
    let debian = Debian(folder.path().join("root"));
    let made = Command::new("mmdebstrap")
        .args([
            "--quiet",
            "--variant=minbase",
            "--include=systemd,man-db",
            RELEASE,
        ])
        .arg(&debian.0)
        .status()
        .unwrap();
    assert!(
        made.success(),
        "mmdebstrap: it needs root and Debian's packages"
    );
    fs::copy(package(None), debian.path("/tmp/robot-edge.deb")).unwrap();
    debian.run("apt-get update && apt-get install -y /tmp/robot-edge.deb");

    assert_eq!(
        debian.run("robot-edge --version"),
        format!("robot-edge {}", env!("CARGO_PKG_VERSION"))
    );
    assert_eq!(debian.run("id -nG foreshore"), "foreshore dialout");
    let units = "robot-edge.service foreshore-nft.service";
    assert_eq!(debian.run(&format!("systemd-analyze verify {units}")), "");
    let (_, enabled) = debian.try_run(&format!("systemctl is-enabled {units}"));
    assert_eq!(enabled, "disabled\ndisabled");

    // The vehicle's configuration and keys, as docs/deployment.md says.
    let (laser, ahrs) = (
        Emulator::on_tcp(Lms111::default()),
        Emulator::on_serial(Mti::default()),
    );
    let endpoint = quic(free_port());
    let setup = format!(
        "robot-edge setup --vehicle generic2d --size 0.6,0.5,0.4 --listen {endpoint} --device laser=sick_cola,tcp={} \
         --device ahrs=xsens,serial=/dev/foreshore/xsens",
        laser.address
    );
    let printed = debian.run(&setup);
    assert!(
        printed.contains("/etc/foreshore/vehicle.toml: written"),
        "{printed}"
    );
    let (is_ok, printed) = debian.try_run(&setup);
    assert!(!is_ok && printed.contains("--force"), "{printed}");
    debian.run(
        "cd /root; robot-edge keys fleet --robot scout --host localhost --operator anna; \
         robot-edge install-keys fleet/vehicles/scout /etc/foreshore/keys",
    );
    for config in ["vehicle.toml", "example.toml"] {
        let command = format!("runuser -u foreshore -- robot-edge check /etc/foreshore/{config}");
        let printed = debian.run(&command);
        assert!(printed.starts_with("ok\nvehicle: "), "{config}: {printed}");
    }
    for (path, owner) in [
        ("/etc/foreshore", "root:foreshore 750"),
        ("/etc/foreshore/foreshore.nft", "root:root 644"),
        ("/etc/foreshore/robot-edge.env", "root:root 644"),
        ("/etc/foreshore/keys", "root:foreshore 750"),
        ("/usr/bin/robot-edge", "root:root 755"),
        (
            "/usr/lib/systemd/system/robot-edge.service",
            "root:root 644",
        ),
        ("/usr/lib/sysusers.d/robot-edge.conf", "root:root 644"),
        ("/usr/lib/udev/rules.d/70-foreshore.rules", "root:root 644"),
        ("/usr/share/doc/robot-edge/LICENSE-MIT", "root:root 644"),
        (
            "/usr/share/fish/vendor_completions.d/robot-edge.fish",
            "root:root 644",
        ),
        (
            "/usr/share/zsh/vendor-completions/_robot-edge",
            "root:root 644",
        ),
    ] {
        assert_eq!(
            debian.run(&format!("stat -c '%U:%G %a' {path}")),
            owner,
            "{path}"
        );
    }

    // A page for the program and each command, and the service's.
    let help = debian.run("robot-edge --help");
    let commands = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let commands = commands.take_while(|line| !line.is_empty());
    let commands: Vec<&str> = commands
        .map(|line| line.split_whitespace().next().unwrap())
        .collect();
    assert!(
        commands.contains(&"setup") && commands.len() > 10,
        "{commands:?}"
    );
    for command in commands.iter().filter(|command| **command != "help") {
        debian.run(&format!("man -w robot-edge-{command}"));
    }
    let page = debian.run("man robot-edge-setup");
    assert!(
        page.contains("--device") && page.contains("NAME=KIND,KEY=VALUE"),
        "{page}"
    );
    let completed = debian.run(
        "bash -c '. /usr/share/bash-completion/completions/robot-edge; COMP_WORDS=(robot-edge se); COMP_CWORD=1; \
         _robot__edge robot-edge se robot-edge; echo ${COMPREPLY[@]}'",
    );
    assert_eq!(completed, "setup");

    // It runs as the service does, and a console elsewhere shows its map.
    let _terminals = debian.mount("/dev/pts");
    fs::create_dir(debian.path("/dev/foreshore")).unwrap();
    let terminal = fs::canonicalize(&ahrs.address).unwrap();
    fs::set_permissions(&terminal, Permissions::from_mode(0o666)).unwrap();
    symlink(terminal, debian.path("/dev/foreshore/xsens")).unwrap();
    debian.run("echo '[localization]\nsource = \"static\"' >> /etc/foreshore/vehicle.toml");
    let printed = debian
        .run("runuser -u foreshore -- robot-edge check /etc/foreshore/vehicle.toml --connect");
    for identity in ["LMS10x", "MTi"] {
        assert!(printed.contains(identity), "{printed}");
    }
    let mut edge = Command::new("chroot");
    edge.args(["--userspec=foreshore", "--groups=dialout"])
        .arg(&debian.0);
    edge.args(
        "robot-edge run --vehicle /etc/foreshore/vehicle.toml --keys /etc/foreshore/keys"
            .split(' '),
    );
    let _edge = Running::start(&mut edge, "edge");
    let picture = folder.path().join("console.png");
    if let Some(screen) = Screen::open() {
        let mut console = command(&format!(
            "operator-console --connect {endpoint} --keys {} --screenshot {} --after 15",
            debian.path("/root/fleet/people/anna").display(),
            picture.display()
        ));
        screen.show(&mut console);
        Running::start(&mut console, "console").ends_well();
        let colors = Colors::of(&Pixels::of(&picture));
        assert!(colors.free > 20_000 && colors.walls > 500, "{colors:?}");
    }

    // Another package keeps what its owner changed; a purge keeps configuration and keys.
    debian.run("echo '# mine' >> /etc/foreshore/robot-edge.env; dpkg -i --force-confdef /tmp/robot-edge.deb");
    assert!(
        debian
            .run("cat /etc/foreshore/robot-edge.env")
            .ends_with("# mine")
    );
    debian.run("apt-get purge -y robot-edge");
    assert_eq!(debian.run("ls /etc/foreshore"), "keys\nvehicle.toml");
}

/// What a replay says of its maps, with their digests.
fn layers(program: &mut Command, folder: &Path) -> Value {
    let summary = folder.join("summary.json");
    let replayed = program
        .args(["replay", &rooms(), "--no-network", "--quiet", "--summary"])
        .arg(&summary)
        .status();
    assert!(replayed.unwrap().success());
    let summary: Value = serde_json::from_slice(&fs::read(summary).unwrap()).unwrap();
    assert!(
        summary["layers"]["occupancy"]["digest"].is_string(),
        "{summary}"
    );
    summary["layers"].clone()
}

#[test]
#[ignore = "builds for twenty minutes"]
fn the_arm64_package_maps_the_same() {
    const TARGET: &str = "aarch64-unknown-linux-gnu";
    let zig = (
        "cargo-zigbuild",
        "cargo install cargo-zigbuild; pip install ziglang",
    );
    let qemu = ("qemu-aarch64-static", "package qemu-user-static");
    if !has_all(&[CARGO_DEB, MMDEBSTRAP, zig, qemu]) {
        return;
    }
    let folder = tempdir().unwrap();
    let root = folder.path().join("root");
    // Unpacked only: nothing of it must run here.
    let made = Command::new("mmdebstrap")
        .args([
            "--quiet",
            "--arch=arm64",
            "--variant=extract",
            "--include=libgcc-s1",
            RELEASE,
        ])
        .arg(&root)
        .status();
    assert!(made.unwrap().success());
    let unpacked = Command::new("dpkg-deb")
        .arg("-x")
        .arg(package(Some(TARGET)))
        .arg(&root)
        .status();
    assert!(unpacked.unwrap().success());
    let robot_edge = || {
        let mut command = Command::new("qemu-aarch64-static");
        command
            .arg("-L")
            .arg(&root)
            .arg(root.join("usr/bin/robot-edge"));
        command
    };
    let checked = robot_edge()
        .arg("check")
        .arg(root.join("etc/foreshore/example.toml"))
        .output()
        .unwrap();
    assert!(checked.stdout.starts_with(b"ok\n"), "{checked:?}");
    assert_eq!(
        layers(&mut robot_edge(), folder.path()),
        layers(&mut command("robot-edge"), folder.path())
    );
}
