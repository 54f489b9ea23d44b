//! The `[[plants]]` of a world file.

use serde::Deserialize;
use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

use super::super::fault::Fault;
use super::super::number::{Between, BetweenMillimetres, Coordinate, NotNegative, Positive};

/// One `[[plants]]`.
#[derive(Debug)]
pub(in super::super) struct PlantsEntry {
    pub(in super::super) any: AnyPlants,
    pub(in super::super) growth: GrowthEntry,
}

/// The keys that depend on `kind`.
#[derive(Debug)]
pub(in super::super) enum GrowthEntry {
    Stems(StemsEntry),
    Crowns(CrownsEntry),
}

/// The keys of every kind.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in super::super) struct AnyPlants {
    #[serde(default)]
    pub(in super::super) name: String,
    pub(in super::super) seed: u64,
    pub(in super::super) rigidity: RigidityEntry,
    pub(in super::super) stiffness: Option<Positive>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(in super::super) enum RigidityEntry {
    Flexible,
    Rigid,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in super::super) struct StemsEntry {
    rectangle_m: Option<[[Coordinate; 2]; 2]>,
    polygon_m: Option<Vec<[Coordinate; 2]>>,
    along_m: Option<Vec<[Coordinate; 2]>>,
    width_m: Option<Positive>,
    pub(in super::super) density_per_m2: NotNegative,
    pub(in super::super) tufts: Option<TuftsEntry>,
    pub(in super::super) height_m: Between,
    pub(in super::super) thickness_mm: BetweenMillimetres,
    #[serde(default)]
    pub(in super::super) lean_deg: NotNegative,
    pub(in super::super) shoots: Option<ShootsEntry>,
}

/// Where stems grow.
pub(in super::super) enum AreaEntry<'a> {
    Rectangle([[Coordinate; 2]; 2]),
    Polygon(&'a [[Coordinate; 2]]),
    Strip {
        along_m: &'a [[Coordinate; 2]],
        width_m: Positive,
    },
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in super::super) struct TuftsEntry {
    pub(in super::super) stems: u32,
    pub(in super::super) radius_m: Positive,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in super::super) struct ShootsEntry {
    pub(in super::super) count: u32,
    pub(in super::super) length_m: Between,
    pub(in super::super) thickness_mm: BetweenMillimetres,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in super::super) struct CrownsEntry {
    pub(in super::super) at_m: Vec<[Coordinate; 2]>,
    pub(in super::super) radius_m: Between,
    #[serde(default)]
    pub(in super::super) bottom_m: Between,
    pub(in super::super) height_m: Between,
    pub(in super::super) branches: u32,
    pub(in super::super) branch_thickness_mm: BetweenMillimetres,
    pub(in super::super) leaves_per_m2: NotNegative,
    pub(in super::super) leaf_length_m: Between,
    pub(in super::super) leaf_thickness_mm: BetweenMillimetres,
}

impl StemsEntry {
    /// `None` where the keys give no area or several.
    pub(in super::super) fn area(&self) -> Option<AreaEntry<'_>> {
        match (
            self.rectangle_m,
            self.polygon_m.as_deref(),
            self.along_m.as_deref(),
            self.width_m,
        ) {
            (Some(corners), None, None, None) => Some(AreaEntry::Rectangle(corners)),
            (None, Some(corners), None, None) => Some(AreaEntry::Polygon(corners)),
            (None, None, Some(along_m), Some(width_m)) => {
                Some(AreaEntry::Strip { along_m, width_m })
            }
            _ => None,
        }
    }
}

const KINDS: &str = "\"stems\" or \"crowns\"";
const KEYS_OF_ANY: [&str; 4] = ["name", "seed", "rigidity", "stiffness"];

pub(super) fn parse(plants: Spanned<DeValue<'_>>) -> Result<Vec<Spanned<PlantsEntry>>, Fault> {
    let (span, found) = (plants.span(), plants.get_ref().type_str());
    if let DeValue::Array(plants) = plants.into_inner() {
        plants.into_iter().map(parse_one).collect()
    } else {
        let message = format!("expected `[[plants]]` tables, found {found}");
        Err(Fault::new(span, message))
    }
}

fn parse_one(mut plants: Spanned<DeValue<'_>>) -> Result<Spanned<PlantsEntry>, Fault> {
    let span = plants.span();
    let mut of_any = DeTable::new();
    let mut kind = None;
    if let DeValue::Table(table) = plants.get_mut() {
        kind = table.remove("kind");
        for key in KEYS_OF_ANY {
            if let Some((key, value)) = table.remove_entry(key) {
                of_any.insert(key, value);
            }
        }
    }
    let Some(kind) = kind else {
        let message = format!("plants need `kind`, which is {KINDS}");
        return Err(Fault::new(span, message));
    };
    let any = deserialize(Spanned::new(span.clone(), DeValue::Table(of_any)))?;
    let growth = match kind.get_ref().as_str() {
        Some("stems") => GrowthEntry::Stems(of_kind(plants)?),
        Some("crowns") => GrowthEntry::Crowns(of_kind(plants)?),
        other => {
            let name = other.map(|name| format!(" \"{name}\"")).unwrap_or_default();
            let message = format!("unknown `kind`{name}, expected {KINDS}");
            return Err(Fault::new(kind.span(), message));
        }
    };
    Ok(Spanned::new(span, PlantsEntry { any, growth }))
}

/// As for solids: a message that lists what is allowed lists the keys that were taken out before, too.
fn of_kind<T: DeserializeOwned>(plants: Spanned<DeValue<'_>>) -> Result<T, Fault> {
    deserialize(plants).map_err(|mut fault: Fault| {
        if fault.message.starts_with("unknown field") {
            fault.message += &KEYS_OF_ANY.map(|key| format!(", `{key}`")).concat();
        }
        fault
    })
}

fn deserialize<T: DeserializeOwned>(value: Spanned<DeValue<'_>>) -> Result<T, Fault> {
    Ok(T::deserialize(ValueDeserializer::from(value))?)
}
