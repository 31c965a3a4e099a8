//! Points of clouds: of every world, what follows from states that are moved in some columns at once.
//!
//! A block holds some worlds, each in as many lanes, as for derivatives; each lane of a world has a point of its own. Points come kind by
//! kind, those first that take over most of what was found for the nominal states.

use std::sync::atomic::Ordering;

use lanesim_kernels::integration::{difference, displace};
use lanesim_kernels::inverse::Inverse;
use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::state::{Applied, BlockStatus, Status};

use super::super::{Batch, Crew, Job, Worker};
use super::{Cloud, LANES, NOMINAL, PLUS, Work, share, sides};
use crate::block::Block;
use crate::cloud::request::{Of, Shape};
use crate::cloud::times::Kind;
use crate::cloud::visit::Visit;
use crate::options::Tables;
use crate::rows::Rows;

/// Places among the rows, those of `Found`.
const AFTER: usize = 0;
const BEFORE: usize = 1;
const CHANGED: usize = 2;
const SIDES: usize = 3;
const STATUS: usize = 4;

impl<L: LaneQuery<Real: Tables>> Batch<L> {
    /// Writes what follows from every world's points, the points, how many rows began or ceased to act there, how columns can be moved, and
    /// what happened; what has no room is not wanted.
    pub(in crate::batch) fn visit(&mut self, visit: &Visit<'_>, rows: Vec<Rows<'_>>) {
        let shape = Shape::new(&self.crew.model, visit.request.of, visit.request.scheme.sensors);
        let pace = visit.points.len() as f64 * self.crew.paces.step.get();
        let request = &visit.request;
        let _ = self.each(1, pace, rows, request.cancel, |crew, Job { first_world, worlds, group, rows }, worker| {
            for block in group.blocks() {
                let before = block.status;
                crew.guard(block, worker, |block, worker| {
                    crew.visit_block((visit, &shape, *first_world), rows, block, worker);
                });
                if block.status != before {
                    block.ids.iter().for_each(|id| lose(visit, rows, *id, block.status.lane(0)));
                }
            }
            if let Some(progress) = request.progress {
                progress.fetch_add(*worlds as u64, Ordering::Relaxed);
            }
        });
    }
}

/// Writes that nothing follows from a world's points.
fn lose(visit: &Visit<'_>, rows: &mut [Rows<'_>], world: usize, status: Status) {
    let width = visit.points.len() * visit.widths[AFTER];
    put(&mut rows[AFTER], world * width, &vec![f64::NAN; width]);
    put(&mut rows[STATUS], world, &[f64::from(status.0)]);
}

/// Writes numbers, if they are wanted.
fn put(rows: &mut Rows<'_>, at: usize, numbers: &[f64]) {
    if !rows.is_empty() {
        rows.write(at, numbers);
    }
}

/// In each lane the point that it has.
type Own = [Option<usize>; LANES];

/// What the columns of controls and forces are, and to which sides each lane's controls can be moved.
struct Bounds {
    first_control: usize,
    first_force: usize,
    sides: Vec<[[bool; 2]; LANES]>,
}

impl Bounds {
    /// A distance along a column as a lane has to take it.
    fn distance(&self, lane: usize, column: usize, distance: f64) -> f64 {
        let control = column.checked_sub(self.first_control).and_then(|control| self.sides.get(control));
        let [plus, minus] = control.map_or([true; 2], |lanes| lanes[lane]);
        let (own, other) = if distance > 0.0 { (plus, minus) } else { (minus, plus) };
        match (own, other) {
            (true, _) => distance,
            (false, true) => -distance,
            (false, false) => 0.0,
        }
    }

    /// How a lane's column can be moved.
    fn mark(&self, lane: usize, column: usize) -> f64 {
        let control = column.checked_sub(self.first_control).and_then(|control| self.sides.get(control));
        match control.map_or([true; 2], |lanes| lanes[lane]) {
            [true, true] => 2.0,
            [true, false] => 1.0,
            [false, true] => -1.0,
            [false, false] => 0.0,
        }
    }
}

impl<L: LaneQuery> Cloud<L> {
    /// Moves the nominal states to the points that the lanes have; `forces` are those of the nominal ones, `accelerations` those of inverse
    /// dynamics.
    fn displace(
        &mut self,
        visit: &Visit<'_>,
        model: &lanesim_kernels::model::Model<L::Real>,
        (kind, own, bounds): (Kind, &Own, &Bounds),
        (forces, accelerations): (&[L], &mut [L]),
    ) {
        let Cloud { block: Block { state, applied, .. }, nominal, tangent, .. } = self;
        let (nv, na) = (model.sizes.nv, model.sizes.na);
        tangent.fill(L::zero());
        if let Some(applied) = applied.as_deref_mut().filter(|_| visit.forces) {
            applied.qfrc_applied.copy_from_slice(forces);
        }
        let add = |to: &mut L, lane: usize, distance: f64| {
            let sum = *to + L::splat(L::Real::from_f64(distance));
            to.set(lane, sum.get(lane));
        };
        for (lane, point) in own.iter().enumerate() {
            let Some(point) = point else { continue };
            for (column, distance) in visit.points.moves(*point) {
                let distance = bounds.distance(lane, *column, *distance);
                let number = match (column / nv.max(1), visit.request.of) {
                    (0, _) => &mut tangent[*column],
                    (1, _) => &mut state.qvel[column - nv],
                    (_, Of::Inverse) => &mut accelerations[column - 2 * nv],
                    _ if *column < 2 * nv + na => &mut state.act[column - 2 * nv],
                    _ if *column < bounds.first_force => &mut state.ctrl[column - bounds.first_control],
                    _ => match applied.as_deref_mut() {
                        Some(applied) => &mut applied.qfrc_applied[column - bounds.first_force],
                        None => continue,
                    },
                };
                add(number, lane, distance);
            }
        }
        if kind == Kind::Position {
            displace(model, &nominal.qpos, tangent, &mut state.qpos);
        }
    }
}

impl<L: LaneQuery<Real: Tables>> Crew<L> {
    fn visit_block(
        &self,
        (visit, shape, first_world): (&Visit<'_>, &Shape, usize),
        rows: &mut [Rows<'_>],
        block: &mut Block<L>,
        worker: &mut Worker<L>,
    ) {
        let count = block.ids.len();
        let share = share(L::WIDTH, count, |share| visit.evaluations(share));
        let worlds = L::WIDTH / share;
        let mut cloud = worker.cloud.take().unwrap_or_else(|| Box::new(Cloud::new(&self.tables)));
        for first in (0..count).step_by(worlds) {
            let lanes = first..count.min(first + worlds);
            cloud.fill(&self.tables, block, lanes.clone(), share);
            if visit.forces {
                cloud.block.applied.get_or_insert_with(|| Box::new(Applied::new(&self.tables.sizes)));
            }
            let work = Work { request: &visit.request, shape, share, ids: &block.ids[lanes] };
            cloud.give(&visit.request, first_world, &work);
            let alive = cloud.spread(block.status.alive >> first, &work);
            self.visit_of(visit, &work, alive, rows, (&mut cloud, worker));
        }
        worker.cloud = Some(cloud);
    }

    /// The points of the worlds that a block was filled with, of which those of `alive` can be stepped.
    fn visit_of(
        &self,
        visit: &Visit<'_>,
        work: &Work<'_>,
        alive: u32,
        rows: &mut [Rows<'_>],
        (cloud, worker): (&mut Cloud<L>, &mut Worker<L>),
    ) {
        let mut events = BlockStatus { alive, ..BlockStatus::default() };
        let alive = self.nominal_of(work, alive, (cloud, worker), &mut events);
        let bounds = self.bounds(visit, cloud);
        let forces = cloud.block.applied.as_ref().map_or(Vec::new(), |applied| applied.qfrc_applied.clone());
        for (kind, points) in &visit.order {
            for own in points.chunks(work.share) {
                self.points_of(
                    (visit, work, &bounds),
                    (*kind, own, alive),
                    &forces,
                    rows,
                    (cloud, worker),
                    &mut events,
                );
            }
        }
        for (i, id) in work.ids.iter().enumerate() {
            let lanes = i * work.share..(i + 1) * work.share;
            let status = Status(lanes.clone().fold(0, |bits, lane| bits | events.lane(lane).0));
            let columns = visit.widths[2];
            let marks: Vec<_> = (0..columns).map(|column| bounds.mark(lanes.start, column)).collect();
            put(&mut rows[SIDES], id * columns, &marks);
            put(&mut rows[STATUS], *id, &[f64::from(status.0)]);
            if alive >> lanes.start & 1 == 0 {
                lose(visit, rows, *id, status);
            }
        }
    }

    /// To which sides controls can be moved.
    fn bounds(&self, visit: &Visit<'_>, cloud: &Cloud<L>) -> Bounds {
        let sizes = &self.tables.sizes;
        let first_control = 2 * sizes.nv + sizes.na;
        let of = |(own, control): (_, &L)| {
            let mut lanes = [[true; 2]; LANES];
            if let Some(reach) = visit.reach {
                let all = lanes.iter_mut().take(L::WIDTH).enumerate();
                all.for_each(|(lane, free)| *free = sides(own, control.get(lane).to_f64(), reach));
            }
            lanes
        };
        let controls = if visit.request.of == Of::Inverse { 0 } else { sizes.nu };
        let sides = self.tables.controls.iter().zip(&cloud.nominal.ctrl).take(controls).map(of).collect();
        Bounds { first_control, first_force: first_control + sizes.nu, sides }
    }

    /// One point of a kind in each lane of a world, as many as it has.
    fn points_of(
        &self,
        (visit, work, bounds): (&Visit<'_>, &Work<'_>, &Bounds),
        (kind, points, alive): (Kind, &[usize], u32),
        forces: &[L],
        rows: &mut [Rows<'_>],
        (cloud, worker): (&mut Cloud<L>, &mut Worker<L>),
        events: &mut BlockStatus,
    ) {
        let mut own: Own = [None; LANES];
        let used = own.iter_mut().enumerate().take(work.ids.len() * work.share);
        used.for_each(|(lane, own)| *own = points.get(lane % work.share).copied());
        let wanted =
            own.iter().enumerate().fold(0, |bits, (lane, own)| bits | u32::from(own.is_some()) << lane) & alive;
        let inverse = worker.inverse.get_or_insert_with(|| Inverse::new(&self.tables.sizes));
        cloud.rewind();
        inverse.given.copy_from_slice(&cloud.given);
        cloud.displace(visit, &self.tables, (kind, &own, bounds), (forces, &mut inverse.given));
        let at = |lane: usize, point: usize| work.ids[lane / work.share] * visit.points.len() + point;
        let each = |rows: &mut Rows<'_>, parts: &[&[L]], width: usize, known: u32| {
            if rows.is_empty() {
                return;
            }
            for (lane, point) in own.iter().enumerate().filter_map(|(lane, own)| Some((lane, (*own)?))) {
                let numbers = parts.iter().copied().flatten().map(|x| x.get(lane).to_f64() + 0.0);
                let known = known >> lane & 1 != 0;
                rows.fill(at(lane, point) * width, width, numbers.map(|x| if known { x } else { f64::NAN }));
            }
        };
        let state = &cloud.block.state;
        let given: &[L] = if visit.request.of == Of::Inverse { &inverse.given } else { &[] };
        let before = [&state.qpos[..], &state.qvel, &state.act, &state.ctrl, given];
        each(&mut rows[BEFORE], &before, visit.widths[BEFORE], alive);
        let done = self.evaluate(&visit.request, Some((kind, PLUS)), wanted, (cloud, worker), events);
        if !rows[CHANGED].is_empty() {
            let mut changed = [0; LANES];
            let [nominal, acting] = &cloud.acting;
            nominal.compare(acting, wanted, &mut changed);
            let all = own.iter().enumerate().filter_map(|(lane, own)| Some((lane, (*own)?)));
            all.for_each(|(lane, point)| rows[CHANGED].write(at(lane, point), &[f64::from(changed[lane])]));
        }
        let Cloud { ends, tangent, .. } = cloud;
        let [mut positions, others] = ends[PLUS].numbers();
        if visit.tangent && !positions.is_empty() {
            difference(&self.tables, ends[NOMINAL].numbers()[0], positions, tangent);
            positions = tangent;
        }
        each(&mut rows[AFTER], &[positions, others], visit.widths[AFTER], done);
    }
}
