//! Lidars that send packets that others recorded; `None`, with a notice, if the recordings are not on this machine.

use std::path::PathBuf;

use emulators::packets::Packets;

use crate::shared_data::shared_data;

/// Bytes of a column of `os0-32_fw2.2.pcap`: a header of 12, and 32 pixels of 16.
const COLUMN: usize = 12 + 32 * 16;

pub(crate) fn vlp16() -> Option<Packets> {
    Some(Packets::of_velodyne(
        &shared_data("velodyne")?.join("vlp16_packets.db3"),
    ))
}

/// The OS0 and the file of its metadata.
pub(crate) fn os0() -> Option<(Packets, PathBuf)> {
    let folder = shared_data("ouster")?;
    let packets = Packets::of_ouster(&folder.join("os0-32_fw2.2.pcap"), 1, COLUMN);
    Some((packets, folder.join("os0-32_fw2.2.json")))
}
