//! Wheel, touch pad and fingers: how far they zoom and push the map.

use eframe::egui::{Event, InputState, MouseWheelSource, MouseWheelUnit, Vec2};

/// Scroll distance for a zoom by e, points.
const SCROLL_PER_E: f64 = 450.0;

/// The scrolling device. egui distributes its scrolling over several frames.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct GestureTracker {
    is_of_fingers: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Gesture {
    /// Zoom factor about the pointer.
    pub(super) factor: f64,
    pub(super) push: Vec2,
}

impl GestureTracker {
    pub(super) fn take(&mut self, input: &InputState) -> Gesture {
        if let Some(last) = input.events.iter().rev().find_map(is_of_fingers) {
            self.is_of_fingers = last;
        }
        if let Some(touch) = input.multi_touch() {
            return Gesture {
                factor: f64::from(touch.zoom_delta),
                push: touch.translation_delta,
            };
        }
        let pinch = f64::from(input.zoom_delta());
        let scroll = input.smooth_scroll_delta();
        // With Shift, egui scrolls sideways.
        if self.is_of_fingers || scroll.x != 0.0 {
            return Gesture {
                factor: pinch,
                push: scroll,
            };
        }
        let wheel = libm::exp(f64::from(scroll.y) / SCROLL_PER_E);
        Gesture {
            factor: pinch * wheel,
            push: Vec2::ZERO,
        }
    }
}

impl Gesture {
    pub(super) fn zooms(&self) -> bool {
        (self.factor - 1.0).abs() > 1e-6
    }
}

/// If the system does not report it: touch pads scroll in points, wheels in lines.
fn is_of_fingers(event: &Event) -> Option<bool> {
    let Event::MouseWheel { unit, source, .. } = event else {
        return None;
    };
    Some(match source {
        MouseWheelSource::Trackpad | MouseWheelSource::Momentum => true,
        MouseWheelSource::Wheel => false,
        MouseWheelSource::Unknown => *unit == MouseWheelUnit::Point,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::{Context, Modifiers, RawInput, TouchPhase, vec2};

    /// The sum of all frames after one wheel step or touch pad stroke.
    fn gesture(unit: MouseWheelUnit, modifiers: Modifiers) -> Gesture {
        let ctx = Context::default();
        let mut gestures = GestureTracker::default();
        let (mut factor, mut push) = (1.0, Vec2::ZERO);
        for frame in 0..30 {
            let wheel = Event::MouseWheel {
                unit,
                delta: vec2(0.0, 12.0),
                phase: TouchPhase::Move,
                source: MouseWheelSource::Unknown,
                modifiers,
            };
            let input = RawInput {
                time: Some(f64::from(frame) * 0.02),
                events: if frame == 0 { vec![wheel] } else { Vec::new() },
                ..RawInput::default()
            };
            let mut is_first_pass = true;
            let output = ctx.run_ui(input, |ui| {
                if std::mem::take(&mut is_first_pass) {
                    let gesture = ui.input(|input| gestures.take(input));
                    factor *= gesture.factor;
                    push += gesture.push;
                }
            });
            output.drop_without_applying_deltas();
        }
        Gesture { factor, push }
    }

    #[test]
    fn wheel_zooms_and_two_fingers_pan() {
        let wheel = gesture(MouseWheelUnit::Line, Modifiers::NONE);
        assert!(wheel.factor > 1.5 && wheel.push == Vec2::ZERO, "{wheel:?}");
        let fingers = gesture(MouseWheelUnit::Point, Modifiers::NONE);
        assert!(!fingers.zooms(), "{fingers:?}");
        assert!(
            (fingers.push - vec2(0.0, 12.0)).length() < 0.5,
            "{fingers:?}"
        );
        let sideways = gesture(MouseWheelUnit::Line, Modifiers::SHIFT);
        assert!(!sideways.zooms() && sideways.push.x > 100.0, "{sideways:?}");
        let pinch = gesture(MouseWheelUnit::Line, Modifiers::COMMAND);
        assert!(pinch.factor > 1.5 && pinch.push == Vec2::ZERO, "{pinch:?}");
    }
}
