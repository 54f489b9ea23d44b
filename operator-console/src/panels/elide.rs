//! Shortens long names in the middle: recordings of one robot begin alike and differ in the time at the end.

/// Share of the kept characters that belongs to the end.
const END: f64 = 0.6;

/// `name`, or the longest shortened form that `fits`.
pub fn elided(name: &str, fits: impl Fn(&str) -> bool) -> String {
    if fits(name) {
        return name.to_owned();
    }
    let signs: Vec<char> = name.chars().collect();
    let (mut least, mut most) = (0, signs.len());
    while least + 1 < most {
        let middle = least.midpoint(most);
        if fits(&shortened(&signs, middle)) {
            least = middle;
        } else {
            most = middle;
        }
    }
    shortened(&signs, least)
}

fn shortened(signs: &[char], kept: usize) -> String {
    let end = (END * kept as f64).ceil() as usize;
    let beginning = signs.iter().take(kept - end);
    let ending = signs.iter().skip(signs.len() - end);
    beginning.chain(&['…']).chain(ending).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn in_signs(name: &str, most: usize) -> String {
        elided(name, |name| name.chars().count() <= most)
    }

    #[test]
    fn long_names_are_shortened_in_the_middle() {
        let name = "lake-2026-11-22T150130Z.mcap";
        assert_eq!(in_signs(name, 28), name);
        assert_eq!(in_signs(name, 21), "lake-202…150130Z.mcap");
        assert_eq!(in_signs(name, 2), "…p");
        assert_eq!(in_signs(name, 0), "…");
        assert_eq!(in_signs("", 0), "");
        assert_eq!(in_signs("Grün-über-Übergröße", 8), "Gr…größe");
    }
}
