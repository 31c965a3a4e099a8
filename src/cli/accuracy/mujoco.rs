//! Jobs done by MuJoCo, in a Python process of its own.

use serde_json::{Value, json};

use super::super::mujoco::{Process, numbers};
use super::engine::{Job, Outcome, Trajectory, to_json};
use super::ruler::Sample;

const SCRIPT: &str = include_str!("mujoco.py");

/// A process that steps one world at a time.
pub struct MuJoCo {
    process: Process,
    /// Its version.
    pub version: String,
}

impl MuJoCo {
    /// Starts it; an error says why there is none.
    pub fn start(python: &str) -> Result<MuJoCo, String> {
        let process = Process::start(python, SCRIPT)?;
        Ok(MuJoCo { version: process.version.clone(), process })
    }

    /// Does the job; an error in words if it cannot.
    pub fn run(&mut self, job: &Job<'_>) -> Result<Outcome, String> {
        let request = json!({
            "xml": job.xml,
            "options": job.setting.options(),
            "starts": job.starts.iter().map(to_json).collect::<Vec<_>>(),
            "controls": job.controls,
            "steps": job.steps,
            "intervals": job.intervals,
            "every": job.every,
            "timing": {
                "start": to_json(job.timing.start),
                "control": job.timing.control,
                "steps": job.timing.steps,
                "seconds": job.timing.seconds,
            },
        });
        self.process.send(&request)?;
        let answer = self.process.receive()?;
        let empty = Vec::new();
        let list = answer["trajectories"].as_array().unwrap_or(&empty);
        let trajectories = list.iter().zip(job.starts).map(|(value, start)| trajectory(value, start, job)).collect();
        Ok(Outcome { trajectories, seconds_per_step: answer["seconds_per_step"].as_f64() })
    }
}

fn trajectory(value: &Value, start: &Sample, job: &Job<'_>) -> Trajectory {
    let passed = |k: usize| job.setting.timestep * (job.steps * job.every * k) as f64;
    let states = value["states"].as_array().into_iter().flatten().enumerate();
    let samples = states.map(|(k, state)| {
        let all = numbers(state);
        let (qpos, qvel) = all.split_at(start.qpos.len().min(all.len()));
        Sample { time: start.time + passed(k), qpos: qpos.to_vec(), qvel: qvel.to_vec() }
    });
    Trajectory { samples: samples.collect(), lost: value["lost"].as_bool().unwrap_or(true) }
}
