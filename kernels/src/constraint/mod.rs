//! Constraint rows: dry friction, joint limits and contacts, with regularisation and reference acceleration.
//!
//! A contact has `dim` components: normal velocity, two tangential, spin and two rolling. Its pyramid's rows are
//! `normal ± μⱼ·componentⱼ`. Rows of limits and contacts that act in no world of the block are left out; a world in which
//! a listed row does not act has D = 0 there.
//!
//! Contacts come in two kinds. One side stands still: the component's row is a spatial vector `w` at the tree's origin,
//! its Jacobian is w·cdof for every dof that moves the link. Both sides move: the Jacobian is stored over the dofs that
//! move one side and not the other.

mod contacts;
mod dof_rows;
mod impedance;

pub use contacts::{cone, contact_rows};
pub use dof_rows::dof_rows;
pub use impedance::impedance;

use crate::lane::Lane;
use crate::math::vec3::Vec3;
use crate::model::Model;

/// What a row on a joint stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DofRowKind {
    /// Dry friction: force within ± bound.
    Friction,
    /// Lower limit: J = +1.
    Lower,
    /// Upper limit: J = -1.
    Upper,
    /// Limit of a ball joint: J = -axis on three dofs.
    Ball,
}

/// A row that acts on the dofs of one joint.
#[derive(Clone, Copy, Debug)]
pub struct DofRow<L> {
    /// Kind.
    pub kind: DofRowKind,
    /// Index into the model's friction losses or limits.
    pub id: u32,
    /// First dof.
    pub dof: u32,
    /// Rotation axis of a ball joint's limit; unused otherwise.
    pub axis: Vec3<L>,
    /// Violation r - margin (0 for friction).
    pub pos: L,
    /// D = 1/R; 0 in worlds where the row does not act.
    pub d: L,
    /// Minus the reference acceleration.
    pub reference: L,
    /// Largest force (friction).
    pub bound: L,
}

/// The set to which a contact's force is confined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
    /// Link that moves, if the other side stands still, else [`NONE`](crate::model::NONE).
    pub link: u32,
    /// First entry of the stored Jacobian (both sides move): dof by dof, the components of each.
    pub jacobian: u32,
    /// First among the block's edges of rays and pyramids, or place among its elliptic contacts.
    pub edge: u32,
    /// Entry in the list of strengths.
    pub strength: u32,
    /// Cone.
    pub cone: Cone,
}

/// What decides a contact's force: D of the normal row, and of every row of a pyramid, which is 0 in worlds where the
/// contact does not act; the regularised friction coefficient μ̂ of an elliptic cone; friction of components 1 to 5. An
/// array, which generated code can read.
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

    /// Friction of component `j`, from 1.
    #[inline(always)]
    pub fn friction(&self, j: usize) -> L {
        self.strength[1 + j]
    }
}

impl ContactRow {
    /// Number of edges, or of ellipses.
    #[inline(always)]
    pub fn edges(&self) -> usize {
        match self.cone {
            Cone::Ray | Cone::Ellipse => 1,
            Cone::Pyramid => 2 * (self.dim as usize - 1),
        }
    }

    /// Its components in the flat arrays.
    #[inline(always)]
    pub fn components(&self) -> std::ops::Range<usize> {
        self.component as usize..(self.component + self.dim) as usize
    }

    /// Number of constraint rows that the contact counts as.
    pub fn rows(&self) -> u32 {
        match self.cone {
            Cone::Ray | Cone::Ellipse => self.dim,
            Cone::Pyramid => 2 * (self.dim - 1),
        }
    }
}

/// Constraint rows of a block.
#[derive(Clone, Debug)]
pub struct Constraint<L> {
    /// Rows on joints.
    pub dof_rows: Vec<DofRow<L>>,
    /// Contacts that act in some world.
    pub contact_rows: Vec<ContactRow>,
    /// Strengths of those contacts.
    pub strengths: Vec<Strength<L>>,
    /// Per component: minus the reference acceleration.
    pub reference: Vec<L>,
    /// Per component of contacts with one moving side: motion row at the tree's origin.
    pub motion: Vec<[L; 6]>,
    /// Jacobians of contacts with two moving sides.
    pub jacobian: Vec<L>,
    /// Whether some listed contact couples dofs that the inertia matrix does not.
    pub cross: bool,
}

impl<L: Lane> Constraint<L> {
    /// Room for the rows that the model can have.
    pub fn new(model: &Model<L::Real>) -> Self {
        let capacity = model.capacity();
        Constraint {
            dof_rows: Vec::with_capacity(capacity.dof_rows),
            contact_rows: Vec::with_capacity(capacity.contacts),
            strengths: Vec::with_capacity(capacity.contacts),
            reference: Vec::with_capacity(capacity.components),
            motion: Vec::with_capacity(capacity.components),
            jacobian: Vec::with_capacity(capacity.jacobian),
            cross: false,
        }
    }

    /// Bytes of the lists.
    pub fn bytes(&self) -> usize {
        self.dof_rows.capacity() * size_of::<DofRow<L>>()
            + self.contact_rows.capacity() * size_of::<ContactRow>()
            + self.strengths.capacity() * size_of::<Strength<L>>()
            + (self.reference.capacity() + self.jacobian.capacity() + 6 * self.motion.capacity()) * size_of::<L>()
    }

    /// The law of a listed contact's force.
    #[inline(always)]
    pub fn law(&self, row: &ContactRow) -> Law<'_, L> {
        Law { cone: row.cone, strength: &self.strengths[row.strength as usize] }
    }

    /// Whether no row acts in any world.
    pub fn is_empty(&self) -> bool {
        self.dof_rows.is_empty() && self.contact_rows.is_empty()
    }
}
