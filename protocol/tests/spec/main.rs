//! Checks `SPEC.md` against the code: every example is built from its stated values and compared
//! byte by byte, and every message, field, layer, key and limit must be in it.

#![allow(
    clippy::unwrap_used,
    reason = "the lint knows functions marked as tests, not what they call"
)]

mod messages;
mod tables;
mod tiles;

use serde_json::Value;

const SPEC: &str = include_str!("../../SPEC.md");

/// Lines of the one code block that opens with exactly ` ```info `.
fn block(info: &str) -> String {
    let opening = format!("```{info}");
    let mut lines = SPEC.lines();
    assert!(
        lines.any(|line| line == opening),
        "SPEC.md has no block {opening}"
    );
    let block: Vec<&str> = lines.by_ref().take_while(|line| *line != "```").collect();
    assert!(
        !lines.any(|line| line == opening),
        "SPEC.md has two blocks {opening}"
    );
    block.join("\n")
}

/// The rest of the opening line of every block that begins with ` ```kind `.
fn blocks_of(kind: &str) -> Vec<&'static str> {
    let opening = format!("```{kind} ");
    SPEC.lines()
        .filter_map(|line| line.strip_prefix(&opening))
        .collect()
}

/// The bytes of a ` ```hex NAME ` block.
fn hex(name: &str) -> Vec<u8> {
    let block = block(&format!("hex {name}"));
    let digits: String = block
        .lines()
        .filter_map(|line| line.split('#').next())
        .flat_map(str::chars)
        .filter(|character| !character.is_whitespace())
        .collect();
    bytes(&digits)
}

/// The values of a ` ```json NAME ` block, with `"hex:…"` as sequences of bytes.
fn json(name: &str) -> Value {
    let mut value = serde_json::from_str(&block(&format!("json {name}"))).unwrap();
    expand(&mut value);
    value
}

/// Cells of the rows of all tables whose first cell is `` `…` `` or a number, between a heading and
/// the next.
fn table(heading: &str) -> Vec<Vec<&'static str>> {
    let mut lines = SPEC.lines();
    assert!(
        lines.any(|line| line == heading),
        "SPEC.md has no heading {heading:?}"
    );
    let mut in_block = false;
    lines
        .take_while(|line| {
            in_block ^= line.starts_with("```");
            in_block || !line.starts_with('#')
        })
        .filter_map(|line| line.strip_prefix("| ")?.strip_suffix(" |"))
        .map(|row| row.split('|').map(str::trim).collect::<Vec<_>>())
        .filter(|row| row[0].starts_with(|first: char| first == '`' || first.is_ascii_digit()))
        .collect()
}

fn bytes(digits: &str) -> Vec<u8> {
    assert!(digits.len().is_multiple_of(2), "half a byte: {digits}");
    (0..digits.len())
        .step_by(2)
        .map(|at| u8::from_str_radix(&digits[at..at + 2], 16).unwrap())
        .collect()
}

fn expand(value: &mut Value) {
    match value {
        Value::String(text) => {
            if let Some(digits) = text.strip_prefix("hex:") {
                *value = bytes(digits).into();
            }
        }
        Value::Array(values) => values.iter_mut().for_each(expand),
        Value::Object(fields) => fields.values_mut().for_each(expand),
        Value::Null | Value::Bool(_) | Value::Number(_) => {}
    }
}
