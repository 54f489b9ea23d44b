//! Docking sites keep their names while another robot, or a recording, is shown.

use protocol::tile::BootId;

use super::ConsoleModel;
use super::site_names::SiteNames;

/// Names of docking sites of a robot that is not shown.
#[derive(Clone, Debug)]
pub struct SavedSiteNames {
    boot: BootId,
    epoch: Option<u32>,
    names: SiteNames,
}

impl ConsoleModel {
    /// The names of docking sites, for [`Self::restore_site_names`] when this robot is shown again. Nothing is named here any more.
    pub fn take_site_names(&mut self) -> Option<SavedSiteNames> {
        let boot = self.map.boot()?;
        let (epoch, names) = self.shores.take_names();
        Some(SavedSiteNames { boot, epoch, names })
    }

    /// Names docking sites as before, where they turn out to be of the same maps of the same run of the robot.
    pub fn restore_site_names(&mut self, kept: SavedSiteNames) {
        self.saved_site_names = Some(kept);
        self.restore_names();
    }

    pub(super) fn restore_names(&mut self) {
        let of_this_run = self
            .saved_site_names
            .take_if(|kept| self.map.boot() == Some(kept.boot));
        if let Some(kept) = of_this_run
            && !self.shores.restore(kept.epoch, &kept.names)
        {
            // Its maps are not told of yet, or are others.
            self.saved_site_names = Some(kept);
        }
    }
}
