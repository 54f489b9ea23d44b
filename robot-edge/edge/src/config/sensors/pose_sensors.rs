//! The sensors that poses are made of where nothing says them ready-made.

use std::collections::BTreeMap;

use super::{GpsConfig, ImuConfig, SensorConfig, WheelEncodersConfig};

/// A sensor and the name that it has.
type Named<'a, T> = (&'a str, &'a T);

/// Wheels and attitude, from which poses are reckoned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WheelsAndAttitude<'a> {
    /// The only encoders.
    pub encoders: Named<'a, WheelEncodersConfig>,
    /// The only attitude sensor.
    pub imu: Named<'a, ImuConfig>,
}

/// Satellite fixes and attitude, which are poses on Earth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FixesAndAttitude<'a> {
    /// The only receiver.
    pub gps: Named<'a, GpsConfig>,
    /// The only attitude sensor.
    pub imu: Named<'a, ImuConfig>,
}

impl<'a> WheelsAndAttitude<'a> {
    /// Those of `sensors`.
    ///
    /// # Errors
    /// Unless there is exactly one of each: how many encoders and attitude sensors there are.
    pub fn of(sensors: &'a BTreeMap<String, SensorConfig>) -> Result<Self, (usize, usize)> {
        let encoders = all(sensors, SensorConfig::wheel_encoders);
        let imus = all(sensors, SensorConfig::imu);
        match (&encoders[..], &imus[..]) {
            (&[encoders], &[imu]) => Ok(Self { encoders, imu }),
            (encoders, imus) => Err((encoders.len(), imus.len())),
        }
    }
}

impl<'a> FixesAndAttitude<'a> {
    /// Those of `sensors`.
    ///
    /// # Errors
    /// Unless there is exactly one of each: how many receivers and attitude sensors there are.
    pub fn of(sensors: &'a BTreeMap<String, SensorConfig>) -> Result<Self, (usize, usize)> {
        let receivers = all(sensors, SensorConfig::gps);
        let imus = all(sensors, SensorConfig::imu);
        match (&receivers[..], &imus[..]) {
            (&[gps], &[imu]) => Ok(Self { gps, imu }),
            (receivers, imus) => Err((receivers.len(), imus.len())),
        }
    }
}

fn all<'a, T>(
    sensors: &'a BTreeMap<String, SensorConfig>,
    of_kind: impl Fn(&'a SensorConfig) -> Option<&'a T>,
) -> Vec<Named<'a, T>> {
    let named = sensors
        .iter()
        .filter_map(|(name, sensor)| Some((name.as_str(), of_kind(sensor)?)));
    named.collect()
}
