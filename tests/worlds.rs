//! The batch, rollouts and evaluation from outside: shapes, errors, noise, outputs, sizes of nothing.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::support;
use crate::support::{all_models, every_output, fails, load, load_with, options, parse};
use lanesim::eval::eval;
use lanesim::npz::{Array, Data};
use lanesim::outputs::Output;
use lanesim::{Backend, Controls, Field, Model, Options, Precision, Rollout, Worlds, noise};
use lanesim_kernels::pipeline::Stage;

fn wide() -> Options {
    options(Precision::F64, Backend::Wide)
}

fn worlds(model: &Model, n: usize) -> Worlds {
    Worlds::new(model, n, &wide()).expect("a batch")
}

fn outputs<const N: usize>(names: [&str; N]) -> [Output; N] {
    names.map(|name| Output::named(name).expect("an output"))
}

#[test]
fn wrong_worlds_and_lengths_are_named() {
    let mut worlds = worlds(&load("zoo/cartpole"), 3);
    fails(worlds.set(Field::Qpos, 3, &[0.0, 0.0]), "there is no world 3: the batch has 3, counted from 0");
    fails(worlds.get(Field::Qpos, 7), "there is no world 7");
    fails(worlds.status(3), "there is no world 3");
    fails(worlds.reset(9, None), "there is no world 9");
    fails(worlds.reset(0, Some(5)), "there is no keyframe 5: the model has");
    fails(worlds.set(Field::Qpos, 0, &[0.0; 3]), "qpos has 3 numbers; expected 2");
    fails(worlds.set_unchecked(Field::Qvel, 0, &[0.0]), "qvel has 1 numbers; expected 2");
    fails(worlds.set(Field::Qvel, 1, &[0.0, f64::NAN]), "qvel[1] of world 1 is NaN; expected a finite number");
    fails(worlds.set(Field::Ctrl, 1, &[f64::INFINITY]), "ctrl[0] of world 1 is inf; expected a finite number");
}

#[test]
fn wrong_controls_are_named() {
    let model = load("zoo/cheetah");
    let nu = model.tables().sizes.nu;
    let mut worlds = worlds(&model, 3);
    let mut run = |controls: &[f64]| {
        worlds.rollout(&Rollout { nstep: 4, controls: Controls::Given(controls), ..Rollout::default() }).map(|_| ())
    };
    fails(run(&[0.0; 7]), &format!("controls have 7 numbers; expected nworld 3 × nstep 4 × nu {nu}"));
    let mut controls = vec![0.0; 12 * nu];
    controls[(2 * 4 + 1) * nu + 3] = f64::NAN;
    fails(run(&controls), "controls[2, 1, 3] is NaN; expected a finite number");
    run(&vec![0.1; 12 * nu]).expect("a rollout");
}

#[test]
fn wrong_outputs_are_named() {
    fails(Output::named("xpso"), "there is no output xpso; did you mean \"xpos\"?");
    let mut worlds = worlds(&load("zoo/hopper"), 2);
    let ragged = outputs(["contact_dist"]);
    let rollout = Rollout { nstep: 1, outputs: &ragged, ..Rollout::default() };
    fails(worlds.rollout(&rollout), "contact_dist differs in length between worlds and cannot be recorded");
}

#[test]
fn impossible_options_are_named() {
    let model = load("zoo/cartpole");
    fails(Worlds::new(&model, 1, &Options { threads: Some(0), ..wide() }), "threads must be at least 1");
    fails(Worlds::new(&model, 1, &Options { threads: Some(1_000_000), ..wide() }), "expected at most 1024");
}

fn array(shape: &[usize], data: Vec<f64>) -> Array {
    Array::new(shape.to_vec(), Data::F64(data)).expect("an array")
}

#[test]
fn wrong_inputs_of_eval_are_named() {
    let model = load("zoo/cartpole");
    let run = |inputs: &[(&str, Array)], field: &str| {
        let inputs: BTreeMap<_, _> = inputs.iter().map(|(name, array)| (name.to_string(), array.clone())).collect();
        eval(&model, &inputs, &[field], 0, &wide())
    };
    let two = array(&[2, 2], vec![0.0; 4]);
    fails(run(&[("qpso", two.clone())], "qacc"), "unknown input array qpso; did you mean \"qpos\"?");
    fails(run(&[("qpos", array(&[2, 3], vec![0.0; 6]))], "qacc"), "qpos has shape [2, 3]; expected [N, 2]");
    fails(run(&[("qpos", two.clone()), ("qvel", array(&[1, 2], vec![0.0; 2]))], "qacc"), "another input has 2");
    fails(run(&[("qpos", array(&[1, 2], vec![0.0, f64::NAN]))], "qacc"), "qpos[1] of world 0 is NaN");
    fails(run(&[("qpos", two)], "qaac"), "there is no output or model array qaac; did you mean \"qacc\"?");
}

/// What cannot be run yet is refused at load, and what is said. The table shrinks as things are built.
#[test]
fn what_is_not_built_yet_says_so() {
    let path = support::repository("models/zoo/hopper.xml");
    let overrides = vec![("ipc".to_string(), "enable".to_string())];
    let options = lanesim::mjcf::LoadOptions { overrides, lenient: false };
    let problem = lanesim::Model::from_xml_path(&path, &options).expect_err("not built").to_string();
    assert!(problem.starts_with("flag: ipc: incremental potential contact is not supported (remove it"), "{problem}");
}

#[test]
fn noise_depends_on_seed_world_step_and_actuator_alone() {
    let model = load("zoo/cheetah");
    let nu = model.tables().sizes.nu;
    let recorded = outputs(["ctrl", "qpos"]);
    let run = |n: usize, threads: usize, backend: Backend, seed: u64| {
        let options = Options { threads: Some(threads), backend, ..wide() };
        let mut worlds = Worlds::new(&model, n, &options).expect("a batch");
        let rollout = Rollout {
            nstep: 25,
            controls: Controls::Noise { seed, scale: 1.0 },
            outputs: &recorded,
            ..Rollout::default()
        };
        worlds.rollout(&rollout).expect("a rollout").outputs
    };
    let base = run(33, 1, Backend::Wide, 7);
    for (n, threads, backend) in [(33, 2, Backend::Wide), (9, 1, Backend::Wide), (20, 2, Backend::Scalar)] {
        for (got, expected) in run(n, threads, backend, 7).iter().zip(&base) {
            assert_eq!(got[..], expected[..got.len()], "{n} worlds on {threads} threads, {backend:?}");
        }
    }
    assert_ne!(run(33, 1, Backend::Wide, 8)[0], base[0]);
    for (i, u) in base[0].iter().enumerate() {
        let (world, step, actuator) = (i / (25 * nu), i / nu % 25, i % nu);
        let [low, high] = model.control_range(actuator);
        let x = noise::uniform(7, world as u64, step as u64, actuator as u64);
        assert_eq!(*u, low + (high - low) * x);
    }
}

#[test]
fn noise_takes_a_share_of_the_ranges_around_their_middles() {
    let model = load("zoo/humanoid18");
    let nu = model.tables().sizes.nu;
    let run = |scale: f64| {
        let controls = Controls::Noise { seed: 4, scale };
        let recorded = outputs(["ctrl"]);
        let rollout = Rollout { nstep: 50, controls, outputs: &recorded, ..Rollout::default() };
        worlds(&model, 9).rollout(&rollout)
    };
    for scale in [0.0, 0.25, 1.0] {
        let controls = run(scale).expect("a rollout").outputs.swap_remove(0);
        let mut widest = 0.0_f64;
        for (i, u) in controls.iter().enumerate() {
            let [low, high] = model.control_range(i % nu);
            widest = widest.max((u - 0.5 * (low + high)).abs() / (0.5 * (high - low)));
        }
        assert!(widest <= scale + 1e-15 && widest >= 0.99 * scale, "{scale}: {widest}");
    }
    for scale in [-0.1, 1.1, f64::NAN] {
        let message = run(scale).expect_err("a scale outside its bounds").to_string();
        assert!(message.contains("expected a number from 0 to 1"), "{message}");
    }
}

/// `[nworld, nstep, width]`, state outputs after the step: the same as stepping by hand.
#[test]
fn rollouts_record_the_state_after_every_step() {
    let model = load("zoo/hopper");
    let sizes = &model.tables().sizes;
    let (nworld, nstep) = (11, 7);
    let recorded = outputs(["time", "qpos", "qvel", "xpos", "status", "energy"]);
    let controls: Vec<f64> = (0..nworld * nstep * sizes.nu).map(|i| (i as f64 * 0.7).sin()).collect();
    let rollout = Rollout { nstep, controls: Controls::Given(&controls), outputs: &recorded, ..Rollout::default() };
    let run = worlds(&model, nworld).rollout(&rollout).expect("a rollout");
    let widths = [1, sizes.nq, sizes.nv, 3 * sizes.nbody, 1, 2];
    for (output, width) in run.outputs.iter().zip(widths) {
        assert_eq!(output.len(), nworld * nstep * width);
    }
    let mut by_hand = worlds(&model, nworld);
    for step in 0..nstep {
        for world in 0..nworld {
            let row = (world * nstep + step) * sizes.nu;
            by_hand.set(Field::Ctrl, world, &controls[row..row + sizes.nu]).expect("controls");
        }
        by_hand.step(1).expect("a step");
        for world in 0..nworld {
            let at = world * nstep + step;
            for (i, field) in [Field::Time, Field::Qpos, Field::Qvel].into_iter().enumerate() {
                let expected = by_hand.get(field, world).expect("a field");
                assert_eq!(run.outputs[i][at * widths[i]..(at + 1) * widths[i]], expected, "{} {at}", field.name());
            }
        }
    }
}

#[test]
fn rollouts_count() {
    let model = load("zoo/humanoid18");
    let progress = AtomicU64::new(0);
    let rollout = Rollout { nstep: 5, progress: Some(&progress), statistics: true, clock: true, ..Rollout::default() };
    let run = worlds(&model, 19).rollout(&rollout).expect("a rollout");
    assert_eq!(progress.load(Ordering::Relaxed), 95);
    let s = run.statistics;
    assert_eq!((s.world_steps, s.block_steps), (95.0, 15.0));
    // Six points of the feet on the floor, four rows each, in every world.
    assert_eq!((s.contacts, s.slots, s.rows), (570.0, 570.0, 2280.0));
    assert!(s.iterations > 0.0 && s.block_iterations <= s.iterations, "{s:?}");
    for ((stage, name), spent) in Stage::ALL.iter().zip(run.clock.spent) {
        // Nobody asked for the energy or for sensors, Euler needs no derivative, and there are no tendons.
        let idle = matches!(stage, Stage::Energy | Stage::Derivative | Stage::Sensor | Stage::Tendon);
        assert_eq!(spent.is_zero(), idle, "{name} took {spent:?}");
    }
}

#[test]
fn eval_gives_names_shapes_and_padding() {
    let model = load("zoo/humanoid27");
    let sizes = &model.tables().sizes;
    let mut qpos: Vec<f64> = vec![];
    // On the floor, high in the air, and halfway into the floor.
    for height in [0.05, 5.0, 0.3] {
        let mut q = model.initial_key().qpos;
        q[2] = height;
        qpos.extend(q);
    }
    let inputs = BTreeMap::from([("qpos".to_string(), array(&[3, sizes.nq], qpos))]);
    let fields = ["qM", "ncon", "contact_geom", "contact_frame", "efc_J", "body_mass", "timestep", "qacc"];
    let run = eval(&model, &inputs, &fields, 0, &wide()).expect("an evaluation");
    let names: Vec<&str> = run.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, fields);
    let found: BTreeMap<_, _> = run.iter().map(|(name, array)| (name.as_str(), array)).collect();
    let ncon = found["ncon"].to_f64().into_owned();
    let most = ncon.iter().fold(0.0_f64, |m, x| m.max(*x)) as usize;
    assert!(ncon[0] > 0.0 && ncon[1] == 0.0, "{ncon:?}");
    assert_eq!(found["qM"].shape(), [3, sizes.nv, sizes.nv]);
    assert_eq!(found["contact_geom"].shape(), [3, most, 2]);
    assert_eq!(found["contact_frame"].shape(), [3, most, 9]);
    assert_eq!(found["efc_J"].shape()[2], sizes.nv);
    assert_eq!(found["body_mass"].shape(), [sizes.nbody], "model arrays come once");
    assert!(found["contact_frame"].to_f64()[9 * most..18 * most].iter().all(|x| *x == 0.0), "padding is zero");
    assert!(matches!(found["contact_geom"].data(), Data::I32(_)), "integers stay integers");
    let none = eval(&model, &BTreeMap::new(), &["qpos"], 0, &wide()).expect("an evaluation");
    assert_eq!(none[0].1.to_f64(), model.initial_key().qpos, "no input: one world in the reference configuration");
}

#[test]
fn every_output_has_the_length_that_it_announces() {
    for name in ["zoo/humanoid27", "unit/empty", "unit/zero_dof", "unit/ball_limit", "unit/frictionloss"] {
        let model = load(name);
        let all: Vec<Output> = every_output(&model);
        assert!(Output::all().all(|output| !output.name.is_empty() && !output.meaning.is_empty()));
        worlds(&model, 3)
            .forward(&all, &mut |_, values| {
                for (output, values) in all.iter().zip(&values) {
                    if let Some(width) = output.width(&model) {
                        assert_eq!(values.len(), width, "{name} {}", output.name());
                    }
                }
            })
            .expect("outputs");
    }
}

/// An output runs the stages that it needs, and reads no other: the same numbers alone as among all, also where the
/// workspace has just served other worlds.
#[test]
fn every_output_is_the_same_alone() {
    let same = |a: &[f64], b: &[f64]| a.iter().map(|x| x.to_bits()).eq(b.iter().map(|x| x.to_bits()));
    for name in
        ["zoo/humanoid27", "zoo/hopper", "unit/limits", "unit/frictionloss", "unit/condim_elliptic", "unit/gravcomp"]
    {
        for solver in ["Newton", "PGS"] {
            let model = load_with(name, &[("solver", solver)]);
            let all: Vec<Output> = every_output(&model);
            let start = |height: f64| {
                let mut worlds = worlds(&model, 10);
                for world in 0..10 {
                    let mut qpos = model.initial_key().qpos;
                    qpos.iter_mut().enumerate().for_each(|(i, q)| *q += 0.3 * ((world * 7 + i) as f64).sin());
                    if name.starts_with("zoo") {
                        qpos[if name == "zoo/hopper" { 1 } else { 2 }] += height;
                    }
                    worlds.set(Field::Qpos, world, &qpos).expect("a state");
                }
                worlds
            };
            let collect = |worlds: &mut Worlds, outputs: &[Output]| {
                let mut rows = vec![];
                worlds.forward(outputs, &mut |_, values| rows.push(values)).expect("outputs");
                rows
            };
            let together = collect(&mut start(-0.9), &all);
            for (o, output) in all.iter().enumerate() {
                let mut worlds = start(-0.9);
                let alone = collect(&mut worlds, &[*output]);
                for (world, (alone, together)) in alone.iter().zip(&together).enumerate() {
                    assert!(same(&alone[0], &together[o]), "{name} {solver} world {world}: {} alone", output.name());
                }
                // High above the floor, then down again, in the same workspace.
                let states = worlds.get_all(Field::Qpos);
                let up = start(0.9).get_all(Field::Qpos);
                let width = states.len() / 10;
                for (outputs, qpos) in [(&all[..], &up), (&all[o..=o], &states)] {
                    (0..10)
                        .for_each(|w| worlds.set(Field::Qpos, w, &qpos[w * width..(w + 1) * width]).expect("a state"));
                    let rows = collect(&mut worlds, outputs);
                    if outputs.len() == 1 && output.name() != "status" {
                        let differs =
                            rows.iter().zip(&together).position(|(row, together)| !same(&row[0], &together[o]));
                        assert_eq!(differs, None, "{name} {solver}: {} after other worlds", output.name());
                    }
                }
            }
        }
    }
}

/// No worlds, no dofs, no actuators: nothing happens, and nothing fails.
#[test]
fn nothing_is_a_size_too() {
    let recorded = outputs(["qpos", "time"]);
    for name in ["zoo/humanoid27", "unit/empty", "unit/zero_dof", "unit/free"] {
        let model = load(name);
        for n in [0, 1, 9] {
            let mut worlds = worlds(&model, n);
            let run = worlds
                .rollout(&Rollout {
                    nstep: 3,
                    controls: Controls::Noise { seed: 1, scale: 1.0 },
                    outputs: &recorded,
                    ..Rollout::default()
                })
                .expect("a rollout");
            assert_eq!(run.outputs[0].len(), 3 * n * model.tables().sizes.nq, "{name}");
            assert_eq!(run.outputs[1].len(), 3 * n, "{name}");
            assert_eq!((worlds.nworld(), worlds.lost()), (n, 0));
            for time in worlds.get_all(Field::Time) {
                assert!((time - 3.0 * model.tables().options.timestep).abs() < 1e-15, "{name}: {time}");
            }
        }
        let mut none = worlds(&model, 0);
        none.rollout(&Rollout { nstep: 5, controls: Controls::Given(&[]), ..Rollout::default() }).expect("a rollout");
        fails(none.get(Field::Qpos, 0), "there is no world 0: the batch has 0");
    }
    let empty = worlds(&load("zoo/hopper"), 2).rollout(&Rollout { outputs: &recorded, ..Rollout::default() });
    assert!(empty.expect("a rollout of no steps").outputs.iter().all(Vec::is_empty));
}

/// The goal: at most 64 bytes per world beside the numbers of its state.
#[test]
fn a_world_costs_little_beside_its_state() {
    for name in all_models() {
        let model = load(&name);
        for (precision, bytes) in [(Precision::F64, 8), (Precision::F32, 4)] {
            let (per_world, scratch) =
                Worlds::new(&model, 16, &options(precision, Backend::Wide)).expect("a batch").memory();
            let forces = [Field::QfrcApplied, Field::XfrcApplied];
            let of_state = Field::ALL.iter().filter(|(field, _)| !forces.contains(field));
            let twice = [Field::Time, Field::Qpos, Field::History].map(|field| field.len(&model)).iter().sum();
            let low: usize = if precision == Precision::F32 { twice } else { 0 };
            let state = bytes * of_state.map(|(field, _)| field.len(&model)).sum::<usize>() + bytes * low;
            assert!(per_world <= state + 64, "{name} in {precision:?}: {per_world} bytes, {state} of state");
            assert!(scratch < 64 << 20, "{name}: {scratch} bytes of scratch");
        }
    }
}

#[test]
fn a_world_keeps_its_first_contacts_and_says_that_there_were_more() {
    let model = load("zoo/humanoid18");
    let run = |max_contacts: usize| {
        let mut worlds = Worlds::new(&model, 1, &Options { max_contacts, ..wide() }).expect("a batch");
        let mut counts = vec![];
        worlds.forward(&outputs(["ncon"]), &mut |_, values| counts.push(values[0][0])).expect("outputs");
        (counts[0], worlds.status(0).expect("a status").names())
    };
    assert_eq!(run(6), (6.0, vec![]));
    assert_eq!(run(4), (4.0, vec!["ContactOverflow"]));
    assert_eq!(run(0), (0.0, vec!["ContactOverflow"]));
}

/// MuJoCo sets no limit but memory.
#[test]
fn a_world_has_thousands_of_contacts() {
    let boxes: String =
        (0..500).map(|x| format!("<geom type=\"box\" size=\"0.1 0.1 0.1\" pos=\"{x} 0 0\"/>")).collect();
    let text = format!(
        "<mujoco><worldbody><geom type=\"plane\" size=\"1 1 1\"/><body pos=\"0 0 0.09\"><freejoint/>{boxes}</body></worldbody></mujoco>"
    );
    let model = Model::from_xml_string(&text, &Default::default()).expect("a model");
    let mut worlds = Worlds::new(&model, 1, &Options::default()).expect("a batch");
    let mut counts = vec![];
    worlds.forward(&outputs(["ncon"]), &mut |_, values| counts.push(values[0][0])).expect("outputs");
    assert_eq!((counts[0], worlds.status(0).expect("a status").names()), (2000.0, vec![]));
}

#[test]
fn a_field_set_is_the_field_read() {
    let model = load("zoo/humanoid27");
    for precision in [Precision::F64, Precision::F32] {
        let mut worlds = Worlds::new(&model, 20, &options(precision, Backend::Wide)).expect("a batch");
        for (field, name) in Field::ALL {
            assert_eq!(field.name(), name);
            // Numbers that f32 holds exactly.
            let values: Vec<f64> = (0..field.len(&model)).map(|i| i as f64 * 0.25 - 3.0).collect();
            worlds.set(field, 13, &values).expect("a field");
            assert_eq!(worlds.get(field, 13).expect("a field"), values, "{name}");
            assert_eq!(worlds.get_all(field).len(), 20 * values.len(), "{name}");
        }
    }
}

#[test]
fn hashes_tell_states_apart() {
    let model = parse("<mujoco><worldbody><body><joint type='slide'/><geom size='1'/></body></worldbody></mujoco>");
    let hash = |qpos: f64, qvel: f64| {
        let mut worlds = worlds(&model, 2);
        worlds.set(Field::Qpos, 1, &[qpos]).expect("a state");
        worlds.set(Field::Qvel, 1, &[qvel]).expect("a state");
        worlds.state_hash()
    };
    assert_eq!(hash(0.1, 0.2), hash(0.1, 0.2));
    assert_ne!(hash(0.1, 0.2), hash(0.2, 0.1));
    assert_ne!(hash(0.1, 0.2), hash(0.1, 0.2 + 1e-16));
}

#[test]
fn threads_and_pins_leave_the_bits_alone() {
    let model = load("zoo/cheetah");
    let run = |threads: usize, pin: bool, calls: usize| {
        let options = Options { threads: Some(threads), pin, backend: Backend::Auto, ..wide() };
        let mut worlds = Worlds::new(&model, 100, &options).expect("a batch");
        for _ in 0..calls {
            let controls = Controls::Noise { seed: 3, scale: 1.0 };
            worlds.rollout(&Rollout { nstep: 60 / calls, controls, ..Rollout::default() }).expect("a rollout");
        }
        worlds.state_hash()
    };
    for calls in [1, 20] {
        let alone = run(1, false, calls);
        let all = core_affinity::get_core_ids().map_or(1, |cores| cores.len());
        for (threads, pin) in [(2, false), (all, all > 1), (5, false), (64, false)] {
            assert_eq!(run(threads, pin, calls), alone, "{threads} threads, pin {pin}, {calls} calls");
        }
    }
}
