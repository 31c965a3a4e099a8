//! The guard: no world is lost to its own inertia, what it books is kept with the state, and where it has nothing to do it does nothing.

use crate::support;
use crate::support::{Random, fails, load_with, options};
use lanesim::mjcf::LoadOptions;
use lanesim::{Backend, Controls, Field, Model, Options, Parameter, Precision, Rollout, Worlds};
use lanesim_kernels::state::Status;

const INTEGRATORS: [&str; 5] = ["Euler", "implicitfast", "implicit", "discrete", "midpoint"];
/// Ten links that swing undamped.
const CHAIN: usize = 10;

fn guarded(name: &str, integrator: &str, timestep: &str) -> Model {
    load_with(name, &[("integrator", integrator), ("timestep", timestep), ("guard", "enable")])
}

/// Humanoids whose joints turn at 15 rad/s, and whose motors are switched between their ends ten times a second.
fn wild(model: &Model, nworld: usize, options: &Options) -> (Worlds, Vec<f64>) {
    let mut worlds = Worlds::new(model, nworld, options).expect("a batch");
    let sizes = &model.tables().sizes;
    let hold = (0.1 / model.tables().options.timestep).round() as usize;
    let mut controls = vec![];
    for world in 0..nworld {
        let mut random = Random(world as u64 + 1);
        let mut qvel = random.vector(sizes.nv, 26.0);
        qvel[..6].fill(0.0);
        worlds.set(Field::Qvel, world, &qvel).expect("a state");
        for _ in 0..20 {
            let ends: Vec<f64> =
                (0..sizes.nu).map(|a| model.control_range(a)[usize::from(random.uniform(0.0, 1.0) < 0.5)]).collect();
            (0..hold).for_each(|_| controls.extend_from_slice(&ends));
        }
    }
    (worlds, controls)
}

#[test]
fn wild_worlds_are_not_lost() {
    for integrator in ["Euler", "midpoint"] {
        for precision in [Precision::F64, Precision::F32] {
            let model = guarded("zoo/humanoid27", integrator, "0.01");
            let options = Options { precision, threads: Some(2), ..Options::default() };
            let (mut worlds, controls) = wild(&model, 64, &options);
            let nstep = controls.len() / 64 / model.tables().sizes.nu;
            let controls = Controls::Given(&controls);
            let run =
                worlds.rollout(&Rollout { nstep, controls, statistics: true, ..Rollout::default() }).expect("a run");
            assert_eq!(worlds.lost(), 0, "{integrator} {precision:?}");
            // It has to act for that, and says so.
            let share = run.statistics.per_world_step(run.statistics.guarded);
            assert!(share > 0.01 && share < 1.0, "{integrator} {precision:?}: {share}");
            let acted =
                (0..64).filter(|world| worlds.status(*world).expect("a status").contains(Status::GUARDED)).count();
            assert!(acted > 32, "{integrator} {precision:?}: {acted}");
        }
    }
}

fn chain(timestep: f64, integrator: &str) -> Model {
    let (mut open, mut close) = (String::new(), String::new());
    for i in 0..CHAIN {
        open += &format!(
            "<body pos='{} 0 0'><joint axis='0 1 0'/><geom type='capsule' fromto='0 0 0 .2 0 0' size='.01' mass='.2'
              contype='0' conaffinity='0'/>",
            if i == 0 { 0.0 } else { 0.2 }
        );
        close += "</body>";
    }
    let text = format!(
        "<mujoco><option timestep='{timestep}' integrator='{integrator}' guard='enable'/>
          <worldbody>{open}{close}</worldbody></mujoco>"
    );
    support::parse(&text)
}

#[test]
fn undamped_chains_are_not_lost() {
    for integrator in ["Euler", "midpoint"] {
        for precision in [Precision::F64, Precision::F32] {
            for timestep in [0.005, 0.02] {
                let mut worlds =
                    Worlds::new(&chain(timestep, integrator), 1, &options(precision, Backend::Wide)).expect("a batch");
                worlds.step((10.0 / timestep) as usize).expect("steps");
                assert_eq!(worlds.lost(), 0, "{integrator} {precision:?} {timestep}");
                let speeds = worlds.get(Field::Qvel, 0).expect("velocities");
                assert!(support::largest(&speeds) < 200.0, "{integrator} {precision:?} {timestep}: {speeds:?}");
            }
        }
    }
}

/// A world's bits with a guard depend on nothing beside it, nor on what runs it.
#[test]
fn bits_are_a_worlds_own() {
    for integrator in INTEGRATORS {
        for (name, timestep) in [("zoo/humanoid27", "0.01"), ("zoo/capsule_pile", "0.005"), ("zoo/chain31", "0.01")] {
            let model = guarded(name, integrator, timestep);
            for precision in [Precision::F64, Precision::F32] {
                let hashes = |nworld: usize, backend| {
                    let mut worlds = wild(&model, nworld, &options(precision, backend)).0;
                    worlds.step(100).expect("steps");
                    [0, 1].map(|world| {
                        let of = |field| worlds.get(field, world).expect("a field");
                        [of(Field::Qpos), of(Field::Qvel), of(Field::TreeGuard)]
                            .concat()
                            .iter()
                            .map(|x| x.to_bits())
                            .collect::<Vec<_>>()
                    })
                };
                let expected = hashes(2, Backend::Scalar);
                for (nworld, backend) in [(17, Backend::Wide), (5, Backend::Native)] {
                    assert!(hashes(nworld, backend) == expected, "{name} {integrator} {precision:?} {backend:?}");
                }
            }
        }
    }
}

/// What is saved continues as if nothing had happened; what is set from outside starts new books.
#[test]
fn books_are_part_of_the_state() {
    let model = guarded("zoo/humanoid27", "midpoint", "0.01");
    for precision in [Precision::F64, Precision::F32] {
        let (mut whole, _) = wild(&model, 3, &options(precision, Backend::Wide));
        whole.step(30).expect("steps");
        let mut resumed = Worlds::new(&model, 3, &options(precision, Backend::Wide)).expect("a batch");
        for world in 0..3 {
            for (field, _) in Field::ALL {
                resumed.set(field, world, &whole.get(field, world).expect("a field")).expect("a field");
            }
        }
        let books = whole.get(Field::TreeGuard, 0).expect("books");
        assert_eq!(books.len(), 15);
        assert!(books[0].abs() > 1.0 && books[2] > 1.0, "{books:?}");
        whole.step(50).expect("steps");
        resumed.step(50).expect("steps");
        assert_eq!(whole.state_hash(), resumed.state_hash());
        for field in [Field::Qpos, Field::Qvel] {
            let values = whole.get(field, 1).expect("a field");
            whole.set(field, 1, &values).expect("a field");
            assert_eq!(whole.get(Field::TreeGuard, 1).expect("books"), [0.0; 15]);
            whole.step(1).expect("a step");
        }
        assert_ne!(whole.get(Field::TreeGuard, 1).expect("books"), [0.0; 15]);
        whole.reset_all(None, None).expect("a reset");
        assert_eq!(whole.get(Field::TreeGuard, 2).expect("books"), [0.0; 15]);
    }
}

/// Where steps resolve the motion, the guard is silent, and leaves it but for rounding.
#[test]
fn it_is_silent_where_steps_resolve_the_motion() {
    for integrator in INTEGRATORS {
        let run = |guard: &str| {
            let given = [("integrator", integrator), ("timestep", "0.001"), ("guard", guard)];
            let mut worlds =
                Worlds::new(&load_with("zoo/quadruped", &given), 1, &options(Precision::F64, Backend::Wide))
                    .expect("a batch");
            let done = worlds.rollout(&Rollout { nstep: 200, statistics: true, ..Rollout::default() }).expect("a run");
            (worlds.get(Field::Qpos, 0).expect("positions"), done.statistics.guarded)
        };
        let ((with, acted), (without, _)) = (run("enable"), run("disable"));
        assert_eq!(acted, 0.0, "{integrator}");
        assert!(support::worst(&with, &without).1 < 1e-3, "{integrator}: {:?}", support::worst(&with, &without));
    }
}

/// Without the option there are no books.
#[test]
fn without_it_nothing_is_kept() {
    let model = load_with("zoo/humanoid27", &[]);
    assert_eq!(Field::TreeGuard.len(&model), 0);
    assert_eq!(load_with("zoo/humanoid27", &[("guard", "disable")]).tables().sizes.nguard, 0);
}

#[test]
fn what_it_refuses_and_notes() {
    let load = |body: &str, options: &str| {
        let text = format!("<mujoco><option guard='enable' {options}/><worldbody>{body}</worldbody></mujoco>");
        Model::from_xml_string(&text, &LoadOptions::default())
    };
    let arm = "<body><joint/><geom size='.1' pos='.1 0 0'/><body pos='.2 0 0'><joint/><geom size='.1' pos='.1 0 0'/></body></body>";
    let error = load(arm, "integrator='RK4'").map(drop).expect_err("a refusal").to_string();
    assert!(error.contains("the guard under integrator RK4 is not supported (set integrator=\"midpoint\""), "{error}");
    for body in
        ["", "<geom size='1'/>", "<body><freejoint/><geom size='.1'/></body>", "<body><joint/><geom size='.1'/></body>"]
    {
        let notes = load(body, "").expect("a model").report().notes.join("; ");
        assert!(notes.contains("option guard has no effect"), "{body}: {notes}");
    }
    assert!(load(arm, "").expect("a model").report().notes.is_empty());
    let error = Model::from_xml_string("<mujoco><option guard='yes'/></mujoco>", &LoadOptions::default());
    let error = error.map(drop).expect_err("a refusal").to_string();
    assert!(error.contains("guard"), "{error}");
    // Springs are fitted to inertias of the model.
    let model = load_with("zoo/quadruped", &[("integrator", "midpoint")]);
    let mut worlds = Worlds::new(&model, 1, &options(Precision::F64, Backend::Wide)).expect("a batch");
    let mass = Parameter::BodyMass.of(&model).to_vec();
    fails(
        worlds.set_parameter(Parameter::BodyMass, 0, &mass),
        "body_mass cannot differ between worlds of this model: springs and dampers are fitted to inertias by midpoint steps, \
         and would be stale",
    );
}
