//! The vehicle: its footprint to scale, an arrow where that would be too small to see.

use eframe::egui::{Color32, Painter, Pos2, Shape, Stroke, Vec2, vec2};

/// A shorter footprint is drawn as an arrow of [`ARROW`] points instead.
const MIN_LENGTH: f32 = 16.0;
pub(in crate::map_view) const ARROW: f32 = 20.0;

/// The vehicle on the screen.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::map_view) struct VehicleMark {
    /// Corners of the footprint, from the front left one clockwise on the screen; empty where it is too
    /// small or unknown.
    pub(in crate::map_view) footprint: Vec<Pos2>,
    /// Tip, rear right, notch, rear left.
    pub(in crate::map_view) arrow: [Pos2; 4],
}

impl VehicleMark {
    /// `footprint_m`: extent along and across, whose middle is `offset_m` ahead of `at`; `ahead`: where it heads on the screen,
    /// a unit vector.
    pub(in crate::map_view) fn new(
        at: Pos2,
        ahead: Vec2,
        (footprint_m, offset_m): (Option<[f32; 2]>, f32),
        points_per_m: f64,
    ) -> Self {
        let right = vec2(-ahead.y, ahead.x);
        let middle = at + ahead * (offset_m * points_per_m as f32);
        let place = |offset: Vec2| middle + ahead * offset.x + right * offset.y;
        let extent = footprint_m
            .map(|extent_m| extent_m.map(|side_m| side_m * points_per_m as f32))
            .filter(|extent| extent.iter().all(|side| side.is_finite() && *side > 0.0))
            .filter(|[length, width]| length.max(*width) >= MIN_LENGTH);
        let footprint = extent.map_or_else(Vec::new, |[length, width]| {
            let (half, side) = (0.5 * length, 0.5 * width);
            [(half, -side), (half, side), (-half, side), (-half, -side)]
                .map(|(x, y)| place(vec2(x, y)))
                .to_vec()
        });
        let length = extent.map_or(ARROW, |[length, width]| 0.62 * length.min(1.6 * width));
        let corners = [(0.5, 0.0), (-0.5, 0.38), (-0.26, 0.0), (-0.5, -0.38)];
        Self {
            footprint,
            arrow: corners.map(|(x, y)| place(vec2(x, y) * length)),
        }
    }

    /// Draws it in `color` with an outline that stands out on any map.
    pub(in crate::map_view) fn paint(&self, painter: &Painter, color: Color32) {
        let halo = Stroke::new(3.5, Color32::WHITE);
        let line = Stroke::new(1.8, color);
        if !self.footprint.is_empty() {
            let paper = Color32::from_white_alpha(150);
            painter.add(Shape::convex_polygon(self.footprint.clone(), paper, halo));
            painter.add(Shape::closed_line(self.footprint.clone(), line));
        }
        let [tip, rear_right, notch, rear_left] = self.arrow;
        painter.add(Shape::closed_line(self.arrow.to_vec(), halo));
        // The arrow is not convex; its halves are.
        for half in [[tip, rear_right, notch], [tip, notch, rear_left]] {
            painter.add(Shape::convex_polygon(half.to_vec(), color, Stroke::NONE));
        }
    }
}

#[cfg(test)]
mod tests {
    use eframe::egui::pos2;

    use super::*;

    fn assert_near(a: Pos2, b: Pos2) {
        assert!(a.distance(b) < 1e-3, "{a:?} is not {b:?}");
    }

    #[test]
    fn the_footprint_is_to_scale_and_turned() {
        let at = pos2(100.0, 200.0);
        let east = VehicleMark::new(at, vec2(1.0, 0.0), (Some([1.0, 0.5]), 0.0), 100.0);
        assert_near(east.footprint[0], pos2(150.0, 175.0));
        assert_near(east.footprint[2], pos2(50.0, 225.0));
        let north = VehicleMark::new(at, vec2(0.0, -1.0), (Some([1.0, 0.5]), 0.0), 100.0);
        assert_near(north.footprint[0], pos2(75.0, 150.0));
        assert_near(north.footprint[1], pos2(125.0, 150.0));
        assert!(north.arrow[0].y < north.arrow[2].y, "the tip is ahead");
        // The base frame at the rear axle: the front is 0.8 m ahead, the rear 0.2 m behind.
        let rear_axle = VehicleMark::new(at, vec2(0.0, -1.0), (Some([1.0, 0.5]), 0.3), 100.0);
        assert_near(rear_axle.footprint[0], pos2(75.0, 120.0));
        assert_near(rear_axle.footprint[2], pos2(125.0, 220.0));
    }

    #[test]
    fn a_vehicle_is_never_too_small_to_see() {
        for footprint_m in [
            None,
            Some([0.5, 0.3]),
            Some([0.0, 0.0]),
            Some([f32::NAN, 1.0]),
        ] {
            let mark = VehicleMark::new(pos2(0.0, 0.0), vec2(1.0, 0.0), (footprint_m, 0.0), 10.0);
            assert_eq!(mark.footprint, []);
            assert_near(mark.arrow[0], pos2(0.5 * ARROW, 0.0));
        }
    }
}
