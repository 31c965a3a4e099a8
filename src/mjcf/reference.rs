//! Elements that refer to parts of the body tree by name, and what replication does to them.

use std::collections::{HashMap, HashSet};

use crate::spec::{
    Actuator, Body, Equality, Exclude, Held, ObjectKind, Pair, Path, Sensor, Tendon, Transmission, Waypoint,
};

/// Kinds of elements that others name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Space {
    Body,
    Site,
    Camera,
    Joint,
    Geom,
    Tendon,
    Actuator,
}

/// Number of kinds.
const SPACES: usize = 7;

/// Names by kind.
pub(super) type Names<'a> = [HashSet<&'a str>; SPACES];

/// The names in bodies, and in what is directly in the body around them.
pub(super) fn names<'a>(bodies: &'a [Body], content: &'a Body) -> Names<'a> {
    let all = || bodies.iter().chain(std::iter::once(content));
    let mut names = Names::default();
    let mut add = |space: Space, found: &mut dyn Iterator<Item = &'a String>| {
        names[space as usize] = found.map(String::as_str).filter(|name| !name.is_empty()).collect();
    };
    add(Space::Body, &mut bodies.iter().map(|body| &body.name));
    add(Space::Joint, &mut all().flat_map(|body| body.joints.iter().map(|joint| &joint.name)));
    add(Space::Geom, &mut all().flat_map(|body| body.geoms.iter().map(|geom| &geom.name)));
    add(Space::Site, &mut all().flat_map(|body| body.sites.iter().map(|site| &site.name)));
    add(Space::Camera, &mut all().flat_map(|body| body.cameras.iter().map(|camera| &camera.name)));
    names
}

/// An element that names others.
pub(super) trait Refers: Clone {
    /// The names that it refers to, with their kinds.
    fn targets(&mut self) -> Vec<(Space, &mut String)>;
    /// Its own name.
    fn name(&mut self) -> &mut String;
}

/// Names of one kind.
fn all<'a>(space: Space, names: impl IntoIterator<Item = &'a mut String>) -> Vec<(Space, &'a mut String)> {
    names.into_iter().map(|name| (space, name)).collect()
}

impl Refers for Pair {
    fn targets(&mut self) -> Vec<(Space, &mut String)> {
        all(Space::Geom, [&mut self.geom1, &mut self.geom2])
    }
    fn name(&mut self) -> &mut String {
        &mut self.name
    }
}

impl Refers for Exclude {
    fn targets(&mut self) -> Vec<(Space, &mut String)> {
        all(Space::Body, [&mut self.body1, &mut self.body2])
    }
    fn name(&mut self) -> &mut String {
        &mut self.name
    }
}

impl Refers for Tendon {
    fn targets(&mut self) -> Vec<(Space, &mut String)> {
        match &mut self.path {
            Path::Fixed(joints) => all(Space::Joint, joints.iter_mut().map(|(joint, _)| joint)),
            Path::Spatial(points) => {
                let names = points.iter_mut().flat_map(|point| match point {
                    Waypoint::Site(site) => vec![(Space::Site, site)],
                    Waypoint::Geom { geom, side } => vec![(Space::Geom, geom), (Space::Site, side)],
                    Waypoint::Pulley(_) => Vec::new(),
                });
                names.collect()
            }
        }
    }
    fn name(&mut self) -> &mut String {
        &mut self.name
    }
}

impl Refers for Equality {
    fn targets(&mut self) -> Vec<(Space, &mut String)> {
        match &mut self.held {
            Held::Points { bodies, .. } | Held::Frames { bodies, .. } => all(Space::Body, bodies),
            Held::Sites(sites) | Held::SiteFrames { sites, .. } => all(Space::Site, sites),
            Held::Joints { joints, .. } => all(Space::Joint, joints),
            Held::Tendons { tendons, .. } => all(Space::Tendon, tendons),
        }
    }
    fn name(&mut self) -> &mut String {
        &mut self.name
    }
}

impl Refers for Sensor {
    fn targets(&mut self) -> Vec<(Space, &mut String)> {
        let objects = self.object.iter_mut().chain(&mut self.reference);
        let space = |kind| match kind {
            ObjectKind::Body | ObjectKind::XBody => Space::Body,
            ObjectKind::Joint => Space::Joint,
            ObjectKind::Geom => Space::Geom,
            ObjectKind::Site => Space::Site,
            ObjectKind::Camera => Space::Camera,
            ObjectKind::Tendon => Space::Tendon,
            ObjectKind::Actuator => Space::Actuator,
        };
        objects.map(|object| (space(object.kind), &mut object.name)).collect()
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
    fn targets(&mut self) -> Vec<(Space, &mut String)> {
        match &mut self.actuator.transmission {
            Transmission::Joint(joint) | Transmission::JointInParent(joint) => all(Space::Joint, [joint]),
            Transmission::Site { site, reference } => all(Space::Site, std::iter::once(site).chain(reference)),
            Transmission::SliderCrank { crank, slider, .. } => all(Space::Site, [crank, slider]),
            Transmission::Tendon(tendon) => all(Space::Tendon, [tendon]),
            Transmission::Body(body) => all(Space::Body, [body]),
        }
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
    by_target: [HashMap<String, Vec<usize>>; SPACES],
}

impl<T: Refers> References<T> {
    pub fn new(items: impl IntoIterator<Item = T>) -> Self {
        let mut references = References { items: Vec::new(), by_target: Default::default() };
        for item in items {
            references.push(item);
        }
        references
    }

    pub fn push(&mut self, mut item: T) {
        for (space, target) in item.targets() {
            self.by_target[space as usize].entry(target.clone()).or_default().push(self.items.len());
        }
        self.items.push(Some(item));
    }

    /// Whether some element refers to a name.
    pub fn mention(&self, name: &str) -> bool {
        self.by_target.iter().any(|space| space.contains_key(name))
    }

    /// The elements that refer to something that is about to be replicated, by index. Afterwards none will have such a
    /// name as its target, so these names are forgotten.
    pub fn to(&mut self, replicated: &Names) -> Vec<usize> {
        let mut indices = Vec::new();
        for (names, space) in replicated.iter().zip(&mut self.by_target) {
            indices.extend(names.iter().filter_map(|name| space.remove(*name)).flatten());
        }
        indices.retain(|&index| self.items[index].is_some());
        indices.sort_unstable();
        indices.dedup();
        indices
    }

    /// The names of elements that have one.
    pub fn names(&mut self, indices: &[usize]) -> Vec<String> {
        let names = indices.iter().filter_map(|&index| Some(self.items[index].as_mut()?.name().clone()));
        names.filter(|name| !name.is_empty()).collect()
    }

    /// Moves elements to the end, once for each suffix. What they refer to outside of the replica stays the same.
    pub fn replicate(&mut self, indices: &[usize], replicated: &Names, suffixes: &[String]) {
        let originals: Vec<T> = indices.iter().filter_map(|&index| self.items[index].take()).collect();
        for suffix in suffixes {
            for original in &originals {
                let mut copy = original.clone();
                let replicated =
                    |(space, name): &(Space, &mut String)| replicated[*space as usize].contains(name.as_str());
                for (_, target) in copy.targets().into_iter().filter(replicated) {
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
