//! Poses from the scans and the raw odometry of a CARMEN log, measured:
//! `cargo run --release -p localization --example evaluate_scan_matching -- LOG [relations=FILE] [picture=FILE.png]
//! [odometry=no] [revisits=yes] [pairs=yes] [kidnapped=STARTS [from=OTHER_LOG]]`

use std::collections::BTreeMap;
use std::error::Error;
use std::io::Write;
use std::path::Path;

use localization::scan_matching::loop_closure::search_points;
use localization::scan_matching::relations::{Relation, Spread};
use localization::scan_matching::relocalization::Relocalizer;
use localization::scan_matching::scan_points::{PointLimits, ScanPoint, scan_points};
use localization::scan_matching::search_grid::{Search, SearchWindow};
use localization::scan_matching::slam::{Confidence, ScanInput, ScanSlam};
use localization::scan_matching::slam_settings::SlamSettings;
use localization::scan_matching::submap::Submap;
use measurement::MeasurementData;
use measurement::pose::{Pose, yaw_rad};
use measurement::scan::Scan;
use measurement::time::RobotTime;
use nalgebra::{Isometry2, Point2};
use rand_chacha::rand_core::{Rng, SeedableRng};
use recording::Selection;

struct LogScan {
    stamp: RobotTime,
    scan: Scan,
    base_from_sensor: Isometry2<f64>,
    odom_from_base: Isometry2<f64>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let log = arguments.next().ok_or("name a CARMEN log")?;
    let options: BTreeMap<String, String> = arguments
        .filter_map(|option| {
            let (name, value) = option.split_once('=')?;
            Some((name.to_owned(), value.to_owned()))
        })
        .collect();
    let scans = read_scans(Path::new(&log))?;
    let has_odometry = options.get("odometry").is_none_or(|value| value != "no");
    let mut out = std::io::stdout();

    let mut slam = ScanSlam::new(SlamSettings::default());
    let mut poses = Vec::new();
    let mut times_ms = Vec::new();
    let mut counts = [0_usize; 4];
    let mut corrections = 0;
    let mut residuals = Vec::new();
    for scan in &scans {
        let begin_ms = used_ms();
        let pose = slam.push(&input(scan, has_odometry));
        times_ms.push(used_ms() - begin_ms);
        counts[match pose.confidence {
            Confidence::Full => 0,
            Confidence::UncertainAlong(_) => 1,
            Confidence::OdometryOnly => 2,
            Confidence::Lost => 3,
        }] += 1;
        corrections += usize::from(pose.is_corrected);
        residuals.push(pose.residual_m);
        let is_lost = pose.confidence == Confidence::Lost;
        poses.push((pose.keyframe, pose.keyframe_from_base, is_lost));
    }
    slam.finish();
    let keyframes = slam.map().keyframes();
    let piece_of = slam.map().pieces();
    let pieces: Vec<_> = poses
        .iter()
        .map(|(at, _, is_lost)| (!is_lost).then(|| piece_of[*at as usize]))
        .collect();
    let poses: Vec<_> = poses
        .iter()
        .map(|(at, own, _)| keyframes[*at as usize] * own)
        .collect();
    let total_s = times_ms.iter().sum::<f64>() / 1e3;
    let span_s = scans[scans.len() - 1]
        .stamp
        .since(scans[0].stamp)
        .as_secs_f64();
    times_ms.sort_by(f64::total_cmp);
    let at = |share: f64| times_ms[((times_ms.len() - 1) as f64 * share) as usize];
    let closures = slam.closures();
    writeln!(
        out,
        "{} scans, {} keyframes, {} closures, {} removed, {corrections} corrections\n\
         confidence: full {}, along one direction not {}, odometry only {}, lost {}; residual {:.4} m\n\
         {total_s:.1} s, {:.0} x real time; a scan p50 {:.2} ms, p99 {:.2} ms, most {:.2} ms; resident at most {} MB",
        scans.len(),
        keyframes.len(),
        closures.added,
        closures.removed,
        counts[0],
        counts[1],
        counts[2],
        counts[3],
        Spread::of(&residuals).mean,
        span_s / total_s,
        at(0.5),
        at(0.99),
        at(1.0),
        peak_mb(),
    )?;
    let mut sizes = BTreeMap::new();
    for piece in pieces.iter().flatten() {
        *sizes.entry(*piece).or_insert(0_usize) += 1;
    }
    if sizes.len() > 1 {
        let sizes: Vec<_> = sizes.values().collect();
        writeln!(out, "{} pieces, of {sizes:?} scans", sizes.len())?;
    }
    if let Some(file) = options.get("relations") {
        let text = std::fs::read_to_string(file)?;
        for (name, errors) in relation_errors(&text, &scans, &poses, &pieces) {
            let [m, rad]: [Vec<f64>; 2] = [
                errors.iter().map(|e| e.0).collect(),
                errors.iter().map(|e| e.1).collect(),
            ];
            let (m, rad) = (Spread::of(&m), Spread::of(&rad));
            let mut sorted: Vec<_> = errors.iter().map(|e| e.0).collect();
            sorted.sort_by(f64::total_cmp);
            writeln!(
                out,
                "{name}: {} relations, {:.4} ± {:.4} m, {:.3} ± {:.3}°, median {:.4} m, p95 {:.3} m, most {:.3} m",
                m.count,
                m.mean,
                m.deviation,
                rad.mean.to_degrees(),
                rad.deviation.to_degrees(),
                sorted[sorted.len() / 2],
                sorted[sorted.len() * 95 / 100],
                sorted[sorted.len() - 1],
            )?;
        }
    }
    if let (Some(file), true) = (options.get("relations"), options.contains_key("pairs")) {
        measure_pairs(&mut out, &std::fs::read_to_string(file)?, &scans, &poses)?;
    }
    if let Some(starts) = options.get("kidnapped") {
        let other = options.get("from");
        let other = other.map(|file| read_scans(Path::new(file))).transpose()?;
        measure_kidnapped(&mut out, &scans, &poses, other.as_deref(), starts.parse()?)?;
    }
    if options.contains_key("revisits") {
        measure_revisits(&mut out, &scans, &poses)?;
    }
    if let Some(file) = options.get("picture") {
        draw(Path::new(file), &scans, &poses)?;
    }
    Ok(())
}

fn input(scan: &LogScan, has_odometry: bool) -> ScanInput<'_> {
    ScanInput {
        stamp: scan.stamp,
        scan: &scan.scan,
        base_from_sensor: scan.base_from_sensor,
        odom_from_base: has_odometry.then_some(scan.odom_from_base),
        is_heading_only: false,
        is_by_clouds: false,
        is_placed: false,
        base_from_antenna: Point2::origin(),
    }
}

fn planar(pose: &Pose) -> Isometry2<f64> {
    Isometry2::new(pose.translation.vector.xy(), yaw_rad(pose))
}

fn read_scans(path: &Path) -> Result<Vec<LogScan>, Box<dyn Error>> {
    let mut reader = recording::open(path, Selection::All)?;
    let mut scans = Vec::new();
    while let Some(measurement) = reader.next_measurement()? {
        if let MeasurementData::Scan {
            scan,
            own_pose: Some(own),
        } = measurement.data
        {
            let base_from_sensor = own.odom_from_base.inv_mul(&own.odom_from_sensor);
            scans.push(LogScan {
                stamp: measurement.stamp,
                scan,
                base_from_sensor: planar(&base_from_sensor),
                odom_from_base: planar(&own.odom_from_base),
            });
        }
    }
    Ok(scans)
}

fn relation_errors(
    text: &str,
    scans: &[LogScan],
    poses: &[Isometry2<f64>],
    pieces: &[Option<u32>],
) -> BTreeMap<String, Vec<(f64, f64)>> {
    let by_stamp: BTreeMap<RobotTime, usize> = scans
        .iter()
        .enumerate()
        .map(|(at, scan)| (scan.stamp, at))
        .collect();
    let nearest = |stamp: RobotTime| {
        let after = by_stamp.range(stamp..).next();
        let before = by_stamp.range(..stamp).next_back();
        let near = after.into_iter().chain(before);
        near.min_by_key(|(own, _)| own.since(stamp).as_nanos().abs())
            .map_or(0, |(_, at)| *at)
    };
    let mut errors: BTreeMap<String, Vec<_>> = BTreeMap::new();
    for relation in text.lines().filter_map(Relation::parse) {
        let (pair, kind) = match relation.remarks.as_slice() {
            [first, second, kind] => (
                [first, second].map(|number| number.parse().unwrap_or(0)),
                match kind.as_str() {
                    "c" => "consecutive",
                    _ => "revisited",
                },
            ),
            _ => (relation.stamps.map(nearest), "all"),
        };
        let [first, second] = pair.map(|at| &poses[at]);
        let [piece, other] = pair.map(|at| pieces[at]);
        let across = if piece.is_some() && piece == other {
            ""
        } else {
            ", between pieces or lost (of no meaning)"
        };
        errors
            .entry(format!("{kind}{across}"))
            .or_default()
            .push(relation.error(first, second));
    }
    errors
}

/// Which is right where poses and relations differ, the two scans say: the second is registered with the first alone, from
/// the relation, and from the poses.
fn measure_pairs(
    out: &mut impl Write,
    text: &str,
    scans: &[LogScan],
    poses: &[Isometry2<f64>],
) -> Result<(), Box<dyn Error>> {
    let mut angles_deg = [Vec::new(), Vec::new(), Vec::new()];
    let mut differing = 0;
    for relation in text.lines().filter_map(Relation::parse) {
        let [first, second, kind] = relation.remarks.as_slice() else {
            continue;
        };
        let [first, second]: [usize; 2] = [first.parse()?, second.parse()?];
        let mut submap = Submap::default();
        for point in points_of(&scans[first], 30.0) {
            submap.add(&point);
        }
        let points = points_of(&scans[second], 30.0);
        let own = poses[first].inv_mul(&poses[second]);
        let register = |start: &Isometry2<f64>| submap.register(&points, start, None);
        let by_own = register(&own);
        let by_relation = register(&relation.first_from_second);
        // Of two minima the one with more inliers.
        let best = if by_own.inliers >= by_relation.inliers {
            by_own
        } else {
            by_relation
        };
        let deg = |a: &Isometry2<f64>, b: &Isometry2<f64>| {
            a.rotation.angle_to(&b.rotation).abs().to_degrees()
        };
        if best.inliers < 0.6 || best.degenerate > 0 {
            if deg(&own, &relation.first_from_second) > 1.0 {
                writeln!(
                    out,
                    "scans {first} and {second} ({kind}): poses and relation differ by {:.2}°, the scans do not decide; inliers {:.2}",
                    deg(&own, &relation.first_from_second),
                    best.inliers,
                )?;
            }
            continue;
        }
        let pose = best.submap_from_base;
        angles_deg[0].push(deg(&own, &relation.first_from_second));
        angles_deg[1].push(deg(&own, &pose));
        angles_deg[2].push(deg(&relation.first_from_second, &pose));
        if deg(&own, &relation.first_from_second) > 1.0 {
            differing += 1;
            writeln!(
                out,
                "scans {first} and {second} ({kind}): poses and relation differ by {:.2}°, poses and scans by {:.2}°, \
                 relation and scans by {:.2}°, inliers {:.2}",
                deg(&own, &relation.first_from_second),
                deg(&own, &pose),
                deg(&relation.first_from_second, &pose),
                best.inliers,
            )?;
        }
    }
    let [both, own, relation] = angles_deg.map(|angles| Spread::of(&angles));
    writeln!(
        out,
        "pairs: {} relations that the scans decide, {differing} differ by more than 1°; mean angle of poses and relations {:.3}°, \
         poses and scans {:.3}°, relations and scans {:.3}°",
        both.count, both.mean, own.mean, relation.mean,
    )?;
    Ok(())
}

/// A start must be found on this way.
const MAX_WAY_M: f64 = 10.0;

/// A map of the even scans, and starts at random odd ones: whether the vehicle is found within 10 m of driving. Starts in
/// another log must not be found.
fn measure_kidnapped(
    out: &mut impl Write,
    scans: &[LogScan],
    all_poses: &[Isometry2<f64>],
    other: Option<&[LogScan]>,
    starts: u32,
) -> Result<(), Box<dyn Error>> {
    let settings = SlamSettings::default();
    let matched = |scans: &[LogScan]| {
        let mut slam = ScanSlam::new(settings);
        let even = scans.iter().step_by(2);
        let poses: Vec<_> = even.map(|scan| slam.push(&input(scan, true))).collect();
        slam.finish();
        (slam, poses)
    };
    let (slam, poses) = matched(scans);
    let map = slam.map();
    // An odd scan is where the poses by all scans have it, from the even one before.
    let truth = |odd: usize| {
        let even = &poses[odd / 2];
        let step = all_poses[odd - 1].inv_mul(&all_poses[odd]);
        map.keyframes()[even.keyframe as usize] * even.keyframe_from_base * step
    };
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    let (mut found, mut wrong, mut ways_m, mut worst) = (0, 0, Vec::new(), (0.0_f64, 0.0_f64));
    let mut times_ms = Vec::new();
    let other = other.map(|other| (other, matched(other).1));
    let (driven, driven_poses) = other
        .as_ref()
        .map_or((scans, &poses), |(other, poses)| (*other, poses));
    // Each start has the way before it that it may take.
    let mut left_m = 0.0;
    let steps = driven_poses.windows(2).rev().take_while(|pair| {
        let [a, b] = [0, 1].map(|end| pair[end].local_from_base.translation.vector);
        left_m += (a - b).norm();
        left_m < MAX_WAY_M
    });
    let last_start = driven_poses.len().saturating_sub(steps.count() + 1).max(1);
    for _ in 0..starts {
        let start = 2 * (random.next_u32() as usize % last_start) + 1;
        let mut slam = ScanSlam::new(settings);
        let mut relocalizer = Relocalizer::default();
        let (mut driven_m, mut last) = (0.0, None::<Isometry2<f64>>);
        let mut is_placed = false;
        for odd in (start..driven.len()).step_by(2) {
            let pose = slam.push(&input(&driven[odd], true)).local_from_base;
            let step = last.map_or(0.0, |last| {
                (pose.translation.vector - last.translation.vector).norm()
            });
            driven_m += step;
            last = Some(pose);
            if driven_m > MAX_WAY_M {
                break;
            }
            let begin_ms = used_ms();
            let points = || slam.surroundings();
            let place = relocalizer.update(map, &pose, points, None, &settings.closure);
            times_ms.extend(Some(used_ms() - begin_ms).filter(|time_ms| *time_ms > 1.0));
            let Some(place) = place else {
                continue;
            };
            is_placed = true;
            let (m, rad) = if other.is_some() {
                (f64::INFINITY, 0.0)
            } else {
                let error = truth(odd).inv_mul(&place.map_from_base);
                (
                    error.translation.vector.norm(),
                    error.rotation.angle().abs(),
                )
            };
            if m < 0.2 && rad < 2_f64.to_radians() {
                found += 1;
                ways_m.push(driven_m);
                worst = (worst.0.max(m), worst.1.max(rad));
            } else {
                wrong += 1;
                writeln!(
                    out,
                    "wrong: start {start}, scan {odd}, after {driven_m:.1} m: {m:.2} m, {:.1}°, explained {:.3}",
                    rad.to_degrees(),
                    place.explained
                )?;
            }
            break;
        }
        if !is_placed {
            let explained = relocalizer.places().iter().map(|place| place.explained);
            let explained: Vec<_> = explained.take(3).collect();
            writeln!(
                out,
                "not found: start {start}, after {driven_m:.1} m; the best places explain {explained:.3?}"
            )?;
        }
    }
    ways_m.sort_by(f64::total_cmp);
    times_ms.sort_by(f64::total_cmp);
    writeln!(
        out,
        "kidnapped: {found} of {starts} found, {wrong} wrong; after {:.1} m in the median, {:.1} m at most; \
         error at most {:.3} m, {:.2}°; {} updates in {} submaps, {:.0} ms in the median, {:.0} ms at most",
        ways_m.get(ways_m.len() / 2).copied().unwrap_or(0.0),
        ways_m.last().copied().unwrap_or(0.0),
        worst.0,
        worst.1.to_degrees(),
        times_ms.len(),
        map.submap_count(),
        times_ms.get(times_ms.len() / 2).copied().unwrap_or(0.0),
        times_ms.last().copied().unwrap_or(0.0),
    )?;
    Ok(())
}

/// The offset of walls between two visits of a place, at least 60 s apart: how far what the second shows must be moved to
/// lie on what the first shows, in the directions that it determines. A visit shows the scans up to 5 m of driving before
/// and after, for the vehicle may have driven the other way.
fn measure_revisits(
    out: &mut impl Write,
    scans: &[LogScan],
    poses: &[Isometry2<f64>],
) -> Result<(), Box<dyn Error>> {
    const AROUND_M: f64 = 5.0;
    let mut driven_m = vec![0.0; poses.len()];
    for at in 1..poses.len() {
        let step = poses[at].translation.vector - poses[at - 1].translation.vector;
        driven_m[at] = driven_m[at - 1] + step.norm();
    }
    let visit = |middle: usize| {
        let mut submap = Submap::default();
        let begin = driven_m.partition_point(|m| *m < driven_m[middle] - AROUND_M);
        let end = driven_m.partition_point(|m| *m <= driven_m[middle] + AROUND_M);
        for at in begin..end {
            let pose = poses[middle].inv_mul(&poses[at]);
            for point in points_of(&scans[at], 15.0) {
                submap.add(&point.in_frame(&pose));
            }
        }
        submap
    };
    let (mut offsets, mut without, mut last_m) = (Vec::new(), 0, f64::NEG_INFINITY);
    for at in 0..scans.len() {
        let here = poses[at].translation.vector;
        let is_visit = |other: &usize| {
            (poses[*other].translation.vector - here).norm() < 1.0
                && scans[at].stamp.since(scans[*other].stamp).as_secs_f64() >= 60.0
                && driven_m[at] - driven_m[*other] > 2.0 * AROUND_M
        };
        if driven_m[at] - last_m < 1.0 {
            continue;
        }
        let Some(other) = (0..at).find(is_visit) else {
            continue;
        };
        last_m = driven_m[at];
        let first = visit(other);
        let own: Vec<ScanPoint> = visit(at).points().collect();
        let start = poses[other].inv_mul(&poses[at]);
        let window = SearchWindow {
            middle: start,
            half_m: [1.5; 2],
            half_rad: 0.1,
            min_score: 0.3,
            prior: Some((0.05, 1.0, 0.1)),
        };
        let mut search = Search::new(&search_points(&own), window);
        search.advance(&first.search_grid(), usize::MAX);
        let registered = search
            .best()
            .map(|found| first.register(&own, &found.pose, None));
        let Some(registered) = registered.filter(|registered| registered.inliers > 0.4) else {
            without += 1;
            continue;
        };
        let mut step = registered.submap_from_base.translation.vector - start.translation.vector;
        if let Some(along) = registered.uncertain_along {
            let along = registered.submap_from_base.rotation * along;
            step -= along * step.dot(&along);
        }
        offsets.push(step.norm());
    }
    offsets.sort_by(f64::total_cmp);
    let at = |share: f64| {
        offsets
            .get(((offsets.len().max(1) - 1) as f64 * share) as usize)
            .copied()
            .unwrap_or(0.0)
    };
    writeln!(
        out,
        "revisits: {} measured, {without} do not match; offset median {:.3} m, p95 {:.3} m, most {:.3} m",
        offsets.len(),
        at(0.5),
        at(0.95),
        at(1.0),
    )?;
    Ok(())
}

/// Hits up to this range, in the frame of the vehicle.
fn points_of(scan: &LogScan, max_range_m: f64) -> Vec<ScanPoint> {
    let limits = PointLimits {
        max_range_m,
        ..SlamSettings::default().points
    };
    scan_points(
        &scan.scan,
        &scan.base_from_sensor,
        (&Isometry2::identity(), 0.0),
        &limits,
    )
}

/// Hits dark, the way of the vehicle from blue to red.
fn draw(path: &Path, scans: &[LogScan], poses: &[Isometry2<f64>]) -> Result<(), Box<dyn Error>> {
    const MAX_SIDE: f64 = 2000.0;
    let mut hits: Vec<Point2<f64>> = Vec::new();
    for (scan, pose) in scans.iter().zip(poses) {
        let points = points_of(scan, 20.0);
        hits.extend(points.iter().map(|point| pose * point.position));
    }
    let bound = |pick: fn(f64, f64) -> f64, axis: usize, start| {
        hits.iter().map(|p| p[axis]).fold(start, pick)
    };
    let low = [bound(f64::min, 0, f64::MAX), bound(f64::min, 1, f64::MAX)];
    let high = [bound(f64::max, 0, f64::MIN), bound(f64::max, 1, f64::MIN)];
    let cell_m = ((high[0] - low[0]).max(high[1] - low[1]) / MAX_SIDE).max(0.05);
    let size = [0, 1].map(|axis| ((high[axis] - low[axis]) / cell_m) as usize + 1);
    let place = |p: &Point2<f64>| {
        let [x, y] = [0, 1].map(|axis| ((p[axis] - low[axis]) / cell_m) as usize);
        (size[1] - 1 - y.min(size[1] - 1)) * size[0] + x.min(size[0] - 1)
    };
    let mut counts = vec![0_u32; size[0] * size[1]];
    for hit in &hits {
        counts[place(hit)] += 1;
    }
    let mut image: Vec<u8> = counts
        .iter()
        .flat_map(|count| [255 - (count * 40).min(255) as u8; 3])
        .collect();
    for (at, pose) in poses.iter().enumerate() {
        let pixel = place(&Point2::from(pose.translation.vector)) * 3;
        let share = (at * 255 / poses.len()) as u8;
        image[pixel..pixel + 3].copy_from_slice(&[share, 80, 255 - share]);
    }
    let file = std::io::BufWriter::new(std::fs::File::create(path)?);
    let mut encoder = png::Encoder::new(file, size[0] as u32, size[1] as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header()?.write_image_data(&image)?;
    Ok(())
}

/// Time that this thread has run, milliseconds: others may use the processor too. 0 where the system does not say.
fn used_ms() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanos = text
        .split(' ')
        .next()
        .and_then(|nanos| nanos.parse::<f64>().ok());
    nanos.unwrap_or(0.0) / 1e6
}

/// Greatest resident memory so far, megabytes; 0 where the system does not say.
fn peak_mb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let number = line.and_then(|line| line.trim().split(' ').next()?.parse::<u64>().ok());
    number.map_or(0, |kb| kb / 1024)
}
