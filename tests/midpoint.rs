//! Midpoint steps: their order, what they keep, what they bear, and what they refuse. The exact motion is that of Runge-Kutta steps that
//! are far more accurate, or a closed formula.

use crate::support;
use crate::support::{load_with, options, parse, worst};
use lanesim::eval::eval;
use lanesim::mjcf::LoadOptions;
use lanesim::npz::{Array, Data};
use lanesim::{Backend, Field, Model, Precision, Worlds};
use std::collections::BTreeMap;

const PENDULUM: &str = "<mujoco><worldbody><body><joint axis='0 1 0'/>
    <inertial pos='0 0 -.5' mass='1' diaginertia='.02 .02 .02'/></body></worldbody></mujoco>";
const DOUBLE: &str = "<mujoco><default><geom type='cylinder' fromto='0 0 0 0 0 -.4' size='.02' mass='.4' contype='0'
    conaffinity='0'/><joint axis='0 1 0'/></default>
    <worldbody><body><joint/><geom/><body pos='0 0 -.4'><joint/><geom/></body></body></worldbody></mujoco>";
const TUMBLING: &str = "<mujoco><option gravity='0 0 0'/><worldbody><body><freejoint/>
    <inertial pos='0 0 0' mass='1' diaginertia='.010 .015 .022'/></body></worldbody></mujoco>";
/// An arm and a tip on servos that are stiffer than any step.
const SERVO: &str = "<mujoco><default><joint axis='0 1 0'/></default><worldbody><body><joint name='arm'/>
    <inertial pos='.3 0 0' mass='2' diaginertia='.06 .06 .06'/><body pos='.6 0 0'><joint name='tip'/>
    <inertial pos='.01 0 0' mass='.005' diaginertia='5e-7 5e-7 5e-7'/></body></body></worldbody>
    <actuator><position joint='arm' kp='20000' kv='200'/><position joint='tip' kp='1000' kv='1'/></actuator></mujoco>";

fn with(text: &str, integrator: &str, timestep: f64) -> Model {
    let given = [("integrator", integrator.to_string()), ("timestep", timestep.to_string())];
    let overrides = given.map(|(name, value)| (name.to_string(), value)).to_vec();
    Model::from_xml_string(text, &LoadOptions { overrides, ..LoadOptions::default() }).expect("a model")
}

/// Positions every 20 ms, and the last velocities.
fn run(model: &Model, precision: Precision, (qpos, qvel): (&[f64], &[f64]), time: f64) -> (Vec<Vec<f64>>, Vec<f64>) {
    let mut worlds = Worlds::new(model, 1, &options(precision, Backend::Wide)).expect("a batch");
    worlds.set(Field::Qpos, 0, qpos).expect("a state");
    worlds.set(Field::Qvel, 0, qvel).expect("a state");
    let every = (0.02 / model.tables().options.timestep).round() as usize;
    let mut path = Vec::new();
    for _ in 0..(time / 0.02).round() as usize {
        worlds.step(every).expect("steps");
        path.push(worlds.get(Field::Qpos, 0).expect("positions"));
    }
    (path, worlds.get(Field::Qvel, 0).expect("velocities"))
}

/// Root of the mean square of what two paths differ by.
fn apart(a: &[Vec<f64>], b: &[Vec<f64>]) -> f64 {
    let squares: Vec<f64> = a.concat().iter().zip(b.concat()).map(|(x, y)| (x - y) * (x - y)).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// Errors at 4, 2 and 1 ms.
fn errors(text: &str, precision: Precision, start: (&[f64], &[f64]), time: f64) -> [f64; 3] {
    let exact = run(&with(text, "RK4", 0.0005), Precision::F64, start, time).0;
    [0.004, 0.002, 0.001].map(|h| apart(&run(&with(text, "midpoint", h), precision, start, time).0, &exact))
}

fn order([coarse, _, fine]: [f64; 3]) -> f64 {
    (coarse / fine).log2() / 2.0
}

#[test]
fn a_pendulum_is_of_order_two() {
    for angle in [60.0_f64, 120.0] {
        let found = errors(PENDULUM, Precision::F64, (&[angle.to_radians()], &[0.0]), 10.0);
        assert!((order(found) - 2.0).abs() < 0.1, "{angle}: {found:?}");
        assert!(found[1] < 5e-5, "{angle}: {found:?}");
    }
}

#[test]
fn a_double_pendulum_is_of_order_two() {
    let found = errors(DOUBLE, Precision::F64, (&[0.9, -0.5], &[0.0; 2]), 5.0);
    assert!((order(found) - 2.0).abs() < 0.15, "{found:?}");
    assert!(found[1] < 5e-5, "{found:?}");
}

#[test]
fn single_precision_is_near_double_precision() {
    for (text, start, range) in
        [(PENDULUM, (&[2.0_f64][..], &[0.0][..]), 4.0), (DOUBLE, (&[0.9, -0.5][..], &[0.0, 0.0][..]), 2.0)]
    {
        let model = with(text, "midpoint", 0.002);
        let [single, double] = [Precision::F32, Precision::F64].map(|precision| run(&model, precision, start, 2.0).0);
        assert!(apart(&single, &double) < 1e-4 * range, "{}", apart(&single, &double));
    }
}

/// A body that turns over again and again: energy is kept but for rounding.
#[test]
fn a_free_body_keeps_its_energy() {
    let (inertia, spin) = ([0.010, 0.015, 0.022], [0.01, 10.0, 0.01]);
    let start: (&[f64], &[f64]) = (&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], &[1.0, -2.0, 0.5, 0.01, 10.0, 0.01]);
    let energy = |w: &[f64]| (0..3).map(|k| inertia[k] * w[k] * w[k]).sum::<f64>();
    let exact = run(&with(TUMBLING, "RK4", 0.0005), Precision::F64, start, 10.0).0;
    let (path, velocity) = run(&with(TUMBLING, "midpoint", 0.002), Precision::F64, start, 10.0);
    assert!((energy(&velocity[3..]) / energy(&spin) - 1.0).abs() < 1e-11, "{velocity:?}");
    assert_eq!(velocity[..3], start.1[..3]);
    let turned = |(a, b): (&Vec<f64>, &Vec<f64>)| {
        let off = |sign: f64| (3..7).map(|k| (a[k] - sign * b[k]).powi(2)).sum::<f64>().sqrt();
        2.0 * off(1.0).min(off(-1.0))
    };
    let error = path.iter().zip(&exact).map(turned).fold(0.0, f64::max);
    assert!(error < 2e-4, "{error}");
}

/// At rest, what a servo lacks is the weight that it bears by its stiffness.
#[test]
fn stiff_servos_hold() {
    for (precision, tolerance) in [(Precision::F64, 1e-9), (Precision::F32, 1e-5)] {
        for h in [0.002, 0.01] {
            let (path, velocity) = run(&with(SERVO, "midpoint", h), precision, (&[0.0; 2], &[0.0; 2]), 4.0);
            let end = path.last().expect("a position");
            let weight = |lever: f64, mass: f64| 9.81 * mass * lever;
            let (a, b) = (end[0], end[0] + end[1]);
            let tip = weight(0.01 * b.cos(), 0.005);
            let arm = weight(0.3 * a.cos(), 2.0) + weight(0.6 * a.cos(), 0.005) + tip;
            assert!((2e4 * a - arm).abs() / 2e4 < tolerance, "{precision:?} {h}: {end:?} {arm}");
            assert!((1e3 * end[1] - tip).abs() / 1e3 < tolerance, "{precision:?} {h}: {end:?} {tip}");
            assert!(worst(&velocity, &[0.0; 2]).1 < 100.0 * tolerance, "{velocity:?}");
        }
    }
}

/// A spring with a damper moves as with exact time, whatever the step.
#[test]
fn springs_and_dampers_are_exact() {
    let text = "<mujoco><option gravity='0 0 0'/><worldbody><body><joint type='slide' stiffness='300' damping='4'/>
        <geom size='.1' mass='2'/></body></worldbody></mujoco>";
    let (k, b, m, h): (f64, f64, f64, f64) = (300.0, 4.0, 2.0, 0.02);
    let (rate, turn) = (0.5 * b / m, (k / m - 0.25 * b * b / (m * m)).sqrt());
    let path = run(&with(text, "midpoint", h), Precision::F64, (&[0.1], &[0.0]), 4.0).0;
    // Trace and determinant of the map are exact, so that every third position follows from two.
    let (trace, determinant) = (2.0 * (-rate * h).exp() * (turn * h).cos(), (-2.0 * rate * h).exp());
    for three in path.windows(3) {
        let expected = trace * three[1][0] - determinant * three[0][0];
        assert!((three[2][0] - expected).abs() < 1e-14, "{three:?}");
    }
}

/// What is looked at is of the state, with the acceleration of continuous time; looking changes no bits.
#[test]
fn outputs_are_of_the_state() {
    let row = |x: &[f64]| Array::new(vec![1, x.len()], Data::F64(x.to_vec())).expect("an array");
    let inputs = BTreeMap::from([("qpos".to_string(), row(&[0.9, -0.5])), ("qvel".to_string(), row(&[1.0, 2.0]))]);
    let evaluate = |integrator| {
        let fields = ["qacc", "xpos", "qfrc_bias"];
        let found = eval(&with(DOUBLE, integrator, 0.01), &inputs, &fields, 0, &options(Precision::F64, Backend::Wide));
        let found: BTreeMap<_, _> = found.expect("an evaluation").into_iter().collect();
        fields.map(|name| found[name].to_f64().into_owned())
    };
    assert_eq!(evaluate("midpoint"), evaluate("RK4"));
    let model = load_with("zoo/humanoid27", &[("integrator", "midpoint")]);
    let mut worlds =
        [0, 1].map(|_| Worlds::new(&model, 3, &support::options(Precision::F64, Backend::Auto)).expect("a batch"));
    let outputs = ["xpos", "qacc", "ncon"].map(|name| model.output(name).expect("an output"));
    for outputs in [&[][..], &outputs] {
        let world = &mut worlds[usize::from(!outputs.is_empty())];
        world.rollout(&lanesim::Rollout { nstep: 200, outputs, ..Default::default() }).expect("a rollout");
    }
    assert_eq!(worlds[0].state_hash(), worlds[1].state_hash());
}

#[test]
fn what_midpoint_steps_refuse() {
    let body =
        "<worldbody><body><joint name='a'/><geom name='g' size='.1'/><body><joint name='b'/><geom size='.1'/></body>
        <body><joint name='c'/><geom size='.1'/></body></body></worldbody>";
    let refused = |rest: &str, overrides: &[(&str, &str)]| {
        let text = format!("<mujoco><option integrator='midpoint'/>{body}{rest}</mujoco>");
        let overrides = overrides.iter().map(|(k, v)| (k.to_string(), v.to_string())).collect();
        let model = Model::from_xml_string(&text, &LoadOptions { overrides, ..LoadOptions::default() });
        model.map(drop).expect_err("a refusal").to_string()
    };
    let pad = "<actuator><adhesion name='pad' body='1' ctrlrange='0 1'/></actuator>";
    for (rest, says) in [
        (pad, "integrator midpoint does not support"),
        (
            "<tendon><fixed name='t' damping='1'><joint joint='b' coef='1'/><joint joint='c' coef='1'/></fixed></tendon>",
            "along a tendon between branches is not supported under integrator midpoint",
        ),
    ] {
        let message = refused(rest, &[]);
        assert!(message.contains(says), "{message}");
    }
    for timestep in ["0", "nan", "-1"] {
        let message = refused("", &[("timestep", timestep)]);
        assert!(message.contains("timestep"), "{message}");
    }
}

/// A step of a thousand seconds loses a world or keeps it, and says so.
#[test]
fn huge_steps_end() {
    for guard in ["enable", "disable"] {
        let model = load_with("zoo/ant", &[("integrator", "midpoint"), ("timestep", "1000"), ("guard", guard)]);
        let mut worlds = Worlds::new(&model, 2, &support::options(Precision::F32, Backend::Wide)).expect("a batch");
        worlds.step(20).expect("steps");
        assert!(worlds.get(Field::Qpos, 0).expect("positions").iter().all(|x| x.is_finite()));
    }
}

#[test]
fn inverse_dynamics_of_a_state_are_those_of_continuous_time() {
    let [ours, euler] = ["midpoint", "Euler"].map(|integrator| {
        let model = load_with("zoo/quadruped", &[("integrator", integrator)]);
        let mut worlds = Worlds::new(&model, 1, &support::options(Precision::F64, Backend::Wide)).expect("a batch");
        let qacc = vec![0.3; model.tables().sizes.nv];
        worlds.inverse(&qacc).expect("forces")
    });
    assert_eq!(ours, euler);
    let model = parse(
        &DOUBLE.replace("<default>", "<option integrator='midpoint'><flag invdiscrete='enable'/></option><default>"),
    );
    let mut worlds = Worlds::new(&model, 1, &support::options(Precision::F64, Backend::Wide)).expect("a batch");
    support::fails(
        worlds.inverse(&[0.0; 2]),
        "flag invdiscrete: inverse dynamics of a step do not go with integrator midpoint, which evaluates other states (set \
         integrator=\"implicitfast\", or leave out invdiscrete)",
    );
}
