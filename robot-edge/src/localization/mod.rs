//! To be filled.

pub mod config;
