//! What is refused before anything is computed: every problem that an element shows by itself.

use std::collections::HashSet;

use lanesim_kernels::options::Integrator;

use super::drives;
use super::element::Element;
use super::lengthrange::MOST_STEPS;
use super::names::{self, label};
use crate::diagnostics::{Diagnostics, quoted};
use crate::spec::{Body, Geom, GeomMass, Inertia, Joint, JointKind, Key, LengthRange, Pair, Shape, Source, Spec};
use crate::unbuilt::unbuilt;

/// Most numbers of all keyframes together.
const MOST_KEY_NUMBERS: usize = 10_000_000;

/// Adds every problem of `spec`. Whether bodies form a tree, so that later passes may walk it.
pub(crate) fn check(spec: &Spec, diagnostics: &mut Diagnostics) -> bool {
    let tree = check_tree(spec, diagnostics);
    names::check_unique(spec, diagnostics);
    check_options(spec, diagnostics);
    check_compiler(spec, diagnostics);
    let moving = if tree { moving(spec) } else { vec![false; spec.bodies.len()] };
    let (mut joint, mut geom, mut site, mut camera) = (0, 0, 0, 0);
    for (i, body) in spec.bodies.iter().enumerate() {
        check_body(spec, i, body, diagnostics);
        for j in &body.joints {
            check_joint(j, joint, spec.compiler.autolimits, diagnostics);
            joint += 1;
        }
        for g in &body.geoms {
            check_geom(g, geom, moving[i], diagnostics);
            check_surface(spec, g, geom, diagnostics);
            geom += 1;
        }
        for s in &body.sites {
            let label = label("site", &s.name, site);
            let mut element = Element { label, source: &s.source, diagnostics };
            element.pose(&s.pos, &s.quat);
            check_size(&mut element, s.shape, &s.size);
            site += 1;
        }
        for c in &body.cameras {
            Element::new(label("camera", &c.name, camera), &c.source, diagnostics).pose(&c.pos, &c.quat);
            camera += 1;
        }
    }
    check_contact(spec, diagnostics);
    drives::check(spec, diagnostics);
    check_keys(spec, diagnostics);
    tree
}

/// Refuses an ellipsoid in a medium, and a surface that moves, where no number is, or where steps do not know of it.
fn check_surface(spec: &Spec, geom: &Geom, index: usize, diagnostics: &mut Diagnostics) {
    let mut element = Element { label: label("geom", &geom.name, index), source: &geom.source, diagnostics };
    let fluid = geom.fluid.unwrap_or_default();
    element.finite("fluidcoef", &fluid);
    let (discrete, o) = (spec.option.integrator == Integrator::Discrete, &spec.option);
    if geom.fluid.is_some() && discrete && (o.density != 0.0 || o.viscosity != 0.0) {
        let message = "fluidshape ellipsoid in a medium, which integrator discrete does not support";
        element.refuse(message, "set integrator=\"implicitfast\"");
    }
    let finite = element.finite("surfacevel", &geom.surfacevel);
    if finite && geom.surfacevel != [0.0; 6] && discrete {
        let message = "surfacevel, which integrator discrete does not support";
        element.refuse(message, "set integrator=\"implicitfast\"");
    }
}

fn check_tree(spec: &Spec, diagnostics: &mut Diagnostics) -> bool {
    let Some(world) = spec.bodies.first() else {
        diagnostics.push(&Source::default(), "", "there is no world body", "start from Spec::new");
        return false;
    };
    let mut tree = true;
    if !world.joints.is_empty() || world.inertial.is_some() || world.mocap {
        diagnostics.push(&world.source, "world", "the world cannot move", "put joints into bodies");
        tree = false;
    }
    for (i, body) in spec.bodies.iter().enumerate().skip(1) {
        if body.parent >= i {
            let label = label("body", &body.name, i);
            diagnostics.push(&body.source, label, "comes before its parent", "add parents first");
            tree = false;
        }
    }
    tree
}

/// Which bodies have a joint on their path to the world.
fn moving(spec: &Spec) -> Vec<bool> {
    let mut moving = vec![false; spec.bodies.len()];
    for (i, body) in spec.bodies.iter().enumerate().skip(1) {
        moving[i] = moving[body.parent] || !body.joints.is_empty();
    }
    moving
}

/// A setting under examination, with the place where it was written.
fn setting(
    spec: &Spec,
    element: &str,
    attribute: &str,
    diagnostics: &mut Diagnostics,
    check: impl FnOnce(&mut Element),
) {
    let source = spec.place(element, attribute);
    check(&mut Element { label: element.into(), source: &source, diagnostics });
}

fn check_options(spec: &Spec, diagnostics: &mut Diagnostics) {
    let o = &spec.option;
    for unbuilt in unbuilt(o) {
        setting(spec, unbuilt.element, unbuilt.attribute, diagnostics, |e| {
            e.refuse(format!("{} not supported", unbuilt.what), unbuilt.remedy);
        });
    }
    let mut check = |attribute: &str, check: &dyn Fn(&mut Element)| {
        setting(spec, "option", attribute, diagnostics, |element| check(element));
    };
    for (name, x, what) in [("timestep", o.timestep, "time step"), ("impratio", o.impratio, "number")] {
        check(name, &|e| {
            if !(x > 0.0 && x.is_finite()) {
                e.refuse(format!("{name} is {x}"), format!("give a positive {what}"));
            }
        });
    }
    for (name, vector) in [("gravity", &o.gravity), ("wind", &o.wind), ("magnetic", &o.magnetic)] {
        check(name, &|e| _ = e.finite(name, vector));
    }
    check("o_margin", &|e| _ = e.finite("o_margin", &[o.o_margin]));
    let sizes = [
        ("density", o.density),
        ("viscosity", o.viscosity),
        ("tolerance", o.tolerance),
        ("ls_tolerance", o.ls_tolerance),
        ("noslip_tolerance", o.noslip_tolerance),
        ("ccd_tolerance", o.ccd_tolerance),
        ("sleep_tolerance", o.sleep_tolerance),
    ];
    for (name, x) in sizes {
        check(name, &|e| e.not_negative(name, &[x]));
    }
    check("o_solref", &|e| e.solref("o_solref", &o.o_solref));
    check("o_solimp", &|e| _ = e.finite("o_solimp", &o.o_solimp));
    check("o_friction", &|e| e.not_negative("o_friction", &o.o_friction));
}

fn check_compiler(spec: &Spec, diagnostics: &mut Diagnostics) {
    let c = &spec.compiler;
    for (name, x) in [("boundmass", c.boundmass), ("boundinertia", c.boundinertia)] {
        setting(spec, "compiler", name, diagnostics, |e| e.not_negative(name, &[x]));
    }
    setting(spec, "compiler", "settotalmass", diagnostics, |e| _ = e.finite("settotalmass", &[c.settotalmass]));
    let range = &c.lengthrange;
    let LengthRange { accel, maxforce, timeconst, timestep, inttotal, interval, tolrange, .. } = *range;
    for (name, x) in [
        ("accel", accel),
        ("maxforce", maxforce),
        ("timeconst", timeconst),
        ("timestep", timestep),
        ("inttotal", inttotal),
        ("interval", interval),
        ("tolrange", tolrange),
    ] {
        setting(spec, "lengthrange", name, diagnostics, |e| e.not_negative(name, &[x]));
    }
    let steps = inttotal / if timestep > 0.0 { timestep } else { spec.option.timestep };
    if steps > MOST_STEPS {
        setting(spec, "lengthrange", "inttotal", diagnostics, |e| {
            e.refuse(format!("inttotal takes {steps:.0} steps of timestep"), format!("take at most {MOST_STEPS:.0}"));
        });
    }
}

fn check_body(spec: &Spec, index: usize, body: &Body, diagnostics: &mut Diagnostics) {
    let mut element = Element { label: label("body", &body.name, index), source: &body.source, diagnostics };
    element.pose(&body.pos, &body.quat);
    element.finite("gravcomp", &[body.gravcomp]);
    if body.mocap && index > 0 && (body.parent != 0 || !body.joints.is_empty()) {
        element.refuse("a mocap body must be a child of the world without joints", "move it or drop mocap");
    }
    let free = body.joints.iter().any(|j| j.kind == JointKind::Free);
    if free && body.parent != 0 {
        element.refuse("a free joint is only allowed in a child of the world", "move the body to the top level");
    }
    let dofs: usize = body.joints.iter().map(|j| dof_count(j.kind)).sum();
    if dofs > 6 {
        let hint = if free { "a free joint must be alone in its body" } else { "put joints into several bodies" };
        element.refuse(format!("has {dofs} degrees of freedom, at most 6 are possible"), hint);
    }
    let mut ball = false;
    for joint in &body.joints {
        if ball && matches!(joint.kind, JointKind::Ball | JointKind::Hinge) {
            element.refuse("a ball joint is followed by a rotation", "it adds nothing: remove one of the two");
            break;
        }
        ball |= joint.kind == JointKind::Ball;
    }
    if let Some(inertial) = &body.inertial {
        let label = format!("inertial of {}", label("body", &spec.bodies[index].name, index));
        let mut element = Element { label, source: &inertial.source, diagnostics: element.diagnostics };
        element.pose(&inertial.pos, &inertial.quat);
        element.not_negative("mass", &[inertial.mass]);
        match &inertial.inertia {
            Inertia::Diagonal(d) => element.not_negative("diaginertia", d),
            Inertia::Full(f) => {
                element.finite("fullinertia", f);
            }
        }
    }
}

/// Degrees of freedom of a joint.
pub(crate) fn dof_count(kind: JointKind) -> usize {
    match kind {
        JointKind::Free => 6,
        JointKind::Ball => 3,
        JointKind::Slide | JointKind::Hinge => 1,
    }
}

/// Positions of a joint.
pub(crate) fn qpos_count(kind: JointKind) -> usize {
    match kind {
        JointKind::Free => 7,
        JointKind::Ball => 4,
        JointKind::Slide | JointKind::Hinge => 1,
    }
}

fn check_joint(joint: &Joint, index: usize, autolimits: bool, diagnostics: &mut Diagnostics) {
    let mut element = Element { label: label("joint", &joint.name, index), source: &joint.source, diagnostics };
    let scalar = matches!(joint.kind, JointKind::Slide | JointKind::Hinge);
    element.finite("pos", &joint.pos);
    if scalar && element.finite("axis", &joint.axis) {
        let norm = joint.axis.iter().map(|x| x * x).sum::<f64>().sqrt();
        if norm < 1e-14 || !norm.is_finite() {
            element.refuse("axis has no direction", "give an axis of length one");
        }
    }
    element.finite("ref", &[joint.reference]);
    element.finite("springref", &[joint.springref]);
    element.not_negative("springyield", &[joint.springyield]);
    if joint.springyield > 0.0 && joint.kind == JointKind::Free {
        element.refuse("springyield, but the spring of a free joint does not yield", "remove it");
    }
    element.finite("stiffness", &joint.stiffness);
    element.finite("damping", &joint.damping);
    element.not_negative("damping", &joint.damping[..1]);
    element.not_negative("armature", &[joint.armature]);
    element.not_negative("frictionloss", &[joint.frictionloss]);
    if element.finite("springdamper", &joint.springdamper)
        && joint.springdamper != [0.0; 2]
        && joint.springdamper.iter().any(|&x| x <= 0.0)
    {
        element.refuse("springdamper needs two positive numbers", "give time constant and damping ratio");
    }
    element.finite("margin", &[joint.margin]);
    element.solref("solreflimit", &joint.solreflimit);
    element.solref("solreffriction", &joint.solreffriction);
    element.finite("solimplimit", &joint.solimplimit);
    element.finite("solimpfriction", &joint.solimpfriction);
    if scalar {
        element.bounds("range", "limited", joint.range, joint.limited, autolimits);
        let (range, flag) = (joint.actuatorfrcrange, joint.actuatorfrclimited);
        element.bounds("actuatorfrcrange", "actuatorfrclimited", range, flag, autolimits);
    } else if joint.kind == JointKind::Ball {
        let on = element.range("range", "limited", joint.range, joint.limited, autolimits);
        let lower = joint.range.map_or(0.0, |r| r[0]);
        if on && lower != 0.0 {
            element.refuse(format!("the range of a ball joint starts at {lower}"), "give 0 and the largest angle");
        }
    }
}

/// How many sizes a shape has; a plane's only matter for display.
pub(crate) fn used_sizes(shape: Shape) -> usize {
    match shape {
        Shape::Plane | Shape::HeightField | Shape::Mesh => 0,
        Shape::Sphere => 1,
        Shape::Capsule | Shape::Cylinder => 2,
        Shape::Ellipsoid | Shape::Box => 3,
    }
}

fn check_size(element: &mut Element, shape: Shape, size: &[f64; 3]) {
    let used = used_sizes(shape);
    if element.finite("size", size)
        && let Some(i) = (0..used).find(|&i| size[i] <= 0.0)
    {
        element.refuse(format!("size {i} must be positive, it is {}", size[i]), format!("give {used} positive sizes"));
    }
}

fn check_geom(geom: &Geom, index: usize, moving: bool, diagnostics: &mut Diagnostics) {
    let mut element = Element { label: label("geom", &geom.name, index), source: &geom.source, diagnostics };
    element.pose(&geom.pos, &geom.quat);
    check_size(&mut element, geom.shape, &geom.size);
    match geom.mass {
        GeomMass::Mass(mass) => element.not_negative("mass", &[mass]),
        GeomMass::Density(density) => element.not_negative("density", &[density]),
        GeomMass::Solid { mass, moments } => element.not_negative("mass", &[mass, moments[0], moments[1], moments[2]]),
    }
    if geom.shape == Shape::Plane && moving {
        element.refuse("a plane cannot move", "attach it to the world, or use a thin box");
    }
    element.condim(geom.condim);
    element.not_negative("friction", &geom.friction);
    element.finite("solmix", &[geom.solmix]);
    element.solref("solref", &geom.solref);
    element.finite("solimp", &geom.solimp);
    element.finite("margin", &[geom.margin]);
    element.finite("gap", &[geom.gap]);
}

fn check_contact(spec: &Spec, diagnostics: &mut Diagnostics) {
    let geoms: HashSet<&str> = spec.bodies.iter().flat_map(|b| &b.geoms).map(|g| g.name.as_str()).collect();
    for (i, pair) in spec.pairs.iter().enumerate() {
        check_pair(pair, i, &geoms, spec, diagnostics);
    }
    let bodies: HashSet<&str> = spec.bodies.iter().map(|b| b.name.as_str()).collect();
    for (i, exclude) in spec.excludes.iter().enumerate() {
        let label = label("exclude", &exclude.name, i);
        let mut element = Element { label, source: &exclude.source, diagnostics };
        for (attribute, name) in [("body1", &exclude.body1), ("body2", &exclude.body2)] {
            if name.is_empty() {
                element.refuse(format!("{attribute} is missing"), "name a body");
            } else if !bodies.contains(name.as_str()) {
                let message = format!("{attribute} names an unknown body {}", quoted(name));
                element.unknown(message, name, spec.bodies.iter().map(|b| b.name.as_str()));
            }
        }
    }
}

fn check_pair(pair: &Pair, index: usize, geoms: &HashSet<&str>, spec: &Spec, diagnostics: &mut Diagnostics) {
    let mut element = Element { label: label("pair", &pair.name, index), source: &pair.source, diagnostics };
    for (attribute, name) in [("geom1", &pair.geom1), ("geom2", &pair.geom2)] {
        if name.is_empty() {
            element.refuse(format!("{attribute} is missing"), "name a geom");
        } else if !geoms.contains(name.as_str()) {
            let message = format!("{attribute} names an unknown geom {}", quoted(name));
            element.unknown(message, name, spec.bodies.iter().flat_map(|b| &b.geoms).map(|g| g.name.as_str()));
        }
    }
    if pair.geom1 == pair.geom2 && !pair.geom1.is_empty() {
        element.refuse(format!("geom {} is paired with itself", quoted(&pair.geom1)), "name two geoms");
    }
    element.condim(pair.condim);
    element.not_negative("friction", &pair.friction);
    element.solref("solref", &pair.solref);
    element.solref("solreffriction", &pair.solreffriction);
    element.finite("solimp", &pair.solimp);
    element.finite("margin", &[pair.margin]);
    element.finite("gap", &[pair.gap]);
}

fn check_keys(spec: &Spec, diagnostics: &mut Diagnostics) {
    let kinds = || spec.bodies.iter().flat_map(|body| &body.joints).map(|joint| joint.kind);
    let (nq, nv): (usize, usize) = (kinds().map(qpos_count).sum(), kinds().map(dof_count).sum());
    let nmocap = spec.bodies.iter().filter(|b| b.mocap).count();
    // Every keyframe is kept in full, however little of it is written.
    let na = spec.activations();
    let nplastic = plastic(spec);
    let each = nq + nv + na + nplastic + spec.controls() + 7 * nmocap;
    let most = MOST_KEY_NUMBERS / each.max(1);
    if let Some(key) = spec.keys.get(most) {
        let message = format!("{} keyframes of {each} numbers each are more than can be kept", spec.keys.len());
        let mut element = Element { label: label("key", &key.name, most), source: &key.source, diagnostics };
        return element.refuse(message, format!("give at most {most}"));
    }
    for (i, key) in spec.keys.iter().enumerate() {
        let label = label("key", &key.name, i);
        let mut element = Element { label, source: &key.source, diagnostics };
        check_key(key, [nq, nv, na, nplastic, spec.controls(), nmocap], &mut element);
    }
}

/// Numbers of where springs rest that yield.
fn plastic(spec: &Spec) -> usize {
    let joints = spec.bodies.iter().flat_map(|body| &body.joints).filter(|joint| joint.springyield > 0.0);
    let count = |joint: &Joint| if joint.kind == JointKind::Ball { 4 } else { 1 };
    let tendons = spec.tendons.iter().filter(|tendon| tendon.springyield > 0.0).count();
    joints.map(count).sum::<usize>() + 2 * tendons
}

fn check_key(key: &Key, [nq, nv, na, nplastic, nu, nmocap]: [usize; 6], element: &mut Element) {
    element.finite("time", &[key.time]);
    let fields = [
        ("qpos", &key.qpos, nq),
        ("qvel", &key.qvel, nv),
        ("act", &key.act, na),
        ("plastic", &key.plastic, nplastic),
        ("ctrl", &key.ctrl, nu),
        ("mpos", &key.mpos, 3 * nmocap),
        ("mquat", &key.mquat, 4 * nmocap),
    ];
    for (name, values, n) in fields {
        let Some(values) = values else { continue };
        if values.len() > n {
            let message = format!("{name} has {} numbers, the model has {n}", values.len());
            element.refuse(message, format!("give at most {n} numbers; those that are missing are filled in"));
        }
        element.finite(name, values);
    }
}
