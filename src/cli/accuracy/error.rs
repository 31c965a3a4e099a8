//! Errors of trajectories, by the ruler.

use super::curve::median;
use super::engine::Trajectory;
use super::ruler::{Ruler, Sample};
use super::scenario::Measure;

/// The error of runs by a measure, the worst of all worlds; `None` where a world was lost, unless losses are what counts.
pub fn error(measure: Measure, ruler: &Ruler, runs: &[Trajectory], reference: Option<&[Trajectory]>) -> Option<f64> {
    if runs.is_empty() {
        return None;
    }
    match measure {
        Measure::Lost => return Some(runs.iter().filter(|run| run.lost).count() as f64 / runs.len() as f64),
        Measure::Through => return Some(runs.iter().filter(|run| through(run)).count() as f64 / runs.len() as f64),
        _ => {}
    }
    if runs.iter().any(|run| run.lost) {
        return None;
    }
    let truth = reference.filter(|reference| reference.len() == runs.len());
    match measure {
        Measure::Window => {
            let all = runs.iter().zip(truth?).map(|(run, truth)| Some(end(ruler, run, truth).rms()));
            median(all)
        }
        Measure::Solve => median(runs.iter().zip(truth?).map(|(run, truth)| unsolved(ruler, run, truth))),
        Measure::Far => {
            let home = &runs[0];
            let away = |run: &Trajectory| Some(far(ruler, home, run));
            largest(runs[1..].iter().map(away))
        }
        Measure::Path => largest(runs.iter().zip(truth?).map(|(run, truth)| path(ruler, run, truth))),
        Measure::End => {
            let one = |(run, truth)| Some(end(ruler, run, truth).all().fold(0.0, |most: f64, x| most.max(x.abs())));
            largest(runs.iter().zip(truth?).map(one))
        }
        _ => largest(runs.iter().map(|run| alone(measure, ruler, &run.samples))),
    }
}

fn largest(mut all: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    all.try_fold(0.0, |most: f64, x| x.map(|x| most.max(x)))
}

/// What a step leaves unsolved. The truth's samples are the start, the converged step, and the step without constraints.
fn unsolved(ruler: &Ruler, run: &Trajectory, truth: &Trajectory) -> Option<f64> {
    let [start, solved, free] = &truth.samples[..] else { return None };
    let between = |a: &Sample, b: &Sample| a.qvel.iter().zip(&b.qvel).map(|(a, b)| a - b).collect();
    let size = |change| ruler.kinetic(&Sample { qvel: change, ..start.clone() }).sqrt();
    let whole = size(between(solved, free));
    let left = size(between(run.samples.last()?, solved));
    (whole > 0.0).then_some(left / whole)
}

fn through(run: &Trajectory) -> bool {
    run.lost || run.samples.last().is_some_and(|s| s.qpos[0] > 0.0)
}

fn end(ruler: &Ruler, run: &Trajectory, truth: &Trajectory) -> super::ruler::Differences {
    match (run.samples.last(), truth.samples.last()) {
        (Some(a), Some(b)) => ruler.differences(a, b),
        _ => Default::default(),
    }
}

/// What ends elsewhere than at home, after the distance between the starts.
fn far(ruler: &Ruler, home: &Trajectory, run: &Trajectory) -> f64 {
    let start = ruler.differences(&run.samples[0], &home.samples[0]);
    let end = end(ruler, run, home);
    end.all().zip(start.all()).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()))
}

fn path(ruler: &Ruler, run: &Trajectory, truth: &Trajectory) -> Option<f64> {
    let (mut squares, mut count, mut turn) = (0.0, 0, 0.0_f64);
    for (a, b) in run.samples.iter().zip(&truth.samples) {
        let differences = ruler.differences(a, b);
        squares += differences.coordinates.iter().map(|x| x * x).sum::<f64>();
        count += differences.coordinates.len();
        let turns = differences.turns.chunks_exact(3);
        turn = turns.map(|t| t.iter().map(|x| x * x).sum::<f64>().sqrt()).fold(turn, f64::max);
    }
    Some(if count > 0 { (squares / count as f64).sqrt() } else { turn })
}

/// Measures that need no other run.
fn alone(measure: Measure, ruler: &Ruler, samples: &[Sample]) -> Option<f64> {
    let (first, last) = (samples.first()?, samples.last()?);
    let after = |time: f64| samples.iter().find(|s| s.time >= time - 1e-9);
    let largest = |f: &dyn Fn(&Sample) -> f64| samples.iter().map(f).fold(0.0, f64::max);
    Some(match measure {
        Measure::Energy(scale) => {
            let start = ruler.energy(first);
            largest(&|s| (ruler.energy(s) - start).abs()) / scale
        }
        Measure::Gain(scale) => {
            let rise = |(least, most): (f64, f64), s: &Sample| {
                let e = ruler.energy(s);
                (e.min(least), most.max(e - least))
            };
            samples.iter().fold((f64::INFINITY, 0.0), rise).1 / scale
        }
        Measure::Momentum(scale) => {
            let start = ruler.momentum(first);
            largest(&|s| ruler.momentum(s).distance(start)) / scale
        }
        Measure::Angular => {
            let start = ruler.angular(first);
            largest(&|s| ruler.angular(s).distance(start))
        }
        Measure::Gap => largest(&|s| ruler.distance(s, ["loop_a", "loop_b"]).unwrap_or(f64::NAN)),
        Measure::Creep(from) => {
            let start = after(from)?;
            let way: f64 = (0..2).map(|k| (last.qpos[k] - start.qpos[k]).powi(2)).sum();
            way.sqrt() / (last.time - start.time)
        }
        Measure::Acceleration(from, exact) => {
            let start = after(from)?;
            ((last.qvel[0] - start.qvel[0]) / (last.time - start.time) / exact - 1.0).abs()
        }
        Measure::Distance(exact) => {
            let way: f64 = (0..2).map(|k| (last.qpos[k] - first.qpos[k]).powi(2)).sum();
            (way.sqrt() / exact - 1.0).abs()
        }
        Measure::Speed(exact) => (last.qvel[0] / exact - 1.0).abs(),
        Measure::Flight(radius) => {
            let start = ruler.energy(first);
            let ground = ruler.energy(&Sample { qvel: vec![0.0; first.qvel.len()], ..first.clone() });
            let height = first.qpos[2] - radius;
            let scale = ground * height / first.qpos[2];
            let error = |s: &Sample| if s.qpos[2] > radius { (ruler.energy(s) - start).abs() / scale } else { 0.0 };
            largest(&error)
        }
        Measure::Rest => last.qvel.iter().fold(0.0, |most: f64, v| most.max(v.abs())),
        Measure::Drift(from) => {
            let start = after(from)?;
            ruler.differences(last, start).all().fold(0.0, |most: f64, x| most.max(x.abs()))
        }
        Measure::Sink(length) => (ruler.height_of_last(first) - ruler.height_of_last(last)).max(0.0) / length,
        _ => return None,
    })
}
