//! The plants of a world.

use nalgebra::{Point2, Vector2};
use toml::Spanned;

use super::super::fault::Fault;
use super::super::file::{
    AreaEntry, CrownsEntry, GrowthEntry, Header, PlantsEntry, RigidityEntry, ShootsEntry,
    StemsEntry, WindEntry,
};
use super::super::number::{BetweenMillimetres, Coordinate};
use crate::noise::NoiseStream;
use crate::scene::{Growth as SceneGrowth, Receiver, Scene};
use crate::vegetation::area::Area;
use crate::vegetation::growth::{Between, Crowns, Growth, PlantGenerator, Shoots, Stand, Tufts};
use crate::vegetation::wind::Wind;
use crate::vegetation::{Patch, Rigidity, Vegetation};

const MAX_PATCHES: usize = 1_000;

/// Beyond it a stem would be longer than any plant.
const MAX_LEAN_DEG: f64 = 80.0;

/// Softer, and wind would lay it on the ground farther away than it is high.
const LEAST_STIFFNESS: f64 = 0.1;

/// `None` where there are none.
pub(super) fn build(
    entries: &[Spanned<PlantsEntry>],
    header: &Header,
    ground: &Scene,
) -> Result<Option<SceneGrowth>, Fault> {
    if let Some(extra) = entries.get(MAX_PATCHES) {
        let message = format!("more than {MAX_PATCHES} patches of plants");
        return Err(Fault::new(extra.span(), message));
    }
    if entries.is_empty() {
        return Ok(None);
    }
    let water_m = header.water.as_ref().map(|water| water.level_m.0);
    let ground_m = |at: Point2<f64>| {
        let height_m = ground.height_m(at, 0.0)?;
        Some(water_m.map_or(height_m, |water_m| water_m.max(height_m)))
    };
    let bed_m = |at: Point2<f64>| ground.height_m(at, 0.0);
    let mut generator = PlantGenerator::new(&bed_m, &ground_m);
    let mut patches = Vec::with_capacity(entries.len());
    for entry in entries {
        let span = entry.span();
        let PlantsEntry { any, growth } = entry.get_ref();
        let stiffness = any.stiffness.map_or(1.0, |stiffness| stiffness.0);
        if stiffness < LEAST_STIFFNESS {
            let message = format!("`stiffness` is less than {LEAST_STIFFNESS}");
            return Err(Fault::new(span, message));
        }
        let (rigidity, reach) = match any.rigidity {
            RigidityEntry::Flexible => (Rigidity::Flexible, 1.0 / stiffness),
            RigidityEntry::Rigid => (Rigidity::Rigid, 0.0),
        };
        let growth = match growth {
            GrowthEntry::Stems(entry) => {
                Growth::Stems(stand(entry).map_err(|message| Fault::new(span.clone(), message))?)
            }
            GrowthEntry::Crowns(entry) => Growth::Crowns(crowns(entry)),
        };
        let noise = NoiseStream::new(any.seed, "world/plants");
        let stems = generator
            .grow(&growth, reach, noise)
            .map_err(|error| Fault::new(span, error.to_string()))?;
        patches.push(Patch {
            name: any.name.clone(),
            rigidity,
            stems,
        });
    }
    let wind = header.wind.as_ref().map_or(Wind::CALM, wind);
    Ok(Some(SceneGrowth {
        vegetation: Vegetation::new(generator.into_stems(), patches, wind),
        receiver: Receiver {
            min_share: header.receiver.min_share.0,
            separation_m: header.receiver.separation_m.0,
        },
    }))
}

fn stand(entry: &StemsEntry) -> Result<Stand, String> {
    let area = entry
        .area()
        .ok_or("stems need either `rectangle_m`, `polygon_m`, or `along_m` with `width_m`")?;
    if entry.lean_deg.0 > MAX_LEAN_DEG {
        return Err(format!("`lean_deg` is more than {MAX_LEAN_DEG}"));
    }
    Ok(Stand {
        area: match area {
            AreaEntry::Rectangle(corners) => {
                let [a, b] = corners.map(point);
                Area::Rectangle([a.inf(&b), a.sup(&b)])
            }
            AreaEntry::Polygon(corners) => Area::Polygon(polygon(corners)?),
            AreaEntry::Strip { along_m, width_m } => {
                if along_m.len() < 2 {
                    return Err("`along_m` needs at least 2 points".to_owned());
                }
                Area::Strip {
                    along_m: along_m.iter().copied().map(point).collect(),
                    width_m: width_m.0,
                }
            }
        },
        density_per_m2: entry.density_per_m2.0,
        tufts: entry.tufts.map(|tufts| Tufts {
            stems: tufts.stems,
            radius_m: tufts.radius_m.0,
        }),
        height_m: entry.height_m.0,
        thickness_m: metres(entry.thickness_mm),
        lean_rad: entry.lean_deg.0.to_radians(),
        shoots: entry.shoots.map(|shoots| {
            let ShootsEntry {
                count,
                length_m,
                thickness_mm,
            } = shoots;
            Shoots {
                count,
                length_m: length_m.0,
                thickness_m: metres(thickness_mm),
            }
        }),
    })
}

fn crowns(entry: &CrownsEntry) -> Crowns {
    Crowns {
        at_m: entry.at_m.iter().copied().map(point).collect(),
        radius_m: entry.radius_m.0,
        bottom_m: entry.bottom_m.0,
        height_m: entry.height_m.0,
        branches: entry.branches,
        branch_thickness_m: metres(entry.branch_thickness_mm),
        leaves_per_m2: entry.leaves_per_m2.0,
        leaf_length_m: entry.leaf_length_m.0,
        leaf_thickness_m: metres(entry.leaf_thickness_mm),
    }
}

fn wind(entry: &WindEntry) -> Wind {
    let towards_rad = entry.towards_deg.0.to_radians();
    Wind {
        towards: Vector2::new(libm::cos(towards_rad), libm::sin(towards_rad)),
        lean: entry.lean.0,
        sway: entry.sway.0,
        period_s: entry.period_s.0,
    }
}

pub(super) fn polygon(corners: &[[Coordinate; 2]]) -> Result<Vec<Point2<f64>>, String> {
    if corners.len() < 3 {
        return Err("`polygon_m` needs at least 3 corners".to_owned());
    }
    Ok(corners.iter().copied().map(point).collect())
}

fn point(at: [Coordinate; 2]) -> Point2<f64> {
    Point2::from(at.map(|coordinate| coordinate.0))
}

fn metres(BetweenMillimetres(millimetres): BetweenMillimetres) -> Between {
    millimetres.map(|mm| 1e-3 * mm)
}
