//! Numbers of a world file, checked while they are read so that an error knows its line.

use std::ops::RangeInclusive;

use serde::Deserialize;

/// A number that is finite and at most 10⁶ in size, which bounds every world.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(try_from = "f64")]
pub(super) struct Coordinate(pub(super) f64);

/// A [`Coordinate`] that is at least 10⁻⁶.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "f64")]
pub(super) struct Positive(pub(super) f64);

/// A [`Coordinate`] that is not below 0.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(try_from = "f64")]
pub(super) struct NotNegative(pub(super) f64);

/// A number from 0 to 1.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(try_from = "f64")]
pub(super) struct Probability(pub(super) f64);

/// An angle from 0 to 180.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "f64")]
pub(super) struct HalfTurnDegrees(pub(super) f64);

/// A share by which something reads too much: from −0.9, below which it would hardly read anything, to 10.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(try_from = "f64")]
pub(super) struct ScaleError(pub(super) f64);

impl TryFrom<f64> for Coordinate {
    type Error = String;
    fn try_from(value: f64) -> Result<Self, String> {
        within(value, -1e6..=1e6).map(Self)
    }
}

impl TryFrom<f64> for Positive {
    type Error = String;
    fn try_from(value: f64) -> Result<Self, String> {
        within(value, 1e-6..=1e6).map(Self)
    }
}

impl TryFrom<f64> for NotNegative {
    type Error = String;
    fn try_from(value: f64) -> Result<Self, String> {
        within(value, 0.0..=1e6).map(Self)
    }
}

impl TryFrom<f64> for Probability {
    type Error = String;
    fn try_from(value: f64) -> Result<Self, String> {
        within(value, 0.0..=1.0).map(Self)
    }
}

impl TryFrom<f64> for HalfTurnDegrees {
    type Error = String;
    fn try_from(value: f64) -> Result<Self, String> {
        within(value, 0.0..=180.0).map(Self)
    }
}

impl TryFrom<f64> for ScaleError {
    type Error = String;
    fn try_from(value: f64) -> Result<Self, String> {
        within(value, -0.9..=10.0).map(Self)
    }
}

fn within(value: f64, bounds: RangeInclusive<f64>) -> Result<f64, String> {
    if bounds.contains(&value) {
        Ok(value)
    } else {
        let (least, most) = bounds.into_inner();
        Err(format!("{value} is not between {least} and {most}"))
    }
}
