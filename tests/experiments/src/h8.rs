//! H8: shores that nobody has shaped, against the force of their stems on the hull.

use std::collections::BTreeMap;

use super::outcome::{Check, Outcome, Part, Table};
use super::pictures::Picture;
use super::random_shores::{DENSITIES_PER_M2, DISTANCES_M, Kind, RandomShore, random_world};
use super::session::{SEED, Session};
use super::shores::{self, MatchedCluster, WaterWorld, main_cluster};
use super::voxel_views::Canvas;
use edge::config::SensorConfig;
use mapping::shore::{ShoreClass as Found, ShoreCluster};
use simulation::world::ShoreClass as Truth;

/// Share of the shores that must be right.
const RIGHT_MIN: f64 = 0.9;
/// Greatest share of the Solid ones that may be called passable, or not be found.
const MISSED_MAX: f64 = 0.01;
/// Of light that goes a hull's length into canes, what is seen through; the rule's.
const SEEN_THROUGH: f64 = 0.005;
/// Of the reed of the worlds: the mean diameter of a stem, metres, and what is in the way of a beam over its stems
/// alone: with two shoots each.
const CANE_M: f64 = 0.011;
const WITH_SHOOTS: f64 = 1.4;
/// Bounds of the rows and columns of the table over densities and distances.
const DENSITY_BOUNDS_PER_M2: [f64; 6] = [
    0.5,
    DENSITIES_PER_M2[0],
    10.0,
    20.0,
    40.0,
    DENSITIES_PER_M2[1],
];
const DISTANCE_BOUNDS_M: [f64; 5] = [DISTANCES_M[0], 7.0, 11.0, 15.0, DISTANCES_M[1]];

/// A stretch of shore, and its largest cluster if there is one.
struct JudgedShore {
    drawn: RandomShore,
    truth: Truth,
    cluster: Option<ShoreCluster>,
}

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let drives = session.for_each_seed("H8: random shores", |seed| drive(session, seed))?;
    let shores: Vec<_> = drives.into_iter().flatten().collect();
    session.step("H8: pictures")?;
    let (world, _) = random_world(SEED)?;
    let world = WaterWorld::of(world, session.rules())?;
    let pipeline = world.run(SEED)?.finish()?;
    let config = &world.config.mapping.shore;
    let caption = "classes and numbers of clusters, of seed 1";
    let mut pictures = shores::picture(&world, &pipeline, "h8-shores", caption)?;
    let limit = Limit::of(&world);
    pictures.push(limit.picture(&shores));
    Ok(Outcome {
        checks: checks(&shores, &limit),
        parts: vec![
            Part::text(include_str!("notes/h8.md")),
            Part::text("Classes of the largest cluster of each stretch:"),
            Part::Table(confusion(&shores, JudgedShore::found)),
            Part::text("Of the same clusters by their share of rigid voxels [HYB §7.2]:"),
            Part::Table(confusion(&shores, |shore| {
                let cluster = shore.cluster.as_ref()?;
                Some(truth_of(config.class_of_ratio(cluster.ratio)))
            })),
            Part::text("By what stands there:"),
            Part::Table(kinds(&shores)),
            Part::text("Canes alone, right of all, by stems a square metre and distance:"),
            Part::Table(limits(&shores, &limit)),
            Part::Pictures(pictures),
        ],
    })
}

fn drive(session: &Session<'_>, seed: u64) -> anyhow::Result<Vec<JudgedShore>> {
    let (world, drawn) = random_world(seed)?;
    let world = WaterWorld::of(world, session.rules())?;
    let pipeline = world.run(seed)?.finish()?;
    let maps = world.maps(&pipeline)?;
    let cell_m = maps.voxels.octree().cell_m();
    let clusters = maps.shore.clusters();
    let clusters = clusters.map(|cluster| MatchedCluster::of(&world, cell_m, cluster));
    let clusters: Vec<_> = clusters.collect();
    let shores = world.world.shores().iter().zip(drawn).enumerate();
    let judged = shores.map(|(number, (shore, drawn))| JudgedShore {
        drawn,
        truth: shore.class,
        cluster: main_cluster(&clusters, number).map(|matched| matched.cluster.clone()),
    });
    Ok(judged.collect())
}

fn truth_of(found: Found) -> Truth {
    match found {
        Found::Sparse => Truth::Sparse,
        Found::Dense => Truth::Dense,
        Found::Solid => Truth::Solid,
    }
}

impl JudgedShore {
    fn found(&self) -> Option<Truth> {
        Some(truth_of(self.cluster.as_ref()?.class))
    }

    fn is_right(&self) -> bool {
        self.found() == Some(self.truth)
    }

    /// Where nothing is found nothing is in the way.
    fn is_solid_called_passable(&self) -> bool {
        self.truth == Truth::Solid && self.found() != Some(Truth::Solid)
    }

    /// Dense canes that a wall could stand behind and not be seen.
    fn is_beyond(&self, limit: &Limit) -> bool {
        self.truth == Truth::Dense
            && self.drawn.density_per_m2 >= limit.per_m2(self.drawn.distance_m)
    }

    /// Canes without anything rigid.
    fn is_canes(&self) -> bool {
        self.drawn.kind <= Kind::PatchyCanes
    }
}

/// Where canes are no longer seen through.
struct Limit {
    hull_m: f64,
    divergence_rad: f64,
}

impl Limit {
    fn of(world: &WaterWorld) -> Self {
        let models = world
            .config
            .sensors
            .values()
            .filter_map(SensorConfig::range_model);
        let lasers = models.filter(|model| model.has_metrics);
        Self {
            hull_m: world.config.vehicle.length_m,
            divergence_rad: lasers.map(|model| model.divergence_rad).fold(0.0, f64::max),
        }
    }

    /// Stems a square metre, at a distance in metres.
    fn per_m2(&self, distance_m: f64) -> f64 {
        let beam_m = CANE_M + self.divergence_rad * distance_m;
        -libm::log(SEEN_THROUGH) / (WITH_SHOOTS * beam_m * self.hull_m)
    }

    /// Canes over distance and density, right or wrong, and the limit.
    fn picture(&self, shores: &[JudgedShore]) -> Picture {
        const COLORS: [[u8; 3]; 5] = [[255; 3], [0, 114, 178], [213, 94, 0], [120; 3], [225; 3]];
        const PER_M: f64 = 10.0;
        let cell = |distance_m: f64, density: f64| {
            [distance_m * PER_M, density].map(|at| libm::floor(at) as i64)
        };
        let (first, last) = (
            cell(0.0, 0.0),
            cell(DISTANCES_M[1] + 1.0, DENSITIES_PER_M2[1] + 2.0),
        );
        let mut canvas = Canvas::new(first, last, &COLORS, 4);
        for at in canvas.cells() {
            if at[0] % 50 == 0 || at[1] % 10 == 0 {
                canvas.set(at, 4);
            }
        }
        canvas.line(3, |at| Some(self.per_m2(at / PER_M)));
        for shore in shores.iter().filter(|shore| shore.is_canes()) {
            let [x, y] = cell(shore.drawn.distance_m, shore.drawn.density_per_m2);
            for at in [[x, y], [x + 1, y], [x, y + 1], [x + 1, y + 1]] {
                canvas.set(at, if shore.is_right() { 1 } else { 2 });
            }
        }
        let caption = "canes alone: distance to the right, 5 m a line, stems a square metre upwards, 10 a line; blue right, orange \
                       wrong; below the grey curve they are seen through";
        canvas.picture("h8-limit", caption)
    }
}

fn checks(shores: &[JudgedShore], limit: &Limit) -> Vec<Check> {
    let count = |is: &dyn Fn(&JudgedShore) -> bool| shores.iter().filter(|shore| is(shore)).count();
    let of = |part: usize, whole: usize| {
        let share = part as f64 / whole.max(1) as f64;
        (share, format!("{part} of {whole}, {:.1} %", 100.0 * share))
    };
    let solid = count(&|shore| shore.truth == Truth::Solid);
    let (missed, missed_text) = of(count(&JudgedShore::is_solid_called_passable), solid);
    let sizes = shores
        .iter()
        .filter_map(|shore| Some(shore.cluster.as_ref()?.voxels));
    let (least, most) = sizes.fold((u32::MAX, 0), |(a, b), size| (a.min(size), b.max(size)));
    let beyond = |shore: &JudgedShore| shore.is_beyond(limit);
    let beyond_right = count(&|shore| beyond(shore) && shore.is_right());
    let (beyond_all, all_right) = (count(&beyond), count(&JudgedShore::is_right));
    let within = shores.len() - beyond_all;
    let (right, right_text) = of(all_right - beyond_right, within);
    vec![
        Check::gate(
            "shores of the right class, but for Dense canes beyond the limit",
            right_text,
            "≥ 90 %",
            right >= RIGHT_MIN,
        ),
        Check::shown(
            "all shores of the right class",
            of(all_right, shores.len()).1,
        ),
        Check::shown(
            "Dense canes beyond the limit called Dense",
            of(beyond_right, beyond_all).1,
        ),
        Check::gate(
            "Solid called passable or not found",
            missed_text,
            "≤ 1 %",
            missed <= MISSED_MAX,
        ),
        Check::shown("voxels of a largest cluster", format!("{least} … {most}")),
    ]
}

const CLASSES: [Truth; 3] = [Truth::Sparse, Truth::Dense, Truth::Solid];

fn confusion(shores: &[JudgedShore], found: impl Fn(&JudgedShore) -> Option<Truth>) -> Table {
    let mut table = Table::new(&[
        "actual class",
        "Sparse",
        "Dense",
        "Solid",
        "not found",
        "right",
    ]);
    for truth in CLASSES {
        let of_truth: Vec<_> = shores.iter().filter(|shore| shore.truth == truth).collect();
        let count = |class| {
            of_truth
                .iter()
                .filter(|shore| found(shore) == class)
                .count()
        };
        let [sparse, dense, solid] = CLASSES.map(|class| count(Some(class)).to_string());
        let right = format!("{} of {}", count(Some(truth)), of_truth.len());
        let missing = count(None).to_string();
        table.push([format!("{truth:?}"), sparse, dense, solid, missing, right]);
    }
    table
}

fn kinds(shores: &[JudgedShore]) -> Table {
    let columns = [
        "kind",
        "shores",
        "Sparse, Dense, Solid",
        "right",
        "called too passable",
        "called too solid",
    ];
    let mut table = Table::new(&columns);
    let mut by_kind: BTreeMap<Kind, Vec<&JudgedShore>> = BTreeMap::new();
    for shore in shores {
        by_kind.entry(shore.drawn.kind).or_default().push(shore);
    }
    for (kind, shores) in by_kind {
        let count =
            |is: &dyn Fn(&JudgedShore) -> bool| shores.iter().filter(|shore| is(shore)).count();
        let classes = CLASSES.map(|class| count(&|shore| shore.truth == class).to_string());
        table.push([
            kind.text().to_owned(),
            shores.len().to_string(),
            classes.join(", "),
            count(&JudgedShore::is_right).to_string(),
            count(&|shore| shore.found() < Some(shore.truth)).to_string(),
            count(&|shore| shore.found() > Some(shore.truth)).to_string(),
        ]);
    }
    table
}

fn limits(shores: &[JudgedShore], limit: &Limit) -> Table {
    let distances = DISTANCE_BOUNDS_M.windows(2);
    let names = distances.clone().map(|b| format!("{} … {} m", b[0], b[1]));
    let columns: Vec<_> = std::iter::once("stems / m²".to_owned())
        .chain(names)
        .collect();
    let mut table = Table::new(&columns.iter().map(String::as_str).collect::<Vec<_>>());
    for densities in DENSITY_BOUNDS_PER_M2.windows(2) {
        let mut row = vec![format!("{} … {}", densities[0], densities[1])];
        row.extend(distances.clone().map(|distances| {
            let here = shores.iter().filter(|shore| {
                let is_in = |value: f64, bounds: &[f64]| (bounds[0]..bounds[1]).contains(&value);
                shore.is_canes()
                    && is_in(shore.drawn.density_per_m2, densities)
                    && is_in(shore.drawn.distance_m, distances)
            });
            let (right, wrong): (Vec<_>, Vec<_>) = here.partition(|shore| shore.is_right());
            format!("{} of {}", right.len(), right.len() + wrong.len())
        }));
        table.push(row);
    }
    let mut row = vec!["seen through below".to_owned()];
    row.extend(distances.map(|b| format!("{:.0} … {:.0}", limit.per_m2(b[1]), limit.per_m2(b[0]))));
    table.push(row);
    table
}
