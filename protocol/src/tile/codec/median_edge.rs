//! Cell codes ⇄ prediction residuals.
//!
//! The median-edge predictor of LOCO-I (Weinberger, Seroussi & Sapiro 2000, §III-A) over known cells. An
//! unknown cell is the symbol 0 and is given its own prediction for a value, so that a hole neither
//! resets nor bends the predictions around it. A known cell is `1 + zigzag(code − prediction)`, the
//! difference taken modulo 65535 (the number of known codes): every code has exactly one symbol, and a
//! small difference of either sign is a small symbol.

use crate::layer::UNKNOWN;
use crate::tile::TILE_SIDE;

/// The prediction for the first cell: height 0, the middle of the codes.
const FIRST: u16 = 32768;
/// Known codes, and so residuals: 1 … 65535.
const KNOWN_CODES: i32 = 65535;

/// Replaces whole rows of codes by symbols.
pub(super) fn to_symbols(codes: &[u16], symbols: &mut [u16]) {
    walk(codes, symbols, |code, prediction| {
        if code == UNKNOWN {
            (UNKNOWN, prediction)
        } else {
            (1 + zigzag(code, prediction), code)
        }
    });
}

/// Replaces whole rows of symbols by codes; every symbol is some code.
pub(super) fn from_symbols(symbols: &[u16], codes: &mut [u16]) {
    walk(symbols, codes, |symbol, prediction| match symbol {
        0 => (UNKNOWN, prediction),
        known => {
            let code = unzigzag(known - 1, prediction);
            (code, code)
        }
    });
}

/// Feeds every cell of `from` and its prediction to `step`, which answers the output and the value that
/// later predictions shall take for the cell.
fn walk(from: &[u16], into: &mut [u16], mut step: impl FnMut(u16, u16) -> (u16, u16)) {
    let mut above = [FIRST; TILE_SIDE];
    let mut first_row = true;
    let rows = from
        .chunks_exact(TILE_SIDE)
        .zip(into.chunks_exact_mut(TILE_SIDE));
    for (from, into) in rows {
        let mut left = above[0];
        let mut above_left = above[0];
        for ((&input, output), above) in from.iter().zip(into).zip(&mut above) {
            let prediction = if first_row {
                left
            } else {
                median_edge(left, *above, above_left)
            };
            above_left = *above;
            (*output, left) = step(input, prediction);
            *above = left;
        }
        first_row = false;
    }
}

/// The median of `left`, `above` and `left + above − above_left`.
fn median_edge(left: u16, above: u16, above_left: u16) -> u16 {
    let (low, high) = (left.min(above), left.max(above));
    let gradient = i32::from(left) + i32::from(above) - i32::from(above_left);
    gradient.clamp(i32::from(low), i32::from(high)) as u16
}

fn zigzag(code: u16, prediction: u16) -> u16 {
    let half = KNOWN_CODES / 2;
    let mut residual = i32::from(code) - i32::from(prediction);
    if residual > half {
        residual -= KNOWN_CODES;
    } else if residual < -half {
        residual += KNOWN_CODES;
    }
    ((residual << 1) ^ (residual >> 31)) as u16
}

fn unzigzag(zigzag: u16, prediction: u16) -> u16 {
    let residual = i32::from(zigzag >> 1) ^ -i32::from(zigzag & 1);
    let code = i32::from(prediction) + residual;
    (if code < 1 {
        code + KNOWN_CODES
    } else if code > KNOWN_CODES {
        code - KNOWN_CODES
    } else {
        code
    }) as u16
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn predictor_follows_edges_and_planes() {
        assert_eq!(median_edge(10, 20, 5), 20, "rising edge");
        assert_eq!(median_edge(10, 20, 30), 10, "falling edge");
        assert_eq!(median_edge(10, 20, 12), 18, "plane");
        assert_eq!(median_edge(65535, 65535, 1), 65535);
    }

    #[test]
    fn a_plane_with_a_hole_costs_nothing_after_its_edges() {
        let codes: Vec<u16> = (0..64 * 64)
            .map(|i| {
                let (x, y) = (i % 64, i / 64);
                let hole = (20..40).contains(&x) && (20..40).contains(&y);
                if hole { UNKNOWN } else { 30000 + 3 * x - 7 * y }
            })
            .collect();
        let mut symbols = vec![0; codes.len()];
        to_symbols(&codes, &mut symbols);
        for y in 1..64 {
            for x in 1..64 {
                assert!(
                    symbols[64 * y + x] <= 1,
                    "({x}, {y}): {}",
                    symbols[64 * y + x]
                );
            }
        }
    }

    #[test]
    fn every_symbol_is_a_code_and_back() {
        for prediction in [1, 2, 32768, 65534, 65535] {
            for zig in (0..65535).step_by(7).chain([65533, 65534]) {
                let code = unzigzag(zig, prediction);
                assert_ne!(code, UNKNOWN);
                assert_eq!(zigzag(code, prediction), zig, "{prediction} {zig}");
            }
        }
    }

    proptest! {
        #[test]
        fn any_rows_survive(codes in prop::collection::vec(any::<u16>(), 64 * 5)) {
            let mut symbols = vec![0; codes.len()];
            let mut back = vec![0; codes.len()];
            to_symbols(&codes, &mut symbols);
            from_symbols(&symbols, &mut back);
            prop_assert_eq!(codes, back);
        }
    }
}
