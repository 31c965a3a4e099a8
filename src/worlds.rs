//! The public batch: many worlds of one model.

use std::sync::Arc;

use lanesim_codegen::{Float, Fragment, InstructionSet, Statistics};
use lanesim_kernels::lane::LaneQuery;
use lanesim_kernels::part::Kernels;
use lanesim_kernels::state::Status;
use wide::{f32x16, f64x8};

use crate::batch::{Batch, Engine, WorkerCode};
use crate::error::Error;
pub use crate::field::Field;
use crate::memory;
use crate::model::{Key, Model};
use crate::native::{ModelCode, Native};
pub use crate::options::{Backend, Options, Precision};
use crate::outputs::{Output, Reading};
use crate::parameters::Parameter;
use crate::pool::Pool;
use crate::rollout::{Rollout, Trajectories};
use crate::rows::{Rows, Strided};
use crate::status::{OnDiverge, StatusEvent};

/// Machine code of a part of a step.
#[derive(Clone, Debug)]
pub struct CodePart {
    /// Name.
    pub name: String,
    /// Figures; `None`: straight-line code would be too large, or there is none for such rows, and the kernels do it.
    pub statistics: Option<Statistics>,
    /// The instructions, one a line.
    pub disassembly: Option<String>,
}

/// What steps the worlds of a batch.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Running {
    /// `Native`, `Wide` or `Scalar`.
    pub backend: Backend,
    /// Instruction set of the machine code made for the model.
    pub instructions: Option<InstructionSet>,
    /// Why there is no machine code, although it was wanted.
    pub notice: Option<String>,
}

impl Running {
    /// Code if it is wanted and can be had; notes which, and why not.
    fn choose<T: Float>(
        &mut self,
        options: &Options,
        get: impl FnOnce() -> Result<Arc<ModelCode<T>>, String>,
    ) -> Option<Arc<ModelCode<T>>> {
        self.backend = Backend::Wide;
        if options.backend == Backend::Wide {
            return None;
        }
        match get() {
            Ok(code) => {
                self.backend = Backend::Native;
                self.instructions = Some(code.isa());
                Some(code)
            }
            Err(why) => {
                self.notice = Some(format!("no machine code for the model, SIMD lanes step instead: {why}"));
                None
            }
        }
    }
}

fn kernels<L: LaneQuery>() -> WorkerCode<L> {
    Box::new(Kernels)
}

fn worker_code<T: Float>(code: Option<Arc<ModelCode<T>>>) -> impl Fn() -> WorkerCode<T::Block> + Send + Sync {
    move || match &code {
        Some(code) => Box::new(Native::new(code.clone())),
        None => kernels(),
    }
}

/// Many worlds of one model. A world's results are the same bits whatever its place, its neighbours, the number of worlds
/// and the number of threads.
pub struct Worlds {
    pub(crate) model: Model,
    pub(crate) options: Options,
    running: Running,
    /// Worlds' rows of the parameters that vary, in the order in which they began to.
    pub(crate) parameters: Vec<(Parameter, Vec<f64>)>,
    /// Tables in which what follows from a world's masses is computed, where these vary.
    pub(crate) reweighed: Option<Box<lanesim_kernels::model::Model<f64>>>,
    pub(crate) engine: Box<dyn Engine>,
}

impl Worlds {
    /// `nworld` worlds in the reference configuration, at rest.
    pub fn new(model: &Model, nworld: usize, options: &Options) -> Result<Self, Error> {
        Worlds::with_pool(model, nworld, options, Arc::new(Pool::new(options.threads, options.pin)?))
    }

    /// The same on the threads of a pool that others may use too, though not at the same time.
    pub fn with_pool(model: &Model, nworld: usize, options: &Options, pool: Arc<Pool>) -> Result<Self, Error> {
        let restart = match options.on_diverge {
            OnDiverge::Reset { key } => Some(key_state(model, key)?),
            OnDiverge::Freeze | OnDiverge::Error => None,
        };
        let scalar = options.backend == Backend::Scalar;
        let (f64_codes, f32_codes) = model.codes();
        let mut running = Running { backend: options.backend, instructions: None, notice: None };
        let engine: Box<dyn Engine> = match (options.precision, scalar) {
            (Precision::F64, true) => Box::new(Batch::<f64>::new(model, nworld, kernels, pool, options, restart)?),
            (Precision::F32, true) => Box::new(Batch::<f32>::new(model, nworld, kernels, pool, options, restart)?),
            (Precision::F64, false) => {
                let code = running.choose(options, || f64_codes.get(model.tables(), options.instructions));
                Box::new(Batch::<f64x8>::new(model, nworld, worker_code(code), pool, options, restart)?)
            }
            (Precision::F32, false) => {
                let code = running.choose(options, || f32_codes.get(model.tables_f32(), options.instructions));
                Box::new(Batch::<f32x16>::new(model, nworld, worker_code(code), pool, options, restart)?)
            }
        };
        Ok(Worlds {
            model: model.clone(),
            options: options.clone(),
            running,
            parameters: Vec::new(),
            reweighed: None,
            engine,
        })
    }

    /// What steps the worlds.
    pub fn running(&self) -> &Running {
        &self.running
    }

    /// The machine code that a plain step runs where all worlds have the model's own numbers, part by part; empty if there is
    /// none. Makes what has not been needed yet.
    pub fn code(&self) -> Vec<CodePart> {
        fn list<T: Float>(code: &Result<Arc<ModelCode<T>>, String>) -> Vec<CodePart> {
            let parts = code.as_ref().map(|code| code.all()).unwrap_or_default();
            let part = |(name, code): (_, Option<&Fragment<T>>)| CodePart {
                name,
                statistics: code.map(|code| code.statistics().clone()),
                disassembly: code.map(Fragment::disassembly),
            };
            parts.into_iter().map(part).collect()
        }
        let instructions = self.running.instructions;
        match (instructions, self.options.precision) {
            (None, _) => Vec::new(),
            (_, Precision::F64) => list(&self.model.codes().0.get(self.model.tables(), instructions)),
            (_, Precision::F32) => list(&self.model.codes().1.get(self.model.tables_f32(), instructions)),
        }
    }

    /// The model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The options.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Number of worlds.
    pub fn nworld(&self) -> usize {
        self.engine.nworld()
    }

    /// Number of threads that step, of which the caller's is one.
    pub fn threads(&self) -> usize {
        self.engine.threads()
    }

    /// Number of worlds per block, and the name of the lane type.
    pub fn lanes(&self) -> (usize, &'static str) {
        self.engine.lanes()
    }

    pub(crate) fn check_world(&self, world: usize) -> Result<(), Error> {
        if world < self.nworld() {
            return Ok(());
        }
        Err(Error::Input(format!("there is no world {world}: the batch has {}, counted from 0", self.nworld())))
    }

    fn check_field(&self, field: Field, given: usize) -> Result<(), Error> {
        let expected = field.len(&self.model);
        if given == expected {
            return Ok(());
        }
        Err(Error::Input(format!("{} has {given} numbers; expected {expected}", field.name())))
    }

    /// Sets a field of one world. Values must be finite; clears nothing else.
    pub fn set(&mut self, field: Field, world: usize, values: &[f64]) -> Result<(), Error> {
        self.check_world(world)?;
        self.check_field(field, values.len())?;
        if let Some(i) = values.iter().position(|x| !x.is_finite()) {
            let x = values[i];
            return Err(Error::Input(format!(
                "{}[{i}] of world {world} is {x}; expected a finite number",
                field.name()
            )));
        }
        if field == Field::EqActive
            && let Some(i) = values.iter().position(|x| ![0.0, 1.0].contains(x))
        {
            let x = values[i];
            return Err(Error::Input(format!("{}[{i}] of world {world} is {x}; expected 0 or 1", field.name())));
        }
        self.engine.set(field, world, values);
        Ok(())
    }

    /// Sets a field of one world without looking at the values: what a world does with NaN is its status.
    pub fn set_unchecked(&mut self, field: Field, world: usize, values: &[f64]) -> Result<(), Error> {
        self.check_world(world)?;
        self.check_field(field, values.len())?;
        self.engine.set(field, world, values);
        Ok(())
    }

    /// A field of one world.
    pub fn get(&self, field: Field, world: usize) -> Result<Vec<f64>, Error> {
        self.check_world(world)?;
        Ok(self.engine.get(field, world))
    }

    /// A field of all worlds, world by world.
    pub fn get_all(&self, field: Field) -> Vec<f64> {
        (0..self.nworld()).flat_map(|world| self.engine.get(field, world)).collect()
    }

    /// Status of one world.
    pub fn status(&self, world: usize) -> Result<Status, Error> {
        self.check_world(world)?;
        Ok(self.engine.status(world))
    }

    /// For every bit of a world's status, when and where it was set first, in the order of events.
    pub fn status_detail(&self, world: usize) -> Result<Vec<StatusEvent>, Error> {
        self.check_world(world)?;
        Ok(self.engine.firsts(world).iter().map(|first| StatusEvent::new(&self.model, first)).collect())
    }

    /// Number of frozen worlds.
    pub fn lost(&self) -> usize {
        (0..self.nworld()).filter(|world| self.engine.status(*world).contains(Status::FROZEN)).count()
    }

    /// Whether any world is frozen: quicker than counting them.
    pub fn any_lost(&self) -> bool {
        self.engine.any_frozen()
    }

    /// Resets one world to a keyframe, or to the reference configuration; clears all that it remembers, its status too.
    pub fn reset(&mut self, world: usize, key: Option<usize>) -> Result<(), Error> {
        self.check_world(world)?;
        self.engine.reset(world, &key_state(&self.model, key)?);
        Ok(())
    }

    /// Resets every world, or those where `mask` is true, as [`reset`](Worlds::reset) does, on all threads.
    pub fn reset_all(&mut self, mask: Option<&[bool]>, key: Option<usize>) -> Result<(), Error> {
        mask.map_or(Ok(()), |mask| self.check_mask(mask))?;
        self.engine.reset_all(mask, &key_state(&self.model, key)?);
        Ok(())
    }

    /// Sets one world's status: with its other fields, this restores a world exactly.
    pub fn set_status(&mut self, world: usize, status: Status) -> Result<(), Error> {
        self.check_world(world)?;
        self.engine.set_status(world, status);
        Ok(())
    }

    /// Sets a field of all worlds, or of those where `mask` is true, on all threads. Nothing is set if a row is missing;
    /// values are not looked at (see [`Values::check_finite`](crate::rows::Values::check_finite)).
    ///
    /// ```
    /// use lanesim::rows::{Rows, Strided, Values};
    /// use lanesim::{Field, Model, Options, Worlds};
    ///
    /// let xml = "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>";
    /// let model = Model::from_xml_string(xml, &Default::default())?;
    /// let mut worlds = Worlds::new(&model, 3, &Options::default())?;
    /// worlds.write_all(Field::Qvel, &Strided::new(Values::F32(&[1.0, 2.0, 3.0]), 1), Some(&[true, false, true]))?;
    ///
    /// let mut qvel = [0.0; 3];
    /// worlds.read_all(&["qvel"], vec![Rows::F64(&mut qvel)])?;
    /// assert_eq!(qvel, [1.0, 0.0, 3.0]);
    /// # Ok::<(), lanesim::Error>(())
    /// ```
    pub fn write_all(&mut self, field: Field, rows: &Strided<'_>, mask: Option<&[bool]>) -> Result<(), Error> {
        let width = field.len(&self.model);
        mask.map_or(Ok(()), |mask| self.check_mask(mask))?;
        check_fit(field.name(), rows, self.nworld(), width)?;
        self.engine.ask_for_forces(field, self.nworld())?;
        self.engine.write_all(field, rows, mask);
        Ok(())
    }

    /// Writes outputs of all worlds' present states to the caller's arrays, `[nworld, width]` each, on all threads.
    /// Derived ones are computed, as by [`forward`](Worlds::forward); so is everything if no output is named, for the
    /// sake of the worlds' statuses.
    pub fn read_all(&mut self, names: &[&str], rows: Vec<Rows<'_>>) -> Result<(), Error> {
        self.read(&Reading { names, ..Reading::default() }, rows)
    }

    /// Rows must hold one entry per number, world and step; lists one per world.
    pub(crate) fn check_rows(
        &self,
        outputs: &[Output],
        rows: &[Rows<'_>],
        (nworld, nstep): (usize, usize),
    ) -> Result<(), Error> {
        if outputs.len() != rows.len() {
            return Err(Error::Input(format!("{} arrays for {} outputs", rows.len(), outputs.len())));
        }
        for (output, rows) in outputs.iter().zip(rows) {
            let name = output.name();
            let lists = matches!(rows, Rows::Lists(_));
            let width = if lists { Some(1) } else { output.width(&self.model) };
            let Some(width) = width else {
                return Err(Error::Input(format!(
                    "{name} differs in length between worlds: it needs a list per world"
                )));
            };
            let entries = [nworld, nstep, width];
            if memory::product(&entries) != Some(rows.len()) || (lists && nstep != 1) {
                let (given, expected) = (rows.len(), memory::count(&entries));
                return Err(Error::Input(format!("array for {name} has {given} entries; expected {expected}")));
            }
        }
        Ok(())
    }

    pub(crate) fn check_mask(&self, mask: &[bool]) -> Result<(), Error> {
        let (given, expected) = (mask.len(), self.nworld());
        if given == expected {
            return Ok(());
        }
        Err(Error::Input(format!("the mask has {given} entries; expected nworld {expected}")))
    }

    /// Advances every world by `nstep` steps with its present controls.
    pub fn step(&mut self, nstep: usize) -> Result<(), Error> {
        self.rollout(&Rollout { nstep, ..Rollout::default() }).map(|_| ())
    }

    /// Takes every world through `nstep` steps, block by block.
    pub fn rollout(&mut self, rollout: &Rollout<'_>) -> Result<Trajectories, Error> {
        let nworld = self.count(rollout.ids)?;
        rollout.check(&self.model, nworld)?;
        let zeros = |output: &Output| {
            let entries = [nworld, rollout.nstep, output.width(&self.model).unwrap_or(0)];
            memory::zeros("the outputs", &entries, self.options.max_memory)
        };
        let mut outputs = rollout.outputs.iter().map(zeros).collect::<Result<Vec<_>, _>>()?;
        let rows = outputs.iter_mut().map(|output| Rows::F64(output)).collect();
        let result = self.rollout_into(rollout, rows)?;
        Ok(Trajectories { outputs, ..result })
    }

    /// The same with the outputs written to the caller's arrays, `[nworld, nstep, width]` each;
    /// [`Trajectories::outputs`] stays empty.
    pub fn rollout_into(&mut self, rollout: &Rollout<'_>, rows: Vec<Rows<'_>>) -> Result<Trajectories, Error> {
        let nworld = self.count(rollout.ids)?;
        rollout.check(&self.model, nworld)?;
        self.check_rows(rollout.outputs, &rows, (nworld, rollout.nstep))?;
        let (mut trajectories, mut rows) = (Trajectories::default(), Some(rows));
        self.on(rollout.ids, &mut |engine| trajectories = engine.rollout(rollout, rows.take().unwrap_or_default()))?;
        if rollout.cancelled() {
            return Err(Error::Cancelled);
        }
        match self.options.on_diverge {
            OnDiverge::Error => self.first_lost(rollout.ids).map_or(Ok(trajectories), Err),
            OnDiverge::Freeze | OnDiverge::Reset { .. } => Ok(trajectories),
        }
    }

    /// The error that names the world which was lost first, of those chosen.
    fn first_lost(&self, ids: Option<&[usize]>) -> Option<Error> {
        if !self.any_lost() {
            return None;
        }
        let ids = ids.map_or_else(|| (0..self.nworld()).collect(), <[usize]>::to_vec);
        let lost = ids.into_iter().filter(|world| self.engine.status(*world).contains(Status::FROZEN));
        let cause = |world| {
            let firsts = self.engine.firsts(world);
            let frozen = firsts.iter().find(|first| first.status == Status::FROZEN)?.step;
            let cause = firsts.iter().find(|first| first.step == frozen && first.status.freezes())?;
            Some((frozen, world, StatusEvent::new(&self.model, cause)))
        };
        let (_, world, event) = lost.filter_map(cause).min_by_key(|(step, world, _)| (*step, *world))?;
        Some(Error::Diverged { world, event })
    }

    /// Bytes per world and per thread, as [`memory`](Worlds::memory) says of a batch, without making one.
    pub fn memory_of(model: &Model, options: &Options) -> (usize, usize) {
        match (options.precision, options.backend == Backend::Scalar) {
            (Precision::F64, true) => Batch::<f64>::memory_of(model),
            (Precision::F32, true) => Batch::<f32>::memory_of(model),
            (Precision::F64, false) => Batch::<f64x8>::memory_of(model),
            (Precision::F32, false) => Batch::<f32x16>::memory_of(model),
        }
    }

    /// 64-bit hash of the final positions and velocities, in the order of worlds: equal for equal bits.
    pub fn state_hash(&self) -> u64 {
        self.engine.state_hash()
    }

    /// Bytes kept per world, parameters that vary included, and bytes of scratch per thread.
    pub fn memory(&self) -> (usize, usize) {
        let (world, thread) = self.engine.memory();
        let rows: usize = self.parameters.iter().map(|(parameter, _)| parameter.len(&self.model)).sum();
        (world + rows * size_of::<f64>(), thread)
    }
}

/// An error if the rows of so many worlds do not lie inside the array.
pub(crate) fn check_fit(name: &str, rows: &Strided<'_>, nworld: usize, width: usize) -> Result<(), Error> {
    if rows.fits(nworld, width) {
        return Ok(());
    }
    let (given, expected) = (rows.values.len(), memory::count(&[nworld, width]));
    Err(Error::Input(format!("{name} has {given} numbers; expected {expected} = nworld {nworld} × {width}")))
}

/// A keyframe, or the reference configuration.
pub(crate) fn key_state(model: &Model, key: Option<usize>) -> Result<Key, Error> {
    let Some(k) = key else { return Ok(model.initial_key()) };
    let n = model.keys().len();
    model.keys().get(k).cloned().ok_or_else(|| Error::Unknown(format!("there is no keyframe {k}: the model has {n}")))
}
