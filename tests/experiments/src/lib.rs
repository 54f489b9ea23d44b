//! The experiments of the three documents, in simulated worlds whose truth is known (`docs/methods.md` §8).
//!
//! Each runs through the same path as a recording ([`run`]) and is judged against the world's exact
//! geometry; the result is an [`Outcome`], plain data that [`report`] writes as a page with pictures.
//! \[LOD\] is *LADAR mapping and obstacle detection*, \[HYB\] *Hybrid 3D perception for land and water*,
//! \[LRF\] *Mapping using a laser range finder*.

pub mod command;
pub mod outcome;
pub mod run;
pub mod session;

mod land;
mod lidars;
mod random_shores;
mod rooms;
mod shore_force;
mod shores;
mod terrain;
mod truth;

mod d1;
mod d2;
mod d3;
mod e1;
mod e2;
mod e3;
mod e4;
mod e5;
mod e6;
mod e7;
mod e8;
mod e9;
mod h1;
mod h2;
mod h3;
mod h4;
mod h5;
mod h6;
mod h7;
mod h8;
mod l1;
mod l2;
mod l3;
mod p1;

pub mod pictures;
pub mod report;
mod voxel_views;

pub use outcome::Outcome;
pub use session::Session;

/// One experiment of the table in `docs/methods.md` §8.
pub struct Experiment {
    pub id: &'static str,
    pub title: &'static str,
    /// Document and section that it repeats.
    pub source: &'static str,
    /// What it must show, in the words of the table.
    pub criterion: &'static str,
    /// Fails only if it could not be run to its end; an experiment that does not pass is an [`Outcome`].
    pub run: fn(&Session<'_>) -> anyhow::Result<Outcome>,
}

impl Experiment {
    /// The experiment of this [`id`](Self::id), in capitals or not.
    pub fn of_id(id: &str) -> Option<&'static Self> {
        EXPERIMENTS
            .iter()
            .find(|experiment| experiment.id.eq_ignore_ascii_case(id))
    }
}

/// All of them, in the order of the table.
pub static EXPERIMENTS: [Experiment; 24] = [
    Experiment {
        id: "E1",
        title: "Sizes of cells, in a hall",
        source: "[LOD 5.1]",
        criterion: "pillar-to-wall distance 1.7 m within one cell; table of time and memory per size",
        run: e1::run,
    },
    Experiment {
        id: "E2",
        title: "The reference plane",
        source: "[LOD 5.2]",
        criterion: "every cell within ± 3 cm and Free",
        run: e2::run,
    },
    Experiment {
        id: "E3",
        title: "The ground plane changes its orientation",
        source: "[LOD 5.3]",
        criterion: "false obstacles before; after the reset ≥ 95 % of the swept ramp Free; bumps do not reset",
        run: e3::run,
    },
    Experiment {
        id: "E4",
        title: "Straight on",
        source: "[LOD 5.4]",
        criterion: "with true odometry: wall distances constant within one cell, no holes among swept cells; \
                    with the document's encoder errors (4.8 %, 7 %): shown, not gated",
        run: e4::run,
    },
    Experiment {
        id: "E5",
        title: "Attitudes on objects",
        source: "[LOD 5.5]",
        criterion: "false obstacles with compensation 0; without it, many (both shown)",
        run: e5::run,
    },
    Experiment {
        id: "E6",
        title: "A left turn",
        source: "[LOD 5.6]",
        criterion: "the walls that were mapped before the turn cover ≤ 1.05 × as many cells after it (no drag); \
                    glass lets beams through, as in the document",
        run: e6::run,
    },
    Experiment {
        id: "E7",
        title: "Gentle slopes",
        source: "[LOD 6.2]",
        criterion: "above the local ground ≤ 2 % of a ramp, a bank and a crowned road are obstacles, and every block on \
                    them is; above one plane more",
        run: e7::run,
    },
    Experiment {
        id: "E8",
        title: "Grass",
        source: "[LOD 6.2]",
        criterion: "grass is an obstacle, and with a least width of obstacles ≤ 20 % of it; blocks in it stay obstacles",
        run: e8::run,
    },
    Experiment {
        id: "E9",
        title: "Looking where the map is blind",
        source: "[LOD 6.2]",
        criterion: "after a turn on the spot a laser that is turned to what is unknown finds ≥ 99 % of the way and every block \
                    beside it in time",
        run: e9::run,
    },
    Experiment {
        id: "H1",
        title: "A lagging encoder",
        source: "[HYB 8.1]",
        criterion: "two ground surfaces without, one with the time offset",
        run: h1::run,
    },
    Experiment {
        id: "H2",
        title: "Slope costs in a yard",
        source: "[HYB 8.2]",
        criterion: "cost as in §4; canopy above the vehicle no obstacle, low branch an obstacle",
        run: h2::run,
    },
    Experiment {
        id: "H3",
        title: "What gives way in a meadow",
        source: "[HYB 8.4.1]",
        criterion: "rock and trunk lethal, grass and twigs traversable",
        run: h3::run,
    },
    Experiment {
        id: "H4",
        title: "Shores of a lake",
        source: "[HYB 8.4.2]",
        criterion: "≥ 12 clusters; ≥ 95 % of clusters right over 20 seeds, and never Solid called Sparse",
        run: h4::run,
    },
    Experiment {
        id: "H5",
        title: "A dock",
        source: "[HYB 8.2.2]",
        criterion: "the ramp is found as a docking site; overgrown shores are not",
        run: h5::run,
    },
    Experiment {
        id: "H6",
        title: "A person walks through",
        source: "[LOD 6]",
        criterion: "no trail 10 s after; walls stay",
        run: h6::run,
    },
    Experiment {
        id: "H7",
        title: "Sonar and laser at the waterline",
        source: "[HYB 8.1.2]",
        criterion: "a face below the waterline lies ≤ 5 cm off its part above",
        run: h7::run,
    },
    Experiment {
        id: "H8",
        title: "Shores at random",
        source: "[HYB 8.4.2]",
        criterion: "against the force of their stems on the hull: ≤ 1 % of Solid called passable; ≥ 90 % of 200 shores \
                    right where canes can be seen through",
        run: h8::run,
    },
    Experiment {
        id: "L1",
        title: "Occupied and free cells agree with the truth",
        source: "[LRF]",
        criterion: "occupied/free cells agree with truth ≥ 99 % of observed cells away from edges",
        run: l1::run,
    },
    Experiment {
        id: "L2",
        title: "A reflective surface",
        source: "[LRF]",
        criterion: "errors vanish with further observations",
        run: l2::run,
    },
    Experiment {
        id: "L3",
        title: "A recording with motion capture",
        source: "[LRF]",
        criterion: "as L1, from a file with poses of cameras; occupied cells ≥ 98 % right where seeing through a cell \
                    counts no more than a hit",
        run: l3::run,
    },
    Experiment {
        id: "P1",
        title: "Circles with wheels that slip and a compass that drifts",
        source: "[ours]",
        criterion: "the pose at the end is ≤ 10 cm off, from planar lasers, level and tilting, and from a lidar with rings; heights where the circle closes \
                    ≤ 5 cm off",
        run: p1::run,
    },
    Experiment {
        id: "D1",
        title: "A bridge, a tunnel and overhangs, with rings",
        source: "[ours]",
        criterion: "with 64 rings heights ≤ 2 cm rms, ≥ 99 % of what 3 beams meet found, ≤ 0.5 % of the ground an obstacle up to \
                    15 m; the way is free below the bridge and on it",
        run: d1::run,
    },
    Experiment {
        id: "D2",
        title: "What gives way in a thicket, with rings",
        source: "[ours]",
        criterion: "with 64 rings ≥ 90 % of grass and twigs traversable, ≥ 95 % of rocks rigid",
        run: d2::run,
    },
    Experiment {
        id: "D3",
        title: "A jetty, with rings",
        source: "[ours]",
        criterion: "with 16 rings ≥ 99 % of what 3 beams meet of deck, piles, shore and a moored boat lethal up to 20 m, ≤ 0.5 % of \
                    the water; nothing in the boat's way, also below a footbridge",
        run: d3::run,
    },
];
