//! Shores and docking sites: what stands along the water, how dense, how far away.

mod columns;
mod distance;
mod list;
mod order;

use protocol::layer::{LayerId, Swatch};
use protocol::message::{DockingSite, ShoreCluster};
use protocol::shores::DOCKING_SITE_CODE;

use super::formatting::{count, signed};
use crate::map_view::{MapView, ShoreMark};
use crate::model::{ConsoleModel, Neighbour, Outline, SiteName};

pub(crate) use distance::Distance;
pub use list::shores_ui;

/// What the panel shows.
#[derive(Clone, Debug, PartialEq)]
pub struct ShoresData {
    /// Shores, the nearest first.
    pub shores: Vec<ShoreRow>,
    /// Docking sites, the best first.
    pub sites: Vec<ShoreRow>,
    /// What else there is to say.
    pub notes: Vec<String>,
    /// What a click showed last.
    pub marked: Option<ShoreMark>,
    /// What stands out because the hand was over it.
    pub hovered: Option<ShoreMark>,
}

/// A shore or a docking site in one line.
#[derive(Clone, Debug, PartialEq)]
pub struct ShoreRow {
    /// Which.
    pub mark: ShoreMark,
    /// Number of the shore, or letter of the site.
    pub name: String,
    /// Colour, pattern and name of what it is.
    pub class: Swatch,
    /// Share of rigid voxels, or mean slope cost.
    pub share: String,
    /// Voxels, or width.
    pub size: String,
    /// From the middle of the vehicle: to the nearest edge of the shore, or to the middle of the site.
    pub distance: String,
    /// Why one could dock there; of a shore nothing.
    pub reason: Option<String>,
    /// The whole row in words.
    pub sentence: String,
    /// Where it is in `odom`, metres.
    pub center_m: [f64; 2],
    /// By number or rank, share, size and distance, to sort by.
    keys: [f64; 4],
}

/// What a list is sorted by: what its column is called.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SortBy {
    /// Number of the shore, or rank of the site.
    Number,
    /// Share of rigid voxels, or cost.
    Share,
    /// Voxels, or width: the greatest first.
    Size,
    /// From the vehicle: the nearest first.
    Distance,
}

impl ShoreRow {
    /// Whether it is a docking site.
    const fn is_site(&self) -> bool {
        match self.mark {
            ShoreMark::Shore(_) => false,
            ShoreMark::Site(_) => true,
        }
    }
}

impl ShoresData {
    /// The shores as the robot tells of them and `view` marks them; `None` for a robot that does not.
    pub fn new(model: &ConsoleModel, view: &MapView) -> Option<Self> {
        let (marked, hovered) = (view.marked(), view.hovered());
        if !model.has_shores() {
            return None;
        }
        let vehicle_m = model.vehicle().pose().map(|(pose, _)| {
            let [x, y, _] = pose.position_m;
            [x, y]
        });
        let Some(shores) = model.shores() else {
            return Some(Self {
                shores: Vec::new(),
                sites: Vec::new(),
                notes: vec!["No shore data yet.".to_owned()],
                marked,
                hovered,
            });
        };
        let mut notes = Vec::new();
        if shores.clusters.is_empty() && shores.sites.is_empty() {
            notes.push("No shore detected.".to_owned());
        }
        for (left_out, what) in [
            (shores.clusters_left_out, "smaller shores"),
            (shores.sites_left_out, "worse docking sites"),
        ] {
            if left_out > 0 {
                notes.push(format!("{} {what} are not listed.", count(left_out.into())));
            }
        }
        let beam_m = model.info().map(|info| info.footprint_m[1]);
        let known = model.shore_outlines();
        let rows = shores.clusters.iter().zip(known.outlines());
        let mut rows: Vec<_> = rows.map(|shore| shore_row(shore, vehicle_m)).collect();
        sort(&mut rows, SortBy::Distance);
        let sites = shores.sites.iter().zip(known.neighbours());
        let sites = sites.zip(model.site_names()).zip(1..);
        let site_rows = sites.map(|(((site, neighbour), name), rank)| {
            let row = site_row(site, (*name, rank), vehicle_m);
            let reason = Some(reason(site, beam_m, *neighbour));
            ShoreRow { reason, ..row }
        });
        Some(Self {
            shores: rows,
            sites: site_rows.collect(),
            notes,
            marked,
            hovered,
        })
    }
}

/// Sorts rows as a column wants it.
pub fn sort(rows: &mut [ShoreRow], by: SortBy) {
    rows.sort_by(|a, b| {
        let order = match by {
            SortBy::Number => a.keys[0].total_cmp(&b.keys[0]),
            SortBy::Share => a.keys[1].total_cmp(&b.keys[1]),
            SortBy::Size => b.keys[2].total_cmp(&a.keys[2]),
            SortBy::Distance => a.keys[3].total_cmp(&b.keys[3]),
        };
        order.then(a.keys[0].total_cmp(&b.keys[0]))
    });
}

/// Why a boat fits there: how wide it is against the boat's beam, and what grows nearest to its middle. How gentle it
/// is, is its cost.
fn reason(site: &DockingSite, beam_m: Option<f32>, neighbour: Option<Neighbour>) -> String {
    let width = beam_m
        .filter(|beam_m| *beam_m > 0.0)
        .map(|beam_m| format!("{:.1} × beam", site.width_m / beam_m));
    let neighbour = neighbour.map(|neighbour| {
        let Neighbour {
            number,
            class,
            away_m,
        } = neighbour;
        let class = class.name();
        if away_m > 0.0 {
            format!("{away_m:.0} m to shore {number}, {class}")
        } else {
            format!("shore {number}, {class}, around it")
        }
    });
    let reasons: Vec<_> = width.into_iter().chain(neighbour).collect();
    reasons.join("; ")
}

fn shore_row(
    (cluster, outline): (&ShoreCluster, &Outline),
    vehicle_m: Option<[f64; 2]>,
) -> ShoreRow {
    let away = Distance::of_shore(outline, vehicle_m);
    let share = format!("{:.0} %", 100.0 * cluster.ratio());
    let size = count(cluster.voxels.into());
    let (number, class) = (cluster.number, class_swatch(cluster.class.code()));
    let voxels = f64::from(cluster.voxels);
    ShoreRow {
        mark: ShoreMark::Shore(number),
        reason: None,
        keys: [f64::from(number), cluster.ratio(), voxels, away.key()],
        sentence: format!(
            "Shore {number}, {}, {share} rigid, {size} voxels, {}",
            class.label,
            away.words()
        ),
        name: number.to_string(),
        class,
        share,
        size,
        distance: away.column(),
        center_m: cluster.center_m.map(f64::from),
    }
}

/// Its name stays with it; its rank, from 1, only sorts.
fn site_row(
    site: &DockingSite,
    (name, rank): (SiteName, u32),
    vehicle_m: Option<[f64; 2]>,
) -> ShoreRow {
    let away = Distance::of_site(site, vehicle_m);
    let share = format!("{:.2}", site.mean_cost);
    let size = format!("{} m", signed(site.width_m.into(), 1));
    ShoreRow {
        mark: ShoreMark::Site(name),
        reason: None,
        keys: [
            f64::from(rank),
            f64::from(site.mean_cost),
            f64::from(site.width_m),
            away.key(),
        ],
        sentence: format!(
            "Docking site {name}, cost {share}, {size} wide, {}",
            away.words()
        ),
        name: name.to_string(),
        class: class_swatch(DOCKING_SITE_CODE),
        share,
        size,
        distance: away.column(),
        center_m: site.center_m.map(f64::from),
    }
}

/// A class as the legend of the layer shows it.
fn class_swatch(code: u16) -> Swatch {
    let palette = LayerId::Shore.default_palette();
    let class = LayerId::Shore.classes().get(usize::from(code) - 1);
    Swatch {
        color: palette.color(code),
        pattern: palette.pattern(code),
        mark: palette.mark_color(code),
        label: class.map(|class| class.name.to_owned()).unwrap_or_default(),
    }
}

#[cfg(test)]
mod tests;
