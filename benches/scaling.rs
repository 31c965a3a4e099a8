//! Throughput against the number of worlds, from one block to more than fits any cache, and against the number of threads.

mod common;

use common::{PRECISIONS, load, noise, run, settled};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lanesim::Rollout;

const MODELS: [&str; 2] = ["humanoid18", "hopper"];
const STEPS: usize = 10;

fn worlds(criterion: &mut Criterion) {
    for (model, (precision, name)) in MODELS.into_iter().flat_map(|m| PRECISIONS.map(|p| (m, p))) {
        let mut group = criterion.benchmark_group(format!("worlds/{model}/{name}"));
        group.sample_size(10);
        for nworld in [16, 256, 4096, 65536] {
            let mut worlds = settled(&load(model), nworld, precision, 1);
            // As many steps whatever the number of worlds, but for the largest.
            let nstep = (4096 * STEPS / nworld).max(1);
            group.throughput(Throughput::Elements((nworld * nstep) as u64));
            let rollout = Rollout { nstep, ..noise() };
            group.bench_function(nworld.to_string(), |bencher| bencher.iter(|| run(&mut worlds, &rollout)));
        }
    }
}

fn threads(criterion: &mut Criterion) {
    const WORLDS: usize = 4096;
    let most = std::thread::available_parallelism().map_or(1, usize::from);
    let counts: Vec<usize> = (0..).map(|k| 1 << k).take_while(|n| *n < most).chain([most]).collect();
    for (model, (precision, name)) in MODELS.into_iter().flat_map(|m| PRECISIONS.map(|p| (m, p))) {
        let mut group = criterion.benchmark_group(format!("threads/{model}/{name}"));
        group.sample_size(10).throughput(Throughput::Elements((WORLDS * STEPS) as u64));
        for threads in &counts {
            let mut worlds = settled(&load(model), WORLDS, precision, *threads);
            let rollout = Rollout { nstep: STEPS, ..noise() };
            group.bench_function(threads.to_string(), |bencher| bencher.iter(|| run(&mut worlds, &rollout)));
        }
    }
}

criterion_group! { name = benches; config = common::criterion(); targets = worlds, threads }
criterion_main!(benches);
