//! Checks `SPEC.md` against the code: every example is built from its stated values and compared
//! byte by byte, and every message, field, layer, key and limit must be in it.

#![allow(
    clippy::unwrap_used,
    reason = "the lint knows functions marked as tests, not what they call"
)]

mod document;
mod messages;
mod signed;
mod tables;
mod tiles;
