//! Reading recordings: bytes in, measurements out.

use measurement::MeasurementData;
use recording::{self, Selection};

use crate::recordings::{self, ACES, CLINIC, INTEL_MCAP, ROOMS, TWO_LASERS};
use crate::rounds::{ROUNDS, Rounds, timed};

/// One table, a row a recording.
pub(crate) fn print() -> anyhow::Result<()> {
    println!("reading: every message decoded, in file order");
    println!("| recording | scans | MB/s | scans/s |");
    println!("| --- | ---: | ---: | ---: |");
    for name in [ROOMS, ACES, CLINIC, INTEL_MCAP, TWO_LASERS] {
        let Some(path) = recordings::find(name) else {
            continue;
        };
        let megabytes = path.metadata()?.len() as f64 / 1e6;
        let (mut secs, mut scans) = (Rounds::default(), 0);
        for _ in 0..ROUNDS {
            let (read, time_s) = timed(|| {
                let mut reader = recording::open(&path, Selection::All)?;
                let mut scans = 0;
                while let Some(measurement) = reader.next_measurement()? {
                    scans += usize::from(matches!(measurement.data, MeasurementData::Scan { .. }));
                }
                anyhow::Ok(scans)
            });
            scans = read?;
            secs.add(time_s);
        }
        println!(
            "| {name} | {scans} | {:.0} | {:.0} |",
            secs.map(|secs| megabytes / secs),
            secs.map(|secs| scans as f64 / secs)
        );
    }
    Ok(())
}
