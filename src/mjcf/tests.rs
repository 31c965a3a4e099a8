//! Tests of the front end. Numbers were computed by MuJoCo 4.0.0 from the same text.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use super::{LoadOptions, load, parse, parse_with_files};
use crate::spec::{Bias, Gain, GeomMass, Inertia, JointKind, Shape, Spec, Transmission, Tri};

fn world(body: &str) -> String {
    format!("<mujoco><worldbody>{body}</worldbody></mujoco>")
}

/// A model with a joint `j` and some sections.
fn with_joint(sections: &str) -> String {
    format!(
        "<mujoco>{sections}<worldbody><body><joint name=\"j\" range=\"-30 60\"/><geom name=\"g\" size=\".1\"/></body>\
         <geom name=\"h\" size=\".1\"/></worldbody></mujoco>"
    )
}

#[track_caller]
fn ok(text: &str) -> Spec {
    parse(text, &LoadOptions::default()).unwrap_or_else(|problems| panic!("{problems}\n{text}"))
}

fn lenient(text: &str) -> Spec {
    let options = LoadOptions { lenient: true, ..LoadOptions::default() };
    parse(text, &options).unwrap_or_else(|problems| panic!("{problems}\n{text}"))
}

/// The first problem is as expected.
#[track_caller]
fn rejects(text: &str, expected: &str) {
    let problems = parse(text, &LoadOptions::default()).expect_err("must be rejected");
    assert_eq!(problems.0[0].to_string(), expected, "in {text}");
}

#[track_caller]
fn close(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    for (a, b) in found.iter().zip(expected) {
        assert!((a - b).abs() < 2e-6, "{found:?} instead of {expected:?}");
    }
}

// ---- text and schema

#[test]
fn what_is_not_xml() {
    rejects("", "the file is empty (an MJCF file starts with <mujoco>)");
    rejects("  \n", "the file is empty (an MJCF file starts with <mujoco>)");
    rejects("garbage", "1: not well-formed XML: unknown token at 1:1");
    rejects("<mujoco>\n<worldbody", "1: not well-formed XML: the root node was opened but never closed");
    rejects(
        "<!DOCTYPE a [<!ENTITY b \"c\">]><mujoco/>",
        "1: not well-formed XML: XML with DTD detected (remove the document type declaration)",
    );
    rejects("<robot/>", "1: robot: the root element must be <mujoco>, not <robot>");
}

#[test]
fn tolerated_xml() {
    ok("<mujoco><!-- two -- dashes --->\n<worldbody/></mujoco>");
    assert_eq!(ok("<mujoco model=\"m\"version=\"1\"/>").name, "m");
    assert_eq!(ok("\u{feff}<mujoco/>").bodies.len(), 1);
    assert_eq!(ok(&world("text <geom size='.1'/>")).bodies[0].geoms.len(), 1);
}

#[test]
fn names_of_elements_and_attributes() {
    rejects(&world("<geom size='1' colour='1'/><body>\n</body>"), &{
        let valid = "adhesion, castshadow, conaffinity, condim, contype, density, fitscale, fluidcoef, fluidshape, \
            friction, fromto, gap, group, hfield, margin, mass, material, mesh, pos, priority, rgba, shellinertia, \
            size, solimp, solmix, solref, surfacevel, type, user, quat, axisangle, euler, xyaxes, zaxis, name, class";
        format!("1: geom: unknown attribute \"colour\" (valid: {valid})")
    });
    rejects(
        "<mujoco>\n<worldbody>\n<geom name='floor' frction='1'/></worldbody></mujoco>",
        "3: geom \"floor\": unknown attribute \"frction\" (did you mean \"friction\"?)",
    );
    rejects(&world("<boddy/>"), "1: boddy: unknown element in worldbody (did you mean \"body\"?)");
    rejects("<mujoco><worldboyd/></mujoco>", "1: worldboyd: unknown element in mujoco (did you mean \"worldbody\"?)");
    rejects("<mujoco><worldbody pos='0 0 0'/></mujoco>", "1: worldbody: worldbody has no attributes (remove them)");
    rejects(
        "<mujoco><option><flag/><flag/></option></mujoco>",
        "1: flag: a second flag in the same option (merge the two)",
    );
    assert_eq!(ok("<mujoco><world><geom size='1'/></world></mujoco>").notes, ["world is an old name of worldbody"]);
}

#[test]
fn problems_are_collected_and_capped() {
    let text = world(&"<geom foo='1' size='x'/>".repeat(40));
    let problems = parse(&text, &LoadOptions::default()).expect_err("bad").0;
    assert_eq!(problems.len(), 51);
    assert_eq!(problems[50].message, "30 more problems are not listed");
}

#[test]
fn forms_of_numbers() {
    let bad = |value: &str| {
        rejects(&world(&format!("<geom size='1' mass='{value}'/>")), &{
            let reason = match value {
                "1 2" => "expected 1 number, found 2".to_string(),
                "nan" | "inf" => format!("\"{value}\" is not a finite number"),
                "1e400" => "\"1e400\" is too large".to_string(),
                _ => format!("\"{value}\" is not a number"),
            };
            format!("1: geom: attribute \"mass\": {reason}")
        })
    };
    ["1 2", "nan", "inf", "1e400", "0x10", "1,2", "1f", "1d3", "1_0", "--1"].map(bad);
    for value in ["1", "+1", "1.", "1e0", " 1 ", "\t1\n"] {
        let spec = ok(&world(&format!("<geom size='1' mass='{value}'/>")));
        assert_eq!(spec.bodies[0].geoms[0].mass, GeomMass::Mass(1.0));
    }
    // Blank is as if it were absent.
    assert_eq!(ok(&world("<geom size='1' mass=''/>")).bodies[0].geoms[0].mass, GeomMass::Density(1000.0));
    rejects(&world("<geom contype='1.5'/>"), "1: geom: attribute \"contype\": \"1.5\" is not an integer");
    rejects(&world("<geom contype='4294967295'/>"), "1: geom: attribute \"contype\": \"4294967295\" is too large");
    assert_eq!(ok(&world("<geom contype='-1'/>")).bodies[0].geoms[0].contype, u32::MAX);
    rejects(&world("<geom pos='1 2'/>"), "1: geom: attribute \"pos\": expected 3 numbers, found 2");
    rejects(
        &world("<geom friction='1 2 3 4'/>"),
        "1: geom: attribute \"friction\": expected at most 3 numbers, found 4",
    );
    rejects(
        &world("<geom shellinertia='True'/>"),
        "1: geom: attribute \"shellinertia\": \"True\" is not one of true, false",
    );
    rejects(
        &world("<geom type='cube'/>"),
        "1: geom: attribute \"type\": \"cube\" is not one of plane, hfield, sphere, capsule, ellipsoid, cylinder, box, mesh, sdf",
    );
}

#[test]
fn hostile_sizes() {
    let many: String = (0..200).map(|i| format!(" a{i}='0'")).collect();
    rejects(&format!("<mujoco>\n<option{many}/></mujoco>"), "2: an element has more than 128 attributes");
    let deep = format!("{}{}", "<body>".repeat(10_000), "</body>".repeat(10_000));
    assert_eq!(ok(&world(&deep)).bodies.len(), 10_001);
    let too_deep = format!("{}{}", "<body>".repeat(60_000), "</body>".repeat(60_000));
    rejects(&world(&too_deep), "1: elements are nested more than 50000 deep");
    assert_eq!(ok(&world(&"<body><geom size='1'/></body>".repeat(20_000))).bodies.len(), 20_001);
    let huge = "<replicate count='2000000000' offset='1 0 0'><geom size='1'/></replicate>";
    rejects(&world(huge), "1: replicate: the model has more than 1000000 elements (replicate less)");
    let nested = format!("{}<geom/>{}", "<replicate count='100'>".repeat(9), "</replicate>".repeat(9));
    rejects(&world(&nested), "1: replicate: the model has more than 1000000 elements (replicate less)");
    let empty = format!("{}{}", "<replicate count='1000000'>".repeat(9), "</replicate>".repeat(9));
    rejects(&world(&empty), "1: replicate: the model has more than 1000000 elements (replicate less)");
}

// ---- orientations and shapes

fn geom_quat(compiler: &str, attributes: &str) -> [f64; 4] {
    let text = format!("<mujoco><compiler {compiler}/><worldbody><geom size='1' {attributes}/></worldbody></mujoco>");
    ok(&text).bodies[0].geoms[0].quat
}

#[test]
fn orientations() {
    close(&geom_quat("", "euler='10 20 30'"), &[0.943714, 0.127679, 0.144878, 0.268536]);
    close(&geom_quat("eulerseq='XYZ'", "euler='10 20 30'"), &[0.951549, 0.038135, 0.189308, 0.239298]);
    close(&geom_quat("", "zaxis='1 1 0'"), &[0.707107, -0.5, 0.5, 0.0]);
    close(&geom_quat("", "zaxis='0 0 -1'"), &[0.0, 1.0, 0.0, 0.0]);
    close(&geom_quat("", "quat='2 0 0 1'"), &[0.894427, 0.0, 0.0, 0.447214]);
    close(&geom_quat("", "axisangle='1 2 3 30'"), &[0.965926, 0.069172, 0.138344, 0.207516]);
    close(&geom_quat("angle='radian'", "axisangle='0 0 2 1'"), &[0.5f64.cos(), 0.0, 0.0, 0.5f64.sin()]);
    close(&geom_quat("", "xyaxes='1 2 0 1 1 1'"), &[0.462707, 0.713799, 0.441152, 0.285969]);
    rejects(&world("<geom quat='0 0 0 0'/>"), "1: geom: zero quaternion");
    rejects(&world("<geom zaxis='0 0 0'/>"), "1: geom: zaxis is too short");
    rejects(
        &world("<geom xyaxes='1 0 0 2 0 0'/>"),
        "1: geom: xyaxes: the y axis is too short or parallel to the x axis",
    );
    rejects(
        &world("<body quat='1 0 0 0' euler='0 0 0'/>"),
        "1: body: more than one orientation is given (keep one of quat, axisangle, euler, xyaxes, zaxis)",
    );
    rejects(
        "<mujoco><compiler eulerseq='xya'/></mujoco>",
        "1: compiler: attribute \"eulerseq\": must be three of x, y, z, X, Y, Z",
    );
}

#[test]
fn compiler_settings_hold_for_the_whole_model() {
    let text = "<mujoco><worldbody><geom euler='90 0 0' size='1'/></worldbody><compiler angle='radian'/></mujoco>";
    close(&ok(text).bodies[0].geoms[0].quat, &[0.525322, 0.850904, 0.0, 0.0]);
    rejects(
        "<mujoco><compiler coordinate='global'/></mujoco>",
        "1: compiler: attribute \"coordinate\": only local is supported",
    );
}

#[test]
fn shapes_between_two_points() {
    let geom = |attributes: &str| ok(&world(&format!("<geom {attributes}/>"))).bodies[0].geoms[0].clone();
    let capsule = geom("type='capsule' fromto='0 0 0 1 0 0' size='.1'");
    close(&capsule.quat, &[0.707107, 0.0, -0.707107, 0.0]);
    close(&capsule.pos, &[0.5, 0.0, 0.0]);
    close(&capsule.size, &[0.1, 0.5, 0.0]);
    close(&geom("type='box' fromto='0 0 0 1 0 0' size='1 .3 .4'").size, &[1.0, 1.0, 0.5]);
    close(&geom("type='ellipsoid' fromto='0 0 0 0 0 2' size='1'").quat, &[0.0, 1.0, 0.0, 0.0]);
    close(&geom("type='cylinder' fromto='0 0 0 0 2 2' size='1'").quat, &[0.382683, 0.923880, 0.0, 0.0]);
    geom("type='capsule' fromto='0 0 0 1 0 0' pos='0 0 0' size='.1'");
    let reject = |attributes: &str, message: &str| rejects(&world(&format!("<geom {attributes}/>")), message);
    reject("fromto='0 0 0 1 0 0'", "1: geom: fromto needs a capsule, cylinder, box or ellipsoid");
    reject("type='box' fromto='1 2 3 1 2 3'", "1: geom: the two points of fromto coincide");
    reject("type='box' fromto='0 0 0 1 0 0' pos='1 0 0'", "1: geom: both pos and fromto are given");
    let site = ok(&world("<site type='capsule' fromto='0 0 0 1 0 0' size='1'/>")).bodies[0].sites[0].clone();
    close(&site.size, &[1.0, 0.5, 0.005]);
    rejects(&world("<site type='plane'/>"), "1: site: a site cannot be a plane or height field");
}

// ---- defaults

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
    close(&geom("quat='0 1 0 0'", "euler='90 0 0'").quat, &[0.707107, 0.707107, 0.0, 0.0]);
    close(&geom("euler='90 0 0'", "quat='0 1 0 0'").quat, &[0.0, 1.0, 0.0, 0.0]);
    close(&geom("euler='90 0 0'", "zaxis='1 1 0'").quat, &[0.707107, -0.5, 0.5, 0.0]);
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

// ---- joints, frames, inertia

#[test]
fn angles_of_joints() {
    let joint =
        |attributes: &str| ok(&world(&format!("<body><joint {attributes}/></body>"))).bodies[1].joints[0].clone();
    let hinge = joint("range='-90 180' ref='90' springref='-180'");
    assert_eq!(hinge.range, Some([-0.5 * PI, PI]));
    assert_eq!((hinge.reference, hinge.springref), (0.5 * PI, -PI));
    assert_eq!(joint("type='slide' range='-9 90' ref='10'").range, Some([-9.0, 90.0]));
    assert_eq!(joint("type='slide' ref='10'").reference, 10.0);
    assert_eq!(joint("type='ball' range='0 90'").range, Some([0.0, 0.5 * PI]));
    assert_eq!(joint("range='0 0'").range, None);
    assert_eq!((joint("type='free' range='0 1'").range, joint("type='free'").limited), (None, Tri::False));
    assert_eq!(joint("stiffness='1 2' damping='3'").stiffness, [1.0, 2.0, 0.0]);
    rejects(&world("<joint/>"), "1: joint: the world cannot have a joint (put it in a body)");
    rejects(
        &world("<body><joint springyield='1'/></body>"),
        "1: joint: yielding springs (springyield) are not supported (a lenient load leaves it out)",
    );
}

#[test]
fn frames() {
    let frame = "<frame pos='1 2 3' euler='0 0 90'>";
    let spec = ok(&world(&format!(
        "{frame}<body pos='1 0 0' name='a'/><frame pos='1 0 0' euler='90 0 0'><body pos='1 1 0'/></frame></frame>\
         <body>{frame}<joint pos='.1 0 0' axis='1 0 0'/><geom type='capsule' fromto='0 0 0 1 0 0' size='.1'/>\
         <inertial pos='1 0 0' mass='1' diaginertia='1 1 1'/></frame></body>\
         <body>{frame}<joint type='free'/></frame></body>"
    )));
    close(&spec.bodies[1].pos, &[1.0, 3.0, 3.0]);
    close(&spec.bodies[1].quat, &[0.707107, 0.0, 0.0, 0.707107]);
    close(&spec.bodies[2].pos, &[1.0, 4.0, 4.0]);
    close(&spec.bodies[2].quat, &[0.5, 0.5, 0.5, 0.5]);
    close(&spec.bodies[3].joints[0].pos, &[1.0, 2.1, 3.0]);
    close(&spec.bodies[3].joints[0].axis, &[0.0, 1.0, 0.0]);
    close(&spec.bodies[3].geoms[0].pos, &[1.0, 2.5, 3.0]);
    close(&spec.bodies[3].geoms[0].quat, &[0.5, 0.5, -0.5, 0.5]);
    assert_eq!(spec.bodies[4].joints[0].kind, JointKind::Free);
    close(&spec.bodies[4].joints[0].pos, &[0.0; 3]);
    let inertial = spec.bodies[3].inertial.as_ref().expect("given");
    close(&inertial.pos, &[1.0, 3.0, 3.0]);
    close(&inertial.quat, &[0.707107, 0.0, 0.0, 0.707107]);
}

#[test]
fn inertias() {
    let inertial = |attributes: &str| world(&format!("<body><inertial {attributes}/></body>"));
    let full = ok(&world(
        "<body><frame euler='90 0 0'><inertial pos='0 0 0' mass='1' fullinertia='1 2 3 .1 .2 .3'/></frame></body>",
    ));
    // A quarter turn about x takes y to z and z to -y.
    match full.bodies[1].inertial.as_ref().expect("given").inertia {
        Inertia::Full(found) => close(&found, &[1.0, 3.0, 2.0, -0.2, 0.1, -0.3]),
        Inertia::Diagonal(_) => panic!("the inertia is full"),
    }
    rejects(&inertial("pos='0 0 0'"), "1: inertial: attribute \"mass\" is missing");
    rejects(&inertial("mass='1'"), "1: inertial: attribute \"pos\" is missing");
    rejects(
        &inertial("pos='0 0 0' mass='1' quat='1 0 0 0' fullinertia='1 1 1 0 0 0'"),
        "1: inertial: fullinertia does not go with diaginertia or an orientation (keep one)",
    );
    rejects(
        &world("<body><inertial pos='0 0 0' mass='1'/><inertial pos='0 0 0' mass='1'/></body>"),
        "1: inertial: a second inertial in the same body (merge the two)",
    );
}

// ---- replicas

fn body_names(spec: &Spec) -> Vec<&str> {
    spec.bodies.iter().map(|body| body.name.as_str()).collect()
}

#[test]
fn replicas_of_bodies() {
    let spec = ok(&world(
        "<replicate count='3' offset='1 0 0' euler='0 0 90'>\
         <body name='b' pos='0 0 1'><freejoint name='f'/><geom name='g' size='.1'/></body></replicate>",
    ));
    assert_eq!(body_names(&spec), ["world", "b0", "b1", "b2"]);
    close(&spec.bodies[2].pos, &[1.0, 0.0, 1.0]);
    close(&spec.bodies[3].pos, &[1.0, 1.0, 1.0]);
    close(&spec.bodies[3].quat, &[0.0, 0.0, 0.0, 1.0]);
    assert_eq!((&*spec.bodies[3].joints[0].name, &*spec.bodies[3].geoms[0].name), ("f2", "g2"));
    let spec = ok(&world(
        "<replicate count='2' offset='1 0 0'><body name='a'><replicate count='2' offset='0 1 0'><body name='b'/>\
         </replicate></body></replicate>",
    ));
    assert_eq!(body_names(&spec), ["world", "a0", "b00", "b10", "a1", "b01", "b11"]);
    let parents: Vec<usize> = spec.bodies.iter().map(|body| body.parent).collect();
    assert_eq!(parents, [0, 0, 1, 1, 0, 4, 4]);
    let ten = ok(&world("<replicate count='10' sep='-'><body name='b'/></replicate>"));
    assert_eq!((&*ten.bodies[1].name, &*ten.bodies[10].name), ("b-00", "b-09"));
    assert_eq!(ok(&world("<replicate count='0'><geom size='1'/></replicate>")).bodies[0].geoms.len(), 0);
}

#[test]
fn replicas_of_geoms() {
    let spec = ok(&world(
        "<geom name='x' size='1'/><replicate count='2' offset='1 0 0' sep='-'>\
         <replicate count='3' offset='0 1 0' sep='+' euler='0 0 10'><geom name='g' size='.1'/></replicate></replicate>\
         <geom name='y' size='1'/>",
    ));
    let geoms = &spec.bodies[0].geoms;
    let names: Vec<&str> = geoms.iter().map(|geom| geom.name.as_str()).collect();
    assert_eq!(names, ["x", "g+0-0", "g+1-0", "g+2-0", "g+0-1", "g+1-1", "g+2-1", "y"]);
    close(&geoms[3].pos, &[-0.173648, 1.984808, 0.0]);
    close(&geoms[6].quat, &[0.984808, 0.0, 0.0, 0.173648]);
    close(&geoms[6].pos, &[0.826352, 1.984808, 0.0]);
}

#[test]
fn replicas_within_a_body() {
    rejects(
        &world("<body><replicate count='2'><frame><joint/></frame></replicate></body>"),
        "1: joint: joint cannot be replicated within one body (replicate a body that holds it)",
    );
    rejects(&world("<replicate/>"), "1: replicate: attribute \"count\" is missing");
    rejects(&world("<replicate count='-1'/>"), "1: replicate: attribute \"count\": must not be negative");
}

#[test]
fn references_follow_replicas() {
    let bodies = "<worldbody><geom name='h' type='plane' size='1 1 1'/><replicate count='2'>\
        <body name='b'><joint name='j'/><geom name='g' size='.1'/><replicate count='2'><body name='c'><joint name='i'/>\
        </body></replicate></body></replicate><body name='k'><joint name='k'/></body></worldbody>";
    let spec = ok(&format!(
        "<mujoco>{bodies}<actuator><motor name='p' joint='k'/><motor name='m' joint='j'/><motor name='q' joint='i'/>\
         <motor name='r' joint='j'/></actuator><contact><pair name='x' geom1='h' geom2='g'/>\
         <exclude body1='world' body2='b'/></contact></mujoco>"
    ));
    let actuators: Vec<String> = spec
        .actuators
        .iter()
        .map(|a| match &a.transmission {
            Transmission::Joint(joint) | Transmission::JointInParent(joint) => format!("{} {joint}", a.name),
        })
        .collect();
    let expected = ["p k", "m0 j0", "r0 j0", "q00 i00", "q10 i10", "m1 j1", "r1 j1", "q01 i01", "q11 i11"];
    assert_eq!(actuators, expected);
    let pairs: Vec<_> = spec.pairs.iter().map(|p| (&*p.name, &*p.geom1, &*p.geom2)).collect();
    assert_eq!(pairs, [("x0", "h", "g0"), ("x1", "h", "g1")]);
    let excludes: Vec<_> = spec.excludes.iter().map(|e| (&*e.body1, &*e.body2)).collect();
    assert_eq!(excludes, [("world", "b0"), ("world", "b1")]);
}

// ---- actuators

/// Gain, bias, damping ratio and control range of an actuator with some defaults.
fn servo(defaults: &str, actuator: &str) -> ([f64; 3], [f64; 3], f64, Option<[f64; 2]>) {
    let text = with_joint(&format!("<default>{defaults}</default><actuator>{actuator}</actuator>"));
    let a = ok(&text).actuators[0].clone();
    (a.gainprm, a.biasprm, a.dampratio, a.ctrlrange)
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
    check("<motor/>", "1: motor: nothing to act on (give joint or jointinparent)");
    check("<damper joint='j'/>", "1: damper: a damper needs a ctrlrange");
    check("<damper joint='j' ctrlrange='-1 1'/>", "1: damper: the ctrlrange of a damper must not be negative");
    let missing = |what: &str| format!("{what} not supported (a lenient load leaves it out)");
    check("<motor name='a' tendon='t'/>", &missing("1: motor \"a\": transmission through a tendon is"));
    check("<muscle joint='j'/>", &missing("1: muscle: actuators of kind muscle are"));
    check("<position joint='j' timeconst='1'/>", &missing("1: position: activation states (dyntype, timeconst) are"));
    check("<motor joint='j' delay='.1'/>", &missing("1: motor: a delay is"));
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

// ---- contacts, keys, custom data, options

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
        <option gravity='1 2 3' integrator='RK4'><flag contact='disable' energy='enable'/></option></mujoco>";
    let option = ok(text).option;
    assert_eq!((option.timestep, option.gravity, option.actuatorgroupdisable), (0.1, [1.0, 2.0, 3.0], 0b1010));
    assert!(!option.flags.gravity && !option.flags.contact && option.flags.energy);
    rejects(
        "<mujoco><option integrator='euler'/></mujoco>",
        "1: option: attribute \"integrator\": \"euler\" is not one of Euler, RK4, implicit, implicitfast, discrete",
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
    assert!(bad.starts_with("unknown option \"timstep\" (did you mean \"timestep\"? valid: actuatorgroup"), "{bad}");
    let bad = with("contact", "no").expect_err("bad").to_string();
    assert_eq!(bad, "option \"contact\": \"no\" is not one of enable, disable");
}

// ---- what is left out

#[test]
fn losses() {
    let text = with_joint(
        "<asset><mesh name='m' file='m.stl'/></asset><tendon><fixed name='t'/></tendon><sensor><clock/></sensor>\
         <actuator><motor name='a' tendon='t'/><motor name='b' joint='j'/></actuator>\
         <worldbody><geom name='v' type='mesh' mesh='m'/><camera/><light/></worldbody>\
         <contact><pair geom1='v' geom2='g'/></contact><keyframe><key ctrl='1 2' act='3'/></keyframe>",
    );
    let spec = lenient(&text);
    assert_eq!(
        spec.losses,
        [
            "line 1: fixed \"t\": tendons are not supported, left out",
            "line 1: clock: sensors are not supported, left out",
            "line 1: mesh \"m\": meshes are not supported, left out",
            "line 1: motor \"a\": transmission through a tendon is not supported, left out",
            "line 1: geom \"v\": meshes are not supported, left out",
            "line 1: pair: geom \"v\" was left out, and so is this pair",
            "line 1: key: act left out with the actuators that it belongs to",
        ]
    );
    assert_eq!((spec.actuators.len(), spec.pairs.len()), (1, 0));
    assert_eq!(spec.keys[0].ctrl, Some(vec![2.0]));
    assert_eq!(spec.notes, ["1 cameras and 1 lights have no effect"]);
    rejects(&text, "1: fixed \"t\": tendons are not supported (a lenient load leaves it out)");
}

// ---- files

#[test]
fn includes_from_memory() {
    let files = |list: &[(&str, &str)]| -> BTreeMap<String, String> {
        list.iter().map(|&(name, text)| (name.to_string(), text.to_string())).collect()
    };
    let given = files(&[
        ("a.xml", "<x>\n<geom size='.2'/><include file='b.xml'/></x>"),
        ("b.xml", "<mujocoinclude><geom size='.3' mas='1'/></mujocoinclude>"),
    ]);
    let read = |text: &str, files: &BTreeMap<String, String>| parse_with_files(text, files, &LoadOptions::default());
    let text = world("<geom size='.1'/><include file='a.xml'/><geom size='.4'/>");
    let problem = read(&text, &given).expect_err("bad").to_string();
    assert_eq!(problem, "b.xml:1: geom: unknown attribute \"mas\" (did you mean \"mass\"?)");
    let given = files(&[("a.xml", "<x>\n<geom size='.2'/></x>")]);
    let spec = read(&text, &given).expect("good");
    let sizes: Vec<f64> = spec.bodies[0].geoms.iter().map(|geom| geom.size[0]).collect();
    assert_eq!(sizes, [0.1, 0.2, 0.4]);
    let source = &spec.bodies[0].geoms[1].source;
    assert_eq!((source.file.as_deref(), source.line), (Some("a.xml"), 2));
    let twice = world("<include file='a.xml'/>\n<include file='a.xml'/>");
    let problem = read(&twice, &given).expect_err("bad").to_string();
    assert_eq!(problem, "2: include: file \"a.xml\" was already included (include each file once)");
    rejects(&text, "1: include: file \"a.xml\": no such file among those given");
    rejects(&world("<include/>"), "1: include: attribute \"file\" is missing");
}

#[test]
fn includes_from_disk() {
    let folder = std::env::temp_dir().join(format!("lanesim-mjcf-{}", std::process::id()));
    std::fs::create_dir_all(folder.join("parts")).expect("a temporary folder");
    let write = |name: &str, text: &[u8]| std::fs::write(folder.join(name), text).expect("written");
    write("main.xml", b"<mujoco><include file='parts/a.xml'/></mujoco>");
    // The second file is found beside the one that includes it.
    write("parts/a.xml", b"<x><worldbody><include file='b.xml'/></worldbody></x>");
    write("parts/b.xml", b"<x><geom size='7'/></x>");
    write("self.xml", b"<mujoco><include file='./self.xml'/></mujoco>");
    write("utf16.xml", b"\xff\xfe<\0m\0");
    write("latin.xml", b"<mujoco model='\xe9'/>");
    let read = |name: &str| load(&folder.join(name), &LoadOptions::default());
    assert_eq!(read("main.xml").expect("good").bodies[0].geoms[0].size[0], 7.0);
    let problem = |name: &str| read(name).expect_err("bad").0[0].message.clone();
    assert_eq!(problem("self.xml"), "file \"./self.xml\" was already included");
    assert_eq!(problem("utf16.xml"), "the file is UTF-16, but must be UTF-8");
    assert_eq!(problem("latin.xml"), "the file is not UTF-8 at byte 15");
    assert!(problem("none.xml").starts_with("the file cannot be read: "));
    assert_eq!(problem("parts"), "the file cannot be read: not a regular file");
    std::fs::remove_dir_all(&folder).expect("removed");
}
