//! The octree as files: `voxels.bt` and `points.ply`.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use nalgebra::{Point3, Vector3};
use protocol::layer::{LayerId, UNKNOWN};
use protocol::message::VoxelFile;
use protocol::packed_file::PackedFile;
use protocol::tile::{TileCells, TileKey};
use protocol::tile_store::TileStore;

use super::octomap_bt::{self, BtWriteError, BtWriter};
use crate::publishing::cells_to_tiles::key;
use crate::publishing::voxel_snapshots::VoxelSnapshot;
use mapping::grid::VoxelIndex;
use mapping::octree::Octree;
use measurement::time::RobotTime;

#[derive(Debug, thiserror::Error)]
pub enum VoxelExportError {
    #[error("{path}: cannot write: {why}", path = path.display())]
    Io { path: PathBuf, why: std::io::Error },
    #[error("{path}: {why}", path = path.display())]
    Tree { path: PathBuf, why: BtWriteError },
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VoxelFiles {
    pub files: Vec<PathBuf>,
    /// Voxels that `voxels.bt` has no room for: farther than 32,768 voxels from the origin of `odom`.
    pub voxels_omitted: u64,
}

/// Of a point without a class.
const UNCLASSIFIED: (u8, &str) = (0, "unclassified");
/// The layers whose classes the points have, and what is added to the code of a class.
const CLASS_LAYERS: [(LayerId, u8); 2] = [(LayerId::Rigidity, 0), (LayerId::Shore, 10)];

/// Writes both files to `dir`. The class of a point is that of its column in the published maps.
pub fn export_voxels(
    dir: &Path,
    octree: &Octree,
    store: &TileStore,
) -> Result<VoxelFiles, VoxelExportError> {
    let tree = dir.join(VoxelFile::Tree.name());
    let points = dir.join(VoxelFile::Points.name());
    let create = |path: &Path| -> io::Result<_> { Ok(BufWriter::new(File::create(path)?)) };
    let voxels_omitted = create(&tree)
        .map_err(BtWriteError::Io)
        .and_then(|mut out| {
            let omitted = write_tree(octree, &mut out)?;
            out.flush()?;
            Ok(omitted)
        })
        .map_err(|why| match why {
            BtWriteError::Io(why) => VoxelExportError::Io {
                path: tree.clone(),
                why,
            },
            why @ (BtWriteError::OutOfRange(_) | BtWriteError::OutOfOrder(_)) => {
                VoxelExportError::Tree {
                    path: tree.clone(),
                    why,
                }
            }
        })?;
    create(&points)
        .and_then(|mut out| {
            write_points(octree, |key| store.get(key)?.cells(), &mut out)?;
            out.flush()
        })
        .map_err(|why| VoxelExportError::Io {
            path: points.clone(),
            why,
        })?;
    Ok(VoxelFiles {
        files: vec![tree, points],
        voxels_omitted,
    })
}

/// What the class of a voxel is read from, apart from the store, which mapping goes on writing to.
pub struct PublishedClasses(BTreeMap<TileKey, TileCells>);

impl PublishedClasses {
    pub fn of(store: &TileStore) -> Self {
        let tiles = CLASS_LAYERS
            .into_iter()
            .flat_map(|(layer, _)| store.tiles(layer));
        Self(
            tiles
                .filter_map(|(key, stored)| Some((key, stored.cells()?.clone())))
                .collect(),
        )
    }
}

/// Both files as [`export_voxels`] would write them, packed: the map up to `stamp`.
pub fn pack_voxels(
    stamp: RobotTime,
    octree: &Octree,
    classes: &PublishedClasses,
) -> Result<VoxelSnapshot, BtWriteError> {
    let tree = PackedFile::pack(|out| write_tree(octree, out).map(drop))?;
    let cells = |key| classes.0.get(&key);
    let points = PackedFile::pack(|out| write_points(octree, cells, out))?;
    Ok(VoxelSnapshot {
        stamp,
        files: [tree, points],
    })
}

/// Distances from the vehicle within which voxels stay fine, tried in turn, metres.
const FINE_M: [f64; 4] = [40.0, 20.0, 10.0, 0.0];

/// As [`pack_voxels`], in files of at most `limit_bytes` if that is possible: voxels farther from the vehicle are merged by
/// 4 × 4 × 4.
pub fn pack_voxels_for_link(
    stamp: RobotTime,
    (mut octree, vehicle_in_odom): (Octree, Point3<f64>),
    classes: &PublishedClasses,
    limit_bytes: u64,
) -> Result<VoxelSnapshot, BtWriteError> {
    let mut snapshot = pack_voxels(stamp, &octree, classes)?;
    for fine_m in FINE_M {
        let bytes = snapshot.files.iter().map(|file| file.packed.len() as u64);
        if bytes.sum::<u64>() <= limit_bytes {
            break;
        }
        octree.coarsen_beyond(vehicle_in_odom, fine_m);
        snapshot = pack_voxels(stamp, &octree, classes)?;
    }
    Ok(snapshot)
}

/// BLAKE3 of every known voxel, hexadecimal: of each block of 16³ voxels that holds one, ordered by the x, y and z of
/// its least voxel, these as little-endian i32, then for each of its 64 bricks which voxels are known and which are
/// occupied, as bits of little-endian u64; bricks and voxels x first, then y, then z.
pub fn voxel_digest(octree: &Octree) -> String {
    let mut hasher = blake3::Hasher::new();
    for block in octree.known_blocks(|least| least) {
        for coordinate in [block.least.x, block.least.y, block.least.z] {
            hasher.update(&coordinate.to_le_bytes());
        }
        for brick in block.bricks {
            hasher.update(&brick.known.to_le_bytes());
            hasher.update(&brick.occupied.to_le_bytes());
        }
    }
    hasher.finalize().to_string()
}

/// Returns the number of voxels that are left out, because the format has no place for them.
fn write_tree(octree: &Octree, mut out: impl Write) -> Result<u64, BtWriteError> {
    let (tree, omitted) = bt_writer(octree)?;
    tree.write(octree.cell_m(), &mut out)?;
    Ok(omitted)
}

/// The nodes of `voxels.bt` without its header, and the number of voxels that are left out.
pub fn octomap_tree(octree: &Octree) -> Result<(Vec<u8>, u64), BtWriteError> {
    let (tree, omitted) = bt_writer(octree)?;
    Ok((tree.finish().0, omitted))
}

fn bt_writer(octree: &Octree) -> Result<(BtWriter, u64), BtWriteError> {
    let mut tree = BtWriter::default();
    let mut omitted = 0;
    for block in octree.known_blocks(octomap_bt::place) {
        if octomap_bt::place(block.least).is_some() {
            tree.push_block(block.least, &block.bricks)?;
        } else {
            let known = block.bricks.iter().map(|brick| brick.known.count_ones());
            omitted += u64::from(known.sum::<u32>());
        }
    }
    Ok((tree, omitted))
}

fn write_points<'a>(
    octree: &Octree,
    cells: impl Fn(TileKey) -> Option<&'a TileCells>,
    mut out: impl Write,
) -> io::Result<()> {
    let cell_m = octree.cell_m();
    let points: Vec<_> = octree
        .occupied()
        .map(|(voxel, surface)| {
            let corner = Point3::new(voxel.x, voxel.y, voxel.z).map(f64::from);
            let inside = surface.map_or_else(|| Vector3::repeat(0.5), |surface| surface.mean());
            PlyPoint {
                point: (corner + inside) * cell_m,
                class: class_of(voxel, &cells),
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
    write_ply(&header, points.into_iter(), &mut out)
}

fn class_of<'a>(voxel: VoxelIndex, cells: &impl Fn(TileKey) -> Option<&'a TileCells>) -> u8 {
    let (tile, place) = voxel.column().split();
    let of_layer = |(layer, offset): (LayerId, u8)| {
        let code = cells(key(layer, tile))?.codes()[place];
        (code != UNKNOWN).then(|| code as u8 + offset)
    };
    CLASS_LAYERS
        .into_iter()
        .find_map(of_layer)
        .unwrap_or(UNCLASSIFIED.0)
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct PlyPoint {
    /// Metres in the frame of the file; rounded to f32 there, which is 0.1 mm at 1 km.
    point: Point3<f64>,
    class: u8,
}

#[derive(Clone, Copy, Debug)]
struct PlyHeader<'a> {
    frame: &'a str,
    /// Side of the voxels that the points stand for, metres.
    cell_m: f64,
    classes: &'a [(u8, &'a str)],
}

/// Binary PLY, which `CloudCompare`, `MeshLab` and `Open3D` open: `float x y z` in metres and `uchar class`, little-endian; frame, cell and classes are
/// comments of the header.
fn write_ply(
    header: &PlyHeader<'_>,
    points: impl ExactSizeIterator<Item = PlyPoint>,
    out: &mut impl Write,
) -> io::Result<()> {
    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    writeln!(out, "comment frame {}", one_line(header.frame))?;
    writeln!(out, "comment cell_m {}", header.cell_m)?;
    for (class, name) in header.classes {
        writeln!(out, "comment class {class} {}", one_line(name))?;
    }
    writeln!(out, "element vertex {}", points.len())?;
    writeln!(out, "property float x\nproperty float y\nproperty float z")?;
    writeln!(out, "property uchar class\nend_header")?;
    for PlyPoint { point, class } in points {
        let mut vertex = [0; VERTEX_BYTES];
        for (bytes, coordinate) in vertex.chunks_exact_mut(4).zip(point.iter()) {
            bytes.copy_from_slice(&(*coordinate as f32).to_le_bytes());
        }
        vertex[VERTEX_BYTES - 1] = class;
        out.write_all(&vertex)?;
    }
    Ok(())
}

/// Three floats and a byte.
const VERTEX_BYTES: usize = 13;

/// A comment ends with its line, so that no name can end it early.
fn one_line(name: &str) -> String {
    let printable = |character: char| {
        if character.is_control() {
            ' '
        } else {
            character
        }
    };
    name.chars().map(printable).collect()
}

#[cfg(test)]
mod tests {
    use super::super::octomap_bt::tests::read;
    use super::*;
    use mapping::octree::{OctreeConfig, RangeSensorModel};
    use mapping::octree::{Ray, VoxelState};
    use mapping::registered_scan::SensorId;

    #[test]
    fn the_tree_has_all_that_it_has_room_for_and_the_rest_is_counted() {
        let mut octree = Octree::new(&OctreeConfig::default(), &[RangeSensorModel::default()], 1);
        let mut see = |from: [f64; 3], to: [f64; 3]| {
            let ray = Ray {
                origin: from.into(),
                end: to.into(),
                is_hit: true,
            };
            assert_eq!(octree.integrate(SensorId(0), [ray]), 0);
        };
        // Many blocks, from the last of the curve to the first.
        see([8.05, 8.05, 8.05], [-8.05, -8.05, -8.05]);
        see([9.05, -7.05, 0.05], [-7.05, 9.05, 0.05]);
        // Voxels 32,760 to 32,775 along x: half of them are beyond the format.
        see([3_276.05, 0.05, 0.05], [3_277.55, 0.05, 0.05]);
        let counts = octree.counts();
        let mut bytes = Vec::new();
        assert_eq!(write_tree(&octree, &mut bytes).unwrap(), 8);
        let mut voxels = [0; 2];
        for cube in read(&bytes) {
            let state = if cube.is_occupied {
                VoxelState::Occupied
            } else {
                VoxelState::Free
            };
            assert_eq!(octree.state(cube.least), state, "{cube:?}");
            voxels[usize::from(cube.is_occupied)] += 1 << (3 * cube.edge_log2);
        }
        // The last of those beyond was hit.
        assert_eq!(voxels, [counts.free - 7, counts.occupied - 1]);
    }

    #[test]
    fn files_for_a_thin_link_are_coarse_far_from_the_vehicle() {
        let mut octree = Octree::new(&OctreeConfig::default(), &[RangeSensorModel::default()], 1);
        // A wall along x, up to 60 m.
        let ends = (0..600).flat_map(|x| (0..20).map(move |z| (x, z)));
        let rays = ends.map(|(x, z)| Ray {
            origin: Point3::new(0.05, 0.05, 1.05),
            end: Point3::new(0.1 * f64::from(x) + 0.05, 2.05, 0.1 * f64::from(z) + 0.05),
            is_hit: true,
        });
        octree.integrate(SensorId(0), rays);
        let classes = PublishedClasses(BTreeMap::new());
        let stamp = RobotTime::from_nanos(0);
        let packed = |limit_bytes| {
            let octree = (octree.clone(), Point3::origin());
            let snapshot = pack_voxels_for_link(stamp, octree, &classes, limit_bytes).unwrap();
            snapshot.files.map(|file| file.packed.len() as u64)
        };
        let whole = packed(u64::MAX);
        assert_eq!(
            whole,
            pack_voxels(stamp, &octree, &classes)
                .unwrap()
                .files
                .map(|file| file.packed.len() as u64)
        );
        let total: u64 = whole.iter().sum();
        for divisor in [2, 4] {
            let bytes = packed(total / divisor).iter().sum::<u64>();
            assert!(bytes <= total / divisor, "{bytes} of {total}");
        }
        // The coarsest that there is.
        assert!(packed(0).iter().sum::<u64>() < total / 4);
    }

    /// Header lines, and x, y, z and class of every vertex.
    fn read_ply(bytes: &[u8]) -> (Vec<&str>, Vec<([f32; 3], u8)>) {
        let end = b"\nend_header\n";
        let header = bytes.windows(end.len()).position(|window| window == end);
        let (header, vertices) = bytes.split_at(header.unwrap() + end.len());
        let vertices = vertices.chunks(VERTEX_BYTES).map(|vertex| {
            let along = |at: usize| f32::from_le_bytes(vertex[at..at + 4].try_into().unwrap());
            ([along(0), along(4), along(8)], vertex[12])
        });
        (
            str::from_utf8(header).unwrap().lines().collect(),
            vertices.collect(),
        )
    }

    #[test]
    fn points_are_written_with_their_classes() {
        let point = |x, y, z, class| PlyPoint {
            point: Point3::new(x, y, z),
            class,
        };
        let header = PlyHeader {
            frame: "odom\nend_header",
            cell_m: 0.1,
            classes: &[(0, "occupied"), (2, "rigid")],
        };
        let points = [point(0.05, -1.25, 3.0, 2), point(1e3, 0.0, -0.5, 0)];
        let mut bytes = Vec::new();
        write_ply(&header, points.into_iter(), &mut bytes).unwrap();
        let (header, vertices) = read_ply(&bytes);
        assert_eq!(
            header,
            [
                "ply",
                "format binary_little_endian 1.0",
                "comment frame odom end_header",
                "comment cell_m 0.1",
                "comment class 0 occupied",
                "comment class 2 rigid",
                "element vertex 2",
                "property float x",
                "property float y",
                "property float z",
                "property uchar class",
                "end_header",
            ]
        );
        assert_eq!(
            vertices,
            [([0.05, -1.25, 3.0], 2), ([1000.0, 0.0, -0.5], 0)]
        );
    }
}
