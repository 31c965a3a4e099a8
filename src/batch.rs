//! The engine behind [`Worlds`](crate::Worlds): blocks of one lane type, and the workers that take them through steps.

mod cloud;
mod crew;
mod inverse;

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::model::{Quantities, Quantity, Varied};
use lanesim_kernels::state::Status;
use lanesim_kernels::workspace::Workspace;

use crate::block::Block;
use crate::cloud::request::Request;
use crate::cloud::visit::Visit;
use crate::error::Error;
use crate::field::{Field, Home};
use crate::group;
use crate::memory;
use crate::model::{Key, Model};
use crate::options::{Options, Tables};
use crate::outputs::Output;
use crate::pace::{self, Paces};
use crate::parameters;
use crate::plan::Plan;
use crate::pool::Pool;
use crate::rollout::{Rollout, Trajectories};
use crate::rows::{Rows, Strided};
use crate::status::First;
use crate::store::Store;

pub(crate) use crew::WorkerCode;
use crew::{Crew, Job, Seat, Worker};

/// What [`Worlds`](crate::Worlds) needs of a batch, whatever its lane type.
pub(crate) trait Engine: Send {
    fn nworld(&self) -> usize;
    fn threads(&self) -> usize;
    fn lanes(&self) -> (usize, &'static str);
    fn set(&mut self, field: Field, world: usize, values: &[f64]);
    fn get(&self, field: Field, world: usize) -> Vec<f64>;
    fn status(&self, world: usize) -> Status;
    fn any_frozen(&self) -> bool;
    fn firsts(&self, world: usize) -> Vec<First>;
    fn set_status(&mut self, world: usize, status: Status);
    fn reset(&mut self, world: usize, key: &Key);
    fn reset_all(&mut self, mask: Option<&[bool]>, key: &Key);
    fn write_all(&mut self, field: Field, rows: &Strided<'_>, mask: Option<&[bool]>);
    /// An error if `field` is a force from outside and there is no memory for that of so many worlds.
    fn ask_for_forces(&self, field: Field, nworld: usize) -> Result<(), Error>;
    fn read_all(&mut self, outputs: &[Output], rows: Vec<Rows<'_>>, cancel: Option<&AtomicBool>);
    fn rollout(&mut self, rollout: &Rollout<'_>, rows: Vec<Rows<'_>>) -> Trajectories;
    fn inverse(&mut self, qacc: &Strided<'_>, rows: Rows<'_>, cancel: Option<&AtomicBool>);
    fn cloud(&mut self, request: &Request<'_>, rows: Vec<Rows<'_>>);
    fn points(&mut self, visit: &Visit<'_>, rows: Vec<Rows<'_>>);
    /// Does `work` on an engine that has only these worlds, in this order, and puts them back where they were.
    fn among(&mut self, ids: &[usize], work: &mut dyn FnMut(&mut dyn Engine)) -> Result<(), Error>;
    fn vary(&mut self, set: Quantities) -> Result<(), Error>;
    fn put(&mut self, quantity: Quantity, world: usize, values: &[f64]);
    fn state_hash(&self) -> u64;
    fn memory(&self) -> (usize, usize);
}

/// Blocks of lane type `L`, and who takes them through steps.
pub(crate) struct Batch<L: LaneQuery> {
    store: Store<L>,
    crew: Crew<L>,
}

impl<L: LaneQuery<Real: Tables>> Batch<L> {
    /// `nworld` worlds; those that diverge start again from `restart`, if it is given. `code` is asked for every thread's.
    pub fn new(
        model: &Model,
        nworld: usize,
        code: impl Fn() -> WorkerCode<L> + Send + Sync + 'static,
        pool: Arc<Pool>,
        options: &Options,
        restart: Option<Key>,
    ) -> Result<Self, Error> {
        let tables = L::Real::tables(model).clone();
        let blocks = nworld.div_ceil(L::WIDTH);
        let needs = (Store::<L>::block_bytes(&tables.sizes), Workspace::<L>::bytes(&tables));
        memory::check_batch((blocks, needs.0), (pool.threads().min(blocks), needs.1), options.max_memory)?;
        let store = Store::new(&tables, nworld)?;
        let crew = Crew {
            nworld,
            chosen: None,
            max_contacts: options.max_contacts,
            varying: (Quantities::NONE, 0),
            restart,
            steps: 0,
            seats: (0..pool.threads()).map(|_| Mutex::default()).collect(),
            pool,
            code: Box::new(code),
            paces: Paces::new(&tables.sizes),
            model: model.clone(),
            tables,
        };
        crew.seat(0).map(drop)?;
        Ok(Batch { store, crew })
    }

    /// Bytes of a world and of a thread's scratch.
    pub fn memory_of(model: &Model) -> (usize, usize) {
        let tables = L::Real::tables(model);
        (Store::<L>::block_bytes(&tables.sizes) / L::WIDTH, Workspace::<L>::bytes(tables))
    }

    /// Does `work` for all blocks, at most `size` at a time, and fewer towards the end, so that the threads end together; on the
    /// caller's thread alone unless all should take longer than waking others, by `pace`, nanoseconds for a block. Each of
    /// `rows` is an array of equally many entries per world; a group of blocks gets those of its worlds. Once `cancel` is true,
    /// no more blocks are begun. Returns nanoseconds for a block, as measured.
    fn each(
        &mut self,
        size: usize,
        pace: f64,
        mut rows: Vec<Rows<'_>>,
        cancel: Option<&AtomicBool>,
        work: impl Fn(&Crew<L>, &mut Job<'_, L>, &mut Worker<L>) + Sync,
    ) -> f64 {
        let Batch { store, crew } = self;
        let widths: Vec<usize> = rows.iter().map(|rows| rows.len().checked_div(crew.nworld).unwrap_or(0)).collect();
        let blocks = store.kept.len();
        let helpers = pace::helpers(pace, blocks).min(crew.pool.threads() - 1);
        let threads = helpers + 1;
        let share = |left: usize| if threads == 1 { size } else { size.min(left / (2 * threads)).max(1) };
        let mut first_world = 0;
        let shares = store.groups(share).map(|blocks| {
            let first = first_world;
            let worlds = (blocks.1.len() * L::WIDTH).min(crew.nworld - first);
            first_world += worlds;
            let rows: Vec<_> = rows.iter_mut().zip(&widths).map(|(rows, width)| rows.take(worlds * width)).collect();
            (first, worlds, blocks, rows)
        });
        let (queue, spent) = (Mutex::new(shares), AtomicU64::new(0));
        let crew = &*crew;
        crew.pool.run(helpers, |thread| {
            // The caller has a seat; a helper for whom there is no memory does not help.
            let Ok(mut seat) = crew.seat(thread) else { return };
            let Some(Seat { worker, group }) = seat.as_mut() else { return };
            let start = Instant::now();
            while !cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed)) {
                // A statement of its own: the queue is locked only while the next block is taken.
                let next = queue.lock().unwrap_or_else(PoisonError::into_inner).next();
                let Some((first_world, worlds, (states, kept), rows)) = next else { break };
                group.fit(&crew.tables, kept.len());
                group.load(states, kept, worlds);
                work(crew, &mut Job { first_world, worlds, group: &mut *group, rows }, worker);
                group.store(states, kept);
            }
            spent.fetch_add(start.elapsed().as_nanos() as u64, Ordering::Relaxed);
        });
        spent.into_inner() as f64 / blocks.max(1) as f64
    }
}

impl<L: LaneQuery<Real: Tables>> Batch<L> {
    /// Does `work` for every lane that has a world for which the mask holds, with the world's number.
    fn each_lane(&mut self, mask: Option<&[bool]>, work: impl Fn(&Crew<L>, &mut Block<L>, usize, usize) + Sync) {
        let pace = self.crew.paces.copy.get();
        let spent = self.each(1, pace, Vec::new(), None, |crew, Job { first_world, group, .. }, _| {
            for block in group.blocks() {
                for lane in 0..block.ids.len() {
                    let world = *first_world + block.ids[lane];
                    if mask.is_none_or(|mask| mask[world]) {
                        work(crew, block, lane, world);
                    }
                }
            }
        });
        self.crew.paces.copy.note(spent);
    }
}

impl<L: LaneQuery<Real: Tables>> Engine for Batch<L> {
    fn nworld(&self) -> usize {
        self.crew.nworld
    }

    fn threads(&self) -> usize {
        self.crew.pool.threads()
    }

    fn lanes(&self) -> (usize, &'static str) {
        (L::WIDTH, L::NAME)
    }

    fn set(&mut self, field: Field, world: usize, values: &[f64]) {
        self.store.set(field, &self.crew.tables.sizes, world, values);
    }

    fn get(&self, field: Field, world: usize) -> Vec<f64> {
        self.store.get(field, &self.crew.tables.sizes, world)
    }

    fn status(&self, world: usize) -> Status {
        self.store.status(world)
    }

    fn any_frozen(&self) -> bool {
        self.store.any_frozen(self.crew.nworld)
    }

    fn firsts(&self, world: usize) -> Vec<First> {
        let firsts = &self.store.kept[world / L::WIDTH].firsts;
        firsts.iter().filter(|first| first.lane == world % L::WIDTH).copied().collect()
    }

    fn reset(&mut self, world: usize, key: &Key) {
        let Ok(mut seat) = self.crew.seat(0) else { return };
        let Some(Seat { group, .. }) = seat.as_mut() else { return };
        self.store.change(world, group.scratch(), |block, lane| block.reset(&self.crew.tables.sizes, lane, key));
    }

    fn reset_all(&mut self, mask: Option<&[bool]>, key: &Key) {
        self.each_lane(mask, |crew, block, lane, _| block.reset(&crew.tables.sizes, lane, key));
    }

    fn set_status(&mut self, world: usize, status: Status) {
        let kept = &mut self.store.kept[world / L::WIDTH];
        kept.status.set_lane(world % L::WIDTH, status);
        kept.firsts.retain(|first| first.lane != world % L::WIDTH);
    }

    fn ask_for_forces(&self, field: Field, nworld: usize) -> Result<(), Error> {
        match field.home() {
            Home::Applied(_) => self.store.ask_for_forces(&self.crew.tables.sizes, nworld),
            Home::State(_) => Ok(()),
        }
    }

    fn write_all(&mut self, field: Field, rows: &Strided<'_>, mask: Option<&[bool]>) {
        self.each_lane(mask, |crew, block, lane, world| {
            block.set_row(field, &crew.tables.sizes, lane, rows, world);
        });
    }

    fn read_all(&mut self, outputs: &[Output], rows: Vec<Rows<'_>>, cancel: Option<&AtomicBool>) {
        let plan = Plan::forward(outputs);
        let pace = self.crew.paces.read(&plan).get();
        let spent = self.each(1, pace, rows, cancel, |crew, Job { group, rows, .. }, worker| {
            for block in group.blocks() {
                crew.guard(block, worker, |block, worker| crew.read_block(outputs, &plan, rows, block, worker));
            }
        });
        if !cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed)) {
            self.crew.paces.read(&plan).note(spent);
        }
    }

    fn rollout(&mut self, rollout: &Rollout<'_>, rows: Vec<Rows<'_>>) -> Trajectories {
        let mut plan = Plan::step(rollout.outputs);
        plan.residual |= rollout.statistics;
        self.crew.clear();
        let tables = &self.crew.tables;
        let bytes = Store::<L>::block_bytes(&tables.sizes) + self.crew.varying.1 * size_of::<L>();
        let size = group::size(tables, bytes, rollout.nstep);
        let steps = rollout.nstep as f64;
        let pace = steps * self.crew.paces.step.get();
        let spent = self
            .each(size, pace, rows, rollout.cancel, |crew, job, worker| crew.run_group(rollout, &plan, job, worker));
        if rollout.nstep > 0 && !rollout.cancelled() {
            self.crew.paces.step.note(spent / steps);
        }
        self.crew.steps += rollout.nstep as u64;
        self.crew.collect()
    }

    fn inverse(&mut self, qacc: &Strided<'_>, rows: Rows<'_>, cancel: Option<&AtomicBool>) {
        self.invert(qacc, rows, cancel);
    }

    fn cloud(&mut self, request: &Request<'_>, rows: Vec<Rows<'_>>) {
        self.cloud(request, rows);
    }

    fn points(&mut self, visit: &Visit<'_>, rows: Vec<Rows<'_>>) {
        self.visit(visit, rows);
    }

    fn among(&mut self, ids: &[usize], work: &mut dyn FnMut(&mut dyn Engine)) -> Result<(), Error> {
        if ids.is_empty() {
            return Ok(());
        }
        let part = self.store.gather(&self.crew.tables.sizes, ids)?;
        let whole = std::mem::replace(&mut self.store, part);
        let nworld = std::mem::replace(&mut self.crew.nworld, ids.len());
        self.crew.chosen = Some(ids.to_vec());
        work(self);
        self.crew.chosen = None;
        self.crew.nworld = nworld;
        let part = std::mem::replace(&mut self.store, whole);
        self.store.scatter(ids, &part);
        Ok(())
    }

    fn vary(&mut self, set: Quantities) -> Result<(), Error> {
        let Batch { store, crew } = self;
        let tables = L::Real::rounded(parameters::widened(&crew.model, set));
        store.vary(&tables, set)?;
        let lanes = set.iter().map(|quantity| quantity.of(&tables).len()).sum();
        let seat = Seat::new(&tables, (crew.code)(), (set, lanes))?;
        (crew.tables, crew.varying) = (tables, (set, lanes));
        // What threads keep is for the model as it was.
        crew.seats.iter_mut().for_each(|seat| *seat = Mutex::default());
        crew.seats[0] = Mutex::new(Some(seat));
        Ok(())
    }

    fn put(&mut self, quantity: Quantity, world: usize, values: &[f64]) {
        let sizes = &self.crew.tables.sizes;
        if sizes.nguard > 0 {
            self.store.set(Field::TreeGuard, sizes, world, &vec![0.0; 15 * sizes.nguard]);
        }
        self.store.put(quantity, world, values);
    }

    fn state_hash(&self) -> u64 {
        let mut hash = Fnv::default();
        for world in 0..self.crew.nworld {
            for x in self.store.configuration(&self.crew.tables.sizes, world) {
                hash.add(x.bits());
            }
        }
        hash.0
    }

    fn memory(&self) -> (usize, usize) {
        let block = Store::<L>::block_bytes(&self.crew.tables.sizes);
        let varied = match self.crew.varying {
            (_, 0) => 0,
            (_, lanes) => lanes * size_of::<L>() + size_of::<Varied<L>>(),
        };
        ((block + varied) / L::WIDTH, Workspace::<L>::bytes(&self.crew.tables))
    }
}

/// FNV-1a over 64-bit words.
struct Fnv(u64);

impl Default for Fnv {
    fn default() -> Self {
        Fnv(0xcbf2_9ce4_8422_2325)
    }
}

impl Fnv {
    fn add(&mut self, word: u64) {
        for byte in word.to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }
}

#[cfg(test)]
mod tests {
    use wide::f64x8;

    use super::*;
    use crate::rollout::Controls;

    /// A driven hinge; `worlds` of it.
    fn batch(worlds: usize) -> Batch<f64x8> {
        let text =
            "<mujoco><worldbody><body><joint name='j' axis='0 1 0'/><geom size='.1' pos='.3 0 0'/></body></worldbody>
            <actuator><motor joint='j'/></actuator></mujoco>";
        let model = Model::from_xml_string(text, &Default::default()).expect("a model");
        let kernels = || -> WorkerCode<f64x8> { Box::new(lanesim_kernels::part::Kernels) };
        let pool = Arc::new(Pool::new(Some(2), false).expect("a pool"));
        Batch::new(&model, worlds, kernels, pool, &Options::default(), None).expect("a batch")
    }

    #[test]
    fn threads_get_a_workspace_when_they_take_part() {
        let mut batch = batch(16);
        for _ in 0..10 {
            batch.rollout(&Rollout { nstep: 1, ..Rollout::default() }, Vec::new());
        }
        let seats = batch.crew.seats.iter_mut().map(|seat| seat.get_mut().expect("a seat").is_some());
        assert_eq!(seats.collect::<Vec<_>>(), [true, false]);
    }

    #[test]
    fn a_panic_costs_its_block_only() {
        let (mut whole, mut broken) = (batch(16), batch(16));
        let run = |controls| Rollout { nstep: 5, controls, ..Rollout::default() };
        let controls = [0.3; 80];
        whole.rollout(&run(Controls::Given(&controls)), Vec::new());
        // The last world's last row is missing. The public face would not let that through.
        broken.rollout(&run(Controls::Given(&controls[..79])), Vec::new());
        for world in 0..16 {
            let status = broken.status(world);
            if world >= 8 {
                assert_eq!(status.names(), ["CallbackFailed", "Frozen"]);
                assert_eq!(broken.firsts(world).len(), 2);
            } else {
                assert_eq!(
                    (status, broken.get(Field::Qpos, world)),
                    (Status::default(), whole.get(Field::Qpos, world))
                );
            }
        }
        // The pool and the batch are as good as before.
        let key = broken.crew.model.initial_key();
        broken.reset_all(None, &key);
        broken.rollout(&run(Controls::Given(&controls)), Vec::new());
        assert_eq!(broken.get(Field::Qpos, 9), whole.get(Field::Qpos, 0));
        assert_eq!(broken.status(9), Status::default());
    }
}
