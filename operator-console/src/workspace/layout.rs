//! A layout as it is kept, and the one there is at first.
//!
//! The tree of the docking library is not what is written: its format is its own, and may change with its version.

use std::collections::BTreeSet;

use eframe::egui::Id;
use egui_tiles::{Container, Linear, LinearDir, Tabs, Tile, TileId, Tiles, Tree};
use serde::{Deserialize, Serialize};

use super::PanelId;
use super::flattening::flattened;

/// Widths and heights of the panels around the map, points.
pub(super) const LEFT: f32 = 280.0;
pub(super) const RIGHT: f32 = 300.0;
pub(super) const BELOW: f32 = 190.0;
/// What the map has in a window of 1280×800.
const MAP: [f32; 2] = [700.0, 570.0];
/// A share that is greater was not written by this program.
const MAX_SHARE: f32 = 1e5;

/// Where panels are, and which the operator has closed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Layout {
    root: Place,
    #[serde(default)]
    pub(super) hidden: BTreeSet<PanelId>,
}

/// A part of the window.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Place {
    /// One panel.
    Panel(PanelId),
    /// One at a time.
    Tabs { front: usize, places: Vec<Place> },
    /// From left to right.
    Row(Vec<Part>),
    /// From top to bottom.
    Column(Vec<Part>),
}

/// A place in a row or a column, and its share of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Part {
    pub(super) share: f32,
    pub(super) place: Place,
}

impl Default for Layout {
    fn default() -> Self {
        let tabs = |panels: &[PanelId]| Place::Tabs {
            front: 0,
            places: panels.iter().copied().map(Place::Panel).collect(),
        };
        let part = |share, place| Part { share, place };
        let [map_width, map_height] = MAP;
        let left = Place::Column(vec![
            part(300.0, tabs(&[PanelId::Robot, PanelId::Robots])),
            part(460.0, tabs(&[PanelId::Layers, PanelId::Shores])),
        ]);
        let below = tabs(&[
            PanelId::Link,
            PanelId::Events,
            PanelId::Alerts,
            PanelId::Sensors,
            PanelId::Recording,
            PanelId::Losses,
        ]);
        let middle = Place::Column(vec![
            part(map_height, tabs(&[PanelId::Map])),
            part(BELOW, below),
        ]);
        Self {
            root: Place::Row(vec![
                part(LEFT, left),
                part(map_width, middle),
                part(RIGHT, tabs(&[PanelId::Driving])),
            ]),
            hidden: BTreeSet::new(),
        }
    }
}

impl Layout {
    /// The layout of a tree; that of a first run where there is none in it.
    pub(super) fn of(tree: &Tree<PanelId>, hidden: BTreeSet<PanelId>) -> Self {
        match tree.root.and_then(|root| place_of(&tree.tiles, root)) {
            Some(root) => Self { root, hidden },
            None => Self::default(),
        }
    }

    /// The same with nothing but panels in tabs, of which `dropped` were put there by hand just now.
    pub(super) fn flattened(self, dropped: &BTreeSet<PanelId>) -> Self {
        Self {
            root: flattened(self.root, dropped),
            ..self
        }
    }

    /// The same as a tree.
    pub(super) fn tree(&self) -> Tree<PanelId> {
        let mut tiles = Tiles::default();
        let root = insert(&mut tiles, &self.root);
        Tree::new(Id::unique("workspace"), root, tiles)
    }

    /// Whether every panel is in it once, and every share is one: a file may say anything.
    pub fn is_whole(&self) -> bool {
        let mut panels = Vec::new();
        let is_sound = self.root.collect(&mut panels);
        panels.sort_unstable();
        is_sound && panels == PanelId::ALL
    }
}

impl Place {
    /// Adds its panels; whether all in it is sound.
    pub(super) fn collect(&self, panels: &mut Vec<PanelId>) -> bool {
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
        // None is offered.
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

pub(super) fn share_of(linear: &Linear, child: TileId) -> f32 {
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
    let children: Vec<_> = parts
        .iter()
        .map(|part| insert(tiles, &part.place))
        .collect();
    let mut linear = Linear::new(dir, children.clone());
    for (child, part) in children.into_iter().zip(parts) {
        linear.shares.set_share(child, part.share);
    }
    tiles.insert_container(Container::Linear(linear))
}
