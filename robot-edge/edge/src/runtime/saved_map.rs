//! A map of matched scans in a folder, to go on in: `map.bin`, poses and submaps, and `scans.bin`, the kept scans.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Read, Write as _};
use std::path::Path;

use anyhow::{Context as _, bail};
use serde::{Deserialize, Serialize};

use super::kept_scans::{KeptScans, KeptSnapshot};
use crate::exit::UsageError;
use localization::scan_localization::{Keyframe, SavedMap};
use localization::scan_matching::pose_graph::Edge;
use localization::scan_matching::position_fixes::PositionFix;
use localization::scan_matching::slam_map::SlamMapParts;
use nalgebra::{Isometry2, Matrix3, Point2};
use protocol::geodesy::GeodeticPoint;

const MAP: &str = "map.bin";
const SCANS: &str = "scans.bin";
/// With the version of the format.
const MAGIC: &[u8; 8] = b"FSMAP\x00\x00\x03";

/// What is in `map.bin` behind its magic and checksum.
#[derive(Serialize, Deserialize)]
struct Contents {
    keyframes: Vec<FileKeyframe>,
    edges: Vec<FileEdge>,
    submaps: Vec<(u32, u32, Vec<[f32; 8]>)>,
    drifts: Vec<BTreeMap<u32, (f64, f64)>>,
    fixes: Vec<FileFix>,
    /// Latitude and longitude, degrees, and height above the ellipsoid, metres.
    datum: Option<[f64; 3]>,
    /// Of the kept scans.
    scans: u64,
    bytes: u64,
    crc32: u32,
}

#[derive(Serialize, Deserialize)]
struct FileKeyframe {
    session: u32,
    stamp_ns: i64,
    odom_from_keyframe: Isometry2<f64>,
    map_from_keyframe: Isometry2<f64>,
}

#[derive(Serialize, Deserialize)]
struct FileEdge {
    from: u32,
    to: u32,
    from_from_to: Isometry2<f64>,
    information: Matrix3<f64>,
    is_closure: bool,
}

#[derive(Serialize, Deserialize)]
struct FileFix {
    keyframe: u32,
    keyframe_from_antenna: Point2<f64>,
    antenna: Point2<f64>,
    sigma_m: f64,
    is_aligned: bool,
}

impl Contents {
    fn of(map: &SavedMap, scans: u64, bytes: u64, crc32: u32) -> Self {
        let (keyframes, parts) = map.to_parts();
        let keyframe = |(keyframe, map_from_keyframe): (Keyframe, _)| FileKeyframe {
            session: keyframe.session,
            stamp_ns: keyframe.stamp_ns,
            odom_from_keyframe: keyframe.odom_from_keyframe,
            map_from_keyframe,
        };
        let edge = |edge: Edge| FileEdge {
            from: edge.from,
            to: edge.to,
            from_from_to: edge.from_from_to,
            information: edge.information,
            is_closure: edge.is_closure,
        };
        let fix = |fix: PositionFix| FileFix {
            keyframe: fix.keyframe,
            keyframe_from_antenna: fix.keyframe_from_antenna,
            antenna: fix.antenna,
            sigma_m: fix.sigma_m,
            is_aligned: fix.is_aligned,
        };
        Self {
            keyframes: keyframes.into_iter().map(keyframe).collect(),
            edges: parts.edges.into_iter().map(edge).collect(),
            submaps: parts.submaps,
            drifts: parts.drifts,
            fixes: parts.fixes.into_iter().map(fix).collect(),
            datum: map
                .datum()
                .map(|datum| [datum.latitude_deg, datum.longitude_deg, datum.altitude_m]),
            scans,
            bytes,
            crc32,
        }
    }

    fn map(self) -> Option<SavedMap> {
        let keyframe = |file: FileKeyframe| {
            let keyframe = Keyframe {
                session: file.session,
                stamp_ns: file.stamp_ns,
                odom_from_keyframe: file.odom_from_keyframe,
            };
            (keyframe, file.map_from_keyframe)
        };
        let edge = |file: FileEdge| Edge {
            from: file.from,
            to: file.to,
            from_from_to: file.from_from_to,
            information: file.information,
            is_closure: file.is_closure,
        };
        let fix = |file: FileFix| PositionFix {
            keyframe: file.keyframe,
            keyframe_from_antenna: file.keyframe_from_antenna,
            antenna: file.antenna,
            sigma_m: file.sigma_m,
            is_aligned: file.is_aligned,
        };
        let parts = SlamMapParts {
            edges: self.edges.into_iter().map(edge).collect(),
            submaps: self.submaps,
            drifts: self.drifts,
            fixes: self.fixes.into_iter().map(fix).collect(),
        };
        let datum = self
            .datum
            .map(|[latitude_deg, longitude_deg, altitude_m]| GeodeticPoint {
                latitude_deg,
                longitude_deg,
                altitude_m,
            });
        let keyframes = self.keyframes.into_iter().map(keyframe).collect();
        SavedMap::from_parts(keyframes, parts, datum)
    }
}

/// Writes the map to a new folder, which is there only when it is whole.
pub(super) fn save(folder: &Path, map: &SavedMap, kept: KeptSnapshot) -> anyhow::Result<()> {
    refuse_existing(folder)?;
    let name = folder
        .file_name()
        .context("the folder of a map needs a name")?;
    let temporary = folder.with_file_name(format!(".{}.tmp", name.display()));
    // Of a run that was cut off.
    if temporary.exists() {
        fs::remove_dir_all(&temporary)?;
    }
    fs::create_dir_all(&temporary)?;
    let scans = temporary.join(SCANS);
    let mut copy = File::create(&scans)?;
    if io::copy(&mut kept.file.take(kept.bytes), &mut copy)? != kept.bytes {
        bail!("its scans are not there any more");
    }
    copy.sync_all()?;
    let contents = Contents::of(map, kept.count, kept.bytes, checksum(&scans)?.0);
    let body = postcard::to_stdvec(&contents)?;
    let mut file = File::create(temporary.join(MAP))?;
    file.write_all(MAGIC)?;
    file.write_all(&crc32fast::hash(&body).to_le_bytes())?;
    file.write_all(&body)?;
    file.sync_all()?;
    Ok(fs::rename(&temporary, folder)?)
}

/// A map is never written over.
pub(super) fn refuse_existing(folder: &Path) -> Result<(), UsageError> {
    match folder.symlink_metadata() {
        Ok(_) => Err(UsageError(format!(
            "{}: exists already and is not written over: give the map another name",
            folder.display()
        ))),
        Err(_) => Ok(()),
    }
}

/// Reads a map, and its scans into a file of this process.
pub(super) fn load(folder: &Path) -> anyhow::Result<(SavedMap, KeptScans)> {
    let path = folder.join(MAP);
    let bytes = fs::read(&path).map_err(|error| {
        UsageError(format!(
            "{}: no map can be read here: {error}",
            path.display()
        ))
    })?;
    let contents =
        parse(&bytes).with_context(|| format!("{}: this is no map, or damaged", path.display()));
    let (map, (count, length, crc32)) =
        contents.map_err(|error| UsageError(format!("{error:#}")))?;
    let scans = folder.join(SCANS);
    let found = checksum(&scans)
        .map_err(|error| UsageError(format!("{}: cannot be read: {error}", scans.display())))?;
    if found != (crc32, length) {
        return Err(UsageError(format!(
            "{}: the scans are not those of the map: {} bytes of {}",
            scans.display(),
            found.1,
            length
        ))
        .into());
    }
    let kept = KeptScans::of_file(&scans, count, map.sessions())
        .with_context(|| format!("{}: cannot be copied", scans.display()))?;
    Ok((map, kept))
}

/// The map; number, bytes and checksum of its scans.
fn parse(bytes: &[u8]) -> anyhow::Result<(SavedMap, (u64, u64, u32))> {
    let Some((sum, body)) = bytes
        .strip_prefix(MAGIC)
        .and_then(|rest| rest.split_first_chunk::<4>())
    else {
        bail!("it does not begin as a map of this version");
    };
    if crc32fast::hash(body) != u32::from_le_bytes(*sum) {
        bail!("its checksum is wrong");
    }
    let contents: Contents = postcard::from_bytes(body)?;
    let of_scans = (contents.scans, contents.bytes, contents.crc32);
    let map = contents.map().context("its parts do not fit together")?;
    Ok((map, of_scans))
}

/// CRC-32 and length of a file.
fn checksum(path: &Path) -> io::Result<(u32, u64)> {
    let mut file = File::open(path)?;
    let (mut hasher, mut bytes) = (crc32fast::Hasher::new(), 0);
    let mut buffer = vec![0; 1 << 16];
    loop {
        let read = file.read(&mut buffer)?;
        if read == 0 {
            return Ok((hasher.finalize(), bytes));
        }
        hasher.update(&buffer[..read]);
        bytes += read as u64;
    }
}
