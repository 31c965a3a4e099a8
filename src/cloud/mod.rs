//! Clouds: many states around one, side by side in the lanes, and the derivatives that follow from where they go.

mod grid;
mod hessian;
mod parameters;
mod points;
pub(crate) mod request;
mod smoothing;
pub(crate) mod times;
pub(crate) mod visit;

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use lanesim_kernels::exact;
use lanesim_kernels::lane::Real;
use lanesim_kernels::model::{Joint, JointKind};
use lanesim_kernels::options::{self, Solver};
use lanesim_kernels::workspace::Workspace;
use wide::f64x8;

pub use self::grid::Grid;
pub use self::hessian::{Costs, Seen, hessian};
pub use self::parameters::{ByParameter, Numbers};
pub use self::points::{Found, How};
pub use self::request::{Method, Scheme};
use self::request::{Of, Request, Shape};
pub use self::smoothing::Smoothing;
pub use self::times::{Time, Times};
pub use self::visit::Points;
use crate::error::Error;
use crate::field::Field;
use crate::inverse;
use crate::memory;
use crate::model::Model;
use crate::npz::{Array, Data};
use crate::rows::{Rows, Strided, Values};
use crate::states::{Known, States};
use crate::worlds::{Options, Worlds, check_fit};

/// How the constraints of a cloud's states are solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Solving {
    /// By Newton's method until nothing is left but rounding. States that do not get there have no derivatives.
    #[default]
    Accurate,
    /// As steps do, with the model's own solver, tolerance and iterations: what is left of the error is divided by `eps`.
    FixedWork,
}

/// Derivatives of worlds' next states, as MuJoCo's `mjd_transitionFD` has them. States are told by differences of qpos in the tangent
/// space, `nv`, then qvel, then act: n = 2 nv + na numbers. The last index runs fastest. NaN where a state has none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Transition {
    /// Of the next state by the state, `[nworld, n, n]`.
    pub a: Vec<f64>,
    /// Of the next state by controls, `[nworld, n, nu]`.
    pub b: Vec<f64>,
    /// Of sensors by the state, `[nworld, nsensordata, n]`; empty unless they are wanted.
    pub c: Vec<f64>,
    /// Of sensors by controls, `[nworld, nsensordata, nu]`; empty unless they are wanted.
    pub d: Vec<f64>,
    /// How each column of A, then of B, was perturbed, `[nworld, n + nu]`: 2 to both sides, 1 forward, -1 backward, as controls at a limit are,
    /// 0 not at all: the control's range is too narrow, or it is outside, and its column is zero; or derivatives are exact.
    pub sides: Vec<f64>,
    /// How many limits and contacts push beside the state, on either side, that do not push in it, or the other way round, by columns
    /// likewise: where there are some, the difference goes across a kink. Of exact derivatives, how many rows are within a millionth of where they begin
    /// or cease to act, or to slide.
    pub changed: Vec<f64>,
    /// Bits of [`Status`](crate::status::Status): what happened to the states, `[nworld]`.
    pub status: Vec<f64>,
}

/// Of what derivatives are taken.
#[derive(Clone, Copy, Debug)]
pub enum Target<'a> {
    /// The next state: what is in [`Transition`].
    Transition,
    /// The acceleration, MuJoCo's `qacc`: `A`, `[nworld, nv, n]`, by the state, and `B`, `[nworld, nv, nu]`, by controls, for a solver that is
    /// where the state is.
    Acceleration,
    /// The force of inverse dynamics (see [`Worlds::inverse`]) for these accelerations, a row of `nv` for each world: `dq`, `dv` and `da`,
    /// `[nworld, nv, nv]` each, by positions in the tangent space, by velocities and by accelerations, as MuJoCo's `mjd_inverseFD` but
    /// not transposed.
    Inverse(Strided<'a>),
}

impl Target<'_> {
    fn of(&self) -> Of {
        match self {
            Target::Transition => Of::Transition,
            Target::Acceleration => Of::Acceleration,
            Target::Inverse(_) => Of::Inverse,
        }
    }

    /// What [`Worlds::derivatives_into`] writes: name, a world's dimensions, and whether it is of integers. Matrices of derivatives, then
    /// `sides`, `changed` and `status` as in [`Transition`], the columns being those of all matrices in this order.
    pub fn arrays(&self, model: &Model, sensors: bool) -> Vec<(&'static str, Vec<usize>, bool)> {
        Shape::new(model, self.of(), sensors).arrays()
    }
}

/// The same model with options by which constraints are solved accurately (see [`Solving::Accurate`]).
///
/// # Errors
///
/// If it does not compile with these.
pub fn accurate(model: &Model) -> Result<Model, Error> {
    if model.tables().options == accurate_options(&model.tables().options) {
        return Ok(model.clone());
    }
    let mut spec = model.basis().spec.clone();
    spec.option = accurate_options(&spec.option);
    Ok(Model::from_spec(&spec)?)
}

/// The options that differ in such a model.
pub fn accurate_options(options: &options::Options) -> options::Options {
    options::Options {
        solver: Solver::Newton,
        tolerance: options.tolerance.min(1e-15),
        ls_tolerance: options.ls_tolerance.min(1e-9),
        iterations: options.iterations.max(200),
        ls_iterations: options.ls_iterations.max(100),
        ..options.clone()
    }
}

/// An error if a joint's quaternion in rows of positions, of which `shape` is that of the array, is as good as zero: no rotation, and none beside it.
///
/// # Errors
///
/// That; it names the joint and the place.
pub fn check_quaternions(model: &Model, qpos: Values<'_>, shape: &[usize]) -> Result<(), Error> {
    let nq = model.tables().sizes.nq;
    let quaternion = |joint: &Joint<f64>| match joint.kind {
        JointKind::Free => Some(joint.qpos as usize + 3),
        JointKind::Ball => Some(joint.qpos as usize),
        JointKind::Slide | JointKind::Hinge => None,
    };
    let joints = model.tables().joints.iter().enumerate();
    let all: Vec<_> = joints.filter_map(|(j, joint)| Some((j, quaternion(joint)?))).collect();
    for state in 0..qpos.len().checked_div(nq).unwrap_or(0) {
        for (j, at) in &all {
            let (start, mut squared) = (state * nq + at, 0.0);
            qpos.for_each(start..start + 4, |_, x| squared += x * x);
            if squared.sqrt() < f64::MINVAL {
                let (mut place, mut i) = (vec![0; shape.len()], start);
                for (k, n) in place.iter_mut().zip(shape).rev() {
                    (*k, i) = (i % n, i / n);
                }
                let name = model.names().joints.name(*j);
                return Err(Error::Input(format!(
                    "array `qpos` holds a quaternion of length zero at {place:?}, that of joint {j} {name:?}; expected a rotation, such as 1 0 0 0"
                )));
            }
        }
    }
    Ok(())
}

impl Worlds {
    /// Derivatives of the next states that follow from the worlds' present ones, which stay as they are: column by column from differences of
    /// steps. Constraints are solved as steps solve them; `eps` asks for more than most models do, see [`accurate`].
    ///
    /// ```
    /// use lanesim::cloud::Scheme;
    /// use lanesim::{Model, Options, Worlds};
    ///
    /// let xml = "<mujoco><worldbody><body><joint type='slide'/><geom size='.1'/></body></worldbody></mujoco>";
    /// let model = Model::from_xml_string(xml, &Default::default())?;
    /// let found = Worlds::new(&model, 1, &Options::default())?.transition(&Scheme::default())?;
    /// for (x, expected) in found.a.iter().zip([1.0, 0.002, 0.0, 1.0]) {
    ///     assert!((x - expected).abs() < 1e-9);
    /// }
    /// # Ok::<(), lanesim::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// If `eps` is out of bounds, or there is no memory for the derivatives.
    pub fn transition(&mut self, scheme: &Scheme) -> Result<Transition, Error> {
        let mut all = room(&self.model, &Target::Transition, scheme, self.nworld(), self.options.max_memory)?;
        let rows = all.iter_mut().map(|rows| Rows::F64(rows)).collect();
        self.derivatives_into(&Target::Transition, scheme, Solving::FixedWork, rows, Follow::default())?;
        let mut all = all.into_iter();
        let mut next = || all.next().unwrap_or_default();
        Ok(Transition { a: next(), b: next(), c: next(), d: next(), sides: next(), changed: next(), status: next() })
    }

    /// Derivatives of anything, written to the caller's arrays, one for each of [`Target::arrays`]. With [`Solving::Accurate`] the model must be an
    /// [`accurate`] one; worlds and columns that did not converge are NaN. The number that is given counts the worlds that are done; once the flag
    /// turns true the result is [`Error::Cancelled`].
    ///
    /// # Errors
    ///
    /// As above; if an array has another length; if the model's steps cannot be inverted.
    pub fn derivatives_into(
        &mut self,
        target: &Target<'_>,
        scheme: &Scheme,
        solving: Solving,
        rows: Vec<Rows<'_>>,
        follow: Follow<'_>,
    ) -> Result<(), Error> {
        let Follow { progress, cancel, times } = follow;
        scheme.check(self.options.precision)?;
        if scheme.method == Method::Exact {
            let missing = exact::missing(self.model.tables(), target.of().exact());
            missing.map_or(Ok(()), |missing| Err(Error::Input(missing)))?;
            // Numbers, and numbers with their rates.
            let scratch = Workspace::<f64x8>::bytes(self.model.tables());
            memory::ask("a thread's scratch for exact derivatives", &[3, scratch])?;
        }
        let (nworld, nv) = (self.nworld(), self.model.tables().sizes.nv);
        let qacc = if let Target::Inverse(qacc) = target { Some(qacc) } else { None };
        if let Some(qacc) = qacc {
            inverse::check_model(&self.model)?;
            check_fit("qacc", qacc, nworld, nv)?;
        }
        let arrays = target.arrays(&self.model, scheme.sensors);
        if rows.len() != arrays.len() {
            return Err(Error::Input(format!("{} arrays for derivatives; expected {}", rows.len(), arrays.len())));
        }
        for ((name, dims, _), rows) in arrays.iter().zip(&rows) {
            let entries: Vec<_> = [nworld].into_iter().chain(dims.iter().copied()).collect();
            if memory::product(&entries) != Some(rows.len()) || matches!(rows, Rows::Lists(_)) {
                let (given, expected) = (rows.len(), memory::count(&entries));
                return Err(Error::Input(format!("array for {name} has {given} entries; expected {expected}")));
            }
        }
        let strict = solving == Solving::Accurate;
        self.engine.cloud(&Request { of: target.of(), scheme: *scheme, qacc, strict, progress, cancel, times }, rows);
        if cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed)) {
            return Err(Error::Cancelled);
        }
        Ok(())
    }
}

/// Room for the derivatives of so many states.
fn room(
    model: &Model,
    target: &Target<'_>,
    scheme: &Scheme,
    count: usize,
    limit: Option<usize>,
) -> Result<Vec<Vec<f64>>, Error> {
    let room = |(_, dims, _): (_, Vec<usize>, _)| {
        let entries: Vec<_> = [count].into_iter().chain(dims).collect();
        memory::zeros("the derivatives", &entries, limit)
    };
    target.arrays(model, scheme.sensors).into_iter().map(room).collect()
}

/// Arrays that [`transition`] reads: all that decides what a state leads to.
pub(crate) const INPUTS: [Known; 10] = [
    Known::field(Field::Qpos, true),
    Known::field(Field::Qvel, true),
    Known::field(Field::Act, false),
    Known::field(Field::Ctrl, false),
    Known::field(Field::QaccWarmstart, false),
    Known::field(Field::EqActive, false),
    Known::field(Field::MocapPos, false),
    Known::field(Field::MocapQuat, false),
    Known::field(Field::QfrcApplied, false),
    Known::field(Field::XfrcApplied, false),
];

/// Names of these arrays, and whether there must be one.
pub fn inputs() -> impl Iterator<Item = (&'static str, bool)> {
    INPUTS.iter().map(|known| (known.name, known.required))
}

/// What a call is told beside the states: differences, the solver, how worlds work, and who counts the states that are done.
#[derive(Clone, Copy, Debug)]
pub struct Call<'a> {
    /// Differences.
    pub scheme: Scheme,
    /// How constraints are solved.
    pub solving: Solving,
    /// How worlds work.
    pub options: &'a Options,
    /// Counts the states that are done.
    pub progress: Option<&'a AtomicU64>,
    /// Adds up what columns take.
    pub times: Option<&'a Times>,
}

/// Who follows derivatives while they are taken.
#[derive(Clone, Copy, Debug, Default)]
pub struct Follow<'a> {
    /// Counts the states that are done.
    pub progress: Option<&'a AtomicU64>,
    /// Ends it early once it is set.
    pub cancel: Option<&'a AtomicBool>,
    /// Adds up what columns take.
    pub times: Option<&'a Times>,
}

/// Derivatives of steps from many states, such as those of whole trajectories: arrays `qpos` and `qvel`, and of what else decides a step those that
/// are not as the model starts, all with the same leading dimensions, `[N, ...]` or `[nworld, nstep, ...]`. Returns what [`Target::arrays`] lists with
/// the same ones (see [`Transition`]).
///
/// # Errors
///
/// If an array is missing, unknown, of another shape or has a number that is not finite; if `eps` is out of bounds.
pub fn transition(
    model: &Model,
    inputs: &BTreeMap<String, Array>,
    call: &Call<'_>,
) -> Result<Vec<(String, Array)>, Error> {
    many(model, (inputs, &INPUTS), &Target::Transition, call)
}

/// The same of accelerations, see [`Target::Acceleration`].
///
/// # Errors
///
/// As of [`transition`].
pub fn acceleration(
    model: &Model,
    inputs: &BTreeMap<String, Array>,
    call: &Call<'_>,
) -> Result<Vec<(String, Array)>, Error> {
    many(model, (inputs, &INPUTS), &Target::Acceleration, call)
}

/// The same of inverse dynamics, see [`Target::Inverse`]: `qacc` is an array, too, and forces from outside are none.
///
/// # Errors
///
/// As of [`transition`]; if the model's steps are to be inverted and cannot be.
pub fn inverse(
    model: &Model,
    inputs: &BTreeMap<String, Array>,
    call: &Call<'_>,
) -> Result<Vec<(String, Array)>, Error> {
    let none = Strided { values: Values::F64(&[]), offset: 0, stride: 0 };
    many(model, (inputs, &inverse::INPUTS), &Target::Inverse(none), call)
}

fn many(
    model: &Model,
    (inputs, known): (&BTreeMap<String, Array>, &[Known]),
    target: &Target<'_>,
    call: &Call<'_>,
) -> Result<Vec<(String, Array)>, Error> {
    let Call { scheme, solving, options, progress, times } = call;
    scheme.check(options.precision)?;
    let states = States::new(model, inputs, known)?;
    let qpos = inputs.get(Field::Qpos.name());
    qpos.map_or(Ok(()), |qpos| check_quaternions(model, Values::F64(&qpos.to_f64()), qpos.shape()))?;
    // Inverse dynamics solve nothing.
    let solves = *solving == Solving::Accurate && target.of() != Of::Inverse;
    let model = &if solves { accurate(model)? } else { model.clone() };
    let (arrays, nv) = (target.arrays(model, scheme.sensors), model.tables().sizes.nv);
    let mut all = room(model, target, scheme, states.count, options.max_memory)?;
    let qacc = states.numbers("qacc");
    states.each(model, options, |worlds, here| {
        let part = |(array, (_, dims, _)): (_, &(_, Vec<usize>, _))| {
            let (array, width): (&mut Vec<f64>, usize) = (array, dims.iter().product());
            Rows::F64(&mut array[here.start * width..here.end * width])
        };
        let rows = all.iter_mut().zip(&arrays).map(part).collect();
        let qacc = Strided { values: Values::F64(qacc), offset: here.start * nv, stride: nv };
        let target = if let Target::Inverse(_) = target { &Target::Inverse(qacc) } else { target };
        let follow = Follow { progress: *progress, cancel: None, times: *times };
        worlds.derivatives_into(target, scheme, *solving, rows, follow)
    })?;
    let joined = all.into_iter().zip(arrays).map(|(numbers, (name, dims, integers))| {
        let shape = states.leading.iter().copied().chain(dims).collect();
        let data = if integers { Data::I32(numbers.iter().map(|x| *x as i32).collect()) } else { Data::F64(numbers) };
        let array = Array::new(shape, data);
        array.map(|array| (name.to_owned(), array)).ok_or(Error::Memory { what: "the derivatives", bytes: None })
    });
    joined.collect()
}
