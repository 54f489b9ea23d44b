//! Edge and console as processes, over real Zenoh sessions.

mod connection;
pub(crate) mod desktop;
mod drive_window;
mod driving;
mod fleet_load;
mod garbage;
mod joining;
mod load;

mod map_pictures;
mod maps;
mod sensors;
pub(crate) mod shaped;
mod steady;
pub(crate) mod window;

use std::path::Path;
use std::sync::atomic::{AtomicU8, Ordering};

use network::clock;
use network::sessions::Endpoints;
use operator_console::link::RobotSession;
use operator_console::model::{ConsoleModel, LinkState, ModelSettings};
use protocol::keys::{RobotId, view_of};
use protocol::layer::LayerId;
use protocol::message::View;
use protocol::tile::BootId;
use protocol::wire::{self, Header};
use zenoh::{Session, Wait as _};

use crate::processes::{Running, rooms, start, tcp};

/// A replay of `rooms` that serves after its end.
fn edge(port: u16, rate: &str, export: &Path) -> Running {
    let (rooms, listen, export) = (rooms(), tcp(port), export.display());
    start(&format!(
        "robot-edge replay {rooms} --rate {rate} --keep-serving --robot scout --listen {listen} --export {export}"
    ))
}

/// A headless console that exports when the data of `robot` ends.
fn console(port: u16, robot: &str, export: &Path) -> Running {
    let (connect, export) = (tcp(port), export.display());
    start(&format!(
        "operator-console --headless --for 100 --connect {connect} --robot {robot} --export {export}"
    ))
}

/// The session of a console's window with robot `scout`, which shows these layers.
pub(crate) fn open_session(
    endpoints: &Endpoints,
    layers: &[LayerId],
    wake: impl Fn() + Send + 'static,
) -> RobotSession {
    static OPENED: AtomicU8 = AtomicU8::new(1);
    let settings = ModelSettings {
        robot: "scout".parse().unwrap(),
        session: BootId([OPENED.fetch_add(1, Ordering::Relaxed); 16]),
        tile_store_mb: 64,
        layers: layers.iter().copied().collect(),
    };
    RobotSession::open(settings, endpoints, wake)
}

/// The endpoints of a console that connects without keys.
fn connect_to(endpoint: String) -> Endpoints {
    Endpoints {
        connect: vec![endpoint],
        ..Endpoints::default()
    }
}

pub(crate) fn is_live(model: &ConsoleModel) -> bool {
    model.connection().state(clock::now()) == LinkState::Live
}

/// Sends the view of a synchronized console to `scout`, which makes it send events, and scans if they are wanted.
pub(crate) fn send_view(session: &Session, name: &str, wants_scan: bool) {
    let header = Header {
        boot: BootId([9; 16]),
        seq: 0,
        robot_time_ns: 0,
    };
    let view = View {
        rectangle_m: [-10.0, -10.0, 10.0, 10.0],
        layers: 1,
        revision: u64::MAX,
        is_synchronized: true,
        wants_scan,
    };
    let [robot, name]: [RobotId; 2] = ["scout", name].map(|name| name.parse().unwrap());
    let view = wire::encode(&header, &view).unwrap();
    session.put(view_of(&robot, &name), view).wait().unwrap();
}
