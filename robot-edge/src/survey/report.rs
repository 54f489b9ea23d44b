//! The page that `robot-edge info` prints.

use std::collections::BTreeSet;
use std::fmt;

use super::Survey;
use super::scans::ScanSurvey;
use super::stamps::StampSurvey;
use measurement::drops::DropReason;
use measurement::time::RobotDuration;
use measurement::{FrameId, GeodeticFix};

/// Joints of one stream that the page lists.
const MAX_JOINTS_LISTED: usize = 12;

impl fmt::Display for Survey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write_file(f)?;
        self.write_topics(f)?;
        if !self.scans.is_empty() {
            writeln!(f, "\nrange sensors")?;
        }
        for scan in &self.scans {
            self.write_scan(f, scan)?;
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
            Some((first, last)) => {
                writeln!(
                    f,
                    "  {}, from {:.3} to {:.3}",
                    Duration(self.duration()),
                    first.as_secs_f64(),
                    last.as_secs_f64()
                )?;
            }
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
            match (summary.understood, stamps.rate_hz()) {
                (false, _) => writeln!(f, "not read: no sensor data that is understood")?,
                (true, Some(rate)) => writeln!(f, "{} Hz", significant(rate))?,
                (true, None) => writeln!(f, "-")?,
            }
        }
        Ok(())
    }

    fn write_scan(&self, f: &mut fmt::Formatter<'_>, scan: &ScanSurvey) -> fmt::Result {
        let name = self
            .stream(scan.stream)
            .map_or("", |summary| &summary.stream.name);
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
        let name = |stream| {
            self.stream(stream)
                .map_or("", |summary| &*summary.stream.name)
        };
        if !self.joints.is_empty() {
            writeln!(f, "\njoints")?;
        }
        for joints in &self.joints {
            let listed: Vec<_> = joints
                .names
                .iter()
                .map(String::as_str)
                .take(MAX_JOINTS_LISTED)
                .collect();
            let more = joints.names.len() - listed.len();
            write!(f, "  {}: {}", name(joints.stream), listed.join(", "))?;
            if more > 0 {
                write!(f, " and {more} more")?;
            }
            writeln!(f)?;
        }
        if !self.attitudes.is_empty() {
            writeln!(f, "\nattitudes")?;
        }
        for attitudes in &self.attitudes {
            writeln!(
                f,
                "  {}: {} of {} give an orientation",
                name(attitudes.stream),
                attitudes.oriented,
                attitudes.count
            )?;
        }
        if !self.fixes.is_empty() {
            writeln!(f, "\nsatellite fixes")?;
        }
        for fixes in &self.fixes {
            write!(
                f,
                "  {}: {} of {} are a fix",
                name(fixes.stream),
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
        for odometry in &self.odometry {
            let name = self
                .stream(odometry.stream)
                .map_or("", |summary| &summary.stream.name);
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
        // Damage can give a frame several parents, or make it its own ancestor.
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
        for scan in &self.scans {
            let StampSurvey {
                count,
                repeated,
                backward,
                ..
            } = scan.stamps;
            let name = self
                .stream(scan.stream)
                .map_or("", |summary| &summary.stream.name);
            if repeated + backward > 0 {
                none = false;
                writeln!(
                    f,
                    "  {name}: of {count} stamps {repeated} repeat the one before, {backward} go back"
                )?;
            }
        }
        if none {
            writeln!(f, "  none")?;
        }
        for note in &self.loss_notes {
            writeln!(f, "    {note}")?;
        }
        Ok(())
    }
}

const fn loss_in_words(reason: DropReason) -> &'static str {
    match reason {
        DropReason::Damaged => "damaged lines, records or chunks, passed over",
        DropReason::CutOff => "places where it ends in the middle of something",
        DropReason::Undecodable => "messages that do not match their type, and unorganised clouds",
        DropReason::BadStamp => "stamps that are not finite or out of range",
        DropReason::BadPose => "poses that are not finite or no rotation",
        DropReason::BadScan => "scans without beams, or with angles that are not finite",
        DropReason::Late
        | DropReason::WheelJump
        | DropReason::NoFix
        | DropReason::BadFix
        | DropReason::GnssOutlier
        | DropReason::PoseJump
        | DropReason::NoPose
        | DropReason::BeforeFirstPose
        | DropReason::PoseGap
        | DropReason::AfterLastPose
        | DropReason::QueueFull
        | DropReason::InvalidRange
        | DropReason::OwnBody
        | DropReason::Isolated
        | DropReason::OutOfBounds
        | DropReason::OutsideWindow => reason.as_str(),
    }
}

/// A frame's name, or that it has none.
fn frame(name: &str) -> &str {
    if name.is_empty() { "(unnamed)" } else { name }
}

/// Three digits that count.
fn significant(value: f64) -> String {
    let decimals = match value {
        v if v >= 100.0 => 0,
        v if v >= 10.0 => 1,
        v if v >= 1.0 => 2,
        _ => 3,
    };
    format!("{value:.decimals$}")
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
