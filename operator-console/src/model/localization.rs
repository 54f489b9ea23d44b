//! How well the scans determine the pose, where the robot matches scans.

use std::collections::VecDeque;
use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::{Localization, MAX_CLOSURES};
use protocol::tile::BootId;

/// Residuals are kept for so long.
const HISTORY: Duration = Duration::from_mins(5);
/// More than a robot sends in that time.
const MAX_RESIDUALS: usize = 1024;

/// The last message of it, and those of the last minutes.
#[derive(Clone, Debug, Default)]
pub struct LocalizationHistory {
    newest: Option<(Localization, Monotonic)>,
    run: Option<BootId>,
    closures_m: Vec<[f32; 4]>,
    residuals_m: VecDeque<(Monotonic, f32)>,
}

impl LocalizationHistory {
    /// `None` where no scans are matched.
    pub fn newest(&self) -> Option<&Localization> {
        self.newest.as_ref().map(|(newest, _)| newest)
    }

    /// When the last one came.
    pub fn received_at(&self) -> Option<Monotonic> {
        self.newest.as_ref().map(|(_, at)| *at)
    }

    /// The newest closures: x and y of both ends in the map, metres.
    pub fn closures_m(&self) -> &[[f32; 4]] {
        &self.closures_m
    }

    /// When they came, and metres, oldest first.
    pub fn residuals_m(&self) -> impl Iterator<Item = &(Monotonic, f32)> {
        self.residuals_m.iter()
    }

    pub(super) fn take(&mut self, mut localization: Localization, run: BootId, now: Monotonic) {
        self.begin_run(run);
        if let Some(closures_m) = localization.closures_m.take() {
            self.closures_m = closures_m;
        }
        self.residuals_m.push_back((now, localization.residual_m));
        while self.residuals_m.len() > MAX_RESIDUALS
            || self
                .residuals_m
                .front()
                .is_some_and(|(at, _)| now.since(*at) > HISTORY)
        {
            self.residuals_m.pop_front();
        }
        self.newest = Some((localization, now));
    }

    /// Forgets what another run of the robot sent.
    pub(super) fn begin_run(&mut self, run: BootId) {
        if self.run != Some(run) {
            *self = Self {
                run: Some(run),
                ..Self::default()
            };
        }
    }
}

/// Whether a program could have sent it that works.
pub(super) fn is_valid(localization: &Localization) -> bool {
    let Localization {
        covariance_m2: [xx, _, yy],
        heading_sigma_rad,
        inliers,
        residual_m,
        closures_m,
        ..
    } = localization;
    let closures_m = closures_m.as_deref().unwrap_or_default();
    let numbers = [xx, yy, heading_sigma_rad, inliers, residual_m];
    numbers.iter().all(|number| **number >= 0.0)
        && closures_m.len() <= MAX_CLOSURES
        && closures_m.iter().flatten().all(|m| m.is_finite())
}

/// Half axes of the ellipse that holds the position with 95 %, metres, the greater first, and the angle of the greater from x;
/// `None` where a covariance is not finite.
pub fn ellipse_95([xx, xy, yy]: [f32; 3]) -> Option<([f64; 2], f64)> {
    /// √(−2 ln 0.05).
    const SCALE: f64 = 2.447_746_830_680_816;
    let [xx, xy, yy] = [xx, xy, yy].map(f64::from);
    let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
    let spread = libm::hypot(half, xy);
    let axes_m = [mean + spread, mean - spread].map(|m2| SCALE * libm::sqrt(m2.max(0.0)));
    let is_finite = axes_m.iter().all(|m| m.is_finite());
    is_finite.then(|| (axes_m, 0.5 * libm::atan2(xy, half)))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_4;

    use protocol::keys::Topic;

    use super::*;
    use crate::test_support::{BOOT, announce_boot, at, inject, localization, scout};

    #[test]
    fn closures_stay_until_others_come_and_residuals_for_five_minutes() {
        let mut model = scout();
        let closures_m = Some(vec![[1.0, 2.0, 3.0, 4.0]]);
        for (ms, closures_m) in [(1_000, closures_m), (2_000, None), (302_500, None)] {
            let message = Localization {
                closures_m,
                ..localization()
            };
            inject(&mut model, Topic::Localization, &message, at(ms));
        }
        // The head of the same run comes after it.
        announce_boot(&mut model, BOOT, at(302_600));
        let history = model.localization();
        assert_eq!(history.closures_m(), [[1.0, 2.0, 3.0, 4.0]]);
        assert_eq!(history.residuals_m().count(), 1);
        let damaged = Localization {
            residual_m: f32::NAN,
            ..localization()
        };
        inject(&mut model, Topic::Localization, &damaged, at(303_000));
        assert_eq!(model.localization().received_at(), Some(at(302_500)));
        announce_boot(&mut model, BootId([8; 16]), at(304_000));
        assert_eq!(model.localization().newest(), None);
    }

    #[test]
    fn an_ellipse_lies_along_the_greatest_variance() {
        let (axes_m, angle_rad) = ellipse_95([0.5, 0.3, 0.5]).unwrap();
        assert!(
            (axes_m[0] / 2.4477 - 0.8_f64.sqrt()).abs() < 1e-4,
            "{axes_m:?}"
        );
        assert!(
            (axes_m[1] / 2.4477 - 0.2_f64.sqrt()).abs() < 1e-4,
            "{axes_m:?}"
        );
        assert!((angle_rad - FRAC_PI_4).abs() < 1e-6);
        assert_eq!(ellipse_95([f32::INFINITY, 0.0, 0.0]), None);
    }
}
