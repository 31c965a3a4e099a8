//! The elements of a model's files in one flat arena, with the place of each; includes are already spliced in.

use std::sync::Arc;

use super::scan::scan;
use crate::diagnostics::{Diagnostics, file_problem, quoted};
use crate::spec::Source;

/// Most elements and texts of one file.
const MOST_NODES: u32 = 2_000_000;

/// An XML element.
#[derive(Clone, Debug)]
pub(super) struct Element {
    pub tag: String,
    pub attributes: Vec<(String, String)>,
    /// Indices into the tree.
    pub children: Vec<usize>,
    pub source: Source,
}

impl Element {
    /// The value of an attribute.
    pub fn get(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(n, _)| n == name).map(|(_, value)| value.as_str())
    }

    /// Tag and name, for messages.
    pub fn label(&self) -> String {
        match self.get("name") {
            Some(name) if !name.is_empty() => format!("{} {}", crate::diagnostics::shorten(&self.tag), quoted(name)),
            _ => crate::diagnostics::shorten(&self.tag),
        }
    }
}

/// All elements; the root is the first.
#[derive(Clone, Debug, Default)]
pub(super) struct Tree {
    pub elements: Vec<Element>,
}

impl std::ops::Index<usize> for Tree {
    type Output = Element;
    fn index(&self, index: usize) -> &Element {
        &self.elements[index]
    }
}

impl Tree {
    /// Parses one file and appends its elements; returns the index of its root.
    pub fn append(&mut self, text: &str, file: Option<&Arc<str>>) -> Result<usize, Diagnostics> {
        let source = |line| Source { file: file.cloned(), line };
        let text = text.trim_start_matches('\u{feff}').trim_end_matches('\0');
        if text.trim().is_empty() {
            return Err(file_problem(&source(0), "the file is empty", "an MJCF file starts with <mujoco>"));
        }
        let text = scan(text).map_err(|fault| file_problem(&source(fault.line), fault.message, fault.remedy))?;
        let options = roxmltree::ParsingOptions { allow_dtd: false, nodes_limit: MOST_NODES, ..Default::default() };
        let document = roxmltree::Document::parse_with_options(&text, options).map_err(|error| {
            let remedy = match error {
                roxmltree::Error::DtdDetected => "remove the document type declaration".to_string(),
                roxmltree::Error::NodesLimitReached => format!("write at most {MOST_NODES} elements and texts"),
                roxmltree::Error::DuplicatedAttribute(..) => "keep one of them".to_string(),
                roxmltree::Error::NonXmlChar(..) => "remove the character".to_string(),
                roxmltree::Error::UnexpectedCloseTag(..)
                | roxmltree::Error::NoRootNode
                | roxmltree::Error::UnclosedRootNode
                | roxmltree::Error::UnexpectedEndOfStream
                | roxmltree::Error::InvalidAttributeValue(..)
                | roxmltree::Error::InvalidName(..)
                | roxmltree::Error::InvalidChar(..)
                | roxmltree::Error::InvalidChar2(..)
                | roxmltree::Error::InvalidString(..)
                | roxmltree::Error::UnknownToken(..) => {
                    "every tag must be closed, every value be in quotes".to_string()
                }
                _ => String::new(),
            };
            file_problem(&source(error.pos().row), format!("not well-formed XML: {error}"), remedy)
        })?;
        Ok(self.copy(&document, &Lines::new(&text), file))
    }

    /// Copies the elements of a document, in document order.
    fn copy(&mut self, document: &roxmltree::Document, lines: &Lines, file: Option<&Arc<str>>) -> usize {
        let root = self.elements.len();
        let mut open: Vec<(roxmltree::NodeId, usize)> = Vec::new();
        for node in document.root_element().descendants().filter(roxmltree::Node::is_element) {
            let parent = node.parent_element().map(|p| p.id());
            while open.last().is_some_and(|&(id, _)| Some(id) != parent) {
                open.pop();
            }
            let index = self.elements.len();
            if let Some(&(_, parent)) = open.last() {
                self.elements[parent].children.push(index);
            }
            self.elements.push(Element {
                tag: node.tag_name().name().to_string(),
                attributes: node.attributes().map(|a| (a.name().to_string(), a.value().to_string())).collect(),
                children: Vec::new(),
                source: Source { file: file.cloned(), line: lines.line(node.range().start) },
            });
            open.push((node.id(), index));
        }
        root
    }

    /// The children of an element.
    pub fn children(&self, index: usize) -> impl DoubleEndedIterator<Item = &Element> {
        self.elements[index].children.iter().map(|&child| &self.elements[child])
    }

    /// The children of all sections of one name, in order.
    pub fn section<'a>(&'a self, tag: &'a str) -> impl Iterator<Item = usize> + 'a {
        self.sections(tag).flat_map(|section| self.elements[section].children.iter().copied())
    }

    /// All sections of one name, in order.
    pub fn sections<'a>(&'a self, tag: &'a str) -> impl Iterator<Item = usize> + 'a {
        self.elements[0].children.iter().copied().filter(move |&child| self.elements[child].tag == tag)
    }
}

/// Where the lines of a text start: the parser's own search for a line is linear.
struct Lines(Vec<usize>);

impl Lines {
    fn new(text: &str) -> Self {
        Lines(
            std::iter::once(0)
                .chain(text.bytes().enumerate().filter(|&(_, b)| b == b'\n').map(|(i, _)| i + 1))
                .collect(),
        )
    }

    fn line(&self, offset: usize) -> u32 {
        u32::try_from(self.0.partition_point(|&start| start <= offset)).unwrap_or(u32::MAX)
    }
}
