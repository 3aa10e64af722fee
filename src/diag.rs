//! Errors that point into the user's text, a file or an override on the command line, with line, caret and help.

use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet, normalize_untrusted_str};
use std::ops::Range;

/// A text that errors can point into.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceText {
    /// File name, or `--set`.
    pub name: String,
    /// All of the text, into which the spans of errors point.
    pub text: String,
}

/// Position in a source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// Index into the sources of the [`Report`].
    pub source: usize,
    /// Range of bytes in the text of the source.
    pub span: Range<usize>,
}

/// One error.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diag {
    /// What is wrong, with the value and what would be right.
    pub title: String,
    /// Where it is wrong.
    pub place: Place,
    /// What to do.
    pub help: Option<String>,
}

/// All errors of an input, in the order of its text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Report {
    /// The file first, then one for every override that an error points into.
    pub sources: Vec<SourceText>,
    /// The errors, sorted by place, none twice.
    pub diags: Vec<Diag>,
}

/// Maximum number of errors printed at once; the number of the others follows.
const MAX_PRINTED: usize = 20;

impl Report {
    /// Sorts the errors by their places and drops repetitions.
    pub fn new(sources: Vec<SourceText>, mut diags: Vec<Diag>) -> Report {
        diags.sort_by_key(|d| (d.place.source, d.place.span.start));
        diags.dedup();
        Report { sources, diags }
    }
}

impl std::fmt::Display for Report {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (i, diag) in self.diags.iter().take(MAX_PRINTED).enumerate() {
            if i > 0 {
                writeln!(f, "\n")?;
            }
            let source = &self.sources[diag.place.source];
            // The renderer needs spans inside the text and on character boundaries.
            let len = source.text.len();
            let start = source.text.floor_char_boundary(diag.place.span.start.min(len));
            let end = source.text.ceil_char_boundary(diag.place.span.end.clamp(start, len));
            let snippet = Snippet::source(source.text.as_str())
                .path(source.name.as_str())
                .annotation(AnnotationKind::Primary.span(start..end));
            let mut group: Group<'_> = Level::ERROR.primary_title(diag.title.as_str()).element(snippet);
            if let Some(help) = &diag.help {
                group = group.element(Level::HELP.message(normalize_untrusted_str(help)));
            }
            write!(f, "{}", Renderer::plain().render(&[group]))?;
        }
        if self.diags.len() > MAX_PRINTED {
            write!(f, "\n\n... and {} more", self.diags.len() - MAX_PRINTED)?;
        }
        Ok(())
    }
}

impl std::error::Error for Report {}

/// The last name of a path: `driven` of `sprockets.driven`.
pub fn last_name(path: &str) -> &str {
    path.rsplit('.').next().unwrap_or(path)
}

/// The name among `known` that is most similar to `name`, if any is similar.
pub fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    known
        .into_iter()
        .map(|k| (strsim::normalized_damerau_levenshtein(name, k), k))
        .filter(|(similarity, _)| *similarity > 0.5)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, k)| k)
}
