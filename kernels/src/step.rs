//! A step: the stages are evaluated, whoever wants to looks at them, and an integrator makes the next state of what they found.

use crate::diagnosis;
use crate::history;
use crate::integration::{Rk4, drift};
use crate::lane::LaneQuery;
use crate::model::{Instance, Model};
use crate::part::{Op, Part, Step};
use crate::passive;
use crate::pipeline::{Run, Solved, Stage, Stages, forward};
use crate::sleep;
use crate::state::{BlockStatus, State, Status};
use crate::workspace::Workspace;

/// One step: evaluate, then advance.
pub fn step<L: LaneQuery>(
    model: &Model<L::Real>,
    state: &mut State<L>,
    run: &mut Run<'_, L>,
    status: &mut BlockStatus,
    ws: &mut Workspace<L>,
) {
    let solved = evaluate(model, state, run, status, ws);
    advance(model, state, run, status, solved, ws);
}

/// The first part of a step: all stages at its state. What they leave can be read until the step advances.
pub fn evaluate<L: LaneQuery>(
    model: &Model<L::Real>,
    state: &mut State<L>,
    run: &mut Run<'_, L>,
    status: &mut BlockStatus,
    ws: &mut Workspace<L>,
) -> Solved {
    if let Some(clock) = &mut run.clock {
        clock.start();
    }
    run.stages = run.stages | Stages::STEP;
    if !model.sensor_rings.is_empty() && model.options.flags.sensor {
        // The histories take what they measure.
        (run.stages, run.keep) = (run.stages | Stages::up_to(Stage::Sensor), true);
    }
    if let Some(sleep) = &mut ws.sleep {
        sleep::disturb(model, state, run.applied, status.alive, sleep);
    }
    if ws.middle.is_none() {
        return forward(model, state, run, status, ws);
    }
    // A midpoint step is evaluated at its middle, when it advances: this is for whoever looks at what its state leads to.
    run.stages = run.stages.without(Stage::Integration);
    match run.keep {
        true => forward(model, state, run, status, ws),
        false => Solved { lanes: status.alive, unfinished: 0 },
    }
}

/// The second part: integrate, check, commit. `solved` is what the first part returned. A world whose next state would not be
/// finite, or huge, keeps its last state and is frozen.
pub fn advance<L: LaneQuery>(
    model: &Model<L::Real>,
    state: &mut State<L>,
    run: &mut Run<'_, L>,
    status: &mut BlockStatus,
    mut solved: Solved,
    ws: &mut Workspace<L>,
) {
    // What was done with the stages in between is not part of the step.
    if let Some(clock) = &mut run.clock {
        clock.start();
    }
    if let Some(mut middle) = ws.middle.take() {
        drift(model, state, &mut middle);
        let wanted = (run.stages, run.keep);
        (run.stages, run.keep) = (Stages::STEP, false);
        solved = forward(model, &mut middle, run, status, ws);
        (run.stages, run.keep) = wanted;
        ws.middle = Some(middle);
    }
    if let Workspace { sleep: Some(sleep), constraint, .. } = ws {
        sleep::settle(model, state, (run.applied, constraint), status.alive, sleep);
    }
    let now = history::clock(state);
    let good = if ws.rk4.is_some() {
        solved = evaluate_between(model, state, run, status, solved, ws);
        solved.lanes
    } else {
        let (model, mut good) = (Instance { model, varied: run.varied }, [0]);
        let step = &mut Step { model, state, applied: run.applied, ws, stages: run.stages, clock: None };
        run.executor.run(Part::new(Op::Integrate), solved.lanes, &mut good, step);
        good[0]
    };
    if let Some(sleep) = &ws.sleep {
        sleep::hold(model, state, sleep);
    }
    passive::yield_springs(model, &ws.tendons, L::mask_of(good), state);
    history::record(model, state, (now, good), &ws.sensors);
    if let Some(kick) = &ws.kick {
        status.record(Status::GUARDED, kick.acted() & good);
    }
    // How a solver ends that works with numbers beyond all bounds says nothing, and may depend on other worlds' contacts.
    status.record(Status::NOT_CONVERGED, solved.unfinished & good);
    let lost = status.alive & !good;
    if lost != 0 {
        diagnosis::freeze(ws, lost, status);
    }
    if let Some(clock) = &mut run.clock {
        clock.end(Stage::Integration);
    }
}

/// The evaluations of a Runge-Kutta step after the first, and the commit of the next state that follows from all. Returns what the
/// solvers made of the worlds: those that have taken the next state, and those in which any reached its limit.
///
/// A world that is lost on the way stays where it was lost: further evaluations repeat the one that lost it, so that the workspace
/// still holds what happened.
fn evaluate_between<L: LaneQuery>(
    model: &Model<L::Real>,
    state: &mut State<L>,
    run: &mut Run<'_, L>,
    status: &mut BlockStatus,
    mut solved: Solved,
    ws: &mut Workspace<L>,
) -> Solved {
    // Nobody reads what they leave.
    let wanted = (run.stages, run.residual, run.keep);
    (run.stages, run.residual, run.keep) = (Stages::STEP, false, false);
    if let Some(rk4) = &mut ws.rk4 {
        rk4.start(state);
    }
    for part in 0..Rk4::<L>::PARTS {
        let (instance, mut good) = (Instance { model, varied: run.varied }, [0]);
        let step = &mut Step { model: instance, state, applied: run.applied, ws, stages: run.stages, clock: None };
        run.executor.run(Part::of(Op::Combine, part as u32), solved.lanes, &mut good, step);
        solved.lanes = good[0];
        if part + 1 < Rk4::<L>::PARTS
            && let Some(mut rk4) = ws.rk4.take()
        {
            let next = forward(model, &mut rk4.stage, run, status, ws);
            ws.rk4 = Some(rk4);
            solved.unfinished |= next.unfinished;
            solved.lanes &= next.lanes;
        }
    }
    (run.stages, run.residual, run.keep) = wanted;
    solved
}
