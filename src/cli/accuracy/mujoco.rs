//! Jobs done by MuJoCo, in a Python process of its own.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use serde_json::{Value, json};

use super::engine::{Job, Outcome, Trajectory, to_json};
use super::ruler::Sample;

const SCRIPT: &str = include_str!("mujoco.py");

/// A process that steps one world at a time.
pub struct MuJoCo {
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
    /// Its version.
    pub version: String,
}

impl MuJoCo {
    /// Starts it; an error says why there is none.
    pub fn start(python: &str) -> Result<MuJoCo, String> {
        let mut command = Command::new(python);
        command.args(["-c", SCRIPT]).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().map_err(|e| format!("cannot run {python}: {e}"))?;
        let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(format!("cannot talk to {python}"));
        };
        let mut mujoco = MuJoCo { child, input, output: BufReader::new(output), version: String::new() };
        let greeting = mujoco.answer().map_err(|_| format!("{python} has no package mujoco"))?;
        mujoco.version = greeting["version"].as_str().unwrap_or_default().to_owned();
        Ok(mujoco)
    }

    fn answer(&mut self) -> Result<Value, String> {
        let mut line = String::new();
        self.output.read_line(&mut line).map_err(|e| e.to_string())?;
        serde_json::from_str(&line).map_err(|_| "the process of MuJoCo ended".to_owned())
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
        writeln!(self.input, "{request}").and_then(|()| self.input.flush()).map_err(|e| e.to_string())?;
        let answer = self.answer()?;
        if let Some(error) = answer["error"].as_str() {
            return Err(error.to_owned());
        }
        let empty = Vec::new();
        let list = answer["trajectories"].as_array().unwrap_or(&empty);
        let trajectories = list.iter().zip(job.starts).map(|(value, start)| trajectory(value, start, job)).collect();
        Ok(Outcome { trajectories, seconds_per_step: answer["seconds_per_step"].as_f64() })
    }
}

impl Drop for MuJoCo {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().into_iter().flatten().filter_map(Value::as_f64).collect()
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
