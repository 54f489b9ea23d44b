//! One layer of settings, a preset, a file or an override, checked on its own.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use toml::de::{DeTable, DeValue};
use toml::{Table, Value};

use super::error::{ConfigError, ConfigIssue, Expected, Origin, Problem, suggest};
use super::schema::{Schema, SensorKinds};

/// Faults of one layer beyond this many are not reported: the first ones explain them.
const MAX_ISSUES: usize = 100;
/// Characters of a value or key that a message quotes.
const MAX_QUOTED_CHARS: usize = 60;

#[derive(Clone, Debug)]
pub(super) struct ConfigLayer {
    pub(super) table: Table,
    pub(super) origins: Origins,
}

#[derive(Clone, Debug)]
pub(super) enum Origins {
    One(Origin),
    /// In a file, at these bytes by path of the key.
    File {
        path: PathBuf,
        text: String,
        offsets: BTreeMap<String, usize>,
    },
}

impl ConfigLayer {
    pub(super) fn preset(name: &'static str, text: &str) -> Result<Self, ConfigError> {
        let parsed = text.parse();
        Ok(Self {
            table: parsed.map_err(|error: toml::de::Error| ConfigError::Syntax {
                origin: Origin::Preset(name),
                message: error.message().to_owned(),
            })?,
            origins: Origins::One(Origin::Preset(name)),
        })
    }

    pub(super) fn file(path: &Path, text: &str) -> Result<Self, ConfigError> {
        let syntax = |error: &toml::de::Error| ConfigError::Syntax {
            origin: origin_at(path, text, error.span().map_or(0, |span| span.start)),
            message: error.message().to_owned(),
        };
        let spanned = DeTable::parse(text).map_err(|error| syntax(&error))?;
        let mut offsets = BTreeMap::new();
        collect_offsets(spanned.get_ref(), "", &mut offsets);
        Ok(Self {
            table: text.parse().map_err(|error| syntax(&error))?,
            origins: Origins::File {
                path: path.to_owned(),
                text: text.to_owned(),
                offsets,
            },
        })
    }

    pub(super) fn origin(&self, key: &str) -> Option<Origin> {
        match &self.origins {
            Origins::File {
                path,
                text,
                offsets,
            } => offsets
                .get(key)
                .map(|&offset| origin_at(path, text, offset)),
            Origins::One(origin) => key
                .split('.')
                .try_fold(&self.table, |table, part| match table.get(part) {
                    Some(Value::Table(inner)) => Ok(inner),
                    found => Err(found.is_some()),
                })
                .map_or_else(|found| found, |_table| true)
                .then(|| origin.clone()),
        }
    }

    /// The kinds of the sensors, as far as this layer names them.
    pub(super) fn sensor_kinds(&self) -> SensorKinds<'_> {
        let sensors = self.table.get("sensors").and_then(Value::as_table);
        let kinds = sensors.into_iter().flatten().filter_map(|(name, sensor)| {
            let kind = sensor.get("kind")?.as_str()?;
            Some((name.as_str(), kind))
        });
        kinds.collect()
    }

    pub(super) fn check(&self, root: &Schema, kinds: &SensorKinds<'_>) -> Vec<ConfigIssue> {
        let mut issues = Vec::new();
        self.check_table(
            &self.table,
            root,
            "",
            &KnownKeys { root, kinds },
            &mut issues,
        );
        issues
    }

    fn check_table(
        &self,
        table: &Table,
        schema: &Schema,
        prefix: &str,
        all: &KnownKeys<'_>,
        issues: &mut Vec<ConfigIssue>,
    ) {
        for (key, value) in table {
            if issues.len() >= MAX_ISSUES {
                return;
            }
            let path = join(prefix, key);
            let known = schema.get(key, all.kinds).filter(|_| is_bare(key));
            let issue = match (known, value) {
                (None, _) => Some(unknown_key(&path, value, all)),
                (
                    Some(inner @ (Schema::Table(_) | Schema::Sensors(_) | Schema::Devices(_))),
                    Value::Table(table),
                ) => {
                    self.check_table(table, inner, &path, all, issues);
                    None
                }
                (Some(inner), value) => {
                    wrong_type(value, inner.expected()).map(|problem| (path, problem))
                }
            };
            issues.extend(issue.map(|(key, problem)| ConfigIssue {
                origin: self.origin(&key),
                key: quoted(&key),
                problem,
            }));
        }
    }
}

struct KnownKeys<'a> {
    root: &'a Schema,
    kinds: &'a SensorKinds<'a>,
}

/// Path of `key` in the table at `prefix`.
pub(super) fn join(prefix: &str, key: &str) -> String {
    let dot = if prefix.is_empty() { "" } else { "." };
    format!("{prefix}{dot}{key}")
}

/// Whether TOML takes `key` without quotes.
pub(super) fn is_bare(key: &str) -> bool {
    !key.is_empty()
        && key
            .bytes()
            .all(|byte| byte.is_ascii_alphanumeric() || b"_-".contains(&byte))
}

/// The beginning of what a user wrote, on one line.
pub(super) fn quoted(text: &str) -> String {
    let printable = |c: char| {
        if c.is_control() {
            char::REPLACEMENT_CHARACTER
        } else {
            c
        }
    };
    let mut short: String = text.chars().take(MAX_QUOTED_CHARS).map(printable).collect();
    if text.chars().nth(MAX_QUOTED_CHARS).is_some() {
        short.push('…');
    }
    short
}

fn unknown_key(path: &str, value: &Value, all: &KnownKeys<'_>) -> (String, Problem) {
    // Of `[mapping.ocupancy]` with one setting that setting is named, as `--set` would.
    let (mut path, mut value) = (path.to_owned(), value);
    while let Value::Table(table) = value
        && table.len() == 1
        && let Some((key, inner)) = table.iter().next()
    {
        path = join(&path, key);
        value = inner;
    }
    let sensor = path
        .strip_prefix("sensors.")
        .or_else(|| path.strip_prefix("devices."))
        .and_then(|rest| rest.split('.').next())
        .unwrap_or(Schema::SENSOR);
    let known = all.root.paths(sensor, all.kinds.get(sensor).copied());
    // The key of a sensor is not meant for a device of the same name.
    let of_sensor = path.starts_with("sensors.");
    let candidates = known
        .iter()
        .filter(|(known, _)| !(of_sensor && known.starts_with("devices.")))
        .filter(|(_, expected)| value.is_table() || *expected != Expected::Table)
        .map(|(path, _)| path.as_str());
    let suggestion = suggest(&path, candidates);
    (path, Problem::UnknownKey { suggestion })
}

fn wrong_type(value: &Value, expected: Expected) -> Option<Problem> {
    let fits = match (expected, value) {
        (Expected::Bool, Value::Boolean(_))
        | (Expected::Number, Value::Float(_) | Value::Integer(_))
        | (Expected::Text, Value::String(_)) => true,
        (Expected::Integer(max), Value::Integer(number)) => {
            u64::try_from(*number).is_ok_and(|number| number <= max)
        }
        (Expected::OneOf(words), Value::String(word)) => words.contains(&word.as_str()),
        _ => false,
    };
    (!fits).then(|| Problem::WrongType {
        expected,
        found: match value {
            Value::Table(_) => "a table".to_owned(),
            Value::Array(_) => "an array".to_owned(),
            Value::String(text) => format!("the text \"{}\"", quoted(text)),
            Value::Integer(_) | Value::Float(_) | Value::Boolean(_) | Value::Datetime(_) => {
                quoted(&value.to_string())
            }
        },
    })
}

fn collect_offsets(table: &DeTable<'_>, prefix: &str, offsets: &mut BTreeMap<String, usize>) {
    for (key, value) in table {
        let path = join(prefix, key.get_ref());
        if let DeValue::Table(inner) = value.get_ref() {
            collect_offsets(inner, &path, offsets);
        }
        offsets.insert(path, key.span().start);
    }
}

fn origin_at(path: &Path, text: &str, offset: usize) -> Origin {
    let before = text.get(..offset).unwrap_or(text);
    let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
    Origin::File {
        path: path.to_owned(),
        line: before.matches('\n').count() + 1,
        column: before[line_start..].chars().count() + 1,
    }
}
