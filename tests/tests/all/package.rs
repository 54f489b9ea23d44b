//! The Debian package, installed into a fresh Debian. It needs root, cargo-deb, mmdebstrap and Debian's packages.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use tempfile::tempdir;

use crate::skip::skip;

const RELEASE: &str = "bookworm";
const SETUP: &str = "robot-edge setup --vehicle introbot --listen quic/[::]:7447 \
    --device laser=sick_cola,tcp=192.168.0.1:2111 --device ahrs=xsens,serial=/dev/foreshore/xsens";

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

    fn path(&self, inside: &str) -> PathBuf {
        self.0.join(inside.trim_start_matches('/'))
    }
}

/// The package, built in the folder of this test's own program.
fn package() -> PathBuf {
    let program = std::env::current_exe().unwrap();
    let target = program.ancestors().nth(3).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robot-edge/deploy/package");
    let output = Command::new(script)
        .env("CARGO_TARGET_DIR", target)
        .stderr(Stdio::inherit())
        .output()
        .unwrap();
    assert!(output.status.success(), "{output:?}");
    let printed = String::from_utf8(output.stdout).unwrap();
    PathBuf::from(printed.lines().last().unwrap())
}

fn has(program: &str) -> bool {
    let asked = Command::new(program).arg("--version").output();
    asked.is_ok_and(|output| output.status.success())
}

#[test]
#[ignore = "builds for ten minutes and installs a Debian"]
fn the_package_installs_on_a_fresh_debian() {
    for (program, remedy) in [
        ("cargo-deb", "cargo install cargo-deb"),
        ("mmdebstrap", "package mmdebstrap"),
    ] {
        if !has(program) {
            return skip(&format!("there is no {program}"), remedy);
        }
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
    fs::copy(package(), debian.path("/tmp/robot-edge.deb")).unwrap();
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
    let printed = debian.run(SETUP);
    assert!(
        printed.contains("/etc/foreshore/vehicle.toml: written"),
        "{printed}"
    );
    let (is_ok, printed) = debian.try_run(SETUP);
    assert!(!is_ok && printed.contains("--force"), "{printed}");
    debian.run(
        "cd /root; robot-edge keys fleet --robot scout --host boat.example --operator anna; \
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
