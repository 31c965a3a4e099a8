//! `asset/model` and `attach`: parts of other models, with all that is about them and about nothing else.

use std::collections::{HashMap, HashSet};
use std::path::PathBuf;
use std::sync::Arc;

use super::document::{Include, Record};
use super::include::{self, Files};
use super::option;
use super::reader::Reader;
use super::reference::{Entry, Names, Refers, Space, names};
use super::report::{Report, quoted};
use super::tree::{Element, Tree};
use crate::spec::{Actuator, Body, JointKind, Key, KeyPart, Spec};

/// Models within models within models: a chain of more is a mistake.
const DEEPEST: usize = 8;

/// Most elements that are copied for parts of a model that it attaches itself.
const MOST_COPIED: usize = 20_000_000;

/// Where a model stands that is read.
#[derive(Clone, Copy)]
pub(super) struct Context<'a, 'f> {
    pub files: &'a Files<'f>,
    pub lenient: bool,
    /// Folder of the model's own files, relative to that of the main file: empty, or with a slash at its end.
    pub folder: &'a str,
    /// The models that attach it, outermost first.
    pub around: &'a [PathBuf],
    /// What is wanted of it.
    pub cut: Option<Cut<'a>>,
}

/// A part of a model.
#[derive(Clone, Copy)]
pub(super) enum Cut<'a> {
    Body(&'a str),
    Frame(&'a str),
}

impl std::fmt::Display for Cut<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (kind, name) = match self {
            Cut::Body(name) => ("body", name),
            Cut::Frame(name) => ("frame", name),
        };
        write!(f, "{kind} {}", quoted(name))
    }
}

impl Cut<'_> {
    /// Leaves nothing of the body tree but this; `false` if there is no such element.
    pub fn apply(self, tree: &mut Tree) -> bool {
        let (tag, name) = match self {
            Cut::Body(name) => ("body", name),
            Cut::Frame(name) => ("frame", name),
        };
        let worlds: Vec<usize> = tree.sections("worldbody").chain(tree.sections("world")).collect();
        // Elements with the default class that is around them.
        let mut open: Vec<(usize, Option<String>)> = worlds.iter().rev().map(|&world| (world, None)).collect();
        while let Some((index, class)) = open.pop() {
            let element = &tree[index];
            if element.tag == tag && element.get("name") == Some(name) {
                if let (Some(class), None) = (class, element.get("childclass")) {
                    tree.elements[index].attributes.push(("childclass".into(), class));
                }
                for world in &worlds {
                    tree.elements[*world].children.clear();
                }
                tree.elements[worlds[0]].children.push(index);
                return true;
            }
            let class = element.get("childclass").map(str::to_string).or(class);
            open.extend(element.children.iter().rev().map(|&child| (child, class.clone())));
        }
        false
    }
}

/// A model that can be attached.
struct Asset {
    path: PathBuf,
    text: String,
    /// Folder of its own files.
    folder: String,
}

/// Reads what every `attach` brings, by the index of its element. Options of `spec` change where the model says `conflict="merge"`.
pub(super) fn parts(
    tree: &Tree,
    context: &Context,
    mut record: Option<&mut Record>,
    spec: &mut Spec,
    report: &mut Report,
) -> HashMap<usize, Spec> {
    let assets = assets(tree, context, record.as_deref_mut(), report);
    let policy = tree.sections("compiler").filter_map(|index| tree[index].get("conflict")).last();
    let mut parts = HashMap::new();
    for index in (0..tree.elements.len()).filter(|&index| tree[index].tag == "attach") {
        let element = &tree[index];
        let reader = Reader::new(element, report);
        let (name, prefix) = (reader.text("model"), reader.text("prefix"));
        if element.get("prefix").is_none() {
            report.error(element, "attribute \"prefix\" is missing", "give each part a prefix of its own");
            continue;
        }
        if name.is_empty() {
            if let Some(mut part) = own_part(tree, index, context, record.as_deref_mut(), report) {
                prefixed(&mut part, &prefix);
                parts.insert(index, part);
            }
            continue;
        }
        let Some(asset) = assets.get(&name) else {
            let remedy = report.propose(&name, assets.keys().map(String::as_str));
            report.error(element, format!("no asset is a model {}", quoted(&name)), remedy);
            continue;
        };
        if let Some(mut part) = part(element, asset, context, record.as_deref_mut(), report) {
            option::merge(&mut spec.option, &part.option, policy, element, report);
            if part.compiler != spec.compiler {
                report.note_on(element, "compiler settings of the attached model give way to those of this one");
            }
            prefixed(&mut part, &prefix);
            parts.insert(index, part);
        }
    }
    parts
}

/// The models among the assets, by name.
fn assets(
    tree: &Tree,
    context: &Context,
    mut record: Option<&mut Record>,
    report: &mut Report,
) -> HashMap<String, Asset> {
    let mut assets = HashMap::new();
    for index in tree.section("asset").filter(|&index| tree[index].tag == "model") {
        let element = &tree[index];
        let Some(file) = element.get("file").filter(|file| !file.is_empty()) else {
            report.error(element, "attribute \"file\" is missing", "");
            continue;
        };
        if element.get("content_type").is_some_and(|kind| !matches!(kind, "" | "text/xml")) {
            report.unsupported(element, "attached models in other formats than MJCF are");
            continue;
        }
        let by = element.source.file.as_deref();
        let (path, text) = include::fetch(context.files, &format!("{}{file}", context.folder), by, report);
        let text = match text {
            Ok(text) => text,
            Err((message, remedy)) => {
                report.error(element, message, remedy);
                continue;
            }
        };
        if let Some(record) = &mut record {
            let name = format!("{}{file}", context.folder);
            let path = path.display().to_string();
            record.includes.push(Include { by: by.map(str::to_string), name, path, text: text.clone() });
        }
        let mut own = Tree::default();
        let file_name: Arc<str> = path.display().to_string().into();
        if let Err(problems) = own.append(&text, Some(&file_name)) {
            report.absorb(problems);
            continue;
        }
        let written = file.replace('\\', "/");
        let folder = written.rsplit_once('/').map_or(String::new(), |(folder, _)| format!("{folder}/"));
        let name = element.get("name").or(own[0].get("model")).unwrap_or("MuJoCo Model").to_string();
        assets.insert(name, Asset { path, text, folder: format!("{}{folder}", context.folder) });
    }
    assets
}

/// Reads the part of a model that an element attaches, and drops what is about other things; `None` if it cannot be had, which is
/// reported.
fn part(
    element: &Element,
    asset: &Asset,
    context: &Context,
    mut record: Option<&mut Record>,
    report: &mut Report,
) -> Option<Spec> {
    let cut = cut(element, report)?;
    if context.around.contains(&asset.path) || context.around.len() == DEEPEST {
        report.error(
            element,
            "the model attaches itself, or models within models go too deep",
            "attach a part that attaches nothing",
        );
        return None;
    }
    let around = [context.around, std::slice::from_ref(&asset.path)].concat();
    let file: Arc<str> = asset.path.display().to_string().into();
    let mut read = |cut| {
        let inner = Context { folder: &asset.folder, around: &around, cut, ..*context };
        super::read_model(&asset.text, Some(&file), &inner, &[], record.as_deref_mut())
    };
    let whole = read(None).map_err(|problems| report.absorb(problems)).ok()?;
    let Some(cut) = cut else { return Some(with_key_parts(whole, None)) };
    let Ok(part) = read(Some(cut)) else {
        report.error(element, format!("the model has no {cut}"), "");
        return None;
    };
    Some(with_key_parts(pruned(part), Some(&whole)))
}

/// What is attached of a model, `None` within: all of it. `None` if both are given, which is reported.
fn cut<'a>(element: &'a Element, report: &mut Report) -> Option<Option<Cut<'a>>> {
    Some(match (element.get("body"), element.get("frame")) {
        (Some(_), Some(_)) => {
            report.error(element, "both body and frame are given", "keep one");
            return None;
        }
        (Some(body), None) => Some(Cut::Body(body)),
        (None, Some(frame)) => Some(Cut::Frame(frame)),
        (None, None) => None,
    })
}

/// A part of the model itself, without the parts of itself that this attaches; `None` if it cannot be had, which is reported.
fn own_part(
    tree: &Tree,
    index: usize,
    context: &Context,
    record: Option<&mut Record>,
    report: &mut Report,
) -> Option<Spec> {
    let element = &tree[index];
    let Some(cut) = cut(element, report)? else {
        report.error(element, "nothing to attach", "give body or frame, or a model");
        return None;
    };
    // Each is read from a copy of the model.
    let copies = tree.elements.iter().filter(|element| element.tag == "attach").count();
    if copies.saturating_mul(tree.elements.len()) > MOST_COPIED {
        report.error(
            element,
            "a large model attaches too many parts of itself",
            "use replicate, or models of their own",
        );
        return None;
    }
    let mut own = tree.clone();
    for element in own.elements.iter_mut().filter(|element| element.tag == "attach" && element.get("model").is_none()) {
        element.tag = "frame".into();
        element.attributes.clear();
    }
    let inner = Context { cut: Some(cut), ..*context };
    if !cut.apply(&mut own.clone()) {
        report.error(element, format!("the model has no {cut}"), "name a part that is not attached itself");
        return None;
    }
    match super::read_tree(own, Report::new(context.lenient), &inner, &[], record) {
        Ok(mut part) => {
            // What is said of the whole model is said once.
            (part.keys, part.notes) = (Vec::new(), Vec::new());
            Some(pruned(part))
        }
        Err(problems) => {
            report.absorb(problems);
            None
        }
    }
}

/// Without what names something that is not there.
fn pruned(mut spec: Spec) -> Spec {
    let bodies = spec.bodies.clone();
    let mut known: Names = names(&bodies[1..], &bodies[0]);
    known[Space::Body as usize].insert("world");
    fn keep<T: Refers>(list: &mut Vec<T>, known: &Names) {
        list.retain_mut(|item| {
            let missing = |(space, name): &(Space, &mut String)| {
                !name.is_empty() && !known[*space as usize].contains(name.as_str())
            };
            !item.targets().iter().any(missing)
        });
    }
    keep(&mut spec.pairs, &known);
    keep(&mut spec.excludes, &known);
    keep(&mut spec.tendons, &known);
    let tendons: Vec<String> = spec.tendons.iter().map(|tendon| tendon.name.clone()).collect();
    known[Space::Tendon as usize] = tendons.iter().map(String::as_str).collect();
    keep(&mut spec.equalities, &known);
    let mut entries: Vec<Entry> = spec.actuators.drain(..).map(|actuator| Entry { actuator, kept: true }).collect();
    keep(&mut entries, &known);
    spec.actuators = entries.into_iter().map(|entry| entry.actuator).collect();
    let actuators: Vec<String> = spec.actuators.iter().map(|actuator| actuator.name.clone()).collect();
    known[Space::Actuator as usize] = actuators.iter().map(String::as_str).collect();
    keep(&mut spec.sensors, &known);
    spec
}

/// The same with a prefix on every name.
fn prefixed(spec: &mut Spec, prefix: &str) {
    let add = |name: &mut String| {
        if !name.is_empty() {
            name.insert_str(0, prefix);
        }
    };
    fn all<T: Refers>(list: &mut [T], add: &impl Fn(&mut String)) {
        for item in list {
            add(item.name());
            for (space, name) in item.targets() {
                if space as usize != Space::Body as usize || name != "world" {
                    add(name);
                }
            }
        }
    }
    for body in spec.bodies.iter_mut().skip(1) {
        add(&mut body.name);
    }
    for body in &mut spec.bodies {
        body.joints.iter_mut().for_each(|joint| add(&mut joint.name));
        body.sites.iter_mut().for_each(|site| add(&mut site.name));
        body.cameras.iter_mut().for_each(|camera| add(&mut camera.name));
        for geom in &mut body.geoms {
            add(&mut geom.name);
            add(&mut geom.mesh);
            add(&mut geom.hfield);
        }
    }
    spec.meshes.iter_mut().for_each(|mesh| add(&mut mesh.name));
    spec.hfields.iter_mut().for_each(|field| add(&mut field.name));
    all(&mut spec.pairs, &add);
    all(&mut spec.excludes, &add);
    all(&mut spec.tendons, &add);
    all(&mut spec.equalities, &add);
    let mut entries: Vec<Entry> = spec.actuators.drain(..).map(|actuator| Entry { actuator, kept: true }).collect();
    all(&mut entries, &add);
    spec.actuators = entries.into_iter().map(|entry| entry.actuator).collect();
    all(&mut spec.sensors, &add);
    for key in &mut spec.keys {
        add(&mut key.name);
        key.controls.iter_mut().for_each(|(name, _)| add(name));
    }
}

/// Numbers of positions and velocities of a joint.
fn coordinates(kind: JointKind) -> (usize, usize) {
    match kind {
        JointKind::Free => (7, 6),
        JointKind::Ball => (4, 3),
        JointKind::Slide | JointKind::Hinge => (1, 1),
    }
}

/// Bodies depth first, which is the order of coordinates.
fn depth_first(bodies: &[Body]) -> Vec<usize> {
    let mut children: Vec<Vec<usize>> = vec![Vec::new(); bodies.len()];
    for (i, body) in bodies.iter().enumerate().skip(1) {
        children[body.parent].push(i);
    }
    let (mut order, mut open) = (Vec::new(), vec![0]);
    while let Some(body) = open.pop() {
        order.push(body);
        open.extend(children[body].iter().rev());
    }
    order
}

/// With keyframes that say what they do body by body. Those of a part are written for the whole, in which the bodies of the part
/// follow each other as they do in the part.
fn with_key_parts(mut spec: Spec, whole: Option<&Spec>) -> Spec {
    let source = whole.unwrap_or(&spec);
    let (order, own) = (depth_first(&source.bodies), depth_first(&spec.bodies));
    let place = |body: &Body| {
        order.iter().skip(1).position(|&b| source.bodies[b].name == body.name && source.bodies[b].source == body.source)
    };
    let first = own.get(1).and_then(|&body| place(&spec.bodies[body])).unwrap_or(0);
    // Where coordinates of each body of the whole start, the world left out.
    let (mut starts, mut at) = (Vec::new(), (0, 0));
    for &body in &order[1..] {
        starts.push(at);
        for joint in &source.bodies[body].joints {
            let (nq, nv) = coordinates(joint.kind);
            at = (at.0 + nq, at.1 + nv);
        }
    }
    let named: HashSet<&str> = spec.actuators.iter().map(|actuator| actuator.name.as_str()).collect();
    let keys: Vec<Key> = source
        .keys
        .iter()
        .map(|key| {
            let slice = |list: &Option<Vec<f64>>, start: usize, len: usize| -> Vec<f64> {
                list.as_deref().and_then(|list| list.get(start..start + len)).unwrap_or_default().to_vec()
            };
            let part = |(k, &body): (usize, &usize)| {
                let joints = &spec.bodies[body].joints;
                let (nq, nv) =
                    joints.iter().map(|joint| coordinates(joint.kind)).fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
                let (q, v) = *starts.get(first + k)?;
                let part = KeyPart { body, qpos: slice(&key.qpos, q, nq), qvel: slice(&key.qvel, v, nv) };
                (!joints.is_empty()).then_some(part)
            };
            let mut given = key.ctrl.iter().flatten().copied();
            let control = |actuator: &Actuator| {
                let own: Vec<f64> = given.by_ref().take(actuator.controls()).collect();
                let here = !own.is_empty() && named.contains(actuator.name.as_str());
                here.then(|| (actuator.name.clone(), own))
            };
            Key {
                name: key.name.clone(),
                time: key.time,
                parts: own.iter().skip(1).enumerate().filter_map(part).collect(),
                controls: source.actuators.iter().filter_map(control).collect(),
                source: key.source.clone(),
                ..Key::default()
            }
        })
        .collect();
    spec.keys = keys;
    spec
}
