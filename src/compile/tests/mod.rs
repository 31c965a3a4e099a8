//! The compiler as a whole, against figures of MuJoCo 4.0.0.

mod ranges;
mod refused;
mod tendons;

use lanesim_kernels::constraint::DofRowKind;
use lanesim_kernels::model::{AxisKind, NONE, Shape as KernelShape, Span};

use crate::model::{ArrayData, Model};
use crate::spec::*;

fn body(parent: usize, pos: [f64; 3]) -> Body {
    Body { parent, pos, ..Body::default() }
}

fn ball(radius: f64) -> Geom {
    Geom { size: [radius, 0.0, 0.0], ..Geom::default() }
}

/// The box 0.1 0.2 0.3 at x = 0.5.
fn brick() -> Geom {
    Geom { shape: Shape::Box, size: [0.1, 0.2, 0.3], pos: [0.5, 0.0, 0.0], ..Geom::default() }
}

fn joint(kind: JointKind, axis: [f64; 3]) -> Joint {
    Joint { name: "j".into(), kind, axis, ..Joint::default() }
}

fn hinge() -> Joint {
    joint(JointKind::Hinge, [0.0, 0.0, 1.0])
}

fn free() -> Joint {
    joint(JointKind::Free, [0.0, 0.0, 1.0])
}

/// One body on the world with these joints and geoms.
fn single(joints: Vec<Joint>, geoms: Vec<Geom>) -> Spec {
    let mut spec = Spec::new("single");
    spec.add_body(0, Body { name: "a".into(), joints, geoms, ..Body::default() });
    spec
}

#[track_caller]
fn model(spec: &Spec) -> Model {
    Model::from_spec(spec).unwrap_or_else(|e| panic!("{e}"))
}

#[track_caller]
fn reals(model: &Model, name: &str) -> Vec<f64> {
    match &model.array(name).unwrap_or_else(|| panic!("no array {name}")).data {
        ArrayData::F64(data) => data.clone(),
        ArrayData::I32(data) => data.iter().map(|&x| x as f64).collect(),
    }
}

/// Compares an array with MuJoCo's.
#[track_caller]
fn agrees(model: &Model, name: &str, expected: &[f64]) {
    let got = reals(model, name);
    assert_eq!(got.len(), expected.len(), "{name}: {got:?}");
    let scale = expected.iter().fold(1e-3, |m: f64, x| m.max(x.abs()));
    let error = got.iter().zip(expected).fold(0.0, |m: f64, (a, b)| m.max((a - b).abs()));
    assert!(error <= 1e-13 * scale, "{name}: {got:?} instead of {expected:?}");
}

#[test]
fn nothing_at_all() {
    let model = model(&Spec::new(""));
    for size in [("nq", 0), ("nv", 0), ("nu", 0), ("na", 0), ("nbody", 1)] {
        assert!(model.sizes().contains(&size), "{size:?}");
    }
    assert_eq!(model.tables_f32().links.len(), 0);
}

#[test]
fn bodies_are_numbered_depth_first() {
    let mut spec = Spec::new("order");
    for (name, parent) in [("a", 0), ("b", 0), ("a1", 1), ("b1", 2), ("a2", 1)] {
        spec.add_body(parent, Body { name: name.into(), ..Body::default() });
    }
    let model = model(&spec);
    let names: Vec<&str> = model.names().bodies.iter().collect();
    assert_eq!(names, ["world", "a", "a1", "a2", "b", "b1"]);
    agrees(&model, "body_parentid", &[0.0, 0.0, 1.0, 1.0, 0.0, 4.0]);
}

#[test]
fn jointless_bodies_ride_on_links() {
    let mut spec = single(vec![joint(JointKind::Hinge, [1.0, 0.0, 1.0])], vec![brick()]);
    spec.add_body(1, Body { geoms: vec![brick()], ..body(0, [1.0; 3]) });
    spec.add_body(2, body(0, [2.0; 3]));
    let model = model(&spec);
    let weights = [
        0.0,
        0.0,
        0.0006626378286683628,
        0.005301102629346903,
        0.005963740458015266,
        0.005301102629346903,
        0.13252756573367258,
        0.005301102629346903,
    ];
    agrees(&model, "body_invweight0", &weights);
    agrees(&model, "dof_invweight0", &[0.015903307888040712]);
    agrees(&model, "dof_M0", &[62.879999999999995]);
    let link = &model.tables().links[0];
    assert_eq!((link.mass, link.com), (96.00000000000001, [1.0, 0.5, 0.5]));
    let place = model.placements().bodies[3];
    assert_eq!((place.link, place.pos), (0, [3.0; 3]));
}

/// Figures of MuJoCo 4.0.0: a body that only slides weighs in every direction, unless it stands on several bodies that stand still.
#[test]
fn weights_of_a_slide_by_what_it_stands_on() {
    let weight = |before: &str, after: &str| {
        let body =
            "<inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/><joint type='slide' axis='0 0 1'/><geom size='.1'/>";
        let text = format!("<mujoco><worldbody>{before}<body>{body}</body>{after}</worldbody></mujoco>");
        let model = crate::Model::from_xml_string(&text, &Default::default()).expect("a model");
        let array = model.array("body_invweight0").map(|array| array.data.clone());
        let Some(crate::model::ArrayData::F64(weights)) = array else { panic!("no weights") };
        weights[weights.len() - 2]
    };
    assert_eq!(weight("", ""), 1.0);
    assert_eq!(weight("<body>", "</body>"), 1.0);
    assert_eq!(weight("<body mocap='true'>", "</body>"), 1.0);
    assert_eq!(weight("<body><body>", "</body></body>"), 1.0 / 3.0);
}

#[test]
fn weights_of_a_ball_and_a_free_joint() {
    let motor = Actuator {
        transmission: Transmission::Joint("j".into()),
        gear: [3.0, 2.0, 1.0, 0.0, 0.0, 0.0],
        armature: 0.2,
        damping: [0.7, 0.0, 0.0],
        ..Actuator::default()
    };
    let mut spec = single(vec![Joint { armature: 0.5, ..joint(JointKind::Ball, [0.0; 3]) }], vec![brick()]);
    spec.actuators.push(motor);
    let ball = model(&spec);
    agrees(&ball, "body_invweight0", &[0.0, 0.0, 0.010759853943660016, 0.11914291653567506]);
    agrees(&ball, "dof_M0", &[4.380000000000001, 15.900000000000002, 15.100000000000001]);
    agrees(&ball, "dof_armature", &[0.5; 3]);
    agrees(&ball, "dof_damping", &[0.0; 3]);
    agrees(&ball, "actuator_acc0", &[0.6995277696863041]);
    let dof = &ball.tables().dofs[1];
    assert!((dof.armature - 2.3).abs() < 1e-15 && (dof.damping[0] - 6.3).abs() < 1e-15 && dof.damped);

    spec.bodies[1].joints[0].kind = JointKind::Free;
    let free = model(&spec);
    let (t, r) = (0.057737064749425575, 0.24238817116359423);
    agrees(&free, "dof_invweight0", &[t, t, t, r, r, r]);
    agrees(&free, "body_invweight0", &[0.0, 0.0, 0.019967634146060963, r]);
    agrees(&free, "actuator_acc0", &[0.33998249178807205]);
}

#[test]
fn weights_of_a_slider() {
    let slider = |geom: Geom| {
        let slide = Joint { armature: 7.0, ..joint(JointKind::Slide, [1.0, 0.0, 0.0]) };
        model(&single(vec![slide], vec![geom]))
    };
    let aside = slider(brick());
    agrees(&aside, "body_invweight0", &[0.0, 0.0, 0.006060606060606061, 0.0]);
    agrees(&aside, "dof_invweight0", &[0.01818181818181818]);
    let centred = slider(Geom { pos: [0.0; 3], ..brick() });
    agrees(&centred, "body_invweight0", &[0.0, 0.0, 0.02083333333333333, 0.0]);
    agrees(&centred, "dof_invweight0", &[0.02083333333333333]);
    agrees(&centred, "dof_M0", &[55.0]);
}

/// A trunk with an arm that forks and a leg, and motors on every joint but the first; figures of MuJoCo 4.0.0.
#[test]
fn accelerations_by_actuators_of_branches() {
    let text = r#"<mujoco><worldbody><body pos="0 0 1"><freejoint/><geom type="box" size="0.2 0.1 0.05"/>
      <body pos="0.2 0.1 0"><joint name="a" type="ball" armature="0.01"/>
        <geom type="capsule" fromto="0 0 0 0.1 0.3 -0.2" size="0.03"/>
        <body pos="0.1 0.3 -0.2"><joint name="aa" axis="1 1 0"/>
          <geom type="capsule" fromto="0 0 0 0.2 0 0.1" size="0.02"/></body>
        <body pos="0.1 0.3 -0.2"><joint name="ab" type="slide" axis="0 1 2"/><geom size="0.04"/></body></body>
      <body pos="-0.2 0.1 0"><joint name="b" axis="0 1 0" pos="0 0 0.02"/>
        <geom type="capsule" fromto="0 0 0 0 0.1 -0.4" size="0.03"/>
        <body pos="0 0.1 -0.4"><joint name="ba" axis="0 0 1" armature="0.02"/>
          <geom type="box" size="0.1 0.02 0.02" pos="0.1 0 0"/></body></body>
    </body></worldbody><actuator><motor joint="a" gear="1 2 3"/><motor joint="aa" gear="2"/><motor joint="ab"/>
    <motor joint="b"/><motor joint="ba" gear="5"/></actuator></mujoco>"#;
    let model = Model::from_xml_string(text, &Default::default()).expect("a model");
    let norms = [77.63399211591538, 1103.153415712395, 13.939505571581313, 14.711797751336801, 213.95005623773798];
    agrees(&model, "actuator_acc0", &norms);
}

#[test]
fn springs_from_time_constants() {
    let two = |springs: [[f64; 2]; 2]| {
        let y = |springdamper| Joint { springdamper, name: String::new(), ..joint(JointKind::Hinge, [0.0, 1.0, 0.0]) };
        let mut spec = single(vec![y(springs[0])], vec![brick()]);
        spec.add_body(1, Body { joints: vec![y(springs[1])], geoms: vec![brick()], ..body(0, [1.0, 0.0, 0.0]) });
        model(&spec)
    };
    let chain = two([[0.1, 1.0], [0.2, 0.5]]);
    agrees(&chain, "jnt_stiffness", &[1924.705882352941, 212.46753246753244]);
    agrees(&chain, "dof_damping", &[384.9411764705883, 21.246753246753247]);
    agrees(&chain, "dof_invweight0", &[0.05195599022004889, 0.47066014669926654]);
    agrees(
        &chain,
        "body_invweight0",
        &[0.0, 0.0, 0.004329665851670741, 0.017318663406682963, 0.00636715566422168, 0.0784433577832111],
    );
    assert!(chain.tables().joints[1].spring && chain.tables().dofs[0].damped);
    let free = model(&single(vec![Joint { springdamper: [0.1, 1.0], ..free() }], vec![brick()]));
    agrees(&free, "jnt_stiffness", &[207.8268109908407]);
}

#[test]
fn damping_ratio_and_inherited_range() {
    let y = |name: &str, armature| Joint { name: name.into(), armature, ..joint(JointKind::Hinge, [0.0, 1.0, 0.0]) };
    let mut spec = single(vec![Joint { range: Some([-0.2, 0.6]), ..y("j", 0.5) }], vec![brick()]);
    spec.add_body(1, Body { joints: vec![y("k", 0.0)], geoms: vec![brick()], ..body(0, [1.0, 0.0, 0.0]) });
    let servo = |joint: &str| Actuator {
        transmission: Transmission::Joint(joint.into()),
        gainprm: [10.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        bias: Bias::Affine,
        biasprm: [0.0, -10.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        dampratio: 1.0,
        ..Actuator::default()
    };
    let geared = Actuator { gear: [3.0, 0.0, 0.0, 0.0, 0.0, 0.0], inheritrange: 0.5, ..servo("j") };
    spec.actuators = vec![geared, Actuator { armature: 0.3, ..servo("k") }];
    let model = model(&spec);
    let kv: Vec<f64> = model.tables().actuators.iter().map(|a| a.bias[2]).collect();
    assert!((kv[0] + 9.886162603921457).abs() < 1e-13 && (kv[1] + 9.941949534659543).abs() < 1e-13, "{kv:?}");
    agrees(&model, "actuator_acc0", &[0.39343439318420986, 0.4229667414481045]);
    agrees(&model, "actuator_ctrlrange", &[0.0, 0.4, 0.0, 0.0]);
    assert!(model.tables().controls[0].limited && !model.tables().controls[1].limited);
}

#[test]
fn a_long_chain_agrees_with_its_inertia_matrix() {
    // Unit point-like spheres on unit arms about y: M_ij = Σ_k (k-i+1)(k-j+1) m + I; its inverse by elimination.
    let n = 12;
    let mut spec = Spec::new("chain");
    for i in 0..n {
        let arm = Geom { pos: [1.0, 0.0, 0.0], mass: GeomMass::Mass(1.0), ..ball(0.1) };
        let y = Joint { axis: [0.0, 1.0, 0.0], ..Joint::default() };
        spec.add_body(
            i,
            Body { joints: vec![y], geoms: vec![arm], pos: [f64::from(i > 0), 0.0, 0.0], ..Body::default() },
        );
    }
    let inertia = 0.4 * 0.01;
    let entry = |i: usize, j: usize| (i.max(j)..n).map(|k| ((k - i + 1) * (k - j + 1)) as f64 + inertia).sum::<f64>();
    let mut rows: Vec<Vec<f64>> =
        (0..n).map(|i| (0..2 * n).map(|j| if j < n { entry(i, j) } else { f64::from(j == n + i) }).collect()).collect();
    for p in 0..n {
        let pivot = rows[p][p];
        rows[p].iter_mut().for_each(|x| *x /= pivot);
        let row = rows[p].clone();
        for (i, other) in rows.iter_mut().enumerate().filter(|(i, _)| *i != p) {
            let factor = other[p];
            other.iter_mut().zip(&row).for_each(|(x, y)| *x -= factor * y);
            debug_assert!(i != p);
        }
    }
    let model = model(&spec);
    for (i, weight) in reals(&model, "dof_invweight0").into_iter().enumerate() {
        assert!((weight / rows[i][n + i] - 1.0).abs() < 1e-9, "{i}: {weight} {}", rows[i][n + i]);
    }
    let diagonal: Vec<f64> = (0..n).map(|i| entry(i, i)).collect();
    agrees(&model, "dof_M0", &diagonal);
}

/// SPEC T3.
#[test]
fn contacts_mix_the_parameters_of_their_geoms() {
    let plane = Geom {
        shape: Shape::Plane,
        solref: [0.05, 0.7],
        solimp: [0.8, 0.9, 0.002, 0.3, 3.0],
        friction: [0.3, 0.04, 0.005],
        solmix: 3.0,
        condim: 1,
        margin: 0.01,
        gap: 0.02,
        ..Geom::default()
    };
    let sphere = Geom { friction: [0.5, 0.01, 0.001], condim: 4, margin: 0.002, gap: 0.003, ..ball(0.1) };
    let pair = |plane: &Geom, sphere: &Geom| {
        let mut spec = single(vec![free()], vec![sphere.clone()]);
        spec.bodies[0].geoms.push(plane.clone());
        spec.option.flags.refsafe = false;
        model(&spec).tables().pairs[0].clone()
    };
    let close = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(x, y)| (x - y).abs() <= 1e-13 * y.abs().max(1e-6));
    let mixed = pair(&plane, &sphere);
    assert_eq!(mixed.condim, 4);
    assert!(close(&mixed.friction, &[0.5, 0.5, 0.04, 0.005, 0.005]));
    assert!(close(&[mixed.margin, mixed.include], &[0.012, 0.035]));
    let i = mixed.impedance.clone();
    assert!(close(
        &[i.dmin, i.dmax, 1.0 / i.inverse_width, i.midpoint, i.power],
        &[0.825, 0.9125, 0.00175, 0.35, 2.75]
    ));
    let (dw, tc, dr) = (0.9125f64, 0.0425f64, 0.775f64);
    assert!(close(&[i.k, i.b], &[1.0 / (dw * tc * dr).powi(2), 2.0 / (dw * tc)]));

    let first = pair(&Geom { priority: 1, ..plane.clone() }, &sphere);
    assert_eq!(first.condim, 1);
    assert!(close(&first.friction, &[0.3, 0.3, 0.04, 0.005, 0.005]));
    assert!(close(&[first.impedance.b], &[2.0 / (0.9 * 0.05)]));

    let stiff = pair(&plane, &Geom { solref: [-500.0, -10.0], ..sphere });
    assert!(close(&[stiff.impedance.k, stiff.impedance.b], &[500.0 / (dw * dw), 10.0 / dw]));
}

/// SPEC T1: a sphere on a plane.
#[test]
fn weights_of_a_contact() {
    let mut spec = single(vec![free()], vec![ball(0.1)]);
    spec.bodies[0].geoms.push(Geom { shape: Shape::Plane, ..Geom::default() });
    let model = model(&spec);
    let pair = &model.tables().pairs[0];
    assert!((pair.invweight - 0.238732414638).abs() < 1e-12);
    assert!((pair.impedance.k - 2770.083102493).abs() < 1e-9 && (pair.impedance.b - 105.2631578947).abs() < 1e-9);
    let geoms = &model.tables().geoms;
    assert_eq!(geoms[pair.geom1 as usize].shape, KernelShape::Plane);
    assert_eq!((pair.link1, pair.link2, pair.dofs, pair.cross), (NONE, 0, Span::default(), false));
}

/// Base with two arms of two bodies each, every body with one hinge and one sphere.
fn star() -> Spec {
    let mut spec = Spec::new("star");
    for (name, parent) in [("base", 0), ("l1", 1), ("l2", 2), ("r1", 1), ("r2", 4)] {
        let axis = [1.0, 0.0, 0.0];
        let joints = vec![Joint { name: name.into(), axis, ..Joint::default() }];
        let geoms = vec![Geom { name: name.into(), ..ball(0.1) }];
        spec.add_body(parent, Body { name: name.into(), joints, geoms, ..Body::default() });
    }
    spec
}

fn touching(model: &Model) -> Vec<(u32, u32)> {
    let tables = model.tables();
    tables.pairs.iter().map(|p| (tables.geoms[p.geom1 as usize].id, tables.geoms[p.geom2 as usize].id)).collect()
}

#[test]
fn pairs_of_a_tree() {
    let model = model(&star());
    // Not parent and child: 0-1, 0-3, 1-2, 3-4.
    assert_eq!(touching(&model), [(0, 2), (0, 4), (1, 3), (1, 4), (2, 3), (2, 4)]);
    let tables = model.tables();
    let dofs = |i: usize| -> Vec<(u32, bool)> {
        tables.pair_dofs[tables.pairs[i].dofs.range()].iter().map(|d| (d.dof, d.second)).collect()
    };
    assert_eq!(dofs(0), [(1, true), (2, true)]);
    assert!(!tables.pairs[0].cross);
    assert_eq!(dofs(1), [(3, true), (4, true)]);
    assert_eq!(dofs(5), [(1, false), (2, false), (3, true), (4, true)]);
    assert!(tables.pairs[5].cross);
    assert!(tables.pairs.iter().all(|pair| pair.sides == lanesim_kernels::model::Sides::Two));
    assert_eq!((tables.sizes.nslot, tables.pairs[5].slots), (6, Span { start: 5, len: 1 }));
}

#[test]
fn filters() {
    let mut spec = star();
    spec.excludes.push(Exclude { body1: "r2".into(), body2: "l2".into(), ..Exclude::default() });
    spec.bodies[2].geoms[0].contype = 0;
    spec.bodies[2].geoms[0].conaffinity = 2;
    let reduced = model(&spec);
    assert_eq!(touching(&reduced), [(0, 2), (0, 4), (2, 3)]);
    agrees(&reduced, "exclude_signature", &[f64::from((3 << 16) + 5)]);

    spec.option.flags.filterparent = false;
    assert_eq!(touching(&model(&spec)), [(0, 2), (0, 3), (0, 4), (2, 3), (3, 4)]);
    spec.option.flags.contact = false;
    assert_eq!(touching(&model(&spec)), []);
}

#[test]
fn explicit_pairs_replace_automatic_ones() {
    let mut spec = star();
    let pair = |geom1: &str, geom2: &str, condim| Pair {
        geom1: geom1.into(),
        geom2: geom2.into(),
        condim,
        solreffriction: [0.1, 1.0],
        ..Pair::default()
    };
    spec.pairs = vec![pair("r2", "base", 4), pair("l1", "base", 1)];
    let model = model(&spec);
    assert_eq!(touching(&model), [(0, 1), (0, 2), (0, 4), (1, 3), (1, 4), (2, 3), (2, 4)]);
    let pairs = &model.tables().pairs;
    assert_eq!((pairs[0].condim, pairs[1].condim, pairs[2].condim), (1, 3, 4));
    assert!((pairs[0].friction_b - 2.0 / (0.95 * 0.1)).abs() < 1e-12);
    agrees(&model, "pair_dim", &[1.0, 4.0]);
    agrees(&model, "pair_geom2", &[1.0, 4.0]);
}

#[test]
fn rows_of_branches_that_touch() {
    let mut spec = Spec::new("two");
    for name in ["a", "b", "c"] {
        let mask = u32::from(name != "b");
        let geom = Geom { contype: mask, conaffinity: mask, ..ball(0.1) };
        spec.add_body(0, Body { joints: vec![hinge_named(name)], geoms: vec![geom], ..Body::default() });
    }
    // Dofs 0 and 2 meet; dof 1 lies between them in storage and stays apart.
    let rows = &model(&spec).tables().rows.clone();
    assert_eq!((rows.first.as_slice(), rows.start.as_slice()), ([0, 0, 0].as_slice(), [0, 1, 3].as_slice()));
    spec.option.flags.contact = false;
    assert_eq!(model(&spec).tables().rows.first, [0, 1, 2]);
}

fn hinge_named(name: &str) -> Joint {
    Joint { name: name.into(), ..hinge() }
}

#[test]
fn mocap_bodies_are_links_without_joints() {
    let trees = |model: &Model| model.sizes().iter().find(|(name, _)| *name == "ntree").map(|(_, n)| *n);
    let mut alone = Spec::new("alone");
    alone.add_body(0, Body { mocap: true, geoms: vec![ball(0.1)], ..body(0, [0.0; 3]) });
    assert_eq!(trees(&model(&alone)), Some(0));
    let mut spec = Spec::new("mocap");
    let hand = spec.add_body(0, Body { mocap: true, geoms: vec![ball(0.1)], ..body(0, [0.0, 0.0, 1.0]) });
    spec.add_body(hand, Body { joints: vec![hinge()], geoms: vec![ball(0.1)], ..Body::default() });
    spec.keys.push(Key { mquat: Some(vec![2.0, 0.0, 0.0, 0.0]), ..Key::default() });
    let model = model(&spec);
    let place = model.placements().geoms[0];
    let tables = model.tables();
    assert_eq!((place.link, place.pos), (0, [0.0; 3]));
    assert_eq!((tables.links[0].mocap, tables.links[0].pos, tables.links[0].dofs.len), (0, [0.0, 0.0, 1.0], 0));
    assert_eq!((tables.links[1].mocap, tables.links[1].parent, tables.sizes.nv), (NONE, 0, 1));
    assert_eq!(trees(&model), Some(1));
    let key = &model.keys()[0];
    assert_eq!(
        (key.mpos.as_slice(), key.mquat.as_slice()),
        ([0.0, 0.0, 1.0].as_slice(), [1.0, 0.0, 0.0, 0.0].as_slice())
    );
    // Its child is not filtered by the world, but by the mocap body.
    assert!(model.tables().pairs.is_empty());
}

#[test]
fn fused_bodies() {
    let mut spec = Spec::new("fuse");
    spec.compiler.fusestatic = true;
    let a = spec.add_body(0, Body { name: "a".into(), ..body(0, [1.0, 0.0, 0.0]) });
    let b = spec.add_body(a, Body { joints: vec![hinge()], geoms: vec![brick()], ..body(0, [0.0, 0.0, 1.0]) });
    let turned = Body { quat: [1.0, 1.0, 0.0, 0.0], geoms: vec![brick()], ..body(0, [0.0, 0.0, 1.0]) };
    let c = spec.add_body(b, turned);
    spec.add_body(c, Body { joints: vec![hinge_named("k")], geoms: vec![brick()], ..Body::default() });
    let fused = model(&spec);
    agrees(&fused, "body_parentid", &[0.0, 0.0, 1.0]);
    agrees(&fused, "body_mass", &[0.0, 96.0, 48.0]);
    agrees(&fused, "body_inertia", &[0.0, 0.0, 0.0, 28.16, 26.4, 2.4, 2.08, 1.6, 0.8]);
    agrees(&fused, "body_ipos", &[0.0, 0.0, 0.0, 0.5, 0.0, 0.5, 0.5, 0.0, 0.0]);
    agrees(&fused, "geom_bodyid", &[1.0, 1.0, 2.0]);
    agrees(&fused, "geom_pos", &[0.5, 0.0, 0.0, 0.5, 0.0, 1.0, 0.5, 0.0, 0.0]);

    spec.excludes.push(Exclude { body1: "a".into(), body2: "world".into(), ..Exclude::default() });
    assert_eq!(model(&spec).names().bodies.len(), 4);
    spec.bodies[c].gravcomp = 1.0;
    assert_eq!(model(&spec).names().bodies.len(), 5);
}

#[test]
fn fused_bodies_whose_inertia_comes_from_geoms() {
    let mut spec = single(vec![hinge()], vec![Geom { pos: [0.0; 3], ..brick() }]);
    let (pos, quat, source) = ([0.0; 3], [1.0, 0.0, 0.0, 0.0], Source::default());
    let inertial = Inertial { pos, quat, mass: 1.0, inertia: Inertia::Diagonal([1.0; 3]), source };
    spec.add_body(1, Body { inertial: Some(inertial), ..body(0, [1.0, 2.0, 3.0]) });
    spec.compiler.fusestatic = true;
    agrees(&model(&spec), "body_mass", &[0.0, 49.0]);
    spec.compiler.inertiafromgeom = InertiaFromGeom::True;
    agrees(&model(&spec), "body_mass", &[0.0, 48.0]);
}

#[test]
fn aligned_free_bodies() {
    let mut spec = single(vec![free()], vec![brick()]);
    spec.bodies[1].pos = [1.0, 2.0, 3.0];
    spec.bodies[1].sites.push(Site::default());
    spec.compiler.alignfree = true;
    let aligned = model(&spec);
    agrees(&aligned, "qpos0", &[1.5, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0]);
    agrees(&aligned, "site_pos", &[-0.5, 0.0, 0.0]);
    agrees(&aligned, "geom_pos", &[0.0; 3]);
    agrees(&aligned, "body_ipos", &[0.0; 6]);
    spec.bodies[1].joints[0].align = Tri::False;
    agrees(&model(&spec), "geom_pos", &[0.5, 0.0, 0.0]);
}

#[test]
fn compiler_settings_for_mass() {
    let mut spec = single(vec![free()], vec![ball(0.1)]);
    spec.add_body(0, body(0, [0.0; 3]));
    spec.compiler.boundmass = 100.0;
    spec.compiler.boundinertia = 5.0;
    let bounded = model(&spec);
    agrees(&bounded, "body_mass", &[0.0, 100.0, 100.0]);
    agrees(&bounded, "body_inertia", &[0.0, 0.0, 0.0, 5.0, 5.0, 5.0, 5.0, 5.0, 5.0]);
    spec.compiler.settotalmass = 10.0;
    agrees(&model(&spec), "body_mass", &[0.0, 5.0, 5.0]);

    let mut visual = single(vec![free()], vec![ball(0.1), Geom { contype: 0, conaffinity: 0, ..ball(0.2) }]);
    visual.compiler.discardvisual = true;
    let kept = model(&visual);
    assert_eq!(kept.names().geoms.len(), 1);
    agrees(&kept, "body_mass", &[0.0, 37.69911184307752]);
}

#[test]
fn joint_tables() {
    let spec = single(vec![Joint { axis: [0.0, -3.0, 0.0], pos: [0.0, 0.0, 0.1], ..hinge() }], vec![brick()]);
    let joint = model(&spec).tables().joints[0].clone();
    assert_eq!((joint.axis_kind, joint.axis, joint.anchored), (AxisKind::Minus(1), [0.0, -1.0, 0.0], true));
    let general = single(vec![joint_along([1.0, 1.0, 0.0])], vec![brick()]);
    assert_eq!(model(&general).tables().joints[0].axis_kind, AxisKind::General);
}

fn joint_along(axis: [f64; 3]) -> Joint {
    joint(JointKind::Slide, axis)
}

#[test]
fn limits_and_dry_friction() {
    let spec =
        single(vec![Joint { range: Some([-1.0, 1.0]), margin: 0.1, frictionloss: 2.0, ..hinge() }], vec![brick()]);
    let tables = model(&spec).tables().clone();
    let (limit, loss) = (&tables.limits[0], &tables.friction_losses[0]);
    assert_eq!((limit.range, limit.margin, limit.ball), ([-1.0, 1.0], 0.1, false));
    let weight = limit.invweight;
    assert!((loss.r - 0.1 / 0.9 * weight).abs() < 1e-15 * weight && loss.bound == 2.0);
    let rows = |tables: &_| lanesim_kernels::constraint::all_dof_rows(tables).map(|row| row.kind).collect::<Vec<_>>();
    assert_eq!(rows(&tables), [DofRowKind::Friction, DofRowKind::Limit]);
    // Both limits act at once where the margins overlap.
    let mut narrow = spec.clone();
    narrow.bodies[1].joints[0].margin = 1.1;
    assert_eq!(rows(model(&narrow).tables()), [DofRowKind::Friction, DofRowKind::Lower, DofRowKind::Upper]);
    let mut off = spec;
    off.option.flags.constraint = false;
    let tables = model(&off).tables().clone();
    assert!(tables.limits.is_empty() && tables.friction_losses.is_empty());
}

#[test]
fn both_precisions_have_the_same_least_friction() {
    let mut spec = single(vec![free()], vec![Geom { friction: [1.0, 0.0, 0.0], ..ball(0.1) }]);
    spec.bodies[0].geoms.push(Geom { shape: Shape::Plane, friction: [1.0, 0.0, 0.0], ..Geom::default() });
    let model = model(&spec);
    assert_eq!(model.tables().pairs[0].friction[2], 1e-5);
    assert_eq!(model.tables_f32().pairs[0].friction[2], 1e-5);
}

/// Nothing recurses, and nothing costs the square of the number of bodies.
#[test]
fn large_models() {
    let mut deep = Spec::new("deep");
    let mut wide = Spec::new("wide");
    for i in 0..20_000 {
        deep.add_body(i, body(0, [0.0, 0.0, 0.1]));
        let geom = Geom { contype: 0, conaffinity: 0, ..ball(0.1) };
        wide.add_body(0, Body { geoms: vec![geom], ..Body::default() });
    }
    assert_eq!(model(&deep).names().bodies.len(), 20_001);
    assert_eq!(model(&wide).names().geoms.len(), 20_000);
    for body in wide.bodies.iter_mut().skip(1) {
        body.geoms[0] = ball(0.1);
        body.joints.push(Joint { name: String::new(), ..free() });
    }
    refused::check(&wide, "pairs of geoms can touch");
}
