//! Sensors.

pub use lanesim_kernels::model::{ContactField, RayField, Reduce, SensorKind};

use super::{History, Source};

/// The kind of an element that a sensor is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ObjectKind {
    /// A body's inertial frame.
    Body,
    /// A body's own frame; of a contact sensor, the body and all that it carries.
    XBody,
    /// A joint.
    Joint,
    /// A geom.
    Geom,
    /// A site.
    Site,
    /// A camera.
    Camera,
    /// A tendon.
    Tendon,
    /// An actuator.
    Actuator,
}

/// An element that a sensor is about.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Object {
    /// What it is.
    pub kind: ObjectKind,
    /// Its name.
    pub name: String,
}

/// When the numbers of a user's sensor can be computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NeedStage {
    /// From positions.
    Pos,
    /// From velocities.
    Vel,
    /// From accelerations.
    #[default]
    Acc,
}

/// What the numbers of a user's sensor are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DataType {
    /// Any numbers.
    #[default]
    Real,
    /// Numbers that are not negative.
    Positive,
    /// A unit vector.
    Axis,
    /// A unit quaternion.
    Quaternion,
}

/// What a contact sensor returns of which contacts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Contacts {
    /// What of each, in the order of [`ContactField::ALL`]; empty: how many are found.
    pub fields: Vec<ContactField>,
    /// Which of those that match.
    pub reduce: Reduce,
    /// How many at most.
    pub num: usize,
}

impl Default for Contacts {
    fn default() -> Self {
        Contacts { fields: Vec::new(), reduce: Reduce::None, num: 1 }
    }
}

impl Contacts {
    /// What of each, as bits.
    fn bits(&self) -> u32 {
        let bits = self.fields.iter().map(|field| field.bit()).sum();
        if bits == 0 { ContactField::Found.bit() } else { bits }
    }

    /// Number of numbers, what they are, and the stage by which they are known.
    fn shape(&self) -> (usize, DataType, NeedStage) {
        use ContactField::{AngVel, Force, LinVel, Torque};
        let fields = || ContactField::of(self.bits());
        let stage = if matches!(self.reduce, Reduce::MaxForce | Reduce::NetForce)
            || fields().any(|field| matches!(field, Force | Torque))
        {
            NeedStage::Acc
        } else if fields().any(|field| matches!(field, LinVel | AngVel)) {
            NeedStage::Vel
        } else {
            NeedStage::Pos
        };
        let width: usize = fields().map(ContactField::width).sum();
        (width.saturating_mul(self.num), DataType::Real, stage)
    }
}

/// A sensor (MJCF `sensor`).
#[derive(Clone, Debug)]
pub struct Sensor {
    /// Name, or empty.
    pub name: String,
    /// What it measures.
    pub kind: SensorKind,
    /// The element that it is about; none for energies, the clock and user sensors that name none.
    pub object: Option<Object>,
    /// The element in whose frame it is seen, or what is on the other side of a distance or contact; for [`SensorKind::InsideSite`], the site; for [`SensorKind::CamProjection`], the camera.
    pub reference: Option<Object>,
    /// Bound of its numbers; 0: none.
    pub cutoff: f64,
    /// Standard deviation of its noise, for whoever adds noise.
    pub noise: f64,
    /// Samples that are kept of its numbers.
    pub history: History,
    /// What it returns of each ray; only of [`SensorKind::Rangefinder`]. Empty: distances.
    pub fields: Vec<RayField>,
    /// What it returns of which contacts; only of [`SensorKind::Contact`].
    pub contacts: Contacts,
    /// Number of numbers, what they are, and when they can be computed; only of [`SensorKind::User`].
    pub user: (usize, DataType, NeedStage),
    /// Where it was written.
    pub source: Source,
}

impl Default for Sensor {
    fn default() -> Self {
        Sensor {
            name: String::new(),
            kind: SensorKind::Clock,
            object: None,
            reference: None,
            cutoff: 0.0,
            noise: 0.0,
            history: History::default(),
            fields: Vec::new(),
            contacts: Contacts::default(),
            user: Default::default(),
            source: Source::default(),
        }
    }
}

impl Sensor {
    /// What it returns of each ray or contact, as bits.
    pub(crate) fn bits(&self) -> u32 {
        if self.kind == SensorKind::Contact {
            return self.contacts.bits();
        }
        let bits = self.fields.iter().map(|field| field.bit()).sum();
        if self.kind == SensorKind::Rangefinder && bits == 0 { RayField::Dist.bit() } else { bits }
    }

    /// Number of numbers (of a rangefinder, of each ray), what they are, and the stage by which they are known.
    pub fn shape(&self) -> (usize, DataType, NeedStage) {
        use DataType::{Axis, Positive, Quaternion, Real};
        use NeedStage::{Acc, Pos, Vel};
        use SensorKind as Kind;
        match self.kind {
            Kind::Touch => (1, Positive, Acc),
            Kind::Accelerometer | Kind::Force | Kind::Torque | Kind::FrameLinAcc | Kind::FrameAngAcc => (3, Real, Acc),
            Kind::Velocimeter | Kind::Gyro | Kind::FrameLinVel | Kind::FrameAngVel | Kind::BallAngVel => (3, Real, Vel),
            Kind::SubtreeLinVel | Kind::SubtreeAngMom => (3, Real, Vel),
            Kind::Magnetometer | Kind::FramePos | Kind::SubtreeCom => (3, Real, Pos),
            Kind::FrameQuat | Kind::BallQuat => (4, Quaternion, Pos),
            Kind::FrameXAxis | Kind::FrameYAxis | Kind::FrameZAxis => (3, Axis, Pos),
            Kind::InsideSite => (1, Positive, Pos),
            Kind::JointVel | Kind::TendonVel | Kind::ActuatorVel => (1, Real, Vel),
            Kind::JointLimitVel | Kind::TendonLimitVel => (1, Real, Vel),
            Kind::ActuatorFrc | Kind::JointActuatorFrc | Kind::TendonActuatorFrc => (1, Real, Acc),
            Kind::JointLimitFrc | Kind::TendonLimitFrc => (1, Real, Acc),
            Kind::CamProjection => (2, Real, Pos),
            Kind::Rangefinder => (RayField::of(self.bits()).map(RayField::width).sum(), Real, Pos),
            Kind::JointPos | Kind::TendonPos | Kind::ActuatorPos => (1, Real, Pos),
            Kind::GeomDist => (1, Real, Pos),
            Kind::GeomNormal => (3, Axis, Pos),
            Kind::GeomFromTo => (6, Real, Pos),
            Kind::Contact => self.contacts.shape(),
            Kind::JointLimitPos | Kind::TendonLimitPos => (1, Real, Pos),
            Kind::EPotential | Kind::EKinetic | Kind::Clock => (1, Real, Pos),
            Kind::User => self.user,
        }
    }
}
