//! The runs of a scenario: every setting, with every engine.

use lanesim::{Error, Precision};
use serde_json::{Value, json};

use super::engine::{Job, Outcome, Setting, Timing, Trajectory};
use super::error::error;
use super::mujoco::MuJoCo;
use super::ours;
use super::reference::References;
use super::ruler::{Ruler, Sample};
use super::scenario::{Scenario, Start};

/// Simulated time of a timed run, s, and its least number of steps.
const SPAN: (f64, usize) = (0.1, 20);
/// Worlds of the short run's wild batches.
const FEW_WORLDS: usize = 16;

/// Integrators that MuJoCo has.
const MUJOCOS: [&str; 5] = ["Euler", "implicitfast", "implicit", "discrete", "RK4"];
/// Solvers, first the one that is always tried.
const SOLVERS: [&str; 3] = ["Newton", "CG", "PGS"];

/// What is asked for.
pub struct Campaign {
    /// The short one.
    pub quick: bool,
    /// Integrators of ours.
    pub integrators: Vec<String>,
    /// Precisions of ours.
    pub precisions: Vec<Precision>,
    /// Time steps instead of the scenarios', s.
    pub timesteps: Option<Vec<f64>>,
    /// Least time of a timed run, s.
    pub seconds: f64,
    /// References.
    pub references: References,
}

/// What came of a setting.
#[derive(Clone, Debug)]
pub struct Row {
    /// Short name of the scenario.
    pub scenario: &'static str,
    /// `lanesim f64`, `lanesim f32` or `MuJoCo`.
    pub engine: String,
    /// How it stepped.
    pub setting: Setting,
    /// The scenario's error; none if a world was lost.
    pub error: Option<f64>,
    /// What was measured beside it.
    pub also: Vec<(&'static str, Option<f64>)>,
    /// Wall time of a step of a world on a core, s.
    pub seconds_per_step: Option<f64>,
    /// Worlds lost.
    pub lost: usize,
    /// Why it was not run.
    pub refused: Option<String>,
}

impl Row {
    /// Wall seconds per simulated second.
    pub fn work(&self) -> Option<f64> {
        Some(self.seconds_per_step? / self.setting.timestep)
    }

    /// As a record.
    pub fn json(&self) -> Value {
        let also: serde_json::Map<_, _> = self.also.iter().map(|(name, x)| ((*name).to_owned(), json!(x))).collect();
        json!({
            "scenario": self.scenario,
            "engine": self.engine,
            "integrator": self.setting.integrator,
            "cone": self.setting.cone,
            "solver": self.setting.solver,
            "timestep": self.setting.timestep,
            "iterations": self.setting.iterations,
            "error": self.error,
            "also": also,
            "us_step": self.seconds_per_step.map(|s| 1e6 * s),
            "work": self.work(),
            "lost": self.lost,
            "refused": self.refused,
        })
    }
}

/// An engine of a campaign.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Engine {
    /// This one.
    Ours(Precision),
    /// The reference of the field.
    MuJoCo,
}

impl Engine {
    /// Its name in tables and records.
    pub fn name(self) -> &'static str {
        match self {
            Engine::Ours(Precision::F64) => "lanesim f64",
            Engine::Ours(Precision::F32) => "lanesim f32",
            Engine::MuJoCo => "MuJoCo",
        }
    }

    /// Whether it can step so.
    pub fn has(self, setting: &Setting) -> bool {
        self != Engine::MuJoCo || MUJOCOS.contains(&setting.integrator.as_str())
    }
}

/// How the runs of a scenario start and are driven, by contact cone.
struct Truth {
    cone: Option<String>,
    starts: Vec<Sample>,
    controls: Vec<Vec<Vec<f64>>>,
    reference: Option<Vec<Trajectory>>,
    timed: (Sample, Vec<f64>),
}

impl Campaign {
    /// The engines, in the order in which they run.
    pub fn engines(&self, mujoco: bool) -> Vec<Engine> {
        let ours = self.precisions.iter().map(|precision| Engine::Ours(*precision));
        ours.chain(mujoco.then_some(Engine::MuJoCo)).collect()
    }

    /// Settings of a scenario; not every engine [has](Engine::has) all of them.
    pub fn settings(&self, scenario: &Scenario) -> Vec<Setting> {
        let timesteps = self.timesteps.clone().unwrap_or_else(|| scenario.timesteps(self.quick));
        let cones: Vec<Option<String>> = match scenario.cones {
            [] => vec![None],
            cones => cones.iter().map(|cone| Some((*cone).to_owned())).collect(),
        };
        let mut all = Vec::new();
        let mut add = |integrator: &str, cone: &Option<String>, solver: &str, timestep, iterations| {
            let (integrator, cone, solver) = (integrator.to_owned(), cone.clone(), solver.to_owned());
            all.push(Setting { integrator, cone, solver, timestep, iterations });
        };
        for solver in SOLVERS {
            scenario.iterations.iter().for_each(|n| add("Euler", &cones[0], solver, timesteps[0], Some(*n)));
        }
        let tried = |name: &&String| scenario.integrators.is_empty() || scenario.integrators.contains(&name.as_str());
        let integrators = self.integrators.iter().filter(tried).filter(|_| scenario.iterations.is_empty());
        for (cone, integrator) in cones.iter().flat_map(|cone| integrators.clone().map(move |name| (cone, name))) {
            let others = scenario.solvers && integrator == "implicitfast" && !self.quick;
            for solver in SOLVERS.into_iter().take(if others { SOLVERS.len() } else { 1 }) {
                timesteps.iter().for_each(|dt| add(integrator, cone, solver, *dt, None));
            }
        }
        all
    }

    /// All runs of a scenario; `tell` hears of each that is done.
    pub fn run(&self, scenario: &Scenario, mujoco: &mut Option<MuJoCo>, tell: &dyn Fn()) -> Result<Vec<Row>, Error> {
        let text = scenario.model();
        let model = ours::model(&text, &[])?;
        let (ruler, nu) = (Ruler::new(&model), model.tables().sizes.nu);
        let mut truths: Vec<Truth> = Vec::new();
        let mut rows = Vec::new();
        let engines = self.engines(mujoco.is_some());
        // Engines by turns, so that they share what else the machine does.
        for setting in self.settings(scenario) {
            if !truths.iter().any(|truth| truth.cone == setting.cone) {
                truths.push(self.truth(scenario, &model, nu, setting.cone.as_deref())?);
            }
            let truth = truths.iter().find(|truth| truth.cone == setting.cone);
            let Some(truth) = truth else { continue };
            for engine in engines.iter().filter(|engine| engine.has(&setting)) {
                let job = self.job(scenario, &text, &setting, truth);
                let outcome = match (engine, mujoco.as_mut()) {
                    (Engine::Ours(precision), _) => ours::run(&job, *precision, &[]).map_err(|e| e.to_string()),
                    (Engine::MuJoCo, Some(mujoco)) => mujoco.run(&job),
                    (Engine::MuJoCo, None) => continue,
                };
                rows.push(row(scenario, *engine, &setting, outcome, (&ruler, truth)));
                tell();
            }
        }
        Ok(rows)
    }

    fn truth(
        &self,
        scenario: &Scenario,
        model: &lanesim::Model,
        nu: usize,
        cone: Option<&str>,
    ) -> Result<Truth, Error> {
        let intervals = (scenario.seconds / scenario.hold).round() as usize;
        let keys = starts(model, scenario, self.quick);
        let driven = |starts: &[Sample], intervals: usize| match scenario.control {
            None => Vec::new(),
            Some(_) => {
                let world = |(w, start): (usize, &Sample)| scenario.controls(nu, w, start.time, intervals);
                starts.iter().enumerate().map(world).collect()
            }
        };
        let controls = driven(&keys, intervals);
        let compares = [scenario.error].iter().chain(scenario.also).any(|measure| measure.needs_reference());
        let wanted = compares || scenario.timed_at > 0.0;
        let found = if wanted { Some(self.references.get(scenario, cone, &keys, &controls)?) } else { None };
        let control_at = |time: f64| scenario.controls(nu, 0, time, 1).pop().unwrap_or_default();
        let at = |run: &Trajectory| run.samples.iter().find(|s| s.time >= scenario.timed_at - 1e-9).cloned();
        let timed = found.as_ref().and_then(|runs| at(&runs[0])).unwrap_or_else(|| keys[0].clone());
        let timed = (timed.clone(), control_at(timed.time));
        let cone = cone.map(str::to_owned);
        if let Start::States(from) = scenario.start {
            let samples = found.into_iter().flatten().flat_map(|run| run.samples);
            let starts: Vec<_> = samples.filter(|s| s.time >= from).collect();
            let setting = &self.settings(scenario)[0];
            let reference = Some(ours::solved(&scenario.model(), setting, &starts)?);
            return Ok(Truth { cone, starts, controls: Vec::new(), reference, timed });
        }
        let Start::Windows(_) = scenario.start else {
            return Ok(Truth { cone, starts: keys, controls, reference: found, timed });
        };
        let samples: Vec<_> = found.into_iter().flatten().flat_map(|run| run.samples).collect();
        let starts = samples[..samples.len() - 1].to_vec();
        let ends = samples.windows(2).map(|pair| Trajectory { samples: pair.to_vec(), lost: false }).collect();
        let controls = driven(&starts, (scenario.sample / scenario.hold).round() as usize);
        Ok(Truth { cone, starts, controls, reference: Some(ends), timed })
    }

    fn job<'a>(&self, scenario: &Scenario, xml: &'a str, setting: &'a Setting, truth: &'a Truth) -> Job<'a> {
        let (seconds, hold) = match scenario.start {
            Start::Windows(span) => (span, scenario.hold),
            Start::States(_) => (setting.timestep, setting.timestep),
            _ => (scenario.seconds, scenario.hold),
        };
        let count = |time: f64, unit: f64| (time / unit).round() as usize;
        let timing = Timing {
            start: &truth.timed.0,
            control: &truth.timed.1,
            steps: count(SPAN.0, setting.timestep).max(SPAN.1),
            seconds: self.seconds,
            batch: scenario.batch,
        };
        Job {
            xml,
            setting,
            starts: &truth.starts,
            controls: &truth.controls,
            steps: count(hold, setting.timestep),
            intervals: count(seconds, hold),
            every: count(scenario.sample.min(seconds), hold),
            timing,
        }
    }
}

fn starts(model: &lanesim::Model, scenario: &Scenario, quick: bool) -> Vec<Sample> {
    let rest = Ruler::new(model).rest();
    if let Start::Wild(worlds, deviation) = scenario.start {
        let dofs = rest.qvel.len();
        let speeds = |world| (0..dofs).map(|dof| Scenario::wild_velocity(world, dof, deviation)).collect();
        let worlds = if quick { FEW_WORLDS.min(worlds) } else { worlds };
        return (0..worlds).map(|world| Sample { qvel: speeds(world), ..rest.clone() }).collect();
    }
    let key = |key: &lanesim::model::Key| Sample { time: 0.0, qpos: key.qpos.clone(), qvel: key.qvel.clone() };
    match model.keys() {
        [] => vec![rest],
        keys => keys.iter().map(key).collect(),
    }
}

fn row(
    scenario: &Scenario,
    engine: Engine,
    setting: &Setting,
    outcome: Result<Outcome, String>,
    (ruler, truth): (&Ruler, &Truth),
) -> Row {
    let (outcome, refused) = match outcome {
        Ok(outcome) => (outcome, None),
        Err(why) => (Outcome::default(), Some(why)),
    };
    let of = |measure| error(measure, ruler, &outcome.trajectories, truth.reference.as_deref());
    let lost = outcome.trajectories.iter().filter(|run| run.lost).count();
    Row {
        scenario: scenario.id,
        engine: engine.name().to_owned(),
        setting: setting.clone(),
        error: of(scenario.error),
        also: scenario.also.iter().map(|measure| (measure.name(), of(*measure))).collect(),
        // A run that lost worlds is cheap, and worth nothing.
        seconds_per_step: outcome.seconds_per_step.filter(|_| lost == 0 || scenario.error.counts_losses()),
        lost,
        refused,
    }
}
