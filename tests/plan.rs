//! What a plan leaves out changes nothing that was asked for: minimal runs give the same bits as full ones.

use crate::support::{Random, all_models, every_output, load, options};
use lanesim::outputs::Output;
use lanesim::plan::Plan;
use lanesim::{Backend, Controls, Field, Model, Precision, Rollout, Worlds};

const WORLDS: usize = 5;

fn worlds(model: &Model, precision: Precision) -> Worlds {
    Worlds::new(model, WORLDS, &options(precision, Backend::Auto)).expect("a batch")
}

/// Puts every world into a state near the reference, different for every seed.
fn scatter(model: &Model, worlds: &mut Worlds, seed: u64) {
    let mut random = Random(seed);
    for world in 0..WORLDS {
        worlds.reset(world, None).expect("a world");
        for (field, size) in [(Field::Qpos, 0.1), (Field::Qvel, 1.0), (Field::Ctrl, 1.0)] {
            let start = worlds.get(field, world).expect("a field");
            let moved: Vec<f64> = start.iter().zip(random.vector(start.len(), size)).map(|(x, d)| x + d).collect();
            worlds.set(field, world, &moved).expect("a state");
        }
        let force = random.vector(Field::QfrcApplied.len(model), 1.0);
        worlds.set(Field::QfrcApplied, world, &force).expect("a force");
    }
}

/// Bits of outputs, world by world and output by output.
fn forward(worlds: &mut Worlds, outputs: &[Output]) -> Vec<Vec<Vec<u64>>> {
    let mut all = Vec::new();
    worlds
        .forward(outputs, &mut |_, values| {
            all.push(values.into_iter().map(|row| row.into_iter().map(f64::to_bits).collect()).collect());
        })
        .expect("outputs");
    all
}

#[test]
fn a_minimal_forward_run_has_the_bits_of_a_full_one() {
    for name in all_models() {
        let model = load(&name);
        let outputs = every_output(&model);
        assert!(outputs.len() + 3 > Output::all().count());
        for precision in [Precision::F64, Precision::F32] {
            let (mut full, mut minimal) = (worlds(&model, precision), worlds(&model, precision));
            // What another state left in the workspace must not show.
            scatter(&model, &mut minimal, 1);
            forward(&mut minimal, &outputs);
            scatter(&model, &mut full, 2);
            scatter(&model, &mut minimal, 2);
            let expected = forward(&mut full, &outputs);
            for (i, output) in outputs.iter().enumerate() {
                for (world, row) in forward(&mut minimal, &[*output]).iter().enumerate() {
                    assert_eq!(row[0], expected[world][i], "{name} {} of world {world}", output.name());
                }
            }
        }
    }
}

#[test]
fn what_is_recorded_does_not_change_the_steps() {
    let names = ["energy", "xquat", "qM", "status", "solver_residual", "nefc"];
    let outputs = names.map(|name| Output::named(name).expect("an output"));
    for name in ["zoo/ant", "zoo/cheetah", "unit/ball", "unit/actuation_off"] {
        let model = load(name);
        let run = |outputs: &[Output], statistics: bool| {
            let mut worlds = worlds(&model, Precision::F64);
            let controls = Controls::Noise { seed: 3, scale: 1.0 };
            let rollout = Rollout { nstep: 50, controls, outputs, statistics, ..Rollout::default() };
            worlds.rollout(&rollout).expect("a rollout");
            worlds.state_hash()
        };
        assert_eq!(run(&[], false), run(&outputs, true), "{name}");
    }
}

#[test]
fn plans_say_what_runs() {
    let named = |names: &[&str]| names.iter().map(|n| Output::named(n).expect("an output")).collect::<Vec<_>>();
    let runs = |plan: Plan, model: &Model| -> Vec<&'static str> {
        plan.parts(model).iter().filter(|part| part.runs).map(|part| part.name).collect()
    };
    let ball = load("unit/ball");
    assert_eq!(runs(Plan::forward(&named(&["xpos", "xquat"])), &ball), ["position", "  quaternions"]);
    let step = runs(Plan::step(&named(&["qpos"])), &ball);
    for absent in ["collision", "constraint", "solver", "energy"] {
        assert!(!step.contains(&absent), "{absent}");
    }
    assert!(runs(Plan::step(&named(&["energy"])), &ball).contains(&"energy"));
    let ant = runs(Plan::forward(&named(&["ncon"])), &load("zoo/ant"));
    assert!(ant.contains(&"collision") && !ant.contains(&"inertia") && !ant.contains(&"solver"), "{ant:?}");
}
