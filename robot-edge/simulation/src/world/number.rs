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

/// How long ago, seconds: at most 10, beyond which it is no lag.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(try_from = "f64")]
pub(super) struct LagSeconds(pub(super) f64);

/// Period of waves, seconds: those of shorter than 0.3 are ripples that surface tension drives, those of
/// longer than 30 are no wind's.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "f64")]
pub(super) struct WavePeriod(pub(super) f64);
/// Least and greatest of something, from 0 to 20: no plant of a world is larger.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(try_from = "[f64; 2]")]
pub(super) struct Between(pub(super) [f64; 2]);

/// Least and greatest thickness, from 10⁻³ mm to 1000 mm.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "[f64; 2]")]
pub(super) struct BetweenMillimetres(pub(super) [f64; 2]);

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

impl TryFrom<f64> for LagSeconds {
    type Error = String;
    fn try_from(value: f64) -> Result<Self, String> {
        within(value, 0.0..=10.0).map(Self)
    }
}

impl TryFrom<f64> for WavePeriod {
    type Error = String;
    fn try_from(value: f64) -> Result<Self, String> {
        within(value, 0.3..=30.0).map(Self)
    }
}

impl TryFrom<[f64; 2]> for Between {
    type Error = String;
    fn try_from(values: [f64; 2]) -> Result<Self, String> {
        ordered_within(values, 0.0..=20.0).map(Self)
    }
}

impl TryFrom<[f64; 2]> for BetweenMillimetres {
    type Error = String;
    fn try_from(values: [f64; 2]) -> Result<Self, String> {
        ordered_within(values, 1e-3..=1e3).map(Self)
    }
}

fn ordered_within(values: [f64; 2], bounds: RangeInclusive<f64>) -> Result<[f64; 2], String> {
    let [least, most] = values;
    within(least, bounds.clone())?;
    within(most, bounds)?;
    if least <= most {
        Ok(values)
    } else {
        Err(format!("the least, {least}, is more than the most, {most}"))
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
