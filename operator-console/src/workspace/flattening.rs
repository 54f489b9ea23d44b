//! Tabs hold panels, and nothing else: a tab that holds tabs or a row has no name that says what is in it, and can not
//! be closed.
//!
//! Where a panel is dropped on the lower part of another, the library puts both into tabs, or a row, of their own within
//! the tabs that were there. What its preview had marked is what an operator expects: a tab beside the others, or a
//! place beside all of them.

use std::collections::BTreeSet;

use super::PanelId;
use super::layout::{Part, Place};

/// A row or a column around tabs that were found in it, and their place in it.
struct Enclosing {
    make: fn(Vec<Part>) -> Place,
    others: Vec<Part>,
    at: usize,
    share: f32,
}

/// The same with nothing but panels in tabs, of which the same one is in front. Of a row in tabs, what is not of the
/// `dropped` panels stays with the other tabs, and the row is around them.
pub(super) fn flattened(place: Place, dropped: &BTreeSet<PanelId>) -> Place {
    let each = |parts: Vec<Part>| {
        let parts = parts.into_iter().map(|part| Part {
            share: part.share,
            place: flattened(part.place, dropped),
        });
        parts.collect()
    };
    match place {
        Place::Panel(panel) => Place::Panel(panel),
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
    // The innermost was found last.
    enclosing.into_iter().rev().fold(tabs, |place, enclosing| {
        let share = enclosing.share;
        let mut parts = enclosing.others;
        parts.insert(enclosing.at, Part { share, place });
        (enclosing.make)(parts)
    })
}

fn holds(place: &Place, panels: &BTreeSet<PanelId>) -> bool {
    let mut held = Vec::new();
    // Whether it is sound is asked where a layout is read.
    let _is_sound = place.collect(&mut held);
    held.iter().any(|panel| panels.contains(panel))
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn tabs_within_tabs_are_tabs_beside_the_others() {
        use PanelId::{Alerts, Events, Link, Losses, Sensors};
        let deepest = tabs(1, vec![panels(0, &[Alerts]), panels(1, &[Sensors, Losses])]);
        let nested = tabs(1, vec![Place::Panel(Link), deepest, Place::Panel(Events)]);
        let nobody = BTreeSet::new();
        let expected = panels(3, &[Link, Alerts, Sensors, Losses, Events]);
        assert_eq!(flattened(nested, &nobody), expected);
        // One that is not in front brings nothing to the front.
        let behind = tabs(0, vec![Place::Panel(Link), panels(1, &[Alerts, Events])]);
        let expected = panels(0, &[Link, Alerts, Events]);
        assert_eq!(flattened(behind, &nobody), expected);
        let row = Place::Row(parts([panels(1, &[Link, Events]), Place::Panel(Losses)]));
        assert_eq!(flattened(row.clone(), &nobody), row);
    }

    #[test]
    fn a_row_within_tabs_is_beside_all_of_them() {
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
