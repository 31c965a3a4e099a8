//! First and second differences of anything that can be told of a cloud's points.

use std::ops::Range;

use super::Target;
use super::visit::Points;
use crate::error::Error;
use crate::model::Model;
use crate::options::Precision;

/// Points of which first and second differences are taken along some columns. *Forward*: the state itself, each column moved by `eps`, and, for
/// second differences, each two of them, a column with itself included. *Centred*: the same to both sides, where only controls are moved twice,
/// for those at a limit.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    columns: Vec<usize>,
    /// Which of the columns, by their places, are those of controls.
    controls: Vec<usize>,
    eps: f64,
    centred: bool,
    second: bool,
}

impl Grid {
    /// Differences along these columns of a target, or, if none are named, along all but those of forces. `second`: whether second ones
    /// are wanted.
    ///
    /// # Errors
    ///
    /// If there is no such column, or one comes twice; if `eps` is out of bounds.
    pub fn new(
        model: &Model,
        target: &Target<'_>,
        columns: Option<&[usize]>,
        (eps, centred, second): (f64, bool, bool),
    ) -> Result<Grid, Error> {
        let sizes = &model.tables().sizes;
        let (all, forces) = (target.columns(model), if matches!(target, Target::Inverse(_)) { 0 } else { sizes.nv });
        let columns = columns.map_or_else(|| (0..all - forces).collect(), <[usize]>::to_vec);
        let mut seen = vec![false; all];
        for column in &columns {
            match seen.get_mut(*column) {
                None => {
                    return Err(Error::Input(format!("there is no column {column}; there are {all}, counted from 0")));
                }
                Some(true) => return Err(Error::Input(format!("column {column} is named twice; name each once"))),
                Some(seen) => *seen = true,
            }
        }
        if !(1e-12..=1.0).contains(&eps) {
            return Err(Error::Options(format!("eps is {eps}; expected a number from 1e-12 to 1")));
        }
        let first = 2 * sizes.nv + sizes.na;
        let those: Range<usize> = if forces > 0 { first..first + sizes.nu } else { 0..0 };
        let controls = (0..columns.len()).filter(|i| those.contains(&columns[*i])).collect();
        Ok(Grid { columns, controls, eps, centred, second })
    }

    /// How far to move where nobody says it.
    pub fn eps(precision: Precision, centred: bool, second: bool) -> f64 {
        match (precision, second, centred) {
            (Precision::F64, true, _) => 1e-4,
            (Precision::F64, false, _) => 1e-6,
            (Precision::F32, true, _) => 2e-2,
            (Precision::F32, false, true) => 5e-3,
            (Precision::F32, false, false) => 1e-3,
        }
    }

    /// How near a control can be to its limit before it is moved one way only.
    pub fn reach(&self) -> f64 {
        if self.second { 2.0 * self.eps } else { self.eps }
    }

    /// The columns.
    pub fn columns(&self) -> &[usize] {
        &self.columns
    }

    /// The points, in the order in which [`differentiate`](Grid::differentiate) takes what follows from them.
    pub fn points(&self) -> Points {
        let Grid { columns, controls, eps, centred, second } = self;
        let mut points = Points::default();
        points.push([]);
        columns.iter().for_each(|column| points.push([(*column, *eps)]));
        if *centred {
            columns.iter().for_each(|column| points.push([(*column, -eps)]));
        }
        if !second {
            return points;
        }
        for (i, one) in columns.iter().enumerate() {
            if !centred {
                points.push([(*one, 2.0 * eps)]);
            }
            for other in &columns[i + 1..] {
                points.push([(*one, *eps), (*other, *eps)]);
                if *centred {
                    points.push([(*one, -eps), (*other, -eps)]);
                }
            }
        }
        if *centred {
            controls.iter().for_each(|i| points.push([(columns[*i], 2.0 * eps)]));
        }
        points
    }

    /// Place of the point at which both columns, by their places, are moved forward, or if they are the same, this one twice; the one at which
    /// both are moved backward, if there is one, is the next.
    fn pair(&self, i: usize, j: usize) -> usize {
        let (n, low, high) = (self.columns.len(), i.min(j), i.max(j));
        if !self.centred {
            return 1 + n + low * n - low * low.saturating_sub(1) / 2 + high - low;
        }
        if i == j {
            let place = self.controls.iter().position(|control| *control == i).unwrap_or(0);
            return 1 + 2 * n + n * (n - 1) + place;
        }
        let before = low * (n - 1) - low * low.saturating_sub(1) / 2;
        1 + 2 * n + 2 * (before + high - low - 1)
    }

    /// Derivatives along the columns of numbers that were found at the points of one state, `values`, `[npoint, m]`: `gradient`, `[m, n]`, and
    /// `hessian`, `[m, n, n]`, or nothing if there is no room for it. `sides`: how each of a target's columns could be moved, see
    /// [`Found`](super::Found).
    pub fn differentiate(&self, values: &[f64], sides: &[f64], gradient: &mut [f64], hessian: &mut [f64]) {
        let n = self.columns.len();
        let m = gradient.len().checked_div(n).unwrap_or(0);
        for k in 0..m {
            let at = |point: usize| values[point * m + k];
            let side = |i: usize| sides[self.columns[i]];
            for i in 0..n {
                gradient[k * n + i] = self.first(&at, i, side(i));
            }
            if hessian.is_empty() {
                continue;
            }
            for i in 0..n {
                for j in i..n {
                    let found = self.second(&at, (i, side(i)), (j, side(j)));
                    hessian[(k * n + i) * n + j] = found;
                    hessian[(k * n + j) * n + i] = found;
                }
            }
        }
    }

    /// Of the columns, how they could be moved, and how many rows began or ceased to act at most among the points for which they were.
    pub(super) fn mark(&self, sides: &[f64], changed: &[f64], [to_sides, to_changed]: [&mut [f64]; 2]) {
        to_sides.iter_mut().zip(&self.columns).for_each(|(to, column)| *to = sides[*column]);
        let points = self.points();
        for (point, changed) in changed.iter().enumerate().filter(|(_, changed)| **changed > 0.0) {
            for (column, _) in points.moves(point) {
                let place = self.columns.iter().position(|own| own == column).unwrap_or(0);
                to_changed[place] = to_changed[place].max(*changed);
            }
        }
    }

    fn first(&self, at: &impl Fn(usize) -> f64, i: usize, side: f64) -> f64 {
        let n = self.columns.len();
        match (side, self.centred) {
            (2.0, true) => (at(1 + i) - at(1 + n + i)) / (2.0 * self.eps),
            (0.0, _) => 0.0,
            _ => side.signum() * (at(1 + i) - at(0)) / self.eps,
        }
    }

    fn second(&self, at: &impl Fn(usize) -> f64, (i, one): (usize, f64), (j, other): (usize, f64)) -> f64 {
        let (n, square, pair) = (self.columns.len(), self.eps * self.eps, self.pair(i, j));
        let (forward, backward) = (|i: usize| at(1 + i), |i: usize| at(1 + n + i));
        match (self.centred && one == 2.0 && other == 2.0, i == j) {
            _ if one == 0.0 || other == 0.0 => 0.0,
            (true, true) => ((forward(i) - at(0)) + (backward(i) - at(0))) / square,
            (true, false) => {
                let (ahead, behind) = (at(pair) - forward(i) - forward(j), at(pair + 1) - backward(i) - backward(j));
                (ahead + behind + 2.0 * at(0)) / (2.0 * square)
            }
            _ => one.signum() * other.signum() * ((at(pair) - forward(i)) - (forward(j) - at(0))) / square,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Along columns that are those of a grid, a quadratic function's derivatives are exact, whatever can be moved where.
    #[test]
    fn quadratic_functions_have_exact_derivatives() {
        let (n, eps) = (4, 0.25);
        let x: Vec<f64> = (0..n).map(|i| 0.3 * i as f64 - 0.5).collect();
        let h = |i: usize, j: usize| 1.0 + (i * j) as f64 - 0.5 * (i + j) as f64;
        let f = |x: &[f64]| {
            let twice: f64 = (0..n).flat_map(|i| (0..n).map(move |j| (i, j))).map(|(i, j)| x[i] * h(i, j) * x[j]).sum();
            0.5 * twice + x.iter().enumerate().map(|(i, x)| i as f64 * x).sum::<f64>()
        };
        for (centred, sides) in [
            (false, [2.0, 2.0, 2.0, 2.0]),
            (true, [2.0, 2.0, 2.0, 2.0]),
            (false, [2.0, 2.0, -1.0, 1.0]),
            (true, [2.0, 2.0, -1.0, 1.0]),
            (true, [2.0, 2.0, 0.0, 1.0]),
        ] {
            let columns = (0..n).collect();
            let grid = Grid { columns, controls: vec![2, 3], eps, centred, second: true };
            let points = grid.points();
            let expected = if centred { n * n + n + 1 + 2 } else { 1 + n + n * (n + 1) / 2 };
            assert_eq!(points.len(), expected);
            let value = |point| {
                let mut moved = x.clone();
                for (column, distance) in points.moves(point) {
                    let side: f64 = sides[*column];
                    moved[*column] += if side == 2.0 { *distance } else { side * distance.abs() };
                }
                f(&moved)
            };
            let values: Vec<f64> = (0..points.len()).map(value).collect();
            let (mut gradient, mut hessian) = (vec![0.0; n], vec![0.0; n * n]);
            grid.differentiate(&values, &sides, &mut gradient, &mut hessian);
            for i in 0..n {
                for j in 0..n {
                    let expected = if sides[i] == 0.0 || sides[j] == 0.0 { 0.0 } else { h(i, j) };
                    assert!((hessian[i * n + j] - expected).abs() < 1e-12, "{centred} {sides:?} {i} {j}");
                }
                let slope = (0..n).map(|j| h(i, j) * x[j]).sum::<f64>() + i as f64;
                // One-sided first differences are off by half the step times the curvature.
                let off = if sides[i] == 2.0 && centred { 0.0 } else { 0.5 * eps * h(i, i) * sides[i].signum() };
                let expected = if sides[i] == 0.0 { 0.0 } else { slope + off };
                assert!((gradient[i] - expected).abs() < 1e-12, "{centred} {sides:?} {i}");
            }
        }
    }
}
