//! An entry of a store: cells, or a tombstone.

use crate::tile::{TILE_CELLS, TileCells, TileDigest};

/// One entry of a store.
#[derive(Clone, Debug)]
pub struct StoredTile {
    pub(super) revision: u64,
    pub(super) stamp_ns: i64,
    pub(super) digest: TileDigest,
    pub(super) known: u16,
    pub(super) content: Content,
}

#[derive(Clone, Debug)]
pub(super) enum Content {
    Cells(TileCells),
    /// Published as all unknown.
    Blank,
    /// Dropped to stay within the limit.
    Evicted,
}

impl StoredTile {
    /// The revision of its present state.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// Stamp of the newest measurement when it changed last, nanoseconds on the clock of the data.
    pub fn stamp_ns(&self) -> i64 {
        self.stamp_ns
    }

    /// The digest of its cells; of all-unknown cells where it holds none.
    pub fn digest(&self) -> TileDigest {
        self.digest
    }

    /// How many of its cells are known.
    pub fn known(&self) -> usize {
        usize::from(self.known)
    }

    /// Its cells; `None` where no cell is known.
    pub fn cells(&self) -> Option<&TileCells> {
        match &self.content {
            Content::Cells(cells) => Some(cells),
            Content::Blank | Content::Evicted => None,
        }
    }

    /// Whether it was dropped to stay within the store's limit.
    pub fn is_evicted(&self) -> bool {
        matches!(self.content, Content::Evicted)
    }
}

// A tile's known cells fit the u16 that counts them.
const _: () = assert!(TILE_CELLS <= u16::MAX as usize);
