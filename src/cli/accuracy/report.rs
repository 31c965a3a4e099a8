//! What is printed: *ours | MuJoCo | ratio at equal error*.

use super::campaign::Row;
use super::curve::{Point, hull, median, work};
use super::scenario::{Measure, Scenario};

/// Time steps of MuJoCo's Euler step at whose errors work is compared, s; where that is lost, of its best step.
const ANCHORS: [f64; 3] = [0.005, 0.002, 0.0005];
/// What solvers leave unsolved where their work is compared.
const UNSOLVED: [f64; 3] = [1e-2, 1e-3, 1e-6];
const MUJOCO: &str = "MuJoCo";
const OURS: [&str; 2] = ["lanesim f64", "lanesim f32"];

/// A scenario's line.
#[derive(Clone, Debug, Default)]
pub struct Line {
    /// Short name.
    pub id: &'static str,
    /// What happens, and what is measured.
    pub what: String,
    /// Errors at which work is compared.
    pub errors: [Option<f64>; 3],
    /// MuJoCo's work there.
    pub mujoco: [Option<f64>; 3],
    /// Our work there, by precision.
    pub ours: [[Option<f64>; 3]; 2],
    /// The smallest errors: MuJoCo, ours by precision.
    pub least: [Option<f64>; 3],
    /// Runs that lost worlds, and all: MuJoCo, ours by precision.
    pub lost: [(usize, usize); 3],
}

/// The points of an engine.
pub fn points(rows: &[Row], engine: &str) -> Vec<Point> {
    let all = rows.iter().filter(|row| row.engine == engine);
    all.filter_map(|row| Some(Point { error: row.error.filter(|e| e.is_finite())?, work: row.work()? })).collect()
}

impl Line {
    /// From the rows of a scenario.
    pub fn new(scenario: &Scenario, rows: &[Row]) -> Line {
        let compared = !matches!(scenario.error, Measure::Lost | Measure::Through);
        let cone = scenario.cones.first().map(|cone| (*cone).to_owned());
        let anchor = |dt: f64| {
            let here = rows.iter().filter(|row| {
                let s = &row.setting;
                row.engine == MUJOCO && s.cone == cone && s.solver == "Newton" && s.timestep == dt && compared
            });
            let euler = here.clone().find(|row| row.setting.integrator == "Euler").and_then(|row| row.error);
            euler.or_else(|| here.filter_map(|row| row.error).min_by(f64::total_cmp))
        };
        let engines = [MUJOCO, OURS[0], OURS[1]];
        let hulls = engines.map(|engine| hull(&points(rows, engine)));
        let errors = if scenario.iterations.is_empty() { ANCHORS.map(anchor) } else { UNSOLVED.map(Some) };
        let at = |k: usize| errors.map(|e| work(&hulls[k], e?));
        let lost = |engine: &str| {
            let runs = rows.iter().filter(|row| row.engine == engine && row.refused.is_none());
            (runs.clone().filter(|row| row.lost > 0).count(), runs.count())
        };
        Line {
            id: scenario.id,
            what: format!("{} ({})", scenario.title, scenario.error.name()),
            errors,
            mujoco: at(0),
            ours: [at(1), at(2)],
            least: [0, 1, 2].map(|k| hulls[k].last().map(|point| point.error)),
            lost: engines.map(lost),
        }
    }

    /// MuJoCo's work over ours at equal error, by precision.
    pub fn ratios(&self, precision: usize) -> [Option<f64>; 3] {
        [0, 1, 2].map(|k| Some(self.mujoco[k]? / self.ours[precision][k]?))
    }
}

fn shown(values: &[Option<f64>], form: &dyn Fn(f64) -> String) -> String {
    values.iter().map(|x| x.map_or("-".into(), form)).collect::<Vec<_>>().join(" / ")
}

/// Everything as a table in Markdown, with what it says under it.
pub fn markdown(lines: &[Line], mujoco: Option<&str>) -> String {
    let small = |x: f64| format!("{x:.1e}");
    let ratio = |x: f64| if x >= 10.0 { format!("{x:.0}") } else { format!("{x:.1}") };
    let head = "| | scenario (error) | errors compared | MuJoCo, least work at these | \
                lanesim f64 | ratio f64 | ratio f32 | least error: MuJoCo / f64 / f32 | lost runs: MuJoCo, f64, f32 |\n\
                |---|---|---|---|---|---|---|---|---|\n";
    let mut text = head.to_owned();
    for line in lines {
        let lost = line.lost.map(|(lost, all)| format!("{lost} of {all}")).join(", ");
        text += &format!(
            "| {} | {} | {} | {} | {} | {} | {} | {} | {lost} |\n",
            line.id,
            line.what,
            shown(&line.errors, &small),
            shown(&line.mujoco, &small),
            shown(&line.ours[0], &small),
            shown(&line.ratios(0), &ratio),
            shown(&line.ratios(1), &ratio),
            shown(&line.least, &small),
        );
    }
    text += "\nErrors compared are those of MuJoCo's Euler step at 5, 2 and 0.5 ms, or of its best step where that loses the \
             world; of solvers 1e-2, 1e-3 and 1e-6. Work is wall seconds per simulated second, world and core, the least over all settings of an engine that reach the \
             error; ratios are MuJoCo's work over ours. A dash: nothing reaches the error, or a world was lost.\n";
    for (k, name) in ["f64", "f32"].iter().enumerate() {
        let middles = lines.iter().map(|line| median(line.ratios(k)));
        let least = lines.iter().flat_map(|line| line.ratios(k)).flatten().fold(f64::INFINITY, f64::min);
        if let Some(middle) = median(middles.clone()) {
            let n = middles.flatten().count();
            text += &format!("\nMedian ratio {name}: {middle:.1} over {n} scenarios; least {least:.2}.\n");
        }
    }
    text += &mujoco.map_or("\nMuJoCo was not there.\n".into(), |version| format!("\nMuJoCo {version}, same run.\n"));
    text
}
