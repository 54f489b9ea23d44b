//! Memory for exporting the largest maps.

use super::*;

/// Cells on a side: a square kilometre at 0.1 m.
const SIDE: i64 = 10_000;
/// The picture of 3334 × 3334 pixels takes 33 MB, and as much while it is filtered. A copied raster
/// would take 200 MB.
const MAX_EXTRA_KB: u64 = 150_000;

/// A line of this process's status, KB; `None` if the system has none.
fn status_kb(name: &str) -> Option<u64> {
    let text = fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    line.trim_matches(|sign: char| !sign.is_ascii_digit())
        .parse()
        .ok()
}

#[test]
#[ignore = "ten seconds and 300 MB; its figure of memory holds where it runs alone"]
fn a_map_of_10_000_by_10_000_cells_is_exported_in_little_memory() {
    let layer = LayerId::Occupancy;
    let code = |x: i64, y: i64| 1 + ((x / 7 + y / 3) % 250) as u16;
    let store = store_of(layer, 0.1, SIDE, SIDE, code);
    assert_eq!(store.cells_known(layer), 100_000_000);
    // Resets the peak.
    drop(fs::write("/proc/self/clear_refs", "5"));
    let held_kb = status_kb("VmRSS:");
    let dir = tempfile::tempdir().unwrap();
    let exported = export_all(dir.path(), &store, &Caption::default()).unwrap();
    assert_eq!(exported.files.len(), 4);
    if let (Some(held_kb), Some(peak_kb)) = (held_kb, status_kb("VmHWM:")) {
        let extra_kb = peak_kb.saturating_sub(held_kb);
        println!("{held_kb} KB held, {extra_kb} KB more for the export");
        assert!(extra_kb < MAX_EXTRA_KB, "{extra_kb}");
    }
    for file in &exported.files {
        println!(
            "{}: {} bytes",
            file.display(),
            fs::metadata(file).unwrap().len()
        );
    }

    let file = File::open(dir.path().join("occupancy.tif")).unwrap();
    let mut decoder = Decoder::new(file).unwrap();
    assert_eq!(decoder.dimensions().unwrap(), (10_000, 10_000));
    let decode = |x, y| layer.quantisation().decode(code(x, y)).unwrap().to_bits();
    let DecodingResult::F32(first) = decoder.read_chunk(0).unwrap() else {
        panic!("not f32");
    };
    assert_eq!(first[0].to_bits(), decode(0, SIDE - 1));
    assert_eq!(first[9_999].to_bits(), decode(SIDE - 1, SIDE - 1));
    let pgm = fs::metadata(dir.path().join("occupancy.pgm")).unwrap();
    assert_eq!(
        pgm.len(),
        100_000_000 + "P5\n10000 10000\n255\n".len() as u64
    );
}
