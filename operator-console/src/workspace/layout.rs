//! Stored layout of the panels, and the default one.
//!
//! The tree of the docking library is not stored directly, because its format may change with its version.

use std::collections::BTreeSet;

use eframe::egui::{Id, Vec2};
use egui_tiles::{Container, Linear, LinearDir, Tabs, Tile, TileId, Tiles, Tree};
use serde::{Deserialize, Serialize};

use super::PanelId;

/// Width of the panels beside the map, points.
const LEFT: f32 = 250.0;
const RIGHT: f32 = 300.0;
/// Width of the map in a window of 1280 points.
const MAP: f32 = 730.0;
/// Height of panels below others, points.
const BELOW: f32 = 190.0;
const MAX_SHARE: f32 = 1e5;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Layout {
    root: Place,
    #[serde(default)]
    pub(super) hidden: BTreeSet<PanelId>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Place {
    Panel(PanelId),
    /// Only the panel with index `front` is visible.
    Tabs {
        front: usize,
        places: Vec<Place>,
    },
    Row(Vec<Part>),
    Column(Vec<Part>),
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Part {
    share: f32,
    place: Place,
}

impl Default for Layout {
    fn default() -> Self {
        let tabs = |panels: &[PanelId]| Place::Tabs {
            front: 0,
            places: panels.iter().copied().map(Place::Panel).collect(),
        };
        let part = |share, place| Part { share, place };
        let layers = tabs(&[PanelId::Layers, PanelId::Shores, PanelId::Sensors]);
        let robot = tabs(&[PanelId::Robot, PanelId::Robots, PanelId::Link]);
        let reports = tabs(&[
            PanelId::Alerts,
            PanelId::Events,
            PanelId::Recording,
            PanelId::Losses,
        ]);
        let left = Place::Column(vec![part(430.0, layers), part(330.0, robot)]);
        let right = Place::Column(vec![
            part(560.0, tabs(&[PanelId::Driving])),
            part(200.0, reports),
        ]);
        Self {
            root: Place::Row(vec![
                part(LEFT, left),
                part(MAP, tabs(&[PanelId::Map])),
                part(RIGHT, right),
            ]),
            hidden: BTreeSet::new(),
        }
    }
}

impl Layout {
    pub(super) fn of(tree: &Tree<PanelId>, hidden: BTreeSet<PanelId>) -> Self {
        match tree.root.and_then(|root| place_of(&tree.tiles, root)) {
            Some(root) => Self { root, hidden },
            None => Self::default(),
        }
    }

    /// The same layout with nothing but panels in tabs. `dropped` panels were just moved.
    pub(super) fn flattened(self, dropped: &BTreeSet<PanelId>) -> Self {
        Self {
            root: flattened(self.root, dropped),
            ..self
        }
    }

    pub(super) fn tree(&self) -> Tree<PanelId> {
        let mut tiles = Tiles::default();
        let root = insert(&mut tiles, &self.root);
        Tree::new(Id::unique("workspace"), root, tiles)
    }

    /// Whether it contains each panel once and all shares are valid: settings files may be edited.
    pub fn is_whole(&self) -> bool {
        let mut panels = Vec::new();
        let is_sound = self.root.collect(&mut panels);
        panels.sort_unstable();
        is_sound && panels == PanelId::ALL
    }
}

impl Place {
    fn collect(&self, panels: &mut Vec<PanelId>) -> bool {
        match self {
            Self::Panel(panel) => {
                panels.push(*panel);
                true
            }
            Self::Tabs { places, .. } => {
                !places.is_empty() && places.iter().all(|place| place.collect(panels))
            }
            Self::Row(parts) | Self::Column(parts) => {
                let is_sound = |part: &Part| {
                    let is_share = part.share > 0.0 && part.share < MAX_SHARE;
                    part.place.collect(panels) && is_share
                };
                !parts.is_empty() && parts.iter().all(is_sound)
            }
        }
    }
}

fn place_of(tiles: &Tiles<PanelId>, id: TileId) -> Option<Place> {
    Some(match tiles.get(id)? {
        Tile::Pane(panel) => Place::Panel(*panel),
        Tile::Container(Container::Tabs(tabs)) => {
            let front = |child: &TileId| Some(*child) == tabs.active;
            Place::Tabs {
                front: tabs.children.iter().position(front).unwrap_or(0),
                places: places_of(tiles, &tabs.children),
            }
        }
        Tile::Container(Container::Linear(linear)) => {
            let parts = linear.children.iter().filter_map(|child| {
                Some(Part {
                    share: share_of(linear, *child),
                    place: place_of(tiles, *child)?,
                })
            });
            match linear.dir {
                LinearDir::Horizontal => Place::Row(parts.collect()),
                LinearDir::Vertical => Place::Column(parts.collect()),
            }
        }
        Tile::Container(Container::Grid(grid)) => {
            let children: Vec<_> = grid.children().copied().collect();
            Place::Tabs {
                front: 0,
                places: places_of(tiles, &children),
            }
        }
    })
}

fn places_of(tiles: &Tiles<PanelId>, ids: &[TileId]) -> Vec<Place> {
    ids.iter().filter_map(|id| place_of(tiles, *id)).collect()
}

fn share_of(linear: &Linear, child: TileId) -> f32 {
    let mut shares = linear.shares.iter();
    shares
        .find(|(id, _)| **id == child)
        .map_or(1.0, |(_, share)| *share)
}

fn insert(tiles: &mut Tiles<PanelId>, place: &Place) -> TileId {
    match place {
        Place::Panel(panel) => tiles.insert_pane(*panel),
        Place::Tabs { front, places } => {
            let children: Vec<_> = places.iter().map(|place| insert(tiles, place)).collect();
            let mut tabs = Tabs::new(children.clone());
            if let Some(front) = children.get(*front) {
                tabs.set_active(*front);
            }
            tiles.insert_container(Container::Tabs(tabs))
        }
        Place::Row(parts) => linear(tiles, LinearDir::Horizontal, parts),
        Place::Column(parts) => linear(tiles, LinearDir::Vertical, parts),
    }
}

fn linear(tiles: &mut Tiles<PanelId>, dir: LinearDir, parts: &[Part]) -> TileId {
    let children = parts.iter().map(|part| insert(tiles, &part.place));
    let children: Vec<_> = children.collect();
    let mut linear = Linear::new(dir, children.clone());
    for (child, part) in children.into_iter().zip(parts) {
        linear.shares.set_share(child, part.share);
    }
    tiles.insert_container(Container::Linear(linear))
}

/// Minimum size of the map beside other panels, points, and minimum share of a small window.
const LEAST: f32 = 300.0;
const LEAST_SHARE: f32 = 0.4;
/// Size of a panel that was just docked beside the map, points: the library's default is too small.
const NEW: f32 = 250.0;
/// A smaller size was not set by the operator, points.
const COLLAPSED: f32 = 20.0;

/// Other visible panels keep their size, the map gets the rest.
pub(super) fn resize_for_map(tree: &mut Tree<PanelId>, map: TileId, size: Vec2) {
    let mut way = vec![map];
    while let Some(parent) = tree.tiles.parent_of(way[way.len() - 1]) {
        way.push(parent);
    }
    let mut size = size;
    for pair in way.windows(2).rev() {
        let [child, parent] = [pair[0], pair[1]];
        let Some(Tile::Container(Container::Linear(linear))) = tree.tiles.get(parent) else {
            continue;
        };
        let axis = match linear.dir {
            LinearDir::Horizontal => 0,
            LinearDir::Vertical => 1,
        };
        let others = linear.children.iter().copied();
        let is_other = |other: &TileId| *other != child && tree.tiles.is_visible_in_layout(*other);
        let others: Vec<_> = others.filter(is_other).collect();
        let Some(Tile::Container(Container::Linear(linear))) = tree.tiles.get_mut(parent) else {
            continue;
        };
        let mut taken = 0.0;
        for other in others {
            let mut points = share_of(linear, other);
            if points < COLLAPSED {
                points = NEW;
                linear.shares.set_share(other, points);
            }
            taken += points;
        }
        let least = LEAST.min(LEAST_SHARE * size[axis]);
        let for_map = (size[axis] - taken).max(least);
        // If the space is too small, other panels shrink; their stored sizes stay, for a larger window.
        let share = if taken + for_map > size[axis] {
            for_map * taken / (size[axis] - for_map).max(1.0)
        } else {
            for_map
        };
        linear.shares.set_share(child, share);
        size[axis] = for_map;
    }
}

/// Whether the window is too narrow for the panels beside the map, and too low for those below others, at their default
/// size. If so, the window shows the map and the driving panel alone while this console drives.
pub fn is_tight(window: Vec2) -> [bool; 2] {
    let is_too_small = |whole: f32, taken: f32| whole - taken < LEAST.max(LEAST_SHARE * whole);
    [
        is_too_small(window.x, LEFT + RIGHT),
        is_too_small(window.y, BELOW),
    ]
}

/// A row or column that contained tabs, and their position in it.
struct Enclosing {
    make: fn(Vec<Part>) -> Place,
    others: Vec<Part>,
    at: usize,
    share: f32,
}

/// Tabs must contain panels only: nested tabs have no useful title and cannot be closed. The docking library nests
/// them if a panel is dropped on the lower part of another.
///
/// Nested tabs become tabs beside the others. A row or column in tabs moves around all tabs; its panels that are not
/// `dropped` stay in the tabs.
fn flattened(place: Place, dropped: &BTreeSet<PanelId>) -> Place {
    let each = |parts: Vec<Part>| {
        let parts = parts.into_iter().map(|Part { share, place }| Part {
            share,
            place: flattened(place, dropped),
        });
        parts.collect()
    };
    match place {
        Place::Panel(_) => place,
        Place::Row(parts) => Place::Row(each(parts)),
        Place::Column(parts) => Place::Column(each(parts)),
        Place::Tabs { front, places } => flattened_tabs(front, places, dropped),
    }
}

fn flattened_tabs(front: usize, places: Vec<Place>, dropped: &BTreeSet<PanelId>) -> Place {
    let (mut panels, mut panel_in_front, mut enclosing) = (Vec::new(), 0, Vec::new());
    for (index, place) in places.into_iter().enumerate() {
        let mut inner = flattened(place, dropped);
        let (inner_front, inner_panels) = loop {
            let (make, parts): (fn(Vec<Part>) -> Place, _) = match inner {
                Place::Panel(_) => break (0, vec![inner]),
                Place::Tabs { front, places } => break (front, places),
                Place::Row(parts) => (Place::Row, parts),
                Place::Column(parts) => (Place::Column, parts),
            };
            let mut others = parts;
            let at = others.iter().position(|part| !holds(&part.place, dropped));
            let at = at.unwrap_or(0);
            if others.is_empty() {
                break (0, Vec::new());
            }
            let part = others.remove(at);
            inner = part.place;
            enclosing.push(Enclosing {
                make,
                others,
                at,
                share: part.share,
            });
        };
        if index == front {
            panel_in_front = panels.len() + inner_front;
        }
        panels.extend(inner_panels);
    }
    let tabs = Place::Tabs {
        front: panel_in_front,
        places: panels,
    };
    // Innermost first.
    enclosing.into_iter().rev().fold(tabs, |place, enclosing| {
        let share = enclosing.share;
        let mut parts = enclosing.others;
        parts.insert(enclosing.at, Part { share, place });
        (enclosing.make)(parts)
    })
}

fn holds(place: &Place, panels: &BTreeSet<PanelId>) -> bool {
    let mut held = Vec::new();
    // The result is checked when a layout is read.
    let _is_sound = place.collect(&mut held);
    held.iter().any(|panel| panels.contains(panel))
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::vec2;

    /// Height of the top bar, points.
    const BAR: f32 = 39.0;

    #[test]
    fn is_tight_below_two_fifths_or_300_points() {
        for (width, height, percent, expected) in [
            (1280.0, 800.0, 100.0, [false, false]),
            (1280.0, 800.0, 120.0, [false, false]),
            (1024.0, 600.0, 100.0, [false, false]),
            // 550 of 917 points beside the map are three fifths; 190 of 490 points below others leave 300.
            (918.0, 491.0 + BAR, 100.0, [false, false]),
            (916.0, 489.0 + BAR, 100.0, [true, true]),
            (1280.0, 800.0, 150.0, [true, false]),
            (700.0, 620.0, 100.0, [true, false]),
            (640.0, 480.0, 100.0, [true, true]),
        ] {
            let points = 100.0 / percent * vec2(width, height);
            let reported = is_tight(points - vec2(0.0, BAR));
            assert_eq!(reported, expected, "{width} × {height} at {percent} %");
        }
    }

    fn tabs(front: usize, places: Vec<Place>) -> Place {
        Place::Tabs { front, places }
    }

    fn panels(front: usize, panels: &[PanelId]) -> Place {
        tabs(front, panels.iter().copied().map(Place::Panel).collect())
    }

    fn parts(places: [Place; 2]) -> Vec<Part> {
        let part = |place| Part { share: 1.0, place };
        places.map(part).to_vec()
    }

    #[test]
    fn nested_tabs_are_flattened() {
        use PanelId::{Alerts, Events, Link, Losses, Sensors};
        let deepest = tabs(1, vec![panels(0, &[Alerts]), panels(1, &[Sensors, Losses])]);
        let nested = tabs(1, vec![Place::Panel(Link), deepest, Place::Panel(Events)]);
        let nobody = BTreeSet::new();
        let expected = panels(3, &[Link, Alerts, Sensors, Losses, Events]);
        assert_eq!(flattened(nested, &nobody), expected);
        let behind = tabs(0, vec![Place::Panel(Link), panels(1, &[Alerts, Events])]);
        let expected = panels(0, &[Link, Alerts, Events]);
        assert_eq!(flattened(behind, &nobody), expected);
        let row = Place::Row(parts([panels(1, &[Link, Events]), Place::Panel(Losses)]));
        assert_eq!(flattened(row.clone(), &nobody), row);
    }

    #[test]
    fn a_row_in_tabs_moves_around_them() {
        use PanelId::{Alerts, Events, Layers, Link};
        let beside_layers = [panels(0, &[Layers]), panels(1, &[Link, Alerts, Events])];
        let beside_alerts = [panels(1, &[Link, Layers, Events]), panels(0, &[Alerts])];
        for (dropped, expected) in [(Layers, beside_layers), (Alerts, beside_alerts)] {
            let pair = [panels(0, &[Layers]), panels(0, &[Alerts])];
            let column = Place::Column(parts(pair));
            let nested = tabs(1, vec![Place::Panel(Link), column, Place::Panel(Events)]);
            let flattened = flattened(nested, &[dropped].into());
            assert_eq!(flattened, Place::Column(parts(expected)), "{dropped:?}");
        }
    }
}
