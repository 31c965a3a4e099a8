//! From contacts to the block's list of constraint rows.

use crate::collision::{Collision, Contact};
use crate::constraint::{Constraint, ContactRow, grow};
use crate::lane::LaneQuery;
use crate::model::{Instance, Sides};
use crate::part::{Executor, OneByOne, Op, Part, Parts, Step};

/// Numbers of all rows on joints and tendons; lists the contacts that act in some world, closer than their margin, with their numbers.
pub fn rows<L: LaneQuery>(step: &mut Step<'_, L>, alive: u32, executor: &mut dyn Executor<L>) {
    let mut act = [0; 2];
    executor.run(Part::new(Op::Joints), alive, &mut act, step);
    let constraint = &mut step.ws.constraint;
    [constraint.joint_lanes, constraint.joint_cross] = act;
    list(step.model, &step.ws.collision, &mut step.ws.constraint);
    if !executor.measure(step, &mut measure) {
        OneByOne::run(executor, step, &mut measure);
    }
}

/// Numbers of equality constraints; returns the worlds in which some are active.
pub fn equalities<L: LaneQuery>(step: &mut Step<'_, L>, alive: u32, executor: &mut dyn Executor<L>) -> u32 {
    if step.model.equalities.is_empty() {
        return 0;
    }
    let mut act = [0; 2];
    executor.run(Part::new(Op::Equality), alive, &mut act, step);
    let equality = &mut step.ws.constraint.equality;
    [equality.lanes, equality.cross] = act;
    equality.lanes
}

/// Numbers of the listed contacts.
fn measure(parts: &mut dyn Parts) {
    const ALL: u32 = u32::MAX;
    parts.each(Op::Measure, ALL, [ALL; 2]);
    parts.each(Op::MeasureBoth, ALL, [ALL; 2]);
}

/// Lists the contacts that act in some world, and makes room for their numbers.
fn list<L: LaneQuery>(model: Instance<'_, L>, collision: &Collision<L>, constraint: &mut Constraint<L>) {
    constraint.contact_rows.clear();
    (constraint.cross, constraint.coupled) = (constraint.joining() != 0, false);
    constraint.contact_lanes = 0;
    let (mut component, mut jacobian) = (0, 0);
    for (contact, slot) in (0..).zip(&collision.slots) {
        let pair = &model.pairs[slot.pair as usize];
        if pair.rigid() {
            continue;
        }
        let lanes = L::bits(Contact(&collision.found[slot.place as usize]).dist().lt(model.margin(slot.pair as usize)));
        if lanes == 0 {
            continue;
        }
        let common = constraint.rows_of_pairs[slot.pair as usize];
        constraint.contact_lanes |= lanes;
        if common.sides != Sides::One {
            constraint.coupled = true;
            constraint.cross |= pair.cross;
        }
        let strength = constraint.contact_rows.len() as u32;
        let row = ContactRow { contact, component, lanes, jacobian, strength, place: slot.place, ..common };
        component += row.dim;
        jacobian += row.dim * pair.dofs.len;
        constraint.contact_rows.push(row);
    }
    let zero = L::zero();
    constraint.components = component as usize;
    grow(&mut constraint.strengths, constraint.contact_rows.len(), [zero; 7]);
    grow(&mut constraint.reference, component as usize, zero);
    grow(&mut constraint.motion, component as usize, [zero; 6]);
    grow(&mut constraint.jacobian, jacobian as usize, zero);
}
