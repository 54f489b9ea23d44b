//! A window of cells that moves with the vehicle while its cells stay fixed in `odom`.
//!
//! The buffer is circular in both axes, and each entry stores which cell it holds. Moving the
//! window touches no cell: an entry is blanked when its next cell is first written. (\[LOD\] §4.5
//! shifts and rotates its array, and reports holes and drag.)

use crate::grid::CellIndex;

/// Rolling window.
#[derive(Clone, Debug)]
pub struct RollingGrid<T> {
    blank: T,
    /// Columns and rows.
    sides: [i32; 2],
    /// The cell with the least x and y; `None` before the first [`RollingGrid::center_on`].
    first: Option<CellIndex>,
    /// Column and row of `first` in the buffer.
    origin: (i32, i32),
    /// Row-major by `y mod rows`, then `x mod columns`.
    entries: Vec<Entry<T>>,
    changed: Vec<CellIndex>,
    /// Untaken changes of cells that lost their entry.
    departed: Vec<(CellIndex, T)>,
}

#[derive(Clone, Copy, Debug)]
struct Entry<T> {
    owner: CellIndex,
    is_changed: bool,
    value: T,
}

/// Limit of window coordinates, cells.
const MAX_INDEX: i32 = 1 << 30;
/// Owner of an empty entry; no window reaches it.
const NO_OWNER: CellIndex = CellIndex {
    x: i32::MIN,
    y: i32::MIN,
};

/// Index of a cell's entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Slot(usize);

impl<T: Copy> RollingGrid<T> {
    /// A window of so many columns and rows (at least 1), all `blank`.
    pub fn new(sides: [u32; 2], blank: T) -> Self {
        let empty = Entry {
            owner: NO_OWNER,
            is_changed: false,
            value: blank,
        };
        Self {
            blank,
            sides: sides.map(u32::cast_signed),
            first: None,
            origin: (0, 0),
            entries: vec![empty; sides[0] as usize * sides[1] as usize],
            changed: Vec::new(),
            departed: Vec::new(),
        }
    }

    /// Columns and rows.
    pub const fn sides(&self) -> [i32; 2] {
        self.sides
    }

    /// The cell with the least x and y; `None` before the first [`RollingGrid::center_on`].
    pub const fn first(&self) -> Option<CellIndex> {
        self.first
    }

    /// Memory of the cells, bytes.
    pub const fn bytes(&self) -> usize {
        self.entries.len() * size_of::<Entry<T>>()
    }

    /// Moves the window so that `center` is its middle cell. Cells that enter it are blank, unless
    /// they were in it before and their entry was not reused.
    pub fn center_on(&mut self, center: CellIndex) {
        // Far from the limits of an index, so that no window wraps.
        let [columns, rows] = self.sides;
        let first_of = |center: i32, side: i32| center.clamp(-MAX_INDEX, MAX_INDEX) - side / 2;
        let first = CellIndex {
            x: first_of(center.x, columns),
            y: first_of(center.y, rows),
        };
        self.first = Some(first);
        self.origin = (first.x.rem_euclid(columns), first.y.rem_euclid(rows));
    }

    /// Entry of `cell`; `None` outside of the window.
    pub fn slot(&self, cell: CellIndex) -> Option<Slot> {
        let first = self.first?;
        let [columns, rows] = self.sides;
        let (dx, dy) = (cell.x.wrapping_sub(first.x), cell.y.wrapping_sub(first.y));
        let wrap = |at: i32, side: i32| if at >= side { at - side } else { at };
        let is_inside = (0..columns).contains(&dx) && (0..rows).contains(&dy);
        is_inside.then(|| {
            let x = wrap(self.origin.0 + dx, columns);
            let y = wrap(self.origin.1 + dy, rows);
            Slot(y as usize * columns as usize + x as usize)
        })
    }

    /// Also for cells outside of the window.
    fn entry_index(&self, cell: CellIndex) -> usize {
        let [columns, rows] = self.sides;
        let (x, y) = (cell.x.rem_euclid(columns), cell.y.rem_euclid(rows));
        y as usize * columns as usize + x as usize
    }

    /// Value of `cell`, whose entry is `slot`.
    pub fn at(&self, cell: CellIndex, slot: Slot) -> &T {
        let entry = &self.entries[slot.0];
        if entry.owner == cell {
            &entry.value
        } else {
            &self.blank
        }
    }

    /// Mutable value of `cell`, whose entry is `slot`; call [`RollingGrid::mark_changed`] after a
    /// change.
    pub fn at_mut(&mut self, cell: CellIndex, slot: Slot) -> &mut T {
        let entry = &mut self.entries[slot.0];
        if entry.owner != cell {
            if std::mem::take(&mut entry.is_changed) {
                self.departed.push((entry.owner, entry.value));
            }
            entry.owner = cell;
            entry.value = self.blank;
        }
        &mut entry.value
    }

    /// Value of `cell`; `None` outside of the window.
    pub fn get(&self, cell: CellIndex) -> Option<&T> {
        self.slot(cell).map(|slot| self.at(cell, slot))
    }

    /// Records that `cell` at `slot` has changed.
    pub fn mark_changed(&mut self, cell: CellIndex, slot: Slot) {
        if !std::mem::replace(&mut self.entries[slot.0].is_changed, true) {
            self.changed.push(cell);
        }
    }

    /// Cells changed since the last call, with their newest values, in the order of their first
    /// change; those that lost their entry come first.
    pub fn take_changed(&mut self) -> Vec<(CellIndex, T)> {
        let mut taken = std::mem::take(&mut self.departed);
        for cell in std::mem::take(&mut self.changed) {
            let entry = self.entry_index(cell);
            let entry = &mut self.entries[entry];
            // A cell that lost its entry is in `departed`; one that returned may be listed twice.
            if entry.owner == cell && std::mem::take(&mut entry.is_changed) {
                taken.push((cell, entry.value));
            }
        }
        taken
    }

    /// Blanks every cell; discards untaken changes.
    pub fn erase(&mut self) {
        for entry in &mut self.entries {
            entry.owner = NO_OWNER;
            entry.is_changed = false;
        }
        self.changed.clear();
        self.departed.clear();
    }

    /// Every cell of the window, row by row.
    pub fn iter(&self) -> impl Iterator<Item = (CellIndex, &T)> {
        let [columns, rows] = self.sides;
        let cells = self.first.into_iter().flat_map(move |first| {
            (0..rows).flat_map(move |row| {
                (0..columns).map(move |column| CellIndex {
                    x: first.x + column,
                    y: first.y + row,
                })
            })
        });
        cells.filter_map(|cell| Some((cell, self.get(cell)?)))
    }
}

/// Cells of the window of so many columns and rows from `from` that are not in the one from `other`.
pub(super) fn difference(
    from: CellIndex,
    other: CellIndex,
    [columns, rows]: [i32; 2],
) -> impl Iterator<Item = CellIndex> {
    let row = move |y: i32| {
        // In a row of both windows, only the columns beyond the other.
        let columns = if (0..rows).contains(&y.wrapping_sub(other.y)) {
            beyond(from.x, other.x, columns)
        } else {
            from.x..from.x + columns
        };
        columns.map(move |x| CellIndex { x, y })
    };
    (from.y..from.y + rows).flat_map(row)
}

/// The part of `from .. from + side` outside of `other .. other + side`.
fn beyond(from: i32, other: i32, side: i32) -> std::ops::Range<i32> {
    if other >= from {
        from..other.min(from + side)
    } else {
        (other + side).max(from)..from + side
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;

    const fn cell(x: i32, y: i32) -> CellIndex {
        CellIndex { x, y }
    }

    fn set(grid: &mut RollingGrid<u32>, at: CellIndex, value: u32) {
        let slot = grid.slot(at).unwrap();
        *grid.at_mut(at, slot) = value;
        grid.mark_changed(at, slot);
    }

    #[test]
    fn cells_stay_where_they_are_while_the_window_moves() {
        let mut grid = RollingGrid::new([5, 5], 0);
        assert_eq!(grid.get(cell(0, 0)), None, "no window yet");
        grid.center_on(cell(0, 0));
        set(&mut grid, cell(2, -2), 7);
        set(&mut grid, cell(-2, 0), 8);
        grid.center_on(cell(1, 0));
        assert_eq!(grid.get(cell(2, -2)), Some(&7));
        assert_eq!(grid.get(cell(3, 0)), Some(&0), "an entering cell is blank");
        assert_eq!(grid.get(cell(-2, 0)), None);
        set(&mut grid, cell(3, 0), 9);
        // The departed cell keeps its last value.
        assert_eq!(
            grid.take_changed(),
            [(cell(-2, 0), 8), (cell(2, -2), 7), (cell(3, 0), 9)]
        );
        assert_eq!(grid.take_changed(), []);
        grid.center_on(cell(0, 0));
        assert_eq!(grid.get(cell(-2, 0)), Some(&0), "its place was taken");
    }

    proptest! {
        /// Compared with a map: a read gives the last value or, for cells that left the window,
        /// possibly blank; every last value is published.
        #[test]
        fn the_window_shows_the_last_values_and_publishes_them_all(
            steps in prop::collection::vec((-9..9i32, -9..9i32, -3..4i32, -2..3i32), 1..40),
        ) {
            let mut grid = RollingGrid::new([7, 5], 0);
            let mut stayed: BTreeMap<(i32, i32), u32> = BTreeMap::new();
            let mut published: BTreeMap<(i32, i32), u32> = BTreeMap::new();
            let mut expected: BTreeMap<(i32, i32), u32> = BTreeMap::new();
            let mut center = cell(0, 0);
            for (n, (dx, dy, x, y)) in (1..).zip(steps) {
                center = cell(center.x + dx, center.y + dy);
                grid.center_on(center);
                stayed.retain(|&(x, y), _| {
                    (x - center.x).abs() <= 3 && (y - center.y).abs() <= 2
                });
                let at = cell(center.x + x, center.y + y);
                set(&mut grid, at, n);
                stayed.insert((at.x, at.y), n);
                expected.insert((at.x, at.y), n);
                for (at, &value) in grid.iter() {
                    let key = (at.x, at.y);
                    match stayed.get(&key) {
                        Some(&last) => prop_assert_eq!(value, last),
                        None => prop_assert!(value == 0 || Some(&value) == expected.get(&key)),
                    }
                }
                if n % 3 == 0 {
                    published.extend(grid.take_changed().iter().map(|(at, v)| ((at.x, at.y), *v)));
                    prop_assert_eq!(&published, &expected);
                }
            }
        }
    }
}
