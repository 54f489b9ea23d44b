use std::fs::File;
use std::time::Duration;

use protocol::keys::Topic;
use protocol::message::{Info, LayerInfo, Status};
use protocol::mosaic::{MAX_RASTER_CELLS, Raster};
use protocol::tile_store::TileStore;
use tiff::decoder::{Decoder, DecodingResult};

use super::super::tests::publish;
use super::*;
use crate::model::{ConsoleModel, RequestId};
use crate::test_support::store_of;
use crate::test_support::{announce_map, at, console, inject, inject_reply, push_tile, scout};

const CELL_M: f64 = 0.1;

pub(in crate::map_view) fn model_of(store: &TileStore) -> ConsoleModel {
    let mut model = console("scout", &LayerId::ALL);
    let grids: Vec<_> = store.grids().collect();
    let info = Info {
        vehicle: String::new(),
        source: String::new(),
        footprint_m: [1.0, 1.0],
        limits: [1.0, 0.0, 1.0],
        layers: grids
            .iter()
            .map(|grid| LayerInfo {
                layer: grid.layer,
                cell_m: grid.cell_m,
            })
            .collect(),
        ..Info::default()
    };
    announce_map(&mut model, store, at(1_000));
    inject_reply(&mut model, RequestId(1), Topic::Info, &info, at(1_000));
    for grid in grids {
        for (key, _) in store.tiles(grid.layer) {
            push_tile(&mut model, store, key, at(2_000));
        }
    }
    model
}

/// Every layer with all kinds of codes, and unknown cells on both sides of the origin.
pub(in crate::map_view) fn store() -> TileStore {
    let mut store = store_of(&LayerId::ALL);
    for layer in LayerId::ALL {
        let is_code = |code| layer.quantisation().is_code(code);
        let codes = (0..=u16::MAX).filter(|code| is_code(*code)).count();
        for tile in [(-1, 0), (0, 0), (1, -1)] {
            let code = |x, y| ((x * 31 + y * 977) % codes) as u16 * u16::from(y > 3);
            publish(&mut store, layer, tile, code);
        }
    }
    store
}

#[test]
fn probe_and_export_have_equal_values() {
    let store = store();
    let model = model_of(&store);
    let dir = tempfile::tempdir().unwrap();
    let stack = LayerStack::default();
    for layer in LayerId::ALL {
        let raster = Raster::of_layer(model.map().store(), layer, MAX_RASTER_CELLS)
            .unwrap()
            .unwrap();
        let path = dir.path().join("layer.tif");
        protocol::export::write_geotiff(&path, &raster, None).unwrap();
        let file = std::io::BufReader::new(File::open(&path).unwrap());
        let image = Decoder::new(file).unwrap().read_image().unwrap();
        let pixels: Vec<f32> = if let DecodingResult::F32(values) = image {
            values
        } else if let DecodingResult::I8(values) = image {
            values.into_iter().map(f32::from).collect()
        } else if let DecodingResult::U8(values) = image {
            values.into_iter().map(f32::from).collect()
        } else {
            panic!("{image:?}")
        };
        let (first_x, first_y) = raster.first_cell();
        let mut known = 0;
        for row in (0..raster.height()).step_by(3) {
            for column in 0..raster.width() {
                let point_m = [
                    (first_x as f64 + column as f64 + 0.3) * CELL_M,
                    (first_y as f64 + row as f64 + 0.9) * CELL_M,
                ];
                let probe = ProbeData::new(&model, &stack, point_m, at(3_000));
                let cell = probe.cells.iter().find(|cell| cell.layer == layer);
                let value = cell.and_then(|cell| cell.value);
                // Row 0 of a GeoTIFF has the greatest y.
                let pixel = pixels[(raster.height() - 1 - row) * raster.width() + column];
                let is_unknown = pixel.is_nan() || (!layer.classes().is_empty() && pixel == 0.0);
                assert_eq!(
                    value.map(f32::to_bits),
                    (!is_unknown).then_some(pixel.to_bits()),
                    "{layer} {column} {row}"
                );
                known += usize::from(value.is_some());
            }
        }
        assert!(known > 2_000, "{layer}: {known}");
    }
}

#[test]
fn hidden_layers_are_probed_if_known() {
    let store = store();
    let model = model_of(&store);
    let mut stack = LayerStack::default();
    stack.show_only(LayerId::Elevation, &LayerId::ALL.into());
    let layers = |point_m| {
        let probe = ProbeData::new(&model, &stack, point_m, at(5_000));
        let cells = probe.cells.into_iter();
        cells
            .map(|cell| (cell.layer, cell.is_shown, cell.value.is_some()))
            .collect::<Vec<_>>()
    };
    assert_eq!(
        layers([2.0, -50.0]),
        [(LayerId::Elevation, true, false)],
        "nothing is known there"
    );
    let known = layers([3.17, 4.55]);
    assert!(known.len() > 3, "{known:?}");
    let hidden = known.iter().filter(|(_, is_shown, _)| !is_shown);
    assert!(hidden.clone().count() > 2);
    for (layer, _, is_known) in hidden {
        assert!(is_known, "{layer}");
    }
    let far = ProbeData::new(&model, &stack, [f64::MAX, 0.0], at(5_000));
    assert!(far.cells.iter().all(|cell| cell.value.is_none()));
}

#[test]
fn cell_at_a_point() {
    let check = |point_m, expected| {
        let (key, column, row) = cell_at(LayerId::Cost, point_m, 0.1).unwrap();
        assert_eq!((key.tx, key.ty, column, row), expected);
    };
    check([0.05, 6.45], (0, 1, 0, 0));
    check([-0.01, -6.41], (-1, -2, 63, 63));
    check([-6.35, 0.11], (-1, 0, 0, 1));
    for far in [f64::MAX, f64::INFINITY] {
        assert_eq!(cell_at(LayerId::Cost, [far, 0.0], 0.1), None);
    }
}

fn cell(layer: LayerId, number: f32) -> ProbedCell {
    let quantisation = layer.quantisation();
    ProbedCell {
        layer,
        is_shown: true,
        value: quantisation.decode(quantisation.encode(number)),
        age: Some(DataAge::Old(Duration::from_millis(3_240))),
        revision: Some(1_234),
        source: None,
    }
}

#[test]
fn values_have_units_or_names() {
    let check = |layer: LayerId, number: f32, expected: &str| {
        assert_eq!(cell(layer, number).reading(), expected);
    };
    check(LayerId::Elevation, -0.125, "height −0.125 m");
    check(LayerId::Occupancy, 0.9, "P(occupied) 0.90");
    check(LayerId::Cost, 0.5, "slope cost 0.50");
    check(LayerId::Obstacle, 1.0, "obstacle");
    check(LayerId::Obstacle, -1.0, "free");
    check(LayerId::Shore, 4.0, "docking site");
    check(LayerId::Intra, 0.2, "IntraScan 0.20");
    check(LayerId::Inter, 0.39, "InterScan 0.39");
    check(LayerId::Depth, 2.35, "depth 2.350 m");
    let unknown = ProbedCell {
        value: None,
        ..cell(LayerId::Cost, 0.5)
    };
    assert_eq!(unknown.reading(), "slope cost unknown");
}

#[test]
fn probe_shows_position_value_and_age() {
    let mut hidden = cell(LayerId::Cost, 0.5);
    hidden.is_shown = false;
    let probe = ProbeData {
        point_m: [1.234, -5.0],
        cells: vec![cell(LayerId::Obstacle, 1.0), hidden],
    };
    assert_eq!(probe.place(), "x\u{a0}1.23\u{a0}m  y\u{a0}−5.00\u{a0}m");
    assert_eq!(probe.cells[0].reading(), "obstacle");
    assert_eq!(
        probe.cells[1].origin(),
        "3.2 s ago, voxels, slope around, revision 1\u{a0}234, hidden"
    );
    let measured = ProbedCell {
        source: Some("from laser and sonar".to_owned()),
        ..cell(LayerId::Cost, 0.5)
    };
    assert_eq!(
        measured.origin(),
        "3.2 s ago, from laser and sonar, revision 1\u{a0}234"
    );
    for source in [None, measured.source.clone()] {
        let unknown = ProbedCell {
            value: None,
            source,
            ..measured.clone()
        };
        assert_eq!(unknown.origin(), "3.2 s ago, revision 1\u{a0}234");
        assert_eq!(unknown.changed().as_deref(), Some("3.2 s ago"));
    }
}

#[test]
fn an_unknown_cell_has_the_age_of_its_tile() {
    let mut robot = store();
    let mut model = model_of(&robot);
    let reported = |model: &ConsoleModel, point_m| {
        let probe = ProbeData::new(model, &LayerStack::default(), point_m, at(5_000));
        let cells = probe.cells.iter();
        let mut cells = cells.filter(|cell| cell.layer == LayerId::Elevation);
        let cell = cells.next().unwrap();
        assert_eq!(cell.value, None, "{point_m:?}");
        cell.origin()
    };
    // Its lowest rows are unknown.
    let (in_tile, beside) = ([3.17, 0.15], [2.0, -50.0]);
    let tile = cell_at(LayerId::Elevation, in_tile, CELL_M).map(|(key, ..)| key);
    let revision = robot.get(tile.unwrap()).unwrap().revision();
    let words = format!("4.0 s ago, revision {revision}");
    assert_eq!(reported(&model, in_tile), words);
    assert_eq!(reported(&model, beside), "");
    // Erased tiles do not exist.
    robot.erase_layer(LayerId::Elevation).unwrap();
    announce_map(&mut model, &robot, at(4_000));
    assert_eq!(reported(&model, in_tile), "");
}

fn sensor_info(name: &str, kind: SensorKind) -> SensorInfo {
    SensorInfo {
        name: name.to_owned(),
        kind,
        mount: None,
        view: None,
        rate_hz: None,
    }
}

fn status(name: &str, fault: Option<SensorFault>) -> SensorStatus {
    SensorStatus {
        name: name.to_owned(),
        messages: 7,
        rate_hz: 5.0,
        age_ms: Some(10_000),
        dropped: 0,
        fault,
    }
}

#[test]
fn layers_name_the_sensors_that_feed_them() {
    let mut sensors = vec![
        sensor_info("gps", SensorKind::SatelliteReceiver),
        sensor_info("laser", SensorKind::TiltingLaser),
        sensor_info("laser tilt", SensorKind::TiltEncoder),
        sensor_info("sonar", SensorKind::Sonar),
    ];
    let statuses = [status("sonar", None), status("laser", None)];
    let check = |sensors: &[SensorInfo], layer, expected: Option<&str>| {
        let words = source_text(layer, sensors, &statuses, Duration::ZERO);
        assert_eq!(words.as_deref(), expected);
    };
    check(&sensors, LayerId::Cost, Some("from laser and sonar"));
    for layer in [LayerId::Rigidity, LayerId::Intra, LayerId::Inter] {
        check(&sensors, layer, Some("from laser"));
    }
    check(&sensors, LayerId::Depth, Some("from sonar"));
    check(&sensors[..1], LayerId::Cost, None);
    check(&[], LayerId::Occupancy, None);
    for name in ["left", "right"] {
        sensors.push(sensor_info(name, SensorKind::PlanarLaser));
    }
    check(
        &sensors,
        LayerId::Shore,
        Some("from laser, sonar and 2 more"),
    );
}

#[test]
fn sensor_faults_follow_the_names() {
    let sensors = ["laser", "sonar", "left"].map(|name| sensor_info(name, SensorKind::PlanarLaser));
    let check = |faults: &[(&str, SensorFault)], expected: &str| {
        let statuses = faults
            .iter()
            .map(|(name, fault)| status(name, Some(*fault)));
        let statuses: Vec<_> = statuses.collect();
        let reported = Duration::from_secs(2);
        let words = source_text(LayerId::Cost, &sensors, &statuses, reported);
        assert_eq!(words.as_deref(), Some(expected));
    };
    check(
        &[("laser", SensorFault::Silent)],
        "from laser, sonar and 1 more (laser silent for 12 s)",
    );
    check(
        &[
            ("sonar", SensorFault::AllInvalid),
            ("left", SensorFault::Slow),
        ],
        "from laser, sonar and 1 more (sonar sees nothing now, left slow now)",
    );
    check(
        &[("left", SensorFault::Clock)],
        "from laser, sonar and 1 more (left's clock jumped)",
    );
    let never = SensorStatus {
        age_ms: None,
        ..status("sonar", None)
    };
    let words = fault_text(&never, SensorFault::Silent, Duration::ZERO);
    assert_eq!(words, "sonar silent from the start");
}

#[test]
fn no_current_faults_of_silent_or_ended_data() {
    let mut model = scout();
    let described = Info {
        sensors: vec![sensor_info("laser", SensorKind::PlanarLaser)],
        ..Info::default()
    };
    inject_reply(&mut model, RequestId(0), Topic::Info, &described, at(1_000));
    let mut reported = Status {
        sensors: vec![status("laser", Some(SensorFault::Slow))],
        ..Status::default()
    };
    for (has_ended, now, words) in [
        (false, 1_000, "from laser (laser slow now)"),
        (false, 61_000, "from laser"),
        (true, 62_000, "from laser"),
    ] {
        if now != 61_000 {
            reported.has_ended = has_ended;
            inject(&mut model, Topic::Status, &reported, at(now));
        }
        let source = source(&model, LayerId::Cost, at(now));
        assert_eq!(source.as_deref(), Some(words), "{now}");
    }
}
