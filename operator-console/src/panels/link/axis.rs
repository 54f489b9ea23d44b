//! What stands on the axis of a plot: round numbers, two of them at least.

use egui_plot::GridMark;

/// What an axis may end at, times a power of ten: halves of these are short numbers.
const ENDS: [f64; 8] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0];
/// Numbers that stand closer together become pale in the plotting library, points.
const APART: f64 = 32.0;

/// An axis from 0 to a round number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Axis {
    /// Where it ends.
    pub(super) end: f64,
    /// From one number to the next.
    step: f64,
}

impl Axis {
    /// An axis that reaches `highest`, which is above 0, on a plot so many points high: its numbers are 0 and its end, and its
    /// middle where there is room.
    pub(super) fn new(highest: f64, height: f64) -> Self {
        let power = libm::pow(10.0, libm::floor(libm::log10(highest)));
        let ends = ENDS.map(|end| end * power);
        let end = ends.into_iter().find(|end| *end >= highest);
        let end = end.unwrap_or(highest);
        let has_middle = 0.5 * height > APART;
        let step = if has_middle { 0.5 * end } else { end };
        Self { end, step }
    }

    /// Its numbers, from 0 on.
    pub(super) fn marks(self) -> Vec<GridMark> {
        let count = libm::round(self.end / self.step) as u32;
        let mark = |number| GridMark {
            value: f64::from(number) * self.step,
            step_size: self.step,
        };
        (0..=count).map(mark).collect()
    }
}

/// A number of the axis, no longer than it must be.
pub(super) fn label(mark: GridMark) -> String {
    // Sums of halves of powers of ten that are short, but not in binary.
    let rounded = libm::round(mark.value * 1e6) / 1e6;
    rounded.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(highest: f64, height: f64) -> Vec<String> {
        let marks = Axis::new(highest, height).marks();
        marks.into_iter().map(label).collect()
    }

    #[test]
    fn an_axis_has_two_numbers_at_least_and_reaches_the_highest_value() {
        assert_eq!(labels(50.0, 48.0), ["0", "50"]);
        assert_eq!(labels(50.0, 90.0), ["0", "25", "50"]);
        assert_eq!(labels(81.0, 90.0), ["0", "50", "100"]);
        assert_eq!(labels(2.0, 90.0), ["0", "1", "2"]);
        assert_eq!(labels(0.03, 90.0), ["0", "0.015", "0.03"]);
        // The next round number, so that a line has most of the height.
        for (highest, end) in [
            (1.5, 2.0),
            (2.1, 3.0),
            (3.1, 4.0),
            (41.0, 50.0),
            (51.0, 60.0),
            (0.61, 0.8),
            (81.0, 100.0),
        ] {
            let reached = Axis::new(highest, 90.0).end;
            assert!((reached - end).abs() < 1e-9, "{highest}: {reached}");
        }
        // Numbers stand farther apart than what would make them pale.
        assert_eq!(labels(50.0, 2.0 * APART), ["0", "50"]);
        for highest in [0.1, 9.99, 10.0, 19.9, 21.0, 77.7, 4_321.0, 1e7] {
            for height in [40.0, 62.0, 200.0] {
                let axis = Axis::new(highest, height);
                assert!(axis.end >= highest && axis.end <= 2.0 * highest, "{axis:?}");
                let marks = axis.marks();
                assert!(marks.len() >= 2, "{axis:?}");
                let apart = axis.step / axis.end * height;
                assert!(apart > APART, "{axis:?}: {apart}");
            }
        }
    }
}
