//! Clouds: of every world, what follows from its state and from states beside it.
//!
//! A block of a cloud holds some worlds, each in as many lanes: in one lane of each of them one column is perturbed. All columns of a
//! kind are gone through so, first to one side, then to the other, which leaves differences lane by lane. As all lanes of a world have
//! what was found for its nominal state, columns of controls and of velocities start where these matter.

mod acting;
mod end;
mod exact;
mod points;

use std::ops::Range;
use std::sync::atomic::Ordering;
use std::time::Instant;

use lanesim_kernels::diagnosis;
use lanesim_kernels::integration::displace;
use lanesim_kernels::inverse::{self, Inverse};
use lanesim_kernels::kick;
use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::model::{Control, Model as KernelModel};
use lanesim_kernels::options::Integrator;
use lanesim_kernels::pipeline;
use lanesim_kernels::stage::{Stage, Stages, Start};
use lanesim_kernels::state::{Applied, BlockStatus, State, Status};
use lanesim_kernels::step;

use self::acting::Acting;
use self::end::End;
use super::{Batch, Crew, Job, Worker};
use crate::block::Block;
use crate::cloud::request::{Method, Of, Request, Scheme, Shape};
use crate::cloud::times::Kind;
use crate::options::Tables;
use crate::plan::Plan;
use crate::rows::Rows;
use crate::store::copy;

/// More lanes than any lane type has.
const LANES: usize = 16;
/// In each lane the column that is perturbed.
type Columns = [Option<usize>; LANES];

/// What a thread has for clouds.
#[derive(Debug)]
pub(super) struct Cloud<L> {
    /// The states that are evaluated.
    block: Block<L>,
    /// The states around which they are.
    nominal: State<L>,
    /// Accelerations, of inverse dynamics.
    given: Vec<L>,
    /// What follows from nominal states, and to either side.
    ends: [End<L>; 3],
    /// Which rows act in the nominal states, and in others.
    acting: [Acting; 2],
    /// A step in the tangent space of positions.
    tangent: Vec<L>,
    /// The derivatives by a column in each lane.
    slopes: Vec<L>,
    /// For exact derivatives, from when they are first asked for.
    exact: Option<Box<exact::Room>>,
}

/// Places in [`Cloud::ends`].
const NOMINAL: usize = 0;
const PLUS: usize = 1;
const MINUS: usize = 2;

impl<L: LaneQuery> Cloud<L> {
    fn new(model: &KernelModel<L::Real>) -> Self {
        let sizes = &model.sizes;
        Cloud {
            block: Block::new(model),
            nominal: State::new(sizes),
            given: vec![L::zero(); sizes.nv],
            ends: Default::default(),
            acting: Default::default(),
            tangent: vec![L::zero(); sizes.nv],
            slopes: Vec::new(),
            exact: None,
        }
    }

    /// Takes worlds from the lanes of a block, each into `share` lanes; the lanes that are left repeat the first.
    fn fill(&mut self, model: &KernelModel<L::Real>, from: &Block<L>, lanes: Range<usize>, share: usize) {
        let (start, count) = (lanes.start, lanes.len());
        let source = |lane: usize| start + if lane / share < count { lane / share } else { 0 };
        let all = |from: &[L], to: &mut [L]| (0..L::WIDTH).for_each(|lane| copy(from, source(lane), to, lane));
        (0..State::<L>::COUNT).for_each(|n| all(from.state.field(n), self.nominal.field_mut(n)));
        match &from.applied {
            Some(applied) => {
                let mine = self.block.applied.get_or_insert_with(|| Box::new(Applied::new(&model.sizes)));
                (0..Applied::<L>::COUNT).for_each(|n| all(applied.field(n), mine.field_mut(n)));
            }
            None => self.block.applied = None,
        }
        self.block.varied.clone_from(&from.varied);
        if let (Some(varied), Some(mine)) = (&from.varied, &mut self.block.varied) {
            varied.set().iter().for_each(|quantity| all(varied.lanes(quantity), mine.lanes_mut(quantity)));
        }
    }

    /// The accelerations of the worlds that it was filled with, whose first has this number.
    fn give(&mut self, request: &Request<'_>, first_world: usize, work: &Work<'_>) {
        let Some(qacc) = request.qacc else { return };
        let nv = self.given.len();
        for lane in 0..L::WIDTH {
            let id = work.ids.get(lane / work.share).unwrap_or(&work.ids[0]);
            qacc.row(first_world + id, nv, |i, x| self.given[i].set(lane, L::Real::from_f64(x)));
        }
    }

    /// The nominal states again.
    fn rewind(&mut self) {
        (0..State::<L>::COUNT).for_each(|n| self.block.state.field_mut(n).copy_from_slice(self.nominal.field(n)));
    }

    /// Perturbs in each lane the column that is given for it, by `eps`; `accelerations` are those of inverse dynamics.
    fn perturb(
        &mut self,
        model: &KernelModel<L::Real>,
        (kind, columns): (Kind, &Columns),
        eps: f64,
        accelerations: &mut [L],
    ) {
        let Cloud { block: Block { state, .. }, nominal, tangent, .. } = self;
        let na = model.sizes.na;
        let columns = columns.iter().enumerate().filter_map(|(lane, column)| Some((lane, (*column)?)));
        let eps = L::Real::from_f64(eps);
        let add = |to: &mut L, lane: usize| {
            let sum = *to + L::splat(eps);
            to.set(lane, sum.get(lane));
        };
        match kind {
            Kind::Position => {
                tangent.fill(L::zero());
                columns.for_each(|(lane, column)| tangent[column].set(lane, eps));
                displace(model, &nominal.qpos, tangent, &mut state.qpos);
            }
            Kind::Velocity => columns.for_each(|(lane, column)| add(&mut state.qvel[column], lane)),
            Kind::Acceleration => columns.for_each(|(lane, column)| add(&mut accelerations[column], lane)),
            Kind::Actuation => columns.for_each(|(lane, column)| match column.checked_sub(na) {
                None => add(&mut state.act[column], lane),
                Some(control) => add(&mut state.ctrl[control], lane),
            }),
        }
    }

    /// The lanes of worlds that are bits of `alive`.
    fn spread(&self, alive: u32, work: &Work<'_>) -> u32 {
        let lanes = 0..work.ids.len() * work.share;
        lanes.fold(0, |bits, lane| bits | (alive >> (lane / work.share) & 1) << lane)
    }
}

/// From where on a kind's states have to be evaluated; `None`: not at all. Nothing stays between the evaluations of a Runge-Kutta step, nor
/// in the middle of a midpoint step, or what the guard works with.
fn start<T>(kind: Kind, of: Of, model: &KernelModel<T>) -> Option<Start> {
    let several = matches!(model.options.integrator, Integrator::Rk4 | Integrator::Midpoint);
    let parts = of == Of::Transition && (several || kick::kicks(model));
    match kind {
        _ if parts => Some(Start::Position),
        Kind::Position => Some(Start::Position),
        Kind::Velocity => Some(Start::Velocity),
        Kind::Actuation => Some(Start::Actuation),
        Kind::Acceleration => None,
    }
}

/// To which sides a control can be perturbed without leaving its range: forward, backward.
fn sides<T: Real>(own: &Control<T>, control: f64, eps: f64) -> [bool; 2] {
    let [low, high] = own.range.map(T::to_f64);
    let inside = |x: f64| !own.limited || (low..=high).contains(&x);
    [inside(control) && inside(control + eps), inside(control) && inside(control - eps)]
}

/// Lanes for each of `count` worlds, such that the fewest evaluations are needed, of which a world takes `evaluations` when it has so many
/// lanes; of equal ones the most, where lanes have most in common.
fn share(width: usize, count: usize, evaluations: impl Fn(usize) -> usize) -> usize {
    let rounds = |share: usize| evaluations(share) * count.div_ceil(width / share);
    let shares = std::iter::successors(Some(width), |share| (share % 2 == 0).then_some(share / 2));
    shares.min_by_key(|share| rounds(*share)).unwrap_or(1)
}

impl<L: LaneQuery<Real: Tables>> Batch<L> {
    /// Writes every world's derivatives, how each column was perturbed, how many rows began or ceased to act there, and what happened. NaN
    /// where there are no derivatives.
    pub(super) fn cloud(&mut self, request: &Request<'_>, rows: Vec<Rows<'_>>) {
        let shape = Shape::new(&self.crew.model, request.of, request.scheme.sensors);
        let pace = 2.0 * shape.all() as f64 * self.crew.paces.step.get();
        let _ = self.each(1, pace, rows, request.cancel, |crew, Job { first_world, worlds, group, rows }, worker| {
            for block in group.blocks() {
                let before = block.status;
                crew.guard(block, worker, |block, worker| {
                    crew.cloud_block((request, &shape, *first_world), rows, block, worker);
                });
                if block.status != before {
                    block.ids.iter().for_each(|id| shape.lose(rows, *id, block.status.lane(0)));
                }
            }
            if let Some(progress) = request.progress {
                progress.fetch_add(*worlds as u64, Ordering::Relaxed);
            }
        });
    }
}

impl<L: LaneQuery<Real: Tables>> Crew<L> {
    fn cloud_block(
        &self,
        (request, shape, first_world): (&Request<'_>, &Shape, usize),
        rows: &mut [Rows<'_>],
        block: &mut Block<L>,
        worker: &mut Worker<L>,
    ) {
        let count = block.ids.len();
        let columns = |share| shape.kinds().iter().map(|kind| shape.columns(*kind).0.div_ceil(share)).sum::<usize>();
        let share = match request.scheme.method {
            Method::Exact => 1,
            Method::Differences => share(L::WIDTH, count, |share| 1 + 2 * columns(share)),
        };
        let worlds = L::WIDTH / share;
        let mut cloud = worker.cloud.take().unwrap_or_else(|| Box::new(Cloud::new(&self.tables)));
        for first in (0..count).step_by(worlds) {
            let lanes = first..count.min(first + worlds);
            cloud.fill(&self.tables, block, lanes.clone(), share);
            let work = Work { request, shape, share, ids: &block.ids[lanes] };
            cloud.give(request, first_world, &work);
            let alive = cloud.spread(block.status.alive >> first, &work);
            self.cloud_of(&work, alive, rows, (&mut cloud, worker));
        }
        worker.cloud = Some(cloud);
    }

    /// The cloud of the worlds that a block was filled with, of which those of `alive` can be stepped.
    fn cloud_of(
        &self,
        work: &Work<'_>,
        alive: u32,
        rows: &mut [Rows<'_>],
        (cloud, worker): (&mut Cloud<L>, &mut Worker<L>),
    ) {
        let mut events = BlockStatus { alive, ..BlockStatus::default() };
        let since = Instant::now();
        let alive = self.nominal_of(work, alive, (cloud, worker), &mut events);
        if let Some(times) = work.request.times {
            times.add(None, work.ids.len(), since.elapsed());
        }
        if work.request.scheme.method == Method::Exact {
            cloud.rewind();
            cloud.exact(self.model.tables(), (work, alive), &worker.workspace, rows);
        } else {
            self.all_columns(work, alive, rows, (cloud, worker), &mut events);
        }
        for (i, id) in work.ids.iter().enumerate() {
            let lanes = i * work.share..(i + 1) * work.share;
            let status = lanes.clone().fold(0, |bits, lane| bits | events.lane(lane).0);
            work.shape.note(rows, *id, Status(status));
            if alive >> lanes.start & 1 == 0 {
                work.shape.lose(rows, *id, Status(status));
            }
        }
    }

    /// Derivatives by all columns, kind after kind.
    fn all_columns(
        &self,
        work: &Work<'_>,
        alive: u32,
        rows: &mut [Rows<'_>],
        (cloud, worker): (&mut Cloud<L>, &mut Worker<L>),
        events: &mut BlockStatus,
    ) {
        for kind in work.shape.kinds() {
            let count = work.shape.columns(*kind).0;
            for first in (0..count).step_by(work.share) {
                let (columns, since) = (work.columns(first, count), Instant::now());
                self.columns_of(work, (*kind, &columns), alive, rows, (cloud, worker), events);
                let columns = columns.iter().flatten().count();
                if let Some(times) = work.request.times {
                    times.add(Some(*kind), columns, since.elapsed());
                }
            }
        }
    }

    /// Evaluates the nominal states in the lanes of `alive`. Returns those in which something followed.
    fn nominal_of(
        &self,
        work: &Work<'_>,
        alive: u32,
        (cloud, worker): (&mut Cloud<L>, &mut Worker<L>),
        events: &mut BlockStatus,
    ) -> u32 {
        cloud.rewind();
        let Block { state, applied, .. } = &cloud.block;
        let bad = diagnosis::inspect(&self.tables, state, applied.as_deref(), events);
        bad.iter().for_each(|(status, lanes)| events.record(*status, *lanes));
        let bad = bad.iter().fold(0, |bad, (_, lanes)| bad | lanes);
        // A rotation by no quaternion has no neighbours.
        let nowhere = events.lanes(Status::QUAT_ZERO);
        let alive = self.end_of(work, None, alive & !bad & !nowhere, 0.0, (cloud, worker), events);
        // Columns start from what constraints add to the nominal acceleration.
        let Cloud { block, nominal, .. } = &mut *cloud;
        nominal.qacc_warmstart.copy_from_slice(&block.state.qacc_warmstart);
        alive
    }

    /// Derivatives by one column of a kind in each lane.
    fn columns_of(
        &self,
        work: &Work<'_>,
        (kind, columns): (Kind, &Columns),
        alive: u32,
        rows: &mut [Rows<'_>],
        (cloud, worker): (&mut Cloud<L>, &mut Worker<L>),
        events: &mut BlockStatus,
    ) {
        let Scheme { eps, centred, .. } = work.request.scheme;
        let wanted =
            columns.iter().enumerate().fold(0, |bits, (lane, c)| bits | u32::from(c.is_some()) << lane) & alive;
        let [mut forward, mut backward] = [wanted; 2];
        if kind == Kind::Actuation {
            for (lane, column) in columns.iter().enumerate() {
                let Some(control) = column.and_then(|column| column.checked_sub(self.tables.sizes.na)) else {
                    continue;
                };
                let value = cloud.nominal.ctrl[control].get(lane).to_f64();
                let [plus, minus] = sides(&self.tables.controls[control], value, eps);
                forward &= !(u32::from(!plus) << lane);
                backward &= !(u32::from(!minus) << lane);
            }
        }
        if !centred {
            backward &= !forward;
        }
        let (mut lost, mut changed) = (0, [0; LANES]);
        for (end, lanes, eps) in [(PLUS, forward, eps), (MINUS, backward, -eps)] {
            if lanes != 0 {
                lost |= lanes & !self.end_of(work, Some((kind, columns, end)), lanes, eps, (cloud, worker), events);
                let [nominal, acting] = &cloud.acting;
                nominal.compare(acting, lanes, &mut changed);
            }
        }
        let Cloud { ends: [nominal, plus, minus], slopes, .. } = &mut *cloud;
        end::differentiate(&self.tables, [nominal, plus, minus], [forward, backward], eps, slopes);
        // No zero has a sign.
        let (lost, none) = (L::mask_of(lost), L::of(f64::NAN));
        slopes.iter_mut().for_each(|slope| *slope = L::select(lost, none, *slope + L::zero()));
        let first = work.shape.columns(kind).1;
        for (i, id) in work.ids.iter().enumerate() {
            let lanes = i * work.share..(i + 1) * work.share;
            if wanted >> lanes.start & 1 == 0 {
                continue;
            }
            let (start, count) = (columns[lanes.start].unwrap_or(0), columns[lanes.clone()].iter().flatten().count());
            let slopes = |row: usize| {
                let (mut own, slopes) = ([0.0; LANES], &cloud.slopes[row]);
                own.iter_mut().zip(lanes.clone()).for_each(|(own, lane)| *own = slopes.get(lane).to_f64());
                own
            };
            work.shape.write(rows, (*id, first + start), count, slopes);
            for (lane, column) in lanes.take(count).zip(first + start..) {
                let taken = |lanes: u32| lanes >> lane & 1 != 0;
                work.shape.mark(rows, *id, column, [taken(forward), taken(backward)], changed[lane]);
            }
        }
    }

    /// Evaluates the nominal states, or those beside them in which columns of a kind are perturbed by `eps`, in the lanes of `alive`, and
    /// keeps what follows. Returns the lanes in which something did.
    fn end_of(
        &self,
        work: &Work<'_>,
        of: Option<(Kind, &Columns, usize)>,
        alive: u32,
        eps: f64,
        (cloud, worker): (&mut Cloud<L>, &mut Worker<L>),
        events: &mut BlockStatus,
    ) -> u32 {
        let inverse = worker.inverse.get_or_insert_with(|| Inverse::new(&self.tables.sizes));
        cloud.rewind();
        inverse.given.copy_from_slice(&cloud.given);
        if let Some((kind, columns, _)) = of {
            cloud.perturb(&self.tables, (kind, columns), eps, &mut inverse.given);
        }
        self.evaluate(work.request, of.map(|(kind, _, end)| (kind, end)), alive, (cloud, worker), events)
    }

    /// Evaluates the states of the block in the lanes of `alive`: nominal ones, or those beside them that a kind of columns leads to, and
    /// keeps what follows. Returns the lanes in which something did.
    fn evaluate(
        &self,
        request: &Request<'_>,
        of: Option<(Kind, usize)>,
        alive: u32,
        (cloud, worker): (&mut Cloud<L>, &mut Worker<L>),
        events: &mut BlockStatus,
    ) -> u32 {
        let Worker { workspace, code, inverse, .. } = worker;
        let inverse = inverse.get_or_insert_with(|| Inverse::new(&self.tables.sizes));
        let Cloud { block: Block { state, applied, varied, .. }, ends, acting, .. } = cloud;
        let start = of.map_or(Some(Start::Position), |(kind, _)| start(kind, request.of, &self.tables));
        let sensors = request.scheme.sensors && request.of == Of::Transition;
        let mut plan = if request.of == Of::Inverse { Plan::inverse() } else { Plan::step(&[]) };
        if sensors {
            plan.stages = plan.stages | Stages::up_to(Stage::Sensor);
        }
        // Accelerations are those of states; a midpoint step is evaluated when it advances.
        if request.of != Of::Transition || self.tables.options.integrator == Integrator::Midpoint {
            plan.stages = plan.stages.without(Stage::Integration);
        }
        plan.stages = start.map_or(Stages::NONE, |start| start.within(plan.stages, &self.tables));
        // Columns read what the nominal evaluation leaves.
        let followed = of.is_none() && request.scheme.method == Method::Differences;
        plan.derived = sensors || followed || request.of == Of::Inverse;
        let mut status = BlockStatus { alive, ..BlockStatus::default() };
        let mut run = self.run(&plan, (applied.as_deref(), varied.as_deref()), code.as_mut());
        let end = &mut ends[of.map_or(NOMINAL, |(_, end)| end)];
        let acting = &mut acting[usize::from(of.is_some())];
        if request.of == Of::Inverse {
            let over_step = self.tables.options.flags.invdiscrete;
            inverse::again(&self.tables, state, over_step, &mut run, &mut status, (workspace, inverse));
            acting.observe(&self.tables, workspace);
            end.keep(&[], [&inverse.qfrc_inverse, &[], &[]]);
        } else {
            let solved = pipeline::forward(&self.tables, state, &mut run, &mut status, workspace);
            acting.observe(&self.tables, workspace);
            if request.of == Of::Acceleration {
                status.record(Status::NOT_CONVERGED, solved.unfinished);
                status.alive &= solved.lanes;
                let (qacc, smooth) = (&workspace.solver.fields.qacc, &workspace.acceleration.qacc_smooth);
                let added = qacc.iter().zip(smooth).map(|(qacc, smooth)| *qacc - *smooth);
                state.qacc_warmstart.iter_mut().zip(added).for_each(|(warm, added)| *warm = added);
                end.keep(&[], [qacc, &[], &[]]);
            } else {
                step::advance(&self.tables, state, &mut run, &mut status, solved, workspace);
                let sensordata = if sensors { &workspace.sensors.data[..] } else { &[] };
                end.keep(&state.qpos, [&state.qvel, &state.act, sensordata]);
            }
        }
        events.events.iter_mut().zip(status.events).for_each(|(all, lanes)| *all |= lanes & alive);
        let unfinished = if request.strict { status.lanes(Status::NOT_CONVERGED) } else { 0 };
        status.alive & !unfinished
    }
}

/// What is done in a block of a cloud.
struct Work<'a> {
    request: &'a Request<'a>,
    shape: &'a Shape,
    /// Lanes of each world.
    share: usize,
    /// The worlds, as numbers within the rows.
    ids: &'a [usize],
}

impl Work<'_> {
    /// In each lane a column of `count`, from `first` on; none in lanes that are left.
    fn columns(&self, first: usize, count: usize) -> Columns {
        let mut columns = [None; LANES];
        for (lane, column) in columns.iter_mut().enumerate().take(self.ids.len() * self.share) {
            let own = first + lane % self.share;
            *column = (own < count).then_some(own);
        }
        columns
    }
}
