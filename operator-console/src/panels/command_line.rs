//! Command line options in monospace: in the proportional font, two dashes look like one.

use eframe::egui::text::LayoutJob;
use eframe::egui::{Color32, FontFamily, FontId, TextFormat, TextStyle, Ui};

/// `words` with options such as `--keys` in monospace.
pub fn with_monospace_options(
    ui: &Ui,
    words: &str,
    style: &TextStyle,
    color: Color32,
) -> LayoutJob {
    let font = style.resolve(ui.style());
    let code = FontId::new(font.size, FontFamily::Monospace);
    let mut job = LayoutJob::default();
    for (is_option, piece) in pieces(words) {
        let font = if is_option { &code } else { &font };
        job.append(piece, 0.0, TextFormat::simple(font.clone(), color));
    }
    job
}

/// Splits text into pieces, with whether each is an option.
fn pieces(words: &str) -> Vec<(bool, &str)> {
    let mut pieces = Vec::new();
    let mut rest = words;
    while let Some(begin) = rest.find("--") {
        let is_name_char = |sign: char| sign.is_ascii_alphanumeric() || sign == '-';
        let option = &rest[begin..];
        let end = option.find(|sign| !is_name_char(sign));
        let (option, behind) = option.split_at(end.unwrap_or(option.len()));
        if begin > 0 {
            pieces.push((false, &rest[..begin]));
        }
        pieces.push((true, option));
        rest = behind;
    }
    if !rest.is_empty() {
        pieces.push((false, rest));
    }
    pieces
}

#[cfg(test)]
mod tests {
    use eframe::egui::{Label, vec2};
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;

    #[test]
    fn options_are_separate_pieces() {
        assert_eq!(
            pieces("with --keys, or --keep-serving."),
            [
                (false, "with "),
                (true, "--keys"),
                (false, ", or "),
                (true, "--keep-serving"),
                (false, ".")
            ]
        );
        assert_eq!(pieces("no option – none"), [(false, "no option – none")]);
        assert_eq!(pieces("--set"), [(true, "--set")]);
        assert_eq!(pieces(""), []);
    }

    #[test]
    fn options_are_monospace() {
        let words = "Start it with --keys first.";
        let window = Harness::builder()
            .with_size(vec2(300.0, 60.0))
            .build_ui(|ui| {
                let job = with_monospace_options(ui, words, &TextStyle::Small, Color32::BLACK);
                let families = job.sections.iter().map(|one| &one.format.font_id.family);
                assert!(families.eq([
                    &FontFamily::Proportional,
                    &FontFamily::Monospace,
                    &FontFamily::Proportional
                ]));
                ui.add(Label::new(job).wrap());
            });
        assert!(window.query_by_label(words).is_some());
    }
}
