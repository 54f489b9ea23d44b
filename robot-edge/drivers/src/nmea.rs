//! NMEA 0183: positions, headings and depths of receivers, compasses and echo sounders.
//!
//! Source: NMEA 0183 version 4; field lists of gpsd ("NMEA Revealed"). Checked against gpsd's regression
//! logs. Angles are radians; headings and courses are clockwise from north, see
//! [`enu_yaw_rad`](crate::gnss::enu_yaw_rad).
//! Sentences of any talker are taken. A sentence without a checksum is dropped.

use std::f64::consts::TAU;

use measurement::GeodeticFix;

use crate::DropReason;
use crate::read_buffer::{Framed, Front, StreamDecoder};

mod session;

pub use session::Nmea;

/// The standard allows 82; RTK receivers send positions with more digits.
const MAX_LENGTH: usize = 256;
const KNOT_MPS: f64 = 1852.0 / 3600.0;

/// A sentence and who sent it.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// Talker: `GP`, `GN`, `HE`, `SD`, …
    pub talker: [u8; 2],
    /// What it says.
    pub sentence: Sentence,
}

/// A sentence. A field that is empty, or missing at the end, is `None`.
#[derive(Clone, Debug, PartialEq)]
pub enum Sentence {
    /// Position and its quality.
    Gga(Gga),
    /// Position, speed and date.
    Rmc(Rmc),
    /// Course and speed.
    Vtg(Vtg),
    /// True heading.
    Hdt(#[doc = "Radians."] Option<f64>),
    /// True heading with mode.
    Ths(Ths),
    /// Magnetic heading.
    Hdg(Hdg),
    /// Errors of the position.
    Gst(Gst),
    /// Turn rate about the upward axis, counter-clockwise positive, rad/s; `None` if not valid.
    Rot(Option<f64>),
    /// Depth with offset.
    Dpt(Dpt),
    /// Depth below the transducer, metres.
    Dbt(Option<f64>),
}

/// Where the position comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// No fix.
    Invalid,
    /// Satellites alone.
    Autonomous,
    /// Differential corrections of satellites or a base.
    Differential,
    /// Precise positioning service.
    Precise,
    /// Carrier phase with fixed ambiguities: centimetres.
    RtkFixed,
    /// Carrier phase with float ambiguities: decimetres.
    RtkFloat,
    /// Dead reckoning.
    Estimated,
    /// Typed in.
    Manual,
    /// Simulated.
    Simulated,
}

/// `GGA`.
#[derive(Clone, Debug, PartialEq)]
pub struct Gga {
    /// Seconds of the UTC day.
    pub time_of_day_s: Option<f64>,
    /// Latitude and longitude on WGS-84, degrees.
    pub position_deg: Option<[f64; 2]>,
    /// Where the position comes from.
    pub quality: Quality,
    /// Number of satellites used.
    pub satellites: Option<u32>,
    /// Horizontal dilution of precision.
    pub horizontal_dilution: Option<f64>,
    /// Height above mean sea level, metres.
    pub altitude_m: Option<f64>,
    /// Height of the mean sea level above the ellipsoid, metres.
    pub geoid_separation_m: Option<f64>,
    /// Age of the corrections, seconds.
    pub correction_age_s: Option<f64>,
    /// Base station of the corrections.
    pub base_station: Option<u32>,
}

/// `RMC`.
#[derive(Clone, Debug, PartialEq)]
pub struct Rmc {
    /// Seconds of the UTC day.
    pub time_of_day_s: Option<f64>,
    /// Year, month, day.
    pub date: Option<(u16, u8, u8)>,
    /// The receiver vouches for the rest.
    pub is_valid: bool,
    /// Latitude and longitude on WGS-84, degrees.
    pub position_deg: Option<[f64; 2]>,
    /// Speed over ground, m/s.
    pub speed_mps: Option<f64>,
    /// Course over ground from true north, radians.
    pub course_rad: Option<f64>,
    /// Magnetic variation, east positive, radians.
    pub variation_rad: Option<f64>,
    /// `A` autonomous, `D` differential, `E` estimated, `F` RTK float, `R` RTK fixed, `N` none, …
    pub mode: Option<char>,
}

/// `VTG`.
#[derive(Clone, Debug, PartialEq)]
pub struct Vtg {
    /// Course over ground from true north, radians.
    pub course_rad: Option<f64>,
    /// Course over ground from magnetic north, radians.
    pub magnetic_course_rad: Option<f64>,
    /// Speed over ground, m/s.
    pub speed_mps: Option<f64>,
    /// As in [`Rmc::mode`].
    pub mode: Option<char>,
}

/// `THS`.
#[derive(Clone, Debug, PartialEq)]
pub struct Ths {
    /// Heading from true north, radians.
    pub heading_rad: Option<f64>,
    /// `A` autonomous, `E` estimated, `M` manual, `S` simulated, `V` not valid.
    pub mode: Option<char>,
}

/// `HDG`.
#[derive(Clone, Debug, PartialEq)]
pub struct Hdg {
    /// Heading that the compass shows, radians.
    pub compass_rad: Option<f64>,
    /// Deviation of the compass in the vehicle, east positive, radians.
    pub deviation_rad: Option<f64>,
    /// Magnetic variation, east positive, radians.
    pub variation_rad: Option<f64>,
}

/// `GST`: 1 σ, metres.
#[derive(Clone, Debug, PartialEq)]
pub struct Gst {
    /// Seconds of the UTC day.
    pub time_of_day_s: Option<f64>,
    /// Semi-major and semi-minor axis of the error ellipse.
    pub ellipse_m: Option<[f64; 2]>,
    /// Direction of the semi-major axis, clockwise from north, radians.
    pub ellipse_direction_rad: Option<f64>,
    /// Errors of latitude, longitude and altitude.
    pub sigma_m: [Option<f64>; 3],
}

/// `DPT`.
#[derive(Clone, Debug, PartialEq)]
pub struct Dpt {
    /// Depth below the transducer, metres.
    pub depth_m: Option<f64>,
    /// Positive: height of the water line above the transducer; negative: depth of the keel below it.
    pub offset_m: Option<f64>,
}

/// Decoder of a line with any number of talkers.
pub type NmeaDecoder = StreamDecoder<Message>;

impl Framed for Message {
    fn front(bytes: &[u8]) -> Front<Self> {
        let ends_line = |byte: &u8| matches!(byte, b'\r' | b'\n');
        let line_ends = bytes.iter().take_while(|byte| ends_line(byte)).count();
        if line_ends > 0 {
            return Front::Blank(line_ends);
        }
        let starts = |byte: &u8| *byte == b'$' || ends_line(byte);
        let garbage = bytes.iter().position(starts).unwrap_or(bytes.len());
        if garbage > 0 {
            return Front::Skip(DropReason::Garbage, garbage);
        }
        let ends = |byte: &u8| !(b' '..=b'~').contains(byte) || *byte == b'$';
        let line = &bytes[1..bytes.len().min(MAX_LENGTH)];
        let Some(length) = line.iter().position(ends) else {
            return if bytes.len() < MAX_LENGTH {
                Front::Incomplete
            } else {
                Front::Skip(DropReason::Length, 1)
            };
        };
        let (line, end) = (&line[..length], 1 + length);
        if !ends_line(&bytes[end]) {
            return Front::Skip(DropReason::CutOff, end);
        }
        match message(line) {
            Ok(message) => Front::Message(message, end),
            Err(reason) => Front::Skip(reason, end),
        }
    }
}

impl Gga {
    /// The position; `None` without one. The altitude is NaN if the receiver has none, and above sea
    /// level if it does not say how that lies above the ellipsoid.
    pub fn fix(&self) -> Option<GeodeticFix> {
        let [latitude_deg, longitude_deg] = self.position_deg?;
        let separation_m = self.geoid_separation_m.unwrap_or(0.0);
        Some(GeodeticFix {
            latitude_deg,
            longitude_deg,
            altitude_m: self
                .altitude_m
                .map_or(f64::NAN, |above_sea| above_sea + separation_m),
            status: match self.quality {
                Quality::Autonomous | Quality::Precise => 0,
                Quality::Differential => 1,
                Quality::RtkFixed | Quality::RtkFloat => 2,
                Quality::Invalid | Quality::Estimated | Quality::Manual | Quality::Simulated => -1,
            },
            sigma_m: None,
        })
    }
}

impl Hdg {
    /// Heading from true north, radians; a missing deviation is none, a missing variation unknown.
    pub fn true_heading_rad(&self) -> Option<f64> {
        let deviation = self.deviation_rad.unwrap_or(0.0);
        Some((self.compass_rad? + deviation + self.variation_rad?).rem_euclid(TAU))
    }
}

/// Exclusive or of all characters between `$` and `*`.
pub(crate) fn checksum(body: &[u8]) -> u8 {
    body.iter().fold(0, |sum, character| sum ^ character)
}

/// Judges received bytes.
/// A message out of a line without `$` and line end.
fn message(line: &[u8]) -> Result<Message, DropReason> {
    let (body, sum) = line
        .split_last_chunk::<3>()
        .and_then(|(body, [star, digits @ ..])| (*star == b'*').then_some((body, digits)))
        .ok_or(DropReason::Checksum)?;
    let sum = str::from_utf8(sum)
        .ok()
        .filter(|sum| !sum.starts_with('+'))
        .and_then(|sum| u8::from_str_radix(sum, 16).ok());
    if sum != Some(checksum(body)) {
        return Err(DropReason::Checksum);
    }
    let body = str::from_utf8(body).ok().ok_or(DropReason::Field)?;
    let mut fields = body.split(',');
    let address = fields.next().unwrap_or_default().as_bytes();
    let [talker @ .., _, _, _] = address else {
        return Err(DropReason::UnknownKind);
    };
    let talker = <[u8; 2]>::try_from(talker)
        .ok()
        .ok_or(DropReason::UnknownKind)?;
    let fields = Fields(fields.collect());
    let sentence = match &address[2..] {
        b"GGA" => Sentence::Gga(fields.gga()?),
        b"RMC" => Sentence::Rmc(fields.rmc()?),
        b"VTG" => Sentence::Vtg(fields.vtg()?),
        b"HDT" => Sentence::Hdt(fields.heading(0)?),
        b"THS" => Sentence::Ths(Ths {
            heading_rad: fields.heading(0)?,
            mode: fields.letter(1)?,
        }),
        b"HDG" => Sentence::Hdg(Hdg {
            compass_rad: fields.heading(0)?,
            deviation_rad: fields.signed_angle(1, ("E", "W"))?,
            variation_rad: fields.signed_angle(3, ("E", "W"))?,
        }),
        b"GST" => Sentence::Gst(fields.gst()?),
        b"ROT" => {
            let to_starboard = fields.number(0)?;
            let rate = to_starboard.map(|deg_per_minute| -deg_per_minute.to_radians() / 60.0);
            Sentence::Rot(rate.filter(|_| fields.get(1) == "A"))
        }
        b"DPT" => Sentence::Dpt(Dpt {
            depth_m: fields.not_negative(0)?,
            offset_m: fields.number(1)?,
        }),
        b"DBT" => Sentence::Dbt(fields.depth_below_transducer()?),
        _ => return Err(DropReason::UnknownKind),
    };
    Ok(Message { talker, sentence })
}

/// Fields of a sentence after its address, from 0.
struct Fields<'a>(Vec<&'a str>);

impl<'a> Fields<'a> {
    fn get(&self, index: usize) -> &'a str {
        self.0.get(index).copied().unwrap_or_default()
    }

    fn number(&self, index: usize) -> Result<Option<f64>, DropReason> {
        let field = self.get(index);
        if field.is_empty() {
            return Ok(None);
        }
        // `parse` alone would take "inf", "NaN" and exponents.
        let digits = field.strip_prefix(['-', '+']).unwrap_or(field);
        let is_decimal = digits
            .bytes()
            .all(|byte| byte.is_ascii_digit() || byte == b'.');
        let number = field
            .parse()
            .ok()
            .filter(|_| is_decimal && digits.len() < 20);
        number.map(Some).ok_or(DropReason::Field)
    }

    fn not_negative(&self, index: usize) -> Result<Option<f64>, DropReason> {
        self.in_range(index, f64::MAX)
    }

    fn in_range(&self, index: usize, max: f64) -> Result<Option<f64>, DropReason> {
        let number = self.number(index)?;
        let is_good = number.is_none_or(|number| (0.0..=max).contains(&number));
        is_good.then_some(number).ok_or(DropReason::Field)
    }

    fn integer(&self, index: usize) -> Result<Option<u32>, DropReason> {
        match self.get(index) {
            "" => Ok(None),
            field if field.bytes().all(|byte| byte.is_ascii_digit()) => {
                field.parse().ok().map(Some).ok_or(DropReason::Field)
            }
            _ => Err(DropReason::Field),
        }
    }

    fn letter(&self, index: usize) -> Result<Option<char>, DropReason> {
        let mut characters = self.get(index).chars();
        match (characters.next(), characters.next()) {
            (letter, None) => Ok(letter),
            _ => Err(DropReason::Field),
        }
    }

    /// An angle of 0 to 360° as radians.
    fn heading(&self, index: usize) -> Result<Option<f64>, DropReason> {
        Ok(self.in_range(index, 360.0)?.map(f64::to_radians))
    }

    /// Degrees and a letter for their sign, as radians.
    fn signed_angle(&self, index: usize, letters: (&str, &str)) -> Result<Option<f64>, DropReason> {
        let angle = self.in_range(index, 180.0)?;
        Ok(self.signed(angle, index + 1, letters)?.map(f64::to_radians))
    }

    fn signed(
        &self,
        value: Option<f64>,
        index: usize,
        (positive, negative): (&str, &str),
    ) -> Result<Option<f64>, DropReason> {
        match (value, self.get(index)) {
            (None, _) => Ok(None),
            (Some(value), letter) if letter == positive => Ok(Some(value)),
            (Some(value), letter) if letter == negative => Ok(Some(-value)),
            _ => Err(DropReason::Field),
        }
    }

    /// Latitude and longitude, each `dddmm.mm` and a letter.
    fn position(&self, index: usize) -> Result<Option<[f64; 2]>, DropReason> {
        let degrees = |index, letters, max| {
            let Some(value) = self.not_negative(index)? else {
                return Ok(None);
            };
            let whole = (value / 100.0).trunc();
            let minutes = value - whole * 100.0;
            let degrees = whole + minutes / 60.0;
            if minutes >= 60.0 || degrees > max {
                return Err(DropReason::Field);
            }
            self.signed(Some(degrees), index + 1, letters)
        };
        let latitude = degrees(index, ("N", "S"), 90.0)?;
        let longitude = degrees(index + 2, ("E", "W"), 180.0)?;
        Ok(latitude
            .zip(longitude)
            .map(|(latitude, longitude)| [latitude, longitude]))
    }

    /// `hhmmss.ss` as seconds of the day; 60 s for a leap second.
    fn time_of_day(&self, index: usize) -> Result<Option<f64>, DropReason> {
        let Some(value) = self.in_range(index, 235_961.0)? else {
            return Ok(None);
        };
        let (hours, minutes) = ((value / 1e4).trunc(), (value / 100.0).trunc() % 100.0);
        let seconds = value % 100.0;
        if minutes >= 60.0 || seconds >= 61.0 {
            return Err(DropReason::Field);
        }
        Ok(Some((hours * 60.0 + minutes) * 60.0 + seconds))
    }

    /// `ddmmyy`; GPS began in 1980, so years of two digits end in 2079.
    fn date(&self, index: usize) -> Result<Option<(u16, u8, u8)>, DropReason> {
        let Some(value) = self.integer(index)? else {
            return Ok(None);
        };
        let (day, month, year) = (value / 10_000, value / 100 % 100, (value % 100) as u16);
        if self.get(index).len() != 6 || !(1..=31).contains(&day) || !(1..=12).contains(&month) {
            return Err(DropReason::Field);
        }
        let century = if year < 80 { 2000 } else { 1900 };
        Ok(Some((century + year, month as u8, day as u8)))
    }

    fn gga(&self) -> Result<Gga, DropReason> {
        Ok(Gga {
            time_of_day_s: self.time_of_day(0)?,
            position_deg: self.position(1)?,
            quality: match self.integer(5)? {
                Some(0) | None => Quality::Invalid,
                Some(1) => Quality::Autonomous,
                // 9 is NovAtel's number for corrections of satellites.
                Some(2 | 9) => Quality::Differential,
                Some(3) => Quality::Precise,
                Some(4) => Quality::RtkFixed,
                Some(5) => Quality::RtkFloat,
                Some(6) => Quality::Estimated,
                Some(7) => Quality::Manual,
                Some(8) => Quality::Simulated,
                Some(_) => return Err(DropReason::Field),
            },
            satellites: self.integer(6)?,
            horizontal_dilution: self.not_negative(7)?,
            altitude_m: self.number(8)?,
            geoid_separation_m: self.number(10)?,
            correction_age_s: self.not_negative(12)?,
            base_station: self.integer(13)?,
        })
    }

    fn rmc(&self) -> Result<Rmc, DropReason> {
        Ok(Rmc {
            time_of_day_s: self.time_of_day(0)?,
            date: self.date(8)?,
            is_valid: self.get(1) == "A",
            position_deg: self.position(2)?,
            speed_mps: self.not_negative(6)?.map(|knots| knots * KNOT_MPS),
            course_rad: self.heading(7)?,
            variation_rad: self.signed_angle(9, ("E", "W"))?,
            mode: self.letter(11)?,
        })
    }

    fn vtg(&self) -> Result<Vtg, DropReason> {
        for (index, unit) in [(1, "T"), (3, "M"), (5, "N"), (7, "K")] {
            if !["", unit].contains(&self.get(index)) {
                return Err(DropReason::Field);
            }
        }
        let from_knots = self.not_negative(4)?.map(|knots| knots * KNOT_MPS);
        let from_kmh = self.not_negative(6)?.map(|speed_kmh| speed_kmh / 3.6);
        Ok(Vtg {
            course_rad: self.heading(0)?,
            magnetic_course_rad: self.heading(2)?,
            speed_mps: from_knots.or(from_kmh),
            mode: self.letter(8)?,
        })
    }

    fn gst(&self) -> Result<Gst, DropReason> {
        let axes = self.not_negative(2)?.zip(self.not_negative(3)?);
        Ok(Gst {
            time_of_day_s: self.time_of_day(0)?,
            ellipse_m: axes.map(|(major, minor)| [major, minor]),
            ellipse_direction_rad: self.heading(4)?,
            sigma_m: [
                self.not_negative(5)?,
                self.not_negative(6)?,
                self.not_negative(7)?,
            ],
        })
    }

    /// Metres, else feet, else fathoms.
    fn depth_below_transducer(&self) -> Result<Option<f64>, DropReason> {
        let (feet, metres, fathoms) = (
            self.not_negative(0)?,
            self.not_negative(2)?,
            self.not_negative(4)?,
        );
        Ok(metres
            .or(feet.map(|feet| feet * 0.3048))
            .or(fathoms.map(|fathoms| fathoms * 1.8288)))
    }
}

#[cfg(test)]
mod tests;
