//! What is asked of a cloud, and where its results go.

use std::sync::atomic::{AtomicBool, AtomicU64};

use arrayvec::ArrayVec;
use lanesim_kernels::exact;
use lanesim_kernels::state::Status;

use super::times::{Kind, Times};
use crate::error::Error;
use crate::model::Model;
use crate::options::Precision;
use crate::rows::{Rows, Strided};

/// By what derivatives are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Differences of evaluations beside the state.
    #[default]
    Differences,
    /// The derivative of what an evaluation computes, exact but for rounding. Double precision, and not for all that a model can have (see
    /// [`lanesim_kernels::exact::missing`]).
    Exact,
}

/// How derivatives are taken: by which differences, and of what.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scheme {
    /// By what. `eps` and `centred` are of differences alone.
    pub method: Method,
    /// How far a number of the state is moved: m, rad, and so on.
    pub eps: f64,
    /// Whether it is moved to both sides, which costs twice as much and is exact to second order.
    pub centred: bool,
    /// Whether derivatives of sensors are wanted.
    pub sensors: bool,
}

impl Default for Scheme {
    fn default() -> Self {
        Scheme { method: Method::Differences, eps: Scheme::eps(Precision::F64, true), centred: true, sensors: false }
    }
}

/// Of what a cloud has the derivatives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Of {
    /// The next state, and sensors if they are wanted.
    Transition,
    /// The acceleration.
    Acceleration,
    /// The force that an acceleration needs.
    Inverse,
}

impl Of {
    /// The same, as the kernels of exact derivatives call it.
    pub fn exact(self) -> exact::Of {
        match self {
            Of::Transition => exact::Of::Transition,
            Of::Acceleration => exact::Of::Acceleration,
            Of::Inverse => exact::Of::Inverse,
        }
    }
}

/// What is computed, and who follows it.
pub(crate) struct Request<'a> {
    pub of: Of,
    pub scheme: Scheme,
    /// Accelerations, one row per world, of inverse dynamics.
    pub qacc: Option<&'a Strided<'a>>,
    /// Whether a solution that did not converge is none.
    pub strict: bool,
    /// Counts the worlds that are done.
    pub progress: Option<&'a AtomicU64>,
    pub cancel: Option<&'a AtomicBool>,
    /// Adds up what columns take.
    pub times: Option<&'a Times>,
}

impl Scheme {
    /// How far to move where nobody says it: in single precision so far that rounding does not swamp the difference.
    pub fn eps(precision: Precision, centred: bool) -> f64 {
        match (precision, centred) {
            (Precision::F64, _) => 1e-6,
            (Precision::F32, false) => 1e-3,
            (Precision::F32, true) => 5e-3,
        }
    }

    /// An error if nothing can follow from it.
    pub(super) fn check(&self, precision: Precision) -> Result<(), Error> {
        if self.method == Method::Exact {
            return match (precision, self.sensors) {
                (Precision::F32, _) => {
                    Err(Error::Options("exact derivatives are of double precision; ask for precision f64".into()))
                }
                (_, true) => Err(Error::Options(
                    "sensors have no exact derivatives yet; take them by differences, or leave them out".into(),
                )),
                _ => Ok(()),
            };
        }
        let least = if precision == Precision::F32 { 1e-5 } else { 1e-12 };
        if self.eps >= least && self.eps <= 1.0 {
            return Ok(());
        }
        let (eps, why) = (self.eps, if precision == Precision::F32 { " in single precision" } else { "" });
        Err(Error::Options(format!("eps is {eps}; expected a number from {least:e} to 1{why}")))
    }
}

/// What decides where numbers are.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    of: Of,
    nv: usize,
    na: usize,
    nu: usize,
    /// Zero where no sensors are wanted.
    nsensordata: usize,
}

/// A matrix of derivatives: its name, what they are of, how many numbers that is, and its columns.
type Matrix = (&'static str, usize, usize);

impl Shape {
    pub fn new(model: &Model, of: Of, sensors: bool) -> Shape {
        let sizes = &model.tables().sizes;
        let nsensordata = if sensors && of == Of::Transition { sizes.nsensordata } else { 0 };
        Shape { of, nv: sizes.nv, na: sizes.na, nu: sizes.nu, nsensordata }
    }

    /// Kinds of columns, in the order in which they are gone through: none changes what the next ones take over from the nominal states.
    pub fn kinds(&self) -> &'static [Kind] {
        match self.of {
            Of::Inverse => &[Kind::Acceleration, Kind::Velocity, Kind::Position],
            Of::Transition | Of::Acceleration => &[Kind::Actuation, Kind::Velocity, Kind::Position],
        }
    }

    /// How many columns of a kind there are, and the first of them among all.
    pub fn columns(&self, kind: Kind) -> (usize, usize) {
        match kind {
            Kind::Position => (self.nv, 0),
            Kind::Velocity => (self.nv, self.nv),
            Kind::Actuation => (self.na + self.nu, 2 * self.nv),
            Kind::Acceleration => (self.nv, 2 * self.nv),
        }
    }

    /// How many columns there are.
    pub fn all(&self) -> usize {
        self.kinds().iter().map(|kind| self.columns(*kind).0).sum()
    }

    /// The matrices, in the order in which they are among the rows.
    fn matrices(&self) -> ArrayVec<Matrix, 4> {
        let (n, nv, nu, ns) = (2 * self.nv + self.na, self.nv, self.nu, self.nsensordata);
        match self.of {
            Of::Transition => ArrayVec::from([("A", n, n), ("B", n, nu), ("C", ns, n), ("D", ns, nu)]),
            Of::Acceleration => ArrayVec::from_iter([("A", nv, n), ("B", nv, nu)]),
            Of::Inverse => ArrayVec::from_iter([("dq", nv, nv), ("dv", nv, nv), ("da", nv, nv)]),
        }
    }

    /// Rows of the matrices without those of sensors.
    pub fn height(&self) -> usize {
        if self.of == Of::Transition { 2 * self.nv + self.na } else { self.nv }
    }

    /// Of the matrices without those of sensors: place among the rows, height, width, and the first of all columns.
    pub fn by_columns(&self) -> impl Iterator<Item = [usize; 4]> {
        let mut first = 0;
        let there = self.matrices().into_iter().enumerate().filter(|(_, (name, ..))| !matches!(*name, "C" | "D"));
        there.map(move |(place, (_, height, width))| {
            first += width;
            [place, height, width, first - width]
        })
    }

    /// The arrays: name, a world's dimensions, and whether it is of integers.
    pub fn arrays(&self) -> Vec<(&'static str, Vec<usize>, bool)> {
        let matrices = self.matrices().into_iter().map(|(name, height, width)| (name, vec![height, width], false));
        let marks = [("sides", vec![self.all()], true), ("changed", vec![self.all()], true), ("status", vec![], true)];
        matrices.chain(marks).collect()
    }

    /// Place of the first mark among the rows.
    fn marks(&self) -> usize {
        match self.of {
            Of::Transition => 4,
            Of::Acceleration => 2,
            Of::Inverse => 3,
        }
    }

    /// Writes some columns of a world that follow each other and are of one kind: how many, and their numbers by row, those of all matrices
    /// that have the column one after the other.
    pub fn write<const N: usize>(
        &self,
        rows: &mut [Rows<'_>],
        (world, column): (usize, usize),
        count: usize,
        slopes: impl Fn(usize) -> [f64; N],
    ) {
        let (n, nv, nu, ns) = (2 * self.nv + self.na, self.nv, self.nu, self.nsensordata);
        // Of the place of a matrix, its height, its first row among the slopes, and its width.
        let mut put = |[place, height, above, width]: [usize; 4], column: usize, before: usize, count: usize| {
            let at = world * height * width + column;
            rows[place]
                .block((at, width), (if count > 0 { height } else { 0 }, count), before, |row| slopes(above + row));
        };
        // Activations and controls are of one kind.
        let states = n.saturating_sub(column).min(count);
        let control = (column + states).saturating_sub(n);
        match self.of {
            Of::Inverse => put([column / nv, nv, 0, nv], column % nv, 0, count),
            Of::Acceleration => {
                put([0, nv, 0, n], column.min(n), 0, states);
                put([1, nv, 0, nu], control, states, count - states);
            }
            Of::Transition => {
                put([0, n, 0, n], column.min(n), 0, states);
                put([2, ns, n, n], column.min(n), 0, states);
                put([1, n, 0, nu], control, states, count - states);
                put([3, ns, n, nu], control, states, count - states);
            }
        }
    }

    /// Writes to which sides a column was perturbed, and how many rows began or ceased to act there.
    pub fn mark(&self, rows: &mut [Rows<'_>], world: usize, column: usize, sides: [bool; 2], changed: u32) {
        let mark = match sides {
            [true, true] => 2.0,
            [true, false] => 1.0,
            [false, true] => -1.0,
            [false, false] => 0.0,
        };
        let (at, place) = (world * self.all() + column, self.marks());
        rows[place].write(at, &[mark]);
        rows[place + 1].write(at, &[f64::from(changed)]);
    }

    /// Writes what happened to a world's states.
    pub fn note(&self, rows: &mut [Rows<'_>], world: usize, status: Status) {
        rows[self.marks() + 2].write(world, &[f64::from(status.0)]);
    }

    /// Writes that a world has no derivatives.
    pub fn lose(&self, rows: &mut [Rows<'_>], world: usize, status: Status) {
        for ((_, dims, integers), rows) in self.arrays().iter().zip(rows.iter_mut()) {
            let entries: usize = dims.iter().product();
            rows.write(world * entries, &vec![if *integers { 0.0 } else { f64::NAN }; entries]);
        }
        self.note(rows, world, status);
    }
}
