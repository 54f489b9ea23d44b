//! Fetches what a part of an export needs from the robot: hidden layers, the complete trajectory, the octree.

use std::collections::BTreeSet;
use std::fmt;
use std::ops::ControlFlow;
use std::thread;
use std::time::Duration;

use anyhow::Error;
use measurement::time::Monotonic;
use network::clock;
use protocol::message::VoxelFile;

use super::{ExportPart, Snapshot};
use crate::link::ModelHandle;
use crate::model::{ConsoleModel, LinkState, TrajectoryProgress, VoxelsProgress};

const POLL_PERIOD: Duration = Duration::from_millis(20);
/// Longer than interruptions of a working link.
const SILENCE: Duration = Duration::from_secs(10);

/// Ten times the period of poses.
const POSE_WAIT: Duration = Duration::from_millis(500);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FetchProgress {
    Requested,
    Tiles(usize),
    Poses([u64; 2]),
    Voxels(VoxelFile, [u64; 2]),
}

impl FetchProgress {
    pub fn share(self) -> f32 {
        let share = |[came, of]: [u64; 2]| came as f32 / of.max(1) as f32;
        match self {
            Self::Requested | Self::Tiles(_) => 0.0,
            Self::Poses(came) => share(came),
            Self::Voxels(VoxelFile::Tree, came) => 0.5 * share(came),
            Self::Voxels(VoxelFile::Points, came) => 0.5 + 0.5 * share(came),
        }
    }

    const fn progress(self) -> (u8, u64) {
        match self {
            Self::Requested => (0, 0),
            Self::Tiles(missing) => (1, u64::MAX - missing as u64),
            Self::Poses([came, _]) | Self::Voxels(VoxelFile::Tree, [came, _]) => (1, came),
            Self::Voxels(VoxelFile::Points, [came, _]) => (2, came),
        }
    }
}

impl fmt::Display for FetchProgress {
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

/// Fetches the parts of one export, each just before it is written. Dropping it frees the fetched data in the model.
pub struct Fetcher<'a> {
    model: &'a ModelHandle,
    patience: Duration,
}

impl<'a> Fetcher<'a> {
    /// Starts an export of these parts. The octree is requested at once: the robot needs seconds to make it, during
    /// which other parts are fetched and written.
    ///
    /// Fetching fails after `patience` without progress.
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

    /// Fetches one part and takes it. Fetching ends after ten seconds of silence of the robot. `watch` receives the
    /// progress and may cancel.
    ///
    /// An incomplete part is taken as it is and marked; an incomplete octree is not taken.
    pub fn fetch(
        &self,
        part: ExportPart,
        mut watch: impl FnMut(FetchProgress) -> ControlFlow<()>,
    ) -> ControlFlow<(), anyhow::Result<Snapshot>> {
        let began = clock::now();
        want(&mut self.model.lock(), part);
        let (mut most, mut since) = (None, began);
        loop {
            // The model is unlocked while this waits.
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
                    // Repeated restarts are no progress.
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
                    Ok(snapshot.lacking(format!("fetching ended: {why}")))
                }
            });
        }
    }
}

impl Drop for Fetcher<'_> {
    fn drop(&mut self) {
        let mut model = self.model.lock();
        // The export may have been cancelled earlier.
        model.drop_voxels();
        model.drop_trajectory();
    }
}

/// Starts to fetch a part. The octree was requested at the start, and shores are pushed.
fn want(model: &mut ConsoleModel, part: ExportPart) {
    match part {
        ExportPart::Layer(layer) if part.is_in(model) => {
            model.want_for_export([layer].into());
            // Pictures show the path.
            want_trajectory(model);
        }
        ExportPart::Trajectory => want_trajectory(model),
        _ => {}
    }
}

fn want_trajectory(model: &mut ConsoleModel) {
    if model.trajectory() == TrajectoryProgress::Unwanted {
        model.want_trajectory();
    }
}

/// The trajectory stays for the pictures until the export ends.
fn release(model: &mut ConsoleModel, part: ExportPart) {
    match part {
        ExportPart::Layer(_) => model.want_for_export(BTreeSet::new()),
        ExportPart::Voxels => model.drop_voxels(),
        ExportPart::Trajectory | ExportPart::Shores => {}
    }
}

fn state(
    model: &ConsoleModel,
    part: ExportPart,
    began: Monotonic,
    now: Monotonic,
) -> Result<Option<FetchProgress>, &'static str> {
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
            // Pictures show the present position. At the end of the data it does not change.
            let pose = model.vehicle().pose();
            let knows_pose = pose.is_some_and(|(_, at)| at >= began || model.has_ended());
            match step {
                Some(_) if is_whole && (knows_pose || now.since(began) > POSE_WAIT) => {
                    // A robot that is gone has sent what there is of the path.
                    let is_live = model.connection().state(now) == LinkState::Live;
                    match model.trajectory() {
                        TrajectoryProgress::Waiting if is_live => Some(FetchProgress::Requested),
                        TrajectoryProgress::Fetching { fetched, of } if is_live => {
                            Some(FetchProgress::Poses([fetched, of]))
                        }
                        _ => None,
                    }
                }
                Some(step) if step.missing > 0 => Some(FetchProgress::Tiles(step.missing)),
                Some(_) | None => Some(FetchProgress::Requested),
            }
        }
        ExportPart::Trajectory => match model.trajectory() {
            TrajectoryProgress::Ready(_) => None,
            TrajectoryProgress::Unwanted => return Err("the robot restarted meanwhile"),
            TrajectoryProgress::Waiting => Some(FetchProgress::Requested),
            TrajectoryProgress::Fetching { fetched, of } => {
                Some(FetchProgress::Poses([fetched, of]))
            }
        },
        ExportPart::Voxels => match model.voxels() {
            VoxelsProgress::Ready(_) | VoxelsProgress::None => None,
            VoxelsProgress::Unwanted => return Err("it was not requested"),
            VoxelsProgress::Waiting => Some(FetchProgress::Requested),
            VoxelsProgress::Fetching { file, fetched, of } => {
                Some(FetchProgress::Voxels(file, [fetched, of]))
            }
            VoxelsProgress::TooLong => return Err("it is longer than a console takes"),
        },
        // Shores are pushed while the robot is connected.
        ExportPart::Shores => {
            let is_heard = model.connection().state(now) == LinkState::Live;
            (!is_heard && !model.has_ended()).then_some(FetchProgress::Requested)
        }
    })
}

#[cfg(test)]
mod tests {
    use network::clock;
    use protocol::keys::Topic;
    use protocol::layer::LayerId;
    use protocol::message::{MapHead, VoxelsReply};

    use super::*;
    use crate::model::{OpenSessions, Outgoing, RequestId};
    use crate::test_support::{
        announce_map, at, console, describe_layers, ended_status, inject, inject_reply,
        pose_at_rest, store_of,
    };

    fn fetch(
        model: &ModelHandle,
        part: ExportPart,
        patience: Duration,
        watch: impl FnMut(FetchProgress) -> ControlFlow<()>,
    ) -> ControlFlow<(), anyhow::Result<Snapshot>> {
        Fetcher::begin(model, [part], patience).fetch(part, watch)
    }

    fn taken(fetched: ControlFlow<(), anyhow::Result<Snapshot>>) -> anyhow::Result<Snapshot> {
        match fetched {
            ControlFlow::Continue(taken) => taken,
            ControlFlow::Break(()) => panic!("nobody cancelled it"),
        }
    }

    #[test]
    fn fetching_reports_progress() {
        for (fetching, words, share) in [
            (
                FetchProgress::Requested,
                "asked for, the robot makes it",
                0.0,
            ),
            (FetchProgress::Tiles(12), "12 tiles to come", 0.0),
            (
                FetchProgress::Poses([500, 2000]),
                "500 of 2000 poses fetched",
                0.25,
            ),
            (
                FetchProgress::Voxels(VoxelFile::Tree, [50, 100]),
                "voxels.bt, 0.0 of 0.0 MB fetched",
                0.25,
            ),
            (
                FetchProgress::Voxels(VoxelFile::Points, [1_300_000, 5_200_000]),
                "points.ply, 1.3 of 5.2 MB fetched",
                0.625,
            ),
        ] {
            assert_eq!(fetching.to_string(), words);
            assert_eq!(fetching.share().to_bits(), f32::to_bits(share), "{words}");
        }
    }

    #[test]
    fn silent_robot_ends_the_fetch() {
        let model = ModelHandle::of(crate::test_support::scout());
        let hour = Duration::from_hours(1);
        let fetch = |part| fetch(&model, part, hour, |_| unreachable!());
        let way = taken(fetch(ExportPart::Trajectory)).unwrap();
        let why = "only what was received here: no data from the robot";
        assert_eq!(way.incomplete_because.as_deref(), Some(why));
        let why = taken(fetch(ExportPart::Voxels)).unwrap_err().to_string();
        assert_eq!(why, "no data from the robot. Export it again later");
        // There are none.
        taken(fetch(ExportPart::Shores)).unwrap();
        assert_eq!(model.lock().trajectory(), TrajectoryProgress::Unwanted);
        assert_eq!(model.lock().voxels(), VoxelsProgress::Unwanted);
    }

    fn asked(model: &ModelHandle, now: Monotonic) -> Vec<RequestId> {
        let asked = model.lock().outgoing(OpenSessions::BOTH, now);
        let requests = asked.into_iter().filter_map(|asked| match asked {
            Outgoing::Get { request, key, .. } if key.ends_with("/voxels") => Some(request),
            Outgoing::Get { .. } | Outgoing::Put { .. } => None,
        });
        requests.collect()
    }

    #[test]
    fn octree_is_requested_once_at_start() {
        let (hour, now) = (Duration::from_hours(1), clock::now());
        let mut scout = crate::test_support::scout();
        let head = MapHead { layers: Vec::new() };
        inject(&mut scout, Topic::MapHead, &head, now);
        let model = ModelHandle::of(scout);
        let parts = [ExportPart::Shores, ExportPart::Voxels];
        let fetcher = Fetcher::begin(&model, parts, hour);
        let [request] = asked(&model, now)[..] else {
            panic!("it is asked for at once");
        };
        let fetch = |part| fetcher.fetch(part, |_| unreachable!());
        // Other parts are fetched while the robot makes it.
        taken(fetch(ExportPart::Shores)).unwrap();
        let none = VoxelsReply::None;
        inject_reply(&mut model.lock(), request, Topic::Voxels, &none, now);
        taken(fetch(ExportPart::Voxels)).unwrap();
        assert_eq!(model.lock().voxels(), VoxelsProgress::Unwanted);
        assert_eq!(asked(&model, now + hour), []);
    }

    #[test]
    fn cancelled_export_frees_the_octree() {
        let model = ModelHandle::of(crate::test_support::scout());
        let begin = |part| Fetcher::begin(&model, [part], Duration::ZERO);
        let fetcher = begin(ExportPart::Voxels);
        assert_eq!(model.lock().voxels(), VoxelsProgress::Waiting);
        drop(fetcher);
        assert_eq!(model.lock().voxels(), VoxelsProgress::Unwanted);
        let _other = begin(ExportPart::Trajectory);
        assert_eq!(model.lock().voxels(), VoxelsProgress::Unwanted);
    }

    #[test]
    fn closed_link_ends_the_fetch() {
        let mut scout = crate::test_support::scout();
        let head = MapHead { layers: Vec::new() };
        inject(&mut scout, Topic::MapHead, &head, clock::now());
        let model = ModelHandle::of(scout);
        let mut looks = 0;
        let hour = Duration::from_hours(1);
        let fetched = fetch(&model, ExportPart::Trajectory, hour, |_| {
            looks += 1;
            model.leave();
            ControlFlow::Continue(())
        });
        let way = taken(fetched).unwrap();
        let why = "only what was received here: something else is shown by now";
        assert_eq!((looks, way.incomplete_because.as_deref()), (1, Some(why)));
    }

    #[test]
    fn complete_map_of_ended_robot_is_complete() {
        let layer = LayerId::Occupancy;
        let store = store_of(&[layer]);
        let mut model = console("scout", &[layer]);
        let ended = ended_status();
        // Long before.
        announce_map(&mut model, &store, at(1));
        describe_layers(&mut model, &[layer], at(1));
        inject(&mut model, Topic::Pose, &pose_at_rest(), at(1));
        inject(&mut model, Topic::Status, &ended, at(1));
        announce_map(&mut model, &store, at(1));
        model.outgoing(OpenSessions::BOTH, at(1));
        assert!(model.has_ended());
        let model = ModelHandle::of(model);
        let part = ExportPart::Layer(layer);
        let fetched = fetch(&model, part, Duration::ZERO, |_| unreachable!());
        assert_eq!(taken(fetched).unwrap().incomplete_because, None);
    }

    fn waits(patience: Duration) -> Duration {
        let mut model = crate::test_support::scout();
        let head = MapHead { layers: Vec::new() };
        crate::test_support::inject(&mut model, Topic::MapHead, &head, clock::now());
        let model = ModelHandle::of(model);
        let started = clock::now();
        let fetched = fetch(&model, ExportPart::Trajectory, patience, |_| {
            ControlFlow::Continue(())
        });
        let way = taken(fetched).unwrap();
        let why = "only what was received here: the robot sends no more of it";
        assert_eq!(way.incomplete_because.as_deref(), Some(why));
        clock::elapsed(started)
    }

    #[test]
    fn a_robot_that_stalls_is_waited_for() {
        // The link counts as silent after 0.4 s, or 1.5 s.
        let patience = Duration::from_millis(1_800);
        assert!(waits(patience) >= patience);
    }

    #[test]
    fn repeated_restart_is_no_progress() {
        let rising = [
            FetchProgress::Requested,
            FetchProgress::Tiles(9),
            FetchProgress::Tiles(8),
        ];
        let of_voxels = [
            FetchProgress::Voxels(VoxelFile::Tree, [5, 9]),
            FetchProgress::Voxels(VoxelFile::Tree, [6, 9]),
            FetchProgress::Voxels(VoxelFile::Points, [0, 9]),
        ];
        for rising in [rising, of_voxels] {
            assert!(rising.is_sorted_by(|a, b| a.progress() < b.progress()));
        }
        assert!(
            FetchProgress::Poses([500, 600]).progress() > FetchProgress::Poses([0, 600]).progress()
        );
    }
}
