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
    /// Distance along a site's z axis to the nearest geom of another body, m; -1: there is none.
    Rangefinder = 7 "rangefinder";
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
        use SensorKind::{Force, Torque, Touch};
        matches!(self, Touch | Force | Torque) || self.of_limit().is_some()
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
        /// Shape of its site.
        pub shape: Shape,
        real:
        /// Sizes of that.
        pub size: [T; 3],
        /// The bound.
        pub cutoff: T,
    } T
}

table! {
    /// A geom that rays can meet.
    pub struct Target {
        /// MJCF body that it belongs to.
        pub body: u32,
        /// Its frame, in [`Model::mounts`](super::Model::mounts).
        pub mount: u32,
        /// Shape.
        pub shape: Shape,
        real:
        /// Sizes.
        pub size: [T; 3],
    } T
}
