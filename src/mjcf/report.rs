//! What a load finds out on its way: problems, losses and notes.

use super::tree::Element;
use crate::diagnostics::Diagnostics;
pub(super) use crate::diagnostics::{file_problem, quoted};
use crate::spec::{Source, Spec};
use crate::suggest;
use crate::unbuilt::Unbuilt;

/// Most losses, and most notes, that are listed.
const MOST_SENTENCES: usize = 1000;

/// Collects problems (which reject the model), losses (what a lenient load left out) and notes.
pub(super) struct Report {
    pub lenient: bool,
    problems: Diagnostics,
    unlisted: usize,
    losses: List,
    notes: List,
}

/// Sentences, of which the first are kept and the rest counted.
#[derive(Default)]
struct List {
    sentences: Vec<String>,
    more: usize,
}

impl List {
    fn push(&mut self, sentence: String) {
        if self.sentences.len() < MOST_SENTENCES {
            self.sentences.push(sentence);
        } else {
            self.more += 1;
        }
    }

    fn finish(mut self) -> Vec<String> {
        if self.more > 0 {
            self.sentences.push(format!("{} more are not listed", self.more));
        }
        self.sentences
    }
}

impl Report {
    pub fn new(lenient: bool) -> Self {
        Report {
            lenient,
            problems: Diagnostics::default(),
            unlisted: 0,
            losses: List::default(),
            notes: List::default(),
        }
    }

    /// Whether there is any problem.
    pub fn failed(&self) -> bool {
        !self.problems.0.is_empty()
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
        if self.problems.0.len() < Diagnostics::MOST {
            self.problems.push(source, element, message, remedy);
        } else {
            self.unlisted += 1;
        }
    }

    /// Adds the problems of another model.
    pub fn absorb(&mut self, problems: Diagnostics) {
        for problem in problems.0 {
            self.error_at(&problem.source, problem.element, problem.message, problem.remedy);
        }
    }

    /// Adds the losses and notes of a model that is attached.
    pub fn adopt(&mut self, spec: &mut Spec) {
        spec.losses.drain(..).for_each(|loss| self.losses.push(loss));
        spec.notes.drain(..).for_each(|note| self.notes.push(note));
    }

    /// A remedy for an unknown word.
    pub fn propose<'a>(&self, word: &str, words: impl Iterator<Item = &'a str> + Clone) -> String {
        self.seek(|| suggest::or_list(word, words))
    }

    /// A remedy that costs time to find, which is not sought once problems are only counted.
    pub fn seek(&self, remedy: impl FnOnce() -> String) -> String {
        if self.problems.0.len() < Diagnostics::MOST { remedy() } else { String::new() }
    }

    /// An element or attribute that changes the physics and is not supported: a loss if lenient, otherwise a problem.
    pub fn unsupported(&mut self, element: &Element, what: &str) {
        if self.lenient {
            self.lose(element, &format!("{what} not supported, left out"));
        } else {
            self.error(element, format!("{what} not supported"), "a lenient load leaves it out");
        }
    }

    /// As [`unsupported`](Self::unsupported), of an element that takes more with it.
    pub fn unsupported_with(&mut self, element: &Element, what: &str, with: &str) {
        if self.lenient {
            self.lose(element, &format!("{what} not supported, left out {with}"));
        } else {
            self.error(element, format!("{what} not supported"), format!("a lenient load leaves it out {with}"));
        }
    }

    /// An option that asks for what is not built: a loss if lenient, otherwise a problem.
    pub fn unbuilt(&mut self, source: &Source, unbuilt: &Unbuilt) {
        let Unbuilt { element, what, remedy, instead, .. } = unbuilt;
        if self.lenient {
            self.lose_at(source, element, &format!("{what} not supported, {instead}"));
        } else {
            self.error_at(
                source,
                *element,
                format!("{what} not supported"),
                format!("{remedy}; a lenient load goes without"),
            );
        }
    }

    /// Adds a note.
    pub fn note(&mut self, what: impl Into<String>) {
        self.notes.push(what.into());
    }

    /// Adds a note on an element.
    pub fn note_on(&mut self, element: &Element, what: &str) {
        self.note_at(&element.source, &element.label(), what);
    }

    /// Adds a note at a place.
    pub fn note_at(&mut self, source: &Source, element: &str, what: &str) {
        self.note(placed(source, element, what));
    }

    /// Adds a loss.
    pub fn lose(&mut self, element: &Element, what: &str) {
        self.lose_at(&element.source, &element.label(), what);
    }

    fn lose_at(&mut self, source: &Source, element: &str, what: &str) {
        self.losses.push(placed(source, element, what));
    }

    /// A pair that refers to a geom that was left out.
    pub fn lose_with(&mut self, source: &Source, what: &str, left_out: &str) {
        if self.lenient || self.failed() {
            self.lose_at(source, what, &format!("{left_out} was left out, and so is this {what}"));
        } else {
            let message = format!("{left_out} is not supported");
            self.error_at(source, what, message, format!("a lenient load leaves the {what} out"));
        }
    }

    /// Hands losses and notes to the model, or returns all problems if there are any.
    pub fn into_result(mut self, spec: &mut Spec) -> Result<(), Diagnostics> {
        if self.unlisted > 0 {
            let message = format!("{} more problems are not listed", self.unlisted);
            self.problems.push(&Source::default(), "", message, "");
        }
        spec.losses = self.losses.finish();
        spec.notes = self.notes.finish();
        self.problems.into_result()
    }
}

/// A sentence on an element, with its place.
pub(super) fn placed(source: &Source, element: &str, what: &str) -> String {
    source.placed(&format!("{element}: {what}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// To read a folder for each of thousands of includes took seconds.
    #[test]
    fn remedies_are_sought_only_for_problems_that_are_listed() {
        let (mut report, mut sought) = (Report::new(false), 0);
        for _ in 0..3000 {
            let remedy = report.seek(|| {
                sought += 1;
                String::new()
            });
            report.error_at(&Source::default(), "include", "is missing", remedy);
        }
        assert_eq!(sought, Diagnostics::MOST);
    }
}
