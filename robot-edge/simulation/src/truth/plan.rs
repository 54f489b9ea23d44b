//! Solids as drawn on a plan: the lines across which the surface seen from above may bend or jump.

use nalgebra::Point2;

use crate::solid::{BOX_EDGES, Shape, Solid};

/// The lines of all solids.
pub(super) struct Plan {
    pub(super) lines: Vec<[Point2<f64>; 2]>,
    pub(super) domes: Vec<Dome>,
}

/// A solid whose top is round.
pub(super) struct Dome {
    pub(super) centre: Point2<f64>,
    pub(super) radius_m: f64,
}

/// Corners of the polygon that stands for a circle; they lie on it.
const CIRCLE_CORNERS: usize = 32;

impl Plan {
    pub(super) fn of(solids: &[Solid]) -> Self {
        let mut plan = Self {
            lines: Vec::new(),
            domes: Vec::new(),
        };
        for solid in solids {
            plan.add(solid);
        }
        // Upright edges are points on a plan.
        plan.lines.retain(|[a, b]| a != b);
        plan
    }

    fn add(&mut self, solid: &Solid) {
        match &solid.shape {
            Shape::Plane => {}
            Shape::Box { size_m } => {
                let corners = solid.box_corners_m(*size_m).map(|corner| corner.xy());
                self.lines
                    .extend(BOX_EDGES.map(|edge| edge.map(|corner| corners[corner])));
            }
            Shape::Cylinder { radius_m, .. } => self.add_circle(solid, *radius_m),
            Shape::Sphere { radius_m } => {
                self.add_circle(solid, *radius_m);
                self.domes.push(Dome {
                    centre: centre_of(solid),
                    radius_m: *radius_m,
                });
            }
            Shape::Mesh(mesh) => {
                for corners in mesh.triangles_m() {
                    let [a, b, c] = corners.map(|corner| (solid.world_from_solid * corner).xy());
                    self.lines.extend([[a, b], [b, c], [c, a]]);
                }
            }
        }
    }

    fn add_circle(&mut self, solid: &Solid, radius_m: f64) {
        let centre = centre_of(solid);
        let corner = |n: usize| {
            let angle_rad = std::f64::consts::TAU * n as f64 / CIRCLE_CORNERS as f64;
            let (x, y) = (libm::cos(angle_rad), libm::sin(angle_rad));
            Point2::new(centre.x + radius_m * x, centre.y + radius_m * y)
        };
        self.lines
            .extend((0..CIRCLE_CORNERS).map(|n| [corner(n), corner((n + 1) % CIRCLE_CORNERS)]));
    }
}

fn centre_of(solid: &Solid) -> Point2<f64> {
    solid.world_from_solid.translation.vector.xy().into()
}
