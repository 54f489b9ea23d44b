//! Outcomes as one Markdown page with pictures beside it.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use serde::{Deserialize, Serialize};

use super::outcome::{Outcome, Part, Table, Verdict};
use super::pictures::Picture;
use super::{Experiment, Session};

/// The page's name; its pictures are in a folder of the same name without the ending.
pub const PAGE: &str = "experiments.md";
const PICTURES: &str = "experiments";
/// Folder of the sections of a page that is not finished.
const FINISHED: &str = "finished";

/// An experiment by the vehicle's own rules, and by those of its document.
pub struct Compared {
    pub experiment: &'static Experiment,
    pub outcome: Outcome,
    pub by_document: Outcome,
}

/// What the page has of one experiment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Section {
    id: String,
    /// Row of the summary.
    row: Vec<String>,
    text: String,
    pub passed: bool,
}

/// A section on the disk, and of what program and seeds it is.
#[derive(Serialize, Deserialize)]
struct KeptSection {
    program: u64,
    seeds: u64,
    section: Section,
}

/// Where the page, its pictures and finished sections are.
#[derive(Clone, Copy, Debug)]
pub struct Folder<'a> {
    dir: &'a Path,
    /// Digest of the program: sections of another one do not count.
    program: u64,
    seeds: u64,
}

impl<'a> Folder<'a> {
    /// Makes the folders of a page: what cannot be written should be known before the experiments are run.
    pub fn prepare(dir: &'a Path, program: u64, session: &Session<'_>) -> anyhow::Result<Self> {
        for name in [PICTURES, FINISHED] {
            let inner = dir.join(name);
            fs::create_dir_all(&inner).with_context(|| inner.display().to_string())?;
        }
        let seeds = *session.seeds().end();
        Ok(Self {
            dir,
            program,
            seeds,
        })
    }

    fn finished(&self, id: &str) -> PathBuf {
        self.dir.join(FINISHED).join(format!("{id}.json"))
    }

    /// The section that this program has finished with these seeds, if any.
    pub fn section(&self, experiment: &Experiment) -> Option<Section> {
        let kept = fs::read(self.finished(experiment.id)).ok()?;
        let kept: KeptSection = serde_json::from_slice(&kept).ok()?;
        (kept.program == self.program && kept.seeds == self.seeds).then_some(kept.section)
    }

    /// Writes the pictures of an experiment and keeps its section.
    pub fn keep(&self, compared: &Compared, session: &Session<'_>) -> anyhow::Result<Section> {
        for picture in compared.outcome.pictures() {
            picture.write(&self.dir.join(PICTURES))?;
        }
        let kept = KeptSection {
            program: self.program,
            seeds: self.seeds,
            section: Section::of(compared, session),
        };
        write_whole(
            &self.finished(compared.experiment.id),
            &serde_json::to_vec(&kept)?,
        )?;
        Ok(kept.section)
    }

    /// Writes the page and returns its path.
    pub fn write(&self, sections: &[Section]) -> anyhow::Result<PathBuf> {
        let path = self.dir.join(PAGE);
        write_whole(&path, page(sections, self.seeds).as_bytes())?;
        Ok(path)
    }
}

/// A file is there whole or not at all.
fn write_whole(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    let part = path.with_extension(format!("{}.part", std::process::id()));
    fs::write(&part, bytes)
        .and_then(|()| fs::rename(&part, path))
        .inspect_err(|_| drop(fs::remove_file(&part)))
        .with_context(|| path.display().to_string())
}

impl Section {
    fn of(compared: &Compared, session: &Session<'_>) -> Self {
        let mut text = heading(compared.experiment);
        text.push_str(&markdown_table(&checks(compared, session)));
        for part in &compared.outcome.parts {
            text.push('\n');
            match part {
                Part::Text(words) => {
                    text.push_str(words);
                    text.push('\n');
                }
                Part::Table(table) => text.push_str(&markdown_table(table)),
                Part::Pictures(pictures) => text.push_str(&beside_each_other(pictures)),
            }
        }
        Self {
            id: compared.experiment.id.to_owned(),
            row: summary(compared),
            text,
            passed: compared.outcome.passed(),
        }
    }
}

fn page(sections: &[Section], seeds: u64) -> String {
    let mut summary = Table::new(&["id", "must show", "measured", ""]);
    summary.rows = sections.iter().map(|section| section.row.clone()).collect();
    let texts = sections.iter().map(|section| section.text.as_str());
    let introduction = include_str!("notes/introduction.md");
    let before = [
        "# Experiments against a known truth\n\n",
        introduction,
        &command(sections, seeds),
        &markdown_table(&summary),
    ];
    before.into_iter().chain(texts).collect()
}

fn command(sections: &[Section], seeds: u64) -> String {
    let ids: Vec<_> = sections.iter().map(|section| section.id.as_str()).collect();
    format!(
        "\nThis page was written by\n\n```sh\nrobot-edge experiments {} --seeds {seeds} --out DIR\n```\n\n",
        ids.join(" ")
    )
}

fn heading(experiment: &Experiment) -> String {
    format!(
        "\n## {}: {}\n\n{} Must show: {}.\n\n",
        experiment.id, experiment.title, experiment.source, experiment.criterion
    )
}

/// Its row of the first table.
fn summary(compared: &Compared) -> Vec<String> {
    let Compared {
        experiment,
        outcome,
        ..
    } = compared;
    let summarized = outcome.checks.iter().take(SUMMARY_CHECKS);
    let summarized: Vec<_> = summarized
        .map(|check| format!("{}: {}", check.what, check.measured))
        .collect();
    vec![
        format!("{} {}", experiment.id, experiment.source),
        experiment.criterion.to_owned(),
        summarized.join("; "),
        if outcome.passed() { "pass" } else { "**FAIL**" }.to_owned(),
    ]
}

/// Checks in a row of the summary.
const SUMMARY_CHECKS: usize = 3;

fn checks(compared: &Compared, session: &Session<'_>) -> Table {
    let measured = format!("measured, {}", session.seeds_text());
    let mut table = Table::new(&["what", &measured, "required", "", "by the document"]);
    for check in &compared.outcome.checks {
        let verdict = match check.verdict {
            Verdict::Passed => "pass",
            Verdict::Failed => "**FAIL**",
            Verdict::Shown => "shown",
        };
        let mut by_document = compared.by_document.checks.iter();
        let by_document = by_document.find(|other| other.what == check.what);
        let by_document = by_document.map_or("", |other| &other.measured);
        table.push([
            &check.what,
            &check.measured,
            &check.required,
            verdict,
            by_document,
        ]);
    }
    table
}

/// First column to the left, figures to the right, words to the left.
fn markdown_table(table: &Table) -> String {
    let escaped = |cell: &String| cell.replace('|', "\\|");
    let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
    let is_figure = |cell: &String| {
        let digits = cell.trim_start_matches(['−', '-', '+']);
        digits.is_empty()
            || digits.starts_with(|first: char| first.is_ascii_digit()) && !digits.contains(' ')
    };
    let is_figures = |column: usize| {
        let mut cells = table.rows.iter().filter_map(|row| row.get(column));
        column > 0 && cells.all(is_figure)
    };
    let rule = (0..table.columns.len())
        .map(|column| if is_figures(column) { "---:" } else { "---" }.to_owned());
    let mut text = line(table.columns.iter().map(escaped).collect());
    text.push_str(&line(rule.collect()));
    for row in &table.rows {
        text.push_str(&line(row.iter().map(escaped).collect()));
    }
    text
}

/// A table of one row, captions above.
fn beside_each_other(pictures: &[Picture]) -> String {
    let mut table = Table {
        columns: pictures
            .iter()
            .map(|picture| picture.caption.clone())
            .collect(),
        rows: Vec::new(),
    };
    let image =
        |picture: &Picture| format!("![{}]({PICTURES}/{}.png)", picture.caption, picture.name);
    table.push(pictures.iter().map(image));
    markdown_table(&table)
}

#[cfg(test)]
mod tests {
    use std::io;
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::outcome::Check;
    use crate::pictures::{Drawing, Image};

    fn l1() -> &'static Experiment {
        Experiment::of_id("l1").unwrap()
    }

    fn tiny() -> Compared {
        let mut table = Table::new(&["cells of", "time, µs", "word"]);
        table.push(["0.1 m", "12.5", "fast"]);
        let picture = |name: &str, caption: &str| Picture {
            name: name.to_owned(),
            caption: caption.to_owned(),
            image: Image::Drawing(Drawing {
                width: 2,
                colors: vec![[0; 3], [255; 3]],
                pixels: vec![0, 1, 1, 0, 0, 0],
            }),
        };
        let outcome = Outcome {
            checks: vec![
                Check::gate("agreement", "99.5 %", "≥ 99 %", true),
                Check::gate("a|b", "3", "0", false),
                Check::shown("drift", "0.2 m"),
            ],
            parts: vec![
                Part::text("\nWords.\n"),
                Part::Table(table),
                Part::Pictures(vec![picture("l1-a", "before"), picture("l1-b", "after")]),
            ],
        };
        Compared {
            experiment: l1(),
            outcome,
            by_document: Outcome {
                checks: vec![Check::gate("agreement", "98.0 %", "≥ 99 %", false)],
                ..Outcome::default()
            },
        }
    }

    #[test]
    fn a_page_says_what_was_asked_what_came_out_and_whether_it_passed() {
        let go = AtomicBool::new(false);
        let session = Session::new(20, &go, &|_| ());
        let page = page(&[Section::of(&tiny(), &session)], 20);
        let (_, page) = page.split_once("This page ").unwrap();
        let expected = "\
was written by

```sh
robot-edge experiments L1 --seeds 20 --out DIR
```

| id | must show | measured |  |
| --- | --- | --- | --- |
| L1 [LRF] | occupied/free cells agree with truth ≥ 99 % of observed cells away from edges | agreement: 99.5 %; a\\|b: 3; drift: 0.2 m | **FAIL** |

## L1: Occupied and free cells agree with the truth

[LRF] Must show: occupied/free cells agree with truth ≥ 99 % of observed cells away from edges.

| what | measured, seeds 1 to 20 | required |  | by the document |
| --- | --- | --- | --- | --- |
| agreement | 99.5 % | ≥ 99 % | pass | 98.0 % |
| a\\|b | 3 | 0 | **FAIL** |  |
| drift | 0.2 m |  | shown |  |

Words.

| cells of | time, µs | word |
| --- | ---: | --- |
| 0.1 m | 12.5 | fast |

| before | after |
| --- | --- |
| ![before](experiments/l1-a.png) | ![after](experiments/l1-b.png) |
";
        assert_eq!(page, expected);
    }

    #[test]
    fn the_page_and_its_pictures_are_written_and_what_is_finished_is_kept() {
        let go = AtomicBool::new(false);
        let session = Session::new(3, &go, &|_| ());
        let temporary = tempfile::tempdir().unwrap();
        let dir = temporary.path().join("new");
        let folder = Folder::prepare(&dir, 1, &session).unwrap();
        assert_eq!(folder.section(l1()), None);
        let section = folder.keep(&tiny(), &session).unwrap();
        assert!(!section.passed);
        assert_eq!(folder.section(l1()), Some(section.clone()));
        let of_another = Folder::prepare(&dir, 2, &session).unwrap();
        assert_eq!(of_another.section(l1()), None, "another program");
        let more = Session::new(4, &go, &|_| ());
        assert_eq!(Folder::prepare(&dir, 1, &more).unwrap().section(l1()), None);

        let path = folder.write(&[section]).unwrap();
        assert_eq!(path, dir.join("experiments.md"));
        assert!(fs::read_to_string(path).unwrap().contains("## L1: "));
        let decoder = png::Decoder::new(io::BufReader::new(
            fs::File::open(dir.join("experiments/l1-a.png")).unwrap(),
        ));
        let reader = decoder.read_info().unwrap();
        assert_eq!((reader.info().width, reader.info().height), (2, 3));
        for (inner, files) in [("", 3), ("finished", 1)] {
            let found = fs::read_dir(dir.join(inner)).unwrap().count();
            assert_eq!(found, files, "nothing temporary is left");
        }

        let file = temporary.path().join("file");
        fs::write(&file, "").unwrap();
        let error = Folder::prepare(&file, 1, &session).unwrap_err().to_string();
        assert!(error.contains("file"), "{error}");
    }
}
