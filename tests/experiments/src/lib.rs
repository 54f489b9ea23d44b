//! The experiments of the three documents, in simulated worlds whose truth is known (`docs/methods.md` §8).
//!
//! Each runs through the same path as a recording ([`run`]) and is judged against the world's exact
//! geometry; what came out is an [`Outcome`], plain data that [`report`] writes as a page with pictures.
//! \[LOD\] is *LADAR mapping and obstacle detection*, \[HYB\] *Hybrid 3D perception for land and water*,
//! \[LRF\] *Mapping using a laser range finder*.

pub mod command;
pub mod outcome;
pub mod run;
pub mod session;

mod land;
mod rooms;
mod shores;
mod terrain;

mod e1;
mod e2;
mod e3;
mod e4;
mod e5;
mod e6;
mod h1;
mod h2;
mod h3;
mod h4;
mod h5;
mod h6;
mod l1;
mod l2;

pub mod pictures;
mod published;
pub mod report;
mod spread;
mod voxel_views;

use std::fmt;
use std::str::FromStr;

use protocol::mosaic::MosaicError;
use protocol::tile_store::StoreError;

use edge::config::ConfigError;
use edge::config::overrides::OverrideError;
use edge::exit::{Interrupted, UsageError};
use edge::publishing::publisher::PublishError;
use simulation::truth::TruthError;
use simulation::{OptionError, WorldError};

pub use outcome::Outcome;
pub use session::Session;

/// One experiment of the table in `docs/methods.md` §8.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Experiment {
    /// Cells of four sizes.
    E1,
    /// A bare floor.
    E2,
    /// Down a ramp.
    E3,
    /// 4.2 m and 20 m straight.
    E4,
    /// Pitch and roll on objects.
    E5,
    /// A turn beside glass.
    E6,
    /// A tilting laser whose encoder lags.
    H1,
    /// Slopes, a canopy and holes.
    H2,
    /// Rocks, trunks, tall grass and twigs.
    H3,
    /// Shores of a lake.
    H4,
    /// A dock between overgrown shores.
    H5,
    /// A person walks through.
    H6,
    /// A horizontal laser in rooms.
    L1,
    /// A reflective surface.
    L2,
}

/// No experiment has this name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no experiment is called `{name}`: there are {known}", known = Experiment::ALL.map(Experiment::id).join(", "))]
pub struct UnknownExperiment {
    /// What was asked for.
    pub name: String,
}

/// Why an experiment could not be run. What it shows is no error, whatever it is.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// There is no such world.
    #[error(transparent)]
    World(#[from] WorldError),
    /// The vehicle's configuration is none.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A setting over it cannot be understood.
    #[error(transparent)]
    Setting(#[from] OverrideError),
    /// The configuration does not fit the vehicle.
    #[error(transparent)]
    Usage(#[from] UsageError),
    /// An option of the simulation makes no sense.
    #[error(transparent)]
    Option(#[from] OptionError),
    /// The truth of this world cannot be had.
    #[error(transparent)]
    Truth(#[from] TruthError),
    /// The map could not be published.
    #[error(transparent)]
    Publish(#[from] PublishError),
    /// Recording or publishing failed.
    #[error(transparent)]
    Pipeline(#[from] anyhow::Error),
    /// A layer to be shown does not fit into a store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A layer to be shown makes no picture.
    #[error(transparent)]
    Mosaic(#[from] MosaicError),
    /// The world or the vehicle is not what the experiment is made for.
    #[error("{0}")]
    Unsuitable(String),
    /// Somebody stopped it.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}

impl Experiment {
    /// All of them, in the order of the table.
    pub const ALL: [Self; 14] = [
        Self::E1,
        Self::E2,
        Self::E3,
        Self::E4,
        Self::E5,
        Self::E6,
        Self::H1,
        Self::H2,
        Self::H3,
        Self::H4,
        Self::H5,
        Self::H6,
        Self::L1,
        Self::L2,
    ];

    /// What the table calls it.
    pub const fn id(self) -> &'static str {
        match self {
            Self::E1 => "E1",
            Self::E2 => "E2",
            Self::E3 => "E3",
            Self::E4 => "E4",
            Self::E5 => "E5",
            Self::E6 => "E6",
            Self::H1 => "H1",
            Self::H2 => "H2",
            Self::H3 => "H3",
            Self::H4 => "H4",
            Self::H5 => "H5",
            Self::H6 => "H6",
            Self::L1 => "L1",
            Self::L2 => "L2",
        }
    }

    /// What it is about.
    pub const fn title(self) -> &'static str {
        match self {
            Self::E1 => "Sizes of cells, in a hall",
            Self::E2 => "The reference plane",
            Self::E3 => "The ground plane changes its orientation",
            Self::E4 => "Straight on",
            Self::E5 => "Attitudes on objects",
            Self::E6 => "A left turn",
            Self::H1 => "A lagging encoder",
            Self::H2 => "Slope costs in a yard",
            Self::H3 => "What gives way in a meadow",
            Self::H4 => "Shores of a lake",
            Self::H5 => "A dock",
            Self::H6 => "A person walks through",
            Self::L1 => "Occupied and free cells agree with the truth",
            Self::L2 => "A reflective surface",
        }
    }

    /// Document and section that it repeats.
    pub const fn source(self) -> &'static str {
        match self {
            Self::E1 => "[LOD 5.1]",
            Self::E2 => "[LOD 5.2]",
            Self::E3 => "[LOD 5.3]",
            Self::E4 => "[LOD 5.4]",
            Self::E5 => "[LOD 5.5]",
            Self::E6 => "[LOD 5.6]",
            Self::H1 => "[HYB 8.1]",
            Self::H2 => "[HYB 8.2]",
            Self::H3 => "[HYB 8.4.1]",
            Self::H4 => "[HYB 8.4.2]",
            Self::H5 => "[HYB 8.2.2]",
            Self::H6 => "[LOD 6]",
            Self::L1 | Self::L2 => "[LRF]",
        }
    }

    /// What it must show, in the words of the table.
    pub const fn criterion(self) -> &'static str {
        match self {
            Self::E1 => {
                "pillar-to-wall distance 1.7 m within one cell; table of time and memory per size"
            }
            Self::E2 => "every cell within ± 3 cm and Free",
            Self::E3 => {
                "false obstacles before; after the reset ≥ 95 % of the swept ramp Free; bumps do not reset"
            }
            Self::E4 => {
                "with true odometry: wall distances constant within one cell, no holes among swept cells; with the document's encoder errors (4.8 %, 7 %): shown, not gated"
            }
            Self::E5 => "false obstacles with compensation 0; without it, many (both shown)",
            Self::E6 => {
                "the walls that were mapped before the turn cover ≤ 1.05 × as many cells after it (no drag); glass lets beams through, as in the document"
            }
            Self::H1 => "two ground surfaces without, one with the time offset",
            Self::H2 => {
                "cost as in §4; canopy above the vehicle no obstacle, low branch an obstacle"
            }
            Self::H3 => "rock and trunk lethal, grass and twigs traversable",
            Self::H4 => {
                "≥ 12 clusters; ≥ 95 % of clusters right over 20 seeds, and never Solid called Sparse"
            }
            Self::H5 => "the ramp is found as a docking site; overgrown shores are not",
            Self::H6 => "no trail 10 s after; walls stay",
            Self::L1 => {
                "occupied/free cells agree with truth ≥ 99 % of observed cells away from edges"
            }
            Self::L2 => "errors vanish with further observations",
        }
    }

    /// Runs it.
    ///
    /// # Errors
    /// Where it could not be run to its end; an experiment that fails is an [`Outcome`].
    pub fn run(self, session: &Session<'_>) -> Result<Outcome, ExperimentError> {
        match self {
            Self::E1 => e1::run(session),
            Self::E2 => e2::run(session),
            Self::E3 => e3::run(session),
            Self::E4 => e4::run(session),
            Self::E5 => e5::run(session),
            Self::E6 => e6::run(session),
            Self::H1 => h1::run(session),
            Self::H2 => h2::run(session),
            Self::H3 => h3::run(session),
            Self::H4 => h4::run(session),
            Self::H5 => h5::run(session),
            Self::H6 => h6::run(session),
            Self::L1 => l1::run(session),
            Self::L2 => l2::run(session),
        }
    }
}

impl fmt::Display for Experiment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.id())
    }
}

impl FromStr for Experiment {
    type Err = UnknownExperiment;

    /// Its [`id`](Self::id), in capitals or not.
    fn from_str(text: &str) -> Result<Self, UnknownExperiment> {
        let named = |experiment: &Self| experiment.id().eq_ignore_ascii_case(text);
        Self::ALL
            .into_iter()
            .find(named)
            .ok_or_else(|| UnknownExperiment {
                name: text.to_owned(),
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_experiment_is_found_by_its_id() {
        for experiment in Experiment::ALL {
            assert_eq!(experiment.id().parse(), Ok(experiment));
            assert_eq!(experiment.id().to_lowercase().parse(), Ok(experiment));
        }
        assert!(Experiment::ALL.is_sorted());
        let error = "E9".parse::<Experiment>().unwrap_err().to_string();
        assert!(
            error.contains("`E9`") && error.contains("H6, L1, L2"),
            "{error}"
        );
        assert!("".parse::<Experiment>().is_err());
    }
}
