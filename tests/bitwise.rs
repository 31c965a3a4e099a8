//! A world's results are the same bits whatever its lane, its neighbours, the number of worlds and of threads, and the
//! backend; and what happens to a world that is lost stays in that world.

use crate::support::{Random, load, load_with};
use lanesim::outputs::Output;
use lanesim::{Backend, Controls, Field, InstructionSet, Model, Options, Precision, Rollout, Worlds};
use lanesim_kernels::state::Status;

/// Different worlds; larger batches repeat them.
const DIFFERENT: usize = 17;
/// Steps of the long runs: enough to fall, and to lie there in contact.
const LONG: usize = 1000;
/// Steps of runs that are repeated for many arrangements.
const SHORT: usize = 60;

const PRECISIONS: [Precision; 2] = [Precision::F64, Precision::F32];

fn options(precision: Precision, backend: Backend, threads: usize) -> Options {
    Options { precision, backend, threads: Some(threads), ..Options::default() }
}

/// What steps worlds side by side: lanes, and the machine code that this processor can run.
fn engines(precision: Precision, threads: usize) -> Vec<Options> {
    let native = [InstructionSet::Avx512, InstructionSet::Avx2].into_iter().filter(|set| set.check().is_ok());
    let native = native.map(|set| Options { instructions: Some(set), ..options(precision, Backend::Native, threads) });
    [options(precision, Backend::Wide, threads)].into_iter().chain(native).collect()
}

/// The state in which world `id` starts: the reference configuration, moved and pushed.
fn start(model: &Model, id: usize) -> (Vec<f64>, Vec<f64>) {
    let mut random = Random(id as u64);
    let mut qpos = model.initial_key().qpos;
    qpos.iter_mut().for_each(|q| *q += random.uniform(-0.05, 0.05));
    (qpos, random.vector(model.tables().sizes.nv, 0.5))
}

/// Control of world `id` at a step, within the range of the actuator.
fn control(model: &Model, id: usize, step: usize, actuator: usize) -> f64 {
    let [low, high] = model.control_range(actuator);
    Random((id * 1_000_003 + step * 1009 + actuator) as u64).uniform(low, high)
}

fn put(worlds: &mut Worlds, world: usize, id: usize) {
    let (qpos, qvel) = start(worlds.model(), id);
    worlds.set(Field::Qpos, world, &qpos).expect("a state");
    worlds.set(Field::Qvel, world, &qvel).expect("a state");
    let nu = worlds.model().tables().sizes.nu;
    let ctrl: Vec<f64> = (0..nu).map(|a| control(worlds.model(), id, 0, a)).collect();
    worlds.set(Field::Ctrl, world, &ctrl).expect("controls");
}

fn batch(model: &Model, ids: &[usize], options: &Options) -> Worlds {
    let mut worlds = Worlds::new(model, ids.len(), options).expect("a batch");
    ids.iter().enumerate().for_each(|(world, id)| put(&mut worlds, world, *id));
    worlds
}

/// Bits of positions and velocities at every step, and of the number of contacts: one row per world.
type Bits = Vec<Vec<u64>>;

fn record(worlds: &mut Worlds, nstep: usize, controls: Controls<'_>) -> Bits {
    let outputs = ["qpos", "qvel", "ncon", "status"].map(|name| Output::named(name).expect("an output"));
    let rollout = Rollout { nstep, controls, outputs: &outputs, ..Rollout::default() };
    let run = worlds.rollout(&rollout).expect("a rollout");
    let n = worlds.nworld();
    let of_world = |world: usize| {
        let part = |values: &Vec<f64>| {
            let width = values.len() / n;
            values[world * width..(world + 1) * width].iter().map(|x| x.to_bits()).collect::<Vec<u64>>()
        };
        run.outputs.iter().flat_map(part).collect()
    };
    (0..n).map(of_world).collect()
}

/// Runs worlds of the given ids side by side under their own controls.
fn run(model: &Model, ids: &[usize], nstep: usize, options: &Options) -> Bits {
    let nu = model.tables().sizes.nu;
    let of_world = |id: &usize| (0..nstep * nu).map(|i| control(model, *id, i / nu, i % nu)).collect::<Vec<f64>>();
    let controls: Vec<f64> = ids.iter().flat_map(of_world).collect();
    record(&mut batch(model, ids, options), nstep, Controls::Given(&controls))
}

#[track_caller]
fn assert_same(what: &str, ids: &[usize], got: &Bits, alone: &Bits) {
    for (world, id) in ids.iter().enumerate() {
        assert!(got[world] == alone[*id], "{what}: world {world} of {} (id {id}) has other bits", ids.len());
    }
}

/// Every way to run the same worlds for a long time, against each of them alone in the scalar backend.
fn long_runs(name: &str, precision: Precision, contacts: f64) {
    let model = load(name);
    let all: Vec<usize> = (0..DIFFERENT).collect();
    let alone: Bits =
        all.iter().flat_map(|id| run(&model, &[*id], LONG, &options(precision, Backend::Scalar, 1))).collect();
    // Where the numbers of contacts are: after positions and velocities, before the status.
    let sizes = &model.tables().sizes;
    let counts = LONG * (sizes.nq + sizes.nv)..LONG * (sizes.nq + sizes.nv + 1);
    let sum: f64 = alone.iter().flat_map(|world| &world[counts.clone()]).map(|bits| f64::from_bits(*bits)).sum();
    let mean = sum / (LONG * DIFFERENT) as f64;
    assert!(mean > contacts, "{name}: only {mean} contacts");
    for engine in engines(precision, 1) {
        for n in [1, 15, 16, 17] {
            let got = run(&model, &all[..n], LONG, &engine);
            assert_same(&format!("{name} in a batch of {n} with {engine:?}"), &all[..n], &got, &alone);
        }
    }
    for engine in engines(precision, 2) {
        let got = run(&model, &all, LONG, &engine);
        assert_same(&format!("{name} with {engine:?}"), &all, &got, &alone);
    }
}

/// A thousand worlds for as long as the long runs and under the same controls: the states at the end.
fn a_thousand(name: &str, precision: Precision) {
    const PART: usize = 50;
    let model = load(name);
    let nu = model.tables().sizes.nu;
    let advance = |worlds: &mut Worlds, ids: &[usize]| {
        for part in (0..LONG).step_by(PART) {
            let row = |id: &usize| (0..PART * nu).map(|i| control(&model, *id, part + i / nu, i % nu)).collect();
            let rows: Vec<Vec<f64>> = (0..DIFFERENT).map(|id| row(&id)).collect();
            let controls: Vec<f64> = ids.iter().flat_map(|id| rows[*id].iter().copied()).collect();
            let rollout = Rollout { nstep: PART, controls: Controls::Given(&controls), ..Rollout::default() };
            worlds.rollout(&rollout).expect("a rollout");
        }
        let of = |field| worlds.get_all(field);
        [Field::Qpos, Field::Qvel, Field::QaccWarmstart].map(|field| bits(&of(field)))
    };
    let all: Vec<usize> = (0..DIFFERENT).collect();
    let many: Vec<usize> = (0..1000).map(|world| world * 5 % DIFFERENT).collect();
    let alone = advance(&mut batch(&model, &all, &options(precision, Backend::Scalar, 1)), &all);
    for engine in engines(precision, 2) {
        let got = advance(&mut batch(&model, &many, &engine), &many);
        for (got, alone) in got.iter().zip(&alone) {
            let width = alone.len() / DIFFERENT;
            for (world, id) in many.iter().enumerate() {
                let (a, b) = (&got[world * width..(world + 1) * width], &alone[id * width..(id + 1) * width]);
                assert!(a == b, "{name}: world {world} of a thousand (id {id}) has other bits with {engine:?}");
            }
        }
    }
}

/// A thousand worlds, and every world at every place of a block.
fn arrangements(name: &str, precision: Precision) {
    let model = load(name);
    let all: Vec<usize> = (0..DIFFERENT).collect();
    let alone = run(&model, &all, SHORT, &options(precision, Backend::Scalar, 2));
    let many: Vec<usize> = (0..1000).map(|world| world * 5 % DIFFERENT).collect();
    for engine in engines(precision, 2) {
        let got = run(&model, &many, SHORT, &engine);
        assert_same(&format!("{name} in a thousand worlds with {engine:?}"), &many, &got, &alone);
    }
    for engine in engines(precision, 1) {
        for shift in 1..16 {
            let turned: Vec<usize> = (0..16).map(|world| (world + shift) % 16).collect();
            let got = run(&model, &turned, SHORT, &engine);
            assert_same(&format!("{name} moved by {shift} with {engine:?}"), &turned, &got, &alone);
        }
    }
}

macro_rules! models {
    ($($module:ident: $name:literal, $contacts:literal;)*) => {$(
        mod $module {
            use super::*;
            #[test]
            fn long_runs_f64() {
                long_runs($name, Precision::F64, $contacts);
            }
            #[test]
            fn long_runs_f32() {
                long_runs($name, Precision::F32, $contacts);
            }
            #[test]
            fn a_thousand_worlds() {
                PRECISIONS.into_iter().for_each(|precision| a_thousand($name, precision));
            }
            #[test]
            fn every_place() {
                PRECISIONS.into_iter().for_each(|precision| arrangements($name, precision));
            }
        }
    )*};
}

// Each with the least mean number of contacts.
models! {
    humanoid27: "zoo/humanoid27", 1.0;
    humanoid18: "zoo/humanoid18", 1.5;
    hopper: "zoo/hopper", 0.5;
}

/// A humanoid that lies on the floor touches itself as well.
#[test]
fn the_long_runs_have_contacts_of_every_kind() {
    let model = load("zoo/humanoid27");
    let ids: Vec<usize> = (0..DIFFERENT).collect();
    let mut worlds = batch(&model, &ids, &options(Precision::F64, Backend::Wide, 2));
    let links = |pair: &lanesim_kernels::model::Pair<f64>| pair.link1.min(pair.link2) != lanesim_kernels::model::NONE;
    assert!(model.tables().pairs.iter().any(|pair| links(pair) && pair.cross), "no pair joins branches");
    let geoms = [Output::named("contact_geom").expect("an output")];
    let body = |geom: f64| model.placements().geoms[geom as usize].link;
    let (mut between_links, mut with_floor) = (0, 0);
    for _ in 0..20 {
        worlds.step(50).expect("steps");
        worlds
            .forward(&geoms, &mut |_, values| {
                for pair in values[0].chunks(2) {
                    let still = pair.iter().any(|geom| body(*geom) == lanesim_kernels::model::NONE);
                    *(if still { &mut with_floor } else { &mut between_links }) += 1;
                }
            })
            .expect("outputs");
    }
    assert!(
        between_links > 10 && with_floor > 100,
        "{between_links} contacts between links, {with_floor} with the floor"
    );
}

/// Other solvers and cones keep the rule too.
#[test]
fn every_solver_and_cone() {
    let ids: Vec<usize> = (0..DIFFERENT).collect();
    for cone in ["pyramidal", "elliptic"] {
        for (solver, noslip) in [("Newton", "0"), ("CG", "0"), ("PGS", "0"), ("Newton", "3")] {
            let model =
                load_with("zoo/humanoid27", &[("cone", cone), ("solver", solver), ("noslip_iterations", noslip)]);
            for precision in PRECISIONS {
                let alone = run(&model, &ids, SHORT, &options(precision, Backend::Scalar, 2));
                for engine in engines(precision, 2) {
                    let got = run(&model, &ids, SHORT, &engine);
                    assert_same(&format!("{cone} {solver} {noslip} {engine:?}"), &ids, &got, &alone);
                }
            }
        }
    }
}

/// Other integrators do, too: those that evaluate several states in a step, and those that are implicit.
#[test]
fn every_integrator() {
    let ids: Vec<usize> = (0..DIFFERENT).collect();
    for integrator in ["RK4", "implicitfast", "implicit", "discrete", "midpoint"] {
        let actuators = ["unit/actuator_refsite", "unit/actuator_slidercrank", "unit/activation", "unit/muscle"];
        for name in ["zoo/humanoid27", "zoo/chain31", "zoo/box_stack", "unit/rk4"].into_iter().chain(actuators) {
            let model = load_with(name, &[("integrator", integrator)]);
            for precision in PRECISIONS {
                let alone = run(&model, &ids, 2 * SHORT, &options(precision, Backend::Scalar, 2));
                for engine in engines(precision, 2) {
                    let got = run(&model, &ids, 2 * SHORT, &engine);
                    assert_same(&format!("{name} {integrator} {engine:?}"), &ids, &got, &alone);
                }
            }
        }
    }
}

/// Systems whose bodies touch in heaps: large islands, and far more dofs than a tree has.
#[test]
fn large_islands() {
    let ids: Vec<usize> = (0..DIFFERENT).collect();
    for (name, dofs) in [("zoo/heap", 224), ("zoo/balls_in_box", 120), ("zoo/capsule_pile", 72), ("zoo/box_stack", 30)]
    {
        for cone in ["pyramidal", "elliptic"] {
            let model = load_with(name, &[("cone", cone)]);
            assert_eq!(model.tables().sizes.nv, dofs, "{name}");
            for precision in PRECISIONS {
                let alone = run(&model, &ids, SHORT, &options(precision, Backend::Scalar, 2));
                for engine in engines(precision, 2) {
                    let got = run(&model, &ids, SHORT, &engine);
                    assert_same(&format!("{name} {cone} {engine:?}"), &ids, &got, &alone);
                }
            }
        }
    }
}

/// Worlds with more contacts than they may have leave out their own, whatever their neighbours have.
#[test]
fn overflowing_worlds() {
    let ids: Vec<usize> = (0..DIFFERENT).collect();
    for (name, most) in [("zoo/balls_in_box", 7), ("zoo/humanoid27", 2)] {
        let model = load(name);
        for precision in PRECISIONS {
            let limited = |options| Options { max_contacts: most, ..options };
            let alone = run(&model, &ids, SHORT, &limited(options(precision, Backend::Scalar, 1)));
            for engine in engines(precision, 1) {
                let got = run(&model, &ids, SHORT, &limited(engine.clone()));
                assert_same(&format!("{name} of at most {most} contacts with {engine:?}"), &ids, &got, &alone);
            }
            let status = |world: &Vec<u64>| Status(f64::from_bits(*world.last().expect("a status")) as u32);
            let over = alone.iter().filter(|world| status(world).contains(Status::CONTACT_OVERFLOW)).count();
            assert!(over > 0, "{name}: no world had more than {most} contacts");
        }
    }
}

/// A batch large enough that worlds change places between blocks, with forces from outside and worlds that are lost on the
/// way: every world's outputs, status and detail are its own.
#[test]
fn worlds_that_change_places() {
    for integrator in ["Euler", "RK4", "implicit"] {
        change_places(&load_with("zoo/ant", &[("integrator", integrator)]));
    }
}

fn change_places(model: &Model) {
    const WORLDS: usize = 300;
    let nbody = model.tables().sizes.nbody;
    let ids: Vec<usize> = (0..WORLDS).collect();
    for precision in PRECISIONS {
        let prepare = |options: &Options| {
            let mut worlds = batch(model, &ids, options);
            for world in 0..WORLDS {
                let mut forces = vec![0.0; 6 * nbody];
                forces[6] = if world % 37 == 5 { 1e9 } else { (world % 7) as f64 };
                worlds.set(Field::XfrcApplied, world, &forces).expect("forces");
            }
            worlds
        };
        let mut alone = prepare(&options(precision, Backend::Scalar, 2));
        let noise = Controls::Noise { seed: 3, scale: 1.0 };
        let expected = record(&mut alone, 2 * SHORT, noise);
        assert!(alone.lost() > 5, "only {} worlds were lost", alone.lost());
        for engine in engines(precision, 1) {
            let mut many = prepare(&engine);
            let got = record(&mut many, 2 * SHORT, noise);
            assert_same(&format!("grouped with {engine:?}"), &ids, &got, &expected);
            for world in 0..WORLDS {
                let [a, b] = [&many, &alone].map(|worlds| worlds.status_detail(world).expect("a status"));
                assert_eq!(a, b, "{engine:?} world {world}");
            }
            for (field, name) in Field::ALL {
                assert_eq!(bits(&many.get_all(field)), bits(&alone.get_all(field)), "{engine:?} {name}");
            }
        }
    }
}

#[test]
fn steps_one_by_one_are_a_rollout() {
    let model = load("zoo/humanoid27");
    let ids: Vec<usize> = (0..DIFFERENT).collect();
    for precision in PRECISIONS {
        let options = options(precision, Backend::Wide, 2);
        let mut at_once = batch(&model, &ids, &options);
        at_once.step(200).expect("steps");
        let mut singly = batch(&model, &ids, &options);
        for _ in 0..200 {
            singly.step(1).expect("a step");
        }
        for (field, name) in Field::ALL {
            assert_eq!(bits(&at_once.get_all(field)), bits(&singly.get_all(field)), "{name}");
        }
        assert_eq!(at_once.state_hash(), singly.state_hash());
    }
}

fn bits(x: &[f64]) -> Vec<u64> {
    x.iter().map(|x| x.to_bits()).collect()
}

/// Values that no world can go on with, or hardly.
const BAD: [f64; 4] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300];

/// Every other world gets a bad value in one field; the worlds between them do not notice.
fn bad_neighbours(name: &str, precision: Precision) {
    let model = load(name);
    let ids: Vec<usize> = (0..DIFFERENT).collect();
    let options = options(precision, Backend::Wide, 1);
    let mut undisturbed = batch(&model, &ids, &options);
    let alone = record(&mut undisturbed, SHORT, Controls::Keep);
    for (field, field_name) in Field::ALL {
        let width = field.len(&model);
        for value in BAD {
            for entry in [0, width / 2, width.saturating_sub(1)].into_iter().filter(|_| width > 0) {
                let mut worlds = batch(&model, &ids, &options);
                for world in (1..DIFFERENT).step_by(2) {
                    let mut values = worlds.get(field, world).expect("a field");
                    values[entry] = value;
                    worlds.set_unchecked(field, world, &values).expect("a field");
                }
                let got = record(&mut worlds, SHORT, Controls::Keep);
                for id in (0..DIFFERENT).step_by(2) {
                    assert!(got[id] == alone[id], "{name}: {field_name}[{entry}] = {value} reaches world {id}");
                    let [got, alone] = [&worlds, &undisturbed].map(|worlds| worlds.status(id).expect("a status"));
                    assert_eq!(got, alone, "{name}: {field_name}[{entry}] = {value} is seen by world {id}");
                }
            }
        }
    }
}

#[test]
fn neighbours_cannot_disturb_humanoid27() {
    PRECISIONS.into_iter().for_each(|precision| bad_neighbours("zoo/humanoid27", precision));
}

#[test]
fn neighbours_cannot_disturb_humanoid18() {
    PRECISIONS.into_iter().for_each(|precision| bad_neighbours("zoo/humanoid18", precision));
}

#[test]
fn neighbours_cannot_disturb_hopper() {
    PRECISIONS.into_iter().for_each(|precision| bad_neighbours("zoo/hopper", precision));
}

/// What a bad value in a field makes of a world: its status, by field and value. It is found before a step is made of it, which
/// would find more.
const CONSEQUENCES: [(Field, f64, &[&str]); 12] = [
    (Field::Qpos, f64::NAN, &["NonFinitePos", "Frozen"]),
    (Field::Qpos, f64::INFINITY, &["NonFinitePos", "Frozen"]),
    (Field::Qpos, 1e30, &["HugeValue", "Frozen"]),
    (Field::Qvel, f64::NAN, &["NonFiniteVel", "Frozen"]),
    (Field::Qvel, f64::NEG_INFINITY, &["NonFiniteVel", "Frozen"]),
    (Field::Qvel, 1e12, &["HugeValue", "Frozen"]),
    (Field::QfrcApplied, f64::NAN, &["NonFiniteAcc", "Frozen"]),
    (Field::QfrcApplied, 1e30, &["HugeValue", "Frozen"]),
    (Field::XfrcApplied, f64::INFINITY, &["NonFiniteAcc", "Frozen"]),
    (Field::Ctrl, f64::NAN, &["BadCtrl"]),
    (Field::Ctrl, f64::INFINITY, &["BadCtrl"]),
    (Field::QaccWarmstart, f64::NAN, &[]),
];

#[test]
fn a_lost_world_keeps_its_last_good_state_and_says_why() {
    let model = load("zoo/hopper");
    for precision in PRECISIONS {
        for (field, value, names) in CONSEQUENCES {
            let what = format!("{} = {value} in {precision:?}", field.name());
            let mut worlds = batch(&model, &[0, 1, 2], &options(precision, Backend::Wide, 1));
            worlds.step(30).expect("steps");
            let mut values = worlds.get(field, 1).expect("a field");
            // The last entry: of a force on a body, of the last joint.
            *values.last_mut().expect("an entry") = value;
            worlds.set_unchecked(field, 1, &values).expect("a field");
            let before = Field::ALL.map(|(field, _)| bits(&worlds.get(field, 1).expect("a field")));
            worlds.step(20).expect("steps");
            assert_eq!(worlds.status(1).expect("a status").names(), names, "{what}");
            let frozen = names.contains(&"Frozen");
            assert_eq!(worlds.lost(), usize::from(frozen), "{what}");
            let after = Field::ALL.map(|(field, _)| bits(&worlds.get(field, 1).expect("a field")));
            assert_eq!(before == after, frozen, "{what}: the state of a frozen world stays, that of another moves on");
        }
    }
}

/// A world that dies on the way is left at its last good state, which is finite.
#[test]
fn a_world_that_explodes_keeps_a_finite_state() {
    let model = load("zoo/hopper");
    for precision in PRECISIONS {
        let mut worlds = batch(&model, &[0, 1], &options(precision, Backend::Wide, 1));
        let nv = model.tables().sizes.nv;
        worlds.set(Field::QfrcApplied, 1, &vec![1e7; nv]).expect("forces");
        worlds.step(500).expect("steps");
        assert_eq!(worlds.status(1).expect("a status").names().last(), Some(&"Frozen"));
        assert_eq!(worlds.status(0).expect("a status"), Status::default());
        for field in [Field::Qpos, Field::Qvel, Field::QaccWarmstart, Field::Time] {
            let values = worlds.get(field, 1).expect("a field");
            assert!(values.iter().all(|x| x.is_finite()), "{} is {values:?}", field.name());
        }
        let time = worlds.get(Field::Time, 1).expect("the time")[0];
        assert!(time < 0.999, "the clock of a frozen world stands still, at {time}");
    }
}

#[test]
fn reset_clears_everything() {
    let model = load("zoo/humanoid18");
    for precision in PRECISIONS {
        let options = options(precision, Backend::Wide, 1);
        let mut worlds = batch(&model, &[0, 1, 2], &options);
        worlds.step(20).expect("steps");
        for (field, _) in Field::ALL {
            let values = vec![f64::NAN; field.len(&model)];
            worlds.set_unchecked(field, 1, &values).expect("a field");
        }
        worlds.step(5).expect("steps");
        assert_eq!(worlds.lost(), 1);
        let mut fresh = Worlds::new(&model, 1, &options).expect("a batch");
        for key in [None, Some(0)].into_iter().take(1 + usize::from(!model.keys().is_empty())) {
            worlds.reset(1, key).expect("a reset");
            fresh.reset(0, key).expect("a reset");
            assert_eq!((worlds.lost(), worlds.status(1).expect("a status")), (0, Status::default()));
            for (field, name) in Field::ALL {
                let got = worlds.get(field, 1).expect("a field");
                assert_eq!(bits(&got), bits(&fresh.get(field, 0).expect("a field")), "{name}");
            }
            worlds.step(100).expect("steps");
            fresh.step(100).expect("steps");
            for (field, name) in Field::ALL {
                let got = worlds.get(field, 1).expect("a field");
                assert_eq!(bits(&got), bits(&fresh.get(field, 0).expect("a field")), "{name} after steps");
            }
        }
    }
}
