//! Default classes, contacts, keyframes, custom data, options, losses.

use super::{H, LoadOptions, close, lenient, ok, parse, rejects, with_joint, world};
use crate::spec::{GeomMass, Shape};

#[test]
fn default_classes() {
    let text = "<mujoco><worldbody>\
        <geom/><geom class='a'/><geom class='b' type='sphere'/>\
        <body childclass='a'><geom/><frame childclass='b'><geom/></frame><body><geom class='main'/></body></body>\
        </worldbody>\
        <default><default class='a'><geom type='box'/><default class='b'><geom size='9'/></default></default>\
        <geom size='3 4 5'/></default></mujoco>";
    let spec = ok(text);
    let sizes: Vec<(Shape, [f64; 3])> =
        spec.bodies.iter().flat_map(|body| body.geoms.iter().map(|geom| (geom.shape, geom.size))).collect();
    let (small, large) = ([3.0, 4.0, 5.0], [9.0, 4.0, 5.0]);
    assert_eq!(
        sizes,
        [
            (Shape::Sphere, small),
            (Shape::Box, small),
            (Shape::Sphere, large),
            (Shape::Box, small),
            (Shape::Box, large),
            (Shape::Sphere, small),
        ]
    );
}

#[test]
fn defaults_of_orientation_and_mass() {
    let geom = |default: &str, attributes: &str| {
        let text = format!(
            "<mujoco><default><geom {default}/></default><worldbody><geom size='1' {attributes}/></worldbody></mujoco>"
        );
        ok(&text).bodies[0].geoms[0].clone()
    };
    close(&geom("quat='0 1 0 0'", "euler='90 0 0'").quat, &[H, H, 0.0, 0.0]);
    close(&geom("euler='90 0 0'", "quat='0 1 0 0'").quat, &[0.0, 1.0, 0.0, 0.0]);
    close(&geom("euler='90 0 0'", "zaxis='1 1 0'").quat, &[H, -0.5, 0.5, 0.0]);
    assert_eq!(geom("mass='3'", "density='4'").mass, GeomMass::Mass(3.0));
    assert_eq!(geom("friction='1 2 3' solimp='.1'", "friction='9'").friction, [9.0, 2.0, 3.0]);
}

#[test]
fn bad_classes() {
    rejects(&world("<geom class='nope'/>"), "1: geom: unknown default class \"nope\" (valid: main)");
    rejects(&world("<body childclass='mian'/>"), "1: body: unknown default class \"mian\" (did you mean \"main\"?)");
    rejects(
        "<mujoco><default class='x'/></mujoco>",
        "1: default: the class at the top must be called main (nest the class in a default)",
    );
    rejects("<mujoco><default><default/></default></mujoco>", "1: default: a nested default needs a class");
    rejects(
        "<mujoco><default><default class='a'/><default class='a'/></default></mujoco>",
        "1: default: class \"a\" is defined twice",
    );
    rejects(
        "<mujoco><default><geom/><geom/></default></mujoco>",
        "1: geom: a second geom in the same default (merge the two)",
    );
}

#[test]
fn pairs() {
    let spec = ok(&with_joint(
        "<default><pair friction='.1 .2' condim='4'/></default>\
         <contact><pair geom1='g' geom2='h' friction='3'/></contact>",
    ));
    assert_eq!(spec.pairs[0].friction, [3.0, 0.2, 0.005, 1e-4, 1e-4]);
    assert_eq!((spec.pairs[0].condim, spec.pairs[0].source.line), (4, 1));
    rejects(&with_joint("<contact><pair geom1='g'/></contact>"), "1: pair: attribute \"geom2\" is missing");
    rejects(&with_joint("<contact><exclude body1='g'/></contact>"), "1: exclude: attribute \"body2\" is missing");
}

#[test]
fn keyframes() {
    let spec = ok(&with_joint("<keyframe><key name='a' time='1' qpos='1' ctrl=''/><key/></keyframe>"));
    assert_eq!((spec.keys[0].qpos.clone(), spec.keys[0].ctrl.clone()), (Some(vec![1.0]), None));
    assert_eq!((spec.keys.len(), spec.keys[0].time), (2, 1.0));
    let sized = |n: &str| with_joint(&format!("<size nkey='{n}'/><keyframe><key/></keyframe>"));
    assert_eq!([ok(&sized("3")).keys.len(), ok(&sized("0")).keys.len(), ok(&sized("-1")).keys.len()], [3, 1, 1]);
    rejects(&sized("1000000000"), "1: size: nkey is 1000000000, more than 10000");
}

#[test]
fn custom_data() {
    ok("<mujoco><custom><numeric name='a' size='3'/><text name='t' data='x'/></custom></mujoco>");
    ok("<mujoco><custom><text name='lanesim.family' data='accel'/></custom></mujoco>");
    rejects(
        "<mujoco><custom><text name='lanesim.famly' data='accel'/></custom></mujoco>",
        "1: text \"lanesim.famly\": unknown name \"lanesim.famly\" (did you mean \"lanesim.family\"?)",
    );
    rejects(
        "<mujoco><custom><text name='lanesim.family' data='x'/></custom></mujoco>",
        "1: text \"lanesim.family\": attribute \"data\": \"x\" is not one of accel, velocity",
    );
}

#[test]
fn options_and_flags() {
    let text = "<mujoco><option timestep='.1' actuatorgroupdisable='1 3'><flag gravity='disable'/></option>\
        <option gravity='1 2 3' integrator='Euler'><flag contact='disable' energy='enable'/></option></mujoco>";
    let option = ok(text).option;
    assert_eq!((option.timestep, option.gravity, option.actuatorgroupdisable), (0.1, [1.0, 2.0, 3.0], 0b1010));
    assert!(!option.flags.gravity && !option.flags.contact && option.flags.energy);
    rejects(
        "<mujoco><option integrator='euler'/></mujoco>",
        "1: option: attribute \"integrator\": \"euler\" is not one of Euler, RK4, implicit, implicitfast, discrete, midpoint; did you mean \"Euler\"?",
    );
    rejects("<mujoco><option iterations='-1'/></mujoco>", "1: option: attribute \"iterations\": -1 is negative");
}

#[test]
fn overrides() {
    let with = |name: &str, value: &str| {
        let overrides = vec![(name.to_string(), value.to_string())];
        parse("<mujoco/>", &LoadOptions { lenient: false, overrides })
    };
    assert_eq!(with("timestep", "0.5").expect("good").option.timestep, 0.5);
    assert_eq!(with("gravity", "0 0 1").expect("good").option.gravity, [0.0, 0.0, 1.0]);
    assert!(!with("gravity", "disable").expect("good").option.flags.gravity);
    assert!(!with("contact", "disable").expect("good").option.flags.contact);
    let bad = with("timstep", "1").expect_err("bad").to_string();
    assert_eq!(bad, "unknown option \"timstep\" (did you mean \"timestep\"?)");
    let bad = with("bogus", "1").expect_err("bad").to_string();
    assert_eq!(bad, "unknown option \"bogus\" (give an attribute of MJCF's option or flag)");
    let bad = with("timestep", " ").expect_err("nothing given").to_string();
    assert_eq!(bad, "option \"timestep\" has no value (give one, or leave the option out)");
    let both = |pairs: [(&str, &str); 2]| {
        let overrides = pairs.map(|(name, value)| (name.to_string(), value.to_string())).to_vec();
        parse("<mujoco/>", &LoadOptions { lenient: false, overrides })
    };
    let bad = both([("timestep", "1"), ("timestep", "2")]).expect_err("which?").to_string();
    assert_eq!(bad, "option \"timestep\" is given both as \"1\" and as \"2\" (give it once)");
    assert_eq!(both([("timestep", "1"), ("timestep", "1 ")]).expect("no contradiction").option.timestep, 1.0);
    both([("gravity", "0 0 1"), ("gravity", "disable")]).expect("an option and a flag");
    let list = |pairs: &[(&str, &str)]| pairs.iter().map(|(n, v)| (n.to_string(), v.to_string())).collect::<Vec<_>>();
    let earlier = list(&[("gravity", "0 0 1"), ("timestep", "1"), ("gravity", "disable")]);
    let replaced = crate::mjcf::replace_overrides(&earlier, &list(&[("timestep", "2"), ("gravity", "enable")]));
    assert_eq!(replaced, list(&[("gravity", "0 0 1"), ("timestep", "2"), ("gravity", "enable")]));
    let bad = with("contact", "no").expect_err("bad").to_string();
    assert_eq!(bad, "option \"contact\": \"no\" is not one of enable, disable");
}

#[test]
fn losses() {
    let text = with_joint(
        "<equality><flex name='t'/></equality><sensor><clock/></sensor>\
         <actuator><plugin name='a' joint='j'/><motor name='b' joint='j'/></actuator>\
         <worldbody><geom name='v' type='sdf'/><camera/><light/></worldbody>\
         <contact><pair geom1='v' geom2='g'/></contact><keyframe><key ctrl='1 2' act='3'/></keyframe>",
    );
    let spec = lenient(&text);
    assert_eq!(
        spec.losses,
        [
            "line 1: flex \"t\": this kind of equality constraint is not supported, left out",
            "line 1: plugin \"a\": actuators of kind plugin are not supported, left out",
            "line 1: geom \"v\": signed distance fields are not supported, left out with its contacts",
            "line 1: pair: geom \"v\" was left out, and so is this pair",
            "line 1: key: act left out with the actuators that it belongs to",
        ]
    );
    assert_eq!((spec.actuators.len(), spec.pairs.len()), (1, 0));
    assert_eq!(spec.keys[0].ctrl, Some(vec![2.0]));
    assert_eq!(spec.notes, ["1 cameras and 1 lights have no effect"]);
    rejects(&text, "1: flex \"t\": this kind of equality constraint is not supported (a lenient load leaves it out)");
}
