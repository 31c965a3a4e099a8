//! Rows of a block as sensors see them: contacts with their forces, what holds points and frames, limits.

use super::Seen;
use super::frame::Frame;
use crate::collision::{Contact, reference};
use crate::constraint::{Cone, ContactRow, DofRowKind};
use crate::lane::{Lane, Mask, Real};
use crate::math::quat;
use crate::math::vec3::{Mat3, Vec3, cross, dot, mul_add, scale, scale_add, select, splat, zero};
use crate::model::{Equality, EqualityKind, Instance, NONE};

/// A contact and its force.
pub(super) struct Touching<'a, L: Lane> {
    /// Its geoms, in MJCF's numbering.
    pub geoms: [u32; 2],
    /// Their MJCF bodies.
    pub bodies: [u32; 2],
    /// Their links.
    pub links: [u32; 2],
    /// Where there is one.
    pub exists: L::Mask,
    /// Where it acts.
    pub acts: L::Mask,
    /// Distance.
    pub dist: L,
    /// Origin of the tree from which its position is told.
    pub origin: Vec3<L>,
    /// Position, from there.
    pub pos: Vec3<L>,
    /// Normal and tangents.
    pub frame: &'a Mat3<L>,
    /// Force and torque on the second geom, in that frame; zero where it does not act.
    pub wrench: [Vec3<L>; 2],
}

/// Calls `f` with the contacts that exist in some world.
pub(super) fn contacts<'a, L: Lane>(model: Instance<'a, L>, seen: &Seen<'a, L>, mut f: impl FnMut(Touching<'a, L>)) {
    let (mut edge, mut rows) = (0, seen.constraint.contact_rows.iter().peekable());
    for slot in &seen.collision.slots {
        let pair = &model.pairs[slot.pair as usize];
        let (mut acts, mut force) = (L::Mask::splat(false), [zero(); 2]);
        // Those in the gap of all worlds have no rows.
        if let Some(row) = rows.next_if(|row| row.place == slot.place) {
            acts = seen.constraint.law(row).d().gt(L::zero());
            force = wrench(seen, row, edge).map(|part| select(acts, &part, &zero()));
            edge += row.edges();
        }
        let contact = Contact(&seen.collision.found[slot.place as usize]);
        let geoms = [pair.geom1, pair.geom2].map(|geom| &model.geoms[geom as usize]);
        f(Touching {
            geoms: geoms.map(|geom| geom.id),
            bodies: geoms.map(|geom| geom.body),
            links: [pair.link1, pair.link2],
            exists: contact.dist().lt(L::of(L::Real::MAXVAL)),
            acts,
            dist: contact.dist(),
            origin: seen.position.origin_of(&model, reference(pair)),
            pos: contact.pos(),
            frame: contact.frame(),
            wrench: force,
        });
    }
}

/// Force and torque of a contact, whose first edge is that of a pyramid.
fn wrench<L: Lane>(seen: &Seen<'_, L>, row: &ContactRow, edge: usize) -> [Vec3<L>; 2] {
    let (law, work) = (seen.constraint.law(row), &seen.solver);
    let mut all = [L::zero(); 6];
    if row.cone == Cone::Pyramid {
        for (j, two) in (1..row.dim as usize).zip(work.edge_force[edge..edge + row.edges()].chunks_exact(2)) {
            all[0] += two[0] + two[1];
            all[j] = law.friction(j) * (two[0] - two[1]);
        }
    } else {
        let force = &work.force.component[row.components()];
        all[..force.len()].copy_from_slice(force);
    }
    let [a, b, c, d, e, f] = all;
    [[a, b, c], [d, e, f]]
}

/// A connect or weld and its force on the first side.
pub(super) struct Holding<L> {
    /// MJCF bodies of its sides.
    pub bodies: [u32; 2],
    /// Its point on each side.
    pub places: [Frame<L>; 2],
    pub force: Vec3<L>,
    pub torque: Vec3<L>,
}

/// Calls `f` with the connects and welds; one has no force where it does not act.
pub(super) fn holds<L: Lane>(model: Instance<'_, L>, seen: &Seen<'_, L>, mut f: impl FnMut(Holding<L>)) {
    for equality in
        model.equalities.iter().filter(|equality| matches!(equality.kind, EqualityKind::Connect | EqualityKind::Weld))
    {
        let rows = &seen.solver.force.equality[equality.rows()];
        let acts = seen.constraint.equality.d[equality.row as usize].gt(L::zero());
        let part = |at: usize| [0, 1, 2].map(|i| L::select(acts, rows[at + i], L::zero()));
        let torque = if equality.kind == EqualityKind::Weld { torque(equality, seen, &part(3)) } else { zero() };
        let place = |side: usize| Frame::fixed(&model, seen.position, equality.links[side], &equality.pos[side]);
        f(Holding { bodies: equality.bodies, places: [place(0), place(1)], force: part(0), torque });
    }
}

/// Torque of a weld on its first body, from the forces of its rows of orientation: these measure s times the vector of E, the first
/// frame's orientation in the second's, which a rotation at u, seen in the second, changes by ½ (0, u) ∘ E.
fn torque<L: Lane>(equality: &Equality<L::Real>, seen: &Seen<'_, L>, force: &Vec3<L>) -> Vec3<L> {
    let [first, second] = [0, 1].map(|side| {
        let (own, link) = (splat(&equality.quat[side]), equality.links[side]);
        if link == NONE { own } else { quat::mul(&seen.quat[link as usize], &own) }
    });
    let [w, x, y, z] = quat::mul(&quat::conjugate(&second), &first);
    let half = L::splat(equality.torquescale) * L::of(0.5);
    let local = scale(half, &scale_add(w, force, &cross(&[x, y, z], force)));
    mul_add(&quat::to_matrix(&second), &local, &zero())
}

/// Calls `f` with the rows of a limit: where each acts, and its violation, the rate of that, and its force.
pub(super) fn limits<L: Lane>(limit: u32, qvel: &[L], seen: &Seen<'_, L>, mut f: impl FnMut(L::Mask, [L; 3])) {
    let constraint = &seen.constraint;
    for (law, force) in constraint.dof_laws().zip(&seen.solver.force.dof) {
        let (row, dof) = (law.row, law.row.dof as usize);
        let rate = || if row.tendon == NONE { qvel[dof] } else { seen.tendons.velocity[row.tendon as usize] };
        let speed = match row.kind {
            DofRowKind::Friction => continue,
            _ if row.id != limit => continue,
            DofRowKind::Limit => law.sign() * rate(),
            DofRowKind::Lower => rate(),
            DofRowKind::Upper => -rate(),
            DofRowKind::Ball => -dot(&law.axis(), &[qvel[dof], qvel[dof + 1], qvel[dof + 2]]),
        };
        f(law.d().gt(L::zero()), [law.pos(), speed, *force]);
    }
}
