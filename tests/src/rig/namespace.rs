//! One network namespace with a TUN device in it, by way of the program `ip`.

use std::fmt::Display;
use std::fs::{self, File};
use std::io::{self, Write};
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::{panic, process, thread};

use rustix::thread::{LinkNameSpaceType, move_into_link_name_space};
use tun_rs::{DeviceBuilder, SyncDevice};

use super::tun::{MTU_BYTES, Side};

const TUN: &str = "/dev/net/tun";

/// Folder of namespaces.
const FOLDER: &str = "/var/run/netns";

/// Prefix of names; process id, number and side follow.
const PREFIX: &str = "foreshore-rig-";

/// The device's name in its namespace.
const DEVICE: &str = "tun0";

/// Why there can be no namespaces.
#[derive(Debug, thiserror::Error)]
pub enum Unavailable {
    /// The machine or the user lacks something, so that a test is skipped.
    #[error("{0}")]
    Lacking(String),
    /// Something else failed.
    #[error("{0}")]
    Failed(String),
}

impl Unavailable {
    pub(super) fn failed(action: &str, message: &dyn Display) -> Self {
        Self::Failed(format!("{action} failed: {message}"))
    }
}

/// Checks rights and tools.
pub(super) fn check() -> Result<(), Unavailable> {
    let user = rustix::process::geteuid();
    if !user.is_root() {
        return Err(Unavailable::Lacking(format!(
            "network namespaces and TUN devices need root; this process runs as user {}",
            user.as_raw()
        )));
    }
    File::options()
        .read(true)
        .write(true)
        .open(TUN)
        .map_err(|err| {
            Unavailable::Lacking(format!(
                "{TUN} cannot be opened (`modprobe tun`; in a container, pass the device): {err}"
            ))
        })?;
    ip(&["-V"], "")
}

/// Removes the namespaces of killed processes, if possible.
pub(super) fn remove_abandoned() {
    let names = fs::read_dir(FOLDER).into_iter().flatten().flatten();
    for name in names.filter_map(|entry| entry.file_name().into_string().ok()) {
        let owner = name
            .strip_prefix(PREFIX)
            .and_then(|rest| rest.split('-').next()?.parse::<u32>().ok());
        if owner.is_some_and(|process| !Path::new("/proc").join(process.to_string()).exists()) {
            ip(&["netns", "del", &name], "").ok();
        }
    }
}

/// A network namespace, removed when this is dropped.
#[derive(Debug)]
pub(super) struct Namespace {
    name: String,
}

impl Namespace {
    /// Creates a namespace in which there is loopback and a TUN device, and opens the device.
    pub(super) fn create(side: Side) -> Result<(Self, SyncDevice), Unavailable> {
        static CREATED: AtomicU32 = AtomicU32::new(0);
        let number = CREATED.fetch_add(1, Ordering::Relaxed);
        let letter = match side {
            Side::A => 'a',
            Side::B => 'b',
        };
        let name = format!("{PREFIX}{}-{number}-{letter}", process::id());
        ip(&["netns", "add", &name], "")?;
        let namespace = Self { name };
        // Created inside the namespace, the device never belongs to the machine.
        let device = namespace
            .within(open_device)
            .and_then(|device| device)
            .map_err(|err| Unavailable::failed("opening a TUN device", &err))?;
        // Without `addrgenmode none` the kernel sends IPv6 packets, which would be counted.
        let setup = format!(
            "link set lo up\n\
             link set {DEVICE} mtu {MTU_BYTES} addrgenmode none\n\
             addr add {}/30 dev {DEVICE}\n\
             link set {DEVICE} up\n",
            side.address()
        );
        ip(&["-n", &namespace.name, "-batch", "-"], &setup)?;
        Ok((namespace, device))
    }

    pub(super) fn name(&self) -> &str {
        &self.name
    }

    pub(super) fn within<T: Send>(&self, task: impl FnOnce() -> T + Send) -> io::Result<T> {
        let namespace = File::open(PathBuf::from(FOLDER).join(&self.name))?;
        // On a thread that ends with the task, because it cannot leave the namespace.
        thread::scope(|scope| {
            let entered = scope.spawn(|| {
                move_into_link_name_space(namespace.as_fd(), Some(LinkNameSpaceType::Network))?;
                Ok(task())
            });
            entered
                .join()
                .unwrap_or_else(|panicked| panic::resume_unwind(panicked))
        })
    }
}

impl Drop for Namespace {
    fn drop(&mut self) {
        // The next process that creates namespaces tries again.
        ip(&["netns", "del", &self.name], "").ok();
    }
}

fn open_device() -> io::Result<SyncDevice> {
    let device = DeviceBuilder::new()
        .name(DEVICE)
        .enable(false)
        .build_sync()?;
    device.set_nonblocking(true)?;
    Ok(device)
}

/// Runs `ip`, with `input` to read.
fn ip(arguments: &[&str], input: &str) -> Result<(), Unavailable> {
    let call = format!("`ip {}`", arguments.join(" "));
    let mut child = Command::new("ip")
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|err| {
            Unavailable::Lacking(format!(
                "the program `ip` (package iproute2) cannot be started: {err}"
            ))
        })?;
    if let Some(mut stdin) = child.stdin.take() {
        // If it stops reading, it reports why.
        stdin.write_all(input.as_bytes()).ok();
    }
    let output = child
        .wait_with_output()
        .map_err(|err| Unavailable::failed(&call, &err))?;
    if output.status.success() {
        return Ok(());
    }
    let message = String::from_utf8_lossy(&output.stderr).trim().to_owned();
    if message.contains("not permitted") || message.contains("Permission denied") {
        return Err(Unavailable::Lacking(format!(
            "{call} is not permitted, though this is root (CAP_NET_ADMIN, CAP_SYS_ADMIN): {message}"
        )));
    }
    Err(Unavailable::failed(&call, &message))
}
