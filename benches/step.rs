//! One step of many typical worlds under control noise, one thread, every model of the zoo.

mod common;

use common::{PRECISIONS, load, noise, run, settled};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

const WORLDS: usize = 512;
const MODELS: [&str; 17] = [
    "ant",
    "arm",
    "balls_in_box",
    "box_stack",
    "capsule_pile",
    "cartpole",
    "chain31",
    "cheetah",
    "hand32",
    "hopper",
    "humanoid18",
    "humanoid27",
    "humanoid29",
    "isolated34",
    "pendulums",
    "quadruped",
    "walker",
];

fn step(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("step");
    group.throughput(Throughput::Elements(WORLDS as u64));
    for (model, (precision, name)) in MODELS.into_iter().flat_map(|m| PRECISIONS.map(|p| (m, p))) {
        let mut worlds = settled(&load(model), WORLDS, precision, 1);
        group.bench_function(format!("{model}/{name}"), |bencher| bencher.iter(|| run(&mut worlds, &noise())));
    }
}

criterion_group! { name = benches; config = common::criterion(); targets = step }
criterion_main!(benches);
