//! Colours and patterns of cell codes.
//!
//! Colour tables have equidistant sRGB stops, interpolated linearly. Patterns distinguish
//! classes without colour. They are drawn over pixels, not over cells, so that they look the same
//! at any magnification.

use serde::{Deserialize, Serialize};

use crate::layer::{Class, LayerId, Legend};

/// A colour scheme. Its name is stored in settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Scheme {
    /// White free … black occupied, unknown transparent.
    Grey,
    /// As `map_server` shows its files: white free … black occupied, unknown grey 205.
    MapServer,
    /// Cividis from dark blue (low) to yellow (high), over a range that can be fitted to the map.
    Cividis,
    /// Elevation colours of \[LOD\] §5: the ground plane ± 3 cm blue, below yellow, above black to
    /// grey.
    GroundPlane,
    /// The same with a ground plane of ± 5 cm (\[LOD\] §5.6).
    GroundPlane5,
    /// And of ± 6 cm (\[LOD\] §5.2, §5.4).
    GroundPlane6,
    /// Magma reversed: light is easy, dark is lethal or rigid.
    Magma,
    /// Deep of cmocean from pale yellow (shoal) to dark blue (deep), over a range from 0 that can be
    /// fitted to the map.
    Deep,
    /// A colour of Okabe and Ito for each class.
    OkabeIto,
    /// Obstacle colours of \[LOD\] §5: free green, obstacle red. Not safe for the colour-blind.
    GreenRed,
}

/// A [`Scheme`] applied to one layer, over a range of values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Palette {
    layer: LayerId,
    scheme: Scheme,
    low: f32,
    high: f32,
}

const TRANSPARENT: [u8; 4] = [0; 4];
const MAP_SERVER_UNKNOWN: [u8; 4] = [205, 205, 205, 255];
/// Marks on light and on dark classes.
const DARK_MARK: [u8; 4] = [24, 28, 34, 255];
const LIGHT_MARK: [u8; 4] = [255, 255, 255, 255];
const LADAR_GREY: [Rgb; 2] = [[0, 0, 0], [200, 200, 200]];

impl Scheme {
    /// Half the thickness of the ground plane, metres, in the colours of \[LOD\] that have one.
    pub const fn ground_m(self) -> Option<f32> {
        match self {
            Self::GroundPlane => Some(0.03),
            Self::GroundPlane5 => Some(0.05),
            Self::GroundPlane6 => Some(0.06),
            _ => None,
        }
    }

    /// Whether its range is fitted to the map; the others have fixed values.
    pub const fn is_fitted(self) -> bool {
        matches!(self, Self::Cividis | Self::Deep)
    }
}

impl LayerId {
    /// Schemes of this layer; the first is the default.
    pub const fn schemes(self) -> &'static [Scheme] {
        match self {
            Self::Occupancy => &[Scheme::Grey, Scheme::MapServer],
            Self::Elevation => &[
                Scheme::Cividis,
                Scheme::GroundPlane,
                Scheme::GroundPlane5,
                Scheme::GroundPlane6,
            ],
            Self::Obstacle => &[Scheme::OkabeIto, Scheme::GreenRed],
            Self::Cost | Self::Intra | Self::Inter => &[Scheme::Magma],
            Self::Rigidity | Self::Shore => &[Scheme::OkabeIto],
            Self::Depth => &[Scheme::Deep],
        }
    }

    /// One palette per scheme of [`schemes`](Self::schemes), over its default range.
    pub fn palettes(self) -> impl Iterator<Item = Palette> {
        self.schemes()
            .iter()
            .map(move |&scheme| Palette::new(self, scheme))
    }

    /// First palette of the layer.
    pub fn default_palette(self) -> Palette {
        Palette::new(self, self.schemes()[0])
    }

    /// Palette of the figures in the document \[LOD\], for the `.document.png` of elevation and obstacle.
    pub fn document_palette(self) -> Option<Palette> {
        self.palettes().find(Palette::is_document_palette)
    }

    /// Class of a code; `None` for unknown and in a continuous layer.
    fn class_of(self, code: u16) -> Option<&'static Class> {
        self.classes().get(usize::from(code).checked_sub(1)?)
    }
}

impl Palette {
    fn new(layer: LayerId, scheme: Scheme) -> Self {
        let (low, high) = match (scheme, scheme.ground_m()) {
            (Scheme::Cividis, _) => (-0.5, 1.5),
            (_, Some(ground_m)) => (ground_m, 2.0),
            (Scheme::Deep, _) => (0.0, 10.0),
            _ => (0.0, 1.0),
        };
        Self {
            layer,
            scheme,
            low,
            high,
        }
    }

    /// Whether these are the colours of \[LOD\] §5.
    pub fn is_document_palette(&self) -> bool {
        self.scheme == Scheme::GreenRed || self.scheme.ground_m().is_some()
    }

    /// Its layer.
    pub const fn layer(&self) -> LayerId {
        self.layer
    }

    /// Its scheme.
    pub const fn scheme(&self) -> Scheme {
        self.scheme
    }

    /// Range of values over which colours vary, in the layer's unit.
    pub const fn range(&self) -> (f32, f32) {
        (self.low, self.high)
    }

    /// The same colours over a range that covers `low` … `high` and ends on round numbers.
    ///
    /// Schemes that do not [fit](Scheme::is_fitted) are returned unchanged, as for an invalid `low`
    /// … `high`. The range is at least 0.2 wide, so that a flat floor does not show its noise. That
    /// of depths begins at 0.
    #[must_use]
    pub fn fitted(self, low: f32, high: f32) -> Self {
        if !(self.scheme.is_fitted() && low <= high && (high - low).is_finite()) {
            return self;
        }
        let (low, high) = if self.scheme == Scheme::Deep {
            (0.0, high.max(0.2))
        } else {
            let spare = (0.2 - (high - low)).max(0.0) / 2.0;
            (low - spare, high + spare)
        };
        let step = round_step(high - low);
        Self {
            low: (low / step + 1e-3).floor() * step,
            high: (high / step - 1e-3).ceil() * step,
            ..self
        }
    }

    /// Colour of a cell as sRGB with straight alpha; unknown is transparent in most schemes.
    pub fn color(&self, code: u16) -> [u8; 4] {
        let Some(value) = self.layer.quantisation().decode(code) else {
            return self.unknown_color();
        };
        let [red, green, blue] = match self.scheme {
            Scheme::OkabeIto => self
                .layer
                .class_of(code)
                .map_or([0; 3], |class| class.color),
            Scheme::GreenRed if code == 1 => [0, 170, 0],
            Scheme::GreenRed => [220, 0, 0],
            _ => self.ramp_color(value),
        };
        [red, green, blue, 255]
    }

    /// Pattern of a cell's class.
    pub fn pattern(&self, code: u16) -> Pattern {
        let class = self.layer.class_of(code);
        class.map_or(Pattern::Plain, |class| class.pattern)
    }

    /// Colour of the marks of a cell's [`pattern`](Self::pattern), contrasting with the cell.
    pub fn mark_color(&self, code: u16) -> [u8; 4] {
        let [red, green, blue, _] = self.color(code).map(u32::from);
        let luma = (299 * red + 587 * green + 114 * blue) / 1000;
        if luma < 128 { LIGHT_MARK } else { DARK_MARK }
    }

    /// Colour of a pixel of a cell: `x` to the right, `y` down.
    pub fn color_at(&self, code: u16, x: usize, y: usize) -> [u8; 4] {
        if self.pattern(code).is_mark(x, y) {
            self.mark_color(code)
        } else {
            self.color(code)
        }
    }

    /// Colour of unknown cells.
    pub const fn unknown_color(&self) -> [u8; 4] {
        match self.scheme {
            Scheme::MapServer => MAP_SERVER_UNKNOWN,
            _ => TRANSPARENT,
        }
    }

    /// Legend of these colours.
    pub fn legend(&self) -> Legend {
        Legend::of(self)
    }

    /// Colour of a value of a continuous layer.
    pub(super) fn ramp_color(&self, value: f32) -> Rgb {
        let part = (value - self.low) / (self.high - self.low);
        if let Some(ground_m) = self.scheme.ground_m() {
            return match value {
                value if value < -ground_m => [240, 205, 0],
                value if value <= ground_m => [40, 80, 220],
                _ => interpolate(&LADAR_GREY, part),
            };
        }
        match self.scheme {
            Scheme::Grey | Scheme::MapServer => interpolate(&[[254; 3], [0; 3]], part),
            Scheme::Cividis => interpolate(&CIVIDIS, part),
            Scheme::Deep => interpolate(&DEEP, part),
            Scheme::Magma if self.layer.least_decides() => interpolate(&MAGMA_REVERSED, 1.0 - part),
            Scheme::Magma => interpolate(&MAGMA_REVERSED, part),
            Scheme::OkabeIto
            | Scheme::GreenRed
            | Scheme::GroundPlane
            | Scheme::GroundPlane5
            | Scheme::GroundPlane6 => [0; 3],
        }
    }
}

/// Round step (1, 2 or 5 times a power of ten) that divides `span` into four to ten parts.
pub(super) fn round_step(span: f32) -> f32 {
    let mut step = 1e-3_f32;
    loop {
        for factor in [1.0, 2.0, 5.0] {
            if span <= step * factor * 10.0 || step > 1e6 {
                return step * factor;
            }
        }
        step *= 10.0;
    }
}

/// An 8-bit sRGB colour.
pub(super) type Rgb = [u8; 3];

/// Cividis (Nuñez, Anderton and Renslow 2018): perceptually uniform with and without colour-vision
/// deficiency. Within 11/255 of the 256-entry original.
pub(super) const CIVIDIS: [Rgb; 17] = [
    [0, 34, 78],
    [0, 46, 106],
    [26, 56, 111],
    [50, 67, 109],
    [67, 78, 108],
    [82, 89, 109],
    [97, 101, 111],
    [111, 112, 115],
    [124, 123, 120],
    [139, 135, 120],
    [155, 147, 118],
    [171, 160, 114],
    [187, 173, 108],
    [204, 186, 100],
    [221, 201, 88],
    [239, 215, 72],
    [254, 232, 56],
];

/// Magma (van der Walt and Smith 2015) from light to dark: perceptually uniform, safe for the
/// colour-blind. Within 3/255 of the 256-entry original.
pub(super) const MAGMA_REVERSED: [Rgb; 17] = [
    [252, 253, 191],
    [253, 224, 162],
    [254, 195, 135],
    [254, 165, 113],
    [251, 135, 97],
    [245, 105, 92],
    [230, 81, 99],
    [207, 65, 112],
    [182, 55, 121],
    [156, 46, 127],
    [130, 38, 129],
    [105, 28, 129],
    [80, 18, 124],
    [54, 16, 106],
    [29, 17, 70],
    [10, 8, 34],
    [0, 0, 4],
];

/// Deep of cmocean (Thyng et al. 2016), for bathymetry: perceptually uniform. Twelve of its 256
/// entries.
pub(super) const DEEP: [Rgb; 12] = [
    [253, 253, 204],
    [206, 236, 179],
    [156, 219, 165],
    [111, 201, 163],
    [86, 177, 163],
    [76, 153, 160],
    [68, 130, 155],
    [62, 108, 150],
    [62, 82, 143],
    [64, 60, 115],
    [54, 43, 77],
    [39, 26, 44],
];

/// Colours of Okabe and Ito (2008), safe for every kind of colour vision.
pub(super) mod okabe_ito {
    use super::Rgb;

    pub(in crate::layer) const BLUISH_GREEN: Rgb = [0x00, 0x9e, 0x73];
    /// Darker than theirs, which is invisible on free ground and on slope cost 0.
    pub(in crate::layer) const DARK_YELLOW: Rgb = [0x7a, 0x6b, 0x00];
    pub(in crate::layer) const BLUE: Rgb = [0x00, 0x72, 0xb2];
    pub(in crate::layer) const VERMILLION: Rgb = [0xd5, 0x5e, 0x00];
    pub(in crate::layer) const REDDISH_PURPLE: Rgb = [0xcc, 0x79, 0xa7];
}

/// Colour at fraction `part` of `stops`; clamped outside 0 … 1.
pub(super) fn interpolate(stops: &[Rgb], part: f32) -> Rgb {
    let last = stops.len() - 1;
    let position = part.clamp(0.0, 1.0) * last as f32;
    let below = (position as usize).min(last);
    let above = (below + 1).min(last);
    let weight = position - below as f32;
    std::array::from_fn(|channel| {
        let (from, to) = (
            f32::from(stops[below][channel]),
            f32::from(stops[above][channel]),
        );
        (from + (to - from) * weight).round() as u8
    })
}

/// Pattern that repeats every [`PERIOD`](Self::PERIOD) pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Pattern {
    /// None.
    Plain,
    /// Single dots in staggered rows.
    Dots,
    /// Thin lines that rise to the right.
    Hatching,
    /// A lattice of upright and level lines.
    Lattice,
    /// Bold chevrons that point up.
    Chevrons,
}

impl Pattern {
    /// Period of every pattern, pixels, to the right and down.
    pub const PERIOD: usize = 8;

    /// Whether a pixel is part of a mark: `x` to the right, `y` down.
    pub const fn is_mark(self, x: usize, y: usize) -> bool {
        let (x, y) = (x % Self::PERIOD, y % Self::PERIOD);
        match self {
            Self::Plain => false,
            Self::Dots => x % 4 == y % 4 && x.is_multiple_of(2),
            Self::Hatching => (x + y).is_multiple_of(4),
            Self::Lattice => x.is_multiple_of(4) || y.is_multiple_of(4),
            Self::Chevrons => (y + 2 * Self::PERIOD - x.abs_diff(4)) % Self::PERIOD < 3,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layer::Quantisation;

    fn palette(layer: LayerId, scheme: Scheme) -> Palette {
        layer
            .palettes()
            .find(|palette| palette.scheme() == scheme)
            .unwrap()
    }

    #[test]
    fn occupancy_is_light_where_free_and_dark_where_occupied() {
        let grey = LayerId::Occupancy.default_palette();
        assert_eq!(grey.color(1), [254, 254, 254, 255]);
        assert_eq!(grey.color(251), [0, 0, 0, 255]);
        assert_eq!(grey.color(126), [127, 127, 127, 255]);
        assert_eq!(grey.color(0), [0, 0, 0, 0]);
        let map_server = palette(LayerId::Occupancy, Scheme::MapServer);
        assert_eq!(map_server.color(0), [205, 205, 205, 255]);
    }

    #[test]
    fn what_is_rigid_is_dark() {
        let [intra, inter] = [LayerId::Intra, LayerId::Inter].map(LayerId::default_palette);
        let code = |value| Quantisation::UNIT_INTERVAL.encode(value);
        for (wide_or_still, thin_or_changing) in [(1.0, 0.0), (0.8, 0.2)] {
            assert_eq!(
                intra.color(code(wide_or_still)),
                inter.color(code(1.0 - wide_or_still))
            );
            assert_eq!(
                intra.color(code(thin_or_changing)),
                inter.color(code(1.0 - thin_or_changing))
            );
        }
        assert_eq!(intra.color(code(1.0)), [0, 0, 4, 255]);
        assert_eq!(inter.color(code(1.0)), [252, 253, 191, 255]);
    }

    #[test]
    fn ground_plane_colours_are_the_documents() {
        for (scheme, ground_m) in [
            (Scheme::GroundPlane, 0.03),
            (Scheme::GroundPlane5, 0.05),
            (Scheme::GroundPlane6, 0.06),
        ] {
            let document = palette(LayerId::Elevation, scheme);
            let color = |height_m| document.color(Quantisation::HEIGHT.encode(height_m));
            for height_m in [-ground_m, 0.0, ground_m] {
                assert_eq!(color(height_m), [40, 80, 220, 255], "{scheme:?} {height_m}");
            }
            assert_eq!(color(-ground_m - 0.005), [240, 205, 0, 255], "{scheme:?}");
            let [red, ..] = color(ground_m + 0.005);
            assert!(red < 3, "{scheme:?}: black just above the ground");
            assert_eq!(color(2.0), [200, 200, 200, 255]);
        }
        let exported = LayerId::Elevation.document_palette();
        assert_eq!(
            exported.map(|palette| palette.scheme()),
            Some(Scheme::GroundPlane)
        );
    }

    #[test]
    fn ramps_get_monotonously_lighter_or_darker() {
        let is_continuous = |layer: &LayerId| layer.classes().is_empty();
        for layer in LayerId::ALL.into_iter().filter(is_continuous) {
            let palette = layer.default_palette();
            let (low, high) = palette.range();
            let lightness: Vec<f32> = (0..=64_u8)
                .map(|i| {
                    let [r, g, b] = palette.ramp_color(low + (high - low) * f32::from(i) / 64.0);
                    0.3 * f32::from(r) + 0.59 * f32::from(g) + 0.11 * f32::from(b)
                })
                .collect();
            let rising = lightness.windows(2).all(|pair| pair[0] < pair[1]);
            let falling = lightness.windows(2).all(|pair| pair[0] > pair[1]);
            assert!(rising || falling, "{layer}: {lightness:?}");
        }
    }

    /// Greys of one period of a class.
    fn greys(palette: &Palette, code: u16) -> Vec<u32> {
        let pixels = (0..Pattern::PERIOD).flat_map(|y| (0..Pattern::PERIOD).map(move |x| (x, y)));
        let grey = |(x, y)| {
            let [red, green, blue, _] = palette.color_at(code, x, y).map(u32::from);
            (299 * red + 587 * green + 114 * blue) / 1000
        };
        pixels.map(grey).collect()
    }

    #[test]
    fn classes_with_patterns_differ_without_colour() {
        for layer in [LayerId::Rigidity, LayerId::Shore] {
            let palette = layer.default_palette();
            let codes = 1..=layer.classes().len() as u16;
            for a in codes.clone() {
                let pattern = palette.pattern(a);
                assert_ne!(pattern, Pattern::Plain, "{layer} {a}");
                let marks = greys(&palette, a);
                let (dark, light) = (marks.iter().min(), marks.iter().max());
                let contrast = light.unwrap() - dark.unwrap();
                assert!(contrast > 100, "{layer} {a}: marks stand out by {contrast}");
                for b in (a + 1)..=*codes.end() {
                    assert_ne!(pattern, palette.pattern(b));
                }
            }
            assert_eq!(palette.pattern(0), Pattern::Plain);
            assert_eq!(palette.color_at(0, 0, 0), palette.unknown_color());
        }
        let elevation = LayerId::Elevation.default_palette();
        assert_eq!(elevation.pattern(4), Pattern::Plain);
        assert_eq!(elevation.color_at(4, 0, 0), elevation.color(4));
    }

    #[test]
    fn a_fitted_range_covers_the_data_and_ends_on_round_numbers() {
        let elevation = LayerId::Elevation.default_palette();
        let check = |low, high, expected: (f32, f32)| {
            let range = elevation.fitted(low, high).range();
            let close = (range.0 - expected.0).abs() < 1e-4 && (range.1 - expected.1).abs() < 1e-4;
            assert!(close, "{low} … {high} gave {range:?}");
        };
        check(-0.43, 2.71, (-0.5, 3.0));
        check(0.0, 0.0, (-0.1, 0.1));
        check(-0.5, 1.5, (-0.6, 1.6));
        check(-12.0, 31.0, (-15.0, 35.0));
        let (low, high) = (f32::NAN, 1.0);
        assert_eq!(elevation.fitted(low, high), elevation);
        let cost = LayerId::Cost.default_palette();
        assert_eq!(cost.fitted(0.2, 0.3), cost);
        let depth = LayerId::Depth.default_palette();
        for (low, high, expected) in [(2.1, 5.8, 6.0), (0.6, 0.6, 0.6), (0.01, 0.05, 0.2)] {
            let range = depth.fitted(low, high).range();
            assert!(
                range.0 == 0.0 && (range.1 - expected).abs() < 1e-4,
                "{range:?}"
            );
        }
    }

    /// Two periods, `#` for a mark.
    fn drawn(pattern: Pattern) -> String {
        let row = |y| {
            let mark = |x| if pattern.is_mark(x, y) { '#' } else { '.' };
            (0..8).map(mark).collect::<String>()
        };
        (0..8).map(row).collect::<Vec<_>>().join("\n")
    }

    #[test]
    fn patterns_match_drawings() {
        assert_eq!(drawn(Pattern::Plain), ["........"; 8].join("\n"));
        assert_eq!(
            drawn(Pattern::Dots),
            "#...#...\n........\n..#...#.\n........\n#...#...\n........\n..#...#.\n........"
        );
        assert_eq!(
            drawn(Pattern::Hatching),
            "#...#...\n...#...#\n..#...#.\n.#...#..\n#...#...\n...#...#\n..#...#.\n.#...#.."
        );
        assert_eq!(
            drawn(Pattern::Lattice),
            "########\n#...#...\n#...#...\n#...#...\n########\n#...#...\n#...#...\n#...#..."
        );
        assert_eq!(
            drawn(Pattern::Chevrons),
            "....#...\n...###..\n..#####.\n.###.###\n###...##\n##.....#\n#.......\n........"
        );
    }
}
