//! The engine behind [`Worlds`](crate::Worlds): blocks of one lane type, and the workers that take them through steps.

use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};

use lanesim_kernels::constraint::{Cone, DofRowKind};
use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::model::Model as KernelModel;
use lanesim_kernels::pipeline::{self, Run, StageClock};
use lanesim_kernels::state::{Status, state_len};
use lanesim_kernels::workspace::Workspace;

use crate::block::Block;
use crate::convex::SupportCollider;
use crate::model::{Key, Model};
use crate::noise;
use crate::outputs::{Output, View};
use crate::pool::Pool;
use crate::rollout::{Controls, Rollout, Statistics, Trajectories};
use crate::rows::{Rows, Strided};
use crate::worlds::{Field, Tables};

/// What [`Worlds`](crate::Worlds) needs of a batch, whatever its lane type.
pub(crate) trait Engine: Send {
    fn nworld(&self) -> usize;
    fn threads(&self) -> usize;
    fn lanes(&self) -> (usize, &'static str);
    fn set(&mut self, field: Field, world: usize, values: &[f64]);
    fn get(&self, field: Field, world: usize) -> Vec<f64>;
    fn status(&self, world: usize) -> Status;
    fn set_status(&mut self, world: usize, status: Status);
    fn reset(&mut self, world: usize, key: &Key);
    fn write_all(&mut self, field: Field, rows: &Strided<'_>, mask: Option<&[bool]>);
    fn read_all(&mut self, outputs: &[Output], rows: Vec<Rows<'_>>);
    fn rollout_into(&mut self, rollout: &Rollout<'_>, rows: Vec<Rows<'_>>) -> Trajectories;
    fn state_hash(&self) -> u64;
    fn memory(&self) -> (usize, usize);
}

/// Blocks of lane type `L`, one workspace per worker.
pub(crate) struct Batch<L: LaneQuery> {
    model: Model,
    tables: Arc<KernelModel<L::Real>>,
    nworld: usize,
    max_contacts: usize,
    blocks: Vec<Block<L>>,
    pool: Arc<Pool>,
    workers: Vec<Mutex<Worker<L>>>,
}

/// What a worker thread keeps from block to block.
struct Worker<L> {
    workspace: Workspace<L>,
    statistics: Statistics,
    clock: StageClock,
}

/// A block with its share of the outputs: `rows[o]` holds the block's worlds' rows of output `o`.
struct Job<'a, L> {
    first_world: usize,
    worlds: usize,
    block: &'a mut Block<L>,
    rows: Vec<Rows<'a>>,
}

impl<L: LaneQuery<Real: Tables>> Batch<L> {
    pub fn new(model: &Model, nworld: usize, pool: Arc<Pool>, max_contacts: usize) -> Self {
        let tables = L::Real::tables(model).clone();
        let blocks =
            (0..nworld.div_ceil(L::WIDTH)).map(|b| Block::new(&tables, L::WIDTH.min(nworld - b * L::WIDTH))).collect();
        let workers = (0..pool.threads())
            .map(|_| {
                let workspace = Workspace::new(&tables);
                Mutex::new(Worker { workspace, statistics: Statistics::default(), clock: StageClock::default() })
            })
            .collect();
        Batch { model: model.clone(), tables, nworld, max_contacts, blocks, pool, workers }
    }

    /// Does `work` for every block, on all workers. Each of `rows` is an array of equally many entries per world; a block
    /// gets those of its worlds.
    fn spread(&mut self, mut rows: Vec<Rows<'_>>, work: impl Fn(&Self, &mut Job<'_, L>, &mut Worker<L>) + Sync) {
        if self.nworld == 0 {
            return;
        }
        let widths: Vec<usize> = rows.iter().map(|rows| rows.len() / self.nworld).collect();
        let mut blocks = std::mem::take(&mut self.blocks);
        let jobs = blocks.iter_mut().enumerate().map(|(b, block)| {
            let first_world = b * L::WIDTH;
            let worlds = L::WIDTH.min(self.nworld - first_world);
            block.pad(worlds);
            let rows = rows.iter_mut().zip(&widths).map(|(rows, width)| rows.take(worlds * width)).collect();
            Job { first_world, worlds, block, rows }
        });
        let queue = Mutex::new(jobs);
        let this = &*self;
        this.pool.run(|thread| {
            let mut worker = this.workers[thread].lock().unwrap_or_else(PoisonError::into_inner);
            loop {
                // A statement of its own: the queue is locked only while the next block is taken.
                let next = queue.lock().unwrap_or_else(PoisonError::into_inner).next();
                let Some(mut job) = next else { break };
                work(this, &mut job, &mut worker);
            }
        });
        drop(queue);
        self.blocks = blocks;
    }

    /// Takes one block through all steps of a rollout.
    fn run_block(&self, rollout: &Rollout<'_>, job: &mut Job<'_, L>, worker: &mut Worker<L>) {
        for step in 0..rollout.nstep {
            if rollout.cancelled() {
                return;
            }
            self.load_controls(rollout, step, job);
            let Worker { workspace, statistics, clock } = worker;
            let mut run = Run {
                applied: job.block.applied.as_deref(),
                clock: rollout.clock.then_some(clock),
                max_contacts: self.max_contacts,
                convex: &SupportCollider,
            };
            let alive = job.block.status.alive;
            pipeline::step(&self.tables, &mut job.block.state, &mut run, &mut job.block.status, workspace);
            if rollout.statistics {
                gather(workspace, alive, statistics);
            }
            self.record(rollout, step, job, workspace);
        }
        if let Some(progress) = rollout.progress {
            progress.fetch_add((rollout.nstep * job.worlds) as u64, Ordering::Relaxed);
        }
    }

    fn load_controls(&self, rollout: &Rollout<'_>, step: usize, job: &mut Job<'_, L>) {
        let nu = self.tables.sizes.nu;
        match rollout.controls {
            Controls::Keep => {}
            Controls::Given(controls) => {
                for lane in 0..job.worlds {
                    let row = ((job.first_world + lane) * rollout.nstep + step) * nu;
                    for (u, x) in job.block.state.ctrl.iter_mut().zip(&controls[row..row + nu]) {
                        u.set(lane, L::Real::from_f64(*x));
                    }
                }
            }
            Controls::Strided { values, world, step: stride } => {
                let ctrl = &mut job.block.state.ctrl;
                for lane in 0..job.worlds {
                    let row = (job.first_world + lane) * world + step * stride;
                    values.for_each(row..row + nu, |i, x| ctrl[i].set(lane, L::Real::from_f64(x)));
                }
            }
            Controls::Noise { seed } => {
                for (a, u) in job.block.state.ctrl.iter_mut().enumerate() {
                    let [low, high] = self.model.control_range(a);
                    for lane in 0..job.worlds {
                        let world = (job.first_world + lane) as u64;
                        let x = noise::uniform(seed, world, step as u64, a as u64);
                        u.set(lane, <L::Real as Real>::from_f64(low + (high - low) * x));
                    }
                }
            }
        }
    }

    fn record(&self, rollout: &Rollout<'_>, step: usize, job: &mut Job<'_, L>, workspace: &mut Workspace<L>) {
        if rollout.outputs.is_empty() {
            return;
        }
        if rollout.outputs.iter().any(Output::needs_energy) {
            pipeline::energy(&self.tables, &job.block.state, workspace);
        }
        let view = View { model: &self.model, tables: &self.tables, block: job.block, workspace };
        for (output, rows) in rollout.outputs.iter().zip(&mut job.rows) {
            let width = rows.len() / (job.worlds * rollout.nstep);
            for lane in 0..job.worlds {
                output.write(&view, lane, rows, (lane * rollout.nstep + step) * width);
            }
        }
    }
}

/// Adds a step's counts to the statistics.
fn gather<L: LaneQuery>(workspace: &Workspace<L>, alive: u32, statistics: &mut Statistics) {
    let worlds = f64::from(alive.count_ones());
    let count = |mask: L::Mask| f64::from((L::bits(mask) & alive).count_ones());
    statistics.world_steps += worlds;
    statistics.block_steps += 1.0;
    statistics.slots += workspace.collision.contacts.len() as f64 * worlds;
    for contact in &workspace.collision.contacts {
        statistics.contacts += count(contact.dist.lt(L::of(L::Real::MAXVAL)));
    }
    for row in &workspace.constraint.dof_rows {
        let acts = row.kind == DofRowKind::Friction;
        statistics.rows += if acts { worlds } else { count(row.d.gt(L::zero())) };
    }
    for row in &workspace.constraint.contact_rows {
        let rows = match row.cone {
            Cone::Ray | Cone::Ellipse => row.dim,
            Cone::Pyramid => 2 * (row.dim - 1),
        };
        statistics.rows += f64::from(rows) * count(row.d.gt(L::zero()));
    }
    let solver = &workspace.solver.statistics;
    statistics.block_iterations += f64::from(solver.block_niter);
    for lane in (0..L::WIDTH).filter(|lane| alive >> lane & 1 != 0) {
        statistics.iterations += solver.niter.get(lane).to_f64();
    }
}

impl<L: LaneQuery<Real: Tables>> Engine for Batch<L> {
    fn nworld(&self) -> usize {
        self.nworld
    }

    fn threads(&self) -> usize {
        self.pool.threads()
    }

    fn lanes(&self) -> (usize, &'static str) {
        (L::WIDTH, L::NAME)
    }

    fn set(&mut self, field: Field, world: usize, values: &[f64]) {
        let block = &mut self.blocks[world / L::WIDTH];
        block.set(field, &self.tables.sizes, world % L::WIDTH, values);
    }

    fn get(&self, field: Field, world: usize) -> Vec<f64> {
        self.blocks[world / L::WIDTH].read(field, &self.model, world % L::WIDTH)
    }

    fn status(&self, world: usize) -> Status {
        self.blocks[world / L::WIDTH].status.lane(world % L::WIDTH)
    }

    fn reset(&mut self, world: usize, key: &Key) {
        self.blocks[world / L::WIDTH].reset(&self.tables.sizes, world % L::WIDTH, key);
    }

    fn set_status(&mut self, world: usize, status: Status) {
        self.blocks[world / L::WIDTH].status.set_lane(world % L::WIDTH, status);
    }

    fn write_all(&mut self, field: Field, rows: &Strided<'_>, mask: Option<&[bool]>) {
        self.spread(Vec::new(), |this, job, _| {
            for lane in 0..job.worlds {
                let world = job.first_world + lane;
                if mask.is_none_or(|mask| mask[world]) {
                    job.block.set_row(field, &this.tables.sizes, lane, rows, world);
                }
            }
        });
    }

    fn read_all(&mut self, outputs: &[Output], rows: Vec<Rows<'_>>) {
        let derived = outputs.is_empty() || outputs.iter().any(Output::is_derived);
        let energy = outputs.iter().any(Output::needs_energy);
        self.spread(rows, |this, job, worker| {
            let ws = &mut worker.workspace;
            if derived {
                let applied = job.block.applied.as_deref();
                let mut run = Run { applied, clock: None, max_contacts: this.max_contacts, convex: &SupportCollider };
                pipeline::forward(&this.tables, &job.block.state, &mut run, &mut job.block.status, ws);
            }
            if energy {
                pipeline::energy(&this.tables, &job.block.state, ws);
            }
            let view = View { model: &this.model, tables: &this.tables, block: job.block, workspace: ws };
            for (output, rows) in outputs.iter().zip(&mut job.rows) {
                let width = rows.len() / job.worlds;
                (0..job.worlds).for_each(|lane| output.write(&view, lane, rows, lane * width));
            }
        });
    }

    fn rollout_into(&mut self, rollout: &Rollout<'_>, rows: Vec<Rows<'_>>) -> Trajectories {
        for worker in &self.workers {
            let mut worker = worker.lock().unwrap_or_else(PoisonError::into_inner);
            worker.statistics = Statistics::default();
            worker.clock = StageClock::default();
        }
        self.spread(rows, |this, job, worker| this.run_block(rollout, job, worker));
        let mut result = Trajectories::default();
        for worker in &self.workers {
            let worker = worker.lock().unwrap_or_else(PoisonError::into_inner);
            result.statistics.add(&worker.statistics);
            for (sum, spent) in result.clock.spent.iter_mut().zip(worker.clock.spent) {
                *sum += spent;
            }
        }
        result
    }

    fn state_hash(&self) -> u64 {
        let mut hash = Fnv::default();
        for world in 0..self.nworld {
            let state = &self.blocks[world / L::WIDTH].state;
            for x in state.qpos.iter().chain(&state.qvel) {
                hash.add(x.get(world % L::WIDTH).bits());
            }
        }
        hash.0
    }

    fn memory(&self) -> (usize, usize) {
        let lane = size_of::<L>() / L::WIDTH;
        let state = state_len::<L>(&self.tables.sizes) * lane;
        // Six vectors' allocations beside the block itself.
        let block = (size_of::<Block<L>>() + 6 * 16) / L::WIDTH;
        (state + block, self.scratch())
    }
}

impl<L: LaneQuery<Real: Tables>> Batch<L> {
    /// Bytes of one workspace.
    fn scratch(&self) -> usize {
        let mut worker = self.workers[0].lock().unwrap_or_else(PoisonError::into_inner);
        let ws = &mut worker.workspace;
        let mut lanes = 0;
        let mut count = |field: lanesim_kernels::fields::FieldView<'_, L>| lanes += field.data.len();
        ws.position.for_each(&mut count);
        ws.inertia.for_each(&mut count);
        ws.collision.colliders.for_each(&mut count);
        ws.velocity.for_each(&mut count);
        ws.passive.for_each(&mut count);
        ws.actuation.for_each(&mut count);
        ws.acceleration.for_each(&mut count);
        ws.solver.fields.for_each(&mut count);
        ws.integration.for_each(&mut count);
        ws.energy.for_each(&mut count);
        lanes * size_of::<L>() + ws.collision.bytes() + ws.constraint.bytes()
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
