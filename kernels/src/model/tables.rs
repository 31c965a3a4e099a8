//! One table entry per element of the model.

use super::cast::{Cast, Representable, table};
use super::{NONE, Span};
use crate::lane::{Lane, Real};

table! {
    /// A body with joints or a mocap body, with everything that is fixed to it.
    pub struct Link {
        /// Link that carries it, or [`NONE`]: the world or a body that stands still.
        pub parent: u32,
        /// Tree.
        pub tree: u32,
        /// MJCF body that has the joints.
        pub body: u32,
        /// Mocap body that it is, without joints, or [`NONE`].
        pub mocap: u32,
        /// Its joints.
        pub joints: Span,
        /// Its degrees of freedom.
        pub dofs: Span,
        /// Whether `rot` is the identity.
        pub aligned: bool,
        /// Which components of `com`, and which of `inertia`, are zero, in all worlds where masses and inertias vary.
        pub zeros: ([bool; 3], [bool; 6]),
        real:
        /// Position of its frame before its joints act, in the parent link's frame, or in the world if it has none.
        pub pos: [T; 3],
        /// Orientation of its frame before its joints act, row-major, likewise.
        pub rot: [T; 9],
        /// The same as a quaternion.
        pub quat: [T; 4],
        /// Mass, of all that it carries.
        pub mass: T,
        /// Centre of mass in the link's frame.
        pub com: [T; 3],
        /// Inertia about the centre of mass in the link's axes: xx, yy, zz, xy, xz, yz.
        pub inertia: [T; 6],
        /// Gravity compensation: Σ mass·gravcomp over the bodies that it carries, and the mean position weighted by it.
        pub gravcomp: T,
        /// Where gravity compensation acts, in the link's frame.
        pub gravcomp_pos: [T; 3],
    } T
}

/// The kind of a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Position and quaternion; six degrees of freedom.
    Free,
    /// Quaternion; three degrees of freedom.
    Ball,
    /// Translation.
    Slide,
    /// Rotation about an axis.
    Hinge,
}

/// Direction of a joint axis in the link's frame, when it is a coordinate axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxisKind {
    /// Along +x, +y or +z (0, 1, 2).
    Plus(u8),
    /// Along -x, -y or -z.
    Minus(u8),
    /// Any other.
    General,
}

table! {
    /// A joint.
    pub struct Joint {
        /// Kind.
        pub kind: JointKind,
        /// Link that it moves.
        pub link: u32,
        /// First position.
        pub qpos: u32,
        /// First degree of freedom.
        pub dof: u32,
        /// Special direction of the axis.
        pub axis_kind: AxisKind,
        /// Whether `pos` is not zero.
        pub anchored: bool,
        /// Whether any stiffness is not zero.
        pub spring: bool,
        /// Where its spring rests among [`State::plastic`](crate::state::State::plastic), if it yields, or [`NONE`].
        pub plastic: u32,
        /// Whether gravity compensation of this joint's dofs counts as an actuator force.
        pub actuator_gravcomp: bool,
        /// Whether the total actuator force is bounded.
        pub force_limited: bool,
        real:
        /// Anchor in the link's frame.
        pub pos: [T; 3],
        /// Unit axis in the link's frame.
        pub axis: [T; 3],
        /// Position in the defining configuration (slide, hinge).
        pub qpos0: T,
        /// Position at which the spring rests: scalar in [0]; ball: quaternion in [0..4]; free: 3 + 4.
        pub qpos_spring: [T; 7],
        /// Coefficients of the spring force.
        pub stiffness: [T; 3],
        /// How far its spring is stretched before it yields.
        pub springyield: T,
        /// Bounds on the total actuator force.
        pub force_range: [T; 2],
    } T
}

/// What a degree of freedom does to its link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DofKind {
    /// Translation of a free joint along world axis 0, 1 or 2.
    FreeTranslation(u8),
    /// Rotation of a free joint about the link's axis 0, 1 or 2, through the tree's origin.
    FreeRotation(u8),
    /// Rotation of a ball joint about the link's axis 0, 1 or 2.
    BallRotation(u8),
    /// Slide.
    Slide,
    /// Hinge.
    Hinge,
}

table! {
    /// A degree of freedom.
    pub struct Dof {
        /// Kind.
        pub kind: DofKind,
        /// Link.
        pub link: u32,
        /// Joint.
        pub joint: u32,
        /// Next degree of freedom towards the root, or [`NONE`].
        pub parent: u32,
        /// First degree of freedom of the tree's free joint, or [`NONE`].
        pub free_base: u32,
        /// Whether its row of the inertia matrix is the diagonal alone, by what its body is.
        pub simple: bool,
        /// Whether any damping is not zero (the joint's or reflected from actuators).
        pub damped: bool,
        /// Whether `damping[1..]` are zero.
        pub damping_linear: bool,
        real:
        /// Inertia added to the diagonal, actuators' reflected armature included.
        pub armature: T,
        /// Coefficients of the damper force, actuators' reflected damping included.
        pub damping: [T; 3],
        /// Inverse weight in the reference configuration, 1/kg, 1/(kg m²): what midpoint steps fit springs and dampers to.
        pub invweight: T,
    } T
}

/// A tree, as far as its sleep goes.
#[derive(Clone, Copy, Debug)]
pub struct Sleeper {
    /// Whether it may sleep.
    pub allowed: bool,
    /// Its positions.
    pub qpos: Span,
    /// Its degrees of freedom.
    pub dofs: Span,
}

/// The shape of a geom. The order is MuJoCo's, by which the geoms of a pair are sorted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Shape {
    /// Infinite plane, normal along z.
    Plane,
    /// Height field: half lengths along x and y, and a height that displays.
    HeightField,
    /// Sphere: radius.
    Sphere,
    /// Capsule along z: radius, half length.
    Capsule,
    /// Ellipsoid: three semi-axes.
    Ellipsoid,
    /// Cylinder along z: radius, half length.
    Cylinder,
    /// Box: three half sizes.
    Box,
    /// Convex hull of a mesh: half sizes of a box about the origin that holds it.
    Mesh,
}

table! {
    /// A geom that takes part in some pair.
    pub struct Geom {
        /// MJCF geom.
        pub id: u32,
        /// MJCF body that it belongs to.
        pub body: u32,
        /// Shape.
        pub shape: Shape,
        /// Link that carries it, or [`NONE`]: it stands still.
        pub link: u32,
        /// Whether `rot` is the identity.
        pub aligned: bool,
        /// Of a mesh, its place among the hulls; of a height field, among those; else [`NONE`].
        pub hull: u32,
        real:
        /// Position in the link's frame, or in the world.
        pub pos: [T; 3],
        /// Orientation, row-major, likewise.
        pub rot: [T; 9],
        /// Sizes.
        pub size: [T; 3],
        /// Radius of the bounding sphere about `pos`; 0 for planes.
        pub rbound: T,
    } T
}

table! {
    /// Constraint impedance and reference, from `solref` and `solimp`: `a_ref = -b v - k d(r) r`, with impedance d
    /// rising from `dmin` to `dmax` over `width`: with x = |r|/width, d = dmin + y (dmax - dmin), y = `low` xᵖ up to
    /// `midpoint` and 1 - `high` (1 - x)ᵖ above.
    pub struct Impedance {
        /// Whether the impedance is the constant (dmin + dmax)/2: equal ends or no width.
        pub flat: bool,
        /// Power p if it is 1 or 2; 0: any other.
        pub small_power: u8,
        real:
        /// Stiffness k before the impedance factor.
        pub k: T,
        /// Damping b.
        pub b: T,
        /// Impedance at zero violation.
        pub dmin: T,
        /// Impedance at `width`.
        pub dmax: T,
        /// 1 / width; 0 if flat.
        pub inverse_width: T,
        /// Point of inflection, as a fraction of `width`.
        pub midpoint: T,
        /// Power of the two arcs.
        pub power: T,
        /// midpoint^(1 - p)
        pub low: T,
        /// (1 - midpoint)^(1 - p)
        pub high: T,
    } T
}

impl<T: Copy> Impedance<T> {
    /// Its numbers.
    #[inline(always)]
    pub fn numbers(&self) -> [T; 9] {
        let Impedance { k, b, dmin, dmax, inverse_width, midpoint, power, low, high, .. } = *self;
        [k, b, dmin, dmax, inverse_width, midpoint, power, low, high]
    }
}

impl<T: Real> Impedance<T> {
    /// The same in all lanes.
    #[inline(always)]
    pub fn lanes<L: Lane<Real = T>>(&self) -> Impedance<L> {
        self.with(self.numbers().map(L::splat))
    }

    /// One of the same form with other numbers.
    #[inline(always)]
    pub fn with<L: Lane<Real = T>>(
        &self,
        [k, b, dmin, dmax, inverse_width, midpoint, power, low, high]: [L; 9],
    ) -> Impedance<L> {
        let Impedance { flat, small_power, .. } = *self;
        Impedance { flat, small_power, k, b, dmin, dmax, inverse_width, midpoint, power, low, high }
    }
}

table! {
    /// A pair of geoms that may touch.
    pub struct Pair {
        /// First geom, index into [`Model::geoms`]; its shape sorts first.
        pub geom1: u32,
        /// Second geom.
        pub geom2: u32,
        /// Link of the first geom, or [`NONE`] if joints do not move it: it may be a mocap body's.
        pub link1: u32,
        /// Link of the second geom, likewise.
        pub link2: u32,
        /// Dimension of its contacts: 1, 3, 4 or 6.
        pub condim: u32,
        /// Its contact slots.
        pub slots: Span,
        /// For a pair of two links: degrees of freedom that move one of them and not the other, in
        /// [`Model::pair_dofs`], ascending. Empty for a pair with a geom that stands still.
        pub dofs: Span,
        /// Whether those dofs lie on different branches, so that the pair's contacts couple dofs that the inertia
        /// matrix does not.
        pub cross: bool,
        /// What moves.
        pub sides: Sides,
        real:
        /// Distance below which contacts act.
        pub margin: T,
        /// Distance below which contacts are listed: margin + gap.
        pub include: T,
        /// Friction: two tangential, torsional, two rolling.
        pub friction: [T; 5],
        /// Impedance of the normal row, and of every row of a pyramid.
        pub impedance: Impedance<T>,
        /// Damping of the friction rows of an elliptic contact.
        pub friction_b: T,
        /// Sum of the bodies' translational inverse weights: Â of the normal.
        pub invweight: T,
    } T
}

impl<T: Copy> Geom<T> {
    /// Position, orientation, sizes.
    #[inline(always)]
    pub fn numbers(&self) -> [T; 15] {
        let ([x, y, z], [a, b, c, d, e, f, g, h, i], [s, t, u]) = (self.pos, self.rot, self.size);
        [x, y, z, a, b, c, d, e, f, g, h, i, s, t, u]
    }
}

impl<T: Copy> Pair<T> {
    /// Number of those numbers.
    pub const LAW: usize = 17;

    /// The numbers that rows of its contacts depend on.
    #[inline(always)]
    pub fn law(&self) -> [T; 17] {
        let Pair { margin, friction: [f1, f2, f3, f4, f5], friction_b, invweight, .. } = *self;
        let [k, b, dmin, dmax, inverse_width, midpoint, power, low, high] = self.impedance.numbers();
        [margin, invweight, friction_b, f1, f2, f3, f4, f5, k, b, dmin, dmax, inverse_width, midpoint, power, low, high]
    }
}

impl<T> Link<T> {
    /// The last of its degrees of freedom, or [`NONE`].
    #[inline(always)]
    pub fn last_dof(&self) -> u32 {
        if self.dofs.len == 0 { NONE } else { self.dofs.start + self.dofs.len - 1 }
    }
}

impl<T> Pair<T> {
    /// Its geoms.
    #[inline(always)]
    pub fn geoms(&self) -> [usize; 2] {
        [self.geom1 as usize, self.geom2 as usize]
    }

    /// Whether the geoms cannot move against each other: the contacts are reported and have no rows. Only MJCF's `pair` names
    /// such geoms.
    pub fn rigid(&self) -> bool {
        self.link1 == self.link2
    }
}

/// What moves at a contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Sides {
    /// One side stands still.
    One,
    /// Both sides are links of one tree.
    Two,
    /// The sides are of different trees.
    Apart,
}

/// One degree of freedom of a pair's relative Jacobian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PairDof {
    /// Degree of freedom.
    pub dof: u32,
    /// Whether it moves the second link (its column counts as positive) or the first (negative).
    pub second: bool,
}

table! {
    /// A limit of a joint, or of a tendon.
    pub struct Limit {
        /// Tendon, or [`NONE`]; then `joint`, `dof` and `qpos` are 0.
        pub tendon: u32,
        /// Joint.
        pub joint: u32,
        /// First degree of freedom.
        pub dof: u32,
        /// First position.
        pub qpos: u32,
        /// Whether the joint is a ball; then `range[1]` bounds its angle.
        pub ball: bool,
        real:
        /// Lower and upper limit.
        pub range: [T; 2],
        /// Distance below which the limit acts.
        pub margin: T,
        /// Impedance.
        pub impedance: Impedance<T>,
        /// Â: inverse weight of the joint's dofs, or of the tendon.
        pub invweight: T,
    } T
}

impl<T: Copy> Limit<T> {
    /// Number of those numbers.
    pub const NUMBERS: usize = 12;

    /// Range, margin, impedance.
    #[inline(always)]
    pub fn numbers(&self) -> [T; 12] {
        let ([x0, x1], [k, b, dmin, dmax, inverse_width, midpoint, power, low, high]) =
            (self.range, self.impedance.numbers());
        [x0, x1, self.margin, k, b, dmin, dmax, inverse_width, midpoint, power, low, high]
    }
}

/// What an equality constraint holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EqualityKind {
    /// A point of one body on a point of another: three rows.
    Connect,
    /// A frame of one body on a frame of another: three rows of position, three of orientation.
    Weld,
    /// The position of a joint as a polynomial of that of another, or at a value: one row.
    Joint,
    /// The same of the lengths of tendons.
    Tendon,
}

table! {
    /// An equality constraint.
    pub struct Equality {
        /// Its number in the file.
        pub id: u32,
        /// What it holds.
        pub kind: EqualityKind,
        /// Links of its two sides, or [`NONE`]: it stands still (connect, weld).
        pub links: [u32; 2],
        /// MJCF bodies of its two sides (connect, weld).
        pub bodies: [u32; 2],
        /// Positions of its joints; [`NONE`] for a second that there is not.
        pub qpos: [u32; 2],
        /// Its tendons, likewise.
        pub tendons: [u32; 2],
        /// Degrees of freedom that move one of its sides against the other, in [`Model::equality_dofs`], ascending.
        pub dofs: Span,
        /// Whether it couples dofs that the inertia matrix does not.
        pub cross: bool,
        /// Its first row among those of all equality constraints.
        pub row: u32,
        /// The first entry of its Jacobian: dof by dof, the rows of each.
        pub jacobian: u32,
        real:
        /// The point on each side, in the link's frame, or in the world.
        pub pos: [[T; 3]; 2],
        /// The frame on each side, likewise (weld).
        pub quat: [[T; 4]; 2],
        /// Length that stands for a radian (weld).
        pub torquescale: T,
        /// Coefficients of the polynomial, constant first (joint, tendon).
        pub polynomial: [T; 5],
        /// Positions of the joints, or lengths of the tendons, in the reference configuration, from which the polynomial counts.
        pub reference: [T; 2],
        /// Impedance.
        pub impedance: Impedance<T>,
        /// Â of rows of position and of orientation.
        pub invweight: [T; 2],
    } T
}

impl<T> Equality<T> {
    /// Number of rows.
    #[inline(always)]
    pub fn dim(&self) -> usize {
        match self.kind {
            EqualityKind::Connect => 3,
            EqualityKind::Weld => 6,
            EqualityKind::Joint | EqualityKind::Tendon => 1,
        }
    }

    /// Its rows among those of all equality constraints.
    #[inline(always)]
    pub fn rows(&self) -> std::ops::Range<usize> {
        self.row as usize..self.row as usize + self.dim()
    }
}

/// One degree of freedom of an equality constraint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EqualityDof {
    /// Degree of freedom.
    pub dof: u32,
    /// Which of the sides it moves.
    pub moves: [bool; 2],
}

table! {
    /// Dry friction of a degree of freedom, or of a tendon.
    pub struct FrictionLoss {
        /// Tendon, or [`NONE`]; then `dof` is 0.
        pub tendon: u32,
        /// Degree of freedom.
        pub dof: u32,
        real:
        /// Largest force.
        pub bound: T,
        /// Regulariser R.
        pub r: T,
        /// Damping of the reference acceleration.
        pub b: T,
    } T
}

table! {
    /// An MJCF body, as a place where forces from outside act.
    pub struct Body {
        /// Link that carries it, or [`NONE`].
        pub link: u32,
        real:
        /// Centre of mass in the link's frame.
        pub com: [T; 3],
        /// Orientation of its principal axes in the link's frame, row-major.
        pub rot: [T; 9],
        /// Mass.
        pub mass: T,
        /// Principal moments of inertia.
        pub inertia: [T; 3],
    } T
}

table! {
    /// A body in a medium, with the box of the same inertia.
    pub struct Fluid {
        /// Link that carries it.
        pub link: u32,
        real:
        /// Centre of mass in the link's frame.
        pub pos: [T; 3],
        /// Orientation of the inertia's axes in the link's frame, row-major.
        pub rot: [T; 9],
        /// Resistance that grows with the speed: torque by angular velocity, force by velocity.
        pub linear: [T; 2],
        /// Resistance that grows with the square of the speed: torque about each axis, force along each.
        pub square: [[T; 3]; 2],
    } T
}

table! {
    /// A geom whose surface moves.
    pub struct Belt {
        /// Its place among [`Model::geoms`](super::Model::geoms).
        pub geom: u32,
        real:
        /// Velocity and angular velocity about its middle, its axes.
        pub velocity: [T; 6],
    } T
}

table! {
    /// A geom in a medium, taken for an ellipsoid.
    pub struct Ellipsoid {
        /// Link that carries it.
        pub link: u32,
        real:
        /// Its middle in the link's frame.
        pub pos: [T; 3],
        /// Orientation of its axes in the link's frame, row-major.
        pub rot: [T; 9],
        /// By axis, the square of the product of the other two semiaxes, over the largest.
        pub areas: [T; 3],
        /// Mass of what it carries along by axis, and moment of inertia of what it spins with it.
        pub carried: [T; 3],
        /// That moment.
        pub spun: [T; 3],
        /// What about each axis makes resistance to turning grow with the angular velocity.
        pub stirred: [T; 3],
        /// Resistance that grows with the speed: torque by angular velocity, force by velocity.
        pub linear: [T; 2],
        /// What drag grows by with the speed: with the shadow's area over that of the largest shadow, and by itself.
        pub blunt: T,
        /// The latter.
        pub slender: T,
        /// Lift of Kutta.
        pub kutta: T,
        /// Lift of Magnus.
        pub magnus: T,
    } T
}
