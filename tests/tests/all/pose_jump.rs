//! A jump in odometry is reported, and the maps are kept or erased as configured.

use measurement::time::RobotDuration;
use measurement::{Measurement, MeasurementData};
use protocol::layer::LayerId;
use robot_edge::experiments::run;
use robot_edge::runtime::{MapEvent, Pipeline};
use simulation::source::START;
use simulation::{SimulatedSource, SimulationOptions, World};

/// Time at which the odometry jumps, seconds.
const JUMP_S: f64 = 4.0;
const JUMP_M: f64 = 5.0;
const END_S: f64 = 6.0;

/// Drives through the hall; returns the maps and events.
fn drive(on_jump: &str) -> (Pipeline, Vec<MapEvent>) {
    let world = World::load("hall").unwrap();
    let settings = [
        "localization.source=odometry",
        &format!("localization.on_jump={on_jump}"),
    ];
    let config = run::vehicle_config(&world, &settings).unwrap();
    let options = SimulationOptions {
        duration_s: Some(END_S),
        ..SimulationOptions::default()
    };
    let mut source = SimulatedSource::new(&world, options).unwrap();
    let mut pipeline = run::pipeline(&config, source.streams()).unwrap();
    while let Some(measurement) = source.next_measurement() {
        pipeline.push(jumping(measurement)).unwrap();
    }
    pipeline.finish().unwrap();
    let map_events = pipeline.take_map_events();
    (pipeline, map_events)
}

fn jumping(mut measurement: Measurement) -> Measurement {
    let jumps_at = START + RobotDuration::from_secs_f64(JUMP_S);
    if measurement.stamp >= jumps_at
        && let MeasurementData::Odometry { odom_from_base, .. } = &mut measurement.data
    {
        odom_from_base.translation.x += JUMP_M;
    }
    measurement
}

/// Least x of the published cells, metres, and the number of erasures.
fn published(pipeline: &Pipeline) -> (f64, u32) {
    let store = pipeline.publisher().store();
    let layer = LayerId::Obstacle;
    let raster = protocol::mosaic::Raster::of_layer(&store, layer, 1_000_000).unwrap();
    (raster.unwrap().corners_m().0[0], store.epoch(layer))
}

#[test]
fn a_pose_jump_keeps_or_erases_the_maps_as_configured() {
    let (kept, map_events) = drive("keep");
    let [map_event] = &map_events[..] else {
        panic!("{map_events:?}");
    };
    assert_eq!(map_event.kind, "pose_jump");
    assert_eq!(
        map_event.message,
        "the poses jumped by 5.00 m: the maps were kept"
    );
    let (least_x_m, erased) = published(&kept);
    assert!(least_x_m < 4.0, "the earlier cells are kept: {least_x_m}");
    assert_eq!(erased, 0);

    let (reset, map_events) = drive("reset");
    assert!(
        map_events[0].message.ends_with("the maps were erased"),
        "{map_events:?}"
    );
    let (least_x_after_m, erased) = published(&reset);
    assert!(
        least_x_after_m > least_x_m + 4.0,
        "{least_x_after_m} {least_x_m}"
    );
    assert_eq!(erased, 1);

    // Only scans between the poses before and after the jump lack a pose.
    for pipeline in [&kept, &reset] {
        let counts = pipeline.registration().counts();
        assert!(counts.dropped_scans.total() <= 1, "{counts:?}");
        assert_eq!(
            counts.scans_in,
            counts.scans_registered + counts.dropped_scans.total()
        );
    }
}
