//! Which recordings are measured, and where they are.

use std::path::PathBuf;

/// Small, and always there.
pub(crate) const ROOMS: &str = "rooms.mcap";
/// A raw log of a SICK laser indoors: 7374 scans of 180 beams.
pub(crate) const ACES: &str = "carmen/aces.clf";
/// The longest way, 1.4 km, and the longest beams, up to 80 m: 6917 scans of 180.
pub(crate) const CLINIC: &str = "carmen/fr-clinic_robotlaser.clf";
/// The scans of a CARMEN log as ROS 2 messages.
pub(crate) const INTEL_MCAP: &str = "mcap/intel_corrected.mcap";
/// A ROS 1 bag.
pub(crate) const TWO_LASERS: &str = "rosbag1/two_lasers.bag";

/// The path of a recording; `None`, said aloud, where it is not on this machine.
pub(crate) fn find(name: &str) -> Option<PathBuf> {
    let path = if name == ROOMS {
        PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../recordings")).join(name)
    } else {
        let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data");
        let root = std::env::var_os("FORESHORE_DATA").map_or_else(|| beside.into(), PathBuf::from);
        root.join(name)
    };
    let found = path.is_file().then_some(path);
    if found.is_none() {
        println!("skipped: {name} is not on this machine");
    }
    found
}
