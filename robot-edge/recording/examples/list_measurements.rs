//! Lists the streams of a recording and counts its measurements:
//! `cargo run -p recording --example list_measurements -- FILE`

use std::error::Error;
use std::io::Write;
use std::path::Path;

use recording::Selection;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("name a recording")?;
    let mut reader = recording::open(Path::new(&path), Selection::All)?;
    let mut measurements = 0;
    while reader.next_measurement()?.is_some() {
        measurements += 1;
    }
    let mut out = std::io::stdout();
    writeln!(
        out,
        "{measurements} measurements, {} losses",
        reader.losses().total()
    )?;
    for summary in reader.streams() {
        let stream = &summary.stream;
        writeln!(
            out,
            "{} ({}): {} messages",
            stream.name, stream.type_name, summary.messages
        )?;
    }
    Ok(())
}
