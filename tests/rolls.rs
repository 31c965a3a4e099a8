//! Rollouts of models whose state is more than positions, velocities and activations, or whose actuators have several controls, against
//! MuJoCo's; what such worlds keep, and what is refused of such models.

use std::collections::BTreeMap;

use crate::support;
use crate::support::golden::Failures;
use crate::support::{agree, load_with, options, parse, repository};
use lanesim::npz::{self, Array};
use lanesim::outputs::Output;
use lanesim::{Backend, Controls, Field, Model, Precision, Rollout, Worlds};

const NAMES: [&str; 5] = ["delays", "springyield", "controllers", "dcmotor", "orientation"];
const INTEGRATORS: [&str; 5] = ["Euler", "RK4", "implicitfast", "implicit", "discrete"];
const CONVERGED: [(&str, &str); 3] = [("tolerance", "1e-14"), ("ls_tolerance", "1e-6"), ("iterations", "200")];

fn recorded(name: &str) -> BTreeMap<String, Array> {
    npz::read(&repository("tests/goldens/rolls").join(format!("{name}.npz"))).expect("a recording")
}

/// A model with an integrator, and worlds of it where a recording begins.
fn start(name: &str, integrator: &str, recording: &BTreeMap<String, Array>, backend: (Precision, Backend)) -> Worlds {
    let overrides = [&CONVERGED[..], &[("integrator", integrator)]].concat();
    let model = load_with(&format!("unit/{name}"), &overrides);
    let mut worlds = Worlds::new(&model, 3, &options(backend.0, backend.1)).expect("worlds");
    let key = (!model.keys().is_empty()).then_some(0);
    worlds.reset_all(None, key).expect("a reset");
    let qvel = recording["start/qvel"].to_f64();
    (0..3).for_each(|world| worlds.set(Field::Qvel, world, &qvel).expect("velocities"));
    worlds
}

/// How far rollouts of one precision may be from MuJoCo's: rounding grows along the way, and where a spring yields, or a sample is told, may
/// be a rounding to either side.
fn rolls(precision: Precision, tolerance: f64) {
    let mut failures = Failures::default();
    for name in NAMES {
        let recording = recorded(name);
        for integrator in INTEGRATORS {
            for backend in [Backend::Native, Backend::Wide, Backend::Scalar] {
                let mut worlds = start(name, integrator, &recording, (precision, backend));
                let ctrl = recording.get("ctrl").map_or(Vec::new(), |ctrl| ctrl.to_f64().into_owned());
                let nstep = recording[&format!("{integrator}/qpos")].shape()[0];
                let fields: Vec<&str> = ["qpos", "qvel", "act", "history", "plastic", "sensordata"]
                    .into_iter()
                    .filter(|field| recording.contains_key(&format!("{integrator}/{field}")))
                    .collect();
                let outputs: Vec<Output> = fields.iter().map(|name| Output::named(name).expect("an output")).collect();
                let given = ctrl.repeat(3);
                let rollout =
                    Rollout { nstep, controls: Controls::Given(&given), outputs: &outputs, ..Rollout::default() };
                let found = worlds.rollout(&rollout).expect("a rollout");
                for (field, found) in fields.iter().zip(&found.outputs) {
                    let expected = recording[&format!("{integrator}/{field}")].to_f64();
                    let third = found.len() / 3;
                    let place = || format!("{name} {integrator} {backend:?} {field}");
                    failures.check(place, agree(&found[2 * third..], &expected, tolerance, 1.0));
                }
            }
        }
    }
    failures.report();
}

#[test]
fn rollouts_are_mujocos_f64() {
    rolls(Precision::F64, 1e-9);
}

#[test]
fn rollouts_are_mujocos_f32() {
    rolls(Precision::F32, 1e-4);
}

/// A servo's bound is that of the length of its torque, which keeps its direction.
#[test]
fn torques_of_servos_are_shortened() {
    let text = |bound: &str| {
        format!(
            "<mujoco><worldbody><body><joint name='j' type='ball'/><geom size='.1'/></body></worldbody>
             <actuator><orientation joint='j' kp='20' kv='3' {bound}/></actuator></mujoco>"
        )
    };
    let forces = |bound: &str| {
        let model = parse(&text(bound));
        let mut worlds = Worlds::new(&model, 1, &options(Precision::F64, Backend::Auto)).expect("worlds");
        worlds.set(Field::Ctrl, 0, &[0.8, 0.3, -0.2]).expect("controls");
        worlds.set(Field::Qvel, 0, &[0.5, -0.4, 0.3]).expect("velocities");
        let outputs = [Output::named("actuator_force").expect("an output")];
        let rollout = Rollout { nstep: 1, outputs: &outputs, ..Rollout::default() };
        worlds.rollout(&rollout).expect("a rollout").outputs.remove(0)
    };
    // MuJoCo's.
    agree(&forces(""), &[14.5, 7.2, -4.9], 1e-12, 1.0).expect("the torque");
    let shortened = forces("forcerange='0 0.5'");
    agree(&shortened, &[0.428_627, 0.212_835, -0.144_846], 1e-6, 1.0).expect("the torque of that length");
}

/// A reset puts histories and yielded springs back, and a world that goes on from a state that was read goes on as the first did.
#[test]
fn states_are_complete() {
    for name in ["delays", "springyield", "dcmotor"] {
        let recording = recorded(name);
        for precision in [Precision::F64, Precision::F32] {
            let mut worlds = start(name, "Euler", &recording, (precision, Backend::Auto));
            let model = worlds.model().clone();
            let noise =
                |nstep| Rollout { nstep, controls: Controls::Noise { seed: 5, scale: 1.0 }, ..Rollout::default() };
            let fresh =
                |worlds: &Worlds| [Field::History, Field::Plastic].map(|field| worlds.get(field, 0).expect("a field"));
            let first = fresh(&worlds);
            worlds.rollout(&noise(30)).expect("a rollout");
            assert_ne!(first, fresh(&worlds));
            let mut copy = support::copied(&worlds, &[0, 1, 2], &options(precision, Backend::Scalar));
            worlds.rollout(&noise(7)).expect("a rollout");
            copy.rollout(&noise(7)).expect("a rollout");
            for (field, _) in Field::ALL {
                assert_eq!(
                    worlds.get(field, 1).expect("a field"),
                    copy.get(field, 1).expect("a field"),
                    "{name} {field:?}"
                );
            }
            worlds.reset_all(None, (!model.keys().is_empty()).then_some(0)).expect("a reset");
            assert_eq!(first, fresh(&worlds), "{name}");
        }
    }
}

/// What comes from outside may be any number: a world whose history is nonsense is its own affair.
#[test]
fn nonsense_in_a_history_stays_in_its_world() {
    let recording = recorded("delays");
    for backend in [Backend::Native, Backend::Scalar] {
        let mut worlds = start("delays", "Euler", &recording, (Precision::F64, backend));
        let len = worlds.get(Field::History, 0).expect("a history").len();
        for (world, x) in [(0, f64::NAN), (2, 1e300)] {
            worlds.set_unchecked(Field::History, world, &vec![x; len]).expect("a history");
        }
        let mut alone = start("delays", "Euler", &recording, (Precision::F64, Backend::Scalar));
        for run in [&mut worlds, &mut alone] {
            let rollout =
                Rollout { nstep: 20, controls: Controls::Noise { seed: 1, scale: 1.0 }, ..Rollout::default() };
            run.rollout(&rollout).expect("a rollout");
        }
        let of = |worlds: &Worlds| worlds.get(Field::Qpos, 1).expect("positions");
        assert_eq!(of(&worlds), of(&alone));
    }
}

#[track_caller]
fn refused(text: &str, expected: &str) {
    let problem = Model::from_xml_string(text, &Default::default()).expect_err("not refused").to_string();
    assert!(problem.contains(expected), "{problem}");
}

#[test]
fn histories_and_controllers_that_cannot_be() {
    let with = |inside: &str| {
        format!(
            "<mujoco><worldbody><site name='w'/><body name='b'><joint name='j'/><geom size='.1' pos='.3 0 0'/><site name='s'/></body>
             <body><joint name='k' type='ball'/><geom size='.1'/></body></worldbody>{inside}</mujoco>"
        )
    };
    let sensor = |sensor: &str, expected: &str| refused(&with(&format!("<sensor>{sensor}</sensor>")), expected);
    sensor("<clock delay='.1'/>", "delay 0.1, but it keeps no samples (give nsample, at least delay over timestep)");
    sensor("<clock nsample='2' delay='-1'/>", "delay is negative");
    sensor("<clock nsample='-1'/>", "nsample must not be negative (give 0 for none)");
    sensor("<clock nsample='2' interval='.1 .1'/>", "its interval has the phase 0.1");
    sensor("<clock nsample='2' interval='.1 -.2'/>", "its interval has the phase -0.2");
    sensor("<clock nsample='2' interp='spline'/>", "interp");
    sensor("<clock nsample='16000000'/>", "histories have 32000002 numbers (use at most 10000000)");
    let check = |actuator: &str, expected: &str| refused(&with(&format!("<actuator>{actuator}</actuator>")), expected);
    check("<motor joint='j' delay='.1'/>", "delay 0.1, but it keeps no samples");
    check("<pid joint='j' input='vel pos'/>", "\"vel pos\" are not once each and in order");
    check("<pid joint='j' input='vel' ki='1'/>", "it follows a position, and is told none (add pos to its inputs)");
    check("<pid joint='j' kv='1' dampratio='1'/>", "both kv and dampratio are given");
    check("<pid joint='j' ki='-1'/>", "ki must not be negative");
    check("<pid joint='j' input='voltage'/>", "its inputs are none that it can have");
    check("<general joint='j' gaintype='pid'/>", "its gaintype, biastype and dyntype do not go together");
    check("<general joint='j' dyntype='dcmotor'/>", "its gaintype, biastype and dyntype do not go together");
    check("<dcmotor joint='j'/>", "its resistance is 0 (give resistance, or nominal)");
    check("<dcmotor joint='j' resistance='1'/>", "its torque constant is 0 (give motorconst, or nominal)");
    check("<dcmotor joint='j' resistance='1' motorconst='1' controller='1'/>", "a controller that is told nothing");
    check("<dcmotor joint='j' resistance='1' motorconst='1' lugre='1'/>", "bristles (lugre) with the friction 0 0");
    check("<dcmotor joint='j' resistance='1' motorconst='1' thermal='1'/>", "attribute \"thermal\"");
    check(
        "<dcmotor joint='j' resistance='1' motorconst='1' input='none' nsample='2'/>",
        "nsample, but it has no control",
    );
    check("<orientation joint='j'/>", "it turns a joint that is no ball (name a ball joint)");
    check("<orientation site='s'/>", "it turns neither a ball joint nor a site against another");
    check("<orientation joint='k' forcerange='-1 1'/>", "its forcerange bounds the length of its torque");
    check("<orientation joint='k' input='euler'/>", "\"euler\" is unknown");
    let joint = with("").replace("<joint name='j'/>", "<joint name='j' type='free' springyield='1'/>");
    refused(&joint, "springyield, but the spring of a free joint does not yield (remove it)");
    let tendon = "<option integrator='RK4'/><tendon><spatial springyield='1'><site site='s'/><site site='w'/></spatial></tendon>";
    refused(&with(tendon), "springyield along a path is not supported under integrator RK4");
    parse(&with(&tendon.replace("RK4", "implicitfast")));
}
