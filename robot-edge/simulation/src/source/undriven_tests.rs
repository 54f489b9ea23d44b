//! What a vehicle that nobody drives measures is fixed, world by world.

use super::{SimulatedSource, SimulationOptions};
use crate::world::World;
use measurement::pose::Pose;
use measurement::{Measurement, MeasurementData};

/// BLAKE3 over all that is measured in the first seconds, written down before vehicles could be driven; of the
/// boat, since its laser sees its own posts.
const FIRST_SECONDS: [(&str, f64, &str); 7] = [
    (
        "rooms",
        6.0,
        "4e4fe87b2c18c91f4979522162e6f585ac003ee0d897ad0f994afd202274dc79",
    ),
    (
        "street",
        3.0,
        "2fb7ec96a601e9febbdcad95ed3e7e5edb9f73e6f4b5480f523ddc4207ec3804",
    ),
    (
        "bumps",
        6.0,
        "73bf0f5bc07fc9cdba882313fa5609887e3d05d7c2b3ffe80e378b2ab2a7724c",
    ),
    (
        "turn",
        3.0,
        "1434bc932c62ae2db4676cba1ef08cbf5de8faa95a43724b8783b890d219e7d6",
    ),
    (
        "meadow",
        2.0,
        "4ef7104b3cf7d9ff77c3c3ff71c3907065fe47635f1d61acedd2d81aaf6ff649",
    ),
    (
        "lake",
        2.0,
        "ae10ac00c56712ad4cf9e8435d559437c80e39d98447702ca6cbbb74babe6751",
    ),
    (
        "dock",
        2.0,
        "66faea7b73ec1321cfd884b8abb4dd244b71eb358ca32c2f8d98ea97a2efbfb5",
    ),
];

#[test]
fn a_vehicle_that_nobody_drives_measures_what_it_always_did() {
    let found = FIRST_SECONDS.map(|(world, duration_s, _)| (world, digest(world, duration_s)));
    let expected = FIRST_SECONDS.map(|(world, _, digest)| (world, digest.to_owned()));
    assert_eq!(found, expected);
}

fn digest(world: &str, duration_s: f64) -> String {
    let options = SimulationOptions {
        seed: 1,
        duration_s: Some(duration_s),
        ..SimulationOptions::default()
    };
    let mut source = SimulatedSource::new(&World::load(world).unwrap(), options).unwrap();
    let measured: Vec<_> = std::iter::from_fn(|| source.next_measurement()).collect();
    digest_of(&measured)
}

/// BLAKE3 over stamps and all numbers.
pub(super) fn digest_of(measurements: &[Measurement]) -> String {
    let mut hasher = blake3::Hasher::new();
    for measurement in measurements {
        hasher.update(&measurement.stamp.as_nanos().to_le_bytes());
        hasher.update(&measurement.stream.0.to_le_bytes());
        for bits in bits(measurement) {
            hasher.update(&bits.to_le_bytes());
        }
    }
    hasher.finalize().to_string()
}

/// All numbers of a measurement.
fn bits(measurement: &Measurement) -> Vec<u64> {
    let of_pose = |pose: &Pose| {
        pose.to_homogeneous()
            .iter()
            .map(|value| value.to_bits())
            .collect()
    };
    let of = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect();
    match &measurement.data {
        MeasurementData::Scan { scan, .. } => scan
            .ranges_m
            .iter()
            .map(|range_m| u64::from(range_m.to_bits()))
            .collect(),
        MeasurementData::Transform {
            parent_from_child, ..
        } => of_pose(parent_from_child),
        MeasurementData::Odometry { odom_from_base, .. } => of_pose(odom_from_base),
        MeasurementData::Imu(sample) => of(&[
            &sample.orientation_xyzw.unwrap()[..],
            &sample.angular_velocity_radps,
            &sample.linear_acceleration_mps2,
        ]
        .concat()),
        MeasurementData::Joints(joints) => {
            joints.iter().map(|(_, angle)| angle.to_bits()).collect()
        }
        MeasurementData::Fix(fix) => of(&[fix.latitude_deg, fix.longitude_deg, fix.altitude_m]),
        MeasurementData::Twist(_) | MeasurementData::PointCloud(_) => {
            panic!("a simulated vehicle gives none: {measurement:?}")
        }
    }
}
