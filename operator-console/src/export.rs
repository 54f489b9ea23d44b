//! The exports of a map as the window and the command without one write them: part by part, so that there is something to
//! tell on the way, and a place to stop.

mod fetching;
mod parts;

use std::fmt;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context as _;
use protocol::export::{Caption, StampedPose, export_raster, write_shores, write_trajectory};
use protocol::layer::LayerId;
use protocol::message::{Shores, VoxelFile};
use protocol::mosaic::{KnownTiles, MAX_RASTER_CELLS};
use protocol::packed_file::UnpackError;

use crate::model::{ConsoleModel, FetchedVoxels, TrajectoryProgress, VoxelsProgress};

pub use fetching::{Fetcher, Fetching};
pub use parts::{Exported, export_parts};

/// Something that can be exported by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ExportPart {
    /// A layer: `GeoTIFF`, pictures, and for occupancy what Nav2's map server reads.
    Layer(LayerId),
    /// Where the vehicle was, as TUM.
    Trajectory,
    /// Shores and docking sites, as `GeoJSON`.
    Shores,
    /// The octree, as `OctoMap`'s binary tree and as points. It has to be fetched first.
    Voxels,
}

impl ExportPart {
    /// All there are.
    pub fn all() -> impl Iterator<Item = Self> {
        LayerId::ALL.into_iter().map(Self::Layer).chain([
            Self::Trajectory,
            Self::Shores,
            Self::Voxels,
        ])
    }

    /// What `model` has of it.
    pub fn is_in(self, model: &ConsoleModel) -> bool {
        match self {
            Self::Layer(layer) => model.map().store().cell_m(layer).is_some(),
            Self::Trajectory => true,
            Self::Shores => model.shores().is_some(),
            // Cost is made of the octree.
            Self::Voxels => model.map().store().cell_m(LayerId::Cost).is_some(),
        }
    }

    /// The files it becomes, in words.
    pub fn files(self) -> String {
        match self {
            Self::Layer(LayerId::Occupancy) => "occupancy.tif, .png, .pgm and .yaml".to_owned(),
            Self::Layer(layer) => {
                let document = if layer.document_palette().is_some() {
                    ", .document.png"
                } else {
                    ""
                };
                format!("{layer}.tif, .png{document}")
            }
            Self::Trajectory => "trajectory.tum".to_owned(),
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

/// What there is of a part at one moment. Taking it is quick, since no cells are copied; writing it is not: between the two,
/// the model is free.
#[derive(Clone, Debug)]
pub struct Snapshot {
    content: Content,
    /// Why it is not all that the robot has.
    lacks: Option<String>,
}

#[derive(Clone, Debug)]
enum Content {
    /// A layer of which something is known.
    Layer {
        tiles: KnownTiles,
        title: String,
        vehicle_m: Option<[f64; 2]>,
    },
    Trajectory(Arc<[StampedPose]>),
    Shores(Shores),
    Voxels(Arc<FetchedVoxels>),
    Nothing,
}

impl Snapshot {
    /// What `model` has of a part.
    pub fn of(model: &ConsoleModel, part: ExportPart) -> Self {
        let content = match part {
            ExportPart::Layer(layer) => {
                let tiles = KnownTiles::of_layer(model.map().store(), layer);
                let info = model.info();
                let position_m = model.vehicle().pose().map(|(pose, _)| pose.position_m);
                // What has no grid has not been told of yet.
                tiles.map_or(Content::Nothing, |tiles| Content::Layer {
                    tiles,
                    title: info.map(|info| info.source.clone()).unwrap_or_default(),
                    vehicle_m: position_m.map(|[x, y, _]| [x, y]),
                })
            }
            ExportPart::Trajectory => Content::Trajectory(match model.trajectory() {
                TrajectoryProgress::Ready(poses) => poses,
                TrajectoryProgress::Unwanted
                | TrajectoryProgress::Waiting
                | TrajectoryProgress::Fetching { .. } => model.vehicle().poses().into(),
            }),
            ExportPart::Shores => model
                .shores()
                .map_or(Content::Nothing, |shores| Content::Shores(shores.clone())),
            ExportPart::Voxels => match model.voxels() {
                VoxelsProgress::Ready(voxels) => Content::Voxels(voxels),
                VoxelsProgress::Unwanted
                | VoxelsProgress::Waiting
                | VoxelsProgress::Fetching { .. }
                | VoxelsProgress::None
                | VoxelsProgress::TooLong => Content::Nothing,
            },
        };
        Self {
            content,
            lacks: None,
        }
    }

    /// The same, of which somebody knows why it is not all that the robot has.
    fn lacking(self, why: String) -> Self {
        Self {
            lacks: Some(why),
            ..self
        }
    }

    /// Writes it to `folder`, which is there; says which files. Nothing has none.
    ///
    /// # Errors
    /// Where the layer is too large to be a raster, or a file cannot be written.
    pub fn write(self, folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
        match self.content {
            Content::Layer {
                tiles,
                title,
                vehicle_m,
            } => {
                let Some(raster) = tiles.into_raster(MAX_RASTER_CELLS)? else {
                    return Ok(Vec::new());
                };
                let caption = Caption {
                    title: &title,
                    vehicle_m,
                    labels: &[],
                };
                Ok(export_raster(folder, &raster, &caption)?)
            }
            Content::Trajectory(poses) => {
                let path = folder.join("trajectory.tum");
                write_trajectory(&path, poses.iter().copied())?;
                Ok(vec![path])
            }
            Content::Shores(shores) => Ok(vec![write_shores(folder, &shores)?]),
            Content::Voxels(voxels) => write_voxels(folder, &voxels),
            Content::Nothing => Ok(Vec::new()),
        }
    }
}

/// Writes the octree's files to `folder`; says which.
///
/// # Errors
/// Where a file is not what the robot promised, or cannot be written.
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
