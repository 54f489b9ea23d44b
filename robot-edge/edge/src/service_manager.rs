//! Notifications to systemd: `sd_notify(3)`, datagrams to the socket named by `NOTIFY_SOCKET`.

#[cfg(unix)]
use std::{
    ffi::OsStr,
    io,
    os::unix::ffi::OsStrExt as _,
    os::unix::net::{SocketAddr, UnixDatagram},
};

pub const SOCKET: &str = "NOTIFY_SOCKET";

/// The service manager that started this process, if it expects notifications.
#[derive(Debug, Default)]
pub struct ServiceManager {
    #[cfg(unix)]
    socket: Option<UnixDatagram>,
}

impl ServiceManager {
    /// The one named by the environment; none if there is no name or no connection.
    #[cfg(unix)]
    pub fn from_environment() -> Self {
        let named = std::env::var_os(SOCKET);
        let connected = named.and_then(|name| {
            connect(&name)
                .inspect_err(|why| {
                    tracing::warn!(%why, ?name, "{SOCKET}: the service manager is not notified");
                })
                .ok()
        });
        Self { socket: connected }
    }

    /// None: this system has no such sockets.
    #[cfg(not(unix))]
    pub fn from_environment() -> Self {
        Self::default()
    }

    /// The service runs, and sends watchdog messages from now on.
    pub fn ready(&self) {
        self.notify("READY=1");
    }

    pub fn ready_without_watchdog(&self) {
        self.notify("READY=1\nWATCHDOG_USEC=0");
    }

    pub fn notify_watchdog(&self) {
        self.notify("WATCHDOG=1");
    }

    /// The sender of watchdog messages ends orderly.
    pub fn disable_watchdog(&self) {
        self.notify("WATCHDOG_USEC=0");
    }

    /// It never waits. Without messages the watchdog acts by itself.
    #[cfg(unix)]
    fn notify(&self, state: &str) {
        drop(
            self.socket
                .as_ref()
                .map(|socket| socket.send(state.as_bytes())),
        );
    }

    #[cfg(not(unix))]
    fn notify(&self, _state: &str) {}
}

#[cfg(unix)]
fn connect(name: &OsStr) -> io::Result<UnixDatagram> {
    let socket = UnixDatagram::unbound()?;
    socket.set_nonblocking(true)?;
    socket.connect_addr(&address(name)?)?;
    Ok(socket)
}

/// A path, or on Linux an abstract name behind an `@`.
#[cfg(unix)]
fn address(name: &OsStr) -> io::Result<SocketAddr> {
    #[cfg(target_os = "linux")]
    if let [b'@', name @ ..] = name.as_bytes() {
        return <SocketAddr as std::os::linux::net::SocketAddrExt>::from_abstract_name(name);
    }
    SocketAddr::from_pathname(name)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn sockets_have_a_path_or_an_abstract_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notify");
        let name = format!("@foreshore-test-{}", std::process::id());
        for name in [path.as_os_str(), OsStr::new(&name)] {
            let manager = UnixDatagram::bind_addr(&address(name).unwrap()).unwrap();
            let service = ServiceManager {
                socket: Some(connect(name).unwrap()),
            };
            service.ready_without_watchdog();
            let mut buffer = [0; 64];
            let count = manager.recv(&mut buffer).unwrap();
            assert_eq!(&buffer[..count], b"READY=1\nWATCHDOG_USEC=0");
            drop(manager);
            // A service manager that is restarted is none for a while.
            service.notify_watchdog();
        }
        assert!(connect(OsStr::new("/nonexistent/notify")).is_err());
    }
}
