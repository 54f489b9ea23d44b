//! Legends and their button.

use eframe::egui::Shape;

use super::super::grid::ScaleBar;
use super::*;

/// Share of the map under the legends.
fn under_legends(window: &Harness<'_, Rig>) -> f32 {
    let view = &window.state().view;
    let place = view.legends.place.unwrap();
    place.area() / view.place().area()
}

#[test]
fn a_button_opens_more_legends_on_small_maps() {
    for (width, height, most) in [
        (215.0, 390.0, 0.19),
        (260.0, 300.0, 0.21),
        (500.0, 400.0, 0.21),
    ] {
        let mut window = window_of(width, height);
        let share = under_legends(&window);
        assert!(share < most, "{width} × {height}: {share}");
        let button = window.get_by_label_contains("more legend");
        button.focus();
        window.run_steps(2);
        assert!(window.get_by_label_contains("more legend").is_focused());
        window.key_press(Key::Enter);
        window.run_steps(4);
        window.get_by_label("Fewer legends");
        let opened = under_legends(&window);
        assert!(opened > share, "{width} × {height}: {opened}");
        let place = window.state().view.legends.place.unwrap();
        assert!(window.state().view.place().contains_rect(place), "{place}");
        window.get_by_label("Fewer legends").click();
        window.run_steps(4);
        window.get_by_label_contains("more legend");
        let closed = under_legends(&window);
        assert!((closed - share).abs() < 0.01, "{closed} {share}");
    }
    let mut tiny = window_of(190.0, 150.0);
    assert!(under_legends(&tiny) < 0.1);
    tiny.get_by_label_contains("Legends: ").click();
    tiny.run_steps(4);
    tiny.get_by_label("Fewer legends");
    assert!(under_legends(&tiny) > 0.25, "{}", under_legends(&tiny));
    let large = window_of(1400.0, 1000.0);
    assert!(large.query_by_label_contains("more legend").is_none());
    assert!(large.query_by_label_contains("Legends: ").is_none());
}

#[test]
fn a_narrow_map_has_one_legend() {
    window_of(294.0, 1_200.0).get_by_label_contains("4 more legends");
    let wide = window_of(900.0, 1_200.0);
    assert!(wide.query_by_label_contains("more legend").is_none());
}

#[test]
fn a_narrow_map_has_the_button_beside_the_title() {
    // The map in a window of 700 × 620 points.
    let mut window = window_of(294.0, 406.0);
    crate::theme::set(&window.ctx);
    window.run_steps(4);
    let share = under_legends(&window);
    assert!(share < 0.13, "{share}");
    for (name, is_there) in [
        ("Sparse", true),
        ("Docking site", true),
        ("Obstacle", false),
        ("Unknown", false),
    ] {
        let found = window.query_by_label(name).is_some();
        assert_eq!(found, is_there, "{name}");
    }
    let button = window.get_by_label_contains("4 more legends: Obstacles");
    let button = button.rect();
    let title = window.get_by_label("Shore").rect();
    let card = window.state().view.legends.place.unwrap();
    assert!(card.contains_rect(button), "{card} {button}");
    assert!(button.y_range().contains(title.center().y), "{title}");
    assert!(title.right() <= button.left(), "{title} {button}");
    // The button also works after a click into the card.
    for label in ["more legend", "Fewer legends", "more legend"] {
        window.get_by_label_contains(label).click();
        window.run_steps(4);
        let card = window.state().view.legends.place.unwrap();
        click(&mut window, card.center_bottom() - vec2(0.0, 20.0));
        window.run_steps(2);
    }
    window.get_by_label("Fewer legends");
}

/// Margins of the test window and of the scale bar's card, points.
const AROUND: f32 = 16.0;
const PADDING: f32 = 16.0;

/// The scale bar beside the legends.
fn scale_bar(view: &MapView) -> ScaleBar {
    let room =
        view.place().width() - super::super::legend_card::width(view.place()) - 3.0 * CARD_MARGIN;
    ScaleBar::new(view.camera.points_per_m, room)
}

#[test]
fn legends_do_not_cover_the_scale_bar() {
    // The map in windows of 500 to 730 points.
    for width in [204.0, 215.0, 253.0, 294.0] {
        let mut window = window_of(width + AROUND, 300.0 + AROUND);
        crate::theme::set(&window.ctx);
        // Obstacles over heights have the longest texts.
        let stack = &mut window.state_mut().view.settings.stack;
        stack.apply(LayerCommand::Show(LayerId::Shore, false));
        window.run_steps(4);
        for is_opened in [false, true] {
            window.get_by_label("Free: clear over the known");
            let view = &window.state().view;
            let legends = view.legends.place.unwrap();
            let bar = view.place().left() + CARD_MARGIN + PADDING + scale_bar(view).length;
            assert!(bar < legends.left() + 0.5, "{width}: {bar} {legends}");
            if !is_opened {
                window.get_by_label_contains("more legend").click();
                window.run_steps(4);
            }
        }
    }
}

#[test]
fn opened_legends_hide_the_scale_bar_completely() {
    let mut window = window_of(160.0 + AROUND, 134.0 + AROUND);
    crate::theme::set(&window.ctx);
    look(&mut window, Look::Follow(false));
    let screen = window.state().view.camera.screen;
    let camera = &mut window.state_mut().view.camera;
    // The bar has 47 points.
    camera.zoom_about(screen.center(), 4.7 / camera.points_per_m);
    let has_bar = |window: &Harness<'_, Rig>| {
        let label = scale_bar(&window.state().view).label;
        assert_eq!(label, "10 m");
        let mut shapes = window.output().shapes.iter();
        shapes.any(
            |clipped| matches!(&clipped.shape, Shape::Text(text) if text.galley.text() == label),
        )
    };
    window.run_steps(4);
    assert!(has_bar(&window));
    for (label, has) in [("Legends: ", false), ("Fewer legends", true)] {
        window.get_by_label_contains(label).focus();
        window.run_steps(2);
        window.key_press(Key::Enter);
        window.run_steps(4);
        assert_eq!(has_bar(&window), has, "{label}");
    }
}

#[test]
fn opened_legends_scroll_by_keys() {
    const SCROLLED: &str = "Legends; Page Up and Page Down scroll them";
    let mut window = window_of(260.0, 300.0);
    assert!(window.query_by_label(SCROLLED).is_none(), "closed");
    window.get_by_label_contains("more legend").focus();
    window.run_steps(2);
    window.key_press(Key::Enter);
    window.run_steps(4);
    let first = window.get_by_label("Obstacle").rect().top();
    let top = |window: &Harness<'_, Rig>| window.get_by_label("Obstacle").rect().top();
    // Keys scroll while the button has the focus.
    window.key_press(Key::PageDown);
    window.run_steps(4);
    let second = top(&window);
    assert!(second < first - 40.0, "{second} {first}");
    window.key_press(Key::PageUp);
    window.run_steps(4);
    assert!((top(&window) - first).abs() < 1.0);
    window.get_by_label(SCROLLED).focus();
    window.run_steps(2);
    window.key_press(Key::PageDown);
    window.run_steps(4);
    assert!((top(&window) - second).abs() < 1.0);
    window.key_press(Key::ArrowUp);
    window.run_steps(4);
    assert!((top(&window) - second).abs() < 1.0, "arrows drive");
    window.ctx.memory_mut(|memory| {
        if let Some(focused) = memory.focused() {
            memory.surrender_focus(focused);
        }
    });
    window.run_steps(2);
    window.key_press(Key::PageUp);
    window.run_steps(4);
    assert!((top(&window) - second).abs() < 1.0);
    let mut roomy = window_of(500.0, 800.0);
    if let Some(button) = roomy.query_by_label_contains("more legend") {
        button.click();
    }
    roomy.run_steps(4);
    assert!(roomy.query_by_label(SCROLLED).is_none());
}

/// Whether legends or their button overlap buttons or compass.
fn lie_on_others(window: &Harness<'_, Rig>) -> bool {
    let view = &window.state().view;
    let legends = view.legends.place.unwrap();
    let compass = window.get_by_label("Compass: y up").rect();
    assert!(view.place().contains_rect(legends), "{legends}");
    legends.intersects(compass) || legends.intersects(view.buttons)
}

#[test]
fn legends_do_not_cover_compass_or_buttons() {
    // Among others, the map in a window of 640 × 480 points at 120 %, with and without the driving panel.
    for (width, height, is_button_alone) in [
        (211.0, 168.0, true),
        (250.0, 168.0, true),
        (211.0, 134.0, true),
        (180.0, 120.0, true),
        (211.0, 300.0, false),
    ] {
        for uppermost in [LayerId::Shore, LayerId::Cost] {
            let size = format!("{width} × {height}, {uppermost}");
            let mut window = window_of(width + AROUND, height + AROUND);
            crate::theme::set(&window.ctx);
            if uppermost == LayerId::Cost {
                let stack = &mut window.state_mut().view.settings.stack;
                stack.apply(LayerCommand::Above(LayerId::Cost, LayerId::Shore));
            }
            window.run_steps(4);
            let alone = window.query_by_label_contains("Legends: ").is_some();
            assert_eq!(alone, is_button_alone, "{size}");
            assert!(!lie_on_others(&window), "{size}");
            window.get_by_label_contains("egends: ").click();
            window.run_steps(4);
            assert!(!lie_on_others(&window), "{size}, opened");
        }
    }
}

#[test]
fn a_long_title_is_below_the_button() {
    let mut window = window_of(211.0 + AROUND, 300.0 + AROUND);
    crate::theme::set(&window.ctx);
    let stack = &mut window.state_mut().view.settings.stack;
    stack.apply(LayerCommand::Above(LayerId::Cost, LayerId::Shore));
    window.run_steps(4);
    let title = window.get_by_label("Slope cost").rect();
    let button = window.get_by_label_contains("more legends: ").rect();
    assert!(title.height() < 20.0, "one line: {title}");
    assert!(title.top() >= button.bottom(), "{title} {button}");
}
