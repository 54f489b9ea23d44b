//! Numbers of docking sites that stay with their places.
//!
//! Ranks of docking sites change while the robot maps, and an operator means a place. So a site gets a number when it
//! first appears, and a site at a known place keeps the number of that place.
//!
//! **The rule.** A site and a place can match if their centres are no farther apart than half of the greater width:
//! sites do not touch, so a neighbour never matches. If more than one can match, the two that are nearest to *each
//! other* match. Distance is how far the ends have moved: by centres alone, a bank that grows until its centre is where
//! a small site was would take that site's number. Headings are ignored: they change while a bank is mapped.
//!
//! If two sites merge, one place is inside another. It is a site of its own again if both are found, but not if one is
//! cut off by the edge of the window: places of the last update take precedence.
//!
//! A place is remembered with its last and its widest extent: a bank may enter the window with another end than the one
//! that left it last.

use std::cmp::Reverse;

use nalgebra::Point2;

use crate::docking::DockingSite;

/// Beyond this limit the places that were not found for the longest time are forgotten.
const MAX_PLACES: usize = 256;

/// Gives each docking site the number of its place, or a new one. A number is never reused.
#[derive(Clone, Debug, Default)]
pub(crate) struct DockingSiteTracker {
    places: Vec<Place>,
    last_number: u32,
    updates: u64,
}

impl DockingSiteTracker {
    /// Sets the number, from 1, of each site.
    pub(crate) fn assign(&mut self, sites: &mut [DockingSite]) {
        self.updates += 1;
        let known = self.known(sites);
        for (site, known) in sites.iter_mut().zip(known) {
            let found = Extent::of(site);
            if let Some(place) = known.and_then(|at| self.places.get_mut(at)) {
                place.update(found, self.updates);
                site.number = place.number;
                continue;
            }
            self.last_number = self.last_number.saturating_add(1);
            site.number = self.last_number;
            self.places.push(Place {
                number: self.last_number,
                last: found,
                widest: found,
                found_in: self.updates,
            });
        }
        if self.places.len() > MAX_PLACES {
            self.places.sort_by_key(|place| Reverse(place.found_in));
            self.places.truncate(MAX_PLACES);
        }
    }

    fn known(&self, sites: &[DockingSite]) -> Vec<Option<usize>> {
        let mut pairs = Vec::new();
        for (rank, site) in sites.iter().enumerate() {
            let found = Extent::of(site);
            let near = self.places.iter().enumerate();
            pairs.extend(near.filter_map(|(at, place)| Some((place.moved_m(found)?, rank, at))));
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
        // A place of the last update that would get no site takes precedence.
        let is_recent = |at: usize| self.places[at].found_in + 1 == self.updates;
        for (_, rank, at) in pairs {
            if let Some(other) = known[rank].filter(|other| !is_recent(*other))
                && is_recent(at)
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
    number: u32,
    last: Extent,
    widest: Extent,
    found_in: u64,
}

impl Place {
    fn update(&mut self, found: Extent, update: u64) {
        self.last = found;
        if found.width_m >= self.widest.width_m {
            self.widest = found;
        }
        self.found_in = update;
    }

    /// How far the ends of a site have moved from this place; `None` if they cannot match.
    fn moved_m(&self, found: Extent) -> Option<f64> {
        let moved = [self.last, self.widest].map(|known| known.moved_m(found));
        moved.into_iter().flatten().min_by(f64::total_cmp)
    }
}

#[derive(Clone, Copy, Debug)]
struct Extent {
    centre_m: Point2<f64>,
    width_m: f64,
}

impl Extent {
    fn of(site: &DockingSite) -> Self {
        Self {
            centre_m: site.centre_in_odom,
            width_m: site.width_m,
        }
    }

    /// How far the ends have moved; `None` if the extents cannot match.
    fn moved_m(self, other: Self) -> Option<f64> {
        let away_m = (other.centre_m - self.centre_m).norm();
        let reach_m = 0.5 * self.width_m.max(other.width_m);
        let grown_m = 0.5 * (other.width_m - self.width_m).abs();
        (away_m <= reach_m).then_some(away_m + grown_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CELL_M: f64 = 0.3;

    /// x and y of the middle, and the width, metres.
    type Site = [f64; 3];

    const fn site(x_m: f64, y_m: f64, width_m: f64) -> Site {
        [x_m, y_m, width_m]
    }

    fn next(tracker: &mut DockingSiteTracker, sites: &[Site]) -> Vec<u32> {
        let site = |&[x_m, y_m, width_m]: &Site| DockingSite {
            number: 0,
            cells: Vec::new(),
            centre_in_odom: Point2::new(x_m, y_m),
            heading_rad: 1.0,
            vegetation: None,
            price: 0.2,
            approach_in_odom: Point2::origin(),
            passable: Vec::new(),
            width_m,
        };
        let mut sites: Vec<_> = sites.iter().map(site).collect();
        tracker.assign(&mut sites);
        sites.iter().map(|site| site.number).collect()
    }

    /// The numbers of these lists of sites, one after the other.
    fn check(lists: &[(&[Site], &[u32])]) {
        let mut tracker = DockingSiteTracker::default();
        for (step, (sites, numbers)) in lists.iter().enumerate() {
            assert_eq!(next(&mut tracker, sites), *numbers, "list {step}");
        }
    }

    #[test]
    fn numbers_survive_changes_of_rank() {
        let (ramp, bank) = (site(10.0, 0.0, 4.0), site(-10.0, 0.0, 4.0));
        let between = site(0.0, 5.0, 4.0);
        check(&[
            (&[ramp, bank], &[1, 2]),
            (&[bank, ramp], &[2, 1]),
            (&[between, bank, ramp], &[3, 2, 1]),
        ]);
        // A site that returns has its old number, and no number is reused.
        check(&[
            (&[ramp, bank], &[1, 2]),
            (&[bank], &[2]),
            (&[], &[]),
            (&[site(0.0, 30.0, 4.0)], &[3]),
            (&[site(10.5, 1.0, 3.0), bank], &[1, 2]),
        ]);
    }

    #[test]
    fn number_survives_small_moves() {
        let mut tracker = DockingSiteTracker::default();
        // In the end far from where it was widest.
        assert_eq!(next(&mut tracker, &[site(0.0, 0.0, 6.0)]), [1]);
        for step in 1..100 {
            let here = site(f64::from(step) * CELL_M, 0.0, 1.6);
            assert_eq!(next(&mut tracker, &[here]), [1], "step {step}");
        }
    }

    #[test]
    fn number_survives_fast_growth() {
        check(&[
            (&[site(0.0, 0.0, 2.0)], &[1]),
            // From 1 m before the old middle to 59 m behind it.
            (&[site(29.0, 0.0, 60.0)], &[1]),
            (&[site(57.0, 0.0, 4.0)], &[1]),
        ]);
        // Half of the greater width, and no more.
        check(&[
            (&[site(0.0, 0.0, 4.0)], &[1]),
            (&[site(2.0, 0.0, 3.0)], &[1]),
            (&[site(4.01, 0.0, 3.0)], &[2]),
        ]);
        // As in the simulated lake, within four seconds, over another place.
        let (bank, piece) = (site(41.4, -25.6, 26.7), site(62.7, -26.5, 3.4));
        check(&[
            (&[bank, piece], &[1, 2]),
            (&[site(49.5, -25.8, 43.8)], &[1]),
            (&[site(63.0, -26.3, 70.0)], &[1]),
            // After they part, each has its number again.
            (&[piece, bank], &[2, 1]),
        ]);
    }

    #[test]
    fn near_sites_do_not_swap_numbers() {
        check(&[
            (&[site(0.0, 0.0, 4.0), site(2.9, 0.0, 4.0)], &[1, 2]),
            // Both move, so that the first is nearer to the second's old place than to its own.
            (&[site(1.6, 0.0, 4.0), site(3.1, 0.0, 4.0)], &[1, 2]),
        ]);
        let [left, middle, right] = [-5.0, 0.0, 5.0].map(|x_m| site(x_m, 0.0, 5.0));
        check(&[
            (&[left, middle], &[1, 2]),
            (&[right, middle], &[3, 2]),
            (&[middle, left, right], &[2, 1, 3]),
        ]);
    }

    #[test]
    fn a_long_bank_is_known_again_by_either_end() {
        check(&[
            (&[site(0.0, 0.0, 20.0)], &[1]),
            // The end that leaves the window last is not the one that enters it first.
            (&[site(9.0, 0.0, 2.0)], &[1]),
            (&[], &[]),
            (&[site(-9.0, 0.0, 2.0)], &[1]),
        ]);
    }

    #[test]
    fn numbers_survive_a_merge() {
        let (left, right) = (site(-4.0, 0.0, 6.0), site(4.0, 0.0, 6.0));
        let both = site(0.5, 0.0, 15.0);
        check(&[
            (&[left, right], &[1, 2]),
            (&[both], &[2]),
            (&[left, right], &[1, 2]),
        ]);
        // A part of the merged bank keeps its number: its left half alone is where 1 was.
        check(&[
            (&[left, right], &[1, 2]),
            (&[both], &[2]),
            (&[left], &[2]),
            (&[both], &[2]),
            (&[right], &[2]),
            (&[both], &[2]),
            (&[left], &[2]),
            (&[both], &[2]),
            (&[left, right], &[1, 2]),
            (&[right], &[2]),
            (&[left], &[1]),
            (&[right], &[2]),
        ]);
    }

    #[test]
    fn least_recent_place_is_forgotten_first() {
        let mut tracker = DockingSiteTracker::default();
        let (first, second) = (site(0.0, 0.0, 4.0), site(0.0, 50.0, 4.0));
        assert_eq!(next(&mut tracker, &[first, second]), [1, 2]);
        for at in 0..MAX_PLACES - 1 {
            let far = site(10.0 + at as f64 * 10.0, 0.0, 4.0);
            next(&mut tracker, &[far, second]);
            assert!(tracker.places.len() <= MAX_PLACES);
        }
        // A number that was never used.
        let new = MAX_PLACES as u32 + 2;
        assert_eq!(next(&mut tracker, &[second, first]), [2, new]);
    }

    #[test]
    fn numbers_are_unique_for_any_input() {
        let mut tracker = DockingSiteTracker::default();
        let odd = [
            site(0.0, 0.0, 0.0),
            site(0.0, 0.0, -1.0),
            site(0.0, 0.0, f64::MAX),
            site(f64::MAX, f64::MIN, f64::MAX),
            site(f64::NAN, 0.0, f64::INFINITY),
        ];
        for _ in 0..3 {
            let found = next(&mut tracker, &odd);
            for (at, number) in found.iter().enumerate() {
                assert!(!found[..at].contains(number), "{found:?}");
            }
        }
        assert!(tracker.places.len() <= 3 * odd.len());
    }
}
