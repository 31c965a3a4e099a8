//! MuJoCo in a Python process of its own, which answers a line of JSON with another.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use serde_json::Value;

/// A process that runs a script, which first says its version.
pub struct Process {
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
    /// MuJoCo's version.
    pub version: String,
}

impl Process {
    /// Starts it; an error says why there is none.
    pub fn start(python: &str, script: &str) -> Result<Process, String> {
        let mut command = Command::new(python);
        command.args(["-c", script]).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().map_err(|e| format!("cannot run {python}: {e}"))?;
        let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(format!("cannot talk to {python}"));
        };
        let mut process = Process { child, input, output: BufReader::new(output), version: String::new() };
        let greeting = process.read().map_err(|_| format!("{python} has no package mujoco"))?;
        process.version = greeting["version"].as_str().unwrap_or_default().to_owned();
        Ok(process)
    }

    /// Sends a job.
    pub fn send(&mut self, job: &Value) -> Result<(), String> {
        writeln!(self.input, "{job}").and_then(|()| self.input.flush()).map_err(|e| e.to_string())
    }

    /// Waits for the answer to the job that was sent; an error in words if it could not be done.
    pub fn receive(&mut self) -> Result<Value, String> {
        let answer = self.read()?;
        answer["error"].as_str().map_or(Ok(()), |error| Err(error.to_owned()))?;
        Ok(answer)
    }

    fn read(&mut self) -> Result<Value, String> {
        let mut line = String::new();
        self.output.read_line(&mut line).map_err(|e| e.to_string())?;
        serde_json::from_str(&line).map_err(|_| "the process of MuJoCo ended".to_owned())
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The numbers of a list.
pub fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().into_iter().flatten().filter_map(Value::as_f64).collect()
}
