//! Contacts and constraint rows of one world, in MuJoCo's order and layout.

use glam::DVec3;
use lanesim_kernels::collision::reference;
use lanesim_kernels::constraint::{Cone, ContactRow, DofLaw, DofRowKind, Law};
use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::model::{Equality, EqualityKind, NONE, Pair, Sides};
use lanesim_kernels::tendon;

use super::World;

/// MuJoCo's numbers for the types of rows.
const EQUALITY: i32 = 0;
const FRICTION_DOF: i32 = 1;
const FRICTION_TENDON: i32 = 2;
const LIMIT_JOINT: i32 = 3;
const LIMIT_TENDON: i32 = 4;
const CONTACT_FRICTIONLESS: i32 = 5;
const CONTACT_PYRAMIDAL: i32 = 6;
const CONTACT_ELLIPTIC: i32 = 7;

/// A constraint row of one world.
pub(super) struct Row {
    pub kind: i32,
    pub id: usize,
    pub jacobian: Vec<f64>,
    pub pos: f64,
    pub margin: f64,
    pub d: f64,
    pub aref: f64,
    pub force: f64,
}

/// A contact of one world: its number in the block, and its first row.
pub(super) struct Contact {
    index: usize,
    row: Option<usize>,
}

/// Number of contacts of the world.
pub(super) fn count<L: LaneQuery>(world: World<'_, L>) -> usize {
    world.workspace.collision.contacts().filter(|c| c.dist().get(world.lane).to_f64() < L::Real::MAXVAL).count()
}

/// Number of constraint rows of the world.
pub(super) fn count_rows<L: LaneQuery>(world: World<'_, L>) -> usize {
    let constraint = &world.workspace.constraint;
    let acts = |d: &L| d.get(world.lane).to_f64() > 0.0;
    let contacts =
        constraint.contact_rows.iter().filter(|row| acts(&constraint.law(row).d())).map(|row| row.rows() as usize);
    let equality = equality_rows(world).filter(|(_, row)| acts(&constraint.equality.d[*row])).count();
    equality + constraint.dof_laws().filter(|law| acts(&law.d())).count() + contacts.sum::<usize>()
}

/// The rows of equality constraints that may act, each with its constraint.
fn equality_rows<'a, L: LaneQuery>(world: World<'a, L>) -> impl Iterator<Item = (&'a Equality<L::Real>, usize)> {
    world.tables.equalities.iter().flat_map(|equality| equality.rows().map(move |row| (equality, row)))
}

/// Appends numbers of each contact of the world.
pub(super) fn of_contacts<L: LaneQuery, const N: usize>(
    world: World<'_, L>,
    out: &mut Vec<f64>,
    numbers: impl Fn(&Contact) -> [f64; N],
) {
    listed(world).iter().for_each(|contact| out.extend(numbers(contact)));
}

/// Appends numbers of each row that acts in the world; its force is known `with_forces` only.
pub(super) fn of_rows<L: LaneQuery>(
    world: World<'_, L>,
    with_forces: bool,
    out: &mut Vec<f64>,
    numbers: impl Fn(&Row, &mut Vec<f64>),
) {
    rows(world, &mut listed(world), with_forces).iter().for_each(|row| numbers(row, out));
}

/// Appends each contact's first row, or -1.
pub(super) fn first_rows<L: LaneQuery>(world: World<'_, L>, out: &mut Vec<f64>) {
    let mut contacts = listed(world);
    rows(world, &mut contacts, false);
    out.extend(contacts.iter().map(|contact| contact.row.map_or(-1.0, |row| row as f64)));
}

/// The pair of geoms that touch.
pub(super) fn pair<'a, L: LaneQuery>(world: World<'a, L>, contact: &Contact) -> &'a Pair<L::Real> {
    &world.tables.pairs[world.workspace.collision.slots[contact.index].pair as usize]
}

/// Their numbers.
pub(super) fn geoms<L: LaneQuery>(world: World<'_, L>, contact: &Contact) -> [usize; 2] {
    let pair = pair(world, contact);
    [pair.geom1, pair.geom2].map(|geom| world.tables.geoms[geom as usize].id as usize)
}

/// Distance, m.
pub(super) fn distance<L: LaneQuery>(world: World<'_, L>, contact: &Contact) -> f64 {
    world.number(&world.workspace.collision.contact(contact.index).dist())
}

/// Place in the world, m.
pub(super) fn position<L: LaneQuery>(world: World<'_, L>, contact: &Contact) -> DVec3 {
    let at = world.workspace.position.origin_of(world.tables, reference(pair(world, contact)));
    world.vector(&world.workspace.collision.contact(contact.index).pos()[..]) + world.vector(&at[..])
}

/// Normal and two tangents.
pub(super) fn frame<L: LaneQuery>(world: World<'_, L>, contact: &Contact) -> [f64; 9] {
    let frame = world.workspace.collision.contact(contact.index).frame();
    std::array::from_fn(|i| world.number(&frame[i]))
}

/// Coefficients of friction: two tangents, spin, two rolls; the world's own, if they vary.
pub(super) fn friction<L: LaneQuery>(world: World<'_, L>, contact: &Contact) -> [f64; 5] {
    let pair = world.workspace.collision.slots[contact.index].pair as usize;
    let [_, _, _, friction @ ..] = world.instance().law(pair);
    std::array::from_fn(|k| world.number(&friction[k]))
}

/// Distance below which force acts, m.
pub(super) fn margin<L: LaneQuery>(world: World<'_, L>, contact: &Contact) -> f64 {
    world.number(&world.instance().margin(world.workspace.collision.slots[contact.index].pair as usize))
}

/// Force and torque on the second geom of each contact that acts, in the contact's frame.
pub(super) fn wrenches<L: LaneQuery>(world: World<'_, L>) -> Vec<(Contact, [f64; 6])> {
    let constraint = &world.workspace.constraint;
    let (mut edge, mut found) = (0, Vec::new());
    for row in &constraint.contact_rows {
        let first_edge = edge;
        edge += row.edges();
        let law = constraint.law(row);
        if law.d().get(world.lane).to_f64() <= 0.0 {
            continue;
        }
        let forces = contact_forces(world, row, first_edge);
        let mut wrench = [0.0; 6];
        if row.cone == Cone::Pyramid {
            for ((j, mu), force) in signed_friction(world, law, row.dim).zip(&forces) {
                wrench[0] += force;
                wrench[j] += mu * force;
            }
        } else {
            wrench.iter_mut().zip(&forces).for_each(|(entry, force)| *entry = *force);
        }
        found.push((Contact { index: row.contact as usize, row: None }, wrench));
    }
    found
}

/// The connects and welds that act, each with the forces of its rows of position and of orientation.
pub(super) fn holds<'a, L: LaneQuery>(
    world: World<'a, L>,
) -> impl Iterator<Item = (&'a Equality<L::Real>, [DVec3; 2])> {
    let force = &world.workspace.solver.force.equality;
    let spatial = world.tables.equalities.iter().filter(move |equality| {
        let acts = world.number(&world.workspace.constraint.equality.d[equality.row as usize]) > 0.0;
        acts && matches!(equality.kind, EqualityKind::Connect | EqualityKind::Weld)
    });
    spatial.map(move |equality| {
        let rows = &force[equality.rows()];
        let turning = if equality.kind == EqualityKind::Weld { world.vector(&rows[3..]) } else { DVec3::ZERO };
        (equality, [world.vector(rows), turning])
    })
}

/// The contacts that the world has.
fn listed<L: LaneQuery>(world: World<'_, L>) -> Vec<Contact> {
    let exists = |dist: L| dist.get(world.lane).to_f64() < L::Real::MAXVAL;
    let contacts = world.workspace.collision.contacts().enumerate();
    contacts.filter(|(_, contact)| exists(contact.dist())).map(|(index, _)| Contact { index, row: None }).collect()
}

/// The rows that act in the world; notes each contact's first. Without `forces` these are zero, and nothing is read of the
/// solver, which may not have run.
fn rows<L: LaneQuery>(world: World<'_, L>, contacts: &mut [Contact], forces: bool) -> Vec<Row> {
    let constraint = &world.workspace.constraint;
    let mut out = Vec::new();
    for (equality, row) in equality_rows(world) {
        if constraint.equality.d[row].get(world.lane).to_f64() > 0.0 {
            let force = if forces { world.number(&world.workspace.solver.force.equality[row]) } else { 0.0 };
            out.push(equality_row(world, (equality, row), force));
        }
    }
    for (i, law) in constraint.dof_laws().enumerate() {
        if law.d().get(world.lane).to_f64() > 0.0 {
            let force = if forces { world.number(&world.workspace.solver.force.dof[i]) } else { 0.0 };
            out.push(dof_row(world, law, force));
        }
    }
    let mut edge = 0;
    for row in &constraint.contact_rows {
        let first_edge = edge;
        edge += row.edges();
        if constraint.law(row).d().get(world.lane).to_f64() > 0.0 {
            let Some(n) = contacts.iter().position(|c| c.index == row.contact as usize) else { continue };
            contacts[n].row = Some(out.len());
            let forces = if forces { contact_forces(world, row, first_edge) } else { vec![0.0; row.rows() as usize] };
            contact_rows(world, row, n, &forces, &mut out);
        }
    }
    out
}

fn equality_row<L: LaneQuery>(world: World<'_, L>, (equality, row): (&Equality<L::Real>, usize), force: f64) -> Row {
    let rows = &world.workspace.constraint.equality;
    let mut jacobian = vec![0.0; world.tables.sizes.nv];
    for (dof, column) in rows.columns(world.tables, equality) {
        jacobian[dof] = world.number(&column[row - equality.row as usize]);
    }
    Row {
        kind: EQUALITY,
        id: equality.id as usize,
        jacobian,
        pos: world.number(&rows.pos[row]),
        margin: 0.0,
        d: world.number(&rows.d[row]),
        aref: -world.number(&rows.reference[row]),
        force,
    }
}

fn dof_row<L: LaneQuery>(world: World<'_, L>, law: DofLaw<'_, L>, force: f64) -> Row {
    let mut jacobian = vec![0.0; world.tables.sizes.nv];
    let (row, dof) = (law.row, law.row.dof as usize);
    let sign = match row.kind {
        DofRowKind::Upper => -1.0,
        DofRowKind::Limit => world.number(&law.sign()),
        _ => 1.0,
    };
    match row.kind {
        _ if row.tendon != NONE => {
            let columns = tendon::columns(world.tables, row.tendon as usize, &world.workspace.tendons.jacobian);
            columns.for_each(|(dof, j)| jacobian[dof] = sign * world.number(&j));
        }
        DofRowKind::Friction | DofRowKind::Lower | DofRowKind::Upper | DofRowKind::Limit => jacobian[dof] = sign,
        DofRowKind::Ball => {
            for k in 0..3 {
                jacobian[dof + k] = -world.number(&law.axis()[k]);
            }
        }
    }
    let margin = match row.kind {
        DofRowKind::Friction => 0.0,
        _ => world.number(&world.instance().limit(row.id as usize).1),
    };
    let (kind, id) = match (row.kind, row.tendon) {
        (DofRowKind::Friction, NONE) => (FRICTION_DOF, dof),
        (DofRowKind::Friction, tendon) => (FRICTION_TENDON, tendon as usize),
        (_, NONE) => (LIMIT_JOINT, world.tables.limits[row.id as usize].joint as usize),
        (_, tendon) => (LIMIT_TENDON, tendon as usize),
    };
    Row {
        kind,
        id,
        jacobian,
        pos: world.number(&law.pos()) + margin,
        margin,
        d: world.number(&law.d()),
        aref: -world.number(&law.reference()),
        force,
    }
}

/// Forces of a contact's rows. The first edge of a pyramid is `first_edge` among the block's.
fn contact_forces<L: LaneQuery>(world: World<'_, L>, row: &ContactRow, first_edge: usize) -> Vec<f64> {
    let work = &world.workspace.solver;
    let read = |lanes: &[L]| lanes.iter().map(|x| world.number(x)).collect::<Vec<f64>>();
    if row.cone == Cone::Pyramid {
        read(&work.edge_force[first_edge..first_edge + row.edges()])
    } else {
        read(&work.force.component[row.components()])
    }
}

/// Component and signed friction of every edge of a pyramid.
fn signed_friction<L: LaneQuery>(world: World<'_, L>, law: Law<'_, L>, dim: u32) -> impl Iterator<Item = (usize, f64)> {
    let mu = move |j: usize| world.number(&law.friction(j));
    (1..dim as usize).flat_map(move |j| [(j, mu(j)), (j, -mu(j))])
}

/// The rows of a contact: its normal, the edges of its pyramid, or its components.
fn contact_rows<L: LaneQuery>(world: World<'_, L>, row: &ContactRow, id: usize, forces: &[f64], out: &mut Vec<Row>) {
    let (first, dim) = (row.component as usize, row.dim as usize);
    let components = component_jacobians(world, row);
    let reference = &world.workspace.constraint.reference[first..first + dim];
    let reference: Vec<f64> = reference.iter().map(|x| world.number(x)).collect();
    let law = world.workspace.constraint.law(row);
    let d = world.number(&law.d());
    let margin = world.number(&world.instance().margin(row.pair as usize));
    let pos = world.number(&world.workspace.collision.contact(row.contact as usize).dist());
    match row.cone {
        Cone::Ray => {
            let (kind, jacobian) = (CONTACT_FRICTIONLESS, components[0].clone());
            out.push(Row { kind, id, jacobian, pos, margin, d, aref: -reference[0], force: forces[0] });
        }
        Cone::Pyramid => {
            for ((j, mu), force) in signed_friction(world, law, row.dim).zip(forces) {
                let edge = |dof: usize| mu.mul_add(components[j][dof], components[0][dof]);
                out.push(Row {
                    kind: CONTACT_PYRAMIDAL,
                    id,
                    jacobian: (0..world.tables.sizes.nv).map(edge).collect(),
                    pos,
                    margin,
                    d,
                    aref: -mu.mul_add(reference[j], reference[0]),
                    force: *force,
                });
            }
        }
        Cone::Ellipse => {
            for (j, jacobian) in components.into_iter().enumerate() {
                let mu = |j: usize| world.number(&law.friction(j));
                let ratio = if j == 0 { 1.0 } else { (mu(j) / world.number(&law.mu())).powi(2) };
                let (pos, margin) = if j == 0 { (pos, margin) } else { (0.0, 0.0) };
                let (kind, d) = (CONTACT_ELLIPTIC, d * ratio);
                out.push(Row { kind, id, jacobian, pos, margin, d, aref: -reference[j], force: forces[j] });
            }
        }
    }
}

/// Dense Jacobians of a contact's components.
fn component_jacobians<L: LaneQuery>(world: World<'_, L>, row: &ContactRow) -> Vec<Vec<f64>> {
    let (first, dim) = (row.component as usize, row.dim as usize);
    let mut out = vec![vec![0.0; world.tables.sizes.nv]; dim];
    let constraint = &world.workspace.constraint;
    if row.sides != Sides::One {
        let dofs = &world.tables.pair_dofs[world.tables.pairs[row.pair as usize].dofs.range()];
        for (n, entry) in dofs.iter().enumerate() {
            for (i, jacobian) in out.iter_mut().enumerate() {
                let at = row.jacobian as usize + n * dim + i;
                jacobian[entry.dof as usize] = world.number(&constraint.jacobian[at]);
            }
        }
        return out;
    }
    let mut dof = world.tables.links[row.link as usize].last_dof();
    while dof != NONE {
        let motion = &world.workspace.position.cdof[dof as usize];
        for (i, jacobian) in out.iter_mut().enumerate() {
            let w = &constraint.motion[first + i];
            jacobian[dof as usize] = (0..6).map(|k| world.number(&w[k]) * world.number(&motion[k])).sum();
        }
        dof = world.tables.dofs[dof as usize].parent;
    }
    out
}
