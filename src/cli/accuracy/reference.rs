//! References: the same model in double precision, by RK4 with a time step so small that its error is nothing beside those that
//! are judged, solved to 1e-12. They are kept in files, since they take longer than everything else.

use std::path::{Path, PathBuf};

use lanesim::{Error, Precision};
use serde_json::{Value, json};

use super::engine::{Job, Setting, Timing, Trajectory, to_json};
use super::ours;
use super::ruler::Sample;
use super::scenario::Scenario;

/// Counts up when references made before are no longer right.
const VERSION: u32 = 1;

/// Where references are kept, and made.
pub struct References {
    folder: PathBuf,
}

impl References {
    /// In this folder, or else where the system keeps such files.
    pub fn new(folder: Option<PathBuf>) -> References {
        let usual = || directories::ProjectDirs::from("", "", "lanesim").map(|dirs| dirs.cache_dir().join("accuracy"));
        References { folder: folder.or_else(usual).unwrap_or_else(|| std::env::temp_dir().join("lanesim-accuracy")) }
    }

    /// The reference of a scenario, with this contact cone.
    pub fn get(
        &self,
        scenario: &Scenario,
        cone: Option<&str>,
        starts: &[Sample],
        controls: &[Vec<Vec<f64>>],
    ) -> Result<Vec<Trajectory>, Error> {
        let key = format!("{VERSION} {cone:?} {starts:?} {controls:?} {} {}", shape(scenario), scenario.xml);
        let file = self.folder.join(format!("{}-{:08x}.json", scenario.id, crc32fast::hash(key.as_bytes())));
        if let Some(known) = read(&file) {
            return Ok(known);
        }
        let made = make(scenario, cone, starts, controls)?;
        // What cannot be kept is made again.
        let _ = write(&file, &made);
        Ok(made)
    }
}

fn shape(s: &Scenario) -> String {
    format!("{} {} {} {:?} {:?}", s.seconds, s.sample, s.hold, s.reference, s.start)
}

fn make(
    scenario: &Scenario,
    cone: Option<&str>,
    starts: &[Sample],
    controls: &[Vec<Vec<f64>>],
) -> Result<Vec<Trajectory>, Error> {
    let (integrator, timestep) = scenario.reference;
    let setting = Setting {
        integrator: integrator.into(),
        cone: cone.map(str::to_owned),
        solver: "Newton".into(),
        timestep,
        iterations: None,
    };
    let count = |time: f64, unit: f64| (time / unit).round() as usize;
    let job = Job {
        xml: scenario.xml,
        setting: &setting,
        starts,
        controls,
        steps: count(scenario.hold, timestep),
        intervals: count(scenario.seconds, scenario.hold),
        every: count(scenario.sample, scenario.hold),
        timing: Timing { start: &starts[0], control: &[], steps: 0, seconds: 0.0, batch: 1 },
    };
    let accurate = [("tolerance", "1e-12"), ("iterations", "200")].map(|(name, value)| (name.into(), value.into()));
    Ok(ours::run(&job, Precision::F64, &accurate)?.trajectories)
}

fn read(file: &Path) -> Option<Vec<Trajectory>> {
    let value: Value = serde_json::from_reader(std::fs::File::open(file).ok()?).ok()?;
    let numbers = |value: &Value| value.as_array().into_iter().flatten().filter_map(Value::as_f64).collect();
    let sample = |value: &Value| Sample {
        time: value["time"].as_f64().unwrap_or(0.0),
        qpos: numbers(&value["qpos"]),
        qvel: numbers(&value["qvel"]),
    };
    let trajectory = |value: &Value| Trajectory {
        samples: value["samples"].as_array().into_iter().flatten().map(sample).collect(),
        lost: value["lost"] == true,
    };
    Some(value.as_array()?.iter().map(trajectory).collect())
}

fn write(file: &Path, trajectories: &[Trajectory]) -> std::io::Result<()> {
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder)?;
    }
    let sample = |sample: &Sample| {
        let mut value = to_json(sample);
        value["time"] = json!(sample.time);
        value
    };
    let trajectory =
        |t: &Trajectory| json!({ "lost": t.lost, "samples": t.samples.iter().map(sample).collect::<Vec<_>>() });
    let all: Value = trajectories.iter().map(trajectory).collect();
    let scratch = file.with_extension(format!("{}.part", std::process::id()));
    std::fs::write(&scratch, all.to_string())?;
    std::fs::rename(scratch, file)
}
