//! No window: joins, waits until the map is synchronized, writes the exports.

use std::io::{self, Write};
use std::mem;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context as _, Error, anyhow};
use measurement::time::Monotonic;
use protocol::keys::RobotId;
use protocol::layer::LayerId;
use protocol::tile::BootId;
use robot_edge::clock;
use robot_edge::credentials::Credentials;
use robot_edge::exit::{Exit, Interrupted};
use robot_edge::link::sessions::Endpoints;
use robot_edge::link::{random_id, zenoh_config_file};

use crate::export::{ExportPart, Fetcher, Snapshot, export_parts};
use crate::join_timing::{JoinTiming, VISIBLE_M};
use crate::link::RobotSession;
use crate::model::{ConsoleModel, LinkState, ModelSettings};
use crate::target::Target;

/// Between two looks at the model.
const POLL_PERIOD: Duration = Duration::from_millis(20);
/// Most memory for tiles, megabytes: twice what a robot holds by default.
pub const STORE_MB: u32 = 512;

/// What to watch and where to write it.
#[derive(Clone, Debug)]
pub struct Headless {
    /// Addresses to ask; where there are none the network is searched.
    pub connect: Vec<String>,
    /// Which robot; else the only one there is.
    pub robot: Option<RobotId>,
    /// A Zenoh configuration.
    pub zenoh_config: Option<PathBuf>,
    /// Who the operator is, where the link is secured.
    pub credentials: Option<Credentials>,
    /// Where to write.
    pub export: PathBuf,
    /// How long to watch, if not until the first time synchronized.
    pub watch_for: Option<Duration>,
    /// How long to wait for a robot and until the map is synchronized, beyond `watch_for`, both from the start.
    pub timeout: Duration,
    /// Say nothing.
    pub quiet: bool,
}

impl Headless {
    fn target(&self) -> Target {
        Target {
            connect: self.connect.clone(),
            robot: self.robot.clone(),
            zenoh_config: self.zenoh_config.clone(),
            credentials: self.credentials.clone(),
            timeout: self.timeout,
            quiet: self.quiet,
        }
    }

    /// Says how far it is, on standard error.
    fn say(&self, words: &str) {
        if !self.quiet {
            // What cannot be said keeps nobody from watching.
            drop(writeln!(io::stderr(), "{words}"));
        }
    }
}

/// Watches and exports. Whatever keeps the map from being synchronized, what came is written; where nothing was heard of the
/// robot, nothing is.
///
/// # Errors
/// Where there is no robot, several and none was named, the map is not synchronized in time, or a file cannot be
/// written.
pub fn run(
    settings: &Headless,
    is_interrupted: impl Fn() -> bool,
    out: &mut dyn Write,
) -> anyhow::Result<Exit> {
    let started = clock::now();
    let target = settings.target();
    settings.say(&target.looking());
    let robot = target.find(&is_interrupted)?;
    let discovered = clock::now();
    let answers = format!("robot {} answers at {}", robot.robot, robot.endpoint);
    let mut wait_for_robot = target.wait_for_robot(&robot);
    let model = ModelSettings {
        robot: robot.robot,
        session: BootId(random_id()?),
        tile_store_mb: STORE_MB,
        layers: LayerId::ALL.into_iter().collect(),
    };
    let endpoints = Endpoints {
        connect: vec![robot.endpoint],
        zenoh_config: zenoh_config_file(settings.zenoh_config.clone()),
        credentials: settings.credentials.clone(),
        ..Endpoints::default()
    };
    let session = RobotSession::open(model, &endpoints, || {}).context("cannot watch")?;

    session.model().set_unfinished(true);
    let mut join_timing = JoinTiming::new(discovered);
    let (mut was_connected, mut was_synchronized) = (false, false);
    let watched = watch(settings, &is_interrupted, started, || {
        let mut model = session.model();
        view_around_vehicle(&mut model);
        let now = clock::now();
        if model.connection().state(now) == LinkState::Waiting {
            wait_for_robot.report_progress(now);
        } else if !mem::replace(&mut was_connected, true) {
            settings.say(&answers);
        }
        // A picture marks the vehicle: a map without one is not all there is.
        let is_placed = model.vehicle().pose().is_some() || is_empty(&model);
        let is_synchronized = model.is_synchronized(now) && is_placed;
        join_timing.update(&model, is_synchronized);
        if is_synchronized != was_synchronized {
            tracing::info!(is_synchronized, "step");
            was_synchronized = is_synchronized;
        }
        let has_ended = model.has_ended();
        // A robot that has ended and is gone will not announce its map again.
        (
            is_synchronized || (has_ended && model.matches_last_head()),
            has_ended,
        )
    });
    let (_, messages) = session.model().connection().totals();
    match watched {
        // Of a robot that was never heard there is nothing to write: empty files would look like results.
        Watched::TimedOut if messages == 0 => {
            return Err(wait_for_robot.conclusion(&is_interrupted));
        }
        Watched::Interrupted if messages == 0 => return Err(Interrupted.into()),
        Watched::Synchronized | Watched::TimedOut | Watched::Interrupted => {}
    }
    let handle = session.handle();
    // What is fetched comes first: a robot whose data has ended does not wait for files that are written.
    let mut parts: Vec<_> = ExportPart::all().collect();
    parts.sort_by_key(|part| !matches!(part, ExportPart::Trajectory | ExportPart::Voxels));
    // Of a map that is not synchronized, what came is written, whatever it is.
    let fetcher = matches!(watched, Watched::Synchronized)
        .then(|| Fetcher::begin(&handle, parts.iter().copied(), settings.timeout));
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
    if !settings.quiet {
        join_timing.print(&model, out)?;
        print_summary(&model, &exported.files, out)?;
    }
    if exported.is_left {
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

/// What a map lacks that is not synchronized `after` this long, and why.
fn not_synchronized(model: &ConsoleModel, problem: Option<String>, after: Duration) -> String {
    let missing: usize = model.map().layer_states().map(|step| step.missing).sum();
    let why = problem.map(|why| format!(" ({why})")).unwrap_or_default();
    let after_s = after.as_secs_f64();
    format!(
        "the map is not synchronized with the robot's after {after_s:.0} s{why}: {missing} tiles are known to be missing"
    )
}

/// Whether nothing is known of any layer.
fn is_empty(model: &ConsoleModel) -> bool {
    let store = model.map().store();
    store.grids().all(|grid| store.cells_known(grid.layer) == 0)
}

/// What is near the vehicle comes first, as it would in a window.
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
        if elapsed >= watch_for.saturating_add(settings.timeout) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::demo::free_endpoint;

    fn of_nobody(endpoint: &str, export: PathBuf) -> Headless {
        Headless {
            connect: vec![endpoint.to_owned()],
            robot: Some("nobody".parse().unwrap()),
            zenoh_config: None,
            credentials: None,
            export,
            watch_for: None,
            timeout: Duration::from_millis(100),
            quiet: false,
        }
    }

    #[test]
    fn of_a_robot_that_was_never_heard_nothing_is_written() {
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
    fn what_was_not_heard_yet_is_looked_for() {
        let mut settings = of_nobody("tcp/boat:7447", PathBuf::new());
        let looking = |settings: &Headless| settings.target().looking();
        assert_eq!(
            looking(&settings),
            "looking for robot nobody at tcp/boat:7447"
        );
        settings.robot = None;
        settings.connect.push("tcp/barge:7447".to_owned());
        assert_eq!(
            looking(&settings),
            "looking for a robot at tcp/boat:7447, tcp/barge:7447"
        );
        settings.connect.clear();
        assert_eq!(
            looking(&settings),
            "looking for a robot on the local network"
        );
    }
}
