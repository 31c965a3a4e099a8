//! What the compiler refuses, and what it says.

use super::*;
use crate::diagnostics::Diagnostics;

/// Compiles a spec that must be refused, with `message` among what is said.
#[track_caller]
pub(super) fn check(spec: &Spec, message: &str) {
    let error = match Model::from_spec(spec) {
        Ok(_) => panic!("accepted; expected: {message}"),
        Err(error) => error.to_string(),
    };
    assert!(error.contains(message), "{error}\nexpected: {message}");
}

/// One body, changed by `change`, must be refused.
#[track_caller]
fn refuses(change: impl FnOnce(&mut Spec), message: &str) {
    let mut spec = single(vec![hinge()], vec![ball(0.1)]);
    change(&mut spec);
    check(&spec, message);
}

#[test]
fn refused_structure() {
    refuses(|s| s.bodies[1].parent = 1, "body \"a\": comes before its parent");
    refuses(|s| s.bodies[0].joints.push(hinge()), "the world cannot move");
    refuses(|s| s.bodies.clear(), "no world");
    refuses(|s| s.bodies.push(s.bodies[1].clone()), "body \"a\": repeated name");
    refuses(|s| s.bodies[1].joints.push(hinge()), "joint \"j\": repeated name");
    refuses(|s| s.bodies[1].mocap = true, "mocap body must be a child of the world without joints");
}

#[test]
fn refused_joints() {
    refuses(|s| s.bodies[1].joints.push(free()), "at most 6");
    refuses(|s| s.bodies[1].joints = vec![joint(JointKind::Ball, [0.0; 3]), hinge()], "ball joint is followed");
    refuses(|s| s.bodies[1].joints[0].axis = [0.0; 3], "axis has no direction");
    let reversed = |s: &mut Spec| {
        (s.bodies[1].joints[0].range, s.bodies[1].joints[0].limited) = (Some([1.0, -1.0]), Tri::True);
    };
    refuses(reversed, "joint \"j\": range is empty: 1 -1");
    refuses(|s| s.bodies[1].joints[0].limited = Tri::True, "range is empty");
    refuses(|s| s.bodies[1].joints[0].armature = -1.0, "armature is negative");
    refuses(|s| s.bodies[1].joints[0].damping[0] = -1.0, "damping is negative");
    refuses(|s| s.bodies[1].joints[0].frictionloss = -1.0, "frictionloss is negative");
    refuses(|s| s.bodies[1].joints[0].springdamper = [0.1, 0.0], "springdamper needs two");
    refuses(|s| s.bodies[1].joints[0].solreflimit = [0.02, -1.0], "solreflimit mixes");
    refuses(|s| s.bodies[1].joints[0].pos[2] = f64::NAN, "joint \"j\": pos is not finite");
    let ball = Joint { range: Some([0.1, 0.5]), ..joint(JointKind::Ball, [0.0; 3]) };
    refuses(|s| s.bodies[1].joints = vec![ball], "range of a ball joint");
    let unlimited = |s: &mut Spec| {
        s.compiler.autolimits = false;
        s.bodies[1].joints[0].range = Some([0.0, 1.0]);
    };
    refuses(unlimited, "autolimits is off");
    let nested = |s: &mut Spec| {
        s.add_body(
            1,
            Body {
                joints: vec![Joint { name: String::new(), ..free() }],
                geoms: vec![super::ball(0.1)],
                ..Body::default()
            },
        );
    };
    refuses(nested, "a free joint is only allowed in a child of the world");
}

#[test]
fn refused_geoms_and_sites() {
    refuses(|s| s.bodies[1].geoms[0].size[0] = 0.0, "geom #0: size 0 must be positive");
    refuses(|s| s.bodies[1].geoms[0].shape = Shape::Capsule, "size 1 must be positive");
    refuses(|s| s.bodies[1].geoms[0].shape = Shape::Plane, "a plane cannot move");
    refuses(|s| s.bodies[1].geoms[0].condim = 2, "condim is 2");
    refuses(|s| s.bodies[1].geoms[0].friction[1] = -0.1, "friction is negative");
    refuses(|s| s.bodies[1].geoms[0].quat = [0.0; 4], "quat has no direction");
    refuses(|s| s.bodies[1].geoms[0].mass = GeomMass::Mass(-1.0), "mass is negative");
    refuses(|s| s.bodies[1].geoms[0].solref = [0.0, 1.0], "solref mixes");
    refuses(|s| s.bodies[1].sites.push(Site { size: [0.0; 3], ..Site::default() }), "site #0: size 0");
}

#[test]
fn refused_masses() {
    refuses(|s| s.bodies[1].geoms[0].mass = GeomMass::Mass(0.0), "body \"a\": moves, but has no mass");
    refuses(|s| s.bodies[1].geoms[0].size[0] = 1e200, "overflows");
    let inertial = |inertia| {
        move |s: &mut Spec| {
            let (pos, quat, source) = ([0.0; 3], [1.0, 0.0, 0.0, 0.0], Source::default());
            s.bodies[1].inertial = Some(Inertial { pos, quat, mass: 1.0, inertia, source });
        }
    };
    refuses(inertial(Inertia::Diagonal([1.0, 1.0, 10.0])), "violates A + B >= C");
    refuses(inertial(Inertia::Diagonal([1.0, 1.0, 0.0])), "no mass or no inertia");
    refuses(inertial(Inertia::Diagonal([1.0, -1.0, 1.0])), "diaginertia is negative");
    refuses(inertial(Inertia::Full([1.0, 1.0, 1.0, 5.0, 5.0, 5.0])), "not positive definite");
    refuses(inertial(Inertia::Full([f64::NAN; 6])), "fullinertia is not finite");
}

#[test]
fn refused_options() {
    refuses(|s| s.option.timestep = 0.0, "option: timestep is 0");
    refuses(|s| s.option.timestep = f64::NAN, "timestep is NaN");
    refuses(|s| s.option.gravity[1] = f64::NAN, "gravity is not finite");
    refuses(|s| s.option.density = -1.2, "density is negative");
    refuses(
        |s| s.option.flags.diagexact = true,
        "diagexact: the exact diagonal of the constraint space is not supported",
    );
    refuses(|s| s.option.sleep_tolerance = f64::NAN, "sleep_tolerance");
    refuses(|s| s.option.viscosity = -1e-5, "viscosity is negative");
    refuses(|s| s.option.impratio = 0.0, "impratio is 0");
    refuses(|s| s.compiler.boundmass = -1.0, "boundmass is negative");
}

#[test]
fn refused_references() {
    let pair = |geom1: &str, geom2: &str| Pair { geom1: geom1.into(), geom2: geom2.into(), ..Pair::default() };
    refuses(|s| s.pairs.push(pair("x", "")), "geom1 names an unknown geom \"x\"");
    refuses(|s| s.pairs.push(pair("x", "")), "geom2 is missing");
    refuses(|s| s.pairs.push(pair("x", "x")), "paired with itself");
    let exclude = Exclude { body1: "a".into(), body2: "worl".into(), ..Exclude::default() };
    refuses(|s| s.excludes.push(exclude), "body2 names an unknown body \"worl\" (did you mean \"world\"?)");
    let motor = |target: &str| Actuator { transmission: Transmission::Joint(target.into()), ..Actuator::default() };
    refuses(|s| s.actuators.push(motor("k")), "unknown joint \"k\"");
    refuses(|s| s.actuators.push(motor("")), "acts on nothing");
    refuses(|s| s.actuators.push(Actuator { ctrllimited: Tri::True, ..motor("j") }), "ctrlrange is empty");
    refuses(|s| s.actuators.push(Actuator { inheritrange: 1.0, ..motor("j") }), "joint \"j\" has no range");
    // Half of what is infinite is nowhere: the control range was [-inf NaN].
    let half_open = |s: &mut Spec| {
        s.bodies[1].joints[0].range = Some([f64::NEG_INFINITY, 1.0]);
        s.actuators.push(Actuator { inheritrange: 1.0, ..motor("j") });
    };
    refuses(half_open, "inheritrange, but the range of joint \"j\" has an infinite end (give ctrlrange)");
    refuses(|s| s.actuators.push(Actuator { armature: -1.0, ..motor("j") }), "armature is negative");
    refuses(|s| s.keys.push(Key { qpos: Some(vec![0.0; 2]), ..Key::default() }), "qpos has 2 numbers, the model has 1");
    refuses(|s| s.keys.push(Key { ctrl: Some(vec![f64::NAN]), ..Key::default() }), "ctrl has 1 numbers");
}

#[test]
fn every_problem_is_named() {
    let mut spec = single(vec![Joint { axis: [0.0; 3], ..hinge() }], vec![ball(-1.0)]);
    spec.option.timestep = -1.0;
    spec.bodies[1].source = Source { file: Some("arm.xml".into()), line: 7 };
    spec.bodies[1].gravcomp = f64::NAN;
    let Diagnostics(list) = Model::from_spec(&spec).unwrap_err();
    let text: Vec<String> = list.iter().map(ToString::to_string).collect();
    assert!(text.len() >= 4, "{text:?}");
    assert!(text.contains(&"arm.xml:7: body \"a\": gravcomp is not finite (give finite numbers)".to_string()));
}

/// Constants that overflow, in double precision or rounded to single, have a place.
#[test]
fn numbers_that_overflow() {
    let problem = |text: &str| {
        Model::from_xml_string(text, &crate::mjcf::LoadOptions::default()).expect_err("overflows").to_string()
    };
    let world = |body: &str| format!("<mujoco><worldbody>\n<body name='a'>{body}</body></worldbody></mujoco>");
    let far = "<joint axis='1 0 0'/><geom pos='1e155 -.187 0' size='.15' mass='1'/>";
    assert!(problem(&world(far)).starts_with("2: body \"a\": "), "{}", problem(&world(far)));
    // m r² = 1e40 is finite in double precision only.
    let single = problem(&world("<joint name='j' axis='0 1 0'/><geom pos='1e20 0 0' size='.15' mass='1'/>"));
    assert!(single.contains("2: joint \"j\": inertia leaves the range of numbers"), "{single}");
    let heavy = problem(&world("<freejoint/><geom size='.1' mass='1e300'/>"));
    assert!(heavy.contains("2: body \"a\": mass leaves the range of numbers (of single precision, too)"), "{heavy}");
    let armed = problem(&world("<joint name='j' armature='1e39'/><geom size='.1'/>"));
    assert!(armed.contains("2: joint \"j\": armature leaves the range of numbers"), "{armed}");
    // Distances between geoms are squared.
    let ball = "<body><freejoint/><geom size='.1'/></body>";
    let still =
        problem(&format!("<mujoco><worldbody>{ball}\n<geom name='g' size='.1' pos='1e16 0 0'/></worldbody></mujoco>"));
    assert!(still.contains("2: geom \"g\": place or size leaves the range of numbers"), "{still}");
    let gear = "<actuator>\n<motor joint='j' gear='1e60'/></actuator>";
    let text = format!(
        "<mujoco><worldbody><body><joint name='j'/><geom size='.1' pos='1 0 0'/></body></worldbody>{gear}</mujoco>"
    );
    assert!(problem(&text).contains("2: actuator #0: gear leaves the range of numbers"), "{}", problem(&text));
    let gravity = "<mujoco>\n<option gravity='0 0 -1e39'/></mujoco>";
    assert!(problem(gravity).contains("2: option: gravity leaves the range of numbers"), "{}", problem(gravity));
    // Large, but in range.
    let large = world("<freejoint/><geom size='.1' mass='1e30'/>");
    assert!(Model::from_xml_string(&large, &crate::mjcf::LoadOptions::default()).is_ok());
}

/// A step that is no number in single precision steps nothing, or everything away.
#[test]
fn refused_options_out_of_range() {
    for x in [1e-300, 1e-40, 1e300] {
        refuses(|s| s.option.timestep = x, "option: timestep leaves the range of numbers");
        refuses(|s| s.option.impratio = x, "option: impratio leaves the range of numbers");
    }
}

/// However many problems there are, some are listed and the rest counted; what is said of an element is said once.
#[test]
fn problems_are_capped() {
    let many = |count: usize| {
        let mut spec = single(vec![hinge()], vec![ball(0.1); count]);
        spec.bodies[1].geoms.iter_mut().for_each(|geom| (geom.name, geom.size) = (String::new(), [0.0; 3]));
        let Diagnostics(list) = Model::from_spec(&spec).unwrap_err();
        (list.len(), list.last().map(|last| last.message.clone()).unwrap_or_default())
    };
    assert_eq!(many(51).0, 51);
    assert_eq!(many(1000), (51, "950 more problems are not listed".to_string()));
    let mut spec = single(vec![free()], vec![ball(0.1)]);
    spec.bodies[0].geoms = vec![ball(0.1); 10];
    spec.bodies[0].geoms.iter_mut().for_each(|geom| geom.name.clear());
    spec.bodies[1].geoms[0].margin = 1e300;
    let problems = Model::from_spec(&spec).unwrap_err().to_string();
    let mut lines: Vec<&str> = problems.lines().collect();
    lines.sort_unstable();
    lines.dedup();
    assert_eq!(lines.len(), problems.lines().count(), "{problems}");
}

/// A model's keyframes are kept in full, so that many short ones of a large model would take any amount of memory.
#[test]
fn keyframes_without_a_bound() {
    let mut spec = single(vec![hinge()], vec![ball(0.1)]);
    spec.keys = vec![Key::default(); 5_000_001];
    check(&spec, "key #5000000: 5000001 keyframes of 2 numbers each are more than can be kept (give at most 5000000)");
}

/// Names of any length and content stay out of messages.
#[test]
fn long_names_are_shortened() {
    let mut spec = single(vec![hinge()], vec![ball(0.1)]);
    spec.bodies[1].geoms[0].name = "g\u{1b}".repeat(1_000_000);
    spec.bodies[1].geoms[0].condim = 2;
    let actuator = Actuator { transmission: Transmission::Joint("j".repeat(1_000_000)), ..Actuator::default() };
    spec.actuators.push(actuator);
    let problems = Model::from_spec(&spec).unwrap_err().to_string();
    assert!(problems.len() < 1000 && !problems.contains('\u{1b}'), "{}", problems.len());
}
