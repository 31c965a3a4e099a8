//! What is refused of equality constraints.

use std::collections::HashMap;

use super::super::element::Element;
use super::super::names::label;
use crate::diagnostics::{Diagnostics, quoted};
use crate::spec::{Equality, Held, JointKind, Spec};

/// Adds every problem that equality constraints show.
pub(crate) fn check(spec: &Spec, diagnostics: &mut Diagnostics) {
    if spec.equalities.is_empty() {
        return;
    }
    let bodies = Known::new("body", spec.bodies.iter().map(|body| (body.name.as_str(), None)));
    let sites = spec.bodies.iter().flat_map(|body| &body.sites);
    let sites = Known::new("site", sites.map(|site| (site.name.as_str(), None)));
    let joints = spec.bodies.iter().flat_map(|body| &body.joints);
    let joints = Known::new("joint", joints.map(|joint| (joint.name.as_str(), Some(joint.kind))));
    let tendons = Known::new("tendon", spec.tendons.iter().map(|tendon| (tendon.name.as_str(), None)));
    for (i, equality) in spec.equalities.iter().enumerate() {
        let mut element = Element::new(name_of(equality, i), &equality.source, diagnostics);
        element.solref("solref", &equality.solref);
        element.finite("solimp", &equality.solimp);
        match &equality.held {
            Held::Points { bodies: names, anchor } => {
                element.finite("anchor", anchor);
                bodies.check(names, Some("world"), &mut element);
            }
            Held::Frames { bodies: names, anchor, relpose, torquescale } => {
                element.finite("anchor", anchor);
                element.finite("torquescale", &[*torquescale]);
                if let Some((pos, quat)) = relpose {
                    element.finite("relpose", pos);
                    element.quat("relpose", quat);
                }
                bodies.check(names, Some("world"), &mut element);
            }
            Held::Sites(names) => sites.check(names, None, &mut element),
            Held::SiteFrames { sites: names, torquescale } => {
                element.finite("torquescale", &[*torquescale]);
                sites.check(names, None, &mut element);
            }
            Held::Tendons { tendons: names, polycoef } => {
                element.finite("polycoef", polycoef);
                tendons.check(names, Some(""), &mut element);
            }
            Held::Joints { joints: names, polycoef } => {
                element.finite("polycoef", polycoef);
                joints.check(names, Some(""), &mut element);
                for name in names.iter().filter(|name| !name.is_empty()) {
                    if let Some(Some(JointKind::Ball | JointKind::Free)) = joints.kinds.get(name.as_str()) {
                        let message = format!("joint {} is neither a hinge nor a slide", quoted(name));
                        element.refuse(message, "hold a ball or a free joint by connect or weld");
                    }
                }
            }
        }
    }
    check_cycles(spec, diagnostics);
}

/// As messages call it.
pub(super) fn name_of(equality: &Equality, index: usize) -> String {
    let kind = match equality.held {
        Held::Points { .. } | Held::Sites(_) => "connect",
        Held::Frames { .. } | Held::SiteFrames { .. } => "weld",
        Held::Joints { .. } => "equality joint",
        Held::Tendons { .. } => "equality tendon",
    };
    label(kind, &equality.name, index)
}

/// The elements of a kind, by name.
struct Known<'a> {
    kind: &'static str,
    kinds: HashMap<&'a str, Option<JointKind>>,
}

impl<'a> Known<'a> {
    fn new(kind: &'static str, elements: impl Iterator<Item = (&'a str, Option<JointKind>)>) -> Self {
        Known { kind, kinds: elements.filter(|(name, _)| !name.is_empty()).collect() }
    }

    /// Refuses names of what is not there, and one name twice. `second`: what it is if it is not given; `None`: it must be.
    fn check(&self, names: &[String; 2], second: Option<&str>, element: &mut Element) {
        let kind = self.kind;
        for (i, name) in names.iter().enumerate() {
            if name.is_empty() {
                if i == 0 || second.is_none() {
                    element.refuse(format!("{kind}{} is missing", i + 1), format!("name a {kind}"));
                }
            } else if !self.kinds.contains_key(name.as_str()) {
                let message = format!("{kind}{} names an unknown {kind} {}", i + 1, quoted(name));
                let mut known: Vec<&str> = self.kinds.keys().copied().collect();
                known.sort_unstable();
                element.unknown(message, name, known.into_iter());
            }
        }
        let given = [&*names[0], if names[1].is_empty() { second.unwrap_or("") } else { &*names[1] }];
        if given[0] == given[1] && !given[0].is_empty() {
            let message = format!("{kind} {} is held to itself", quoted(given[0]));
            element.refuse(message, format!("name two different {}", if kind == "body" { "bodies" } else { kind }));
        }
    }
}

/// Refuses joints, or tendons, each of which, active from the start, is to follow from the next and in the end from itself.
fn check_cycles(spec: &Spec, diagnostics: &mut Diagnostics) {
    // What each follows from, as the first constraint says that does.
    let mut all: [HashMap<&str, &str>; 2] = Default::default();
    for (i, equality) in spec.equalities.iter().enumerate().filter(|(_, equality)| equality.active) {
        let (what, [y, x], follows) = match &equality.held {
            Held::Joints { joints, .. } => ("joints", joints, &mut all[0]),
            Held::Tendons { tendons, .. } => ("tendons", tendons, &mut all[1]),
            _ => continue,
        };
        if x.is_empty() || x == y {
            continue;
        }
        // Joints further up, as far as they are known.
        let (mut at, mut path) = (x.as_str(), vec![y.as_str(), x.as_str()]);
        while let Some(next) = follows.get(at).filter(|_| at != y.as_str()) {
            at = next;
            path.push(at);
        }
        if at == y.as_str() {
            let names: Vec<String> = path.iter().map(|name| quoted(name)).collect();
            let message = format!("{what} follow from each other in a circle: {}", names.join(", "));
            let mut element = Element::new(name_of(equality, i), &equality.source, diagnostics);
            element.refuse(message, "remove one of the constraints: the others say the same of it");
            continue;
        }
        follows.entry(y).or_insert(x);
    }
}
