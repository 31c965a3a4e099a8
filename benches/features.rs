//! What a feature costs that is there but does nothing: CPU time of a step beside that of the same model without it.
//!
//! Worlds are high above the floor at rest, joints in the middle of their ranges, so that no contact or limit acts. Both
//! models are stepped in turn, in several rounds; the median of the ratios is printed, with the quartiles.

use std::error::Error;
use std::time::Instant;

use lanesim::mjcf::LoadOptions;
use lanesim::{Field, Model, Options, Precision, Rollout, Worlds};
use lanesim_kernels::model::JointKind;

const WORLDS: usize = 1024;
const STEPS: usize = 20;
/// Models and batches that are made, and pairs of runs of each.
const ROUNDS: usize = 13;
const REPEATS: usize = 5;
/// Height, m, from which nothing reaches the floor in so few steps.
const HEIGHT: f64 = 50.0;

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

fn batch(model: &Model, precision: Precision) -> Result<Worlds, Box<dyn Error>> {
    Ok(Worlds::new(model, WORLDS, &Options { precision, threads: Some(1), ..Options::default() })?)
}

/// CPU time of some steps from `qpos` at rest, s.
fn time(worlds: &mut Worlds, qpos: &[f64]) -> Result<f64, Box<dyn Error>> {
    for world in 0..WORLDS {
        worlds.reset(world, None)?;
        worlds.set(Field::Qpos, world, qpos)?;
    }
    let start = cpu_seconds();
    worlds.step(STEPS)?;
    Ok(cpu_seconds() - start)
}

/// CPU time of all threads of this process as Linux counts it, else wall time, s.
fn cpu_seconds() -> f64 {
    let time = |task: std::io::Result<std::fs::DirEntry>| -> Option<f64> {
        let text = std::fs::read_to_string(task.ok()?.path().join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse().ok()
    };
    let nanoseconds: Option<f64> = std::fs::read_dir("/proc/self/task").ok().map(|tasks| tasks.filter_map(time).sum());
    match nanoseconds {
        Some(sum) if sum > 0.0 => sum * 1e-9,
        _ => {
            static START: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
            START.get_or_init(Instant::now).elapsed().as_secs_f64()
        }
    }
}

/// Quartiles of the ratio of CPU times, and rows that acted after all. Where memory and code happen to lie makes a difference of
/// several per cent for as long as a batch lives, so every round has its own models and batches, put elsewhere by padding.
fn compare(zoo: &str, feature: &Feature, precision: Precision) -> Result<([f64; 3], f64), Box<dyn Error>> {
    let qpos = calm(&model(zoo, |text| (text.to_owned(), &[]))?);
    let mut ratios = Vec::with_capacity(ROUNDS);
    let (mut padding, mut acting) = (vec![], 0.0);
    for round in 0..ROUNDS {
        padding.push(vec![1_u8; 4160 * (1 + 5 * round % 7)]);
        let (with, without) = (model(zoo, feature.with)?, model(zoo, feature.without)?);
        let (mut a, mut b) = (batch(&with, precision)?, batch(&without, precision)?);
        time(&mut a, &qpos)?;
        time(&mut b, &qpos)?;
        acting = a.rollout(&Rollout { nstep: 1, statistics: true, ..Rollout::default() })?.statistics.rows;
        // The fastest of several: what disturbs only ever adds.
        let mut fastest = [f64::INFINITY; 2];
        for _ in 0..REPEATS {
            fastest[0] = time(&mut a, &qpos)?.min(fastest[0]);
            fastest[1] = time(&mut b, &qpos)?.min(fastest[1]);
        }
        ratios.push(fastest[0] / fastest[1]);
    }
    ratios.sort_by(f64::total_cmp);
    Ok(([1, 2, 3].map(|quarter| ratios[quarter * (ROUNDS - 1) / 4]), acting))
}

fn main() -> Result<(), Box<dyn Error>> {
    println!("{:<13} {:<30} {:<5} {:>7}  quartiles", "model", "feature", "type", "cost");
    for zoo in ["hopper", "cheetah", "ant", "humanoid18", "humanoid27"] {
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
