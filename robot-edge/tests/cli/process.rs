//! Runs the program, and reads what it prints and exports with other people's code.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;
use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::Tag;

/// The project's own recording: the simulated world `rooms`.
pub(crate) fn rooms() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../recordings/rooms.mcap")
}

/// The program with `words` as its arguments; paths are added with [`Command::arg`].
pub(crate) fn robot_edge(words: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_robot-edge"));
    let mut words = words.split_whitespace();
    let name = words.next();
    command.args(name);
    // Tests run side by side, and there is one default port.
    if matches!(name, Some("replay" | "simulate")) {
        command.arg("--no-network");
    }
    command
        .args(words)
        .env_remove("RUST_LOG")
        .env_remove("ZENOH_CONFIG");
    command
}

/// How a process ended.
#[derive(Debug)]
pub(crate) struct Ended {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl From<Output> for Ended {
    fn from(output: Output) -> Self {
        Self {
            code: output.status.code(),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        }
    }
}

impl Ended {
    /// Asserts a refusal: exit code `code`, nothing on standard output, and one line that holds all of
    /// `says`. (clap's messages are several lines.)
    #[track_caller]
    pub(crate) fn refuses(&self, code: i32, says: &[&str]) {
        assert_eq!(self.code, Some(code), "{self:#?}");
        assert_eq!(self.stdout, "");
        for part in says {
            assert!(
                self.stderr.contains(part),
                "no {part:?} in:\n{}",
                self.stderr
            );
        }
        let is_one_line =
            self.stderr.starts_with("robot-edge: ") && self.stderr.lines().count() == 1;
        assert!(
            is_one_line || self.stderr.starts_with("error: "),
            "{}",
            self.stderr
        );
    }

    /// Asserts exit code 0.
    #[track_caller]
    pub(crate) fn succeeds(self) -> Self {
        assert_eq!(self.code, Some(0), "{self:#?}");
        self
    }
}

/// Runs a command to its end.
#[track_caller]
pub(crate) fn run(command: &mut Command) -> Ended {
    command.output().unwrap().into()
}

/// The summary of a `replay` or `simulate` that has to succeed and, being told to be quiet, say nothing.
#[track_caller]
pub(crate) fn summary_of(command: &mut Command) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("summary.json");
    let ended = run(command.arg("--quiet").arg("--summary").arg(&path)).succeeds();
    assert_eq!((ended.stdout.as_str(), ended.stderr.as_str()), ("", ""));
    read_json(&path)
}

pub(crate) fn read_json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// The digest of the occupancy layer.
#[track_caller]
pub(crate) fn digest(summary: &Value) -> &str {
    let digest = summary["layers"]["occupancy"]["digest"].as_str().unwrap();
    assert_eq!(digest.len(), 64, "{digest}");
    digest
}

/// `events` of a summary as lines, kind first.
pub(crate) fn events(summary: &Value) -> Vec<String> {
    let events = summary["events"].as_array().unwrap().iter();
    events
        .map(|event| {
            format!(
                "{}: {}",
                event["kind"].as_str().unwrap(),
                event["message"].as_str().unwrap()
            )
        })
        .collect()
}

/// Asserts that every beam was a hit, a miss or dropped; returns the number of beams.
#[track_caller]
pub(crate) fn assert_every_beam_counted(summary: &Value) -> u64 {
    let beams = &summary["beams"];
    let count = |what: &str| beams[what].as_u64().unwrap();
    let dropped = beams["dropped"].as_object().unwrap().values();
    let dropped: u64 = dropped.map(|n| n.as_u64().unwrap()).sum();
    assert_eq!(
        count("in"),
        count("hits") + count("misses") + dropped,
        "{beams}"
    );
    count("in")
}

/// The sorted names of files in a folder.
pub(crate) fn names_in(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<_> = entries
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

/// Probabilities of being occupied, row 0 the greatest y; NaN where unknown.
pub(crate) struct OccupancyTiff {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) cell_m: f64,
    /// Column and row of the upper left corner, in cells from the origin of `odom`.
    pub(crate) corner: [i64; 2],
    pub(crate) values: Vec<f32>,
}

impl OccupancyTiff {
    pub(crate) fn read(folder: &Path) -> Self {
        let mut tiff = Decoder::new(File::open(folder.join("occupancy.tif")).unwrap()).unwrap();
        let (width, height) = tiff.dimensions().unwrap();
        let scale = tiff.get_tag_f64_vec(Tag::ModelPixelScaleTag).unwrap();
        let tie = tiff.get_tag_f64_vec(Tag::ModelTiepointTag).unwrap();
        let cell_m = scale[0];
        assert_eq!(scale, [cell_m, cell_m, 0.0]);
        assert_eq!((&tie[..3], tie[5]), (&[0.0; 3][..], 0.0));
        let DecodingResult::F32(values) = tiff.read_image().unwrap() else {
            panic!("samples are not f32");
        };
        let whole = |metres: f64| {
            let cells = metres / cell_m;
            assert!(
                (cells - cells.round()).abs() < 1e-6,
                "{metres} m is no edge between cells"
            );
            cells.round() as i64
        };
        Self {
            width: width as usize,
            height: height as usize,
            cell_m,
            corner: [whole(tie[3]), whole(tie[4])],
            values,
        }
    }

    /// The probability in the cell `x` columns east and `y` rows north of `odom`'s origin.
    fn at(&self, x: i64, y: i64) -> Option<f32> {
        let column = usize::try_from(x - self.corner[0])
            .ok()
            .filter(|&c| c < self.width)?;
        let row = usize::try_from(self.corner[1] - 1 - y)
            .ok()
            .filter(|&r| r < self.height)?;
        Some(self.values[row * self.width + column]).filter(|p| !p.is_nan())
    }

    fn known(&self) -> impl Iterator<Item = [i64; 2]> {
        let cells = self.values.iter().enumerate().filter(|(_, p)| !p.is_nan());
        cells.map(|(index, _)| {
            let (row, column) = (index / self.width, index % self.width);
            [
                self.corner[0] + column.cast_signed() as i64,
                self.corner[1] - 1 - row.cast_signed() as i64,
            ]
        })
    }

    /// Compares all cells that either map knows.
    pub(crate) fn compare(&self, other: &Self) -> Comparison {
        assert_eq!(self.cell_m.to_bits(), other.cell_m.to_bits());
        let mut comparison = Comparison::default();
        for [x, y] in self.known() {
            comparison.add(self.at(x, y), other.at(x, y));
        }
        for [x, y] in other.known().filter(|&[x, y]| self.at(x, y).is_none()) {
            comparison.add(None, other.at(x, y));
        }
        comparison
    }
}

/// What two maps make of the cells that either knows.
#[derive(Debug, Default)]
pub(crate) struct Comparison {
    /// Known to either.
    pub(crate) cells: u64,
    /// Of the same class, and at most 0.05 apart.
    pub(crate) agree: u64,
    /// Known to one alone.
    pub(crate) one_sided: u64,
    /// Known to both, of the same class, and farther apart.
    pub(crate) far: u64,
    /// Known to both, of different classes.
    pub(crate) other_class: u64,
    /// Exactly the same.
    pub(crate) equal: u64,
}

impl Comparison {
    fn add(&mut self, one: Option<f32>, two: Option<f32>) {
        self.cells += 1;
        match (one, two) {
            (Some(one), Some(two)) if grey(one) != grey(two) => self.other_class += 1,
            (Some(one), Some(two)) if (one - two).abs() > 0.05 => self.far += 1,
            (Some(one), Some(two)) => {
                self.agree += 1;
                self.equal += u64::from(one.to_bits() == two.to_bits());
            }
            _ => self.one_sided += 1,
        }
    }

    /// The share of cells that agree.
    pub(crate) fn share(&self) -> f64 {
        self.agree as f64 / self.cells as f64
    }
}

/// The grey of a probability in a PGM for Nav2's `map_server`, by that tool's own rule.
pub(crate) fn grey(probability: f32) -> u8 {
    if probability >= 0.65 {
        0
    } else if probability <= 0.196 {
        254
    } else {
        205
    }
}

/// Width, height and pixels of a binary PGM.
pub(crate) fn read_pgm(path: &Path) -> (usize, usize, Vec<u8>) {
    let bytes = fs::read(path).unwrap();
    let mut lines = bytes.splitn(4, |&byte| byte == b'\n');
    let mut line = || lines.next().unwrap();
    assert_eq!(line(), b"P5");
    let size = String::from_utf8(line().to_vec()).unwrap();
    let (width, height) = size.split_once(' ').unwrap();
    assert_eq!(line(), b"255");
    (
        width.parse().unwrap(),
        height.parse().unwrap(),
        line().to_vec(),
    )
}
