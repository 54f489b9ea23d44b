//! A gamepad: a stick that counts while a dead-man button is held.

/// What a gamepad says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PadReading {
    /// Whether the dead-man button is held.
    pub is_deadman_held: bool,
    /// Stick forwards, −1 … 1, as the hardware says it.
    pub forward: f32,
    /// Stick to the left, −1 … 1.
    pub left: f32,
}

/// Sticks that were let go lie within this of their middle.
const DEAD_ZONE: f32 = 0.15;

/// A stick's deflection without its dead zone: 0 within it, from there evenly to ±1. Nonsense is 0.
pub(super) fn without_dead_zone(deflection: f32) -> f32 {
    if !deflection.is_finite() {
        return 0.0;
    }
    let beyond = (deflection.abs() - DEAD_ZONE) / (1.0 - DEAD_ZONE);
    beyond.clamp(0.0, 1.0).copysign(deflection)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_middle_is_dead_and_the_ends_are_whole() {
        for (deflection, expected) in [
            (0.0, 0.0),
            (0.15, 0.0),
            (-0.15, 0.0),
            (0.575, 0.5),
            (1.0, 1.0),
            (-1.0, -1.0),
            (-7.0, -1.0),
            (f32::NAN, 0.0),
            (f32::INFINITY, 0.0),
        ] {
            let got = without_dead_zone(deflection);
            assert!((got - expected).abs() < 1e-6, "{deflection}: {got}");
        }
    }

    proptest! {
        #[test]
        fn more_deflection_is_never_less(bits in any::<[u32; 2]>()) {
            let [a, b] = bits.map(f32::from_bits);
            let (a_out, b_out) = (without_dead_zone(a), without_dead_zone(b));
            prop_assert!(a_out.abs() <= 1.0 && b_out.abs() <= 1.0);
            if a.is_finite() && b.is_finite() && a <= b {
                prop_assert!(a_out <= b_out, "{a} {b}: {a_out} {b_out}");
            }
        }
    }
}
