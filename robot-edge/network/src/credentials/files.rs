//! Files that are made once and never written over, secrets that only their owner reads.

use std::fs::{self, OpenOptions};
use std::io;
use std::io::Read as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use protocol::keys::{OperatorId, RobotId};

/// Longest file that is read; certificates, keys and lists are far shorter.
const MAX_BYTES: u64 = 1 << 20;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Readers {
    All,
    Owner,
}

pub(super) fn read(path: &Path) -> Result<String, CredentialsError> {
    let failed = |why| CredentialsError::Read {
        path: path.to_owned(),
        why,
    };
    let file = fs::File::open(path).map_err(failed)?;
    let mut text = String::new();
    let bytes = file.take(MAX_BYTES + 1).read_to_string(&mut text);
    if bytes.map_err(failed)? as u64 > MAX_BYTES {
        return Err(CredentialsError::content(
            path,
            format!("longer than {MAX_BYTES} bytes"),
        ));
    }
    Ok(text)
}

/// The text of a file that only its owner may read; one of root's, its group too, which then cannot write it.
pub(super) fn read_secret(path: &Path) -> Result<String, CredentialsError> {
    refuse_exposed(path)?;
    read(path)
}

#[cfg(unix)]
fn refuse_exposed(path: &Path) -> Result<(), CredentialsError> {
    use std::os::unix::fs::MetadataExt as _;
    let metadata = fs::metadata(path).map_err(|why| CredentialsError::Read {
        path: path.to_owned(),
        why,
    })?;
    let mode = metadata.mode() & 0o777;
    let others = if metadata.uid() == 0 { 0o037 } else { 0o077 };
    if mode & others == 0 {
        Ok(())
    } else {
        Err(CredentialsError::Exposed {
            path: path.to_owned(),
            mode,
        })
    }
}

#[cfg(not(unix))]
fn refuse_exposed(_path: &Path) -> Result<(), CredentialsError> {
    Ok(())
}

/// Makes a folder and those above it.
pub(super) fn make_folder(path: &Path, readers: Readers) -> Result<(), CredentialsError> {
    let mut builder = fs::DirBuilder::new();
    builder.recursive(true);
    restrict_folder(&mut builder, readers);
    builder.create(path).map_err(|why| CredentialsError::Write {
        path: path.to_owned(),
        why,
    })
}

/// Makes a folder that is not there yet, for its owner alone.
pub(super) fn make_new_folder(path: &Path) -> Result<(), CredentialsError> {
    let mut builder = fs::DirBuilder::new();
    restrict_folder(&mut builder, Readers::Owner);
    builder.create(path).map_err(|why| CredentialsError::Write {
        path: path.to_owned(),
        why,
    })
}

#[cfg(unix)]
fn restrict_folder(builder: &mut fs::DirBuilder, readers: Readers) {
    use std::os::unix::fs::DirBuilderExt as _;
    if readers == Readers::Owner {
        builder.mode(0o700);
    }
}

#[cfg(not(unix))]
fn restrict_folder(_builder: &mut fs::DirBuilder, _readers: Readers) {}

/// Writes a file that is not there yet. It appears with all of its text, or not at all.
pub(super) fn create(path: &Path, text: &str, readers: Readers) -> Result<(), CredentialsError> {
    let draft = write_draft(path, text, readers)?;
    // Unlike a rename, a link does not replace what somebody else has made meanwhile.
    let linked = fs::hard_link(&draft, path);
    // The draft is a second name for the same file, or for nothing.
    drop(fs::remove_file(&draft));
    linked.map_err(|why| CredentialsError::Write {
        path: path.to_owned(),
        why,
    })
}

/// Replaces a file in one step: a reader gets all of the old text, or all of the new.
pub(super) fn replace(path: &Path, text: &str, readers: Readers) -> Result<(), CredentialsError> {
    let draft = write_draft(path, text, readers)?;
    fs::rename(&draft, path).map_err(|why| CredentialsError::Write {
        path: path.to_owned(),
        why,
    })
}

fn write_draft(path: &Path, text: &str, readers: Readers) -> Result<PathBuf, CredentialsError> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let draft = path.with_file_name(format!(".{name}.{}.new", std::process::id()));
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    restrict_file(&mut options, readers);
    let write = || -> io::Result<()> {
        // What a run left that was killed between two lines.
        if let Err(why) = fs::remove_file(&draft)
            && why.kind() != io::ErrorKind::NotFound
        {
            return Err(why);
        }
        let mut file = options.open(&draft)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()
    };
    write().map_err(|why| CredentialsError::Write {
        path: path.to_owned(),
        why,
    })?;
    Ok(draft)
}

#[cfg(unix)]
fn restrict_file(options: &mut OpenOptions, readers: Readers) {
    use std::os::unix::fs::OpenOptionsExt as _;
    options.mode(match readers {
        Readers::All => 0o644,
        Readers::Owner => 0o600,
    });
}

#[cfg(not(unix))]
fn restrict_file(_options: &mut OpenOptions, _readers: Readers) {}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};

    use super::*;

    #[test]
    fn a_secret_is_its_owners_and_is_never_written_over() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key.pem");
        create(&path, "one", Readers::Owner).unwrap();
        let mode = || fs::metadata(&path).unwrap().permissions().mode() & 0o777;
        assert_eq!((read_secret(&path).unwrap(), mode()), ("one".into(), 0o600));
        let error = create(&path, "two", Readers::Owner).unwrap_err();
        assert!(error.to_string().contains("exists"), "{error}");
        assert_eq!(read(&path).unwrap(), "one");
        let is_roots = fs::metadata(&path).unwrap().uid() == 0;
        for (mode, is_good) in [(0o640, is_roots), (0o660, false), (0o604, false)] {
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
            match read_secret(&path) {
                Ok(_) => assert!(is_good, "{mode:o}"),
                Err(why) => {
                    let error = why.to_string();
                    let says = error.contains(&format!("{mode:o}")) && error.contains("chmod");
                    assert!(!is_good && says, "{error}");
                }
            }
        }
        replace(&path, "three", Readers::Owner).unwrap();
        assert_eq!(
            (read_secret(&path).unwrap(), mode()),
            ("three".into(), 0o600)
        );
        let left: Vec<_> = fs::read_dir(folder.path()).unwrap().collect();
        assert_eq!(left.len(), 1, "no draft is left: {left:?}");
    }
}

/// The authority's certificate, in every folder.
pub(super) const CA_CERTIFICATE: &str = "ca.pem";
/// The authority's key, at home.
pub(super) const CA_KEY: &str = "ca.key.pem";
/// What its owner shows when it connects or is connected to.
pub(super) const CERTIFICATE: &str = "link.pem";
/// The key of that certificate.
pub(super) const PRIVATE_KEY: &str = "link.key.pem";
/// What a person signs commands with.
pub(super) const SIGNING_KEY: &str = "signing.key.pem";
/// Who may watch or drive a vehicle.
pub(super) const OPERATORS: &str = "operators.toml";
/// All that a router needs, in one file.
pub(super) const ROUTER_CONFIG: &str = "router.json5";

/// The folder of a fleet: what stays at home, and one folder for each machine and person to take away.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FleetFolder(PathBuf);

impl FleetFolder {
    /// The fleet at `root`, which need not be there.
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self(root.into())
    }

    /// The authority: never leaves home.
    pub fn authority(&self) -> PathBuf {
        self.0.join("authority")
    }

    pub fn vehicle(&self, robot: &RobotId) -> PathBuf {
        self.vehicles_folder().join(robot.as_str())
    }

    pub fn person(&self, name: &OperatorId) -> PathBuf {
        self.0.join("people").join(name.as_str())
    }

    pub fn router(&self) -> PathBuf {
        self.0.join("router")
    }

    pub fn operators(&self, robot: &RobotId) -> PathBuf {
        self.vehicle(robot).join(OPERATORS)
    }

    pub fn router_config(&self) -> PathBuf {
        self.router().join(ROUTER_CONFIG)
    }

    /// Every vehicle of the fleet, by name.
    pub(super) fn vehicles(&self) -> Result<Vec<RobotId>, CredentialsError> {
        let folder = self.vehicles_folder();
        if !folder.exists() {
            return Ok(Vec::new());
        }
        let failed = |why| CredentialsError::Read {
            path: folder.clone(),
            why,
        };
        let mut vehicles = Vec::new();
        for entry in folder.read_dir().map_err(failed)? {
            let name = entry.map_err(failed)?.file_name();
            vehicles.extend(name.to_str().and_then(|name| name.parse().ok()));
        }
        vehicles.sort();
        Ok(vehicles)
    }

    fn vehicles_folder(&self) -> PathBuf {
        self.0.join("vehicles")
    }
}

/// The folder inside `folder` that was probably meant, if it is a whole fleet's.
pub(super) fn subfolder_hint(folder: &Path) -> Option<String> {
    let fleet = FleetFolder::new(folder);
    fleet.authority().exists().then(|| {
        format!(
            "this is a whole fleet's folder: name the one of a vehicle or a person in it, {} or {}",
            folder.join("vehicles").join("NAME").display(),
            folder.join("people").join("NAME").display()
        )
    })
}

#[derive(Debug, thiserror::Error)]
pub enum CredentialsError {
    #[error("{path}: cannot be read: {why}", path = path.display())]
    Read { path: PathBuf, why: io::Error },
    #[error("{path}: cannot be written: {why}", path = path.display())]
    Write { path: PathBuf, why: io::Error },
    #[error(
        "{path}: others than its owner may read this secret (mode {mode:03o}). `chmod 600` it; if somebody may have read \
         it, have a new one made",
        path = path.display()
    )]
    Exposed { path: PathBuf, mode: u32 },
    #[error("{path}: {why}", path = path.display())]
    Content { path: PathBuf, why: String },
    #[error("{0}")]
    Conflict(String),
    #[error("no certificate can be made: {0}")]
    Make(#[from] rcgen::Error),
    #[error("the operating system gives no random numbers: {0}")]
    NoRandomness(#[from] getrandom::Error),
}

impl CredentialsError {
    pub(super) fn content(path: impl Into<PathBuf>, why: impl Into<String>) -> Self {
        Self::Content {
            path: path.into(),
            why: why.into(),
        }
    }
}
