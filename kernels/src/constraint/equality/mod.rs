//! Rows of equality constraints: what is held, how far off it is, its Jacobian, and what it would do by itself.
//!
//! A row's Jacobian is a list of dofs that is known when the model is compiled, and its law is two-sided: f = -D (J a - a_ref),
//! wherever the acceleration is. In worlds where an equality constraint is not active, D = 0.

mod joint;
mod sides;

pub use joint::slope;

use super::Motion;
use super::dof_rows::regulariser;
use crate::lane::{Lane, Mask};
use crate::math::vec3::zero;
use crate::model::{Equality, EqualityDof, EqualityKind, Instance, Model, NONE};
use crate::position::{Configuration, orientation};
use crate::tendon;

/// Equality constraints of a block. Lists of numbers have room for all that the model has, each at its place.
#[derive(Clone, Debug)]
pub struct Equalities<L> {
    /// Worlds in which some are active, bit by bit.
    pub lanes: u32,
    /// Worlds in which some are active that couple dofs that the inertia matrix does not.
    pub cross: u32,
    /// How much stiffer than heavy the stiffest is that acts: D over the inertia that it meets.
    pub swamping: L,
    /// Jacobians: of each, dof by dof, its rows.
    pub jacobian: Vec<L>,
    /// Per row: what is left of what should be 0.
    pub pos: Vec<L>,
    /// Per row: D = 1/R; 0 in worlds where the row does not act.
    pub d: Vec<L>,
    /// Per row: minus the reference acceleration.
    pub reference: Vec<L>,
    /// Orientations of links, of those that welds ask for.
    pub quats: Vec<[L; 4]>,
    /// Those links, parents first.
    turning: Vec<u32>,
}

impl<L: Lane> Equalities<L> {
    /// Room for those of the model.
    pub(super) fn new(model: &Model<L::Real>) -> Self {
        let (rows, zero) = (vec![L::zero(); model.sizes.ne], L::zero());
        let turning = turning(model);
        Equalities {
            lanes: 0,
            cross: 0,
            swamping: zero,
            jacobian: vec![zero; model.sizes.nej],
            pos: rows.clone(),
            d: rows.clone(),
            reference: rows,
            quats: vec![[zero; 4]; if turning.is_empty() { 0 } else { model.links.len() }],
            turning,
        }
    }

    /// Bytes of that.
    pub(super) fn bytes(model: &Model<L::Real>) -> usize {
        let quats = if turning(model).is_empty() { 0 } else { model.links.len() };
        (model.sizes.nej + 3 * model.sizes.ne + 4 * quats) * size_of::<L>()
    }

    /// Whether none is active in any world.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.lanes == 0
    }

    /// None is active in any world.
    pub(super) fn clear(&mut self) {
        if self.lanes != 0 {
            self.d.fill(L::zero());
        }
        (self.lanes, self.cross, self.swamping) = (0, 0, L::zero());
    }

    /// The dofs of one, each with its column of the Jacobian.
    #[inline(always)]
    pub fn columns<'a>(
        &'a self,
        model: &'a Model<L::Real>,
        equality: &Equality<L::Real>,
    ) -> impl Iterator<Item = (usize, &'a [L])> + Clone {
        let dofs = &model.equality_dofs[equality.dofs.range()];
        let columns = self.jacobian[equality.jacobian as usize..].chunks_exact(equality.dim());
        dofs.iter().map(|entry| entry.dof as usize).zip(columns)
    }
}

/// Numbers of the equality constraints, which act in the worlds of `alive` in which they are `active`, that is not 0. Returns the
/// worlds in which some are, and those in which some are that couple dofs that the inertia matrix does not.
pub fn equality_rows<L: Lane>(
    model: Instance<'_, L>,
    motion: Motion<'_, L>,
    (configuration, active): (Configuration<'_, L>, &[L]),
    alive: L::Mask,
    out: &mut Equalities<L>,
) -> [L::Mask; 2] {
    orientation::quaternions(&model, configuration, out.turning.iter().copied(), &mut out.quats);
    out.swamping = L::zero();
    let [mut some, mut cross] = [L::Mask::splat(false); 2];
    for (e, equality) in model.equalities.iter().enumerate() {
        let acts = !active[equality.id as usize].eq(L::zero()) & alive;
        some = some | acts;
        if equality.cross {
            cross = cross | acts;
        }
        let held = match equality.kind {
            EqualityKind::Joint => joint::held(equality, equality.qpos, configuration.qpos),
            EqualityKind::Tendon => joint::held(equality, equality.tendons, &motion.tendons.length),
            EqualityKind::Connect | EqualityKind::Weld => sides::held(model, equality, motion, &out.quats),
        };
        write(model, e, &held, motion, acts, out);
    }
    [some, cross]
}

/// The links that welds hold, with all that carry them, parents first.
fn turning<T>(model: &Model<T>) -> Vec<u32> {
    let mut links = Vec::new();
    for weld in model.equalities.iter().filter(|equality| equality.kind == EqualityKind::Weld) {
        for mut link in weld.links {
            while link != NONE {
                links.push(link);
                link = model.links[link as usize].parent;
            }
        }
    }
    links.sort_unstable();
    links.dedup();
    links
}

/// What an equality constraint holds, and the rates that its Jacobian is made of.
struct Held<L> {
    /// What should be 0, row by row.
    pos: [L; 6],
    /// What the rates of that change by without an acceleration of the joints.
    drift: [L; 6],
    /// What the Jacobian is made of.
    rates: Rates<L>,
}

/// How a dof moves what is held.
enum Rates<L> {
    /// As its joint, or the tendons that it changes: by this times their velocity, for the first and the second.
    Lengths([L; 2]),
    /// As points and frames.
    Sides(sides::Sides<L>),
}

/// Writes the numbers of an equality constraint's rows, in the worlds where it is active: Jacobian, position, D and minus the
/// reference acceleration b J v + k d r + J̇ v. As in MuJoCo, it does not act where nothing moves what it holds.
#[inline(always)]
fn write<L: Lane>(
    model: Instance<'_, L>,
    e: usize,
    held: &Held<L>,
    motion: Motion<'_, L>,
    acts: L::Mask,
    out: &mut Equalities<L>,
) {
    let equality = &model.equalities[e];
    let dofs = &model.equality_dofs[equality.dofs.range()];
    let (dim, impedance) = (equality.dim(), equality.impedance.lanes::<L>());
    let (mut moves, mut speeds) = (L::Mask::splat(false), [L::zero(); 6]);
    let columns = out.jacobian[equality.jacobian as usize..].chunks_exact_mut(dim);
    for (entry, column) in dofs.iter().zip(columns) {
        let rates = rates(&model, equality, &held.rates, entry, motion);
        let qvel = motion.qvel[entry.dof as usize];
        for ((j, speed), rate) in column.iter_mut().zip(&mut speeds).zip(rates) {
            *j = rate;
            *speed = rate.mul_add(qvel, *speed);
            moves = moves | !rate.eq(L::zero());
        }
    }
    // All rows together are off by so much.
    let mut square = L::zero();
    for r in &held.pos[..dim] {
        square = r.mul_add(*r, square);
    }
    let d = super::impedance(&impedance, square.sqrt());
    let weights = model.equality_weight(e);
    let acts = acts & moves;
    out.swamping = out.swamping.max(L::select(acts, d / (L::one() - d), L::zero()));
    for (i, row) in equality.rows().enumerate() {
        out.pos[row] = held.pos[i];
        out.d[row] = L::select(acts, L::one() / regulariser(d, weights[i / 3]), L::zero());
        let pull = impedance.b.mul_add(speeds[i], impedance.k * d * held.pos[i]);
        out.reference[row] = pull + held.drift[i];
    }
}

/// The column of a dof.
#[inline(always)]
fn rates<L: Lane>(
    model: &Model<L::Real>,
    equality: &Equality<L::Real>,
    rates: &Rates<L>,
    entry: &EqualityDof,
    motion: Motion<'_, L>,
) -> [L; 6] {
    match rates {
        Rates::Lengths(factors) => {
            let mut column = zero();
            for side in (0..2).filter(|side| entry.moves[*side]) {
                column[0] = match equality.tendons[side] {
                    NONE => factors[side],
                    tendon => {
                        let columns = tendon::columns(model, tendon as usize, &motion.tendons.jacobian);
                        let own = columns.filter(|(dof, _)| *dof == entry.dof as usize);
                        own.fold(column[0], |sum, (_, j)| factors[side].mul_add(j, sum))
                    }
                };
            }
            column
        }
        Rates::Sides(sides) => sides.rates(&motion.position.cdof[entry.dof as usize], entry.moves),
    }
}
