//! The line that a vehicle leaves behind on the map.

use std::collections::VecDeque;

/// No two points are nearer to each other.
const STEP_M: f64 = 0.1;
/// Points at most; beyond that every second one of the older half goes.
const MAX_POINTS: usize = 20_000;

/// Where the vehicle was, oldest first.
#[derive(Clone, Debug, Default)]
pub(super) struct Trail {
    /// Metres in `odom`.
    points_m: VecDeque<[f64; 2]>,
    /// Of each point, nanoseconds.
    stamps_ns: VecDeque<i64>,
}

impl Trail {
    pub(super) const fn points_m(&self) -> &VecDeque<[f64; 2]> {
        &self.points_m
    }

    /// The vehicle is here now.
    pub(super) fn add(&mut self, stamp_ns: i64, point_m: [f64; 2]) {
        if self
            .points_m
            .back()
            .is_none_or(|last| is_far(*last, point_m))
        {
            self.points_m.push_back(point_m);
            self.stamps_ns.push_back(stamp_ns);
            if self.points_m.len() > MAX_POINTS {
                self.thin();
            }
        }
    }

    /// The vehicle was there too, oldest first, up to a stamp: what is far enough from the points before and behind it is put
    /// between them. Of data whose clock began anew, that is done with the points since.
    pub(super) fn fill(&mut self, known: &[(i64, [f64; 2])], newest_ns: i64) {
        let stamps: Vec<_> = self.stamps_ns.iter().copied().collect();
        let here = since_last_fall(&stamps, |stamp_ns| *stamp_ns);
        let known = &known[since_last_fall(known, |(stamp_ns, _)| *stamp_ns)..];
        let mut all = self.stamps_ns.drain(..).zip(self.points_m.drain(..));
        let mut filled: Vec<(i64, [f64; 2])> = all.by_ref().take(here).collect();
        let before_fall = filled.len();
        let mut here = all.peekable();
        for (stamp_ns, point_m) in known.iter().copied() {
            if stamp_ns > newest_ns {
                break;
            }
            while let Some(earlier) = here.next_if(|(here_ns, _)| *here_ns <= stamp_ns) {
                filled.push(earlier);
            }
            let before = filled[before_fall..]
                .last()
                .is_none_or(|(_, before_m)| is_far(*before_m, point_m));
            let behind = here
                .peek()
                .is_none_or(|(_, behind_m)| is_far(*behind_m, point_m));
            if before && behind {
                filled.push((stamp_ns, point_m));
            }
        }
        filled.extend(here);
        (self.stamps_ns, self.points_m) = filled.into_iter().unzip();
        while self.points_m.len() > MAX_POINTS {
            self.thin();
        }
    }

    /// These points and no others.
    pub(super) fn replace(&mut self, points_m: impl IntoIterator<Item = [f64; 2]>) {
        self.points_m = points_m.into_iter().take(MAX_POINTS).collect();
        self.stamps_ns = std::iter::repeat_n(i64::MIN, self.points_m.len()).collect();
    }

    fn thin(&mut self) {
        let old = self.points_m.len() / 2;
        let is_kept = |index: usize| index >= old || index.is_multiple_of(2);
        let mut index = 0..;
        self.points_m.retain(|_| index.next().is_none_or(is_kept));
        let mut index = 0..;
        self.stamps_ns.retain(|_| index.next().is_none_or(is_kept));
    }
}

/// Where the last stretch of rising stamps begins.
fn since_last_fall<T>(points: &[T], stamp_ns: impl Fn(&T) -> i64) -> usize {
    let falls = points
        .windows(2)
        .rposition(|pair| stamp_ns(&pair[1]) < stamp_ns(&pair[0]));
    falls.map_or(0, |index| index + 1)
}

fn is_far([ax, ay]: [f64; 2], [bx, by]: [f64; 2]) -> bool {
    let (dx, dy) = (bx - ax, by - ay);
    dx * dx + dy * dy >= STEP_M * STEP_M
}

#[cfg(test)]
mod tests {
    use super::*;

    fn along_x(xs: impl IntoIterator<Item = i64>) -> impl Iterator<Item = (i64, [f64; 2])> {
        xs.into_iter().map(|x| (x, [x as f64, 0.0]))
    }

    fn of(xs: impl IntoIterator<Item = i64>) -> Trail {
        let mut trail = Trail::default();
        along_x(xs).for_each(|(stamp_ns, point_m)| trail.add(stamp_ns, point_m));
        trail
    }

    fn xs(trail: &Trail) -> Vec<i64> {
        trail.points_m.iter().map(|[x, _]| *x as i64).collect()
    }

    /// Up to 22.
    fn fill(trail: &mut Trail, known: impl IntoIterator<Item = i64>) {
        trail.fill(&along_x(known).collect::<Vec<_>>(), 22);
    }

    #[test]
    fn a_clock_that_began_anew_draws_no_line_across_the_map() {
        // The stamps are those of a clock that leapt back by 100.
        let mut trail = of([100, 101, 102]);
        for x in [3, 7] {
            trail.add(x, [100.0 + x as f64, 0.0]);
        }
        let known = [101, 102, 4, 5].map(|stamp_ns| (stamp_ns, [100.0 + stamp_ns as f64, 0.0]));
        trail.fill(&known, 7);
        assert_eq!(xs(&trail), [100, 101, 102, 103, 104, 105, 107]);
        // Those of before, told by themselves.
        trail.fill(&[(100, [90.0, 0.0]), (101, [91.0, 0.0])], 7);
        assert_eq!(trail.points_m.len(), 7);
    }

    #[test]
    fn it_has_steps_and_a_limit_and_keeps_its_ends() {
        let mut trail = of([0]);
        trail.add(1, [0.05, 0.0]);
        assert_eq!(trail.points_m.len(), 1);
        let trail = of(0..100_000);
        assert!(trail.points_m.len() <= MAX_POINTS);
        assert_eq!(trail.points_m.len(), trail.stamps_ns.len());
        assert_eq!((trail.points_m[0], trail.stamps_ns[0]), ([0.0, 0.0], 0));
        assert_eq!(trail.points_m.back(), Some(&[99_999.0, 0.0]));
    }

    #[test]
    fn gaps_are_filled_and_what_is_known_stays() {
        let mut trail = of([10, 11, 12, 20, 21]);
        fill(&mut trail, [0, 5, 10, 15, 20, 22, 30]);
        assert_eq!(xs(&trail), [0, 5, 10, 11, 12, 15, 20, 21, 22]);
        let stamps: Vec<_> = trail.stamps_ns.iter().copied().collect();
        assert_eq!(stamps, xs(&trail));
        trail.fill(&[(13, [12.05, 0.0]), (14, [14.95, 0.0])], 22);
        assert_eq!(xs(&trail).len(), 9);
        fill(&mut trail, -50_000..0);
        assert!(trail.points_m.len() <= MAX_POINTS);
        assert_eq!(trail.points_m.back(), Some(&[22.0, 0.0]));
    }

    #[test]
    fn nothing_known_is_filled_with_all() {
        let mut trail = Trail::default();
        fill(&mut trail, [0, 1, 2]);
        assert_eq!(xs(&trail), [0, 1, 2]);
        trail.replace([[7.0, 0.0]]);
        trail.add(9, [8.0, 0.0]);
        assert_eq!(xs(&trail), [7, 8]);
    }
}
