//! Orientations, shapes, joints, frames, inertias and replicas.

use std::f64::consts::PI;

use super::{H, close, ok, rejects, world};
use crate::spec::{Inertia, JointKind, Spec, Tri};

fn geom_quat(compiler: &str, attributes: &str) -> [f64; 4] {
    let text = format!("<mujoco><compiler {compiler}/><worldbody><geom size='1' {attributes}/></worldbody></mujoco>");
    ok(&text).bodies[0].geoms[0].quat
}

#[test]
fn orientations() {
    close(&geom_quat("", "euler='10 20 30'"), &[0.943714, 0.127679, 0.144878, 0.268536]);
    close(&geom_quat("eulerseq='XYZ'", "euler='10 20 30'"), &[0.951549, 0.038135, 0.189308, 0.239298]);
    close(&geom_quat("", "zaxis='1 1 0'"), &[H, -0.5, 0.5, 0.0]);
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
    close(&capsule.quat, &[H, 0.0, -H, 0.0]);
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
    assert_eq!(joint("type='free' range='0 1'").range, Some([0.0, 1.0]));
    assert_eq!(joint("type='free' limited='true'").limited, Tri::False);
    assert_eq!(joint("stiffness='1 2' damping='3'").stiffness, [1.0, 2.0, 0.0]);
    rejects(&world("<joint/>"), "1: joint: the world cannot have a joint (put it in a body)");
    assert_eq!(joint("springyield='90'").springyield, 0.5 * PI);
    assert_eq!(joint("type='slide' springyield='90'").springyield, 90.0);
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
    close(&spec.bodies[1].quat, &[H, 0.0, 0.0, H]);
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
    close(&inertial.quat, &[H, 0.0, 0.0, H]);
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
    let bodies = "<worldbody><site name='w'/><geom name='h' type='plane' size='1 1 1'/><replicate count='2'>\
        <body name='b'><joint name='j'/><site name='s'/><geom name='g' size='.1'/><replicate count='2'><body name='c'><joint name='i'/>\
        </body></replicate></body></replicate><body name='k'><joint name='k'/></body></worldbody>";
    let spec = ok(&format!(
        "<mujoco>{bodies}<actuator><motor name='p' joint='k'/><motor name='m' joint='j'/><motor name='q' joint='i'/>\
         <motor name='r' joint='j'/><motor name='s' site='s' refsite='w'/></actuator><contact><pair name='x' geom1='h' geom2='g'/>\
         <exclude body1='world' body2='b'/></contact></mujoco>"
    ));
    let actuators: Vec<String> = spec
        .actuators
        .iter()
        .map(|a| {
            let sites = a.transmission.sites().into_iter().map(|(_, site)| site);
            let targets: Vec<&str> = a.transmission.joint().into_iter().chain(sites).collect();
            format!("{} {}", a.name, targets.join(" "))
        })
        .collect();
    let expected =
        ["p k", "m0 j0", "r0 j0", "s0 s0 w", "q00 i00", "q10 i10", "m1 j1", "r1 j1", "s1 s1 w", "q01 i01", "q11 i11"];
    assert_eq!(actuators, expected);
    let pairs: Vec<_> = spec.pairs.iter().map(|p| (&*p.name, &*p.geom1, &*p.geom2)).collect();
    assert_eq!(pairs, [("x0", "h", "g0"), ("x1", "h", "g1")]);
    let excludes: Vec<_> = spec.excludes.iter().map(|e| (&*e.body1, &*e.body2)).collect();
    assert_eq!(excludes, [("world", "b0"), ("world", "b1")]);
}
