//! Randomised smoothing: the mean of anything over normal noise around a state, and the gradient of that mean.

use super::Target;
use super::visit::Points;
use crate::error::Error;
use crate::model::Model;
use crate::noise;

/// Noise around states, the same around each of them: pairs of points on both sides, so that odd moments vanish. The same seed gives the same
/// points, whatever else is asked for, so that differences between states are not those of the noise.
#[derive(Clone, Debug, PartialEq)]
pub struct Smoothing {
    columns: Vec<usize>,
    scales: Vec<f64>,
    pairs: usize,
    /// Standard normal numbers, `[pairs, n]`.
    draws: Vec<f64>,
    /// The inverse of the draws' second moments, `[n, n]`.
    inverse: Vec<f64>,
}

impl Smoothing {
    /// Noise of a standard deviation for each column of a target (see [`Points`]), `scales`; where it is zero there is none, and no derivative.
    ///
    /// # Errors
    ///
    /// If there is not a scale for each column, or one is negative or not finite; if there are fewer pairs than columns with noise, from
    /// which no gradient follows.
    pub fn new(
        model: &Model,
        target: &Target<'_>,
        scales: &[f64],
        (pairs, seed): (usize, u64),
    ) -> Result<Smoothing, Error> {
        let expected = target.columns(model);
        if scales.len() != expected {
            return Err(Error::Input(format!(
                "{} scales of noise; expected {expected}, one for each column",
                scales.len()
            )));
        }
        if let Some((column, scale)) = scales.iter().enumerate().find(|(_, x)| !x.is_finite() || **x < 0.0) {
            return Err(Error::Input(format!("the scale of noise in column {column} is {scale}; expected 0 or more")));
        }
        let columns: Vec<usize> = (0..expected).filter(|column| scales[*column] > 0.0).collect();
        let n = columns.len();
        if n == 0 {
            return Err(Error::Input("no column has noise; give one a scale above 0".into()));
        }
        if pairs < n {
            return Err(Error::Input(format!(
                "{pairs} pairs of points for {n} columns with noise; give as many pairs as columns, or rather some times more"
            )));
        }
        let draws: Vec<f64> =
            (0..pairs * n).map(|i| noise::normal(seed, (i / n) as u64, 0, columns[i % n] as u64)).collect();
        let inverse = inverse_of(&moments(&draws, n), n)
            .ok_or_else(|| Error::Input(format!("{pairs} pairs of points do not span {n} columns; give more")))?;
        let scales = columns.iter().map(|column| scales[*column]).collect();
        Ok(Smoothing { columns, scales, pairs, draws, inverse })
    }

    /// The columns with noise.
    pub fn columns(&self) -> &[usize] {
        &self.columns
    }

    /// The points, in the order in which [`fit`](Smoothing::fit) takes what follows from them: twice as many as pairs.
    pub fn points(&self) -> Points {
        let mut points = Points::default();
        for draws in self.draws.chunks_exact(self.columns.len()) {
            for side in [1.0, -1.0] {
                let moves = self.columns.iter().zip(&self.scales).zip(draws);
                points.push(moves.map(|((column, scale), draw)| (*column, side * scale * draw)));
            }
        }
        points
    }

    /// Of numbers that were found at the points of one state, `values`, `[npoint, m]`: their mean, `[m]`, and its gradient by the columns with
    /// noise, `[m, n]`. By Stein's lemma the gradient of a mean over normal noise is the slope of the best linear fit; that of these points is
    /// exact for linear functions, and tends to it for all others as points become many.
    pub fn fit(&self, values: &[f64], mean: &mut [f64], gradient: &mut [f64]) {
        let (n, m) = (self.columns.len(), mean.len());
        let mut product = vec![0.0; n];
        for (k, mean) in mean.iter_mut().enumerate() {
            product.fill(0.0);
            let mut sum = 0.0;
            for (pair, draws) in self.draws.chunks_exact(n).enumerate() {
                let [plus, minus] = [0, 1].map(|side| values[(2 * pair + side) * m + k]);
                sum += plus + minus;
                let half = 0.5 * (plus - minus);
                product.iter_mut().zip(draws).for_each(|(product, draw)| *product += half * draw);
            }
            *mean = sum / (2 * self.pairs) as f64;
            for i in 0..n {
                let row = &self.inverse[i * n..(i + 1) * n];
                let slope: f64 = row.iter().zip(&product).map(|(a, b)| a * b).sum();
                gradient[k * n + i] = slope / self.scales[i];
            }
        }
    }
}

/// Sums of products of the columns of `draws`, `[.., n]`.
fn moments(draws: &[f64], n: usize) -> Vec<f64> {
    let mut sums = vec![0.0; n * n];
    for row in draws.chunks_exact(n) {
        for i in 0..n {
            (0..n).for_each(|j| sums[i * n + j] += row[i] * row[j]);
        }
    }
    sums
}

/// The inverse of a symmetric positive definite matrix, by Gauss and Jordan; none if it is not clearly one.
fn inverse_of(matrix: &[f64], n: usize) -> Option<Vec<f64>> {
    let (mut left, mut right) = (matrix.to_vec(), vec![0.0; n * n]);
    (0..n).for_each(|i| right[i * n + i] = 1.0);
    let largest = (0..n).map(|i| matrix[i * n + i]).fold(0.0, f64::max);
    for pivot in 0..n {
        let at = left[pivot * n + pivot];
        if at.is_nan() || at <= 1e-12 * largest {
            return None;
        }
        for matrix in [&mut left, &mut right] {
            matrix[pivot * n..(pivot + 1) * n].iter_mut().for_each(|x| *x /= at);
        }
        for row in (0..n).filter(|row| *row != pivot) {
            let factor = left[row * n + pivot];
            for matrix in [&mut left, &mut right] {
                (0..n).for_each(|j| matrix[row * n + j] -= factor * matrix[pivot * n + j]);
            }
        }
    }
    Some(right)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn smoothing(pairs: usize, scales: [f64; 3]) -> Smoothing {
        let xml = "<mujoco><worldbody><body><joint type='slide'/><geom size='.1'/></body></worldbody></mujoco>";
        let model = Model::from_xml_string(xml, &Default::default()).unwrap();
        Smoothing::new(&model, &Target::Transition, &scales, (pairs, 5)).unwrap()
    }

    fn values(of: &Smoothing, f: impl Fn(&[f64; 3]) -> f64) -> Vec<f64> {
        let points = of.points();
        let value = |point| {
            let mut x = [0.0; 3];
            points.moves(point).iter().for_each(|(column, distance)| x[*column] = *distance);
            f(&x)
        };
        (0..points.len()).map(value).collect()
    }

    #[test]
    fn linear_functions_are_fitted_exactly() {
        let noise = smoothing(4, [0.5, 0.0, 2.0]);
        assert_eq!(noise.columns(), [0, 2]);
        let (mut mean, mut gradient) = ([0.0], [0.0; 2]);
        noise.fit(&values(&noise, |x| 3.0 + 2.0 * x[0] - 7.0 * x[2]), &mut mean, &mut gradient);
        assert!((mean[0] - 3.0).abs() < 1e-12, "{mean:?}");
        assert!((gradient[0] - 2.0).abs() < 1e-12 && (gradient[1] + 7.0).abs() < 1e-12, "{gradient:?}");
    }

    /// The mean of |x + 1| over normal noise of deviation s is s sqrt(2 / pi) exp(-1 / 2 s^2) + erf(1 / s sqrt 2), its slope
    /// the latter term.
    #[test]
    fn a_kink_is_smoothed_as_its_formula_says() {
        let noise = smoothing(1 << 17, [2.0, 0.0, 0.0]);
        let (mut mean, mut gradient) = ([0.0], [0.0]);
        noise.fit(&values(&noise, |x| (x[0] + 1.0).abs()), &mut mean, &mut gradient);
        let erf = 0.382_924_922_548_026_2;
        let expected = 2.0 * (2.0 / std::f64::consts::PI).sqrt() * (-0.125_f64).exp() + erf;
        assert!((mean[0] - expected).abs() < 0.01, "{mean:?} {expected}");
        assert!((gradient[0] - erf).abs() < 0.01, "{gradient:?} {erf}");
    }
}
