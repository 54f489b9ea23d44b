//! Letters for docking sites, which stay with their places. Pure: lists in, names out.
//!
//! The robot tells of docking sites as a list, the best first, and the ranks change while it learns. Who points at a
//! site, or marks it, means a place: so each site gets a letter (A, B … Z, AA, AB …, without I and O) when it is first heard of, and
//! what is where a site was known is that site.
//!
//! **The rule.** A site and a place can be one where their middles are no farther apart than half of the greater of both
//! widths. Sites do not touch, so the middles of two that lie side by side are at least half of both widths apart: a
//! neighbour is never taken for the site itself. And one that has grown or shrunk between two lists, by whatever share,
//! still has its middle there. Where more than one can be, the two that are nearest to *each other* are one: if each site
//! took what is nearest to it, the better of two would take the letter of its neighbour. Near is where the ends have moved
//! little: the way of the middle, and half of the change in width. By middles alone, a bank that grows until its middle lies
//! where a small site once was would take that site's letter. Headings are not asked: they turn while a bank is still being
//! seen.
//!
//! Two sites that grow into one leave a place behind that is inside another. It is a site of its own again where both are
//! told of, and not where one of them is cut off by the window's edge: what was told of last time goes before what was not.
//!
//! A place is remembered as it was seen last and as it was widest. The robot tells only of what is in its window, and
//! of a bank that enters it first one end, perhaps not the one that was seen last.

use std::cmp::Reverse;
use std::fmt;

use protocol::message::DockingSite;

/// Places that are remembered. Beyond it those that were not seen for the longest go; a message holds
/// [`MAX_SITES`](protocol::shores::MAX_SITES), which is fewer.
const MAX_PLACES: usize = 256;
/// Without I and O, which look like figures: those are the names of shores.
const LETTERS: &[u8] = b"ABCDEFGHJKLMNPQRSTUVWXYZ";

/// What a docking site is called: the same for the same place, in one run of a robot and of this console.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SiteName {
    /// How often the names had begun anew: an A of other maps is another site.
    beginning: u32,
    /// From 0, in the order in which sites were first heard of.
    index: u64,
}

impl SiteName {
    /// How many letters it has.
    pub const fn letters(self) -> u32 {
        let mut letters = 1;
        let mut rest = self.index / LETTERS.len() as u64;
        while rest > 0 {
            letters += 1;
            rest = (rest - 1) / LETTERS.len() as u64;
        }
        letters
    }
}

impl fmt::Display for SiteName {
    /// A to Z without I and O, then AA, AB … ZZ, then AAA: as spreadsheets count columns.
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

/// The places that have names.
#[derive(Clone, Debug, Default)]
pub struct SiteNames {
    places: Vec<Place>,
    beginning: u32,
    /// Sites that were given names since.
    named: u64,
    /// Lists that were taken.
    lists: u64,
}

impl SiteNames {
    /// The names of the sites of a new list, in its order.
    pub fn name(&mut self, sites: &[DockingSite]) -> Vec<SiteName> {
        self.lists += 1;
        let known = self.known(sites);
        let names: Vec<_> = sites
            .iter()
            .zip(known)
            .map(|(site, known)| {
                let seen = Extent::of(site);
                if let Some(place) = known.and_then(|at| self.places.get_mut(at)) {
                    place.see(seen, self.lists);
                    return place.name;
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
                name
            })
            .collect();
        if self.places.len() > MAX_PLACES {
            self.places.sort_by_key(|place| Reverse(place.seen_in));
            self.places.truncate(MAX_PLACES);
        }
        names
    }

    /// The maps began anew, and with them the letters. No name of before equals one from now on.
    pub fn restart(&mut self) {
        *self = Self {
            beginning: self.beginning.wrapping_add(1),
            ..Self::default()
        };
    }

    /// Which place each site is.
    fn known(&self, sites: &[DockingSite]) -> Vec<Option<usize>> {
        let mut pairs = Vec::new();
        for (rank, site) in sites.iter().enumerate() {
            let seen = Extent::of(site);
            let near = self.places.iter().enumerate();
            pairs.extend(near.filter_map(|(at, place)| Some((place.moved_m(seen)?, rank, at))));
        }
        pairs.sort_by(|(one_m, ..), (other_m, ..)| one_m.total_cmp(other_m));
        // The nearest pair of those left over is one of which each is nearest to the other.
        let mut known = vec![None; sites.len()];
        let mut is_taken = vec![false; self.places.len()];
        for (_, rank, at) in &pairs {
            if known[*rank].is_none() && !is_taken[*at] {
                known[*rank] = Some(*at);
                is_taken[*at] = true;
            }
        }
        // What was not told of last time gives way to what was and would be without a site.
        let was_told = |at: usize| self.places[at].seen_in + 1 == self.lists;
        for (_, rank, at) in pairs {
            if let Some(other) = known[rank].filter(|other| !was_told(*other))
                && was_told(at)
                && !is_taken[at]
                // As it was seen last, and not only as it was once.
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

/// Where a site with a name was.
#[derive(Clone, Copy, Debug)]
struct Place {
    name: SiteName,
    last: Extent,
    widest: Extent,
    /// The number of the list that told of it last.
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

    /// How far its ends have moved if a site is this place; `None` where it cannot be.
    fn moved_m(&self, seen: Extent) -> Option<f64> {
        let moved = [self.last, self.widest].map(|known| known.moved_m(seen));
        moved.into_iter().flatten().min_by(f64::total_cmp)
    }
}

/// How a site lies, metres in `odom`.
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

    /// From one to the other, if they can be of the same site.
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
mod tests;
