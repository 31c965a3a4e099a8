//! Second derivatives of what a state costs by what follows from it.

use std::collections::BTreeMap;

use super::points::width;
use super::{Call, Found, Grid, How, INPUTS, Of, Solving, Target, accurate, check_quaternions};
use crate::error::Error;
use crate::field::Field;
use crate::inverse;
use crate::memory;
use crate::model::Model;
use crate::npz::{Array, Data};
use crate::rows::{Rows, Strided, Values};
use crate::states::States;

/// Bytes of what is found at points at once.
const MOST: usize = 1 << 26;

/// A point as its cost sees it.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// What follows from it, see [`Target::after`].
    pub after: &'a [f64],
    /// The point itself, see [`Target::before`].
    pub before: &'a [f64],
}

/// What second derivatives are of.
pub struct Costs<'a> {
    /// How many costs a point has, or how many residuals.
    pub count: usize,
    /// Writes them. What follows is NaN where nothing does.
    pub of: &'a mut dyn FnMut(&Seen<'_>, &mut [f64]),
    /// By Gauss and Newton: the cost is half the sum of squares of residuals, whose curvature is left out. First differences are enough.
    pub gauss_newton: bool,
}

/// Values, gradients and Hessians of costs of many states: arrays as of [`transition`](super::transition), with `qacc` for inverse dynamics,
/// and the columns of `target` along which derivatives are taken, if not along all but those of forces. With the scheme of the
/// call: forward by 1 + n + n (n + 1) / 2 points a state, centred by n² + n + 1 and one for each control. Returns `value`, `[..., m]`, `gradient`,
/// `[..., m, n]`, and `hessian`, `[..., m, n, n]`, one for each cost, or a single one by Gauss and Newton; `sides`, `[..., n]`, how each column
/// was moved, as in [`Transition`](super::Transition); `changed`, `[..., n]`, how many contacts and limits begin or cease to push at
/// most among the points for which it was moved; `status`, `[...]`.
///
/// # Errors
///
/// As of [`transition`](super::transition); if there is no such column.
pub fn hessian(
    model: &Model,
    inputs: &BTreeMap<String, Array>,
    target: &Target<'_>,
    columns: Option<&[usize]>,
    costs: &mut Costs<'_>,
    call: &Call<'_>,
) -> Result<Vec<(String, Array)>, Error> {
    let of = target.of();
    let states = States::new(model, inputs, if of == Of::Inverse { &inverse::INPUTS } else { &INPUTS })?;
    let qpos = inputs.get(Field::Qpos.name());
    qpos.map_or(Ok(()), |qpos| check_quaternions(model, Values::F64(&qpos.to_f64()), qpos.shape()))?;
    let solves = call.solving == Solving::Accurate && of != Of::Inverse;
    let model = &if solves { accurate(model)? } else { model.clone() };
    let scheme = (call.scheme.eps, call.scheme.centred, !costs.gauss_newton);
    let grid = &Grid::new(model, target, columns, scheme)?;
    let points = grid.points();
    let how = How { solving: call.solving, sensors: call.scheme.sensors, reach: Some(grid.reach()), ..How::default() };
    let widths = [width(&target.after(model, &how)), width(&target.before(model))];
    let bytes = points.len() * (widths[0] + widths[1] + costs.count) * size_of::<f64>();
    let most = (MOST / bytes.max(1)).max(1);
    let limit = call.options.max_memory;
    let mut results = Results::new(grid, states.count, costs, limit)?;
    let nv = model.tables().sizes.nv;
    let qacc = states.numbers("qacc");
    states.each_of(model, call.options, most, |worlds, here| {
        let count = here.len();
        let room = |width: usize| memory::zeros("the points", &[count, width], limit);
        let [mut after, mut before] = [room(points.len() * widths[0])?, room(points.len() * widths[1])?];
        let mut marks = Marks { changed: room(points.len())?, sides: room(target.columns(model))?, status: room(1)? };
        let found = Found {
            after: Rows::F64(&mut after),
            before: Rows::F64(&mut before),
            changed: Rows::F64(&mut marks.changed),
            sides: Rows::F64(&mut marks.sides),
            status: Rows::F64(&mut marks.status),
        };
        let qacc = Strided { values: Values::F64(qacc), offset: here.start * nv, stride: nv };
        let target = if of == Of::Inverse { &Target::Inverse(qacc) } else { target };
        worlds.points_into(target, &points, &how, found, (call.progress, None))?;
        let mut values = room(points.len() * costs.count)?;
        for (point, values) in values.chunks_exact_mut(costs.count.max(1)).enumerate() {
            let row =
                |numbers, width: usize| -> &[f64] { &<[f64]>::as_ref(numbers)[point * width..(point + 1) * width] };
            (costs.of)(&Seen { after: row(&after, widths[0]), before: row(&before, widths[1]) }, values);
        }
        results.add(here.start, count, &values, &marks);
        Ok(())
    })?;
    results.arrays(&states.leading)
}

/// What was found about some states' columns.
struct Marks {
    changed: Vec<f64>,
    sides: Vec<f64>,
    status: Vec<f64>,
}

/// The arrays that are returned.
struct Results<'a> {
    grid: &'a Grid,
    gauss_newton: bool,
    /// Residuals, or costs.
    m: usize,
    /// Costs.
    own: usize,
    value: Vec<f64>,
    gradient: Vec<f64>,
    hessian: Vec<f64>,
    sides: Vec<f64>,
    changed: Vec<f64>,
    status: Vec<f64>,
}

impl<'a> Results<'a> {
    fn new(grid: &'a Grid, count: usize, costs: &Costs<'_>, limit: Option<usize>) -> Result<Self, Error> {
        let (n, m) = (grid.columns().len(), costs.count);
        let own = if costs.gauss_newton { 1 } else { m };
        let room = |width: &[usize]| memory::zeros("the derivatives", &[&[count], width].concat(), limit);
        Ok(Results {
            grid,
            gauss_newton: costs.gauss_newton,
            m,
            own,
            value: room(&[own])?,
            gradient: room(&[own, n])?,
            hessian: room(&[own, n, n])?,
            sides: room(&[n])?,
            changed: room(&[n])?,
            status: room(&[1])?,
        })
    }

    /// Derivatives of some states, from the first on.
    fn add(&mut self, first: usize, count: usize, values: &[f64], marks: &Marks) {
        let Results { grid, m, own, .. } = *self;
        let (n, points) = (grid.columns().len(), values.len() / (m * count).max(1));
        let all = marks.sides.len() / count.max(1);
        for i in 0..count {
            let state = first + i;
            let (values, sides) = (&values[i * points * m..(i + 1) * points * m], &marks.sides[i * all..(i + 1) * all]);
            let gradient = &mut self.gradient[state * own * n..(state + 1) * own * n];
            let hessian = &mut self.hessian[state * own * n * n..(state + 1) * own * n * n];
            let value = &mut self.value[state * own..(state + 1) * own];
            if self.gauss_newton {
                let mut jacobian = vec![0.0; m * n];
                grid.differentiate(values, sides, &mut jacobian, &mut []);
                value[0] = 0.5 * values[..m].iter().map(|r| r * r).sum::<f64>();
                gauss_newton(&jacobian, &values[..m], gradient, hessian);
            } else {
                grid.differentiate(values, sides, gradient, hessian);
                value.copy_from_slice(&values[..m]);
            }
            let here = state * n..(state + 1) * n;
            grid.mark(
                sides,
                &marks.changed[i * points..(i + 1) * points],
                [&mut self.sides[here.clone()], &mut self.changed[here]],
            );
            self.status[state] = marks.status[i];
        }
    }

    fn arrays(self, leading: &[usize]) -> Result<Vec<(String, Array)>, Error> {
        let (n, m) = (self.grid.columns().len(), self.own);
        let real = [
            ("value", vec![m], self.value),
            ("gradient", vec![m, n], self.gradient),
            ("hessian", vec![m, n, n], self.hessian),
        ];
        let whole =
            [("sides", vec![n], self.sides), ("changed", vec![n], self.changed), ("status", vec![], self.status)];
        let real = real.into_iter().map(|(name, dims, numbers)| (name, dims, Data::F64(numbers)));
        let integers = |numbers: Vec<f64>| Data::I32(numbers.into_iter().map(|x| x as i32).collect());
        let whole = whole.into_iter().map(|(name, dims, numbers)| (name, dims, integers(numbers)));
        let joined = real.chain(whole).map(|(name, dims, data)| {
            let array = Array::new(leading.iter().copied().chain(dims).collect(), data);
            array.map(|array| (name.to_owned(), array)).ok_or(Error::Memory { what: "the derivatives", bytes: None })
        });
        joined.collect()
    }
}

/// Gradient and Hessian of half the sum of squares of residuals, but for their curvature: J'r and J'J.
fn gauss_newton(jacobian: &[f64], residuals: &[f64], gradient: &mut [f64], hessian: &mut [f64]) {
    let n = gradient.len();
    gradient.fill(0.0);
    hessian.fill(0.0);
    for (row, residual) in jacobian.chunks_exact(n.max(1)).zip(residuals) {
        for i in 0..n {
            gradient[i] += row[i] * residual;
            for j in 0..n {
                hessian[i * n + j] += row[i] * row[j];
            }
        }
    }
}
