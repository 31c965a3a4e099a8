//! Elements that refer to parts of the body tree by name, and what replication does to them.

use std::collections::{HashMap, HashSet};

use crate::spec::{Actuator, Equality, Exclude, Held, Pair, Transmission};

/// An element that names others.
pub(super) trait Refers: Clone {
    /// The names that it refers to, all of one kind.
    fn targets(&mut self) -> Vec<&mut String>;
    /// Which kind, where elements may refer to several.
    fn space(&self) -> usize {
        0
    }
    /// Its own name.
    fn name(&mut self) -> &mut String;
}

impl Refers for Pair {
    fn targets(&mut self) -> Vec<&mut String> {
        vec![&mut self.geom1, &mut self.geom2]
    }
    fn name(&mut self) -> &mut String {
        &mut self.name
    }
}

impl Refers for Exclude {
    fn targets(&mut self) -> Vec<&mut String> {
        vec![&mut self.body1, &mut self.body2]
    }
    fn name(&mut self) -> &mut String {
        &mut self.name
    }
}

impl Refers for Equality {
    fn targets(&mut self) -> Vec<&mut String> {
        match &mut self.held {
            Held::Points { bodies: names, .. }
            | Held::Frames { bodies: names, .. }
            | Held::Sites(names)
            | Held::SiteFrames { sites: names, .. }
            | Held::Joints { joints: names, .. } => names.iter_mut().collect(),
        }
    }
    /// Bodies, sites, joints.
    fn space(&self) -> usize {
        match self.held {
            Held::Points { .. } | Held::Frames { .. } => 0,
            Held::Sites(_) | Held::SiteFrames { .. } => 1,
            Held::Joints { .. } => 2,
        }
    }
    fn name(&mut self) -> &mut String {
        &mut self.name
    }
}

/// An actuator, kept or left out: one that was left out still has a place in the controls of a keyframe.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub actuator: Actuator,
    pub kept: bool,
}

impl Refers for Entry {
    fn targets(&mut self) -> Vec<&mut String> {
        match &mut self.actuator.transmission {
            Transmission::Joint(joint) | Transmission::JointInParent(joint) => vec![joint],
            Transmission::Site { site, reference } => std::iter::once(site).chain(reference).collect(),
            Transmission::SliderCrank { crank, slider, .. } => vec![crank, slider],
        }
    }
    /// Joints, sites.
    fn space(&self) -> usize {
        usize::from(self.actuator.transmission.joint().is_none())
    }
    fn name(&mut self) -> &mut String {
        &mut self.actuator.name
    }
}

/// Elements of one kind, in order, found by what they refer to.
#[derive(Debug)]
pub(super) struct References<T> {
    items: Vec<Option<T>>,
    /// By kind.
    by_target: [HashMap<String, Vec<usize>>; 3],
}

impl<T: Refers> References<T> {
    pub fn new(items: impl IntoIterator<Item = T>) -> Self {
        let mut references = References { items: Vec::new(), by_target: Default::default() };
        for item in items {
            references.push(item);
        }
        references
    }

    fn push(&mut self, mut item: T) {
        let space = item.space();
        for target in item.targets() {
            self.by_target[space].entry(target.clone()).or_default().push(self.items.len());
        }
        self.items.push(Some(item));
    }

    /// Whether some element refers to a name.
    pub fn mention(&self, name: &str) -> bool {
        self.by_target.iter().any(|space| space.contains_key(name))
    }

    /// The elements that refer to something that is about to be replicated, by index. Afterwards none will have such a
    /// name as its target, so these names are forgotten. Names come by kind.
    pub fn to(&mut self, replicated: &[&HashSet<&str>]) -> Vec<usize> {
        let mut indices = Vec::new();
        for (names, space) in replicated.iter().zip(&mut self.by_target) {
            indices.extend(names.iter().filter_map(|name| space.remove(*name)).flatten());
        }
        indices.retain(|&index| self.items[index].is_some());
        indices.sort_unstable();
        indices.dedup();
        indices
    }

    /// Moves elements to the end, once for each suffix. What they refer to outside of the replica stays the same.
    pub fn replicate(&mut self, indices: &[usize], replicated: &[&HashSet<&str>], suffixes: &[String]) {
        let originals: Vec<T> = indices.iter().filter_map(|&index| self.items[index].take()).collect();
        for suffix in suffixes {
            for original in &originals {
                let mut copy = original.clone();
                let replicated = replicated[copy.space()];
                for target in copy.targets().into_iter().filter(|target| replicated.contains(target.as_str())) {
                    target.push_str(suffix);
                }
                if !copy.name().is_empty() {
                    copy.name().push_str(suffix);
                }
                self.push(copy);
            }
        }
    }

    /// The elements, in order.
    pub fn into_items(self) -> impl Iterator<Item = T> {
        self.items.into_iter().flatten()
    }
}
