//! The `[[plants]]` of a world file.

use nalgebra::Point2;
use serde::Deserialize;
use toml::Spanned;
use toml::de::DeValue;

use super::values::{
    Coordinate, Fault, NotNegative, PlantMetres, Positive, TOO_FEW_CORNERS, Tagged, millimetres,
    point,
};
use crate::noise::NoiseStream;
use crate::scene::Scene;
use crate::vegetation::growth::{Growth, PlantGenerator, Shoots, Stand, Tufts};
use crate::vegetation::{Area, Patch, Rigidity, Vegetation, Wind};

/// The keys of every kind.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CommonKeys {
    #[serde(default)]
    name: String,
    seed: u64,
    rigidity: Rigidity,
    stiffness: Option<Positive>,
}

const COMMON_KEYS: &[&str] = &["name", "seed", "rigidity", "stiffness"];

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StemsEntry {
    rectangle_m: Option<[[Coordinate; 2]; 2]>,
    polygon_m: Option<Vec<[Coordinate; 2]>>,
    along_m: Option<Vec<[Coordinate; 2]>>,
    width_m: Option<Positive>,
    density_per_m2: NotNegative,
    tufts: Option<Tufts>,
    height_m: PlantMetres,
    #[serde(rename = "thickness_mm", deserialize_with = "millimetres")]
    thickness_m: [f64; 2],
    #[serde(default)]
    lean_deg: NotNegative,
    shoots: Option<Shoots>,
}

const NO_AREA: &str = "stems need either `rectangle_m`, `polygon_m`, or `along_m` with `width_m`";

const KINDS: &str = "\"stems\" or \"crowns\"";

const MAX_PATCHES: usize = 1_000;

/// Beyond it a stem would be longer than any plant.
const MAX_LEAN_DEG: f64 = 80.0;

/// Softer, and wind would lay it on the ground farther away than it is high.
const LEAST_STIFFNESS: f64 = 0.1;

/// The plants of the file on `ground`, some of it under water up to `water_m`; `None` where there are none.
pub(super) fn parse(
    tables: Vec<Spanned<DeValue<'_>>>,
    ground: &Scene,
    water_m: Option<f64>,
    wind: Wind,
) -> Result<Option<Vegetation>, Fault> {
    if let Some(extra) = tables.get(MAX_PATCHES) {
        let message = format!("more than {MAX_PATCHES} patches of plants");
        return Err(Fault::new(extra.span(), message));
    }
    if tables.is_empty() {
        return Ok(None);
    }
    let bed_m = |at: Point2<f64>| ground.height_m(at, 0.0);
    let ground_m = |at: Point2<f64>| {
        let height_m = ground.height_m(at, 0.0)?;
        Some(water_m.map_or(height_m, |water_m| water_m.max(height_m)))
    };
    let mut generator = PlantGenerator::new(&bed_m, &ground_m);
    let mut patches = Vec::with_capacity(tables.len());
    let missing = format!("plants need `kind`, which is {KINDS}");
    for table in tables {
        let mut table = Tagged::<CommonKeys>::split(table, "kind", COMMON_KEYS, &missing)?;
        let growth = match table.tag() {
            "stems" => stand(table.keys()?)
                .map(Growth::Stems)
                .map_err(|message| table.fault(message))?,
            "crowns" => Growth::Crowns(table.keys()?),
            _ => return Err(table.unknown_tag("kind", KINDS)),
        };
        let keys = &table.common;
        let stiffness = keys.stiffness.map_or(1.0, |stiffness| stiffness.0);
        if stiffness < LEAST_STIFFNESS {
            return Err(table.fault(format!("`stiffness` is less than {LEAST_STIFFNESS}")));
        }
        let reach = match keys.rigidity {
            Rigidity::Flexible => 1.0 / stiffness,
            Rigidity::Rigid => 0.0,
        };
        let noise = NoiseStream::new(keys.seed, "world/plants");
        let stems = generator
            .grow(&growth, reach, noise)
            .map_err(|error| table.fault(error.to_string()))?;
        patches.push(Patch {
            name: table.common.name,
            rigidity: table.common.rigidity,
            stems,
        });
    }
    let stems = generator.into_stems();
    Ok(Some(Vegetation::new(stems, patches, wind)))
}

fn stand(keys: StemsEntry) -> Result<Stand, String> {
    let line = |corners: Vec<[Coordinate; 2]>| corners.into_iter().map(point).collect();
    let area = match (keys.rectangle_m, keys.polygon_m, keys.along_m, keys.width_m) {
        (Some(corners), None, None, None) => {
            let [a, b] = corners.map(point);
            Area::Rectangle([a.inf(&b), a.sup(&b)])
        }
        (None, Some(corners), None, None) => {
            if corners.len() < 3 {
                return Err(TOO_FEW_CORNERS.to_owned());
            }
            Area::Polygon(line(corners))
        }
        (None, None, Some(along_m), Some(width_m)) => {
            if along_m.len() < 2 {
                return Err("`along_m` needs at least 2 points".to_owned());
            }
            Area::Strip {
                along_m: line(along_m),
                width_m: width_m.0,
            }
        }
        _ => return Err(NO_AREA.to_owned()),
    };
    if keys.lean_deg.0 > MAX_LEAN_DEG {
        return Err(format!("`lean_deg` is more than {MAX_LEAN_DEG}"));
    }
    Ok(Stand {
        area,
        density_per_m2: keys.density_per_m2.0,
        tufts: keys.tufts,
        height_m: keys.height_m.0,
        thickness_m: keys.thickness_m,
        lean_rad: keys.lean_deg.0.to_radians(),
        shoots: keys.shoots,
    })
}
