//! The project's own recording from end to end, that it can be made again, and that it always gives the same map.

use std::fs;
use std::path::Path;

use serde_json::json;

use crate::gdal::gis_report;
use crate::process::{
    OccupancyTiff, digest, events, grey, names_in, read_json, read_pgm, robot_edge, rooms, run,
    summary_of,
};

/// Every platform and every build makes this map. It changes only where placing, mapping or the world do,
/// and then whoever changes it looks at the new map first.
const ROOMS_DIGEST: &str = "b513a1327a0f7f8ac4215938dc685c178acf3d15692a7c486c159473dbace048";

const EXPORTS: [&str; 6] = [
    "occupancy.pgm",
    "occupancy.png",
    "occupancy.tif",
    "occupancy.yaml",
    "trajectory.geojson",
    "trajectory.tum",
];

#[test]
fn the_clip_becomes_maps_and_figures() {
    let folder = tempfile::tempdir().unwrap();
    let (maps, figures) = (folder.path().join("new/maps"), folder.path().join("s.json"));
    let ended = run(robot_edge("replay --quiet")
        .arg(rooms())
        .arg("--export")
        .arg(&maps)
        .arg("--summary")
        .arg(&figures))
    .succeeds();
    assert_eq!((ended.stdout.as_str(), ended.stderr.as_str()), ("", ""));
    assert_eq!(names_in(&maps), EXPORTS);
    assert_eq!(names_in(folder.path()), ["new", "s.json"]);
    if let Some(report) = gis_report(&maps) {
        let occupancy = &report["rasters"]["occupancy.tif"];
        assert_eq!(occupancy["problems"], json!([]));
        // Against the file for Nav2's map server.
        assert_eq!(occupancy["cells"], 203 * 152);
        assert_eq!(occupancy["other_cells"], 0);
        // No place on Earth is known.
        let crs = occupancy["crs"].as_str().unwrap();
        assert!(crs.starts_with("LOCAL_CS[\"odom\""), "{crs}");
        let path = &report["vectors"]["trajectory.geojson"];
        assert_eq!(
            (&path["crs"], &path["shapes"]),
            (&json!("odom"), &json!(["LINESTRING"]))
        );
    }
    // The README says that this is the picture that its command makes.
    let shown = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/rooms.png");
    let is_shown = fs::read(shown).unwrap() == fs::read(maps.join("occupancy.png")).unwrap();
    assert!(is_shown, "docs/rooms.png is of another program");

    let summary = read_json(&figures);
    assert_eq!(summary["recording"], rooms().to_str().unwrap());
    assert_eq!(summary["vehicle"], "pioneer");
    assert_eq!(
        summary["scans"],
        json!({"in": 1159, "mapped": 1159, "dropped": {}})
    );
    assert_eq!(
        summary["beams"],
        json!({"in": 791_597, "hits": 680_507, "misses": 107_152, "dropped": {"invalid_range": 3938}})
    );
    assert_eq!(digest(&summary), ROOMS_DIGEST);
    let occupancy = &summary["layers"]["occupancy"];
    assert_eq!(occupancy["cells_known"], 29_326);
    assert_eq!(
        occupancy["counts"],
        json!({"free": 26_576, "occupied": 2526, "undecided": 224})
    );
    assert!(occupancy["bytes"].as_u64().unwrap() > 0);
    assert_eq!(summary["layers"].as_object().unwrap().len(), 1);
    assert_eq!(
        summary.get("voxels"),
        None,
        "no voxels are mapped, so none are claimed"
    );

    let tiles = &summary["tiles"];
    let number = |name: &str| tiles[name].as_u64().unwrap();
    assert_eq!(number("raw_bytes"), number("published") * 64 * 64 * 4);
    assert!(number("bytes") * 20 < number("raw_bytes"), "{tiles}");
    assert!(number("published") > 100);

    let real = |name: &str| summary[name].as_f64().unwrap();
    assert!(
        (real("duration_s") - 115.94).abs() < 1e-9,
        "{}",
        real("duration_s")
    );
    assert!(real("wall_s") > 0.0 && real("wall_s") < 60.0);
    assert!((real("realtime_factor") * real("wall_s") - real("duration_s")).abs() < 1e-6);
    assert!((1 << 20..100 << 20).contains(&summary["peak_rss_bytes"].as_u64().unwrap()));
    for stage in ["localization", "mapping", "publish"] {
        let times = &summary["stages"][stage];
        let time = |name: &str| times[name].as_f64().unwrap();
        assert!(
            0.0 < time("p50_us") && time("p50_us") <= time("p99_us"),
            "{times}"
        );
        assert!(time("p99_us") <= time("max_us") * 1.01, "{times}");
    }
    assert_eq!(
        events(&summary),
        [
            "setup: pioneer (named in the recording)",
            "setup: laser: /scan",
            "setup: poses: transforms up to frame odom",
        ]
    );
}

#[test]
fn other_tools_read_the_same_map_from_every_export() {
    let folder = tempfile::tempdir().unwrap();
    let summary = summary_of(
        robot_edge("replay")
            .arg(rooms())
            .arg("--export")
            .arg(folder.path()),
    );

    let tiff = OccupancyTiff::read(folder.path());
    let (width, height, pixels) = read_pgm(&folder.path().join("occupancy.pgm"));
    assert_eq!((tiff.width, tiff.height), (width, height));
    let greys: Vec<u8> = tiff.values.iter().map(|&p| grey(p)).collect();
    assert_eq!(greys, pixels);
    let known = tiff.values.iter().filter(|p| !p.is_nan()).count() as u64;
    assert_eq!(summary["layers"]["occupancy"]["cells_known"], known);
    assert!(
        tiff.values
            .iter()
            .all(|p| p.is_nan() || (0.02..=0.98).contains(p))
    );

    // The outer walls stand from -2.57 to 17.88 m and from -3.43 to 12.04 m; the laser sees their insides.
    assert_eq!(tiff.cell_m.to_bits(), 0.1_f64.to_bits());
    assert_eq!((tiff.corner, width, height), ([-25, 119], 203, 152));
    assert_eq!(
        fs::read_to_string(folder.path().join("occupancy.yaml")).unwrap(),
        "image: occupancy.pgm\nmode: trinary\nresolution: 0.1\n\
         origin: [-2.5, -3.3000000000000003, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    );
    let picture = fs::read(folder.path().join("occupancy.png")).unwrap();
    assert!(picture.starts_with(b"\x89PNG\r\n\x1a\n"));

    let trajectory = fs::read_to_string(folder.path().join("trajectory.tum")).unwrap();
    let poses: Vec<Vec<f64>> = trajectory
        .lines()
        .map(|line| {
            line.split(' ')
                .map(|number| number.parse().unwrap())
                .collect()
        })
        .collect();
    assert_eq!(poses.len(), 1159);
    assert!(poses.iter().all(|pose| pose.len() == 8));
    assert!(
        poses.windows(2).all(|pair| pair[0][0] < pair[1][0]),
        "stamps rise"
    );
    // Where the world's path begins.
    assert_eq!(
        poses[0],
        [946_684_800.0, -1.4, 4.32, 0.0, 0.0, 0.0, 0.0, 1.0]
    );
}

#[test]
fn the_clip_can_be_made_again_byte_by_byte() {
    let folder = tempfile::tempdir().unwrap();
    let simulate = |name: &str| {
        let path = folder.path().join(name);
        let maps = folder.path().join("maps");
        let summary = summary_of(
            robot_edge("simulate rooms --rate max")
                .arg("--record")
                .arg(&path)
                .arg("--export")
                .arg(&maps),
        );
        assert_eq!(names_in(&maps), EXPORTS);
        (digest(&summary).to_owned(), fs::read(path).unwrap())
    };
    let (first_digest, first) = simulate("first.mcap");
    let (second_digest, second) = simulate("second.mcap");
    assert_eq!(
        (first_digest.as_str(), second_digest.as_str()),
        (ROOMS_DIGEST, ROOMS_DIGEST)
    );
    assert!(first == second, "two runs record different bytes");
    assert!(
        first == fs::read(rooms()).unwrap(),
        "recordings/rooms.mcap is of another program"
    );
}

fn digest_with(options: &str) -> String {
    let summary = summary_of(
        robot_edge("replay")
            .arg(rooms())
            .args(options.split_whitespace()),
    );
    assert_eq!(
        summary["scans"]["dropped"],
        serde_json::json!({}),
        "{options}"
    );
    digest(&summary).to_owned()
}

/// All of `options` give one digest, which is returned.
#[track_caller]
fn one_digest(options: &[&str]) -> String {
    let digests: Vec<_> = options.iter().map(|options| digest_with(options)).collect();
    for (options, digest) in options.iter().zip(&digests) {
        assert_eq!(*digest, digests[0], "{options}");
    }
    digests.into_iter().next().unwrap()
}

#[test]
fn threads_repetition_and_speed_change_nothing() {
    one_digest(&[
        "",
        "--rate max",
        "--set mapping.threads=1",
        "--set mapping.threads=2",
        "--set mapping.threads=2",
    ]);
    let twenty = one_digest(&[
        "--duration 20",
        "--rate 10 --duration 20",
        "--rate 10 --duration 20 --set mapping.threads=2",
    ]);
    let three = one_digest(&[
        "--duration 3",
        "--rate 1 --duration 3",
        "--rate 1 --duration 3 --set mapping.threads=2",
    ]);
    assert_ne!(three, twenty);
}

#[test]
fn settings_that_matter_change_the_map() {
    let usual = digest_with("");
    for setting in ["cell_m=0.05", "p_free=0.4", "miss=free"] {
        let option = format!("--set mapping.occupancy.{setting}");
        assert_ne!(usual, digest_with(&option), "{setting}");
    }
}
