//! A model before compilation: what an MJCF file says once defaults, frames, replicas, angle units and orientation
//! notations are resolved, or what Rust code builds directly.
//!
//! Angles are radians, orientations quaternions (w, x, y, z), lengths and masses whatever the model uses. Elements are
//! kept in the order in which they were written. `compile` turns a `Spec` into a [`Model`](crate::Model) and is the only
//! place that rejects one.

mod actuator;
mod camera;
mod equality;
mod heights;
mod history;
mod mesh;
mod sensor;
mod tendon;

use std::collections::BTreeMap;
use std::sync::Arc;

pub use actuator::{Actuator, Bias, Dynamics, Gain, Input, LengthRange, LengthRangeMode, Transmission};
pub use camera::Camera;
pub use equality::{Equality, Held};
pub use heights::HeightField;
pub use history::{History, Interpolation};
pub use lanesim_kernels::options::Options;
pub use mesh::{Mesh, MeshInertia, Triangles};
pub use sensor::{
    ContactField, Contacts, DataType, NeedStage, Object, ObjectKind, RayField, Reduce, Sensor, SensorKind,
};
pub use tendon::{Path, Tendon, Waypoint};

/// Where an element was written, for diagnostics. Elements built from code have the default: no file, line 0.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Source {
    /// File, if any.
    pub file: Option<Arc<str>>,
    /// Line, counted from 1; 0: unknown.
    pub line: u32,
}

impl Source {
    /// A sentence after the place that it is about.
    pub(crate) fn placed(&self, sentence: &str) -> String {
        match (&self.file, self.line) {
            (Some(file), line) => format!("{file}:{line}: {sentence}"),
            (None, 0) => sentence.to_owned(),
            (None, line) => format!("line {line}: {sentence}"),
        }
    }
}

/// `true`, `false` or decided by what else is given (MJCF `auto`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tri {
    /// Decided by whether a range is given whose lower end is below its upper one.
    #[default]
    Auto,
    /// Off.
    False,
    /// On.
    True,
}

/// Whether a range is in force: if the flag says so or, without a flag, if it has a lower end below its upper one.
pub(crate) fn is_limited(range: Option<[f64; 2]>, flag: Tri) -> bool {
    match flag {
        Tri::True => true,
        Tri::False => false,
        Tri::Auto => range.is_some_and(|[lo, hi]| lo < hi),
    }
}

/// What a whole model says: the input of the compiler.
#[derive(Clone, Debug, Default)]
pub struct Spec {
    /// Name of the model.
    pub name: String,
    /// Compiler settings.
    pub compiler: Compiler,
    /// Simulation options.
    pub option: Options,
    /// Bodies; index 0 is the world, and a body comes after its parent.
    pub bodies: Vec<Body>,
    /// Meshes.
    pub meshes: Vec<Mesh>,
    /// Height fields.
    pub hfields: Vec<HeightField>,
    /// Explicit contact pairs.
    pub pairs: Vec<Pair>,
    /// Pairs of bodies whose geoms do not collide.
    pub excludes: Vec<Exclude>,
    /// Tendons.
    pub tendons: Vec<Tendon>,
    /// Equality constraints.
    pub equalities: Vec<Equality>,
    /// Actuators.
    pub actuators: Vec<Actuator>,
    /// Sensors.
    pub sensors: Vec<Sensor>,
    /// Keyframes.
    pub keys: Vec<Key>,
    /// Where options and compiler settings were written, by element and attribute: `option timestep`, `flag sleep`.
    pub written: BTreeMap<String, Source>,
    /// What a lenient load left out, one sentence each; empty otherwise.
    pub losses: Vec<String>,
    /// Notes to the user: things that were dropped without effect on the physics, deprecated spellings.
    pub notes: Vec<String>,
}

impl Spec {
    /// An empty model: the world alone, with default options.
    pub fn new(name: &str) -> Self {
        Spec {
            name: name.to_string(),
            bodies: vec![Body { name: "world".into(), ..Body::default() }],
            ..Spec::default()
        }
    }

    /// Where an attribute of `option`, `flag` or `compiler` was written; nowhere if it was not.
    pub(crate) fn place(&self, element: &str, attribute: &str) -> Source {
        self.written.get(&format!("{element} {attribute}")).cloned().unwrap_or_default()
    }

    /// Number of activations.
    pub(crate) fn activations(&self) -> usize {
        self.actuators.iter().map(Actuator::activations).sum()
    }

    /// Number of controls.
    pub(crate) fn controls(&self) -> usize {
        self.actuators.iter().map(Actuator::controls).sum()
    }

    /// Adds a body to the body of index `parent` and returns its own index. The parent named in `body` does not count.
    pub fn add_body(&mut self, parent: usize, body: Body) -> usize {
        self.bodies.push(Body { parent, ..body });
        self.bodies.len() - 1
    }
}

/// Which bodies take mass and inertia from their geoms (MJCF `compiler/inertiafromgeom`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum InertiaFromGeom {
    /// Bodies without `inertial`.
    #[default]
    Auto,
    /// None.
    False,
    /// All.
    True,
}

/// Compiler settings that act after parsing (MJCF `compiler`).
#[derive(Clone, Debug, PartialEq)]
pub struct Compiler {
    /// Whether a range alone means that it is in force.
    pub autolimits: bool,
    /// Least mass of a moving body.
    pub boundmass: f64,
    /// Least diagonal inertia of a moving body.
    pub boundinertia: f64,
    /// Total mass to rescale to; not positive: leave alone.
    pub settotalmass: f64,
    /// Replace inertias that violate the triangle rule by their mean.
    pub balanceinertia: bool,
    /// Merge bodies without joints into their parents.
    pub fusestatic: bool,
    /// Drop geoms that only decorate: no contact and no part in inertia.
    pub discardvisual: bool,
    /// Align the frames of free bodies with their inertia.
    pub alignfree: bool,
    /// Whether shapes fitted to meshes fit the box along their axes, not that of their inertia.
    pub fitaabb: bool,
    /// Which bodies take inertia from geoms.
    pub inertiafromgeom: InertiaFromGeom,
    /// Groups of geoms that count for inertia, inclusive.
    pub inertiagrouprange: [i32; 2],
    /// How ranges of lengths are found.
    pub lengthrange: LengthRange,
}

impl Default for Compiler {
    fn default() -> Self {
        Compiler {
            autolimits: true,
            boundmass: 0.0,
            boundinertia: 0.0,
            settotalmass: -1.0,
            balanceinertia: false,
            fusestatic: false,
            discardvisual: false,
            alignfree: false,
            fitaabb: false,
            inertiafromgeom: InertiaFromGeom::Auto,
            inertiagrouprange: [0, 5],
            lengthrange: LengthRange::default(),
        }
    }
}

/// Whether the tree of a body may sleep (MJCF `body/sleep`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SleepPolicy {
    /// Unless an actuator acts on it, or a spring or damper of a tendon that it shares with other trees.
    #[default]
    Auto,
    /// It stays awake.
    Never,
    /// It may.
    Allowed,
    /// It may, and starts asleep.
    Init,
}

/// A rigid body (MJCF `body`).
#[derive(Clone, Debug)]
pub struct Body {
    /// Name, or empty.
    pub name: String,
    /// Index of the parent in [`Spec::bodies`]; the world is its own parent.
    pub parent: usize,
    /// Position in the parent's frame.
    pub pos: [f64; 3],
    /// Orientation in the parent's frame.
    pub quat: [f64; 4],
    /// Whether the pose is an input of the simulation.
    pub mocap: bool,
    /// Fraction of the body's weight that is compensated.
    pub gravcomp: f64,
    /// Whether its tree may sleep; bodies that carry no tree have the default.
    pub sleep: SleepPolicy,
    /// Whether [`Compiler::fusestatic`] may merge it into its parent.
    pub fuse: bool,
    /// Explicit mass and inertia.
    pub inertial: Option<Inertial>,
    /// Joints, in order.
    pub joints: Vec<Joint>,
    /// Geoms, in order.
    pub geoms: Vec<Geom>,
    /// Sites, in order.
    pub sites: Vec<Site>,
    /// Cameras, in order.
    pub cameras: Vec<Camera>,
    /// The first geom with mass that a lenient load left out, if any: for messages.
    pub lost_mass: Option<String>,
    /// Where it was written.
    pub source: Source,
}

impl Default for Body {
    fn default() -> Self {
        Body {
            name: String::new(),
            parent: 0,
            pos: [0.0; 3],
            quat: [1.0, 0.0, 0.0, 0.0],
            mocap: false,
            gravcomp: 0.0,
            sleep: SleepPolicy::Auto,
            fuse: true,
            inertial: None,
            joints: Vec::new(),
            geoms: Vec::new(),
            sites: Vec::new(),
            cameras: Vec::new(),
            lost_mass: None,
            source: Source::default(),
        }
    }
}

/// Explicit mass and inertia of a body (MJCF `inertial`).
#[derive(Clone, Debug)]
pub struct Inertial {
    /// Centre of mass in the body frame.
    pub pos: [f64; 3],
    /// Orientation of the inertia's frame in the body frame.
    pub quat: [f64; 4],
    /// Mass.
    pub mass: f64,
    /// The inertia about the centre of mass.
    pub inertia: Inertia,
    /// Where it was written.
    pub source: Source,
}

/// Rotational inertia about the centre of mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Inertia {
    /// Principal moments, in the frame of [`Inertial::quat`].
    Diagonal([f64; 3]),
    /// Ixx, Iyy, Izz, Ixy, Ixz, Iyz in body axes; [`Inertial::quat`] is not used.
    Full([f64; 6]),
}

/// The kind of a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Six degrees of freedom; only on a child of the world.
    Free,
    /// Three rotational degrees of freedom.
    Ball,
    /// Translation along the axis.
    Slide,
    /// Rotation about the axis.
    Hinge,
}

/// A joint (MJCF `joint`, `freejoint`).
#[derive(Clone, Debug)]
pub struct Joint {
    /// Name, or empty.
    pub name: String,
    /// Kind.
    pub kind: JointKind,
    /// Anchor in the body frame; not used by free joints.
    pub pos: [f64; 3],
    /// Axis in the body frame, any positive length; slides and hinges.
    pub axis: [f64; 3],
    /// Limits, rad or m, infinite where there is none; `None`: not given. Ball: (0, largest angle).
    pub range: Option<[f64; 2]>,
    /// Whether the range is in force.
    pub limited: Tri,
    /// Distance below which the limit acts.
    pub margin: f64,
    /// Value of the position in the defining configuration.
    pub reference: f64,
    /// Position at which the spring is at rest.
    pub springref: f64,
    /// How far the spring is stretched before it yields, and rests elsewhere; 0: it does not yield.
    pub springyield: f64,
    /// Coefficients of the spring force a x + b x² + c x³.
    pub stiffness: [f64; 3],
    /// Coefficients of the damper force a v + b v|v| + c v³.
    pub damping: [f64; 3],
    /// Time constant and damping ratio that override stiffness and damping when both are positive.
    pub springdamper: [f64; 2],
    /// Inertia added to the diagonal of the inertia matrix.
    pub armature: f64,
    /// Dry friction.
    pub frictionloss: f64,
    /// `solref` of the limit.
    pub solreflimit: [f64; 2],
    /// `solimp` of the limit.
    pub solimplimit: [f64; 5],
    /// `solref` of dry friction.
    pub solreffriction: [f64; 2],
    /// `solimp` of dry friction.
    pub solimpfriction: [f64; 5],
    /// Bounds on the total actuator force; `None`: not given.
    pub actuatorfrcrange: Option<[f64; 2]>,
    /// Whether those bounds are in force.
    pub actuatorfrclimited: Tri,
    /// Whether gravity compensation counts as an actuator force.
    pub actuatorgravcomp: bool,
    /// Free joints: whether the body's frame moves to its inertia; `Auto`: as [`Compiler::alignfree`] says.
    pub align: Tri,
    /// Group, for display.
    pub group: i32,
    /// Where it was written.
    pub source: Source,
}

/// MuJoCo's default `solref`.
pub const SOLREF: [f64; 2] = [0.02, 1.0];
/// MuJoCo's default `solimp`.
pub const SOLIMP: [f64; 5] = [0.9, 0.95, 0.001, 0.5, 2.0];

impl Default for Joint {
    fn default() -> Self {
        Joint {
            name: String::new(),
            kind: JointKind::Hinge,
            pos: [0.0; 3],
            axis: [0.0, 0.0, 1.0],
            range: None,
            limited: Tri::Auto,
            margin: 0.0,
            reference: 0.0,
            springref: 0.0,
            springyield: 0.0,
            stiffness: [0.0; 3],
            damping: [0.0; 3],
            springdamper: [0.0; 2],
            armature: 0.0,
            frictionloss: 0.0,
            solreflimit: SOLREF,
            solimplimit: SOLIMP,
            solreffriction: SOLREF,
            solimpfriction: SOLIMP,
            actuatorfrcrange: None,
            actuatorfrclimited: Tri::Auto,
            actuatorgravcomp: false,
            align: Tri::Auto,
            group: 0,
            source: Source::default(),
        }
    }
}

/// The shape of a geom or site, in MuJoCo's order (a pair of geoms is sorted by it).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Shape {
    /// Infinite plane, normal along z.
    Plane,
    /// A height field; its sizes follow from it.
    HeightField,
    /// Sphere: radius.
    Sphere,
    /// Capsule along z: radius, half length of the cylinder part.
    Capsule,
    /// Ellipsoid: three semi-axes.
    Ellipsoid,
    /// Cylinder along z: radius, half length.
    Cylinder,
    /// Box: three half sizes.
    Box,
    /// A mesh, of which the convex hull collides; its sizes follow from it.
    Mesh,
}

/// How a geom's mass is given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GeomMass {
    /// Mass.
    Mass(f64),
    /// Density; times volume, or area for shells.
    Density(f64),
    /// Mass, and principal moments along the geom's axes.
    Solid {
        /// Mass.
        mass: f64,
        /// Principal moments.
        moments: [f64; 3],
    },
}

/// A geometric shape fixed to a body (MJCF `geom`).
#[derive(Clone, Debug)]
pub struct Geom {
    /// Name, or empty.
    pub name: String,
    /// Shape.
    pub shape: Shape,
    /// Sizes, as [`Shape`] says; the rest 0. Not used with a mesh.
    pub size: [f64; 3],
    /// Name of the mesh that is its shape, or to which its shape is fitted; or empty.
    pub mesh: String,
    /// Name of the height field that is its shape, or empty.
    pub hfield: String,
    /// How much larger than the mesh a fitted shape is.
    pub fitscale: f64,
    /// Position in the body frame.
    pub pos: [f64; 3],
    /// Orientation in the body frame.
    pub quat: [f64; 4],
    /// Mass or density.
    pub mass: GeomMass,
    /// Whether the mass lies on the surface.
    pub shellinertia: bool,
    /// Contact type bits.
    pub contype: u32,
    /// Contact affinity bits.
    pub conaffinity: u32,
    /// Dimension of the contact: 1, 3, 4 or 6.
    pub condim: i32,
    /// Of two geoms, the one with the higher priority sets the contact's parameters.
    pub priority: i32,
    /// Group, for display and `inertiagrouprange`.
    pub group: i32,
    /// Whether the rays of sensors pass through it, as it is not seen: its colour has no opacity.
    pub clear: bool,
    /// In a medium, coefficients of the drag of blunt, slender and turning ellipsoids, and of the lift of Kutta and of Magnus; without, it counts
    /// with its body's inertia, unless another geom of the body has some.
    pub fluid: Option<[f64; 5]>,
    /// Velocity of its surface against it, and angular velocity about its middle, in its axes.
    pub surfacevel: [f64; 6],
    /// Sliding, torsional and rolling friction.
    pub friction: [f64; 3],
    /// Weight when parameters of two geoms are mixed.
    pub solmix: f64,
    /// Contact reference parameters.
    pub solref: [f64; 2],
    /// Contact impedance parameters.
    pub solimp: [f64; 5],
    /// Distance below which the contact acts.
    pub margin: f64,
    /// Distance beyond the margin within which contacts are listed without acting.
    pub gap: f64,
    /// Where it was written.
    pub source: Source,
}

impl Default for Geom {
    fn default() -> Self {
        Geom {
            name: String::new(),
            shape: Shape::Sphere,
            size: [0.0; 3],
            mesh: String::new(),
            hfield: String::new(),
            fitscale: 1.0,
            pos: [0.0; 3],
            quat: [1.0, 0.0, 0.0, 0.0],
            mass: GeomMass::Density(1000.0),
            shellinertia: false,
            contype: 1,
            conaffinity: 1,
            condim: 3,
            priority: 0,
            group: 0,
            clear: false,
            fluid: None,
            surfacevel: [0.0; 6],
            friction: [1.0, 0.005, 0.0001],
            solmix: 1.0,
            solref: SOLREF,
            solimp: SOLIMP,
            margin: 0.0,
            gap: 0.0,
            source: Source::default(),
        }
    }
}

/// A frame of interest fixed to a body (MJCF `site`).
#[derive(Clone, Debug)]
pub struct Site {
    /// Name, or empty.
    pub name: String,
    /// Shape.
    pub shape: Shape,
    /// Sizes.
    pub size: [f64; 3],
    /// Position in the body frame.
    pub pos: [f64; 3],
    /// Orientation in the body frame.
    pub quat: [f64; 4],
    /// Group, for display.
    pub group: i32,
    /// Where it was written.
    pub source: Source,
}

impl Default for Site {
    fn default() -> Self {
        Site {
            name: String::new(),
            shape: Shape::Sphere,
            size: [0.005; 3],
            pos: [0.0; 3],
            quat: [1.0, 0.0, 0.0, 0.0],
            group: 0,
            source: Source::default(),
        }
    }
}

/// An explicit contact pair with its own parameters (MJCF `contact/pair`).
#[derive(Clone, Debug)]
pub struct Pair {
    /// Name, or empty.
    pub name: String,
    /// Name of the first geom.
    pub geom1: String,
    /// Name of the second geom.
    pub geom2: String,
    /// Dimension of the contact.
    pub condim: i32,
    /// Two tangential, one torsional, two rolling coefficients.
    pub friction: [f64; 5],
    /// Reference parameters.
    pub solref: [f64; 2],
    /// Reference parameters of friction rows of elliptic cones; zero: `solref`.
    pub solreffriction: [f64; 2],
    /// Impedance parameters.
    pub solimp: [f64; 5],
    /// Distance below which the contact acts.
    pub margin: f64,
    /// Distance beyond the margin within which the contact is listed.
    pub gap: f64,
    /// Where it was written.
    pub source: Source,
}

impl Default for Pair {
    fn default() -> Self {
        Pair {
            name: String::new(),
            geom1: String::new(),
            geom2: String::new(),
            condim: 3,
            friction: [1.0, 1.0, 0.005, 1e-4, 1e-4],
            solref: SOLREF,
            solreffriction: [0.0; 2],
            solimp: SOLIMP,
            margin: 0.0,
            gap: 0.0,
            source: Source::default(),
        }
    }
}

/// Two bodies whose geoms do not collide (MJCF `contact/exclude`).
#[derive(Clone, Debug, Default)]
pub struct Exclude {
    /// Name, or empty.
    pub name: String,
    /// Name of the first body.
    pub body1: String,
    /// Name of the second body.
    pub body2: String,
    /// Where it was written.
    pub source: Source,
}

/// What a keyframe says of one body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KeyPart {
    /// Index of the body in [`Spec::bodies`].
    pub body: usize,
    /// Positions of its joints; empty: not given.
    pub qpos: Vec<f64>,
    /// Velocities, likewise.
    pub qvel: Vec<f64>,
}

/// A saved state (MJCF `keyframe/key`). What is missing, or short, is filled from the reference configuration, or with
/// zeros.
#[derive(Clone, Debug, Default)]
pub struct Key {
    /// Name, or empty.
    pub name: String,
    /// Time, s.
    pub time: f64,
    /// Positions, at most `nq`.
    pub qpos: Option<Vec<f64>>,
    /// Velocities, at most `nv`.
    pub qvel: Option<Vec<f64>>,
    /// Activations, at most `na`.
    pub act: Option<Vec<f64>>,
    /// Where springs rest that yield, at most `nplastic`.
    pub plastic: Option<Vec<f64>>,
    /// Controls, at most `nu`.
    pub ctrl: Option<Vec<f64>>,
    /// Mocap positions, at most `3 nmocap`.
    pub mpos: Option<Vec<f64>>,
    /// Mocap orientations, at most `4 nmocap`.
    pub mquat: Option<Vec<f64>>,
    /// What it says of single bodies, beside `qpos` and `qvel`: of models that are attached.
    pub parts: Vec<KeyPart>,
    /// Controls of single actuators by name, beside `ctrl`, likewise.
    pub controls: Vec<(String, Vec<f64>)>,
    /// Where it was written.
    pub source: Source,
}
