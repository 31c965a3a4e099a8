//! Rollouts: what recording costs beside stepping, and what a long horizon saves beside single steps, one thread.

mod common;

use common::{PRECISIONS, load, noise, run, settled};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lanesim::Rollout;
use lanesim::outputs::Output;

const WORLDS: usize = 128;
const STEPS: usize = 20;
/// Nothing, the state, and what has to be computed on the way.
const RECORDED: [(&str, &[&str]); 3] =
    [("nothing", &[]), ("state", &["qpos", "qvel"]), ("frames", &["qpos", "qvel", "xpos", "xquat", "qfrc_constraint"])];

fn rollout(criterion: &mut Criterion) {
    for (model, (precision, name)) in
        ["humanoid18", "hopper", "isolated34"].into_iter().flat_map(|m| PRECISIONS.map(|p| (m, p)))
    {
        let mut worlds = settled(&load(model), WORLDS, precision, 1);
        let mut group = criterion.benchmark_group(format!("rollout/{model}/{name}"));
        group.throughput(Throughput::Elements((WORLDS * STEPS) as u64));
        for (what, fields) in RECORDED {
            let outputs: Vec<Output> =
                fields.iter().map(|field| Output::named(field).unwrap_or_else(|e| panic!("{e}"))).collect();
            let rollout = Rollout { nstep: STEPS, outputs: &outputs, ..noise() };
            group.bench_function(what, |bencher| bencher.iter(|| run(&mut worlds, &rollout)));
        }
        group.bench_function("single steps", |bencher| {
            bencher.iter(|| (0..STEPS).for_each(|_| drop(run(&mut worlds, &noise()))));
        });
    }
}

criterion_group! { name = benches; config = common::criterion(); targets = rollout }
criterion_main!(benches);
