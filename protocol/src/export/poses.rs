//! Poses of a whole run, as differences, and compressed.

use std::sync::Arc;

use crate::export::StampedPose;

/// Poses that are encoded together.
const PART: usize = 500;
/// Of zstd; higher levels gain a tenth, and need half a megabyte while they work.
const LEVEL: i32 = 1;
/// Of a part that is not compressed: 8 numbers of at most 10 bytes a pose, and what stands before them.
const MAX_BYTES: usize = 80 * PART + 30;

/// Poses, oldest first, in a sixth (on a plane) to a third of the 64 bytes of a [`StampedPose`]; none of their digits is lost. Clones share
/// what is encoded.
#[derive(Clone, Debug, Default)]
pub struct Poses {
    /// `PART` poses each.
    encoded: Vec<Arc<[u8]>>,
    /// Those behind, fewer than `2 * PART`.
    recent: Vec<StampedPose>,
}

impl Poses {
    /// Number of poses.
    pub const fn len(&self) -> usize {
        self.encoded.len() * PART + self.recent.len()
    }

    /// Whether there are none.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Adds a pose behind the others.
    pub fn push(&mut self, pose: StampedPose) {
        self.recent.push(pose);
        if self.recent.len() == 2 * PART {
            self.encoded.push(encode(self.recent.drain(..PART)));
        }
    }

    /// Replaces pose `at`, counted from 0; does nothing where there is none.
    pub fn replace(&mut self, at: usize, pose: StampedPose) {
        if let Some(part) = self.encoded.get_mut(at / PART) {
            let mut poses = decode(part);
            // A recording that is read again has the same poses.
            if poses[at % PART] == pose {
                return;
            }
            poses[at % PART] = pose;
            *part = encode(poses.into_iter());
        } else if let Some(known) = self.recent.get_mut(at - self.encoded.len() * PART) {
            *known = pose;
        }
    }

    /// The poses from number `from` on, counted from 0.
    pub fn iter_from(&self, from: usize) -> impl Iterator<Item = StampedPose> {
        self.every(1, from)
    }

    /// Every `step`-th pose (of 0: each) from number `from` on; parts without one of them are not decoded.
    pub fn every(&self, step: usize, from: usize) -> impl Iterator<Item = StampedPose> {
        let (mut decoded, mut poses) = (usize::MAX, Vec::new());
        (from..self.len())
            .step_by(step.max(1))
            .filter_map(move |at| {
                let part = at / PART;
                let Some(encoded) = self.encoded.get(part) else {
                    return self.recent.get(at - self.encoded.len() * PART).copied();
                };
                if part != decoded {
                    (decoded, poses) = (part, decode(encoded));
                }
                poses.get(at % PART).copied()
            })
    }
}

impl FromIterator<StampedPose> for Poses {
    fn from_iter<I: IntoIterator<Item = StampedPose>>(all: I) -> Self {
        let mut poses = Self::default();
        all.into_iter().for_each(|pose| poses.push(pose));
        poses
    }
}

// Numbers are always encoded, and what is decoded was encoded here: neither fails.

fn encode(part: impl Iterator<Item = StampedPose>) -> Arc<[u8]> {
    let mut columns: [Vec<i64>; 8] = Default::default();
    let mut before = [0; 8];
    for pose in part {
        let mut row = pose.to_row();
        row[7] = row[7].wrapping_sub(w_of(row));
        for ((column, before), now) in columns.iter_mut().zip(&mut before).zip(row) {
            column.push(now.wrapping_sub(std::mem::replace(before, now)));
        }
    }
    let part = postcard::to_stdvec(&columns).unwrap_or_default();
    zstd::bulk::compress(&part, LEVEL)
        .unwrap_or_default()
        .into()
}

fn decode(part: &[u8]) -> Vec<StampedPose> {
    let part = zstd::bulk::decompress(part, MAX_BYTES).unwrap_or_default();
    let columns: [Vec<i64>; 8] = postcard::from_bytes(&part).unwrap_or_default();
    let mut before = [0_i64; 8];
    let rows = (0..columns[0].len()).map(|at| {
        before = std::array::from_fn(|n| before[n].wrapping_add(columns[n][at]));
        let mut row = before;
        row[7] = row[7].wrapping_add(w_of(row));
        StampedPose::from_row(row)
    });
    rows.collect()
}

/// The w of a unit quaternion by its x, y and z, but for its sign and what was rounded: what differs from it takes few bytes.
fn w_of([.., x, y, z, _]: [i64; 8]) -> i64 {
    let [x, y, z] = [x, y, z].map(|part| part as f64 * 1e-9);
    (libm::sqrt((1.0 - x * x - y * y - z * z).max(0.0)) * 1e9).round() as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of a vehicle that drives in a circle of 10 m, ten poses a second.
    fn pose(n: usize) -> StampedPose {
        on_waves(n, 0.0)
    }

    /// The same, heaving and rolling by so many metres and radians.
    fn on_waves(n: usize, amplitude: f64) -> StampedPose {
        let wave = amplitude * libm::sin(2.7 * n as f64);
        let angle = 0.005 * n as f64;
        let (sin, cos) = libm::sincos(angle);
        let (half_sin, half_cos) = libm::sincos(0.5 * angle);
        let stamp_ns = i64::MAX / 2 + 100_000_000 * i64::try_from(n).unwrap();
        StampedPose::new(
            stamp_ns,
            [10.0 * sin, -10.0 * cos, wave],
            [
                0.5 * wave * half_cos,
                0.5 * wave * half_sin,
                half_sin,
                half_cos,
            ],
        )
    }

    #[test]
    fn poses_come_back_from_any_number_on_in_fewer_bytes() {
        for count in [0, 1, 999, 1000, 1001, 5499, 5500] {
            let poses: Poses = (0..count).map(pose).collect();
            assert_eq!((poses.len(), poses.is_empty()), (count, count == 0));
            for from in [0, 1, 499, 500, 501, 998, 1000, 5000, usize::MAX] {
                let expected: Vec<_> = (from..count).map(pose).collect();
                let found: Vec<_> = poses.iter_from(from).collect();
                assert_eq!(found, expected, "{count} from {from}");
                let found: Vec<_> = poses.every(700, from).collect();
                let expected: Vec<_> = (from..count).step_by(700).map(pose).collect();
                assert_eq!(found, expected, "{count} from {from}");
            }
        }
        for (amplitude, most) in [(0.0, 12.0), (0.05, 24.0)] {
            let poses: Poses = (0..10_000).map(|n| on_waves(n, amplitude)).collect();
            let bytes: usize = poses.encoded.iter().map(|part| part.len()).sum();
            let each = bytes as f64 / (poses.encoded.len() * PART) as f64;
            assert!(each < most, "{amplitude}: {each}");
        }
    }

    #[test]
    fn a_pose_is_replaced_wherever_it_is() {
        let mut poses: Poses = (0..1600).map(pose).collect();
        let mut expected: Vec<_> = (0..1600).map(pose).collect();
        for at in [0, 499, 500, 999, 1000, 1599] {
            poses.replace(at, pose(7));
            expected[at] = pose(7);
        }
        poses.replace(1600, pose(7));
        assert_eq!(poses.iter_from(0).collect::<Vec<_>>(), expected);
    }
}
