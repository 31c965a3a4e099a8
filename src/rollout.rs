//! Rollouts: controls in, chosen outputs out.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::stage::StageClock;
use lanesim_kernels::workspace::Workspace;

use crate::error::Error;
use crate::memory;
use crate::model::Model;
use crate::outputs::Output;
use crate::rows::Values;

/// Controls of a rollout.
#[derive(Clone, Copy, Debug, Default)]
pub enum Controls<'a> {
    /// The controls that each world has.
    #[default]
    Keep,
    /// One row per world and step: `[nworld, nstep, nu]`.
    Given(&'a [f64]),
    /// Rows in an array of any layout: that of world `w` at step `t` begins at `w * world + t * step`. A stride of 0
    /// repeats one row.
    Strided {
        /// The array.
        values: Values<'a>,
        /// From one world's row to the next.
        world: usize,
        /// From one step's row to the next.
        step: usize,
    },
    /// Uniform in the control range of limited actuators and in [-1, 1] of others, redrawn every step.
    Noise {
        /// Seed; the numbers depend on (seed, world, step, actuator) alone.
        seed: u64,
        /// Share of the range, around its middle, that the numbers take: 1 for all of it, 0 for the middle alone.
        scale: f64,
    },
}

/// What to run and what to record.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rollout<'a> {
    /// Number of steps.
    pub nstep: usize,
    /// Numbers of the worlds that are taken through the steps, each at most once; `None`: all. Rows of controls and outputs
    /// are theirs, in this order. The other worlds stay as they are, bit by bit.
    pub ids: Option<&'a [usize]>,
    /// Controls.
    pub controls: Controls<'a>,
    /// What to record at every step: state outputs after the step; derived outputs as the step computed them, from the
    /// state before it.
    pub outputs: &'a [Output],
    /// Counts finished world steps while the rollout runs.
    pub progress: Option<&'a AtomicU64>,
    /// Stops the rollout when it turns true: every world ends after some whole number of steps, and the result is
    /// [`Error::Cancelled`].
    pub cancel: Option<&'a AtomicBool>,
    /// Whether to gather statistics.
    pub statistics: bool,
    /// Whether to time the stages.
    pub clock: bool,
}

impl Rollout<'_> {
    /// Whether the caller wants it to stop.
    pub fn cancelled(&self) -> bool {
        self.cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed))
    }

    /// An error if strided controls end before the last row.
    fn check_strides(&self, nu: usize, nworld: usize) -> Result<(), Error> {
        let Controls::Strided { values, world, step } = self.controls else { return Ok(()) };
        if nu == 0 || nworld == 0 || self.nstep == 0 {
            return Ok(());
        }
        let last = (nworld - 1).checked_mul(world).zip((self.nstep - 1).checked_mul(step));
        let end = last.and_then(|(w, t)| w.checked_add(t)).and_then(|at| at.checked_add(nu));
        if end.is_some_and(|end| end <= values.len()) {
            return Ok(());
        }
        Err(Error::Input(format!(
            "controls have {} numbers; too few for strides ({world}, {step}) and nworld {nworld}, nstep {}, nu {nu}",
            values.len(),
            self.nstep
        )))
    }

    /// Checks shapes and values of the controls of `nworld` worlds, and that outputs can be recorded.
    pub fn check(&self, model: &Model, nworld: usize) -> Result<(), Error> {
        if let Some(output) = self.outputs.iter().find(|output| output.width(model).is_none()) {
            let name = output.name();
            return Err(Error::Input(format!(
                "{name} differs in length between worlds and cannot be recorded in a rollout"
            )));
        }
        self.outputs.iter().try_for_each(|output| output.check(model))?;
        let nu = model.tables().sizes.nu;
        self.check_strides(nu, nworld)?;
        if let Controls::Noise { scale, .. } = self.controls
            && !(0.0..=1.0).contains(&scale)
        {
            return Err(Error::Input(format!("the scale of control noise is {scale}; expected a number from 0 to 1")));
        }
        let Controls::Given(controls) = self.controls else { return Ok(()) };
        let (given, nstep) = (controls.len(), self.nstep);
        if memory::product(&[nworld, nstep, nu]) != Some(given) {
            return Err(Error::Input(format!(
                "controls have {given} numbers; expected nworld {nworld} × nstep {nstep} × nu {nu}"
            )));
        }
        if let Some(i) = controls.iter().position(|u| !u.is_finite()) {
            let (world, rest) = (i / (self.nstep * nu), i % (self.nstep * nu));
            return Err(Error::Input(format!(
                "controls[{world}, {}, {}] is {}; expected a finite number",
                rest / nu,
                rest % nu,
                controls[i]
            )));
        }
        Ok(())
    }
}

/// What a rollout recorded.
#[derive(Clone, Debug, Default)]
pub struct Trajectories {
    /// One array per output, `[nworld, nstep, width]`.
    pub outputs: Vec<Vec<f64>>,
    /// Statistics, if asked for.
    pub statistics: Statistics,
    /// Time per stage, if asked for.
    pub clock: StageClock,
}

/// Sums and maxima over the steps of all blocks.
#[derive(Clone, Copy, Debug, Default)]
pub struct Statistics {
    /// World steps.
    pub world_steps: f64,
    /// Block steps.
    pub block_steps: f64,
    /// Contacts of worlds.
    pub contacts: f64,
    /// Contacts of blocks, each counted once for every world alive: what the slots have room for.
    pub slots: f64,
    /// Constraint rows of worlds.
    pub rows: f64,
    /// Solver iterations of worlds.
    pub iterations: f64,
    /// Solver iterations of the slowest world of each block.
    pub block_iterations: f64,
    /// Most iterations of a world in a step.
    pub most_iterations: f64,
    /// Residuals of worlds (see the output `solver_residual`).
    pub residuals: f64,
    /// Largest residual of a world in a step.
    pub largest_residual: f64,
    /// World steps in which the guard acted on some tree.
    pub guarded: f64,
}

impl Statistics {
    /// Mean over world steps of one of the sums.
    pub fn per_world_step(&self, sum: f64) -> f64 {
        if self.world_steps > 0.0 { sum / self.world_steps } else { 0.0 }
    }

    /// Adds another thread's sums.
    pub fn add(&mut self, other: &Statistics) {
        self.world_steps += other.world_steps;
        self.block_steps += other.block_steps;
        self.contacts += other.contacts;
        self.slots += other.slots;
        self.rows += other.rows;
        self.iterations += other.iterations;
        self.block_iterations += other.block_iterations;
        self.most_iterations = self.most_iterations.max(other.most_iterations);
        self.residuals += other.residuals;
        self.largest_residual = self.largest_residual.max(other.largest_residual);
        self.guarded += other.guarded;
    }

    /// Adds the counts of a step of the worlds whose bits are set in `alive`.
    pub(crate) fn gather<L: LaneQuery>(&mut self, workspace: &Workspace<L>, alive: u32) {
        let worlds = f64::from(alive.count_ones());
        let count = |mask: L::Mask| f64::from((L::bits(mask) & alive).count_ones());
        self.world_steps += worlds;
        self.block_steps += 1.0;
        self.slots += workspace.collision.slots.len() as f64 * worlds;
        for contact in workspace.collision.contacts() {
            self.contacts += count(contact.dist().lt(L::of(L::Real::MAXVAL)));
        }
        for law in workspace.constraint.dof_laws() {
            self.rows += count(law.d().gt(L::zero()));
        }
        for row in &workspace.constraint.contact_rows {
            self.rows += f64::from(row.rows()) * count(workspace.constraint.law(row).d().gt(L::zero()));
        }
        if let Some(kick) = &workspace.kick {
            self.guarded += f64::from((kick.acted() & alive).count_ones());
        }
        let solver = &workspace.solver.statistics;
        self.block_iterations += f64::from(solver.block_niter);
        for lane in (0..L::WIDTH).filter(|lane| alive >> lane & 1 != 0) {
            let (niter, residual) = (solver.niter.get(lane).to_f64(), solver.residual.get(lane).to_f64());
            self.iterations += niter;
            self.most_iterations = self.most_iterations.max(niter);
            self.residuals += residual;
            self.largest_residual = self.largest_residual.max(residual);
        }
    }
}
