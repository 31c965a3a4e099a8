//! How a benchmark is made.
//!
//! Worlds start from typical states: a few are warmed up under uniform control noise, then copied over all worlds with a
//! little noise on the velocity. The run is made twice from the same start, first with statistics and clocks, then bare
//! and timed; both must end in the same bits. Cycles are of a clock that is measured around both. Then single steps from states of the run are compared with the scalar f64
//! path, solved to 1e-12: no speed without its error.

use std::sync::atomic::AtomicU64;
use std::time::Instant;

use lanesim::noise;
use lanesim::rollout::Statistics;
use lanesim::{Backend, Controls, Field, Model, Options, Precision, Rollout, Running, Worlds};
use lanesim_kernels::pipeline::Stage;
use lanesim_kernels::state::Status;

use super::failure::Failure;
use super::{clock, engine};

/// Worlds that are warmed up.
const BASES: usize = 32;
/// Simulated time of the warm-up, s.
const WARM_UP_SECONDS: f64 = 2.0;
/// Bounds on its number of steps.
const WARM_UP_STEPS: (usize, usize) = (500, 2000);
/// Largest velocity at the start of the warm-up.
const START_VELOCITY: f64 = 0.05;
/// Standard deviation of what is added to the copies' velocities.
const COPY_VELOCITY: f64 = 0.01;
/// States from which single steps are compared: half from the start of the run, half from its end.
const SAMPLES: usize = 256;

/// A benchmark to be made.
pub struct Plan<'a> {
    /// The model, as it is benchmarked.
    pub model: &'a Model,
    /// The same with the solver set to 1e-12.
    pub accurate: &'a Model,
    /// How it is stepped.
    pub options: Options,
    /// Number of worlds.
    pub nworld: usize,
    /// Steps of each.
    pub nstep: usize,
    /// Keyframe from which the warm-up starts.
    pub key: Option<usize>,
    /// Steps of the warm-up, if they are not to follow from the time step.
    pub warm_up: Option<usize>,
    /// Share of the control ranges that noise takes.
    pub noise: f64,
    /// Seed of everything random.
    pub seed: u64,
}

/// What a benchmark found.
pub struct Measurement {
    /// Wall time of the bare run.
    pub seconds: f64,
    /// Cycles per second of a core before, between and after the runs, on average.
    pub hertz: f64,
    /// Worlds frozen at its end.
    pub lost: usize,
    /// Hash of its final state.
    pub hash: u64,
    /// Counts of the observed run.
    pub statistics: Statistics,
    /// Time per stage of the observed run, summed over threads.
    pub stage_seconds: Vec<(&'static str, f64)>,
    /// Vector operations per block of the stages that are machine code from end to end.
    pub stage_operations: Vec<(&'static str, usize)>,
    /// Relative errors of single steps, ascending.
    pub errors: Vec<f64>,
    /// Worker threads.
    pub threads: usize,
    /// Worlds per block, and the lane type.
    pub lanes: (usize, &'static str),
    /// What stepped them.
    pub running: Running,
}

/// A state from which a world can be stepped.
struct State {
    time: f64,
    qpos: Vec<f64>,
    qvel: Vec<f64>,
    warmstart: Vec<f64>,
}

impl State {
    fn of(worlds: &Worlds, world: usize) -> Result<State, Failure> {
        Ok(State {
            time: worlds.get(Field::Time, world)?[0],
            qpos: worlds.get(Field::Qpos, world)?,
            qvel: worlds.get(Field::Qvel, world)?,
            warmstart: worlds.get(Field::QaccWarmstart, world)?,
        })
    }

    fn set(&self, worlds: &mut Worlds, world: usize) -> Result<(), Failure> {
        worlds.reset(world, None)?;
        worlds.set(Field::Time, world, &[self.time])?;
        worlds.set(Field::Qpos, world, &self.qpos)?;
        worlds.set(Field::Qvel, world, &self.qvel)?;
        Ok(worlds.set(Field::QaccWarmstart, world, &self.warmstart)?)
    }
}

/// Vector operations of the stages that are one piece of machine code. The smooth stages count as the last of them.
fn stage_operations(worlds: &Worlds) -> Vec<(&'static str, usize)> {
    let stages = [("smooth", "acceleration"), ("euler", "integration")];
    let code = worlds.code();
    let operations = |part: &str| code.iter().find(|code| code.name == part)?.statistics.as_ref();
    let of = |(part, stage)| operations(part).map(|s| (stage, s.total_operations()));
    stages.into_iter().filter_map(of).collect()
}

impl Plan<'_> {
    /// World steps of everything that reports progress.
    pub fn total(&self) -> u64 {
        2 * self.nworld as u64 * self.nstep as u64
    }

    /// Makes the benchmark.
    pub fn measure(&self, progress: &AtomicU64) -> Result<Measurement, Failure> {
        let mut worlds = Worlds::new(self.model, self.nworld, &self.options)?;
        engine::notice(&worlds);
        let bases = self.warm_up()?;
        let run = Rollout {
            nstep: self.nstep,
            controls: Controls::Noise { seed: self.seed, scale: self.noise },
            progress: Some(progress),
            ..Rollout::default()
        };
        self.start(&mut worlds, &bases)?;
        let mut samples = sample(&worlds, SAMPLES / 2)?;
        let mut hertz = clock::hertz();
        let observed = worlds.rollout(&Rollout { statistics: true, clock: true, ..run })?;
        let observed_hash = worlds.state_hash();
        self.start(&mut worlds, &bases)?;
        hertz += clock::hertz();
        let start = Instant::now();
        worlds.rollout(&run)?;
        let seconds = start.elapsed().as_secs_f64();
        hertz += clock::hertz();
        let hash = worlds.state_hash();
        if hash != observed_hash {
            return Err(Failure::Input(format!(
                "two runs from the same start ended in different states ({observed_hash:016x} and {hash:016x}); \
                 please report this"
            )));
        }
        samples.extend(sample(&worlds, SAMPLES / 2)?);
        let stages = Stage::ALL.iter().zip(observed.clock.spent);
        Ok(Measurement {
            seconds,
            hertz: hertz / 3.0,
            lost: worlds.lost(),
            hash,
            statistics: observed.statistics,
            stage_seconds: stages.map(|((_, name), spent)| (*name, spent.as_secs_f64())).collect(),
            stage_operations: stage_operations(&worlds),
            errors: self.errors(&samples)?,
            threads: worlds.threads(),
            lanes: worlds.lanes(),
            running: worlds.running().clone(),
        })
    }

    /// States of worlds that have been under control noise for a while.
    fn warm_up(&self) -> Result<Vec<State>, Failure> {
        let n = BASES.min(self.nworld);
        let mut worlds = Worlds::new(self.model, n, &self.options)?;
        let nv = Field::Qvel.len(self.model);
        for world in 0..n {
            let velocity = |i| START_VELOCITY * (2.0 * noise::uniform(self.seed, world as u64, 0, i as u64) - 1.0);
            worlds.reset(world, self.key)?;
            let start = worlds.get(Field::Qvel, world)?;
            worlds.set(Field::Qvel, world, &(0..nv).map(|i| start[i] + velocity(i)).collect::<Vec<_>>())?;
        }
        let enough = (WARM_UP_SECONDS / self.model.tables().options.timestep).ceil() as usize;
        worlds.rollout(&Rollout {
            nstep: self.warm_up.unwrap_or_else(|| enough.clamp(WARM_UP_STEPS.0, WARM_UP_STEPS.1)),
            // Not the noise of the run itself.
            controls: Controls::Noise { seed: !self.seed, scale: self.noise },
            ..Rollout::default()
        })?;
        let bases = sample(&worlds, n)?;
        if bases.is_empty() {
            return Err(Failure::Input("every world was lost while warming up; try `lanesim check`".into()));
        }
        Ok(bases)
    }

    /// Puts every world into a copy of some base.
    fn start(&self, worlds: &mut Worlds, bases: &[State]) -> Result<(), Failure> {
        for world in 0..self.nworld {
            let base = &bases[world % bases.len()];
            let disturb =
                |(i, v): (usize, &f64)| v + COPY_VELOCITY * noise::normal(self.seed, world as u64, 0, i as u64);
            let qvel: Vec<f64> = base.qvel.iter().enumerate().map(disturb).collect();
            worlds.reset(world, None)?;
            worlds.set(Field::Time, world, &[base.time])?;
            worlds.set(Field::Qpos, world, &base.qpos)?;
            worlds.set(Field::Qvel, world, &qvel)?;
        }
        Ok(())
    }

    /// Relative errors of the next velocity after one step from each state, ascending.
    fn errors(&self, samples: &[State]) -> Result<Vec<f64>, Failure> {
        let exact = Options { precision: Precision::F64, backend: Backend::Scalar, ..self.options.clone() };
        let next = |model: &Model, options: &Options| -> Result<Vec<Option<Vec<f64>>>, Failure> {
            let mut worlds = Worlds::new(model, samples.len(), options)?;
            for (world, state) in samples.iter().enumerate() {
                state.set(&mut worlds, world)?;
            }
            worlds.rollout(&Rollout {
                nstep: 1,
                controls: Controls::Noise { seed: self.seed, scale: self.noise },
                ..Rollout::default()
            })?;
            (0..samples.len())
                .map(|world| {
                    let frozen = worlds.status(world)?.contains(Status::FROZEN);
                    Ok(if frozen { None } else { Some(worlds.get(Field::Qvel, world)?) })
                })
                .collect()
        };
        let pairs = next(self.model, &self.options)?.into_iter().zip(next(self.accurate, &exact)?);
        let mut errors: Vec<f64> = pairs.filter_map(|(ours, exact)| Some(relative_error(&ours?, &exact?))).collect();
        errors.sort_by(f64::total_cmp);
        Ok(errors)
    }
}

/// States of up to `count` worlds, evenly spread over the batch, that are not frozen.
fn sample(worlds: &Worlds, count: usize) -> Result<Vec<State>, Failure> {
    let n = worlds.nworld();
    let count = count.min(n);
    let mut states = Vec::with_capacity(count);
    for world in (0..count).map(|i| i * n / count) {
        if !worlds.status(world)?.contains(Status::FROZEN) {
            states.push(State::of(worlds, world)?);
        }
    }
    Ok(states)
}

/// |x - exact| / |exact|, or the absolute difference where `exact` is zero.
fn relative_error(x: &[f64], exact: &[f64]) -> f64 {
    let norm = |squares: f64| squares.sqrt();
    let difference = norm(x.iter().zip(exact).map(|(a, b)| (a - b) * (a - b)).sum());
    let scale = norm(exact.iter().map(|b| b * b).sum());
    if scale > 0.0 { difference / scale } else { difference }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_relative_where_they_can_be() {
        assert_eq!(relative_error(&[3.0, 4.0], &[3.0, 4.0]), 0.0);
        assert_eq!(relative_error(&[0.0, 10.0], &[0.0, 5.0]), 1.0);
        assert_eq!(relative_error(&[0.5], &[0.0]), 0.5);
        assert_eq!(relative_error(&[], &[]), 0.0);
    }
}
