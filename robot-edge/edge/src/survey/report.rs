//! The page that `robot-edge info` prints.

use std::collections::BTreeSet;
use std::fmt;
use std::path::Path;

use super::Survey;
use super::topics::{ScanSurvey, StampSurvey};
use crate::config::{
    self, Config, FixesAndAttitude, ImuConfig, WheelsAndAttitude, presets, the_imu,
};
use crate::events::merge_alike;
use localization::{LocalizationConfig, PoseSource};
use measurement::drops::{DropCounts, DropReason};
use measurement::time::{RobotDuration, RobotTime};
use measurement::{FrameId, GeodeticFix, StreamId};
use protocol::export::span_label;
use recording::Format;

const MAX_JOINTS_LISTED: usize = 12;

impl fmt::Display for Survey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write_file(f)?;
        self.write_topics(f)?;
        if !self.scans.is_empty() {
            writeln!(f, "\nrange sensors")?;
        }
        for (stream, scan) in &self.scans {
            self.write_scan(f, *stream, scan)?;
        }
        self.write_sensors_of_poses(f)?;
        self.write_frames(f)?;
        self.write_faults(f)?;
        writeln!(f, "\ncan it be mapped?")?;
        self.write_mappable(f)
    }
}

impl Survey {
    fn write_file(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let size = Bytes(self.position.bytes_total);
        writeln!(f, "{}\n  {}, {size}", self.path.display(), self.format)?;
        if !self.is_complete() {
            let read = Bytes(self.position.bytes_read);
            writeln!(f, "  surveyed: its first {read}")?;
        }
        match self.time_span() {
            Some(_) if self.has_no_clock() => {
                writeln!(
                    f,
                    "  times are not known: its clock cannot be used (see faults)"
                )?;
            }
            Some(span) => writeln!(f, "  {}, {}", Duration(self.duration()), Span(span))?,
            None => writeln!(f, "  nothing with a stamp")?,
        }
        if let Some(vehicle) = &self.vehicle {
            writeln!(f, "  vehicle: {vehicle}")?;
        }
        Ok(())
    }

    fn write_topics(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = |of: fn(&super::StreamSummary) -> &str, least: usize| {
            self.streams
                .iter()
                .map(|s| of(s).chars().count())
                .max()
                .unwrap_or(0)
                .max(least)
        };
        let name_width = width(|s| &s.stream.name, 5);
        let type_width = width(|s| &s.stream.type_name, 4);
        writeln!(
            f,
            "\n  {:name_width$}  {:type_width$}  messages  rate",
            "topic", "type"
        )?;
        for (summary, stamps) in self.streams.iter().zip(&self.stamps) {
            let name = &summary.stream.name;
            let type_name = &summary.stream.type_name;
            let messages = summary.messages;
            write!(
                f,
                "  {name:name_width$}  {type_name:type_width$}  {messages:8}  "
            )?;
            match (summary.understood, stamps.rate_hz(messages)) {
                (false, _) => writeln!(f, "not read: no sensor data that is understood")?,
                (true, Some(rate)) => writeln!(f, "{} Hz", significant(rate))?,
                (true, None) => writeln!(f, "-")?,
            }
        }
        Ok(())
    }

    fn write_scan(
        &self,
        f: &mut fmt::Formatter<'_>,
        stream: StreamId,
        scan: &ScanSurvey,
    ) -> fmt::Result {
        let name = self.topic_name(stream);
        let beams = match scan.beams {
            (fewest, most) if fewest == most => format!("{most} beams"),
            (fewest, most) => format!("{fewest} to {most} beams"),
        };
        writeln!(
            f,
            "  {name}: {} scans of {beams} in frame {}",
            scan.stamps.count,
            frame(&scan.frame)
        )?;
        writeln!(
            f,
            "    {:.1}° to {:.1}° in steps of {:.3}°, beams {:.1} µs apart",
            scan.angle_min_rad.to_degrees(),
            scan.angle_max_rad().to_degrees(),
            scan.angle_increment_rad.to_degrees(),
            scan.time_increment_s * 1e6,
        )?;
        write!(
            f,
            "    ranges {} to {} m",
            scan.range_min_m, scan.range_max_m
        )?;
        if let Some((greatest, count)) = scan.max_range.greatest() {
            write!(f, "; the greatest is {greatest} m, {count} times")?;
        }
        writeln!(f)?;
        if let Some(miss) = scan.inferred_miss_range_m() {
            writeln!(
                f,
                "    from {miss} m on they repeat: what this laser reports for no return"
            )?;
        }
        Ok(())
    }

    fn write_sensors_of_poses(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = |stream| self.topic_name(stream);
        if !self.joints.is_empty() {
            writeln!(f, "\njoints")?;
        }
        for (stream, joints) in &self.joints {
            let listed: Vec<_> = joints
                .names
                .iter()
                .map(String::as_str)
                .take(MAX_JOINTS_LISTED)
                .collect();
            let more = joints.names.len() - listed.len();
            write!(f, "  {}: {}", name(*stream), listed.join(", "))?;
            if more > 0 {
                write!(f, " and {more} more")?;
            }
            writeln!(f)?;
        }
        if !self.attitudes.is_empty() {
            writeln!(f, "\nattitudes")?;
        }
        for (stream, attitudes) in &self.attitudes {
            writeln!(
                f,
                "  {}: {} of {} give an orientation",
                name(*stream),
                attitudes.oriented,
                attitudes.count
            )?;
        }
        if !self.fixes.is_empty() {
            writeln!(f, "\nsatellite fixes")?;
        }
        for (stream, fixes) in &self.fixes {
            write!(
                f,
                "  {}: {} of {} are a fix",
                name(*stream),
                fixes.fixed,
                fixes.count
            )?;
            match fixes.first {
                Some(GeodeticFix {
                    latitude_deg,
                    longitude_deg,
                    altitude_m,
                    ..
                }) => writeln!(
                    f,
                    ", the first at {latitude_deg:.6}°, {longitude_deg:.6}°, {altitude_m:.1} m"
                )?,
                None => writeln!(f)?,
            }
        }
        Ok(())
    }

    fn write_frames(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let roots = self.frames.roots();
        if self.odometry.is_empty() && self.frames.edges().next().is_none() {
            return Ok(());
        }
        writeln!(f, "\nframes")?;
        for (stream, odometry) in &self.odometry {
            let name = self.topic_name(*stream);
            writeln!(
                f,
                "  {name}: {} in {}, {} poses",
                frame(&odometry.child),
                frame(&odometry.parent),
                odometry.count
            )?;
        }
        for root in &roots {
            writeln!(f, "  {}", frame(root))?;
            self.write_children(f, root, 2, &mut BTreeSet::new())?;
        }
        if roots.is_empty() && self.frames.edges().next().is_some() {
            writeln!(f, "  they go in a circle")?;
        }
        if self.frames.beyond_limit > 0 {
            writeln!(
                f,
                "  and {} transforms of more frames",
                self.frames.beyond_limit
            )?;
        }
        Ok(())
    }

    fn write_children<'a>(
        &'a self,
        f: &mut fmt::Formatter<'_>,
        parent: &'a FrameId,
        depth: usize,
        written: &mut BTreeSet<&'a FrameId>,
    ) -> fmt::Result {
        // Damage can produce several parents of a frame, or a cycle.
        if !written.insert(parent) {
            return Ok(());
        }
        for (_, child, edge) in self.frames.edges().filter(|(known, ..)| *known == parent) {
            let indent = 2 * depth;
            write!(f, "{:indent$}{}", "", frame(child))?;
            if edge.is_static {
                writeln!(f, " (static)")?;
            } else {
                let seconds = Duration(edge.last.since(edge.first));
                writeln!(f, " ({} transforms in {seconds})", edge.count)?;
            }
            self.write_children(f, child, depth + 1, written)?;
        }
        Ok(())
    }

    fn write_faults(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "\nfaults")?;
        let mut none = true;
        for (reason, count) in self.losses.iter() {
            none = false;
            writeln!(f, "  {}: {count}", loss_in_words(reason))?;
        }
        if self.stamp_repairs > 0 {
            none = false;
            writeln!(
                f,
                "  stamps that contradicted the order of their lines, changed to fit it: {}",
                self.stamp_repairs
            )?;
        }
        for (stream, scan) in &self.scans {
            let StampSurvey {
                count,
                repeated,
                backward,
                ..
            } = scan.stamps;
            let name = self.topic_name(*stream);
            if repeated + backward > 0 {
                none = false;
                writeln!(
                    f,
                    "  {name}: of {count} stamps {repeated} repeat the one before, {backward} go back"
                )?;
            }
            if scan.stamps.is_clock_unusable(count) {
                writeln!(
                    f,
                    "  {name}: its clock cannot be used: scans are mapped in the order of the file"
                )?;
            }
        }
        if none {
            writeln!(f, "  none")?;
        }
        for note in merge_alike(self.loss_notes.iter().map(String::as_str)) {
            writeln!(f, "    {note}")?;
        }
        if let Some(advice) = recover_advice(self.format, &self.losses, &self.path) {
            writeln!(f, "    {advice}")?;
        }
        Ok(())
    }

    /// Whether the stamps of no stream of scans can be used.
    pub(crate) fn has_no_clock(&self) -> bool {
        let mut stamps = self.scans.iter().map(|(_, scan)| &scan.stamps);
        !self.scans.is_empty() && stamps.all(|stamps| stamps.is_clock_unusable(stamps.count))
    }
}

/// How to make a whole file of a cut-off or damaged one; `None` if nothing is missing.
pub fn recover_advice(format: Format, losses: &DropCounts, path: &Path) -> Option<String> {
    let has_gaps = losses
        .iter()
        .any(|(reason, _)| matches!(reason, DropReason::CutOff | DropReason::Damaged));
    (has_gaps && format == Format::Mcap).then(|| {
        let file = shell_quoted(&path.display().to_string());
        format!("to save what is left: robot-edge recover {file} saved.mcap")
    })
}

const fn loss_in_words(reason: DropReason) -> &'static str {
    match reason {
        DropReason::Damaged => "damaged lines, records or chunks, passed over",
        DropReason::CutOff => "places where it ends in the middle of something",
        DropReason::Undecodable => "messages that do not match their type",
        DropReason::Lost => "packets that the sensor sent, and that are not there",
        DropReason::BadStamp => "stamps that are not finite or out of range",
        DropReason::BadPose => "poses that are not finite or no rotation",
        DropReason::BadScan => "scans without beams, or with angles that are not finite",
        _ => reason.as_str(),
    }
}

fn frame(name: &str) -> &str {
    if name.is_empty() { "(unnamed)" } else { name }
}

/// Three significant digits.
fn significant(value: f64) -> String {
    let decimals = match value {
        v if v >= 100.0 => 0,
        v if v >= 10.0 => 1,
        v if v >= 1.0 => 2,
        _ => 3,
    };
    format!("{value:.decimals$}")
}

/// First and last stamp: as dates if the clock was set, and as numbers.
struct Span((RobotTime, RobotTime));

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (first, last) = self.0;
        let [first_s, last_s] = [first, last].map(RobotTime::as_secs_f64);
        match span_label(first.as_nanos(), last.as_nanos()) {
            Some(dates) => write!(f, "{dates} ({first_s:.3} to {last_s:.3})"),
            None => write!(
                f,
                "stamps {first_s:.3} to {last_s:.3} s of a clock without a date"
            ),
        }
    }
}

struct Bytes(u64);

impl fmt::Display for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            bytes if bytes < 1_000_000 => write!(f, "{:.1} kB", bytes as f64 / 1e3),
            bytes if bytes < 1_000_000_000 => write!(f, "{:.1} MB", bytes as f64 / 1e6),
            bytes => write!(f, "{:.2} GB", bytes as f64 / 1e9),
        }
    }
}

struct Duration(RobotDuration);

impl fmt::Display for Duration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let seconds = self.0.as_secs_f64();
        if seconds.abs() < 100.0 {
            return write!(f, "{seconds:.1} s");
        }
        let whole = seconds as i64;
        let (hours, minutes, seconds) = (whole / 3600, whole / 60 % 60, whole % 60);
        if hours > 0 {
            write!(f, "{hours} h {minutes} min {seconds} s")
        } else {
            write!(f, "{minutes} min {seconds} s")
        }
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Mappable {
    Yes {
        laser: StreamId,
        pose_source: String,
        /// Whether a replay uses these poses only with `localization.source=auto`: the vehicle that the
        /// recording names is configured for others, which are missing.
        needs_auto: bool,
        /// Whether the sensor must be named: there are several, and they are not all assigned to a vehicle that
        /// the recording names.
        must_be_named: bool,
    },
    NoPoseSource,
    NoRangeSensor,
}

impl Survey {
    /// Chooses the range sensor with poses and the most scans.
    pub fn mappable(&self) -> Mappable {
        let vehicle = self.config_of_vehicle();
        let candidates = self.scans.iter().filter_map(|(stream, scan)| {
            Some((*stream, scan, self.poses(scan, vehicle.as_ref())?))
        });
        match candidates.max_by_key(|(_, scan, poses)| (!poses.1, scan.stamps.count)) {
            Some((stream, _, (pose_source, needs_auto))) => Mappable::Yes {
                laser: stream,
                pose_source,
                needs_auto,
                must_be_named: self.scans.len() > 1 && self.sensors_of_vehicle().is_none(),
            },
            None if self.scans.is_empty() => Mappable::NoRangeSensor,
            None => Mappable::NoPoseSource,
        }
    }

    /// The configuration of the vehicle that the recording names, if it is a preset.
    fn config_of_vehicle(&self) -> Option<Config> {
        let preset = presets::get(self.vehicle.as_deref()?).ok()?;
        config::load(preset.name, &[]).ok()
    }

    /// The range sensors of that vehicle with their streams, if all are assigned.
    fn sensors_of_vehicle(&self) -> Option<Vec<(String, StreamId)>> {
        let config = self.config_of_vehicle()?;
        let sensors = config.range_sensors();
        let assigned = self.assign(&sensors).ok()?;
        let named = sensors.iter().zip(assigned);
        let named = named.filter_map(|(sensor, stream)| Some((sensor.name.to_owned(), stream?)));
        Some(named.collect())
    }

    fn write_sensors_of_vehicle(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Some(vehicle), Some(sensors)) = (&self.vehicle, self.sensors_of_vehicle()) else {
            return Ok(());
        };
        if sensors.len() > 1 {
            let named = sensors
                .iter()
                .map(|(name, stream)| format!("{name} ({})", self.topic_name(*stream)));
            let named: Vec<_> = named.collect();
            writeln!(f, "  as {vehicle}, with {}", named.join(" and "))?;
        }
        Ok(())
    }

    /// Writes the command that makes pictures of the map, with the range sensor if it must be named, after the
    /// alternatives.
    fn write_replay(
        &self,
        f: &mut fmt::Formatter<'_>,
        laser: Option<StreamId>,
        options: &str,
    ) -> fmt::Result {
        let file = shell_quoted(&self.path.display().to_string());
        let topic = |stream| {
            let name = shell_quoted(self.topic_name(stream));
            format!("--topic laser={name}")
        };
        let named = laser.map(|laser| format!(" {}", topic(laser)));
        let named = named.unwrap_or_default();
        let others = self.scans.iter().map(|&(stream, _)| stream);
        for other in others.filter(|other| laser.is_some_and(|laser| laser != *other)) {
            writeln!(
                f,
                "  or with {} in the place of {}",
                topic(other),
                named.trim_start()
            )?;
        }
        writeln!(
            f,
            "  robot-edge replay {file}{named}{options} --export maps"
        )
    }

    pub(super) fn write_mappable(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.mappable() {
            Mappable::Yes {
                laser,
                pose_source,
                needs_auto,
                must_be_named,
            } => {
                writeln!(f, "  yes: {pose_source}")?;
                self.write_sensors_of_vehicle(f)?;
                let options = if needs_auto {
                    " --set localization.source=auto"
                } else {
                    ""
                };
                self.write_replay(f, must_be_named.then_some(laser), options)
            }
            Mappable::NoPoseSource => {
                writeln!(
                    f,
                    "  no: there are no poses of the sensor: neither odometry nor a"
                )?;
                writeln!(f, "  moving transform above {}", self.frames_of_scans())?;
                writeln!(f, "  if the vehicle stood still:")?;
                let several = self.scans.first().filter(|_| self.scans.len() > 1);
                let laser = several.map(|&(stream, _)| stream);
                self.write_replay(f, laser, " --set localization.source=static")
            }
            Mappable::NoRangeSensor => {
                writeln!(f, "  no: there is no planar range sensor in it")?;
                if self.clouds().next().is_some() {
                    writeln!(
                        f,
                        "  it has clouds of a three-dimensional lidar, for a vehicle with one:"
                    )?;
                    self.write_replay(f, None, " --vehicle generic3d")?;
                }
                Ok(())
            }
        }
    }

    fn frames_of_scans(&self) -> String {
        let mut frames: Vec<&str> = self.scans.iter().map(|(_, scan)| &*scan.frame).collect();
        frames.sort_unstable();
        frames.dedup();
        frames.join(", ")
    }
}

fn shell_quoted(text: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "/._-+:@%=,".contains(c);
    if !text.is_empty() && text.chars().all(plain) {
        text.to_owned()
    } else {
        format!("'{}'", text.replace('\'', r"'\''"))
    }
}

/// The source of the poses as text, and [`Mappable::Yes::needs_auto`].
type Poses = (String, bool);

impl Survey {
    /// The poses for `scan`. `vehicle` is the preset that the recording names.
    fn poses(&self, scan: &ScanSurvey, vehicle: Option<&Config>) -> Option<Poses> {
        let wanted = vehicle.map_or(PoseSource::Auto, |config| config.localization.source);
        let found = self.poses_from(wanted, scan, vehicle);
        if wanted == PoseSource::Auto {
            return Some((found?, false));
        }
        let name = self.vehicle.as_deref().unwrap_or_default();
        if let Some(found) = found {
            return Some((format!("{found}, as configured for {name}"), false));
        }
        let others = self.poses_from(PoseSource::Auto, scan, vehicle)?;
        let but = format!("{name} is configured for another pose source, which is not in it");
        Some((format!("{others}; {but}"), true))
    }

    /// As `runtime/plan.rs` decides with the configuration of the vehicle.
    fn poses_from(
        &self,
        source: PoseSource,
        scan: &ScanSurvey,
        vehicle: Option<&Config>,
    ) -> Option<String> {
        let bring = || "every scan brings its pose".to_owned();
        let own = || scan.has_own_poses.then(bring);
        let transforms = || self.transforms(scan, vehicle);
        let odometry = || self.describe_odometry();
        let wheels = || self.wheels_and_attitude(vehicle?);
        let fixes = || self.fixes_and_attitude(vehicle?);
        let matched = |prior: Option<String>| Some(format!("scans are matched; {}", prior?));
        match source {
            PoseSource::Auto => own()
                .or_else(transforms)
                .or_else(odometry)
                .or_else(wheels)
                .or_else(fixes),
            PoseSource::Log => own(),
            PoseSource::Tf => transforms(),
            PoseSource::Odometry => odometry(),
            PoseSource::Static => Some("the vehicle stands still".to_owned()),
            PoseSource::Wheels => wheels(),
            PoseSource::Gps => fixes(),
            PoseSource::Scan => Some("scans are matched".to_owned()),
            PoseSource::ScanWheels => {
                matched(own().or_else(odometry).or_else(transforms).or_else(wheels))
            }
            PoseSource::ScanImu => matched(self.attitude_alone(vehicle?)),
            PoseSource::ScanGps => matched(fixes()),
        }
    }

    fn transforms(&self, scan: &ScanSurvey, vehicle: Option<&Config>) -> Option<String> {
        let default = LocalizationConfig::default();
        let localization = vehicle.map_or(&default, |config| &config.localization);
        let base_frame = localization.base_frame.as_str();
        let wanted = localization.fixed_frame.as_deref();
        let lead = |start: &str| {
            let fixed_frame = self.frames.fixed_ancestor(start, base_frame, wanted)?;
            Some(format!("transforms lead from {start} to {fixed_frame}"))
        };
        [&*scan.frame, base_frame].into_iter().find_map(lead)
    }

    fn attitude_alone(&self, vehicle: &Config) -> Option<String> {
        the_imu(&vehicle.sensors)?;
        let stream = self.streams_with_orientation().first().copied()?;
        Some(format!("attitude of {}", self.topic_name(stream)))
    }

    fn describe_odometry(&self) -> Option<String> {
        let (stream, odometry) = self.best_odometry()?;
        let name = &self.stream(*stream)?.stream.name;
        Some(format!(
            "{name} gives poses of {} in {}",
            odometry.child, odometry.parent
        ))
    }

    fn wheels_and_attitude(&self, vehicle: &Config) -> Option<String> {
        let sensors = WheelsAndAttitude::of(&vehicle.sensors).ok()?;
        let (_, encoders) = sensors.encoders;
        let both = self.streams_with_joints(&[&encoders.left_joint, &encoders.right_joint]);
        let angles = self.topics(&both, encoders.topic.as_deref())?;
        let attitude = self.attitude_topics(sensors.imu.1)?;
        Some(format!(
            "wheels of {angles} and attitude of {attitude} give poses"
        ))
    }

    fn fixes_and_attitude(&self, vehicle: &Config) -> Option<String> {
        let sensors = FixesAndAttitude::of(&vehicle.sensors).ok()?;
        let fixes = self.topics(&self.streams_with_fix(), sensors.gps.1.topic.as_deref())?;
        let attitude = self.attitude_topics(sensors.imu.1)?;
        Some(format!(
            "satellite fixes of {fixes} and attitude of {attitude} give poses"
        ))
    }

    fn attitude_topics(&self, imu: &ImuConfig) -> Option<String> {
        self.topics(&self.streams_with_orientation(), imu.topic.as_deref())
    }

    /// The possible topics of a sensor: the configured one, or all. A replay with several requires a choice.
    fn topics(&self, streams: &[StreamId], configured: Option<&str>) -> Option<String> {
        let names = streams.iter().map(|&stream| self.topic_name(stream));
        let fits = |name: &&str| configured.is_none_or(|topic| topic == *name);
        let names: Vec<&str> = names.filter(fits).collect();
        (!names.is_empty()).then(|| names.join(" or "))
    }
}
