//! The smooth acceleration over a step, where one evaluation at its beginning is not all that it is made of: the second velocity of
//! midpoint steps, and the guard.

mod guard;
mod midpoint;
mod root;

pub use guard::{Stages, book, guard, keep};
pub use midpoint::midpoint;

use crate::fields::fields;
use crate::lane::{Lane, LaneQuery};
use crate::model::{Model, Sizes};
use crate::options::Integrator;
use crate::velocity::Velocity;

fields! {
    /// What the guard hands from the smooth stages to the end of the step.
    pub struct Guard(sizes) {
        /// Velocity after the inertial forces and half of the others.
        pub velocity: Vec<L> = if sizes.nguard > 0 { sizes.nv } else { 0 },
        /// The books of each tree at the end of the step, as in [`State`](crate::state::State).
        pub books: Vec<[L; 15]> = sizes.nguard,
        /// 1 where the guard took more than a hundredth of a tree's inner velocities.
        pub acted: Vec<L> = sizes.nguard,
    } L
}

fields! {
    /// Vectors that are worked with.
    pub struct Scratch(sizes) {
        /// Bias force at the middle velocity.
        pub bias: Vec<L> = sizes.nv,
        /// First acceleration; then the velocity that inertial forces add.
        pub first: Vec<L> = sizes.nv,
        /// Middle velocity; then the velocity that all other forces add.
        pub second: Vec<L> = sizes.nv,
        /// What that leaves of its own equation; then what the guard changes.
        pub change: Vec<L> = sizes.nv,
        /// Products with the inertia, or with the metric.
        pub product: Vec<L> = sizes.nv,
        /// The same of the velocity that other forces add.
        pub forced: Vec<L> = sizes.nv,
        /// The same of that which inertial forces add.
        pub inertial: Vec<L> = sizes.nv,
    } L
}

/// What models have that are integrated by midpoint steps, or with a guard.
#[derive(Clone, Debug)]
pub struct Kick<L> {
    /// What the guard hands on.
    pub guard: Guard<L>,
    /// Scratch.
    pub scratch: Scratch<L>,
    /// Motions at the middle velocity.
    pub motion: Velocity<L>,
}

impl<L: Lane> Kick<L> {
    /// Room for a model that needs it.
    pub fn new(model: &Model<L::Real>) -> Option<Self> {
        let sizes = &model.sizes;
        kicks(model).then(|| Kick {
            guard: Guard::new(sizes),
            scratch: Scratch::new(sizes),
            motion: Velocity::new(&motions(model)),
        })
    }

    /// Bytes of that.
    pub fn bytes(model: &Model<L::Real>) -> usize {
        let of = |sizes: &Sizes| Guard::<L>::bytes(sizes).saturating_add(Scratch::<L>::bytes(sizes));
        if kicks(model) { of(&model.sizes).saturating_add(Velocity::<L>::bytes(&motions(model))) } else { 0 }
    }
}

impl<L: LaneQuery> Kick<L> {
    /// Worlds in which the guard has acted.
    pub fn acted(&self) -> u32 {
        self.guard.acted.iter().fold(0, |lanes, acted| lanes | L::bits(acted.gt(L::zero())))
    }
}

/// Whether a model's steps are kicked.
pub fn kicks<T>(model: &Model<T>) -> bool {
    model.options.integrator == Integrator::Midpoint || model.sizes.nguard > 0
}

fn motions<T>(model: &Model<T>) -> Sizes {
    match model.options.integrator {
        Integrator::Midpoint => model.sizes.clone(),
        _ => Sizes::default(),
    }
}
