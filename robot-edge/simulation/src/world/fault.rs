//! What is wrong with a world file, and where.

use std::ops::Range;

/// What is wrong, and which bytes of the text say so.
#[derive(Debug)]
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
