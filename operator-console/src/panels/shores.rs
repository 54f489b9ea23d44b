//! Shores and docking sites: class, size and distance.

mod list;

use eframe::egui::{Button, Id, Rect, Ui};
use protocol::layer::{LayerId, Swatch};
use protocol::message::{DockingChoice, DockingSite, ShoreClass, ShoreCluster};
use protocol::shores::{DOCKING_SITE_CODE, site_letters};

use super::formatting::{count, signed};
use crate::map_view::{MapView, ShoreMark};
use crate::model::{ConsoleModel, Neighbour, Outline};
use crate::teleop_client::{Intent, TeleopClientState};

pub use list::shores_ui;

#[derive(Clone, Debug, PartialEq)]
pub struct ShoresData {
    pub shores: Vec<ShoreRow>,
    pub sites: Vec<ShoreRow>,
    pub notes: Vec<String>,
    pub marked: Option<ShoreMark>,
    pub hovered: Option<ShoreMark>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct ShoreRow {
    pub mark: ShoreMark,
    /// Number of a shore, letter of a site.
    pub name: String,
    pub class: Swatch,
    pub share: String,
    pub size: String,
    /// From the vehicle to the nearest edge of a shore, or to the middle of a site.
    pub distance: String,
    /// Why a boat can dock there; sites only.
    pub reason: Option<String>,
    /// The row as a sentence, for screen readers.
    pub sentence: String,
    pub center_m: [f64; 2],
    /// Sort keys: number or rank, share, size, distance.
    keys: [f64; 4],
}

/// Docking in vegetation, offered to who drives for the marked site.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DockingOffer {
    choice: DockingChoice,
    is_chosen: bool,
}

impl DockingOffer {
    pub fn new(
        model: &ConsoleModel,
        view: &MapView,
        teleop_client: Option<&TeleopClientState>,
    ) -> Option<Self> {
        let teleop_client = teleop_client.filter(|client| client.lease.held().is_some())?;
        if let Some(choice) = teleop_client.docking {
            let is_chosen = true;
            return Some(Self { choice, is_chosen });
        }
        let sites = &model.shores()?.sites;
        let site = sites
            .iter()
            .find(|site| view.marked() == Some(ShoreMark::Site(site.number)))?;
        Some(Self {
            choice: site.choice()?,
            is_chosen: false,
        })
    }
}

pub fn docking_ui(ui: &mut Ui, offer: DockingOffer) -> Option<Intent> {
    let DockingOffer { choice, is_chosen } = offer;
    let site = site_letters(choice.site);
    let words = if is_chosen {
        format!("End docking at {site}")
    } else {
        format!("Dock at {site}, {}", choice.vegetation.name())
    };
    let hint = "While you drive, the collision monitor lets the vehicle creep into the vegetation of this site, and into \
                nothing else. It ends with the control of the vehicle, or where the robot changes the site's class.";
    let response = ui
        .add(Button::selectable(is_chosen, words))
        .on_hover_text(hint);
    response
        .clicked()
        .then_some(Intent::Dock(Some(choice).filter(|_| !is_chosen)))
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SortBy {
    Number,
    Share,
    Size,
    Distance,
}

impl ShoreRow {
    const fn is_site(&self) -> bool {
        match self.mark {
            ShoreMark::Shore(_) => false,
            ShoreMark::Site(_) => true,
        }
    }
}

impl ShoresData {
    /// `None` if the robot does not map shores.
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
        let site_rows = sites.zip(1..).map(|((site, neighbour), rank)| {
            let row = site_row(site, rank, vehicle_m);
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

/// Width relative to the boat's beam, and the nearest shore.
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

fn site_row(site: &DockingSite, rank: u32, vehicle_m: Option<[f64; 2]>) -> ShoreRow {
    let name = site_letters(site.number);
    let away = Distance::of_site(site, vehicle_m);
    let share = format!("{:.2}", site.price);
    let size = format!("{} m", signed(site.width_m.into(), 1));
    ShoreRow {
        mark: ShoreMark::Site(site.number),
        reason: None,
        keys: [
            f64::from(rank),
            f64::from(site.price),
            f64::from(site.width_m),
            away.key(),
        ],
        sentence: format!(
            "Docking site {name}, {}, price {share}, {size} wide, {}",
            site.ground_name(),
            away.words()
        ),
        name,
        class: class_swatch(site.vegetation.map_or(DOCKING_SITE_CODE, ShoreClass::code)),
        share,
        size,
        distance: away.column(),
        center_m: site.center_m.map(f64::from),
    }
}

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

/// x and y in `odom`, m.
type Point = [f64; 2];

const TO_SHORES: &str = "from the middle of the vehicle to the nearest edge of the shore's outline; \
                                    around: the vehicle is within it";
const TO_SITES: &str = "from the middle of the vehicle to the middle of the docking site";

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Distance {
    Unknown,
    Around,
    Metres(f64),
}

impl Distance {
    pub(crate) fn of_shore(outline: &Outline, vehicle_m: Option<Point>) -> Self {
        match vehicle_m.map(|at_m| outline.away_m(at_m)) {
            None => Self::Unknown,
            Some(away_m) if away_m > 0.0 => Self::Metres(away_m),
            Some(_) => Self::Around,
        }
    }

    pub(crate) fn of_site(site: &DockingSite, vehicle_m: Option<Point>) -> Self {
        vehicle_m.map_or(Self::Unknown, |at_m| {
            let [x, y] = site.center_m.map(f64::from);
            Self::Metres(libm::hypot(x - at_m[0], y - at_m[1]))
        })
    }

    /// Sort key, m; unknown is last.
    pub(crate) const fn key(self) -> f64 {
        match self {
            Self::Unknown => f64::INFINITY,
            Self::Around => 0.0,
            Self::Metres(away_m) => away_m,
        }
    }

    fn column(self) -> String {
        match self {
            Self::Unknown => "–".to_owned(),
            Self::Around => "around".to_owned(),
            Self::Metres(away_m) => {
                let decimals = usize::from(away_m < 9.95);
                format!("{away_m:.decimals$} m")
            }
        }
    }

    fn words(self) -> String {
        match self {
            Self::Unknown => "distance unknown".to_owned(),
            Self::Around => "around the vehicle".to_owned(),
            Self::Metres(_) => format!("{} away", self.column()),
        }
    }
}

/// How a list was drawn in the last pass. Distances change with every pose; rows must not move under the pointer.
#[derive(Clone, Debug)]
struct DrawnList {
    /// The order is outdated if the list was hidden since.
    pass: u64,
    by: SortBy,
    place: Rect,
    order: Vec<ShoreMark>,
}

/// Sorts rows. While the pointer is over them, known rows keep their order and new ones are last.
fn arrange(ui: &Ui, id: Id, rows: &mut [ShoreRow], by: SortBy) {
    sort(rows, by);
    let drawn: Option<DrawnList> = ui.data(|data| data.get_temp(id));
    let is_held = |drawn: &DrawnList| {
        drawn.by == by
            && drawn.pass + 1 == ui.ctx().cumulative_pass_nr()
            && ui.rect_contains_pointer(drawn.place)
    };
    if let Some(drawn) = drawn.filter(is_held) {
        keep_order(rows, &drawn.order);
    }
}

fn remember(ui: &Ui, id: Id, rows: &[ShoreRow], by: SortBy, place: Rect) {
    let drawn = DrawnList {
        pass: ui.ctx().cumulative_pass_nr(),
        by,
        place,
        order: rows.iter().map(|row| row.mark).collect(),
    };
    ui.data_mut(|data| data.insert_temp(id, drawn));
}

fn keep_order(rows: &mut [ShoreRow], order: &[ShoreMark]) {
    rows.sort_by_cached_key(|row| {
        let at = order.iter().position(|mark| *mark == row.mark);
        at.unwrap_or(order.len())
    });
}

#[cfg(test)]
mod tests;
