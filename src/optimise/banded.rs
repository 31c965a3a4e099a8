//! Symmetric matrices of blocks along a band, and their factor.

use faer::linalg::solvers::Solve;
use faer::sparse::{SparseColMat, Triplet};
use faer::{Mat, Side};

/// Blocks below the diagonal that there are.
const BELOW: usize = 2;

/// A symmetric matrix in which a block couples with the two before and after it.
pub(super) struct Banded {
    width: usize,
    /// By row of blocks, that of the diagonal, then those before it.
    blocks: Vec<[Mat<f64>; BELOW + 1]>,
}

impl Banded {
    /// Zeros: so many blocks of so many numbers.
    pub fn new(count: usize, width: usize) -> Banded {
        let zeros = || std::array::from_fn(|_| Mat::zeros(width, width));
        Banded { width, blocks: (0..count).map(|_| zeros()).collect() }
    }

    /// Adds to an entry and to the one across the diagonal, which are one if they are the same; `at`: block and place in it. The second must not be later.
    pub fn add(&mut self, row: (usize, usize), column: (usize, usize), value: f64) {
        self.blocks[row.0][row.0 - column.0][(row.1, column.1)] += value;
    }

    /// x with (H + μ diag H) x = b; `None` if that is not positive definite.
    pub fn solve(&self, mu: f64, b: &[f64]) -> Option<Vec<f64>> {
        let (n, width) = (b.len(), self.width);
        let mut entries = Vec::with_capacity(n * width * (BELOW + 1));
        for (block, row) in self.blocks.iter().enumerate() {
            for (back, part) in row.iter().enumerate().filter(|(back, _)| *back <= block) {
                for i in 0..width {
                    let columns = if back == 0 { i + 1 } else { width };
                    for k in 0..columns {
                        let own = back == 0 && i == k;
                        let val = part[(i, k)] * if own { 1.0 + mu } else { 1.0 };
                        entries.push(Triplet { row: block * width + i, col: (block - back) * width + k, val });
                    }
                }
            }
        }
        let matrix = SparseColMat::<usize, f64>::try_new_from_triplets(n, n, &entries).ok()?;
        let factor = matrix.sp_cholesky(Side::Lower).ok()?;
        let x = factor.solve(Mat::from_fn(n, 1, |i, _| b[i]));
        let x: Vec<f64> = (0..n).map(|i| x[(i, 0)]).collect();
        x.iter().all(|x| x.is_finite()).then_some(x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solutions_fit() {
        let (count, width) = (5, 3);
        let n = count * width;
        let mut banded = Banded::new(count, width);
        let mut dense = Mat::<f64>::zeros(n, n);
        for i in 0..n {
            for k in (0..=i).filter(|k| i / width - k / width <= BELOW) {
                let value = if i == k { 9.0 } else { ((i * 7 + k * 3) as f64).sin() };
                banded.add((i / width, i % width), (k / width, k % width), value);
                dense[(i, k)] = value;
                dense[(k, i)] = value;
            }
        }
        let b: Vec<f64> = (0..n).map(|i| (i as f64).cos()).collect();
        let x = banded.solve(0.5, &b).expect("a solution");
        for i in 0..n {
            let product: f64 = (0..n).map(|k| dense[(i, k)] * x[k]).sum::<f64>() + 4.5 * x[i];
            assert!((product - b[i]).abs() < 1e-12, "{i}: {product} {}", b[i]);
        }
        banded.add((0, 0), (0, 0), -100.0);
        assert!(banded.solve(0.0, &b).is_none());
    }
}
