//! Stores the emergency stop on disk from a thread of its own, so that the loop never waits for the disk.

use std::fs::{File, OpenOptions};
use std::io;
use std::io::Read as _;
use std::io::Seek as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::{self, JoinHandle};

use teleop::{EStopId, StoredEStop};

/// Greatest number of waiting requests. The arbiter repeats those that found no room.
const CAPACITY: usize = 8;

/// The teleop loop's handle of the thread that stores the emergency stop.
#[derive(Debug)]
pub struct EStopStore {
    previous: StoredEStop,
    requests: Option<SyncSender<Option<EStopId>>>,
    stored: Receiver<Option<EStopId>>,
    /// Clearing was requested but not accepted yet.
    clear_pending: bool,
    thread: Option<JoinHandle<()>>,
}

impl EStopStore {
    /// Reads what the previous run left, and starts the thread.
    pub fn start(mut file: EStopFile) -> io::Result<Self> {
        let previous = file.read();
        let (requests, requested) = sync_channel(CAPACITY);
        let (done, stored) = sync_channel(CAPACITY);
        let thread = thread::Builder::new()
            .name("estop-store".to_owned())
            .spawn(move || run(&mut file, &requested, &done))?;
        Ok(Self {
            previous,
            requests: Some(requests),
            stored,
            clear_pending: false,
            thread: Some(thread),
        })
    }

    /// What the previous run left.
    pub(super) const fn previous(&self) -> StoredEStop {
        self.previous
    }

    pub(super) fn store(&mut self, id: EStopId) {
        // The arbiter repeats it until it is stored.
        let _is_on_its_way = self.submit(Some(id));
        self.clear_pending = false;
    }

    pub(super) fn clear(&mut self) {
        self.clear_pending = !self.submit(None);
    }

    /// Emergency stops that were stored since the last call.
    pub(super) fn take_stored(&mut self) -> Option<EStopId> {
        if self.clear_pending {
            self.clear();
        }
        self.stored.try_iter().flatten().last()
    }

    fn submit(&self, estop: Option<EStopId>) -> bool {
        match self
            .requests
            .as_ref()
            .map(|requests| requests.try_send(estop))
        {
            Some(Ok(())) => true,
            Some(Err(TrySendError::Full(_) | TrySendError::Disconnected(_))) | None => false,
        }
    }
}

impl Drop for EStopStore {
    fn drop(&mut self) {
        self.requests = None;
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread that keeps the emergency stop failed");
        }
    }
}

fn run(
    file: &mut EStopFile,
    requested: &Receiver<Option<EStopId>>,
    done: &SyncSender<Option<EStopId>>,
) {
    while let Ok(estop) = requested.recv() {
        match file.write(estop) {
            // Fails only if the loop has ended.
            Ok(()) => drop(done.try_send(estop)),
            Err(error) => tracing::error!(
                path = %file.path().display(),
                %error,
                "the emergency stop cannot be stored; it holds, and is not acknowledged"
            ),
        }
    }
}

const NAME: &str = "estop";
const BYTES: usize = 38;

/// A file that says which emergency stop is active, if one is.
///
/// It always has the same length and is written in place: on a full disk an emergency stop is still stored (on file
/// systems that write in place). What is half written or damaged reads as an emergency stop.
#[derive(Debug)]
pub struct EStopFile {
    file: File,
    path: PathBuf,
}

impl EStopFile {
    /// Opens the file of a directory; where there is none it is made, and says that no emergency stop is active.
    pub fn open(dir: &Path) -> io::Result<Self> {
        std::fs::create_dir_all(dir)?;
        let path = dir.join(NAME);
        let is_new = !path.try_exists()?;
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(&path)?;
        let mut estop = Self { file, path };
        if is_new {
            estop.write(None)?;
            File::open(dir)?.sync_all()?;
        }
        Ok(estop)
    }

    /// What was in force when it was last written.
    pub fn read(&mut self) -> StoredEStop {
        let mut bytes = Vec::with_capacity(BYTES + 1);
        let read = self
            .file
            .rewind()
            .and_then(|()| (&self.file).take(BYTES as u64 + 1).read_to_end(&mut bytes));
        match read {
            Ok(_) => parse(&bytes),
            Err(error) => {
                tracing::error!(path = %self.path.display(), %error, "cannot be read");
                StoredEStop::Unreadable
            }
        }
    }

    /// Says which emergency stop is active, and returns when it is on the disk.
    pub fn write(&mut self, estop: Option<EStopId>) -> io::Result<()> {
        self.file.rewind()?;
        self.file.write_all(content(estop).as_bytes())?;
        self.file.sync_data()
    }

    pub fn path(&self) -> &Path {
        &self.path
    }
}

fn content(estop: Option<EStopId>) -> String {
    let record = match estop {
        None => format!("{:<8}{:020}", "none", 0),
        Some(EStopId(id)) => format!("{:<8}{id:020}", "latched"),
    };
    let check = crc32fast::hash(record.as_bytes());
    format!("{record} {check:08x}\n")
}

fn parse(bytes: &[u8]) -> StoredEStop {
    let id = std::str::from_utf8(bytes).ok().and_then(|text| {
        let id = text.get(8..28)?.parse().ok()?;
        (text == content(None) || text == content(Some(EStopId(id)))).then_some((text, id))
    });
    match id {
        Some((text, _)) if text.starts_with("none") => StoredEStop::None,
        Some((_, id)) => StoredEStop::Latched(EStopId(id)),
        None => StoredEStop::Unreadable,
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn what_is_stored_is_found_by_the_next_run() {
        let dir = tempfile::tempdir().unwrap();
        let start = || EStopStore::start(EStopFile::open(dir.path()).unwrap()).unwrap();
        let mut estop_store = start();
        assert_eq!(estop_store.previous(), StoredEStop::None);
        estop_store.store(EStopId(3));
        let mut stored = None;
        while stored.is_none() {
            stored = estop_store.take_stored();
            thread::sleep(Duration::from_millis(1));
        }
        assert_eq!(stored, Some(EStopId(3)));
        assert_eq!(start().previous(), StoredEStop::Latched(EStopId(3)));
        estop_store.clear();
        drop(estop_store);
        assert_eq!(start().previous(), StoredEStop::None);
    }

    #[test]
    fn clearing_is_repeated_until_there_is_room() {
        let dir = tempfile::tempdir().unwrap();
        let (requests, requested) = sync_channel(1);
        let (done, stored) = sync_channel(1);
        let mut estop_store = EStopStore {
            previous: StoredEStop::None,
            requests: Some(requests),
            stored,
            clear_pending: false,
            thread: None,
        };
        estop_store.store(EStopId(1));
        estop_store.clear();
        assert!(estop_store.clear_pending, "no room yet");
        let mut file = EStopFile::open(dir.path()).unwrap();
        file.write(requested.recv().unwrap()).unwrap();
        assert_eq!(estop_store.take_stored(), None);
        assert!(!estop_store.clear_pending);
        drop(estop_store);
        run(&mut file, &requested, &done);
        assert_eq!(file.read(), StoredEStop::None);
    }

    #[test]
    fn a_damaged_file_counts_as_an_emergency_stop() {
        let dir = tempfile::tempdir().unwrap();
        let dir = dir.path().join("state/scout");
        let read = || EStopFile::open(&dir).unwrap().read();
        assert_eq!(read(), StoredEStop::None);
        let mut file = EStopFile::open(&dir).unwrap();
        for id in [7, u64::MAX, 0] {
            file.write(Some(EStopId(id))).unwrap();
            assert_eq!(read(), StoredEStop::Latched(EStopId(id)));
        }
        let path = file.path().to_owned();
        let whole = std::fs::read(&path).unwrap();
        assert_eq!(whole.len(), BYTES);
        for at in 0..BYTES {
            let mut damaged = whole.clone();
            damaged[at] ^= 1;
            std::fs::write(&path, &damaged).unwrap();
            assert_eq!(read(), StoredEStop::Unreadable, "{at}");
            std::fs::write(&path, &whole[..at]).unwrap();
            assert_eq!(read(), StoredEStop::Unreadable, "cut at {at}");
        }
        std::fs::write(&path, [&whole[..], b"x"].concat()).unwrap();
        assert_eq!(read(), StoredEStop::Unreadable, "longer");
        std::fs::write(&path, &whole).unwrap();
        file.write(None).unwrap();
        assert_eq!(read(), StoredEStop::None);
    }

    #[test]
    fn a_directory_that_cannot_be_made_is_an_error() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("file");
        std::fs::write(&file, "").unwrap();
        assert!(EStopFile::open(&file.join("state")).is_err());
    }
}
