//! The commands that map, and their options.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::str::FromStr;

use clap::Args;
use clap::builder::NonEmptyStringValueParser;
use nalgebra::{Isometry2, Vector2};
use protocol::keys::RobotId;

use crate::config::Override;
use crate::exit::UsageError;
use crate::pacer::Rate;
use recording::ros::middleware::MAX_DOMAIN;

/// `run`.
#[derive(Clone, Debug, PartialEq, Args)]
pub struct RunLive {
    /// Its ROS 2 system.
    #[command(flatten)]
    pub ros: RosOptions,
    /// Look so long for the sensors, seconds
    #[arg(long = "wait", value_name = "S", default_value = "10", value_parser = above_zero, allow_negative_numbers = true)]
    pub wait_s: f64,
    /// How it is driven.
    #[command(flatten)]
    pub driving: DrivingOptions,
    /// Options of every command that maps.
    #[command(flatten)]
    pub mapping: MappingOptions,
}

/// `replay`.
#[derive(Clone, Debug, PartialEq, Args)]
pub struct Replay {
    /// MCAP or .db3 with ROS 2 messages, ROS 1 bag, CARMEN log, or .pcap with the packets of a lidar
    pub recording: PathBuf,
    /// Poses of the sensor beside the recording: KITTI (a row of 12 numbers for each cloud) or TUM (8, with time)
    #[arg(long, value_name = "FILE")]
    pub poses: Option<PathBuf>,
    /// Times as fast as it was recorded, or `max`
    #[arg(long, value_name = "1|2.5|max", default_value = "max", value_parser = str::parse::<Rate>, allow_negative_numbers = true)]
    pub rate: Rate,
    /// Begin again at the end, until interrupted
    #[arg(long = "loop")]
    pub repeat: bool,
    /// Skip this much of the recording, seconds
    #[arg(long = "start", value_name = "S", default_value = "0", value_parser = seconds_from_zero, allow_negative_numbers = true)]
    pub start_s: f64,
    /// Stop after this much of the recording, seconds
    #[arg(long = "duration", value_name = "S", value_parser = above_zero, allow_negative_numbers = true)]
    pub duration_s: Option<f64>,
    /// Options of every command that maps.
    #[command(flatten)]
    pub mapping: MappingOptions,
}

/// `simulate`.
#[derive(Clone, Debug, PartialEq, Args)]
pub struct Simulate {
    /// Name of a world, or a world file
    #[arg(value_parser = NonEmptyStringValueParser::new())]
    pub world: String,
    /// What chance starts from: the same seed gives the same run
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Stop after this much simulated time, seconds
    #[arg(long = "duration", value_name = "S", value_parser = above_zero, allow_negative_numbers = true)]
    pub duration_s: Option<f64>,
    /// Times as fast as real time, or `max`
    #[arg(long, value_name = "1|max", default_value = "1", value_parser = str::parse::<Rate>, allow_negative_numbers = true)]
    pub rate: Rate,
    /// Let operators drive it at any rate: for hours of driving in minutes. Its world goes faster than their reactions
    #[arg(long, hide = true)]
    pub drive_at_any_rate: bool,
    /// Where maps are published.
    #[command(flatten)]
    pub ros: RosOptions,
    /// How it is driven.
    #[command(flatten)]
    pub driving: DrivingOptions,
    /// Options of every command that maps.
    #[command(flatten)]
    pub mapping: MappingOptions,
}

/// The ROS 2 system.
#[derive(Clone, Debug, Default, PartialEq, Eq, Args)]
pub struct RosOptions {
    /// The ROS 2 system's Zenoh router or bridge, for sensors, `[ros2_output]` and `[planner]` [default: of `run`, tcp/localhost:7447, unless
    /// the vehicle has devices of its own and publishes nothing; `simulate` publishes only with this option]
    #[arg(long = "ros", value_name = "ENDPOINT", value_parser = NonEmptyStringValueParser::new())]
    pub endpoint: Option<String>,
    /// Its domain [default: what `ROS_DOMAIN_ID` says, or 0]
    #[arg(long = "ros-domain", value_name = "N", value_parser = clap::value_parser!(u32).range(..=i64::from(MAX_DOMAIN)))]
    pub domain: Option<u32>,
}

/// How the vehicle is driven.
#[derive(Clone, Debug, Default, PartialEq, Eq, Args)]
pub struct DrivingOptions {
    /// Log every round of the loop that drives: the request, the output to the motors, and why; where there is such a file,
    /// in `FILE-2.csv`, `FILE-3.csv` …
    #[arg(long, value_name = "FILE.csv", conflicts_with = "no_network")]
    pub drive_log: Option<PathBuf>,
    /// Keep an emergency stop here, so that it outlives this program [default: of `run`, `$STATE_DIRECTORY`, or
    /// `foreshore/ROBOT` in `$XDG_STATE_HOME` or `~/.local/state`; `simulate` forgets it at the end]
    #[arg(long, value_name = "DIR", conflicts_with = "no_network")]
    pub state_dir: Option<PathBuf>,
    /// Let operators start and stop recordings, which go here in files of a minute, and go on after a crash
    #[arg(long, value_name = "DIR", conflicts_with = "no_network")]
    pub recordings: Option<PathBuf>,
    /// Let operators save the map of matched scans here, each under a name, to go on in it with `--map`
    #[arg(long, value_name = "DIR", conflicts_with = "no_network")]
    pub maps: Option<PathBuf>,
}

/// Which vehicle, and how it is set up.
#[derive(Clone, Debug, Default, PartialEq, Args)]
pub struct VehicleOptions {
    /// Vehicle: a preset (see `robot-edge vehicles`) or a configuration file
    #[arg(long, value_name = "NAME|FILE", value_parser = NonEmptyStringValueParser::new())]
    pub vehicle: Option<String>,
    /// Override one setting: `mapping.occupancy.cell_m=0.05`; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = str::parse::<Override>)]
    pub settings: Vec<Override>,
    /// Topic of a sensor, where several fit: `laser=/scan`; may be repeated
    #[arg(long = "topic", value_name = "ROLE=NAME", value_parser = Override::topic)]
    pub topics: Vec<Override>,
}

/// Options of every command that maps.
#[derive(Clone, Debug, PartialEq, Args)]
pub struct MappingOptions {
    /// Which vehicle.
    #[command(flatten)]
    pub setup: VehicleOptions,
    /// Name of this robot: letters, digits, `_` and `-`
    #[arg(long, value_name = "ID")]
    pub robot: Option<RobotId>,
    /// How consoles reach it.
    #[command(flatten)]
    pub network: NetworkOptions,
    /// Write everything that comes in to a recording; where there is such a file, to `FILE-2.mcap`, `FILE-3.mcap` …
    #[arg(long, value_name = "FILE.mcap")]
    pub record: Option<PathBuf>,
    /// Write the maps at the end; with `--keep-serving`, when it is stopped
    #[arg(long, value_name = "DIR")]
    pub export: Option<PathBuf>,
    /// Let Foxglove connect here over its WebSocket protocol and show maps, scans, poses and events. Nobody is
    /// authenticated, and nobody can drive by it. Other addresses than 127.0.0.1 need --insecure
    #[arg(long, value_name = "127.0.0.1:8765", hide = !cfg!(feature = "foxglove"))]
    pub foxglove: Option<SocketAddr>,
    /// Maps to go on in.
    #[command(flatten)]
    pub map: MapOptions,
    /// Write figures of the run at the end
    #[arg(long, value_name = "FILE.json")]
    pub summary: Option<PathBuf>,
}

impl MappingOptions {
    /// Where Foxglove connects to: as open to other machines as the rest of the network.
    pub fn foxglove_address(&self) -> Result<Option<SocketAddr>, UsageError> {
        match self.foxglove {
            Some(at) if !at.ip().is_loopback() && !self.network.insecure => {
                Err(UsageError(format!(
                    "--foxglove {at}: other machines could watch without a key. Listen on 127.0.0.1 and forward the port \
                 (ssh -L), or say --insecure"
                )))
            }
            at => Ok(at),
        }
    }
}

/// Maps of matched scans (localization.source = "scan…") that outlive a run.
#[derive(Clone, Debug, Default, PartialEq, Args)]
pub struct MapOptions {
    /// Save the map to this new folder at the end, to go on in it
    #[arg(long, value_name = "DIR")]
    pub save_map: Option<PathBuf>,
    /// Go on in a saved map, once the vehicle is found in it by its scans
    #[arg(long = "map", value_name = "DIR")]
    pub folder: Option<PathBuf>,
    /// About where the vehicle is in it, within 3 m and 45°: metres and degrees [default: anywhere]
    #[arg(long = "near", value_name = "X,Y,YAW", requires = "folder", allow_hyphen_values = true, value_parser = str::parse::<PlanarPose>)]
    pub near: Option<PlanarPose>,
}

/// `X,Y,YAW`, metres and degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanarPose(pub Isometry2<f64>);

impl FromStr for PlanarPose {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split(',').map(|number| number.trim().parse::<f64>());
        let numbers: Vec<f64> = numbers
            .filter_map(Result::ok)
            .filter(|n| n.is_finite())
            .collect();
        match (&numbers[..], text.split(',').count()) {
            (&[x_m, y_m, yaw_deg], 3) => Ok(Self(Isometry2::new(
                Vector2::new(x_m, y_m),
                yaw_deg.to_radians(),
            ))),
            _ => Err(
                "a pose is x and y in metres and the heading in degrees: `12.5,-3,90`".to_owned(),
            ),
        }
    }
}

/// How consoles reach the robot.
#[derive(Clone, Debug, Default, PartialEq, Eq, Args)]
pub struct NetworkOptions {
    /// Listen here for consoles: `quic/HOST:PORT` with --keys, `tcp/HOST:PORT` without, tiles at the next port
    /// [default: this machine only, port 7447]; may be repeated
    #[arg(long, value_name = "ENDPOINT")]
    pub listen: Vec<String>,
    /// Connect to a Zenoh router here; may be repeated
    #[arg(long, value_name = "ENDPOINT")]
    pub connect: Vec<String>,
    /// Who this vehicle is and who may watch and drive it: its folder of `robot-edge keys`
    #[arg(long, value_name = "DIR")]
    pub keys: Option<PathBuf>,
    /// Without keys, let anybody who reaches the listener watch and drive: nothing is encrypted, nobody proves who they
    /// are
    #[arg(long, conflicts_with = "keys")]
    pub insecure: bool,
    /// Zenoh configuration (JSON5) that ours is laid over [default: what `ZENOH_CONFIG` names]
    #[arg(long, value_name = "FILE")]
    pub zenoh_config: Option<PathBuf>,
    /// Do not open the network
    #[arg(long, conflicts_with_all = ["listen", "connect", "keys", "insecure", "zenoh_config", "keep_serving"])]
    pub no_network: bool,
    /// Go on serving the map when the data has ended, until interrupted; a simulated vehicle that can be driven goes on
    /// measuring instead
    #[arg(long)]
    pub keep_serving: bool,
}

impl VehicleOptions {
    /// Everything that overrides the vehicle's configuration, weakest first.
    pub fn overrides(&self) -> Vec<Override> {
        self.settings.iter().chain(&self.topics).cloned().collect()
    }
}

fn seconds_from_zero(text: &str) -> Result<f64, String> {
    finite(text)
        .filter(|&secs| secs >= 0.0)
        .ok_or_else(|| "seconds are a number, 0 or more".to_owned())
}

pub(super) fn above_zero(text: &str) -> Result<f64, String> {
    finite(text)
        .filter(|&secs| secs > 0.0)
        .ok_or_else(|| "expected a number above 0".to_owned())
}

fn finite(text: &str) -> Option<f64> {
    text.parse().ok().filter(|number: &f64| number.is_finite())
}
