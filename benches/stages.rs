//! Time of each stage within the steps of typical worlds, one thread: nanoseconds per world and step are the figures under
//! `time` divided by the number of worlds. A clock is read between stages, at about 20 ns each per block.

mod common;

use std::time::Duration;

use common::{MODELS, PRECISIONS, load, noise, run, settled};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lanesim::Rollout;
use lanesim_kernels::pipeline::Stage;

const WORLDS: usize = 128;

fn stages(criterion: &mut Criterion) {
    for (model, (precision, name)) in MODELS.into_iter().flat_map(|m| PRECISIONS.map(|p| (m, p))) {
        let mut worlds = settled(&load(model), WORLDS, precision, 1);
        let mut group = criterion.benchmark_group(format!("stages/{model}/{name}"));
        group.throughput(Throughput::Elements(WORLDS as u64));
        for (stage, stage_name) in Stage::ALL {
            group.bench_function(stage_name, |bencher| {
                bencher.iter_custom(|steps| {
                    let rollout = Rollout { nstep: steps as usize, clock: true, ..noise() };
                    // A stage that a model does not need takes nothing; criterion wants something.
                    run(&mut worlds, &rollout).clock.spent[stage as usize].max(Duration::from_nanos(steps))
                });
            });
        }
    }
}

criterion_group! { name = benches; config = common::criterion(); targets = stages }
criterion_main!(benches);
