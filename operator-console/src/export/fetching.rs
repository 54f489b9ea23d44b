//! What a part of an export needs of the robot first: layers that were hidden, the whole way, the octree.

use std::collections::BTreeSet;
use std::fmt;
use std::ops::ControlFlow;
use std::thread;
use std::time::Duration;

use anyhow::Error;
use protocol::message::VoxelFile;
use robot_edge::clock::Monotonic;

use super::{ExportPart, Snapshot};
use crate::link::ModelHandle;
use crate::model::{ConsoleModel, LinkState, TrajectoryProgress, VoxelsProgress};

/// Between two looks at what is being fetched.
const LOOK: Duration = Duration::from_millis(20);
/// Longer than a link stalls that comes back.
const SILENCE: Duration = Duration::from_secs(10);

/// Ten times as long as a robot with a pose says nothing of it.
const POSE_WAIT: Duration = Duration::from_millis(500);

/// How far fetching a part is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fetching {
    /// It is asked for, or being made.
    Asked,
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
            Self::Asked | Self::Tiles(_) => 0.0,
            Self::Poses(came) => share(came),
            Self::Voxels(VoxelFile::Tree, came) => 0.5 * share(came),
            Self::Voxels(VoxelFile::Points, came) => 0.5 + 0.5 * share(came),
        }
    }

    /// Rises with what came.
    const fn progress(self) -> (u8, u64) {
        match self {
            Self::Asked => (0, 0),
            Self::Tiles(missing) => (1, u64::MAX - missing as u64),
            Self::Poses([came, _]) | Self::Voxels(VoxelFile::Tree, [came, _]) => (1, came),
            Self::Voxels(VoxelFile::Points, [came, _]) => (2, came),
        }
    }
}

impl fmt::Display for Fetching {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Asked => f.write_str("asked for, the robot makes it"),
            Self::Tiles(missing) => write!(f, "{missing} tiles to come"),
            Self::Poses([came, of]) => write!(f, "{came} of {of} poses fetched"),
            Self::Voxels(file, came) => {
                let [came_mb, of_mb] = came.map(|bytes| bytes as f64 * 1e-6);
                write!(f, "{}, {came_mb:.1} of {of_mb:.1} MB fetched", file.name())
            }
        }
    }
}

/// Fetches what `part` needs, and takes it. A robot that has said nothing for ten seconds is not waited for, and one that sends
/// no more of it for no longer than `patience`. `watch` hears how far it is, and may break it off.
///
/// What cannot be fetched is taken as it is known here, and says so; of the octree nothing is.
pub fn fetch(
    model: &ModelHandle,
    part: ExportPart,
    patience: Duration,
    mut watch: impl FnMut(Fetching) -> ControlFlow<()>,
) -> ControlFlow<(), anyhow::Result<Snapshot>> {
    let began = Monotonic::now();
    want(&mut model.lock(), part);
    let (mut most, mut since) = (None, began);
    loop {
        // The model is free while this waits.
        let mut guard = model.lock();
        let now = Monotonic::now();
        let age = guard.connection().age(now);
        let came = match state(&guard, part, began, now) {
            Ok(Some(_)) if model.is_left() => Err("something else is shown by now"),
            Ok(Some(_)) if age.is_none_or(|age| age > SILENCE) => Err("the robot is not heard"),
            Ok(Some(_)) if now.since(since) > patience => Err("the robot sends no more of it"),
            Ok(Some(fetching)) => {
                drop(guard);
                // What is begun anew again and again is no progress.
                if most < Some(fetching.progress()) {
                    most = Some(fetching.progress());
                    since = now;
                }
                if watch(fetching).is_break() {
                    give_back(&mut model.lock(), part);
                    return ControlFlow::Break(());
                }
                thread::sleep(LOOK);
                continue;
            }
            Ok(None) => Ok(()),
            Err(why) => Err(why),
        };
        let snapshot = Snapshot::of(&guard, part);
        give_back(&mut guard, part);
        return ControlFlow::Continue(match (came, part) {
            (Ok(()), _) => Ok(snapshot),
            (Err(why), ExportPart::Voxels) => {
                Err(Error::msg(format!("{why}. Export it again later")))
            }
            (Err(why), ExportPart::Trajectory) => {
                Ok(snapshot.lacking(format!("only what was heard here, since {why}")))
            }
            (Err(why), ExportPart::Layer(_) | ExportPart::Shores) => {
                Ok(snapshot.lacking(format!("as far as it came, since {why}")))
            }
        });
    }
}

/// Begins to fetch a part.
fn want(model: &mut ConsoleModel, part: ExportPart) {
    match part {
        ExportPart::Layer(layer) if part.is_in(model) => model.follow_too([layer].into()),
        ExportPart::Trajectory => model.want_trajectory(),
        // Else somebody who wants other parts first had it begun.
        ExportPart::Voxels if model.voxels() == VoxelsProgress::Unwanted => model.want_voxels(),
        ExportPart::Voxels | ExportPart::Layer(_) | ExportPart::Shores => {}
    }
}

/// The snapshot has it.
fn give_back(model: &mut ConsoleModel, part: ExportPart) {
    match part {
        ExportPart::Layer(_) => model.follow_too(BTreeSet::new()),
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
    let another_run = "the robot began anew meanwhile";
    Ok(match part {
        ExportPart::Layer(layer) => {
            let step = model.map().steps().find(|step| step.layer == layer);
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
                Some(_) | None => Some(Fetching::Asked),
            }
        }
        ExportPart::Trajectory => match model.trajectory() {
            TrajectoryProgress::Ready(_) => None,
            TrajectoryProgress::Unwanted => return Err(another_run),
            TrajectoryProgress::Waiting => Some(Fetching::Asked),
            TrajectoryProgress::Fetching { fetched, of } => Some(Fetching::Poses([fetched, of])),
        },
        ExportPart::Voxels => match model.voxels() {
            VoxelsProgress::Ready(_) | VoxelsProgress::None => None,
            VoxelsProgress::Unwanted => return Err(another_run),
            VoxelsProgress::Waiting => Some(Fetching::Asked),
            VoxelsProgress::Fetching { file, fetched, of } => {
                Some(Fetching::Voxels(file, [fetched, of]))
            }
            VoxelsProgress::TooLong => return Err("it is longer than a console takes"),
        },
        // They come by themselves, while the robot is heard.
        ExportPart::Shores => {
            let is_heard = model.connection().state(now) == LinkState::Live;
            (!is_heard && !model.has_ended()).then_some(Fetching::Asked)
        }
    })
}

#[cfg(test)]
mod tests {
    use protocol::keys::Topic;
    use protocol::layer::LayerId;
    use protocol::message::{Info, LayerInfo, MapHead, Pose, Status, VoxelsReply};
    use protocol::tile_store::{LayerGrid, TileStore};

    use super::*;
    use crate::model::{OpenSessions, Outgoing, RequestId};
    use crate::pretend::{BOOT, announces, answers, at, console, says};

    #[test]
    fn what_is_fetched_is_told_and_moves_the_bar() {
        for (fetching, words, share) in [
            (Fetching::Asked, "asked for, the robot makes it", 0.0),
            (Fetching::Tiles(12), "12 tiles to come", 0.0),
            (
                Fetching::Poses([500, 2000]),
                "500 of 2000 poses fetched",
                0.25,
            ),
            (
                Fetching::Voxels(VoxelFile::Tree, [50, 100]),
                "voxels.bt, 0.0 of 0.0 MB fetched",
                0.25,
            ),
            (
                Fetching::Voxels(VoxelFile::Points, [1_300_000, 5_200_000]),
                "points.ply, 1.3 of 5.2 MB fetched",
                0.625,
            ),
        ] {
            assert_eq!(fetching.to_string(), words);
            assert_eq!(fetching.share().to_bits(), f32::to_bits(share), "{words}");
        }
    }

    #[test]
    fn a_robot_that_is_not_heard_is_not_waited_for() {
        let model = ModelHandle::of(crate::pretend::scout());
        let hour = Duration::from_hours(1);
        let fetch = |part| fetch(&model, part, hour, |_| unreachable!());
        let ControlFlow::Continue(Ok(way)) = fetch(ExportPart::Trajectory) else {
            panic!();
        };
        let why = "only what was heard here, since the robot is not heard";
        assert_eq!(way.lacks.as_deref(), Some(why));
        let ControlFlow::Continue(Err(why)) = fetch(ExportPart::Voxels) else {
            panic!();
        };
        assert_eq!(
            why.to_string(),
            "the robot is not heard. Export it again later"
        );
        let outlines = fetch(ExportPart::Shores);
        assert_eq!(model.lock().trajectory(), TrajectoryProgress::Unwanted);
        assert_eq!(model.lock().voxels(), VoxelsProgress::Unwanted);
        assert!(
            matches!(outlines, ControlFlow::Continue(Ok(_))),
            "there are none"
        );
    }

    #[test]
    fn an_octree_that_was_begun_before_is_not_begun_anew() {
        let mut scout = crate::pretend::scout();
        let now = Monotonic::now();
        let head = MapHead { layers: Vec::new() };
        says(&mut scout, Topic::MapHead, &head, now);
        scout.want_voxels();
        let asked = scout.outgoing(OpenSessions::BOTH, now);
        let request = asked.iter().find_map(|asked| match asked {
            Outgoing::Get { request, key, .. } if key.ends_with("/voxels") => Some(*request),
            Outgoing::Get { .. } | Outgoing::Put { .. } => None,
        });
        let none = VoxelsReply::None;
        answers(&mut scout, request.unwrap(), Topic::Voxels, &none, now);
        let model = ModelHandle::of(scout);
        let hour = Duration::from_hours(1);
        let fetched = fetch(&model, ExportPart::Voxels, hour, |_| unreachable!());
        assert!(matches!(fetched, ControlFlow::Continue(Ok(_))));
        assert_eq!(model.lock().voxels(), VoxelsProgress::Unwanted);
    }

    #[test]
    fn what_is_not_shown_any_more_is_not_waited_for() {
        let mut scout = crate::pretend::scout();
        let head = MapHead { layers: Vec::new() };
        says(&mut scout, Topic::MapHead, &head, Monotonic::now());
        let model = ModelHandle::of(scout);
        let mut looks = 0;
        let hour = Duration::from_hours(1);
        let fetched = fetch(&model, ExportPart::Trajectory, hour, |_| {
            looks += 1;
            model.leave();
            ControlFlow::Continue(())
        });
        let ControlFlow::Continue(Ok(way)) = fetched else {
            panic!();
        };
        let why = "only what was heard here, since something else is shown by now";
        assert_eq!((looks, way.lacks.as_deref()), (1, Some(why)));
    }

    #[test]
    fn the_whole_map_of_a_robot_that_has_ended_and_is_gone_is_whole() {
        let (layer, cell_m) = (LayerId::Occupancy, 0.1);
        let mut store = TileStore::new(BOOT, 10);
        store.set_grid(LayerGrid { layer, cell_m }).unwrap();
        let mut model = console("scout", &[layer]);
        let info = Info {
            layers: vec![LayerInfo { layer, cell_m }],
            ..Info::default()
        };
        let ended = Status {
            has_ended: true,
            ..Status::default()
        };
        let pose = Pose {
            position_m: [1.0, 2.0, 0.0],
            quaternion_xyzw: [0.0, 0.0, 0.0, 1.0],
            speed_mps: 0.0,
            turn_rate_radps: 0.0,
            token: None,
        };
        // Long ago.
        announces(&mut model, &store, at(1));
        answers(&mut model, RequestId(1), Topic::Info, &info, at(1));
        says(&mut model, Topic::Pose, &pose, at(1));
        says(&mut model, Topic::Status, &ended, at(1));
        announces(&mut model, &store, at(1));
        model.outgoing(OpenSessions::BOTH, at(1));
        assert!(model.has_ended());
        let model = ModelHandle::of(model);
        let part = ExportPart::Layer(layer);
        let fetched = fetch(&model, part, Duration::ZERO, |_| unreachable!());
        let ControlFlow::Continue(Ok(map)) = fetched else {
            panic!();
        };
        assert_eq!(map.lacks, None);
    }

    /// How long a robot is waited for that was heard just now and answers nothing.
    fn waits(patience: Duration) -> Duration {
        let mut model = crate::pretend::scout();
        let head = MapHead { layers: Vec::new() };
        crate::pretend::says(&mut model, Topic::MapHead, &head, Monotonic::now());
        let model = ModelHandle::of(model);
        let started = Monotonic::now();
        let fetched = fetch(&model, ExportPart::Trajectory, patience, |_| {
            ControlFlow::Continue(())
        });
        let ControlFlow::Continue(Ok(way)) = fetched else {
            panic!();
        };
        let why = "only what was heard here, since the robot sends no more of it";
        assert_eq!(way.lacks.as_deref(), Some(why));
        started.elapsed()
    }

    #[test]
    fn a_robot_that_stalls_is_waited_for() {
        // The link counts as silent after 0.4 s, or 1.5 s.
        let patience = Duration::from_millis(1_800);
        assert!(waits(patience) >= patience);
    }

    #[test]
    fn what_begins_anew_is_no_progress() {
        let rising = [Fetching::Asked, Fetching::Tiles(9), Fetching::Tiles(8)];
        let of_voxels = [
            Fetching::Voxels(VoxelFile::Tree, [5, 9]),
            Fetching::Voxels(VoxelFile::Tree, [6, 9]),
            Fetching::Voxels(VoxelFile::Points, [0, 9]),
        ];
        for rising in [rising, of_voxels] {
            assert!(rising.is_sorted_by(|a, b| a.progress() < b.progress()));
        }
        assert!(Fetching::Poses([500, 600]).progress() > Fetching::Poses([0, 600]).progress());
    }
}
