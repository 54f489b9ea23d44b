//! The exports of a map as the window and the command without one write them: part by part, so that there is something to
//! tell on the way, and a place to stop.

use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context as _;
use protocol::export::{
    Caption, StampedPose, palette_for, write_geotiff, write_map_server, write_picture,
    write_shores, write_trajectory,
};
use protocol::layer::LayerId;
use protocol::message::{Shores, VoxelFile};
use protocol::mosaic::{MAX_RASTER_CELLS, Raster};
use protocol::packed_file::UnpackError;

use crate::model::{ConsoleModel, FetchedVoxels, VoxelsProgress};

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
            Self::Layer(LayerId::Occupancy) => {
                "occupancy.tif, .png, .document.png, .pgm and .yaml".to_owned()
            }
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

/// What there is of a part at one moment. Taking it is quick, writing it is not: between the two, the model is free.
#[derive(Clone, Debug)]
pub struct Snapshot(Content);

#[derive(Clone, Debug)]
enum Content {
    /// A layer of which something is known.
    Layer {
        raster: Raster,
        title: String,
        vehicle_m: Option<[f64; 2]>,
    },
    Trajectory(Vec<StampedPose>),
    Shores(Shores),
    Voxels(Arc<FetchedVoxels>),
    Nothing,
}

impl Snapshot {
    /// What `model` has of a part.
    ///
    /// # Errors
    /// Where the layer is too large to be a raster.
    pub fn of(model: &ConsoleModel, part: ExportPart) -> anyhow::Result<Self> {
        let content = match part {
            ExportPart::Layer(layer) if part.is_in(model) => {
                let raster = Raster::of_layer(model.map().store(), layer, MAX_RASTER_CELLS)?;
                let info = model.info();
                let position_m = model.vehicle().pose().map(|(pose, _)| pose.position_m);
                raster.map_or(Content::Nothing, |raster| Content::Layer {
                    raster,
                    title: info.map(|info| info.source.clone()).unwrap_or_default(),
                    vehicle_m: position_m.map(|[x, y, _]| [x, y]),
                })
            }
            ExportPart::Layer(_) => Content::Nothing,
            ExportPart::Trajectory => Content::Trajectory(model.vehicle().poses().to_vec()),
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
        Ok(Self(content))
    }

    /// Writes it to `folder`; says which files. Nothing has none.
    ///
    /// # Errors
    /// Where a file cannot be written.
    pub fn write(&self, folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("{}: cannot be made", folder.display()))?;
        match &self.0 {
            Content::Layer {
                raster,
                title,
                vehicle_m,
            } => {
                let caption = Caption {
                    title,
                    vehicle_m: *vehicle_m,
                    labels: &[],
                };
                write_layer(folder, raster, &caption)
            }
            Content::Trajectory(poses) => {
                let path = folder.join("trajectory.tum");
                write_trajectory(&path, poses.iter().copied())?;
                Ok(vec![path])
            }
            Content::Shores(shores) => Ok(vec![write_shores(folder, shores)?]),
            Content::Voxels(voxels) => write_voxels(folder, voxels),
            Content::Nothing => Ok(Vec::new()),
        }
    }
}

/// The files of `protocol::export::export_layer`, from a raster that was taken out of its store.
fn write_layer(
    folder: &Path,
    raster: &Raster,
    caption: &Caption<'_>,
) -> anyhow::Result<Vec<PathBuf>> {
    let layer = raster.layer();
    let mut files = vec![
        folder.join(format!("{layer}.tif")),
        folder.join(format!("{layer}.png")),
    ];
    write_geotiff(&files[0], raster)?;
    write_picture(&files[1], raster, &palette_for(raster), caption)?;
    if let Some(palette) = layer.document_palette() {
        let path = folder.join(format!("{layer}.document.png"));
        write_picture(&path, raster, &palette, caption)?;
        files.push(path);
    }
    if layer == LayerId::Occupancy {
        files.extend(write_map_server(folder, "occupancy", raster)?);
    }
    Ok(files)
}

/// Writes the octree's files to `folder`; says which.
///
/// # Errors
/// Where a file is not what the robot promised, or cannot be written.
pub fn write_voxels(folder: &Path, voxels: &FetchedVoxels) -> anyhow::Result<Vec<PathBuf>> {
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

/// Writes everything that `model` holds to `folder`; says which files. A part that fails does not keep the others from
/// being written; the first error is returned at the end.
///
/// # Errors
/// Where a file cannot be written.
pub fn export_all(model: &ConsoleModel, folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    let mut first_error = None;
    for part in ExportPart::all() {
        match Snapshot::of(model, part).and_then(|snapshot| snapshot.write(folder)) {
            Ok(written) => files.extend(written),
            Err(error) => {
                first_error.get_or_insert(error);
            }
        }
    }
    first_error.map_or(Ok(files), Err)
}
