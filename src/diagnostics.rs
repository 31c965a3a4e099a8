//! What is wrong with a model: every problem found, each with its place and its remedy.

use std::fmt;

use crate::spec::Source;

/// One problem.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// Where.
    pub source: Source,
    /// Element and name, such as `geom "floor"`; empty if the file as a whole.
    pub element: String,
    /// What is wrong.
    pub message: String,
    /// What to do about it; may be empty.
    pub remedy: String,
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(file) = &self.source.file {
            write!(f, "{file}:")?;
        }
        if self.source.line > 0 {
            write!(f, "{}:", self.source.line)?;
        }
        if self.source.file.is_some() || self.source.line > 0 {
            write!(f, " ")?;
        }
        if !self.element.is_empty() {
            write!(f, "{}: ", self.element)?;
        }
        write!(f, "{}", self.message)?;
        if !self.remedy.is_empty() {
            write!(f, " ({})", self.remedy)?;
        }
        Ok(())
    }
}

/// Why a model was rejected: at least one [`Diagnostic`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Diagnostics(pub Vec<Diagnostic>);

impl Diagnostics {
    /// Most problems that are listed.
    pub(crate) const MOST: usize = 50;

    /// Adds a problem.
    pub fn push(
        &mut self,
        source: &Source,
        element: impl Into<String>,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) {
        self.0.push(Diagnostic {
            source: source.clone(),
            element: element.into(),
            message: message.into(),
            remedy: remedy.into(),
        });
    }

    /// `Ok` if there is no problem.
    pub fn into_result(self) -> Result<(), Diagnostics> {
        if self.0.is_empty() { Ok(()) } else { Err(self.first()) }
    }

    /// The first problems; if there are many more, the rest are counted.
    pub(crate) fn first(mut self) -> Diagnostics {
        // One more may already be the sentence that counts the rest.
        if self.0.len() > Self::MOST + 1 {
            let message = format!("{} more problems are not listed", self.0.len() - Self::MOST);
            self.0.truncate(Self::MOST);
            self.push(&Source::default(), "", message, "mend these first");
        }
        self
    }
}

impl fmt::Display for Diagnostics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, d) in self.0.iter().enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            write!(f, "{d}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Diagnostics {}

/// One problem with a file as a whole.
pub(crate) fn file_problem(source: &Source, message: impl Into<String>, remedy: impl Into<String>) -> Diagnostics {
    let mut problems = Diagnostics::default();
    problems.push(source, "", message, remedy);
    problems
}

/// A name in quotes, safe to print.
pub(crate) fn quoted(name: &str) -> String {
    format!("\"{}\"", shorten(name))
}

/// The first characters of a text that may be long or hold control characters, for messages.
pub fn shorten(text: &str) -> String {
    const MOST: usize = 40;
    let mut out: String = text.chars().take(MOST).map(|c| if c.is_control() { ' ' } else { c }).collect();
    if text.chars().nth(MOST).is_some() {
        out.push('…');
    }
    out
}
