//! Docking sites keep their names while another robot, or a recording, is shown.

use protocol::tile::BootId;

use super::ConsoleModel;
use super::site_names::SiteNames;

/// Names of docking sites of a robot that is not shown.
#[derive(Clone, Debug)]
pub struct KeptSiteNames {
    boot: BootId,
    epoch: Option<u32>,
    names: SiteNames,
}

impl ConsoleModel {
    /// The names of docking sites, for [`Self::keep_site_names`] when this robot is shown again. Nothing is named here any more.
    pub fn take_site_names(&mut self) -> Option<KeptSiteNames> {
        let boot = self.map.boot()?;
        let (epoch, names) = self.shores.take_names();
        Some(KeptSiteNames { boot, epoch, names })
    }

    /// Names docking sites as before, where they turn out to be of the same maps of the same run of the robot.
    pub fn keep_site_names(&mut self, kept: KeptSiteNames) {
        self.kept_names = Some(kept);
        self.go_on_with_names();
    }

    pub(super) fn go_on_with_names(&mut self) {
        let of_this_run = self
            .kept_names
            .take_if(|kept| self.map.boot() == Some(kept.boot));
        if let Some(kept) = of_this_run
            && !self.shores.go_on_with(kept.epoch, &kept.names)
        {
            // Its maps are not told of yet, or are others.
            self.kept_names = Some(kept);
        }
    }
}
