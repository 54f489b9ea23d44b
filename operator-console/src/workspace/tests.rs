use eframe::egui::{Vec2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;

use super::*;

struct Rig {
    workspace: Workspace,
    absent: Vec<PanelId>,
    drawn: Vec<PanelId>,
}

fn window(layout: &Layout, size: [f32; 2]) -> Harness<'static, Rig> {
    let rig = Rig {
        workspace: Workspace::of(layout),
        absent: Vec::new(),
        drawn: Vec::new(),
    };
    let mut harness = Harness::builder()
        .with_size(Vec2::from(size))
        .build_ui_state(
            |ui, rig: &mut Rig| {
                rig.drawn.clear();
                let (absent, drawn) = (&rig.absent, &mut rig.drawn);
                rig.workspace
                    .show(ui, |panel| !absent.contains(&panel), &mut |ui, panel| {
                        drawn.push(panel);
                        let _room = ui.label(format!("{panel:?} content"));
                    });
            },
            rig,
        );
    harness.run_steps(4);
    harness
}

fn size_of(window: &Harness<'_, Rig>, panel: PanelId) -> Vec2 {
    let tree = &window.state().workspace.tree;
    let id = tree.tiles.find_pane(&panel).unwrap();
    tree.tiles.rect(id).unwrap().size()
}

#[test]
fn default_layout_has_all_panels_and_a_large_map() {
    assert!(Layout::default().is_whole());
    let window = window(&Layout::default(), [1280.0, 760.0]);
    let drawn = [
        PanelId::Layers,
        PanelId::Robot,
        PanelId::Map,
        PanelId::Driving,
        PanelId::Alerts,
    ];
    let mut shown = window.state().drawn.clone();
    shown.sort_unstable();
    let mut expected = drawn.to_vec();
    expected.sort_unstable();
    assert_eq!(shown, expected);
    let map = size_of(&window, PanelId::Map);
    assert!(
        map.x * map.y >= 0.5 * 1280.0 * 800.0,
        "half a window: {map}"
    );
}

#[test]
fn tabs_are_switched_closed_and_reopened() {
    let mut window = window(&Layout::default(), [1280.0, 760.0]);
    window.get_by_label("Events").click();
    window.run_steps(3);
    assert!(window.state().drawn.contains(&PanelId::Events));
    assert!(!window.state().drawn.contains(&PanelId::Alerts));
    let workspace = &mut window.state_mut().workspace;
    workspace.set_wanted(PanelId::Alerts, true);
    window.run_steps(2);
    assert!(window.state().drawn.contains(&PanelId::Alerts));

    for panel in PanelId::ALL {
        window.state_mut().workspace.set_wanted(panel, false);
    }
    window.run_steps(3);
    assert_eq!(window.state().drawn, [PanelId::Map], "the map stays");
    let map = size_of(&window, PanelId::Map);
    assert!(map.x > 1260.0 && map.y > 740.0, "{map}");
    window
        .state_mut()
        .workspace
        .set_wanted(PanelId::Driving, true);
    window.run_steps(3);
    window.get_by_label("Driving content");
    window.state_mut().workspace.reset();
    window.run_steps(3);
    assert_eq!(window.state().drawn.len(), 5);
}

#[test]
fn panels_without_content_are_hidden() {
    let mut window = window(&Layout::default(), [1280.0, 760.0]);
    let with_driving = size_of(&window, PanelId::Map).x;
    window.state_mut().absent = vec![
        PanelId::Driving,
        PanelId::Alerts,
        PanelId::Events,
        PanelId::Recording,
        PanelId::Losses,
    ];
    window.run_steps(3);
    assert!(size_of(&window, PanelId::Map).x > with_driving + 150.0);
    assert!(window.state().workspace.is_wanted(PanelId::Driving));
    window.state_mut().absent.clear();
    window.run_steps(3);
    assert!((size_of(&window, PanelId::Map).x - with_driving).abs() < 2.0);
    assert!((size_of(&window, PanelId::Driving).x - 300.0).abs() < 8.0);
}

#[test]
fn a_front_tab_returns_with_its_content() {
    let mut window = window(&Layout::default(), [1280.0, 760.0]);
    window.get_by_label("Shores").click();
    window.run_steps(3);
    assert!(window.state().drawn.contains(&PanelId::Shores));
    for _times in 0..2 {
        window.state_mut().absent = vec![PanelId::Shores, PanelId::Alerts, PanelId::Driving];
        window.run_steps(3);
        assert!(window.state().drawn.contains(&PanelId::Layers));
        assert!(window.state().drawn.contains(&PanelId::Events));
        // Also in the stored layout.
        let kept = window.state().workspace.layout();
        let again = Workspace::of(&kept).layout();
        assert_eq!(again, kept);
        window.state_mut().absent.clear();
        window.run_steps(3);
        assert!(window.state().drawn.contains(&PanelId::Shores));
        assert!(window.state().drawn.contains(&PanelId::Alerts));
    }
    // A choice made while another panel is hidden counts.
    window.state_mut().absent = vec![PanelId::Alerts];
    window.run_steps(3);
    window.get_by_label("Losses").click();
    window.run_steps(3);
    window.state_mut().absent.clear();
    window.run_steps(3);
    assert!(window.state().drawn.contains(&PanelId::Losses));
}

#[test]
fn a_growing_window_enlarges_the_map() {
    let mut window = window(&Layout::default(), [1280.0, 760.0]);
    let driving = size_of(&window, PanelId::Driving).x;
    let map = size_of(&window, PanelId::Map);
    window.set_size(vec2(1680.0, 960.0));
    window.run_steps(4);
    assert!((size_of(&window, PanelId::Driving).x - driving).abs() < 2.0);
    let grown = size_of(&window, PanelId::Map) - map;
    assert!((grown - vec2(400.0, 200.0)).length() < 4.0, "{grown}");
    // Too small for all panels.
    window.set_size(vec2(640.0, 440.0));
    window.run_steps(4);
    let map = size_of(&window, PanelId::Map);
    assert!(map.x > 120.0 && map.y > 120.0, "{map}");
    for (width, map) in [(640.0, 256.0), (700.0, 280.0), (860.0, 300.0)] {
        window.set_size(vec2(width, 580.0));
        window.run_steps(4);
        let drawn = size_of(&window, PanelId::Map).x;
        assert!((drawn - map).abs() < 14.0, "{width}: {drawn}");
    }
    window.set_size(vec2(1680.0, 960.0));
    window.run_steps(4);
    assert!((size_of(&window, PanelId::Driving).x - driving).abs() < 2.0);
}

#[test]
fn layout_round_trip() {
    let mut rig = window(&Layout::default(), [1280.0, 760.0]);
    rig.state_mut().workspace.set_wanted(PanelId::Losses, false);
    rig.get_by_label("Robots").click();
    rig.run_steps(3);
    let layout = rig.state().workspace.layout();
    let kept = serde_json::to_string(&layout).unwrap();
    let read: Layout = serde_json::from_str(&kept).unwrap();
    assert!(read.is_whole());
    assert_eq!(read, layout);
    let again = window(&read, [1280.0, 760.0]);
    assert!(again.state().drawn.contains(&PanelId::Robots));
    assert!(!again.state().workspace.is_wanted(PanelId::Losses));

    // Missing or repeated panels and invalid shares are rejected.
    for (from, to) in [
        (r#"{"panel":"alerts"},"#, ""),
        (r#""losses"}]"#, r#""link"}]"#),
        (r#""share":"#, r#""share":-"#),
    ] {
        let broken = kept.replacen(from, to, 1);
        assert_ne!(broken, kept, "{from}");
        assert!(!serde_json::from_str::<Layout>(&broken).unwrap().is_whole());
    }
}

#[test]
fn keyboard_focus_cycles_through_panels() {
    let mut window = window(&Layout::default(), [1280.0, 760.0]);
    let mut seen = Vec::new();
    for _press in 0..6 {
        window.state_mut().workspace.cycle_focus(true);
        window.run_steps(2);
        seen.push(window.state().workspace.focused.unwrap());
    }
    let expected = [
        PanelId::Layers,
        PanelId::Robot,
        PanelId::Map,
        PanelId::Driving,
        PanelId::Alerts,
        PanelId::Layers,
    ];
    assert_eq!(seen, expected);
    window.state_mut().workspace.cycle_focus(false);
    window.run_steps(2);
    assert_eq!(window.state().workspace.focused, Some(PanelId::Alerts));
}

/// Drags a panel by its tab and drops it `off` the middle of another one.
fn drop_on(window: &mut Harness<'_, Rig>, panel: &str, on: PanelId, off: Vec2) {
    let tree = &window.state().workspace.tree;
    let body = tree.tiles.rect(tree.tiles.find_pane(&on).unwrap()).unwrap();
    let target = body.center() + off;
    let tab = window.get_by_label(panel).rect().center();
    window.hover_at(tab);
    window.run_steps(1);
    window.drag_at(tab);
    window.run_steps(1);
    for part in [0.3, 0.7, 1.0] {
        window.hover_at(tab + part * (target - tab));
        window.run_steps(2);
    }
    window.drop_at(target);
    window.run_steps(4);
}

#[test]
fn a_panel_dropped_on_another_is_a_tab_beside_it() {
    let mut window = window(&Layout::default(), [1280.0, 760.0]);
    // In the middle of a panel, the library nests tabs.
    drop_on(&mut window, "Driving", PanelId::Layers, vec2(0.0, 20.0));
    let drawn = window.state().drawn.clone();
    assert!(drawn.contains(&PanelId::Driving), "in front: {drawn:?}");
    assert!(!drawn.contains(&PanelId::Layers), "{drawn:?}");
    let top = |label| window.get_by_label(label).rect().top();
    let tops = ["Layers", "Shores", "Driving"].map(|label| top(label).round() as i32);
    assert_eq!(tops, [tops[0]; 3], "one row of tabs");
    assert!(window.query_by_label("Tabs").is_none());
    // Stored layouts are flattened, too.
    let kept = window.state().workspace.layout();
    assert_eq!(Workspace::of(&kept).layout(), kept);
    let json = serde_json::to_string(&kept).unwrap();
    let (from, to) = (
        r#"{"panel":"driving"}"#,
        r#"{"tabs":{"front":0,"places":[{"panel":"driving"}]}}"#,
    );
    let nested: Layout = serde_json::from_str(&json.replacen(from, to, 1)).unwrap();
    assert_ne!(nested, kept);
    assert_eq!(Workspace::of(&nested).layout(), kept);
}

#[test]
fn a_panel_dropped_at_a_side_is_beside_the_tabs() {
    let mut window = window(&Layout::default(), [1280.0, 760.0]);
    let width = size_of(&window, PanelId::Alerts).x;
    let right = vec2(0.25 * width, 20.0);
    drop_on(&mut window, "Driving", PanelId::Alerts, right);
    let drawn = window.state().drawn.clone();
    for panel in [PanelId::Driving, PanelId::Alerts] {
        assert!(drawn.contains(&panel), "{panel:?}: {drawn:?}");
    }
    assert!(window.query_by_label("Horizontal").is_none());
    let rect = |label: &str| window.get_by_label(label).rect();
    assert!(rect("Driving").left() > rect("Alerts").right());
    assert!((rect("Driving").top() - rect("Alerts").top()).abs() < 2.0);
}
