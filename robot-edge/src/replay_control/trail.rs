//! The way of the vehicle up to where a replay is: poses on the network are twenty a second, and a recording that is
//! wound passes hours in that time.

/// The trail is this fine at first.
const STEP_M: f64 = 0.1;
/// Points that are kept; of more, every second goes, again and again.
const MAX_POINTS: usize = 20_000;

/// Where the vehicle was.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ReplayTrail {
    points_m: Vec<[f64; 2]>,
    step_m: f64,
    /// Changes with every point.
    version: u64,
}

impl Default for ReplayTrail {
    fn default() -> Self {
        Self {
            points_m: Vec::new(),
            step_m: STEP_M,
            version: 0,
        }
    }
}

impl ReplayTrail {
    /// The vehicle was here.
    pub(super) fn add_point(&mut self, point_m: [f64; 2]) {
        let is_far = self.points_m.last().is_none_or(|last| {
            let [dx, dy] = [point_m[0] - last[0], point_m[1] - last[1]];
            dx * dx + dy * dy >= self.step_m * self.step_m
        });
        if !is_far {
            return;
        }
        self.points_m.push(point_m);
        self.version += 1;
        if self.points_m.len() > MAX_POINTS {
            let mut index = 0;
            self.points_m.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.step_m *= 2.0;
        }
    }

    /// The data begins anew.
    pub(super) fn restart(&mut self) {
        self.points_m.clear();
        self.step_m = STEP_M;
        self.version += 1;
    }

    /// The data goes on where `then` was taken.
    pub(super) fn restore(&mut self, then: &Self) {
        let version = self.version + 1;
        self.clone_from(then);
        self.version = version;
    }

    /// The points, oldest first, and their version, if that is another than `known`.
    pub(super) fn newer_than(&self, known: u64) -> Option<(u64, Vec<[f64; 2]>)> {
        (self.version != known).then(|| (self.version, self.points_m.clone()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trail_is_bounded_and_known_once() {
        let mut trail = ReplayTrail::default();
        assert_eq!(trail.newer_than(0), None);
        for x in 0..3 {
            trail.add_point([0.06 * f64::from(x), 0.0]);
        }
        let (version, points_m) = trail.newer_than(0).unwrap();
        assert_eq!(points_m, [[0.0, 0.0], [0.12, 0.0]]);
        assert_eq!(trail.newer_than(version), None);
        for x in 1..100_000 {
            trail.add_point([f64::from(x), 0.0]);
            assert!(trail.points_m.len() <= MAX_POINTS);
        }
        assert_eq!(trail.points_m.first(), Some(&[0.0, 0.0]));
        let then = trail.clone();
        trail.restart();
        trail.restore(&then);
        let (newer, points_m) = trail.newer_than(then.version).unwrap();
        assert_eq!(Some((then.version, points_m)), then.newer_than(0));
        trail.restart();
        assert!(trail.newer_than(newer).is_some());
        let (_, points_m) = trail.newer_than(version).unwrap();
        assert_eq!(points_m, [[0.0; 2]; 0]);
    }
}
