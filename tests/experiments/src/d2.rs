//! D2: what gives way in a thicket, by a lidar with many rings.

use protocol::layer::LayerId;

use super::h3::objects::{Class, Columns, Objects};
use super::land::{LandWorld, published};
use super::lidars::{add_checks, worlds};
use super::outcome::{Check, Outcome, Part, Spread, Table};
use super::pictures::Picture;
use super::run::known_cells;
use super::session::{Rules, SEED, Session};

const THICKET: &str = include_str!("../../../robot-edge/simulation/worlds/thicket.toml");
/// Share of the obstructed columns of grass and twigs that must be traversable, as in H3.
const GIVES_WAY_MIN_PERCENT: f64 = 90.0;
/// Share of the obstructed columns of rocks that must be called rigid.
const RIGID_MIN_PERCENT: f64 = 95.0;

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let mut outcome = Outcome::default();
    if session.rules() == Rules::Document {
        return Ok(outcome);
    }
    outcome.parts.push(Part::text(include_str!("notes/d2.md")));
    for (label, world) in worlds("thicket", THICKET)? {
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
        add_checks(&mut outcome, label, checks(label, &drives));
        outcome.parts.push(Part::Table(by_class(label, &drives)));
        let pictures = pictures.into_iter().flatten().collect();
        outcome.parts.push(Part::Pictures(pictures));
    }
    Ok(outcome)
}

/// Columns by class, in the order of [`Class::EVALUATED`].
type Drive = [Columns; 4];

fn checks(label: &str, drives: &[Drive]) -> [Check; 4] {
    let rigid = Spread::over(drives, |[rocks, ..]| 100.0 * rocks.rigid_share());
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
            what("rocks that are rigid"),
            (rigid, 1, " %"),
            RIGID_MIN_PERCENT,
        ),
        Check::shown(what("rocks that stay lethal"), lethal(0).text(1, " %")),
        Check::shown(what("trunks that stay lethal"), lethal(1).text(1, " %")),
    ]
}

fn by_class(label: &str, drives: &[Drive]) -> Table {
    let mut table = Columns::table(label);
    for (place, class) in Class::EVALUATED.into_iter().enumerate() {
        let drives: Vec<_> = drives.iter().map(|drive| drive[place]).collect();
        table.push(Columns::row(class.label(), &drives));
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
