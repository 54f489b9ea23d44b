//! Clouds of a planar laser that is tilted or that tilts: its scans of a short time, each beam placed with the sensor's pose on the
//! vehicle at its own time.
//!
//! What one of them shows is a stripe of the surroundings. Stripe for stripe is registered in what the ones before showed, as an upright
//! lidar's revolutions are; walls are looked for in those of the last seconds together.

use std::collections::VecDeque;

use mapping::registered_scan::BeamOutcome;
use measurement::FrameId;
use measurement::cloud::{Cloud, CloudPoint};
use measurement::drops::DropReason;
use measurement::pose::Pose;
use measurement::time::{RobotDuration, RobotTime};
use nalgebra::Point3;

use crate::beam_projection::{BeamProjector, BodyBox, SensorSettings};
use crate::registration::scan_queue::Sweep;
use crate::scan_localization::WaitingScan;

/// A cloud has the scans of this time: the motion within is even.
pub(crate) const STRIPE: RobotDuration = RobotDuration::from_millis(240);
/// Walls are looked for in the clouds of this time: a servo has tilted its laser up or down once.
const SURROUNDINGS: RobotDuration = RobotDuration::from_millis(2500);

/// Collects scans.
#[derive(Clone, Debug)]
pub(crate) struct ScanCollector {
    projector: BeamProjector,
    /// Times of the first beam and of the last, and frame of the laser.
    span: Option<(RobotTime, RobotTime, FrameId)>,
    /// In the frame of the vehicle.
    points: Vec<CloudPoint>,
    /// Stripes with their stamps and the vehicle's poses.
    placed: VecDeque<(RobotTime, Pose, Vec<Point3<f64>>)>,
}

impl ScanCollector {
    pub(crate) fn new(sensor: SensorSettings, body: BodyBox) -> Self {
        Self {
            projector: BeamProjector::new(sensor, body),
            span: None,
            points: Vec::new(),
            placed: VecDeque::new(),
        }
    }

    /// Without scans.
    pub(crate) fn emptied(self) -> Self {
        Self {
            span: None,
            points: Vec::new(),
            placed: VecDeque::new(),
            ..self
        }
    }

    /// Takes a scan, in the order of time.
    pub(crate) fn push(
        &mut self,
        waiting: &WaitingScan,
        base_from_sensor_at: impl FnMut(RobotTime) -> Result<Pose, DropReason>,
    ) -> Result<(), DropReason> {
        let Sweep::Planar(scan) = &waiting.sweep else {
            return Err(DropReason::BadScan);
        };
        let (stamp, identity) = (waiting.stamp, Pose::identity());
        let projected = self
            .projector
            .project(scan, stamp, identity, base_from_sensor_at)?;
        let begin = self.span.as_ref().map_or(stamp, |(begin, ..)| *begin);
        self.span = Some((begin, waiting.known_at, FrameId::clone(&waiting.frame)));
        let scan_s = stamp.since(begin).as_secs_f64();
        let beams = projected.beams.iter();
        let hits = beams.filter(|beam| beam.outcome == BeamOutcome::Hit);
        self.points.extend(hits.map(|beam| CloudPoint {
            position_m: beam.end_in_odom.cast::<f32>().into(),
            after_s: (scan_s + f64::from(beam.index) * f64::from(scan.time_increment_s)) as f32,
            intensity: 0.0,
            ring: None,
        }));
        Ok(())
    }

    pub(crate) fn is_complete(&self) -> bool {
        let span = self.span.as_ref();
        span.is_some_and(|(begin, end, _)| *end >= *begin + STRIPE)
    }

    /// The stripe of the scans so far.
    pub(crate) fn stripe(&mut self) -> Option<WaitingScan> {
        let (stamp, known_at, frame) = self.span.take()?;
        let cloud = Cloud {
            points: std::mem::take(&mut self.points),
            without_return: 0,
        };
        Some(WaitingScan {
            stamp,
            known_at,
            frame,
            sweep: Sweep::Cloud(cloud, stamp),
        })
    }

    /// What the vehicle has met lately, as a cloud in its frame, together with its newest cloud, taken at this pose.
    pub(crate) fn surroundings(
        &mut self,
        newest: &Cloud,
        stamp: RobotTime,
        odom_from_base: &Pose,
    ) -> Cloud {
        let points = newest.points.iter();
        let points = points.map(|point| Point3::from(point.position_m.map(f64::from)));
        self.placed
            .push_back((stamp, *odom_from_base, points.collect()));
        while self
            .placed
            .front()
            .is_some_and(|(before, ..)| *before + SURROUNDINGS < stamp)
        {
            self.placed.pop_front();
        }
        let base_from_odom = odom_from_base.inverse();
        let points = self.placed.iter().flat_map(|(_, odom_from_then, points)| {
            let now_from_then = base_from_odom * odom_from_then;
            points.iter().map(move |point| CloudPoint {
                position_m: (now_from_then * point).cast::<f32>().into(),
                after_s: 0.0,
                intensity: 0.0,
                ring: None,
            })
        });
        Cloud {
            points: points.collect(),
            without_return: 0,
        }
    }
}
