//! Text for numbers, times, names and options of the command line.

use std::time::Duration;

use eframe::egui::text::LayoutJob;
use eframe::egui::{Color32, FontFamily, FontId, TextFormat, TextStyle, Ui};

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

/// `angle_deg`: counter-clockwise from the axis of `odom` that is called `x`, and shown so without north.
pub fn direction(angle_deg: f64, knows_north: bool, x: &str) -> String {
    if knows_north {
        return bearing(90.0 - angle_deg);
    }
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

pub fn bytes(bytes: u64) -> String {
    let size = bytes as f64;
    match bytes {
        0..1000 => format!("{bytes} B"),
        1000..1_000_000 => format!("{:.0} kB", size / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", size / 1e6),
        1_000_000_000.. => format!("{:.1} GB", size / 1e9),
    }
}

pub fn capitalised(text: &str) -> String {
    let mut chars = text.chars();
    match chars.next() {
        Some(first) => first.to_uppercase().chain(chars).collect(),
        None => String::new(),
    }
}

/// `words` with options such as `--keys` in monospace: in the proportional font, two dashes look like one.
pub fn with_monospace_options(
    ui: &Ui,
    words: &str,
    style: &TextStyle,
    color: Color32,
) -> LayoutJob {
    let font = style.resolve(ui.style());
    let code = FontId::new(font.size, FontFamily::Monospace);
    let mut job = LayoutJob::default();
    for word in words.split_inclusive(' ') {
        let font = if word.contains("--") { &code } else { &font };
        job.append(word, 0.0, TextFormat::simple(font.clone(), color));
    }
    job
}

/// Share of the kept characters that belongs to the end, where recordings of one robot differ.
const END: f64 = 0.6;

/// `name`, or the longest form that `fits`, shortened in the middle.
pub fn elided(name: &str, fits: impl Fn(&str) -> bool) -> String {
    if fits(name) {
        return name.to_owned();
    }
    let signs: Vec<char> = name.chars().collect();
    let shortened = |kept: usize| -> String {
        let end = (END * kept as f64).ceil() as usize;
        let ending = &signs[signs.len() - end..];
        signs[..kept - end]
            .iter()
            .chain(&['…'])
            .chain(ending)
            .collect()
    };
    let longest = (1..signs.len())
        .rev()
        .map(shortened)
        .find(|name| fits(name));
    longest.unwrap_or_else(|| "…".to_owned())
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;

    use eframe::egui::text::LayoutSection;

    use super::*;

    #[test]
    fn long_names_are_shortened_in_the_middle() {
        let name = "lake-2026-11-22T150130Z.mcap";
        for (name, most, shown) in [
            (name, 28, name),
            (name, 21, "lake-202…150130Z.mcap"),
            (name, 2, "…p"),
            (name, 0, "…"),
            ("", 0, ""),
            ("Grün-über-Übergröße", 8, "Gr…größe"),
        ] {
            let fits = |name: &str| name.chars().count() <= most;
            assert_eq!(elided(name, fits), shown);
        }
    }

    #[test]
    fn options_are_monospace() {
        let window = Harness::builder().build_ui(|ui| {
            let words = "Start it with --keys first.";
            let job = with_monospace_options(ui, words, &TextStyle::Small, Color32::BLACK);
            // Words of one format are one section.
            let family = |section: &LayoutSection| section.format.font_id.family.clone();
            let families: Vec<_> = job.sections.iter().map(family).collect();
            let words = FontFamily::Proportional;
            assert_eq!(families, [words.clone(), FontFamily::Monospace, words]);
        });
        drop(window);
    }

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
}
