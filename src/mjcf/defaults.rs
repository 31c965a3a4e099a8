//! Default classes: for each, the record from which an element of each kind starts.

use std::collections::BTreeMap;

use super::actuator::{RawActuator, Tag};
use super::asset::RawMesh;
use super::camera::RawCamera;
use super::contact;
use super::equality;
use super::geom::{RawGeom, RawSite};
use super::joint;
use super::reader::Reader;
use super::report::{Report, quoted};
use super::tendon;
use super::tree::{Element, Tree};
use crate::spec::{Equality, Joint, Pair, Tendon};

/// Most classes of a model.
const MOST_CLASSES: usize = 10_000;
/// The class at the root.
pub(super) const MAIN: usize = 0;

/// The values of one class, inherited ones included.
#[derive(Clone, Debug, Default)]
pub(super) struct Class {
    parent: usize,
    pub joint: Joint,
    pub geom: RawGeom,
    pub site: RawSite,
    pub camera: RawCamera,
    pub mesh: RawMesh,
    pub pair: Pair,
    pub equality: Equality,
    pub tendon: Tendon,
    actuator: RawActuator,
    /// By tag, the nearest class whose actuator record was written by that tag or by `general`.
    donors: [Option<usize>; Tag::COUNT],
}

/// All classes.
#[derive(Debug)]
pub(super) struct Classes {
    classes: Vec<Class>,
    names: BTreeMap<String, usize>,
}

impl std::ops::Index<usize> for Classes {
    type Output = Class;
    fn index(&self, class: usize) -> &Class {
        &self.classes[class]
    }
}

impl Classes {
    /// Reads all `default` sections. A class starts from what its parent's own elements made of it, wherever they stand.
    pub fn read(tree: &Tree, report: &mut Report) -> Self {
        let mut classes =
            Classes { classes: vec![Class::default()], names: BTreeMap::from([("main".to_string(), MAIN)]) };
        for section in tree.sections("default") {
            let element = &tree[section];
            if element.get("class").is_some_and(|name| name != "main") {
                report.error(element, "the class at the top must be called main", "nest the class in a default");
            }
            let mut open = vec![(section, None)];
            while let Some((index, parent)) = open.pop() {
                if classes.classes.len() > MOST_CLASSES {
                    report.error(&tree[index], format!("the model has more than {MOST_CLASSES} default classes"), "");
                    return classes;
                }
                let class = parent.map_or(MAIN, |parent| classes.add(&tree[index], parent, report));
                classes.read_class(tree, index, class, report);
                let nested = tree[index].children.iter().rev().filter(|&&child| tree[child].tag == "default");
                open.extend(nested.map(|&child| (child, Some(class))));
            }
        }
        classes
    }

    fn add(&mut self, element: &Element, parent: usize, report: &mut Report) -> usize {
        let name = element.get("class").unwrap_or_default();
        if name.is_empty() {
            report.error(element, "a nested default needs a class", "");
        } else if self.names.contains_key(name) {
            report.error(element, format!("class {} is defined twice", quoted(name)), "");
        }
        let class = self.classes.len();
        self.classes.push(Class { parent, ..self.classes[parent].clone() });
        self.names.entry(name.to_string()).or_insert(class);
        class
    }

    fn read_class(&mut self, tree: &Tree, index: usize, class: usize, report: &mut Report) {
        for element in tree.children(index) {
            let mut reader = Reader::new(element, report);
            let values = &mut self.classes[class];
            match element.tag.as_str() {
                "joint" => joint::read(&mut reader, &mut values.joint),
                "geom" => values.geom.read(&mut reader),
                "site" => values.site.read(&mut reader),
                "camera" => values.camera.read(&mut reader),
                "mesh" => values.mesh.read(&mut reader),
                "pair" => contact::read(&mut reader, &mut values.pair),
                "equality" => equality::read(&mut reader, &mut values.equality),
                "tendon" => tendon::read(&mut reader, &mut values.tendon),
                tag => {
                    if let Some(tag) = Tag::of(tag) {
                        let actuator = self.actuator(class, tag, &mut reader);
                        self.classes[class].actuator = actuator;
                        self.classes[class].donors = self.donors(class, tag);
                    }
                }
            }
        }
    }

    /// An actuator of a class, with the attributes of an element.
    pub fn actuator(&self, class: usize, tag: Tag, reader: &mut Reader) -> RawActuator {
        let donor = self.classes[class].donors[tag as usize];
        let mut actuator = self.classes[class].actuator.clone();
        actuator.read(tag, donor.map(|at| &self.classes[at].actuator), reader);
        actuator
    }

    /// The donors of a class whose actuator record a tag has just written: whoever wrote it before no longer counts.
    fn donors(&self, class: usize, tag: Tag) -> [Option<usize>; Tag::COUNT] {
        if tag == Tag::General {
            return [Some(class); Tag::COUNT];
        }
        let inherited =
            if class == MAIN { [None; Tag::COUNT] } else { self.classes[self.classes[class].parent].donors };
        let mut donors = inherited;
        donors[tag as usize] = Some(class);
        donors
    }

    /// The class that an element names by an attribute, or `otherwise`; an unknown one is reported.
    pub fn named(&self, element: &Element, attribute: &str, otherwise: usize, report: &mut Report) -> usize {
        let Some(name) = element.get(attribute) else { return otherwise };
        self.names.get(name).copied().unwrap_or_else(|| {
            let remedy = report.propose(name, self.names.keys().map(String::as_str));
            report.error(element, format!("unknown default class {}", quoted(name)), remedy);
            otherwise
        })
    }
}
