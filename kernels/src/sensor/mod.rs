//! Sensors: what a model measures of itself. Nothing depends on them, so they are found only when somebody asks.
//!
//! Measures that follow from states, motions and actuators are a part ([`measure`]); those of rows, whose list differs from block
//! to block, come after it ([`measure_rows`]).

mod contact;
mod frame;
mod ground;
mod load;
mod range;
mod ray;
mod rows;
mod space;
mod subtree;
mod tendons;

use std::ops::Deref;

pub use tendons::{Push, pushes};

use crate::actuation::Actuation;
use crate::collision::{Collision, ConvexCollider};
use crate::constraint::Constraint;
use crate::energy::{self, Energy};
use crate::fields::fields;
use crate::inertia::Inertia;
use crate::lane::{Lane, LaneQuery};
use crate::math::quat;
use crate::math::vec3::{Vec3, add, column, cross, mul_t, scale_add, splat, sub, zero};
use crate::model::{Bound, Instance, NONE, Sensor, SensorKind};
use crate::position::{Position, orientation};
use crate::solver::SolverWork;
use crate::state::{Applied, State};
use crate::tendon::Tendons;
use crate::velocity::Velocity;
use frame::Frame;

fields! {
    /// What sensors measure.
    pub struct Sensors(sizes) {
        /// Measures, sensor by sensor.
        pub data: Vec<L> = sizes.nsensordata,
        /// The same before any of it is told late; of models whose sensors have histories.
        pub measured: Vec<L> = sizes.nmeasured,
        /// By what the contacts of a sensor are sorted, one number of each of its places.
        pub keys: Vec<L> = sizes.nsensorkey,
        /// Acceleration of each link (angular, linear) at its tree's origin, that of gravity upwards in it; of models that measure
        /// accelerations.
        pub cacc: Vec<[L; 6]> = sizes.nsensoracc,
        /// Orientation of each link as a quaternion; of models that measure orientations, or torques beside welds.
        pub quat: Vec<[L; 4]> = sizes.nsensorquat,
    } L
}

/// Most numbers of a measure that does not follow from rows.
const MOST: usize = 4;

/// The stages that sensors read.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)] // each field is the stage of the same name
pub struct Stages<'a, L: Lane> {
    pub position: &'a Position<L>,
    pub tendons: &'a Tendons<L>,
    pub inertia: &'a Inertia<L>,
    pub velocity: &'a Velocity<L>,
    pub actuation: &'a Actuation<L>,
    pub collision: &'a Collision<L>,
    pub constraint: &'a Constraint<L>,
    pub solver: &'a SolverWork<L>,
}

/// The same, and what was found of links on the way.
struct Seen<'a, L: Lane> {
    stages: Stages<'a, L>,
    energy: &'a Energy<L>,
    /// Where springs rest that yield.
    plastic: &'a [L],
    cacc: &'a [[L; 6]],
    quat: &'a [[L; 4]],
}

impl<'a, L: Lane> Deref for Seen<'a, L> {
    type Target = Stages<'a, L>;
    fn deref(&self) -> &Stages<'a, L> {
        &self.stages
    }
}

/// Finds all measures but those that follow from rows.
pub fn measure<L: Lane>(
    model: Instance<'_, L>,
    state: &State<L>,
    stages: Stages<'_, L>,
    energy: &mut Energy<L>,
    sensors: &mut Sensors<L>,
) {
    let Stages { position, tendons, inertia, velocity, solver, .. } = stages;
    if model.sensors.iter().any(|sensor| sensor.kind.of_energy()) {
        energy::energy(model, energy::Stages { position, tendons, inertia }, state, energy);
    }
    let Sensors { data, cacc, quat, .. } = sensors;
    accelerate(model, &velocity.cacc, (&position.cdof, &solver.fields.qacc), cacc);
    if !quat.is_empty() {
        orientation::quaternions(&model, state.into(), 0..model.links.len() as u32, quat);
    }
    let seen = Seen { stages, energy, plastic: &state.plastic, cacc, quat };
    for sensor in model.sensors.iter().filter(|sensor| !model.apart(sensor)) {
        match sensor.kind {
            SensorKind::Rangefinder => range(model, sensor, &seen, &|_| true, data),
            _ => put(sensor, &value(model, sensor, state, &seen), data),
        }
    }
}

/// Finds what the rays of a rangefinder meet.
fn range<L: Lane>(
    model: Instance<'_, L>,
    sensor: &Sensor<L::Real>,
    seen: &Seen<'_, L>,
    any: ground::Any<'_, L::Mask>,
    data: &mut [L],
) {
    let mut out = data[sensor.data.range()].iter_mut();
    range::measure(model, seen.position, sensor, any, |x| {
        if let Some(out) = out.next() {
            *out = bounded(sensor, x);
        }
    });
}

/// Finds the measures that are found apart, after the others. Forces of rows are kept by the solver.
pub fn measure_rows<L: LaneQuery>(
    model: Instance<'_, L>,
    state: &State<L>,
    applied: Option<&Applied<L>>,
    convex: &dyn ConvexCollider,
    (stages, energy): (Stages<'_, L>, &Energy<L>),
    sensors: &mut Sensors<L>,
) {
    use SensorKind as Kind;
    let Sensors { data, keys, cacc, quat, .. } = sensors;
    let seen = Seen { stages, energy, plastic: &state.plastic, cacc, quat };
    for sensor in model.sensors.iter().filter(|sensor| model.apart(sensor)) {
        let value = match sensor.kind {
            Kind::Rangefinder => {
                range(model, sensor, &seen, &L::any, data);
                continue;
            }
            Kind::Contact => {
                contact::measure(model, sensor, &seen, keys, &mut data[sensor.data.range()]);
                continue;
            }
            kind if kind.of_space() => {
                let way = space::way(model, stages.position, sensor, convex);
                put(sensor, &space::numbers(kind, &way), data);
                continue;
            }
            Kind::Touch => [load::touch(model, sensor, &seen), L::zero(), L::zero()],
            Kind::Torque => load::load(model, sensor, applied, &seen)[0],
            Kind::Force => load::load(model, sensor, applied, &seen)[1],
            _ => [load::limit(sensor, &state.qvel, &seen), L::zero(), L::zero()],
        };
        put(sensor, &value, data);
    }
}

/// Writes a measure, cut off.
#[inline(always)]
fn put<L: Lane>(sensor: &Sensor<L::Real>, value: &[L], data: &mut [L]) {
    for (out, x) in data[sensor.data.range()].iter_mut().zip(value) {
        *out = bounded(sensor, *x);
    }
}

/// A number of a sensor, cut off.
#[inline(always)]
fn bounded<L: Lane>(sensor: &Sensor<L::Real>, x: L) -> L {
    let most = L::splat(sensor.cutoff);
    match sensor.bound {
        Bound::None => x,
        Bound::Above => x.min(most),
        Bound::Both => x.clamp(-most, most),
    }
}

/// Accelerations of links: those with no acceleration of the joints, and what these add.
fn accelerate<L: Lane>(model: Instance<'_, L>, bias: &[[L; 6]], (axes, qacc): (&[[L; 6]], &[L]), out: &mut [[L; 6]]) {
    if out.is_empty() {
        return;
    }
    for (l, link) in model.links.iter().enumerate() {
        let mut added = match link.parent {
            NONE => zero(),
            parent => sub(&out[parent as usize], &bias[parent as usize]),
        };
        for dof in link.dofs.range() {
            added = scale_add(qacc[dof], &axes[dof], &added);
        }
        out[l] = add(&bias[l], &added);
    }
}

/// What a sensor measures.
#[inline(always)]
fn value<L: Lane>(model: Instance<'_, L>, sensor: &Sensor<L::Real>, state: &State<L>, seen: &Seen<'_, L>) -> [L; MOST] {
    use SensorKind as Kind;
    let Seen { stages: Stages { position, tendons, actuation, .. }, energy, .. } = seen;
    let id = sensor.id as usize;
    let one = |x: L| [x, L::zero(), L::zero(), L::zero()];
    let three = |[x, y, z]: Vec3<L>| [x, y, z, L::zero()];
    let some = |all: &[L]| [0, 1, 2, 3].map(|k: usize| all.get(k).copied().unwrap_or(L::zero()));
    let frame = || Frame::new(&model, position, sensor.mount);
    let reference = || (sensor.reference != NONE).then(|| Frame::new(&model, position, sensor.reference));
    match sensor.kind {
        Kind::JointPos => one(state.qpos[id]),
        Kind::JointVel => one(state.qvel[id]),
        Kind::TendonPos => one(tendons.length[id]),
        Kind::TendonVel => one(tendons.velocity[id]),
        Kind::TendonActuatorFrc => {
            let pulling =
                model.actuators.iter().zip(&actuation.force).filter(|(actuator, _)| actuator.tendon == sensor.id);
            one(pulling.fold(L::zero(), |sum, (_, force)| sum + *force))
        }
        Kind::ActuatorPos => some(&actuation.length[id..]),
        Kind::ActuatorVel => some(&actuation.velocity[id..]),
        Kind::ActuatorFrc => some(&actuation.force[id..]),
        // A model without actuators has no such forces.
        Kind::JointActuatorFrc => one(actuation.qfrc_actuator.get(id).copied().unwrap_or(L::zero())),
        Kind::BallQuat => {
            let q = &state.qpos[id..];
            quat::unit(&[q[0], q[1], q[2], q[3]])
        }
        Kind::BallAngVel => three([state.qvel[id], state.qvel[id + 1], state.qvel[id + 2]]),
        Kind::Clock => one(state.time[0]),
        Kind::EPotential => one(energy.potential[0]),
        Kind::EKinetic => one(energy.kinetic[0]),
        Kind::Magnetometer => {
            let field = model.options.magnetic.map(L::of);
            three(mul_t(&frame().rot, &field))
        }
        Kind::InsideSite => {
            let site = Frame::new(&model, position, sensor.reference);
            let at = mul_t(&site.rot, &frame().from(&site));
            one(L::select(ray::inside(sensor.shape, &splat(&sensor.size), &at), L::one(), L::zero()))
        }
        Kind::CamProjection => {
            let [x, y] = range::project(sensor, &Frame::new(&model, position, sensor.reference), &frame());
            [x, y, L::zero(), L::zero()]
        }
        Kind::SubtreeCom => three(subtree::centre(model, position, sensor.bodies)),
        Kind::SubtreeLinVel => three(subtree::velocity(model, seen, sensor.bodies)),
        Kind::SubtreeAngMom => three(subtree::momentum(model, seen, sensor.bodies)),
        Kind::FrameQuat => frame_quat(model, sensor, seen),
        Kind::Gyro => three(mul_t(&frame().rot, &frame().velocity(seen)[0])),
        Kind::Velocimeter => three(mul_t(&frame().rot, &frame().velocity(seen)[1])),
        Kind::Accelerometer => three(mul_t(&frame().rot, &frame().acceleration(model, seen)[1])),
        Kind::FramePos => three(match reference() {
            Some(reference) => mul_t(&reference.rot, &frame().from(&reference)),
            None => add(&frame().origin, &frame().pos),
        }),
        Kind::FrameXAxis | Kind::FrameYAxis | Kind::FrameZAxis => {
            let axis = column(&frame().rot, sensor.kind as usize - Kind::FrameXAxis as usize);
            three(in_axes(reference(), axis))
        }
        Kind::FrameLinVel => three(match reference() {
            Some(reference) => {
                let ([_, v], [turn, shift]) = (frame().velocity(seen), reference.velocity(seen));
                let carried = add(&shift, &cross(&turn, &frame().from(&reference)));
                mul_t(&reference.rot, &sub(&v, &carried))
            }
            None => frame().velocity(seen)[1],
        }),
        Kind::FrameAngVel => three(match reference() {
            Some(reference) => mul_t(&reference.rot, &sub(&frame().velocity(seen)[0], &reference.velocity(seen)[0])),
            None => frame().velocity(seen)[0],
        }),
        Kind::FrameLinAcc => three(frame().acceleration(model, seen)[1]),
        Kind::FrameAngAcc => three(frame().acceleration(model, seen)[0]),
        // Nobody computes them.
        Kind::User => zero(),
        // Those are found apart.
        Kind::GeomDist | Kind::GeomNormal | Kind::GeomFromTo | Kind::Contact => zero(),
        Kind::Rangefinder | Kind::Touch | Kind::Force | Kind::Torque => zero(),
        Kind::JointLimitPos | Kind::JointLimitVel | Kind::JointLimitFrc => zero(),
        Kind::TendonLimitPos | Kind::TendonLimitVel | Kind::TendonLimitFrc => zero(),
    }
}

/// A direction in the axes of a reference frame, or of the world.
#[inline(always)]
fn in_axes<L: Lane>(reference: Option<Frame<L>>, axis: Vec3<L>) -> Vec3<L> {
    reference.map_or(axis, |reference| mul_t(&reference.rot, &axis))
}

/// Orientation of a frame, in a reference frame if there is one.
#[inline(always)]
fn frame_quat<L: Lane>(model: Instance<'_, L>, sensor: &Sensor<L::Real>, seen: &Seen<'_, L>) -> [L; 4] {
    let of = |mount: u32| {
        let mount = &model.mounts[mount as usize];
        let own = splat(&mount.quat);
        if mount.link == NONE { own } else { quat::mul(&seen.quat[mount.link as usize], &own) }
    };
    let turn = match sensor.reference {
        NONE => of(sensor.mount),
        reference => quat::mul(&quat::conjugate(&of(reference)), &of(sensor.mount)),
    };
    quat::unit(&turn)
}
