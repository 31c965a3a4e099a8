//! Numbers of the model that differ from world to world.
//!
//! Kernels read what may vary through [`Instance`], the model as the worlds of a block have it: shared numbers come from
//! the tables and fold into recorded code, varying ones are lanes, which become inputs of the code.

use std::ops::Deref;

use super::{Geom, Impedance, Limit, Link, Model, Pair, Tendon};
use crate::lane::{Lane, Mask};
use crate::math::vec3::splat;

/// Numbers of the tables that can vary.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Quantity {
    /// Gravity: three numbers.
    Gravity,
    /// Potential energy of the bodies that stand still: one number.
    StillPotential,
    /// First damping coefficient of each dof.
    Damping,
    /// First stiffness coefficient of each joint.
    Stiffness,
    /// Gain of each actuator, three numbers.
    Gain,
    /// Bias of each actuator, three numbers.
    Bias,
    /// Gear of each actuator, six numbers.
    Gear,
    /// What contact rows of each pair depend on, 17 numbers, see [`Pair::law`], in place of [`Quantity::Law`].
    Grip,
    /// Mass, centre of mass and inertia of each link, ten numbers.
    Link,
    /// Gravity compensation of each link and where it acts, four numbers.
    Compensation,
    /// Armature of each dof.
    Armature,
    /// Inverse weight of each limit.
    LimitWeight,
    /// Regulariser of each dry friction.
    Regulariser,
    /// Mean inertia: one number.
    MeanInertia,
    /// Mass of each MJCF body.
    BodyMass,
    /// Inverse weights of each equality constraint, two numbers.
    EqualityWeight,
    /// Principal moments of inertia of each MJCF body, three numbers.
    BodyInertia,
    /// Range, margin and impedance of each limit, twelve numbers, see [`Limit::numbers`].
    Limit,
    /// Largest force of each dry friction.
    Loss,
    /// Where each joint's spring rests, seven numbers.
    Rest,
    /// Of each tendon, the first coefficients of stiffness and damping, and the lengths between which its spring rests.
    Tension,
    /// Bounds of each actuator's force, two numbers.
    ForceRange,
    /// Bounds of each control, two numbers.
    ControlRange,
    /// What each actuator's activation follows its control by, three numbers.
    Times,
    /// Position, orientation and sizes of each geom, 15 numbers: shared by all worlds, see [`Quantity::SHARED`].
    Geom,
    /// Distance within which contacts of each pair are listed: likewise.
    Include,
    /// What contact rows of each pair depend on, 17 numbers, see [`Pair::law`]: likewise.
    Law,
    /// A zero that nobody who records may know: likewise.
    Zero,
}

impl Quantity {
    /// All of them.
    pub const ALL: [Quantity; 28] = [
        Quantity::Gravity,
        Quantity::StillPotential,
        Quantity::Damping,
        Quantity::Stiffness,
        Quantity::Gain,
        Quantity::Bias,
        Quantity::Gear,
        Quantity::Grip,
        Quantity::Link,
        Quantity::Compensation,
        Quantity::Armature,
        Quantity::LimitWeight,
        Quantity::Regulariser,
        Quantity::MeanInertia,
        Quantity::BodyMass,
        Quantity::EqualityWeight,
        Quantity::BodyInertia,
        Quantity::Limit,
        Quantity::Loss,
        Quantity::Rest,
        Quantity::Tension,
        Quantity::ForceRange,
        Quantity::ControlRange,
        Quantity::Times,
        Quantity::Geom,
        Quantity::Include,
        Quantity::Law,
        Quantity::Zero,
    ];

    /// Those that never vary. Code for one part that is run for many elements reads them from arrays, where kernels read the
    /// tables.
    pub const SHARED: [Quantity; 4] = [Quantity::Geom, Quantity::Include, Quantity::Law, Quantity::Zero];

    /// Those that may vary from world to world: the first ones.
    pub const VARYING: [Quantity; Self::ALL.len() - Self::SHARED.len()] = {
        let mut varying = [Quantity::Gravity; Self::ALL.len() - Self::SHARED.len()];
        let mut i = 0;
        while i < varying.len() {
            varying[i] = Self::ALL[i];
            i += 1;
        }
        varying
    };

    /// The same as a set.
    pub fn varying() -> Quantities {
        Quantities::of(&Self::VARYING)
    }

    /// Name.
    pub const fn name(self) -> &'static str {
        NAMES[self as usize]
    }

    /// Numbers of an element.
    pub const fn width(self) -> usize {
        match self {
            Quantity::Gravity | Quantity::Gain | Quantity::Bias | Quantity::BodyInertia | Quantity::Times => 3,
            Quantity::Gear => 6,
            Quantity::Rest => 7,
            Quantity::Link => 10,
            Quantity::Compensation | Quantity::Tension => 4,
            Quantity::EqualityWeight | Quantity::ForceRange | Quantity::ControlRange => 2,
            Quantity::Geom => 15,
            Quantity::Limit => Limit::<f64>::NUMBERS,
            Quantity::Grip | Quantity::Law => Pair::<f64>::LAW,
            _ => 1,
        }
    }

    /// The model's own numbers, element by element.
    pub fn of<T: Copy + Default>(self, model: &Model<T>) -> Vec<T> {
        match self {
            Quantity::Gravity => model.gravity.to_vec(),
            Quantity::StillPotential => vec![model.potential_still],
            Quantity::Damping => model.dofs.iter().map(|dof| dof.damping[0]).collect(),
            Quantity::Stiffness => model.joints.iter().map(|joint| joint.stiffness[0]).collect(),
            Quantity::Gain => model.actuators.iter().flat_map(|actuator| actuator.gain).collect(),
            Quantity::Bias => model.actuators.iter().flat_map(|actuator| actuator.bias).collect(),
            Quantity::Gear => model.actuators.iter().flat_map(|actuator| actuator.gear).collect(),
            Quantity::Link => {
                let mass = |link: &Link<T>| [link.mass].into_iter().chain(link.com).chain(link.inertia);
                model.links.iter().flat_map(mass).collect()
            }
            Quantity::Compensation => {
                let lift = |link: &Link<T>| [link.gravcomp].into_iter().chain(link.gravcomp_pos);
                model.links.iter().flat_map(lift).collect()
            }
            Quantity::Armature => model.dofs.iter().map(|dof| dof.armature).collect(),
            Quantity::LimitWeight => model.limits.iter().map(|limit| limit.invweight).collect(),
            Quantity::Regulariser => model.friction_losses.iter().map(|loss| loss.r).collect(),
            Quantity::MeanInertia => vec![model.mean_inertia],
            Quantity::BodyInertia => model.bodies.iter().flat_map(|body| body.inertia).collect(),
            Quantity::BodyMass => model.bodies.iter().map(|body| body.mass).collect(),
            Quantity::EqualityWeight => model.equalities.iter().flat_map(|equality| equality.invweight).collect(),
            Quantity::Limit => model.limits.iter().flat_map(Limit::numbers).collect(),
            Quantity::Loss => model.friction_losses.iter().map(|loss| loss.bound).collect(),
            Quantity::Rest => model.joints.iter().flat_map(|joint| joint.qpos_spring).collect(),
            Quantity::Tension => model.tendons.iter().flat_map(Tendon::tension).collect(),
            Quantity::ForceRange => model.actuators.iter().flat_map(|actuator| actuator.force_range).collect(),
            Quantity::ControlRange => model.controls.iter().flat_map(|control| control.range).collect(),
            Quantity::Times => model.actuators.iter().flat_map(|actuator| actuator.times).collect(),
            Quantity::Geom => model.geoms.iter().flat_map(Geom::numbers).collect(),
            Quantity::Include => model.pairs.iter().map(|pair| pair.include).collect(),
            Quantity::Grip | Quantity::Law => model.pairs.iter().flat_map(Pair::law).collect(),
            Quantity::Zero => vec![T::default()],
        }
    }
}

/// Names of the quantities, in the order of [`Quantity::ALL`].
const NAMES: [&str; Quantity::ALL.len()] = [
    "Gravity",
    "StillPotential",
    "Damping",
    "Stiffness",
    "Gain",
    "Bias",
    "Gear",
    "Grip",
    "Link",
    "Compensation",
    "Armature",
    "LimitWeight",
    "Regulariser",
    "MeanInertia",
    "BodyMass",
    "EqualityWeight",
    "BodyInertia",
    "Limit",
    "Loss",
    "Rest",
    "Tension",
    "ForceRange",
    "ControlRange",
    "Times",
    "Geom",
    "Include",
    "Law",
    "Zero",
];

/// A set of quantities.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Quantities(u32);

impl Quantities {
    /// None.
    pub const NONE: Quantities = Quantities(0);

    /// Those of a list.
    pub const fn of(list: &[Quantity]) -> Self {
        let (mut set, mut i) = (0, 0);
        while i < list.len() {
            set |= 1 << list[i] as u32;
            i += 1;
        }
        Quantities(set)
    }

    /// Whether it is among them.
    pub const fn has(self, quantity: Quantity) -> bool {
        self.0 >> quantity as u32 & 1 != 0
    }

    /// Those of either.
    pub const fn or(self, other: Self) -> Self {
        Quantities(self.0 | other.0)
    }

    /// Those of both.
    pub const fn and(self, other: Self) -> Self {
        Quantities(self.0 & other.0)
    }

    /// Whether there are none.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// One after the other.
    pub fn iter(self) -> impl Iterator<Item = Quantity> {
        Quantity::ALL.into_iter().filter(move |quantity| self.has(*quantity))
    }
}

/// The numbers that vary among the worlds of a block.
#[derive(Clone, Debug)]
pub struct Varied<L> {
    set: Quantities,
    /// By quantity; empty if it does not vary.
    lanes: [Vec<L>; Quantity::ALL.len()],
}

impl<L: Lane> Varied<L> {
    /// The model's own numbers in all worlds.
    pub fn new(model: &Model<L::Real>, set: Quantities) -> Self {
        let lanes = |quantity: Quantity| quantity.of(model).into_iter().map(L::splat).collect();
        Varied { set, lanes: Quantity::ALL.map(|q| if set.has(q) { lanes(q) } else { Vec::new() }) }
    }

    /// What varies.
    pub fn set(&self) -> Quantities {
        self.set
    }

    /// A quantity's numbers; none if it does not vary.
    #[inline(always)]
    pub fn lanes(&self, quantity: Quantity) -> &[L] {
        &self.lanes[quantity as usize]
    }

    /// The same, to be changed.
    #[inline(always)]
    pub fn lanes_mut(&mut self, quantity: Quantity) -> &mut [L] {
        &mut self.lanes[quantity as usize]
    }

    /// Bytes of the numbers.
    pub fn bytes(&self) -> usize {
        self.lanes.iter().map(|lanes| size_of_val(&lanes[..])).sum()
    }

    /// Calls `f` with the numbers of everything that varies.
    pub fn for_each(&mut self, f: &mut dyn FnMut(&mut [L])) {
        for quantity in self.set.iter() {
            f(self.lanes_mut(quantity));
        }
    }
}

/// The model as the worlds of a block have it.
#[derive(Debug)]
pub struct Instance<'a, L: Lane> {
    /// What they share; of what varies, only the structure counts.
    pub model: &'a Model<L::Real>,
    /// What varies, if anything does.
    pub varied: Option<&'a Varied<L>>,
}

impl<L: Lane> Clone for Instance<'_, L> {
    #[inline(always)]
    fn clone(&self) -> Self {
        *self
    }
}

impl<L: Lane> Copy for Instance<'_, L> {}

impl<L: Lane> Deref for Instance<'_, L> {
    type Target = Model<L::Real>;
    #[inline(always)]
    fn deref(&self) -> &Model<L::Real> {
        self.model
    }
}

/// Nothing varies.
impl<'a, L: Lane> From<&'a Model<L::Real>> for Instance<'a, L> {
    fn from(model: &'a Model<L::Real>) -> Self {
        Instance { model, varied: None }
    }
}

impl<L: Lane> Instance<'_, L> {
    /// Numbers of element `i` if the quantity varies.
    #[inline(always)]
    fn entry<const N: usize>(&self, quantity: Quantity, i: usize) -> Option<[L; N]> {
        let lanes = self.varied?.lanes(quantity);
        lanes.get(N * i..N * (i + 1)).map(|own| std::array::from_fn(|k| own[k]))
    }

    /// Gravity.
    #[inline(always)]
    pub fn gravity(&self) -> [L; 3] {
        self.entry(Quantity::Gravity, 0).unwrap_or_else(|| splat(&self.model.gravity))
    }

    /// Potential energy of the bodies that stand still.
    #[inline(always)]
    pub fn still_potential(&self) -> L {
        self.entry(Quantity::StillPotential, 0).map_or_else(|| L::splat(self.potential_still), |[x]| x)
    }

    /// Coefficients of a dof's damper.
    #[inline(always)]
    pub fn damping(&self, dof: usize) -> [L; 3] {
        let [a, b, c] = splat(&self.dofs[dof].damping);
        self.entry(Quantity::Damping, dof).map_or([a, b, c], |[own]| [own, b, c])
    }

    /// The worlds in which some dof is damped, if worlds differ in that.
    pub fn damped(&self) -> Option<L::Mask> {
        let lanes = self.varied?.lanes(Quantity::Damping);
        if lanes.is_empty() || self.dofs.iter().any(|dof| !dof.damping_linear) {
            return None;
        }
        Some(lanes.iter().fold(L::Mask::splat(false), |some, x| some | x.gt(L::zero())))
    }

    /// Coefficients of a joint's spring.
    #[inline(always)]
    pub fn stiffness(&self, joint: usize) -> [L; 3] {
        let [a, b, c] = splat(&self.joints[joint].stiffness);
        self.entry(Quantity::Stiffness, joint).map_or([a, b, c], |[own]| [own, b, c])
    }

    /// Gain of an actuator: constant, per length, per velocity.
    #[inline(always)]
    pub fn gain(&self, actuator: usize) -> [L; 3] {
        self.entry(Quantity::Gain, actuator).unwrap_or_else(|| splat(&self.actuators[actuator].gain))
    }

    /// Bias of an actuator, likewise.
    #[inline(always)]
    pub fn bias(&self, actuator: usize) -> [L; 3] {
        self.entry(Quantity::Bias, actuator).unwrap_or_else(|| splat(&self.actuators[actuator].bias))
    }

    /// Gear of an actuator.
    #[inline(always)]
    pub fn gear(&self, actuator: usize) -> [L; 6] {
        self.entry(Quantity::Gear, actuator).unwrap_or_else(|| splat(&self.actuators[actuator].gear))
    }

    /// Mass of a link, its centre of mass, and its inertia.
    #[inline(always)]
    pub fn mass(&self, link: usize) -> (L, [L; 3], [L; 6]) {
        let own = &self.links[link];
        match self.entry::<10>(Quantity::Link, link) {
            Some(all) => {
                let (com, inertia) = &own.zeros;
                let or_zero = |zero: bool, x: L| if zero { L::zero() } else { x };
                let com = std::array::from_fn(|i| or_zero(com[i], all[1 + i]));
                (all[0], com, std::array::from_fn(|i| or_zero(inertia[i], all[4 + i])))
            }
            None => (L::splat(own.mass), splat(&own.com), splat(&own.inertia)),
        }
    }

    /// Gravity compensation of a link, and where it acts.
    #[inline(always)]
    pub fn compensation(&self, link: usize) -> (L, [L; 3]) {
        let own = &self.links[link];
        match self.entry(Quantity::Compensation, link) {
            Some([weight, x, y, z]) => (weight, [x, y, z]),
            None => (L::splat(own.gravcomp), splat(&own.gravcomp_pos)),
        }
    }

    /// Mass of an MJCF body.
    #[inline(always)]
    pub fn body_mass(&self, body: usize) -> L {
        self.entry(Quantity::BodyMass, body).map_or_else(|| L::splat(self.bodies[body].mass), |[x]| x)
    }

    /// Principal moments of inertia of an MJCF body.
    #[inline(always)]
    pub fn body_inertia(&self, body: usize) -> [L; 3] {
        self.entry(Quantity::BodyInertia, body).unwrap_or_else(|| splat(&self.bodies[body].inertia))
    }

    /// Inertia added to a dof.
    #[inline(always)]
    pub fn armature(&self, dof: usize) -> L {
        self.entry(Quantity::Armature, dof).map_or_else(|| L::splat(self.dofs[dof].armature), |[x]| x)
    }

    /// Inverse weight of a limit.
    #[inline(always)]
    pub fn limit_weight(&self, limit: usize) -> L {
        self.entry(Quantity::LimitWeight, limit).map_or_else(|| L::splat(self.limits[limit].invweight), |[x]| x)
    }

    /// Inverse weights of an equality constraint, of rows of position and of orientation.
    #[inline(always)]
    pub fn equality_weight(&self, equality: usize) -> [L; 2] {
        self.entry(Quantity::EqualityWeight, equality).unwrap_or_else(|| splat(&self.equalities[equality].invweight))
    }

    /// Regulariser of a dry friction.
    #[inline(always)]
    pub fn regulariser(&self, loss: usize) -> L {
        self.entry(Quantity::Regulariser, loss).map_or_else(|| L::splat(self.friction_losses[loss].r), |[x]| x)
    }

    /// Mean diagonal of the inertia matrix.
    #[inline(always)]
    pub fn mean_inertia(&self) -> L {
        self.entry(Quantity::MeanInertia, 0).map_or_else(|| L::splat(self.model.mean_inertia), |[x]| x)
    }

    /// Position, orientation and sizes of a geom, if they are not to be folded.
    #[inline(always)]
    pub fn geom(&self, geom: usize) -> Option<[L; 15]> {
        self.entry(Quantity::Geom, geom)
    }

    /// Distance within which contacts of a pair are listed.
    #[inline(always)]
    pub fn include(&self, pair: usize) -> L {
        self.entry(Quantity::Include, pair).map_or_else(|| L::splat(self.pairs[pair].include), |[x]| x)
    }

    /// What contact rows of a pair depend on: the worlds' own numbers, or those that they share.
    #[inline(always)]
    pub fn law(&self, pair: usize) -> [L; Pair::<f64>::LAW] {
        let own = self.entry(Quantity::Grip, pair).or_else(|| self.entry(Quantity::Law, pair));
        own.unwrap_or_else(|| splat(&self.pairs[pair].law()))
    }

    /// Distance below which contacts of a pair act.
    #[inline(always)]
    pub fn margin(&self, pair: usize) -> L {
        let lanes = self.varied.map_or(&[][..], |varied| varied.lanes(Quantity::Grip));
        lanes.get(Pair::<f64>::LAW * pair).copied().unwrap_or_else(|| L::splat(self.pairs[pair].margin))
    }

    /// Range, margin and impedance of a limit.
    #[inline(always)]
    pub fn limit(&self, limit: usize) -> ([L; 2], L, Impedance<L>) {
        let own = &self.limits[limit];
        let [low, high, margin, impedance @ ..] =
            self.entry(Quantity::Limit, limit).unwrap_or_else(|| splat(&own.numbers()));
        ([low, high], margin, own.impedance.with(impedance))
    }

    /// Largest force of a dry friction.
    #[inline(always)]
    pub fn loss(&self, loss: usize) -> L {
        self.entry(Quantity::Loss, loss).map_or_else(|| L::splat(self.friction_losses[loss].bound), |[x]| x)
    }

    /// Where a joint's spring rests that does not yield.
    #[inline(always)]
    pub fn rest(&self, joint: usize) -> [L; 7] {
        self.entry(Quantity::Rest, joint).unwrap_or_else(|| splat(&self.joints[joint].qpos_spring))
    }

    /// First coefficients of a tendon's stiffness and damping, and the lengths between which its spring rests that does not yield.
    #[inline(always)]
    fn tension(&self, tendon: usize) -> [L; 4] {
        self.entry(Quantity::Tension, tendon).unwrap_or_else(|| splat(&self.tendons[tendon].tension()))
    }

    /// Coefficients of a tendon's spring.
    #[inline(always)]
    pub fn tendon_stiffness(&self, tendon: usize) -> [L; 3] {
        let [_, b, c] = splat(&self.tendons[tendon].stiffness);
        [self.tension(tendon)[0], b, c]
    }

    /// Coefficients of a tendon's damper.
    #[inline(always)]
    pub fn tendon_damping(&self, tendon: usize) -> [L; 3] {
        let [_, b, c] = splat(&self.tendons[tendon].damping);
        [self.tension(tendon)[1], b, c]
    }

    /// The lengths between which a tendon's spring rests that does not yield.
    #[inline(always)]
    pub fn tendon_rest(&self, tendon: usize) -> [L; 2] {
        let [_, _, low, high] = self.tension(tendon);
        [low, high]
    }

    /// Bounds of an actuator's force.
    #[inline(always)]
    pub fn force_range(&self, actuator: usize) -> [L; 2] {
        self.entry(Quantity::ForceRange, actuator).unwrap_or_else(|| splat(&self.actuators[actuator].force_range))
    }

    /// Bounds of a control.
    #[inline(always)]
    pub fn control_range(&self, control: usize) -> [L; 2] {
        self.entry(Quantity::ControlRange, control).unwrap_or_else(|| splat(&self.controls[control].range))
    }

    /// What an actuator's activation follows its control by.
    #[inline(always)]
    pub fn times(&self, actuator: usize) -> [L; 3] {
        self.entry(Quantity::Times, actuator).unwrap_or_else(|| splat(&self.actuators[actuator].times))
    }

    /// A zero.
    #[inline(always)]
    pub fn zero(&self) -> L {
        self.entry(Quantity::Zero, 0).map_or_else(L::zero, |[x]| x)
    }
}
