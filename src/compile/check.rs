//! What is refused before anything is computed: every problem that an element shows by itself.

use std::collections::HashSet;

use lanesim_kernels::options::Integrator;

use super::lengthrange::MOST_STEPS;
use super::names::{self, label};
use crate::diagnostics::{Diagnostics, quoted};
use crate::spec::{
    Actuator, Bias, Body, Dynamics, Gain, Geom, GeomMass, Inertia, Joint, JointKind, Key, LengthRange, Options, Pair,
    Path, Shape, Source, Spec, Tendon, Transmission, Tri, Waypoint, is_limited,
};
use crate::suggest::did_you_mean;
use crate::unbuilt::unbuilt;

/// Most numbers of all keyframes together.
const MOST_KEY_NUMBERS: usize = 10_000_000;

/// One element under examination.
pub(super) struct Element<'a> {
    label: String,
    source: &'a Source,
    diagnostics: &'a mut Diagnostics,
}

impl<'a> Element<'a> {
    pub fn new(label: String, source: &'a Source, diagnostics: &'a mut Diagnostics) -> Self {
        Element { label, source, diagnostics }
    }

    pub fn refuse(&mut self, message: impl Into<String>, remedy: impl Into<String>) {
        self.diagnostics.push(self.source, self.label.clone(), message, remedy);
    }

    /// Refuses a reference to what is not there. Only the first few come with a suggestion: each costs a search.
    pub fn unknown<'b>(&mut self, message: String, name: &str, candidates: impl Iterator<Item = &'b str>) {
        const SUGGESTED: usize = 20;
        let few = self.diagnostics.0.len() < SUGGESTED;
        let hint = if few { did_you_mean(name, candidates) } else { String::new() };
        self.refuse(message, hint);
    }

    /// Refuses NaN and infinity; whether all numbers are finite.
    pub fn finite(&mut self, attribute: &str, values: &[f64]) -> bool {
        let ok = values.iter().all(|x| x.is_finite());
        if !ok {
            self.refuse(format!("{attribute} is not finite"), "give finite numbers");
        }
        ok
    }

    pub fn not_negative(&mut self, attribute: &str, values: &[f64]) {
        if self.finite(attribute, values)
            && let Some(x) = values.iter().find(|&&x| x < 0.0)
        {
            self.refuse(format!("{attribute} is negative: {x}"), "give 0 or more");
        }
    }

    pub fn quat(&mut self, attribute: &str, quat: &[f64]) {
        if self.finite(attribute, quat) {
            let norm = quat.iter().map(|x| x * x).sum::<f64>().sqrt();
            if norm < 1e-15 || !norm.is_finite() {
                self.refuse(format!("{attribute} has no direction"), "give a quaternion of length one");
            }
        }
    }

    fn pose(&mut self, pos: &[f64; 3], quat: &[f64; 4]) {
        self.finite("pos", pos);
        self.quat("quat", quat);
    }

    pub fn solref(&mut self, attribute: &str, solref: &[f64; 2]) {
        if self.finite(attribute, solref) && (solref[0] > 0.0) != (solref[1] > 0.0) {
            self.refuse(
                format!("{attribute} mixes its two forms: {} {}", solref[0], solref[1]),
                "give two positive numbers (time constant, damping ratio) or none (-stiffness, -damping)",
            );
        }
    }

    fn condim(&mut self, condim: i32) {
        if ![1, 3, 4, 6].contains(&condim) {
            self.refuse(format!("condim is {condim}"), "use 1, 3, 4 or 6");
        }
    }

    /// Whether a range is in force; refuses what cannot be. `0 0` counts as not given.
    fn range(&mut self, attribute: &str, limited: &str, range: Option<[f64; 2]>, flag: Tri, autolimits: bool) -> bool {
        if range.is_some_and(|range| range.iter().any(|x| x.is_nan())) {
            self.refuse(format!("{attribute} is not a number"), "give numbers, or inf for no bound");
            return false;
        }
        if flag == Tri::Auto && range.is_some_and(|range| range != [0.0, 0.0]) && !autolimits {
            self.refuse(
                format!("{attribute} without {limited}, and autolimits is off"),
                format!("set {limited}, or autolimits=\"true\""),
            );
            return false;
        }
        is_limited(range, flag)
    }

    /// As [`range`](Self::range); a range in force must not be empty.
    pub fn bounds(&mut self, attribute: &str, limited: &str, range: Option<[f64; 2]>, flag: Tri, autolimits: bool) {
        let [lo, hi] = range.unwrap_or_default();
        if self.range(attribute, limited, range, flag, autolimits) && lo >= hi {
            self.refuse(format!("{attribute} is empty: {lo} {hi}"), format!("give {attribute} as lower upper"));
        }
    }
}

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
    check_actuators(spec, diagnostics);
    check_keys(spec, diagnostics);
    tree
}

/// Refuses a surface that moves where no number is, or where steps do not know of it.
fn check_surface(spec: &Spec, geom: &Geom, index: usize, diagnostics: &mut Diagnostics) {
    let mut element = Element { label: label("geom", &geom.name, index), source: &geom.source, diagnostics };
    let fluid = geom.fluid.unwrap_or_default();
    element.finite("fluidcoef", &fluid);
    let finite = element.finite("surfacevel", &geom.surfacevel);
    if finite && geom.surfacevel != [0.0; 6] && spec.option.integrator == Integrator::Discrete {
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

fn check_actuators(spec: &Spec, diagnostics: &mut Diagnostics) {
    let joints = || spec.bodies.iter().flat_map(|b| &b.joints);
    let sites = spec.bodies.iter().flat_map(|b| &b.sites).map(|s| s.name.as_str()).filter(|name| !name.is_empty());
    let sites: std::collections::BTreeSet<&str> = sites.collect();
    let by_name: std::collections::HashMap<&str, &Joint> = joints().map(|j| (j.name.as_str(), j)).collect();
    for (i, actuator) in spec.actuators.iter().enumerate() {
        let label = label("actuator", &actuator.name, i);
        let mut element = Element { label, source: &actuator.source, diagnostics };
        let mut joint = None;
        if let Some(target) = actuator.transmission.joint() {
            joint = if target.is_empty() { None } else { by_name.get(target).copied() };
            if target.is_empty() {
                element.refuse("acts on nothing", "name a joint");
            } else if joint.is_none() {
                let message = format!("acts on an unknown joint {}", quoted(target));
                element.unknown(message, target, joints().map(|j| j.name.as_str()));
            }
        }
        let mut tendon = None;
        if let Some(target) = actuator.transmission.tendon() {
            tendon = spec.tendons.iter().find(|tendon| tendon.name == target && !target.is_empty());
            if tendon.is_none() {
                let message = format!("acts on an unknown tendon {}", quoted(target));
                element.unknown(message, target, spec.tendons.iter().map(|tendon| tendon.name.as_str()));
            }
        }
        if let Some(target) = actuator.transmission.body() {
            let names = || spec.bodies.iter().map(|body| body.name.as_str()).filter(|name| !name.is_empty());
            if !names().any(|name| name == target) {
                element.unknown(format!("acts on an unknown body {}", quoted(target)), target, names());
            }
            check_on_body(actuator, &spec.option, &mut element);
        }
        for (attribute, name) in actuator.transmission.sites() {
            if !sites.contains(name) {
                let message = format!("{attribute} names an unknown site {}", quoted(name));
                element.unknown(message, name, sites.iter().copied());
            }
        }
        check_actuator(actuator, (joint, tendon), spec.compiler.autolimits, &mut element);
    }
}

/// Refuses what depends on the length and the velocity of an actuator on a body, of which it has none before contacts are known.
fn check_on_body(a: &Actuator, option: &Options, element: &mut Element) {
    let follows =
        a.gain == Gain::Affine && a.gainprm[1..3] != [0.0; 2] || a.bias == Bias::Affine && a.biasprm[1..3] != [0.0; 2];
    if follows || a.gain == Gain::Muscle || a.bias == Bias::Muscle || a.dynamics == Dynamics::Muscle {
        let message = "acts on a body, and its force follows length or velocity, which is not supported";
        element.refuse(message, "give it a fixed gain");
    }
    if a.armature != 0.0 || a.damping != [0.0; 3] || a.inheritrange > 0.0 {
        element.refuse("armature, damping or inheritrange, but it acts on a body", "remove them");
    }
    if option.integrator.has_metric() {
        let what = format!("acts on a body, which integrator {} does not support", option.integrator);
        element.refuse(what, "set integrator=\"implicitfast\"");
    }
    if option.guard {
        element.refuse("acts on a body, which the guard does not support", "set guard=\"disable\"");
    }
}

/// Refuses what a tendon cannot give an actuator.
fn check_by_tendon(a: &Actuator, tendon: &Tendon, element: &mut Element) {
    let wraps = match &tendon.path {
        Path::Fixed(_) => false,
        Path::Spatial(points) => points.iter().any(|point| matches!(point, Waypoint::Geom { .. })),
    };
    let name = quoted(&tendon.name);
    if a.armature > 0.0 && wraps {
        element.refuse(format!("armature, but tendon {name} wraps a geom"), "remove the armature");
    }
    let finite = tendon.range.is_some_and(|[lo, hi]| lo < hi && lo.is_finite() && hi.is_finite());
    if a.inheritrange > 0.0 && !finite {
        element.refuse(format!("inheritrange, but tendon {name} has no range"), "give the tendon a range");
    }
}

fn check_actuator(
    a: &Actuator,
    (joint, tendon): (Option<&Joint>, Option<&Tendon>),
    autolimits: bool,
    element: &mut Element,
) {
    if let Some(tendon) = tendon {
        check_by_tendon(a, tendon, element);
    }
    if let Transmission::SliderCrank { rod, .. } = a.transmission
        && (!rod.is_finite() || rod <= 0.0)
    {
        element.refuse(format!("cranklength {rod} is no length of a rod"), "give a positive cranklength");
    }
    if !a.transmission.sites().is_empty() {
        if a.armature != 0.0 || a.damping != [0.0; 3] {
            let message = "armature and damping, which act on a joint, but it acts on sites";
            element.refuse(message, "give them to joints");
        }
        if a.inheritrange > 0.0 {
            element.refuse("inheritrange, but sites have no range", "give ctrlrange");
        }
    }
    element.finite("gear", &a.gear);
    element.finite("gainprm", &a.gainprm);
    element.finite("biasprm", &a.biasprm);
    element.finite("dynprm", &a.dynprm);
    if let Some(range) = a.lengthrange {
        element.finite("lengthrange", &range);
    }
    if a.gain == Gain::Muscle {
        check_muscle(&a.gainprm, element);
    } else if a.bias == Bias::Muscle {
        check_muscle(&a.biasprm, element);
    }
    if a.dynamics != Dynamics::None {
        element.bounds("actrange", "actlimited", a.actrange, a.actlimited, autolimits);
    } else if is_limited(a.actrange, a.actlimited) {
        element.refuse("actrange or actlimited, but it has no activation", "remove it");
    }
    element.not_negative("dampratio", &[a.dampratio]);
    element.not_negative("armature", &[a.armature]);
    element.finite("damping", &a.damping);
    element.not_negative("damping", &a.damping[..1]);
    element.finite("inheritrange", &[a.inheritrange]);
    if a.inheritrange > 0.0 {
        let (ranged, name) = match a.dynamics {
            Dynamics::Integrator => (a.actrange, "actrange"),
            _ => (a.ctrlrange, "ctrlrange"),
        };
        if ranged.is_some() {
            element.refuse(format!("has both {name} and inheritrange"), "keep one of them");
        }
        if let Some(joint) = joint {
            if !matches!(joint.kind, JointKind::Hinge | JointKind::Slide) {
                element.refuse("inheritrange needs a hinge or slide joint", "give ctrlrange");
            } else if joint.range.is_none_or(|[lo, hi]| lo == hi) {
                let message = format!("inheritrange, but joint {} has no range", quoted(&joint.name));
                element.refuse(message, "give the joint a range");
            } else if joint.range.is_some_and(|range| range.iter().any(|end| end.is_infinite())) {
                let message =
                    format!("inheritrange, but the range of joint {} has an infinite end", quoted(&joint.name));
                element.refuse(message, "give ctrlrange");
            }
        }
    } else {
        element.bounds("ctrlrange", "ctrllimited", a.ctrlrange, a.ctrllimited, autolimits);
    }
    element.bounds("forcerange", "forcelimited", a.forcerange, a.forcelimited, autolimits);
}

/// Refuses parameters of which no muscle can be.
fn check_muscle(prm: &[f64; 10], element: &mut Element) {
    let [from, to, _, scale, lmin, lmax, vmax, fpmax, fvmax, _] = *prm;
    if from >= to {
        element.refuse(format!("a muscle of the range {from} {to}"), "give range as lower upper");
    }
    if lmin >= 1.0 || lmax <= 1.0 {
        element.refuse(format!("a muscle with lmin {lmin} and lmax {lmax}"), "give lmin below 1 and lmax above");
    }
    for (name, x) in [("scale", scale), ("vmax", vmax), ("fpmax", fpmax), ("fvmax", fvmax)] {
        if x <= 0.0 {
            element.refuse(format!("a muscle with {name} {x}"), format!("give a positive {name}"));
        }
    }
}

fn check_keys(spec: &Spec, diagnostics: &mut Diagnostics) {
    let kinds = || spec.bodies.iter().flat_map(|body| &body.joints).map(|joint| joint.kind);
    let (nq, nv): (usize, usize) = (kinds().map(qpos_count).sum(), kinds().map(dof_count).sum());
    let nmocap = spec.bodies.iter().filter(|b| b.mocap).count();
    // Every keyframe is kept in full, however little of it is written.
    let na = spec.activations();
    let each = nq + nv + na + spec.actuators.len() + 7 * nmocap;
    let most = MOST_KEY_NUMBERS / each.max(1);
    if let Some(key) = spec.keys.get(most) {
        let message = format!("{} keyframes of {each} numbers each are more than can be kept", spec.keys.len());
        let mut element = Element { label: label("key", &key.name, most), source: &key.source, diagnostics };
        return element.refuse(message, format!("give at most {most}"));
    }
    for (i, key) in spec.keys.iter().enumerate() {
        let label = label("key", &key.name, i);
        let mut element = Element { label, source: &key.source, diagnostics };
        check_key(key, [nq, nv, na, spec.actuators.len(), nmocap], &mut element);
    }
}

fn check_key(key: &Key, [nq, nv, na, nu, nmocap]: [usize; 5], element: &mut Element) {
    element.finite("time", &[key.time]);
    let fields = [
        ("qpos", &key.qpos, nq),
        ("qvel", &key.qvel, nv),
        ("act", &key.act, na),
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
