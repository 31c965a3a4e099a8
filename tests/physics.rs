//! Physics that is known: figures of MuJoCo 4.0.0, closed formulas, and what a solution must satisfy.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use crate::support;
use crate::support::golden::{Failures, Golden};
use crate::support::{agree, assert_agree, options, parse};
use lanesim::eval::eval;
use lanesim::model::ArrayData;
use lanesim::npz::{Array, Data};
use lanesim::outputs::Output;
use lanesim::{Backend, Field, Model, Precision, Worlds};
use lanesim_kernels::options::Integrator;

fn worlds(model: &Model) -> Worlds {
    Worlds::new(model, 1, &options(Precision::F64, Backend::Wide)).expect("a batch")
}

/// Results for one state, by name.
fn evaluate(model: &Model, qpos: &[f64], qvel: &[f64], fields: &[&str]) -> BTreeMap<String, Vec<f64>> {
    evaluate_in(Precision::F64, model, qpos, qvel, fields)
}

fn evaluate_in(
    precision: Precision,
    model: &Model,
    qpos: &[f64],
    qvel: &[f64],
    fields: &[&str],
) -> BTreeMap<String, Vec<f64>> {
    let row = |x: &[f64]| Array::new(vec![1, x.len()], Data::F64(x.to_vec())).expect("an array");
    let inputs = BTreeMap::from([("qpos".to_string(), row(qpos)), ("qvel".to_string(), row(qvel))]);
    let run = eval(model, &inputs, fields, 0, &options(precision, Backend::Wide)).expect("an evaluation");
    run.into_iter().map(|(name, array)| (name, array.to_f64().into_owned())).collect()
}

/// Compares with figures that have twelve digits after the point.
#[track_caller]
fn is(what: &str, got: &[f64], expected: &[f64]) {
    assert_agree(what, got, expected, 1e-11, 1.0);
}

/// Positions after steps from a state.
fn after(model: &Model, qpos: &[f64], qvel: &[f64], nstep: usize) -> (Vec<f64>, Vec<f64>) {
    let mut worlds = worlds(model);
    worlds.set(Field::Qpos, 0, qpos).expect("a state");
    worlds.set(Field::Qvel, 0, qvel).expect("a state");
    worlds.step(nstep).expect("steps");
    (worlds.get(Field::Qpos, 0).expect("positions"), worlds.get(Field::Qvel, 0).expect("velocities"))
}

// ---- figures of MuJoCo ---------------------------------------------------------------------------------------------------

/// A sphere that slides and spins on a plane. The solver runs to the minimiser, as it did for the figures.
fn sliding_sphere(cone: &str) -> Model {
    parse(&format!(
        "<mujoco><option cone='{cone}' tolerance='1e-14' iterations='200' ls_tolerance='1e-6'/><worldbody>
           <geom type='plane' size='5 5 .1'/>
           <body pos='0 0 .099'><freejoint/><geom size='.1'/></body>
         </worldbody></mujoco>"
    ))
}

const SLIDING: [f64; 6] = [0.3, 0.1, -0.2, 1.0, 2.0, 3.0];

/// Regulariser, reference, force, acceleration and the pose after a hundred steps.
#[track_caller]
fn check_sliding(cone: &str, r: f64, aref: &[f64], force: &[f64], qacc: [f64; 6], end: [f64; 7]) {
    let model = sliding_sphere(cone);
    let qpos = [0.0, 0.0, 0.099, 1.0, 0.0, 0.0, 0.0];
    let got = evaluate(&model, &qpos, &SLIDING, &["efc_R", "efc_aref", "efc_force", "qacc"]);
    is("R", &got["efc_R"], &vec![r; aref.len()]);
    is("reference", &got["efc_aref"], aref);
    is("force", &got["efc_force"], force);
    is("acceleration", &got["qacc"], &qacc);
    is("pose", &after(&model, &qpos, &SLIDING, 100).0, &end);
}

#[test]
fn a_sphere_slides_on_a_pyramid() {
    check_sliding(
        "pyramidal",
        0.050259455713,
        &[2.684210526316, 44.684210526316, 34.315789473684, 13.052631578947],
        &[21.036862082183, 45.605742878417, 39.540492857292, 27.102112103309],
        [-2.969444671583, -5.865388237434, 22.0095, -145.9015324062, 73.86493620563, 0.0],
        [
            0.05442013947,
            0.008946480774,
            0.099633067285,
            0.919189598506,
            -0.035637205236,
            0.263430646714,
            0.290559401797,
        ],
    );
}

#[test]
fn a_sphere_slides_on_a_cone() {
    check_sliding(
        "elliptic",
        0.012564863928,
        &[23.684210526316, -21.0, 10.631578947368],
        &[133.285209921201, -24.935437238017, 12.623955694434],
        [-3.013747425213, -5.952897141882, 22.0095, -148.0783164043, 74.96696720218, 0.0],
        [
            0.054416052667,
            0.008938312706,
            0.099633067285,
            0.91917223136,
            -0.035747620897,
            0.263453626952,
            0.290579942774,
        ],
    );
}

#[test]
fn a_double_pendulum_swings() {
    let model = parse(
        "<mujoco><option timestep='.01'><flag contact='disable'/></option>
         <default><geom type='capsule' fromto='0 0 0 .5 0 0' size='.05'/><joint axis='0 1 0' damping='.1'/></default>
         <worldbody><body><joint/><geom/><body pos='.5 0 0'><joint/><geom/></body></body></worldbody></mujoco>",
    );
    let got = evaluate(&model, &[0.0, 0.0], &[0.0, 0.0], &["qM", "qfrc_bias", "qacc"]);
    is("M", &got["qM"], &[3.026466372805, 0.956909487329, 0.956909487329, 0.400585788256]);
    is("bias", &got["qfrc_bias"], &[-43.660283903264, -10.915070975816]);
    is("acceleration", &got["qacc"], &[23.745677444809, -29.475316899245]);
    let (qpos, qvel) = after(&model, &[0.0, 0.0], &[0.0, 0.0], 100);
    is("positions", &qpos, &[2.978733185218, 0.351760273989]);
    is("velocities", &qvel, &[-2.116570015307, 5.102365701244]);
}

fn reals(model: &Model, name: &str) -> Vec<f64> {
    match &model.array(name).unwrap_or_else(|| panic!("no array {name}")).data {
        ArrayData::F64(data) => data.clone(),
        ArrayData::I32(data) => data.iter().map(|x| f64::from(*x)).collect(),
    }
}

/// What becomes of two geoms' contact parameters.
#[test]
fn contact_parameters_are_mixed() {
    let check = |plane: &str,
                 sphere: &str,
                 dim: u32,
                 friction: [f64; 5],
                 solref: [f64; 2],
                 solimp: [f64; 5],
                 margin: f64| {
        let model = parse(&format!(
            "<mujoco><worldbody>
               <geom type='plane' size='1 1 1' solimp='.8 .9 .002 .3 3' friction='.3 .04 .005' solmix='3' condim='1'
                     margin='.01' gap='.02' solref='.05 .7' {plane}/>
               <body><freejoint/><geom size='.1' friction='.5 .01 .001' condim='4' margin='.002' gap='.003' {sphere}/></body>
             </worldbody></mujoco>"
        ));
        let pair = &model.tables().pairs[0];
        assert_eq!(pair.condim, dim, "{plane} {sphere}");
        is("friction", &pair.friction, &friction);
        is("margin", &[pair.margin], &[margin]);
        // MuJoCo's meaning of solref and solimp, from what they became.
        let imp = &pair.impedance;
        let (dmin, dmax) = (solimp[0], solimp[1]);
        let (b, k) = if solref[0] > 0.0 {
            (2.0 / (dmax * solref[0]), 1.0 / (dmax * solref[0] * solref[1]).powi(2))
        } else {
            (-solref[1] / dmax, -solref[0] / (dmax * dmax))
        };
        is("impedance", &[imp.b, imp.k, imp.dmin, imp.dmax, 1.0 / imp.inverse_width], &[b, k, dmin, dmax, solimp[2]]);
        is("inflection", &[imp.midpoint, imp.power], &solimp[3..]);
    };
    let mixed = [0.5, 0.5, 0.04, 0.005, 0.005];
    let solimp = [0.825, 0.9125, 0.00175, 0.35, 2.75];
    check("", "solref='.02 1'", 4, mixed, [0.0425, 0.775], solimp, 0.012);
    check("", "solref='-500 -10'", 4, mixed, [-500.0, -10.0], solimp, 0.012);
    let plane = [0.3, 0.3, 0.04, 0.005, 0.005];
    check("priority='1'", "", 1, plane, [0.05, 0.7], [0.8, 0.9, 0.002, 0.3, 3.0], 0.012);
}

/// Contacts of a geom at (0.3, 0.2, z) with a box of half size one, as x, y of their places; the rest is the same for all:
/// distance, height, and the normal's z component (the normal points from the geom whose type comes first).
#[track_caller]
fn check_on_box(geom: &str, z: f64, dist: f64, height: f64, normal: f64, places: &[[f64; 2]]) {
    let model = parse(&format!(
        "<mujoco><worldbody><geom type='box' size='1 1 1'/><body><freejoint/><geom {geom}/></body></worldbody></mujoco>"
    ));
    let qpos = [0.3, 0.2, z, 1.0, 0.0, 0.0, 0.0];
    let got = evaluate(&model, &qpos, &[0.0; 6], &["contact_dist", "contact_pos", "contact_frame"]);
    is("distances", &got["contact_dist"], &vec![dist; places.len()]);
    let mut found: Vec<[f64; 3]> = got["contact_pos"].chunks(3).map(|p| [p[0], p[1], p[2]]).collect();
    let mut expected: Vec<[f64; 3]> = places.iter().map(|p| [p[0], p[1], height]).collect();
    let order = |a: &[f64; 3], b: &[f64; 3]| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1]));
    found.sort_by(order);
    expected.sort_by(order);
    is("places", found.as_flattened(), expected.as_flattened());
    for frame in got["contact_frame"].chunks(9) {
        is("normal", &frame[..3], &[0.0, 0.0, normal]);
    }
}

#[test]
fn geoms_rest_on_a_box() {
    check_on_box("type='sphere' size='.2'", 1.19, -0.01, 0.995, -1.0, &[[0.3, 0.2]]);
    // The centre is inside.
    check_on_box("type='sphere' size='.2'", 0.9, -0.3, 0.85, -1.0, &[[0.3, 0.2]]);
    check_on_box("type='capsule' size='.1 .3' euler='90 0 0'", 1.09, -0.01, 0.995, -1.0, &[[0.3, 0.5], [0.3, -0.1]]);
    let (s, c) = f64::sin_cos(PI / 6.0);
    let corner = |x: f64, y: f64| [0.3 + c * x - s * y, 0.2 + s * x + c * y];
    let corners = [corner(0.2, 0.3), corner(0.2, -0.3), corner(-0.2, 0.3), corner(-0.2, -0.3)];
    check_on_box("type='box' size='.2 .3 .4' euler='0 0 30'", 1.39, -0.01, 0.995, 1.0, &corners);
}

// ---- closed formulas -----------------------------------------------------------------------------------------------------

const BRICK: &str = "<mujoco><option timestep='.001' gravity='0 0 GRAVITY'/><worldbody><body pos='0 0 2'><freejoint/>
    <geom type='box' size='.1 .2 .3'/></body></worldbody></mujoco>";

#[test]
fn free_fall() {
    let model = parse(&BRICK.replace("GRAVITY", "-9.81"));
    let (n, h, g, v) = (300.0, 0.001, 9.81, [0.5, -0.2, 3.0]);
    let (qpos, qvel) = after(&model, &model.initial_key().qpos, &[v[0], v[1], v[2], 0.0, 0.0, 0.0], 300);
    // Velocity first, then position: x = x₀ + n h v - g h² n (n + 1) / 2.
    let height = 2.0 + n * h * v[2] - g * h * h * n * (n + 1.0) / 2.0;
    is("place", &qpos[..3], &[n * h * v[0], n * h * v[1], height]);
    is("velocity", &qvel[..3], &[v[0], v[1], v[2] - n * h * g]);
    is("turn", &qpos[3..], &[1.0, 0.0, 0.0, 0.0]);
}

/// A body that spins about a principal axis goes on so.
#[test]
fn spinning_about_principal_axes() {
    let model = parse(&BRICK.replace("GRAVITY", "0"));
    for axis in 0..3 {
        let mut spin = [0.0; 6];
        spin[3 + axis] = 7.0;
        let (qpos, qvel) = after(&model, &model.initial_key().qpos, &spin, 1000);
        let mut turn = [3.5_f64.cos(), 0.0, 0.0, 0.0];
        turn[1 + axis] = 3.5_f64.sin();
        is("turn", &qpos[3..], &turn);
        is("spin", &qvel, &spin);
    }
}

/// About the axis of middle inertia a spin is not stable: it turns over (Dzhanibekov), and energy and momentum stay.
#[test]
fn spinning_about_the_middle_axis_turns_over() {
    let model = parse(&BRICK.replace("GRAVITY", "0").replace(".001", ".0002"));
    let mut worlds = worlds(&model);
    worlds.set(Field::Qvel, 0, &[0.0, 0.0, 0.0, 0.001, 10.0, 0.001]).expect("a state");
    let energy = Output::named("energy").expect("an output");
    let kinetic = |worlds: &mut Worlds| {
        let mut found = 0.0;
        worlds.forward(&[energy], &mut |_, values| found = values[0][1]).expect("outputs");
        found
    };
    let before = kinetic(&mut worlds);
    let mut lowest = 10.0_f64;
    for _ in 0..200 {
        worlds.step(100).expect("steps");
        lowest = lowest.min(worlds.get(Field::Qvel, 0).expect("velocities")[4]);
    }
    assert!(lowest < -9.9, "the spin never turns over: {lowest}");
    let drift = (kinetic(&mut worlds) - before).abs() / before;
    // First order in the step: 20000 steps of 2e-4 s at 10 rad/s.
    assert!(drift < 0.02, "kinetic energy drifts by {drift:.1e}");
}

/// Largest energy error of an undamped pendulum over two seconds.
fn pendulum_drift(timestep: f64) -> f64 {
    let model = parse(&format!(
        "<mujoco><option timestep='{timestep}'/><worldbody><body><joint axis='0 1 0'/>
         <geom type='capsule' fromto='0 0 0 .5 0 0' size='.05'/></body></worldbody></mujoco>"
    ));
    let mut worlds = worlds(&model);
    let energy = Output::named("energy").expect("an output");
    let (mut first, mut worst) = (None, 0.0_f64);
    let steps = (2.0 / timestep).round() as usize;
    for _ in 0..=steps {
        let mut now = 0.0;
        worlds.forward(&[energy], &mut |_, values| now = values[0][0] + values[0][1]).expect("outputs");
        worst = worst.max((now - *first.get_or_insert(now)).abs());
        worlds.step(1).expect("a step");
    }
    worst
}

/// Semi-implicit Euler is of first order: half the step, half the error.
#[test]
fn energy_errors_of_euler_are_of_first_order() {
    let drifts = [0.004, 0.002, 0.001].map(pendulum_drift);
    for pair in drifts.windows(2) {
        let ratio = pair[0] / pair[1];
        assert!((1.9..2.1).contains(&ratio), "halving the step divides the error by {ratio:.2}: {drifts:?}");
    }
}

/// A body at rest on the floor is carried: the contact forces are its weight.
#[test]
fn the_floor_carries_the_weight() {
    for shape in ["type='sphere' size='.1'", "type='box' size='.1 .1 .1'", "type='capsule' size='.1 .2' euler='0 90 0'"]
    {
        let model = parse(&format!(
            "<mujoco><worldbody><geom type='plane' size='5 5 .1'/>
             <body pos='0 0 .1'><freejoint/><geom {shape}/></body></worldbody></mujoco>"
        ));
        let (qpos, qvel) = after(&model, &model.initial_key().qpos, &[0.0; 6], 2000);
        let got = evaluate(&model, &qpos, &qvel, &["qfrc_constraint", "qvel"]);
        let weight = reals(&model, "body_mass")[1] * 9.81;
        assert_agree(shape, &got["qfrc_constraint"][..3], &[0.0, 0.0, weight], 1e-6, 1.0);
        assert_agree(shape, &got["qvel"], &[0.0; 6], 1e-6, 1.0);
    }
}

/// The disk of a cylinder that is nearly flat: the direction of its lowest point hangs on the last digits, its height must
/// not. In single precision the contact once lay millimetres off the disk.
#[test]
fn a_cylinder_nearly_flat_on_the_floor() {
    let model = parse(
        "<mujoco><worldbody><geom type='plane' size='5 5 .1'/>
         <body><freejoint/><geom type='cylinder' size='.1 .08'/></body></worldbody></mujoco>",
    );
    for precision in [Precision::F64, Precision::F32] {
        for tilt in [0.0, 1e-9, 1e-7, 3e-6, 1e-5, 1e-4, 1e-3] {
            for turn in [0.0, 0.3, 1.1, 2.9] {
                let (s, c) = f64::sin_cos(0.5 * tilt);
                let qpos = [0.0, 0.0, 0.079, c, s * f64::cos(turn), s * f64::sin(turn), 0.0];
                let got = evaluate_in(precision, &model, &qpos, &[0.0; 6], &["contact_dist", "ncon"]);
                let what = format!("{precision:?} tilt {tilt} turn {turn}");
                assert!(got["ncon"][0] >= 3.0, "{what}: {got:?}");
                let lowest = 0.079 - 0.1 * f64::sin(tilt) - 0.08 * f64::cos(tilt);
                let least = got["contact_dist"].iter().fold(1.0_f64, |m, x| m.min(*x));
                assert!((least - lowest).abs() < 1e-7, "{what}: {least}, not {lowest}");
            }
        }
    }
}

// ---- what solutions satisfy ----------------------------------------------------------------------------------------------

/// MuJoCo's numbers for the types of rows.
const EQUALITY: f64 = 0.0;
const FRICTION_DOF: f64 = 1.0;
const FRICTION_TENDON: f64 = 2.0;
const ELLIPTIC: f64 = 7.0;

/// M a = smooth force + Jᵀf, and every row's force is what its law makes of its acceleration: -D (J a - aref), no pull in
/// limits, frictionless contacts and edges of pyramids, no more than the bound in dry friction, both ways in equality constraints.
#[test]
fn solutions_are_optimal() {
    let fields = [
        "qM",
        "qacc",
        "qfrc_smooth",
        "qfrc_constraint",
        "nefc",
        "efc_J",
        "efc_D",
        "efc_aref",
        "efc_force",
        "efc_type",
        "efc_id",
    ];
    let mut failures = Failures::default();
    // Discrete steps weigh accelerations by M - h D where the step ends (`tests/steps.rs`).
    let continuous = |golden: &Golden| golden.model.tables().options.integrator != Integrator::Discrete;
    for golden in Golden::all().into_iter().filter(continuous) {
        let ours = golden.eval(&fields, 0, &options(Precision::F64, Backend::Wide));
        let nv = golden.model.tables().sizes.nv;
        let losses = ["dof_frictionloss", "tendon_frictionloss"].map(|name| reals(&golden.model, name));
        for state in 0..golden.states() {
            let get = |name: &str| &ours[name][state][..];
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let (a, f, nefc) = (get("qacc"), get("efc_force"), get("nefc")[0] as usize);
            let row = |r: usize| &get("efc_J")[r * nv..(r + 1) * nv];
            let pulled: Vec<f64> = (0..nv).map(|i| (0..nefc).map(|r| row(r)[i] * f[r]).sum()).collect();
            let place = |what: &str| format!("{} state {state} {what}", golden.name);
            let size = support::largest(get("qfrc_smooth")).max(support::largest(&pulled)).max(1.0);
            failures.check(|| place("Jᵀf"), agree(&pulled, get("qfrc_constraint"), 1e-10, size));
            let residual: Vec<f64> =
                (0..nv).map(|i| dot(&get("qM")[i * nv..(i + 1) * nv], a) - get("qfrc_smooth")[i] - pulled[i]).collect();
            failures.check(|| place("M a - smooth force - Jᵀf"), agree(&residual, &vec![0.0; nv], 1e-9, size));
            for r in (0..nefc).filter(|r| get("efc_type")[*r] != ELLIPTIC) {
                let free = -get("efc_D")[r] * (dot(row(r), a) - get("efc_aref")[r]);
                let kind = get("efc_type")[r];
                let expected = if kind == FRICTION_DOF || kind == FRICTION_TENDON {
                    let bound = losses[usize::from(kind == FRICTION_TENDON)][get("efc_id")[r] as usize];
                    free.clamp(-bound, bound)
                } else if kind == EQUALITY {
                    free
                } else {
                    free.max(0.0)
                };
                let size = support::largest(f).max(1.0);
                failures.check(|| place(&format!("row {r} force")), agree(&f[r..=r], &[expected], 1e-8, size));
            }
        }
    }
    failures.report();
}

/// The normal row of a contact is the rate of its distance, where the contact is at the nearest point. Of the contacts round
/// a tilted disk only the first is, and of those of two faces one at most: the others slide along rim or edges.
#[test]
fn normal_rows_are_rates_of_distances() {
    const STEP: f64 = 1e-6;
    let fields = ["ncon", "contact_dist", "contact_geom", "contact_efc", "contact_dim", "efc_J", "efc_type"];
    let mut failures = Failures::default();
    // MuJoCo's numbers for shapes: a plane with a cylinder, two boxes.
    const SLIDE_WHEN_SEVERAL: [[f64; 2]; 2] = [[0.0, 5.0], [6.0, 6.0]];
    for golden in Golden::all() {
        let model = &golden.model;
        let (nv, tables) = (model.tables().sizes.nv, model.tables());
        let states = golden.inputs();
        let (Some(qpos), Some(qvel)) = (states.get("qpos"), states.get("qvel")) else { continue };
        for state in 0..golden.states() {
            let q = &qpos.to_f64()[state * tables.sizes.nq..(state + 1) * tables.sizes.nq];
            // Along the state's own motion, and something to move those at rest.
            let v: Vec<f64> = (0..nv).map(|i| qvel.to_f64()[state * nv + i] + (1.0 + i as f64).sin()).collect();
            let at = |h: f64| {
                let mut moved = vec![0.0; q.len()];
                lanesim_kernels::integration::advance::<f64>(tables, [q, &[]], &v, h, [&mut moved, &mut []]);
                evaluate(model, &moved, &v, &fields)
            };
            let (now, plus, minus) = (at(0.0), at(STEP), at(-STEP));
            if plus["contact_geom"] != now["contact_geom"] || minus["contact_geom"] != now["contact_geom"] {
                continue;
            }
            let shapes = reals(model, "geom_type");
            for c in 0..now["ncon"][0] as usize {
                let r = now["contact_efc"][c];
                let geoms = &now["contact_geom"][2 * c..2 * c + 2];
                let several = now["contact_geom"].chunks(2).filter(|other| *other == geoms).count() > 1;
                let slides =
                    several && SLIDE_WHEN_SEVERAL.contains(&[shapes[geoms[0] as usize], shapes[geoms[1] as usize]]);
                if r < 0.0 || slides {
                    continue;
                }
                let row = |r: usize| now["efc_J"][r * nv..(r + 1) * nv].iter().zip(&v).map(|(j, v)| j * v).sum::<f64>();
                let r = r as usize;
                let pyramid = now["contact_dim"][c] > 1.0 && now["efc_type"][r] != ELLIPTIC;
                // The edges of a pyramid are normal ± friction.
                let normal = if pyramid { 0.5 * (row(r) + row(r + 1)) } else { row(r) };
                let rate = (plus["contact_dist"][c] - minus["contact_dist"][c]) / (2.0 * STEP);
                let place = || format!("{} state {state} contact {c} rate of distance", golden.name);
                failures.check(place, agree(&[normal], &[rate], 1e-6, 1.0));
            }
        }
    }
    failures.report();
}

#[test]
fn angles_of_springs_wrap() {
    // A ball joint's spring pulls along the shorter way, past half a turn the other way round.
    let model = parse(
        "<mujoco><option gravity='0 0 0'/><worldbody><body><joint type='ball' stiffness='3'/><geom size='.1'/></body>
         </worldbody></mujoco>",
    );
    for (angle, pull) in [(0.5, 0.5), (3.0, 3.0), (3.5, 3.5 - 2.0 * PI), (-1.0, -1.0), (6.0, 6.0 - 2.0 * PI)] {
        let qpos = [f64::cos(angle / 2.0), 0.0, f64::sin(angle / 2.0), 0.0];
        let got = evaluate(&model, &qpos, &[0.0; 3], &["qfrc_passive"]);
        is("spring", &got["qfrc_passive"], &[0.0, -3.0 * pull, 0.0]);
    }
}
