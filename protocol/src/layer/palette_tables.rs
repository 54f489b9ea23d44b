//! Colour tables: 17 equidistant sRGB stops, interpolated linearly.

/// An 8-bit sRGB colour.
pub(super) type Rgb = [u8; 3];

/// Cividis (Nuñez, Anderton & Renslow 2018): perceptually uniform and nearly the same to readers with and
/// without colour-vision deficiency. Within 11/255 of the 256-entry original.
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

/// Magma (van der Walt & Smith 2015) from light to dark: perceptually uniform, safe for the colour-blind.
/// Within 3/255 of the 256-entry original.
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

/// Okabe & Ito's colours (2008), distinct to every kind of colour vision.
pub(super) mod okabe_ito {
    use super::Rgb;

    pub(in crate::layer) const BLUISH_GREEN: Rgb = [0x00, 0x9e, 0x73];
    pub(in crate::layer) const YELLOW: Rgb = [0xf0, 0xe4, 0x42];
    pub(in crate::layer) const BLUE: Rgb = [0x00, 0x72, 0xb2];
    pub(in crate::layer) const VERMILLION: Rgb = [0xd5, 0x5e, 0x00];
    pub(in crate::layer) const REDDISH_PURPLE: Rgb = [0xcc, 0x79, 0xa7];
}

/// The colour at `part` of the way through `stops`; outside 0 … 1 it is the nearest end.
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
