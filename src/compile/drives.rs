//! What is refused of actuators.

use super::element::Element;
use super::histories;
use super::names::label;
use crate::diagnostics::{Diagnostics, quoted};
use crate::spec::{
    Actuator, Bias, Dynamics, Gain, Input, Joint, JointKind, Options, Path, Spec, Tendon, Transmission, Tri, Waypoint,
    is_limited,
};

/// Adds every problem that actuators show.
pub(super) fn check(spec: &Spec, diagnostics: &mut Diagnostics) {
    let joints = || spec.bodies.iter().flat_map(|b| &b.joints);
    let sites = spec.bodies.iter().flat_map(|b| &b.sites).map(|s| s.name.as_str()).filter(|name| !name.is_empty());
    let sites: std::collections::BTreeSet<&str> = sites.collect();
    let by_name: std::collections::HashMap<&str, &Joint> = joints().map(|j| (j.name.as_str(), j)).collect();
    for (i, actuator) in spec.actuators.iter().enumerate() {
        let label = label("actuator", &actuator.name, i);
        let mut element = Element::new(label, &actuator.source, diagnostics);
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
    if matches!(a.gain, Gain::Pid | Gain::DcMotor) {
        element.refuse("acts on a body, which no controller or motor does", "give it another gaintype");
    }
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
    if a.gain == Gain::So3 && joint.is_some_and(|joint| joint.kind != JointKind::Ball) {
        element.refuse("it turns a joint that is no ball", "name a ball joint");
    }
    element.finite("gear", &a.gear);
    element.finite("gainprm", &a.gainprm);
    element.finite("biasprm", &a.biasprm);
    element.finite("dynprm", &a.dynprm);
    histories::check(&a.history, element);
    if a.history.interval != [0.0; 2] {
        element.refuse("interval, which only sensors have", "remove it");
    }
    if let Some(range) = a.lengthrange {
        element.finite("lengthrange", &range);
    }
    check_controls(a, element);
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

/// Refuses several controls that nothing can be done with, and motors that cannot be.
fn check_controls(a: &Actuator, element: &mut Element) {
    let (pid, motor) = (a.gain == Gain::Pid, a.gain == Gain::DcMotor);
    let kinds = match (pid, motor) {
        (true, _) => a.bias == Bias::Affine && matches!(a.dynamics, Dynamics::None | Dynamics::Pid),
        (_, true) => a.bias == Bias::DcMotor && a.dynamics == Dynamics::DcMotor,
        _ if a.gain == Gain::So3 => a.bias == Bias::So3 && matches!(a.dynamics, Dynamics::None | Dynamics::Integrator),
        _ => !matches!(a.bias, Bias::DcMotor | Bias::So3) && !matches!(a.dynamics, Dynamics::Pid | Dynamics::DcMotor),
    };
    if !kinds {
        let remedy = "use the element pid, dcmotor or orientation; gaintype pid goes with biastype affine, so3 and dcmotor with their own";
        return element.refuse("its gaintype, biastype and dyntype do not go together", remedy);
    }
    if a.gain == Gain::So3 {
        check_servo(a, element);
    }
    if !pid && (a.velrange.is_some() || a.ffrange.is_some()) {
        element.refuse("velrange or ffrange, but it is no controller", "remove them, or use the element pid");
    }
    if !pid && !motor {
        return;
    }
    let has = |input: Input| a.inputs.contains(&input);
    if !a.inputs.is_sorted_by(|a, b| a < b) || pid && (a.inputs.is_empty() || has(Input::Voltage)) {
        let remedy = if pid { "give some of pos, vel, ff, in this order" } else { "give each input once, in order" };
        element.refuse("its inputs are none that it can have", remedy);
    }
    if a.inputs.is_empty() && a.history.nsample > 0 {
        element.refuse("nsample, but it has no control", "remove it");
    }
    for (name, range) in [("velrange", a.velrange), ("ffrange", a.ffrange)] {
        element.bounds(name, "ctrllimited", range, Tri::Auto, true);
    }
    let [slews, integrates, ..] = a.states();
    let told = has(Input::Pos) || has(Input::Vel) || has(Input::FeedForward);
    let ki = if pid { a.gainprm[0] } else { a.gainprm[5] };
    if pid && ki != 0.0 && a.dynamics != Dynamics::Pid || pid && a.dynamics == Dynamics::Pid && a.activations() == 0 {
        element.refuse(format!("ki is {ki} and its dyntype does not say so"), "give dyntype pid with ki or slewmax");
    }
    if (integrates || pid && slews) && !has(Input::Pos) {
        element.refuse("it follows a position, and is told none", "add pos to its inputs");
    }
    if motor {
        check_motor(a, (slews, told), element);
    }
}

/// Refuses a servo on an orientation that has none to turn.
fn check_servo(a: &Actuator, element: &mut Element) {
    let between = matches!(a.transmission, Transmission::Site { reference: Some(_), .. });
    if !between && !matches!(a.transmission, Transmission::Joint(_)) {
        element.refuse("it turns neither a ball joint nor a site against another", "give joint, or site and refsite");
    }
    if a.gainprm[0] != -a.biasprm[1] {
        let message = format!("gainprm {} and biasprm {} are not opposite", a.gainprm[0], a.biasprm[1]);
        element.refuse(message, "give biasprm as 0 -kp -kv");
    }
    if a.quaternion && a.dynamics != Dynamics::None {
        element.refuse("a quaternion that is integrated", "give input=\"expmap\", or dyntype none");
    }
    if a.forcerange.is_some_and(|range| range[0] != 0.0) {
        element.refuse("its forcerange bounds the length of its torque", "give 0 as the lower end");
    }
    if a.gear != [1.0, 0.0, 0.0, 0.0, 0.0, 0.0] || a.armature != 0.0 || a.damping != [0.0; 3] || a.inheritrange > 0.0 {
        element.refuse("it has no gear, armature, damping or inheritrange", "remove them");
    }
}

/// Refuses a motor without resistance, and a controller without a motor.
fn check_motor(a: &Actuator, (slews, told): (bool, bool), element: &mut Element) {
    let [resistance, constant, _, _, kp, ki, kd, most_voltage, ..] = a.gainprm;
    if resistance <= 0.0 {
        element.refuse(format!("its resistance is {resistance}"), "give resistance, or nominal");
    }
    if constant < 0.0 || constant == 0.0 && !a.inputs.is_empty() {
        element.refuse(format!("its torque constant is {constant}"), "give motorconst, or nominal");
    }
    element.not_negative("controller", &[most_voltage]);
    element.not_negative("dynprm", &a.dynprm[..4]);
    element.not_negative("dynprm", &a.dynprm[5..9]);
    if ([kp, ki, kd] != [0.0; 3] || slews) && !told {
        element.refuse("a controller that is told nothing", "add pos, vel or ff to its inputs");
    }
    let [_, _, _, moving, still, fades, ..] = a.biasprm;
    if a.dynprm[5] > 0.0 && (moving <= 0.0 || still <= 0.0 || fades <= 0.0) {
        let message = format!("bristles (lugre) with the friction {moving} {still} that fades by {fades}");
        element.refuse(message, "give positive coulomb, static and stribeck");
    }
    if a.dynprm[2] > 0.0 && a.dynprm[3] <= 0.0 {
        element.refuse("its winding stores no heat", "give a thermal capacitance");
    }
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
