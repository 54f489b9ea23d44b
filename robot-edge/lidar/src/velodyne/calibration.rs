//! Calibration of one sensor: the YAML file that the ROS driver `velodyne_pointcloud` reads.
//!
//! Source of the keys and of what is done with them: `calibration.cc` and `unpack_vlp16` of ros-drivers/velodyne (BSD). Such a file
//! is one list of numbers for each laser, and only that is read here, in both ways in which YAML writes it: serde's YAML crate is not
//! maintained any more, and a whole parser would be many times as long. What the driver does to the lasers of an HDL-64E alone,
//! a second point of correction and the intensity by focal distance, is not done.

/// Why a calibration is not used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CalibrationError {
    /// A line that is none of such a file.
    #[error("line {0}: \"{1}\" is no key of a calibration with a number")]
    Line(usize, String),
    /// It is for no sensor that is decoded.
    #[error("it has {found} lasers with the numbers 0 to {last}; sensors have 16 or 32", last = found.saturating_sub(1))]
    Lasers {
        /// Lasers in the file.
        found: usize,
    },
    /// A laser is missing, or is there twice.
    #[error("laser {0} is not there exactly once")]
    Laser(usize),
    /// It is for an HDL-64E.
    #[error("a two-point correction, which only an HDL-64E has")]
    TwoPoints,
}

/// Where the lasers of one sensor are.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// By the laser's number.
    pub(super) lasers: Vec<Correction>,
    /// Metres of a step of range, if it differs.
    pub(super) step_m: Option<f64>,
}

/// Where one laser is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Correction {
    pub(super) elevation_rad: f64,
    /// Added to the azimuth, degrees.
    pub(super) turned_deg: f64,
    /// Added to the range, metres.
    pub(super) range_offset_m: f64,
    /// From the axis, metres.
    pub(super) left_m: f64,
    pub(super) up_m: f64,
}

impl Calibration {
    /// Reads a file's text.
    ///
    /// # Errors
    /// If it is none of a sensor with 16 or 32 lasers, with the place of the first problem.
    pub fn read(text: &str) -> Result<Self, CalibrationError> {
        let mut lasers: Vec<(Option<usize>, Correction)> = Vec::new();
        let mut step_m = None;
        for (line, number) in text.lines().zip(1..) {
            let content = line.split('#').next().unwrap_or_default();
            for part in content.split(['{', '}', ',']) {
                let mut part = part.trim();
                if let Some(rest) = part.strip_prefix('-')
                    && !rest.starts_with(|next: char| next.is_ascii_digit())
                {
                    lasers.push(Default::default());
                    part = rest.trim();
                }
                if matches!(part, "" | "lasers:") {
                    continue;
                }
                let wrong = || CalibrationError::Line(number, part.to_owned());
                let (key, value) = part.split_once(':').ok_or_else(wrong)?;
                let value = value.trim();
                if key == "two_pt_correction_available" {
                    match value {
                        "false" => continue,
                        _ => return Err(CalibrationError::TwoPoints),
                    }
                }
                let value: f64 = value
                    .parse()
                    .ok()
                    .filter(|value: &f64| value.is_finite())
                    .ok_or_else(wrong)?;
                match (key, lasers.last_mut()) {
                    ("distance_resolution", _) => step_m = Some(value),
                    ("laser_id", Some((id, _))) => *id = Some(value as usize),
                    ("vert_correction", Some((_, laser))) => laser.elevation_rad = value,
                    ("rot_correction", Some((_, laser))) => laser.turned_deg = -value.to_degrees(),
                    ("dist_correction", Some((_, laser))) => laser.range_offset_m = value,
                    ("horiz_offset_correction", Some((_, laser))) => laser.left_m = value,
                    ("vert_offset_correction", Some((_, laser))) => laser.up_m = value,
                    (
                        "dist_correction_x" | "dist_correction_y" | "focal_distance"
                        | "focal_slope" | "min_intensity" | "max_intensity",
                        Some(_),
                    )
                    | ("num_lasers", _) => {}
                    _ => return Err(wrong()),
                }
            }
        }
        let found = lasers.len();
        if !matches!(found, 16 | 32) {
            return Err(CalibrationError::Lasers { found });
        }
        let of_number = |number: usize| {
            let mut its = lasers.iter().filter(|(id, _)| *id == Some(number));
            match (its.next(), its.next()) {
                (Some((_, laser)), None) => Ok(*laser),
                _ => Err(CalibrationError::Laser(number)),
            }
        };
        Ok(Self {
            lasers: (0..found).map(of_number).collect::<Result<_, _>>()?,
            step_m,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sixteen lasers, of which `key` of the third is `value`, in one of both ways of writing.
    fn file(is_block: bool, key: &str, value: &str) -> String {
        let laser = |id: usize| {
            let value = if id == 2 { value } else { "0.0" };
            if is_block {
                format!("  - {key}: {value}\n    laser_id: {id}\n    vert_correction: -0.1\n")
            } else {
                format!("- {{{key}: {value}, laser_id: {id},\n  vert_correction: -0.1}}\n")
            }
        };
        let lasers: String = (0..16).map(laser).collect();
        format!("lasers:\n{lasers}num_lasers: 16 # all\ndistance_resolution: 0.004\n")
    }

    #[test]
    fn each_correction_is_read_in_both_ways_of_writing() {
        let third = |key: &str| {
            let both =
                [true, false].map(|is_block| Calibration::read(&file(is_block, key, "0.25")));
            assert_eq!(both[0], both[1]);
            let [read, _] = both.map(Result::unwrap);
            assert_eq!(read.step_m, Some(0.004));
            assert!((read.lasers[1].elevation_rad + 0.1).abs() < 1e-12);
            let laser = read.lasers[2];
            [
                laser.turned_deg.to_radians(),
                laser.range_offset_m,
                laser.left_m,
                laser.up_m,
            ]
        };
        for (key, expected) in [
            ("rot_correction", [-0.25, 0.0, 0.0, 0.0]),
            ("dist_correction", [0.0, 0.25, 0.0, 0.0]),
            ("horiz_offset_correction", [0.0, 0.0, 0.25, 0.0]),
            ("vert_offset_correction", [0.0, 0.0, 0.0, 0.25]),
            ("focal_slope", [0.0; 4]),
        ] {
            let found = third(key);
            let is_near = found
                .iter()
                .zip(expected)
                .all(|(found, expected)| (found - expected).abs() < 1e-12);
            assert!(is_near, "{key}: {found:?}");
        }
    }

    #[test]
    fn what_is_no_calibration_is_refused_with_its_place() {
        for (text, says) in [
            (String::new(), "it has 0 lasers"),
            (
                file(true, "dist_corection", "0"),
                "line 2: \"dist_corection: 0.0\" is no key",
            ),
            (
                file(true, "dist_correction", "x"),
                "line 8: \"dist_correction: x\" is no key",
            ),
            (file(true, "dist_correction", ".nan"), "line 8"),
            (
                file(true, "focal_slope", "0").replace("laser_id: 5", "laser_id: 6"),
                "laser 5 is not there exactly once",
            ),
            (
                file(false, "two_pt_correction_available", "true"),
                "a two-point correction",
            ),
            ("dist_correction: 1".to_owned(), "line 1"),
            ("[1, 2]".to_owned(), "line 1"),
        ] {
            let error = Calibration::read(&text).map(drop).unwrap_err().to_string();
            assert!(error.contains(says), "{text}: {error}");
        }
    }
}
