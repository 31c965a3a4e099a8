//! Tendons: what they run along, and what acts along them.

use super::cast::{Cast, Representable, table};
use super::{Model, Span};
use crate::lane::Real;

table! {
    /// A tendon: its length is a sum over joints (fixed), or that of a path from site to site (spatial).
    pub struct Tendon {
        /// The dofs that change its length, in [`Model::tendon_dofs`], ascending; each has a place of the same number in the Jacobian.
        pub dofs: Span,
        /// The pieces of its path, in [`Model::stretches`]; none of a fixed one.
        pub stretches: Span,
        /// Whether `dofs` lie on different branches, so that rows along it couple dofs that the inertia matrix does not.
        pub cross: bool,
        /// Whether any stiffness is not zero.
        pub spring: bool,
        /// Where its spring rests among [`State::plastic`](crate::state::State::plastic), if it yields, or [`NONE`](super::NONE).
        pub plastic: u32,
        /// Whether any damping is not zero.
        pub damped: bool,
        /// Whether `damping[1..]` are zero.
        pub damping_linear: bool,
        /// Whether it has armature.
        pub heavy: bool,
        /// Whether the total force of its actuators is bounded.
        pub force_limited: bool,
        real:
        /// Lengths between which the spring rests.
        pub rest: [T; 2],
        /// Coefficients of the spring force.
        pub stiffness: [T; 3],
        /// How far its spring is stretched before it yields.
        pub springyield: T,
        /// Coefficients of the damper force.
        pub damping: [T; 3],
        /// Inertia against changes of its length.
        pub armature: T,
        /// Bounds of the total force of its actuators.
        pub force_range: [T; 2],
    } T
}

impl<T: Copy> Tendon<T> {
    /// First coefficients of stiffness and damping, and the lengths between which the spring rests.
    #[inline(always)]
    pub fn tension(&self) -> [T; 4] {
        let [low, high] = self.rest;
        [self.stiffness[0], self.damping[0], low, high]
    }
}

impl<T> Tendon<T> {
    /// Whether its length is a sum over joints.
    #[inline(always)]
    pub fn fixed(&self) -> bool {
        self.stretches.len == 0
    }
}

table! {
    /// A degree of freedom of a tendon.
    pub struct TendonDof {
        /// Degree of freedom.
        pub dof: u32,
        /// Position of its joint, of a fixed tendon.
        pub qpos: u32,
        real:
        /// What the length gains with it, of a fixed tendon.
        pub coef: T,
    } T
}

/// What a tendon may wrap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Round {
    /// A sphere.
    Sphere,
    /// A cylinder along z, without ends.
    Cylinder,
}

/// On which side a tendon passes what it may wrap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Passes {
    /// On the shorter one.
    Anywhere,
    /// On that of a site outside.
    Outside,
    /// Through the inside.
    Inside,
    /// One of the two: the site moves against what is wrapped.
    Either,
}

table! {
    /// A piece of a tendon's path, from one site to the next.
    pub struct Stretch {
        /// Links of the two sites and of what it may wrap; [`NONE`](super::NONE): it stands still, or there is none.
        pub links: [u32; 3],
        /// MJCF bodies of the same; [`NONE`](super::NONE): there is nothing to wrap.
        pub bodies: [u32; 3],
        /// What it may wrap.
        pub round: Option<Round>,
        /// Where it passes that.
        pub passes: Passes,
        /// Link of the site that says so.
        pub side_link: u32,
        /// Degrees of freedom that move some of `links` against others, in [`Model::stretch_dofs`].
        pub dofs: Span,
        real:
        /// The sites in their links' frames, or in the world.
        pub pos: [[T; 3]; 2],
        /// What of its length counts: one over the pulley's divisor.
        pub share: T,
        /// Middle of what it may wrap, likewise.
        pub middle: [T; 3],
        /// Its orientation, row-major, likewise.
        pub rot: [T; 9],
        /// Its radius.
        pub radius: T,
        /// The site that says where it passes: where the site moves against what is wrapped, in its link's frame; else in the frame of what is
        /// wrapped.
        pub side: [T; 3],
    } T
}

/// One degree of freedom of a piece of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StretchDof {
    /// Degree of freedom.
    pub dof: u32,
    /// Its entry in [`Model::tendon_dofs`].
    pub entry: u32,
    /// Which of the piece's links it moves.
    pub moves: [bool; 3],
}

impl<T> Model<T> {
    /// Lists of dofs that rows along tendons couple beyond the inertia matrix, ascending: of tendons with a limit or dry friction.
    pub fn tendon_joins(&self) -> impl Iterator<Item = &[TendonDof<T>]> {
        let limits = self.limits.iter().map(|limit| limit.tendon);
        let held = limits.chain(self.friction_losses.iter().map(|loss| loss.tendon));
        let tendons = held.filter_map(|tendon| self.tendons.get(tendon as usize));
        tendons.filter(|tendon| tendon.cross).map(|tendon| &self.tendon_dofs[tendon.dofs.range()])
    }
}
