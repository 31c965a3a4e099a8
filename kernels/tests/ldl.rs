//! The sparse factor against faer, over random trees and filled patterns.

mod support;

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use lanesim_kernels::lane::{Lane, LaneQuery, Real};
use lanesim_kernels::math::ldl;
use lanesim_kernels::model::{Pattern, Rows, Span};
use support::{Random, block};
use wide::{f32x16, f64x8};

/// Which entries below the diagonal are there.
type Shape = Vec<Vec<bool>>;

/// The ancestors of every dof of a random forest.
fn forest(n: usize, random: &mut Random) -> Shape {
    let mut shape: Shape = Vec::new();
    for i in 0..n {
        // A chain more often than not; now and then a new tree.
        let parent = if i == 0 || random.below(8) == 0 {
            None
        } else if random.below(3) > 0 {
            Some(i - 1)
        } else {
            Some(random.below(i))
        };
        let mut row = vec![false; i];
        if let Some(p) = parent {
            row[..p].copy_from_slice(&shape[p]);
            row[p] = true;
        }
        shape.push(row);
    }
    shape
}

/// The shape with a few more entries, and all that elimination makes of them.
fn filled(shape: &Shape, random: &mut Random) -> Shape {
    let mut wide = shape.clone();
    let n = wide.len();
    for _ in 0..n / 6 + 1 {
        let (i, j) = (random.below(n), random.below(n));
        if i != j {
            wide[i.max(j)][i.min(j)] = true;
        }
    }
    for k in (0..n).rev() {
        let columns: Vec<usize> = (0..k).filter(|j| wide[k][*j]).collect();
        for (n, i) in columns.iter().enumerate() {
            columns[..n].iter().for_each(|j| wide[*i][*j] = true);
        }
    }
    wide
}

/// Storage with room for a shape.
fn rows(shape: &Shape) -> Rows {
    let mut out = Rows::default();
    let mut start = 0;
    for (i, row) in shape.iter().enumerate() {
        let first = row.iter().position(|there| *there).unwrap_or(i);
        out.start.push(start);
        out.first.push(first as u32);
        start += (i - first + 1) as u32;
    }
    out
}

/// The runs of a shape.
fn pattern(shape: &Shape) -> Pattern {
    let (mut runs, mut rows): (Vec<Span>, Vec<Span>) = (vec![], vec![]);
    for row in shape {
        let first = runs.len() as u32;
        for (j, there) in row.iter().enumerate() {
            if *there && j > 0 && row[j - 1] {
                runs.last_mut().expect("a run").len += 1;
            } else if *there {
                runs.push(Span { start: j as u32, len: 1 });
            }
        }
        rows.push(Span { start: first, len: runs.len() as u32 - first });
    }
    Pattern::new(runs, rows)
}

/// A random positive definite matrix of the given shape: Lᵀ D L.
fn matrix(shape: &Shape, random: &mut Random) -> Mat<f64> {
    let n = shape.len();
    let l = Mat::from_fn(n, n, |i, j| match i.cmp(&j) {
        std::cmp::Ordering::Equal => 1.0,
        std::cmp::Ordering::Greater if shape[i][j] => random.uniform(-0.7, 0.7),
        _ => 0.0,
    });
    let d = Mat::from_fn(n, n, |i, j| if i == j { random.uniform(0.2, 3.0) } else { 0.0 });
    l.transpose() * d * &l
}

/// The lower triangle as stored.
fn store(rows: &Rows, m: &Mat<f64>) -> Vec<f64> {
    (0..m.nrows()).flat_map(|i| (rows.first[i] as usize..=i).map(move |j| m[(i, j)])).collect()
}

fn cast<L: Lane>(x: &[f64]) -> Vec<L> {
    x.iter().map(|x| L::of(*x)).collect()
}

struct Solution<L> {
    factor: Vec<L>,
    x: Vec<L>,
    singular: u32,
}

fn solve<L: LaneQuery>(rows: &Rows, pattern: &Pattern, m: &[L], b: &[L]) -> Solution<L> {
    let (mut factor, mut inverse, mut x) = (m.to_vec(), vec![L::zero(); b.len()], b.to_vec());
    let mut scratch = vec![L::of(f64::NAN); b.len()];
    let singular = L::bits(ldl::factor(rows, pattern, &mut factor, &mut inverse, &mut scratch));
    ldl::solve(rows, pattern, &factor, &inverse, &mut x);
    Solution { factor, x, singular }
}

/// Largest difference over the largest value.
fn error(got: &[f64], exact: &[f64]) -> f64 {
    let size = exact.iter().fold(1.0_f64, |m, x| m.max(x.abs()));
    got.iter().zip(exact).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs())) / size
}

/// Sizes of the systems: every small one, and some that fill more than one word of bits.
fn sizes() -> impl Iterator<Item = usize> {
    (1..=24).chain([31, 40, 64, 70])
}

/// Factor, solve and multiply for one shape, in one number type.
fn check_against_faer<R: LaneQuery<Real = R> + Real>(shape: &Shape, random: &mut Random, tolerance: f64) {
    let n = shape.len();
    let (rows, pattern) = (rows(shape), pattern(shape));
    let m = matrix(shape, random);
    let b: Vec<f64> = (0..n).map(|_| random.uniform(-1.0, 1.0)).collect();
    let stored: Vec<R> = cast(&store(&rows, &m));
    let numbers = |x: &[R]| x.iter().map(|x| x.to_f64()).collect::<Vec<f64>>();

    let mut product = vec![R::zero(); n];
    ldl::multiply(&rows, &pattern, &stored, &cast(&b), &mut product);
    let column = Mat::from_fn(n, 1, |i, _| b[i]);
    let exact: Vec<f64> = (&m * &column).col(0).iter().copied().collect();
    let e = error(&numbers(&product), &exact);
    assert!(e < tolerance, "product of size {n} in {}: {e:.1e}", R::NAME_OF);

    let solution = solve(&rows, &pattern, &stored, &cast(&b));
    let exact = m.llt(Side::Lower).expect("positive definite").solve(&column);
    let exact: Vec<f64> = exact.col(0).iter().copied().collect();
    let e = error(&numbers(&solution.x), &exact);
    assert!(e < 1e3 * tolerance && solution.singular == 0, "solution of size {n} in {}: {e:.1e}", R::NAME_OF);
}

/// Names for messages.
trait Named {
    const NAME_OF: &'static str;
}
impl<T: Real> Named for T {
    const NAME_OF: &'static str = T::NAME;
}

#[test]
fn agrees_with_faer() {
    let mut random = Random(5);
    for n in sizes() {
        for _ in 0..5 {
            let tree = forest(n, &mut random);
            let wide = filled(&tree, &mut random);
            for shape in [&tree, &wide] {
                // A product of n terms rounds n times; conditions of these matrices reach a few hundred.
                check_against_faer::<f64>(shape, &mut random, 1e-14);
                check_against_faer::<f32>(shape, &mut random, 1e-5);
            }
        }
    }
}

/// The same matrix factored with a wider pattern: the same bits, but for signs of zeros.
fn check_wider_pattern<R: LaneQuery<Real = R> + Real>(n: usize, random: &mut Random) {
    let tree = forest(n, random);
    let wide = filled(&tree, random);
    let rows = rows(&wide);
    let m: Vec<R> = cast(&store(&rows, &matrix(&tree, random)));
    let b: Vec<R> = (0..n).map(|_| R::of(random.uniform(-1.0, 1.0))).collect();
    let narrow = solve(&rows, &pattern(&tree), &m, &b);
    let wider = solve(&rows, &pattern(&wide), &m, &b);
    for (a, b) in narrow.factor.iter().zip(&wider.factor).chain(narrow.x.iter().zip(&wider.x)) {
        assert_eq!((*a + R::zero()).bits(), (*b + R::zero()).bits(), "size {n}: {a:?}, {b:?}");
    }
}

#[test]
fn a_wider_pattern_gives_the_same_bits() {
    let mut random = Random(6);
    for n in sizes() {
        for _ in 0..20 {
            check_wider_pattern::<f64>(n, &mut random);
            check_wider_pattern::<f32>(n, &mut random);
        }
    }
}

/// A different matrix in every lane: each lane as if it were alone.
fn check_lanes<W: LaneQuery<Real: LaneQuery<Real = W::Real>>>(n: usize, random: &mut Random) {
    let shape = forest(n, random);
    let (rows, pattern) = (rows(&shape), pattern(&shape));
    let mut each = |f: &mut dyn FnMut(&mut Random) -> Vec<f64>| -> Vec<Vec<W::Real>> {
        (0..W::WIDTH).map(|_| f(random).iter().map(|x| Real::from_f64(*x)).collect()).collect()
    };
    let matrices = each(&mut |random| store(&rows, &matrix(&shape, random)));
    let vectors = each(&mut |random| (0..n).map(|_| random.uniform(-1.0, 1.0)).collect());
    let side_by_side = |all: &[Vec<W::Real>]| -> Vec<W> {
        (0..all[0].len()).map(|i| block(&all.iter().map(|one| one[i]).collect::<Vec<_>>())).collect()
    };
    let wide = solve(&rows, &pattern, &side_by_side(&matrices), &side_by_side(&vectors));
    for lane in 0..W::WIDTH {
        let alone = solve(&rows, &pattern, &matrices[lane], &vectors[lane]);
        for (a, b) in wide.factor.iter().zip(&alone.factor).chain(wide.x.iter().zip(&alone.x)) {
            assert_eq!(a.get(lane).bits(), b.get(0).bits(), "size {n}, lane {lane} of {}", W::NAME);
        }
    }
}

#[test]
fn lanes_do_not_see_each_other() {
    let mut random = Random(7);
    for n in sizes() {
        check_lanes::<f64x8>(n, &mut random);
        check_lanes::<f32x16>(n, &mut random);
    }
}

#[test]
fn pivots_without_inertia_are_reported() {
    let rows = Rows { start: vec![0, 1], first: vec![0, 0] };
    let pattern = pattern(&vec![vec![], vec![true]]);
    for (m, singular) in [
        ([1.0, 0.5, 1.0], false),
        ([1.0, 0.0, 0.0], true),
        ([1.0, 1.0, 1.0], true),
        ([1.0, 0.0, -2.0], true),
        ([f64::NAN, 0.0, 1.0], true),
    ] {
        let solution = solve::<f64>(&rows, &pattern, &m, &[1.0, 1.0]);
        assert_eq!(solution.singular != 0, singular, "{m:?}");
        assert!(solution.x.iter().all(|x| x.is_finite()), "{m:?}: {:?}", solution.x);
    }
}
