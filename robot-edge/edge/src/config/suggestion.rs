//! What somebody who mistyped a name probably meant.

use std::fmt;

/// The known name nearest to what was typed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Suggestion {
    /// The name.
    pub name: String,
    /// Near enough to be what was meant.
    pub is_close: bool,
}

impl fmt::Display for Suggestion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_close {
            write!(f, "did you mean `{}`?", self.name)
        } else {
            write!(f, "the nearest that exists is `{}`", self.name)
        }
    }
}

/// The longest part of what was typed that is compared: distances take memory and time.
const MAX_COMPARED_CHARS: usize = 80;

/// The nearest of `names` to `typed`, by Damerau-Levenshtein distance without regard to case.
///
/// Of a dotted name its last parts count too, so that `cell_m` finds `mapping.occupancy.cell_m`.
pub(super) fn suggest<'a>(
    typed: &str,
    names: impl IntoIterator<Item = &'a str>,
) -> Option<Suggestion> {
    let typed: String = typed
        .chars()
        .take(MAX_COMPARED_CHARS)
        .collect::<String>()
        .to_lowercase();
    let typed_parts = typed.split('.').count();
    let distance = |name: &str| {
        let whole = strsim::damerau_levenshtein(&typed, name);
        let parts = name.split('.').count();
        if parts <= typed_parts {
            return whole;
        }
        let tail: Vec<&str> = name.split('.').skip(parts - typed_parts).collect();
        whole.min(strsim::damerau_levenshtein(&typed, &tail.join(".")) + 1)
    };
    let (distance, name) = names
        .into_iter()
        .map(|name| (distance(name), name))
        .min_by_key(|&(distance, _)| distance)?;
    Some(Suggestion {
        name: name.to_owned(),
        is_close: distance <= (typed.chars().count() / 3).max(2),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(typed: &str, expected: &str, is_close: bool) {
        let names = [
            "mapping.occupancy.cell_m",
            "mapping.occupancy.p_free",
            "vehicle.name",
        ];
        let hint = suggest(typed, names).unwrap();
        assert_eq!(
            (hint.name.as_str(), hint.is_close),
            (expected, is_close),
            "{typed}"
        );
    }

    #[test]
    fn slips_of_every_kind_find_the_key() {
        check("mapping.occupancy.cell", "mapping.occupancy.cell_m", true);
        check("mapping.ocupancy.cell_m", "mapping.occupancy.cell_m", true);
        check("Mapping.Occupancy.Cell_M", "mapping.occupancy.cell_m", true);
        check("mapping.occupancy.clel_m", "mapping.occupancy.cell_m", true);
        check("cell_m", "mapping.occupancy.cell_m", true);
        check("occupancy.p_fre", "mapping.occupancy.p_free", true);
        check("nmae", "vehicle.name", true);
    }

    #[test]
    fn what_is_far_from_all_is_said_to_be() {
        check("xyzzy", "vehicle.name", false);
        assert_eq!(suggest("x", []), None);
    }
}
