//! Scans on disk, from which the maps are made again after a loop was closed.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::Path;

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};
use tempfile::NamedTempFile;

use mapping::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan, ScanKind, SensorId};
use measurement::pose::{self, Pose};
use measurement::time::RobotTime;

/// A scan is kept if its sensor has moved so far since the last one, metres, …
const SPACING_M: f64 = 0.05;
/// …a cloud, which shows more, …
const CLOUD_SPACING_M: f64 = 0.25;
/// …or has turned so far, radians, …
const SPACING_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
const CLOUD_SPACING_RAD: f64 = 5.0 * std::f64::consts::PI / 180.0;
/// …or is one of so many at a place: a cell needs more than one hit.
const AT_A_PLACE: u32 = 5;
/// At this size of the file every second scan is left out, and the spacing is doubled.
const MAX_BYTES: u64 = 2_000_000_000;

/// Scans in `odom`, in the order in which they were mapped, in a file that goes with this value. Beams are accurate to micrometres.
#[derive(Debug)]
pub(super) struct KeptScans {
    file: BufWriter<NamedTempFile>,
    bytes: u64,
    count: u64,
    /// Number of the run, of those that made the map.
    session: u32,
    /// Grows when scans are left out.
    spacing: f64,
    thinned: u32,
    last: BTreeMap<SensorId, LastKept>,
    max_bytes: u64,
}

/// A file that begins with all scans that were kept at a time.
#[derive(Debug)]
pub(super) struct KeptSnapshot {
    pub(super) file: File,
    pub(super) bytes: u64,
    pub(super) count: u64,
}

#[derive(Clone, Debug)]
pub(super) struct KeptMark {
    bytes: u64,
    count: u64,
    thinned: u32,
    last: BTreeMap<SensorId, LastKept>,
}

#[derive(Clone, Copy, Debug)]
struct LastKept {
    position_m: Vector3<f64>,
    odom_from_base: Pose,
    /// Across the beams of a planar scan: it turns with a tilting sensor.
    normal: Vector3<f64>,
    here: u32,
}

#[derive(Serialize, Deserialize)]
struct Record {
    session: u32,
    stamp_ns: i64,
    sensor: u8,
    kind: u8,
    width_m: f32,
    beam_step_rad: f64,
    translation_m: [f64; 3],
    quaternion_xyzw: [f64; 4],
    own_body_hits: u32,
    beams: Vec<BeamRecord>,
}

/// In the frame of the vehicle.
#[derive(Serialize, Deserialize)]
struct BeamRecord {
    origin_m: [f32; 3],
    end_m: [f32; 3],
    index: u32,
    range_m: f32,
    is_hit: bool,
}

impl KeptScans {
    pub(super) fn new() -> io::Result<Self> {
        Ok(Self {
            file: BufWriter::new(NamedTempFile::new()?),
            bytes: 0,
            count: 0,
            session: 0,
            spacing: 1.0,
            thinned: 0,
            last: BTreeMap::new(),
            max_bytes: MAX_BYTES,
        })
    }

    /// Goes on with the scans of a file, of earlier runs.
    pub(super) fn of_file(path: &Path, count: u64, session: u32) -> io::Result<Self> {
        let mut file = NamedTempFile::new()?;
        let bytes = io::copy(&mut File::open(path)?, file.as_file_mut())?;
        Ok(Self {
            file: BufWriter::new(file),
            bytes,
            count,
            session,
            ..Self::new()?
        })
    }

    /// The scans so far, to copy them while others are added.
    pub(super) fn snapshot(&mut self) -> io::Result<KeptSnapshot> {
        self.file.flush()?;
        Ok(KeptSnapshot {
            file: self.file.get_ref().reopen()?,
            bytes: self.bytes,
            count: self.count,
        })
    }

    /// Its size.
    pub(super) const fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The scans that follow are of this run.
    pub(super) const fn begin_session(&mut self, session: u32) {
        self.session = session;
    }

    /// Scans that are kept.
    pub(super) const fn count(&self) -> u64 {
        self.count
    }

    /// How often every second scan was left out: numbers of scans are other ones then.
    pub(super) const fn thinned(&self) -> u32 {
        self.thinned
    }

    /// What a checkpoint keeps; the file itself goes on.
    pub(super) fn mark(&self) -> KeptMark {
        KeptMark {
            bytes: self.bytes,
            count: self.count,
            thinned: self.thinned,
            last: self.last.clone(),
        }
    }

    /// Forgets the scans since a mark.
    pub(super) fn go_back(&mut self, to: &KeptMark) -> io::Result<()> {
        if to.thinned != self.thinned {
            return Err(io::Error::other(
                "the scans that were kept since were thinned out; replay the recording from its beginning",
            ));
        }
        self.file.flush()?;
        let file = self.file.get_mut().as_file_mut();
        file.set_len(to.bytes)?;
        file.seek(SeekFrom::Start(to.bytes))?;
        self.bytes = to.bytes;
        self.count = to.count;
        self.last.clone_from(&to.last);
        Ok(())
    }

    /// Keeps a scan, in `odom`, unless it shows what the last one has shown.
    pub(super) fn add(&mut self, scan: &RegisteredScan) -> io::Result<()> {
        if !self.is_new(scan) {
            return Ok(());
        }
        self.write(&Record::of(scan, self.session))?;
        if self.bytes > self.max_bytes {
            self.thin()?;
        }
        Ok(())
    }

    /// The scans so far, from number `from` on, each with the number of its run.
    pub(super) fn read(
        &mut self,
        from: u64,
    ) -> io::Result<impl Iterator<Item = io::Result<(u32, RegisteredScan)>> + use<>> {
        self.file.flush()?;
        let mut file = BufReader::new(self.file.get_ref().reopen()?);
        for _ in 0..from {
            skip_record(&mut file)?;
        }
        let left = self.count.saturating_sub(from);
        Ok((0..left).map(move |_| read_record(&mut file)?.scan()))
    }

    /// Forgets all.
    pub(super) fn clear(&mut self) -> io::Result<()> {
        *self = Self {
            max_bytes: self.max_bytes,
            ..Self::new()?
        };
        Ok(())
    }

    fn write(&mut self, record: &Record) -> io::Result<()> {
        let bytes = postcard::to_stdvec(record).map_err(io::Error::other)?;
        let length = u32::try_from(bytes.len()).map_err(io::Error::other)?;
        self.file.write_all(&length.to_le_bytes())?;
        self.file.write_all(&bytes)?;
        self.bytes += 4 + u64::from(length);
        self.count += 1;
        Ok(())
    }

    fn is_new(&mut self, scan: &RegisteredScan) -> bool {
        let Some(first) = scan.beams.first() else {
            return false;
        };
        let middle = &scan.beams[scan.beams.len() / 2];
        let [a, b] = [first, middle].map(|beam| beam.end_in_odom - beam.origin_in_odom);
        let now = LastKept {
            position_m: first.origin_in_odom.coords,
            odom_from_base: scan.odom_from_base,
            normal: a.cross(&b).try_normalize(1e-9).unwrap_or_default(),
            here: 1,
        };
        let (spacing_m, spacing_rad) = match scan.kind {
            ScanKind::Cloud => (CLOUD_SPACING_M, CLOUD_SPACING_RAD),
            ScanKind::Beams | ScanKind::Arc | ScanKind::Contact { .. } => (SPACING_M, SPACING_RAD),
        };
        let Some(last) = self.last.get_mut(&scan.sensor) else {
            self.last.insert(scan.sensor, now);
            return true;
        };
        let moved_m = (now.position_m - last.position_m).norm();
        let turned = now
            .odom_from_base
            .rotation
            .angle_to(&last.odom_from_base.rotation);
        let tilted = libm::asin(now.normal.cross(&last.normal).norm().min(1.0));
        let is_cloud = scan.kind == ScanKind::Cloud;
        let turned_rad = if is_cloud { turned } else { turned.max(tilted) };
        if moved_m >= self.spacing * spacing_m || turned_rad >= self.spacing * spacing_rad {
            *last = now;
            return true;
        }
        last.here += 1;
        last.here <= AT_A_PLACE
    }

    fn thin(&mut self) -> io::Result<()> {
        let mut thinned = Self {
            spacing: 2.0 * self.spacing,
            thinned: self.thinned + 1,
            last: self.last.clone(),
            max_bytes: self.max_bytes,
            session: self.session,
            ..Self::new()?
        };
        self.file.flush()?;
        let mut file = BufReader::new(self.file.get_ref().reopen()?);
        for number in 0..self.count {
            if number % 2 == 0 {
                skip_record(&mut file)?;
            } else {
                thinned.write(&read_record(&mut file)?)?;
            }
        }
        *self = thinned;
        Ok(())
    }
}

fn record_length(file: &mut BufReader<File>) -> io::Result<u32> {
    let mut length = [0; 4];
    file.read_exact(&mut length)?;
    Ok(u32::from_le_bytes(length))
}

fn skip_record(file: &mut BufReader<File>) -> io::Result<()> {
    let length = record_length(file)?;
    file.seek_relative(length.into())
}

fn read_record(file: &mut BufReader<File>) -> io::Result<Record> {
    let mut bytes = vec![0; record_length(file)? as usize];
    file.read_exact(&mut bytes)?;
    postcard::from_bytes(&bytes).map_err(io::Error::other)
}

impl Record {
    fn of(scan: &RegisteredScan, session: u32) -> Self {
        let base_from_odom = scan.odom_from_base.inverse();
        let near = |point: &Point3<f64>| (base_from_odom * point).coords.map(|m| m as f32).into();
        let beams = scan.beams.iter().map(|beam| BeamRecord {
            origin_m: near(&beam.origin_in_odom),
            end_m: near(&beam.end_in_odom),
            index: beam.index,
            range_m: beam.range_m,
            is_hit: beam.outcome == BeamOutcome::Hit,
        });
        let (kind, width_m) = match scan.kind {
            ScanKind::Beams => (0, 0.0),
            ScanKind::Cloud => (1, 0.0),
            ScanKind::Arc => (2, 0.0),
            ScanKind::Contact { width_m } => (3, width_m),
        };
        let q = scan.odom_from_base.rotation.quaternion();
        Self {
            session,
            stamp_ns: scan.stamp.as_nanos(),
            sensor: scan.sensor.0,
            kind,
            width_m,
            beam_step_rad: scan.beam_step_rad,
            translation_m: scan.odom_from_base.translation.vector.into(),
            quaternion_xyzw: [q.i, q.j, q.k, q.w],
            own_body_hits: scan.own_body_hits,
            beams: beams.collect(),
        }
    }

    /// With the number of its run.
    fn scan(self) -> io::Result<(u32, RegisteredScan)> {
        let odom_from_base = pose::from_parts(self.translation_m, self.quaternion_xyzw)
            .ok_or_else(|| io::Error::other("a kept scan has no pose"))?;
        let far = |point: [f32; 3]| odom_from_base * Point3::from(point.map(f64::from));
        let beams = self.beams.iter().map(|beam| RegisteredBeam {
            origin_in_odom: far(beam.origin_m),
            end_in_odom: far(beam.end_m),
            outcome: if beam.is_hit {
                BeamOutcome::Hit
            } else {
                BeamOutcome::Miss
            },
            index: beam.index,
            range_m: beam.range_m,
        });
        let scan = RegisteredScan {
            stamp: RobotTime::from_nanos(self.stamp_ns),
            sensor: SensorId(self.sensor),
            kind: match self.kind {
                0 => ScanKind::Beams,
                1 => ScanKind::Cloud,
                2 => ScanKind::Arc,
                _ => ScanKind::Contact {
                    width_m: self.width_m,
                },
            },
            beam_step_rad: self.beam_step_rad,
            odom_from_base,
            own_body_hits: self.own_body_hits,
            beams: beams.collect(),
        };
        Ok((self.session, scan))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use measurement::pose::planar;

    /// Of a vehicle at this place, with two beams.
    fn scan(stamp_ns: i64, x_m: f64, yaw_rad: f64) -> RegisteredScan {
        let odom_from_base = planar(x_m, -3.0, yaw_rad);
        let beam = |index: u32, y_m: f64, outcome| RegisteredBeam {
            origin_in_odom: odom_from_base * Point3::new(0.2, 0.0, 0.4),
            end_in_odom: odom_from_base * Point3::new(8.0, y_m, 0.4),
            outcome,
            index,
            range_m: 7.8,
        };
        RegisteredScan {
            stamp: RobotTime::from_nanos(stamp_ns),
            sensor: SensorId(1),
            kind: ScanKind::Beams,
            beam_step_rad: 0.01,
            odom_from_base,
            own_body_hits: 3,
            beams: vec![
                beam(4, 1.0, BeamOutcome::Hit),
                beam(9, -1.0, BeamOutcome::Miss),
            ],
        }
    }

    fn stamps(kept: &mut KeptScans, from: u64) -> Vec<i64> {
        let scans = kept.read(from).unwrap();
        scans.map(|scan| scan.unwrap().1.stamp.as_nanos()).collect()
    }

    #[test]
    fn what_is_read_is_what_was_kept() {
        let mut kept = KeptScans::new().unwrap();
        let scan = scan(7, 1234.5, 2.0);
        kept.add(&scan).unwrap();
        let (session, read) = kept.read(0).unwrap().next().unwrap().unwrap();
        assert_eq!(session, 0);
        for (read, beam) in read.beams.iter().zip(&scan.beams) {
            assert!((read.end_in_odom - beam.end_in_odom).norm() < 2e-6);
            assert!((read.origin_in_odom - beam.origin_in_odom).norm() < 2e-6);
        }
        let rounded = |scan: &RegisteredScan| RegisteredScan {
            beams: scan
                .beams
                .iter()
                .map(|beam| RegisteredBeam {
                    origin_in_odom: Point3::origin(),
                    end_in_odom: Point3::origin(),
                    ..*beam
                })
                .collect(),
            ..scan.clone()
        };
        assert_eq!(rounded(&read), rounded(&scan));
    }

    #[test]
    fn a_vehicle_that_stands_keeps_a_few_scans() {
        let mut kept = KeptScans::new().unwrap();
        for stamp_ns in 0..20 {
            kept.add(&scan(stamp_ns, 0.0, 0.0)).unwrap();
        }
        kept.add(&scan(20, 0.06, 0.0)).unwrap();
        kept.add(&scan(21, 0.06, 0.01)).unwrap();
        assert_eq!(stamps(&mut kept, 0), [0, 1, 2, 3, 4, 20, 21]);
        assert_eq!(stamps(&mut kept, 5), [20, 21]);
    }

    #[test]
    fn of_too_many_scans_every_second_is_left_out() {
        let mut kept = KeptScans::new().unwrap();
        kept.max_bytes = 2000;
        for stamp_ns in 0..100 {
            kept.add(&scan(stamp_ns, 0.1 * stamp_ns as f64, 0.0))
                .unwrap();
        }
        assert!(kept.bytes <= 2000 && kept.thinned() > 0);
        let stamps = stamps(&mut kept, 0);
        assert!(stamps.len() as u64 == kept.count() && stamps.is_sorted());
        assert!(
            stamps[0] < 50 && stamps[stamps.len() - 1] > 80,
            "{stamps:?}"
        );
    }

    #[test]
    fn what_came_after_a_mark_is_forgotten() {
        let mut kept = KeptScans::new().unwrap();
        kept.add(&scan(0, 0.0, 0.0)).unwrap();
        let mark = kept.mark();
        kept.add(&scan(1, 1.0, 0.0)).unwrap();
        kept.go_back(&mark).unwrap();
        kept.add(&scan(2, 1.0, 0.0)).unwrap();
        assert_eq!(stamps(&mut kept, 0), [0, 2]);
    }
}
