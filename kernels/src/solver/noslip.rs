//! The no-slip pass: friction is solved again without regularisation, normal forces fixed, so that what should stick
//! does.

use super::{Problem, SolverWork, Whitened, joints, pgs};
use crate::constraint::{Cone, ContactRow, DofRowKind};
use crate::lane::Lane;
use crate::math::vec3::build;

/// Begins a pass: over dry friction. Its gain is by how much the cost falls.
pub fn sweep_rows<L: Lane>(problem: &Problem<'_, L>, open: L::Mask, work: &mut SolverWork<L>) {
    let Problem { model, constraint, .. } = problem;
    let SolverWork { dual, force, .. } = work;
    let (before, mut gain) = (dual.bias.equality.len(), L::zero());
    for (r, law) in constraint.dof_laws().enumerate().filter(|(_, law)| law.row.kind == DofRowKind::Friction) {
        let (bound, row) = (joints::bound(*model, &law), before + r);
        let residual = dual.residual_of_row(row, dual.bias.dof[r]);
        let (change, fall) = pgs::scalar(&mut force.dof[r], residual, dual.diagonal[row], -bound, bound, open);
        gain += fall;
        dual.add_row(row, change);
    }
    dual.gain[0] = gain;
}

/// Goes on with the friction of a contact.
pub fn sweep_contact<L: Lane>(
    problem: &Problem<'_, L>,
    (row, place): (&ContactRow, &Whitened),
    open: L::Mask,
    work: &mut SolverWork<L>,
) {
    let SolverWork { dual, force, edge_force, .. } = work;
    let (law, n) = (problem.constraint.law(row), row.dim as usize);
    let acts = open & law.d().gt(L::zero());
    let block = dual.block(row, place);
    let force = &mut force.component[row.components()];
    match row.cone {
        Cone::Ray => {}
        Cone::Pyramid => {
            for (j, edges) in (1..n).zip(edge_force[place.edges(row)].chunks_exact_mut(2)) {
                let residual = dual.residual_of(row, place, j);
                let bound = law.friction(j) * (edges[0] + edges[1]);
                let (change, gain) = pgs::scalar(&mut force[j], residual, block[j][j], -bound, bound, acts);
                dual.gain[0] += gain;
                // The pair keeps its sum.
                let half = change / law.friction(j) * L::of(0.5);
                edges[0] += half;
                edges[1] -= half;
                dual.add_component(place, j, change);
            }
        }
        Cone::Ellipse => {
            let residual = dual.residual(row, place);
            let old: [L; 6] = build(|i| if i < n { force[i] } else { L::zero() });
            // Without regularisation the gradient is the residual; its constant part leaves out friction.
            let constant: [L; 6] = build(|i| (0..n).fold(residual[i], |sum, k| block[i][k].neg_mul_add(old[k], sum)));
            let mut next = old;
            pgs::friction(n, law, &block, &constant, &mut next);
            let change: [L; 6] = build(|i| L::select(acts, next[i] - old[i], L::zero()));
            for i in 0..n {
                let moved = (0..n).fold(L::zero(), |sum, k| block[i][k].mul_add(change[k], sum));
                dual.gain[0] -= change[i] * moved.mul_add(L::of(0.5), residual[i]);
                force[i] = L::select(acts, next[i], old[i]);
            }
            dual.add(row, place, &change);
        }
    }
}
