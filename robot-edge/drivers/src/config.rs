//! Settings of `[devices.<name>]`: a device that is read without a middleware.
//!
//! One table for all kinds; a key that a kind does not have is refused.

use std::collections::BTreeMap;
use std::fmt;
use std::net::SocketAddr;
use std::path::PathBuf;

use serde::Deserialize;

use crate::beam_selection::{AngleRange, BeamSelection};
use crate::transport::Address;

/// One device.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DeviceConfig {
    /// What it is.
    pub kind: Kind,
    /// Host and port of a device on TCP.
    pub tcp: Option<String>,
    /// Host and port of a device on UDP.
    pub udp: Option<String>,
    /// Own address and port that a device sends datagrams to.
    pub udp_listen: Option<String>,
    /// Serial port; better a name that stays: `/dev/serial/by-id/…`.
    pub serial: Option<String>,
    /// Bits per second of the serial port; where absent, as the device is delivered.
    pub baud: Option<u32>,
    /// What the device's identity must contain (a serial number), so that no other is taken for it.
    pub identity: Option<String>,
    /// First angle that is used, counter-clockwise from the sensor's x axis.
    pub sector_from_deg: Option<f64>,
    /// Last angle that is used.
    pub sector_to_deg: Option<f64>,
    /// Angles at which beams hit the vehicle itself: `-135..-120, 95..100`.
    pub masks_deg: Option<String>,
    /// Smallest range of the data sheet.
    pub range_min_m: Option<f64>,
    /// Greatest range of the data sheet.
    pub range_max_m: Option<f64>,
    /// Measurements per second; where absent, as the device is set.
    pub rate_hz: Option<f64>,
    /// Angle between beams; where absent, as the device is set.
    pub resolution_deg: Option<f64>,
    /// How a SICK scanner talks; where absent, both are tried in turn.
    pub coding: Option<ColaCoding>,
    /// Name or address of a lidar that is queried or configured before its packets are received, with its port if that differs.
    pub host: Option<String>,
    /// File with the metadata of an Ouster.
    pub metadata: Option<PathBuf>,
    /// File with the calibration of a Velodyne.
    pub calibration: Option<PathBuf>,
    /// Speed of sound in the water.
    pub sound_speed_mps: Option<f64>,
    /// The device of the kind `ntrip` whose corrections this receiver gets.
    pub corrections: Option<String>,
    /// Mountpoint of an NTRIP caster.
    pub mountpoint: Option<String>,
    /// User of an NTRIP caster.
    pub user: Option<String>,
    /// Password of an NTRIP caster.
    pub password: Option<String>,
    /// Which servo it is.
    pub servo: Option<Servo>,
    /// Number of a servo on its line.
    pub servo_id: Option<u32>,
    /// One end of what a servo sweeps to and fro, degrees from its middle; together with the next two.
    pub sweep_from_deg: Option<f64>,
    /// The other end, greater.
    pub sweep_to_deg: Option<f64>,
    /// How fast it sweeps, degrees per second.
    pub sweep_degps: Option<f64>,
    /// The joint that a servo turns.
    pub joint: Option<String>,
}

/// Kinds of devices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "the modules say it")]
pub enum Kind {
    #[default]
    SickCola,
    SickLdlrs,
    Hokuyo,
    Rplidar,
    Xsens,
    Nmea,
    Ublox,
    Ntrip,
    Imagenex852,
    ImagenexDeltat,
    Ping1d,
    Dynamixel,
    Velodyne,
    Ouster,
    Livox,
}

/// What a kind of device measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// Sweeps, or single beams.
    Scans,
    /// Points of a three-dimensional lidar.
    Clouds,
    /// Orientation and rates.
    Attitudes,
    /// Positions.
    Fixes,
    /// Positions of a receiver, or single beams of an echo sounder.
    FixesOrDepths,
    /// The angle of a joint.
    Angles,
    /// It works for another device.
    Nothing,
}

impl fmt::Display for Kind {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

/// How a SICK scanner talks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ColaCoding {
    /// Text.
    A,
    /// Binary.
    B,
}

/// Servos.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "names of devices")]
pub enum Servo {
    Ax12a,
    Mx28,
    XSeries,
}

/// What is wrong with a setting, and what to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// Path of the key: `devices.laser.tcp`.
    pub key: String,
    /// The problem, and what is allowed.
    pub text: String,
}

impl Problem {
    /// `key`: of the device, empty for the device itself.
    pub(crate) fn new(device: &str, key: &str, text: String) -> Self {
        let dot = if key.is_empty() { "" } else { "." };
        Self {
            key: format!("devices.{device}{dot}{key}"),
            text,
        }
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "`{}`: {}", self.key, self.text)
    }
}

/// Ways to connect a device, as bits.
/// The key of this name.
pub const TCP: u8 = 1;
/// The key of this name.
pub const UDP: u8 = 2;
/// The key of this name.
pub const UDP_LISTEN: u8 = 4;
/// The key of this name.
pub const SERIAL: u8 = 8;

const ADDRESSES: [(u8, &str); 4] = [
    (TCP, "tcp"),
    (UDP, "udp"),
    (UDP_LISTEN, "udp_listen"),
    (SERIAL, "serial"),
];

/// Keys of all kinds.
const COMMON: &[&str] = &[
    "kind",
    "tcp",
    "udp",
    "udp_listen",
    "serial",
    "baud",
    "identity",
];
/// Keys of what gives scans.
const SCANS: &[&str] = &[
    "sector_from_deg",
    "sector_to_deg",
    "masks_deg",
    "range_min_m",
    "range_max_m",
];

/// What a kind has.
struct Traits {
    addresses: u8,
    keys: &'static [&'static str],
}

impl Kind {
    const fn traits(self) -> Traits {
        let (addresses, keys): (u8, &[&str]) = match self {
            Self::SickCola => (TCP, &["coding", "rate_hz", "resolution_deg"]),
            Self::SickLdlrs => (TCP, &[]),
            Self::Hokuyo => (TCP | SERIAL, &[]),
            Self::Rplidar => (SERIAL, &[]),
            Self::Xsens => (SERIAL, &["rate_hz"]),
            Self::Nmea => (TCP | UDP_LISTEN | SERIAL, &["corrections"]),
            Self::Ublox => (SERIAL | TCP, &["rate_hz", "corrections"]),
            Self::Ntrip => (TCP, &["mountpoint", "user", "password"]),
            Self::Imagenex852 => (SERIAL, &["rate_hz", "sound_speed_mps"]),
            Self::ImagenexDeltat => (UDP_LISTEN, &[]),
            Self::Ping1d => (UDP | SERIAL, &["rate_hz", "sound_speed_mps"]),
            Self::Dynamixel => (
                SERIAL,
                &[
                    "rate_hz",
                    "servo",
                    "servo_id",
                    "joint",
                    "sweep_from_deg",
                    "sweep_to_deg",
                    "sweep_degps",
                ],
            ),
            Self::Velodyne => (UDP_LISTEN, &["calibration"]),
            Self::Ouster => (UDP_LISTEN, &["host", "metadata"]),
            Self::Livox => (UDP_LISTEN, &["host"]),
        };
        Traits { addresses, keys }
    }

    /// All kinds.
    pub const ALL: [Self; 15] = [
        Self::SickCola,
        Self::SickLdlrs,
        Self::Hokuyo,
        Self::Rplidar,
        Self::Xsens,
        Self::Nmea,
        Self::Ublox,
        Self::Ntrip,
        Self::Imagenex852,
        Self::ImagenexDeltat,
        Self::Ping1d,
        Self::Dynamixel,
        Self::Velodyne,
        Self::Ouster,
        Self::Livox,
    ];

    /// Its name in a configuration.
    pub const fn name(self) -> &'static str {
        match self {
            Self::SickCola => "sick_cola",
            Self::SickLdlrs => "sick_ldlrs",
            Self::Hokuyo => "hokuyo",
            Self::Rplidar => "rplidar",
            Self::Xsens => "xsens",
            Self::Nmea => "nmea",
            Self::Ublox => "ublox",
            Self::Ntrip => "ntrip",
            Self::Imagenex852 => "imagenex852",
            Self::ImagenexDeltat => "imagenex_deltat",
            Self::Ping1d => "ping1d",
            Self::Dynamixel => "dynamixel",
            Self::Velodyne => "velodyne",
            Self::Ouster => "ouster",
            Self::Livox => "livox",
        }
    }

    /// What shows that its codec is right.
    pub const fn evidence(self) -> &'static str {
        match self {
            Self::SickCola => "recorded sessions of an LMS111 and a TiM781S",
            Self::Xsens => "recorded messages",
            Self::Nmea => "recorded logs",
            Self::Ntrip => "a recorded reply",
            Self::Imagenex852 => "recorded shots",
            Self::Hokuyo => "replies in manuals and other projects",
            Self::Rplidar | Self::Ublox => "bytes of other projects",
            Self::Ping1d => "bytes of the documentation",
            Self::Dynamixel => "bytes of the manual",
            Self::Velodyne => "recorded packets of a VLP-16; other models are not proved",
            Self::Ouster => {
                "recorded packets of an OS0 and an OS1; the profiles LEGACY and RNG19_RFL8_SIG16_NIR16 are not proved"
            }
            Self::SickLdlrs | Self::ImagenexDeltat | Self::Livox => "not proved on hardware",
        }
    }

    /// Whether it gives scans, or single beams.
    pub const fn gives_scans(self) -> bool {
        matches!(self.output(), Output::Scans | Output::FixesOrDepths)
    }

    /// Its measurements.
    pub const fn output(self) -> Output {
        match self {
            Self::SickCola
            | Self::SickLdlrs
            | Self::Hokuyo
            | Self::Rplidar
            | Self::Imagenex852
            | Self::ImagenexDeltat
            | Self::Ping1d => Output::Scans,
            Self::Xsens => Output::Attitudes,
            Self::Nmea => Output::FixesOrDepths,
            Self::Ublox => Output::Fixes,
            Self::Dynamixel => Output::Angles,
            Self::Ntrip => Output::Nothing,
            Self::Velodyne | Self::Ouster | Self::Livox => Output::Clouds,
        }
    }

    /// Bits per second as delivered.
    const fn baud(self) -> u32 {
        match self {
            Self::Nmea => 4800,
            Self::Ublox => 38_400,
            Self::Dynamixel => 57_600,
            Self::SickCola
            | Self::SickLdlrs
            | Self::Hokuyo
            | Self::Rplidar
            | Self::Xsens
            | Self::Ntrip
            | Self::Imagenex852
            | Self::ImagenexDeltat
            | Self::Ping1d
            | Self::Velodyne
            | Self::Ouster
            | Self::Livox => 115_200,
        }
    }
}

/// The keys that say where something is: one of four, and a bit rate.
#[derive(Clone, Copy, Debug)]
pub struct LinkKeys<'a> {
    /// `tcp`, `udp`, `udp_listen`, `serial`.
    pub given: [&'a Option<String>; 4],
    /// Of a serial port.
    pub baud: Option<u32>,
}

impl LinkKeys<'_> {
    /// Where it is, of the ways `of_kind`; `baud`: where the key is absent. Fails with a key and what is wrong.
    pub fn address(&self, of_kind: u8, baud: u32) -> Result<Address, (&'static str, String)> {
        let given = ADDRESSES.iter().zip(self.given);
        let given: Vec<_> = given
            .filter_map(|((bit, key), value)| Some((*bit, *key, value.as_deref()?)))
            .collect();
        let allowed: Vec<&str> = ADDRESSES
            .iter()
            .filter(|(bit, _)| of_kind & bit != 0)
            .map(|(_, key)| *key)
            .collect();
        let allowed = allowed.join(" or ");
        let &[(bit, key, address)] = given.as_slice() else {
            let text = format!("set exactly one of the keys that say where it is: {allowed}");
            return Err(("", text));
        };
        if of_kind & bit == 0 {
            return Err((key, format!("such a device is reached by {allowed}")));
        }
        if bit != SERIAL && self.baud.is_some() {
            return Err(("baud", "only a serial port has it: remove it".to_owned()));
        }
        let has_port = || {
            let (host, port) = address.rsplit_once(':')?;
            (!host.is_empty() && port.parse::<u16>().is_ok_and(|port| port > 0)).then_some(())
        };
        let no_port = || {
            let text = format!("\"{address}\" is no host and port, as 192.168.0.1:2111 is");
            Err((key, text))
        };
        match bit {
            TCP if has_port().is_some() => Ok(Address::Tcp(address.to_owned())),
            UDP if has_port().is_some() => Ok(Address::Udp(address.to_owned())),
            TCP | UDP => no_port(),
            UDP_LISTEN => match address.parse::<SocketAddr>() {
                Ok(address) => Ok(Address::UdpListen(address)),
                Err(_) => Err((
                    key,
                    format!("\"{address}\" is no address and port, as 0.0.0.0:4040 is"),
                )),
            },
            _ => {
                let baud = self.baud.unwrap_or(baud);
                if address.is_empty() || !(300..=12_000_000).contains(&baud) {
                    let text = "a port has a name, and `baud` from 300 to 12000000";
                    return Err((key, text.to_owned()));
                }
                Ok(Address::Serial {
                    path: address.into(),
                    baud,
                })
            }
        }
    }
}

/// A servo turns when it is about 1° from an end.
const LEAST_SWEEP_DEG: f64 = 5.0;

impl DeviceConfig {
    /// All problems of the devices, not the first alone. `given`: the keys that were set of a device.
    pub fn check_all<'a, K: Iterator<Item = &'a str>>(
        devices: &BTreeMap<String, Self>,
        given: impl Fn(&str) -> K,
    ) -> Vec<Problem> {
        let problems = devices.iter().flat_map(|(name, config)| {
            let found = config.check(given(name)).into_iter();
            let problems = found.map(move |(key, text)| Problem::new(name, key, text));
            problems.chain(config.check_corrections(name, devices))
        });
        problems.collect()
    }

    fn check<'a>(&self, given: impl Iterator<Item = &'a str>) -> Vec<(&'a str, String)> {
        let traits = self.kind.traits();
        let mut problems = Vec::new();
        let mut has_kind = false;
        for key in given {
            has_kind |= key == "kind";
            let is_of_kind = COMMON.contains(&key)
                || (self.kind.gives_scans() && SCANS.contains(&key))
                || traits.keys.contains(&key);
            if !is_of_kind {
                problems.push((key, "this kind of device has no such key".to_owned()));
            }
        }
        if !has_kind {
            return vec![("kind", "missing: what is it?".to_owned())];
        }
        let checks = [
            self.address().map(drop),
            self.beams().map(drop),
            self.check_numbers(),
            self.check_required(),
            self.check_host(),
        ];
        problems.extend(checks.into_iter().filter_map(Result::err));
        problems
    }

    /// Where the device is. Fails with a key and what is wrong.
    pub fn address(&self) -> Result<Address, (&'static str, String)> {
        let keys = LinkKeys {
            given: [&self.tcp, &self.udp, &self.udp_listen, &self.serial],
            baud: self.baud,
        };
        keys.address(self.kind.traits().addresses, self.kind.baud())
    }

    /// Beams that are used. Fails with a key and what is wrong.
    pub fn beams(&self) -> Result<BeamSelection, (&'static str, String)> {
        let range = |from_deg: f64, to_deg: f64| {
            let are_angles = [from_deg, to_deg]
                .iter()
                .all(|angle| (-360.0..=360.0).contains(angle));
            let is_wide = (to_deg - from_deg).rem_euclid(360.0) > 0.0;
            (are_angles && is_wide).then(|| AngleRange {
                from_rad: from_deg.to_radians(),
                to_rad: to_deg.to_radians(),
            })
        };
        let sector = match (self.sector_from_deg, self.sector_to_deg) {
            (None, None) => None,
            (Some(from_deg), Some(to_deg)) => Some(range(from_deg, to_deg).ok_or_else(|| {
                let text = "from `sector_from_deg` counter-clockwise to this must be more than 0 \
                            and less than 360 degrees, both within -360 to 360";
                ("sector_to_deg", text.to_owned())
            })?),
            _ => {
                let text = "a sector has both, `sector_from_deg` and `sector_to_deg`";
                return Err(("sector_from_deg", text.to_owned()));
            }
        };
        let mask = |text: &str| {
            let (from_deg, to_deg) = text.split_once("..")?;
            range(from_deg.trim().parse().ok()?, to_deg.trim().parse().ok()?)
        };
        let masks = self.masks_deg.as_deref().unwrap_or_default();
        let masks = masks.split(',').filter(|text| !text.trim().is_empty());
        let masks = masks.map(|text| {
            let wrong = || {
                let text = format!(
                    "\"{}\" is no range of angles, as -135..-120 is; more are separated by commas",
                    text.trim()
                );
                ("masks_deg", text)
            };
            mask(text).ok_or_else(wrong)
        });
        Ok(BeamSelection {
            sector,
            masks: masks.collect::<Result<_, _>>()?,
        })
    }

    /// The limits of the data sheet, or these.
    pub fn range_limits_m(&self, min: f32, max: f32) -> [f32; 2] {
        [(self.range_min_m, min), (self.range_max_m, max)]
            .map(|(configured, sheet)| configured.map_or(sheet, |metres| metres as f32))
    }

    fn check_numbers(&self) -> Result<(), (&'static str, String)> {
        for (key, value, allowed) in [
            ("range_min_m", self.range_min_m, 0.0..=1000.0),
            ("range_max_m", self.range_max_m, 0.01..=1000.0),
            ("rate_hz", self.rate_hz, 0.1..=1000.0),
            ("resolution_deg", self.resolution_deg, 0.01..=10.0),
            ("sound_speed_mps", self.sound_speed_mps, 1300.0..=1700.0),
            ("servo_id", self.servo_id.map(f64::from), 0.0..=252.0),
            ("sweep_from_deg", self.sweep_from_deg, -150.0..=150.0),
            ("sweep_to_deg", self.sweep_to_deg, -150.0..=150.0),
            ("sweep_degps", self.sweep_degps, 1.0..=360.0),
        ] {
            if let Some(value) = value.filter(|value| !allowed.contains(value)) {
                let (least, greatest) = (allowed.start(), allowed.end());
                return Err((
                    key,
                    format!("{value} is not allowed; allowed: {least} to {greatest}"),
                ));
            }
        }
        if let (Some(from), Some(to)) = (self.sweep_from_deg, self.sweep_to_deg)
            && to - from < LEAST_SWEEP_DEG
        {
            let why = format!(
                "{to} is not allowed: it must be at least {LEAST_SWEEP_DEG} more than `sweep_from_deg` ({from})"
            );
            return Err(("sweep_to_deg", why));
        }
        match (self.range_min_m, self.range_max_m) {
            (Some(min), Some(max)) if min >= max => Err((
                "range_max_m",
                format!("{max} is not allowed: it must be more than `range_min_m` ({min})"),
            )),
            _ => Ok(()),
        }
    }

    fn sweeps(&self) -> bool {
        [self.sweep_from_deg, self.sweep_to_deg, self.sweep_degps]
            .iter()
            .any(Option::is_some)
    }

    /// Where a lidar is queried or configured: [`Self::host`], with this port if it has none.
    pub(crate) fn host(&self, port: u16) -> Option<String> {
        let host = self.host.as_deref()?;
        Some(match host.rsplit_once(':') {
            Some(_) => host.to_owned(),
            None => format!("{host}:{port}"),
        })
    }

    fn check_host(&self) -> Result<(), (&'static str, String)> {
        // The text of a request has it, too.
        let is_host = |address: &str| {
            address.rsplit_once(':').is_some_and(|(host, port)| {
                let mut letters = host.bytes();
                let is_letter = |byte: u8| byte.is_ascii_alphanumeric() || b"-._".contains(&byte);
                !host.is_empty()
                    && letters.all(is_letter)
                    && port.parse::<u16>().is_ok_and(|port| port > 0)
            })
        };
        match self.host(1) {
            Some(address) if !is_host(&address) => {
                let text = "this is no name or address of a host, as 192.168.1.201 is, with a port or without";
                Err(("host", text.to_owned()))
            }
            _ if self.host.is_some() && self.metadata.is_some() => {
                let text = "the metadata are of this file or of `host`: remove one";
                Err(("metadata", text.to_owned()))
            }
            _ => Ok(()),
        }
    }

    /// Keys that a kind cannot do without.
    fn check_required(&self) -> Result<(), (&'static str, String)> {
        let missing = match self.kind {
            Kind::Ntrip if self.mountpoint.is_none() => "mountpoint",
            Kind::Ntrip if self.user.is_some() != self.password.is_some() => "password",
            Kind::Ouster if self.host.is_none() && self.metadata.is_none() => "host",
            Kind::Dynamixel if self.servo.is_none() => "servo",
            Kind::Dynamixel if self.servo_id.is_none() => "servo_id",
            Kind::Dynamixel if self.joint.is_none() => "joint",
            Kind::Dynamixel if self.sweeps() && self.sweep_from_deg.is_none() => "sweep_from_deg",
            Kind::Dynamixel if self.sweeps() && self.sweep_to_deg.is_none() => "sweep_to_deg",
            Kind::Dynamixel if self.sweeps() && self.sweep_degps.is_none() => "sweep_degps",
            _ => return Ok(()),
        };
        Err((missing, "missing: such a device needs it".to_owned()))
    }

    fn check_corrections(&self, name: &str, all: &BTreeMap<String, Self>) -> Option<Problem> {
        let caster = self.corrections.as_deref()?;
        let is_caster = |name: &str| all.get(name).is_some_and(|other| other.kind == Kind::Ntrip);
        let shares = |(other, config): (&String, &Self)| {
            other != name && config.corrections.as_deref() == Some(caster)
        };
        let text = if !is_caster(caster) {
            let casters: Vec<&str> = all
                .keys()
                .map(String::as_str)
                .filter(|name| is_caster(name))
                .collect();
            format!(
                "there is no device of kind \"ntrip\" named \"{caster}\"; there is: {}",
                casters.join(", ")
            )
        } else if all.iter().any(shares) {
            format!(
                "another device has the corrections of \"{caster}\", too: configure a second one"
            )
        } else {
            return None;
        };
        Some(Problem::new(name, "corrections", text))
    }
}

#[cfg(test)]
mod tests;
