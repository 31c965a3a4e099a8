//! The root of a floating tree: what its free joint alone would move, and the momentum of the tree.

use crate::inertia::Inertia;
use crate::lane::{Lane, Real};
use crate::math::spatial::Spatial;
use crate::math::vec3::{Vec3, cross, dot, scale, scale_add, sub};
use crate::model::{Model, Tree};
use crate::position::Position;

/// The six dofs of a free joint.
pub(super) struct Root<L> {
    /// First dof.
    first: usize,
    /// L below the diagonal and the reciprocals of D on it, of their block of M, L D Lᵀ.
    factor: [[L; 6]; 6],
    /// Axes of the rotations, world axes.
    axes: [Vec3<L>; 3],
    /// Centre of mass of the tree, from where the joint is.
    com: Vec3<L>,
}

impl<L: Lane> Root<L> {
    pub fn new(model: &Model<L::Real>, position: &Position<L>, inertia: &Inertia<L>, tree: &Tree) -> Self {
        let first = tree.dofs.start;
        let entry = |i: usize, j: usize| inertia.m[model.rows.at(first + i, first + j)];
        let tiny = L::of(L::Real::TINY);
        let mut factor = [[L::zero(); 6]; 6];
        let mut pivots = [L::zero(); 6];
        for j in 0..6 {
            let mut pivot = entry(j, j);
            for k in 0..j {
                pivot = (factor[j][k] * pivots[k]).neg_mul_add(factor[j][k], pivot);
            }
            pivots[j] = pivot.max(tiny);
            factor[j][j] = L::one() / pivots[j];
            for i in j + 1..6 {
                let mut sum = entry(i, j);
                for k in 0..j {
                    sum = (factor[i][k] * pivots[k]).neg_mul_add(factor[j][k], sum);
                }
                factor[i][j] = sum * factor[j][j];
            }
        }
        let axes = [3, 4, 5].map(|k| {
            let axis = &position.cdof[first + k];
            [axis[0], axis[1], axis[2]]
        });
        let [.., hx, hy, hz, mass] = inertia.composite[tree.links.start];
        let com = [hx, hy, hz].map(|h| h / mass.max(tiny));
        Root { first, factor, axes, com }
    }

    /// The root's numbers of a vector.
    pub fn of(&self, x: &[L]) -> Spatial<L> {
        std::array::from_fn(|k| x[self.first + k])
    }

    /// The motion of the root that has this momentum, the rest of the tree held.
    pub fn motion(&self, momentum: &Spatial<L>) -> Spatial<L> {
        let mut x = *momentum;
        for i in 0..6 {
            for k in 0..i {
                x[i] = self.factor[i][k].neg_mul_add(x[k], x[i]);
            }
        }
        for (i, x) in x.iter_mut().enumerate() {
            *x *= self.factor[i][i];
        }
        for i in (0..6).rev() {
            for k in i + 1..6 {
                x[i] = self.factor[k][i].neg_mul_add(x[k], x[i]);
            }
        }
        x
    }

    /// Angular momentum about the centre of mass and momentum, world axes, of the root's entries of M v.
    pub fn wrench(&self, momentum: &Spatial<L>) -> Spatial<L> {
        let linear = [momentum[0], momentum[1], momentum[2]];
        let mut about = scale(momentum[3], &self.axes[0]);
        for k in 1..3 {
            about = scale_add(momentum[3 + k], &self.axes[k], &about);
        }
        let own = sub(&about, &cross(&self.com, &linear));
        [own[0], own[1], own[2], linear[0], linear[1], linear[2]]
    }

    /// The reverse.
    pub fn momentum(&self, wrench: &Spatial<L>) -> Spatial<L> {
        let (own, linear) = ([wrench[0], wrench[1], wrench[2]], [wrench[3], wrench[4], wrench[5]]);
        let about = scale_add(L::one(), &cross(&self.com, &linear), &own);
        let [x, y, z] = [0, 1, 2].map(|k: usize| dot(&self.axes[k], &about));
        [linear[0], linear[1], linear[2], x, y, z]
    }
}
