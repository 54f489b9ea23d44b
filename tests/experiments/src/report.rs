//! Outcomes as one Markdown page with pictures beside it.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use protocol::export::ExportError;

use super::outcome::{Check, Outcome, Part, Table, Verdict};
use super::pictures::Picture;
use super::{Experiment, Session};

/// The page's name; its pictures are in a folder of the same name without the ending.
pub const PAGE: &str = "experiments.md";
const PICTURES: &str = "experiments";

/// Why the page could not be written.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The page or its folder.
    #[error("{}: {source}", path.display())]
    Io {
        /// What could not be written.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A picture.
    #[error(transparent)]
    Picture(#[from] ExportError),
}

/// Makes the folders of a page: what cannot be written should be known before the experiments are run.
///
/// # Errors
/// Where they cannot be made.
pub fn prepare(dir: &Path) -> Result<(), ReportError> {
    let pictures = dir.join(PICTURES);
    fs::create_dir_all(&pictures).map_err(|source| ReportError::Io {
        path: pictures,
        source,
    })
}

/// Writes the page and its pictures to `dir`, and returns the page's path. The page comes last and whole:
/// what it shows is there.
///
/// # Errors
/// Where something cannot be written.
pub fn write(
    dir: &Path,
    outcomes: &[(Experiment, Outcome)],
    session: &Session<'_>,
) -> Result<PathBuf, ReportError> {
    prepare(dir)?;
    for picture in outcomes.iter().flat_map(|(_, outcome)| outcome.pictures()) {
        picture.write(&dir.join(PICTURES))?;
    }
    let path = dir.join(PAGE);
    let part = dir.join(format!(".{PAGE}.{}.part", std::process::id()));
    fs::write(&part, page(outcomes, session))
        .and_then(|()| fs::rename(&part, &path))
        .map_err(|source| {
            // The first error is the one to tell.
            drop(fs::remove_file(&part));
            ReportError::Io {
                path: path.clone(),
                source,
            }
        })?;
    Ok(path)
}

/// The page as text.
pub fn page(outcomes: &[(Experiment, Outcome)], session: &Session<'_>) -> String {
    let mut page = String::new();
    page.push_str("# Experiments against a known truth\n\n");
    page.push_str(include_str!("notes/introduction.md"));
    page.push_str(&command(outcomes, session));
    page.push_str(&markdown_table(&summary(outcomes)));
    for (experiment, outcome) in outcomes {
        page.push_str(&heading(*experiment));
        page.push_str(&markdown_table(&checks(&outcome.checks, session)));
        for part in &outcome.parts {
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

fn command(outcomes: &[(Experiment, Outcome)], session: &Session<'_>) -> String {
    let ids = outcomes.iter().map(|(experiment, _)| experiment.id());
    let ids: Vec<_> = ids.collect();
    format!(
        "\nThis page was written by\n\n```sh\nrobot-edge experiments {} --seeds {} --out DIR\n```\n\n",
        ids.join(" "),
        session.seeds().end()
    )
}

fn heading(experiment: Experiment) -> String {
    format!(
        "\n## {}: {}\n\n{} Must show: {}.\n\n",
        experiment.id(),
        experiment.title(),
        experiment.source(),
        experiment.criterion()
    )
}

/// One row an experiment.
fn summary(outcomes: &[(Experiment, Outcome)]) -> Table {
    let mut table = Table::new(&["id", "must show", "measured", ""]);
    for (experiment, outcome) in outcomes {
        let summarized = outcome.checks.iter().take(SUMMARY_CHECKS);
        let summarized: Vec<_> = summarized
            .map(|check| format!("{}: {}", check.what, check.measured))
            .collect();
        table.push([
            format!("{} {}", experiment.id(), experiment.source()),
            experiment.criterion().to_owned(),
            summarized.join("; "),
            if outcome.passed() { "pass" } else { "**FAIL**" }.to_owned(),
        ]);
    }
    table
}

/// Checks that the summary tells of.
const SUMMARY_CHECKS: usize = 3;

fn checks(checks: &[Check], session: &Session<'_>) -> Table {
    let measured = format!("measured, {}", session.seeds_text());
    let mut table = Table::new(&["what", &measured, "required", ""]);
    for check in checks {
        let verdict = match check.verdict {
            Verdict::Passed => "pass",
            Verdict::Failed => "**FAIL**",
            Verdict::Shown => "shown",
        };
        let cells = [&check.what, &check.measured, &check.required, verdict];
        table.push(cells);
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
mod tests;
