//! `SPEC.md` and the code are held together: every example in the document is built from the values that
//! it states and compared byte by byte, and every message, field, layer, key and limit must be in it.

#![allow(
    clippy::unwrap_used,
    reason = "the lint knows functions marked as tests, not what they call"
)]

mod document;
mod messages;
mod signed;
mod tables;
mod tiles;
