//! What a feature costs that is there but does nothing: time of a step beside that of the same model without it.
//!
//! Worlds are high above the floor, limbs apart and joints away from their limits, so that no contact or limit acts. Both models are
//! stepped in turn, in several rounds; the median of the ratios is printed, with the quartiles. Arguments are
//! beginnings of the names of models of the zoo, and of features, if not all are wanted.

use std::error::Error;
use std::time::{Duration, Instant};

use lanesim::mjcf::LoadOptions;
use lanesim::{Field, Model, Options, Precision, Rollout, Worlds};
use lanesim_kernels::model::JointKind;

const ZOO: [&str; 5] = ["hopper", "cheetah", "ant", "humanoid18", "humanoid27"];
const STEPS: usize = 100;
/// Time of a run, s, at least: long beside what it takes to wake a thread, short beside the machine's moods.
const RUN: f64 = 5e-3;
/// Time after which a worker without work sleeps.
const SLEEP: Duration = Duration::from_millis(1);
/// Models and batches that are made, and pairs of runs of each.
const ROUNDS: usize = 7;
const REPEATS: usize = 21;
/// Height, m, from which nothing reaches the floor in so few steps.
const HEIGHT: f64 = 50.0;
/// Room that limits leave to joints, at least if they can, rad or m.
const WAY: f64 = 0.3;
/// Speeds of dofs at the start, at most, rad/s or m/s: too slow for that way, and no dof is at rest, so that no number is so
/// small that it costs more. The faster joints turn, the sooner limbs that are near each other may have met.
const SLOW: f64 = 0.1;
const FAST: f64 = 0.5;

/// A feature: its name, and the texts and flags of the model with it and without it.
struct Feature {
    name: &'static str,
    with: fn(&str) -> (String, Flags),
    without: fn(&str) -> (String, Flags),
    speed: f64,
}

type Flags = &'static [(&'static str, &'static str)];

const FEATURES: [Feature; 11] = [
    Feature {
        name: "contacts out of reach",
        with: |text| (text.to_owned(), &[]),
        without: |text| (text.to_owned(), &[("contact", "disable")]),
        speed: SLOW,
    },
    Feature {
        name: "contacts out of reach, faster",
        with: |text| (text.to_owned(), &[]),
        without: |text| (text.to_owned(), &[("contact", "disable")]),
        speed: FAST,
    },
    Feature {
        name: "limits not reached",
        with: |text| (text.to_owned(), &[]),
        without: |text| (text.to_owned(), &[("limit", "disable")]),
        speed: SLOW,
    },
    Feature {
        name: "dry friction switched off",
        with: |text| (rubbing(text), &[("frictionloss", "disable")]),
        without: |text| (text.to_owned(), &[]),
        speed: SLOW,
    },
    Feature {
        name: "actuators at control 0",
        with: |text| (text.to_owned(), &[]),
        without: |text| (cut(text, "actuator"), &[]),
        speed: SLOW,
    },
    Feature {
        name: "actuators of a disabled group",
        with: |text| (text.to_owned(), &[("actuatorgroupdisable", "0")]),
        without: |text| (cut(text, "actuator"), &[]),
        speed: SLOW,
    },
    Feature {
        name: "activations of a disabled group",
        with: |text| (activated(text), &[("actuatorgroupdisable", "0")]),
        without: |text| (text.to_owned(), &[("actuatorgroupdisable", "0")]),
        speed: SLOW,
    },
    Feature {
        name: "equality not active",
        with: |text| {
            let joined = |[a, b]: [&str; 2]| format!(r#"<joint joint1="{a}" joint2="{b}" active="false"/>"#);
            (beside(text, "equality", joined), &[])
        },
        without: |text| (text.to_owned(), &[]),
        speed: SLOW,
    },
    Feature {
        name: "tendon without forces",
        with: |text| {
            let fixed = |[a, b]: [&str; 2]| {
                format!(r#"<fixed><joint joint="{a}" coef="1"/><joint joint="{b}" coef="-1"/></fixed>"#)
            };
            (beside(text, "tendon", fixed), &[])
        },
        without: |text| (text.to_owned(), &[]),
        speed: SLOW,
    },
    Feature {
        name: "sensors not asked for",
        with: |text| {
            let measured = |[a, b]: [&str; 2]| format!(r#"<jointpos joint="{a}"/><jointvel joint="{b}"/><clock/>"#);
            (beside(text, "sensor", measured), &[])
        },
        without: |text| (text.to_owned(), &[]),
        speed: SLOW,
    },
    Feature {
        name: "meshes to be looked at",
        with: |text| (decorated(text), &[]),
        without: |text| (text.to_owned(), &[]),
        speed: SLOW,
    },
];

/// The text with an activation in each of its motors.
fn activated(text: &str) -> String {
    text.replace("<motor ", "<general dyntype=\"integrator\" ")
}

/// The text with a section that is about its last two joints with names.
fn beside(text: &str, section: &str, content: fn([&str; 2]) -> String) -> String {
    let named = text.split("<joint ").skip(1).filter_map(|rest| {
        let (_, name) = rest.split_once('>')?.0.split_once("name=\"")?;
        Some(name.split('"').next().unwrap_or_default())
    });
    let names: Vec<&str> = named.collect();
    let [.., a, b] = names[..] else { return text.to_owned() };
    let content = content([a, b]);
    text.replacen("</mujoco>", &format!("<{section}>{content}</{section}></mujoco>"), 1)
}

/// The text with a mesh in every body, which neither touches nor weighs.
fn decorated(text: &str) -> String {
    let mesh = r#"<asset><mesh name="looks" builtin="sphere" params="2" scale="0.05 0.05 0.05"/></asset>"#;
    let geom = r#"<geom type="mesh" mesh="looks" contype="0" conaffinity="0" mass="0"/></body>"#;
    text.replace("</body>", geom).replacen("<worldbody>", &format!("{mesh}<worldbody>"), 1)
}

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
        let [low, high] = limit.range;
        // As near to the reference configuration, where limbs are apart, as the way that joints go allows.
        let room = WAY.min(0.5 * (high - low));
        let place = &mut qpos[limit.qpos as usize];
        *place = place.clamp(low + room, high - room);
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
fn enough(model: &Model, precision: Precision, start: (&[f64], f64)) -> Result<usize, Box<dyn Error>> {
    let mut worlds = 64;
    loop {
        let mut batch = batch(model, worlds, precision)?;
        time(&mut batch, start)?;
        if time(&mut batch, start)? > RUN {
            return Ok(worlds);
        }
        worlds *= 2;
    }
}

/// Time of some steps from `qpos`, s.
fn time(worlds: &mut Worlds, (qpos, speed): (&[f64], f64)) -> Result<f64, Box<dyn Error>> {
    let nv = worlds.model().tables().sizes.nv;
    for world in 0..worlds.nworld() {
        worlds.reset(world, None)?;
        worlds.set(Field::Qpos, world, qpos)?;
        let speed = |dof: usize| speed * (1.0 + (world * nv + dof) as f64).sin();
        worlds.set(Field::Qvel, world, &(0..nv).map(speed).collect::<Vec<f64>>())?;
    }
    let start = worker_seconds();
    worlds.step(STEPS)?;
    Ok(worker_seconds() - start)
}

/// CPU time of the threads of this process but for its first as Linux counts it, else wall time, s. What the system counts for a
/// thread is up to date only while it sleeps.
fn worker_seconds() -> f64 {
    std::thread::sleep(SLEEP);
    let main = std::process::id().to_string();
    let time = |task: std::io::Result<std::fs::DirEntry>| -> Option<f64> {
        let task = task.ok()?;
        let text = std::fs::read_to_string(task.path().join("schedstat")).ok()?;
        if task.file_name().to_str() == Some(&main) { None } else { text.split_whitespace().next()?.parse().ok() }
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

/// Quartiles over the rounds of the ratio of times, and rows that acted after all. Runs of the two models alternate, each so
/// short that both of a pair see the same machine; what disturbs one of them is an outlier, and a round is its median pair.
/// Where memory and code happen to lie makes a difference of a few per cent for as long as a batch lives, so every round has its
/// own models and batches, put elsewhere by padding.
fn compare(zoo: &str, feature: &Feature, precision: Precision) -> Result<([f64; 3], f64), Box<dyn Error>> {
    let qpos = calm(&model(zoo, |text| (text.to_owned(), &[]))?);
    let start = (&qpos[..], feature.speed);
    let size = enough(&model(zoo, feature.without)?, precision, start)?;
    let mut ratios = Vec::with_capacity(ROUNDS);
    let (mut padding, mut acting) = (vec![], 0.0);
    for round in 0..ROUNDS {
        padding.push(vec![1_u8; 4160 * (1 + 5 * round % 7)]);
        let (with, without) = (model(zoo, feature.with)?, model(zoo, feature.without)?);
        // Neither is always the first to find room.
        let (mut a, mut b);
        if round % 2 == 0 {
            a = batch(&with, size, precision)?;
            b = batch(&without, size, precision)?;
            time(&mut a, start)?;
            time(&mut b, start)?;
        } else {
            b = batch(&without, size, precision)?;
            a = batch(&with, size, precision)?;
            time(&mut b, start)?;
            time(&mut a, start)?;
        }
        acting = a.rollout(&Rollout { nstep: 1, statistics: true, ..Rollout::default() })?.statistics.rows;
        let mut pairs = Vec::with_capacity(REPEATS);
        for repeat in 0..REPEATS {
            let first = if repeat % 2 == 0 { Some(time(&mut a, start)?) } else { None };
            let below = time(&mut b, start)?;
            let above = first.map_or_else(|| time(&mut a, start), Ok)?;
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
    // All threads on one core, which they inherit: where the system puts them otherwise makes a difference of tens of per cent.
    if let Some(core) = core_affinity::get_core_ids().unwrap_or_default().last() {
        core_affinity::set_for_current(*core);
    }
    println!("{:<13} {:<30} {:<5} {:>7}  quartiles", "model", "feature", "type", "cost");
    let asked: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let wanted = |all: &[&str], name: &str| {
        let mut of_kind = asked.iter().filter(|word| all.iter().any(|name| name.starts_with(*word))).peekable();
        of_kind.peek().is_none() || of_kind.any(|word| name.starts_with(word))
    };
    let names = FEATURES.each_ref().map(|feature| feature.name);
    for zoo in ZOO.into_iter().filter(|zoo| wanted(&ZOO, zoo)) {
        for feature in FEATURES.iter().filter(|feature| wanted(&names, feature.name)) {
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
