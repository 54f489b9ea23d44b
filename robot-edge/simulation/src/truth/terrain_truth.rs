//! What stands on the ground, and whether a vehicle can push it over.

use std::ops::Range;

use nalgebra::{Point2, Point3, Vector2};

use crate::World;
use crate::scene::Scene;
use crate::vegetation::Rigidity;

/// The ground of a world apart from what stands on it. Moving solids are left out; plants count as they
/// stand without wind.
pub struct TerrainTruth<'a> {
    world: &'a World,
    ground: Scene,
    objects: Scene,
}

impl<'a> TerrainTruth<'a> {
    /// Of `world`.
    pub fn of(world: &'a World) -> Self {
        let [ground, objects] = world.ground_and_objects().map(|mut solids| {
            solids.retain(|solid| solid.motion.is_none());
            Scene::new(&solids)
        });
        Self {
            world,
            ground,
            objects,
        }
    }

    /// Height of the ground, under water too, metres above z = 0 of the world; `None` where there is none.
    pub fn ground_m(&self, at: Point2<f64>) -> Option<f64> {
        self.ground.height_m(at, 0.0)
    }

    /// Height of the highest rigid surface over a point from the ground up to `vehicle_height_m` above it,
    /// metres above z = 0 of the world: the ground's own where nothing rigid stands there, the upper bound
    /// where something goes on above. `None` where there is no ground.
    ///
    /// Of rigid plants it is the highest within a millimetre of the point.
    pub fn rigid_top_m(&self, at: Point2<f64>, vehicle_height_m: f64) -> Option<f64> {
        let ground_m = self.ground_m(at)?;
        let limit_m = ground_m + vehicle_height_m;
        let down = -nalgebra::Vector3::z();
        let above = Point3::new(at.x, at.y, limit_m);
        let on_objects_m = self
            .objects
            .cast(above, down, vehicle_height_m, 0.0)
            .map_or(ground_m, |hit| limit_m - hit.distance_m);
        let [min_m, max_m] = column(at, THIN_M, ground_m..limit_m);
        let on_plants_m = self
            .world
            .scene()
            .growth()
            .and_then(|growth| growth.vegetation.highest_m(min_m, max_m, Rigidity::Rigid));
        Some(on_plants_m.map_or(on_objects_m, |m| on_objects_m.max(m)))
    }

    /// What stands in the square column about `centre` of half width `half_m`, between two heights above
    /// z = 0 of the world, the ground left out: `None` where nothing does, and rigid where anything rigid
    /// does.
    pub fn class(
        &self,
        centre: Point2<f64>,
        half_m: f64,
        heights_m: Range<f64>,
    ) -> Option<Rigidity> {
        let [min_m, max_m] = column(centre, half_m, heights_m);
        if self.objects.touches_box(min_m, max_m, 0.0) {
            return Some(Rigidity::Rigid);
        }
        let growth = self.world.scene().growth()?;
        growth.vegetation.standing_in(min_m, max_m)
    }
}

/// Half the width of the column that stands for a point.
const THIN_M: f64 = 1e-3;

fn column(centre: Point2<f64>, half_m: f64, heights_m: Range<f64>) -> [Point3<f64>; 2] {
    let half = Vector2::repeat(half_m);
    let (min, max) = (centre - half, centre + half);
    [
        Point3::new(min.x, min.y, heights_m.start),
        Point3::new(max.x, max.y, heights_m.end),
    ]
}
