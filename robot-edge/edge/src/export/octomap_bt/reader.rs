//! Reads a tree leaf by leaf, without building it: any bytes, in constant memory.

use super::{Child, Cube, FIRST_LINE, LEVELS, ORIGIN};
use mapping::grid::VoxelIndex;

/// Why bytes are no binary tree; offsets count from the file's first byte.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BtError {
    /// It begins otherwise.
    #[error("not a binary OctoMap: the first line must begin with `{FIRST_LINE}`")]
    FirstLine,
    /// A line of the header that cannot be understood.
    #[error("header line at byte {at}: {problem}")]
    Header {
        /// Where the line begins.
        at: usize,
        /// What is wrong with it.
        problem: String,
    },
    /// A line that must be there is not.
    #[error("the header, {bytes} bytes, has no `{key}` line")]
    Missing {
        /// What the line begins with.
        key: &'static str,
        /// Length of what was searched.
        bytes: usize,
    },
    /// The tree goes on where the file ends.
    #[error("the file ends at byte {at}, within the tree: it was cut off")]
    CutOff {
        /// The file's length.
        at: usize,
    },
    /// An inner node among the smallest voxels.
    #[error("node at byte {at}: it has children below the 16th level")]
    TooDeep {
        /// Where the node is.
        at: usize,
    },
    /// An inner node that says nothing.
    #[error("node at byte {at}: it is an inner node without children")]
    Childless {
        /// Where the node is.
        at: usize,
    },
    /// There is more than the tree.
    #[error("the tree ends at byte {at}, and {bytes} more bytes follow")]
    Trailing {
        /// Where the tree ends.
        at: usize,
        /// How much follows.
        bytes: usize,
    },
    /// The tree is not of the size that the header says.
    #[error("the header says {declared} nodes, the tree has {found}")]
    Size {
        /// In the header.
        declared: u64,
        /// In the tree.
        found: u64,
    },
}

/// Yields the leaves of a tree in the order of the file, and at its end an error where the file was not whole.
#[derive(Clone, Debug)]
pub struct BtReader<'a> {
    bytes: &'a [u8],
    at: usize,
    cell_m: f64,
    declared_nodes: u64,
    nodes: u64,
    /// The way down from the root: at most one node a level.
    path: Vec<Node>,
}

/// An inner node and how far it has been read.
#[derive(Clone, Copy, Debug)]
struct Node {
    children: u16,
    next: u8,
    /// Its children's edge is two to the power of this, voxels.
    child_edge_log2: u8,
    least: VoxelIndex,
}

impl<'a> BtReader<'a> {
    /// Reads the header of `bytes`, a whole file.
    pub fn new(bytes: &'a [u8]) -> Result<Self, BtError> {
        let header = Header::read(bytes)?;
        let mut reader = Self {
            bytes,
            at: header.bytes,
            cell_m: header.cell_m,
            declared_nodes: header.nodes,
            nodes: 0,
            path: Vec::with_capacity(LEVELS.into()),
        };
        // A tree without a single node has no root to be read either.
        if header.nodes > 0 {
            let least = VoxelIndex {
                x: -ORIGIN,
                y: -ORIGIN,
                z: -ORIGIN,
            };
            reader.nodes = 1;
            reader.enter(least, LEVELS)?;
        }
        Ok(reader)
    }

    /// Side of a voxel, metres.
    pub const fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// Reads the inner node whose edge is two to the power of `edge_log2`.
    fn enter(&mut self, least: VoxelIndex, edge_log2: u8) -> Result<(), BtError> {
        let at = self.at;
        let Some(child_edge_log2) = edge_log2.checked_sub(1) else {
            return Err(BtError::TooDeep { at });
        };
        let node = self.bytes.get(at..).and_then(<[u8]>::first_chunk);
        let cut_off = BtError::CutOff {
            at: self.bytes.len(),
        };
        let children = u16::from_le_bytes(*node.ok_or(cut_off)?);
        // An empty root is what OctoMap writes of a map that nothing was added to but the root.
        if children == 0 && edge_log2 < LEVELS {
            return Err(BtError::Childless { at });
        }
        self.at += 2;
        self.path.push(Node {
            children,
            next: 0,
            child_edge_log2,
            least,
        });
        Ok(())
    }

    fn next_leaf(&mut self) -> Result<Option<Cube>, BtError> {
        while let Some(node) = self.path.last_mut() {
            if node.next == 8 {
                self.path.pop();
                continue;
            }
            let number = node.next;
            node.next += 1;
            let (edge_log2, least) = (node.child_edge_log2, node.child_least(number));
            let child = Child::of(node.children, number);
            self.nodes += u64::from(child != Child::Unknown);
            match child {
                Child::Unknown => {}
                Child::Inner => self.enter(least, edge_log2)?,
                Child::Free | Child::Occupied => {
                    return Ok(Some(Cube {
                        least,
                        edge_log2,
                        is_occupied: child == Child::Occupied,
                    }));
                }
            }
        }
        self.check_end().map(|()| None)
    }

    fn check_end(&self) -> Result<(), BtError> {
        if self.nodes != self.declared_nodes {
            return Err(BtError::Size {
                declared: self.declared_nodes,
                found: self.nodes,
            });
        }
        match self.bytes.len() - self.at {
            0 => Ok(()),
            bytes => Err(BtError::Trailing { at: self.at, bytes }),
        }
    }
}

impl Iterator for BtReader<'_> {
    type Item = Result<Cube, BtError>;

    /// After an error there is nothing more.
    fn next(&mut self) -> Option<Self::Item> {
        let next = self.next_leaf().transpose();
        if !matches!(next, Some(Ok(_))) {
            self.path.clear();
            self.at = self.bytes.len();
            self.declared_nodes = self.nodes;
        }
        next
    }
}

impl Node {
    fn child_least(&self, number: u8) -> VoxelIndex {
        let along = |bit: u8| i32::from((number >> bit) & 1) << self.child_edge_log2;
        VoxelIndex {
            x: self.least.x + along(0),
            y: self.least.y + along(1),
            z: self.least.z + along(2),
        }
    }
}

/// What stands before the tree.
#[derive(Debug)]
struct Header {
    bytes: usize,
    nodes: u64,
    cell_m: f64,
}

impl Header {
    fn read(bytes: &[u8]) -> Result<Self, BtError> {
        if !bytes.starts_with(FIRST_LINE.as_bytes()) {
            return Err(BtError::FirstLine);
        }
        let (mut id, mut nodes, mut cell_m) = (None, None, None);
        let mut at = 0;
        loop {
            let missing = |key| BtError::Missing { key, bytes: at };
            let Some(length) = bytes[at..].iter().position(|byte| *byte == b'\n') else {
                return Err(missing("data"));
            };
            let problem = |problem: String| BtError::Header { at, problem };
            let Ok(line) = str::from_utf8(&bytes[at..at + length]) else {
                return Err(problem("it is no text".into()));
            };
            let mut words = line.split_ascii_whitespace();
            match (words.next(), words.next()) {
                (None, _) => {}
                (Some(word), _) if word.starts_with('#') => {}
                (Some("data"), _) => {
                    id.ok_or_else(|| missing("id"))?;
                    return Ok(Self {
                        bytes: at + length + 1,
                        nodes: nodes.ok_or_else(|| missing("size"))?,
                        cell_m: cell_m.ok_or_else(|| missing("res"))?,
                    });
                }
                (Some("id"), Some("OcTree")) => id = Some(()),
                (Some("id"), Some(other)) => {
                    let other: String = other.chars().take(40).collect();
                    return Err(problem(format!("a tree of type `{other}`, not `OcTree`")));
                }
                (Some("size"), Some(number)) => {
                    let parsed = number.parse();
                    nodes = Some(parsed.map_err(|error| problem(format!("size: {error}")))?);
                }
                (Some("res"), Some(number)) => {
                    let parsed = number.parse().ok();
                    let metres = parsed.filter(|metres: &f64| metres.is_finite() && *metres > 0.0);
                    let metres = metres.ok_or_else(|| problem("res is no length".into()))?;
                    cell_m = Some(metres);
                }
                (Some(word), _) => {
                    let word: String = word.chars().take(40).collect();
                    return Err(problem(format!("`{word}` is not known or lacks a value")));
                }
            }
            at += length + 1;
        }
    }
}
