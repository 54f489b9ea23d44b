//! The end of a run: consoles get what they lack before the link closes.

use super::{CONSOLE_SYNC_TIMEOUT, FINAL_STATUS_DELAY, Network};
use crate::clock;
use crate::pipeline::Maps;
use protocol::layer::LayerId;
use std::io::{self, Write};
use std::time::Duration;

impl Network {
    /// The data has ended: waits until every console has all of it, or for good where that was asked for.
    pub(in crate::app) fn wait_for_consoles(
        &self,
        maps: &Maps,
        quiet: bool,
        is_interrupted: impl Fn() -> bool,
    ) {
        let revision = head_revision(maps);
        let publish_state = self.link.publish_state();
        let is_interrupted = || {
            self.serve_octree_files(maps, true);
            is_interrupted()
        };
        // Who hears of the end and asks hears of the whole.
        self.serve_octree_files(maps, true);
        publish_state.end();
        if self.keep_serving {
            if !quiet && !is_interrupted() {
                // Nothing is lost where standard error is closed.
                drop(writeln!(
                    io::stderr(),
                    "network: the data has ended, the map is served until Ctrl-C"
                ));
            }
            while clock::sleep_until(clock::now() + Duration::from_secs(1), is_interrupted) {}
            return;
        }
        let ended = clock::now();
        let is_over = || {
            let now = clock::now();
            let no_consoles = publish_state.views(now).is_empty();
            let all_informed = now.since(ended) >= FINAL_STATUS_DELAY
                && publish_state.all_consoles_have(revision, now);
            is_interrupted() || no_consoles || all_informed
        };
        clock::sleep_until(ended + CONSOLE_SYNC_TIMEOUT, is_over);
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
