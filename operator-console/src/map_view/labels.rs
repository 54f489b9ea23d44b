//! Placement of labels beside what they name. A label hides nothing that is named, and has a leader line where it is not
//! next to its own.

use eframe::egui::{Pos2, Rect, Vec2, vec2};

/// Further labels are omitted: more cannot be read.
const MAX_LABELS: usize = 60;
/// From the bounds of what is named to its label, points.
const DISTANCES: [f32; 4] = [5.0, 20.0, 40.0, 70.0];
const DIRECTIONS: [Vec2; 8] = [
    vec2(1.0, -1.0),
    vec2(-1.0, -1.0),
    vec2(1.0, 1.0),
    vec2(-1.0, 1.0),
    vec2(0.0, -1.0),
    vec2(0.0, 1.0),
    vec2(-1.0, 0.0),
    vec2(1.0, 0.0),
];
/// A shorter leader line is not drawn, points.
const MIN_LEADER: f32 = 4.0;
/// What is this many times as large as its label in both directions may have it inside if there is no other place.
const LARGE: f32 = 4.0;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Label {
    pub(super) size: Vec2,
    pub(super) named: Area,
    /// Tried first.
    pub(super) preferred: Option<Rect>,
    /// It is not omitted to keep something else visible.
    pub(super) is_important: bool,
}

/// A convex polygon on the screen, counter-clockwise as seen; also a line or a point.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Area {
    corners: Vec<Pos2>,
    bounds: Rect,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct PlacedLabel {
    pub(super) place: Rect,
    /// From the label to what it names.
    pub(super) leader: Option<[Pos2; 2]>,
}

/// Places labels on `screen`, the first ones first, beside everything that is named or `taken`. Those without a place
/// are `None`.
pub(super) fn placed(labels: &[Label], screen: Rect, taken: &[Rect]) -> Vec<Option<PlacedLabel>> {
    let mut taken = taken.to_vec();
    let place = |(index, label): (usize, &Label)| {
        if index >= MAX_LABELS {
            return None;
        }
        let is_free = |place: &Rect| {
            screen.contains_rect(*place) && taken.iter().all(|other| !other.intersects(*place))
        };
        let hides_any = |place: &Rect| labels.iter().any(|other| other.named.is_under(*place));
        let beside = label.candidates(screen);
        let beside = || beside.iter().copied().filter(is_free);
        let place = beside().find(|place| !hides_any(place)).or_else(|| {
            let alone = || beside().find(|place| !label.named.is_under(*place));
            let important = label.is_important.then(alone).flatten();
            important.or_else(|| label.inside(screen).filter(is_free))
        })?;
        taken.push(place);
        Some(PlacedLabel {
            place,
            leader: label.named.leader(place),
        })
    };
    labels.iter().enumerate().map(place).collect()
}

impl Label {
    /// The preferred position, then positions around what is named, near ones first.
    fn candidates(&self, screen: Rect) -> Vec<Rect> {
        let near = self.named.bounds.intersect(screen);
        let around = DISTANCES.iter().flat_map(|distance| {
            let reach = 0.5 * (near.size() + self.size) + Vec2::splat(*distance);
            DIRECTIONS
                .map(|towards| Rect::from_center_size(near.center() + towards * reach, self.size))
        });
        self.preferred.into_iter().chain(around).collect()
    }

    fn inside(&self, screen: Rect) -> Option<Rect> {
        let near = self.named.bounds.intersect(screen);
        let is_large = near.width() > LARGE * self.size.x && near.height() > LARGE * self.size.y;
        is_large.then(|| Rect::from_center_size(near.center(), self.size))
    }
}

impl Area {
    pub(super) fn new(corners: Vec<Pos2>) -> Self {
        Self {
            bounds: Rect::from_points(&corners),
            corners,
        }
    }

    pub(super) const fn bounds(&self) -> Rect {
        self.bounds
    }

    fn edges(&self) -> impl Iterator<Item = [Pos2; 2]> {
        let next = self.corners.iter().cycle().skip(1);
        self.corners.iter().zip(next).map(|(from, to)| [*from, *to])
    }

    /// Whether it is partly under a rectangle. Convex polygons are apart if an edge of one has the other on its outer
    /// side.
    fn is_under(&self, place: Rect) -> bool {
        let corners = [
            place.left_top(),
            place.right_top(),
            place.right_bottom(),
            place.left_bottom(),
        ];
        let is_outside = |[from, to]: [Pos2; 2]| {
            let along = to - from;
            let mut sides = corners
                .iter()
                .map(|corner| along.rot90().dot(*corner - from));
            sides.all(|side| side < 0.0)
        };
        self.bounds.intersects(place) && !self.edges().any(is_outside)
    }

    /// From a label to the nearest point of the edge.
    fn leader(&self, place: Rect) -> Option<[Pos2; 2]> {
        let points = self.edges().map(|[from, to]| {
            let along = to - from;
            let length_squared = along.length_sq();
            let part = if length_squared > 0.0 {
                ((place.center() - from).dot(along) / length_squared).clamp(0.0, 1.0)
            } else {
                0.0
            };
            from + part * along
        });
        let by_distance = |a: &Pos2, b: &Pos2| {
            let [a, b] = [a, b].map(|point| place.center().distance_sq(*point));
            a.total_cmp(&b)
        };
        let end = points.min_by(by_distance)?;
        let start = place.clamp(end);
        let is_drawn = !self.is_under(place) && start.distance(end) >= MIN_LEADER;
        is_drawn.then_some([start, end])
    }
}

#[cfg(test)]
mod tests {
    use eframe::egui::pos2;

    use super::*;

    const SIZE: Vec2 = vec2(20.0, 20.0);

    fn screen() -> Rect {
        Rect::from_min_size(Pos2::ZERO, vec2(400.0, 300.0))
    }

    /// A label of a square with this centre and side.
    fn label(center: Pos2, side: f32) -> Label {
        let square = Rect::from_center_size(center, Vec2::splat(side));
        let corners = [
            square.left_bottom(),
            square.right_bottom(),
            square.right_top(),
            square.left_top(),
        ];
        Label {
            size: SIZE,
            named: Area::new(corners.to_vec()),
            preferred: None,
            is_important: false,
        }
    }

    fn places(labels: &[Label], taken: &[Rect]) -> Vec<Option<Rect>> {
        let placed = placed(labels, screen(), taken).into_iter();
        placed.map(|label| label.map(|label| label.place)).collect()
    }

    #[test]
    fn label_is_beside_what_it_names_with_a_leader_line() {
        let square = label(pos2(100.0, 100.0), 10.0);
        let [Some(label)] = &placed(&[square], screen(), &[])[..] else {
            panic!("no place");
        };
        // 5 points to the right of and above the square of 10 points.
        let place = Rect::from_center_size(pos2(120.0, 80.0), SIZE);
        assert_eq!(label.place, place);
        let leader = [pos2(110.0, 90.0), pos2(105.0, 95.0)];
        assert_eq!(label.leader, Some(leader));
    }

    #[test]
    fn labels_of_a_cluster_hide_nothing_and_do_not_overlap() {
        // Squares of 4 points, 10 points apart: smaller than their labels.
        let grid = (0..5_u8).flat_map(|x| (0..5_u8).map(move |y| [x, y]));
        let squares: Vec<_> = grid
            .map(|at| {
                let [x, y] = at.map(|step| 10.0 * f32::from(step));
                label(pos2(180.0 + x, 130.0 + y), 4.0)
            })
            .collect();
        let places = places(&squares, &[]);
        let places: Vec<_> = places.into_iter().flatten().collect();
        assert!(places.len() >= 20, "{} of 25", places.len());
        for (index, place) in places.iter().enumerate() {
            assert!(screen().contains_rect(*place), "{place}");
            let hidden = squares.iter().find(|square| square.named.is_under(*place));
            assert_eq!(hidden, None, "{place}");
            let mut others = places[index + 1..].iter();
            assert!(others.all(|other| !other.intersects(*place)), "{place}");
        }
    }

    #[test]
    fn taken_places_are_avoided_and_the_screen_is_not_left() {
        // The vehicle is to the right of and above it.
        let vehicle = Rect::from_center_size(pos2(120.0, 80.0), SIZE);
        let square = label(pos2(100.0, 100.0), 10.0);
        let [Some(place)] = places(&[square], &[vehicle])[..] else {
            panic!("no place");
        };
        assert_eq!(place.center(), pos2(80.0, 80.0));
        let corner = label(pos2(395.0, 5.0), 4.0);
        let [Some(place)] = places(&[corner], &[])[..] else {
            panic!("no place");
        };
        assert!(screen().contains_rect(place), "{place}");
        assert_eq!(
            places(&[label(pos2(200.0, 150.0), 4.0)], &[screen()]),
            [None]
        );
    }

    #[test]
    fn only_important_labels_hide_others_and_none_hides_its_own() {
        // A small square within a large one that fills the screen but for its edges.
        let large = label(pos2(200.0, 150.0), 280.0);
        let small = label(pos2(200.0, 150.0), 4.0);
        let [_, of_small] = places(&[large.clone(), small.clone()], &[])[..] else {
            panic!("two labels");
        };
        assert_eq!(of_small, None);
        let important = Label {
            is_important: true,
            preferred: Some(Rect::from_center_size(pos2(200.0, 150.0), SIZE)),
            ..small
        };
        let [Some(of_large), Some(of_small)] = places(&[large.clone(), important.clone()], &[])[..]
        else {
            panic!("both have a place");
        };
        assert!(!large.named.is_under(of_large), "{of_large}");
        assert!(!important.named.is_under(of_small), "{of_small}");
        // What fills the screen has its label inside.
        let whole = label(pos2(200.0, 150.0), 900.0);
        let [Some(whole)] = &placed(&[whole], screen(), &[])[..] else {
            panic!("no place");
        };
        assert_eq!(
            (whole.place.center(), whole.leader),
            (pos2(200.0, 150.0), None)
        );
    }

    #[test]
    fn a_slanting_area_is_only_hidden_where_it_is() {
        // The lower left half of a square.
        let corners = [pos2(100.0, 100.0), pos2(100.0, 200.0), pos2(200.0, 200.0)];
        let half = Area::new(corners.to_vec());
        let at = |x, y| Rect::from_center_size(pos2(x, y), SIZE);
        for (place, is_hidden) in [
            (at(120.0, 180.0), true),
            (at(180.0, 120.0), false),
            (at(150.0, 150.0), true),
            (at(161.0, 140.0), false),
            (at(80.0, 150.0), false),
        ] {
            assert_eq!(half.is_under(place), is_hidden, "{place}");
        }
    }
}
