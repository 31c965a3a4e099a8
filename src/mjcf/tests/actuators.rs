//! Actuators and their shortcuts.

use super::{ok, rejects, with_joint};
use crate::spec::{Actuator, Bias, Dynamics, Gain, Transmission, Tri};

/// Gain, bias, damping ratio and control range of an actuator with some defaults.
fn servo(defaults: &str, actuator: &str) -> ([f64; 3], [f64; 3], f64, Option<[f64; 2]>) {
    let text = with_joint(&format!("<default>{defaults}</default><actuator>{actuator}</actuator>"));
    let a = ok(&text).actuators[0].clone();
    let first = |prm: [f64; 10]| [prm[0], prm[1], prm[2]];
    (first(a.gainprm), first(a.biasprm), a.dampratio, a.ctrlrange)
}

#[test]
fn shortcuts() {
    let check = |defaults: &str, actuator: &str, gain: [f64; 3], bias: [f64; 3]| {
        let found = servo(defaults, actuator);
        assert_eq!((found.0, found.1), (gain, bias), "{defaults} {actuator}");
    };
    let position = "<position joint='j'/>";
    check("", position, [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]);
    check("", "<position joint='j' kp='3' kv='2'/>", [3.0, 0.0, 0.0], [0.0, -3.0, -2.0]);
    check("<position kp='5' kv='2'/>", "<position joint='j' kp='7'/>", [7.0, 0.0, 0.0], [0.0, -7.0, -2.0]);
    check("<general gainprm='5' biasprm='0 -5 -1'/>", position, [5.0, 0.0, 0.0], [0.0, -5.0, -1.0]);
    check("<velocity kv='5'/>", position, [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]);
    check("<general gainprm='5' biastype='affine' biasprm='1 2 3'/>", "<motor joint='j'/>", [1.0, 0.0, 0.0], [0.0; 3]);
    check("<position kp='5' kv='2'/>", "<general joint='j'/>", [5.0, 0.0, 0.0], [0.0, -5.0, -2.0]);
    check("<position kp='5' kv='2'/>", "<velocity joint='j'/>", [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]);
    check("<general gainprm='2'/>", "<velocity joint='j'/>", [2.0, 0.0, 0.0], [0.0, 0.0, -2.0]);
    check("<damper kv='5'/>", "<damper joint='j' ctrlrange='0 1'/>", [0.0, 0.0, -5.0], [0.0; 3]);
    let nested = "<position kp='5' kv='2'/><default class='a'><velocity kv='8'/><default class='b'>\
        <position ctrlrange='0 1'/></default></default>";
    check(nested, "<position joint='j' class='b'/>", [5.0, 0.0, 0.0], [0.0, -5.0, -2.0]);
    check(nested, "<general joint='j' class='a'/>", [8.0, 0.0, 0.0], [0.0, 0.0, -8.0]);
    let general = "<general gainprm='9' biasprm='1 2 3'/><default class='a'><position kv='1'/></default>";
    check(general, "<position joint='j' class='a'/>", [9.0, 0.0, 0.0], [0.0, -9.0, -1.0]);
}

#[test]
fn damping_ratios_and_inherited_ranges() {
    assert_eq!(servo("", "<position joint='j' dampratio='1'/>").2, 1.0);
    assert_eq!(servo("<position dampratio='1'/>", "<position joint='j' kv='1'/>").2, 0.0);
    assert_eq!(servo("", "<general joint='j' gainprm='2' biastype='affine' biasprm='0 -2 3'/>").2, 3.0);
    assert_eq!(servo("", "<general joint='j' gainprm='2' biastype='affine' biasprm='0 -1 3'/>").1[2], 3.0);
    let inherit = |defaults: &str, actuator: &str| {
        let text = with_joint(&format!("<default>{defaults}</default><actuator>{actuator}</actuator>"));
        ok(&text).actuators[0].inheritrange
    };
    assert_eq!(inherit("<position inheritrange='.5'/>", "<position joint='j'/>"), 0.5);
    assert_eq!(inherit("<position inheritrange='.5'/>", "<motor joint='j'/>"), 0.0);
    assert_eq!(inherit("<position inheritrange='.5'/>", "<position joint='j' ctrlrange='0 1'/>"), 0.0);
    assert_eq!(inherit("", "<general joint='j' inheritrange='1'/>"), 0.0);
    let range = servo("<position ctrlrange='0 1'/>", "<position joint='j' inheritrange='1'/>").3;
    assert_eq!(range, None);
}

#[test]
fn bad_actuators() {
    let check = |actuator: &str, message: &str| {
        rejects(&with_joint(&format!("<actuator>{actuator}</actuator>")), message);
    };
    check("<position joint='j' kv='1' dampratio='1'/>", "1: position: both kv and dampratio are given (keep one)");
    check(
        "<position joint='j' ctrlrange='0 1' inheritrange='1'/>",
        "1: position: both ctrlrange and inheritrange are given (keep one)",
    );
    check("<motor/>", "1: motor: nothing to act on (give joint, jointinparent, tendon, site, cranksite or body)");
    check("<damper joint='j'/>", "1: damper: a damper needs a ctrlrange");
    check("<damper joint='j' ctrlrange='-1 1'/>", "1: damper: the ctrlrange of a damper must not be negative");
    let missing = |what: &str| format!("{what} not supported (a lenient load leaves it out)");
    check("<plugin name='a' joint='j'/>", &missing("1: plugin \"a\": actuators of kind plugin are"));
    check(
        "<motor slidersite='s'/>",
        "1: motor: nothing to act on (give joint, jointinparent, tendon, site, cranksite or body)",
    );
    check(
        "<motor joint='j' refsite='s'/>",
        "1: motor: attribute \"refsite\" does not go with joint (remove it, or give site)",
    );
    check(
        "<motor site='s' cranklength='1'/>",
        "1: motor: attribute \"cranklength\" does not go with site (remove it, or give cranksite)",
    );
    check(
        "<motor cranksite='s'/>",
        "1: motor: a crank without a slide (give slidersite, along whose z axis the rod's end moves)",
    );
    check("<motor joint='j' nsample='-1'/>", "1: motor: nsample must not be negative (give 0 for none)");
}

#[test]
fn general_actuators() {
    let text = with_joint(
        "<actuator><general name='a' jointinparent='j' gear='2 3' gaintype='affine' gainprm='1 2 3' ctrlrange='-90 90' \
         forcerange='0 0' forcelimited='false' damping='1 2' armature='3' group='4'/></actuator>",
    );
    let a = ok(&text).actuators[0].clone();
    assert_eq!((a.gain, a.bias, a.transmission), (Gain::Affine, Bias::None, Transmission::JointInParent("j".into())));
    assert_eq!((a.gear, a.ctrlrange), ([2.0, 3.0, 0.0, 0.0, 0.0, 0.0], Some([-90.0, 90.0])));
    assert_eq!((a.forcerange, a.forcelimited), (None, Tri::False));
    assert_eq!((a.damping, a.armature, a.group), ([1.0, 2.0, 0.0], 3.0, 4));
}

/// Dynamics, their parameters, and those of gain and bias.
#[test]
fn activations() {
    let read = |defaults: &str, actuator: &str| {
        let text = with_joint(&format!("<default>{defaults}</default><actuator>{actuator}</actuator>"));
        ok(&text).actuators[0].clone()
    };
    let check = |defaults: &str, actuator: &str, dynamics: Dynamics, prm: [f64; 3]| {
        let a = read(defaults, actuator);
        assert_eq!((a.dynamics, &a.dynprm[..3]), (dynamics, &prm[..]), "{defaults} {actuator}");
    };
    check("", "<motor joint='j'/>", Dynamics::None, [1.0, 0.0, 0.0]);
    check("", "<general joint='j' dyntype='filter' dynprm='2'/>", Dynamics::Filter, [2.0, 0.0, 0.0]);
    check("<general dyntype='filter' dynprm='2'/>", "<motor joint='j'/>", Dynamics::None, [1.0, 0.0, 0.0]);
    let position = "<position joint='j'/>";
    check("<position timeconst='.3'/>", position, Dynamics::FilterExact, [0.3, 0.0, 0.0]);
    check("<position timeconst='.3'/>", "<position joint='j' timeconst='0'/>", Dynamics::None, [0.0; 3]);
    check("<velocity/>", position, Dynamics::None, [1.0, 0.0, 0.0]);
    check("", "<intvelocity joint='j'/>", Dynamics::Integrator, [1.0, 0.0, 0.0]);
    check("", "<cylinder joint='j' timeconst='3'/>", Dynamics::Filter, [3.0, 0.0, 0.0]);
    check("", "<muscle joint='j'/>", Dynamics::Muscle, [0.01, 0.04, 0.0]);
    check("", "<muscle joint='j' timeconst='-1 .1' tausmooth='.2'/>", Dynamics::Muscle, [0.01, 0.1, 0.2]);
    let cylinder = read("<cylinder area='3' bias='1 2 3'/>", "<cylinder joint='j'/>");
    assert_eq!((cylinder.gainprm[0], &cylinder.biasprm[..3]), (3.0, &[1.0, 2.0, 3.0][..]));
    assert_eq!(read("", "<cylinder joint='j' area='3' diameter='2'/>").gainprm[0], std::f64::consts::PI);
    let muscle = read("<muscle force='4' lmin='.3'/>", "<muscle joint='j' scale='7' range='.5 .9'/>");
    let expected = [0.5, 0.9, 4.0, 7.0, 0.3, 1.6, 1.5, 1.3, 1.2, 0.0];
    assert_eq!(
        (muscle.gain, muscle.gainprm, muscle.bias, muscle.biasprm),
        (Gain::Muscle, expected, Bias::Muscle, expected)
    );
    let early = read(
        "",
        "<general joint='j' dyntype='integrator' actearly='true' actrange='1 2' actlimited='false' actdim='1'/>",
    );
    assert_eq!((early.actearly, early.actrange, early.actlimited), (true, Some([1.0, 2.0]), Tri::False));
    let Actuator { inheritrange, actrange, .. } = read("<intvelocity inheritrange='1'/>", "<intvelocity joint='j'/>");
    assert_eq!((inheritrange, actrange), (1.0, None));
}
