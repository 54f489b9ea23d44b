//! Each robot keeps its colour, whoever else is on the network.

use std::collections::BTreeMap;

use eframe::egui::Color32;
use protocol::keys::RobotId;
use serde::{Deserialize, Serialize};

/// Okabe and Ito's series without black, and so that neighbours differ most: told apart with every kind of colour vision,
/// and on light and dark. Vermilion comes first, as on maps of recordings, and orange last, which is the nearest to it.
const SERIES: [(u8, u8, u8); 7] = [
    (0xd5, 0x5e, 0x00),
    (0x00, 0x72, 0xb2),
    (0x00, 0x9e, 0x73),
    (0xcc, 0x79, 0xa7),
    (0x56, 0xb4, 0xe9),
    (0xf0, 0xe4, 0x42),
    (0xe6, 0x9f, 0x00),
];
/// Robots whose colours are remembered.
const MAX_ROBOTS: usize = 256;

/// Which robot has which colour of the series.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct RobotColors(BTreeMap<String, u8>);

impl RobotColors {
    /// The robot's colour; its own from now on. The one that fewest robots have is given.
    pub fn of(&mut self, robot: &RobotId) -> Color32 {
        let known = self.0.get(robot.as_str()).copied();
        let index = known.unwrap_or_else(|| {
            let uses = |index: u8| self.0.values().filter(|used| **used == index).count();
            let index = (0..SERIES.len() as u8)
                .min_by_key(|index| uses(*index))
                .unwrap_or(0);
            self.0.insert(robot.as_str().to_owned(), index);
            self.limit();
            index
        });
        let (red, green, blue) = SERIES[usize::from(index) % SERIES.len()];
        Color32::from_rgb(red, green, blue)
    }

    pub(super) fn limit(&mut self) {
        while self.0.len() > MAX_ROBOTS {
            self.0.pop_first();
        }
    }
}
