//! How a colour looks to people with each kind of colour vision, for tests of colours.
//!
//! Dichromacy after Machado, Oliveira and Fernandes (2009), "A Physiologically-based Model for Simulation of Color Vision
//! Deficiency", severity 1.0; contrast after WCAG 2.

use eframe::egui::Color32;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ColorVision {
    Normal,
    Protanopia,
    Deuteranopia,
    Tritanopia,
}

impl ColorVision {
    pub(crate) const ALL: [Self; 4] = [
        Self::Normal,
        Self::Protanopia,
        Self::Deuteranopia,
        Self::Tritanopia,
    ];

    /// Transformation of linear RGB.
    const fn matrix(self) -> [[f64; 3]; 3] {
        match self {
            Self::Normal => [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            Self::Protanopia => [
                [0.152286, 1.052583, -0.204868],
                [0.114503, 0.786281, 0.099216],
                [-0.003882, -0.048116, 1.051998],
            ],
            Self::Deuteranopia => [
                [0.367322, 0.860646, -0.227968],
                [0.280085, 0.672501, 0.047413],
                [-0.011820, 0.042940, 0.968881],
            ],
            Self::Tritanopia => [
                [1.255528, -0.076749, -0.178779],
                [-0.078411, 0.930809, 0.147602],
                [0.004733, 0.691367, 0.303900],
            ],
        }
    }

    /// Relative luminance of an opaque colour, 0 … 1.
    fn luminance(self, color: Color32) -> f64 {
        let linear = [color.r(), color.g(), color.b()].map(|byte| {
            let part = f64::from(byte) / 255.0;
            if part <= 0.04045 {
                part / 12.92
            } else {
                libm::pow((part + 0.055) / 1.055, 2.4)
            }
        });
        let seen = self.matrix().map(|row| {
            let channel: f64 = row
                .iter()
                .zip(linear)
                .map(|(factor, part)| factor * part)
                .sum();
            channel.clamp(0.0, 1.0)
        });
        0.2126 * seen[0] + 0.7152 * seen[1] + 0.0722 * seen[2]
    }

    /// From 1 (equal) to 21 (black and white).
    pub(crate) fn contrast(self, a: Color32, b: Color32) -> f64 {
        let [a, b] = [a, b].map(|color| self.luminance(color) + 0.05);
        a.max(b) / a.min(b)
    }
}

#[test]
fn red_is_dark_to_protanopes_and_greys_are_grey_to_all() {
    let colors = [[255, 0, 0], [0, 0, 255], [119; 3], [255; 3]];
    for (vision, expected) in [
        (ColorVision::Normal, [5.252, 2.444, 4.689, 21.0]),
        (ColorVision::Protanopia, [3.285, 3.863, 4.689, 21.0]),
        (ColorVision::Deuteranopia, [6.568, 3.077, 4.689, 21.0]),
        (ColorVision::Tritanopia, [5.259, 3.550, 4.689, 21.0]),
    ] {
        for ([red, green, blue], expected) in colors.into_iter().zip(expected) {
            let color = Color32::from_rgb(red, green, blue);
            let ratio = vision.contrast(color, Color32::BLACK);
            assert!(
                (ratio - expected).abs() < 1e-3,
                "{vision:?} {color:?}: {ratio}"
            );
        }
    }
}
