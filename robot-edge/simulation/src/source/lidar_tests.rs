//! Clouds of a simulated lidar.

use super::vehicle_tests::run;
use super::*;

#[test]
fn a_vehicle_with_a_lidar_gives_clouds_in_its_frame() {
    let world = World::load("bridge").unwrap();
    let options = SimulationOptions {
        duration_s: Some(0.25),
        ..SimulationOptions::default()
    };
    let source = SimulatedSource::new(&world, options).unwrap();
    let types: Vec<_> = source
        .streams()
        .iter()
        .map(|stream| (&*stream.name, &*stream.type_name))
        .collect();
    assert_eq!(types[3..], [("/points", "sensor_msgs/PointCloud2")]);
    let measurements = run(&world, options);
    let mount = measurements
        .iter()
        .find_map(|(stream, measurement)| match &measurement.data {
            MeasurementData::Transform {
                child,
                parent_from_child,
                ..
            } if stream == "/tf_static" => {
                Some((child.to_string(), parent_from_child.translation.z))
            }
            _ => None,
        });
    assert_eq!(mount, Some(("lidar".to_owned(), 0.8)));
    let clouds: Vec<_> = measurements
        .iter()
        .filter_map(|(_, measurement)| match &measurement.data {
            MeasurementData::Cloud(cloud) => Some((measurement, cloud)),
            _ => None,
        })
        .collect();
    // The last one whose last column has a pose after it.
    assert_eq!(clouds.len(), 2);
    for (turn, (measurement, cloud)) in (0..).zip(clouds) {
        assert_eq!(&*measurement.frame, "lidar");
        assert_eq!(
            measurement.stamp.since(START),
            RobotDuration::from_millis(100 * turn)
        );
        assert_eq!(cloud.points.len() as u32 + cloud.without_return, 64 * 1024);
        // Rings 0 to 31 look down, and all of it is ground or what stands there.
        let down = cloud.points.iter().filter(|point| point.ring < Some(32));
        assert!(down.clone().all(|point| point.position_m[2] < 0.0));
        assert!(down.count() > 31 * 1024);
    }
}
