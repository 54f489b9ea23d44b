use nalgebra::Point3;
use protocol::tile::BootId;

use super::*;
use crate::export::voxels::voxel_digest;
use localization::pose_buffer::PoseJump;
use mapping::grid::VoxelIndex;
use mapping::octree::VoxelState;
use mapping::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan, SensorId};
use measurement::pose::Pose;

/// Hit of the scan in the map, and of the scan that waits, metres.
const BEFORE_M: [f64; 2] = [3.05, 0.05];
const WAITING_M: [f64; 2] = [0.05, 8.05];

fn take(maps: &mut Maps, registered: &RegistrationOutput) {
    match registered {
        RegistrationOutput::Scan(scan) => {
            maps.integrate(scan);
            maps.publish_if_due().unwrap();
        }
        RegistrationOutput::Jump(jump) => maps.on_pose_jump(jump),
    }
}

/// Empty maps with an octree.
fn maps(on_jump: OnJump) -> Maps {
    let mut config = Config::default();
    config.mapping.octree.enabled = true;
    config.localization.on_jump = on_jump;
    Maps::new(&config, BootId([1; 16]), false).unwrap()
}

/// Five beams, one above the other, into one voxel.
fn scan(stamp_ns: i64, [x, y]: [f64; 2]) -> RegistrationOutput {
    let beams = (0..5).map(|index| {
        let origin = Point3::new(0.05, 0.05, 0.05);
        let end = Point3::new(x, y, 0.01 + 0.02 * f64::from(index));
        RegisteredBeam {
            origin_in_odom: origin,
            end_in_odom: end,
            outcome: BeamOutcome::Hit,
            index,
            range_m: (end - origin).norm() as f32,
        }
    });
    RegistrationOutput::Scan(RegisteredScan {
        stamp: RobotTime::from_nanos(stamp_ns),
        sensor: SensorId(0),
        beam_step_rad: 0.005,
        own_body_hits: 0,
        odom_from_base: Pose::identity(),
        beams: beams.collect(),
    })
}

fn state(octree: &Octree, [x, y]: [f64; 2]) -> VoxelState {
    let point = Point3::new(x, y, 0.05);
    octree.state(VoxelIndex::containing(point, octree.cell_m()))
}

/// The voxels that the two scans hit, in the octree of a paused snapshot; it equals the octree of maps that end there.
fn shown(on_jump: OnJump, waiting: &[RegistrationOutput]) -> (VoxelState, VoxelState) {
    let before = scan(0, BEFORE_M);
    let (mut standing, mut ended) = (maps(on_jump), maps(on_jump));
    for maps in [&mut standing, &mut ended] {
        take(maps, &before);
    }
    for registered in waiting {
        take(&mut ended, registered);
    }
    ended.finish().unwrap();
    let paused_snapshot = standing.publish_paused(waiting.to_vec()).unwrap();
    let octree = standing.octree_of(&paused_snapshot).unwrap();
    let of_ended = ended.mapper().voxels().unwrap().octree();
    assert_eq!(voxel_digest(&octree), voxel_digest(of_ended), "{on_jump:?}");
    (state(&octree, BEFORE_M), state(&octree, WAITING_M))
}

#[test]
fn a_waiting_jump_erases_the_octree_like_the_other_maps() {
    use VoxelState::{Occupied, Unknown};
    let jump = RegistrationOutput::Jump(PoseJump {
        stamp: RobotTime::from_nanos(100),
        distance_m: 5.0,
    });
    let waiting = scan(200, WAITING_M);
    let in_front = [jump.clone(), waiting.clone()];
    let behind = [waiting, jump];
    for (on_jump, waiting, known) in [
        (OnJump::Keep, &in_front, (Occupied, Occupied)),
        (OnJump::Keep, &behind, (Occupied, Occupied)),
        (OnJump::Reset, &in_front, (Unknown, Occupied)),
        (OnJump::Reset, &behind, (Unknown, Unknown)),
    ] {
        assert_eq!(shown(on_jump, waiting), known, "{on_jump:?} {waiting:?}");
    }
}
