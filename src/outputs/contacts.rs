//! Contacts and constraint rows of one world, in MuJoCo's order and layout.

use lanesim_kernels::collision::{origin, reference};
use lanesim_kernels::constraint::{Cone, ContactRow, DofLaw, DofRowKind, Law};
use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::model::{Equality, NONE, Sides};

use super::{Kind, View, number};

/// MuJoCo's numbers for the types of rows.
const EQUALITY: i32 = 0;
const FRICTION_DOF: i32 = 1;
const LIMIT_JOINT: i32 = 3;
const CONTACT_FRICTIONLESS: i32 = 5;
const CONTACT_PYRAMIDAL: i32 = 6;
const CONTACT_ELLIPTIC: i32 = 7;

/// A constraint row of one world.
struct Row {
    kind: i32,
    id: usize,
    jacobian: Vec<f64>,
    pos: f64,
    margin: f64,
    d: f64,
    aref: f64,
    force: f64,
}

/// A contact of one world: its number in the block, and its first row.
struct Contact {
    index: usize,
    row: Option<usize>,
}

/// Number of contacts of the world.
pub(super) fn count<L: LaneQuery>(view: &View<'_, L>, lane: usize) -> usize {
    view.workspace.collision.contacts().filter(|c| c.dist().get(lane).to_f64() < L::Real::MAXVAL).count()
}

/// Number of constraint rows of the world.
pub(super) fn count_rows<L: LaneQuery>(view: &View<'_, L>, lane: usize) -> usize {
    let constraint = &view.workspace.constraint;
    let acts = |d: &L| d.get(lane).to_f64() > 0.0;
    let contacts =
        constraint.contact_rows.iter().filter(|row| acts(&constraint.law(row).d())).map(|row| row.rows() as usize);
    let equality = equality_rows(view).filter(|(_, row)| acts(&constraint.equality.d[*row])).count();
    equality + constraint.dof_laws().filter(|law| acts(&law.d())).count() + contacts.sum::<usize>()
}

/// The rows of equality constraints that may act, each with its constraint.
fn equality_rows<'a, L: LaneQuery>(view: &'a View<'_, L>) -> impl Iterator<Item = (&'a Equality<L::Real>, usize)> {
    view.tables.equalities.iter().flat_map(|equality| equality.rows().map(move |row| (equality, row)))
}

/// An output with one entry per contact or row.
pub(super) fn values<L: LaneQuery>(kind: Kind, view: &View<'_, L>, lane: usize) -> Vec<f64> {
    let mut contacts = listed(view, lane);
    let rows = match kind {
        Kind::ContactEfc
        | Kind::EfcType
        | Kind::EfcId
        | Kind::EfcJ
        | Kind::EfcPos
        | Kind::EfcMargin
        | Kind::EfcD
        | Kind::EfcR
        | Kind::EfcAref => rows(view, lane, &mut contacts, false),
        Kind::EfcForce => rows(view, lane, &mut contacts, true),
        // Other outputs read contacts alone: the rows' stage may not have run, and its lists be an earlier block's.
        _ => vec![],
    };
    let of_rows = |f: &dyn Fn(&Row) -> f64| rows.iter().map(f).collect();
    let collision = &view.workspace.collision;
    let pair = |c: &Contact| &view.tables.pairs[collision.slots[c.index].pair as usize];
    let of_contacts = |f: &dyn Fn(&Contact) -> Vec<f64>| contacts.iter().flat_map(f).collect();
    match kind {
        Kind::ContactGeom => of_contacts(&|c| {
            [pair(c).geom1, pair(c).geom2].map(|g| f64::from(view.tables.geoms[g as usize].id)).to_vec()
        }),
        Kind::ContactDim => of_contacts(&|c| vec![f64::from(pair(c).condim)]),
        Kind::ContactDist => of_contacts(&|c| vec![number(&collision.contact(c.index).dist(), lane)]),
        Kind::ContactPos => of_contacts(&|c| {
            let at = origin(view.tables, &view.workspace.position, reference(pair(c)));
            let pos = collision.contact(c.index).pos();
            (0..3).map(|k| number(&pos[k], lane) + number(&at[k], lane)).collect()
        }),
        Kind::ContactFrame => {
            of_contacts(&|c| collision.contact(c.index).frame().iter().map(|x| number(x, lane)).collect())
        }
        Kind::ContactFriction => of_contacts(&|c| pair(c).friction.map(Real::to_f64).to_vec()),
        Kind::ContactMargin => of_contacts(&|c| vec![pair(c).margin.to_f64()]),
        Kind::ContactEfc => of_contacts(&|c| vec![c.row.map_or(-1.0, |row| row as f64)]),
        Kind::EfcType => of_rows(&|row| f64::from(row.kind)),
        Kind::EfcId => of_rows(&|row| row.id as f64),
        Kind::EfcJ => rows.iter().flat_map(|row| row.jacobian.iter().copied()).collect(),
        Kind::EfcPos => of_rows(&|row| row.pos),
        Kind::EfcMargin => of_rows(&|row| row.margin),
        Kind::EfcD => of_rows(&|row| row.d),
        Kind::EfcR => of_rows(&|row| 1.0 / row.d),
        Kind::EfcAref => of_rows(&|row| row.aref),
        Kind::EfcForce => of_rows(&|row| row.force),
        _ => Vec::new(),
    }
}

/// The contacts that the world has.
fn listed<L: LaneQuery>(view: &View<'_, L>, lane: usize) -> Vec<Contact> {
    let exists = |dist: L| dist.get(lane).to_f64() < L::Real::MAXVAL;
    let contacts = view.workspace.collision.contacts().enumerate();
    contacts.filter(|(_, contact)| exists(contact.dist())).map(|(index, _)| Contact { index, row: None }).collect()
}

/// The rows that act in the world; notes each contact's first. Without `forces` these are zero, and nothing is read of the
/// solver, which may not have run.
fn rows<L: LaneQuery>(view: &View<'_, L>, lane: usize, contacts: &mut [Contact], forces: bool) -> Vec<Row> {
    let constraint = &view.workspace.constraint;
    let mut out = Vec::new();
    for (equality, row) in equality_rows(view) {
        if constraint.equality.d[row].get(lane).to_f64() > 0.0 {
            let force = if forces { number(&view.workspace.solver.force.equality[row], lane) } else { 0.0 };
            out.push(equality_row(view, lane, (equality, row), force));
        }
    }
    for (i, law) in constraint.dof_laws().enumerate() {
        if law.d().get(lane).to_f64() > 0.0 {
            let force = if forces { number(&view.workspace.solver.force.dof[i], lane) } else { 0.0 };
            out.push(dof_row(view, lane, law, force));
        }
    }
    let mut edge = 0;
    for row in &constraint.contact_rows {
        let first_edge = edge;
        edge += row.edges();
        if constraint.law(row).d().get(lane).to_f64() > 0.0 {
            let Some(n) = contacts.iter().position(|c| c.index == row.contact as usize) else { continue };
            contacts[n].row = Some(out.len());
            let forces =
                if forces { contact_forces(view, lane, row, first_edge) } else { vec![0.0; row.rows() as usize] };
            contact_rows(view, lane, row, n, &forces, &mut out);
        }
    }
    out
}

fn equality_row<L: LaneQuery>(
    view: &View<'_, L>,
    lane: usize,
    (equality, row): (&Equality<L::Real>, usize),
    force: f64,
) -> Row {
    let rows = &view.workspace.constraint.equality;
    let mut jacobian = vec![0.0; view.tables.sizes.nv];
    for (dof, column) in rows.columns(view.tables, equality) {
        jacobian[dof] = number(&column[row - equality.row as usize], lane);
    }
    Row {
        kind: EQUALITY,
        id: equality.id as usize,
        jacobian,
        pos: number(&rows.pos[row], lane),
        margin: 0.0,
        d: number(&rows.d[row], lane),
        aref: -number(&rows.reference[row], lane),
        force,
    }
}

fn dof_row<L: LaneQuery>(view: &View<'_, L>, lane: usize, law: DofLaw<'_, L>, force: f64) -> Row {
    let mut jacobian = vec![0.0; view.tables.sizes.nv];
    let (row, dof) = (law.row, law.row.dof as usize);
    match row.kind {
        DofRowKind::Friction | DofRowKind::Lower => jacobian[dof] = 1.0,
        DofRowKind::Upper => jacobian[dof] = -1.0,
        DofRowKind::Limit => jacobian[dof] = number(&law.sign(), lane),
        DofRowKind::Ball => {
            for k in 0..3 {
                jacobian[dof + k] = -number(&law.axis()[k], lane);
            }
        }
    }
    let (kind, id, margin) = if row.kind == DofRowKind::Friction {
        (FRICTION_DOF, dof, 0.0)
    } else {
        let limit = &view.tables.limits[row.id as usize];
        (LIMIT_JOINT, limit.joint as usize, limit.margin.to_f64())
    };
    Row {
        kind,
        id,
        jacobian,
        pos: number(&law.pos(), lane) + margin,
        margin,
        d: number(&law.d(), lane),
        aref: -number(&law.reference(), lane),
        force,
    }
}

/// Forces of a contact's rows. The first edge of a pyramid is `first_edge` among the block's.
fn contact_forces<L: LaneQuery>(view: &View<'_, L>, lane: usize, row: &ContactRow, first_edge: usize) -> Vec<f64> {
    let work = &view.workspace.solver;
    let read = |lanes: &[L]| lanes.iter().map(|x| number(x, lane)).collect::<Vec<f64>>();
    if row.cone == Cone::Pyramid {
        read(&work.edge_force[first_edge..first_edge + row.edges()])
    } else {
        read(&work.force.component[row.components()])
    }
}

/// Component and signed friction of every edge of a pyramid.
fn signed_friction<L: LaneQuery>(law: Law<'_, L>, dim: u32, lane: usize) -> impl Iterator<Item = (usize, f64)> {
    let mu = move |j: usize| number(&law.friction(j), lane);
    (1..dim as usize).flat_map(move |j| [(j, mu(j)), (j, -mu(j))])
}

/// The rows of a contact: its normal, the edges of its pyramid, or its components.
fn contact_rows<L: LaneQuery>(
    view: &View<'_, L>,
    lane: usize,
    row: &ContactRow,
    id: usize,
    forces: &[f64],
    out: &mut Vec<Row>,
) {
    let (first, dim) = (row.component as usize, row.dim as usize);
    let components = component_jacobians(view, lane, row);
    let reference = &view.workspace.constraint.reference[first..first + dim];
    let reference: Vec<f64> = reference.iter().map(|x| number(x, lane)).collect();
    let law = view.workspace.constraint.law(row);
    let d = number(&law.d(), lane);
    let margin = view.tables.pairs[row.pair as usize].margin.to_f64();
    let pos = number(&view.workspace.collision.contact(row.contact as usize).dist(), lane);
    match row.cone {
        Cone::Ray => {
            let (kind, jacobian) = (CONTACT_FRICTIONLESS, components[0].clone());
            out.push(Row { kind, id, jacobian, pos, margin, d, aref: -reference[0], force: forces[0] });
        }
        Cone::Pyramid => {
            for ((j, mu), force) in signed_friction(law, row.dim, lane).zip(forces) {
                let edge = |dof: usize| mu.mul_add(components[j][dof], components[0][dof]);
                out.push(Row {
                    kind: CONTACT_PYRAMIDAL,
                    id,
                    jacobian: (0..view.tables.sizes.nv).map(edge).collect(),
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
                let mu = |j: usize| number(&law.friction(j), lane);
                let ratio = if j == 0 { 1.0 } else { (mu(j) / number(&law.mu(), lane)).powi(2) };
                let (pos, margin) = if j == 0 { (pos, margin) } else { (0.0, 0.0) };
                let (kind, d) = (CONTACT_ELLIPTIC, d * ratio);
                out.push(Row { kind, id, jacobian, pos, margin, d, aref: -reference[j], force: forces[j] });
            }
        }
    }
}

/// Dense Jacobians of a contact's components.
fn component_jacobians<L: LaneQuery>(view: &View<'_, L>, lane: usize, row: &ContactRow) -> Vec<Vec<f64>> {
    let (first, dim) = (row.component as usize, row.dim as usize);
    let mut out = vec![vec![0.0; view.tables.sizes.nv]; dim];
    let constraint = &view.workspace.constraint;
    if row.sides != Sides::One {
        let dofs = &view.tables.pair_dofs[view.tables.pairs[row.pair as usize].dofs.range()];
        for (n, entry) in dofs.iter().enumerate() {
            for (i, jacobian) in out.iter_mut().enumerate() {
                let at = row.jacobian as usize + n * dim + i;
                jacobian[entry.dof as usize] = number(&constraint.jacobian[at], lane);
            }
        }
        return out;
    }
    let mut dof = view.tables.links[row.link as usize].dofs.range().end as u32 - 1;
    while dof != NONE {
        let motion = &view.workspace.position.cdof[dof as usize];
        for (i, jacobian) in out.iter_mut().enumerate() {
            let w = &constraint.motion[first + i];
            jacobian[dof as usize] = (0..6).map(|k| number(&w[k], lane) * number(&motion[k], lane)).sum();
        }
        dof = view.tables.dofs[dof as usize].parent;
    }
    out
}
