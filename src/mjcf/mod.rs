//! MJCF, the text format of MuJoCo: text to [`Spec`].
//!
//! A load goes over the text in stages: `scan` bounds it, `tree` and `include` turn it into elements, `schema` checks
//! their names, then compiler settings and default classes are read, and with these the body tree, contacts, actuators
//! and keyframes. Every stage reports all that it finds, and nothing recurses over the document.
//!
//! What changes the physics but is not supported is a problem, or with [`LoadOptions::lenient`] a line in
//! [`Spec::losses`]. What the elements mean together - names, ranges, masses - is the compiler's business.

mod actuator;
mod body;
mod compiler;
mod contact;
mod custom;
mod defaults;
mod document;
mod geom;
mod include;
mod joint;
mod keyframe;
mod option;
mod orientation;
mod reader;
mod reference;
mod replicate;
mod report;
mod scan;
mod schema;
#[cfg(test)]
mod tests;
mod tree;
mod value;

use std::collections::{BTreeMap, HashSet};
use std::path::Path;
use std::sync::Arc;

use crate::diagnostics::Diagnostics;
use crate::spec::{Actuator, Exclude, Pair, Spec, Transmission};
use actuator::Tag;
use body::Builder;
use defaults::{Classes, MAIN};
pub use document::{Document, Include};
use include::Files;
use reader::Reader;
use reference::{Entry, References};
use report::Report;
use tree::Tree;

/// How to load a model.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LoadOptions {
    /// Leave out what is not supported, with a line in [`Spec::losses`] each, instead of rejecting the model.
    pub lenient: bool,
    /// Options that replace the file's: names and values of the attributes of MJCF's `option`, or of `flag` with the
    /// value `enable` or `disable`.
    pub overrides: Vec<(String, String)>,
}

/// Loads a model from a file. Files that it includes are found relative to it.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Spec, Diagnostics> {
    Document::load(path, options).map(|(_, spec)| spec)
}

/// Parses a model from text that includes no other file.
pub fn parse(text: &str, options: &LoadOptions) -> Result<Spec, Diagnostics> {
    parse_with_files(text, &BTreeMap::new(), options)
}

/// Parses a model from text; the files that it includes are given as texts by name.
pub fn parse_with_files(
    text: &str,
    files: &BTreeMap<String, String>,
    options: &LoadOptions,
) -> Result<Spec, Diagnostics> {
    read(text, None, &Files::Memory(files), options, None)
}

/// Replaces options of a spec, as [`LoadOptions::overrides`] does while loading.
pub fn override_options(spec: &mut Spec, overrides: &[(String, String)]) -> Result<(), Diagnostics> {
    option::apply(overrides, &mut spec.option)
}

fn read(
    text: &str,
    file: Option<&Arc<str>>,
    files: &Files,
    options: &LoadOptions,
    record: Option<&mut Vec<Include>>,
) -> Result<Spec, Diagnostics> {
    let mut report = Report::new(options.lenient);
    let tree = include::read(text, file, files, &mut report, record)?;
    schema::check(&tree, &mut report);
    let mut spec = Spec::new(tree[0].get("model").unwrap_or_default());
    let angles = compiler::read(&tree, &mut spec.compiler, &mut report);
    option::read(&tree, &mut spec.option, &mut report);
    custom::check(&tree, &mut report);
    unsupported_sections(&tree, &mut report);

    let classes = Classes::read(&tree, &mut report);
    let (pairs, excludes) = contacts(&tree, &classes, &mut report);
    let actuators = actuators(&tree, &classes, &mut report);
    let lost_coordinates = tree.sections("deformable").next().is_some();
    let mut builder = Builder {
        tree: &tree,
        classes: &classes,
        angles: &angles,
        report: &mut report,
        bodies: std::mem::take(&mut spec.bodies),
        pairs: References::new(pairs),
        excludes: References::new(excludes),
        actuators: References::new(actuators),
        lost_geoms: HashSet::new(),
        lost_coordinates,
        cameras: 0,
        lights: 0,
        elements: 0,
    };
    builder.build();
    finish(builder, &mut spec);

    report.into_result(&mut spec)?;
    option::apply(&options.overrides, &mut spec.option)?;
    Ok(spec)
}

/// Takes over what was built, and reads the keyframes.
fn finish(builder: Builder, spec: &mut Spec) {
    let Builder { tree, report, bodies, pairs, excludes, actuators, lost_geoms, .. } = builder;
    spec.bodies = bodies;
    spec.excludes = excludes.into_items().collect();
    for pair in pairs.into_items() {
        let lost = [&pair.geom1, &pair.geom2].into_iter().find(|&name| lost_geoms.contains(name)).cloned();
        match lost {
            Some(name) => report.lose_pair(&pair, &name),
            None => spec.pairs.push(pair),
        }
    }
    let mut kept = Vec::new();
    for entry in actuators.into_items() {
        kept.push(entry.kept);
        if entry.kept {
            spec.actuators.push(entry.actuator);
        }
    }
    spec.keys = keyframe::read(tree, &kept, builder.lost_coordinates, report);
    if builder.cameras + builder.lights > 0 {
        report.notes.push(format!("{} cameras and {} lights have no effect", builder.cameras, builder.lights));
    }
}

/// Sections of which nothing is supported.
fn unsupported_sections(tree: &Tree, report: &mut Report) {
    const SECTIONS: [(&str, &str); 5] = [
        ("tendon", "tendons are"),
        ("equality", "equality constraints are"),
        ("sensor", "sensors are"),
        ("extension", "plugins are"),
        ("deformable", "deformable bodies are"),
    ];
    for (section, what) in SECTIONS {
        for index in tree.section(section) {
            report.unsupported(&tree[index], what);
        }
    }
    for index in tree.section("asset") {
        let what = match tree[index].tag.as_str() {
            "mesh" => "meshes are",
            "hfield" => "height fields are",
            "model" => "attached models are",
            _ => continue,
        };
        report.unsupported(&tree[index], what);
    }
}

fn contacts(tree: &Tree, classes: &Classes, report: &mut Report) -> (Vec<Pair>, Vec<Exclude>) {
    let (mut pairs, mut excludes) = (Vec::new(), Vec::new());
    for index in tree.section("contact") {
        let element = &tree[index];
        match element.tag.as_str() {
            "pair" => {
                let class = classes.named(element, "class", MAIN, report);
                pairs.extend(contact::pair(&mut Reader::new(element, report), &classes[class].pair));
            }
            "exclude" => excludes.extend(contact::exclude(&mut Reader::new(element, report))),
            _ => {}
        }
    }
    (pairs, excludes)
}

fn actuators(tree: &Tree, classes: &Classes, report: &mut Report) -> Vec<Entry> {
    let mut entries = Vec::new();
    for index in tree.section("actuator") {
        let element = &tree[index];
        let Some(tag) = Tag::of(&element.tag) else { continue };
        let class = classes.named(element, "class", MAIN, report);
        let mut reader = Reader::new(element, report);
        let actuator = classes.actuator(class, tag, &mut reader).finish(tag, &mut reader);
        let kept = actuator.is_some();
        let joint = || Transmission::Joint(element.get("joint").unwrap_or_default().to_string());
        let actuator = actuator.unwrap_or_else(|| Actuator { transmission: joint(), ..Actuator::default() });
        entries.push(Entry { actuator, kept });
    }
    entries
}
