//! How far it is to shores and docking sites, in a straight line. Pure.
//!
//! A shore is as near as the nearest edge of its [`Outline`].

use protocol::message::DockingSite;

use crate::model::Outline;

/// x and y in `odom`, metres.
type Point = [f64; 2];

/// What the numbers are, as the lists say it.
pub(super) const TO_SHORES: &str = "from the middle of the vehicle to the nearest edge of the shore's outline; \
                                    around: the vehicle is within it";
pub(super) const TO_SITES: &str =
    "from the middle of the vehicle to the middle of the docking site";

/// How far something is from the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Distance {
    /// Nobody knows where the vehicle is.
    Unknown,
    /// The vehicle is within its outline.
    Around,
    /// So many metres.
    Metres(f64),
}

impl Distance {
    /// A shore from a vehicle whose middle is there.
    pub(crate) fn of_shore(outline: &Outline, vehicle_m: Option<Point>) -> Self {
        match vehicle_m.map(|at_m| outline.away_m(at_m)) {
            None => Self::Unknown,
            Some(away_m) if away_m > 0.0 => Self::Metres(away_m),
            Some(_) => Self::Around,
        }
    }

    /// The middle of a docking site from a vehicle whose middle is there.
    pub(crate) fn of_site(site: &DockingSite, vehicle_m: Option<Point>) -> Self {
        vehicle_m.map_or(Self::Unknown, |at_m| {
            let [x, y] = site.center_m.map(f64::from);
            Self::Metres(libm::hypot(x - at_m[0], y - at_m[1]))
        })
    }

    /// To sort by, metres: what is not known comes last.
    pub(crate) const fn key(self) -> f64 {
        match self {
            Self::Unknown => f64::INFINITY,
            Self::Around => 0.0,
            Self::Metres(away_m) => away_m,
        }
    }

    /// As a column has it.
    pub(super) fn column(self) -> String {
        match self {
            Self::Unknown => "–".to_owned(),
            Self::Around => "around".to_owned(),
            Self::Metres(away_m) => {
                let decimals = usize::from(away_m < 9.95);
                format!("{away_m:.decimals$} m")
            }
        }
    }

    /// As a sentence ends with it.
    pub(super) fn words(self) -> String {
        match self {
            Self::Unknown => "distance unknown".to_owned(),
            Self::Around => "around the vehicle".to_owned(),
            Self::Metres(_) => format!("{} away", self.column()),
        }
    }
}

#[cfg(test)]
mod tests {
    use protocol::message::{ShoreClass, ShoreCluster, Shores};

    use super::*;
    use crate::model::ShoreOutlines;

    /// A shore of such corners, half a metre a cell: `(2, 4)` are 1 m and 2 m.
    fn outlines(center_m: [f32; 2], outline: &[(i32, i32)]) -> ShoreOutlines {
        let shore = ShoreCluster {
            number: 1,
            class: ShoreClass::Dense,
            voxels: 10,
            rigid_voxels: 0,
            center_m,
            outline: outline.to_vec(),
        };
        ShoreOutlines::of(&Shores::gather(0.5, None, vec![shore], Vec::new()))
    }

    #[test]
    fn a_shore_is_as_near_as_its_nearest_edge() {
        // Reeds between 5 m and 13 m in x, 0 m and 4 m in y.
        let reeds = outlines([9.0, 2.0], &[(10, 0), (26, 0), (26, 8), (10, 8)]);
        let outline = &reeds.outlines()[0];
        for (vehicle_m, expected) in [
            ([4.0, 2.0], Distance::Metres(1.0)),
            ([15.0, 3.9], Distance::Metres(2.0)),
            ([9.0, 6.5], Distance::Metres(2.5)),
            // From a corner.
            ([2.0, -4.0], Distance::Metres(5.0)),
            ([9.0, 2.0], Distance::Around),
            ([5.1, 0.1], Distance::Around),
        ] {
            let found = Distance::of_shore(outline, Some(vehicle_m));
            assert_eq!(found, expected, "{vehicle_m:?}");
        }
        assert_eq!(Distance::of_shore(outline, None), Distance::Unknown);
    }

    #[test]
    fn a_shore_without_an_outline_is_where_its_middle_is() {
        let point = outlines([3.0, 4.0], &[]);
        assert_eq!(
            Distance::of_shore(&point.outlines()[0], Some([0.0, 0.0])),
            Distance::Metres(5.0)
        );
    }

    #[test]
    fn distances_are_said_shortly_and_whole() {
        let check = |away: Distance, column: &str, words: &str| {
            assert_eq!((&*away.column(), &*away.words()), (column, words));
        };
        check(Distance::Metres(9.94), "9.9 m", "9.9 m away");
        check(Distance::Metres(9.96), "10 m", "10 m away");
        check(Distance::Around, "around", "around the vehicle");
        check(Distance::Unknown, "–", "distance unknown");
    }
}
