//! The range of an echo sounder as a sweep of one beam, along the sensor's x axis.

use measurement::MeasurementData;
use measurement::scan::Scan;

/// Not a number for no range, infinite for no echo.
pub(crate) fn single_beam(range_m: f64, [range_min_m, range_max_m]: [f32; 2]) -> MeasurementData {
    let range_m = range_m as f32;
    let range_m = if range_m < range_min_m {
        f32::NAN
    } else if range_m >= range_max_m {
        f32::INFINITY
    } else {
        range_m
    };
    MeasurementData::Scan {
        scan: Scan {
            range_min_m,
            range_max_m,
            ranges_m: vec![range_m],
            ..Scan::default()
        },
        own_pose: None,
    }
}
