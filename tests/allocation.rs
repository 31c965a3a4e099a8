//! Workers allocate nothing in the loop over steps: a rollout of 2000 steps allocates as often as one of 1000.

mod support;

use std::alloc::System;

use lanesim::outputs::Output;
use lanesim::{Backend, Controls, Model, OnDiverge, Options, Parameter, Precision, Rollout, Worlds};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use support::{all_models, load, options};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

const WORLDS: usize = 12;
/// Allocations of one call that come and go: that of the work which is lent to helpers, and what these need at first.
const SLACK: usize = 8;

/// Allocations during a rollout of `nstep` steps from the reference configuration; the fewest of a few calls.
fn allocations(worlds: &mut Worlds, outputs: &[Output], nstep: usize, calls: usize) -> usize {
    let count = |_| {
        (0..WORLDS).for_each(|world| worlds.reset(world, None).expect("a world"));
        let controls = Controls::Noise { seed: 7, scale: 1.0 };
        let rollout = Rollout { nstep, controls, outputs, statistics: true, ..Rollout::default() };
        let region = Region::new(ALLOCATOR);
        let result = worlds.rollout(&rollout);
        let change = region.change();
        drop(result.expect("a rollout"));
        change.allocations + change.reallocations
    };
    (0..calls).map(count).min().expect("some calls")
}

fn assert_silent(name: &str, model: &Model, options: &Options) {
    let names = ["qpos", "xpos", "xquat", "subtree_com", "cdof", "qM", "energy", "qfrc_passive", "ncon", "nefc"];
    let outputs = names.map(|name| Output::named(name).expect("an output"));
    let mut worlds = Worlds::new(model, WORLDS, options).expect("a batch");
    // Of a heap, steps take long, and few of them meet what there is.
    let steps = if model.tables().sizes.nv > 100 { 100 } else { 1000 };
    // Once for everything that grows on first use.
    allocations(&mut worlds, &outputs, 2 * steps, 1);
    let short = allocations(&mut worlds, &outputs, steps, 2);
    let long = allocations(&mut worlds, &outputs, 2 * steps, 2);
    assert!(long <= short + SLACK, "{name}: {short} allocations in {steps} steps, {long} in twice as many");
}

/// Nor do they where numbers of the model differ between worlds, which change places.
fn assert_parameters_are_silent() {
    let model = load("zoo/ant");
    let mut worlds = Worlds::new(&model, WORLDS, &options(Precision::F64, Backend::Auto)).expect("a batch");
    for parameter in [Parameter::Gravity, Parameter::GeomFriction] {
        worlds.set_parameter(parameter, 3, parameter.of(&model)).expect("a parameter");
    }
    allocations(&mut worlds, &[], 2000, 1);
    let short = allocations(&mut worlds, &[], 1000, 2);
    let long = allocations(&mut worlds, &[], 2000, 2);
    assert!(long <= short + SLACK, "parameters: {short} allocations in 1000 steps, {long} in 2000");
}

/// Nor do they where events are recorded of worlds that change places.
fn assert_events_are_silent() {
    let model = load("zoo/ant");
    let few = Options { max_contacts: 1, ..options(Precision::F64, Backend::Auto) };
    let mut worlds = Worlds::new(&model, WORLDS, &few).expect("a batch");
    allocations(&mut worlds, &[], 2000, 1);
    assert!((0..WORLDS).any(|world| !worlds.status_detail(world).expect("a world").is_empty()));
    let short = allocations(&mut worlds, &[], 1000, 2);
    let long = allocations(&mut worlds, &[], 4000, 2);
    assert!(long <= short + SLACK, "events: {short} allocations in 1000 steps, {long} in 4000");
}

/// A pool of many threads allocates for those that have something to do.
fn assert_idle_threads_take_nothing() {
    let model = load("zoo/humanoid18");
    let bytes = |threads| {
        let region = Region::new(ALLOCATOR);
        let options = Options { threads: Some(threads), ..options(Precision::F64, Backend::Wide) };
        let mut worlds = Worlds::new(&model, 5, &options).expect("a batch");
        worlds.step(100).expect("steps");
        region.change().bytes_allocated
    };
    bytes(1);
    let (one, many) = (bytes(1), bytes(64));
    // Threads cost the system's own few kilobytes each.
    assert!(many < 4 * one, "{one} bytes with one thread, {many} with 64");
}

/// What threads work in is counted before it is allocated: due times of bounding tests, what acceleration of sweeps remembers,
/// forces of edges, and what evaluates stiff worlds of single precision.
fn assert_scratch_is_counted() {
    let balls: String = (0..48)
        .map(|i| format!("<body pos='{} 0 .099'><freejoint/><geom size='.1'/></body>", 0.3 * f64::from(i)))
        .collect();
    for (precision, solver, friction) in
        [(Precision::F64, "Newton", "1"), (Precision::F64, "PGS", "1"), (Precision::F32, "Newton", "1e-4")]
    {
        let text = format!(
            "<mujoco><option solver='{solver}'/><default><geom friction='{friction}'/></default><worldbody>\
             <geom type='plane' size='9 9 1'/>{balls}</worldbody></mujoco>"
        );
        let model = Model::from_xml_string(&text, &Default::default()).expect("a model");
        let options = Options { threads: Some(1), ..options(precision, Backend::Wide) };
        let (world, thread) = Worlds::memory_of(&model, &options);
        let region = Region::new(ALLOCATOR);
        let mut worlds = Worlds::new(&model, 1, &options).expect("a batch");
        worlds.step(3).expect("steps");
        let change = region.change();
        let taken = change.bytes_allocated - change.bytes_deallocated;
        println!("{precision:?} {solver}: {taken} of {thread} + 16 * {world} bytes");
        // Beside it there are lists of the batch, and of single precision the model's tables.
        let tables = if precision == Precision::F32 { 400 * model.tables().pairs.len() } else { 0 };
        assert!(
            taken < thread + 16 * world + 40_000 + tables,
            "{precision:?} {solver}: {taken} bytes, {thread} counted"
        );
    }
}

/// One test, so that no other allocates meanwhile.
#[test]
fn steps_do_not_allocate() {
    assert_scratch_is_counted();
    for name in all_models().iter().filter(|name| name.starts_with("zoo/")) {
        let model = load(name);
        assert_silent(name, &model, &options(Precision::F32, Backend::Auto));
    }
    for (option, value) in [("solver", "PGS"), ("solver", "CG"), ("cone", "elliptic"), ("noslip_iterations", "3")] {
        let model = support::load_with("zoo/ant", &[(option, value), ("iterations", "20")]);
        let reset = Options { on_diverge: OnDiverge::Reset { key: None }, ..options(Precision::F64, Backend::Auto) };
        assert_silent(&format!("ant with {option}={value}"), &model, &reset);
    }
    for (model, integrator) in
        [("zoo/ant", "RK4"), ("zoo/humanoid18", "implicit"), ("unit/rk4", "implicitfast"), ("zoo/ant", "discrete")]
    {
        let model = support::load_with(model, &[("integrator", integrator)]);
        assert_silent(integrator, &model, &options(Precision::F32, Backend::Auto));
    }
    assert_parameters_are_silent();
    assert_events_are_silent();
    assert_idle_threads_take_nothing();
}
