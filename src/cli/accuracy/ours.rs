//! Jobs done by lanesim.

use std::time::Instant;

use lanesim::mjcf::LoadOptions;
use lanesim::{Controls, Error, Field, Model, Options, Precision, Rollout, Worlds, noise};

use super::engine::{Job, Outcome, Setting, Timing, Trajectory, sound};
use super::ruler::Sample;

/// Noise on the velocities of timed worlds, so that they do not all do the same at once.
const SPREAD: f64 = 1e-3;

/// The model with options of a setting.
pub fn model(xml: &str, options: &[(String, String)]) -> Result<Model, Error> {
    let overrides = options.to_vec();
    Ok(Model::from_xml_string(xml, &LoadOptions { overrides, ..LoadOptions::default() })?)
}

fn place(worlds: &mut Worlds, world: usize, sample: &Sample) -> Result<(), Error> {
    worlds.reset(world, None)?;
    worlds.set(Field::Time, world, &[sample.time])?;
    worlds.set(Field::Qpos, world, &sample.qpos)?;
    worlds.set(Field::Qvel, world, &sample.qvel)
}

fn state(worlds: &Worlds, world: usize, time: f64) -> Result<Sample, Error> {
    Ok(Sample { time, qpos: worlds.get(Field::Qpos, world)?, qvel: worlds.get(Field::Qvel, world)? })
}

/// Does the job on one thread.
pub fn run(job: &Job<'_>, precision: Precision, more: &[(String, String)]) -> Result<Outcome, Error> {
    let options: Vec<_> = job.setting.options().into_iter().chain(more.iter().cloned()).collect();
    let model = model(job.xml, &options)?;
    let options = Options { precision, threads: Some(1), ..Options::default() };
    let trajectories = trajectories(job, &model, &options)?;
    let all_lost = trajectories.iter().all(|trajectory| trajectory.lost);
    let timed = !all_lost && job.timing.steps > 0;
    let seconds_per_step = if timed { time(&job.timing, &model, &options)? } else { None };
    Ok(Outcome { trajectories, seconds_per_step })
}

fn trajectories(job: &Job<'_>, model: &Model, options: &Options) -> Result<Vec<Trajectory>, Error> {
    let n = job.starts.len();
    let mut worlds = Worlds::new(model, n, options)?;
    (0..n).try_for_each(|world| place(&mut worlds, world, &job.starts[world]))?;
    let mut all: Vec<_> =
        job.starts.iter().map(|start| Trajectory { samples: vec![start.clone()], lost: false }).collect();
    for interval in 0..job.intervals {
        for (world, controls) in job.controls.iter().enumerate() {
            worlds.set(Field::Ctrl, world, &controls[interval])?;
        }
        worlds.step(job.steps)?;
        if (interval + 1) % job.every != 0 {
            continue;
        }
        let passed = job.setting.timestep * (job.steps * (interval + 1)) as f64;
        for (world, trajectory) in all.iter_mut().enumerate().filter(|(_, trajectory)| !trajectory.lost) {
            let sample = state(&worlds, world, job.starts[world].time + passed)?;
            trajectory.lost = worlds.status(world)?.contains(lanesim_kernels::state::Status::FROZEN) || !sound(&sample);
            if !trajectory.lost {
                trajectory.samples.push(sample);
            }
        }
        if all.iter().all(|trajectory| trajectory.lost) {
            break;
        }
    }
    Ok(all)
}

/// Single steps from states, solved as far as numbers go: the start, the state after it, and what its velocity would be without
/// constraints.
pub fn solved(xml: &str, setting: &Setting, starts: &[Sample]) -> Result<Vec<Trajectory>, Error> {
    let accurate = [("tolerance", "1e-15"), ("iterations", "500")].map(|(name, value)| (name.into(), value.into()));
    let unlimited = Setting { iterations: None, ..setting.clone() };
    let options: Vec<_> = unlimited.options().into_iter().chain(accurate).collect();
    let model = model(xml, &options)?;
    let mut worlds = Worlds::new(&model, starts.len(), &Options { threads: Some(1), ..Options::default() })?;
    starts.iter().enumerate().try_for_each(|(world, start)| place(&mut worlds, world, start))?;
    let nv = model.tables().sizes.nv;
    let mut smooth = vec![0.0; nv * starts.len()];
    worlds.read_all(&["qacc_smooth"], vec![lanesim::rows::Rows::F64(&mut smooth)])?;
    worlds.step(1)?;
    let one = |(world, start): (usize, &Sample)| {
        let after = state(&worlds, world, start.time + setting.timestep)?;
        let mut free = start.clone();
        let accelerations = &smooth[nv * world..nv * (world + 1)];
        free.qvel.iter_mut().zip(accelerations).for_each(|(v, a)| *v += setting.timestep * a);
        Ok(Trajectory { samples: vec![start.clone(), after, free], lost: false })
    };
    starts.iter().enumerate().map(one).collect()
}

/// The best wall time of a step, per world.
fn time(timing: &Timing<'_>, model: &Model, options: &Options) -> Result<Option<f64>, Error> {
    let n = timing.batch;
    let mut worlds = Worlds::new(model, n, options)?;
    let mut best = f64::INFINITY;
    let (begin, mut runs) = (Instant::now(), 0);
    while runs < 3 || begin.elapsed().as_secs_f64() < timing.seconds {
        for world in 0..n {
            let mut start = timing.start.clone();
            for (dof, v) in start.qvel.iter_mut().enumerate() {
                *v += SPREAD * noise::normal(3, world as u64, 0, dof as u64);
            }
            place(&mut worlds, world, &start)?;
        }
        let rollout = Rollout { nstep: timing.steps, ..Rollout::default() };
        let held = lanesim::rows::Values::F64(timing.control);
        let controls = Controls::Strided { values: held, world: 0, step: 0 };
        let rollout = if timing.control.is_empty() { rollout } else { Rollout { controls, ..rollout } };
        let start = Instant::now();
        worlds.rollout(&rollout)?;
        let seconds = start.elapsed().as_secs_f64();
        runs += 1;
        // The first run makes the machine code.
        if runs > 1 {
            best = best.min(seconds);
        }
        if seconds > 4.0 && runs > 1 {
            break;
        }
    }
    Ok((worlds.lost() < n).then_some(best / (timing.steps * n) as f64))
}
