//! What the compiler tells the user about a model that it accepts.

use lanesim_kernels::model::Sizes;

use super::constraints::raised;
use super::links::Links;
use super::names::{List, label};
use super::order::Scene;
use crate::spec::{JointKind, Source, Spec, Tri, is_limited};

/// Adds notes on what was adjusted, or acts otherwise than it may seem.
pub(crate) fn compile_notes(spec: &Spec, scene: &Scene, notes: &mut Vec<String>) {
    let options = &spec.option;
    let mut pushing = List::default();
    let mut slow = List::default();
    let mut slippery = List::default();
    for (i, joint) in scene.joints.iter().enumerate() {
        let spec = joint.spec;
        if spec.stiffness.iter().any(|&k| k < 0.0) {
            pushing.push(&spec.source, label("joint", &spec.name, i));
        }
        let limited = is_limited(spec.range, spec.limited) && spec.kind != JointKind::Free;
        if (limited && raised(options, spec.solreflimit))
            || (spec.frictionloss > 0.0 && raised(options, spec.solreffriction))
        {
            slow.push(&spec.source, label("joint", &spec.name, i));
        }
    }
    for (i, geom) in scene.geoms.iter().enumerate() {
        let spec = geom.spec;
        let collides = spec.contype != 0 || spec.conaffinity != 0;
        if collides && raised(options, spec.solref) {
            slow.push(&spec.source, label("geom", &spec.name, i));
        }
        if collides && spec.condim > 1 && spec.friction[0] < 1e-5 {
            slippery.push(&spec.source, label("geom", &spec.name, i));
        }
    }
    for (i, pair) in spec.pairs.iter().enumerate().filter(|(_, pair)| raised(options, pair.solref)) {
        slow.push(&pair.source, label("pair", &pair.name, i));
    }
    for (i, equality) in spec.equalities.iter().enumerate().filter(|(_, equality)| raised(options, equality.solref)) {
        slow.push(&equality.source, label("equality", &equality.name, i));
    }
    for (i, tendon) in spec.tendons.iter().enumerate() {
        if tendon.stiffness.iter().any(|&k| k < 0.0) {
            pushing.push(&tendon.source, label("tendon", &tendon.name, i));
        }
        let limited = is_limited(tendon.range, tendon.limited);
        if (limited && raised(options, tendon.solreflimit))
            || (tendon.frictionloss > 0.0 && raised(options, tendon.solreffriction))
        {
            slow.push(&tendon.source, label("tendon", &tendon.name, i));
        }
    }
    notes.extend(pushing.sentence("stiffness is negative, the spring pushes away"));
    notes.extend(empty_ranges(spec, scene).sentence("ranges are empty and limit nothing"));
    let bound = 2.0 * options.timestep;
    notes.extend(slow.sentence(&format!("solref time constants below two time steps act as {bound} (refsafe)")));
    notes.extend(slippery.sentence("friction below 1e-5 acts as 1e-5, use condim 1 for none"));
}

/// Ranges that are given, and bound nothing because their ends do not come in order.
fn empty_ranges(spec: &Spec, scene: &Scene) -> List {
    let mut list = List::default();
    let mut check = |(source, label): (&Source, &str), attribute: &str, range: Option<[f64; 2]>, flag: Tri| {
        if let Some([lo, hi]) = range.filter(|range| flag == Tri::Auto && !is_limited(Some(*range), flag)) {
            list.push(source, format!("{label} {attribute} {lo} {hi}"));
        }
    };
    for (i, joint) in scene.joints.iter().enumerate() {
        let joint = joint.spec;
        let at = (&joint.source, &*label("joint", &joint.name, i));
        check(at, "range", joint.range, joint.limited);
        check(at, "actuatorfrcrange", joint.actuatorfrcrange, joint.actuatorfrclimited);
    }
    for (i, tendon) in spec.tendons.iter().enumerate() {
        let at = (&tendon.source, &*label("tendon", &tendon.name, i));
        check(at, "range", tendon.range, tendon.limited);
        check(at, "actuatorfrcrange", tendon.actuatorfrcrange, tendon.actuatorfrclimited);
    }
    for (i, actuator) in spec.actuators.iter().enumerate() {
        let at = (&actuator.source, &*label("actuator", &actuator.name, i));
        check(at, "ctrlrange", actuator.ctrlrange, actuator.ctrllimited);
        check(at, "forcerange", actuator.forcerange, actuator.forcelimited);
        check(at, "actrange", actuator.actrange, actuator.actlimited);
    }
    list
}

/// MuJoCo's counts of elements.
pub(crate) fn counts(spec: &Spec, scene: &Scene, links: &Links, sizes: &Sizes) -> Vec<(&'static str, usize)> {
    vec![
        ("nq", scene.nq),
        ("nv", scene.nv),
        ("nu", spec.controls()),
        ("nactuator", spec.actuators.len()),
        ("nout", sizes.nout),
        ("na", spec.activations()),
        ("nhistory", sizes.nhistory),
        ("nplastic", sizes.nplastic),
        ("nbody", scene.bodies.len()),
        ("njnt", scene.joints.len()),
        ("ngeom", scene.geoms.len()),
        ("nsite", scene.sites.len()),
        ("ntree", links.tree_ids().into_iter().max().map_or(0, |last| (last + 1) as usize)),
        ("ntendon", spec.tendons.len()),
        ("neq", spec.equalities.len()),
        ("nsensor", spec.sensors.len()),
        ("nsensordata", sizes.nsensordata),
        ("nmocap", scene.nmocap),
        ("nkey", spec.keys.len()),
        ("nexclude", spec.excludes.len()),
        ("npair", spec.pairs.len()),
    ]
}
