//! Worlds of water whose shores are drawn at random: on either side of a straight run along x, five stretches each.

use std::ops::Range;

use anyhow::Context as _;
use simulation::World;
use simulation::noise::NoiseStream;
use simulation::world::ShoreClass;

use super::shore_force::{class_of, force_over_thrust};

/// Stretches on a side.
const SHORES: usize = 5;
/// Top of the shelf that shores stand on, metres: the mean of the world `lake`.
const SHELF_M: f64 = -0.7;
/// A stretch begins so far from the boat, metres.
pub(super) const DISTANCES_M: [f64; 2] = [3.0, 20.0];
/// Of canes, stems a square metre.
pub(super) const DENSITIES_PER_M2: [f64; 2] = [5.0, 80.0];

/// What stands on a stretch of shore.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    ScatteredCanes,
    EvenCanes,
    PatchyCanes,
    CanesBeforeWall,
    CanesAmongTrunks,
    Bushes,
    Rocks,
    Wall,
    Bank,
}

impl Kind {
    pub(super) const fn text(self) -> &'static str {
        match self {
            Self::ScatteredCanes => "scattered canes",
            Self::EvenCanes => "canes, even",
            Self::PatchyCanes => "canes in patches",
            Self::CanesBeforeWall => "canes before a wall",
            Self::CanesAmongTrunks => "canes among trunks",
            Self::Bushes => "bushes",
            Self::Rocks => "rocks",
            Self::Wall => "wall",
            Self::Bank => "bank",
        }
    }
}

/// Kinds and how many of a hundred stretches are of each.
const KINDS: [(Kind, f64); 9] = [
    (Kind::ScatteredCanes, 10.0),
    (Kind::EvenCanes, 30.0),
    (Kind::PatchyCanes, 20.0),
    (Kind::CanesBeforeWall, 8.0),
    (Kind::CanesAmongTrunks, 8.0),
    (Kind::Bushes, 8.0),
    (Kind::Rocks, 6.0),
    (Kind::Wall, 5.0),
    (Kind::Bank, 5.0),
];

/// A stretch of shore as it was drawn.
#[derive(Clone, Debug)]
pub(super) struct RandomShore {
    pub(super) kind: Kind,
    /// Of its canes where they are densest; 0 without.
    pub(super) density_per_m2: f64,
    /// From the boat's path to where it begins, metres.
    pub(super) distance_m: f64,
    /// The greatest force on the boat over its thrust.
    pub(super) force: f64,
}

/// The world of a seed, whose shores have their true classes, and how they were drawn, in its order.
pub(super) fn random_world(seed: u64) -> anyhow::Result<(World, Vec<RandomShore>)> {
    let mut text = WorldText::new(seed);
    let mut drawn = Vec::new();
    let mut end_m = 0.0_f64;
    for side in [1.0, -1.0] {
        let mut from_m = text.between(0.0..5.0);
        for _ in 0..SHORES {
            let to_m = from_m + text.between(8.0..20.0);
            drawn.push(text.shore(side, from_m..to_m));
            // Clusters join within 3 m, and crowns and rocks reach out of their places.
            from_m = to_m + text.between(6.0..9.0);
            end_m = end_m.max(to_m);
        }
    }
    text.finish(end_m);
    let parse = |classes: &[ShoreClass]| {
        let name = format!("shores-{seed}");
        World::parse(&name, &text.with_classes(classes)).with_context(|| name.clone())
    };
    let unclassed = parse(&vec![ShoreClass::Solid; drawn.len()])?;
    for (shore, drawn) in unclassed.shores().iter().zip(&mut drawn) {
        drawn.force = force_over_thrust(&unclassed, shore);
    }
    let classes: Vec<_> = drawn.iter().map(|drawn| class_of(drawn.force)).collect();
    Ok((parse(&classes)?, drawn))
}

/// A world file that is being written.
struct WorldText {
    noise: NoiseStream,
    seed: u64,
    text: String,
    /// Outlines of the shores.
    outlines: Vec<String>,
}

/// Where a stretch is: x, and y growing away from the boat.
struct Place {
    x_m: Range<f64>,
    side: f64,
    front_m: f64,
}

impl WorldText {
    fn new(seed: u64) -> Self {
        let mut new = Self {
            noise: NoiseStream::new(seed, "experiments/shores"),
            seed,
            text: String::new(),
            outlines: Vec::new(),
        };
        // From calm to twice the sway of the world `lake`, which has Beaufort 4.
        let [towards_deg, lean, sway] = [0.0..360.0, 0.0..0.1, 0.0..0.24].map(|r| new.between(r));
        new.add(&format!(
            r#"name = "shores-{seed}"
vehicle = "riverwatch"
noise = {{ range_m = 0.01, dropout = 0.005, attitude_deg = 0.1 }}
start = {{ x_m = -12.0, y_m = 0.0, yaw_deg = 0.0 }}
water = {{ level_m = 0.0 }}
wind = {{ towards_deg = {towards_deg}, lean = {lean}, sway = {sway}, period_s = 2.0 }}"#
        ));
        new
    }

    /// The path along all shores, the bed, and far land that all beams end at.
    fn finish(&mut self, end_m: f64) {
        let path = format!(
            "path = {{ speed_mps = 1.5, turn_rate_degps = 11.0, waypoints = [{{ x_m = {end_m}, y_m = 0.0 }}] }}\n"
        );
        self.text.insert_str(0, &path);
        self.add("[[solids]]\nshape = \"plane\"\npoint_m = [0.0, 0.0, -4.0]");
        let (middle_m, length_m) = (0.5 * end_m, end_m + 180.0);
        for y_m in [-60.0, 60.0] {
            self.cuboid([middle_m, y_m, 0.0], [length_m, 20.0, 12.0], false);
        }
        for x_m in [-70.0, end_m + 70.0] {
            self.cuboid([x_m, 0.0, 0.0], [20.0, 100.0, 12.0], false);
        }
    }

    fn with_classes(&self, classes: &[ShoreClass]) -> String {
        let tables = self.outlines.iter().zip(classes).enumerate();
        let tables = tables.map(|(number, (outline, class))| {
            let class = format!("{class:?}").to_lowercase();
            let name = number + 1;
            format!("\n[[shores]]\nname = \"{name}\"\nclass = \"{class}\"\npolygon_m = {outline}\n")
        });
        std::iter::once(self.text.clone()).chain(tables).collect()
    }

    fn shore(&mut self, side: f64, x_m: Range<f64>) -> RandomShore {
        let mut choice = self.between(0.0..100.0);
        let kind = KINDS.iter().find(|(_, weight)| {
            choice -= weight;
            choice < 0.0
        });
        let kind = kind.map_or(Kind::Bank, |(kind, _)| *kind);
        let [nearest_m, farthest_m] = DISTANCES_M;
        let place = Place {
            x_m,
            side,
            front_m: self.between(nearest_m..farthest_m),
        };
        let mut density_per_m2 = 0.0;
        if kind <= Kind::CanesAmongTrunks {
            let [least, most] = match kind {
                Kind::ScatteredCanes => [0.5, DENSITIES_PER_M2[0]],
                _ => DENSITIES_PER_M2,
            };
            // As likely between 5 and 10 as between 40 and 80.
            density_per_m2 = least * libm::pow(most / least, self.between(0.0..1.0));
        }
        let depth_m = match kind {
            Kind::Bushes => 2.8,
            Kind::Rocks => 2.0,
            Kind::Wall => 0.4,
            Kind::Bank => 3.5,
            Kind::CanesBeforeWall => self.between(1.5..4.0),
            _ => self.between(2.0..6.0),
        };
        match kind {
            Kind::ScatteredCanes | Kind::EvenCanes => self.canes(&place, depth_m, density_per_m2),
            Kind::PatchyCanes => self.patches(&place, depth_m, density_per_m2),
            Kind::CanesBeforeWall => {
                self.canes(&place, depth_m, density_per_m2);
                self.wall(&place, depth_m);
            }
            Kind::CanesAmongTrunks => {
                self.canes(&place, depth_m, density_per_m2);
                self.trunks(&place, depth_m);
            }
            Kind::Bushes => self.bushes(&place),
            Kind::Rocks => self.rocks(&place),
            Kind::Wall => self.wall(&place, 0.0),
            Kind::Bank => self.bank(&place),
        }
        self.outline(&place, depth_m);
        RandomShore {
            kind,
            density_per_m2,
            distance_m: place.front_m,
            force: f64::NAN,
        }
    }

    fn canes(&mut self, place: &Place, depth_m: f64, density_per_m2: f64) {
        let lowest_m = self.between(1.2..1.8);
        self.stand(place, depth_m, density_per_m2, lowest_m);
    }

    /// Patches in turn of this density and of a part of it.
    fn patches(&mut self, place: &Place, depth_m: f64, density_per_m2: f64) {
        let lowest_m = self.between(1.2..1.8);
        let mut from_m = place.x_m.start;
        for patch in 0.. {
            let to_m = (from_m + self.between(1.5..4.0)).min(place.x_m.end);
            let share = if patch % 2 == 0 {
                1.0
            } else {
                self.between(0.1..0.5)
            };
            let part = Place {
                x_m: from_m..to_m,
                ..*place
            };
            self.stand(&part, depth_m, share * density_per_m2, lowest_m);
            from_m = to_m;
            if from_m >= place.x_m.end {
                return;
            }
        }
    }

    /// Common reed as in the world `lake`.
    fn stand(&mut self, place: &Place, depth_m: f64, density_per_m2: f64, lowest_m: f64) {
        let [from, to] = place.corners(0.0..depth_m);
        let highest_m = lowest_m + 0.8;
        let seed = self.plant_seed();
        self.add(&format!(
            r#"[[plants]]
kind = "stems"
seed = {seed}
rigidity = "flexible"
rectangle_m = [{from:?}, {to:?}]
density_per_m2 = {density_per_m2}
height_m = [{lowest_m}, {highest_m}]
thickness_mm = [8.0, 14.0]
lean_deg = 10.0
shoots = {{ count = 2, length_m = [0.3, 0.5], thickness_mm = [10.0, 20.0] }}"#
        ));
    }

    /// Willows as in the world `lake`.
    fn bushes(&mut self, place: &Place) {
        let mut at_m = Vec::new();
        let mut x_m = place.x_m.start + 1.4;
        while x_m < place.x_m.end - 1.0 {
            at_m.push([x_m, place.y_m(1.4)]);
            x_m += self.between(1.6..2.2);
        }
        let seed = self.plant_seed();
        self.add(&format!(
            r#"[[plants]]
kind = "crowns"
seed = {seed}
rigidity = "rigid"
at_m = {at_m:?}
radius_m = [1.0, 1.4]
height_m = [1.2, 2.2]
branches = 40
branch_thickness_mm = [20.0, 60.0]
leaves_per_m2 = 200.0
leaf_length_m = [0.08, 0.14]
leaf_thickness_mm = [40.0, 70.0]"#
        ));
    }

    fn rocks(&mut self, place: &Place) {
        let mut x_m = place.x_m.start + 1.0;
        while x_m < place.x_m.end - 1.0 {
            let radius_m = self.between(0.6..1.0);
            let above_m = self.between(0.4..0.9);
            let centre_m = [x_m, place.y_m(1.0), above_m - radius_m];
            self.add(&format!(
                "[[solids]]\nshape = \"sphere\"\ncentre_m = {centre_m:?}\nradius_m = {radius_m}"
            ));
            x_m += self.between(1.0..2.5);
        }
    }

    fn wall(&mut self, place: &Place, behind_m: f64) {
        let top_m = self.between(0.8..2.0);
        let length_m = place.x_m.end - place.x_m.start;
        let centre_m = [
            place.middle_m(),
            place.y_m(behind_m + 0.2),
            0.5 * (top_m + SHELF_M),
        ];
        self.cuboid(centre_m, [length_m, 0.4, top_m - SHELF_M], false);
    }

    fn trunks(&mut self, place: &Place, depth_m: f64) {
        for _ in 0..3 {
            let x_m = self.between(place.x_m.clone());
            let y_m = place.y_m(self.between(0.0..depth_m));
            let radius_m = self.between(0.1..0.25);
            self.add(&format!(
                "[[solids]]\nshape = \"cylinder\"\nbase_m = [{x_m}, {y_m}, {SHELF_M}]\nradius_m = {radius_m}\nheight_m = 6.0"
            ));
        }
    }

    /// Earth that rises at 40° to 70°.
    fn bank(&mut self, place: &Place) {
        let slope = libm::tan(self.between(40.0..70.0).to_radians());
        let top_m = self.between(1.0..2.0);
        let back_m = place.y_m((top_m - SHELF_M) / slope);
        let (from_m, to_m, front_m) = (place.x_m.start, place.x_m.end, place.y_m(0.0));
        let corners = [
            [from_m, front_m, SHELF_M],
            [to_m, front_m, SHELF_M],
            [to_m, back_m, top_m],
            [from_m, back_m, top_m],
        ];
        self.add(&format!(
            "[[solids]]\nshape = \"mesh\"\nvertices_m = {corners:?}\ntriangles = [[0, 1, 2], [0, 2, 3]]"
        ));
    }

    /// The shelf that it stands on, and its outline.
    fn outline(&mut self, place: &Place, depth_m: f64) {
        let [from, to] = place.corners(-0.5..depth_m + 0.5);
        let [x_m, y_m] = [0, 1].map(|axis| 0.5 * (from[axis] + to[axis]));
        let size_m = [to[0] - from[0], (to[1] - from[1]).abs(), 3.0];
        self.cuboid([x_m, y_m, SHELF_M - 1.5], size_m, true);
        let corners = [from, [to[0], from[1]], to, [from[0], to[1]]];
        self.outlines.push(format!("{corners:?}"));
    }

    fn cuboid(&mut self, centre_m: [f64; 3], size_m: [f64; 3], is_ground: bool) {
        self.add(&format!(
            "[[solids]]\nshape = \"box\"\ncentre_m = {centre_m:?}\nsize_m = {size_m:?}\nground = {is_ground}"
        ));
    }

    fn add(&mut self, table: &str) {
        self.text.push_str(table);
        self.text.push_str("\n\n");
    }

    fn plant_seed(&self) -> u64 {
        1_000_000 * self.seed + self.text.len() as u64
    }

    fn between(&mut self, Range { start, end }: Range<f64>) -> f64 {
        start + (end - start) * self.noise.uniform()
    }
}

impl Place {
    /// So far behind its front.
    fn y_m(&self, behind_m: f64) -> f64 {
        self.side * (self.front_m + behind_m)
    }

    fn middle_m(&self) -> f64 {
        0.5 * (self.x_m.start + self.x_m.end)
    }

    /// Two corners of what is so far behind its front.
    fn corners(&self, behind_m: Range<f64>) -> [[f64; 2]; 2] {
        [
            [self.x_m.start, self.y_m(behind_m.start)],
            [self.x_m.end, self.y_m(behind_m.end)],
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_world_is_that_of_its_seed_and_its_shores_have_their_classes() {
        let (world, drawn) = random_world(2001).unwrap();
        let (again, _) = random_world(2001).unwrap();
        assert_eq!(world.shores(), again.shores());
        assert_eq!(world.shores().len(), 2 * SHORES);
        for (shore, drawn) in world.shores().iter().zip(&drawn) {
            assert_eq!(shore.class, class_of(drawn.force));
            let is_rigid = drawn.kind >= Kind::CanesBeforeWall;
            assert_eq!(drawn.force.is_infinite(), is_rigid, "{drawn:?}");
            let is_sparse = drawn.kind == Kind::ScatteredCanes;
            assert!(!is_sparse || shore.class == ShoreClass::Sparse, "{drawn:?}");
        }
    }
}
