//! Sweeps made small, for people to see. Pure.

use protocol::message::{MAX_SCAN_POINTS, Scan};

use mapping::registered_scan::{BeamOutcome, RegisteredScan};

/// What a sweep of the sensor `name` shows, in at most [`MAX_SCAN_POINTS`] points; `None` where it hit nothing.
///
/// Of each bundle of neighbouring beams the nearest hit is kept, so that a thin pole is never lost.
pub fn downsample_scan(name: &str, scan: &RegisteredScan) -> Option<Scan> {
    let origin = scan.beams.first()?.origin_in_odom;
    let beams = scan.beams.last()?.index as usize + 1;
    let bundle = beams.div_ceil(MAX_SCAN_POINTS) as u32;
    let hits = scan.beams.iter().filter(|beam| match beam.outcome {
        BeamOutcome::Hit => true,
        BeamOutcome::Miss => false,
    });
    let mut nearest: Vec<(u32, f32, [f64; 2])> = Vec::new();
    for beam in hits {
        let number = beam.index / bundle;
        let point_m = [beam.end_in_odom.x, beam.end_in_odom.y];
        match nearest.last_mut() {
            Some((last, range_m, kept)) if *last == number => {
                if beam.range_m < *range_m {
                    (*range_m, *kept) = (beam.range_m, point_m);
                }
            }
            Some(_) | None => nearest.push((number, beam.range_m, point_m)),
        }
    }
    let points_m = nearest.into_iter().map(|(_, _, point_m)| point_m);
    let scan = Scan::of_points(name.to_owned(), [origin.x, origin.y], points_m);
    (!scan.steps_cm.is_empty()).then_some(scan)
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use mapping::registered_scan::{RegisteredBeam, ScanKind, SensorId};
    use measurement::pose::Pose;
    use measurement::time::RobotTime;

    /// Beams around a point 100 m east of the origin; `range_m` gives the range of each, negative for a miss.
    fn scan(beams: u32, range_m: impl Fn(u32) -> f32) -> RegisteredScan {
        let origin_in_odom = Point3::new(100.0, 0.0, 0.5);
        let beam = |index: u32| {
            let (range_m, angle_rad) = (range_m(index), f64::from(index) * 1e-3);
            let reach_m = f64::from(range_m.abs());
            let along = [
                reach_m * libm::cos(angle_rad),
                reach_m * libm::sin(angle_rad),
            ];
            RegisteredBeam {
                origin_in_odom,
                end_in_odom: Point3::new(100.0 + along[0], along[1], 0.5),
                outcome: if range_m < 0.0 {
                    BeamOutcome::Miss
                } else {
                    BeamOutcome::Hit
                },
                index,
                range_m: range_m.abs(),
            }
        };
        RegisteredScan {
            stamp: RobotTime::from_nanos(0),
            sensor: SensorId(0),
            beam_step_rad: 1e-3,
            kind: ScanKind::Beams,
            own_body_hits: 0,
            odom_from_base: Pose::identity(),
            beams: (0..beams).map(beam).collect(),
        }
    }

    #[test]
    fn a_pole_that_one_beam_hits_is_never_lost() {
        for pole in 0..1081 {
            let wall = scan(1081, |index| if index == pole { 2.0 } else { 20.0 });
            let shown = downsample_scan("laser", &wall).unwrap();
            let points = shown.points_m().unwrap();
            assert_eq!(points.len(), 271, "bundles of four");
            let near = points.iter().filter(|[x, _]| *x < 103.0).count();
            assert_eq!(near, 1, "beam {pole}");
        }
    }

    #[test]
    fn what_was_not_hit_is_not_shown_and_few_beams_stay_as_they_are() {
        let scan_of = |beams| scan(beams, |index| if index % 2 == 0 { 5.0 } else { -80.0 });
        let shown = downsample_scan("laser", &scan_of(360)).unwrap();
        assert_eq!(
            (shown.sensor.as_str(), shown.steps_cm.len()),
            ("laser", 180)
        );
        assert!((shown.origin_m[0] - 100.0).abs() < 1e-9);
        assert!(downsample_scan("laser", &scan(9, |_| -80.0)).is_none());
        assert!(downsample_scan("laser", &scan(0, |_| 1.0)).is_none());
        for beams in [361, 683, 719, 720, 721, 100_000] {
            let shown = downsample_scan("laser", &scan(beams, |_| 5.0)).unwrap();
            assert!(shown.steps_cm.len() <= MAX_SCAN_POINTS, "{beams}");
        }
    }
}
