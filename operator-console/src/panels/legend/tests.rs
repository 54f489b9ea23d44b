use std::cell::Cell;
use std::rc::Rc;

use super::*;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;

#[test]
fn every_class_and_the_unknown_are_named() {
    for palette in LayerId::ALL.into_iter().flat_map(LayerId::palettes) {
        let data = LegendsData::new([(palette, false)]);
        let harness = Harness::builder()
            .with_size(vec2(236.0, 200.0))
            .build_ui(|ui| legends_ui(ui, &data));
        let title = capitalised(&data.legends[0].title);
        assert!(harness.query_all_by_label(&title).next().is_some());
        for swatch in &data.legends[0].swatches {
            let name = capitalised(&swatch.label);
            let place = harness.get_all_by_label(&name).last().unwrap().rect();
            assert!(place.right() <= 236.0, "{name}: {place:?}");
        }
    }
}

#[test]
fn legends_have_their_computed_size() {
    for width in [95.0, 150.0, 220.0] {
        // Upper layers have the longest texts.
        let palettes = LayerId::ALL.map(|layer| (layer.default_palette(), true));
        let mut data = LegendsData::with_short_titles(palettes);
        if width > 200.0 {
            assert_ne!(data.take_first_title(), "");
        }
        let sizes = Rc::new(Cell::new((0.0, Vec2::ZERO)));
        let seen = Rc::clone(&sizes);
        let mut window = Harness::builder()
            .with_size(vec2(width + 16.0, 900.0))
            .build_ui(move |ui| {
                ui.set_width(width);
                let reported = legends_height(ui, &data, width);
                let drawn = ui.scope(|ui| legends_ui(ui, &data));
                seen.set((reported, drawn.response.rect.size()));
            });
        crate::theme::set(&window.ctx);
        window.run_steps(3);
        let (reported, drawn) = sizes.get();
        assert!(
            (reported - drawn.y).abs() < 2.0,
            "{width}: {reported} {drawn}"
        );
        assert!(drawn.x < width + 0.5, "{width}: {drawn}");
    }
}

#[test]
fn scale_numbers_do_not_overlap() {
    let check = |spans: &[[f32; 2]], expected: &[bool]| {
        let spans: Vec<_> = spans.iter().map(|[a, b]| Rangef::new(*a, *b)).collect();
        assert_eq!(kept(&spans, 12.0), expected, "{spans:?}");
    };
    // Avoids "0.0  0.2  0.4 ≥ 0.5".
    check(
        &[[0.0, 18.0], [60.0, 78.0], [140.0, 158.0], [163.0, 195.0]],
        &[true, true, false, true],
    );
    check(
        &[[0.0, 18.0], [31.0, 49.0], [62.0, 80.0]],
        &[true, true, true],
    );
    check(
        &[[0.0, 18.0], [29.0, 47.0], [62.0, 80.0]],
        &[true, false, true],
    );
    check(&[[0.0, 18.0], [20.0, 38.0]], &[true, false]);
    check(&[[0.0, 18.0]], &[true]);
    check(&[], &[]);
}

#[test]
fn short_titles() {
    let palettes = [LayerId::Shore, LayerId::Elevation, LayerId::Cost]
        .map(|layer| (layer.default_palette(), false));
    let data = LegendsData::with_short_titles(palettes);
    let titles = data.legends.iter().map(|legend| legend.title.as_str());
    let titles: Vec<_> = titles.collect();
    assert_eq!(titles, ["Shore", "Elevation (m)", "Slope cost"]);
}

#[test]
fn unknown_is_listed_once() {
    let palette = |layer: LayerId| layer.default_palette();
    let both = [
        (palette(LayerId::Obstacle), true),
        (palette(LayerId::Elevation), false),
    ];
    let data = LegendsData::new(both);
    let labels = data.legends.iter().map(|legend| {
        let labels = legend.swatches.iter().map(|swatch| swatch.label.as_str());
        labels.collect::<Vec<_>>()
    });
    assert_eq!(
        labels.collect::<Vec<_>>(),
        [
            vec!["free: clear over the known", "obstacle"],
            vec!["unknown"]
        ]
    );
    let swatches = data.legends.iter().flat_map(|legend| &legend.swatches);
    let see_through = swatches.map(is_see_through).collect::<Vec<_>>();
    assert_eq!(see_through, [true, false, false]);
}
