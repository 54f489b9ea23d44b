//! Values that several satellite receivers send.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// A time of the receiver. Bits of `valid`: 1 date, 2 time of day, 4 leap seconds known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the names say it")]
pub struct Utc {
    pub year: u16,
    pub month: u8,
    pub day: u8,
    pub hour: u8,
    pub minute: u8,
    pub second: u8,
    /// −1,000,000,000 to 1,000,000,000.
    pub nanosecond: i32,
    pub valid: u8,
}

impl Utc {
    /// `None` if a date or time claims to be valid and is not one.
    pub(crate) fn new(year: u16, month_to_valid: [u8; 6], nanosecond: i32) -> Option<Self> {
        let [month, day, hour, minute, second, valid] = month_to_valid;
        let is_date = (1..=12).contains(&month) && (1..=31).contains(&day);
        let is_time = hour < 24 && minute < 60 && second <= 60;
        let is_possible = (is_date || valid & 1 == 0)
            && (is_time || valid & 2 == 0)
            && nanosecond.unsigned_abs() <= 1_000_000_000;
        is_possible.then_some(Self {
            year,
            month,
            day,
            hour,
            minute,
            second,
            nanosecond,
            valid,
        })
    }
}

/// Position on WGS-84 with its accuracy (1 σ).
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs, reason = "the names say it")]
pub struct GnssPosition {
    pub latitude_deg: f64,
    pub longitude_deg: f64,
    pub height_above_ellipsoid_m: f64,
    pub height_above_sea_m: f64,
    pub horizontal_accuracy_m: f64,
    pub vertical_accuracy_m: f64,
}

/// Velocity; headings clockwise from north.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs, reason = "the names say it")]
pub struct GnssVelocity {
    /// North, east, down.
    pub ned_mps: [f64; 3],
    pub ground_speed_mps: f64,
    pub heading_of_motion_rad: f64,
    pub speed_accuracy_mps: f64,
    pub heading_accuracy_rad: f64,
    pub heading_of_vehicle_rad: Option<f64>,
}

/// Whether degrees are those of a position.
pub(crate) fn is_on_earth(latitude_deg: f64, longitude_deg: f64) -> bool {
    latitude_deg.abs() <= 90.0 && longitude_deg.abs() <= 180.0
}

/// Yaw in ENU (counter-clockwise from east, −π to π) of a heading clockwise from north.
pub fn enu_yaw_rad(heading_rad: f64) -> f64 {
    PI - (heading_rad + FRAC_PI_2).rem_euclid(TAU)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_become_yaw_in_enu() {
        for (heading_deg, yaw_deg) in [
            (0.0_f64, 90.0_f64),
            (90.0, 0.0),
            (180.0, -90.0),
            (270.0, 180.0),
            (360.0, 90.0),
        ] {
            let error_rad = enu_yaw_rad(heading_deg.to_radians()) - yaw_deg.to_radians();
            assert!(error_rad.abs() < 1e-12, "{heading_deg}");
        }
    }
}
