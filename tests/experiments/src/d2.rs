//! D2: what gives way in a thicket, by a lidar with many rings.

use protocol::layer::LayerId;

use super::h3::objects::{Class, Columns, Objects};
use super::land::{LandWorld, published};
use super::outcome::{Check, Outcome, Part, Spread, Table};
use super::pictures::Picture;
use super::run::known_cells;
use super::session::{Rules, SEED, Session};
use super::terrain::changed;
use simulation::World;

const THICKET: &str = include_str!("../../../robot-edge/simulation/worlds/thicket.toml");
const VEHICLE: &str = "vehicle = \"lidar64\"";
/// The gates are those of the first; of the other the figures are shown.
const VEHICLES: [(&str, &str); 2] = [("64 rings", VEHICLE), ("16 rings", "vehicle = \"lidar16\"")];
/// Share of the obstructed columns of grass and twigs that must be traversable, as in H3.
const GIVES_WAY_MIN_PERCENT: f64 = 90.0;
/// Share of the obstructed columns of rocks that must stay lethal.
const LETHAL_MIN_PERCENT: f64 = 95.0;

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let mut outcome = Outcome::default();
    if session.rules() == Rules::Document {
        return Ok(outcome);
    }
    outcome.parts.push(Part::text(include_str!("notes/d2.md")));
    for (label, vehicle) in VEHICLES {
        let world = World::parse("thicket", &changed(THICKET, &[(VEHICLE, vehicle)])?)?;
        let thicket = LandWorld::of(world, session.rules())?;
        let objects = Objects::of(&thicket)?;
        let drives = session.for_each_seed(&format!("D2: {label}"), |seed| {
            let pipeline = thicket.run(seed)?.finish()?;
            let store = pipeline.publisher().store();
            let pictures = if seed == SEED {
                pictures(&store, thicket.world.vehicle(), label)?
            } else {
                Vec::new()
            };
            let costs = published(&store, LayerId::Cost).collect();
            let rigidity = known_cells(&store, LayerId::Rigidity).collect();
            let columns = objects.columns(&costs, &rigidity);
            let of_class = |class| {
                let each = objects.names(class).filter_map(|name| columns.get(name));
                each.copied().fold(Columns::default(), Columns::plus)
            };
            Ok((Class::EVALUATED.map(of_class), pictures))
        })?;
        let (drives, pictures): (Vec<_>, Vec<_>) = drives.into_iter().unzip();
        let checks = checks(label, &drives).into_iter();
        if vehicle == VEHICLE {
            outcome.checks.extend(checks);
        } else {
            outcome.checks.extend(checks.map(Check::without_gate));
        }
        outcome.parts.push(Part::Table(by_class(label, &drives)));
        let pictures = pictures.into_iter().flatten().collect();
        outcome.parts.push(Part::Pictures(pictures));
    }
    Ok(outcome)
}

/// Columns by class, in the order of [`Class::EVALUATED`].
type Drive = [Columns; 4];

fn checks(label: &str, drives: &[Drive]) -> [Check; 3] {
    let lethal = |class: usize| {
        Spread::over(drives, |drive| {
            100.0 - 100.0 * drive[class].traversable_share()
        })
    };
    let gives_way = Spread::over(drives, |[_, _, grass, twigs]| {
        100.0 * grass.plus(*twigs).traversable_share()
    });
    let what = |what: &str| format!("{label}: obstructed columns of {what}");
    [
        Check::at_least(
            what("grass and twigs that are traversable"),
            (gives_way, 1, " %"),
            GIVES_WAY_MIN_PERCENT,
        ),
        Check::at_least(
            what("rocks that stay lethal"),
            (lethal(0), 1, " %"),
            LETHAL_MIN_PERCENT,
        ),
        Check::shown(what("trunks that stay lethal"), lethal(1).text(1, " %")),
    ]
}

fn by_class(label: &str, drives: &[Drive]) -> Table {
    let mut table = Table::new(&[
        label,
        "obstructed columns",
        "rigid, %",
        "traversable, %",
        "lethal, no metric, %",
        "passable columns",
    ]);
    for (place, class) in Class::EVALUATED.into_iter().enumerate() {
        let median = |figure: &dyn Fn(Columns) -> f64| {
            let spread = Spread::over(drives, |drive| figure(drive[place]));
            format!("{:.0}", spread.median)
        };
        table.push([
            class.label().to_owned(),
            median(&|all| all.obstructed() as f64),
            median(&|all| 100.0 * all.rigid_share()),
            median(&|all| 100.0 * all.traversable_share()),
            median(&|all| 100.0 * all.unlabelled_share()),
            median(&|all| all.passable as f64),
        ]);
    }
    table
}

fn pictures(
    store: &protocol::tile_store::TileStore,
    vehicle: &str,
    label: &str,
) -> anyhow::Result<Vec<Picture>> {
    let mut pictures = Vec::new();
    for layer in [LayerId::Cost, LayerId::Rigidity] {
        let name = format!("d2-{vehicle}-{layer}");
        let caption = format!("thicket, {label}: {layer}");
        let palette = layer.default_palette();
        pictures.extend(Picture::of_layer(store, palette, None, &name, &caption)?);
    }
    Ok(pictures)
}
