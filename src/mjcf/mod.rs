//! MJCF, the text format of MuJoCo: text to [`Spec`].
//!
//! A load goes over the text in stages: `scan` bounds it, `tree` and `include` turn it into elements, `schema` checks
//! their names, then compiler settings and default classes are read, and with these the body tree, contacts, actuators
//! and keyframes. Every stage reports all that it finds, and nothing recurses over the document.
//!
//! What changes the physics but is not supported is a problem, or with [`LoadOptions::lenient`] a line in
//! [`Spec::losses`]. What the elements mean together - names, ranges, masses - is the compiler's business.

mod actuator;
mod asset;
mod attach;
mod body;
mod camera;
mod compiler;
mod contact;
mod custom;
mod defaults;
mod document;
mod equality;
mod geom;
mod heights;
mod history;
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
mod sensor;
mod tendon;
#[cfg(test)]
mod tests;
mod tree;
mod unbuilt;
mod value;

use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::diagnostics::Diagnostics;
use crate::spec::{
    Actuator, Body, Equality, Exclude, HeightField, Key, Mesh, Object, ObjectKind, Pair, Sensor, Spec, Tendon,
    Transmission,
};
use actuator::Tag;
use attach::Context;
use body::Builder;
use defaults::{Classes, MAIN};
use document::Record;
pub use document::{Asset, Document, Include};
use include::{Assets, Files};
use reader::Reader;
use reference::{Entry, References};
use report::{Report, quoted};
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

/// Parses a model from text; the files that it reads, included ones and those of meshes, are given by name.
pub fn parse_with_files(
    text: &str,
    files: &BTreeMap<String, Vec<u8>>,
    options: &LoadOptions,
) -> Result<Spec, Diagnostics> {
    read(text, None, &Files::Memory(files), options, None)
}

/// Replaces options of a spec, as [`LoadOptions::overrides`] does while loading.
pub fn override_options(spec: &mut Spec, overrides: &[(String, String)]) -> Result<(), Diagnostics> {
    option::apply(overrides, spec)
}

/// Overrides that say the same as `earlier` ones followed by `later` ones, each option once: of one given anew, what was
/// said earlier is gone.
pub fn replace_overrides(earlier: &[(String, String)], later: &[(String, String)]) -> Vec<(String, String)> {
    option::replaced(earlier, later)
}

fn read(
    text: &str,
    file: Option<&Arc<str>>,
    files: &Files,
    options: &LoadOptions,
    record: Option<&mut Record>,
) -> Result<Spec, Diagnostics> {
    let main = file.map(|file| PathBuf::from(file.as_ref()));
    let context = Context { files, lenient: options.lenient, folder: "", around: main.as_slice(), cut: None };
    read_model(text, file, &context, &options.overrides, record)
}

/// Reads a model, or a part of one.
fn read_model(
    text: &str,
    file: Option<&Arc<str>>,
    context: &Context,
    overrides: &[(String, String)],
    mut record: Option<&mut Record>,
) -> Result<Spec, Diagnostics> {
    let mut report = Report::new(context.lenient);
    let tree = include::read(text, file, context.files, &mut report, record.as_deref_mut())?;
    schema::check(&tree, &mut report);
    read_tree(tree, report, context, overrides, record)
}

/// Makes what was read into a model.
fn read_tree(
    mut tree: Tree,
    mut report: Report,
    context: &Context,
    overrides: &[(String, String)],
    mut record: Option<&mut Record>,
) -> Result<Spec, Diagnostics> {
    if context.cut.is_some_and(|cut| !cut.apply(&mut tree)) {
        return Err(report::file_problem(&tree[0].source, "there is no such part", ""));
    }
    let mut spec = Spec::new(tree[0].get("model").unwrap_or_default());
    spec.bodies[0].source = tree[0].source.clone();
    let angles = compiler::read(&tree, &mut spec, &mut report);
    option::read(&tree, &mut spec, &mut report);
    let parts = attach::parts(&tree, context, record.as_deref_mut(), &mut spec, &mut report);
    let overridden = option::apply(overrides, &mut spec);
    option::reset_unbuilt(&mut spec, &mut report);
    option::note_iterations(&spec, &mut report);
    custom::check(&tree, &mut report);
    unbuilt::sections(&tree, &mut report);

    let classes = Classes::read(&tree, &mut report);
    let (pairs, excludes) = contacts(&tree, &classes, &mut report);
    let tendons = tendons(&tree, &classes, &mut report);
    let equalities = equalities(&tree, &classes, &mut report);
    let actuators = actuators(&tree, &classes, &mut report);
    let sensors = sensor::all(&tree, &mut report);
    let lost_coordinates = tree.section("deformable").any(|index| tree[index].tag != "skin");
    let mut builder = Builder {
        tree: &tree,
        classes: &classes,
        angles: &angles,
        report: &mut report,
        bodies: std::mem::take(&mut spec.bodies),
        pairs: References::new(pairs),
        excludes: References::new(excludes),
        tendons: References::new(tendons),
        equalities: References::new(equalities),
        actuators: References::new(actuators),
        sensors: References::new(sensors),
        compiler: &spec.compiler,
        parts,
        meshes: Vec::new(),
        hfields: Vec::new(),
        keys: Vec::new(),
        decorations: BTreeMap::new(),
        lost_geoms: Vec::new(),
        lost_coordinates,
        lights: 0,
        elements: 0,
    };
    builder.build();
    let built = Built::of(builder);
    built.finish(&tree, &mut spec, &mut report);
    let mut assets = Assets::new(&tree, context.files, context.folder, record);
    asset::meshes(&tree, &classes, &mut assets, &mut spec, &mut report);
    heights::fields(&tree, &mut assets, &mut spec, &mut report);

    report.into_result(&mut spec)?;
    overridden?;
    Ok(spec)
}

/// What the body tree has become, and what refers to it.
struct Built {
    bodies: Vec<Body>,
    pairs: Vec<Pair>,
    excludes: Vec<Exclude>,
    tendons: Vec<Tendon>,
    equalities: Vec<Equality>,
    actuators: Vec<Entry>,
    sensors: Vec<Sensor>,
    meshes: Vec<Mesh>,
    hfields: Vec<HeightField>,
    keys: Vec<Key>,
    lost_geoms: HashSet<String>,
    lost_coordinates: bool,
    notes: Vec<String>,
}

impl Built {
    fn of(builder: Builder) -> Built {
        let mut notes: Vec<String> = Vec::new();
        for (what, (count, first)) in builder.decorations {
            let (geoms, are) = if count == 1 { ("geom", "is") } else { ("geoms", "are") };
            notes.push(format!(
                "{count} {geoms} on which no motion depends {are} left out, as {what} not built: {first}"
            ));
        }
        let sensors: Vec<Sensor> = builder.sensors.into_items().collect();
        let seen = |name: &str| {
            let objects = sensors.iter().flat_map(|sensor| sensor.object.iter().chain(&sensor.reference));
            objects.filter(|object| object.kind == ObjectKind::Camera).any(|object| object.name == name)
        };
        let cameras = builder.bodies.iter().flat_map(|body| &body.cameras).filter(|camera| !seen(&camera.name)).count();
        if cameras + builder.lights > 0 {
            notes.push(format!("{cameras} cameras and {} lights have no effect", builder.lights));
        }
        Built {
            bodies: builder.bodies,
            pairs: builder.pairs.into_items().collect(),
            excludes: builder.excludes.into_items().collect(),
            tendons: builder.tendons.into_items().collect(),
            equalities: builder.equalities.into_items().collect(),
            actuators: builder.actuators.into_items().collect(),
            sensors,
            meshes: builder.meshes,
            hfields: builder.hfields,
            keys: builder.keys,
            lost_geoms: builder.lost_geoms.into_iter().collect(),
            lost_coordinates: builder.lost_coordinates,
            notes,
        }
    }

    /// Hands over what was built, and reads the keyframes.
    fn finish(self, tree: &Tree, spec: &mut Spec, report: &mut Report) {
        (spec.bodies, spec.excludes) = (self.bodies, self.excludes);
        (spec.tendons, spec.equalities) = (self.tendons, self.equalities);
        for pair in self.pairs {
            let lost = [&pair.geom1, &pair.geom2].into_iter().find(|&name| self.lost_geoms.contains(name)).cloned();
            match lost {
                Some(name) => report.lose_with(&pair.source, "pair", &format!("geom {}", quoted(&name))),
                None => spec.pairs.push(pair),
            }
        }
        let (mut kept, mut lost) = (Vec::new(), self.lost_geoms);
        for entry in self.actuators {
            // One for each control.
            kept.extend(std::iter::repeat_n(entry.kept, entry.actuator.controls()));
            if entry.kept {
                spec.actuators.push(entry.actuator);
            } else {
                lost.insert(entry.actuator.name);
            }
        }
        for sensor in self.sensors {
            let of = |object: &&Object| matches!(object.kind, ObjectKind::Geom | ObjectKind::Actuator);
            let mut objects = sensor.object.iter().chain(&sensor.reference).filter(of);
            match objects.find(|object| !object.name.is_empty() && lost.contains(&object.name)) {
                Some(object) => {
                    let what = if object.kind == ObjectKind::Geom { "geom" } else { "actuator" };
                    let left_out = format!("{what} {}", quoted(&object.name));
                    report.lose_with(&sensor.source, sensor.kind.tag(), &left_out);
                }
                None => spec.sensors.push(sensor),
            }
        }
        spec.keys = keyframe::read(tree, &kept, self.lost_coordinates, report);
        spec.keys.extend(self.keys);
        spec.meshes = self.meshes;
        spec.hfields = self.hfields;
        self.notes.into_iter().for_each(|note| report.note(note));
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

/// Reads the sections.
fn tendons(tree: &Tree, classes: &Classes, report: &mut Report) -> Vec<Tendon> {
    let mut tendons = Vec::new();
    for index in tree.section("tendon") {
        let element = &tree[index];
        let path = match element.tag.as_str() {
            "fixed" => tendon::joints(tree, index, report),
            "spatial" => tendon::waypoints(tree, index, report),
            _ => continue,
        };
        let class = classes.named(element, "class", MAIN, report);
        let mut reader = Reader::new(element, report);
        let mut tendon = classes[class].tendon.clone();
        tendon::read(&mut reader, &mut tendon);
        (tendon.name, tendon.source) = (reader.text("name"), element.source.clone());
        tendons.push(Tendon { path, ..tendon });
    }
    tendons
}

/// Reads the sections.
fn equalities(tree: &Tree, classes: &Classes, report: &mut Report) -> Vec<Equality> {
    let mut equalities = Vec::new();
    for index in tree.section("equality").filter(|&index| equality::built(&tree[index])) {
        let element = &tree[index];
        let class = classes.named(element, "class", MAIN, report);
        let mut reader = Reader::new(element, report);
        let mut equality = classes[class].equality.clone();
        equality::read(&mut reader, &mut equality);
        equality.name = reader.text("name");
        equality.source = element.source.clone();
        if let Some(held) = equality::held(&mut reader) {
            equalities.push(Equality { held, ..equality });
        }
    }
    equalities
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
        let name = element.get("name").unwrap_or_default().to_string();
        let actuator = actuator.unwrap_or_else(|| Actuator { name, transmission: joint(), ..Actuator::default() });
        entries.push(Entry { actuator, kept });
    }
    entries
}
