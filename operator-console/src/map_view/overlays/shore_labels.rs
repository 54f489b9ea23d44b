//! Placement of shore and docking site labels: nearest first, without overlaps.

use eframe::egui::{Pos2, Rect, Vec2, vec2};

/// Between a moved label and the one it avoids, points.
const APART: f32 = 1.0;
/// Candidate positions in label sizes: in place, above, below, left, right.
const PLACES: [Vec2; 5] = [
    Vec2::ZERO,
    vec2(0.0, -1.0),
    vec2(0.0, 1.0),
    vec2(-1.0, 0.0),
    vec2(1.0, 0.0),
];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Shore,
    Site,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Label {
    pub(super) kind: Kind,
    /// Preferred centre on the screen.
    pub(super) at: Pos2,
    /// Points.
    pub(super) size: Vec2,
    /// Distance from the vehicle, m; infinite if unknown.
    pub(super) away_m: f64,
    /// Selected or hovered: placed first.
    pub(super) is_marked: bool,
}

/// Whether a label at its preferred position is visible. Others are not placed.
pub(super) fn is_in_sight((at, size): (Pos2, Vec2), screen: Rect, vehicle: Option<Pos2>) -> bool {
    screen.intersects(preferred_rect(at, size, vehicle))
}

fn preferred_rect(at: Pos2, size: Vec2, vehicle: Option<Pos2>) -> Rect {
    Rect::from_center_size(at + vehicle_clearance(at, size, vehicle), size)
}

/// Indices and positions of the placed labels. Order: marked ones, the nearest shore and the nearest docking site,
/// then by distance. A label that would overlap moves by at most its own size, or is omitted. No label covers the
/// vehicle.
pub(super) fn placed(labels: &[Label], screen: Rect, vehicle: Option<Pos2>) -> Vec<(usize, Rect)> {
    let seen = labels.iter().enumerate();
    let mut seen: Vec<_> = seen
        .filter(|(_, label)| is_in_sight((label.at, label.size), screen, vehicle))
        .collect();
    seen.sort_by(|(_, a), (_, b)| a.away_m.total_cmp(&b.away_m));
    let nearest = [Kind::Shore, Kind::Site].map(|kind| {
        let mut of_kind = seen.iter().filter(|(_, label)| label.kind == kind);
        of_kind.next().map(|(index, _)| *index)
    });
    seen.sort_by_key(|(index, label)| (!label.is_marked, !nearest.contains(&Some(*index))));
    let mut taken: Vec<(usize, Rect)> = Vec::new();
    for (index, label) in seen {
        let mut places = PLACES.iter().map(|place| {
            let at = label.at + *place * (label.size + Vec2::splat(APART));
            preferred_rect(at, label.size, vehicle)
        });
        let free = places.find(|place| {
            let mut others = taken.iter().map(|(_, other)| other);
            screen.intersects(*place) && others.all(|other| !other.intersects(*place))
        });
        taken.extend(free.map(|place| (index, place)));
    }
    taken
}

/// Shortest offset that moves a label off the vehicle.
fn vehicle_clearance(at: Pos2, size: Vec2, vehicle: Option<Pos2>) -> Vec2 {
    let Some(vehicle_at) = vehicle else {
        return Vec2::ZERO;
    };
    let way = at - vehicle_at;
    let lacks = 0.5 * (size + Vec2::splat(super::vehicle::ARROW)) - way.abs();
    if lacks.min_elem() <= 0.0 {
        Vec2::ZERO
    } else if lacks.x < lacks.y {
        vec2(lacks.x.copysign(way.x), 0.0)
    } else {
        vec2(0.0, lacks.y.copysign(way.y))
    }
}

#[cfg(test)]
mod tests {
    use eframe::egui::pos2;

    use super::*;

    const SIZE: Vec2 = vec2(20.0, 20.0);

    fn label(kind: Kind, x: f32, away_m: f64) -> Label {
        Label {
            kind,
            at: pos2(x, 100.0),
            size: SIZE,
            away_m,
            is_marked: false,
        }
    }

    fn screen() -> Rect {
        Rect::from_min_size(Pos2::ZERO, vec2(400.0, 200.0))
    }

    fn order(labels: &[Label]) -> Vec<usize> {
        let placed = placed(labels, screen(), None);
        placed.into_iter().map(|(index, _)| index).collect()
    }

    #[test]
    fn marked_then_nearest_labels_are_placed_first() {
        let mut labels = vec![
            label(Kind::Site, 50.0, 90.0),
            label(Kind::Site, 100.0, 40.0),
            label(Kind::Shore, 150.0, 30.0),
            label(Kind::Shore, 200.0, 5.0),
            label(Kind::Shore, 250.0, 70.0),
            // Nearest, but out of sight.
            label(Kind::Shore, 900.0, 1.0),
        ];
        assert_eq!(order(&labels), [3, 1, 2, 4, 0]);
        labels[4].is_marked = true;
        assert_eq!(order(&labels), [4, 3, 1, 2, 0]);
        // The vehicle's position is unknown.
        for label in &mut labels {
            label.away_m = f64::INFINITY;
        }
        assert_eq!(order(&labels), [4, 0, 2, 1, 3]);
    }

    #[test]
    fn overlapping_labels_move_or_are_omitted() {
        let labels: Vec<_> = (0..6_u8)
            .map(|n| label(Kind::Shore, 100.0, f64::from(n)))
            .collect();
        let placed = placed(&labels, screen(), None);
        let middles: Vec<_> = placed
            .iter()
            .map(|(index, place)| (*index, place.center()))
            .collect();
        let expected = [
            (0, pos2(100.0, 100.0)),
            (1, pos2(100.0, 79.0)),
            (2, pos2(100.0, 121.0)),
            (3, pos2(79.0, 100.0)),
            (4, pos2(121.0, 100.0)),
        ];
        assert_eq!(middles, expected, "the farthest has no place");
    }

    #[test]
    fn a_moved_label_does_not_cover_the_vehicle() {
        let labels = [
            label(Kind::Shore, 100.0, 1.0),
            label(Kind::Shore, 100.0, 2.0),
        ];
        // Above both labels.
        let vehicle = pos2(100.0, 75.0);
        let placed = placed(&labels, screen(), Some(vehicle));
        assert_eq!(placed.len(), 2);
        let mark = Rect::from_center_size(vehicle, Vec2::splat(super::super::vehicle::ARROW));
        for (_, place) in placed {
            assert!(!mark.shrink(0.01).intersects(place), "{place}");
        }
    }
}
