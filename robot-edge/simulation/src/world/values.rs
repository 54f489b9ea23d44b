//! Values of a world file: range checks, tables whose keys depend on a tag, and errors with their place.

use std::ops::Range;

use nalgebra::Point2;
use serde::de::{DeserializeOwned, Error};
use serde::{Deserialize, Deserializer};
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

/// A fault and its place in the text.
pub(super) struct Fault {
    pub(super) message: String,
    pub(super) span: Option<Range<usize>>,
}

impl From<toml::de::Error> for Fault {
    fn from(error: toml::de::Error) -> Self {
        Self {
            message: error.message().to_owned(),
            span: error.span(),
        }
    }
}

impl Fault {
    pub(super) fn new(span: Range<usize>, message: impl Into<String>) -> Self {
        Self {
            message: message.into(),
            span: Some(span),
        }
    }

    /// The line of `text`, counted from 1.
    pub(super) fn line_in(&self, text: &str) -> usize {
        let start = self.span.as_ref().map_or(0, |span| span.start);
        1 + text.get(..start).unwrap_or_default().matches('\n').count()
    }

    /// The key whose value the fault's span is, read backwards from it.
    pub(super) fn key_in(&self, text: &str) -> Option<String> {
        let before = text.get(..self.span.as_ref()?.start)?;
        let (left, value) = before.rsplit_once('=')?;
        // Elements of an array belong to the key before its bracket; anything else is not this key's value.
        let count = |bracket: char| value.matches(bracket).count();
        let is_in_array = count('[') > count(']');
        let is_its_value = (is_in_array || !value.contains('\n'))
            && value.chars().all(|c| !matches!(c, '{' | '}' | '#' | '"'));
        let key = left.trim_end().rsplit([' ', ',', '{', '\t', '\n']).next()?;
        (is_its_value && !key.is_empty()).then(|| key.to_owned())
    }
}

/// A fault of one item of a list, or of all together.
#[derive(Debug, PartialEq)]
pub(crate) struct ItemError {
    /// Counted from 0.
    pub(crate) item: Option<usize>,
    pub(crate) message: String,
}

impl ItemError {
    pub(crate) fn whole(message: &str) -> Self {
        Self {
            item: None,
            message: message.to_owned(),
        }
    }

    /// The fault of `whole`, or of the one of its `items` to blame.
    pub(super) fn fault<T>(self, items: &[Spanned<T>], whole: Range<usize>) -> Fault {
        let item = self.item.and_then(|n| items.get(n));
        Fault::new(item.map_or(whole, Spanned::span), self.message)
    }
}

pub(super) const MILLION: i64 = 1_000_000;

/// A number between two bounds, which are given in millionths.
#[derive(Clone, Copy, Default, Deserialize)]
#[serde(try_from = "f64")]
pub(crate) struct Within<const LEAST: i64, const MOST: i64>(pub(crate) f64);

pub(crate) type Coordinate = Within<{ -MILLION * MILLION }, { MILLION * MILLION }>;
pub(crate) type Positive = Within<1, { MILLION * MILLION }>;
pub(crate) type NotNegative = Within<0, { MILLION * MILLION }>;
pub(crate) type Probability = Within<0, MILLION>;

impl<const LEAST: i64, const MOST: i64> TryFrom<f64> for Within<LEAST, MOST> {
    type Error = String;

    fn try_from(value: f64) -> Result<Self, String> {
        let [least, most] = [LEAST, MOST].map(|bound| bound as f64 / MILLION as f64);
        if (least..=most).contains(&value) {
            Ok(Self(value))
        } else {
            Err(format!("{value} is not between {least} and {most}"))
        }
    }
}

impl<const LEAST: i64, const MOST: i64> Within<LEAST, MOST> {
    /// The bare number of this range.
    pub(crate) fn number<'de, D: Deserializer<'de>>(value: D) -> Result<f64, D::Error> {
        Self::deserialize(value).map(|number| number.0)
    }
}

/// Least and greatest of something, within bounds in millionths.
#[derive(Clone, Copy, Default, Deserialize)]
#[serde(try_from = "[f64; 2]")]
pub(crate) struct Between<const LEAST: i64, const MOST: i64>(pub(crate) [f64; 2]);

/// No plant of a world is larger than 20 m.
pub(crate) type PlantMetres = Between<0, { 20 * MILLION }>;
/// From 10⁻³ to 1000 mm.
pub(crate) type Millimetres = Between<1_000, { 1_000 * MILLION }>;

impl<const LEAST: i64, const MOST: i64> TryFrom<[f64; 2]> for Between<LEAST, MOST> {
    type Error = String;

    fn try_from([least, most]: [f64; 2]) -> Result<Self, String> {
        Within::<LEAST, MOST>::try_from(least)?;
        Within::<LEAST, MOST>::try_from(most)?;
        if least <= most {
            Ok(Self([least, most]))
        } else {
            Err(format!("the least, {least}, is more than the most, {most}"))
        }
    }
}

impl<const LEAST: i64, const MOST: i64> Between<LEAST, MOST> {
    /// The bare numbers of this range.
    pub(crate) fn numbers<'de, D: Deserializer<'de>>(values: D) -> Result<[f64; 2], D::Error> {
        Self::deserialize(values).map(|between| between.0)
    }
}

/// A thickness in millimetres as metres.
pub(crate) fn millimetres<'de, D: Deserializer<'de>>(values: D) -> Result<[f64; 2], D::Error> {
    let millimetres = Millimetres::numbers(values)?;
    Ok(millimetres.map(|mm| 1e-3 * mm))
}

pub(crate) fn points<'de, D: Deserializer<'de>>(values: D) -> Result<Vec<Point2<f64>>, D::Error> {
    let points = Vec::<[Coordinate; 2]>::deserialize(values)?;
    Ok(points.into_iter().map(point).collect())
}

pub(super) const TOO_FEW_CORNERS: &str = "`polygon_m` needs at least 3 corners";

pub(crate) fn polygon<'de, D: Deserializer<'de>>(values: D) -> Result<Vec<Point2<f64>>, D::Error> {
    let corners = points(values)?;
    if corners.len() < 3 {
        return Err(D::Error::custom(TOO_FEW_CORNERS));
    }
    Ok(corners)
}

pub(crate) fn point(at: [Coordinate; 2]) -> Point2<f64> {
    Point2::from(at.map(|coordinate| coordinate.0))
}

/// The tables of the array called `name`, none if it is missing.
pub(super) fn tables<'a>(
    document: &mut DeTable<'a>,
    name: &str,
) -> Result<Vec<Spanned<DeValue<'a>>>, Fault> {
    let Some(array) = document.remove(name) else {
        return Ok(Vec::new());
    };
    let (span, found) = (array.span(), array.get_ref().type_str());
    if let DeValue::Array(tables) = array.into_inner() {
        Ok(tables.into_iter().collect())
    } else {
        let message = format!("expected `[[{name}]]` tables, found {found}");
        Err(Fault::new(span, message))
    }
}

/// A table whose keys depend on the value of one of them, its tag. Serde's own tagged enums lose the place of
/// their values.
pub(super) struct Tagged<'a, T> {
    pub(super) span: Range<usize>,
    tag: Spanned<DeValue<'a>>,
    /// The keys that every tag has.
    pub(super) common: T,
    common_keys: &'static [&'static str],
    rest: DeTable<'a>,
}

impl<'a, T: DeserializeOwned> Tagged<'a, T> {
    /// `missing` is the message where there is no tag.
    pub(super) fn split(
        table: Spanned<DeValue<'a>>,
        tag: &str,
        common_keys: &'static [&'static str],
        missing: &str,
    ) -> Result<Self, Fault> {
        let span = table.span();
        let mut rest = if let DeValue::Table(keys) = table.into_inner() {
            keys
        } else {
            DeTable::new()
        };
        let tag = rest
            .remove(tag)
            .ok_or_else(|| Fault::new(span.clone(), missing))?;
        let mut common = DeTable::new();
        for key in common_keys {
            common.extend(rest.remove_entry(*key));
        }
        Ok(Self {
            tag,
            common: deserialize(common, &span)?,
            common_keys,
            rest,
            span,
        })
    }

    pub(super) fn tag(&self) -> &str {
        self.tag.get_ref().as_str().unwrap_or_default()
    }

    /// Takes the keys that depend on the tag; an error that lists the known keys includes the common ones.
    pub(super) fn keys<K: DeserializeOwned>(&mut self) -> Result<K, Fault> {
        deserialize(std::mem::take(&mut self.rest), &self.span).map_err(|mut fault| {
            if fault.message.starts_with("unknown field") {
                for key in self.common_keys {
                    fault.message.extend([", `", key, "`"]);
                }
            }
            fault
        })
    }

    /// A fault of the table as a whole.
    pub(super) fn fault(&self, message: impl Into<String>) -> Fault {
        Fault::new(self.span.clone(), message)
    }

    pub(super) fn unknown_tag(&self, tag: &str, expected: &str) -> Fault {
        let name = self.tag.get_ref().as_str();
        let name = name.map(|name| format!(" \"{name}\"")).unwrap_or_default();
        let message = format!("unknown `{tag}`{name}, expected {expected}");
        Fault::new(self.tag.span(), message)
    }
}

fn deserialize<T: DeserializeOwned>(keys: DeTable<'_>, span: &Range<usize>) -> Result<T, Fault> {
    let table = Spanned::new(span.clone(), DeValue::Table(keys));
    Ok(T::deserialize(ValueDeserializer::from(table))?)
}
