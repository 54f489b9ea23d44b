//! Drag and drop of files onto a window, as by a file manager: the source's side of XDND, version 5
//! (<https://freedesktop.org/wiki/Specifications/XDND>).

use std::os::unix::ffi::OsStrExt as _;
use std::path::Path;
use std::thread::sleep;
use std::time::Duration;

use measurement::time::Monotonic;
use robot_edge::clock;
use x11rb::connection::Connection as _;
use x11rb::protocol::Event;
use x11rb::protocol::xproto::{
    Atom, AtomEnum, ClientMessageEvent, ConnectionExt as _, CreateWindowAux, EventMask, PropMode,
    SELECTION_NOTIFY_EVENT, SelectionNotifyEvent, SelectionRequestEvent, Timestamp, Window,
    WindowClass,
};
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;

use super::screen::Screen;

const TIMEOUT: Duration = Duration::from_secs(20);
/// Version of the protocol.
const VERSION: u32 = 5;

/// Files that are dragged over a window.
pub(crate) struct DragSource {
    x: RustConnection,
    atoms: Atoms,
    source: Window,
    target: Window,
    /// Start of the drag, in time of the X server.
    began: Timestamp,
    /// The files as `text/uri-list`.
    uris: Vec<u8>,
    /// Number of requests for them.
    requests: usize,
}

/// Names of messages and properties.
struct Atoms {
    aware: Atom,
    selection: Atom,
    enter: Atom,
    position: Atom,
    status: Atom,
    leave: Atom,
    drop: Atom,
    finished: Atom,
    copy: Atom,
    uri_list: Atom,
}

impl Atoms {
    fn of(x: &RustConnection) -> Self {
        let atom = |name: &str| {
            let requests = x.intern_atom(false, name.as_bytes()).unwrap();
            requests.reply().unwrap().atom
        };
        Self {
            aware: atom("XdndAware"),
            selection: atom("XdndSelection"),
            enter: atom("XdndEnter"),
            position: atom("XdndPosition"),
            status: atom("XdndStatus"),
            leave: atom("XdndLeave"),
            drop: atom("XdndDrop"),
            finished: atom("XdndFinished"),
            copy: atom("XdndActionCopy"),
            uri_list: atom("text/uri-list"),
        }
    }
}

impl DragSource {
    /// Drags files to the middle of a window; returns when the window accepts them.
    pub(crate) fn start(screen: &Screen, target: Window, files: &[&Path]) -> Self {
        let (x, root) = screen.connection();
        let source = x.generate_id().unwrap();
        let aux = CreateWindowAux::new().event_mask(EventMask::PROPERTY_CHANGE);
        let class = WindowClass::INPUT_ONLY;
        x.create_window(0, source, root, 0, 0, 1, 1, 0, class, 0, &aux)
            .unwrap()
            .check()
            .unwrap();
        let atoms = Atoms::of(&x);
        let mut drag_source = Self {
            began: now(&x, source, atoms.aware),
            x,
            atoms,
            source,
            target,
            uris: uri_list(files),
            requests: 0,
        };
        drag_source.enter(root);
        drag_source
    }

    fn enter(&mut self, root: Window) {
        let (atoms, x) = (&self.atoms, &self.x);
        let aware = x.get_property(false, self.target, atoms.aware, AtomEnum::ATOM, 0, 1);
        let version = aware.unwrap().reply().unwrap().value32().unwrap().next();
        assert!(version.is_some_and(|version| version >= VERSION));
        x.set_selection_owner(self.source, atoms.selection, self.began)
            .unwrap()
            .check()
            .unwrap();
        self.send(atoms.enter, [VERSION << 24, atoms.uri_list, 0, 0]);
        let size = x.get_geometry(self.target).unwrap().reply().unwrap();
        // Each position is sent when the last one was answered.
        for step in 1_u16..=5 {
            let [x_in, y_in] = [size.width / 10 * step, size.height / 10 * step];
            let [x_in, y_in] = [x_in, y_in].map(|pixels| i16::try_from(pixels).unwrap());
            let at = self.x.translate_coordinates(self.target, root, x_in, y_in);
            let at = at.unwrap().reply().unwrap();
            let [left, top] = [at.dst_x, at.dst_y].map(|pixels| u32::try_from(pixels).unwrap());
            let place = [0, left << 16 | top, self.began, self.atoms.copy];
            self.send(self.atoms.position, place);
            let [_, answer, ..] = self.wait_for_message(self.atoms.status);
            assert_eq!(answer & 1, 1, "the window takes no files");
        }
        self.serve_until(|drag_source| drag_source.requests > 0);
    }

    /// Drops the files and waits until the window has them.
    pub(crate) fn drop_files(mut self) {
        self.send(self.atoms.drop, [0, self.began, 0, 0]);
        let [_, is_taken, ..] = self.wait_for_message(self.atoms.finished);
        assert_eq!(is_taken & 1, 1, "the window has not taken the files");
    }

    /// Drags them out of the window.
    pub(crate) fn leave(self) {
        self.send(self.atoms.leave, [0; 4]);
    }

    /// Sends a message to the window.
    fn send(&self, what: Atom, [a, b, c, d]: [u32; 4]) {
        let message = ClientMessageEvent::new(32, self.target, what, [self.source, a, b, c, d]);
        self.x
            .send_event(false, self.target, EventMask::NO_EVENT, message)
            .unwrap()
            .check()
            .unwrap();
    }

    /// Waits for a message of the window; answers its requests for the files meanwhile.
    fn wait_for_message(&mut self, what: Atom) -> [u32; 5] {
        let mut received = None;
        self.serve(|message| {
            if message.type_ == what {
                received = Some(message.data.as_data32());
            }
            received.is_some()
        });
        received.unwrap()
    }

    fn serve_until(&mut self, is_over: impl Fn(&Self) -> bool) {
        let started = clock::now();
        while !is_over(self) {
            self.take(started);
        }
    }

    /// Answers requests until a message `is_it`.
    fn serve(&mut self, mut is_it: impl FnMut(&ClientMessageEvent) -> bool) {
        let started = clock::now();
        loop {
            if let Some(Event::ClientMessage(message)) = self.take(started)
                && is_it(&message)
            {
                return;
            }
        }
    }

    /// The next event; answers a request for the files.
    fn take(&mut self, started: Monotonic) -> Option<Event> {
        let event = self.x.poll_for_event().unwrap();
        match &event {
            Some(Event::SelectionRequest(request)) => self.send_data(request),
            Some(_) => {}
            None => {
                assert!(
                    clock::elapsed(started) < TIMEOUT,
                    "the window does not answer"
                );
                sleep(Duration::from_millis(2));
            }
        }
        event
    }

    fn send_data(&mut self, request: &SelectionRequestEvent) {
        assert_eq!(request.selection, self.atoms.selection);
        assert_eq!(request.target, self.atoms.uri_list);
        let (to, property) = (request.requestor, request.property);
        let kind = self.atoms.uri_list;
        self.x
            .change_property8(PropMode::REPLACE, to, property, kind, &self.uris)
            .unwrap()
            .check()
            .unwrap();
        let notification = SelectionNotifyEvent {
            response_type: SELECTION_NOTIFY_EVENT,
            sequence: 0,
            time: request.time,
            requestor: to,
            selection: request.selection,
            target: request.target,
            property,
        };
        self.x
            .send_event(false, to, EventMask::NO_EVENT, notification)
            .unwrap()
            .check()
            .unwrap();
        self.requests += 1;
    }
}

/// The time of the X server: the stamp of an empty change.
fn now(x: &RustConnection, window: Window, property: Atom) -> Timestamp {
    x.change_property32(PropMode::APPEND, window, property, AtomEnum::ATOM, &[])
        .unwrap()
        .check()
        .unwrap();
    loop {
        if let Event::PropertyNotify(changed) = x.wait_for_event().unwrap() {
            return changed.time;
        }
    }
}

/// `file` URIs, each with a line end; bytes other than letters, digits and `/-._~` are percent-encoded.
fn uri_list(files: &[&Path]) -> Vec<u8> {
    let mut uris = Vec::new();
    for file in files {
        uris.extend(b"file://");
        for &byte in file.as_os_str().as_bytes() {
            if byte.is_ascii_alphanumeric() || b"/-._~".contains(&byte) {
                uris.push(byte);
            } else {
                uris.extend(format!("%{byte:02X}").into_bytes());
            }
        }
        uris.extend(b"\r\n");
    }
    uris
}
