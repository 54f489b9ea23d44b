//! The format of world files: TOML, every key known, every error with its line.
//!
//! x, y and z are those of the world, z is up. Angles are those of a sensor's mount: roll about x, then
//! pitch about y, then yaw about z; positive pitch is nose down.
//!
//! ```toml
//! name = "yard"
//! vehicle = "holos"                   # a vehicle preset
//! start = { x_m = 0.0, y_m = 0.0, yaw_deg = 90.0 }
//!
//! [noise]
//! range_m = 0.01                      # standard deviation
//! dropout = 0.005                     # probability per beam
//! mixed_pixels = 0.3                  # default 0: probability per beam whose spot straddles an edge
//! beam_divergence_mrad = 15.0         # default: of the laser's data sheet; full angle, 0 is a line
//! attitude_deg = 0.1                  # standard deviation; default: that of the vehicle's AHRS
//! encoder_scale_error = 0.048         # default 0; this one reads 4.8 % too far
//! joint_lag_s = 0.1                   # default 0: encoders of tilting sensors say where they were so long ago
//! laser_covered_s = [20.0, 40.0]      # default: never; from when until when no beam of the main laser has an echo
//! fix_m = 0.05                        # standard deviation, heights twice; default: that of the vehicle's receiver
//!
//! [waves]                             # default: none; for boats only
//! height_m = 0.1                      # significant height: of the highest third, from trough to crest
//! period_s = 2.5                      # of the strongest waves; they are 1.56 m · period² long
//! heading_deg = 90.0                  # where they run to
//! second = { height_m = 0.03, period_s = 1.5, heading_deg = 10.0 }    # optional, on top of the first
//!
//! [path]
//! speed_mps = 0.5                     # a waypoint may say its own
//! turn_rate_degps = 60.0
//! corner_radius_m = 0.0               # default; 0 turns on the spot; a waypoint may say its own
//! waypoints = [{ x_m = 0.0, y_m = 4.0 }, { x_m = 3.0, y_m = 4.0, speed_mps = 0.2 }]
//!
//! [[solids]]
//! shape = "plane"                     # ground without end: solid below it, so no hole fits in
//! point_m = [0.0, 0.0, 0.0]           # default; a point on it
//! pitch_deg = 0.0                     # default; so are yaw_deg and roll_deg
//!
//! [[solids]]
//! shape = "wall"                      # stands on z = 0, cut square at both ends
//! from_m = [-1.0, -1.0]               # ends of its centre line
//! to_m = [5.0, -1.0]
//! thickness_m = 0.15
//! height_m = 2.5
//! reflectivity.glass = { transmission = 0.9 }     # per beam
//!
//! [[solids]]
//! shape = "box"
//! name = "crate"                      # optional, for messages; for every shape
//! centre_m = [2.0, 1.0, 0.4]
//! size_m = [1.2, 0.8, 0.8]            # along its own x, y, z
//! yaw_deg = 30.0                      # default 0; so are pitch_deg and roll_deg
//! reflectivity.specular = { probability = 0.3 }   # default: "diffuse"; for every shape
//!
//! [[solids]]
//! shape = "cylinder"                  # upright
//! base_m = [4.0, 1.0, 0.0]            # centre of its bottom; or centre_m
//! radius_m = 0.25
//! height_m = 1.75
//! # For every shape: offsets from where it stands, straight in between, at rest before and after.
//! motion = [{ t_s = 2.0, x_m = 0.0, y_m = 0.0 }, { t_s = 6.0, x_m = 0.0, y_m = 5.0 }]
//! appears_s = 2.0                     # default: there from the beginning
//! leaves_s = 6.0                      # default: there until the end
//!
//! [[solids]]
//! shape = "sphere"
//! centre_m = [3.0, 2.0, 0.3]
//! radius_m = 0.3
//!
//! [[solids]]
//! shape = "mesh"                      # a surface, seen from both sides
//! vertices_m = [[0.0, 5.0, 0.0], [1.0, 5.0, 0.0], [0.0, 6.0, 0.4]]
//! triangles = [[0, 1, 2]]             # vertices, counted from 0
//!
//! [[solids]]
//! shape = "height_field"              # a surface of two triangles between four heights
//! origin_m = [5.0, 5.0, 0.0]          # of the first height
//! spacing_m = 0.5                     # between heights, along x and y
//! heights_m = [[0.0, 0.1, 0.0], [0.0, 0.2, 0.1]]  # above the origin; rows of growing y, in a row growing x
//! # For every shape: whether it is ground, what plants and vehicles stand on, or stands on the ground.
//! ground = true                       # default: planes, meshes and height fields are, all others are not
//!
//! [water]                             # default: none
//! level_m = 0.0                       # no beam returns through its surface; what is below, sonars see
//!
//! [wind]                              # default: none
//! towards_deg = 40.0                  # where it blows to, from x towards y
//! lean = 0.05                         # of a plant of stiffness 1: its top is so far off on the mean …
//! sway = 0.1                          # … and swings by so much to either side, both by its height
//! period_s = 1.5                      # of its slowest regular swinging
//!
//! [receiver]                          # what a laser makes of thin things; where there are plants
//! min_share = 0.05                  # default; of a beam's light that must come back to be noticed
//! separation_m = 0.75                 # default; echoes nearer to each other come as one: half of 5 ns · c
//!
//! [[plants]]                          # rods as thin as they are; grown from the seed
//! kind = "stems"                      # grass, canes, twigs
//! name = "reeds"                      # optional; for every kind
//! seed = 1                            # for every kind
//! rigidity = "flexible"               # or "rigid": wind does not move it; for every kind
//! stiffness = 2.0                     # default 1; how much less than the wind says it moves; for every kind
//! rectangle_m = [[0.0, 0.0], [4.0, 2.0]]      # where: two corners, or polygon_m = [[x, y], …], or …
//! # along_m = [[0.0, 0.0], [4.0, 1.0]]        # … what is not farther from a line …
//! # width_m = 2.0                             # … than half of this
//! density_per_m2 = 30.0
//! tufts = { stems = 12, radius_m = 0.05 }     # default none: each stands where it happens to
//! height_m = [1.5, 2.2]               # least and greatest; above the ground, or water where that is higher
//! thickness_mm = [6.0, 12.0]          # of a blade: its width as seen from the side
//! lean_deg = 10.0                     # default 0; the most, without wind
//! shoots = { count = 3, length_m = [0.2, 0.4], thickness_mm = [5.0, 15.0] }   # default none; on every stem
//!
//! [[plants]]
//! kind = "crowns"                     # bushes, and what hangs above trunks: closed all around
//! seed = 2
//! rigidity = "rigid"
//! at_m = [[5.0, 5.0], [6.5, 5.2]]     # one crown each
//! radius_m = [0.7, 1.0]
//! bottom_m = [0.0, 0.0]               # default; its lowest point above the ground or water
//! height_m = [1.2, 1.8]               # from there to its top
//! branches = 30                       # in each
//! branch_thickness_mm = [20.0, 60.0]
//! leaves_per_m2 = 200.0               # of its surface
//! leaf_length_m = [0.05, 0.08]
//! leaf_thickness_mm = [30.0, 50.0]
//!
//! [[shores]]                          # the truth of what a boat finds there
//! name = "reeds in the north"
//! class = "dense"                     # or "sparse" or "solid"
//! polygon_m = [[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [0.0, 2.0]]
//!
//! [[docks]]                           # where a boat can land
//! name = "slipway"
//! polygon_m = [[10.0, 0.0], [16.0, 0.0], [16.0, 8.0], [10.0, 8.0]]
//! ```

mod plants;
mod solids;

use serde::Deserialize;
use toml::Spanned;
use toml::de::DeTable;

use super::fault::Fault;
use super::number::{
    Coordinate, HalfTurnDegrees, LagSeconds, NotNegative, Positive, Probability, ScaleError,
    WavePeriod,
};

pub(super) use plants::{
    AreaEntry, CrownsEntry, GrowthEntry, PlantsEntry, RigidityEntry, ShootsEntry, StemsEntry,
};
pub(super) use solids::{
    AnySolid, BoxEntry, CylinderEntry, HeightFieldEntry, MeshEntry, PlaneEntry, ReflectivityEntry,
    ShapeEntry, SolidEntry, SphereEntry, WallEntry,
};

/// A parsed file: the numbers are finite and within their bounds, nothing else is checked.
#[derive(Debug)]
pub(super) struct WorldFile {
    pub(super) header: Header,
    pub(super) solids: Vec<Spanned<SolidEntry>>,
    pub(super) plants: Vec<Spanned<PlantsEntry>>,
}

/// All but the solids and plants.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Header {
    pub(super) name: String,
    pub(super) vehicle: Spanned<String>,
    pub(super) noise: NoiseEntry,
    pub(super) waves: Option<Spanned<WavesEntry>>,
    pub(super) start: StartEntry,
    pub(super) path: Spanned<PathEntry>,
    pub(super) water: Option<WaterEntry>,
    pub(super) wind: Option<WindEntry>,
    #[serde(default)]
    pub(super) receiver: ReceiverEntry,
    #[serde(default)]
    pub(super) shores: Vec<ShoreEntry>,
    #[serde(default)]
    pub(super) docks: Vec<DockEntry>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct WaterEntry {
    pub(super) level_m: Coordinate,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct WindEntry {
    pub(super) towards_deg: Coordinate,
    pub(super) lean: Probability,
    pub(super) sway: Probability,
    pub(super) period_s: Positive,
}

#[derive(Debug, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct ReceiverEntry {
    pub(super) min_share: Probability,
    pub(super) separation_m: NotNegative,
}

impl Default for ReceiverEntry {
    fn default() -> Self {
        Self {
            // One cane of 5 mm across a spot of 30 cm fills 2 % of it, three fill 6 %.
            min_share: Probability(0.05),
            // A pulse of 5 ns is 1.5 m long; of echoes half as far apart the later begins as the first ends.
            separation_m: NotNegative(0.75),
        }
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ShoreEntry {
    pub(super) name: String,
    pub(super) class: ShoreClassEntry,
    pub(super) polygon_m: Spanned<Vec<[Coordinate; 2]>>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum ShoreClassEntry {
    Sparse,
    Dense,
    Solid,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DockEntry {
    pub(super) name: String,
    pub(super) polygon_m: Spanned<Vec<[Coordinate; 2]>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NoiseEntry {
    pub(super) range_m: NotNegative,
    pub(super) dropout: Probability,
    #[serde(default)]
    pub(super) mixed_pixels: Probability,
    pub(super) beam_divergence_mrad: Option<NotNegative>,
    pub(super) attitude_deg: Option<HalfTurnDegrees>,
    #[serde(default)]
    pub(super) encoder_scale_error: ScaleError,
    #[serde(default)]
    pub(super) joint_lag_s: LagSeconds,
    pub(super) fix_m: Option<NotNegative>,
    pub(super) laser_covered_s: Option<[NotNegative; 2]>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct WavesEntry {
    pub(super) height_m: Spanned<NotNegative>,
    pub(super) period_s: WavePeriod,
    pub(super) heading_deg: Coordinate,
    pub(super) second: Option<WaveTrainEntry>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct WaveTrainEntry {
    pub(super) height_m: Spanned<NotNegative>,
    pub(super) period_s: WavePeriod,
    pub(super) heading_deg: Coordinate,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StartEntry {
    pub(super) x_m: Coordinate,
    pub(super) y_m: Coordinate,
    pub(super) yaw_deg: Coordinate,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PathEntry {
    pub(super) speed_mps: Positive,
    pub(super) turn_rate_degps: Positive,
    #[serde(default)]
    pub(super) corner_radius_m: NotNegative,
    pub(super) waypoints: Vec<Spanned<WaypointEntry>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct WaypointEntry {
    pub(super) x_m: Coordinate,
    pub(super) y_m: Coordinate,
    pub(super) speed_mps: Option<Positive>,
    pub(super) corner_radius_m: Option<NotNegative>,
}

/// Parses the text of a world file.
pub(super) fn parse(text: &str) -> Result<WorldFile, Fault> {
    let mut document = DeTable::parse(text)?;
    // Taken out first: serde's own tagged enums forget where in the text their values stood.
    let solids = match document.get_mut().remove("solids") {
        Some(solids) => solids::parse(solids)?,
        None => Vec::new(),
    };
    let plants = match document.get_mut().remove("plants") {
        Some(plants) => plants::parse(plants)?,
        None => Vec::new(),
    };
    let header = Header::deserialize(toml::de::Deserializer::from(document))?;
    Ok(WorldFile {
        header,
        solids,
        plants,
    })
}
