//! What is asked of a cloud, and where its results go.

use std::sync::atomic::{AtomicBool, AtomicU64};

use lanesim_kernels::state::Status;

use crate::error::Error;
use crate::model::Model;
use crate::options::Precision;
use crate::rows::Rows;

/// How derivatives are taken: by which differences, and of what.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scheme {
    /// How far a number of the state is moved: m, rad, and so on.
    pub eps: f64,
    /// Whether it is moved to both sides, which costs twice as much and is exact to second order.
    pub centred: bool,
    /// Whether derivatives of sensors are wanted.
    pub sensors: bool,
}

impl Default for Scheme {
    fn default() -> Self {
        Scheme { eps: Scheme::eps(Precision::F64, true), centred: true, sensors: false }
    }
}

/// What is computed, and who follows it.
pub(crate) struct Request<'a> {
    pub scheme: Scheme,
    /// Whether a solution that did not converge is none.
    pub strict: bool,
    /// Counts the worlds that are done.
    pub progress: Option<&'a AtomicU64>,
    pub cancel: Option<&'a AtomicBool>,
}

/// The lengths that decide where numbers are.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    pub nv: usize,
    pub na: usize,
    pub nu: usize,
    /// Zero where no sensors are wanted.
    pub nsensordata: usize,
}

/// Places of arrays among the rows, see [`arrays`](crate::cloud::arrays).
const SIDES: usize = 4;
const STATUS: usize = 5;

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
        let least = if precision == Precision::F32 { 1e-5 } else { 1e-12 };
        if self.eps >= least && self.eps <= 1.0 {
            return Ok(());
        }
        let (eps, why) = (self.eps, if precision == Precision::F32 { " in single precision" } else { "" });
        Err(Error::Options(format!("eps is {eps}; expected a number from {least:e} to 1{why}")))
    }
}

impl Shape {
    pub fn new(model: &Model, sensors: bool) -> Shape {
        let sizes = &model.tables().sizes;
        let nsensordata = if sensors { sizes.nsensordata } else { 0 };
        Shape { nv: sizes.nv, na: sizes.na, nu: sizes.nu, nsensordata }
    }

    /// Numbers by which states are told.
    pub fn states(&self) -> usize {
        2 * self.nv + self.na
    }

    /// Writes a column of a world: derivatives of the next state, then of sensors.
    pub fn write(&self, rows: &mut [Rows<'_>], world: usize, column: usize, slopes: impl IntoIterator<Item = f64>) {
        let n = self.states();
        let mut slopes = slopes.into_iter();
        // By the state, or by controls.
        let (pair, column, width) = match column.checked_sub(n) {
            None => ([0, 2], column, n),
            Some(control) => ([1, 3], control, self.nu),
        };
        for (place, height) in pair.into_iter().zip([n, self.nsensordata]) {
            let start = world * height * width + column;
            rows[place].column(start, width, slopes.by_ref().take(height));
        }
    }

    /// Writes to which sides a column was perturbed.
    pub fn mark(&self, rows: &mut [Rows<'_>], world: usize, column: usize, sides: [bool; 2]) {
        let mark = match sides {
            [true, true] => 2.0,
            [true, false] => 1.0,
            [false, true] => -1.0,
            [false, false] => 0.0,
        };
        rows[SIDES].write(world * (self.states() + self.nu) + column, &[mark]);
    }

    /// Writes what happened to a world's states.
    pub fn note(&self, rows: &mut [Rows<'_>], world: usize, status: Status) {
        rows[STATUS].write(world, &[f64::from(status.0)]);
    }

    /// Writes that a world has no derivatives.
    pub fn lose(&self, rows: &mut [Rows<'_>], world: usize, status: Status) {
        let (n, ns) = (self.states(), self.nsensordata);
        for (rows, entries) in rows.iter_mut().zip([n * n, n * self.nu, ns * n, ns * self.nu]) {
            rows.write(world * entries, &vec![f64::NAN; entries]);
        }
        rows[SIDES].write(world * (n + self.nu), &vec![0.0; n + self.nu]);
        self.note(rows, world, status);
    }
}
