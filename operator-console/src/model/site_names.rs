//! Letters for docking sites that stay with their places.
//!
//! Ranks of docking sites change while the robot maps, and an operator means a place. So a site gets a letter when it
//! first appears, and a site at a known place keeps the letter of that place.
//!
//! **The rule.** A site and a place can match if their centres are no farther apart than half of the greater width:
//! sites do not touch, so a neighbour never matches. If more than one can match, the two that are nearest to *each
//! other* match. Distance is how far the ends have moved: by centres alone, a bank that grows until its centre is where
//! a small site was would take that site's letter. Headings are ignored: they change while a bank is mapped.
//!
//! If two sites merge, one place is inside another. It is a site of its own again if both are listed, but not if one is
//! cut off by the edge of the robot's window: places of the last list take precedence.
//!
//! A place is remembered with its last and its widest extent: a bank may enter the robot's window with another end than
//! the one that left it last.

use std::cmp::Reverse;
use std::fmt;

use protocol::message::DockingSite;

/// Beyond this limit the places that were not listed for the longest time are forgotten. A message holds fewer:
/// [`MAX_SITES`](protocol::shores::MAX_SITES).
const MAX_PLACES: usize = 256;
/// Without I and O, which look like digits. Digits are the names of shores.
const LETTERS: &[u8] = b"ABCDEFGHJKLMNPQRSTUVWXYZ";

/// Name of a docking site: constant for a place in one run of a robot and of this console.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SiteName {
    /// Number of restarts of the names: an A of other maps is another site.
    beginning: u32,
    /// From 0, in order of appearance.
    index: u64,
}

impl fmt::Display for SiteName {
    /// A to Z without I and O, then AA, AB … ZZ, then AAA, as spreadsheet columns.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut letters = Vec::new();
        let mut rest = Some(self.index);
        let count = LETTERS.len() as u64;
        while let Some(index) = rest {
            letters.push(char::from(LETTERS[(index % count) as usize]));
            rest = (index / count).checked_sub(1);
        }
        formatter.pad(&letters.iter().rev().collect::<String>())
    }
}

#[derive(Clone, Debug, Default)]
pub struct SiteNames {
    places: Vec<Place>,
    beginning: u32,
    /// Names given since the restart.
    named: u64,
    lists: u64,
}

impl SiteNames {
    pub fn name(&mut self, sites: &[DockingSite]) -> Vec<SiteName> {
        self.lists += 1;
        let known = self.known(sites);
        let mut names = Vec::with_capacity(sites.len());
        for (site, known) in sites.iter().zip(known) {
            let seen = Extent::of(site);
            if let Some(place) = known.and_then(|at| self.places.get_mut(at)) {
                place.see(seen, self.lists);
                names.push(place.name);
                continue;
            }
            let name = SiteName {
                beginning: self.beginning,
                index: self.named,
            };
            self.named += 1;
            self.places.push(Place {
                name,
                last: seen,
                widest: seen,
                seen_in: self.lists,
            });
            names.push(name);
        }
        if self.places.len() > MAX_PLACES {
            self.places.sort_by_key(|place| Reverse(place.seen_in));
            self.places.truncate(MAX_PLACES);
        }
        names
    }

    /// Restarts the letters for new maps. No earlier name equals a later one.
    pub fn restart(&mut self) {
        *self = Self {
            beginning: self.beginning.wrapping_add(1),
            ..Self::default()
        };
    }

    fn known(&self, sites: &[DockingSite]) -> Vec<Option<usize>> {
        let mut pairs = Vec::new();
        for (rank, site) in sites.iter().enumerate() {
            let seen = Extent::of(site);
            let near = self.places.iter().enumerate();
            pairs.extend(near.filter_map(|(at, place)| Some((place.moved_m(seen)?, rank, at))));
        }
        pairs.sort_by(|(one_m, ..), (other_m, ..)| one_m.total_cmp(other_m));
        // In the nearest remaining pair each is nearest to the other.
        let mut known = vec![None; sites.len()];
        let mut is_taken = vec![false; self.places.len()];
        for (_, rank, at) in &pairs {
            if known[*rank].is_none() && !is_taken[*at] {
                known[*rank] = Some(*at);
                is_taken[*at] = true;
            }
        }
        // A place of the last list that would get no site takes precedence.
        let was_told = |at: usize| self.places[at].seen_in + 1 == self.lists;
        for (_, rank, at) in pairs {
            if let Some(other) = known[rank].filter(|other| !was_told(*other))
                && was_told(at)
                && !is_taken[at]
                // It must match the last extent, not only the widest.
                && self.places[at].last.moved_m(Extent::of(&sites[rank])).is_some()
            {
                known[rank] = Some(at);
                is_taken[at] = true;
                is_taken[other] = false;
            }
        }
        known
    }
}

#[derive(Clone, Copy, Debug)]
struct Place {
    name: SiteName,
    last: Extent,
    widest: Extent,
    seen_in: u64,
}

impl Place {
    fn see(&mut self, seen: Extent, list: u64) {
        self.last = seen;
        if seen.width_m >= self.widest.width_m {
            self.widest = seen;
        }
        self.seen_in = list;
    }

    /// How far the ends of a site have moved from this place; `None` if they cannot match.
    fn moved_m(&self, seen: Extent) -> Option<f64> {
        let moved = [self.last, self.widest].map(|known| known.moved_m(seen));
        moved.into_iter().flatten().min_by(f64::total_cmp)
    }
}

#[derive(Clone, Copy, Debug)]
struct Extent {
    center_m: [f64; 2],
    width_m: f64,
}

impl Extent {
    fn of(site: &DockingSite) -> Self {
        Self {
            center_m: site.center_m.map(f64::from),
            width_m: site.width_m.into(),
        }
    }

    /// How far the ends have moved; `None` if the extents cannot match.
    fn moved_m(self, other: Self) -> Option<f64> {
        let [x, y] = self.center_m;
        let [other_x, other_y] = other.center_m;
        let away_m = libm::hypot(other_x - x, other_y - y);
        let reach_m = 0.5 * self.width_m.max(other.width_m);
        let grown_m = 0.5 * (other.width_m - self.width_m).abs();
        (away_m <= reach_m).then_some(away_m + grown_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CELL_M: f32 = 0.3;

    fn site(x_m: f32, y_m: f32, width_m: f32) -> DockingSite {
        DockingSite {
            center_m: [x_m, y_m],
            heading_rad: 1.0,
            width_m,
            mean_cost: 0.2,
        }
    }

    fn next(names: &mut SiteNames, sites: &[DockingSite]) -> String {
        let letters: Vec<_> = names.name(sites).iter().map(SiteName::to_string).collect();
        letters.join(" ")
    }

    /// The letters of these lists of sites, one after the other.
    fn check(lists: &[(&[DockingSite], &str)]) {
        let mut names = SiteNames::default();
        for (step, (sites, letters)) in lists.iter().enumerate() {
            assert_eq!(next(&mut names, sites), *letters, "list {step}");
        }
    }

    #[test]
    fn letters_survive_changes_of_rank() {
        let (ramp, bank) = (site(10.0, 0.0, 4.0), site(-10.0, 0.0, 4.0));
        let between = site(0.0, 5.0, 4.0);
        check(&[
            (&[ramp, bank], "A B"),
            (&[bank, ramp], "B A"),
            (&[between, bank, ramp], "C B A"),
        ]);
        // A site that returns has its old letter, and no letter is reused.
        check(&[
            (&[ramp, bank], "A B"),
            (&[bank], "B"),
            (&[], ""),
            (&[site(0.0, 30.0, 4.0)], "C"),
            (&[site(10.5, 1.0, 3.0), bank], "A B"),
        ]);
    }

    #[test]
    fn letter_survives_small_moves() {
        let mut names = SiteNames::default();
        // In the end far from where it was widest.
        assert_eq!(next(&mut names, &[site(0.0, 0.0, 6.0)]), "A");
        for step in 1..100 {
            let here = site(step as f32 * CELL_M, 0.0, 1.6);
            assert_eq!(next(&mut names, &[here]), "A", "step {step}");
        }
    }

    #[test]
    fn letter_survives_fast_growth() {
        check(&[
            (&[site(0.0, 0.0, 2.0)], "A"),
            // From 1 m before the old middle to 59 m behind it.
            (&[site(29.0, 0.0, 60.0)], "A"),
            (&[site(57.0, 0.0, 4.0)], "A"),
        ]);
        // Half of the greater width, and no more.
        check(&[
            (&[site(0.0, 0.0, 4.0)], "A"),
            (&[site(2.0, 0.0, 3.0)], "A"),
            (&[site(4.01, 0.0, 3.0)], "B"),
        ]);
        // As in the simulated lake, within four seconds, over another place.
        let (bank, piece) = (site(41.4, -25.6, 26.7), site(62.7, -26.5, 3.4));
        check(&[
            (&[bank, piece], "A B"),
            (&[site(49.5, -25.8, 43.8)], "A"),
            (&[site(63.0, -26.3, 70.0)], "A"),
            // After they part, each has its letter again.
            (&[piece, bank], "B A"),
        ]);
    }

    #[test]
    fn near_sites_do_not_swap_letters() {
        check(&[
            (&[site(0.0, 0.0, 4.0), site(2.9, 0.0, 4.0)], "A B"),
            // Both move, so that the first is nearer to the second's old place than to its own.
            (&[site(1.6, 0.0, 4.0), site(3.1, 0.0, 4.0)], "A B"),
        ]);
        let [left, middle, right] = [-5.0, 0.0, 5.0].map(|x_m| site(x_m, 0.0, 5.0));
        check(&[
            (&[left, middle], "A B"),
            (&[right, middle], "C B"),
            (&[middle, left, right], "B A C"),
        ]);
    }

    #[test]
    fn a_long_bank_is_known_again_by_either_end() {
        check(&[
            (&[site(0.0, 0.0, 20.0)], "A"),
            // The end that leaves the window last is not the one that enters it first.
            (&[site(9.0, 0.0, 2.0)], "A"),
            (&[], ""),
            (&[site(-9.0, 0.0, 2.0)], "A"),
        ]);
    }

    #[test]
    fn letters_survive_a_merge() {
        let (left, right) = (site(-4.0, 0.0, 6.0), site(4.0, 0.0, 6.0));
        let both = site(0.5, 0.0, 15.0);
        check(&[
            (&[left, right], "A B"),
            (&[both], "B"),
            (&[left, right], "A B"),
        ]);
        // A part of the merged bank keeps its letter: its left half alone is where A was.
        check(&[
            (&[left, right], "A B"),
            (&[both], "B"),
            (&[left], "B"),
            (&[both], "B"),
            (&[right], "B"),
            (&[both], "B"),
            (&[left], "B"),
            (&[both], "B"),
            (&[left, right], "A B"),
            (&[right], "B"),
            (&[left], "A"),
            (&[right], "B"),
        ]);
    }

    #[test]
    fn after_z_comes_aa() {
        let mut names = SiteNames::default();
        let sites: Vec<_> = (0..703)
            .map(|at| site(at as f32 * 10.0, 0.0, 4.0))
            .collect();
        let names = names.name(&sites);
        let letters: Vec<_> = names.iter().map(SiteName::to_string).collect();
        assert_eq!(
            [0, 7, 8, 23, 24, 25, 47, 48, 599, 600].map(|at| &letters[at]),
            ["A", "H", "J", "Z", "AA", "AB", "AZ", "BA", "ZZ", "AAA"]
        );
    }

    #[test]
    fn least_recent_place_is_forgotten_first() {
        let mut names = SiteNames::default();
        let (first, second) = (site(0.0, 0.0, 4.0), site(0.0, 50.0, 4.0));
        assert_eq!(next(&mut names, &[first, second]), "A B");
        for at in 0..MAX_PLACES - 1 {
            names.name(&[site(10.0 + at as f32 * 10.0, 0.0, 4.0), second]);
            assert!(names.places.len() <= MAX_PLACES);
        }
        let again = names.name(&[second, first]);
        assert_eq!(again[0].to_string(), "B");
        assert_eq!(
            again[1].index,
            MAX_PLACES as u64 + 1,
            "a letter that was never used"
        );
    }

    #[test]
    fn restart_makes_old_names_invalid() {
        let (ramp, bank) = (site(10.0, 0.0, 4.0), site(-10.0, 0.0, 4.0));
        let mut names = SiteNames::default();
        let before = names.name(&[ramp, bank]);
        names.restart();
        let after = names.name(&[bank, ramp]);
        assert_eq!(
            after.iter().map(SiteName::to_string).collect::<String>(),
            "AB"
        );
        assert!(before.iter().all(|name| !after.contains(name)));
    }

    #[test]
    fn names_are_unique_for_any_input() {
        let mut names = SiteNames::default();
        let odd = [
            site(0.0, 0.0, 0.0),
            site(0.0, 0.0, -1.0),
            site(0.0, 0.0, f32::MAX),
            site(f32::MAX, f32::MIN, f32::MAX),
            site(f32::NAN, 0.0, f32::INFINITY),
        ];
        for _ in 0..3 {
            let found = names.name(&odd);
            for (at, name) in found.iter().enumerate() {
                assert!(!found[..at].contains(name), "{found:?}");
            }
        }
        assert!(names.places.len() <= 3 * odd.len());
    }
}
