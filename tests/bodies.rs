//! Outputs of bodies and points: velocities, accelerations and forces against MuJoCo's, Jacobians against MuJoCo's and against
//! velocities; what they are of models that vary from world to world; and errors of what is asked for wrongly.

use crate::support::golden::{Failures, Golden};
use crate::support::{agree, load, options, parse};
use lanesim::outputs::{Output, Point};
use lanesim::{Backend, Field, Model, Options, Parameter, Precision, Rollout, Worlds};
use lanesim_kernels::options::Integrator;

const BODIES: [&str; 4] = ["cvel", "cacc", "cfrc_ext", "cfrc_int"];

/// The output of an element of this number: by its name if it has one, since others may be called like its number.
fn named(model: &Model, kind: &str, element: &str) -> String {
    let names = match kind {
        "jac_body" => &model.names().bodies,
        "jac_geom" => &model.names().geoms,
        _ => &model.names().sites,
    };
    let name = names.name(element.parse().expect("a number"));
    format!("{kind}:{}", if name.is_empty() { element } else { name })
}

/// Every model's bodies in its recorded states, judged by the largest entry of all.
fn bodies(precision: Precision, tolerances: [f64; 4], jacobians: f64) {
    let mut failures = Failures::default();
    for mut golden in Golden::all() {
        if precision == Precision::F32 {
            // Internal forces of a stack are what its solver's rounding leaves: up to one and a half times the tolerance in states within 1e-8 of these.
            golden.round("in/qpos");
        }
        let recorded = golden.bodies();
        let point = |name: &str| name.split_once('/').map(|(kind, element)| named(&golden.model, kind, element));
        let asked: Vec<String> = recorded.keys().map(|name| point(name).unwrap_or(name.clone())).collect();
        let names: Vec<&str> = asked.iter().map(String::as_str).collect();
        let ours = golden.eval(&names, 0, &options(precision, Backend::Auto));
        for (file, name) in recorded.keys().zip(&names) {
            let tolerance = BODIES.iter().position(|body| body == name).map_or(jacobians, |i| tolerances[i]);
            let expected = golden.rows(&recorded[file].to_f64());
            for (state, (got, expected)) in ours[*name].iter().zip(&expected).enumerate() {
                let place = || format!("{} state {state} {name}", golden.name);
                failures.check(place, agree(got, expected, tolerance, 1.0));
            }
        }
    }
    failures.report();
}

#[test]
fn bodies_are_mujocos_f64() {
    bodies(Precision::F64, [1e-10; 4], 1e-12);
}

#[test]
fn bodies_are_mujocos_f32() {
    bodies(Precision::F32, [1e-5, 3e-3, 3e-3, 3e-3], 2e-6);
}

/// Of a body, the Jacobian times the joints' velocity is its frame's velocity.
#[test]
fn jacobians_give_velocities() {
    let mut failures = Failures::default();
    for golden in Golden::all() {
        for body in 0..golden.model.tables().sizes.nbody {
            let name = named(&golden.model, "jac_body", &body.to_string());
            let found = golden.eval(&["xvel", "qvel", &name], 0, &Options::default());
            for state in 0..golden.states() {
                let qvel = &found["qvel"][state];
                let rows = found[&name][state].chunks_exact(qvel.len().max(1));
                let product: Vec<f64> = rows.map(|row| row.iter().zip(qvel).map(|(j, v)| j * v).sum()).collect();
                let xvel = &found["xvel"][state][6 * body..6 * body + 6];
                let [turn, shift] = [&xvel[..3], &xvel[3..]];
                if !qvel.is_empty() {
                    let place = || format!("{} state {state} {name}", golden.name);
                    failures.check(place, agree(&product, &[shift, turn].concat(), 1e-12, 1.0));
                }
            }
        }
    }
    failures.report();
}

/// What the state's acceleration takes is what actuators and forces from outside give; in discrete steps, whose acceleration is that over a
/// step, also what springs and dampers lose on the way.
#[test]
fn the_force_of_inverse_dynamics_is_what_is_applied() {
    let mut failures = Failures::default();
    for golden in Golden::all().iter().filter(|golden| {
        golden.model.tables().sizes.nv > 0 && golden.model.tables().options.integrator != Integrator::Discrete
    }) {
        let names = ["qfrc_inverse", "qfrc_smooth", "qfrc_bias", "qfrc_passive"];
        let found = golden.eval(&names, 0, &Options::default());
        let scale = |state: usize| found["qfrc_bias"][state].iter().fold(1.0_f64, |most, x| most.max(x.abs()));
        for state in 0..golden.states() {
            let [got, smooth, bias, passive] = names.map(|name| &found[name][state]);
            let applied: Vec<f64> = (0..got.len()).map(|i| smooth[i] + bias[i] - passive[i]).collect();
            let place = || format!("{} state {state}", golden.name);
            failures.check(place, agree(got, &applied, 1e-8, scale(state)));
        }
    }
    failures.report();
}

/// Worlds with masses of their own have the forces of a model that was compiled with them.
#[test]
fn forces_follow_masses_that_vary() {
    let xml = |masses: [f64; 3]| {
        let inertial = |mass: f64| {
            format!(
                "<inertial pos='0 .1 .2' mass='{mass}' diaginertia='{} {} {}'/>",
                0.02 * mass,
                0.03 * mass,
                0.04 * mass
            )
        };
        parse(&format!(
            "<mujoco><option gravity='0 1 -9'/><worldbody><body>{}<joint axis='0 1 0'/><body pos='.3 0 0'>{}</body>
               <body pos='0 .3 0'>{}<joint axis='1 0 0'/></body></body></worldbody></mujoco>",
            inertial(masses[0]),
            inertial(masses[1]),
            inertial(masses[2])
        ))
    };
    let (plain, heavy) = (xml([1.0, 2.0, 3.0]), xml([2.0, 5.0, 1.0]));
    let forces = |model: &Model, own: bool| {
        let mut worlds = Worlds::new(model, 2, &Options::default()).expect("worlds");
        if own {
            for (parameter, name) in [(Parameter::BodyMass, "body_mass"), (Parameter::BodyInertia, "body_inertia")] {
                let rows = match &heavy.array(name).expect("an array").data {
                    lanesim::model::ArrayData::F64(rows) => rows.clone(),
                    lanesim::model::ArrayData::I32(_) => vec![],
                };
                worlds.set_parameter(parameter, 1, &rows).expect("a parameter");
            }
        }
        worlds.set(Field::Qvel, 1, &[1.0, -2.0]).expect("a field");
        let outputs = ["cfrc_int", "cacc", "cvel"].map(|name| Output::named(name).expect("an output"));
        let mut found = vec![];
        worlds
            .forward(&outputs, &mut |world, arrays| {
                if world == 1 {
                    found = arrays.concat()
                }
            })
            .expect("outputs");
        found
    };
    let (ours, compiled) = (forces(&plain, true), forces(&heavy, false));
    assert_eq!(ours.len(), 3 * 4 * 6);
    agree(&ours, &compiled, 1e-13, 1.0).expect("the same");
    assert!(agree(&ours, &forces(&plain, false), 1e-3, 1.0).is_err());
}

/// Asked for in rollouts, too; the bits are those of the forward computation.
#[test]
fn rollouts_record_them() {
    let model = load("zoo/quadruped");
    let names = ["cvel", "cacc", "cfrc_ext", "cfrc_int", "qfrc_inverse", "jac_body:1", "jac_geom:3"];
    let outputs = names.map(|name| model.output(name).expect("an output"));
    for precision in [Precision::F64, Precision::F32] {
        let run = |backend: Backend| {
            let mut worlds = Worlds::new(&model, 3, &options(precision, backend)).expect("worlds");
            worlds.rollout(&Rollout { nstep: 60, outputs: &outputs, ..Rollout::default() }).expect("a rollout").outputs
        };
        let native = run(Backend::Native);
        assert_eq!(native, run(Backend::Wide));
        assert_eq!(native, run(Backend::Scalar));
        // In the end it stands: the floor carries it.
        let (nbody, g) = (model.tables().sizes.nbody, 9.81);
        let outside = &native[2][59 * 6 * nbody..60 * 6 * nbody];
        let lift: f64 = outside.chunks_exact(6).map(|force| force[5]).sum();
        let mass: f64 = model.tables().links.iter().map(|link| link.mass).sum();
        assert!(lift > 0.2 * mass * g && lift < 5.0 * mass * g, "{lift} N");
    }
}

#[test]
fn wrong_names_and_points_are_refused() {
    let model = parse(
        "<mujoco><worldbody><body name='arm'><joint/><geom name='rod' size='.1'/><site name='tip'/></body></worldbody></mujoco>",
    );
    let refused = |name: &str| model.output(name).expect_err("no such output").to_string();
    assert_eq!(refused("jac_site:tap"), "there is no site tap for the output jac_site:tap; did you mean \"tip\"?");
    assert_eq!(
        refused("jac_body:7"),
        "there is no body 7 for the output jac_body:7; the model has 2, which can be given by name or number, counted from 0"
    );
    assert!(refused("jac_sit:tip").contains("there is no output jac_sit:tip"), "{}", refused("jac_sit:tip"));
    assert_eq!(refused("cvl"), "there is no output cvl; did you mean \"cvel\"?");
    assert!(refused("jac_site:NAME").contains("there is no site NAME"));
    let text = Output::named("jac_site:tip").expect_err("no model").to_string();
    assert!(text.contains("Model::output"), "{text}");
    assert_eq!(model.output("jac_geom:rod").expect("an output").name(), "jac_geom:0");
    assert_eq!(Output::jac(Point::Geom(0)).name(), "jac_geom:0");
    let mut worlds = Worlds::new(&model, 1, &Options::default()).expect("worlds");
    let outputs = [Output::jac(Point::Site(1))];
    let error =
        worlds.rollout(&Rollout { nstep: 1, outputs: &outputs, ..Rollout::default() }).expect_err("no such site");
    assert_eq!(error.to_string(), "output jac_site of site 1: the model has 1, counted from 0");
    assert_eq!(worlds.forward(&outputs, &mut |_, _| ()).expect_err("no such site").to_string(), error.to_string());
}
