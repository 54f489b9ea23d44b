//! Outcomes as one Markdown page with pictures beside it.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context as _;

use super::outcome::{Outcome, Part, Table, Verdict};
use super::pictures::Picture;
use super::{Experiment, Session};

/// The page's name; its pictures are in a folder of the same name without the ending.
pub const PAGE: &str = "experiments.md";
const PICTURES: &str = "experiments";

/// An experiment by the vehicle's own rules, and by those of its document.
pub struct Compared {
    pub experiment: &'static Experiment,
    pub outcome: Outcome,
    pub by_document: Outcome,
}

/// Makes the folders of a page: what cannot be written should be known before the experiments are run.
pub fn prepare(dir: &Path) -> anyhow::Result<()> {
    let pictures = dir.join(PICTURES);
    fs::create_dir_all(&pictures).with_context(|| pictures.display().to_string())
}

/// Writes the page and its pictures to `dir`, and returns the page's path. The page comes last and whole:
/// what it shows is there.
pub fn write(dir: &Path, outcomes: &[Compared], session: &Session<'_>) -> anyhow::Result<PathBuf> {
    prepare(dir)?;
    for picture in outcomes
        .iter()
        .flat_map(|compared| compared.outcome.pictures())
    {
        picture.write(&dir.join(PICTURES))?;
    }
    let path = dir.join(PAGE);
    let part = dir.join(format!(".{PAGE}.{}.part", std::process::id()));
    fs::write(&part, page(outcomes, session))
        .and_then(|()| fs::rename(&part, &path))
        .inspect_err(|_| drop(fs::remove_file(&part)))
        .with_context(|| path.display().to_string())?;
    Ok(path)
}

pub fn page(outcomes: &[Compared], session: &Session<'_>) -> String {
    let mut page = String::new();
    page.push_str("# Experiments against a known truth\n\n");
    page.push_str(include_str!("notes/introduction.md"));
    page.push_str(&command(outcomes, session));
    page.push_str(&markdown_table(&summary(outcomes)));
    for compared in outcomes {
        page.push_str(&heading(compared.experiment));
        page.push_str(&markdown_table(&checks(compared, session)));
        for part in &compared.outcome.parts {
            page.push('\n');
            match part {
                Part::Text(text) => {
                    page.push_str(text);
                    page.push('\n');
                }
                Part::Table(table) => page.push_str(&markdown_table(table)),
                Part::Pictures(pictures) => page.push_str(&beside_each_other(pictures)),
            }
        }
    }
    page
}

fn command(outcomes: &[Compared], session: &Session<'_>) -> String {
    let ids: Vec<_> = outcomes
        .iter()
        .map(|compared| compared.experiment.id)
        .collect();
    format!(
        "\nThis page was written by\n\n```sh\nrobot-edge experiments {} --seeds {} --out DIR\n```\n\n",
        ids.join(" "),
        session.seeds().end()
    )
}

fn heading(experiment: &Experiment) -> String {
    format!(
        "\n## {}: {}\n\n{} Must show: {}.\n\n",
        experiment.id, experiment.title, experiment.source, experiment.criterion
    )
}

/// One row an experiment.
fn summary(outcomes: &[Compared]) -> Table {
    let mut table = Table::new(&["id", "must show", "measured", ""]);
    for Compared {
        experiment,
        outcome,
        ..
    } in outcomes
    {
        let summarized = outcome.checks.iter().take(SUMMARY_CHECKS);
        let summarized: Vec<_> = summarized
            .map(|check| format!("{}: {}", check.what, check.measured))
            .collect();
        table.push([
            format!("{} {}", experiment.id, experiment.source),
            experiment.criterion.to_owned(),
            summarized.join("; "),
            if outcome.passed() { "pass" } else { "**FAIL**" }.to_owned(),
        ]);
    }
    table
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
        let page = page(&[tiny()], &session);
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
    fn the_page_and_its_pictures_are_written() {
        let go = AtomicBool::new(false);
        let session = Session::new(1, &go, &|_| ());
        let folder = tempfile::tempdir().unwrap();
        let dir = folder.path().join("new");
        let path = write(&dir, &[tiny()], &session).unwrap();
        assert_eq!(path, dir.join("experiments.md"));
        assert!(fs::read_to_string(path).unwrap().contains("## L1: "));
        let decoder = png::Decoder::new(io::BufReader::new(
            fs::File::open(dir.join("experiments/l1-a.png")).unwrap(),
        ));
        let reader = decoder.read_info().unwrap();
        assert_eq!((reader.info().width, reader.info().height), (2, 3));
        assert_eq!(
            fs::read_dir(&dir).unwrap().count(),
            2,
            "nothing temporary is left"
        );

        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        let error = prepare(&file).unwrap_err().to_string();
        assert!(error.contains("file"), "{error}");
    }
}
