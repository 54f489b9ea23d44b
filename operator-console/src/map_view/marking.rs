//! Which shores or docking sites stand out on the map: what a click in the lists showed last, and what the hand is over there.

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
    /// What stands out: what was chosen stays whatever the hand is over.
    pub(super) fn shown(&self) -> Vec<ShoreMark> {
        let hovered = self.hovered.filter(|mark| self.chosen != Some(*mark));
        self.chosen.into_iter().chain(hovered).collect()
    }

    pub(super) const fn chosen(&self) -> Option<ShoreMark> {
        self.chosen
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

    /// Lets go of what was chosen and is gone.
    pub(super) fn keep(&mut self, is_there: impl Fn(ShoreMark) -> bool) {
        self.chosen = self.chosen.filter(|mark| is_there(*mark));
    }

    /// What was chosen since it was asked last.
    pub(super) const fn take_sought(&mut self) -> Option<ShoreMark> {
        self.sought.take()
    }
}
