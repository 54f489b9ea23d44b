//! `robot-edge install-keys`: puts a vehicle's keys where it reads them, whole, in the place of those that are there.
//!
//! The new folder is made beside the old one, and the two are exchanged in one step: a reader finds all of the old
//! keys or all of the new ones. A run that was cut off leaves at most a folder beside them, which the next run removes.

use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use protocol::keys::RobotId;
use protocol::signed::SecretKey;
use zeroize::Zeroizing;

use crate::clock;
use crate::credentials::files::{
    self, CA_CERTIFICATE, CERTIFICATE, OPERATORS, PRIVATE_KEY, Readers, SIGNING_KEY, subfolder_hint,
};
use crate::credentials::{Certificate, CredentialsError, Identity, OperatorList, authority};

const FILES: [&str; 4] = [CA_CERTIFICATE, CERTIFICATE, PRIVATE_KEY, OPERATORS];

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Installed {
    /// Whose keys they are.
    pub robot: RobotId,
    /// How many people are on its list.
    pub people: usize,
    /// What the owner should know of its certificate's time, if anything.
    pub warning: Option<String>,
}

/// Puts a copy of the vehicle's folder `from` at `to`, where nothing is or the same vehicle's keys are, which are
/// removed.
///
/// By root, the files are root's, and those of the group may read them that the folder above `to` has; by anybody else,
/// nobody but them may.
pub fn install(from: &Path, to: &Path) -> Result<Installed, CredentialsError> {
    let (credentials, robot, list) = Credentials::of_vehicle(from, None)?;
    let to = resolved(to)?;
    let parent = match to.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
        Some(_) | None => PathBuf::from("."),
    };
    check_replaceable(from, &to, &robot)?;
    let wrote = |path: &Path| {
        let path = path.to_owned();
        move |why| CredentialsError::Write { path, why }
    };
    // Two runs at once would share the draft.
    let above = File::open(&parent).map_err(wrote(&parent))?;
    above.lock().map_err(wrote(&parent))?;
    let name = to.file_name().unwrap_or_default().to_string_lossy();
    let [draft, aside] = ["new", "old"].map(|end| to.with_file_name(format!(".{name}.{end}")));
    remove(&draft).map_err(wrote(&draft))?;
    let exchanged = make(from, &draft, &above).and_then(|()| {
        // As it was read, not as it is: `from` may have changed meanwhile.
        Credentials::of_vehicle(&draft, Some(&robot))?;
        exchange(&draft, &to, &aside).map_err(wrote(&to))?;
        above.sync_all().map_err(wrote(&parent))
    });
    // What was there before; the new keys where they could not be put in its place.
    for left in [&draft, &aside] {
        remove(left).map_err(wrote(left))?;
    }
    exchanged?;
    Ok(Installed {
        robot,
        people: list.people().len(),
        warning: credentials.warning(),
    })
}

/// Where `path` leads, if it is there.
fn resolved(path: &Path) -> Result<PathBuf, CredentialsError> {
    match fs::canonicalize(path) {
        Ok(real) => Ok(real),
        Err(why) if why.kind() == ErrorKind::NotFound && path.file_name().is_some() => {
            Ok(path.to_owned())
        }
        Err(why) => Err(CredentialsError::Read {
            path: path.to_owned(),
            why,
        }),
    }
}

/// Fails unless `to` is absent, empty, or keys of the same vehicle, good or bad: it is going to be removed.
fn check_replaceable(from: &Path, to: &Path, robot: &RobotId) -> Result<(), CredentialsError> {
    let refused = |why: String| Err(CredentialsError::content(to, why));
    let unreadable = |why| CredentialsError::Read {
        path: to.to_owned(),
        why,
    };
    let mut entries = match fs::read_dir(to) {
        Ok(entries) => entries,
        Err(why) if why.kind() == ErrorKind::NotFound => return Ok(()),
        Err(why) => return Err(unreadable(why)),
    };
    let source = fs::canonicalize(from).map_err(unreadable)?;
    if source.starts_with(to) {
        return refused(format!(
            "{} is in it, and it is going to be removed",
            from.display()
        ));
    }
    if entries.next().is_some() && !to.join(CERTIFICATE).exists() {
        return refused(format!(
            "this is no folder of keys, without {CERTIFICATE}, and it would be removed: name another"
        ));
    }
    if let Ok(there) = Credentials::open(to)
        && *there.identity() != Identity::Vehicle(robot.clone())
    {
        return refused(format!(
            "these are the keys of {}, and those of {robot} are to be installed: remove this folder first if that is meant",
            there.identity()
        ));
    }
    Ok(())
}

fn make(from: &Path, draft: &Path, above: &File) -> Result<(), CredentialsError> {
    files::make_new_folder(draft)?;
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |why| CredentialsError::Write { path, why }
    };
    for name in FILES {
        let text = zeroize::Zeroizing::new(files::read(&from.join(name))?);
        let path = draft.join(name);
        files::create(&path, &text, Readers::Owner)?;
        let file = File::open(&path).map_err(failed(&path))?;
        give_to_group(&file, 0o640, above)
            .and_then(|()| file.sync_all())
            .map_err(failed(&path))?;
    }
    let folder = File::open(draft).map_err(failed(draft))?;
    give_to_group(&folder, 0o750, above)
        .and_then(|()| folder.sync_all())
        .map_err(failed(draft))
}

/// As root: lets the group of `above` read, as in a recipe by which /etc/foreshore is root's and the service's group's.
#[cfg(unix)]
fn give_to_group(file: &File, mode: u32, above: &File) -> io::Result<()> {
    use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, fchown};
    // Of a file that was just made, the owner is who runs this.
    if file.metadata()?.uid() != 0 {
        return Ok(());
    }
    fchown(file, None, Some(above.metadata()?.gid()))?;
    file.set_permissions(fs::Permissions::from_mode(mode))
}

#[cfg(not(unix))]
fn give_to_group(_file: &File, _mode: u32, _above: &File) -> io::Result<()> {
    Ok(())
}

/// Puts `draft` at `to`, and what was there at `draft` or `aside`.
fn exchange(draft: &Path, to: &Path, aside: &Path) -> io::Result<()> {
    if !to.exists() {
        return fs::rename(draft, to);
    }
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::{CWD, RenameFlags, renameat_with};
        use rustix::io::Errno;
        match renameat_with(CWD, draft, CWD, to, RenameFlags::EXCHANGE) {
            Ok(()) => return Ok(()),
            // The file system cannot.
            Err(Errno::INVAL | Errno::NOSYS | Errno::OPNOTSUPP) => {}
            Err(why) => return Err(why.into()),
        }
    }
    exchange_in_steps(draft, to, aside)
}

/// The same where the file system has no exchange. Cut off between the two, it leaves nothing at `to`: then no vehicle
/// starts until this is run again.
fn exchange_in_steps(draft: &Path, to: &Path, aside: &Path) -> io::Result<()> {
    remove(aside)?;
    fs::rename(to, aside)?;
    fs::rename(draft, to).inspect_err(|_why| drop(fs::rename(aside, to)))
}

/// Removes a folder with all that is in it, if it is there.
fn remove(folder: &Path) -> io::Result<()> {
    match fs::remove_dir_all(folder) {
        Err(why) if why.kind() != ErrorKind::NotFound => Err(why),
        Ok(()) | Err(_) => Ok(()),
    }
}

/// Who this program is on the network, and whom it believes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Credentials {
    folder: PathBuf,
    certificate: Certificate,
}

impl Credentials {
    /// Reads a vehicle's or person's folder.
    pub fn open(folder: &Path) -> Result<Self, CredentialsError> {
        if !folder.exists() {
            return Err(CredentialsError::content(folder, "there is no such folder"));
        }
        let [ca, link, key] =
            [CA_CERTIFICATE, CERTIFICATE, PRIVATE_KEY].map(|name| folder.join(name));
        if !link.exists()
            && let Some(why) = subfolder_hint(folder)
        {
            return Err(CredentialsError::content(folder, why));
        }
        let certificate = Certificate::read(&link, &ca)?;
        let key_pair = authority::key_pair(&key)?;
        if rcgen::PublicKeyData::subject_public_key_info(&key_pair) != certificate.public_key() {
            return Err(CredentialsError::content(
                &key,
                "not the key of link.pem beside it",
            ));
        }
        Ok(Self {
            folder: folder.to_owned(),
            certificate,
        })
    }

    /// The credentials of a vehicle that goes by the name of `robot`, or by any where that is `None`.
    pub fn of_vehicle(
        folder: &Path,
        robot: Option<&RobotId>,
    ) -> Result<(Self, RobotId, OperatorList), CredentialsError> {
        let own = Self::open(folder)?;
        let Identity::Vehicle(name) = own.identity().clone() else {
            return Err(CredentialsError::content(
                folder,
                format!("these are the keys of {}, not of a vehicle", own.identity()),
            ));
        };
        if let Some(robot) = robot.filter(|robot| **robot != name) {
            return Err(CredentialsError::content(
                folder,
                format!("these are the keys of {name}, and --robot says {robot}"),
            ));
        }
        let list = OperatorList::read(&own.operator_list())?;
        Ok((own, name, list))
    }

    pub const fn identity(&self) -> &Identity {
        self.certificate.identity()
    }

    /// What the owner should know about its certificate's time, if anything.
    pub fn warning(&self) -> Option<String> {
        let now_s = i64::try_from(clock::seconds_since_1970()).unwrap_or(i64::MAX);
        self.certificate.warning(now_s)
    }

    /// What a person signs commands with.
    pub fn signing_key(&self) -> Result<SecretKey, CredentialsError> {
        let path = self.folder.join(SIGNING_KEY);
        let pem = Zeroizing::new(files::read_secret(&path)?);
        SecretKey::from_pem(&pem).map_err(|why| CredentialsError::content(path, why.to_string()))
    }

    pub fn operator_list(&self) -> PathBuf {
        self.folder.join(OPERATORS)
    }

    /// The certificate of the authority that it believes.
    pub fn ca_certificate(&self) -> PathBuf {
        self.folder.join(CA_CERTIFICATE)
    }

    pub fn link_certificate(&self) -> PathBuf {
        self.folder.join(CERTIFICATE)
    }

    pub fn link_key(&self) -> PathBuf {
        self.folder.join(PRIVATE_KEY)
    }
}

#[cfg(test)]
#[cfg(unix)]
mod tests;
