//! What a robot says of itself: who it is, and how mapping is doing.

use protocol::message::{DropCount, Info, LayerInfo, Status};

use super::data_clock::DataClock;
use super::map_stats::MapStats;
use super::network::RobotDescription;
use crate::config::Config;
use crate::pipeline::Maps;
use localization::registration::RegistrationCounts;
use measurement::drops::DropCounts;

/// Who the robot is and what it maps.
pub(super) fn build_info(config: &Config, description: &RobotDescription<'_>, maps: &Maps) -> Info {
    let vehicle = &config.vehicle;
    let teleop = &config.teleop;
    Info {
        vehicle: vehicle.name.clone(),
        source: description.source.to_owned(),
        footprint_m: [vehicle.length_m, vehicle.width_m].map(|metres| metres as f32),
        limits: [vehicle.max_speed_mps, vehicle.max_turn_rate_radps].map(|limit| limit as f32),
        layers: maps
            .publisher()
            .store()
            .grids()
            .map(|grid| LayerInfo {
                layer: grid.layer,
                cell_m: grid.cell_m,
            })
            .collect(),
        revision: 0,
        program: env!("CARGO_PKG_VERSION").to_owned(),
        is_boat: teleop.is_boat,
        stop_decel_mps2: teleop.stop_decel_mps2 as f32,
        stop_decel_radps2: teleop.stop_decel_radps2 as f32,
        max_command_age_ms: teleop.max_command_age_ms,
        can_record: description.can_record,
        // As far as they are known: the link adds them.
        sensors: Vec::new(),
        footprint_offset_m: vehicle.footprint_offset_m as f32,
    }
}

/// How mapping is doing.
pub(super) fn build_status(
    maps: &MapStats,
    registration: RegistrationCounts,
    clock: &DataClock,
    lost: u64,
) -> Status {
    let mut dropped: DropCounts = registration.dropped_scans;
    dropped.merge(&maps.dropped_scans);
    dropped.merge(&registration.dropped_poses);
    dropped.merge(&registration.dropped_beams);
    dropped.merge(&maps.dropped_beams);
    let reasons = dropped
        .iter()
        .map(|(reason, count)| (reason.to_string(), count));
    let lost = (lost > 0).then(|| ("lost_by_source".to_owned(), lost));
    Status {
        data_time_ns: clock.elapsed().as_nanos(),
        scans_in: registration.scans_in,
        scans_mapped: maps.scans_mapped,
        drops: reasons
            .chain(lost)
            .map(|(name, count)| DropCount { name, count })
            .collect(),
        ..Status::default()
    }
}
