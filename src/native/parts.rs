//! The parts of a step for which code is made: what each reads and writes, and recording it.

use lanesim_codegen::{Float, Program, Recorder, Recording};
use lanesim_kernels::acceleration::Acceleration;
use lanesim_kernels::actuation::Actuation;
use lanesim_kernels::collision::Colliders;
use lanesim_kernels::constraint::{self, Constraint};
use lanesim_kernels::derivative::Derivative;
use lanesim_kernels::inertia::Inertia;
use lanesim_kernels::integration::{self, Integration};
use lanesim_kernels::lane::Lane;
use lanesim_kernels::model::{Instance, Model, Quantities, Varied};
use lanesim_kernels::options;
use lanesim_kernels::passive::Passive;
use lanesim_kernels::pipeline::{self, Smooth};
use lanesim_kernels::position::Position;
use lanesim_kernels::stage::Stage;
use lanesim_kernels::state::{Applied, State};
use lanesim_kernels::velocity::Velocity;

use super::{PER_LINK, readers, solver};

/// Which of the smooth stages' code: without or with forces from outside, for steps alone or for whoever reads fields.
#[derive(Clone, Copy, Debug)]
pub struct SmoothKind {
    pub applied: bool,
    pub keep: bool,
}

/// Fields of the smooth stages that the code writes: all, or those that later parts of a step read.
pub fn smooth_fields<'a, L: Lane, T>(
    model: &Model<T>,
    keep: bool,
    stages: Smooth<'a, L>,
    f: &mut dyn FnMut(&'a mut [L]),
) {
    let Smooth { position, inertia, velocity, passive, actuation, acceleration, derivative, colliders } = stages;
    f(&mut colliders.qpos);
    f(colliders.origin.as_flattened_mut());
    f(&mut colliders.way);
    f(&mut colliders.blur);
    f(&mut colliders.travel);
    f(&mut colliders.due);
    if keep {
        position.for_each(&mut |field| f(field.data));
        inertia.for_each(&mut |field| f(field.data));
        velocity.for_each(&mut |field| f(field.data));
        passive.for_each(&mut |field| f(field.data));
        actuation.for_each(&mut |field| f(field.data));
        acceleration.for_each(&mut |field| f(field.data));
        derivative.for_each(&mut |field| f(field.data));
        return;
    }
    f(position.origin.as_flattened_mut());
    f(position.pos.as_flattened_mut());
    f(position.rot.as_flattened_mut());
    f(position.cdof.as_flattened_mut());
    f(velocity.cvel.as_flattened_mut());
    if model.features.articulated {
        f(inertia.link.as_flattened_mut());
    } else {
        f(&mut inertia.m);
    }
    f(&mut acceleration.qfrc_smooth);
    f(&mut acceleration.qacc_smooth);
    f(&mut acceleration.inverse);
    // Newton's method has a factor of its own.
    if model.options.solver != options::Solver::Newton || model.options.noslip_iterations > 0 {
        f(&mut acceleration.factor);
    }
    f(&mut derivative.lower);
    f(&mut derivative.upper);
    f(&mut derivative.inverse);
}

/// Numbers that vary, as far as a part reads them: one field for each quantity.
pub fn varied_fields<'a, L: Lane>(varied: Option<&'a Varied<L>>, reads: Quantities, mut f: impl FnMut(&'a [L])) {
    if let Some(varied) = varied {
        varied.set().and(reads).iter().for_each(|quantity| f(varied.lanes(quantity)));
    }
}

/// A recording, and the number of its next field.
pub struct Binder<T: Float> {
    pub recording: Recording<T>,
    pub next: usize,
}

impl<T: Float> Binder<T> {
    pub fn new() -> Self {
        Binder { recording: Recording::new(), next: 0 }
    }

    /// Makes the lanes those of the next field; returns its number.
    pub fn input(&mut self, lanes: &mut [Recorder<T>]) -> usize {
        let field = self.next;
        lanes.copy_from_slice(&self.recording.input(field, lanes.len()));
        self.next += 1;
        field
    }

    /// Numbers that vary, as far as a part reads them, as the next fields.
    pub fn varied(&mut self, model: &Model<T>, set: Quantities) -> Option<Varied<Recorder<T>>> {
        let mut varied = Varied::new(model, set);
        varied.for_each(&mut |lanes| {
            self.input(lanes);
        });
        (!set.is_empty()).then_some(varied)
    }

    /// Makes the lanes what the next field, which is only written, shall hold.
    pub fn output(&mut self, lanes: &[Recorder<T>]) {
        self.recording.output(self.next, lanes);
        self.next += 1;
    }
}

/// Fields: qpos, qvel, ctrl; forces from outside, if any; what varies; those of [`smooth_fields`]. Masks: the
/// [findings](pipeline::Findings).
pub fn smooth<T: Float>(model: &Model<T>, kind: SmoothKind, varying: Quantities) -> Program<T> {
    let mut binder = Binder::new();
    let mut state = State::<Recorder<T>>::new(&model.sizes);
    for lanes in [&mut state.qpos, &mut state.qvel, &mut state.ctrl] {
        binder.input(lanes);
    }
    let applied = kind.applied.then(|| {
        let mut applied = Applied::new(&model.sizes);
        applied.for_each(&mut |field| {
            binder.input(field.data);
        });
        applied
    });
    let varied = binder.varied(model, varying.and(readers::SMOOTH));
    let mut position = Position::new(&model.sizes);
    let mut inertia = Inertia::new(&model.sizes);
    let mut velocity = Velocity::new(&model.sizes);
    let mut passive = Passive::new(&Stage::Passive.sizes(model));
    let mut actuation = Actuation::new(&Stage::Actuation.sizes(model));
    let mut acceleration = Acceleration::new(&model.sizes);
    let mut derivative = Derivative::new(&Stage::Derivative.sizes(model));
    let mut colliders = Colliders::new(&model.sizes);
    let mut stages = Smooth {
        position: &mut position,
        inertia: &mut inertia,
        velocity: &mut velocity,
        passive: &mut passive,
        actuation: &mut actuation,
        acceleration: &mut acceleration,
        derivative: &mut derivative,
        colliders: &mut colliders,
    };
    let first = binder.next;
    smooth_fields(model, kind.keep, stages.borrow(), &mut |lanes| {
        binder.input(lanes);
    });
    let present = |stage: Stage| stage.present(model);
    let instance = Instance { model, varied: varied.as_ref() };
    let findings = pipeline::smooth(instance, &state, applied.as_ref(), &present, stages.borrow(), &mut |_| {});
    let mut field = first;
    smooth_fields(model, kind.keep, stages, &mut |lanes| {
        binder.recording.output(field, lanes);
        field += 1;
    });
    for mask in <[_; 5]>::from(findings) {
        binder.recording.mask_output(mask);
    }
    binder.recording.finish()
}

/// The least that code can be for: a mask that is handed on.
pub fn probe<T: Float>() -> Program<T> {
    let mut recording = Recording::new();
    let mask = recording.mask_input();
    recording.mask_output(mask);
    recording.finish()
}

/// Operations of the smooth stages, about.
pub fn operations_of_smooth<T>(model: &Model<T>) -> usize {
    let factors = if Stage::Derivative.present(model) { 3 } else { 1 };
    PER_LINK * model.sizes.nlink + factors * solver::work_of_factor(model, false)
}

/// Operations of the integration, about.
pub fn operations_of_euler<T>(model: &Model<T>) -> usize {
    let sizes = &model.sizes;
    let damping = match &model.features {
        features if !features.implicit_damping => 0,
        features if features.articulated => PER_LINK * sizes.nlink,
        _ => solver::work_of_factor(model, false) + 2 * sizes.nm,
    };
    100 * sizes.njnt + 20 * sizes.nv + damping
}

/// Fields: qpos, qvel, warm start, time, all of which change; M, spatial inertias of links, dof axes, smooth acceleration,
/// qacc, smooth force, force of constraints; a zero; next qpos, next qvel, acceleration over the step; what varies. Masks:
/// worlds that are alive; worlds that take the next state.
pub fn euler<T: Float>(model: &Model<T>, varying: Quantities) -> Program<T> {
    let mut binder = Binder::new();
    let mut state = State::<Recorder<T>>::new(&model.sizes);
    let mut position = Position::new(&model.sizes);
    let mut inertia = Inertia::new(&model.sizes);
    let masses = [&mut inertia.m, inertia.link.as_flattened_mut(), position.cdof.as_flattened_mut()];
    let mut vectors: [_; 4] = std::array::from_fn(|_| vec![Recorder::zero(); model.sizes.nv]);
    let State { qpos, qvel, qacc_warmstart, time, .. } = &mut state;
    for lanes in [qpos, qvel, qacc_warmstart, time] {
        binder.input(lanes);
    }
    masses.into_iter().chain(vectors.iter_mut().map(Vec::as_mut_slice)).for_each(|lanes| {
        binder.input(lanes);
    });
    let zero = binder.recording.uniform(binder.next, 1)[0];
    let next_field = binder.next + 1;
    binder.next += 4;
    let varied = binder.varied(model, varying.and(readers::EULER));
    let alive = binder.recording.mask_input();
    let mut next = Integration::new(&Stage::Integration.sizes(model));
    let [qacc_smooth, qacc, smooth, constraint] = vectors.each_ref().map(Vec::as_slice);
    let instance = Instance { model, varied: varied.as_ref() };
    let masses = (&position, &inertia);
    integration::euler(instance, masses, &state.qpos, &state.qvel, qacc, [smooth, constraint], &mut next);
    let good = pipeline::commit(model, &next, [qacc, qacc_smooth], zero, alive, &mut state);
    for (field, lanes) in [&state.qpos, &state.qvel, &state.qacc_warmstart, &state.time].into_iter().enumerate() {
        binder.recording.output(field, lanes);
    }
    for (field, lanes) in [&next.qpos, &next.qvel, &next.qacc].into_iter().enumerate() {
        binder.recording.output(next_field + field, lanes);
    }
    binder.recording.mask_output(good);
    binder.recording.finish()
}

/// Fields: qpos, qvel; numbers of all rows on joints; what varies. Masks: worlds in which some of them acts.
pub fn joints<T: Float>(model: &Model<T>, varying: Quantities) -> Program<T> {
    let mut binder = Binder::new();
    let mut state = State::<Recorder<T>>::new(&model.sizes);
    binder.input(&mut state.qpos);
    binder.input(&mut state.qvel);
    let mut constraint = Constraint::new(model);
    constraint.dof_rows.extend(constraint::all_dof_rows(model));
    constraint.dof_lanes.resize(constraint.dof_rows.len(), [Recorder::zero(); 6]);
    let rows_field = binder.next;
    binder.next += 1;
    let varied = binder.varied(model, varying.and(readers::JOINTS));
    let instance = Instance { model, varied: varied.as_ref() };
    let act = constraint::dof_lanes(instance, &state.qpos, &state.qvel, &mut constraint);
    binder.recording.output(rows_field, constraint.dof_lanes.as_flattened());
    binder.recording.mask_output(act);
    binder.recording.finish()
}
