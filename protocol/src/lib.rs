//! Layers, tiles, exports and messages that `robot-edge` and `operator-console` share.
//!
//! Suggested reading order: a [`layer`] defines the meaning of a map cell; a [`tile`] holds 64×64 cells of one
//! layer; the [`tile_store`] holds all published tiles, on either side; a [`mosaic`] joins tiles into one raster; an
//! [`export`] writes a raster to a file. [`keys`], [`wire`] and [`message`] define the network messages, as
//! `SPEC.md` does for other languages; [`signed`] commands are authenticated, [`shores`] are bounded and checked,
//! [`geodesy`] converts to WGS-84.

#![warn(missing_docs)]

pub mod contours;
pub mod export;
pub mod geodesy;
pub mod keys;
pub mod layer;
pub mod message;
pub mod mosaic;
pub mod packed_file;
pub mod shores;
pub mod signed;
pub mod tile;
pub mod tile_store;
pub mod wire;

#[cfg(test)]
#[path = "../../tests/tests/all/gdal.rs"]
mod gdal;
#[cfg(test)]
#[path = "../../tests/tests/all/skip.rs"]
mod skip;
