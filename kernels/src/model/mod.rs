//! The compiled model as the kernels read it: immutable tables, one entry per element, generic over the real type.
//!
//! Kernels move *links*: bodies that have joints. A body without joints is carried by the nearest ancestor that has
//! them, or stands still; its mass, geoms and sites are part of that link. Every link belongs to one *tree*, the set of
//! links whose motion can be coupled through the inertia matrix. Positions and spatial vectors of a tree's links are
//! relative to the *origin* of the tree, the position of its first link's frame: numbers stay small however far from the
//! world's origin the tree is.

mod actuators;
mod cast;
mod heights;
mod hull;
mod pattern;
mod rings;
mod sensors;
mod strips;
mod tables;
mod tendon;
mod tiles;
mod varied;

use crate::math::low;

pub use actuators::*;
pub use cast::{Cast, Representable};
pub use heights::HeightField;
pub use hull::{Hull, HullFace};
pub use pattern::{Pattern, Rows};
pub use rings::{Interpolation, Ring};
pub use sensors::{Bound, ContactField, Ray, RayField, Reduce, Sensor, SensorKind, Side, Surface, Target};
pub use strips::{Crossing, LONGEST, Strips};
pub use tables::*;
pub use tendon::{Passes, Round, Stretch, StretchDof, Tendon, TendonDof};
pub use tiles::{Patch, Tiles};
pub use varied::{Instance, Quantities, Quantity, Varied};

use std::ops::Range;
use std::sync::Arc;

use crate::lane::Real;
use crate::options::Options;

/// No such element.
pub const NONE: u32 = u32::MAX;

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
    /// Forces of actuators.
    pub nout: usize,
    /// Motors.
    pub nmotor: usize,
    /// Servos on orientations.
    pub nservo: usize,
    /// Actuator moments: the sum of the degrees of freedom on which actuators act.
    pub nmoment: usize,
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
    /// Entries of the tiles of the Hessian, if it has any (see [`Tiles`]).
    pub ntile: usize,
    /// Entries of the multipliers of a strip's.
    pub npanel: usize,
    /// Links of a model whose accelerations are found without that matrix, else 0.
    pub narticulated: usize,
    /// Equality constraints, as MJCF has them.
    pub neq: usize,
    /// Rows of those that can act.
    pub ne: usize,
    /// Entries of their Jacobians.
    pub nej: usize,
    /// Numbers of all sensors.
    pub nsensordata: usize,
    /// Places of the contact sensor with most.
    pub nsensorkey: usize,
    /// Links of a model whose sensors measure accelerations, else 0.
    pub nsensoracc: usize,
    /// Links of a model whose sensors measure orientations, or torques beside welds, else 0.
    pub nsensorquat: usize,
    /// Trees of a model in which trees may sleep, else 0.
    pub nsleep: usize,
    /// Trees of which the guard keeps books; 0 without the option `guard`.
    pub nguard: usize,
    /// Numbers of the histories of actuators and sensors.
    pub nhistory: usize,
    /// Numbers of where springs rest that yield.
    pub nplastic: usize,
    /// Controls of a model in which some act late, else 0.
    pub ndelayed: usize,
    /// Numbers of the sensors of a model in which some have a history, else 0.
    pub nmeasured: usize,
    /// Low words of time, positions and histories, 1 + `nq` + `nhistory`, in single precision, else 0.
    pub nlow: usize,
    /// Tendons.
    pub ntendon: usize,
    /// Entries of their Jacobians.
    pub ntj: usize,
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

/// What the model contains, so that a step runs only what is needed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Features {
    /// Some joint or tendon has a spring and springs are on.
    pub springs: bool,
    /// Some dof or tendon has a damper and dampers are on.
    pub dampers: bool,
    /// Some body has gravity compensation, gravity is on and not zero, and passive forces are on.
    pub gravcomp: bool,
    /// Bodies move in a medium, and passive forces are on.
    pub fluid: bool,
    /// There are actuators and actuation is on.
    pub actuation: bool,
    /// Some actuator acts on a body, by what touches it.
    pub adhesion: bool,
    /// Euler integrates dampers implicitly: some dof is damped, and the flags `damper` and `eulerdamp` are on.
    pub implicit_damping: bool,
    /// Accelerations are found by articulated bodies, without the inertia matrix.
    pub articulated: bool,
}

/// What rounding does to the distances that bounding tests find: by how much more than two geoms can have approached, a distance
/// can have become less.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Blur<T> {
    /// Units in the last place of the lengths by which places are told.
    pub ulps: T,
    /// What one such unit is a part of at rest, times their number, m.
    pub length: T,
}

impl<T: Real, U: Real> Cast<U> for Blur<T> {
    type Out = Blur<U>;
    fn cast(&self) -> Blur<U> {
        Blur { ulps: self.ulps.cast(), length: self.length.cast() }
    }
}

/// A compiled model, over real type `T`. Made by the compiler of the `lanesim` package; kernels trust its indices.
#[derive(Clone, Debug, Default)]
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
    /// By link, how far geoms that it carries can be from its joints (see [`levers`](crate::collision::levers)), m.
    pub levers: Vec<T>,
    /// What rounding does to distances between geoms.
    pub blur: Blur<T>,
    /// Geoms that take part in pairs.
    pub geoms: Vec<Geom<T>>,
    /// Convex hulls of the meshes among them.
    pub hulls: Arc<[Hull]>,
    /// Height fields among them.
    pub heights: Arc<[HeightField]>,
    /// Those of them whose surfaces move.
    pub belts: Vec<Belt<T>>,
    /// Pairs of geoms.
    pub pairs: Vec<Pair<T>>,
    /// Degrees of freedom of pairs.
    pub pair_dofs: Vec<PairDof>,
    /// Bodies in a medium; empty if there is none, or passive forces are off.
    pub fluids: Vec<Fluid<T>>,
    /// Geoms in it, in place of their bodies.
    pub ellipsoids: Vec<Ellipsoid<T>>,
    /// Tendons, in MJCF order.
    pub tendons: Vec<Tendon<T>>,
    /// Degrees of freedom of tendons.
    pub tendon_dofs: Vec<TendonDof<T>>,
    /// Pieces of the paths of tendons.
    pub stretches: Vec<Stretch<T>>,
    /// Degrees of freedom of those.
    pub stretch_dofs: Vec<StretchDof>,
    /// Limits, in the order of joints, then of tendons; empty if the flag `limit` or `constraint` is off.
    pub limits: Vec<Limit<T>>,
    /// Equality constraints that can act, in MJCF order; empty if the flag `equality` or `constraint` is off.
    pub equalities: Vec<Equality<T>>,
    /// Degrees of freedom of equality constraints.
    pub equality_dofs: Vec<EqualityDof>,
    /// Whether each equality constraint of the file is active at first, 1 or 0, length neq.
    pub eq_active0: Vec<T>,
    /// Dry friction, in the order of dofs, then of tendons; empty if the flag `frictionloss` or `constraint` is off.
    pub friction_losses: Vec<FrictionLoss<T>>,
    /// Where springs rest at first that yield (see [`State::plastic`](crate::state::State::plastic)).
    pub plastic0: Vec<T>,
    /// Histories of actuators' controls.
    pub ctrl_rings: Vec<Ring>,
    /// Histories of sensors.
    pub sensor_rings: Vec<Ring>,
    /// Histories at first (see [`State::history`](crate::state::State::history)).
    pub history0: Vec<T>,
    /// Actuators.
    pub actuators: Vec<Actuator<T>>,
    /// Their controls.
    pub controls: Vec<Control<T>>,
    /// What they do with several.
    pub controllers: Vec<Controller<T>>,
    /// Those that turn something to an orientation.
    pub servos: Vec<Servo<T>>,
    /// Those that are motors.
    pub motors: Vec<Motor<T>>,
    /// Frames on which they act, and that sensors are about.
    pub mounts: Vec<Mount<T>>,
    /// Degrees of freedom on which they act.
    pub moment_dofs: Vec<MomentDof>,
    /// Gains and biases of muscles.
    pub muscles: Vec<Muscle<T>>,
    /// Sensors.
    pub sensors: Vec<Sensor<T>>,
    /// Their rays.
    pub rays: Vec<Ray<T>>,
    /// Geoms that these can meet, and those whose distances are measured.
    pub targets: Vec<Target<T>>,
    /// Pairs of those whose distances are measured.
    pub spaces: Vec<[u32; 2]>,
    /// The meshes among those.
    pub surfaces: Arc<[Surface]>,
    /// Storage of the inertia matrix and of the solver's Hessian.
    pub rows: Rows,
    /// Storage of the Hessian where trees touch.
    pub tiles: Tiles,
    /// Strips of dofs if every world has a Hessian with a pattern of its own instead, because many trees can touch; else empty.
    pub own: Strips,
    /// Sparsity of the inertia matrix: row `i` has the ancestors of dof `i`.
    pub tree_pattern: Pattern,
    /// Σ over dofs of the inertia matrix's diagonal in the reference configuration divided by nv (`stat.meaninertia`).
    pub mean_inertia: T,
    /// Positions in the reference configuration, length nq.
    pub qpos0: Vec<T>,
    /// What rounding took from time 0, these and the histories (see [`State::low`](crate::state::State::low)).
    pub low0: Vec<T>,
    /// Trees of a model in which trees may sleep, else empty.
    pub sleepers: Vec<Sleeper>,
    /// By degree of freedom, the length by which its velocity is that of a point, m; 1 of translations; empty likewise.
    pub sleep_lengths: Vec<T>,
    /// For how long trees have rested at first (see [`sleep`](crate::sleep)); empty likewise.
    pub tree_rest0: Vec<T>,
    /// Gravity; zero when its flag is off.
    pub gravity: [T; 3],
    /// Potential energy of the bodies that stand still.
    pub potential_still: T,
}

impl Features {
    /// Whether there can be passive forces.
    pub fn passive(&self) -> bool {
        self.springs || self.dampers || self.gravcomp || self.fluid
    }
}

/// Links whose motions the inertia matrix couples.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tree {
    /// Degrees of freedom.
    pub dofs: Range<usize>,
    /// Links, the first of which carries the others.
    pub links: Range<usize>,
}

impl Tree {
    /// Whether its first link has a free joint.
    pub fn floats<T>(&self, model: &Model<T>) -> bool {
        !self.dofs.is_empty() && matches!(model.dofs[self.dofs.start].kind, DofKind::FreeTranslation(_))
    }

    /// Whether it is a free body that carries no joint.
    pub fn is_free_body<T>(&self, model: &Model<T>) -> bool {
        self.floats(model) && self.links.len() == 1
    }
}

impl<T> Model<T> {
    /// The trees, in order.
    pub fn trees(&self) -> impl Iterator<Item = Tree> {
        let links = &self.links;
        let roots = (0..links.len()).filter(|l| links[*l].parent == NONE);
        roots.map(|l| {
            let carried = links[l + 1..].iter().take_while(|link| link.parent != NONE).count();
            let dofs = links[l].dofs.range().start..links[l + carried].dofs.range().end;
            Tree { dofs, links: l..l + carried + 1 }
        })
    }

    /// Those of which the guard keeps books. Of one dof, or of a free body alone, inertial forces create nothing worth a book.
    pub fn guarded(&self) -> impl Iterator<Item = Tree> {
        let on = self.options.guard;
        self.trees().filter(move |tree| on && tree.dofs.len() > 1 && !tree.is_free_body(self))
    }

    /// Whether a sensor is found apart from those that follow from states, motions and actuators alone: its numbers follow from
    /// rows, from a search, or from so many triangles that they are no straight line.
    pub fn apart(&self, sensor: &Sensor<T>) -> bool {
        sensor.kind.of_rows()
            || sensor.kind.of_space()
            || (sensor.kind == SensorKind::Rangefinder && self.targets.iter().any(|target| target.surface != NONE))
    }

    /// Whether there can be constraint rows.
    pub fn constrained(&self) -> bool {
        !self.pairs.is_empty()
            || !self.limits.is_empty()
            || !self.friction_losses.is_empty()
            || !self.equalities.is_empty()
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

impl<T: Real, U: Real> Cast<U> for Model<T> {
    type Out = Model<U>;
    fn cast(&self) -> Model<U> {
        let low0 = low::remainders(self.qpos0.iter().chain(&self.history0));
        Model {
            sizes: Sizes { nlow: low0.len(), ..self.sizes.clone() },
            options: self.options.clone(),
            features: self.features.clone(),
            bodies: self.bodies.cast(),
            links: self.links.cast(),
            joints: self.joints.cast(),
            dofs: self.dofs.cast(),
            levers: self.levers.cast(),
            blur: self.blur.cast(),
            geoms: self.geoms.cast(),
            hulls: self.hulls.clone(),
            heights: self.heights.clone(),
            belts: self.belts.cast(),
            pairs: self.pairs.cast(),
            pair_dofs: self.pair_dofs.clone(),
            fluids: self.fluids.cast(),
            ellipsoids: self.ellipsoids.cast(),
            tendons: self.tendons.cast(),
            tendon_dofs: self.tendon_dofs.cast(),
            stretches: self.stretches.cast(),
            stretch_dofs: self.stretch_dofs.clone(),
            limits: self.limits.cast(),
            equalities: self.equalities.cast(),
            equality_dofs: self.equality_dofs.clone(),
            eq_active0: self.eq_active0.cast(),
            friction_losses: self.friction_losses.cast(),
            actuators: self.actuators.cast(),
            controls: self.controls.cast(),
            controllers: self.controllers.cast(),
            motors: self.motors.cast(),
            servos: self.servos.cast(),
            mounts: self.mounts.cast(),
            moment_dofs: self.moment_dofs.clone(),
            muscles: self.muscles.cast(),
            sensors: self.sensors.cast(),
            rays: self.rays.cast(),
            targets: self.targets.cast(),
            spaces: self.spaces.clone(),
            surfaces: self.surfaces.clone(),
            rows: self.rows.clone(),
            tiles: self.tiles.clone(),
            own: self.own.clone(),
            tree_pattern: self.tree_pattern.clone(),
            mean_inertia: self.mean_inertia.cast(),
            qpos0: self.qpos0.cast(),
            low0,
            sleepers: self.sleepers.clone(),
            sleep_lengths: self.sleep_lengths.cast(),
            tree_rest0: self.tree_rest0.cast(),
            plastic0: self.plastic0.cast(),
            ctrl_rings: self.ctrl_rings.clone(),
            sensor_rings: self.sensor_rings.clone(),
            history0: self.history0.cast(),
            gravity: self.gravity.cast(),
            potential_still: self.potential_still.cast(),
        }
    }
}
