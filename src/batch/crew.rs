//! Who takes a batch's blocks through steps: threads with what each has of its own, and what they need to know.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use lanesim_kernels::diagnosis::{self, Element};
use lanesim_kernels::inverse::Inverse;
use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::model::{Model as KernelModel, Quantities, Varied};
use lanesim_kernels::options::Integrator;
use lanesim_kernels::part::Executor;
use lanesim_kernels::pipeline::{self, Run, StageClock};
use lanesim_kernels::state::{Applied, BlockStatus, Status};
use lanesim_kernels::step;
use lanesim_kernels::workspace::Workspace;

use super::cloud::Cloud;
use crate::block::Block;
use crate::convex::SupportCollider;
use crate::error::Error;
use crate::group::{self, Group};
use crate::memory;
use crate::model::{Key, Model};
use crate::noise;
use crate::options::Tables;
use crate::outputs::{Buffers, Output, View};
use crate::pace::Paces;
use crate::plan::Plan;
use crate::pool::Pool;
use crate::rollout::{Controls, Rollout, Statistics, Trajectories};
use crate::rows::Rows;

/// Worlds for which controls are drawn together.
const DRAWS: usize = 8;

/// Threads, one workspace each, and what they need to know.
pub(super) struct Crew<L: LaneQuery> {
    pub(super) model: Model,
    pub(super) tables: Arc<KernelModel<L::Real>>,
    pub(super) nworld: usize,
    /// Numbers of the worlds in the batch, while only some are worked on.
    pub(super) chosen: Option<Vec<usize>>,
    pub(super) max_contacts: usize,
    /// What varies between worlds, and how many numbers of a world those are.
    pub(super) varying: (Quantities, usize),
    /// Where diverged worlds start again; `None`: they stay frozen.
    pub(super) restart: Option<Key>,
    /// Steps taken since the batch was made.
    pub(super) steps: u64,
    pub(super) pool: Arc<Pool>,
    /// By thread, from when it first takes part.
    pub(super) seats: Vec<Mutex<Option<Seat<L>>>>,
    /// Makes a thread's way to code.
    pub(super) code: Box<dyn Fn() -> WorkerCode<L> + Send + Sync>,
    /// What work on a block took lately.
    pub(super) paces: Paces,
}

/// What a thread has of its own.
pub(super) struct Seat<L: LaneQuery> {
    pub(super) worker: Worker<L>,
    /// Where its present blocks are.
    pub(super) group: Group<L>,
}

/// What a thread keeps from block to block.
pub(super) struct Worker<L: LaneQuery> {
    pub(super) workspace: Workspace<L>,
    pub(super) code: WorkerCode<L>,
    pub(super) statistics: Statistics,
    pub(super) clock: StageClock,
    pub(super) buffers: Buffers,
    /// From when it is first asked for.
    pub(super) inverse: Option<Inverse<L>>,
    /// Likewise.
    pub(super) cloud: Option<Box<Cloud<L>>>,
}

/// What acts on a block from outside: forces, and numbers of the model that vary.
type Outside<'a, L> = (Option<&'a Applied<L>>, Option<&'a Varied<L>>);

/// A worker's way to the code made for the model.
pub(crate) type WorkerCode<L> = Box<dyn Executor<L> + Send>;

impl<L: LaneQuery> Seat<L> {
    /// A thread's own for a model of which so much varies.
    pub(super) fn new(
        tables: &Arc<KernelModel<L::Real>>,
        mut code: WorkerCode<L>,
        (set, lanes): (Quantities, usize),
    ) -> Result<Self, Error> {
        memory::ask("a thread's scratch", &[Workspace::<L>::bytes(tables)])?;
        if !set.is_empty() {
            code.vary(tables, set);
        }
        Ok(Seat { worker: Worker::new(tables, code), group: Group::new(tables, 1, lanes) })
    }
}

impl<L: LaneQuery> Worker<L> {
    fn new(tables: &KernelModel<L::Real>, code: WorkerCode<L>) -> Self {
        Worker {
            workspace: Workspace::new(tables),
            code,
            statistics: Statistics::default(),
            clock: StageClock::default(),
            buffers: Buffers::default(),
            inverse: None,
            cloud: None,
        }
    }
}

/// Blocks with their share of the outputs: `rows[o]` holds the worlds' rows of output `o`.
pub(super) struct Job<'a, L: LaneQuery> {
    pub(super) first_world: usize,
    pub(super) worlds: usize,
    pub(super) group: &'a mut Group<L>,
    pub(super) rows: Vec<Rows<'a>>,
}

impl<L: LaneQuery<Real: Tables>> Crew<L> {
    /// Takes blocks through all steps of a rollout; if they are several, a span of steps each in turn.
    pub(super) fn run_group(&self, rollout: &Rollout<'_>, plan: &Plan, job: &mut Job<'_, L>, worker: &mut Worker<L>) {
        let Job { first_world, worlds, group, rows } = job;
        let count = group.blocks().len();
        let mut span = if count > 1 { group::SPAN } else { rollout.nstep };
        let report = |steps: usize| {
            if let Some(progress) = rollout.progress {
                progress.fetch_add(steps as u64, Ordering::Relaxed);
            }
        };
        let (mut end, mut left) = (0, rollout.nstep * *worlds);
        while end < rollout.nstep && !rollout.cancelled() {
            let steps = span.min(rollout.nstep - end);
            end += steps;
            for b in 0..count {
                let block = &mut group.blocks()[b];
                self.guard(block, worker, |block, worker| {
                    if block.done == 0 {
                        self.check_state(block);
                    }
                    while block.done < end && !rollout.cancelled() {
                        self.load_controls(rollout, *first_world, block);
                        // A block of which all worlds are frozen is passed over.
                        if block.status.alive != 0 {
                            self.step_block(rollout, plan, (rows, *worlds), block, worker);
                        } else {
                            self.record(rollout, rows, (*worlds, |_| true), (!0, 0), block, worker);
                        }
                        block.done += 1;
                    }
                });
                if end < rollout.nstep {
                    group.observe(b, &self.tables, &worker.workspace);
                }
                let done = steps * group.blocks()[b].ids.len();
                left -= done;
                report(done);
            }
            if end < rollout.nstep && !group.sort() {
                // What is in order now will be for a while.
                span = rollout.nstep.min(2 * span);
            }
        }
        report(left);
    }

    /// Computes outputs of one block's present states.
    pub(super) fn read_block(
        &self,
        outputs: &[Output],
        plan: &Plan,
        rows: &mut [Rows<'_>],
        block: &mut Block<L>,
        worker: &mut Worker<L>,
    ) {
        let Worker { workspace, buffers, code, .. } = worker;
        let (mut valid, mut solved) = (0, 0);
        if plan.derived {
            let before = block.status;
            let bad = diagnosis::inspect(&self.tables, &block.state, block.applied.as_deref(), &mut block.status);
            // Nobody's step yet: what cannot be stepped is left out, not frozen.
            valid = bad.iter().fold(before.alive, |valid, (_, lanes)| valid & !lanes);
            block.status.alive = valid;
            let mut run = self.run(plan, (block.applied.as_deref(), block.varied.as_deref()), code.as_mut());
            let found = pipeline::forward(&self.tables, &mut block.state, &mut run, &mut block.status, workspace);
            block.status.record(Status::NOT_CONVERGED, found.unfinished);
            (block.status.alive, solved) = (before.alive, found.lanes);
            if block.status != before {
                self.note_step(block, before, workspace);
            }
        }
        let view = View { model: &self.model, tables: &self.tables, block, workspace, valid, solved };
        for (output, rows) in outputs.iter().zip(rows) {
            let width = rows.len() / block.ids.len();
            block.ids.iter().enumerate().for_each(|(lane, id)| output.write(&view, lane, buffers, rows, id * width));
        }
    }

    /// Takes a block through a step, and writes the outputs. Those that are derived follow from the state from which the step starts;
    /// worlds that it loses have none.
    fn step_block(
        &self,
        rollout: &Rollout<'_>,
        plan: &Plan,
        (rows, worlds): (&mut [Rows<'_>], usize),
        block: &mut Block<L>,
        worker: &mut Worker<L>,
    ) {
        let before = block.status;
        let Block { state, status, applied, varied, .. } = block;
        let mut run = self.run(plan, (applied.as_deref(), varied.as_deref()), worker.code.as_mut());
        run.clock = rollout.clock.then_some(&mut worker.clock);
        let solved = step::evaluate(&self.tables, state, &mut run, status, &mut worker.workspace);
        // The solver of a midpoint step works when the step advances.
        let late = self.tables.options.integrator == Integrator::Midpoint;
        if rollout.statistics && !late {
            worker.statistics.gather(&worker.workspace, before.alive);
        }
        self.record(rollout, rows, (worlds, Output::derived), (!0, solved.lanes), block, worker);
        let Block { state, status, applied, varied, .. } = block;
        let mut run = self.run(plan, (applied.as_deref(), varied.as_deref()), worker.code.as_mut());
        run.clock = rollout.clock.then_some(&mut worker.clock);
        step::advance(&self.tables, state, &mut run, status, solved, &mut worker.workspace);
        if rollout.statistics && late {
            worker.statistics.gather(&worker.workspace, before.alive);
        }
        let lost = solved.lanes & !block.status.alive;
        if block.status != before {
            self.note_step(block, before, &worker.workspace);
        }
        self.record(rollout, rows, (worlds, Output::derived), (lost, 0), block, worker);
        self.record(rollout, rows, (worlds, |output| !output.derived()), (!0, 0), block, worker);
    }

    pub(super) fn run<'a>(
        &self,
        plan: &Plan,
        (applied, varied): Outside<'a, L>,
        executor: &'a mut dyn Executor<L>,
    ) -> Run<'a, L> {
        let (max_contacts, convex) = (self.max_contacts, &SupportCollider);
        let Plan { stages, residual, derived: keep } = *plan;
        Run { applied, varied, clock: None, max_contacts, convex, stages, residual, executor, keep }
    }

    /// Looks at what a block has from outside: flags what is unusual, and freezes or starts again what cannot be stepped. A step
    /// leaves no such state.
    fn check_state(&self, block: &mut Block<L>) {
        let before = block.status;
        for (cause, lanes) in
            diagnosis::inspect(&self.tables, &block.state, block.applied.as_deref(), &mut block.status)
        {
            block.status.record(cause, lanes);
            block.status.record(Status::FROZEN, lanes);
            block.status.alive &= !lanes;
        }
        if block.status != before {
            self.note(block, before, &|block, status, lane| {
                diagnosis::element_outside(&self.tables, &block.state, block.applied.as_deref(), status, lane)
            });
        }
    }

    /// Keeps what happened in a step that the workspace still holds.
    #[cold]
    pub(super) fn note_step(&self, block: &mut Block<L>, before: BlockStatus, workspace: &Workspace<L>) {
        self.note(block, before, &|block, status, lane| match status {
            Status::QUAT_ZERO | Status::QUAT_FAR => {
                diagnosis::element_outside(&self.tables, &block.state, block.applied.as_deref(), status, lane)
            }
            _ => diagnosis::element(&self.tables, &block.state, workspace, status, lane),
        });
    }

    /// Keeps what happened, and where, and starts worlds again that diverged, if that is the policy.
    #[cold]
    fn note(
        &self,
        block: &mut Block<L>,
        mut before: BlockStatus,
        element: &dyn Fn(&Block<L>, Status, usize) -> Element,
    ) {
        let mut lost = before.alive & !block.status.alive;
        if self.restart.is_some() {
            // A world that starts again is not frozen.
            before.record(Status::FROZEN, lost);
        }
        block.note(&before, self.steps + block.done as u64, element);
        let Some(key) = &self.restart else { return };
        while lost != 0 {
            block.restart(&self.tables.sizes, lost.trailing_zeros() as usize, key);
            lost &= lost - 1;
        }
    }

    /// A world's number in the batch; `place` is that among those worked on.
    fn number(&self, place: usize) -> usize {
        self.chosen.as_ref().map_or(place, |chosen| chosen[place])
    }

    fn load_controls(&self, rollout: &Rollout<'_>, first_world: usize, block: &mut Block<L>) {
        let nu = self.tables.sizes.nu;
        let Block { state, ids, done: step, .. } = block;
        let worlds = ids.iter().map(|id| first_world + id).enumerate();
        match rollout.controls {
            Controls::Keep => {}
            Controls::Given(controls) => {
                for (lane, world) in worlds {
                    let row = (world * rollout.nstep + *step) * nu;
                    for (u, x) in state.ctrl.iter_mut().zip(&controls[row..row + nu]) {
                        u.set(lane, L::Real::from_f64(*x));
                    }
                }
            }
            Controls::Strided { values, world, step: stride } => {
                for (lane, id) in worlds.filter(|_| nu > 0) {
                    let row = id * world + *step * stride;
                    values.for_each(row..row + nu, |i, x| state.ctrl[i].set(lane, L::Real::from_f64(x)));
                }
            }
            Controls::Noise { seed, scale } => {
                let world = |id: &usize| self.number(first_world + id) as u64;
                for (part, ids) in ids.chunks(DRAWS).enumerate() {
                    self.draw((seed, scale), *step as u64, ids.iter().map(world), part * DRAWS, &mut state.ctrl);
                }
            }
        }
    }

    /// Draws the controls of up to [`DRAWS`] worlds, whose first lane is `first`. All loops are as long as there could be
    /// worlds, so that hashes of several run side by side.
    #[inline]
    fn draw(
        &self,
        (seed, scale): (u64, f64),
        step: u64,
        worlds: impl ExactSizeIterator<Item = u64>,
        first: usize,
        ctrl: &mut [L],
    ) {
        let mut draws = [noise::Draws::new(seed, 0, step); DRAWS];
        let count = worlds.len();
        for (draws, world) in draws.iter_mut().zip(worlds) {
            *draws = noise::Draws::new(seed, world, step);
        }
        for (a, u) in ctrl.iter_mut().enumerate() {
            let [low, high] = self.model.control_range(a);
            let (width, cut) = (scale * (high - low), (1.0 - scale) * 0.5 * (high - low));
            let low = low + cut;
            let drawn = draws.map(|draws| L::Real::from_f64(low + width * draws.uniform(a as u64)));
            match count {
                DRAWS => u.put(first, &drawn),
                _ => u.put(first, &drawn[..count]),
            }
        }
    }

    /// Writes some outputs of a block's lanes, of which `rows` are those of `worlds` worlds; derived ones have numbers where they are
    /// `valid`.
    fn record(
        &self,
        rollout: &Rollout<'_>,
        rows: &mut [Rows<'_>],
        (worlds, which): (usize, fn(&Output) -> bool),
        (lanes, valid): (u32, u32),
        block: &Block<L>,
        worker: &mut Worker<L>,
    ) {
        let Worker { workspace, buffers, .. } = worker;
        let view = View { model: &self.model, tables: &self.tables, block, workspace, valid, solved: valid };
        for (output, rows) in rollout.outputs.iter().zip(rows).filter(|(output, _)| lanes != 0 && which(output)) {
            let width = rows.len() / (worlds * rollout.nstep);
            for (lane, id) in block.ids.iter().enumerate().filter(|(lane, _)| lanes >> lane & 1 != 0) {
                output.write(&view, lane, buffers, rows, (id * rollout.nstep + block.done) * width);
            }
        }
    }

    /// A panic in `work` costs its block's worlds, nothing else: they are frozen and flagged, and the workspace, which may
    /// hold anything now, is made anew.
    pub(super) fn guard(
        &self,
        block: &mut Block<L>,
        worker: &mut Worker<L>,
        work: impl FnOnce(&mut Block<L>, &mut Worker<L>),
    ) {
        if catch_unwind(AssertUnwindSafe(|| work(block, worker))).is_err() {
            block.fail(self.steps + block.done as u64);
            worker.workspace = Workspace::new(&self.tables);
            worker.buffers = Buffers::default();
        }
    }

    /// A thread's seat, made when it is first asked for.
    pub(super) fn seat(&self, thread: usize) -> Result<MutexGuard<'_, Option<Seat<L>>>, Error> {
        let mut seat = self.seats[thread].lock().unwrap_or_else(PoisonError::into_inner);
        if seat.is_none() {
            *seat = Some(Seat::new(&self.tables, (self.code)(), self.varying)?);
        }
        Ok(seat)
    }

    /// The threads that have taken part.
    fn workers(&mut self) -> impl Iterator<Item = &mut Worker<L>> {
        let seats = self.seats.iter_mut().map(|seat| seat.get_mut().unwrap_or_else(PoisonError::into_inner));
        seats.flatten().map(|seat| &mut seat.worker)
    }

    /// Forgets what the workers counted.
    pub(super) fn clear(&mut self) {
        for worker in self.workers() {
            worker.statistics = Statistics::default();
            worker.clock = StageClock::default();
        }
    }

    /// What the workers counted.
    pub(super) fn collect(&mut self) -> Trajectories {
        let mut result = Trajectories::default();
        for worker in self.workers() {
            result.statistics.add(&worker.statistics);
            for (sum, spent) in result.clock.spent.iter_mut().zip(worker.clock.spent) {
                *sum += spent;
            }
        }
        result
    }
}
