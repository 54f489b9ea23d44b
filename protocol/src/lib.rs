//! What both sides of Foreshore agree on.
//!
//! Read in this order: a [`layer`] says what a map cell means; a [`tile`] carries 64×64 cells of one
//! layer; the [`tile_store`] holds every tile ever published, on either side; a [`mosaic`] joins tiles
//! into one raster; an [`export`] writes a raster to a file. [`keys`], [`wire`] and [`message`] say how all
//! of it crosses the network, and `SPEC.md` says it for other languages; what an operator
//! wants is [`signed`]. [`shores`] are what a class layer cannot say: which cells are one shore, and where one
//! could dock; [`geodesy`] puts them on Earth.

#![warn(missing_docs)]

pub mod export;
pub mod geodesy;
pub mod keys;
pub mod layer;
pub mod message;
pub mod mosaic;
pub mod name;
pub mod packed_file;
pub mod shores;
pub mod signed;
pub mod tile;
pub mod tile_store;
pub mod wire;
