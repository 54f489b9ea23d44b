//! The end of a run: consoles get what they lack before the link closes.

use super::{FAREWELL, LAST_WORDS, Network};
use crate::clock::{self, Monotonic};
use crate::pipeline::Maps;
use protocol::layer::LayerId;
use std::io::{self, Write};
use std::time::Duration;

impl Network {
    /// The data has ended: waits until every console has all of it, or for good where that was asked for.
    pub(in crate::app) fn take_leave(
        &self,
        maps: &Maps,
        quiet: bool,
        is_interrupted: impl Fn() -> bool,
    ) {
        let revision = head_revision(maps);
        let shared = self.link.shared();
        let is_interrupted = || {
            self.serve_voxels(maps, true);
            is_interrupted()
        };
        // Who hears of the end and asks hears of the whole.
        self.serve_voxels(maps, true);
        shared.end();
        if self.stay {
            if !quiet && !is_interrupted() {
                // Nothing is lost where standard error is closed.
                drop(writeln!(
                    io::stderr(),
                    "network: the data has ended, the map is served until Ctrl-C"
                ));
            }
            while clock::sleep_until(Monotonic::now() + Duration::from_secs(1), is_interrupted) {}
            return;
        }
        let ended = Monotonic::now();
        let is_over = || {
            let now = Monotonic::now();
            let nobody_looks = shared.views(now).is_empty();
            let everybody_knows =
                now.since(ended) >= LAST_WORDS && shared.everybody_has(revision, now);
            is_interrupted() || nobody_looks || everybody_knows
        };
        clock::sleep_until(ended + FAREWELL, is_over);
    }
}

/// The newest revision of any layer.
fn head_revision(maps: &Maps) -> u64 {
    let store = maps.publisher().store();
    LayerId::ALL
        .into_iter()
        .map(|layer| store.head_revision(layer))
        .max()
        .unwrap_or(0)
}
