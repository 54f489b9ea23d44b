//! What a part of an export needs of the robot first: layers that were hidden, the whole way, the octree.

use std::collections::BTreeSet;
use std::fmt;
use std::ops::ControlFlow;
use std::thread;
use std::time::Duration;

use anyhow::Error;
use measurement::time::Monotonic;
use protocol::message::VoxelFile;
use robot_edge::clock;

use super::{ExportPart, Snapshot};
use crate::link::ModelHandle;
use crate::model::{ConsoleModel, LinkState, TrajectoryProgress, VoxelsProgress};

/// Between two looks at what is being fetched.
const POLL_PERIOD: Duration = Duration::from_millis(20);
/// Longer than a link stalls that comes back.
const SILENCE: Duration = Duration::from_secs(10);

/// Ten times as long as a robot with a pose says nothing of it.
const POSE_WAIT: Duration = Duration::from_millis(500);

/// How far fetching a part is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fetching {
    /// It is asked for, or being made.
    Requested,
    /// So many tiles of a layer are known to be missing.
    Tiles(usize),
    /// Poses that came, of how many.
    Poses([u64; 2]),
    /// Bytes of a file that came, of how many.
    Voxels(VoxelFile, [u64; 2]),
}

impl Fetching {
    /// How much of the part is here, 0 … 1.
    pub fn share(self) -> f32 {
        let share = |[came, of]: [u64; 2]| came as f32 / of.max(1) as f32;
        match self {
            Self::Requested | Self::Tiles(_) => 0.0,
            Self::Poses(came) => share(came),
            Self::Voxels(VoxelFile::Tree, came) => 0.5 * share(came),
            Self::Voxels(VoxelFile::Points, came) => 0.5 + 0.5 * share(came),
        }
    }

    /// Rises with what came.
    const fn progress(self) -> (u8, u64) {
        match self {
            Self::Requested => (0, 0),
            Self::Tiles(missing) => (1, u64::MAX - missing as u64),
            Self::Poses([came, _]) | Self::Voxels(VoxelFile::Tree, [came, _]) => (1, came),
            Self::Voxels(VoxelFile::Points, [came, _]) => (2, came),
        }
    }
}

impl fmt::Display for Fetching {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Requested => f.write_str("asked for, the robot makes it"),
            Self::Tiles(missing) => write!(f, "{missing} tiles to come"),
            Self::Poses([came, of]) => write!(f, "{came} of {of} poses fetched"),
            Self::Voxels(file, came) => {
                let [came_mb, of_mb] = came.map(|bytes| bytes as f64 * 1e-6);
                write!(f, "{}, {came_mb:.1} of {of_mb:.1} MB fetched", file.name())
            }
        }
    }
}

/// Fetches the parts of one export, each just before it is written. Dropping it gives back what the model keeps for that.
pub struct Fetcher<'a> {
    model: &'a ModelHandle,
    patience: Duration,
}

impl<'a> Fetcher<'a> {
    /// An export of these parts begins. The octree is asked for now: the robot makes it for seconds, and meanwhile the other
    /// parts are fetched and written.
    ///
    /// A robot that sends no more of a part is waited for no longer than `patience`.
    pub fn begin(
        model: &'a ModelHandle,
        parts: impl IntoIterator<Item = ExportPart>,
        patience: Duration,
    ) -> Self {
        if parts.into_iter().any(|part| part == ExportPart::Voxels) {
            model.lock().want_voxels();
        }
        Self { model, patience }
    }

    /// Fetches what `part`, which is one of those, needs, and takes it. A robot that has said nothing for ten seconds is not
    /// waited for. `watch` hears how far it is, and may break it off.
    ///
    /// What cannot be fetched is taken as it is known here, and says so; of the octree nothing is.
    pub fn fetch(
        &self,
        part: ExportPart,
        mut watch: impl FnMut(Fetching) -> ControlFlow<()>,
    ) -> ControlFlow<(), anyhow::Result<Snapshot>> {
        let began = clock::now();
        want(&mut self.model.lock(), part);
        let (mut most, mut since) = (None, began);
        loop {
            // The model is free while this waits.
            let mut guard = self.model.lock();
            let now = clock::now();
            let age = guard.connection().age(now);
            let came = match state(&guard, part, began, now) {
                Ok(Some(_)) if self.model.is_left() => Err("something else is shown by now"),
                Ok(Some(_)) if age.is_none_or(|age| age > SILENCE) => Err("no data from the robot"),
                Ok(Some(_)) if now.since(since) > self.patience => {
                    Err("the robot sends no more of it")
                }
                Ok(Some(fetching)) => {
                    drop(guard);
                    // What is begun anew again and again is no progress.
                    if most < Some(fetching.progress()) {
                        most = Some(fetching.progress());
                        since = now;
                    }
                    if watch(fetching).is_break() {
                        release(&mut self.model.lock(), part);
                        return ControlFlow::Break(());
                    }
                    thread::sleep(POLL_PERIOD);
                    continue;
                }
                Ok(None) => Ok(()),
                Err(why) => Err(why),
            };
            let snapshot = Snapshot::of(&guard, part);
            release(&mut guard, part);
            return ControlFlow::Continue(match (came, part) {
                (Ok(()), _) => Ok(snapshot),
                (Err(why), ExportPart::Voxels) => {
                    Err(Error::msg(format!("{why}. Export it again later")))
                }
                (Err(why), ExportPart::Trajectory) => {
                    Ok(snapshot.lacking(format!("only what was received here: {why}")))
                }
                (Err(why), ExportPart::Layer(_) | ExportPart::Shores) => {
                    Ok(snapshot.lacking(format!("as far as it came, since {why}")))
                }
            });
        }
    }
}

impl Drop for Fetcher<'_> {
    fn drop(&mut self) {
        // The export may have been left before it came to it.
        self.model.lock().drop_voxels();
    }
}

/// Begins to fetch a part whose turn it is. The octree is on its way since the export began.
fn want(model: &mut ConsoleModel, part: ExportPart) {
    match part {
        ExportPart::Layer(layer) if part.is_in(model) => model.want_for_export([layer].into()),
        ExportPart::Trajectory => model.want_trajectory(),
        ExportPart::Layer(_) | ExportPart::Shores | ExportPart::Voxels => {}
    }
}

/// The snapshot has it.
fn release(model: &mut ConsoleModel, part: ExportPart) {
    match part {
        ExportPart::Layer(_) => model.want_for_export(BTreeSet::new()),
        ExportPart::Trajectory => model.drop_trajectory(),
        ExportPart::Voxels => model.drop_voxels(),
        ExportPart::Shores => {}
    }
}

/// How far it is; `None` where nothing more will come, and why where nothing can.
fn state(
    model: &ConsoleModel,
    part: ExportPart,
    began: Monotonic,
    now: Monotonic,
) -> Result<Option<Fetching>, &'static str> {
    if !part.is_in(model) && part != ExportPart::Voxels {
        return Ok(None);
    }
    Ok(match part {
        ExportPart::Layer(layer) => {
            let step = model.map().layer_states().find(|step| step.layer == layer);
            let is_whole = step.is_some_and(|step| {
                let is_last = model.has_ended() && step.is_equal;
                is_last || step.last_equal.is_some_and(|at| at >= began)
            });
            // Pictures mark where the vehicle is by then. Where the data has ended, it goes nowhere.
            let pose = model.vehicle().pose();
            let knows_pose = pose.is_some_and(|(_, at)| at >= began || model.has_ended());
            match step {
                Some(_) if is_whole && (knows_pose || now.since(began) > POSE_WAIT) => None,
                Some(step) if step.missing > 0 => Some(Fetching::Tiles(step.missing)),
                Some(_) | None => Some(Fetching::Requested),
            }
        }
        ExportPart::Trajectory => match model.trajectory() {
            TrajectoryProgress::Ready(_) => None,
            TrajectoryProgress::Unwanted => return Err("the robot began anew meanwhile"),
            TrajectoryProgress::Waiting => Some(Fetching::Requested),
            TrajectoryProgress::Fetching { fetched, of } => Some(Fetching::Poses([fetched, of])),
        },
        ExportPart::Voxels => match model.voxels() {
            VoxelsProgress::Ready(_) | VoxelsProgress::None => None,
            VoxelsProgress::Unwanted => return Err("nobody has asked for it"),
            VoxelsProgress::Waiting => Some(Fetching::Requested),
            VoxelsProgress::Fetching { file, fetched, of } => {
                Some(Fetching::Voxels(file, [fetched, of]))
            }
            VoxelsProgress::TooLong => return Err("it is longer than a console takes"),
        },
        // They come by themselves, while the robot is heard.
        ExportPart::Shores => {
            let is_heard = model.connection().state(now) == LinkState::Live;
            (!is_heard && !model.has_ended()).then_some(Fetching::Requested)
        }
    })
}

#[cfg(test)]
mod tests;
