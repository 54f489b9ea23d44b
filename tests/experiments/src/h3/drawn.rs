//! Worlds drawn at random: a flat field with boxes, low branches, grass and twigs, on which no rule was tuned.

use std::collections::BTreeMap;

use super::objects::{Columns, Objects};
use crate::land::{
    Cell, Found, Ground, Hits, LETHAL, LandWorld, MIN_HITS, TRAVERSABLE, columns_of, published,
};
use crate::run::known_cells;
use crate::session::Rules;
use protocol::layer::LayerId;
use simulation::World;
use simulation::noise::NoiseStream;

/// Where things stand along the way, metres, each time to the left and to the right of it.
const PLACES: u32 = 6;
const SPACING_M: f64 = 4.0;
/// Kinds of things and how many of each.
const THINGS: [(&str, usize); 4] = [("box", 3), ("branch", 3), ("grass", 4), ("twigs", 2)];

/// Where they are, metres.
const FIELD_M: [[f64; 2]; 2] = [[-2.0, -8.0], [32.0, 8.0]];

/// What the maps of one field say.
pub(super) struct Drive {
    /// Columns that the laser met, lethal by their slope, and lethal with rigidity.
    pub(super) boxes: [Found; 2],
    pub(super) branches: [Found; 2],
    pub(super) plants: Columns,
}

/// Through the field of a seed.
pub(super) fn drive(seed: u64, rules: Rules) -> anyhow::Result<Drive> {
    let field = world(seed, rules)?;
    let (ground, mut hits) = (Ground::of(&field, FIELD_M)?, Hits::default());
    let mut run = field.run(seed)?;
    run.advance_with(run.duration_s(), |_, scan| hits.add(&field, &ground, scan))?;
    let pipeline = run.finish()?;
    let store = pipeline.publisher().store();
    let costs: BTreeMap<Cell, f32> = published(&store, LayerId::Cost).collect();
    let rigidity: BTreeMap<Cell, u16> = known_cells(&store, LayerId::Rigidity).collect();
    let of_kind = |kind: &str| {
        let mut found = [Found::default(); 2];
        let solids = field.world.solids().iter();
        for solid in solids.filter(|solid| solid.name.ends_with(kind)) {
            let columns = columns_of(&field, &ground, solid).into_iter();
            let is_met = |cell: &Cell| ground.is_steep(*cell) && hits.get(*cell).raised >= MIN_HITS;
            for cell in columns.filter(is_met) {
                let is_lethal = costs.get(&cell).is_some_and(|cost| *cost >= LETHAL);
                // Only lethal columns are let through.
                let is_steep = is_lethal || rigidity.get(&cell) == Some(&TRAVERSABLE);
                found[0].add(is_steep);
                found[1].add(is_lethal);
            }
        }
        found
    };
    let plants = Objects::of(&field)?.columns(&costs, &rigidity);
    Ok(Drive {
        boxes: of_kind("box"),
        branches: of_kind("branch"),
        plants: plants.into_values().fold(Columns::default(), Columns::plus),
    })
}

/// The world of a seed.
fn world(seed: u64, rules: Rules) -> anyhow::Result<LandWorld> {
    let text = text(seed);
    LandWorld::of(World::parse("drawn", &text)?, rules)
}

/// Numbers of one world.
struct Draw(NoiseStream);

impl Draw {
    fn between(&mut self, least: f64, greatest: f64) -> f64 {
        least + (greatest - least) * self.0.uniform()
    }
}

fn text(seed: u64) -> String {
    let mut draw = Draw(NoiseStream::new(seed, "experiments/drawn"));
    let mut kinds: Vec<&str> = THINGS
        .iter()
        .flat_map(|&(kind, count)| std::iter::repeat_n(kind, count))
        .collect();
    for last in (1..kinds.len()).rev() {
        kinds.swap(last, draw.between(0.0, last as f64 + 1.0) as usize);
    }
    let (lean, sway) = (draw.between(0.02, 0.12), draw.between(0.05, 0.2));
    let mut text = format!(
        "name = \"drawn\"\nvehicle = \"introbot\"\n\
         noise = {{ range_m = 0.01, dropout = 0.005, attitude_deg = 0.1 }}\n\
         start = {{ x_m = 0.0, y_m = 0.0, yaw_deg = 0.0 }}\n\
         path = {{ speed_mps = 0.6, turn_rate_degps = 30.0, waypoints = [{{ x_m = 26.0, y_m = 0.0 }}] }}\n\
         wind = {{ towards_deg = {:.0}, lean = {lean:.3}, sway = {sway:.3}, period_s = {:.2} }}\n\
         [[solids]]\nname = \"ground\"\nshape = \"plane\"\n",
        draw.between(0.0, 360.0),
        draw.between(1.0, 2.0),
    );
    for (number, kind) in (0_u32..).zip(kinds) {
        let along_m = SPACING_M * f64::from(1 + number % PLACES);
        let side = if number < PLACES { 1.0 } else { -1.0 };
        add(&mut text, &mut draw, (number, kind), along_m, side);
    }
    text
}

fn add(text: &mut String, draw: &mut Draw, (number, kind): (u32, &str), x_m: f64, side: f64) {
    let yaw_deg = draw.between(0.0, 180.0);
    let thing = match kind {
        "box" => {
            let size_m = [(); 3].map(|()| draw.between(0.2, 1.0));
            let [x, y] = [x_m, side * draw.between(1.8, 4.0)];
            let [a, b, c] = size_m;
            format!(
                "[[solids]]\nname = \"{number} box\"\nshape = \"box\"\nyaw_deg = {yaw_deg:.0}\n\
                 centre_m = [{x:.2}, {y:.2}, {:.3}]\nsize_m = [{a:.2}, {b:.2}, {c:.2}]\n",
                0.5 * c
            )
        }
        "branch" => {
            let (thick, long) = (draw.between(0.03, 0.08), draw.between(0.8, 1.6));
            let z = draw.between(0.3, 1.2);
            let y = side * draw.between(2.0, 3.5);
            format!(
                "[[solids]]\nname = \"{number} branch\"\nshape = \"box\"\nyaw_deg = {yaw_deg:.0}\n\
                 centre_m = [{x_m:.2}, {y:.2}, {z:.2}]\nsize_m = [{thick:.3}, {long:.2}, {thick:.3}]\n"
            )
        }
        _ => {
            let is_grass = kind == "grass";
            let (density, stiffness, least_m, shoots) = if is_grass {
                (draw.between(40.0, 120.0), 1.0, draw.between(0.3, 0.6), "")
            } else {
                let shoots =
                    "shoots = { count = 4, length_m = [0.1, 0.3], thickness_mm = [2.0, 4.0] }";
                (draw.between(6.0, 18.0), 2.0, 0.4, shoots)
            };
            let greatest_m = draw.between(least_m + 0.1, 1.0);
            let near = draw.between(1.5, 2.5);
            let far = near + if is_grass { 2.2 } else { 1.5 };
            let (y0, y1) = if side > 0.0 {
                (near, far)
            } else {
                (-far, -near)
            };
            let (x0, x1) = (x_m - 1.0, x_m + 1.0);
            format!(
                "[[plants]]\nkind = \"stems\"\nname = \"{number} {kind}\"\nseed = {}\n\
                 rigidity = \"flexible\"\nstiffness = {stiffness}\ndensity_per_m2 = {density:.0}\n\
                 rectangle_m = [[{x0:.2}, {y0:.2}], [{x1:.2}, {y1:.2}]]\n\
                 height_m = [{least_m:.2}, {greatest_m:.2}]\nthickness_mm = [3.0, 8.0]\nlean_deg = 20.0\n{shoots}\n",
                draw.between(0.0, 1e6) as u64
            )
        }
    };
    text.push_str(&thing);
}
