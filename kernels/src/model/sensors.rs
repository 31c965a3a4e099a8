//! Sensors, the frames that they are about, and what their rays can meet.

use super::cast::{Cast, Representable, table};
use super::{Shape, Span};
use crate::lane::Real;

macro_rules! kinds {
    ($($(#[$doc:meta])* $kind:ident = $number:literal $tag:literal;)*) => {
        /// What a sensor measures.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum SensorKind {
            $($(#[$doc])* $kind = $number,)*
        }

        impl SensorKind {
            /// All.
            pub const ALL: &[SensorKind] = &[$(SensorKind::$kind),*];

            /// MJCF's word for it.
            pub fn tag(self) -> &'static str {
                match self { $(SensorKind::$kind => $tag,)* }
            }
        }
    };
}

// The numbers are MuJoCo's.
kinds! {
    /// Sum of the normal forces of contacts that push through a site, N.
    Touch = 0 "touch";
    /// Acceleration of a site less gravity, its axes, m/s².
    Accelerometer = 1 "accelerometer";
    /// Velocity of a site, its axes, m/s.
    Velocimeter = 2 "velocimeter";
    /// Angular velocity of a site, its axes, rad/s.
    Gyro = 3 "gyro";
    /// Force of its parent on a site's body, its axes, N.
    Force = 4 "force";
    /// Torque of the parent on it, at the site, its axes, N m.
    Torque = 5 "torque";
    /// Magnetic field at a site, its axes.
    Magnetometer = 6 "magnetometer";
    /// What rays along a site's z axis, or through a camera's pixels, meet of other bodies, as [`RayField`] says.
    Rangefinder = 7 "rangefinder";
    /// Where a camera sees a site, pixels from its upper left corner.
    CamProjection = 8 "camprojection";
    /// Position of a slide or hinge, m or rad.
    JointPos = 9 "jointpos";
    /// Velocity of a slide or hinge.
    JointVel = 10 "jointvel";
    /// Length of a tendon.
    TendonPos = 11 "tendonpos";
    /// Rate of that.
    TendonVel = 12 "tendonvel";
    /// Length of an actuator.
    ActuatorPos = 13 "actuatorpos";
    /// Velocity of an actuator.
    ActuatorVel = 14 "actuatorvel";
    /// Force of an actuator.
    ActuatorFrc = 15 "actuatorfrc";
    /// Force of all actuators on a slide or hinge.
    JointActuatorFrc = 16 "jointactuatorfrc";
    /// Force of all actuators on a tendon.
    TendonActuatorFrc = 17 "tendonactuatorfrc";
    /// Orientation of a ball joint.
    BallQuat = 18 "ballquat";
    /// Angular velocity of a ball joint, axes of its body, rad/s.
    BallAngVel = 19 "ballangvel";
    /// Violation of a joint's limit, 0 where it does not act.
    JointLimitPos = 20 "jointlimitpos";
    /// Rate of that.
    JointLimitVel = 21 "jointlimitvel";
    /// Force of the limit.
    JointLimitFrc = 22 "jointlimitfrc";
    /// Violation of a tendon's limit, 0 where it does not act.
    TendonLimitPos = 23 "tendonlimitpos";
    /// Rate of that.
    TendonLimitVel = 24 "tendonlimitvel";
    /// Force of the limit.
    TendonLimitFrc = 25 "tendonlimitfrc";
    /// Position of a frame, m.
    FramePos = 26 "framepos";
    /// Orientation of a frame.
    FrameQuat = 27 "framequat";
    /// X axis of a frame.
    FrameXAxis = 28 "framexaxis";
    /// Y axis of a frame.
    FrameYAxis = 29 "frameyaxis";
    /// Z axis of a frame.
    FrameZAxis = 30 "framezaxis";
    /// Velocity of a frame, m/s.
    FrameLinVel = 31 "framelinvel";
    /// Angular velocity of a frame, rad/s.
    FrameAngVel = 32 "frameangvel";
    /// Acceleration of a frame less gravity, world axes, m/s².
    FrameLinAcc = 33 "framelinacc";
    /// Angular acceleration of a frame, world axes, rad/s².
    FrameAngAcc = 34 "frameangacc";
    /// Centre of mass of a body and all that it carries, m.
    SubtreeCom = 35 "subtreecom";
    /// Velocity of that, m/s.
    SubtreeLinVel = 36 "subtreelinvel";
    /// Angular momentum about that, kg m²/s.
    SubtreeAngMom = 37 "subtreeangmom";
    /// 1 where a frame's position is within a site, else 0.
    InsideSite = 38 "insidesite";
    /// Distance of two geoms, or the least of those of two bodies, m.
    GeomDist = 39 "distance";
    /// Unit vector along the shortest way between them; zero where that is beyond the cutoff.
    GeomNormal = 40 "normal";
    /// Its ends, m; likewise.
    GeomFromTo = 41 "fromto";
    /// Contacts, as [`ContactField`] says.
    Contact = 42 "contact";
    /// Potential energy, J.
    EPotential = 43 "e_potential";
    /// Kinetic energy, J.
    EKinetic = 44 "e_kinetic";
    /// Time, s.
    Clock = 45 "clock";
    /// Zeros: a place for numbers that somebody else computes.
    User = 48 "user";
}

impl SensorKind {
    /// Whether it follows from constraint rows and their forces.
    pub fn of_rows(self) -> bool {
        use SensorKind::{Contact, Force, Torque, Touch};
        matches!(self, Touch | Force | Torque | Contact) || self.of_limit().is_some()
    }

    /// Whether it is about the space between geoms.
    pub fn of_space(self) -> bool {
        matches!(self, SensorKind::GeomDist | SensorKind::GeomNormal | SensorKind::GeomFromTo)
    }

    /// Of a sensor of limits, which number of theirs: violation, rate or force.
    pub fn of_limit(self) -> Option<usize> {
        use SensorKind as Kind;
        Some(match self {
            Kind::JointLimitPos | Kind::TendonLimitPos => 0,
            Kind::JointLimitVel | Kind::TendonLimitVel => 1,
            Kind::JointLimitFrc | Kind::TendonLimitFrc => 2,
            _ => return None,
        })
    }

    /// Whether it follows from accelerations of links.
    pub fn of_accelerations(self) -> bool {
        use SensorKind::{Accelerometer, Force, FrameAngAcc, FrameLinAcc, Torque};
        matches!(self, Accelerometer | Force | Torque | FrameLinAcc | FrameAngAcc)
    }

    /// Whether it follows from an energy.
    pub fn of_energy(self) -> bool {
        matches!(self, SensorKind::EPotential | SensorKind::EKinetic)
    }
}

/// How a sensor's numbers are bounded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bound {
    /// Not at all.
    None,
    /// From above.
    Above,
    /// On both sides of zero.
    Both,
}

table! {
    /// A sensor.
    pub struct Sensor {
        /// What it measures.
        pub kind: SensorKind,
        /// Where its numbers are.
        pub data: Span,
        /// How they are bounded.
        pub bound: Bound,
        /// The frame that it is about, in [`Model::mounts`](super::Model::mounts), or [`NONE`](super::NONE).
        pub mount: u32,
        /// The frame in which it is seen, or the site of [`SensorKind::InsideSite`], likewise.
        pub reference: u32,
        /// Position, dof, tendon, actuator or limit that it is about; MJCF body of a touch sensor or rangefinder.
        pub id: u32,
        /// MJCF bodies that it is about: one and all that it carries.
        pub bodies: Span,
        /// Rays, in [`Model::rays`](super::Model::rays), or pairs of geoms, in [`Model::spaces`](super::Model::spaces).
        pub items: Span,
        /// What it returns of each ray or contact, as bits in the order of [`RayField`] or [`ContactField`].
        pub fields: u32,
        /// Of a contact sensor, which contacts it returns.
        pub reduce: Reduce,
        /// Of a contact sensor, what is on either side.
        pub sides: [Side; 2],
        /// Shape of its site.
        pub shape: Shape,
        real:
        /// Sizes of that.
        pub size: [T; 3],
        /// Of a camera, its focal lengths and half its resolution, pixels.
        pub lens: [T; 4],
        /// The bound.
        pub cutoff: T,
    } T
}

macro_rules! fields {
    ($(#[$doc:meta])* $name:ident { $($(#[$fdoc:meta])* $field:ident = $word:literal $width:literal,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $name {
            $($(#[$fdoc])* $field,)*
        }

        impl $name {
            /// All, with MJCF's words.
            pub const ALL: &[(&str, $name)] = &[$(($word, $name::$field)),*];

            /// Its bit.
            pub fn bit(self) -> u32 {
                1 << self as u32
            }

            /// Number of numbers.
            pub fn width(self) -> usize {
                match self { $($name::$field => $width,)* }
            }

            /// Those of a set of bits.
            pub fn of(bits: u32) -> impl Iterator<Item = $name> {
                $name::ALL.iter().map(|(_, field)| *field).filter(move |field| bits & field.bit() != 0)
            }
        }
    };
}

fields! {
    /// What a rangefinder can return of a ray, in this order.
    RayField {
        /// Distance to what is met, m; -1: nothing is.
        Dist = "dist" 1,
        /// Direction of the ray; zero where nothing is met.
        Dir = "dir" 3,
        /// Where it starts, m.
        Origin = "origin" 3,
        /// What it meets, m; zero where that is nothing.
        Point = "point" 3,
        /// Normal of the surface there; likewise.
        Normal = "normal" 3,
        /// Distance along the axis of sight, m; -1: nothing is met.
        Depth = "depth" 1,
    }
}

fields! {
    /// What a contact sensor can return of a contact, in this order. Vectors but for the position are seen in the contact's frame, which
    /// points from the first side to the second.
    ContactField {
        /// Number of contacts that match, whether they are returned or not; 0 of a place that is left over.
        Found = "found" 1,
        /// Force on the second side, N.
        Force = "force" 3,
        /// Torque on it, N m.
        Torque = "torque" 3,
        /// Distance, m, negative when penetrating.
        Dist = "dist" 1,
        /// Position in the world, m.
        Pos = "pos" 3,
        /// Normal, world axes.
        Normal = "normal" 3,
        /// First tangent, world axes.
        Tangent = "tangent" 3,
        /// Velocity of the second side's point relative to the first's, m/s.
        LinVel = "linvel" 3,
        /// Angular velocity of the second side relative to the first, rad/s.
        AngVel = "angvel" 3,
    }
}

/// Which of the contacts that match a contact sensor returns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Reduce {
    /// The first ones.
    #[default]
    None,
    /// Those of least distance.
    MinDist,
    /// Those of the largest force.
    MaxForce,
    /// One in their place: the sum of their forces in world axes, where they act on average.
    NetForce,
}

/// The geoms on one side of a contact that a sensor is about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Side {
    /// The only geom; [`NONE`](super::NONE): any of the bodies.
    pub geom: u32,
    /// MJCF bodies.
    pub bodies: Span,
}

impl Side {
    /// Whether a geom of a body is one of these.
    pub fn has(self, geom: u32, body: u32) -> bool {
        (self.geom == super::NONE || self.geom == geom) && self.bodies.range().contains(&(body as usize))
    }
}

table! {
    /// A ray of a sensor, in the axes of its frame.
    pub struct Ray {
        real:
        /// Where it starts.
        pub pos: [T; 3],
        /// Unit vector.
        pub dir: [T; 3],
        /// How much of a distance along it is depth.
        pub depth: T,
    } T
}

/// Triangles that rays can meet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// Corners.
    pub vertices: Vec<[f64; 3]>,
    /// Three corners each, counterclockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
}

table! {
    /// A geom that rays can meet, or that has a distance from others.
    pub struct Target {
        /// MJCF body that it belongs to.
        pub body: u32,
        /// Its frame, in [`Model::mounts`](super::Model::mounts).
        pub mount: u32,
        /// Shape.
        pub shape: Shape,
        /// Of a mesh, its place among [`Model::surfaces`](super::Model::surfaces), of a height field among
        /// [`Model::heights`](super::Model::heights); else [`NONE`](super::NONE).
        pub surface: u32,
        /// Of a mesh whose distance is measured, its place among [`Model::hulls`](super::Model::hulls); else [`NONE`](super::NONE).
        pub hull: u32,
        /// Whether rays meet it.
        pub seen: bool,
        real:
        /// Sizes.
        pub size: [T; 3],
    } T
}
