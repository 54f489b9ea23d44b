//! The legend column: title, colour scale with numbers, swatches with names.

use super::canvas::{Canvas, Rect};
use super::map::over_background;
use super::text::TextRenderer;
use super::{FAINT_TEXT_COLOR, LINE_HEIGHT, TEXT_COLOR, TEXT_PX};
use crate::layer::{Legend, Ramp};

const TITLE_WIDTH_MAX: u32 = 190;
const RAMP_WIDTH: u32 = 22;
const RAMP_HEIGHT: u32 = 240;
const TICK_LENGTH: u32 = 6;
const SWATCH_SIDE: u32 = 20;
const SWATCH_PITCH: u32 = 30;
const GAP: u32 = 12;

/// Width and height that [`draw`] needs.
pub(super) fn size(text_renderer: &TextRenderer, legend: &Legend) -> (u32, u32) {
    let title = text_renderer.wrap(&legend.title, TEXT_PX, TITLE_WIDTH_MAX);
    let widths =
        title
            .iter()
            .map(|line| text_renderer.width(line, TEXT_PX))
            .chain(
                legend
                    .swatches
                    .iter()
                    .map(|swatch| SWATCH_SIDE + GAP + text_renderer.width(&swatch.label, TEXT_PX)),
            )
            .chain(legend.ramp.iter().flat_map(|ramp| &ramp.ticks).map(|tick| {
                RAMP_WIDTH + TICK_LENGTH + 6 + text_renderer.width(&tick.label, TEXT_PX)
            }));
    let ramp_height = if legend.ramp.is_some() {
        RAMP_HEIGHT + LINE_HEIGHT + GAP
    } else {
        0
    };
    let height = title.len() as u32 * LINE_HEIGHT
        + GAP
        + ramp_height
        + legend.swatches.len() as u32 * SWATCH_PITCH;
    (widths.max().unwrap_or(0), height)
}

/// Draws the legend with its upper left corner at `at`.
pub(super) fn draw(
    canvas: &mut Canvas,
    text_renderer: &TextRenderer,
    at: (u32, u32),
    legend: &Legend,
) {
    let (x, mut y) = at;
    for line in text_renderer.wrap(&legend.title, TEXT_PX, TITLE_WIDTH_MAX) {
        text_renderer.draw(canvas, (x, y), TEXT_PX, TEXT_COLOR, &line);
        y += LINE_HEIGHT;
    }
    y += GAP;
    if let Some(ramp) = &legend.ramp {
        // Half a line above and below, where the labels of the ends stick out.
        y += LINE_HEIGHT / 2;
        draw_ramp(canvas, text_renderer, (x, y), ramp);
        y += RAMP_HEIGHT + LINE_HEIGHT / 2 + GAP;
    }
    for swatch in &legend.swatches {
        let square = Rect {
            x,
            y,
            width: SWATCH_SIDE,
            height: SWATCH_SIDE,
        };
        canvas.fill(square, FAINT_TEXT_COLOR);
        canvas.fill_with(square.inside(), |x, y| {
            let [x, y] = [x - square.x, y - square.y].map(|pixel| pixel as usize);
            over_background(swatch.color_at(x, y))
        });
        let label_x = square.right() + GAP;
        text_renderer.draw(canvas, (label_x, y), TEXT_PX, TEXT_COLOR, &swatch.label);
        y += SWATCH_PITCH;
    }
}

fn draw_ramp(canvas: &mut Canvas, text_renderer: &TextRenderer, at: (u32, u32), ramp: &Ramp) {
    let (x, y) = at;
    let bar = Rect {
        x,
        y,
        width: RAMP_WIDTH,
        height: RAMP_HEIGHT,
    };
    canvas.fill_framed(bar, FAINT_TEXT_COLOR, FAINT_TEXT_COLOR);
    let span = ramp.high - ramp.low;
    for row in 1..RAMP_HEIGHT - 1 {
        let part = 1.0 - (row as f32 - 0.5) / (RAMP_HEIGHT - 2) as f32;
        let [red, green, blue, _] = ramp.color(ramp.low + span * part);
        let line = Rect {
            x: x + 1,
            y: y + row,
            width: RAMP_WIDTH - 2,
            height: 1,
        };
        canvas.fill(line, [red, green, blue]);
    }
    for tick in &ramp.ticks {
        let part = (tick.value - ramp.low) / span;
        let tick_y = y + ((1.0 - part) * (RAMP_HEIGHT - 1) as f32).round() as u32;
        let mark = Rect {
            x: bar.right(),
            y: tick_y,
            width: TICK_LENGTH,
            height: 1,
        };
        canvas.fill(mark, FAINT_TEXT_COLOR);
        let label = (mark.right() + 6, tick_y.saturating_sub(LINE_HEIGHT / 2 - 2));
        text_renderer.draw(canvas, label, TEXT_PX, TEXT_COLOR, &tick.label);
    }
}
