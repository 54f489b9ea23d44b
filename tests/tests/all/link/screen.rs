//! A virtual screen (Xvfb) with real keys, pressed by the XTEST extension.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use robot_edge::clock;
use x11rb::connection::Connection as _;
use x11rb::protocol::xproto::{
    AtomEnum, BUTTON_PRESS_EVENT, BUTTON_RELEASE_EVENT, ClientMessageEvent, ConnectionExt as _,
    EventMask, ImageFormat, InputFocus, KEY_PRESS_EVENT, KEY_RELEASE_EVENT, MOTION_NOTIFY_EVENT,
    MapState, Window,
};
use x11rb::protocol::xtest::ConnectionExt as _;
use x11rb::rust_connection::RustConnection;

use super::processes::Running;
use crate::skip::skip;

const TIMEOUT: Duration = Duration::from_mins(1);

/// Time between two keys of a fast typist.
const STROKE: Duration = Duration::from_millis(20);

/// A key by its X keycode: the Linux keycode plus 8.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Key {
    Escape = 9,
    Digit5 = 14,
    Equals = 21,
    Q = 24,
    W = 25,
    E = 26,
    O = 32,
    P = 33,
    Enter = 36,
    Control = 37,
    A = 38,
    G = 42,
    L = 46,
    Shift = 50,
    V = 55,
    M = 58,
    Alt = 64,
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
            .args([
                "-displayfd",
                "1",
                "-screen",
                "0",
                "1280x800x24",
                "-nolisten",
                "tcp",
            ])
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

    /// Another connection, with its own events, and the root window.
    pub(crate) fn connection(&self) -> (RustConnection, Window) {
        let (x, screen) = x11rb::connect(Some(&self.display)).unwrap();
        let root = x.setup().roots[screen].root;
        (x, root)
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
        self.fake(KEY_PRESS_EVENT, key as u8, [0, 0]);
    }

    pub(crate) fn release(&self, key: Key) {
        self.fake(KEY_RELEASE_EVENT, key as u8, [0, 0]);
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

    /// Types letters, digits and the marks of paths and addresses.
    pub(crate) fn write(&self, text: &str) {
        for letter in text.chars() {
            let (letter, is_shifted) = match letter {
                ':' => (';', true),
                '_' => ('-', true),
                'A'..='Z' => (letter.to_ascii_lowercase(), true),
                _ => (letter, false),
            };
            let mut rows = ROWS.iter();
            let code = rows.find_map(|(first, row)| Some(first + row.find(letter)? as u8));
            let code = code.or((letter == ' ').then_some(Key::Space as u8));
            let code = code.unwrap_or_else(|| panic!("no key for {letter:?}"));
            if is_shifted {
                self.press(Key::Shift);
            }
            self.fake(KEY_PRESS_EVENT, code, [0, 0]);
            self.fake(KEY_RELEASE_EVENT, code, [0, 0]);
            if is_shifted {
                self.release(Key::Shift);
            }
            sleep(STROKE);
        }
    }

    /// Moves the pointer, pixels from the upper left corner.
    pub(crate) fn point(&self, at: [i16; 2]) {
        self.fake(MOTION_NOTIFY_EVENT, 0, at);
    }

    /// Points and clicks, pixels from the upper left corner.
    pub(crate) fn click(&self, at: [i16; 2]) {
        self.point(at);
        // The button needs a frame to notice the pointer.
        sleep(Duration::from_millis(200));
        self.fake(BUTTON_PRESS_EVENT, 1, at);
        sleep(Duration::from_millis(50));
        self.fake(BUTTON_RELEASE_EVENT, 1, at);
    }

    /// Width, height, and red, green and blue of each pixel, row by row.
    pub(crate) fn pixels(&self) -> ([u16; 2], Vec<[u8; 3]>) {
        let size = self.x.get_geometry(self.root).unwrap().reply().unwrap();
        let image = self
            .x
            .get_image(
                ImageFormat::Z_PIXMAP,
                self.root,
                0,
                0,
                size.width,
                size.height,
                u32::MAX,
            )
            .unwrap()
            .reply()
            .unwrap();
        // Blue, green, red and an unused byte.
        let pixels = image.data.chunks_exact(4).map(|p| [p[2], p[1], p[0]]);
        ([size.width, size.height], pixels.collect())
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

    /// Saves a picture of the screen with `ImageMagick`.
    pub(crate) fn picture(&self, file: &Path) {
        let taken = Command::new("import")
            .args(["-display", &self.display, "-window", "root"])
            .arg(file)
            .status();
        if !taken.is_ok_and(|status| status.success()) {
            println!("no picture: there is no `import` (Debian: apt-get install imagemagick)");
        }
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

    fn fake(&self, kind: u8, detail: u8, [x, y]: [i16; 2]) {
        self.x
            .xtest_fake_input(kind, detail, x11rb::CURRENT_TIME, self.root, x, y, 0)
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
