//! Clouds: of every world, the next states that follow from it and from states beside it.
//!
//! A block of a cloud holds some worlds, each in as many lanes: in one lane of each of them one column is perturbed. All columns of a
//! kind are gone through so, first to one side, then to the other, which leaves differences lane by lane. As all lanes of a world have
//! what was found for its nominal state, columns of controls and of velocities start where these matter.

use std::sync::atomic::Ordering;

use lanesim_kernels::diagnosis;
use lanesim_kernels::integration::{difference, displace};
use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::model::{Actuator, Model as KernelModel};
use lanesim_kernels::options::Integrator;
use lanesim_kernels::pipeline;
use lanesim_kernels::stage::{Stage, Stages, Start};
use lanesim_kernels::state::{Applied, BlockStatus, State, Status};
use lanesim_kernels::step;

use super::{Batch, Crew, Job, Worker};
use crate::block::Block;
use crate::cloud::request::{Request, Scheme, Shape};
use crate::options::Tables;
use crate::plan::Plan;
use crate::rows::Rows;
use crate::store::copy;

/// Columns that a cloud goes through together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Position,
    Velocity,
    /// Activations, then controls.
    Actuation,
}

impl Kind {
    /// From where on a step has to be evaluated. Between the evaluations of a Runge-Kutta step nothing stays.
    fn start<T>(self, model: &KernelModel<T>) -> Start {
        match self {
            _ if model.options.integrator == Integrator::Rk4 => Start::Position,
            Kind::Position => Start::Position,
            Kind::Velocity => Start::Velocity,
            Kind::Actuation => Start::Actuation,
        }
    }
}

/// What follows from a block's states.
#[derive(Debug, Default)]
struct End<L> {
    qpos: Vec<L>,
    qvel: Vec<L>,
    act: Vec<L>,
    sensordata: Vec<L>,
}

/// What a thread has for clouds.
#[derive(Debug)]
pub(super) struct Cloud<L> {
    /// The states that are evaluated.
    block: Block<L>,
    /// The states around which they are.
    nominal: State<L>,
    /// Nominal, and to either side.
    ends: [End<L>; 3],
    /// A step in the tangent space of positions.
    tangent: Vec<L>,
    /// The derivatives of a column in each lane: of the next state, then of sensors.
    slopes: Vec<L>,
}

/// Places in [`Cloud::ends`].
const NOMINAL: usize = 0;
const PLUS: usize = 1;
const MINUS: usize = 2;

impl<L: LaneQuery> Cloud<L> {
    fn new(model: &KernelModel<L::Real>) -> Self {
        let sizes = &model.sizes;
        let zeros = |n: usize| vec![L::zero(); n];
        let end = || End {
            qpos: zeros(sizes.nq),
            qvel: zeros(sizes.nv),
            act: zeros(sizes.na),
            sensordata: zeros(sizes.nsensordata),
        };
        Cloud {
            block: Block::new(model),
            nominal: State::new(sizes),
            ends: [end(), end(), end()],
            tangent: zeros(sizes.nv),
            slopes: zeros(2 * sizes.nv + sizes.na + sizes.nsensordata),
        }
    }

    /// Takes worlds from the lanes of a block, each into `share` lanes; the lanes that are left repeat the first.
    fn fill(&mut self, model: &KernelModel<L::Real>, from: &Block<L>, lanes: std::ops::Range<usize>, share: usize) {
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

    /// The nominal states again.
    fn rewind(&mut self) {
        (0..State::<L>::COUNT).for_each(|n| self.block.state.field_mut(n).copy_from_slice(self.nominal.field(n)));
    }

    /// Perturbs in each lane the column that is given for it, by `eps`.
    fn perturb(&mut self, model: &KernelModel<L::Real>, kind: Kind, columns: &[Option<usize>], eps: f64) {
        let Cloud { block, nominal, tangent, .. } = self;
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
                displace(model, &nominal.qpos, tangent, &mut block.state.qpos);
            }
            Kind::Velocity => columns.for_each(|(lane, column)| add(&mut block.state.qvel[column], lane)),
            Kind::Actuation => columns.for_each(|(lane, column)| match column.checked_sub(na) {
                None => add(&mut block.state.act[column], lane),
                Some(control) => add(&mut block.state.ctrl[control], lane),
            }),
        }
    }

    /// Derivatives of the lanes in which the column was perturbed to the sides that are given: differences of ends by their distance.
    fn differentiate(&mut self, model: &KernelModel<L::Real>, [plus, minus]: [u32; 2], eps: f64) {
        let Cloud { ends: [nominal, to, from], slopes, .. } = self;
        let [forward, backward] = [plus, minus].map(L::mask_of);
        let (eps, both) = (L::of(eps), L::mask_of(plus & minus));
        let distance = L::select(both, eps + eps, eps);
        let choose = |mask: L::Mask, own: &mut Vec<L>, nominal: &[L]| {
            own.iter_mut().zip(nominal).for_each(|(own, nominal)| *own = L::select(mask, *own, *nominal));
        };
        for (mask, end) in [(forward, &mut *to), (backward, &mut *from)] {
            choose(mask, &mut end.qpos, &nominal.qpos);
            choose(mask, &mut end.qvel, &nominal.qvel);
            choose(mask, &mut end.act, &nominal.act);
            choose(mask, &mut end.sensordata, &nominal.sensordata);
        }
        let (positions, others) = slopes.split_at_mut(nominal.qvel.len());
        difference(model, &from.qpos, &to.qpos, positions);
        let of =
            |end: &End<L>| [&end.qvel, &end.act, &end.sensordata].into_iter().flatten().copied().collect::<Vec<L>>();
        for (slope, (to, from)) in others.iter_mut().zip(of(to).into_iter().zip(of(from))) {
            *slope = to - from;
        }
        slopes.iter_mut().for_each(|slope| *slope = *slope / distance);
    }
}

impl Kind {
    /// In the order in which they are gone through: none changes what the next ones take over from the nominal states.
    const ALL: [Kind; 3] = [Kind::Actuation, Kind::Velocity, Kind::Position];

    /// How many columns there are, and the first of them among all.
    fn columns(self, shape: &Shape) -> (usize, usize) {
        match self {
            Kind::Position => (shape.nv, 0),
            Kind::Velocity => (shape.nv, shape.nv),
            Kind::Actuation => (shape.na + shape.nu, 2 * shape.nv),
        }
    }
}

/// To which sides a control can be perturbed without leaving its range: forward, backward.
fn sides<T: Real>(actuator: &Actuator<T>, control: f64, eps: f64) -> [bool; 2] {
    let [low, high] = actuator.ctrl_range.map(T::to_f64);
    let inside = |x: f64| !actuator.ctrl_limited || (low..=high).contains(&x);
    [inside(control) && inside(control + eps), inside(control) && inside(control - eps)]
}

/// Lanes for each of `count` worlds, such that the fewest evaluations are needed; of equal ones the most, where lanes have most in common.
fn share(width: usize, count: usize, shape: &Shape) -> usize {
    let rounds = |share: usize| {
        let columns = Kind::ALL.iter().map(|kind| kind.columns(shape).0.div_ceil(share)).sum::<usize>();
        (1 + 2 * columns) * count.div_ceil(width / share)
    };
    let shares = std::iter::successors(Some(width), |share| (share % 2 == 0).then_some(share / 2));
    shares.min_by_key(|share| rounds(*share)).unwrap_or(1)
}

impl<L: LaneQuery<Real: Tables>> Batch<L> {
    /// Writes every world's derivatives: of the next state and, if they are wanted, of sensors by the state and by controls, how each
    /// column was perturbed, and the status of the worlds. NaN where there are none.
    pub(super) fn cloud(&mut self, request: &Request<'_>, rows: Vec<Rows<'_>>) {
        let shape = Shape::new(&self.crew.model, request.scheme.sensors);
        let columns = (2 * shape.states() + shape.nu) as f64;
        let pace = columns * self.crew.paces.step.get();
        let _ = self.each(1, pace, rows, request.cancel, |crew, Job { worlds, group, rows, .. }, worker| {
            for block in group.blocks() {
                let before = block.status;
                crew.guard(block, worker, |block, worker| crew.cloud_block(request, &shape, rows, block, worker));
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
        request: &Request<'_>,
        shape: &Shape,
        rows: &mut [Rows<'_>],
        block: &mut Block<L>,
        worker: &mut Worker<L>,
    ) {
        let count = block.ids.len();
        let share = share(L::WIDTH, count, shape);
        let worlds = L::WIDTH / share;
        let mut cloud = worker.cloud.take().unwrap_or_else(|| Box::new(Cloud::new(&self.tables)));
        for first in (0..count).step_by(worlds) {
            let lanes = first..count.min(first + worlds);
            cloud.fill(&self.tables, block, lanes.clone(), share);
            let work = Work { request, shape, share, ids: &block.ids[lanes] };
            let alive = cloud.spread(block.status.alive >> first, &work);
            self.cloud_of(&work, alive, rows, &mut cloud, worker);
        }
        worker.cloud = Some(cloud);
    }

    /// The cloud of the worlds that a block was filled with, of which those of `alive` can be stepped.
    fn cloud_of(
        &self,
        work: &Work<'_>,
        alive: u32,
        rows: &mut [Rows<'_>],
        cloud: &mut Cloud<L>,
        worker: &mut Worker<L>,
    ) {
        let mut events = BlockStatus { alive, ..BlockStatus::default() };
        cloud.rewind();
        let Block { state, applied, .. } = &cloud.block;
        let bad = diagnosis::inspect(&self.tables, state, applied.as_deref(), &mut events);
        bad.iter().for_each(|(status, lanes)| events.record(*status, *lanes));
        let bad = bad.iter().fold(0, |bad, (_, lanes)| bad | lanes);
        // A rotation by no quaternion has no neighbours.
        let nowhere = events.lanes(Status::QUAT_ZERO);
        let alive = self.end_of(work, None, alive & !bad & !nowhere, (cloud, worker), &mut events);
        // Columns start from what constraints add to the nominal acceleration.
        let Cloud { block, nominal, .. } = &mut *cloud;
        nominal.qacc_warmstart.copy_from_slice(&block.state.qacc_warmstart);
        for kind in Kind::ALL {
            let count = kind.columns(work.shape).0;
            for first in (0..count).step_by(work.share) {
                let columns = work.columns::<L>(first, count);
                self.columns_of(work, kind, &columns, alive, rows, (cloud, worker), &mut events);
            }
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

    /// Derivatives by one column of a kind in each lane.
    #[expect(clippy::too_many_arguments, reason = "what it reads, where it writes, and what it works with")]
    fn columns_of(
        &self,
        work: &Work<'_>,
        kind: Kind,
        columns: &[Option<usize>],
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
                let Some(control) = column.and_then(|column| column.checked_sub(work.shape.na)) else { continue };
                let value = cloud.nominal.ctrl[control].get(lane).to_f64();
                let [plus, minus] = sides(&self.tables.actuators[control], value, eps);
                forward &= !(u32::from(!plus) << lane);
                backward &= !(u32::from(!minus) << lane);
            }
        }
        if !centred {
            backward &= !forward;
        }
        let mut lost = 0;
        for (end, lanes, eps) in [(PLUS, forward, eps), (MINUS, backward, -eps)] {
            if lanes != 0 {
                cloud.rewind();
                cloud.perturb(&self.tables, kind, columns, eps);
                lost |= lanes & !self.end_of(work, Some((kind, end)), lanes, (cloud, worker), events);
            }
        }
        cloud.differentiate(&self.tables, [forward, backward], eps);
        let first = kind.columns(work.shape).1;
        for (lane, column) in columns.iter().enumerate().filter(|(lane, _)| wanted >> lane & 1 != 0) {
            let Some(column) = column.map(|column| first + column) else { continue };
            let id = work.ids[lane / work.share];
            let taken = |lanes: u32| lanes >> lane & 1 != 0;
            let known = !taken(lost);
            let slopes = cloud.slopes.iter().map(|x| if known { x.get(lane).to_f64() + 0.0 } else { f64::NAN });
            work.shape.write(rows, id, column, slopes);
            work.shape.mark(rows, id, column, [taken(forward), taken(backward)]);
        }
    }

    /// Takes a step from the block's states, in the lanes of `alive`, and keeps where it ends: of nominal states or of a kind of column, to
    /// one side. Returns the lanes that came to an end.
    fn end_of(
        &self,
        work: &Work<'_>,
        of: Option<(Kind, usize)>,
        alive: u32,
        (cloud, worker): (&mut Cloud<L>, &mut Worker<L>),
        events: &mut BlockStatus,
    ) -> u32 {
        let Cloud { block: Block { state, applied, varied, .. }, ends, .. } = cloud;
        let sensors = work.request.scheme.sensors;
        let mut plan = Plan::step(&[]);
        if sensors {
            plan.stages = plan.stages | Stages::up_to(Stage::Sensor);
        }
        let start = of.map_or(Start::Position, |(kind, _)| kind.start(&self.tables));
        plan.stages = start.within(plan.stages, &self.tables);
        // Columns read what the nominal evaluation leaves.
        plan.derived = sensors || of.is_none();
        let mut status = BlockStatus { alive, ..BlockStatus::default() };
        let mut run = self.run(&plan, (applied.as_deref(), varied.as_deref()), worker.code.as_mut());
        let solved = pipeline::forward(&self.tables, state, &mut run, &mut status, &mut worker.workspace);
        let end = &mut ends[of.map_or(NOMINAL, |(_, end)| end)];
        if sensors {
            end.sensordata.copy_from_slice(&worker.workspace.sensors.data);
        }
        step::advance(&self.tables, state, &mut run, &mut status, solved, &mut worker.workspace);
        end.qpos.copy_from_slice(&state.qpos);
        end.qvel.copy_from_slice(&state.qvel);
        end.act.copy_from_slice(&state.act);
        Status::NAMES.iter().for_each(|(name, _)| events.record(*name, status.lanes(*name) & alive));
        let unfinished = if work.request.strict { status.lanes(Status::NOT_CONVERGED) } else { 0 };
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
    fn columns<L: LaneQuery>(&self, first: usize, count: usize) -> Vec<Option<usize>> {
        let column = |lane: usize| {
            let column = first + lane % self.share;
            (column < count && lane / self.share < self.ids.len()).then_some(column)
        };
        (0..L::WIDTH).map(column).collect()
    }
}

impl<L: LaneQuery> Cloud<L> {
    /// The lanes of worlds that are bits of `alive`.
    fn spread(&self, alive: u32, work: &Work<'_>) -> u32 {
        let lanes = 0..work.ids.len() * work.share;
        lanes.fold(0, |bits, lane| bits | (alive >> (lane / work.share) & 1) << lane)
    }
}
