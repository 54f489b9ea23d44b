//! What GDAL reads of an export. Tests of other crates include this file, and `skip.rs` beside it.

use std::path::Path;
use std::process::Command;

use crate::skip::skip;

/// The report of `tests/python/gis_report.py` on `folder`; `None`, and a skipped test, without GDAL.
#[track_caller]
pub(crate) fn gis_report(folder: &Path) -> Option<serde_json::Value> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/python/gis_report.py");
    let has_gdal = |python: &&str| {
        let import = [
            "-c",
            "import numpy, osgeo_utils.samples.validate_cloud_optimized_geotiff",
        ];
        let output = Command::new(python).args(import).output();
        output.is_ok_and(|output| output.status.success())
    };
    // Debian's package is for Debian's Python.
    let Some(python) = ["python3", "/usr/bin/python3"].into_iter().find(has_gdal) else {
        skip("no Python with GDAL", "package python3-gdal");
        return None;
    };
    let output = Command::new(python)
        .arg(script)
        .arg(folder)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    Some(serde_json::from_slice(&output.stdout).unwrap())
}
