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
pub(super) struct ShoreSelection {
    hovered: Option<ShoreMark>,
    selected: Option<ShoreMark>,
    /// Chosen, and not looked at closely yet.
    approach_target: Option<ShoreMark>,
}

impl ShoreSelection {
    /// What stands out: what was chosen stays whatever the hand is over.
    pub(super) fn shown(&self) -> Vec<ShoreMark> {
        let hovered = self.hovered.filter(|mark| self.selected != Some(*mark));
        self.selected.into_iter().chain(hovered).collect()
    }

    pub(super) const fn selected(&self) -> Option<ShoreMark> {
        self.selected
    }

    pub(super) const fn hovered(&self) -> Option<ShoreMark> {
        self.hovered
    }

    pub(super) const fn hover(&mut self, mark: Option<ShoreMark>) {
        self.hovered = mark;
    }

    pub(super) const fn select(&mut self, mark: ShoreMark) {
        self.selected = Some(mark);
        self.approach_target = Some(mark);
    }

    /// Lets go of what was chosen and is gone.
    pub(super) fn retain(&mut self, is_there: impl Fn(ShoreMark) -> bool) {
        self.selected = self.selected.filter(|mark| is_there(*mark));
    }

    /// What was chosen since it was asked last.
    pub(super) const fn take_approach_target(&mut self) -> Option<ShoreMark> {
        self.approach_target.take()
    }
}
