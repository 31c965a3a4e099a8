//! What a load finds out on its way: problems, losses and notes.

use super::tree::Element;
use super::value::shorten;
use crate::diagnostics::Diagnostics;
use crate::spec::{Pair, Source, Spec};
use crate::suggest;

/// Most problems that are listed; the rest are counted.
const MOST_PROBLEMS: usize = 50;

/// Collects problems (which reject the model), losses (what a lenient load left out) and notes.
pub(super) struct Report {
    lenient: bool,
    problems: Diagnostics,
    unlisted: usize,
    losses: Vec<String>,
    pub notes: Vec<String>,
}

impl Report {
    pub fn new(lenient: bool) -> Self {
        Report { lenient, problems: Diagnostics::default(), unlisted: 0, losses: Vec::new(), notes: Vec::new() }
    }

    /// Adds a problem of an element.
    pub fn error(&mut self, element: &Element, message: impl Into<String>, remedy: impl Into<String>) {
        self.error_at(&element.source, element.label(), message, remedy);
    }

    /// Adds a problem at a place.
    pub fn error_at(
        &mut self,
        source: &Source,
        element: impl Into<String>,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) {
        if self.problems.0.len() < MOST_PROBLEMS {
            self.problems.push(source, element, message, remedy);
        } else {
            self.unlisted += 1;
        }
    }

    /// A remedy for an unknown word. To search costs time, so none is sought once problems are only counted.
    pub fn propose<'a>(&self, word: &str, words: impl Iterator<Item = &'a str> + Clone) -> String {
        if self.problems.0.len() < MOST_PROBLEMS { suggest::or_list(word, words) } else { String::new() }
    }

    /// An element or attribute that changes the physics and is not supported: a loss if lenient, otherwise a problem.
    pub fn unsupported(&mut self, element: &Element, what: &str) {
        if self.lenient {
            self.lose(element, &format!("{what} not supported, left out"));
        } else {
            self.error(element, format!("{what} not supported"), "a lenient load leaves it out");
        }
    }

    /// Adds a loss.
    pub fn lose(&mut self, element: &Element, what: &str) {
        self.lose_at(&element.source, &element.label(), what);
    }

    fn lose_at(&mut self, source: &Source, element: &str, what: &str) {
        let place = match (&source.file, source.line) {
            (Some(file), line) => format!("{file}:{line}: "),
            (None, 0) => String::new(),
            (None, line) => format!("line {line}: "),
        };
        self.losses.push(format!("{place}{element}: {what}"));
    }

    /// A pair that refers to a geom that was left out.
    pub fn lose_pair(&mut self, pair: &Pair, geom: &str) {
        self.lose_at(&pair.source, "pair", &format!("geom {} was left out, and so is this pair", quoted(geom)));
    }

    /// Hands losses and notes to the model, or returns all problems if there are any.
    pub fn into_result(mut self, spec: &mut Spec) -> Result<(), Diagnostics> {
        if self.unlisted > 0 {
            let message = format!("{} more problems are not listed", self.unlisted);
            self.problems.push(&Source::default(), "", message, "");
        }
        spec.losses = self.losses;
        spec.notes = self.notes;
        self.problems.into_result()
    }
}

/// One problem with a file as a whole.
pub(super) fn file_problem(source: &Source, message: impl Into<String>, remedy: impl Into<String>) -> Diagnostics {
    let mut problems = Diagnostics::default();
    problems.push(source, "", message, remedy);
    problems
}

/// A name in quotes, safe to print.
pub(super) fn quoted(name: &str) -> String {
    format!("\"{}\"", shorten(name))
}
