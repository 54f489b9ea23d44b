//! The probe's card, as a screen reader is told of it.

use protocol::layer::{LayerId, Quantisation};

use crate::link::controls::Control;

/// What the card says of one layer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Reading {
    pub(super) layer: LayerId,
    pub(super) value: String,
}

/// Where the card says that it reads: x and y in `odom`, metres.
pub(super) fn position_m(all: &[Control]) -> Option<[f64; 2]> {
    all.iter().find_map(|control| position(&control.words))
}

/// What it says of each layer.
pub(super) fn readings(all: &[Control]) -> Vec<Reading> {
    let Some(card) = all
        .iter()
        .find(|control| position(&control.words).is_some())
    else {
        return Vec::new();
    };
    let [left, _, _, below] = card.edges;
    let is_of_card = |control: &&Control| {
        control.role == "Label" && control.edges[0] == left && control.edges[1] >= below
    };
    let named = all.iter().filter(is_of_card).filter_map(|name| {
        let layer = LayerId::ALL
            .into_iter()
            .find(|layer| operator_console::panels::layers::layer_name(*layer) == name.words)?;
        // Next to it, on the same line.
        let in_line = all.iter().filter(|control| {
            control.role == "Label"
                && control.edges[0] >= name.edges[2]
                && (control.edges[1] - name.edges[1]).abs() <= 3
        });
        let value = in_line.min_by_key(|control| control.edges[0])?;
        Some(Reading {
            layer,
            value: value.words.clone(),
        })
    });
    named.collect()
}

impl Reading {
    /// Whether an exported value (NaN, or 0 of a class, where nothing is known) is what the card says, to the digits that
    /// it shows.
    pub(super) fn agrees_with(&self, exported: f32) -> bool {
        if self.value == "unknown" {
            let is_class = !self.layer.classes().is_empty();
            return exported.is_nan() || (is_class && exported.to_bits() == 0);
        }
        match self.layer.quantisation() {
            Quantisation::Classes(classes) => classes.iter().any(|class| {
                class.name == self.value && f32::from(class.value).to_bits() == exported.to_bits()
            }),
            Quantisation::Linear { .. } => {
                let words = self.value.split(' ').next().unwrap_or_default();
                let decimals = words.split_once('.').map_or(0, |(_, after)| after.len());
                let half = 0.5 * 0.1_f64.powi(i32::try_from(decimals).unwrap());
                let shown = number(words).unwrap();
                (shown - f64::from(exported)).abs() <= half * 1.001
            }
        }
    }
}

/// `x 1.20 m  y −3.40 m`
fn position(words: &str) -> Option<[f64; 2]> {
    // The spaces between them are of those that no line is broken at.
    let mut words = words.split_whitespace();
    words.next().filter(|name| *name == "x")?;
    let x = number(words.next()?)?;
    let y = number(words.nth(2)?)?;
    Some([x, y])
}

fn number(words: &str) -> Option<f64> {
    words.replace('−', "-").parse().ok()
}

#[test]
fn a_reading_is_held_to_the_digits_that_it_shows() {
    let reading = |layer, value: &str| Reading {
        layer,
        value: value.to_owned(),
    };
    let height = reading(LayerId::Elevation, "−0.125 m");
    assert!(
        height.agrees_with(-0.1254)
            && !height.agrees_with(-0.1256)
            && !height.agrees_with(f32::NAN)
    );
    let obstacle = reading(LayerId::Obstacle, "free");
    assert!(obstacle.agrees_with(-1.0) && !obstacle.agrees_with(1.0) && !obstacle.agrees_with(0.0));
    let nothing = reading(LayerId::Elevation, "unknown");
    assert!(nothing.agrees_with(f32::NAN) && !nothing.agrees_with(0.0));
    assert_eq!(position("x −1.20 m  y 3.40 m"), Some([-1.2, 3.4]));
    assert_eq!(position("x marks the spot"), None);
}
