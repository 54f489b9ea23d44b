//! The octree as files: `voxels.bt` and `points.ply`.

use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

use nalgebra::Point3;
use protocol::layer::{LayerId, UNKNOWN};
use protocol::tile_store::TileStore;

use super::octomap_bt::{self, BtWriteError, Cube};
use super::ply::{self, PlyHeader, PlyPoint};
use crate::mapping::octree::{Octree, SurfaceVoxel, VoxelState};
use crate::mapping::voxel::VoxelIndex;
use crate::streaming::cells_to_tiles::key;

/// Why a file of voxels could not be written.
#[derive(Debug, thiserror::Error)]
pub enum VoxelExportError {
    /// The file cannot be written.
    #[error("{path}: cannot write: {why}", path = path.display())]
    Io {
        /// Which.
        path: PathBuf,
        /// What the system says.
        why: std::io::Error,
    },
    /// The map does not fit an `OctoMap`.
    #[error("{path}: {why}", path = path.display())]
    Tree {
        /// Which.
        path: PathBuf,
        /// Why.
        why: BtWriteError,
    },
}

/// What was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VoxelFiles {
    /// The files.
    pub files: Vec<PathBuf>,
    /// Voxels that `voxels.bt` has no room for: farther than 32,768 voxels from the origin of `odom`.
    pub voxels_left_out: u64,
}

/// Of a point without a class.
const UNCLASSIFIED: (u8, &str) = (0, "unclassified");
/// The layers whose classes the points have, and what is added to the code of a class.
const CLASS_LAYERS: [(LayerId, u8); 2] = [(LayerId::Rigidity, 0), (LayerId::Shore, 10)];
/// Voxels of an `OctoMap` lie within so many of the origin, along each axis.
const BT_REACH: i32 = 32_768;

/// Writes both files to `dir`. The class of a point is that of its column in the published maps.
pub fn export_voxels(
    dir: &Path,
    octree: &Octree,
    store: &TileStore,
) -> Result<VoxelFiles, VoxelExportError> {
    let trees = dir.join("voxels.bt");
    let voxels_left_out = write_tree(&trees, octree)?;
    let points = dir.join("points.ply");
    let io = |why| VoxelExportError::Io {
        path: points.clone(),
        why,
    };
    write_points(&points, octree, store).map_err(io)?;
    Ok(VoxelFiles {
        files: vec![trees, points],
        voxels_left_out,
    })
}

/// BLAKE3 of every known voxel, hexadecimal: of each block of 16³ voxels that holds one, ordered by the x, y and z of
/// its least voxel, these as little-endian i32, then for each of its 64 bricks which voxels are known and which are
/// occupied, as bits of little-endian u64; bricks and voxels x first, then y, then z.
pub fn voxel_digest(octree: &Octree) -> String {
    let mut blocks: Vec<_> = octree.known_by_block().collect();
    blocks.sort_unstable_by_key(|(first, _)| *first);
    let mut hasher = blake3::Hasher::new();
    for (first, voxels) in blocks {
        for coordinate in [first.x, first.y, first.z] {
            hasher.update(&coordinate.to_le_bytes());
        }
        for bits in voxels {
            hasher.update(&bits.to_le_bytes());
        }
    }
    hasher.finalize().to_string()
}

fn write_tree(path: &Path, octree: &Octree) -> Result<u64, VoxelExportError> {
    let io = |why| VoxelExportError::Io {
        path: path.to_owned(),
        why,
    };
    let mut left_out = 0;
    let fits = |first: VoxelIndex, edge: i32| {
        let within = |at: i32| at >= -BT_REACH && at <= BT_REACH - edge;
        within(first.x) && within(first.y) && within(first.z)
    };
    let mut cubes = Vec::new();
    for cube in octree.cubes() {
        if fits(cube.first, cube.edge.cast_signed()) {
            cubes.push(Cube {
                least: cube.first,
                edge_log2: cube.edge.trailing_zeros() as u8,
                is_occupied: cube.state == VoxelState::Occupied,
            });
        } else {
            left_out += u64::from(cube.edge).pow(3);
        }
    }
    let mut out = BufWriter::new(File::create(path).map_err(io)?);
    octomap_bt::write(cubes, octree.cell_m(), &mut out).map_err(|why| VoxelExportError::Tree {
        path: path.to_owned(),
        why,
    })?;
    out.flush().map_err(io)?;
    Ok(left_out)
}

fn write_points(path: &Path, octree: &Octree, store: &TileStore) -> std::io::Result<()> {
    let cell_m = octree.cell_m();
    let points: Vec<_> = octree
        .occupied()
        .map(|(voxel, surface)| {
            let corner = Point3::new(voxel.x, voxel.y, voxel.z).map(f64::from);
            let inside = surface.map_or_else(|| nalgebra::Vector3::repeat(0.5), SurfaceVoxel::mean);
            PlyPoint {
                point: (corner + inside) * cell_m,
                class: class_of(voxel, store),
            }
        })
        .collect();
    let mut classes = vec![UNCLASSIFIED];
    for (layer, offset) in CLASS_LAYERS {
        classes.extend(
            (1..)
                .zip(layer.classes())
                .map(|(code, class)| (code + offset, class.name)),
        );
    }
    let header = PlyHeader {
        frame: "odom",
        cell_m,
        classes: &classes,
    };
    let mut out = BufWriter::new(File::create(path)?);
    ply::write(&header, points.into_iter(), &mut out)?;
    out.flush()
}

fn class_of(voxel: VoxelIndex, store: &TileStore) -> u8 {
    let (tile, place) = voxel.column().split();
    let of_layer = |(layer, offset): (LayerId, u8)| {
        let cells = store.get(key(layer, tile))?.cells()?;
        let code = cells.codes()[place];
        (code != UNKNOWN).then(|| code as u8 + offset)
    };
    CLASS_LAYERS
        .into_iter()
        .find_map(of_layer)
        .unwrap_or(UNCLASSIFIED.0)
}
