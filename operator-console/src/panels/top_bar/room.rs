//! What each part of the bar has of it where it is narrow: who drives and how the link is come first, then age, map and name. What
//! changes from moment to moment has the same room whatever it says, and so nothing beside it jumps.

/// A name that has less says nothing, points.
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
    /// All other gaps.
    pub(super) gaps: f32,
}

/// What they have, points. The map has the rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Room {
    pub(super) name: f32,
    /// Of the age, and whether it is there in long.
    pub(super) age: Option<(f32, bool)>,
}

impl Room {
    /// Where there are so many points for all.
    pub(super) fn new(available: f32, wanted: Wanted) -> Self {
        let Wanted {
            name,
            link,
            ages,
            driver,
            map,
            gaps,
        } = wanted;
        let name = name.min(NAME.max(NAME_SHARE * available));
        let free = available - link - driver - gaps - map;
        let fits = |(age, _): &(f32, bool)| free - age >= name.min(LEAST_NAME);
        let age =
            ages.and_then(|[long, short]| [(long, true), (short, false)].into_iter().find(fits));
        let free = free - age.map_or(0.0, |(age, _)| age);
        Self {
            name: free.min(name).max(0.0),
            age,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_drives_and_the_link_come_first_then_age_map_and_name() {
        let wanted = Wanted {
            name: 450.0,
            link: 60.0,
            ages: Some([90.0, 60.0]),
            driver: 120.0,
            map: 65.0,
            gaps: 40.0,
        };
        let room = |available| {
            let Room { name, age } = Room::new(available, wanted);
            (name, age)
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
        assert_eq!(room(300.0), (15.0, None));
        assert_eq!(room(100.0), (0.0, None));
    }
}
