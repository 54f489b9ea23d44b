//! The commands beside mapping: recordings, vehicles, keys, experiments.

use std::io;
use std::path::PathBuf;

use clap::builder::NonEmptyStringValueParser;
use clap::{Args, CommandFactory as _, Subcommand};
use clap_complete::Shell;
use protocol::keys::{OperatorId, RobotId};

use super::Cli;

const KEYS_FOLDER: &str = "\
What is where in DIR, and where it goes:
  authority/       stays here: whoever has its key can make themselves anybody
  vehicles/ROBOT/  to that vehicle:  robot-edge ... --keys FOLDER
  people/NAME/     to that person:   operator-console --keys FOLDER
  router/          router.json5 alone, to the router:  zenohd -c router.json5

Files that end in .key.pem, and router.json5, are secrets of who uses them.

Run it again to add vehicles and people. Nothing that is there is changed, but router.json5 is
written anew. Folders and router.json5 that have changed must be brought to where they are used:
`robot-edge install-keys` puts a vehicle's in its place. A vehicle that runs lets people who are
new connect within two seconds; a router does when it is started again.

To take somebody's leave, remove their entry from operators.toml here, and on each vehicle: within a
second they drive no more, within two they see nothing of it. Behind a router they see it until the
router is started again with the router.json5 that this then writes.

For a new certificate, since they expire, remove link.pem and run this again; for new keys,
remove the whole folder and the entries on the lists.";

pub(super) const INSTALLED_KEYS: &str = "\
FROM is checked first: keys that could not be used change nothing. TO is replaced as a whole, in one
step, and can be replaced again and again; a run that is cut off leaves the old keys or the new ones.
A TO that holds anything else, or the keys of another vehicle, is refused.

By root, the files are root's, and the group of the folder above TO may read them: let that be the
group by which robot-edge runs. By anybody else, only they can read them.

A vehicle that runs obeys the new list within two seconds. It shows a new certificate from its next
start on, or from the next time that people are added or taken off.";

/// `info`.
#[derive(Clone, Debug, PartialEq, Eq, Args)]
pub struct Info {
    /// MCAP, ROS 1 bag or CARMEN log
    pub recording: PathBuf,
}

/// `recover`.
#[derive(Clone, Debug, PartialEq, Eq, Args)]
pub struct Recover {
    /// The damaged recording; it is not changed
    pub recording: PathBuf,
    /// Where to write what can be saved
    pub out: PathBuf,
}

/// `vehicles`.
#[derive(Clone, Debug, PartialEq, Eq, Args)]
pub struct Vehicles {
    /// Vehicle to print
    pub name: Option<String>,
}

/// `check`.
#[derive(Clone, Debug, PartialEq, Args)]
pub struct Check {
    /// Configuration file, or name of a preset
    #[arg(value_name = "CONFIG", value_parser = NonEmptyStringValueParser::new())]
    pub config: String,
    /// Open every device, and say what it is and how it measures
    #[arg(long)]
    pub connect: bool,
    /// How long to listen to the devices, seconds
    #[arg(long, value_name = "S", default_value = "5", requires = "connect", value_parser = super::mapping::above_zero)]
    pub seconds: f64,
}

/// `devices`.
#[derive(Clone, Debug, PartialEq, Eq, Args)]
pub struct Devices {
    /// Write requests to serial ports, not only listen: not for the port of a motor controller
    #[arg(long)]
    pub ask: bool,
    /// Another serial port; may be repeated
    #[arg(long = "port", value_name = "PATH")]
    pub ports: Vec<PathBuf>,
}

/// `calibrate`.
#[derive(Clone, Debug, PartialEq, Subcommand)]
pub enum Calibrate {
    /// Find the beams that hit the vehicle itself, and print them as `masks_deg`
    SelfHits(CalibrateSelfHits),
}

/// `calibrate self-hits`.
#[derive(Clone, Debug, PartialEq, Args)]
pub struct CalibrateSelfHits {
    /// Configuration file that has devices
    #[arg(value_name = "CONFIG", value_parser = NonEmptyStringValueParser::new())]
    pub config: String,
    /// How long to look; the vehicle stands
    #[arg(long, value_name = "S", default_value = "60", value_parser = super::mapping::above_zero)]
    pub seconds: f64,
    /// Only the vehicle is so near to a scanner, metres [default: its diagonal and 0.2 m]
    #[arg(long = "within", value_name = "M", value_parser = super::mapping::above_zero)]
    pub within_m: Option<f64>,
}

/// `keys`.
#[derive(Clone, Debug, PartialEq, Eq, Args)]
#[command(after_help = KEYS_FOLDER)]
pub struct Keys {
    /// Folder of the fleet; made where there is none
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// A vehicle; may be repeated
    #[arg(long = "robot", value_name = "ID")]
    pub robots: Vec<RobotId>,
    /// Name or address by which the vehicle is reached, beside this machine's own; may be repeated
    #[arg(long = "host", value_name = "HOST", value_parser = host)]
    pub hosts: Vec<String>,
    /// Somebody who drives; may be repeated. People are for the vehicles named, or for all where none is
    #[arg(long = "operator", value_name = "NAME")]
    pub operators: Vec<OperatorId>,
    /// Somebody who drives, and takes over from others; may be repeated
    #[arg(long = "supervisor", value_name = "NAME")]
    pub supervisors: Vec<OperatorId>,
    /// Somebody who watches; may be repeated
    #[arg(long = "observer", value_name = "NAME")]
    pub observers: Vec<OperatorId>,
    /// Name or address by which a router is reached; may be repeated
    #[arg(long = "router", value_name = "HOST", value_parser = host)]
    pub router_hosts: Vec<String>,
    /// How long new certificates are good for
    #[arg(long, value_name = "N", default_value_t = 365, value_parser = clap::value_parser!(u32).range(1..=3650))]
    pub days: u32,
}

/// `install-keys`.
#[derive(Clone, Debug, PartialEq, Eq, Args)]
pub struct InstallKeys {
    /// The vehicle's folder of `robot-edge keys`, or a copy of it
    pub from: PathBuf,
    /// The folder that `--keys` names on the vehicle; made where there is none
    pub to: PathBuf,
}

/// `evaluate`.
#[derive(Clone, Debug, PartialEq, Eq, Subcommand)]
pub enum Evaluate {
    /// Print mean and standard deviation of its errors, metres and degrees, by relations between its poses (Kümmerle et al. 2009)
    Relations(EvaluateRelations),
}

/// `evaluate relations`.
#[derive(Clone, Debug, PartialEq, Eq, Args)]
pub struct EvaluateRelations {
    /// Relations: two stamps in seconds, x, y, z, roll, pitch, yaw in a line
    #[arg(value_name = "FILE")]
    pub relations: PathBuf,
    /// The trajectory.tum of `--export`, or another TUM file
    pub trajectory: PathBuf,
}

/// `experiments`.
#[derive(Clone, Debug, PartialEq, Eq, Args)]
pub struct Experiments {
    /// Experiments to run [default: all]
    #[arg(value_name = "ID")]
    pub ids: Vec<String>,
    /// Where to write the page and its pictures
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Run each with the seeds 1 to N
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub seeds: u64,
}

/// `motor-guard`.
#[derive(Clone, Debug, PartialEq, Eq, Args)]
pub struct MotorGuard {
    /// Which motors, as JSON
    pub config: String,
}

/// `completions`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Args)]
pub struct Completions {
    /// The shell
    pub shell: Shell,
}

impl Completions {
    pub fn print(self, out: &mut dyn io::Write) -> io::Result<()> {
        // The generator panics where it cannot write; memory can always be written.
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut Cli::command(), "robot-edge", &mut script);
        out.write_all(&script)
    }
}

/// `man`.
#[derive(Clone, Debug, PartialEq, Eq, Args)]
pub struct Man {
    /// Folder to write them to; made where there is none
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

impl Man {
    /// A page for the program and one for each command.
    pub fn write(&self) -> io::Result<()> {
        std::fs::create_dir_all(&self.out)?;
        clap_mangen::generate_to(Cli::command(), &self.out)
    }
}

/// A host name (RFC 1123) or an address.
fn host(text: &str) -> Result<String, String> {
    if let Ok(address) = text.parse::<std::net::IpAddr>() {
        return Ok(address.to_string());
    }
    let is_plain = |label: &str| {
        let bytes = label.as_bytes();
        let is_inner = |byte: &u8| byte.is_ascii_alphanumeric() || *byte == b'-';
        (1..=63).contains(&bytes.len())
            && bytes.iter().all(is_inner)
            && !label.starts_with('-')
            && !label.ends_with('-')
    };
    if text.len() <= 253 && text.split('.').all(is_plain) {
        Ok(text.to_ascii_lowercase())
    } else {
        Err("a host is a name like boat.example, or an address".to_owned())
    }
}
