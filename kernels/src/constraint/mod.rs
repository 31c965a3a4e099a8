//! Constraint rows: dry friction, limits and contacts, with regularisation and reference acceleration.
//!
//! A contact has `dim` components: normal velocity, two tangential, spin and two rolling. Its pyramid's rows are
//! `normal ± μⱼ·componentⱼ`. Contacts that act in no world of the block are left out; a world in which a row does not act has
//! D = 0 there.
//!
//! A component's row is a spatial vector `w` at the tree's origin, which measures the motion of a link, or that of a link
//! relative to another of the same tree: its Jacobian is ± w·cdof for every dof that moves the one and not the other. Where
//! both sides move it is stored over those dofs, for the Hessian, and for contacts between trees, which have no such vector.

mod belt;
mod contacts;
mod discrete;
mod dof_rows;
mod equality;
mod impedance;

pub use belt::drive;
pub(crate) use contacts::grow;
pub use contacts::{
    Classes, Motion, Numbers, Regular, cone, first_dof, kinds, measure, motion_row, regular, rows_of_pairs,
};
pub use discrete::{Metric, discretise, held};
pub use dof_rows::{Measured, all_dof_rows, dof_lanes, joint_rows};
pub use equality::{Equalities, equality_rows, slope};
pub use impedance::impedance;

use crate::lane::Lane;
use crate::math::vec3::Vec3;
use crate::model::{Model, Sides};

/// What a row on a joint or tendon stands for. J is that of the length that it is about: of one dof, or of a tendon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DofRowKind {
    /// Dry friction: force within ± bound.
    Friction,
    /// The limit that is exceeded, lower or upper: J times 1 or -1, the row's sign.
    Limit,
    /// Lower limit, of a range so narrow that both may act at once: J.
    Lower,
    /// Upper limit: -J.
    Upper,
    /// Limit of a ball joint: J = -axis on three dofs.
    Ball,
}

/// A row that acts on the dofs of one joint, or along a tendon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DofRow {
    /// Kind.
    pub kind: DofRowKind,
    /// Index into the model's friction losses or limits.
    pub id: u32,
    /// First dof of the joint.
    pub dof: u32,
    /// Tendon, or [`NONE`](crate::model::NONE).
    pub tendon: u32,
}

/// A row's numbers: rotation axis of a ball joint's limit, or the sign of a limit first; violation r - margin (0 for
/// friction); D = 1/R, which is 0 in worlds where the row does not act; minus the reference acceleration. An array, which
/// generated code can read.
pub type DofLanes<L> = [L; 6];

/// A row on a joint or tendon: what it is, and its numbers.
#[derive(Clone, Copy, Debug)]
pub struct DofLaw<'a, L> {
    /// What it is.
    pub row: DofRow,
    lanes: &'a DofLanes<L>,
}

impl<L: Lane> DofLaw<'_, L> {
    /// Axis of a ball joint's limit.
    #[inline(always)]
    pub fn axis(&self) -> Vec3<L> {
        [self.lanes[0], self.lanes[1], self.lanes[2]]
    }

    /// Sign of a limit that may be the lower or the upper one.
    #[inline(always)]
    pub fn sign(&self) -> L {
        self.lanes[0]
    }

    /// Violation r - margin.
    #[inline(always)]
    pub fn pos(&self) -> L {
        self.lanes[3]
    }

    /// D = 1/R.
    #[inline(always)]
    pub fn d(&self) -> L {
        self.lanes[4]
    }

    /// Minus the reference acceleration.
    #[inline(always)]
    pub fn reference(&self) -> L {
        self.lanes[5]
    }
}

/// The set to which a contact's force is confined.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Cone {
    /// Normal force alone.
    Ray,
    /// Pyramid: one row per edge, all with the same D.
    Pyramid,
    /// Elliptic cone: one row per component, of D·(μⱼ/μ̂)².
    Ellipse,
}

/// A contact's place among the rows.
#[derive(Clone, Copy, Debug)]
pub struct ContactRow {
    /// Index into the block's contacts.
    pub contact: u32,
    /// Pair.
    pub pair: u32,
    /// Number of components.
    pub dim: u32,
    /// First component in the flat arrays.
    pub component: u32,
    /// Worlds in which it acts, bit by bit.
    pub lanes: u32,
    /// What moves.
    pub sides: Sides,
    /// Link whose motion the components measure, unless the sides are apart.
    pub link: u32,
    /// Link relative to which they do, if both sides move in one tree, else [`NONE`](crate::model::NONE).
    pub other: u32,
    /// First entry of the stored Jacobian (both sides move): dof by dof, the components of each.
    pub jacobian: u32,
    /// Entry in the list of strengths.
    pub strength: u32,
    /// Cone.
    pub cone: Cone,
    /// Number of its kind among the model's, [`Constraint::kinds`]; beyond those, of contacts between trees, that of its class.
    pub number: u32,
    /// Its place in what the narrow phase found.
    pub place: u32,
    /// Its classes, see [`Classes`]: that of its numbers where one side stands still;
    pub law: u32,
    /// the same where both move;
    pub links: u32,
    /// and that of what it adds to the Hessian.
    pub couple: u32,
}

/// What decides a contact's force: D of the normal row, and of every row of a pyramid, which is 0 in worlds where the
/// contact does not act; the regularised friction coefficient μ̂ of an elliptic cone, or D of a pyramid's row over the inertia
/// that the contact meets; friction of components 1 to 5. An array, which generated code can read.
pub type Strength<L> = [L; 7];

/// The law of a contact's force.
#[derive(Clone, Copy, Debug)]
pub struct Law<'a, L> {
    /// Cone.
    pub cone: Cone,
    /// Its numbers.
    pub strength: &'a Strength<L>,
}

impl<L: Copy> Law<'_, L> {
    /// D of the normal row, and of every row of a pyramid.
    #[inline(always)]
    pub fn d(&self) -> L {
        self.strength[0]
    }

    /// Regularised friction coefficient μ̂ of an elliptic cone.
    #[inline(always)]
    pub fn mu(&self) -> L {
        self.strength[1]
    }

    /// D of a pyramid's row over the inertia that it meets: how much stiffer than heavy the contact is.
    #[inline(always)]
    pub fn swamping(&self) -> L {
        self.strength[1]
    }

    /// Friction of component `j`, from 1.
    #[inline(always)]
    pub fn friction(&self, j: usize) -> L {
        self.strength[1 + j]
    }
}

/// What the shape of a contact's equations depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Kind {
    /// What moves.
    pub sides: Sides,
    /// Cone.
    pub cone: Cone,
    /// Number of components.
    pub dim: u32,
}

impl ContactRow {
    /// Its kind.
    #[inline(always)]
    pub fn kind(&self) -> Kind {
        Kind { sides: self.sides, cone: self.cone, dim: self.dim }
    }

    /// Its components in the flat arrays.
    #[inline(always)]
    pub fn components(&self) -> std::ops::Range<usize> {
        self.component as usize..(self.component + self.dim) as usize
    }

    /// Number of edges of its pyramid, if it has one.
    #[inline(always)]
    pub fn edges(&self) -> usize {
        if self.cone == Cone::Pyramid { 2 * (self.dim as usize - 1) } else { 0 }
    }

    /// Number of constraint rows that the contact counts as.
    pub fn rows(&self) -> u32 {
        match self.cone {
            Cone::Ray | Cone::Ellipse => self.dim,
            Cone::Pyramid => 2 * (self.dim - 1),
        }
    }
}

/// Constraint rows of a block. Lists of contacts' numbers never get shorter, so that fields that are lent to code stay what
/// they are: beyond the listed contacts they hold numbers that nobody may read.
#[derive(Clone, Debug)]
pub struct Constraint<L> {
    /// Rows on joints and tendons: all that the model has.
    pub dof_rows: Vec<DofRow>,
    /// Their numbers.
    pub dof_lanes: Vec<DofLanes<L>>,
    /// Worlds in which some row on a joint or tendon acts, bit by bit.
    pub joint_lanes: u32,
    /// Worlds in which some of those acts that couples dofs that the inertia matrix does not.
    pub joint_cross: u32,
    /// Worlds in which some contact acts.
    pub contact_lanes: u32,
    /// Kinds of contacts with sides in one tree that the model can have, in the order in which they are worked through.
    pub kinds: Vec<Kind>,
    /// Whether the model can have contacts between trees.
    pub between_trees: bool,
    /// By pair, what its contacts have in common; their places are 0.
    pub rows_of_pairs: Vec<ContactRow>,
    /// Contacts that act in some world.
    pub contact_rows: Vec<ContactRow>,
    /// Number of components that those have together.
    pub components: usize,
    /// Whether some listed contact has a stored Jacobian: both its sides move.
    pub coupled: bool,
    /// Strengths of those contacts.
    pub strengths: Vec<Strength<L>>,
    /// Per component: minus the reference acceleration.
    pub reference: Vec<L>,
    /// Per component of contacts with sides in one tree: motion row at the tree's origin.
    pub motion: Vec<[L; 6]>,
    /// Jacobians of contacts whose sides both move.
    pub jacobian: Vec<L>,
    /// Whether some listed contact, equality constraint or row along a tendon couples dofs that the inertia matrix does not.
    pub cross: bool,
    /// Equality constraints.
    pub equality: Equalities<L>,
}

impl<L: Lane> Constraint<L> {
    /// Room for the rows that the model can have.
    pub fn new(model: &Model<L::Real>) -> Self {
        let capacity = model.capacity();
        let dof_rows: Vec<DofRow> = all_dof_rows(model).collect();
        Constraint {
            dof_lanes: vec![[L::zero(); 6]; dof_rows.len()],
            dof_rows,
            joint_lanes: 0,
            joint_cross: 0,
            contact_lanes: 0,
            rows_of_pairs: rows_of_pairs(model).0,
            kinds: kinds(model),
            between_trees: model.pairs.iter().any(|pair| pair.sides == Sides::Apart),
            contact_rows: Vec::with_capacity(capacity.contacts),
            components: 0,
            coupled: false,
            strengths: Vec::with_capacity(capacity.contacts),
            reference: Vec::with_capacity(capacity.components),
            motion: Vec::with_capacity(capacity.components),
            jacobian: Vec::with_capacity(capacity.jacobian),
            cross: false,
            equality: Equalities::new(model),
        }
    }

    /// Bytes of that.
    pub fn bytes(model: &Model<L::Real>) -> usize {
        let capacity = model.capacity();
        capacity.dof_rows * (size_of::<DofRow>() + size_of::<DofLanes<L>>())
            + capacity.contacts * (size_of::<ContactRow>() + size_of::<Strength<L>>())
            + (7 * capacity.components + capacity.jacobian) * size_of::<L>()
            + model.pairs.len() * size_of::<ContactRow>()
            + Equalities::<L>::bytes(model)
    }

    /// The rows on joints and tendons.
    #[inline(always)]
    pub fn dof_laws(&self) -> impl Iterator<Item = DofLaw<'_, L>> {
        self.dof_rows.iter().zip(&self.dof_lanes).map(|(row, lanes)| DofLaw { row: *row, lanes })
    }

    /// The law of a listed contact's force.
    #[inline(always)]
    pub fn law(&self, row: &ContactRow) -> Law<'_, L> {
        Law { cone: row.cone, strength: &self.strengths[row.strength as usize] }
    }

    /// The stored Jacobian of a contact whose sides both move, over so many dofs.
    #[inline(always)]
    pub fn jacobian_of(&self, row: &ContactRow, dofs: usize) -> &[L] {
        &self.jacobian[row.jacobian as usize..][..dofs * row.dim as usize]
    }

    /// What is kept of a listed contact, and its stored Jacobian over so many dofs.
    #[inline(always)]
    pub fn numbers_mut(&mut self, row: &ContactRow, dofs: usize) -> (Numbers<'_, L>, &mut [L]) {
        let numbers = Numbers {
            strength: &mut self.strengths[row.strength as usize],
            motion: &mut self.motion[row.components()],
            reference: &mut self.reference[row.components()],
        };
        (numbers, &mut self.jacobian[row.jacobian as usize..][..dofs * row.dim as usize])
    }

    /// Contacts between trees.
    #[inline(always)]
    pub fn apart(&self) -> impl Iterator<Item = &ContactRow> {
        self.contact_rows.iter().filter(|row| row.sides == Sides::Apart)
    }

    /// Worlds in which some equality constraint or row along a tendon acts that couples dofs that the inertia matrix does not.
    #[inline(always)]
    pub fn joining(&self) -> u32 {
        self.equality.cross | self.joint_cross
    }

    /// No row acts in any world.
    pub fn clear(&mut self) {
        if self.joint_lanes != 0 {
            self.dof_lanes.iter_mut().for_each(|lanes| lanes[4] = L::zero());
        }
        self.contact_rows.clear();
        self.equality.clear();
        (self.joint_lanes, self.joint_cross, self.contact_lanes, self.cross) = (0, 0, 0, false);
    }

    /// Whether no row acts in any world.
    pub fn is_empty(&self) -> bool {
        self.joint_lanes == 0 && self.contact_rows.is_empty() && self.equality.lanes == 0
    }
}
