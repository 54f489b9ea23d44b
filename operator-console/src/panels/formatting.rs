//! Text for numbers and times.

use std::time::Duration;

/// Duration with a resolution that decreases with its length.
pub fn age(time: Duration) -> String {
    let secs = time.as_secs();
    match secs {
        0..10 => format!("{:.1} s", time.as_millis() as f64 / 1e3),
        10..120 => format!("{secs} s"),
        120..7200 => format!("{} min", secs / 60),
        7200.. => format!("{} h", secs / 3600),
    }
}

/// Number with a true minus sign; zero has no sign.
pub fn signed(number: f64, decimals: usize) -> String {
    let digits = format!("{:.decimals$}", number.abs());
    let is_zero = digits.bytes().all(|byte| matches!(byte, b'0' | b'.'));
    if number < 0.0 && !is_zero {
        format!("−{digits}")
    } else {
        digits
    }
}

/// Turn rate in degrees with its direction; `radps` > 0 is left.
pub fn turn(radps: f64) -> String {
    let deg = radps.to_degrees().round();
    let speed = signed(deg.abs(), 0);
    if deg > 0.0 {
        format!("{speed} °/s left")
    } else if deg < 0.0 {
        format!("{speed} °/s right")
    } else {
        format!("{speed} °/s")
    }
}

/// Three-digit compass direction, degrees clockwise from north.
pub fn bearing(deg: f64) -> String {
    // 359.7° and −0.3° are both 000°.
    let whole = deg.round().rem_euclid(360.0).abs();
    format!("{whole:03.0}°")
}

/// Direction of `angle_deg`, degrees counter-clockwise from x of `odom`. If north is unknown, it is relative to `x`,
/// which is the name of that axis.
pub fn direction(angle_deg: f64, knows_north: bool, x: &str) -> String {
    if knows_north {
        return bearing(90.0 - angle_deg);
    }
    // From −180° to 180°.
    let left_deg = 180.0 - (180.0 - angle_deg).rem_euclid(360.0);
    match left_deg.round() as i64 {
        0 => format!("along {x}"),
        -180 | 180 => format!("against {x}"),
        left @ 1.. => format!("{left}° left of {x}"),
        right @ ..0 => format!("{}° right of {x}", right.unsigned_abs()),
    }
}

/// The one space at which egui does not break lines (it breaks at U+202F).
const GROUPS_APART: char = '\u{a0}';

/// Count in groups of three digits.
pub fn count(number: u64) -> String {
    let digits = number.to_string();
    let mut grouped = String::with_capacity(digits.len() * 4 / 3);
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            grouped.push(GROUPS_APART);
        }
        grouped.push(digit);
    }
    grouped
}

/// Size in the decimal unit that suits it.
pub fn bytes(bytes: u64) -> String {
    let size = bytes as f64;
    match bytes {
        0..1000 => format!("{bytes} B"),
        1000..1_000_000 => format!("{:.0} kB", size / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", size / 1e6),
        1_000_000_000.. => format!("{:.1} GB", size / 1e9),
    }
}

/// First letter as capital.
pub fn capitalised(text: &str) -> String {
    let mut chars = text.chars();
    match chars.next() {
        Some(first) => first.to_uppercase().chain(chars).collect(),
        None => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use eframe::egui::{Color32, FontId};
    use egui_kittest::Harness;

    use super::*;

    #[test]
    fn resolution_of_ages() {
        let check = |ms, expected: &str| assert_eq!(age(Duration::from_millis(ms)), expected);
        check(0, "0.0 s");
        check(9_960, "10.0 s");
        check(12_700, "12 s");
        check(119_999, "119 s");
        check(120_000, "2 min");
        check(7_199_000, "119 min");
        check(90_000_000, "25 h");
    }

    #[test]
    fn directions_are_bearings_if_north_is_known() {
        for (angle_deg, on_earth, on_map) in [
            (0.0, "090°", "along x"),
            (-0.4, "090°", "along x"),
            (13.2, "077°", "13° left of x"),
            (-13.2, "103°", "13° right of x"),
            (179.9, "270°", "against x"),
            (-179.9, "270°", "against x"),
            (-270.0, "000°", "90° left of x"),
            (190.0, "260°", "170° right of x"),
            (359.8, "090°", "along x"),
        ] {
            assert_eq!(direction(angle_deg, true, "x"), on_earth);
            assert_eq!(direction(angle_deg, false, "x"), on_map, "{angle_deg}");
        }
    }

    #[test]
    fn number_texts() {
        assert_eq!(signed(-0.004, 2), "0.00");
        assert_eq!(signed(-12.345, 2), "−12.35");
        assert_eq!(signed(7.0, 1), "7.0");
        assert_eq!(turn(0.21), "12 °/s left");
        assert_eq!(turn(-0.21), "12 °/s right");
        assert_eq!(turn(-0.008), "0 °/s");
        assert_eq!(turn(f64::NAN), "NaN °/s");
        assert_eq!(bytes(999), "999 B");
        assert_eq!(bytes(4_100), "4 kB");
        assert_eq!(bytes(4_149_999), "4.1 MB");
        assert_eq!(bytes(52_000_000_000), "52.0 GB");
        assert_eq!(count(999), "999");
        assert_eq!(count(1_234_567), "1\u{a0}234\u{a0}567");
    }

    #[test]
    fn no_line_break_within_a_number() {
        let words = format!("revision {}", count(12_308));
        let window = Harness::builder().build_ui_state(
            move |ui, lines: &mut Vec<String>| {
                let layout = |words: &str, width| {
                    let font = FontId::proportional(12.0);
                    let painter = ui.painter();
                    painter.layout(words.to_owned(), font, Color32::BLACK, width)
                };
                let width = layout("revision 12 3", f32::INFINITY).size().x;
                let text = layout(&words, width);
                let rows = text.rows.iter();
                *lines = rows.map(|row| row.text().trim_end().to_owned()).collect();
            },
            Vec::new(),
        );
        assert_eq!(*window.state(), ["revision", "12\u{a0}308"]);
    }
}
