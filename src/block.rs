//! A block: as many worlds as the lane type is wide, with their state, status and forces from outside, while they are
//! worked on. In between they are in the store.

use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::math::low;
use lanesim_kernels::model::{Model, Sizes, Varied};
use lanesim_kernels::state::{Applied, BlockStatus, State, Status, copy_lane};

use crate::field::{Field, Home};
use crate::rows::Strided;
use crate::status::{Element, First};

/// Worlds side by side.
#[derive(Clone, Debug)]
pub(crate) struct Block<L> {
    pub state: State<L>,
    pub status: BlockStatus,
    /// Allocated when forces from outside are first set.
    pub applied: Option<Box<Applied<L>>>,
    /// Numbers of the model that vary; in all blocks of a batch, or in none.
    pub varied: Option<Box<Varied<L>>>,
    /// First time of each status of each lane; empty until something happens.
    pub firsts: Vec<First>,
    /// The worlds in the lanes, as numbers within what a worker has taken; the lanes after them are padding.
    pub ids: Vec<usize>,
    /// Steps taken in this run.
    pub done: usize,
}

impl<L: LaneQuery> Block<L> {
    /// Worlds in the reference configuration, at rest; none of them is stepped.
    pub fn new(model: &Model<L::Real>) -> Self {
        Block {
            state: State::initial(model),
            status: BlockStatus::default(),
            applied: None,
            varied: None,
            firsts: Vec::new(),
            ids: Vec::with_capacity(L::WIDTH),
            done: 0,
        }
    }

    /// The field's entries; allocates forces from outside.
    fn lanes(&mut self, field: Field, sizes: &Sizes) -> &mut [L] {
        match field.home() {
            Home::State(number) => self.state.field_mut(number),
            Home::Applied(number) => {
                self.applied.get_or_insert_with(|| Box::new(Applied::new(sizes))).field_mut(number)
            }
        }
    }

    /// Sets a field of one lane.
    pub fn set(&mut self, field: Field, sizes: &Sizes, lane: usize, values: &[f64]) {
        self.wake(field, lane);
        for (entry, x) in self.lanes(field, sizes).iter_mut().zip(values) {
            entry.set(lane, L::Real::from_f64(*x));
        }
        for (low, x) in self.low(field, sizes).iter_mut().zip(values) {
            low.set(lane, L::Real::from_f64(low::remainder::<L::Real>(*x)));
        }
    }

    /// Low words of a field; none if it has none.
    fn low(&mut self, field: Field, sizes: &Sizes) -> &mut [L] {
        field.low(sizes).and_then(|first| self.state.low.get_mut(first..)).unwrap_or_default()
    }

    /// Sets a field of one lane from a world's row.
    pub fn set_row(&mut self, field: Field, sizes: &Sizes, lane: usize, rows: &Strided<'_>, world: usize) {
        self.wake(field, lane);
        let entries = self.lanes(field, sizes);
        let len = entries.len();
        rows.row(world, len, |i, x| entries[i].set(lane, L::Real::from_f64(x)));
        let low = self.low(field, sizes);
        if !low.is_empty() {
            rows.row(world, len, |i, x| low[i].set(lane, L::Real::from_f64(low::remainder::<L::Real>(x))));
        }
    }

    /// Wakes the trees of a lane whose positions are set, and closes the guard's books where these or velocities are.
    fn wake(&mut self, field: Field, lane: usize) {
        if matches!(field, Field::Qpos | Field::Qvel) {
            let books = self.state.tree_guard.as_flattened_mut();
            books.iter_mut().for_each(|x| x.set(lane, L::Real::from_f64(0.0)));
        }
        if field == Field::Qpos {
            self.state.tree_rest.iter_mut().for_each(|rest| rest.set(lane, L::Real::from_f64(0.0)));
        }
    }

    /// Appends a field of one lane to `out`.
    pub fn read(&self, field: Field, sizes: &Sizes, lane: usize, out: &mut Vec<f64>) {
        let lanes = match (field.home(), &self.applied) {
            (Home::State(number), _) => self.state.field(number),
            (Home::Applied(number), Some(applied)) => applied.field(number),
            (Home::Applied(_), None) => return out.resize(out.len() + field.lanes(sizes), 0.0),
        };
        let start = out.len();
        out.extend(lanes.iter().map(|x| x.get(lane).to_f64()));
        let low = field.low(sizes).and_then(|first| self.state.low.get(first..)).unwrap_or_default();
        out[start..].iter_mut().zip(low).for_each(|(x, low)| *x += low.get(lane).to_f64());
    }

    /// Resets one lane: positions as given, the rest as given or zero, warm start, forces and status cleared.
    pub fn reset(&mut self, sizes: &Sizes, lane: usize, key: &crate::model::Key) {
        self.restart(sizes, lane, key);
        self.status.set_lane(lane, Status::default());
        self.firsts.retain(|first| first.lane != lane);
    }

    /// Resets one lane that diverged: like [`reset`](Block::reset), but the status keeps what happened. Allocates nothing.
    pub fn restart(&mut self, sizes: &Sizes, lane: usize, key: &crate::model::Key) {
        let zero = L::Real::from_f64(0.0);
        self.state.for_each(&mut |field| field.data.iter_mut().for_each(|x| x.set(lane, zero)));
        if let Some(applied) = &mut self.applied {
            applied.for_each(&mut |field| field.data.iter_mut().for_each(|x| x.set(lane, zero)));
        }
        for (field, _) in Field::ALL {
            key.field(field).into_iter().for_each(|values| self.set(field, sizes, lane, values));
        }
        let mut status = self.status.lane(lane);
        status.remove(Status::FROZEN);
        self.status.set_lane(lane, status);
    }

    /// Keeps, for every status that is set now and was not `before`, that it was first set in `step`, and where.
    pub fn note(&mut self, before: &BlockStatus, step: u64, element: &dyn Fn(&Self, Status, usize) -> Element) {
        for (i, (status, _)) in Status::NAMES.into_iter().enumerate() {
            let mut new = self.status.events[i] & !before.events[i];
            while new != 0 {
                let lane = new.trailing_zeros() as usize;
                new &= new - 1;
                let element = element(self, status, lane);
                self.firsts.push(First { lane, status, step, element });
            }
        }
    }

    /// Calls `f` with the lanes of every field.
    pub fn for_each(&mut self, f: &mut dyn FnMut(&mut [L])) {
        self.state.for_each(&mut |field| f(field.data));
        if let Some(applied) = &mut self.applied {
            applied.for_each(&mut |field| f(field.data));
        }
        if let Some(varied) = &mut self.varied {
            varied.for_each(f);
        }
    }

    /// Freezes all worlds, because code that their step called has failed.
    pub fn fail(&mut self, step: u64) {
        let before = self.status;
        self.status.record(Status::CALLBACK_FAILED, before.alive);
        self.status.record(Status::FROZEN, before.alive);
        self.status.alive = 0;
        self.note(&before, step, &|_, _, _| Element::World);
    }

    /// Lets padding lanes replicate lane 0, so that they never hold anything unusual.
    pub fn pad(&mut self) {
        for lane in self.ids.len()..L::WIDTH {
            copy_lane(&mut self.state, 0, lane);
        }
    }
}
