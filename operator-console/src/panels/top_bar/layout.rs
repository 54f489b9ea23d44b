//! What each part of the bar has of it where it is narrow: who drives and how the link is come first, then age, map and name. A
//! short name is whole before that, as long as the words of the map, and then of the link, have their marks left to say it. What
//! changes from moment to moment has the same room whatever it says, and so nothing beside it jumps.

/// A name that has less says nothing, points: a shorter one is whole.
const LEAST_NAME: f32 = 64.0;
/// Longer names are shortened, points: what follows matters more. In a wide bar, those that have more than this share of it.
const NAME: f32 = 220.0;
const NAME_SHARE: f32 = 0.4;

/// What the parts would have, and what lies between them, points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Wanted {
    pub(super) name: f32,
    /// The widest that it may be.
    pub(super) link: f32,
    /// The age in long and in short, with the gap before it; none where there is none.
    pub(super) ages: Option<[f32; 2]>,
    /// With what is between it and the map; 0 where nobody can drive.
    pub(super) driver: f32,
    /// Of a map that is as it should be.
    pub(super) map: f32,
    /// The mark of the link or of the map, without words.
    pub(super) mark: f32,
    /// What lies before the map.
    pub(super) before_map: f32,
    /// All other gaps.
    pub(super) gaps: f32,
}

/// What they have, points. The map has the rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Widths {
    pub(super) name: f32,
    /// Whether the link is there in words, beside its mark.
    pub(super) has_link_words: bool,
    /// Of the age, and whether it is there in long.
    pub(super) age: Option<(f32, bool)>,
    /// Whether the map is there at all.
    pub(super) has_map: bool,
}

impl Widths {
    /// Where there are so many points for all: the first of these in which the name has what it needs.
    pub(super) fn new(available: f32, wanted: Wanted) -> Self {
        let Wanted {
            name,
            link,
            ages,
            driver,
            map,
            mark,
            before_map,
            gaps,
        } = wanted;
        let name = name.min(NAME.max(NAME_SHARE * available));
        let [long, short] = [true, false]
            .map(|is_long| ages.map(|[long, short]| (if is_long { long } else { short }, is_long)));
        // With so much for the link, this age, and so much for the map.
        let kinds = [
            (link, long, Some(map)),
            (link, short, Some(map)),
            (link, None, Some(map)),
            (link, None, Some(mark)),
            (mark, None, Some(mark)),
            (mark, None, None),
        ];
        let free = |(link, age, map): (f32, Option<(f32, bool)>, Option<f32>)| {
            let age = age.map_or(0.0, |(age, _)| age);
            let map = map.map_or(0.0, |map| before_map + map);
            available - link - age - driver - map - gaps
        };
        let [.., last] = kinds;
        let fits = |kind: &_| free(*kind) >= name.min(LEAST_NAME);
        let kind = kinds.into_iter().find(fits).unwrap_or(last);
        let (link_has, age, map) = kind;
        Self {
            // Who drives gives way where even the least is too much.
            name: free(kind).max(LEAST_NAME).min(name).min(available.max(0.0)),
            has_link_words: link_has > mark,
            age,
            has_map: map.is_some(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WANTED: Wanted = Wanted {
        name: 450.0,
        link: 60.0,
        ages: Some([90.0, 60.0]),
        driver: 120.0,
        map: 65.0,
        mark: 20.0,
        before_map: 14.0,
        gaps: 26.0,
    };

    #[test]
    fn who_drives_and_the_link_come_first_then_age_map_and_name() {
        let room = |available| {
            let room = Widths::new(available, WANTED);
            assert!(room.has_link_words && room.has_map, "{available}: {room:?}");
            (room.name, room.age)
        };
        let [long, short] = [Some((90.0, true)), Some((60.0, false))];
        assert_eq!(room(1200.0), (450.0, long));
        assert_eq!(room(1000.0), (400.0, long));
        assert_eq!(room(600.0), (225.0, long));
        assert_eq!(room(475.0), (100.0, long));
        assert_eq!(room(439.0), (LEAST_NAME, long));
        assert_eq!(room(438.0), (93.0, short));
        assert_eq!(room(409.0), (LEAST_NAME, short));
        assert_eq!(room(408.0), (123.0, None));
        assert_eq!(room(349.0), (LEAST_NAME, None));
        // The map has its mark alone.
        assert_eq!(room(348.0), (108.0, None));
        assert_eq!(room(304.0), (LEAST_NAME, None));
    }

    #[test]
    fn a_short_name_is_whole_while_words_can_be_left_out_for_it() {
        let room = |available, name| {
            let room = Widths::new(available, Wanted { name, ..WANTED });
            (room.name, room.has_link_words, room.has_map)
        };
        for (available, words, map) in [
            (349.0, true, true),
            (280.0, true, true),
            (279.0, false, true),
            (240.0, false, true),
            (239.0, false, false),
            (206.0, false, false),
            // Who drives is shortened.
            (150.0, false, false),
        ] {
            let expected = (40.0, words, map);
            assert_eq!(room(available, 40.0), expected, "{available}");
        }
        assert_eq!(room(303.0, 450.0), (103.0, false, true));
        assert_eq!(room(100.0, 450.0), (LEAST_NAME, false, false));
    }
}
