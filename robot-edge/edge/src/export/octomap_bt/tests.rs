use std::collections::BTreeMap;
use std::fs;
use std::process::Command;

use proptest::prelude::*;

use super::*;
use crate::shared_data::shared_data;
use crate::skip::skip;
use mapping::octree::BrickStates;

const fn at(x: i32, y: i32, z: i32) -> VoxelIndex {
    VoxelIndex { x, y, z }
}

const fn cube(least: VoxelIndex, edge_log2: u8, is_occupied: bool) -> Cube {
    Cube {
        least,
        edge_log2,
        is_occupied,
    }
}

fn tree(cubes: impl IntoIterator<Item = Cube>) -> Result<BtWriter, BtWriteError> {
    let mut cubes: Vec<_> = cubes.into_iter().collect();
    cubes.sort_by_key(|cube| place(cube.least));
    let mut tree = BtWriter::default();
    cubes.into_iter().try_for_each(|cube| tree.push(cube))?;
    Ok(tree)
}

fn written(cubes: impl IntoIterator<Item = Cube>) -> Vec<u8> {
    let mut bytes = Vec::new();
    tree(cubes).unwrap().write(0.1, &mut bytes).unwrap();
    bytes
}

/// The leaves of a file, which must be whole.
pub(in crate::export) fn read(bytes: &[u8]) -> Vec<Cube> {
    let end = b"\ndata\n";
    let length = bytes.windows(end.len()).position(|six| six == end);
    let (header, tree) = bytes.split_at(length.unwrap());
    let header = str::from_utf8(header).unwrap();
    let value = |key: &str| header.lines().find_map(|line| line.strip_prefix(key));
    assert!(header.starts_with(FIRST_LINE));
    assert_eq!(value("id "), Some("OcTree"));
    let nodes: u64 = value("size ").unwrap().parse().unwrap();
    let mut reader = TreeReader {
        rest: &tree[end.len()..],
        nodes: nodes.min(1),
        leaves: Vec::new(),
    };
    if nodes > 0 {
        reader.inner_node(at(-ORIGIN, -ORIGIN, -ORIGIN), LEVELS - 1);
    }
    assert_eq!((reader.nodes, reader.rest), (nodes, &[][..]));
    reader.leaves
}

struct TreeReader<'a> {
    rest: &'a [u8],
    nodes: u64,
    leaves: Vec<Cube>,
}

impl TreeReader<'_> {
    fn inner_node(&mut self, least: VoxelIndex, child_edge_log2: u8) {
        let (node, rest) = self.rest.split_first_chunk().unwrap();
        self.rest = rest;
        let children = u16::from_le_bytes(*node);
        assert_ne!(children, 0);
        for number in 0..8_u8 {
            let along = |bit: u8| i32::from(number >> bit & 1) << child_edge_log2;
            let least = at(least.x + along(0), least.y + along(1), least.z + along(2));
            let child = Child::of(children, number);
            self.nodes += u64::from(child != Child::Unknown);
            match child {
                Child::Unknown => {}
                Child::Inner => self.inner_node(least, child_edge_log2 - 1),
                Child::Free => self.leaves.push(cube(least, child_edge_log2, false)),
                Child::Occupied => self.leaves.push(cube(least, child_edge_log2, true)),
            }
        }
    }
}

fn counts(cubes: &[Cube]) -> (usize, usize) {
    let occupied = cubes.iter().filter(|cube| cube.is_occupied).count();
    (occupied, cubes.len() - occupied)
}

#[test]
fn a_single_voxel_is_a_path_of_sixteen_nodes() {
    let bytes = written([cube(at(0, 0, 0), 0, true)]);
    let header = "# Octomap OcTree binary file\n\
        # (feel free to add / change comments, but leave the first line as it is!)\n#\n\
        id OcTree\nsize 17\nres 0.1\ndata\n";
    let (text, tree) = bytes.split_at(header.len());
    assert_eq!(str::from_utf8(text).unwrap(), header);
    // The origin is the lowest voxel of the root's highest child; from there it is always the lowest.
    let mut nodes = vec![0x00, 0b1100_0000];
    nodes.extend([0b0000_0011, 0].repeat(14));
    nodes.extend([0b0000_0010, 0]);
    assert_eq!(tree, nodes);
}

#[test]
fn children_are_counted_along_x_then_y_then_z() {
    let cubes = [
        cube(at(1, 0, 0), 0, true),
        cube(at(0, 1, 0), 0, false),
        cube(at(0, 0, 1), 0, true),
    ];
    let bytes = written(cubes);
    assert_eq!(bytes[bytes.len() - 2..], [0b0001_1000, 0b0000_0010]);
    assert_eq!(read(&bytes), cubes);
}

#[test]
fn eight_equal_leaves_become_one() {
    let voxels = |edge: i32| {
        let along = move || -edge..0;
        let columns = along().flat_map(move |x| along().map(move |y| (x, y)));
        columns.flat_map(move |(x, y)| along().map(move |z| at(x, y, z)))
    };
    let all = voxels(4).map(|voxel| cube(voxel, 0, true));
    assert_eq!(read(&written(all)), [cube(at(-4, -4, -4), 2, true)]);
    let but_one = voxels(4).map(|voxel| cube(voxel, 0, voxel != at(-1, -1, -1)));
    let leaves = read(&written(but_one));
    assert_eq!(counts(&leaves), (14, 1));
    // Also where some are large already, but never the whole tree.
    let octants = [-ORIGIN, 0].map(|x| [-ORIGIN, 0].map(|y| [-ORIGIN, 0].map(|z| at(x, y, z))));
    let octants = octants.into_iter().flatten().flatten();
    let leaves = read(&written(octants.map(|least| cube(least, 15, false))));
    assert_eq!(leaves.len(), 8);
}

#[test]
fn an_empty_map_is_an_empty_tree() {
    let bytes = written([]);
    assert!(bytes.ends_with(b"size 0\nres 0.1\ndata\n"));
    assert_eq!(read(&bytes), []);
}

#[test]
fn what_the_format_cannot_hold_is_refused() {
    for misplaced in [
        cube(at(32_768, 0, 0), 0, true),
        cube(at(0, -32_769, 0), 0, true),
        cube(at(0, 0, i32::MIN), 0, true),
        cube(at(0, 0, 2), 2, true),
        cube(at(0, 0, 0), 16, true),
        cube(at(0, 0, 0), 255, true),
    ] {
        let refused = tree([misplaced]);
        assert!(matches!(refused, Err(BtWriteError::OutOfRange(cube)) if cube == misplaced));
    }
    let overlapping = [cube(at(0, 0, 0), 3, true), cube(at(5, 6, 7), 0, false)];
    let refused = tree(overlapping);
    assert!(matches!(refused, Err(BtWriteError::OutOfOrder(voxel)) if voxel == at(5, 6, 7)));
    let mut late = tree([cube(at(0, 0, 0), 0, true)]).unwrap();
    let refused = late.push(cube(at(-1, 0, 0), 0, true));
    assert!(matches!(refused, Err(BtWriteError::OutOfOrder(voxel)) if voxel == at(-1, 0, 0)));
    for misplaced in [at(8, 0, 0), at(32_768, 0, 0)] {
        let refused = BtWriter::default().push_block(misplaced, &[BrickStates::default(); 64]);
        assert!(matches!(refused, Err(BtWriteError::OutOfRange(cube)) if cube.least == misplaced));
    }
}

fn any_cubes() -> impl Strategy<Value = Vec<Cube>> {
    let cube = (-9..9i32, -9..9i32, -9..9i32, 0..3u8, any::<bool>());
    prop::collection::vec(cube, 0..60).prop_map(|cubes| {
        let mut taken: BTreeMap<VoxelIndex, bool> = BTreeMap::new();
        let mut kept = Vec::new();
        for (x, y, z, edge_log2, is_occupied) in cubes {
            let cube = cube_at(
                x << edge_log2,
                y << edge_log2,
                z << edge_log2,
                edge_log2,
                is_occupied,
            );
            if voxels_of(cube).all(|voxel| !taken.contains_key(&voxel)) {
                taken.extend(voxels_of(cube).map(|voxel| (voxel, is_occupied)));
                kept.push(cube);
            }
        }
        kept
    })
}

fn cube_at(x: i32, y: i32, z: i32, edge_log2: u8, is_occupied: bool) -> Cube {
    cube(at(x, y, z), edge_log2, is_occupied)
}

fn voxels_of(cube: Cube) -> impl Iterator<Item = VoxelIndex> {
    let edge = 1 << cube.edge_log2;
    let VoxelIndex { x, y, z } = cube.least;
    (0..edge * edge * edge)
        .map(move |n: i32| at(x + n % edge, y + n / edge % edge, z + n / edge / edge))
}

fn labels(cubes: &[Cube]) -> BTreeMap<VoxelIndex, bool> {
    let labels = cubes.iter().flat_map(|cube| {
        let is_occupied = cube.is_occupied;
        voxels_of(*cube).map(move |voxel| (voxel, is_occupied))
    });
    labels.collect()
}

/// Bricks that are whole more often than chance has it.
fn any_brick() -> impl Strategy<Value = BrickStates> {
    let bits = || {
        prop_oneof![
            Just(0),
            Just(u64::MAX),
            any::<u64>(),
            any::<u64>().prop_map(|n| n | n << 1 | !255)
        ]
    };
    (bits(), bits()).prop_map(|(known, occupied)| BrickStates {
        known,
        occupied: known & occupied,
    })
}

proptest! {
    #[test]
    fn a_block_is_written_as_its_voxels_are(bricks in prop::collection::vec(any_brick(), 64), corner in 0..3_i32) {
        let bricks: [BrickStates; 64] = bricks.try_into().unwrap();
        let least = at(16 * corner, -16, -16 * corner);
        let mut voxels = Vec::new();
        for (number, brick) in (0_i32..).zip(&bricks) {
            for voxel in (0..64).filter(|voxel| brick.known >> voxel & 1 == 1) {
                let along = |axis: i32| 4 * (number >> (2 * axis) & 3) + (voxel >> (2 * axis) & 3);
                let voxel_at = at(least.x + along(0), least.y + along(1), least.z + along(2));
                voxels.push(cube(voxel_at, 0, brick.occupied >> voxel & 1 == 1));
            }
        }
        let mut tree = BtWriter::default();
        tree.push_block(least, &bricks).unwrap();
        let (mut bytes, mut one_by_one) = (Vec::new(), Vec::new());
        let sizes = tree.write(0.1, &mut bytes).unwrap();
        prop_assert_eq!(self::tree(voxels).unwrap().write(0.1, &mut one_by_one).unwrap(), sizes);
        prop_assert_eq!(read(&bytes).len() as u64, sizes.leaves);
        prop_assert_eq!(bytes, one_by_one);
    }

    #[test]
    fn what_was_written_is_read(cubes in any_cubes()) {
        let bytes = written(cubes.iter().copied());
        let leaves = read(&bytes);
        prop_assert_eq!(labels(&leaves), labels(&cubes));
        prop_assert_eq!(written(leaves), bytes, "pruned once and for all");
    }
}

#[test]
fn a_map_of_others_is_read_and_written_byte_for_byte() {
    let Some(folder) = shared_data("octomap") else {
        return;
    };
    let bytes = fs::read(folder.join("geb079.bt")).unwrap();
    let leaves = read(&bytes);
    assert_eq!(counts(&leaves), (143_729, 284_415));
    let mut again = Vec::new();
    let sizes = tree(leaves).unwrap().write(0.08, &mut again).unwrap();
    assert_eq!(sizes.nodes, 532_566);
    assert_eq!(sizes.leaves, 143_729 + 284_415);
    assert!(again == bytes, "{} bytes of {}", again.len(), bytes.len());
}

#[test]
fn octomaps_own_tools_read_what_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("voxels.bt");
    let cubes = [
        cube(at(-1, 2, 3), 0, true),
        cube(at(8, -16, 0), 3, true),
        cube(at(0, 0, 0), 1, false),
    ];
    fs::write(&path, written(cubes)).unwrap();
    let Ok(output) = Command::new("bt2vrml").arg(&path).output() else {
        skip("there is no program bt2vrml", "package octomap-tools");
        return;
    };
    let said = String::from_utf8_lossy(&output.stdout);
    let said = format!("{said}{}", String::from_utf8_lossy(&output.stderr));
    assert!(said.contains("Finished writing 2 voxels"), "{said}");
    let boxes = fs::read_to_string(folder.path().join("voxels.bt.wrl")).unwrap();
    // Centres of both cubes: the voxel of 0.1 m, and the cube of 0.8 m.
    for centre in ["-0.05 0.25 0.35", "1.2 -1.2 0.4"] {
        assert!(boxes.contains(centre), "{centre} is not in {boxes}");
    }
}
