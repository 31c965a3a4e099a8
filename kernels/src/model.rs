//! The compiled model as the kernels read it: immutable tables, one entry per element, generic over the real type.
//!
//! Kernels move *links*: bodies that have joints. A body without joints is carried by the nearest ancestor that has
//! them, or stands still; its mass, geoms and sites are part of that link. Every link belongs to one *tree*, the set of
//! links whose motion can be coupled through the inertia matrix. Positions and spatial vectors of a tree's links are
//! relative to the *origin* of the tree, the position of its first link's frame: numbers stay small however far from the
//! world's origin the tree is.

use crate::lane::Real;
use crate::options::Options;

/// No such element.
pub const NONE: u32 = u32::MAX;

/// Conversion of a table to another real type.
pub trait Cast<U> {
    /// The converted type.
    type Out;
    /// Rounds every real number of `self` to `U`.
    fn cast(&self) -> Self::Out;
}

impl<U: Real> Cast<U> for f64 {
    type Out = U;
    fn cast(&self) -> U {
        U::from_f64(*self)
    }
}

impl<U, A: Cast<U>, const N: usize> Cast<U> for [A; N] {
    type Out = [A::Out; N];
    fn cast(&self) -> Self::Out {
        std::array::from_fn(|i| self[i].cast())
    }
}

impl<U, A: Cast<U>> Cast<U> for Vec<A> {
    type Out = Vec<A::Out>;
    fn cast(&self) -> Self::Out {
        self.iter().map(Cast::cast).collect()
    }
}

/// Declares a table entry: plain fields first, then, after `real`, those that depend on the real type.
macro_rules! table {
    ($(#[$doc:meta])* pub struct $name:ident {
        $($(#[$pdoc:meta])* pub $plain:ident: $ptype:ty,)*
        real: $($(#[$rdoc:meta])* pub $real:ident: $rtype:ty,)*
    } $t:ident) => {
        $(#[$doc])*
        #[derive(Clone, Debug)]
        pub struct $name<$t> {
            $($(#[$pdoc])* pub $plain: $ptype,)*
            $($(#[$rdoc])* pub $real: $rtype,)*
        }
        impl<U: Real> Cast<U> for $name<f64> {
            type Out = $name<U>;
            fn cast(&self) -> $name<U> {
                $name { $($plain: self.$plain.clone(),)* $($real: self.$real.cast(),)* }
            }
        }
    };
}

/// Most entries for which a list is given room in advance. Models in which thousands of pairs could touch at once, and
/// never do, would otherwise take memory for all of them; their lists grow when they must.
const RESERVE: usize = 1 << 14;

/// Room for the lists of a block: contacts, constraint rows and Jacobians that the model can have at once, within reason.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capacity {
    /// Contacts.
    pub contacts: usize,
    /// Rows on joints.
    pub dof_rows: usize,
    /// Contact components.
    pub components: usize,
    /// Entries of stored Jacobians.
    pub jacobian: usize,
}

/// A run of consecutive indices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Span {
    /// First index.
    pub start: u32,
    /// Number of indices.
    pub len: u32,
}

impl Span {
    /// The indices.
    #[inline(always)]
    pub fn range(self) -> std::ops::Range<usize> {
        self.start as usize..(self.start + self.len) as usize
    }
}

/// Numbers of elements, as MuJoCo counts them, and the kernels' own.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Sizes {
    /// Positions.
    pub nq: usize,
    /// Degrees of freedom.
    pub nv: usize,
    /// Controls.
    pub nu: usize,
    /// Activations.
    pub na: usize,
    /// Bodies, the world included.
    pub nbody: usize,
    /// Joints.
    pub njnt: usize,
    /// Geoms.
    pub ngeom: usize,
    /// Sites.
    pub nsite: usize,
    /// Mocap bodies.
    pub nmocap: usize,
    /// Links: bodies with joints.
    pub nlink: usize,
    /// Trees.
    pub ntree: usize,
    /// Candidate pairs of geoms.
    pub npair: usize,
    /// Geoms that take part in some pair.
    pub ncollider: usize,
    /// Contact slots: the sum of the pairs' largest numbers of contacts.
    pub nslot: usize,
    /// Entries of the inertia matrix's storage (see [`Rows`]).
    pub nm: usize,
}

table! {
    /// A body with joints, with everything that is fixed to it.
    pub struct Link {
        /// Link that carries it, or [`NONE`]: the world or a body that stands still.
        pub parent: u32,
        /// Tree.
        pub tree: u32,
        /// MJCF body that has the joints.
        pub body: u32,
        /// Its joints.
        pub joints: Span,
        /// Its degrees of freedom.
        pub dofs: Span,
        /// Whether `rot` is the identity.
        pub aligned: bool,
        /// Whether `inertia` is diagonal.
        pub diagonal: bool,
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
        /// Whether any damping is not zero (the joint's or reflected from actuators).
        pub damped: bool,
        /// Whether `damping[1..]` are zero.
        pub damping_linear: bool,
        real:
        /// Inertia added to the diagonal, actuators' reflected armature included.
        pub armature: T,
        /// Coefficients of the damper force, actuators' reflected damping included.
        pub damping: [T; 3],
    } T
}

/// The shape of a geom. The order is MuJoCo's, by which the geoms of a pair are sorted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Shape {
    /// Infinite plane, normal along z.
    Plane,
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
}

table! {
    /// A geom that takes part in some pair.
    pub struct Geom {
        /// MJCF geom.
        pub id: u32,
        /// Shape.
        pub shape: Shape,
        /// Link that carries it, or [`NONE`]: it stands still.
        pub link: u32,
        /// Whether `rot` is the identity.
        pub aligned: bool,
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

table! {
    /// A pair of geoms that may touch.
    pub struct Pair {
        /// First geom, index into [`Model::geoms`]; its shape sorts first.
        pub geom1: u32,
        /// Second geom.
        pub geom2: u32,
        /// Link of the first geom, or [`NONE`].
        pub link1: u32,
        /// Link of the second geom, or [`NONE`].
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
        /// Sum of the bodies' rotational inverse weights.
        pub invweight_rot: T,
    } T
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
    /// A joint limit.
    pub struct Limit {
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
        /// Â: inverse weight of the joint's dofs.
        pub invweight: T,
    } T
}

table! {
    /// Dry friction of a degree of freedom.
    pub struct FrictionLoss {
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
    } T
}

/// What an actuator acts on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transmission {
    /// A slide or hinge: length is gear·position.
    Scalar,
    /// A ball joint; gear in the child's frame.
    Ball,
    /// A ball joint; gear in the parent's frame.
    BallInParent,
    /// A free joint; rotational gear in the child's frame.
    Free,
    /// A free joint; rotational gear in the world's frame.
    FreeInParent,
}

table! {
    /// An actuator: force = gain·control + bias.
    pub struct Actuator {
        /// What it acts on.
        pub transmission: Transmission,
        /// Joint.
        pub joint: u32,
        /// First position of the joint.
        pub qpos: u32,
        /// First degree of freedom of the joint.
        pub dof: u32,
        /// Whether the gain depends on length or velocity.
        pub gain_affine: bool,
        /// Whether there is a bias.
        pub bias_affine: bool,
        /// Whether the control is clamped.
        pub ctrl_limited: bool,
        /// Whether the force is clamped.
        pub force_limited: bool,
        /// Whether its group is disabled: no force.
        pub disabled: bool,
        real:
        /// Gear.
        pub gear: [T; 6],
        /// Gain: constant, per length, per velocity.
        pub gain: [T; 3],
        /// Bias: constant, per length, per velocity.
        pub bias: [T; 3],
        /// Bounds of the control.
        pub ctrl_range: [T; 2],
        /// Bounds of the force.
        pub force_range: [T; 2],
    } T
}

/// Storage and sparsity of symmetric nv×nv matrices, lower triangle by rows (a *skyline*): row `i` holds columns
/// `first..=i` without a gap, from `start` on. The gaps inside a row are exact zeros, skipped by the runs of a
/// [`Pattern`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rows {
    /// Offset of column `first[i]` of row `i`.
    pub start: Vec<u32>,
    /// First stored column of row `i`: the lowest dof that can ever be coupled to `i`.
    pub first: Vec<u32>,
}

impl Rows {
    /// Offset of entry (i, j), j ≤ i and j ≥ first[i].
    #[inline(always)]
    pub fn at(&self, i: usize, j: usize) -> usize {
        self.start[i] as usize + j - self.first[i] as usize
    }

    /// The storage of row `i`, from its first column to the diagonal.
    #[inline(always)]
    pub fn row(&self, i: usize) -> std::ops::Range<usize> {
        let start = self.start[i] as usize;
        start..start + i + 1 - self.first[i] as usize
    }

    /// Offset of the diagonal entry of row `i`.
    #[inline(always)]
    pub fn diagonal(&self, i: usize) -> usize {
        self.at(i, i)
    }
}

/// Which entries below the diagonal are not structurally zero: for every row, ascending runs of columns, and for every
/// column its rows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Pattern {
    /// Runs of all rows, as columns.
    pub runs: Vec<Span>,
    /// Runs of row `i`.
    pub rows: Vec<Span>,
    /// Rows of all columns.
    below: Vec<u32>,
    /// Rows of column `i`.
    columns: Vec<Span>,
}

impl Pattern {
    /// The pattern with the given runs of rows.
    pub fn new(runs: Vec<Span>, rows: Vec<Span>) -> Self {
        let mut pattern = Pattern { runs, rows, ..Pattern::default() };
        pattern.find_columns();
        pattern
    }

    /// An empty pattern with room for `runs` runs and `entries` entries of an `n`×`n` matrix.
    pub fn with_capacity(n: usize, runs: usize, entries: usize) -> Self {
        Pattern {
            runs: Vec::with_capacity(runs),
            rows: Vec::with_capacity(n),
            below: Vec::with_capacity(entries),
            columns: Vec::with_capacity(n),
        }
    }

    /// Finds the columns after the rows have changed.
    pub fn find_columns(&mut self) {
        let Pattern { runs, rows, below, columns } = self;
        columns.clear();
        columns.resize(rows.len(), Span::default());
        let entries = |row: &Span| runs[row.range()].iter().flat_map(|run| run.range());
        for j in rows.iter().flat_map(entries) {
            columns[j].len += 1;
        }
        let mut offset = 0;
        for column in columns.iter_mut() {
            let len = std::mem::take(&mut column.len);
            column.start = offset;
            offset += len;
        }
        below.clear();
        below.resize(offset as usize, 0);
        for (i, row) in rows.iter().enumerate().rev() {
            for j in entries(row) {
                below[columns[j].range().end] = i as u32;
                columns[j].len += 1;
            }
        }
    }

    /// The rows below the diagonal of column `i`, from the last to the first.
    #[inline(always)]
    pub fn column(&self, i: usize) -> &[u32] {
        &self.below[self.columns[i].range()]
    }

    /// The runs of row `i`.
    #[inline(always)]
    pub fn row(&self, i: usize) -> &[Span] {
        &self.runs[self.rows[i].range()]
    }
}

/// What the model contains, so that a step runs only what is needed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Features {
    /// Some joint has a spring and springs are on.
    pub springs: bool,
    /// Some dof has a damper and dampers are on.
    pub dampers: bool,
    /// Some body has gravity compensation, gravity is on and not zero, and passive forces are on.
    pub gravcomp: bool,
    /// There are actuators and actuation is on.
    pub actuation: bool,
    /// Euler integrates dampers implicitly: some dof is damped, and the flags `damper` and `eulerdamp` are on.
    pub implicit_damping: bool,
}

/// A compiled model, over real type `T`. Made by the compiler of the `lanesim` package; kernels trust its indices.
#[derive(Clone, Debug)]
pub struct Model<T> {
    /// Numbers of elements.
    pub sizes: Sizes,
    /// Options.
    pub options: Options,
    /// Features.
    pub features: Features,
    /// Bodies.
    pub bodies: Vec<Body<T>>,
    /// Links, parents first.
    pub links: Vec<Link<T>>,
    /// Joints, in MJCF order.
    pub joints: Vec<Joint<T>>,
    /// Degrees of freedom.
    pub dofs: Vec<Dof<T>>,
    /// Trees: the first link of each. Links of a tree need not be consecutive.
    pub tree_root: Vec<u32>,
    /// Geoms that take part in pairs.
    pub geoms: Vec<Geom<T>>,
    /// Pairs of geoms.
    pub pairs: Vec<Pair<T>>,
    /// Degrees of freedom of pairs.
    pub pair_dofs: Vec<PairDof>,
    /// Joint limits, in the order of joints; empty if the flag `limit` or `constraint` is off.
    pub limits: Vec<Limit<T>>,
    /// Dry friction, in the order of dofs; empty if the flag `frictionloss` or `constraint` is off.
    pub friction_losses: Vec<FrictionLoss<T>>,
    /// Actuators.
    pub actuators: Vec<Actuator<T>>,
    /// Storage of the inertia matrix and of the solver's Hessian.
    pub rows: Rows,
    /// Sparsity of the inertia matrix: row `i` has the ancestors of dof `i`.
    pub tree_pattern: Pattern,
    /// Σ over dofs of the inertia matrix's diagonal in the reference configuration divided by nv (`stat.meaninertia`).
    pub mean_inertia: T,
    /// Positions in the reference configuration, length nq.
    pub qpos0: Vec<T>,
    /// Gravity; zero when its flag is off.
    pub gravity: [T; 3],
    /// Potential energy of the bodies that stand still.
    pub potential_still: T,
}

impl Features {
    /// Whether there can be passive forces.
    pub fn passive(&self) -> bool {
        self.springs || self.dampers || self.gravcomp
    }
}

impl<T> Model<T> {
    /// Whether there can be constraint rows.
    pub fn constrained(&self) -> bool {
        !self.pairs.is_empty() || !self.limits.is_empty() || !self.friction_losses.is_empty()
    }

    /// Room for a block's lists.
    pub fn capacity(&self) -> Capacity {
        let (mut components, mut jacobian) = (0_usize, 0_usize);
        for pair in &self.pairs {
            let rows = (pair.slots.len * pair.condim) as usize;
            components += rows;
            jacobian = jacobian.saturating_add(rows * pair.dofs.len as usize);
        }
        Capacity {
            contacts: self.sizes.nslot.min(RESERVE),
            dof_rows: self.friction_losses.len() + 2 * self.limits.len(),
            components: components.min(3 * RESERVE),
            jacobian: jacobian.min(16 * RESERVE),
        }
    }
}

impl<U: Real> Cast<U> for Model<f64> {
    type Out = Model<U>;
    fn cast(&self) -> Model<U> {
        Model {
            sizes: self.sizes.clone(),
            options: self.options.clone(),
            features: self.features.clone(),
            bodies: self.bodies.cast(),
            links: self.links.cast(),
            joints: self.joints.cast(),
            dofs: self.dofs.cast(),
            tree_root: self.tree_root.clone(),
            geoms: self.geoms.cast(),
            pairs: self.pairs.cast(),
            pair_dofs: self.pair_dofs.clone(),
            limits: self.limits.cast(),
            friction_losses: self.friction_losses.cast(),
            actuators: self.actuators.cast(),
            rows: self.rows.clone(),
            tree_pattern: self.tree_pattern.clone(),
            mean_inertia: self.mean_inertia.cast(),
            qpos0: self.qpos0.cast(),
            gravity: self.gravity.cast(),
            potential_still: self.potential_still.cast(),
        }
    }
}
