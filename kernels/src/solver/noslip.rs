//! The no-slip pass: friction is solved again without regularisation, normal forces fixed, so that what should stick
//! does.

use super::{Problem, SolverWork, dual, joints, pgs};
use crate::constraint::{Cone, DofRowKind};
use crate::lane::Lane;
use crate::math::vec3::build;

/// One pass over dry friction and the friction of contacts.
pub fn sweep<L: Lane>(problem: &Problem<'_, L>, open: L::Mask, work: &mut SolverWork<L>) -> L {
    let Problem { model, constraint, .. } = problem;
    let mut improvement = L::zero();
    for (r, law) in constraint.dof_laws().enumerate().filter(|(_, law)| law.row.kind == DofRowKind::Friction) {
        let bound = joints::bound(model, &law);
        let b = work.dual.dof(r);
        let residual = dual::product(b, &work.dual.z) + work.dual.bias.dof[r];
        let diagonal = dual::product(b, b);
        let f = &mut work.force.dof[r];
        let (change, gain) = pgs::scalar(f, residual, diagonal, -bound, bound, open);
        improvement += gain;
        work.dual.add_dof(r, change);
    }
    let mut edge = 0;
    for row in &constraint.contact_rows {
        let law = constraint.law(row);
        let acts = open & law.d().gt(L::zero());
        let n = row.dim as usize;
        let force = &mut work.force.component[row.component as usize..row.component as usize + n];
        match row.cone {
            Cone::Ray => {}
            Cone::Pyramid => {
                for j in 1..n {
                    let residual = work.dual.residual(row)[j];
                    let b = work.dual.component(row.component as usize + j);
                    let diagonal = dual::product(b, b);
                    let (plus, minus) = (work.edge_force[edge], work.edge_force[edge + 1]);
                    let bound = law.friction(j) * (plus + minus);
                    let (change, gain) = pgs::scalar(&mut force[j], residual, diagonal, -bound, bound, acts);
                    improvement += gain;
                    // The pair keeps its sum.
                    let half = change / law.friction(j) * L::of(0.5);
                    work.edge_force[edge] = plus + half;
                    work.edge_force[edge + 1] = minus - half;
                    edge += 2;
                    let mut changes = [L::zero(); 6];
                    changes[j] = change;
                    work.dual.add(row, &changes);
                }
            }
            Cone::Ellipse => {
                let block = work.dual.block(row);
                let residual = work.dual.residual(row);
                let old: [L; 6] = build(|i| if i < n { force[i] } else { L::zero() });
                // Without regularisation the gradient is the residual; its constant part leaves out friction.
                let constant: [L; 6] =
                    build(|i| (0..n).fold(residual[i], |sum, k| block[i][k].neg_mul_add(old[k], sum)));
                let mut next = old;
                pgs::friction(n, law, &block, &constant, &mut next);
                let change: [L; 6] = build(|i| L::select(acts, next[i] - old[i], L::zero()));
                for i in 0..n {
                    let moved = (0..n).fold(L::zero(), |sum, k| block[i][k].mul_add(change[k], sum));
                    improvement -= change[i] * moved.mul_add(L::of(0.5), residual[i]);
                    force[i] = L::select(acts, next[i], old[i]);
                }
                work.dual.add(row, &change);
            }
        }
    }
    improvement
}
