//! Exports of a map, part by part, so that progress can be shown and the export can be cancelled.

use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::{fmt, io};

use anyhow::{Context as _, anyhow};
use protocol::export::{
    Caption, Footprint, Label, StampedPose, export_raster, shore_labels, write_path, write_shores,
    write_trajectory,
};
use protocol::layer::LayerId;
use protocol::message::{Datum, Shores, VoxelFile};
use protocol::mosaic::{KnownTiles, MAX_RASTER_CELLS};
use protocol::packed_file::UnpackError;

use crate::model::{ConsoleModel, FetchedVoxels, TrajectoryProgress, VoxelsProgress};
use crate::playback::in_words;

mod fetching;

pub use fetching::{FetchProgress, Fetcher};

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ExportPart {
    /// A layer: `GeoTIFF`, pictures, and for occupancy the files of Nav2's map server.
    Layer(LayerId),
    Trajectory,
    Shores,
    /// The octree as `OctoMap`'s binary tree and as points. It must be fetched first.
    Voxels,
}

impl ExportPart {
    pub fn all() -> impl Iterator<Item = Self> {
        LayerId::ALL.into_iter().map(Self::Layer).chain([
            Self::Trajectory,
            Self::Shores,
            Self::Voxels,
        ])
    }

    pub fn is_in(self, model: &ConsoleModel) -> bool {
        match self {
            Self::Layer(layer) => model.map().store().cell_m(layer).is_some(),
            Self::Trajectory => true,
            Self::Shores => model.shores().is_some(),
            // The cost layer is computed from the octree.
            Self::Voxels => model.map().store().cell_m(LayerId::Cost).is_some(),
        }
    }

    pub fn files(self) -> String {
        match self {
            Self::Layer(layer @ (LayerId::Occupancy | LayerId::Obstacle)) => {
                let document = layer.document_palette().map_or("", |_| ", .document.png");
                format!("{layer}.tif, .png, .pgm and .yaml{document}")
            }
            Self::Layer(layer) => {
                let more = match layer {
                    LayerId::Depth => ", .geojson",
                    _ if layer.document_palette().is_some() => ", .document.png",
                    _ => "",
                };
                format!("{layer}.tif, .png{more}")
            }
            Self::Trajectory => "trajectory.tum, .geojson".to_owned(),
            Self::Shores => "shores.geojson".to_owned(),
            Self::Voxels => VoxelFile::ALL.map(VoxelFile::name).join(" and "),
        }
    }
}

impl fmt::Display for ExportPart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Layer(layer) => layer.fmt(f),
            Self::Trajectory => f.write_str("trajectory"),
            Self::Shores => f.write_str("shores"),
            Self::Voxels => f.write_str("voxels"),
        }
    }
}

/// Content of a part at one moment. Taking it is fast, as cells are shared; writing does not lock the model.
#[derive(Clone, Debug)]
pub struct Snapshot {
    content: Content,
    incomplete_because: Option<String>,
}

#[derive(Clone, Debug)]
enum Content {
    Layer {
        tiles: KnownTiles,
        title: String,
        vehicle_m: Option<[f64; 2]>,
        path: Arc<[StampedPose]>,
        footprint: Option<Footprint>,
        datum: Option<Datum>,
        labels: Vec<Label>,
    },
    Trajectory(Arc<[StampedPose]>, Option<Datum>),
    Shores(Shores),
    Voxels(Arc<FetchedVoxels>),
    Nothing,
}

impl Snapshot {
    pub fn of(model: &ConsoleModel, part: ExportPart) -> Self {
        let datum = model.shores().and_then(|shores| shores.datum);
        let content = match part {
            ExportPart::Layer(layer) => {
                let tiles = KnownTiles::of_layer(model.map().store(), layer);
                let info = model.info();
                let position_m = model.vehicle().pose().map(|(pose, _)| pose.position_m);
                // A layer without a grid has not been described yet.
                tiles.map_or(Content::Nothing, |tiles| Content::Layer {
                    tiles,
                    title: info.map(|info| info.source.clone()).unwrap_or_default(),
                    vehicle_m: position_m.map(|[x, y, _]| [x, y]),
                    path: path(model),
                    footprint: info.map(|info| {
                        let [length_m, width_m] = info.footprint_m.map(f64::from);
                        Footprint {
                            length_m,
                            width_m,
                            offset_m: f64::from(info.footprint_offset_m),
                        }
                    }),
                    datum,
                    labels: model.shores().map(shore_labels).unwrap_or_default(),
                })
            }
            ExportPart::Trajectory => Content::Trajectory(path(model), datum),
            ExportPart::Shores => model
                .shores()
                .map_or(Content::Nothing, |shores| Content::Shores(shores.clone())),
            ExportPart::Voxels => match model.voxels() {
                VoxelsProgress::Ready(voxels) => Content::Voxels(voxels),
                _ => Content::Nothing,
            },
        };
        Self {
            content,
            incomplete_because: None,
        }
    }

    fn lacking(self, why: String) -> Self {
        Self {
            incomplete_because: Some(why),
            ..self
        }
    }

    /// Writes it to the existing `folder` and returns the files. Without content there are none.
    pub fn write(self, folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
        match self.content {
            Content::Layer {
                tiles,
                title,
                vehicle_m,
                path,
                footprint,
                datum,
                labels,
            } => {
                let Some(raster) = tiles.into_raster(MAX_RASTER_CELLS)? else {
                    return Ok(Vec::new());
                };
                let caption = Caption {
                    title: &title,
                    vehicle_m,
                    path: &path,
                    footprint,
                    datum,
                    labels: &labels,
                };
                Ok(export_raster(folder, &raster, &caption)?)
            }
            Content::Trajectory(poses, datum) => {
                let path = folder.join("trajectory.tum");
                write_trajectory(&path, poses.iter().copied())?;
                Ok(vec![path, write_path(folder, &poses, datum)?])
            }
            Content::Shores(shores) => Ok(vec![write_shores(folder, &shores)?]),
            Content::Voxels(voxels) => write_voxels(folder, &voxels),
            Content::Nothing => Ok(Vec::new()),
        }
    }
}

/// The path of the vehicle: all of it if it was fetched, else what was received.
fn path(model: &ConsoleModel) -> Arc<[StampedPose]> {
    match model.trajectory() {
        TrajectoryProgress::Ready(poses) => poses,
        _ => model.vehicle().poses().iter_from(0).collect(),
    }
}

fn write_voxels(folder: &Path, voxels: &FetchedVoxels) -> anyhow::Result<Vec<PathBuf>> {
    let mut written = Vec::new();
    for (name, file) in VoxelFile::ALL.iter().zip(&voxels.files) {
        let path = folder.join(name.name());
        let write = || -> Result<(), UnpackError> {
            let mut out = BufWriter::new(File::create(&path)?);
            file.unpack(&mut out)?;
            Ok(out.flush()?)
        };
        write().with_context(|| format!("{}", path.display()))?;
        written.push(path);
    }
    Ok(written)
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ExportReport {
    pub files: Vec<PathBuf>,
    pub failures: Vec<(ExportPart, String)>,
    pub lacking: Vec<(ExportPart, String)>,
    pub is_cancelled: bool,
}

impl ExportReport {
    /// A text with the number of files in `folder` and a line for each missing part.
    pub fn outcome(&self, folder: &Path) -> Result<String, String> {
        let (count, folder) = (self.files.len(), folder.display());
        let (files, are) = if count == 1 {
            ("file", "is")
        } else {
            ("files", "are")
        };
        let mut lines = vec![if self.is_cancelled {
            format!("Cancelled after {count} {files}; the written files are complete, in {folder}")
        } else {
            format!("{count} {files} {are} in {folder}")
        }];
        let failures = self.failures.iter();
        lines.extend(failures.map(|(part, why)| format!("{part} is missing: {why}")));
        let lacking = self.lacking.iter();
        lines.extend(lacking.map(|(part, why)| format!("{part} is incomplete: {why}")));
        let is_whole = self.failures.is_empty() && self.lacking.is_empty() && !self.is_cancelled;
        let words = lines.join("\n");
        if is_whole { Ok(words) } else { Err(words) }
    }
}

/// Writes `parts` to `folder`, which is created if missing. `take` returns the content of each part just before it is
/// written, given the results so far, or ends the export.
pub fn export_parts(
    folder: &Path,
    parts: impl IntoIterator<Item = ExportPart>,
    mut take: impl FnMut(ExportPart, &ExportReport) -> ControlFlow<(), anyhow::Result<Snapshot>>,
) -> anyhow::Result<ExportReport> {
    make_folder(folder)?;
    let mut exported = ExportReport::default();
    for part in parts {
        let ControlFlow::Continue(taken) = take(part, &exported) else {
            exported.is_cancelled = true;
            break;
        };
        let written = taken.and_then(|snapshot| {
            let incomplete_because = snapshot.incomplete_because.clone();
            Ok((snapshot.write(folder)?, incomplete_because))
        });
        match written {
            Ok((files, incomplete_because)) => {
                exported.files.extend(files);
                exported
                    .lacking
                    .extend(incomplete_because.map(|why| (part, why)));
            }
            Err(error) => exported.failures.push((part, with_advice(&error))),
        }
    }
    Ok(exported)
}

fn make_folder(folder: &Path) -> anyhow::Result<()> {
    let is_file = |path: &&Path| path.is_file();
    if let Some(file) = folder.ancestors().find(is_file) {
        let file = file.display();
        return Err(anyhow!(
            "{file} is a file and no folder. Choose another folder"
        ));
    }
    std::fs::create_dir_all(folder).with_context(|| {
        let folder = folder.display();
        format!("{folder} cannot be made, choose another folder")
    })
}

fn with_advice(error: &anyhow::Error) -> String {
    let why = in_words(error);
    let is_damaged = |error: &UnpackError| matches!(error, UnpackError::Damaged(_));
    let mut causes = error.chain();
    if causes
        .clone()
        .any(|cause| cause.downcast_ref().is_some_and(is_damaged))
    {
        format!("{why}. Export it again")
    } else if causes.any(<dyn std::error::Error>::is::<io::Error>) {
        format!("{why}. Free some space or choose another folder, and export it again")
    } else {
        why
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::sync::Arc;

    use protocol::layer::LayerId;

    use super::*;

    const PARTS: [ExportPart; 3] = [
        ExportPart::Layer(LayerId::Occupancy),
        ExportPart::Trajectory,
        ExportPart::Voxels,
    ];

    fn of(content: Content) -> Snapshot {
        Snapshot {
            content,
            incomplete_because: None,
        }
    }

    fn trajectory() -> Snapshot {
        of(Content::Trajectory(Arc::new([]), None))
    }

    #[test]
    fn failed_part_does_not_block_others() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("new");
        let exported = export_parts(&folder, PARTS, |part, before| {
            assert_eq!(before.files.len(), 2 * usize::from(part == PARTS[2]));
            ControlFlow::Continue(match part {
                ExportPart::Layer(_) => Err(io::Error::other("the disk is full").into()),
                ExportPart::Trajectory => Ok(trajectory()),
                ExportPart::Shores | ExportPart::Voxels => Err(anyhow::anyhow!("too long")),
            })
        });
        let exported = exported.unwrap();
        let files = ["trajectory.tum", "trajectory.geojson"].map(|name| folder.join(name));
        assert_eq!(exported.files, files);
        assert!(folder.join("trajectory.tum").exists());
        let expected = format!(
            "2 files are in {}\n\
             occupancy is missing: the disk is full. Free some space or choose another folder, and export it again\n\
             voxels is missing: too long",
            folder.display()
        );
        assert_eq!(exported.outcome(&folder), Err(expected));
    }

    #[test]
    fn incomplete_part_is_written_and_reported() {
        let dir = tempfile::tempdir().unwrap();
        let exported = export_parts(dir.path(), [ExportPart::Trajectory], |_, _| {
            ControlFlow::Continue(Ok(trajectory().lacking("only a part".to_owned())))
        });
        let expected = format!(
            "2 files are in {}\ntrajectory is incomplete: only a part",
            dir.path().display()
        );
        assert_eq!(exported.unwrap().outcome(dir.path()), Err(expected));
    }

    #[test]
    fn unwritable_file_is_named_once() {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join("trajectory.tum")).unwrap();
        let exported = export_parts(dir.path(), [ExportPart::Trajectory], |_, _| {
            ControlFlow::Continue(Ok(trajectory()))
        });
        let exported = exported.unwrap();
        let [(ExportPart::Trajectory, why)] = &exported.failures[..] else {
            panic!("{exported:?}");
        };
        assert_eq!(why.matches("trajectory.tum").count(), 1, "{why}");
        assert_eq!(why.matches("directory").count(), 1, "{why}");
        assert!(why.ends_with("export it again"), "{why}");
    }

    #[test]
    fn folder_failure_ends_the_export() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("file");
        fs::write(&file, "").unwrap();
        let actual = format!(
            "{} is a file and no folder. Choose another folder",
            file.display()
        );
        for folder in [file.join("maps"), file] {
            let error = export_parts(&folder, PARTS, |_, _| unreachable!()).unwrap_err();
            assert_eq!(error.to_string(), actual);
        }
    }

    #[test]
    fn cancelled_export_reports_its_files() {
        let dir = tempfile::tempdir().unwrap();
        let exported = export_parts(dir.path(), PARTS, |part, _| match part {
            ExportPart::Layer(_) => ControlFlow::Continue(Ok(of(Content::Nothing))),
            ExportPart::Trajectory => ControlFlow::Continue(Ok(trajectory())),
            ExportPart::Shores | ExportPart::Voxels => ControlFlow::Break(()),
        });
        let exported = exported.unwrap();
        assert!(exported.is_cancelled);
        let words = exported.outcome(dir.path()).unwrap_err();
        assert!(words.starts_with("Cancelled after 2 files; the"), "{words}");
    }
}
