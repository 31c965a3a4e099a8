//! What is refused of tendons.

use std::collections::{HashMap, HashSet};

use lanesim_kernels::options::Integrator;

use super::super::element::Element;
use super::super::names::label;
use crate::diagnostics::{Diagnostics, quoted};
use crate::spec::{JointKind, Path, Shape, Spec, Tendon, Waypoint, is_limited};

/// What paths may name.
struct Known<'a> {
    joints: HashMap<&'a str, JointKind>,
    sites: HashSet<&'a str>,
    geoms: HashMap<&'a str, Shape>,
}

/// Adds every problem that tendons show.
pub(crate) fn check(spec: &Spec, diagnostics: &mut Diagnostics) {
    if spec.tendons.is_empty() {
        return;
    }
    let bodies = || spec.bodies.iter();
    let known = Known {
        joints: bodies().flat_map(|body| &body.joints).map(|joint| (joint.name.as_str(), joint.kind)).collect(),
        sites: bodies().flat_map(|body| &body.sites).map(|site| site.name.as_str()).collect(),
        geoms: bodies().flat_map(|body| &body.geoms).map(|geom| (geom.name.as_str(), geom.shape)).collect(),
    };
    for (i, tendon) in spec.tendons.iter().enumerate() {
        let mut element = Element::new(label("tendon", &tendon.name, i), &tendon.source, diagnostics);
        numbers(tendon, spec.compiler.autolimits, &mut element);
        yields(tendon, spec.option.integrator, &mut element);
        match &tendon.path {
            Path::Fixed(joints) => fixed(joints, &known, &mut element),
            Path::Spatial(points) => spatial(tendon, points, &known, &mut element),
        }
    }
}

/// Refuses a spring that would have to yield by a length that no integrator of its kind knows.
fn yields(tendon: &Tendon, integrator: Integrator, element: &mut Element) {
    let between = matches!(integrator, Integrator::Rk4 | Integrator::Midpoint);
    if tendon.springyield > 0.0 && between && matches!(tendon.path, Path::Spatial(_)) {
        let message = format!("springyield along a path is not supported under integrator {integrator}");
        element.refuse(message, "set integrator=\"implicitfast\"");
    }
}

fn numbers(tendon: &Tendon, autolimits: bool, element: &mut Element) {
    element.bounds("range", "limited", tendon.range, tendon.limited, autolimits);
    let (range, flag) = (tendon.actuatorfrcrange, tendon.actuatorfrclimited);
    element.bounds("actuatorfrcrange", "actuatorfrclimited", range, flag, autolimits);
    let [lo, hi] = range.unwrap_or_default();
    if is_limited(range, flag) && lo < hi && (lo > 0.0 || hi < 0.0) {
        let message = format!("actuatorfrcrange leaves no room for no force: {lo} {hi}");
        element.refuse(message, "give a range that contains 0");
    }
    element.finite("margin", &[tendon.margin]);
    if element.finite("springlength", &tendon.springlength) && tendon.springlength[0] > tendon.springlength[1] {
        let [lo, hi] = tendon.springlength;
        element.refuse(format!("springlength is empty: {lo} {hi}"), "give springlength as shorter longer");
    }
    element.finite("stiffness", &tendon.stiffness);
    element.not_negative("springyield", &[tendon.springyield]);
    element.finite("damping", &tendon.damping);
    element.not_negative("damping", &tendon.damping[..1]);
    element.not_negative("armature", &[tendon.armature]);
    element.not_negative("frictionloss", &[tendon.frictionloss]);
    element.solref("solreflimit", &tendon.solreflimit);
    element.solref("solreffriction", &tendon.solreffriction);
    element.finite("solimplimit", &tendon.solimplimit);
    element.finite("solimpfriction", &tendon.solimpfriction);
}

fn fixed(joints: &[(String, f64)], known: &Known, element: &mut Element) {
    if joints.is_empty() {
        element.refuse("has no joint", "add joints, each with a coefficient");
    }
    let mut seen = HashSet::new();
    for (name, coef) in joints {
        element.finite("coef", &[*coef]);
        match known.joints.get(name.as_str()).filter(|_| !name.is_empty()) {
            None => unknown("joint", name, known.joints.keys(), element),
            Some(JointKind::Ball | JointKind::Free) => {
                let message = format!("joint {} is neither a hinge nor a slide", quoted(name));
                element.refuse(message, "a fixed tendon is a sum over hinges and slides");
            }
            Some(_) if !seen.insert(name) => {
                element.refuse(format!("joint {} is repeated", quoted(name)), "add up its coefficients");
            }
            Some(_) => {}
        }
    }
}

fn unknown<'a>(kind: &str, name: &str, known: impl Iterator<Item = &'a &'a str>, element: &mut Element) {
    let mut names: Vec<&str> = known.copied().filter(|name| !name.is_empty()).collect();
    names.sort_unstable();
    element.unknown(format!("names an unknown {kind} {}", quoted(name)), name, names.into_iter());
}

fn spatial(tendon: &Tendon, points: &[Waypoint], known: &Known, element: &mut Element) {
    for point in points {
        match point {
            Waypoint::Site(name) => site("site", name, known, element),
            Waypoint::Geom { geom, side } => {
                match known.geoms.get(geom.as_str()).filter(|_| !geom.is_empty()) {
                    None => unknown("geom", geom, known.geoms.keys(), element),
                    Some(Shape::Sphere | Shape::Cylinder) => {}
                    Some(_) => {
                        let message = format!("geom {} is neither a sphere nor a cylinder", quoted(geom));
                        element.refuse(message, "a tendon wraps a sphere or a cylinder: put one where the geom is");
                    }
                }
                if !side.is_empty() {
                    site("side site", side, known, element);
                }
                if tendon.armature > 0.0 {
                    let message = format!("has armature and wraps geom {}", quoted(geom));
                    element.refuse(message, "remove the armature, or go by sites alone");
                }
            }
            Waypoint::Pulley(divisor) => {
                if element.finite("divisor", &[*divisor]) && *divisor <= 0.0 {
                    element.refuse(format!("divisor of a pulley is {divisor}"), "give a positive number");
                }
            }
        }
    }
    order(points, element);
}

fn site(kind: &str, name: &str, known: &Known, element: &mut Element) {
    if name.is_empty() || !known.sites.contains(name) {
        unknown(kind, name, known.sites.iter(), element);
    }
}

/// Refuses points that do not follow each other as a path's do.
fn order(points: &[Waypoint], element: &mut Element) {
    let sites = points.iter().filter(|point| matches!(point, Waypoint::Site(_))).count();
    if sites < 2 {
        return element.refuse("has fewer than two sites", "a path goes from site to site");
    }
    let at = |i: usize| points.get(i);
    let is_site = |i: usize| matches!(at(i), Some(Waypoint::Site(_)));
    let is_pulley = |i: usize| matches!(at(i), None | Some(Waypoint::Pulley(_)));
    for (i, point) in points.iter().enumerate() {
        let before = i.wrapping_sub(1);
        match point {
            Waypoint::Pulley(_) if i + 1 == points.len() => {
                element.refuse("ends with a pulley", "end it with a site, or remove the pulley");
            }
            Waypoint::Pulley(_) if matches!(at(i + 1), Some(Waypoint::Pulley(_))) => {
                element.refuse("has two pulleys in a row", "keep one of them");
            }
            Waypoint::Pulley(_) => {}
            Waypoint::Geom { geom, .. } => {
                if !is_site(before) || !is_site(i + 1) {
                    element.refuse(format!("geom {} is not between two sites", quoted(geom)), "put sites around it");
                }
            }
            Waypoint::Site(name) => {
                if is_pulley(before) && is_pulley(i + 1) {
                    let message = format!("site {} is alone in its branch", quoted(name));
                    element.refuse(message, "a branch goes from site to site");
                }
                if matches!(at(i + 1), Some(Waypoint::Site(next)) if next == name) {
                    element.refuse(format!("site {} is repeated", quoted(name)), "remove one of the two");
                }
            }
        }
    }
}
