//! Points of clouds, and what is made of what follows from them.

use lanesim::cloud::{Grid, How, Points, Smoothing, Target};
use lanesim::rows::{Strided, Values};
use lanesim::{Model as Compiled, Precision};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3, PyReadwriteArray2,
    PyReadwriteArray3,
};
use numpy::{PyReadwriteArray4, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::failure::raise;
use crate::model::Model;

/// What follows from points: of "transition", "acceleration" or "inverse".
pub fn target<'a>(of: &str, qacc: Option<Values<'a>>, nv: usize) -> Target<'a> {
    match of {
        "inverse" => Target::Inverse(Strided { values: qacc.unwrap_or(Values::F64(&[])), offset: 0, stride: nv }),
        "acceleration" => Target::Acceleration,
        _ => Target::Transition,
    }
}

/// What the points are for.
enum Use {
    Differences(Grid),
    Smoothing(Smoothing),
}

/// Points around states.
#[pyclass(frozen, module = "lanesim._lanesim")]
pub struct Cloud {
    pub points: Points,
    /// How near a control can be to its limit before it is moved one way only.
    pub reach: Option<f64>,
    made: Use,
}

impl Cloud {
    fn taken(&self) -> &[usize] {
        match &self.made {
            Use::Differences(grid) => grid.columns(),
            Use::Smoothing(noise) => noise.columns(),
        }
    }
}

type Parts = Vec<(&'static str, usize)>;

#[pymethods]
impl Cloud {
    /// Points for differences along columns; `scheme`: eps, or what is usual, centred, whether second ones are wanted.
    #[staticmethod]
    fn differences(
        py: Python<'_>,
        model: &Model,
        of: &str,
        columns: Option<Vec<usize>>,
        scheme: (Option<f64>, bool, bool),
        single: bool,
    ) -> PyResult<Cloud> {
        let (eps, centred, second) = scheme;
        let precision = if single { Precision::F32 } else { Precision::F64 };
        let scheme = (eps.unwrap_or_else(|| Grid::eps(precision, centred, second)), centred, second);
        let model: &Compiled = &model.model;
        let grid = Grid::new(model, &target(of, None, 0), columns.as_deref(), scheme).map_err(|e| raise(py, e))?;
        Ok(Cloud { points: grid.points(), reach: Some(grid.reach()), made: Use::Differences(grid) })
    }

    /// Points of normal noise.
    #[staticmethod]
    fn noise(py: Python<'_>, model: &Model, of: &str, scales: Vec<f64>, pairs: usize, seed: u64) -> PyResult<Cloud> {
        let model: &Compiled = &model.model;
        let made = py.detach(|| Smoothing::new(model, &target(of, None, 0), &scales, (pairs, seed)));
        let made = made.map_err(|e| raise(py, e))?;
        Ok(Cloud { points: made.points(), reach: None, made: Use::Smoothing(made) })
    }

    fn __len__(&self) -> usize {
        self.points.len()
    }

    /// The columns of which there are derivatives.
    fn columns<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<usize>> {
        self.taken().to_vec().into_pyarray(py)
    }

    /// For each point, which of these columns it is moved in, `[npoint, n]`.
    fn moved<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<bool>>> {
        let columns = self.taken();
        let mut moved = vec![false; self.points.len() * columns.len()];
        for point in 0..self.points.len() {
            for (column, _) in self.points.moves(point) {
                if let Some(place) = columns.iter().position(|own| own == column) {
                    moved[point * columns.len() + place] = true;
                }
            }
        }
        moved.into_pyarray(py).reshape([self.points.len(), columns.len()])
    }

    /// Names and numbers of what follows from a point, and of a point.
    #[staticmethod]
    fn parts(model: &Model, of: &str, sensors: bool, tangent: bool) -> (Parts, Parts, usize) {
        let (model, target): (&Compiled, _) = (&model.model, target(of, None, 0));
        let how = How { sensors, tangent, ..How::default() };
        (target.after(model, &how), target.before(model), target.columns(model))
    }

    /// Derivatives by differences, `[N, m, n]` and, if there is room for them, `[N, m, n, n]`, of values `[N, npoint, m]`.
    fn differentiate(
        &self,
        py: Python<'_>,
        values: PyReadonlyArray3<'_, f64>,
        sides: PyReadonlyArray2<'_, f64>,
        mut gradient: PyReadwriteArray3<'_, f64>,
        mut hessian: Option<PyReadwriteArray4<'_, f64>>,
    ) -> PyResult<()> {
        let Use::Differences(grid) = &self.made else { return Ok(()) };
        let &[count, npoint, m] = values.shape() else { return Ok(()) };
        let (n, all) = (grid.columns().len(), sides.shape()[1]);
        let (values, sides, gradient) = (values.as_slice()?, sides.as_slice()?, gradient.as_slice_mut()?);
        let hessian = hessian.as_mut().map(|hessian| hessian.as_slice_mut()).transpose()?.unwrap_or_default();
        py.detach(|| {
            let square = hessian.len().checked_div(count).unwrap_or(0);
            for i in 0..count {
                let (gradient, hessian) = (&mut gradient[i * m * n..][..m * n], &mut hessian[i * square..][..square]);
                grid.differentiate(
                    &values[i * npoint * m..][..npoint * m],
                    &sides[i * all..][..all],
                    gradient,
                    hessian,
                );
            }
        });
        Ok(())
    }

    /// Means, `[N, m]`, and their gradients, `[N, m, n]`, by noise, of values `[N, npoint, m]`.
    fn fit(
        &self,
        py: Python<'_>,
        values: PyReadonlyArray3<'_, f64>,
        mut mean: PyReadwriteArray2<'_, f64>,
        mut gradient: PyReadwriteArray3<'_, f64>,
    ) -> PyResult<()> {
        let Use::Smoothing(noise) = &self.made else { return Ok(()) };
        let &[count, npoint, m] = values.shape() else { return Ok(()) };
        let n = noise.columns().len();
        let (values, mean, gradient) = (values.as_slice()?, mean.as_slice_mut()?, gradient.as_slice_mut()?);
        py.detach(|| {
            for i in 0..count {
                let (mean, gradient) = (&mut mean[i * m..][..m], &mut gradient[i * m * n..][..m * n]);
                noise.fit(&values[i * npoint * m..][..npoint * m], mean, gradient);
            }
        });
        Ok(())
    }
}
