//! How much of a frame's time is left for making textures, so that a great map never holds up the hand that moves it.

use std::time::Duration;

use measurement::time::Monotonic;
use robot_edge::clock;

/// Of a frame, for turning tiles into colours.
const TIME: Duration = Duration::from_millis(4);
/// Whole textures that are handed to the graphics driver in a frame: a mebibyte each, about a millisecond.
const UPLOADS: usize = 3;

/// What is left.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrameTime {
    left: Left,
    uploads: usize,
}

#[derive(Clone, Copy, Debug)]
enum Left {
    Until(Monotonic),
    #[cfg(test)]
    Tiles(usize),
}

impl FrameTime {
    /// A new frame.
    pub(super) fn new() -> Self {
        Self {
            left: Left::Until(clock::now() + TIME),
            uploads: UPLOADS,
        }
    }

    /// For so many tiles, however long they take.
    #[cfg(test)]
    pub(super) const fn of_tiles(tiles: usize) -> Self {
        Self {
            left: Left::Tiles(tiles),
            uploads: usize::MAX,
        }
    }

    /// Whether another tile may be begun; it is taken off.
    pub(super) fn take_tile(&mut self) -> bool {
        match &mut self.left {
            Left::Until(end) => clock::now() < *end,
            #[cfg(test)]
            Left::Tiles(left) => {
                let has_some = *left > 0;
                *left = left.saturating_sub(1);
                has_some
            }
        }
    }

    /// Whether another whole texture may be uploaded; it is taken off.
    pub(super) fn take_upload(&mut self) -> bool {
        let has_some = self.uploads > 0;
        self.uploads = self.uploads.saturating_sub(1);
        has_some
    }
}
