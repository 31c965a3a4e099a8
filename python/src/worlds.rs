//! A batch of worlds, shared between threads of the interpreter.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, ThreadId};
use std::time::Instant;

use lanesim::cloud::{self, Follow, Found, How, Method, Scheme, Solving};
use lanesim::rows::{Rows, Strided};
use lanesim::{Backend, Controls, Error, Field, OnDiverge, Options, Parameter, Plan, Precision, Reading, Rollout};
use lanesim_kernels::state::Status;
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use pyo3::types::PyDict;

use crate::arrays::{Numbers, Target};
use crate::cloud::{Cloud, target};
use crate::failure::{self, raise};
use crate::home::{AtHome, Home};
use crate::model::Model;
use crate::watch::{Pace, abandonable, watched};

/// Numbers beyond which copying them out may take long.
const MANY: usize = 1_000_000;
/// Numbers of parameters that are set in no time.
const FEW: usize = 2_000;

/// Numbers of worlds.
type Ids<'py> = PyReadonlyArray1<'py, u64>;

/// The status bits and their names.
pub fn status_bits() -> Vec<(&'static str, u32)> {
    Status::NAMES.iter().map(|(bit, name)| (*name, bit.0)).collect()
}

/// Worker threads.
#[pyclass(frozen, module = "lanesim._lanesim")]
pub struct Pool(AtHome<Arc<lanesim::pool::Pool>>, Home);

#[pymethods]
impl Pool {
    #[new]
    #[pyo3(signature = (threads=None, pin=false))]
    fn new(py: Python<'_>, threads: Option<usize>, pin: bool) -> PyResult<Self> {
        let pool = lanesim::pool::Pool::new(threads, pin).map_err(|e| raise(py, e))?;
        Ok(Pool(AtHome::new(Arc::new(pool)), Home::here()))
    }

    #[getter]
    fn threads(&self) -> usize {
        self.0.threads()
    }
}

/// Options of a batch: a dict, every word of which is known to be right.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Choice {
    precision: String,
    backend: String,
    threads: Option<usize>,
    pin: bool,
    max_memory: Option<usize>,
    on_diverge: String,
    max_contacts: usize,
}

impl Choice {
    /// Reads one, for which its words are made, once in a process.
    pub fn learn(py: Python<'_>) -> PyResult<()> {
        let words = PyDict::new(py);
        for word in ["precision", "backend", "on_diverge"] {
            words.set_item(word, "")?;
        }
        for word in ["threads", "pin", "max_memory", "max_contacts"] {
            words.set_item(word, false)?; // Which is an integer, too.
        }
        words.extract::<Choice>().map(drop)
    }

    fn options(&self) -> Options {
        Options {
            precision: if self.precision == "f32" { Precision::F32 } else { Precision::F64 },
            backend: match &*self.backend {
                "scalar" => Backend::Scalar,
                "wide" => Backend::Wide,
                "native" => Backend::Native,
                _ => Backend::Auto,
            },
            instructions: None,
            threads: self.threads,
            pin: self.pin,
            max_memory: self.max_memory,
            on_diverge: match &*self.on_diverge {
                "reset" => OnDiverge::Reset { key: None },
                "raise" => OnDiverge::Error,
                _ => OnDiverge::Freeze,
            },
            max_contacts: self.max_contacts,
        }
    }
}

/// A batch.
#[pyclass(frozen, module = "lanesim._lanesim")]
pub struct Worlds {
    state: Mutex<State>,
    /// The thread that is using the batch: it may not wait for itself.
    user: Mutex<Option<ThreadId>>,
    home: Home,
}

struct State {
    worlds: AtHome<lanesim::Worlds>,
    /// Of steps, per world.
    stepping: Pace,
    /// Of reading what is derived, per world.
    reading: Pace,
    /// Of clouds, per world.
    clouds: Pace,
}

/// The batch while this thread has it.
struct Use<'a> {
    state: MutexGuard<'a, State>,
    user: &'a Mutex<Option<ThreadId>>,
}

impl Drop for Use<'_> {
    fn drop(&mut self) {
        *self.user.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }
}

impl Worlds {
    /// Waits for other threads to be done with the batch.
    fn acquire(&self, py: Python<'_>) -> PyResult<Use<'_>> {
        self.home.check(py)?;
        let me = Some(thread::current().id());
        if *self.user.lock().unwrap_or_else(PoisonError::into_inner) == me {
            let text = "these worlds are being stepped: a progress callback cannot use them";
            return Err(failure::new(py, "LanesimError", (text,)));
        }
        let state = self.state.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner);
        *self.user.lock().unwrap_or_else(PoisonError::into_inner) = me;
        Ok(Use { state, user: &self.user })
    }
}

fn field(py: Python<'_>, name: &str) -> PyResult<Field> {
    Field::named(name).ok_or_else(|| raise(py, Error::Unknown(format!("there is no field {name}"))))
}

/// What a list of worlds is padded to, the numbers, and whether they are integers.
type Padded<'py> = (usize, Bound<'py, PyAny>);

#[pymethods]
impl Worlds {
    #[new]
    #[pyo3(signature = (model, nworld, choice, pool=None))]
    fn new(py: Python<'_>, model: &Model, nworld: usize, choice: Choice, pool: Option<&Pool>) -> PyResult<Self> {
        pool.map_or(Ok(()), |pool| pool.1.check(py))?;
        let options = choice.options();
        let (model, pool) = (model.here(py)?, pool.map(|pool| Arc::clone(&pool.0)));
        let worlds = abandonable(py, move || match pool {
            Some(pool) => lanesim::Worlds::with_pool(&model, nworld, &options, pool),
            None => lanesim::Worlds::new(&model, nworld, &options),
        })?;
        let worlds = worlds.map_err(|e| raise(py, e))?;
        let worlds = AtHome::new(worlds);
        let state =
            Mutex::new(State { worlds, stepping: Pace::default(), reading: Pace::default(), clouds: Pace::default() });
        Ok(Worlds { state, user: Mutex::new(None), home: Home::here() })
    }

    /// (threads, worlds per block, lane type, bytes per world, bytes of scratch per thread)
    fn engine(&self, py: Python<'_>) -> PyResult<(usize, usize, &'static str, usize, usize)> {
        let worlds = &self.acquire(py)?.state.worlds;
        let ((lanes, name), (world, scratch)) = (worlds.lanes(), worlds.memory());
        Ok((worlds.threads(), lanes, name, world, scratch))
    }

    /// Sets a field, or `state`, of the worlds where `mask` is true, or of those whose numbers are `ids`. `place`: (offset,
    /// stride), world `w`'s row, or that of `ids[w]`, begins at `offset + w * stride` of `values`. `checked`: its numbers must
    /// be finite; name and shape for the message.
    #[pyo3(signature = (name, values, place, mask, ids, checked))]
    #[expect(clippy::too_many_arguments, reason = "as many as the Python side has to say")]
    fn write(
        &self,
        py: Python<'_>,
        name: &str,
        values: Numbers<'_>,
        place: (usize, usize),
        mask: Option<PyReadonlyArray1<'_, bool>>,
        ids: Option<Ids<'_>>,
        checked: Option<(String, Vec<usize>)>,
    ) -> PyResult<()> {
        let field = if name == "state" { None } else { Some(field(py, name)?) };
        let ids = numbers_of(ids)?;
        let rows = Strided { values: values.values()?, offset: place.0, stride: place.1 };
        let mask = mask.as_ref().map(|mask| mask.as_slice()).transpose()?;
        let mut held = self.acquire(py)?;
        let worlds = &mut held.state.worlds;
        let result = py.detach(|| {
            if let Some((name, shape)) = checked {
                rows.values.check_finite(&name, &shape)?;
            }
            match (field, &ids) {
                (Some(field), None) => worlds.write_all(field, &rows, mask),
                (Some(field), Some(ids)) => worlds.write_at(ids, field, &rows),
                (None, None) => worlds.write_states(&rows, mask),
                (None, Some(ids)) => worlds.write_states_at(ids, &rows),
            }
        });
        result.map_err(|e| raise(py, e))
    }

    /// Sets a parameter of the worlds where `mask` is true; `place` as for `write`.
    #[pyo3(signature = (name, values, place, mask))]
    fn write_parameter(
        &self,
        py: Python<'_>,
        name: &str,
        values: Numbers<'_>,
        place: (usize, usize),
        mask: Option<PyReadonlyArray1<'_, bool>>,
    ) -> PyResult<()> {
        let parameter = Parameter::named(name).map_err(|e| raise(py, e))?;
        let rows = Strided { values: values.values()?, offset: place.0, stride: place.1 };
        let mask = mask.as_ref().map(|mask| mask.as_slice()).transpose()?;
        let mut held = self.acquire(py)?;
        let worlds = &mut held.state.worlds;
        let cancel = AtomicBool::new(false);
        let numbers = worlds.nworld().saturating_mul(parameter.len(worlds.model()));
        let work = || worlds.set_parameters_until(parameter, &rows, mask, &cancel);
        let result = if numbers < FEW { py.detach(work) } else { watched(py, &cancel, |_| Ok(()), work)? };
        result.map_err(|e| raise(py, e))
    }

    /// A parameter of all worlds, row by row.
    fn parameter<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let parameter = Parameter::named(name).map_err(|e| raise(py, e))?;
        let worlds = &self.acquire(py)?.state.worlds;
        let mut all = room(py, worlds.nworld(), parameter.len(worlds.model()))?;
        for world in 0..worlds.nworld() {
            all.extend_from_slice(worlds.parameter(parameter, world).map_err(|e| raise(py, e))?);
        }
        Ok(all.into_pyarray(py))
    }

    /// Names of the parameters that differ between worlds, in the order in which they began to.
    fn varying(&self, py: Python<'_>) -> PyResult<Vec<&'static str>> {
        Ok(self.acquire(py)?.state.worlds.varying().map(Parameter::name).collect())
    }

    /// Computes outputs of the present states, of all worlds or of those whose numbers are `ids`. Those with a target are
    /// written to it; the others, of which every world has another number, are returned: the longest length, and all
    /// worlds' numbers, padded with zeros.
    #[pyo3(signature = (names, targets, ids))]
    fn read<'py>(
        &self,
        py: Python<'py>,
        names: Vec<String>,
        mut targets: Vec<Option<Target<'py>>>,
        ids: Option<Ids<'py>>,
    ) -> PyResult<Vec<Option<Padded<'py>>>> {
        let ids = numbers_of(ids)?;
        let mut held = self.acquire(py)?;
        let State { worlds, reading: pace, .. } = &mut *held.state;
        let nworld = ids.as_ref().map_or(worlds.nworld(), Vec::len);
        let mut lists: Vec<Vec<Vec<f64>>> = Vec::with_capacity(targets.len());
        for target in &targets {
            let count = if target.is_none() { nworld } else { 0 };
            let mut list = room(py, count, 1)?;
            list.resize(count, Vec::new());
            lists.push(list);
        }
        let rows = targets.iter_mut().zip(&mut lists).map(|(target, list)| match target {
            Some(target) => target.rows(),
            None => Ok(Rows::Lists(list)),
        });
        let rows = rows.collect::<PyResult<Vec<_>>>()?;
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let outputs = names.iter().map(|name| worlds.model().output(name)).collect::<Result<Vec<_>, _>>();
        let outputs = outputs.map_err(|e| raise(py, e))?;
        let derived = names.is_empty() || Plan::forward(&outputs).derived;
        let entries: usize = rows.iter().map(Rows::len).sum();
        let short = entries < MANY && (!derived || pace.is_short(nworld as f64));
        let (cancel, start) = (AtomicBool::new(false), Instant::now());
        let work = || worlds.read(&Reading { names: &names, ids: ids.as_deref(), cancel: Some(&cancel) }, rows);
        let result = if short { py.detach(work) } else { watched(py, &cancel, |_| Ok(()), work)? };
        result.map_err(|e| raise(py, e))?;
        if derived && !worlds.any_lost() {
            pace.learn(start.elapsed().as_secs_f64(), nworld as f64);
        }
        let padded = targets.iter().zip(lists).zip(outputs).map(|((target, list), output)| {
            if target.is_some() {
                return Ok(None);
            }
            pad(py, list, output.is_integer()).map(Some)
        });
        padded.collect()
    }

    /// Inverse dynamics of the present states, written to `target`; `place` and `checked` as for `write`, of accelerations.
    fn inverse(
        &self,
        py: Python<'_>,
        qacc: Numbers<'_>,
        place: (usize, usize),
        mut target: Target<'_>,
        shape: Vec<usize>,
    ) -> PyResult<()> {
        let rows = Strided { values: qacc.values()?, offset: place.0, stride: place.1 };
        let target = target.rows()?;
        let mut held = self.acquire(py)?;
        let State { worlds, reading: pace, .. } = &mut *held.state;
        let (cancel, amount) = (AtomicBool::new(false), worlds.nworld() as f64);
        let short = pace.is_short(amount);
        let work = || {
            rows.values.check_finite("qacc", &shape)?;
            worlds.inverse_into(&rows, target, Some(&cancel))
        };
        let result = if short { py.detach(work) } else { watched(py, &cancel, |_| Ok(()), work)? };
        result.map_err(|e| raise(py, e))
    }

    /// Derivatives of steps, of accelerations (`of`: "acceleration"), or of inverse dynamics if there are accelerations `qacc`, [nworld, nv], written to
    /// `targets`; `progress` is called with the number of worlds done.
    #[pyo3(signature = (of, qacc, scheme, accurate, targets, progress))]
    #[expect(clippy::too_many_arguments, reason = "as many as the Python side has to say")]
    fn derivatives(
        &self,
        py: Python<'_>,
        of: &str,
        qacc: Option<Numbers<'_>>,
        scheme: (bool, Option<f64>, bool, bool),
        accurate: bool,
        mut targets: Vec<Target<'_>>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<()> {
        let rows = targets.iter_mut().map(Target::rows).collect::<PyResult<Vec<_>>>()?;
        let mut held = self.acquire(py)?;
        let State { worlds, clouds: pace, .. } = &mut *held.state;
        let (exact, eps, centred, sensors) = scheme;
        let method = if exact { Method::Exact } else { Method::Differences };
        let eps = eps.unwrap_or_else(|| Scheme::eps(worlds.options().precision, centred));
        let scheme = Scheme { method, eps, centred, sensors };
        let solving = if accurate { Solving::Accurate } else { Solving::FixedWork };
        let stride = worlds.model().tables().sizes.nv;
        let of = target(of, qacc.as_ref().map(Numbers::values).transpose()?, stride);
        let (cancel, done, amount) = (AtomicBool::new(false), AtomicU64::new(0), worlds.nworld() as f64);
        let start = Instant::now();
        let short = pace.is_short(amount);
        let work = || {
            worlds.derivatives_into(
                &of,
                &scheme,
                solving,
                rows,
                Follow { progress: Some(&done), cancel: Some(&cancel), times: None },
            )
        };
        let result =
            if short { py.detach(work) } else { watched(py, &cancel, |py| follow(py, &progress, &done), work)? };
        result.map_err(|e| raise(py, e))?;
        pace.learn(start.elapsed().as_secs_f64(), amount);
        Ok(())
    }

    /// Writes what follows from the points of a cloud around the worlds' states, of "transition", "acceleration" or, for these accelerations,
    /// "inverse"; `how`: whether sensors, and next positions as differences, are wanted, and whether the model is an accurate one.
    #[pyo3(signature = (of, qacc, cloud, how, targets, progress))]
    #[expect(clippy::too_many_arguments, reason = "as many as the Python side has to say")]
    fn points(
        &self,
        py: Python<'_>,
        of: &str,
        qacc: Option<Numbers<'_>>,
        cloud: &Cloud,
        how: (bool, bool, bool),
        mut targets: [Target<'_>; 5],
        progress: Option<Py<PyAny>>,
    ) -> PyResult<()> {
        let [after, before, changed, sides, status] = &mut targets;
        let found = Found {
            after: after.rows()?,
            before: before.rows()?,
            changed: changed.rows()?,
            sides: sides.rows()?,
            status: status.rows()?,
        };
        let mut held = self.acquire(py)?;
        let State { worlds, clouds: pace, .. } = &mut *held.state;
        let (sensors, tangent, accurate) = how;
        let solving = if accurate { Solving::Accurate } else { Solving::FixedWork };
        let how = How { solving, sensors, tangent, reach: cloud.reach, whole: false };
        let qacc = qacc.as_ref().map(Numbers::values).transpose()?;
        let target = target(of, qacc, worlds.model().tables().sizes.nv);
        let (cancel, done) = (AtomicBool::new(false), AtomicU64::new(0));
        // As of derivatives, which are by columns to both sides.
        let columns = target.columns(worlds.model()).max(1);
        let amount = worlds.nworld() as f64 * (cloud.points.len() as f64 / (2 * columns) as f64);
        let start = Instant::now();
        let short = pace.is_short(amount);
        let work = || worlds.points_into(&target, &cloud.points, &how, found, (Some(&done), Some(&cancel)));
        let result =
            if short { py.detach(work) } else { watched(py, &cancel, |py| follow(py, &progress, &done), work)? };
        result.map_err(|e| raise(py, e))?;
        pace.learn(start.elapsed().as_secs_f64(), amount);
        Ok(())
    }

    /// Derivatives of "transition", "acceleration" or, for these accelerations, "inverse" by numbers of a parameter: slopes, how they were
    /// moved, and what happened.
    #[pyo3(signature = (of, qacc, name, entries, eps, how))]
    #[expect(clippy::too_many_arguments, reason = "as many as the Python side has to say")]
    fn by_parameter<'py>(
        &self,
        py: Python<'py>,
        of: &str,
        qacc: Option<Numbers<'py>>,
        name: &str,
        entries: Vec<usize>,
        eps: f64,
        how: (bool, bool),
    ) -> PyResult<[Bound<'py, PyArray1<f64>>; 3]> {
        let parameter = Parameter::named(name).map_err(|e| raise(py, e))?;
        let mut held = self.acquire(py)?;
        let worlds = &mut held.state.worlds;
        let (sensors, accurate) = how;
        let solving = if accurate { Solving::Accurate } else { Solving::FixedWork };
        let how = How { solving, sensors, ..How::default() };
        let qacc = qacc.as_ref().map(Numbers::values).transpose()?;
        let target = target(of, qacc, worlds.model().tables().sizes.nv);
        let numbers = cloud::Numbers { parameter, entries: &entries, eps };
        let cancel = AtomicBool::new(false);
        let work = || worlds.by_parameter(&target, &numbers, &how, Some(&cancel));
        let found = watched(py, &cancel, |_| Ok(()), work)?.map_err(|e| raise(py, e))?;
        Ok([found.slopes, found.sides, found.status].map(|numbers| numbers.into_pyarray(py)))
    }

    /// Takes all worlds through `nstep` steps, or those whose numbers are `ids`. `controls`: the array and its strides from
    /// world to world and from step to step. `progress` is called with the number of world steps done.
    #[pyo3(signature = (nstep, controls, names, targets, progress, ids))]
    #[expect(clippy::too_many_arguments, reason = "as many as the Python side has to say")]
    fn run(
        &self,
        py: Python<'_>,
        nstep: usize,
        controls: Option<(Numbers<'_>, usize, usize)>,
        names: Vec<String>,
        mut targets: Vec<Target<'_>>,
        progress: Option<Py<PyAny>>,
        ids: Option<Ids<'_>>,
    ) -> PyResult<()> {
        let ids = numbers_of(ids)?;
        let model = self.acquire(py)?.state.worlds.model().clone();
        let outputs = names.iter().map(|name| model.output(name)).collect::<Result<Vec<_>, _>>();
        let outputs = outputs.map_err(|e| raise(py, e))?;
        let rows = targets.iter_mut().map(Target::rows).collect::<PyResult<Vec<_>>>()?;
        let controls = match &controls {
            Some((values, world, step)) => Controls::Strided { values: values.values()?, world: *world, step: *step },
            None => Controls::Keep,
        };
        let rollout = Rollout { nstep, controls, outputs: &outputs, ids: ids.as_deref(), ..Rollout::default() };
        self.go(py, rollout, rows, progress)
    }

    /// Resets the worlds where `mask` is true, or those whose numbers are `ids`, to a keyframe or to the reference
    /// configuration.
    #[pyo3(signature = (mask, ids, key))]
    fn reset(
        &self,
        py: Python<'_>,
        mask: Option<PyReadonlyArray1<'_, bool>>,
        ids: Option<Ids<'_>>,
        key: Option<usize>,
    ) -> PyResult<()> {
        let ids = numbers_of(ids)?;
        let mask = mask.as_ref().map(|mask| mask.as_slice()).transpose()?;
        let mut held = self.acquire(py)?;
        let worlds = &mut held.state.worlds;
        let result = py.detach(|| match &ids {
            Some(ids) => worlds.reset_at(ids, key),
            None => worlds.reset_all(mask, key),
        });
        result.map_err(|e| raise(py, e))
    }

    fn statuses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<u32>>> {
        let worlds = &self.acquire(py)?.state.worlds;
        let bits = (0..worlds.nworld()).map(|w| worlds.status(w).map(|status| status.0));
        Ok(bits.collect::<Result<Vec<u32>, _>>().map_err(|e| raise(py, e))?.into_pyarray(py))
    }

    /// When and where each bit of a world's status was first set: (bit, step, place).
    fn status_detail(&self, py: Python<'_>, world: usize) -> PyResult<Vec<(u32, u64, String)>> {
        let events = self.acquire(py)?.state.worlds.status_detail(world).map_err(|e| raise(py, e))?;
        Ok(events.into_iter().map(|event| (event.status.0, event.step, event.place)).collect())
    }

    fn set_statuses(&self, py: Python<'_>, bits: PyReadonlyArray1<'_, u32>) -> PyResult<()> {
        let bits = bits.as_slice()?;
        let worlds = &mut self.acquire(py)?.state.worlds;
        let mut set = bits.iter().enumerate();
        set.try_for_each(|(w, bits)| worlds.set_status(w, Status(*bits))).map_err(|e| raise(py, e))
    }

    fn state_hash(&self, py: Python<'_>) -> PyResult<u64> {
        Ok(self.acquire(py)?.state.worlds.state_hash())
    }
}

impl Worlds {
    fn go(
        &self,
        py: Python<'_>,
        rollout: Rollout<'_>,
        rows: Vec<Rows<'_>>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<()> {
        let (cancel, done) = (AtomicBool::new(false), AtomicU64::new(0));
        let mut held = self.acquire(py)?;
        let State { worlds, stepping: pace, .. } = &mut *held.state;
        let nworld = rollout.ids.map_or(worlds.nworld(), <[usize]>::len);
        let amount = nworld as f64 * rollout.nstep as f64;
        let start = Instant::now();
        let rollout = Rollout { progress: Some(&done), cancel: Some(&cancel), ..rollout };
        let work = || worlds.rollout_into(&rollout, rows);
        let result = if pace.is_short(amount) {
            py.detach(work)
        } else {
            watched(py, &cancel, |py| follow(py, &progress, &done), work)?
        };
        result.map_err(|e| raise(py, e))?;
        // Frozen worlds are passed over: nothing can be learnt from them.
        if !worlds.any_lost() {
            pace.learn(start.elapsed().as_secs_f64(), amount);
        }
        Ok(())
    }
}

/// Says how much is done to whoever wants to know.
fn follow(py: Python<'_>, progress: &Option<Py<PyAny>>, done: &AtomicU64) -> PyResult<()> {
    match progress {
        Some(callback) => callback.call1(py, (done.load(Ordering::Relaxed),)).map(drop),
        None => Ok(()),
    }
}

fn numbers_of(ids: Option<Ids<'_>>) -> PyResult<Option<Vec<usize>>> {
    let numbers = |ids: Ids<'_>| Ok(ids.as_slice()?.iter().map(|id| *id as usize).collect());
    ids.map(numbers).transpose()
}

/// An empty list with room for `rows` times `width` entries, or an exception if there is no memory for them.
fn room<T>(py: Python<'_>, rows: usize, width: usize) -> PyResult<Vec<T>> {
    let (mut list, count) = (Vec::new(), rows.checked_mul(width));
    let refused = || Error::Memory { what: "the outputs", bytes: count.and_then(|n| n.checked_mul(size_of::<T>())) };
    count.and_then(|n| list.try_reserve_exact(n).ok()).ok_or_else(|| raise(py, refused()))?;
    Ok(list)
}

/// Rows of different lengths as one array.
fn pad(py: Python<'_>, rows: Vec<Vec<f64>>, integer: bool) -> PyResult<Padded<'_>> {
    fn filled<'py, T: numpy::Element + Copy + Default>(
        py: Python<'py>,
        rows: Vec<Vec<f64>>,
        longest: usize,
        cast: impl Fn(f64) -> T,
    ) -> PyResult<Bound<'py, PyAny>> {
        let mut out = room(py, rows.len(), longest)?;
        for row in rows {
            out.extend(row.iter().map(|x| cast(*x)));
            out.resize(out.len() + longest - row.len(), T::default());
        }
        Ok(out.into_pyarray(py).into_any())
    }
    let longest = rows.iter().map(Vec::len).max().unwrap_or(0);
    let array = if integer { filled(py, rows, longest, |x| x as i32) } else { filled(py, rows, longest, |x| x) };
    Ok((longest, array?))
}
