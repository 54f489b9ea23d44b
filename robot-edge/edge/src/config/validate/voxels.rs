//! Which values make sense for the octree and what is made of it.

use crate::config::checks::{Allowed, Checks};
use mapping::MappingConfig;
use mapping::scan_metrics::MetricsConfig;
use mapping::shore::ShoreConfig;

/// Sides of voxels, metres.
const CELL_M: Allowed = Allowed::Within(0.01, 10.0);

pub(super) fn voxels(checks: &mut Checks, mapping: &MappingConfig) {
    octree(checks, mapping);
    cost(checks, mapping);
    metrics(checks, &mapping.metrics);
    shore(checks, &mapping.shore);
    needs(checks, mapping);
}

fn octree(checks: &mut Checks, mapping: &MappingConfig) {
    let octree = &mapping.octree;
    let key = |name: &str| format!("mapping.octree.{name}");
    let cell = "smaller voxels are finer than lasers measure, larger ones than robots move";
    checks.number(&key("cell_m"), octree.cell_m, CELL_M, cell);
    let free = "a voxel that is seen through becomes free, so its probability falls below 0.5";
    let allowed = Allowed::Within(0.001, 0.499);
    checks.number(&key("p_min"), octree.p_min, allowed, free);
    let occupied = "a voxel that is hit becomes occupied, so its probability rises above 0.5";
    let allowed = Allowed::Within(0.501, 0.999);
    checks.number(&key("p_max"), octree.p_max, allowed, occupied);
    let memory = "there must be room for what surrounds the vehicle";
    let limit_mb = octree.memory_limit_mb.into();
    checks.whole(&key("memory_limit_mb"), limit_mb, 1, 65536, memory);
}

fn cost(checks: &mut Checks, mapping: &MappingConfig) {
    let (cost, rigidity) = (&mapping.cost, &mapping.rigidity);
    let mut number = |key: &str, value: f64, allowed, why| {
        checks.number(&format!("mapping.{key}"), value, allowed, why);
    };
    let cell_m = mapping.octree.cell_m;
    // A cell that is itself not allowed says nothing of the box.
    if CELL_M.contains(cell_m) {
        // 2000 columns along an edge are 4 million of some 60 bytes.
        let allowed = Allowed::Within(1.0, 2000.0 * cell_m);
        let size = "the box holds the vehicle and at most 2000 columns along an edge";
        number("cost.box_m", cost.box_m, allowed, size);
    }
    let reach = "the box must hold the ground under the vehicle and what stands on it";
    number(
        "cost.box_half_height_m",
        cost.box_half_height_m,
        Allowed::Within(0.5, 50.0),
        reach,
    );
    let slope = "it lies between level and upright";
    let allowed = Allowed::Within(1.0, 80.0);
    number(
        "cost.critical_slope_deg",
        cost.critical_slope_deg,
        allowed,
        slope,
    );
    let period = "updates cost time, and the map should not be old";
    number(
        "cost.period_s",
        cost.period_s,
        Allowed::Within(0.01, 60.0),
        period,
    );
    let threshold = "it is a value of a metric, 0 to 1";
    let unit = Allowed::Within(0.0, 1.0);
    number(
        "rigidity.intra_threshold",
        rigidity.intra_threshold,
        unit,
        threshold,
    );
    number(
        "rigidity.inter_threshold",
        rigidity.inter_threshold,
        unit,
        threshold,
    );
    let traversable = "1 would be lethal";
    let allowed = Allowed::Within(0.0, 0.996);
    number(
        "rigidity.traversable_vegetation_cost",
        rigidity.traversable_vegetation_cost,
        allowed,
        traversable,
    );
}

fn metrics(checks: &mut Checks, metrics: &MetricsConfig) {
    let mut number = |key: &str, value: f64, allowed, why| {
        checks.number(&format!("mapping.metrics.{key}"), value, allowed, why);
    };
    let range = "beams beyond it have no metrics";
    number(
        "max_range_m",
        metrics.max_range_m,
        Allowed::PositiveUpTo(1000.0),
        range,
    );
    let length = "it is a length of the things that are told apart";
    number(
        "intra_sigma_m",
        metrics.intra_sigma_m,
        Allowed::PositiveUpTo(10.0),
        length,
    );
    number(
        "intra_width_m",
        metrics.intra_width_m,
        Allowed::PositiveUpTo(10.0),
        length,
    );
    number(
        "inter_full_m",
        metrics.inter_full_m,
        Allowed::PositiveUpTo(10.0),
        length,
    );
    let weight = "it is the share of the newest value in the average";
    number(
        "weight",
        metrics.weight,
        Allowed::Within(0.001, 1.0),
        weight,
    );
}

fn shore(checks: &mut Checks, shore: &ShoreConfig) {
    let mut number = |key: &str, value: f64, allowed, why| {
        checks.number(&format!("mapping.shore.{key}"), value, allowed, why);
    };
    let unit = Allowed::Within(0.0, 1.0);
    let threshold = "it is a value of a metric, 0 to 1";
    number("intra_threshold", shore.intra_threshold, unit, threshold);
    number("inter_threshold", shore.inter_threshold, unit, threshold);
    let gap = "it is the gap between the voxels of one shore";
    number(
        "cluster_m",
        shore.cluster_m,
        Allowed::PositiveUpTo(100.0),
        gap,
    );
    let share = "it is a share of rigid voxels, and Sparse comes before Solid";
    number(
        "sparse_below",
        shore.sparse_below,
        Allowed::Within(0.0, shore.solid_above),
        share,
    );
    number("solid_above", shore.solid_above, unit, share);
    let period = "clustering costs time, and classes should not be old";
    number(
        "period_s",
        shore.period_s,
        Allowed::Within(0.01, 60.0),
        period,
    );
}

/// What is made of something else needs it.
fn needs(checks: &mut Checks, mapping: &MappingConfig) {
    let layers = [
        (
            "cost",
            mapping.cost.enabled,
            "octree",
            mapping.octree.enabled,
        ),
        (
            "rigidity",
            mapping.rigidity.enabled,
            "cost",
            mapping.cost.enabled,
        ),
        ("shore", mapping.shore.enabled, "cost", mapping.cost.enabled),
    ];
    for (layer, is_enabled, needed, is_there) in layers {
        if is_enabled && !is_there {
            checks.issue(
                &format!("mapping.{layer}.enabled"),
                "true".to_owned(),
                "it is made of another layer, which is not mapped",
                format!("false, or true in mapping.{needed}.enabled, too"),
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_box_is_not_judged_by_a_cell_that_is_not_allowed() {
        let keys = |cell_m: f64, box_m: f64| -> Vec<String> {
            let mut mapping = MappingConfig::default();
            mapping.octree.cell_m = cell_m;
            mapping.cost.box_m = box_m;
            let mut checks = Checks::default();
            octree(&mut checks, &mapping);
            cost(&mut checks, &mapping);
            let issues = checks.into_issues().into_iter();
            issues.map(|issue| issue.key).collect()
        };
        let (cell, of_box) = ("mapping.octree.cell_m", "mapping.cost.box_m");
        for cell_m in [-3.0, 0.0, 0.001, 11.0, f64::NAN] {
            assert_eq!(keys(cell_m, 40.0), [cell], "{cell_m}");
        }
        assert_eq!(keys(0.1, 500.0), [of_box]);
        assert!(keys(0.1, 40.0).is_empty());
    }
}
