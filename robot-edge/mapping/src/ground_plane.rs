//! Ground plane that heights refer to, its reset, and the local ground around a cell
//! (docs/methods.md, section 1; \[LOD\] §4.6, §5.3).

use measurement::pose;
use measurement::pose::Pose;
use measurement::time::RobotTime;
use nalgebra::{Point2, Point3, Vector3};
use serde::Deserialize;

use crate::elevation::{CellClass, ElevationCell};
use crate::grid::{CellIndex, CellSize};
use crate::rolling_grid::RollingGrid;

/// Settings of `[mapping.ground]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GroundConfig {
    /// ε: the plane is reset if pitch differs from that at the last reset by more than this,
    /// degrees (\[LOD\] §5.3: 0.5; 0.7 and 0.9 in two experiments),
    pub epsilon_deg: f64,
    /// η: and if pitch changed from scan to scan by less than this at 25 Hz, degrees (\[LOD\] §5.3:
    /// 0.1), over a wheelbase.
    pub eta_deg: f64,
    /// How long the pitch must stay before the plane is reset.
    pub reset: GroundReset,
    /// Reference of the obstacle map's thresholds.
    pub reference: GroundReference,
    /// With `reference = "local"`: steepest ground that is no obstacle, degrees.
    pub max_slope_deg: f64,
    /// Whether heights are compensated for pitch and roll; `false` only for comparison (experiment
    /// e5).
    pub compensation: bool,
}

/// How long the pitch must stay before the ground plane is reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GroundReset {
    /// Over a wheelbase of travel; the plane is averaged over attitudes.
    Wheelbase,
    /// From one scan to the next, and the plane is that of one attitude (\[LOD\] §4.6).
    Scan,
}

/// Reference of the obstacle map's thresholds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GroundReference {
    /// The ground plane at its last reset (\[LOD\]).
    Plane,
    /// The ground around each cell, so that a gentle gradient is no obstacle and a kerb is.
    Local,
}

impl Default for GroundConfig {
    fn default() -> Self {
        Self {
            epsilon_deg: 0.5,
            eta_deg: 0.1,
            reset: GroundReset::Wheelbase,
            reference: GroundReference::Plane,
            max_slope_deg: 8.0,
            compensation: true,
        }
    }
}

/// A plane fixed in `odom`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundPlane {
    origin_in_odom: Point3<f64>,
    normal_in_odom: Vector3<f64>,
}

impl GroundPlane {
    /// The x-y plane of the vehicle's frame.
    pub fn under(odom_from_base: &Pose) -> Self {
        Self {
            origin_in_odom: Point3::from(odom_from_base.translation.vector),
            normal_in_odom: odom_from_base.rotation * Vector3::z(),
        }
    }

    /// Signed height of a point above the plane, metres.
    ///
    /// For a hit this is equation (2) of docs/methods.md, `H = cos ρ · (R_ref − R)`, since `z = h −
    /// R · cos ρ` and `h = R_ref · cos ρ`.
    pub fn height_m(&self, point_in_odom: &Point3<f64>) -> f64 {
        self.normal_in_odom
            .dot(&(point_in_odom - self.origin_in_odom))
    }

    /// The point at a height above the plane.
    fn point(&self, at: Point2<f64>, height_m: f64) -> Point3<f64> {
        let foot = Point3::new(at.x, at.y, self.origin_in_odom.z);
        let rise_m = (height_m - self.height_m(&foot)) / self.normal_in_odom.z;
        foot + Vector3::z() * rise_m
    }

    /// How much higher a point at a height above this plane is above another one, metres.
    pub(super) fn rise_m(&self, other: &Self, at: Point2<f64>, height_m: f64) -> f64 {
        other.height_m(&self.point(at, height_m)) - height_m
    }
}

/// Decides when the ground plane is reset (docs/methods.md, section 1).
///
/// \[LOD\] §5.3 resets if pitch differs from that at the last reset by more than ε and from that of
/// the last scan by less than η ([`GroundReset::Scan`]). Literally this fires one scan after a bump.
/// With [`GroundReset::Wheelbase`] every change per scan must stay below η, and the pitch within
/// ε/2, over a wheelbase of travel. Neither a shorter object nor standing on one can cause it.
#[derive(Clone, Debug)]
pub struct GroundTracker {
    epsilon_rad: f64,
    /// η as a rate; the source gives it per scan at 25 Hz.
    eta_radps: f64,
    reset: GroundReset,
    wheelbase_m: f64,
    plane: Option<AveragedPlane>,
    last: Option<Sample>,
    /// Distance driven with a steady pitch, metres, and the pitch at its start.
    steady_m: f64,
    steady_pitch_rad: f64,
}

/// A plane averaged over attitudes.
#[derive(Clone, Copy, Debug)]
struct AveragedPlane {
    plane: GroundPlane,
    pitch_rad: f64,
    scans: u32,
}

/// Attitudes that are averaged after a reset: 0.1° of noise in a single one is 7 cm at the end of a
/// street.
const AVERAGED_SCANS: u32 = 50;

impl AveragedPlane {
    fn new(odom_from_base: &Pose, pitch_rad: f64) -> Self {
        Self {
            plane: GroundPlane::under(odom_from_base),
            pitch_rad,
            scans: 1,
        }
    }

    /// Includes one more attitude.
    fn average_in(&mut self, odom_from_base: &Pose, pitch_rad: f64) {
        if self.scans < AVERAGED_SCANS {
            self.scans += 1;
            let share = 1.0 / f64::from(self.scans);
            let up = odom_from_base.rotation * Vector3::z();
            let mean = self.plane.normal_in_odom.lerp(&up, share);
            self.plane.normal_in_odom = mean / libm::sqrt(mean.norm_squared());
            self.pitch_rad += (pitch_rad - self.pitch_rad) * share;
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    stamp: RobotTime,
    position: Point3<f64>,
    pitch_rad: f64,
}

/// The ground plane was reset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundPlaneReset {
    /// Time of the scan.
    pub stamp: RobotTime,
    /// Pitch of the previous plane, radians, positive nose down.
    pub pitch_before_rad: f64,
    /// Pitch now.
    pub pitch_rad: f64,
    /// Distance driven with a steady pitch, metres.
    pub steady_m: f64,
}

impl std::fmt::Display for GroundPlaneReset {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "the ground plane was reset and the elevation and obstacle maps erased: pitch went from {:.1}° \
             to {:.1}° and stayed there for {:.2} m",
            tenths(self.pitch_before_rad),
            tenths(self.pitch_rad),
            self.steady_m
        )
    }
}

/// Degrees to one decimal, without "-0.0".
fn tenths(angle_rad: f64) -> f64 {
    libm::round(10.0 * angle_rad.to_degrees()) / 10.0 + 0.0
}

/// Scan rate of the source, to which its η refers.
const SOURCE_RATE_HZ: f64 = 25.0;

impl GroundTracker {
    /// For a vehicle with axles `wheelbase_m` apart.
    pub fn new(config: &GroundConfig, wheelbase_m: f64) -> Self {
        Self {
            epsilon_rad: config.epsilon_deg.to_radians(),
            eta_radps: config.eta_deg.to_radians() * SOURCE_RATE_HZ,
            reset: config.reset,
            wheelbase_m,
            plane: None,
            last: None,
            steady_m: 0.0,
            steady_pitch_rad: 0.0,
        }
    }

    /// Takes the pose of a scan; returns the plane for its heights, and the reset if there was one.
    /// The first pose sets the plane, which is no reset.
    pub fn update(
        &mut self,
        stamp: RobotTime,
        odom_from_base: &Pose,
    ) -> (GroundPlane, Option<GroundPlaneReset>) {
        let now = Sample {
            stamp,
            position: Point3::from(odom_from_base.translation.vector),
            pitch_rad: pose::pitch_rad(odom_from_base),
        };
        let is_steady = self.follow_pitch(now);
        let taken = AveragedPlane::new(odom_from_base, now.pitch_rad);
        let Some(before) = &mut self.plane else {
            self.plane = Some(taken);
            return (taken.plane, None);
        };
        let is_tilted = (now.pitch_rad - before.pitch_rad).abs() > self.epsilon_rad;
        if !is_tilted && self.reset == GroundReset::Wheelbase {
            before.average_in(odom_from_base, now.pitch_rad);
        }
        let before = *before;
        let stays = match self.reset {
            GroundReset::Wheelbase => self.steady_m >= self.wheelbase_m,
            GroundReset::Scan => is_steady,
        };
        if !is_tilted || !stays {
            return (before.plane, None);
        }
        self.plane = Some(taken);
        let change = GroundPlaneReset {
            stamp,
            pitch_before_rad: before.pitch_rad,
            pitch_rad: now.pitch_rad,
            steady_m: self.steady_m,
        };
        (taken.plane, Some(change))
    }

    /// The plane; `None` before the first pose.
    pub fn plane(&self) -> Option<GroundPlane> {
        self.plane.map(|taken| taken.plane)
    }

    /// Forgets the plane and the way; the next pose sets a new plane.
    pub fn clear(&mut self) {
        self.plane = None;
        self.last = None;
        self.steady_m = 0.0;
    }

    /// Whether the pitch has changed by less than η since the last scan.
    fn follow_pitch(&mut self, now: Sample) -> bool {
        let Some(before) = self.last.replace(now) else {
            return false;
        };
        let elapsed_s = now.stamp.since(before.stamp).as_secs_f64();
        let change_rad = (now.pitch_rad - before.pitch_rad).abs();
        // On the way onto a ramp each change may be below η: the pitch must also stay in place.
        let drift_rad = (now.pitch_rad - self.steady_pitch_rad).abs();
        let is_steady = change_rad <= self.eta_radps * elapsed_s;
        if is_steady && drift_rad <= 0.5 * self.epsilon_rad {
            self.steady_m += (now.position - before.position).norm();
        } else {
            self.steady_m = 0.0;
            self.steady_pitch_rad = now.pitch_rad;
        }
        is_steady
    }
}

/// Radius around a cell in which ground is searched, metres.
const REACH_M: f64 = 0.6;
/// Height above ground from which a point is not ground, metres: three times the attitude noise at
/// 9 m.
const RAISED_M: f32 = 0.05;

/// Heights of the local ground, metres above the ground plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bounds {
    pub(super) lowest_m: f32,
    pub(super) highest_m: f32,
    /// Points above this are clearly above the ground, obstacle or not.
    pub(super) raised_above_m: f32,
}

impl Bounds {
    pub(super) const PLANE: Self = Self::at(0.0);

    /// Of ground at one height, metres above the ground plane.
    pub(super) const fn at(height_m: f32) -> Self {
        Self {
            lowest_m: height_m,
            highest_m: height_m,
            raised_above_m: height_m + RAISED_M,
        }
    }

    /// Whether a height is within them.
    pub(super) fn contains(&self, height_m: f32) -> bool {
        (self.lowest_m..=self.highest_m).contains(&height_m)
    }

    /// Extended by the depth and height that are not yet an obstacle.
    pub(super) fn beyond(self, h_neg_m: f32, h_pos_m: f32) -> Self {
        Self {
            lowest_m: self.lowest_m - h_neg_m,
            highest_m: self.highest_m + h_pos_m,
            raised_above_m: self.raised_above_m,
        }
    }
}

/// Local ground around a cell (docs/methods.md, section 1, "Smooth slopes").
///
/// Each free cell nearby limits the ground here: it rises or falls no steeper than `max_slope_deg`
/// between them. A kerb exceeds that limit and a gradient does not. A plane fitted over a step
/// would hide half of it.
#[derive(Clone, Debug)]
pub(super) struct LocalGround {
    /// Offsets of the neighbours, each with the greatest rise or fall of the ground on the way,
    /// metres.
    around: Vec<(i32, i32, f32)>,
}

impl LocalGround {
    pub(super) fn new(size: CellSize, max_slope_deg: f64) -> Self {
        let slope = libm::tan(max_slope_deg.to_radians());
        // At least the adjacent cells.
        let reach = size
            .sides_m()
            .map(|side_m| ((REACH_M / side_m) as i32).max(1));
        let [x_m, y_m] = size.sides_m();
        let mut around = Vec::new();
        for dy in -reach[1]..=reach[1] {
            for dx in -reach[0]..=reach[0] {
                let distance_m = libm::hypot(f64::from(dx), f64::from(dy) * (y_m / x_m)) * x_m;
                let is_near = distance_m <= REACH_M.max(1.5 * x_m.max(y_m));
                if (dx, dy) != (0, 0) && is_near {
                    around.push((dx, dy, (slope * distance_m) as f32));
                }
            }
        }
        Self { around }
    }

    /// Highest that ground at `cell` can be beside the lowest points around; +∞ if there are none.
    pub(super) fn highest(&self, grid: &RollingGrid<ElevationCell>, cell: CellIndex) -> f32 {
        let highest_m = self
            .neighbours(grid, cell)
            .map(|(neighbour, rise_m)| neighbour.min_m() + rise_m);
        highest_m.fold(f32::INFINITY, f32::min)
    }

    /// Cells around, each with the greatest rise or fall of the ground on the way.
    fn neighbours<'a>(
        &'a self,
        grid: &'a RollingGrid<ElevationCell>,
        cell: CellIndex,
    ) -> impl Iterator<Item = (&'a ElevationCell, f32)> {
        self.around.iter().filter_map(move |&(dx, dy, rise_m)| {
            let at = CellIndex {
                x: cell.x + dx,
                y: cell.y + dy,
            };
            Some((grid.get(at)?, rise_m))
        })
    }

    /// Bounds of the ground height at `cell`; `None` if no free cell is near.
    pub(super) fn around(
        &self,
        grid: &RollingGrid<ElevationCell>,
        cell: CellIndex,
    ) -> Option<Bounds> {
        let neighbours = self.neighbours(grid, cell);
        let free = neighbours.filter_map(|(neighbour, rise_m)| {
            let is_free = neighbour.class() == CellClass::Free;
            is_free.then_some((neighbour.ground_m()?, rise_m))
        });
        free.fold(None, |bounds: Option<Bounds>, (mean_m, rise_m)| {
            let (low_m, high_m) = (mean_m - rise_m, mean_m + rise_m);
            let (lowest_m, highest_m) = match bounds {
                Some(bounds) => (bounds.lowest_m.max(low_m), bounds.highest_m.min(high_m)),
                None => (low_m, high_m),
            };
            Some(Bounds {
                lowest_m,
                highest_m,
                raised_above_m: highest_m + RAISED_M,
            })
        })
    }
}

#[cfg(test)]
mod tests;
