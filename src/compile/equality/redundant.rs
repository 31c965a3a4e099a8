//! Which equality constraints say what others say already.

use lanesim_kernels::constraint::{Constraint, Motion, equality_rows};
use lanesim_kernels::model::{Instance, Model};
use lanesim_kernels::position::{self, Position};
use lanesim_kernels::tendon::{self, Tendons};
use lanesim_kernels::velocity::Velocity;

use super::check::name_of;
use crate::spec::Spec;

/// Most products of which the notes are made.
const MOST_WORK: usize = 100_000_000;
/// What is left of a row's length once what others say is taken out of it, and is rounding.
const ROUNDING: f64 = 1e-9;

/// A note on every constraint, active from the start, some rows of which follow, in the reference configuration, from others
/// before it and its own, or hold what nothing moves. Such constraints share their load as their impedances say.
pub(crate) fn notes(spec: &Spec, tables: &Model<f64>) -> Vec<String> {
    let sizes = &tables.sizes;
    if sizes.ne == 0 || sizes.ne.saturating_mul(sizes.nv).saturating_mul(sizes.nv.min(sizes.ne)) > MOST_WORK {
        return Vec::new();
    }
    let (mut position, velocity) = (Position::<f64>::new(sizes), Velocity::<f64>::new(sizes));
    position::kinematics(Instance::from(tables), (&tables.qpos0[..]).into(), &mut position);
    let qvel = vec![0.0; sizes.nv];
    let mut lengths = Tendons::<f64>::new(sizes);
    tendon::tendons(tables, &position, &tables.qpos0, &qvel, &mut lengths);
    let motion = Motion { position: &position, velocity: &velocity, tendons: &lengths, qvel: &qvel };
    let mut rows = Constraint::<f64>::new(tables).equality;
    let read = ((&tables.qpos0[..]).into(), &tables.eq_active0[..]);
    equality_rows(Instance::from(tables), motion, read, true, &mut rows);
    let (mut basis, mut notes) = (Vec::new(), Vec::new());
    for equality in tables.equalities.iter().filter(|equality| tables.eq_active0[equality.id as usize] != 0.0) {
        let mut spare = 0;
        for r in 0..equality.dim() {
            let mut row = vec![0.0; sizes.nv];
            rows.columns(tables, equality).for_each(|(dof, column)| row[dof] = column[r]);
            spare += usize::from(!extends(&mut basis, row));
        }
        if spare > 0 {
            let (written, all) = (&spec.equalities[equality.id as usize], equality.dim());
            let name = name_of(written, equality.id as usize);
            let note = format!("{name}: {spare} of its {all} rows say nothing new in the reference configuration");
            notes.push(written.source.placed(&note));
        }
    }
    notes
}

/// Adds what is new in a row to an orthonormal basis; whether there is anything.
fn extends(basis: &mut Vec<Vec<f64>>, mut row: Vec<f64>) -> bool {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let length = dot(&row, &row).sqrt();
    // Twice, so that rounding leaves nothing of the basis.
    for _ in 0..2 {
        for known in &*basis {
            let along = dot(known, &row);
            row.iter_mut().zip(known).for_each(|(x, k)| *x -= along * k);
        }
    }
    let left = dot(&row, &row).sqrt();
    let new = left > ROUNDING * length.max(1.0);
    if new {
        row.iter_mut().for_each(|x| *x /= left);
        basis.push(row);
    }
    new
}
