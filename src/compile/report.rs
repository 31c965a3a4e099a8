//! What the compiler tells the user about a model that it accepts.

use super::constraints::raised;
use super::links::Links;
use super::names::label;
use super::order::Scene;
use crate::spec::{JointKind, Spec, Tri, is_limited};

/// Adds notes on what was adjusted, or acts otherwise than it may seem.
pub(crate) fn compile_notes(spec: &Spec, scene: &Scene, notes: &mut Vec<String>) {
    let options = &spec.option;
    let mut slow: Vec<String> = Vec::new();
    let mut slippery: Vec<String> = Vec::new();
    for (i, joint) in scene.joints.iter().enumerate() {
        let spec = joint.spec;
        if spec.stiffness.iter().any(|&k| k < 0.0) {
            notes.push(format!("{}: stiffness is negative, the spring pushes away", label("joint", &spec.name, i)));
        }
        let limited = is_limited(spec.range, spec.limited) && spec.kind != JointKind::Free;
        if (limited && raised(options, spec.solreflimit))
            || (spec.frictionloss > 0.0 && raised(options, spec.solreffriction))
        {
            slow.push(label("joint", &spec.name, i));
        }
    }
    for (i, geom) in scene.geoms.iter().enumerate() {
        let spec = geom.spec;
        let collides = spec.contype != 0 || spec.conaffinity != 0;
        if collides && raised(options, spec.solref) {
            slow.push(label("geom", &spec.name, i));
        }
        if collides && spec.condim > 1 && spec.friction[0] < 1e-5 {
            slippery.push(label("geom", &spec.name, i));
        }
    }
    let pairs = spec.pairs.iter().enumerate();
    slow.extend(pairs.filter(|(_, p)| raised(options, p.solref)).map(|(i, p)| label("pair", &p.name, i)));
    empty_ranges(spec, scene, notes);
    if !slow.is_empty() {
        let bound = 2.0 * options.timestep;
        notes.push(format!("solref time constants below two time steps act as {bound} (refsafe): {}", listed(&slow)));
    }
    if !slippery.is_empty() {
        let list = listed(&slippery);
        notes.push(format!("friction below 1e-5 acts as 1e-5, use condim 1 for none: {list}"));
    }
    if scene.nmocap > 0 {
        notes.push(format!("{} mocap bodies stand still where the model puts them", scene.nmocap));
    }
}

/// Ranges that are given, and bound nothing because their ends do not come in order.
fn empty_ranges(spec: &Spec, scene: &Scene, notes: &mut Vec<String>) {
    let mut check = |kind: &str, name: &str, index: usize, attribute: &str, range: Option<[f64; 2]>, flag: Tri| {
        if let Some([lo, hi]) = range.filter(|range| flag == Tri::Auto && !is_limited(Some(*range), flag)) {
            notes.push(format!("{}: {attribute} {lo} {hi} is empty: not limited", label(kind, name, index)));
        }
    };
    for (i, joint) in scene.joints.iter().enumerate() {
        let joint = joint.spec;
        check("joint", &joint.name, i, "range", joint.range, joint.limited);
        check("joint", &joint.name, i, "actuatorfrcrange", joint.actuatorfrcrange, joint.actuatorfrclimited);
    }
    for (i, actuator) in spec.actuators.iter().enumerate() {
        check("actuator", &actuator.name, i, "ctrlrange", actuator.ctrlrange, actuator.ctrllimited);
        check("actuator", &actuator.name, i, "forcerange", actuator.forcerange, actuator.forcelimited);
    }
}

/// The first few of a list, and how many more there are.
fn listed(items: &[String]) -> String {
    const SHOWN: usize = 5;
    let mut text = items.iter().take(SHOWN).cloned().collect::<Vec<_>>().join(", ");
    if items.len() > SHOWN {
        text.push_str(&format!(" and {} more", items.len() - SHOWN));
    }
    text
}

/// MuJoCo's counts of elements.
pub(crate) fn counts(spec: &Spec, scene: &Scene, links: &Links) -> Vec<(&'static str, usize)> {
    vec![
        ("nq", scene.nq),
        ("nv", scene.nv),
        ("nu", spec.actuators.len()),
        ("na", 0),
        ("nbody", scene.bodies.len()),
        ("njnt", scene.joints.len()),
        ("ngeom", scene.geoms.len()),
        ("nsite", scene.sites.len()),
        ("ntree", links.tree_root.len()),
        ("ntendon", 0),
        ("neq", 0),
        ("nsensor", 0),
        ("nsensordata", 0),
        ("nmocap", scene.nmocap),
        ("nkey", spec.keys.len()),
        ("nexclude", spec.excludes.len()),
        ("npair", spec.pairs.len()),
    ]
}
