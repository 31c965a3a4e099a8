//! What a feature costs that is there but does nothing: time of a step beside that of the same model without it.
//!
//! Worlds are high above the floor, joints in the middle of their ranges, so that no contact or limit acts. Both models are
//! stepped in turn, in several rounds; the median of the ratios is printed, with the quartiles. Arguments name the models of
//! the zoo, if not all.

use std::error::Error;
use std::time::Instant;

use lanesim::mjcf::LoadOptions;
use lanesim::{Field, Model, Options, Precision, Rollout, Worlds};
use lanesim_kernels::model::JointKind;

const ZOO: [&str; 5] = ["hopper", "cheetah", "ant", "humanoid18", "humanoid27"];
const STEPS: usize = 20;
/// Time of a run, s, at least: long beside what it takes to wake a thread, short beside the machine's moods.
const RUN: f64 = 5e-3;
/// Models and batches that are made, and pairs of runs of each.
const ROUNDS: usize = 7;
const REPEATS: usize = 21;
/// Height, m, from which nothing reaches the floor in so few steps.
const HEIGHT: f64 = 50.0;
/// Speeds of dofs at the start, at most: slow enough for the middle of a joint's range, and no dof is at rest, so that no
/// number is so small that it costs more.
const SPEED: f64 = 0.5;

/// A feature: its name, and the texts and flags of the model with it and without it.
struct Feature {
    name: &'static str,
    with: fn(&str) -> (String, Flags),
    without: fn(&str) -> (String, Flags),
}

type Flags = &'static [(&'static str, &'static str)];

const FEATURES: [Feature; 5] = [
    Feature {
        name: "contacts out of reach",
        with: |text| (text.to_owned(), &[]),
        without: |text| (text.to_owned(), &[("contact", "disable")]),
    },
    Feature {
        name: "limits not reached",
        with: |text| (text.to_owned(), &[]),
        without: |text| (text.to_owned(), &[("limit", "disable")]),
    },
    Feature {
        name: "dry friction switched off",
        with: |text| (rubbing(text), &[("frictionloss", "disable")]),
        without: |text| (text.to_owned(), &[]),
    },
    Feature {
        name: "actuators at control 0",
        with: |text| (text.to_owned(), &[]),
        without: |text| (cut(text, "actuator"), &[]),
    },
    Feature {
        name: "actuators of a disabled group",
        with: |text| (text.to_owned(), &[("actuatorgroupdisable", "0")]),
        without: |text| (cut(text, "actuator"), &[]),
    },
];

/// The text without its sections of that tag.
fn cut(text: &str, tag: &str) -> String {
    let (open, close) = (format!("<{tag}>"), format!("</{tag}>"));
    match (text.find(&open), text.find(&close)) {
        (Some(from), Some(to)) => format!("{}{}", &text[..from], &text[to + close.len()..]),
        _ => text.to_owned(),
    }
}

/// The text with dry friction in its first joint, or by its default in all.
fn rubbing(text: &str) -> String {
    text.replacen("<joint ", "<joint frictionloss=\"0.1\" ", 1)
}

fn model(zoo: &str, side: fn(&str) -> (String, Flags)) -> Result<Model, Box<dyn Error>> {
    let path = format!("{}/models/zoo/{zoo}.xml", env!("CARGO_MANIFEST_DIR"));
    let (text, flags) = side(&cut(&std::fs::read_to_string(path)?, "keyframe"));
    let overrides = flags.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
    Ok(Model::from_xml_string(&text, &LoadOptions { overrides, lenient: true })?)
}

/// Where no feature acts: `like` has the limits that say where that is.
fn calm(like: &Model) -> Vec<f64> {
    let tables = like.tables();
    let mut qpos = tables.qpos0.clone();
    for limit in tables.limits.iter().filter(|limit| !limit.ball) {
        qpos[limit.qpos as usize] = 0.5 * (limit.range[0] + limit.range[1]);
    }
    for joint in tables.joints.iter().filter(|joint| joint.kind == JointKind::Free) {
        qpos[joint.qpos as usize + 2] += HEIGHT;
    }
    for joint in tables.joints.iter().filter(|joint| joint.kind == JointKind::Slide && joint.axis[2] == 1.0) {
        qpos[joint.qpos as usize] += HEIGHT;
    }
    qpos
}

fn batch(model: &Model, worlds: usize, precision: Precision) -> Result<Worlds, Box<dyn Error>> {
    Ok(Worlds::new(model, worlds, &Options { precision, threads: Some(1), ..Options::default() })?)
}

/// Number of worlds for which a run takes long enough.
fn enough(model: &Model, precision: Precision, qpos: &[f64]) -> Result<usize, Box<dyn Error>> {
    let mut worlds = 256;
    loop {
        let mut batch = batch(model, worlds, precision)?;
        time(&mut batch, qpos)?;
        if time(&mut batch, qpos)? > RUN {
            return Ok(worlds);
        }
        worlds *= 2;
    }
}

/// Time of some steps from `qpos`, s.
fn time(worlds: &mut Worlds, qpos: &[f64]) -> Result<f64, Box<dyn Error>> {
    let nv = worlds.model().tables().sizes.nv;
    for world in 0..worlds.nworld() {
        worlds.reset(world, None)?;
        worlds.set(Field::Qpos, world, qpos)?;
        let speed = |dof: usize| SPEED * (1.0 + (world * nv + dof) as f64).sin();
        worlds.set(Field::Qvel, world, &(0..nv).map(speed).collect::<Vec<f64>>())?;
    }
    let start = Instant::now();
    worlds.step(STEPS)?;
    Ok(start.elapsed().as_secs_f64())
}

/// Quartiles over the rounds of the ratio of times, and rows that acted after all. Runs of the two models alternate, each so
/// short that both of a pair see the same machine; what disturbs one of them is an outlier, and a round is its median pair.
/// Where memory and code happen to lie makes a difference for as long as a batch lives, so every round has its own models
/// and batches, put elsewhere by padding.
fn compare(zoo: &str, feature: &Feature, precision: Precision) -> Result<([f64; 3], f64), Box<dyn Error>> {
    let qpos = calm(&model(zoo, |text| (text.to_owned(), &[]))?);
    let size = enough(&model(zoo, feature.without)?, precision, &qpos)?;
    let mut ratios = Vec::with_capacity(ROUNDS);
    let (mut padding, mut acting) = (vec![], 0.0);
    for round in 0..ROUNDS {
        padding.push(vec![1_u8; 4160 * (1 + 5 * round % 7)]);
        let (with, without) = (model(zoo, feature.with)?, model(zoo, feature.without)?);
        let (mut a, mut b) = (batch(&with, size, precision)?, batch(&without, size, precision)?);
        time(&mut a, &qpos)?;
        time(&mut b, &qpos)?;
        acting = a.rollout(&Rollout { nstep: 1, statistics: true, ..Rollout::default() })?.statistics.rows;
        let mut pairs = Vec::with_capacity(REPEATS);
        for repeat in 0..REPEATS {
            let first = if repeat % 2 == 0 { Some(time(&mut a, &qpos)?) } else { None };
            let below = time(&mut b, &qpos)?;
            let above = first.map_or_else(|| time(&mut a, &qpos), Ok)?;
            pairs.push(above / below);
        }
        ratios.push(quartiles(&mut pairs)[1]);
    }
    Ok((quartiles(&mut ratios), acting))
}

/// Sorts.
fn quartiles(numbers: &mut [f64]) -> [f64; 3] {
    numbers.sort_by(f64::total_cmp);
    [1, 2, 3].map(|quarter| numbers[quarter * (numbers.len() - 1) / 4])
}

fn main() -> Result<(), Box<dyn Error>> {
    println!("{:<13} {:<30} {:<5} {:>7}  quartiles", "model", "feature", "type", "cost");
    let asked: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    for zoo in ZOO.into_iter().filter(|zoo| asked.is_empty() || asked.iter().any(|name| name == zoo)) {
        for feature in &FEATURES {
            for (precision, name) in [(Precision::F32, "f32"), (Precision::F64, "f64")] {
                let (quartiles, acting) = compare(zoo, feature, precision)?;
                let [low, median, high] = quartiles.map(|ratio| 100.0 * (ratio - 1.0));
                let note = if acting > 0.0 { "  (rows act: not a fair comparison)" } else { "" };
                println!("{zoo:<13} {:<30} {name:<5} {median:>+6.1}%  {low:+.1}% {high:+.1}%{note}", feature.name);
            }
        }
    }
    Ok(())
}
