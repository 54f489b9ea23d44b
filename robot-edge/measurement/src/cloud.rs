//! Clouds of three-dimensional lidars.

/// Points of a three-dimensional lidar in the order in which they were measured.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cloud {
    /// Points with a return.
    pub points: Vec<CloudPoint>,
}

/// One return.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudPoint {
    /// In the frame of the measurement, metres.
    pub position_m: [f32; 3],
    /// From the measurement's stamp, seconds.
    pub after_s: f32,
    /// Reflectivity as the sensor gives it.
    pub intensity: f32,
    /// The laser that measured it, from 0 at the lowest; `None` if the source does not say.
    pub ring: Option<u16>,
}
