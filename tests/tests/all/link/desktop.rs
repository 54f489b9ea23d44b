//! A console's window on a virtual screen (Xvfb), with real keys pressed by the XTEST extension, the accessibility tree that
//! `--controls` writes to a file, and what the robot reports.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::operator::{NEUTRAL, Operator};
use network::clock;
use protocol::message::{TeleopState, TeleopStatus};
use x11rb::connection::Connection as _;
use x11rb::protocol::xproto::{
    AtomEnum, ClientMessageEvent, ConnectionExt as _, EventMask, InputFocus, KEY_PRESS_EVENT,
    KEY_RELEASE_EVENT, MapState, Window,
};
use x11rb::protocol::xtest::ConnectionExt as _;
use x11rb::rust_connection::RustConnection;

use crate::processes::Running;
use crate::skip::skip;

/// Longer than any step takes on a busy machine.
pub(crate) const TIMEOUT: Duration = Duration::from_mins(1);

/// Time between two keys of a fast typist.
const STROKE: Duration = Duration::from_millis(20);

/// A key by its X keycode: the Linux keycode plus 8.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Key {
    Escape = 9,
    W = 25,
    O = 32,
    Enter = 36,
    Control = 37,
    A = 38,
    G = 42,
    L = 46,
    Semicolon = 47,
    Shift = 50,
    Space = 65,
    Left = 113,
}

/// First keycode and keys of each row of a US keyboard.
const ROWS: [(u8, &str); 4] = [
    (10, "1234567890-="),
    (24, "qwertyuiop[]"),
    (38, "asdfghjkl;"),
    (52, "zxcvbnm,./"),
];

pub(crate) fn skip_without_window(printed: &str) {
    skip(
        &format!("no window can be opened: {printed}"),
        "the packages of .ci/run",
    );
}

/// A virtual screen.
pub(crate) struct Screen {
    server: Child,
    display: String,
    x: RustConnection,
    root: Window,
}

impl Screen {
    /// `None`, and a skipped test, if there is no Xvfb.
    pub(crate) fn open() -> Option<Self> {
        // The server chooses a free display and prints its number when it is ready.
        let server = Command::new("Xvfb")
            .args("-displayfd 1 -screen 0 1280x800x24 -nolisten tcp".split(' '))
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn();
        let Ok(mut server) = server else {
            skip("there is no Xvfb", "package xvfb");
            return None;
        };
        let mut number = String::new();
        BufReader::new(server.stdout.take().unwrap())
            .read_line(&mut number)
            .unwrap();
        let display = format!(":{}", number.trim());
        let (x, screen) = x11rb::connect(Some(&display)).unwrap();
        let root = x.setup().roots[screen].root;
        Some(Self {
            server,
            display,
            x,
            root,
        })
    }

    /// Makes a program open its window here.
    pub(crate) fn show(&self, command: &mut Command) {
        command
            .env("DISPLAY", &self.display)
            .env_remove("WAYLAND_DISPLAY")
            .env_remove("WAYLAND_SOCKET");
    }

    /// Waits for a visible window of this title; `None` if `is_over` first.
    pub(crate) fn window(&self, title: &str, mut is_over: impl FnMut() -> bool) -> Option<Window> {
        let started = clock::now();
        while clock::elapsed(started) < TIMEOUT && !is_over() {
            let children = self.x.query_tree(self.root).unwrap().reply().unwrap();
            let mut windows = children.children.into_iter();
            if let Some(window) = windows.find(|window| self.is_shown(*window, title)) {
                return Some(window);
            }
            sleep(Duration::from_millis(50));
        }
        None
    }

    /// Starts a console here and gives its window the keyboard; `None`, and a skipped test, if it opens no window.
    pub(crate) fn open_console(&self, command: &mut Command) -> Option<(Running, Window)> {
        self.show(command);
        let mut console = Running::start(command, "the window");
        let Some(window) = self.window("Foreshore", || !console.is_running()) else {
            skip_without_window(&console.end().1);
            return None;
        };
        self.focus(window);
        Some((console, window))
    }

    pub(crate) fn focus(&self, window: Window) {
        self.x
            .set_input_focus(InputFocus::PARENT, window, x11rb::CURRENT_TIME)
            .unwrap()
            .check()
            .unwrap();
    }

    pub(crate) fn unfocus(&self) {
        self.focus(self.root);
    }

    pub(crate) fn press(&self, key: Key) {
        self.fake(KEY_PRESS_EVENT, key as u8);
    }

    pub(crate) fn release(&self, key: Key) {
        self.fake(KEY_RELEASE_EVENT, key as u8);
    }

    pub(crate) fn tap(&self, key: Key) {
        self.press(key);
        self.release(key);
    }

    /// Taps a key while another is held.
    pub(crate) fn tap_with(&self, held: Key, key: Key) {
        self.press(held);
        sleep(STROKE);
        self.tap(key);
        sleep(STROKE);
        self.release(held);
    }

    /// Types small letters, digits and the marks of paths and addresses.
    pub(crate) fn write(&self, text: &str) {
        for letter in text.chars() {
            let of_row = |(first, row): &(u8, &str)| Some(first + row.find(letter)? as u8);
            let code = match letter {
                ' ' => Some(Key::Space as u8),
                ':' => Some(Key::Semicolon as u8),
                _ => ROWS.iter().find_map(of_row),
            };
            let code = code.unwrap_or_else(|| panic!("no key for {letter:?}"));
            if letter == ':' {
                self.press(Key::Shift);
            }
            self.fake(KEY_PRESS_EVENT, code);
            self.fake(KEY_RELEASE_EVENT, code);
            if letter == ':' {
                self.release(Key::Shift);
            }
            sleep(STROKE);
        }
    }

    /// Asks a window to close.
    pub(crate) fn close(&self, window: Window) {
        let [protocols, delete] = ["WM_PROTOCOLS", "WM_DELETE_WINDOW"].map(|name| {
            let atom = self.x.intern_atom(false, name.as_bytes()).unwrap();
            atom.reply().unwrap().atom
        });
        let message = ClientMessageEvent::new(32, window, protocols, [delete, 0, 0, 0, 0]);
        self.x
            .send_event(false, window, EventMask::NO_EVENT, message)
            .unwrap()
            .check()
            .unwrap();
    }

    fn is_shown(&self, window: Window, title: &str) -> bool {
        let name = self
            .x
            .get_property(false, window, AtomEnum::WM_NAME, AtomEnum::ANY, 0, 64);
        let name = name.unwrap().reply();
        let attributes = self.x.get_window_attributes(window).unwrap().reply();
        name.is_ok_and(|name| name.value == title.as_bytes())
            && attributes.is_ok_and(|window| window.map_state == MapState::VIEWABLE)
    }

    fn fake(&self, kind: u8, key: u8) {
        self.x
            .xtest_fake_input(kind, key, x11rb::CURRENT_TIME, self.root, 0, 0, 0)
            .unwrap()
            .check()
            .unwrap();
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        drop(self.server.kill());
        drop(self.server.wait());
    }
}

/// The file with all controls of a window.
pub(crate) struct Controls(pub(crate) PathBuf);

impl Controls {
    /// Waits for a control whose text begins with `words`.
    pub(crate) fn beginning(&self, words: &str) {
        let started = clock::now();
        loop {
            let text = fs::read_to_string(&self.0).unwrap_or_default();
            // Role, four edges, label and value.
            let has_words = |line: &str| line.split('\t').skip(5).any(|of| of.starts_with(words));
            if text.lines().any(has_words) {
                return;
            }
            let is_over = clock::elapsed(started) > TIMEOUT;
            assert!(!is_over, "timed out: {words}. Controls:\n{text}");
            sleep(Duration::from_millis(10));
        }
    }
}

/// Requests the lease for `anna` until it is granted: the window may not have connected yet.
pub(crate) fn take_lease(screen: &Screen, telemetry: &Telemetry) {
    for _attempt in 0..30 {
        let started = clock::now();
        while clock::elapsed(started) < Duration::from_millis(1500) {
            let holder = telemetry.now().and_then(|status| status.lease.holder);
            if holder.is_some_and(|holder| holder.as_str() == "anna") {
                return;
            }
            sleep(Duration::from_millis(10));
        }
        // The same key releases a lease that is held.
        screen.tap_with(Key::Control, Key::G);
    }
    panic!("the robot grants no lease");
}

/// Holds a key until the vehicle drives and `is_so`. A busy machine may hang during a press, which then does not
/// count, so the press is repeated.
pub(crate) fn hold_until(
    screen: &Screen,
    telemetry: &Telemetry,
    key: Key,
    is_so: impl Fn(&TeleopStatus) -> bool,
) -> TeleopStatus {
    for _attempt in 0..10 {
        sleep(NEUTRAL);
        screen.press(key);
        let started = clock::now();
        while clock::elapsed(started) < Duration::from_secs(2) {
            let status = telemetry.now();
            let driving =
                status.filter(|status| status.state == TeleopState::Driving && is_so(status));
            if let Some(driving) = driving {
                return driving;
            }
            sleep(Duration::from_millis(5));
        }
        screen.release(key);
    }
    panic!("it does not drive: {:?}", telemetry.now());
}

/// An operator who only watches.
pub(crate) struct Telemetry(Operator);

impl Telemetry {
    pub(crate) fn of(robot: &str, endpoint: &str) -> Self {
        Self(Operator::connect(endpoint, robot, "watcher"))
    }

    /// The last state of driving.
    pub(crate) fn now(&self) -> Option<TeleopStatus> {
        self.0.teleop()
    }

    pub(crate) fn wait_for_status(
        &self,
        what: &str,
        is_so: impl Fn(&TeleopStatus) -> bool,
    ) -> TeleopStatus {
        self.0.wait_for_status(what, is_so)
    }

    /// Position in `odom`, metres, and heading, radians.
    pub(crate) fn pose(&self) -> ([f64; 2], f64) {
        let pose = self.0.pose();
        let [x, y, _] = pose.position_m;
        let [qx, qy, qz, qw] = pose.quaternion_xyzw.map(f64::from);
        let [sine, cosine] = [2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz)];
        let yaw = nalgebra::UnitComplex::from_cos_sin_unchecked(cosine, sine).angle();
        ([x, y], yaw)
    }

    pub(crate) fn assert_stopped(&self, what: &str) {
        let status = self.wait_for_status("a status", |_| true);
        assert_ne!(status.state, TeleopState::Driving, "{what}: {status:?}");
        let applied = status.applied;
        assert!(
            applied.linear_mps.abs() < 1e-6 && applied.angular_radps.abs() < 1e-6,
            "{what}: {status:?}"
        );
    }
}
