//! A bar of a round length in metres.

use super::canvas::{Canvas, Rect};
use super::text::TextRenderer;
use super::{TEXT_COLOR, TEXT_PX};

/// Height that [`draw`] needs.
pub(super) const HEIGHT: u32 = 44;
const BAR_PX_MAX: f64 = 240.0;
const BAR_PX_MIN: f64 = 10.0;
const BAR_TOP: u32 = 16;
const BAR_HEIGHT: u32 = 9;

/// Draws the bar, `wanted_m` long where that can be drawn, with its label to the right; `at` is the upper left corner of its space.
pub(super) fn draw(
    canvas: &mut Canvas,
    text_renderer: &TextRenderer,
    at: (u32, u32),
    pixels_per_m: f64,
    wanted_m: Option<f64>,
    width_max: u32,
) {
    let fits_m = BAR_PX_MAX.min(f64::from(width_max) * 0.5) / pixels_per_m;
    let can_be_seen = |length_m: &f64| length_m * pixels_per_m >= BAR_PX_MIN;
    let length_m = wanted_m
        .map(|length_m| length_m.min(fits_m))
        .filter(can_be_seen)
        .unwrap_or_else(|| round_length_m(fits_m));
    let (x, y) = (at.0, at.1 + BAR_TOP);
    let width = (length_m * pixels_per_m).round().max(1.0) as u32;
    let bar = Rect {
        x,
        y,
        width,
        height: BAR_HEIGHT,
    };
    canvas.fill_framed(bar, TEXT_COLOR, TEXT_COLOR);
    // The second half white, so that the bar is also a ruler for half its length.
    let half = Rect {
        x: x + width / 2,
        y: y + 1,
        width: (width - width / 2).saturating_sub(1),
        height: BAR_HEIGHT - 2,
    };
    canvas.fill(half, [255; 3]);
    let label = (bar.right() + 10, y.saturating_sub(6));
    text_renderer.draw(canvas, label, TEXT_PX, TEXT_COLOR, &length_label(length_m));
}

/// The length of a scale bar, metres: the greatest of 1, 2 and 5 times a power of ten that is at most
/// `length_max_m`.
pub fn round_length_m(length_max_m: f64) -> f64 {
    let mut power = 1e-3;
    while power * 10.0 <= length_max_m && power < 1e9 {
        power *= 10.0;
    }
    [5.0, 2.0]
        .into_iter()
        .map(|factor| factor * power)
        .find(|&length| length <= length_max_m)
        .unwrap_or(power)
}

/// What stands at a length of so many metres.
pub fn length_label(length_m: f64) -> String {
    let rounded = |value: f64| (value * 1000.0).round() / 1000.0;
    if length_m >= 1000.0 {
        format!("{} km", rounded(length_m / 1000.0))
    } else if length_m >= 1.0 {
        format!("{} m", rounded(length_m))
    } else {
        format!("{} cm", rounded(length_m * 100.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_round_and_fit() {
        let check = |length_max_m: f64, expected: &str| {
            assert_eq!(
                length_label(round_length_m(length_max_m)),
                expected,
                "{length_max_m}"
            );
        };
        check(24.0, "20 m");
        check(9.99, "5 m");
        check(1.0, "1 m");
        check(0.57, "50 cm");
        check(0.024, "2 cm");
        check(4100.0, "2 km");
    }
}
