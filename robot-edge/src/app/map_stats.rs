//! What the placing side tells of mapping.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::pipeline::MapsReport;
use measurement::drops::DropCounts;

/// Figures of the maps.
#[derive(Clone, Debug, Default)]
pub(super) struct MapStats {
    /// Scans that are in the map.
    pub(super) scans_mapped: u64,
    /// Placed scans that were left out, by reason.
    pub(super) dropped_scans: DropCounts,
    /// Beams that no layer could take, by reason.
    pub(super) dropped_beams: DropCounts,
}

/// The same for both sides. It is held for as long as copying it takes.
#[derive(Clone, Debug, Default)]
pub(super) struct SharedMapStats(Arc<Mutex<MapStats>>);

impl SharedMapStats {
    pub(super) fn set(&self, report: &MapsReport) {
        let stats = MapStats {
            scans_mapped: report.scans_mapped,
            dropped_scans: report.dropped_scans.clone(),
            dropped_beams: report.dropped_beams.clone(),
        };
        *self.lock() = stats;
    }

    pub(super) fn get(&self) -> MapStats {
        self.lock().clone()
    }

    fn lock(&self) -> MutexGuard<'_, MapStats> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
