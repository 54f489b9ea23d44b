//! The summary at the end of an MCAP file repeats its schemas and channels: with them, messages can be read
//! whose own definitions are lost in a damaged chunk.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};

use super::magic::MAGIC;
use super::record::{self, op};

/// Larger summaries are not read: they hold indexes of files of hundreds of gigabytes.
const MAX_SUMMARY_BYTES: u64 = 16 << 20;

/// Opcode, length and body of the footer, and the end mark.
const END_BYTES: u64 = 9 + 20 + MAGIC.len() as u64;

/// The summary section of `file`; empty where it has none, or not a whole one.
pub(super) fn read(file: &mut File) -> io::Result<Vec<u8>> {
    let length = file.metadata()?.len();
    let Some(footer_at) = length.checked_sub(END_BYTES) else {
        return Ok(Vec::new());
    };
    file.seek(SeekFrom::Start(footer_at))?;
    let mut end = [0; END_BYTES as usize];
    file.read_exact(&mut end)?;
    let [opcode, footer @ ..] = end;
    let start = footer
        .get(8..16)
        .and_then(<[u8]>::first_chunk)
        .map_or(0, |raw| u64::from_le_bytes(*raw));
    let is_whole = opcode == op::FOOTER && end.ends_with(&MAGIC);
    if !is_whole || start == 0 || start > footer_at || footer_at - start > MAX_SUMMARY_BYTES {
        return Ok(Vec::new());
    }
    file.seek(SeekFrom::Start(start))?;
    let mut summary = vec![0; (footer_at - start) as usize];
    file.read_exact(&mut summary)?;
    Ok(summary)
}

/// The schemas and channels in a summary, opcode and body, in file order.
pub(super) fn definitions(summary: &[u8]) -> impl Iterator<Item = (u8, &[u8])> {
    record::any_records(summary).filter(|(opcode, _)| matches!(*opcode, op::SCHEMA | op::CHANNEL))
}
