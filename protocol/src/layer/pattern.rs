//! What tells classes apart without colour: marks on a class's cells, at the scale of the picture.
//!
//! A pattern is laid over pixels, not over cells, so that it reads the same where a cell is one pixel and where it is
//! twenty.

/// Marks that repeat every [`PERIOD`](Self::PERIOD) pixels.
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
    /// Pixels after which every pattern repeats, to the right and down.
    pub const PERIOD: usize = 8;

    /// Whether a pixel is part of a mark; `x` counts to the right, `y` down.
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

    /// Two periods, `#` for a mark.
    fn drawn(pattern: Pattern) -> String {
        let row = |y| {
            let mark = |x| if pattern.is_mark(x, y) { '#' } else { '.' };
            (0..8).map(mark).collect::<String>()
        };
        (0..8).map(row).collect::<Vec<_>>().join("\n")
    }

    #[test]
    fn patterns_look_like_this() {
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
