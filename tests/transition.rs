//! Derivatives of steps: the same bits however they are computed, and against what is known of them. MuJoCo's are compared in Python's tests.

use std::collections::BTreeMap;

use crate::support;
use crate::support::{copied, fails, load, load_with, moving, options};
use lanesim::cloud::{self, Call, Follow, Scheme, Solving, Target, Transition, accurate};
use lanesim::npz::{Array, Data};
use lanesim::outputs::Output;
use lanesim::rows::{Rows, Strided, Values};
use lanesim::status::Status;
use lanesim::{Backend, Field, Model, Options, Precision, Rollout, Worlds};
use lanesim_kernels::integration::{difference, displace};

const INTEGRATORS: [&str; 6] = ["Euler", "implicitfast", "implicit", "RK4", "discrete", "midpoint"];
/// Models that touch the floor and have a free joint, activations, tendons, equality constraints, sensors.
const MODELS: [&str; 6] =
    ["zoo/ant", "zoo/hopper", "unit/muscle", "unit/tendon_forces", "zoo/four_bar", "unit/activation"];

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|x| x.to_bits()).collect()
}

/// Rows of world `id`.
fn of(values: &[f64], id: usize, nworld: usize) -> &[f64] {
    let width = values.len() / nworld;
    &values[id * width..(id + 1) * width]
}

fn assert_same(found: &Transition, id: usize, nworld: usize, expected: &Transition, what: &str) {
    let of = |values| of(values, id, nworld);
    for (name, found, expected) in [
        ("A", of(&found.a), &expected.a),
        ("B", of(&found.b), &expected.b),
        ("C", of(&found.c), &expected.c),
        ("D", of(&found.d), &expected.d),
        ("sides", of(&found.sides), &expected.sides),
        ("changed", of(&found.changed), &expected.changed),
        ("status", of(&found.status), &expected.status),
    ] {
        assert_eq!(bits(found), bits(expected), "{what}: {name} of world {id}");
    }
}

#[test]
fn bits_do_not_depend_on_what_is_beside() {
    const NWORLD: usize = 11;
    for name in MODELS {
        for integrator in INTEGRATORS {
            if ["discrete", "midpoint"].contains(&integrator) && support::NOT_DISCRETE.contains(&name) {
                continue;
            }
            let model = accurate(&load_with(name, &[("integrator", integrator)])).expect("a model");
            let options = |backend, threads| Options { threads: Some(threads), ..options(Precision::F64, backend) };
            let mut worlds = moving(&model, NWORLD, 1.0, &options(Backend::Native, 2));
            for centred in [true, false] {
                let scheme = Scheme { centred, sensors: true, ..Scheme::default() };
                let all = worlds.transition(&scheme).expect("derivatives");
                for (id, backend) in
                    [(0, Backend::Scalar), (3, Backend::Wide), (7, Backend::Native), (10, Backend::Native)]
                {
                    let mut alone = copied(&worlds, &[id], &options(backend, 1));
                    let found = alone.transition(&scheme).expect("derivatives");
                    assert_same(&all, id, NWORLD, &found, &format!("{name} {integrator} {backend:?}"));
                }
                let mut three = copied(&worlds, &[9, 2, 5], &options(Backend::Wide, 1));
                let three = three.transition(&scheme).expect("derivatives");
                assert_eq!(bits(of(&all.a, 2, NWORLD)), bits(of(&three.a, 1, 3)), "{name} {integrator}");
            }
        }
    }
}

/// Where a world is after a step, and its sensors before it.
fn step(worlds: &mut Worlds) -> [Vec<f64>; 4] {
    let outputs = [Output::named("sensordata").expect("an output")];
    let sensors = worlds.rollout(&Rollout { nstep: 1, outputs: &outputs, ..Rollout::default() }).expect("a step");
    let get = |field| worlds.get(field, 0).expect("a field");
    [get(Field::Qpos), get(Field::Qvel), get(Field::Act), sensors.outputs.concat()]
}

#[test]
fn a_column_is_the_difference_of_two_steps() {
    for name in MODELS {
        for integrator in INTEGRATORS {
            if ["discrete", "midpoint"].contains(&integrator) && support::NOT_DISCRETE.contains(&name) {
                continue;
            }
            let model = accurate(&load_with(name, &[("integrator", integrator)])).expect("a model");
            let mut worlds = moving(&model, 2, 1.0, &Options::default());
            // Controls inside their ranges.
            worlds.set(Field::Ctrl, 1, &vec![0.1; model.tables().sizes.nu]).expect("a world");
            let eps = 1e-6;
            let found = worlds.transition(&Scheme { sensors: true, ..Scheme::default() }).expect("derivatives");
            let base = copied(&worlds, &[1], &options(Precision::F64, Backend::Scalar));
            let mut nominal = copied(&base, &[0], &options(Precision::F64, Backend::Scalar));
            step(&mut nominal);
            let warm = nominal.get(Field::QaccWarmstart, 0).expect("a field");
            let sizes = &model.tables().sizes;
            let (nv, na, nu) = (sizes.nv, sizes.na, sizes.nu);
            let (n, ns) = (2 * nv + na, sizes.nsensordata);
            for column in 0..n + nu {
                let end = |eps: f64| {
                    let mut world = copied(&base, &[0], &options(Precision::F64, Backend::Scalar));
                    world.set(Field::QaccWarmstart, 0, &warm).expect("a world");
                    let fields = [(Field::Qvel, nv), (Field::Act, 2 * nv), (Field::Ctrl, n)];
                    if column < nv {
                        let (qpos, mut to) = (world.get(Field::Qpos, 0).expect("a field"), vec![0.0; sizes.nq]);
                        let mut dq = vec![0.0; nv];
                        dq[column] = eps;
                        displace::<f64>(model.tables(), &qpos, &dq, &mut to);
                        world.set(Field::Qpos, 0, &to).expect("a world");
                    } else if let Some((field, first)) = fields.into_iter().rfind(|(_, first)| column >= *first) {
                        let mut values = world.get(field, 0).expect("a field");
                        values[column - first] += eps;
                        world.set(field, 0, &values).expect("a world");
                    }
                    step(&mut world)
                };
                let [to, from] = [end(eps), end(-eps)];
                let mut expected = vec![0.0; nv];
                difference::<f64>(model.tables(), &from[0], &to[0], &mut expected);
                let ends = to[1..].iter().flatten().zip(from[1..].iter().flatten());
                expected.extend(ends.map(|(to, from)| to - from));
                let (wide, at) = if column < n { (n, column) } else { (nu, column - n) };
                let (states, sensors) = if column < n { (&found.a, &found.c) } else { (&found.b, &found.d) };
                let columns = (0..n).map(|i| states[n * wide + i * wide + at]);
                let columns = columns.chain((0..ns).map(|i| sensors[ns * wide + i * wide + at]));
                for (i, (x, expected)) in columns.zip(&expected).enumerate() {
                    let expected = expected / (2.0 * eps) + 0.0;
                    assert_eq!(
                        x.to_bits(),
                        expected.to_bits(),
                        "{name} {integrator} column {column} row {i}: {x} {expected}"
                    );
                }
            }
        }
    }
}

/// Matrices of derivatives of a world of its own.
fn matrices(worlds: &mut Worlds, target: &Target<'_>) -> Vec<Vec<f64>> {
    let arrays = target.arrays(worlds.model(), false);
    let mut all: Vec<Vec<f64>> = arrays.iter().map(|(_, dims, _)| vec![0.0; dims.iter().product()]).collect();
    let rows = all.iter_mut().map(|rows| Rows::F64(rows)).collect();
    let call = (&Scheme::default(), Solving::Accurate);
    worlds.derivatives_into(target, call.0, call.1, rows, Follow::default()).expect("derivatives");
    all
}

#[test]
fn columns_of_inverse_dynamics_are_differences() {
    for (name, integrator, discrete) in [
        ("zoo/ant", "Euler", "disable"),
        ("zoo/hopper", "implicitfast", "enable"),
        ("zoo/four_bar", "discrete", "disable"),
    ] {
        let model = load_with(name, &[("integrator", integrator), ("invdiscrete", discrete)]);
        let base =
            copied(&moving(&model, 2, 1.0, &Options::default()), &[1], &options(Precision::F64, Backend::Native));
        let nv = model.tables().sizes.nv;
        let qacc: Vec<f64> = (0..nv).map(|i| 0.3 * i as f64 - 1.0).collect();
        let target = Target::Inverse(Strided::new(Values::F64(&qacc), nv));
        let found = matrices(&mut copied(&base, &[0], &Options::default()), &target);
        for column in 0..3 * nv {
            let end = |eps: f64| {
                let mut world = copied(&base, &[0], &options(Precision::F64, Backend::Scalar));
                let (mut qacc, i) = (qacc.clone(), column % nv);
                match column / nv {
                    0 => {
                        let qpos = world.get(Field::Qpos, 0).expect("a field");
                        let (mut to, mut dq) = (qpos.clone(), vec![0.0; nv]);
                        dq[i] = eps;
                        displace::<f64>(model.tables(), &qpos, &dq, &mut to);
                        world.set(Field::Qpos, 0, &to).expect("a world");
                    }
                    1 => {
                        let mut qvel = world.get(Field::Qvel, 0).expect("a field");
                        qvel[i] += eps;
                        world.set(Field::Qvel, 0, &qvel).expect("a world");
                    }
                    _ => qacc[i] += eps,
                }
                world.inverse(&qacc).expect("forces")
            };
            for (row, (to, from)) in end(1e-6).iter().zip(end(-1e-6)).enumerate() {
                let (x, expected) = (found[column / nv][row * nv + column % nv], (to - from) / 2e-6 + 0.0);
                assert_eq!(x.to_bits(), expected.to_bits(), "{name} column {column} row {row}: {x} {expected}");
            }
        }
    }
}

#[test]
fn accelerations_of_ends_are_those_of_columns() {
    let model = accurate(&load("zoo/ant")).expect("a model");
    let base = copied(&moving(&model, 2, 1.0, &Options::default()), &[1], &Options::default());
    let found = matrices(&mut copied(&base, &[0], &Options::default()), &Target::Acceleration);
    let (nv, nu) = (model.tables().sizes.nv, model.tables().sizes.nu);
    let qacc = |change: Option<(Field, usize, f64)>| {
        let mut world = copied(&base, &[0], &Options::default());
        if let Some((field, i, eps)) = change {
            let mut values = world.get(field, 0).expect("a field");
            values[i] += eps;
            world.set(field, 0, &values).expect("a world");
        }
        let mut qacc = vec![0.0; nv];
        world.read_all(&["qacc"], vec![Rows::F64(&mut qacc)]).expect("accelerations");
        qacc
    };
    for (field, count) in [(Field::Qvel, nv), (Field::Ctrl, nu)] {
        for i in 0..count {
            let ends = [1e-6, -1e-6].map(|eps| qacc(Some((field, i, eps))));
            for row in 0..nv {
                let x = if field == Field::Qvel { found[0][row * 2 * nv + nv + i] } else { found[1][row * nu + i] };
                let expected = (ends[0][row] - ends[1][row]) / 2e-6;
                let scale = ends[0].iter().fold(1.0_f64, |most, x| most.max(x.abs()));
                assert!((x - expected).abs() < 1e-7 * scale, "{field:?} {i} row {row}: {x} {expected}");
            }
        }
    }
}

#[test]
fn controls_at_limits_are_one_sided() {
    let xml = "<mujoco><worldbody><body><joint name='j' type='slide'/><geom size='.1' mass='1'/></body></worldbody><actuator>
        <motor joint='j' ctrlrange='-1 1'/><motor joint='j' ctrlrange='-1 1'/><motor joint='j' ctrlrange='-1 1'/>
        <motor joint='j' ctrlrange='-1e-7 1e-7'/><motor joint='j'/><motor joint='j' ctrlrange='-1 1'/></actuator></mujoco>";
    let model = Model::from_xml_string(xml, &Default::default()).expect("a model");
    let mut worlds = Worlds::new(&model, 1, &Options::default()).expect("a batch");
    worlds.set(Field::Ctrl, 0, &[1.0, -1.0, 0.5, 0.0, 7.0, 2.0]).expect("a world");
    let slopes = |found: &Transition| found.b[6..].iter().map(|x| (x * 1e6).round() * 1e-6).collect::<Vec<_>>();
    let centred = worlds.transition(&Scheme::default()).expect("derivatives");
    assert_eq!(centred.sides, [2.0, 2.0, -1.0, 1.0, 2.0, 0.0, 2.0, 0.0]);
    assert_eq!(slopes(&centred), [0.002, 0.002, 0.002, 0.0, 0.002, 0.0]);
    let forward = worlds.transition(&Scheme { centred: false, ..Scheme::default() }).expect("derivatives");
    assert_eq!(forward.sides, [1.0, 1.0, -1.0, 1.0, 1.0, 0.0, 1.0, 0.0]);
    assert_eq!(slopes(&forward), slopes(&centred));
}

#[test]
fn states_without_derivatives_have_none_and_say_why() {
    let mut worlds = Worlds::new(&load("zoo/ant"), 4, &Options::default()).expect("a batch");
    let before = worlds.state_hash();
    let mut qpos = worlds.get(Field::Qpos, 1).expect("a field");
    qpos[3..7].fill(0.0);
    worlds.set(Field::Qpos, 1, &qpos).expect("a world");
    worlds.set_unchecked(Field::Qvel, 2, &[f64::NAN; 14]).expect("a world");
    let found = worlds.transition(&Scheme::default()).expect("derivatives");
    let none = |values: &[f64], id| of(values, id, 4).iter().all(|x| x.is_nan());
    for (id, lost) in [false, true, true, false].into_iter().enumerate() {
        assert_eq!((none(&found.a, id), none(&found.b, id)), (lost, lost), "world {id}");
        assert_eq!(of(&found.sides, id, 4).iter().all(|side| *side == 0.0), lost, "world {id}");
    }
    assert_eq!(found.status[1] as u32, Status::QUAT_ZERO.0);
    assert_eq!(found.status[2] as u32, Status::NON_FINITE_VEL.0);
    assert_eq!((found.status[0], found.status[3]), (0.0, 0.0));
    worlds.reset(1, None).expect("a world");
    worlds.reset(2, None).expect("a world");
    assert_eq!(worlds.state_hash(), before, "states stay as they are");
}

#[test]
fn single_precision_is_near() {
    let model = load("zoo/ant");
    let exact = moving(&model, 3, 1.0, &Options::default());
    let expected = copied(&exact, &[0, 1, 2], &Options::default()).transition(&Scheme::default()).expect("derivatives");
    let options = Options { precision: Precision::F32, ..Options::default() };
    let eps = Scheme::eps(Precision::F32, true);
    let found =
        copied(&exact, &[0, 1, 2], &options).transition(&Scheme { eps, ..Scheme::default() }).expect("derivatives");
    let scale = expected.a.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let smooth = expected.b.iter().zip(&found.b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(smooth < 2e-2 * scale, "{smooth}");
}

#[test]
fn bad_input_is_refused() {
    let model = load("zoo/ant");
    let array = |shape: &[usize], values: Vec<f64>| Array::new(shape.to_vec(), Data::F64(values)).expect("an array");
    let start = model.initial_key().qpos;
    let states = |qpos: Vec<f64>| {
        BTreeMap::from([
            ("qpos".to_owned(), array(&[1, 15], qpos)),
            ("qvel".to_owned(), array(&[1, 14], vec![0.0; 14])),
        ])
    };
    let run = |inputs: &BTreeMap<String, Array>, scheme: Scheme| {
        let call =
            Call { scheme, solving: Solving::Accurate, options: &Options::default(), progress: None, times: None };
        cloud::transition(&model, inputs, &call)
    };
    assert_eq!(run(&states(start.clone()), Scheme::default()).expect("derivatives")[0].1.shape(), [1, 28, 28]);
    for eps in [0.0, -1e-6, f64::NAN, f64::INFINITY, 2.0, 1e-13] {
        fails(run(&states(start.clone()), Scheme { eps, ..Scheme::default() }), "expected a number from 1e-12 to 1");
    }
    let mut bad = start.clone();
    bad[3..7].fill(0.0);
    fails(run(&states(bad), Scheme::default()), "array `qpos` holds a quaternion of length zero at [0, 3]");
    let mut bad = start.clone();
    bad[2] = f64::NAN;
    fails(run(&states(bad), Scheme::default()), "array `qpos` holds NaN at [0, 2]");
    let mut inputs = states(start.clone());
    inputs.insert("crtl".into(), array(&[1, 8], vec![0.0; 8]));
    fails(run(&inputs, Scheme::default()), "unknown input array crtl; did you mean \"ctrl\"?");
    let mut inputs = states(start.clone());
    inputs.insert("ctrl".into(), array(&[1, 7], vec![0.0; 7]));
    fails(run(&inputs, Scheme::default()), "ctrl has shape [1, 7]; expected [N, 8] or [nworld, nstep, 8]");
    let mut inputs = states(start.clone());
    inputs.insert("ctrl".into(), array(&[2, 8], vec![0.0; 16]));
    fails(run(&inputs, Scheme::default()), "leading dimensions");
    let mut inputs = states(start);
    inputs.remove("qvel");
    fails(run(&inputs, Scheme::default()), "there is no array qvel; give qpos and qvel");
}
