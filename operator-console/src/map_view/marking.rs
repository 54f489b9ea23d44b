//! Which shore or docking site stands out on the map: what the hand is over in the list, else what it chose last.

use crate::model::SiteName;

/// One of what [`Shores`](protocol::message::Shores) tells of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShoreMark {
    /// A shore, by number.
    Shore(u32),
    /// A docking site, by the name that stays with its place.
    Site(SiteName),
}

/// See the [module](self).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Marking {
    hovered: Option<ShoreMark>,
    chosen: Option<ShoreMark>,
    /// Chosen, and not looked at closely yet.
    sought: Option<ShoreMark>,
}

impl Marking {
    pub(super) const fn shown(&self) -> Option<ShoreMark> {
        match self.hovered {
            Some(mark) => Some(mark),
            None => self.chosen,
        }
    }

    pub(super) const fn hovered(&self) -> Option<ShoreMark> {
        self.hovered
    }

    pub(super) const fn hover(&mut self, mark: Option<ShoreMark>) {
        self.hovered = mark;
    }

    pub(super) const fn choose(&mut self, mark: ShoreMark) {
        self.chosen = Some(mark);
        self.sought = Some(mark);
    }

    /// What was chosen since it was asked last.
    pub(super) const fn take_sought(&mut self) -> Option<ShoreMark> {
        self.sought.take()
    }
}
