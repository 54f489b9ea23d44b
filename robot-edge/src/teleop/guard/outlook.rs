//! How fast the vehicle may move on one heading, given what is around it.

use super::clearance::Margins;
use super::config::{GuardRules, OnBlind};
use super::heading::Heading;
use super::surroundings::Surroundings;

/// Share of the margin at the sides that is left where the vehicle creeps.
const CREEPING_SIDE: f64 = 1.0 / 3.0;

/// What is around, and the rules.
#[derive(Clone, Copy, Debug)]
pub(super) struct Outlook<'a> {
    pub(super) rules: &'a GuardRules,
    pub(super) around: &'a Surroundings,
    /// No sensor tells what is around now.
    pub(super) is_stale: bool,
}

/// What is allowed on one heading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Allowed {
    /// Metres of travel per second.
    pub(super) speed_mps: f64,
    /// It would be more if the ground had been seen.
    pub(super) is_blind: bool,
}

/// What bounds the speed on one heading, metres of travel per second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bounds {
    creep_mps: f64,
    /// By what is known to stand there.
    clear_mps: f64,
    /// By ground that no beam with an echo has seen.
    by_echo_mps: f64,
    /// By ground that nobody has seen.
    seen_mps: f64,
    /// On ground that only misses call free.
    open_mps: f64,
    /// On ground that nobody has seen.
    blind_mps: f64,
    /// Share of the margins at the sides with which `clear_mps` is what it is.
    pub(super) side_share: f64,
}

impl Bounds {
    fn allowed(self) -> Allowed {
        Allowed {
            speed_mps: self.clear_mps.min(self.on_ground_mps()),
            is_blind: self.on_seen_ground_mps() < self.creep_mps
                && self.on_seen_ground_mps() < self.clear_mps,
        }
    }

    /// Whether ground that nobody has seen bounds it, rather than ground that no beam with an echo has seen.
    pub(super) fn is_by_unseen(self) -> bool {
        self.seen_mps < self.open_mps && self.seen_mps >= self.by_echo_mps
    }

    /// Whether what stands there bounds it, rather than ground that nobody has seen.
    pub(super) fn is_by_things(self) -> bool {
        self.clear_mps <= self.on_ground_mps()
    }

    fn on_ground_mps(self) -> f64 {
        self.on_seen_ground_mps().max(self.blind_mps)
    }

    fn on_seen_ground_mps(self) -> f64 {
        self.by_echo_mps.max(self.seen_mps.min(self.open_mps))
    }
}

impl Outlook<'_> {
    /// The greatest speed of travel on a heading from which the vehicle stops before what is known to stand there, and
    /// before ground that nobody has seen, unless it creeps.
    pub(super) fn allowed(&self, heading: Heading) -> Allowed {
        self.bounds(heading).allowed()
    }

    pub(super) fn bounds(&self, heading: Heading) -> Bounds {
        let travel_mps = heading.along.abs() + heading.swing;
        let creep_mps = self.rules.creep_mps / travel_mps;
        let mut side_share = 1.0;
        let mut clear_mps = self.speed_mps(heading, self.clear_m(heading, side_share));
        if clear_mps < creep_mps {
            // Beside a wall, too near for anything but to creep along it.
            let beside_mps = self.speed_mps(heading, self.clear_m(heading, CREEPING_SIDE));
            if beside_mps > clear_mps && beside_mps < creep_mps {
                side_share = CREEPING_SIDE;
            }
            clear_mps = clear_mps.max(beside_mps.min(creep_mps));
        }
        let by_echo_mps = self.speed_on_mps(heading, &self.around.not_seen_by_echo);
        let seen_mps = self.speed_on_mps(heading, &self.around.unseen);
        let blind_mps = match self.rules.on_blind {
            OnBlind::Creep => creep_mps,
            OnBlind::Stop => 0.0,
        };
        Bounds {
            creep_mps,
            clear_mps,
            by_echo_mps,
            seen_mps,
            open_mps: self.rules.open_mps / travel_mps,
            blind_mps,
            side_share,
        }
    }

    fn speed_mps(&self, heading: Heading, travel_m: f64) -> f64 {
        heading.speed_for_mps(travel_m, &self.rules.braking)
    }

    /// Travel until the vehicle touches what is known, with a share of the margin at its sides.
    fn clear_m(&self, heading: Heading, side_share: f64) -> f64 {
        let [hits, mapped] = self.clear_margins(side_share);
        let to_hit_m = self.free_m(hits, heading, &self.around.hits);
        to_hit_m.min(self.free_m(mapped, heading, &self.around.mapped))
    }

    /// Margins of what beams hit, and of what is mapped.
    pub(super) fn clear_margins(&self, side_share: f64) -> [Margins; 2] {
        let Margins { ahead_m, side_m } = self.rules.margins;
        let half_cell_m = 0.5 * self.around.mapped_cell_m;
        let hits = Margins {
            ahead_m,
            side_m: side_share * side_m,
        };
        // What is mapped lies anywhere in its cell.
        let mapped = Margins {
            ahead_m: ahead_m.max(half_cell_m),
            side_m: side_share * side_m.max(half_cell_m),
        };
        [hits, mapped]
    }

    /// The speed from which the vehicle stops before ground that begins at these points.
    fn speed_on_mps(&self, heading: Heading, points: &[[f64; 2]]) -> f64 {
        if self.is_stale {
            return 0.0;
        }
        self.speed_mps(heading, self.free_m(self.unseen_margins(), heading, points))
    }

    pub(super) fn unseen_margins(&self) -> Margins {
        Margins {
            // Half a cell that the body reaches into counts as seen, and another lies before the centre of the next one.
            ahead_m: 1.5 * self.around.unseen_cell_m,
            side_m: 0.0,
        }
    }

    pub(super) fn free_m(&self, margins: Margins, heading: Heading, points: &[[f64; 2]]) -> f64 {
        self.rules.footprint.free_travel_m(margins, heading, points)
    }
}
