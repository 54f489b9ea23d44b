//! Which beams of a sweep are used: a sector, without those that hit the vehicle itself.

use std::f64::consts::TAU;
use std::fmt;

use measurement::scan::Scan;
use measurement::time::RobotDuration;

/// A range of angles about the sensor's z axis, counter-clockwise from the first to the second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AngleRange {
    /// First angle, radians.
    pub from_rad: f64,
    /// Last angle, radians.
    pub to_rad: f64,
}

/// Angles of scans are f32.
const TOLERANCE_RAD: f64 = 1e-5;

impl AngleRange {
    fn contains(self, angle_rad: f64) -> bool {
        let width = (self.to_rad - self.from_rad).rem_euclid(TAU);
        let from_start = (angle_rad - self.from_rad + TOLERANCE_RAD).rem_euclid(TAU);
        from_start <= width + 2.0 * TOLERANCE_RAD
    }
}

/// The beams that are used.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BeamSelection {
    /// Beams that are used; all if there is none.
    pub sector: Option<AngleRange>,
    /// Beams that are not.
    pub masks: Vec<AngleRange>,
}

impl BeamSelection {
    /// Cuts a sweep to the beams from the first in the sector to the last, and takes the range from
    /// those between that are not used. The time from the first beam to the first that is left; `None`
    /// if no beam is.
    pub fn apply(&self, scan: &mut Scan) -> Option<RobotDuration> {
        let angle_rad = |beam: usize| {
            f64::from(scan.angle_min_rad) + beam as f64 * f64::from(scan.angle_increment_rad)
        };
        let is_in_sector = |beam: &usize| {
            self.sector
                .is_none_or(|sector| sector.contains(angle_rad(*beam)))
        };
        let is_masked = |beam: usize| self.masks.iter().any(|mask| mask.contains(angle_rad(beam)));
        let beams = 0..scan.ranges_m.len();
        let first = beams.clone().find(is_in_sector)?;
        let last = beams.clone().rfind(is_in_sector)?;
        let unused: Vec<usize> = (first..=last)
            .filter(|beam| !is_in_sector(beam) || is_masked(*beam))
            .collect();
        let first_angle_rad = angle_rad(first) as f32;
        for beam in unused {
            scan.ranges_m[beam] = f32::NAN;
        }
        scan.ranges_m.truncate(last + 1);
        scan.ranges_m.drain(..first);
        scan.angle_min_rad = first_angle_rad;
        Some(RobotDuration::from_secs_f64(
            first as f64 * f64::from(scan.time_increment_s),
        ))
    }
}

impl fmt::Display for AngleRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [from_deg, to_deg] = [self.from_rad, self.to_rad].map(f64::to_degrees);
        write!(f, "{from_deg:.1}..{to_deg:.1}")
    }
}

/// Learns which beams hit the vehicle itself: those that hit something near in nearly every sweep.
#[derive(Clone, Debug, Default)]
pub struct SelfHits {
    /// Of the first sweep: first angle and step, radians.
    angles_rad: (f64, f64),
    /// Sweeps in which each beam hit something near.
    near: Vec<u32>,
    sweeps: u32,
}

/// Fewer sweeps say nothing.
const MIN_SWEEPS: u32 = 50;
/// A cable or a thin pole is missed sometimes.
const MIN_SHARE: f64 = 0.5;

impl SelfHits {
    /// Adds a sweep; sweeps of another size than the first are left out.
    pub fn add(&mut self, scan: &Scan, reach_m: f32) {
        if self.sweeps == 0 {
            self.angles_rad = (scan.angle_min_rad.into(), scan.angle_increment_rad.into());
            self.near = vec![0; scan.ranges_m.len()];
        }
        if scan.ranges_m.len() != self.near.len() {
            return;
        }
        self.sweeps += 1;
        for (near, range_m) in self.near.iter_mut().zip(&scan.ranges_m) {
            // 0 is no echo, or an error.
            *near += u32::from(*range_m > 0.0 && *range_m < reach_m);
        }
    }

    /// The angles of these beams, with half a beam on both sides. `None` after too few sweeps.
    pub fn masks(&self) -> Option<Vec<AngleRange>> {
        if self.sweeps < MIN_SWEEPS {
            return None;
        }
        let (first_rad, step_rad) = self.angles_rad;
        let is_hit =
            |beam: &usize| f64::from(self.near[*beam]) >= MIN_SHARE * f64::from(self.sweeps);
        let mut masks: Vec<[usize; 2]> = Vec::new();
        for beam in (0..self.near.len()).filter(is_hit) {
            match masks.last_mut() {
                // A single beam between is of the same thing.
                Some([_, last]) if beam - *last <= 2 => *last = beam,
                _ => masks.push([beam, beam]),
            }
        }
        let angle_rad = |beam: f64| first_rad + beam * step_rad;
        let range = |[from, to]: [usize; 2]| {
            let ends = [angle_rad(from as f64 - 0.5), angle_rad(to as f64 + 0.5)];
            AngleRange {
                from_rad: ends[0].min(ends[1]),
                to_rad: ends[0].max(ends[1]),
            }
        };
        Some(masks.into_iter().map(range).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn range(from_deg: f64, to_deg: f64) -> AngleRange {
        AngleRange {
            from_rad: from_deg.to_radians(),
            to_rad: to_deg.to_radians(),
        }
    }

    /// Beams 10° apart whose ranges are their numbers, 1 ms apart.
    fn scan(first_deg: f32, beams: u16) -> Scan {
        Scan {
            angle_min_rad: first_deg.to_radians(),
            angle_increment_rad: 10_f32.to_radians(),
            time_increment_s: 0.001,
            range_min_m: 0.0,
            range_max_m: 100.0,
            ranges_m: (0..beams).map(f32::from).collect(),
        }
    }

    /// The angle of the first beam in degrees, the delay in ms, and the ranges, −1 for none.
    fn selected(selection: &BeamSelection, mut scan: Scan) -> Option<(i32, i64, Vec<i32>)> {
        let delay = selection.apply(&mut scan)?;
        let whole = |range: &f32| if range.is_nan() { -1 } else { *range as i32 };
        Some((
            scan.angle_min_rad.to_degrees().round() as i32,
            (delay.as_nanos() + 500_000) / 1_000_000,
            scan.ranges_m.iter().map(whole).collect(),
        ))
    }

    #[test]
    fn all_beams_without_a_selection() {
        let all = selected(&BeamSelection::default(), scan(-20.0, 4));
        assert_eq!(all, Some((-20, 0, vec![0, 1, 2, 3])));
    }

    #[test]
    fn a_sector_cuts_both_ends() {
        let selection = |from, to| BeamSelection {
            sector: Some(range(from, to)),
            masks: vec![],
        };
        // The LMS111 of introbot: 30° to 150° of the device are ±60° of the sensor.
        let laser = selected(&selection(-60.0, 60.0), scan(-135.0, 28)).unwrap();
        assert_eq!((laser.0, laser.1), (-55, 8));
        assert_eq!(laser.2, (8..=19).collect::<Vec<_>>());
        let ends = selected(&selection(-10.0, 10.0), scan(-20.0, 5));
        assert_eq!(ends, Some((-10, 1, vec![1, 2, 3])));
        assert_eq!(selected(&selection(90.0, 100.0), scan(-20.0, 5)), None);
    }

    #[test]
    fn a_sector_across_the_first_beam_of_a_turn_keeps_it() {
        let selection = BeamSelection {
            sector: Some(range(-20.0, 10.0)),
            masks: vec![],
        };
        let (first, delay, ranges) = selected(&selection, scan(0.0, 36)).unwrap();
        assert_eq!((first, delay, ranges.len()), (0, 0, 36));
        let used: Vec<i32> = ranges.into_iter().filter(|range| *range >= 0).collect();
        assert_eq!(used, [0, 1, 34, 35]);
    }

    #[test]
    fn masked_beams_have_no_range() {
        let selection = BeamSelection {
            sector: Some(range(-20.0, 20.0)),
            masks: vec![range(-10.0, 0.0), range(170.0, -170.0)],
        };
        let masked = selected(&selection, scan(-30.0, 7));
        assert_eq!(masked, Some((-20, 1, vec![1, -1, -1, 4, 5])));
    }

    #[test]
    fn beams_that_hit_the_vehicle_are_learnt() {
        // Beams 1 and 3 see a pole and a cable behind it, which is missed now and then; a person passes beam 6.
        let sweep = |number: u16| {
            let mut scan = scan(-30.0, 8);
            scan.ranges_m = vec![5.0; 8];
            scan.ranges_m[1] = 0.3;
            scan.ranges_m[3] = if number.is_multiple_of(3) {
                f32::NAN
            } else {
                0.4
            };
            scan.ranges_m[6] = if number < 20 { 0.5 } else { 5.0 };
            scan
        };
        let mut hits = SelfHits::default();
        (0..49).for_each(|number| hits.add(&sweep(number), 1.0));
        assert_eq!(hits.masks(), None);
        hits.add(&scan(0.0, 7), 1.0);
        hits.add(&sweep(49), 1.0);
        let masks = hits.masks().unwrap();
        let text: Vec<_> = masks.iter().map(ToString::to_string).collect();
        assert_eq!(text, ["-25.0..5.0"]);
        let mut scan = sweep(50);
        let selection = BeamSelection {
            sector: None,
            masks,
        };
        selection.apply(&mut scan).unwrap();
        assert!(scan.ranges_m[1..=3].iter().all(|range_m| range_m.is_nan()));
        assert_eq!((scan.ranges_m[0], scan.ranges_m[4]), (5.0, 5.0));
    }

    #[test]
    fn clockwise_scanners_are_cut_too() {
        let mut clockwise = scan(20.0, 5);
        clockwise.angle_increment_rad = -clockwise.angle_increment_rad;
        let selection = BeamSelection {
            sector: Some(range(-10.0, 10.0)),
            masks: vec![],
        };
        assert_eq!(
            selected(&selection, clockwise),
            Some((10, 1, vec![1, 2, 3]))
        );
    }
}
