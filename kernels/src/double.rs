//! Worlds whose contacts or equality constraints are so stiff that single precision would lose the inertia beside them: double precision finds their
//! acceleration.
//!
//! A row of a pyramid has D ~ 1/μ². Where that is many thousand times the inertia that it meets, as for low friction or an
//! impedance near 1, rounding of JᵀDJ exceeds M, forces D y come from what is left of y after nearly all of it has cancelled, and
//! where several contacts hold one body, their rounded Jacobians contradict each other by more than R lets pass. No order of
//! operations brings back digits that y and J do not have. So such worlds are gathered from their block, whoever their neighbours
//! are, and the same kernels evaluate them from the state on, with twice the digits.

use std::ops::Range;

use ::wide::f64x8;

use crate::constraint::{Cone, Constraint, ContactRow, DofRow, DofRowKind};
use crate::lane::{Lane, LaneQuery, Mask, Real};
use crate::model::{Model, Varied};
use crate::state::{Applied, State};
use crate::workspace::{Double, Workspace};

/// Largest ratio of a pyramid row's D to the inertia that it meets which single precision bears: errors of an acceleration reach
/// 1e-4 of it at a few times as much.
const BEARABLE: f64 = 4000.0;

/// The same for an equality constraint. Less, since a loop may be closed several times over, and pulls at the whole length of a
/// chain: on a ring of thirteen dofs closed thrice errors reach 2e-4 of the acceleration at a ratio of 100, 8e-3 at 1000.
const BEARABLE_EQUALITY: f64 = 250.0;

/// Worlds that are evaluated together.
const WIDTH: usize = <f64x8 as LaneQuery>::WIDTH;

/// What an evaluation reads beside model and state.
#[derive(Clone, Copy, Debug)]
pub struct Given<'a, L> {
    /// Forces from outside, if there are any.
    pub applied: Option<&'a Applied<L>>,
    /// Numbers of the model that vary from world to world, if any do.
    pub varied: Option<&'a Varied<L>>,
    /// Whether somebody reads what rows do.
    pub keep: bool,
}

/// Worlds of a block in which a contact or an equality constraint is stiffer than single precision bears.
pub fn lanes<L: LaneQuery>(constraint: &Constraint<L>) -> L::Mask {
    let mut found = L::Mask::splat(false);
    if L::Real::EPSILON < 1e-10 {
        return found;
    }
    for row in constraint.contact_rows.iter().filter(|row| row.cone == Cone::Pyramid) {
        let law = constraint.law(row);
        found = found | (law.d().gt(L::zero()) & law.swamping().gt(L::of(BEARABLE)));
    }
    found | constraint.equality.swamping.gt(L::of(BEARABLE_EQUALITY))
}

/// Finds smooth and constrained accelerations and forces of the worlds of `open`, and what rows do where that is asked for. `evaluate`
/// runs the stages for so many worlds that were gathered, and returns those whose solver reached the limit of iterations. Returns these.
pub fn forward<L: LaneQuery>(
    model: &Model<L::Real>,
    state: &State<L>,
    given: Given<'_, L>,
    open: u32,
    ws: &mut Workspace<L>,
    mut evaluate: impl FnMut(&mut Double, usize) -> u32,
) -> u32 {
    let mut double = ws.double.take().unwrap_or_else(|| Box::new(Double::new(model)));
    let mut lanes = (0..L::WIDTH).filter(|lane| open >> lane & 1 != 0);
    let mut left = 0;
    while let Some(first) = lanes.next() {
        let (mut group, mut len) = ([first; WIDTH], 1);
        for (place, lane) in group[1..].iter_mut().zip(&mut lanes) {
            *place = lane;
            len += 1;
        }
        double.gather(state, given, &group);
        let unfinished = evaluate(&mut double, len);
        left |= group[..len].iter().enumerate().fold(0, |bits, (place, lane)| bits | (unfinished >> place & 1) << lane);
        double.scatter(&group[..len], ws);
        if given.keep {
            double.scatter_rows(&group[..len], ws);
        }
    }
    ws.double = Some(double);
    left
}

impl Double {
    /// Takes over what the worlds of `group` are evaluated from.
    fn gather<L: LaneQuery>(&mut self, state: &State<L>, given: Given<'_, L>, group: &[usize; WIDTH]) {
        let widen = |from: &[L], to: &mut [f64x8]| widen(group, from, to);
        let (own, sizes) = (&mut self.state, &self.model.sizes);
        widen(&state.time, &mut own.time);
        widen(&state.qpos, &mut own.qpos);
        for (q, low) in own.qpos.iter_mut().zip(state.positions()[1]) {
            let mut rest = [f64x8::zero()];
            widen(std::slice::from_ref(low), &mut rest);
            *q += rest[0];
        }
        widen(&state.qvel, &mut own.qvel);
        widen(&state.act, &mut own.act);
        widen(&state.history, &mut own.history);
        for (x, low) in own.history.iter_mut().zip(state.past()[1]) {
            let mut rest = [f64x8::zero()];
            widen(std::slice::from_ref(low), &mut rest);
            *x += rest[0];
        }
        widen(&state.plastic, &mut own.plastic);
        widen(&state.ctrl, &mut own.ctrl);
        widen(&state.qacc_warmstart, &mut own.qacc_warmstart);
        widen(&state.eq_active, &mut own.eq_active);
        widen(state.mocap_pos.as_flattened(), own.mocap_pos.as_flattened_mut());
        widen(state.mocap_quat.as_flattened(), own.mocap_quat.as_flattened_mut());
        widen(&state.tree_rest, &mut own.tree_rest);
        widen(state.tree_guard.as_flattened(), own.tree_guard.as_flattened_mut());
        if let Some(applied) = given.applied {
            let own = self.applied.get_or_insert_with(|| Applied::new(sizes));
            widen(&applied.qfrc_applied, &mut own.qfrc_applied);
            widen(applied.xfrc_applied.as_flattened(), own.xfrc_applied.as_flattened_mut());
        }
        if let Some(varied) = given.varied {
            let own = self.varied.get_or_insert_with(|| Varied::new(&self.model, varied.set()));
            for quantity in varied.set().iter() {
                widen(varied.lanes(quantity), own.lanes_mut(quantity));
            }
        }
    }

    /// Hands out what was found.
    fn scatter<L: LaneQuery>(&self, group: &[usize], to: &mut Workspace<L>) {
        let narrow = |from: &[f64x8], to: &mut [L]| narrow(group, from, to);
        let own = &self.workspace;
        narrow(&own.acceleration.qfrc_smooth, &mut to.acceleration.qfrc_smooth);
        narrow(&own.acceleration.qacc_smooth, &mut to.acceleration.qacc_smooth);
        narrow(&own.solver.fields.qacc, &mut to.solver.fields.qacc);
        narrow(&own.solver.fields.qfrc_constraint, &mut to.solver.fields.qfrc_constraint);
        let (own, to) = (&own.solver.statistics, &mut to.solver.statistics);
        narrow(&[own.niter], std::slice::from_mut(&mut to.niter));
        narrow(&[own.residual], std::slice::from_mut(&mut to.residual));
        to.block_niter = to.block_niter.max(own.block_niter);
    }

    /// Hands out what rows do. The lists are in one order, but may differ by rows that only just act: these have no force here,
    /// or none there.
    fn scatter_rows<L: LaneQuery>(&self, group: &[usize], to: &mut Workspace<L>) {
        let narrow = |from: &[f64x8], to: &mut [L]| narrow(group, from, to);
        let (own, zero) = (&self.workspace, [f64x8::zero(); 10]);
        let mut known = own.constraint.dof_rows.iter().zip(&own.solver.force.dof).peekable();
        for (row, force) in to.constraint.dof_rows.iter().zip(&mut to.solver.force.dof) {
            while known.next_if(|(own, _)| order(own) < order(row)).is_some() {}
            let from = known.next_if(|(own, _)| *own == row).map_or(&zero[0], |(_, force)| force);
            narrow(std::slice::from_ref(from), std::slice::from_mut(force));
        }
        narrow(&own.solver.force.equality, &mut to.solver.force.equality);
        let key = |slot: &crate::collision::Slot| (slot.pair, slot.point);
        let mut known = with_edges(&own.constraint.contact_rows).peekable();
        let mut at = 0;
        for row in &to.constraint.contact_rows {
            let slot = key(&to.collision.slots[row.contact as usize]);
            let own_slot = |own_row: &ContactRow| key(&own.collision.slots[own_row.contact as usize]);
            while known.next_if(|(own, _)| own_slot(own) < slot).is_some() {}
            let found = known.next_if(|(own, _)| own_slot(own) == slot);
            let forces = found.as_ref().map_or(&zero[..], |(found, _)| &own.solver.force.component[found.components()]);
            narrow(forces, &mut to.solver.force.component[row.components()]);
            let edges = found.map_or(&zero[..], |(_, edges)| &own.solver.edge_force[edges]);
            narrow(edges, &mut to.solver.edge_force[at..at + row.edges()]);
            at += row.edges();
        }
    }
}

/// What rows on joints are sorted by.
fn order(row: &DofRow) -> (bool, u32, bool) {
    (row.kind != DofRowKind::Friction, row.id, row.kind == DofRowKind::Upper)
}

/// Contacts, and where their edge forces are.
fn with_edges(rows: &[ContactRow]) -> impl Iterator<Item = (&ContactRow, Range<usize>)> {
    rows.iter().scan(0, |end, row| {
        let start = *end;
        *end += row.edges();
        Some((row, start..*end))
    })
}

/// The numbers of the worlds of `group`, side by side.
fn widen<L: LaneQuery>(group: &[usize; WIDTH], from: &[L], to: &mut [f64x8]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = f64x8::from(group.map(|lane| from.get(lane).to_f64()));
    }
}

/// Puts numbers back to the worlds of `group`.
fn narrow<L: LaneQuery>(group: &[usize], from: &[f64x8], to: &mut [L]) {
    for (to, from) in to.iter_mut().zip(from) {
        for (place, lane) in group.iter().enumerate() {
            to.set(*lane, L::Real::from_f64(from.get(place)));
        }
    }
}
