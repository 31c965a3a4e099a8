//! Steps of every integrator: against MuJoCo, against derivatives by differences, against closed solutions; and what is recorded of them.

use crate::support;
use crate::support::golden::{Failures, Golden};
use crate::support::{NOT_DISCRETE, Random, agree, all_models, load, load_with, options, parse};
use lanesim::outputs::Output;
use lanesim::{Backend, Controls, Field, Model, Options, Precision, Rollout, Worlds};
use lanesim_kernels::derivative;
use lanesim_kernels::math::ldl;
use lanesim_kernels::part::Kernels;
use lanesim_kernels::pipeline::{Run, Stages};
use lanesim_kernels::state::{BlockStatus, State};
use lanesim_kernels::step::evaluate;
use lanesim_kernels::workspace::Workspace;

const INTEGRATORS: [&str; 4] = ["RK4", "implicitfast", "implicit", "discrete"];
const PRECISIONS: [Precision; 2] = [Precision::F64, Precision::F32];
const BACKENDS: [Backend; 3] = [Backend::Native, Backend::Wide, Backend::Scalar];

/// One step from every recorded state. Both sides round differently; with elliptic cones MuJoCo stops a little early at the
/// intermediate states, too, which the goldens do not start warm. The inertia matrix of a chain of 31 links has a condition number
/// that single precision feels, where nothing refines the implicit step.
fn steps(integrator: &str, precision: Precision, tolerance: f64) {
    let mut failures = Failures::default();
    for name in all_models() {
        if integrator == "discrete" && NOT_DISCRETE.contains(&&*name) {
            continue;
        }
        let long = name == "zoo/chain31" && precision == Precision::F32 && integrator != "RK4";
        let tolerance = if long { 2e-4 } else { tolerance };
        let golden = Golden::read_with(&name, &[("integrator", integrator)]);
        let expected = golden.steps();
        for backend in BACKENDS {
            let ours = golden.eval(&["qpos", "qvel", "act"], 1, &options(precision, backend));
            for field in ["qpos", "qvel", "act"] {
                let Some(expected) = expected.get(&format!("{integrator}/{field}")) else { continue };
                let rows = ours[field].iter().zip(golden.rows(&expected.to_f64()));
                for (state, (got, expected)) in rows.enumerate() {
                    let place = || format!("{name} state {state} {backend:?} {field}");
                    failures.check(place, agree(got, &expected, tolerance, 1.0));
                }
            }
        }
    }
    failures.report();
}

#[test]
fn runge_kutta_is_mujocos_f64() {
    steps("RK4", Precision::F64, 1e-9);
}

#[test]
fn runge_kutta_is_mujocos_f32() {
    steps("RK4", Precision::F32, 1e-5);
}

#[test]
fn discrete_is_mujocos_f64() {
    steps("discrete", Precision::F64, 1e-9);
}

#[test]
fn discrete_is_mujocos_f32() {
    steps("discrete", Precision::F32, 1e-5);
}

#[test]
fn implicitfast_is_mujocos_f64() {
    steps("implicitfast", Precision::F64, 1e-9);
}

#[test]
fn implicitfast_is_mujocos_f32() {
    steps("implicitfast", Precision::F32, 1e-5);
}

#[test]
fn implicit_is_mujocos_f64() {
    steps("implicit", Precision::F64, 1e-9);
}

#[test]
fn implicit_is_mujocos_f32() {
    steps("implicit", Precision::F32, 1e-5);
}

/// A state of the model, evaluated.
fn evaluated(model: &Model, qpos: &[f64], qvel: &[f64], ctrl: &[f64]) -> Workspace<f64> {
    let tables = model.tables();
    let (mut state, mut ws) = (State::<f64>::initial(tables), Workspace::new(tables));
    state.qpos.copy_from_slice(qpos);
    state.qvel.copy_from_slice(qvel);
    state.ctrl.copy_from_slice(ctrl);
    state.act.fill(0.4);
    let convex = &lanesim::convex::SupportCollider;
    let (stages, executor) = (Stages::STEP, &mut Kernels);
    let mut run = Run {
        applied: None,
        varied: None,
        clock: None,
        max_contacts: 100,
        convex,
        stages,
        residual: false,
        executor,
        keep: true,
    };
    let mut status = BlockStatus { alive: 1, ..BlockStatus::default() };
    evaluate(tables, &mut state, &mut run, &mut status, &mut ws);
    ws
}

/// M - h D, as its factors solve with it, against D from differences of the smooth force.
#[test]
fn the_implicit_matrix_is_that_of_differences() {
    const BY: f64 = 1e-4;
    let mut compared = 0;
    // What joins branches is left out, as in MuJoCo.
    let joins = |name: &str| NOT_DISCRETE.contains(&name) || name == "unit/tendon_forces";
    // As in MuJoCo, bristles of motors resist as they will over a step.
    let bristles = |name: &str| name == "unit/dcmotor";
    for name in
        all_models().into_iter().filter(|name| name.starts_with("unit/fluid") || !joins(name) && !bristles(name))
    {
        let model = load_with(&name, &[("integrator", "implicit"), ("timestep", "0.02")]);
        let (tables, mut random) = (model.tables(), Random(5));
        let (nv, nu, h) = (tables.sizes.nv, tables.sizes.nu, tables.options.timestep);
        for _ in 0..3 {
            let mut qpos = model.initial_key().qpos;
            qpos.iter_mut().for_each(|q| *q += random.uniform(-0.3, 0.3));
            let (qvel, ctrl) = (random.vector(nv, 2.0), random.vector(nu, 1.0));
            let ws = evaluated(&model, &qpos, &qvel, &ctrl);
            let force = |by: f64, i: usize| {
                let mut moved = qvel.clone();
                moved[i] += by;
                evaluated(&model, &qpos, &moved, &ctrl).acceleration.qfrc_smooth
            };
            for i in 0..nv {
                let (more, less) = (force(BY, i), force(-BY, i));
                let (far_more, far_less) = (force(2.0 * BY, i), force(-2.0 * BY, i));
                let slope = |k: usize, by: f64, a: &[f64], b: &[f64]| (a[k] - b[k]) / (2.0 * by);
                let near: Vec<f64> = (0..nv).map(|k| slope(k, BY, &more, &less)).collect();
                let far: Vec<f64> = (0..nv).map(|k| slope(k, 2.0 * BY, &far_more, &far_less)).collect();
                // Not across the bound of an actuator.
                if near.iter().zip(&far).any(|(a, b)| (a - b).abs() > 1e-6 * (1.0 + a.abs())) {
                    continue;
                }
                let (mut unit, mut column) = (vec![0.0; nv], vec![0.0; nv]);
                unit[i] = 1.0;
                ldl::multiply(&tables.rows, &tables.tree_pattern, &ws.inertia.m, &unit, &mut column);
                column.iter_mut().zip(&near).for_each(|(m, d)| *m -= h * d);
                derivative::solve(tables, &ws.derivative, &mut column);
                compared += 1;
                if let Err(problem) = agree(&column, &unit, 1e-6, 1.0) {
                    panic!("{name} dof {i}{problem}");
                }
            }
        }
    }
    assert!(compared > 3000, "{compared} columns were compared");
}

/// The state of one world after a time.
fn after(model: &Model, qpos: &[f64], qvel: &[f64], steps: usize) -> [Vec<f64>; 2] {
    let mut worlds = Worlds::new(model, 1, &options(Precision::F64, Backend::Wide)).expect("a batch");
    worlds.set(Field::Qpos, 0, qpos).expect("a state");
    worlds.set(Field::Qvel, 0, qvel).expect("a state");
    worlds.step(steps).expect("steps");
    [Field::Qpos, Field::Qvel].map(|field| worlds.get(field, 0).expect("a state"))
}

/// Half the step, a sixteenth of the error: a symmetric body that tumbles freely, whose motion is known, and which turns by half a radian
/// in a step. Its axis goes round the angular momentum at the rate |L| / I₁, and it spins about its axis at L₃ (1/I₃ - 1/I₁).
#[test]
fn runge_kutta_is_of_fourth_order_for_rotations() {
    let (i1, i3, time) = (0.3, 0.5, 1.0_f64);
    let text = |h: f64| {
        format!(
            "<mujoco><option integrator='RK4' timestep='{h}' gravity='0 0 0'/><worldbody><body><freejoint/>
            <inertial pos='0 0 0' mass='1' diaginertia='{i1} {i1} {i3}'/></body></worldbody></mujoco>"
        )
    };
    let w = glam::DVec3::new(3.0, 0.0, 4.0);
    let momentum = glam::DVec3::new(i1 * w.x, 0.0, i3 * w.z);
    let turn = glam::DQuat::from_axis_angle(momentum.normalize(), momentum.length() / i1 * time)
        * glam::DQuat::from_rotation_z(momentum.z * (1.0 / i3 - 1.0 / i1) * time);
    let error = |steps: usize| {
        let model = parse(&text(time / steps as f64));
        let [qpos, _] = after(&model, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], &[0.0, 0.0, 0.0, w.x, w.y, w.z], steps);
        let found = glam::DQuat::from_xyzw(qpos[4], qpos[5], qpos[6], qpos[3]);
        2.0 * (turn.inverse() * found).xyz().length()
    };
    let errors = [10, 20, 40, 80].map(error);
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((3.7..4.6).contains(&order), "order {order}, errors {errors:?}");
    }
}

/// The same of coupled joints of every kind, against a step that is sixteen times smaller.
#[test]
fn runge_kutta_is_of_fourth_order_for_trees() {
    let text = |h: f64| {
        format!(
            "<mujoco><option integrator='RK4' timestep='{h}'/><default><geom contype='0' conaffinity='0'/></default>
            <worldbody><body><freejoint/><geom type='box' size='.1 .2 .3'/>
            <body pos='.2 0 0'><joint type='ball' damping='.1'/><geom type='capsule' fromto='0 0 0 .3 .1 0' size='.05'/>
            <body pos='.3 .1 0'><joint axis='0 1 0' stiffness='3'/><joint type='slide' axis='1 0 0' stiffness='80'/>
            <geom type='capsule' fromto='0 0 0 .2 0 .2' size='.04'/></body></body></body></worldbody></mujoco>"
        )
    };
    let time = 0.32;
    let model = parse(&text(0.01));
    let (qpos, qvel) = (model.initial_key().qpos, Random(3).vector(model.tables().sizes.nv, 3.0));
    let state = |steps: usize| after(&parse(&text(time / steps as f64)), &qpos, &qvel, steps).concat();
    let exact = state(2048);
    let errors = [32, 64, 128].map(|steps| {
        let difference = state(steps).iter().zip(&exact).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        assert!(difference > 1e-10, "too near to tell: {difference}");
        difference
    });
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((3.6..4.6).contains(&order), "order {order}, errors {errors:?}");
    }
}

/// A stiff servo, with which Euler is lost, stays where it is sent.
#[test]
fn implicit_integrators_bear_stiff_servos() {
    let text = |integrator: &str| {
        format!(
            "<mujoco><option integrator='{integrator}' timestep='0.01' gravity='0 0 0'/><worldbody>
            <body><joint name='j' axis='0 1 0'/><geom size='.1' pos='.2 0 0'/></body></worldbody>
            <actuator><position joint='j' kp='50' kv='200'/></actuator></mujoco>"
        )
    };
    for (integrator, holds) in [("Euler", false), ("RK4", false), ("implicitfast", true), ("implicit", true)] {
        let mut worlds =
            Worlds::new(&parse(&text(integrator)), 1, &options(Precision::F32, Backend::Auto)).expect("a batch");
        worlds.set(Field::Ctrl, 0, &[1.0]).expect("controls");
        worlds.step(4000).expect("steps");
        let angle = worlds.get(Field::Qpos, 0).expect("a state")[0];
        assert_eq!((angle - 1.0).abs() < 1e-3, holds, "{integrator}: {angle}");
    }
}

/// MuJoCo's orientation after a step in which a ball turns by up to two turns and gains speed.
#[test]
fn rk4_counts_no_whole_turns() {
    let cases: [([f64; 3], [f64; 3], [f64; 4]); 4] = [
        (
            [2.0, -1.0, 2.0],
            [0.4, 0.3, -0.2],
            [0.05668718544856584, 0.7199886123026816, -0.23999638067231, 0.648694611064845],
        ),
        (
            [3.0, -4.0, 1.0],
            [0.2, -0.5, 0.3],
            [-0.9007566045312932, 0.24364837671413947, -0.34868825872553444, 0.08768982919800283],
        ),
        (
            [4.0, 4.0, -2.0],
            [-0.3, 0.1, 0.4],
            [-0.9786982344668129, 0.14146289255271627, 0.13789904341349818, -0.05587369423802194],
        ),
        (
            [9.0, -7.0, 5.0],
            [0.5, 0.2, -0.4],
            [0.9994242547037825, -0.025107269484694057, 0.018741107325587158, -0.013021329618083003],
        ),
    ];
    let model = parse(
        "<mujoco><option integrator='RK4' timestep='1' gravity='0 0 0'/><worldbody><body><joint type='ball'/>
        <inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/></body></worldbody></mujoco>",
    );
    for (precision, backend) in PRECISIONS.into_iter().flat_map(|p| BACKENDS.map(|b| (p, b))) {
        let mut worlds = Worlds::new(&model, cases.len(), &options(precision, backend)).expect("a batch");
        for (world, (qvel, force, _)) in cases.iter().enumerate() {
            worlds.set(Field::Qvel, world, qvel).expect("a velocity");
            worlds.set(Field::QfrcApplied, world, force).expect("a force");
        }
        worlds.step(1).expect("a step");
        let tolerance = if precision == Precision::F64 { 1e-14 } else { 1e-5 };
        for (world, (_, _, expected)) in cases.iter().enumerate() {
            let got = worlds.get(Field::Qpos, world).expect("a state");
            let off = got.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off <= tolerance, "{precision:?} {backend:?} {world}: {got:?}, off by {off:.1e}");
        }
    }
}

/// Derived outputs of a rollout are those of the state from which the step starts, whatever the integrator evaluates after.
#[test]
fn outputs_are_of_the_first_evaluation() {
    let names = ["xpos", "xquat", "qacc", "qfrc_bias", "actuator_force", "ncon", "solver_residual", "energy", "qM"];
    let outputs = names.map(|name| Output::named(name).expect("an output"));
    for (integrator, name) in
        ["Euler", "RK4", "implicitfast", "implicit"].into_iter().flat_map(|i| [(i, "zoo/ant"), (i, "unit/rk4")])
    {
        let model = load_with(name, &[("integrator", integrator)]);
        for (precision, backend) in PRECISIONS.into_iter().flat_map(|p| BACKENDS.map(|b| (p, b))) {
            let mut worlds = Worlds::new(&model, 5, &options(precision, backend)).expect("a batch");
            for world in 0..5 {
                let qvel = Random(world as u64).vector(model.tables().sizes.nv, 1.0);
                worlds.set(Field::Qvel, world, &qvel).expect("a state");
            }
            worlds.step(30).expect("steps");
            let mut expected = vec![Vec::new(); names.len()];
            worlds
                .forward(&outputs, &mut |_, values| {
                    expected.iter_mut().zip(values).for_each(|(all, row)| all.extend(row));
                })
                .expect("outputs");
            let rollout = Rollout { nstep: 1, controls: Controls::Keep, outputs: &outputs, ..Rollout::default() };
            let run = worlds.rollout(&rollout).expect("a rollout");
            for ((name, got), expected) in names.iter().zip(&run.outputs).zip(&expected) {
                let bits = |x: &[f64]| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
                assert_eq!(bits(got), bits(expected), "{integrator} {precision:?} {backend:?} {name}");
            }
        }
    }
}

/// In a rollout, orientations were those of the state after the step, where positions and matrices were those before it.
#[test]
fn quaternions_of_a_rollout_are_of_the_same_state_as_matrices() {
    let model = load("unit/free");
    let mut worlds = Worlds::new(&model, 1, &Options::default()).expect("a batch");
    worlds.set(Field::Qvel, 0, &[0.0, 0.0, 0.0, 9.0, 5.0, 7.0].repeat(2)).expect("a state");
    let outputs = ["xquat", "xmat"].map(|name| Output::named(name).expect("an output"));
    let run = worlds.rollout(&Rollout { nstep: 3, outputs: &outputs, ..Rollout::default() }).expect("a rollout");
    for (q, matrix) in run.outputs[0].chunks(4).zip(run.outputs[1].chunks(9)) {
        let expected =
            glam::DMat3::from_quat(glam::DQuat::from_xyzw(q[1], q[2], q[3], q[0])).transpose().to_cols_array();
        assert!(agree(matrix, &expected, 1e-12, 1.0).is_ok(), "{matrix:?} instead of {expected:?}");
    }
}

/// A world that is lost at an intermediate state keeps the state from which the step started, and says where it was lost.
#[test]
fn a_world_lost_between_has_its_cause() {
    // The spring throws the slide so far by the first half that the second evaluation finds an acceleration beyond all bounds.
    let text = "<mujoco><option integrator='RK4' timestep='0.1' gravity='0 0 0'/><worldbody>
        <body><joint name='calm' type='slide' axis='0 0 1'/><geom size='.1' contype='0' conaffinity='0'/></body>
        <body pos='1 0 0'><joint name='wild' type='slide' axis='0 0 1' damping='0 0 1e6'/><geom size='.1' contype='0' conaffinity='0'/></body>
        </worldbody></mujoco>";
    let model = parse(text);
    for (precision, backend) in PRECISIONS.into_iter().flat_map(|p| BACKENDS.map(|b| (p, b))) {
        let mut worlds = Worlds::new(&model, 3, &options(precision, backend)).expect("a batch");
        (0..3).for_each(|world| {
            worlds.set(Field::Qvel, world, &[1.0, if world == 1 { 0.1 } else { 0.0 }]).expect("a state")
        });
        worlds.step(1).expect("steps");
        assert_eq!(worlds.get(Field::Qvel, 1).expect("a state")[0], 1.0, "{precision:?} {backend:?}");
        let events = worlds.status_detail(1).expect("a status");
        let said: Vec<String> = events.iter().map(|event| event.to_string()).collect();
        assert!(said.iter().any(|line| line.contains("HugeValue") && line.contains("wild")), "{said:?}");
        assert_eq!(worlds.lost(), 1);
        for world in [0, 2] {
            assert!((worlds.get(Field::Qpos, world).expect("a state")[0] - 0.1).abs() < 1e-6);
        }
    }
}

/// Accelerations at intermediate states may be larger than any state may be, as long as the states that they lead to are not. A
/// damper of z = b h / m turns a velocity v into v (1 - z + z²/2 - z³/6 + z⁴/24), and the last acceleration is 2.5e11 m/s².
#[test]
fn accelerations_between_may_be_huge() {
    let model = parse(
        "<mujoco><option integrator='RK4' timestep='0.01' gravity='0 0 0'/><worldbody><body>
        <joint type='slide' axis='0 0 1' damping='1e5'/><geom size='.1' mass='1' contype='0' conaffinity='0'/></body></worldbody></mujoco>",
    );
    let mut worlds = Worlds::new(&model, 1, &options(Precision::F64, Backend::Auto)).expect("a batch");
    worlds.set(Field::Qvel, 0, &[0.01]).expect("a state");
    worlds.step(1).expect("a step");
    let got = worlds.get(Field::Qvel, 0).expect("a state");
    let z: f64 = 1e3;
    let expected = 0.01 * (1.0 - z + z * z / 2.0 - z.powi(3) / 6.0 + z.powi(4) / 24.0);
    assert!(agree(&got, &[expected], 1e-12, 1.0).is_ok(), "{got:?} instead of {expected}");
}

/// Every model steps by every integrator as it did in a batch that knows nothing of it: the settings are read from the model.
#[test]
fn integrators_are_read_from_the_model() {
    for integrator in INTEGRATORS {
        let written = load(&format!("unit/{}", integrator.to_lowercase()));
        assert_eq!(written.tables().options.integrator.to_string(), integrator);
    }
}

/// A discrete step takes springs and dampers where it ends: (m + h b + h² k) a = -k x - b v - h k v, whatever their stiffness.
#[test]
fn discrete_steps_end_where_springs_and_dampers_are_taken() {
    for (k, b) in [(50.0, 3.0), (1e7, 0.0), (0.0, 1e6)] {
        let model = parse(&format!(
            "<mujoco><option integrator='discrete' timestep='0.01' gravity='0 0 0'/><worldbody><body>
            <joint type='slide' axis='0 0 1' stiffness='{k}' damping='{b}'/><geom size='.1' mass='2'/></body></worldbody></mujoco>"
        ));
        for backend in BACKENDS {
            let mut worlds = Worlds::new(&model, 1, &options(Precision::F64, backend)).expect("a batch");
            worlds.set(Field::Qpos, 0, &[0.3]).expect("a state");
            worlds.set(Field::Qvel, 0, &[-0.7]).expect("a state");
            worlds.step(1).expect("a step");
            let (h, x, v) = (0.01, 0.3, -0.7);
            let expected = v + h * (-k * x - b * v - h * k * v) / (2.0 + h * b + h * h * k);
            let got = worlds.get(Field::Qvel, 0).expect("a state");
            assert!(agree(&got, &[expected], 1e-12, 1e-3).is_ok(), "{got:?} instead of {expected}");
            worlds.step(1000).expect("steps");
            assert!(worlds.get(Field::Qpos, 0).expect("a state")[0].abs() < 0.31);
        }
    }
}

#[test]
fn what_discrete_steps_refuse() {
    let expected = [
        "fluidshape ellipsoid in a medium, which integrator discrete does not support (set integrator=\"implicitfast\")",
        "fluidshape ellipsoid in a medium, which integrator discrete does not support (set integrator=\"implicitfast\")",
        "actuator \"pad\": acts on a body, which integrator discrete does not support (set integrator=\"implicitfast\")",
        "geom \"belt\": surfacevel, which integrator discrete does not support (set integrator=\"implicitfast\")",
        "actuator #0: its force follows the motion of several branches, which is not supported under integrator discrete \
         (set integrator=\"implicitfast\"",
        "tendon \"sum\": a spring or damper along a tendon between branches is not supported under integrator discrete",
        "tendon \"branches\": a spring or damper along a tendon between branches is not supported",
        "tendon \"branches\": a spring or damper along a tendon between branches is not supported",
        "tendon \"twice\": a spring or damper along a tendon between branches is not supported",
        "actuator \"servo\": its force follows the motion of several branches, which is not supported",
    ];
    for (name, expected) in NOT_DISCRETE.into_iter().zip(expected) {
        let overrides = vec![("integrator".to_string(), "discrete".to_string())];
        let options = lanesim::mjcf::LoadOptions { overrides, lenient: false };
        let path = support::repository(&format!("models/{name}.xml"));
        let problem = lanesim::Model::from_xml_path(&path, &options).expect_err("not built").to_string();
        assert!(problem.contains(expected), "{problem}");
    }
}
