//! Command without a window: joins, waits until the map is synchronized, exports.

use std::io::{self, Write};
use std::mem;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context as _, Error, anyhow};
use edge::exit::{Exit, Interrupted};
use measurement::time::Monotonic;
use network::clock;
use protocol::layer::LayerId;
use protocol::tile::TileKey;

use crate::export::{ExportPart, Fetcher, Snapshot, export_parts};
use crate::model::{ConsoleModel, LinkState, Stream};
use crate::target::Target;

const POLL_PERIOD: Duration = Duration::from_millis(20);
/// Memory limit for tiles, megabytes: twice what a robot holds by default.
pub const STORE_MB: u32 = 512;

#[derive(Clone, Debug)]
pub struct Headless {
    /// Its timeout is the time for finding the robot and for synchronization beyond `watch_for`, both from the start.
    pub(crate) target: Target,
    pub(crate) export: PathBuf,
    /// Time to watch; default: until synchronized.
    pub(crate) watch_for: Option<Duration>,
}

impl Headless {
    fn say(&self, words: &str) {
        if !self.target.quiet {
            // A closed standard error is no reason to stop.
            drop(writeln!(io::stderr(), "{words}"));
        }
    }

    fn say_stale(&self, stale: &Stale, started: Monotonic) {
        let [from, until] = [stale.from, stale.until].map(|at| at.since(started).as_secs_f64());
        self.say(&format!(
            "pose or map was up to {:.1} s old, from {from:.1} s to {until:.1} s after the start",
            stale.age.as_secs_f64()
        ));
    }
}

/// Watches and exports. If the map is not synchronized, what arrived is written; without any message nothing is.
pub fn run(
    settings: &Headless,
    is_interrupted: impl Fn() -> bool,
    out: &mut dyn Write,
) -> anyhow::Result<Exit> {
    let started = clock::now();
    let target = &settings.target;
    settings.say(&target.looking());
    let robot = target.find(&is_interrupted)?;
    let discovered = clock::now();
    let answers = format!("robot {} answers at {}", robot.robot, robot.endpoint);
    let mut wait_for_robot = target.wait_for_robot(&robot);
    let layers = LayerId::ALL.into_iter().collect();
    let session = target
        .open(&robot, layers, STORE_MB)
        .context("cannot watch")?;

    session.model().set_unfinished(true);
    let mut join_timing = JoinTiming::new(discovered);
    let mut staleness = Staleness::default();
    let (mut was_connected, mut was_synchronized) = (false, false);
    let watched = watch(settings, &is_interrupted, started, || {
        let mut model = session.model();
        view_around_vehicle(&mut model);
        let now = clock::now();
        if model.connection().state(now) == LinkState::Waiting {
            wait_for_robot.report_progress(now);
        } else if !mem::replace(&mut was_connected, true) {
            wait_for_robot.end();
            settings.say(&answers);
        }
        // The picture shows the vehicle, so a pose is needed too.
        let is_placed = model.vehicle().pose().is_some() || is_empty(&model);
        let is_synchronized = model.is_synchronized(now) && is_placed;
        join_timing.update(&model, is_synchronized);
        if is_synchronized != was_synchronized {
            tracing::info!(is_synchronized, "synchronization");
            was_synchronized = is_synchronized;
        }
        if let Some(stale) = staleness.update(&model, now) {
            settings.say_stale(&stale, started);
        }
        let has_ended = model.has_ended();
        // A robot that has ended and is gone sends no further map head.
        (
            is_synchronized || (has_ended && model.matches_last_head()),
            has_ended,
        )
    });
    if let Some(stale) = &staleness.stale {
        settings.say_stale(stale, started);
    }
    let (_, messages) = session.model().connection().totals();
    match watched {
        // Empty files would look like results.
        Watched::TimedOut if messages == 0 => {
            return Err(wait_for_robot.conclusion(&is_interrupted));
        }
        Watched::Interrupted if messages == 0 => return Err(Interrupted.into()),
        Watched::Synchronized | Watched::TimedOut | Watched::Interrupted => {}
    }
    let handle = session.handle();
    // Fetch first: a robot whose data has ended does not wait while files are written.
    let mut parts: Vec<_> = ExportPart::all().collect();
    parts.sort_by_key(|part| !matches!(part, ExportPart::Trajectory | ExportPart::Voxels));
    // A map that is not synchronized is written as it is.
    let fetcher = matches!(watched, Watched::Synchronized)
        .then(|| Fetcher::begin(&handle, parts.iter().copied(), settings.target.timeout));
    let exported = export_parts(&settings.export, parts, |part, _| match &fetcher {
        Some(fetcher) => fetcher.fetch(part, |_| {
            if is_interrupted() {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        }),
        None => ControlFlow::Continue(Ok(Snapshot::of(&handle.lock(), part))),
    })?;
    drop(fetcher);
    session.model().set_unfinished(false);
    let model = session.model();
    if !settings.target.quiet {
        join_timing.print(&model, out)?;
        print_summary(&model, &exported.files, out)?;
    }
    if exported.is_cancelled {
        return Err(Interrupted.into());
    }
    exported.outcome(&settings.export).map_err(Error::msg)?;
    match watched {
        Watched::Synchronized => Ok(Exit::Done),
        Watched::Interrupted => Err(Interrupted.into()),
        Watched::TimedOut => Err(anyhow!(
            "{}; what came is in {}",
            not_synchronized(&model, session.problem(), clock::elapsed(started)),
            settings.export.display()
        )),
    }
}

fn not_synchronized(model: &ConsoleModel, problem: Option<String>, after: Duration) -> String {
    let missing: usize = model.map().layer_states().map(|step| step.missing).sum();
    let why = problem.map(|why| format!(" ({why})")).unwrap_or_default();
    let after_s = after.as_secs_f64();
    format!(
        "the map is not synchronized with the robot's after {after_s:.0} s{why}: {missing} tiles are known to be missing"
    )
}

fn is_empty(model: &ConsoleModel) -> bool {
    let store = model.map().store();
    store.grids().all(|grid| store.cells_known(grid.layer) == 0)
}

/// Requests what is near the vehicle first, as a window would.
fn view_around_vehicle(model: &mut ConsoleModel) {
    if let Some((pose, _)) = model.vehicle().pose() {
        let [x, y, _] = pose.position_m;
        let rectangle_m = [x - VISIBLE_M, y - VISIBLE_M, x + VISIBLE_M, y + VISIBLE_M];
        model.set_view(
            rectangle_m.map(|edge_m| edge_m as f32),
            LayerId::ALL.into_iter().collect(),
        );
    }
}

enum Watched {
    Synchronized,
    TimedOut,
    Interrupted,
}

fn watch(
    settings: &Headless,
    is_interrupted: &impl Fn() -> bool,
    started: Monotonic,
    mut look: impl FnMut() -> (bool, bool),
) -> Watched {
    let watch_for = settings.watch_for.unwrap_or(Duration::ZERO);
    loop {
        let (is_synchronized, has_ended) = look();
        let elapsed = clock::elapsed(started);
        if is_synchronized && (elapsed >= watch_for || has_ended) {
            return Watched::Synchronized;
        }
        if elapsed >= watch_for.saturating_add(settings.target.timeout) {
            return Watched::TimedOut;
        }
        if !clock::sleep_until(clock::now() + POLL_PERIOD, is_interrupted) {
            return Watched::Interrupted;
        }
    }
}

fn print_summary(model: &ConsoleModel, files: &[PathBuf], out: &mut dyn Write) -> io::Result<()> {
    let (bytes, messages) = model.connection().totals();
    writeln!(out, "{messages} messages of {bytes} bytes")?;
    for (why, count) in model.reject_counts().iter() {
        writeln!(out, "refused: {count} × {}", why.name())?;
    }
    let store = model.map().store();
    for grid in store.grids() {
        let digest = store
            .root_digest(grid.layer)
            .map(|digest| digest.to_string());
        writeln!(
            out,
            "{}: {} cells known, digest {}",
            grid.layer,
            store.cells_known(grid.layer),
            digest.unwrap_or_default()
        )?;
    }
    for file in files {
        writeln!(out, "{}", file.display())?;
    }
    Ok(())
}

/// Half the side of the square around the vehicle that counts as the visible area, metres.
const VISIBLE_M: f64 = 20.0;

/// Older data is reported once there is newer data.
const STALE_AFTER: Duration = Duration::from_secs(2);

/// Age of the newest pose or of the map, whichever is older: of the newest tiles, or of the newest map head that the map has matched.
#[derive(Debug, Default)]
struct Staleness {
    matched_head_at: Option<Monotonic>,
    stale: Option<Stale>,
}

#[derive(Clone, Copy, Debug)]
struct Stale {
    /// The greatest age.
    age: Duration,
    /// When it was stale for the first and for the last time.
    from: Monotonic,
    until: Monotonic,
}

impl Staleness {
    /// The time in which data was stale, once it is over.
    fn update(&mut self, model: &ConsoleModel, now: Monotonic) -> Option<Stale> {
        if model.matches_last_head() {
            self.matched_head_at = model.map().head_at();
        }
        let age = |stream| model.link_quality().age(stream, now);
        // A head matches for a moment only while the map changes.
        let head = now.since(self.matched_head_at?);
        let map = age(Stream::Tiles).map_or(head, |tiles| head.min(tiles));
        let age = age(Stream::Pose)?.max(map);
        if age <= STALE_AFTER {
            return self.stale.take();
        }
        let stale = self.stale.get_or_insert(Stale {
            age,
            from: now,
            until: now,
        });
        (stale.age, stale.until) = (stale.age.max(age), now);
        None
    }
}

#[derive(Clone, Copy, Debug)]
struct JoinTiming {
    discovered: Monotonic,
    pose: Option<Duration>,
    tile: Option<Duration>,
    synchronized: Option<Duration>,
}

impl JoinTiming {
    const fn new(discovered: Monotonic) -> Self {
        Self {
            discovered,
            pose: None,
            tile: None,
            synchronized: None,
        }
    }

    fn update(&mut self, model: &ConsoleModel, is_synchronized: bool) {
        let after = clock::elapsed(self.discovered);
        let note = |milestone: &mut Option<Duration>, is_there: bool| {
            if is_there {
                milestone.get_or_insert(after);
            }
        };
        note(&mut self.pose, model.vehicle().pose().is_some());
        let has_tiles = |layer| model.map().store().tiles(layer).next().is_some();
        note(&mut self.tile, LayerId::ALL.into_iter().any(has_tiles));
        note(&mut self.synchronized, is_synchronized);
    }

    /// Prints the times. The time of the visible area is meaningful only if the map did not change.
    fn print(&self, model: &ConsoleModel, out: &mut dyn Write) -> io::Result<()> {
        for (what, after) in [
            ("first pose", self.pose),
            ("first tile", self.tile),
            ("visible area", self.visible_area(model)),
            ("synchronized", self.synchronized),
        ] {
            if let Some(after) = after {
                writeln!(
                    out,
                    "{what}: {:.0} ms after discovery",
                    after.as_secs_f64() * 1e3
                )?;
            }
        }
        Ok(())
    }

    fn visible_area(&self, model: &ConsoleModel) -> Option<Duration> {
        let (pose, _) = model.vehicle().pose()?;
        let [x, y, _] = pose.position_m;
        let map = model.map();
        let is_near = |key: TileKey, cell_m: f64| {
            let [tile_x, tile_y] = key.center_m(cell_m);
            (tile_x - x).abs() <= VISIBLE_M && (tile_y - y).abs() <= VISIBLE_M
        };
        let near = map.store().grids().flat_map(|grid| {
            let tiles = map.store().tiles(grid.layer).map(|(key, _)| key);
            tiles.filter(move |key| is_near(*key, grid.cell_m))
        });
        let last = near.filter_map(|key| map.ages().received_at(key)).max()?;
        Some(last.since(self.discovered))
    }
}

#[cfg(test)]
mod tests {
    use protocol::keys::Topic;
    use protocol::tile::TileCells;

    use super::*;
    use crate::demo::free_endpoint;
    use crate::test_support::{announce_map, at, inject, pose_at_rest, push_tile, scout, store_of};

    #[test]
    fn stale_data_is_reported_once_it_is_new_again() {
        let (mut model, mut staleness) = (scout(), Staleness::default());
        let mut store = store_of(&[LayerId::Occupancy]);
        let mut reported = Vec::new();
        for ms in (0..20_000).step_by(100) {
            // The second time poses come back first, while the map is less old than they were.
            if !(3_000..9_000).contains(&ms) && !(12_600..15_300).contains(&ms) {
                announce_map(&mut model, &store, at(ms));
            }
            if ms == 5_000 {
                drop(store.publish(KEY, TileCells::from_fn(|_, _| 7)).unwrap());
                push_tile(&mut model, &store, KEY, at(ms));
            }
            if !(12_000..15_000).contains(&ms) {
                inject(&mut model, Topic::Pose, &pose_at_rest(), at(ms));
            }
            let stale = staleness.update(&model, at(ms));
            reported
                .extend(stale.map(|stale| [at(ms), stale.from, stale.until, at(0) + stale.age]));
        }
        let expected = [
            [9_000, 7_100, 8_900, 3_900],
            [15_300, 14_000, 15_200, 3_000],
        ];
        assert_eq!(reported, expected.map(|row| row.map(at)));
    }

    const KEY: TileKey = TileKey {
        layer: LayerId::Occupancy,
        tx: 0,
        ty: 0,
    };

    fn of_nobody(endpoint: &str, export: PathBuf) -> Headless {
        Headless {
            target: Target {
                connect: vec![endpoint.to_owned()],
                robot: Some("nobody".parse().unwrap()),
                zenoh_config: None,
                credentials: None,
                timeout: Duration::from_millis(100),
                quiet: false,
            },
            export,
            watch_for: None,
        }
    }

    #[test]
    fn silent_robot_writes_no_files() {
        let folder = tempfile::tempdir().unwrap();
        let endpoint = free_endpoint().unwrap();
        let settings = of_nobody(&endpoint, folder.path().join("maps"));
        let mut out = Vec::new();
        let error = run(&settings, || false, &mut out).unwrap_err().to_string();
        let expected = format!("there is no robot at {endpoint} (no answer there); ");
        assert!(error.starts_with(&expected), "{error}");
        assert!(!settings.export.exists() && out.is_empty());
    }

    #[test]
    fn robot_at_another_address_is_searched() {
        let mut settings = of_nobody("tcp/boat:7447", PathBuf::new());
        let looking = |settings: &Headless| settings.target.looking();
        assert_eq!(
            looking(&settings),
            "looking for robot nobody at tcp/boat:7447"
        );
        settings.target.robot = None;
        settings.target.connect.push("tcp/barge:7447".to_owned());
        assert_eq!(
            looking(&settings),
            "looking for a robot at tcp/boat:7447, tcp/barge:7447"
        );
        settings.target.connect.clear();
        assert_eq!(
            looking(&settings),
            "looking for a robot on the local network"
        );
    }
}
