//! One table entry per actuator of the model, and per frame, dof and muscle of one.

use super::cast::{Cast, Representable, table};
use super::{NONE, Span};
use crate::lane::Real;

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
    /// A site: force and torque in its axes, and no length.
    Site,
    /// A site relative to another, in whose axes force and torque are, and lengths that are measured from it.
    Relative,
    /// A tendon: length is gear·length.
    Tendon,
    /// A slide along the second site's z axis, on a crank's end at the first by a rod of [`Actuator::rod`].
    SliderCrank,
    /// A body: what touches it is pulled towards it.
    Body,
    /// Of an orientation servo on a ball joint, what turns it about one of the child's axes: length is the rotation vector's component.
    Turn,
    /// The same of a site relative to another, about one of its own axes.
    TurnBetween,
}

table! {
    /// A frame that is fixed to a link: on which an actuator acts, or that a sensor is about.
    pub struct Mount {
        /// Link that carries it, or [`NONE`]: it stands still.
        pub link: u32,
        real:
        /// Position in the link's frame, or in the world.
        pub pos: [T; 3],
        /// Orientation, row-major, likewise.
        pub rot: [T; 9],
        /// The same as a quaternion.
        pub quat: [T; 4],
    } T
}

/// One degree of freedom on which an actuator acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MomentDof {
    /// Degree of freedom.
    pub dof: u32,
    /// Which of the actuator's mounts it moves.
    pub moves: [bool; 2],
}

/// How an actuator's activation w follows its control u.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dynamics {
    /// There is none: the control acts.
    None,
    /// w' = u.
    Integrator,
    /// w' = (u - w) / τ.
    Filter,
    /// That of a muscle, which is quicker to tense than to relax.
    Muscle,
}

table! {
    /// What a muscle does: its force by length and velocity. Lengths are counted in the muscle's own, in which it is strongest at 1.
    pub struct Muscle {
        real:
        /// Actuator's length at which the muscle's is `low`.
        pub start: T,
        /// The muscle's length at `start`.
        pub low: T,
        /// Muscle's length per actuator's.
        pub scale: T,
        /// Velocity, in units of the largest, per actuator's.
        pub speed: T,
        /// Peak force.
        pub force: T,
        /// Shortest and longest length at which it pulls.
        pub reach: [T; 2],
        /// Lengths between these and 1, where the arcs of the curve meet.
        pub knees: [T; 2],
        /// Reciprocals of the arcs' widths, from the shortest length on.
        pub arcs: [T; 4],
        /// Force at the largest lengthening velocity, as a share of the peak.
        pub fvmax: T,
        /// Passive force at `reach[1]`, likewise.
        pub fpmax: T,
    } T
}

table! {
    /// A number by which an actuator is told what to do.
    pub struct Control {
        /// Its actuator.
        pub actuator: u32,
        /// Whether it is clamped.
        pub limited: bool,
        real:
        /// Bounds.
        pub range: [T; 2],
    } T
}

table! {
    /// What an actuator does with several controls, of which any may be missing: it pulls towards a position and a velocity.
    pub struct Controller {
        /// The controls that are its position, its velocity, and a force (of a motor, torque) that is added, or [`NONE`].
        pub inputs: [u32; 3],
        /// The activation that follows the first of these at a bounded rate, or [`NONE`].
        pub slew: u32,
        /// The activation that is the integral of the error in position, or [`NONE`].
        pub integral: u32,
        /// Whether that is bounded.
        pub winds: bool,
        real:
        /// How far the first control is followed in a step.
        pub slew_step: T,
        /// The same in a unit of time.
        pub slew_rate: T,
        /// Bound of the integral.
        pub windup: T,
        /// Force per integral.
        pub ki: T,
        /// Of a motor, torque per error in position, and in velocity; other actuators pull by their bias.
        pub gains: [T; 2],
    } T
}

table! {
    /// A direct-current motor: its current follows the voltage, from its controller, if it has one, and from a control.
    pub struct Motor {
        /// The control that is a voltage, or [`NONE`].
        pub voltage: u32,
        /// The activation that is how much warmer than the air its winding is, or [`NONE`].
        pub temperature: u32,
        /// The activation that is how far the bristles of its friction are bent, or [`NONE`].
        pub bristle: u32,
        /// The activation that is its current, or [`NONE`].
        pub current: u32,
        /// Whether the controller's voltage is bounded.
        pub saturates: bool,
        /// Whether the current's rate is.
        pub rises: bool,
        /// Whether its magnets pull it to certain angles.
        pub cogs: bool,
        real:
        /// Resistance, ohm.
        pub resistance: T,
        /// Torque per current, voltage per velocity.
        pub constant: T,
        /// What resistance gains with temperature, per kelvin, and how warm the air is beyond where the resistance is told.
        pub warming: [T; 2],
        /// Temperature per energy, K/J, and the share of it that is lost in a unit of time.
        pub heating: [T; 2],
        /// Bound of the controller's voltage.
        pub most_voltage: T,
        /// Reciprocal of the time constant of the current, and what the current gains in a step per unit of its rate.
        pub electric: [T; 2],
        /// Bound of the current's rate.
        pub most_rise: T,
        /// Torque of the magnets: amplitude, periods per length, phase.
        pub cogging: [T; 3],
        /// Stiffness and damping of bristles.
        pub bristles: [T; 2],
        /// Friction of a moving motor, what it has more at rest, and the reciprocal of the velocity at which that fades.
        pub friction: [T; 3],
    } T
}

table! {
    /// A servo on an orientation: three actuators, one for each axis, that are told together where to turn.
    pub struct Servo {
        /// The first of them.
        pub first: u32,
        /// The first of its controls: a rotation vector, or a quaternion.
        pub ctrl: u32,
        /// Whether it is a quaternion.
        pub quaternion: bool,
        /// Whether its torque is bounded.
        pub bounded: bool,
        real:
        /// Largest torque, whatever its direction.
        pub most: T,
    } T
}

table! {
    /// An actuator, or one of the three of a servo: force = gain·control + bias, or gain·activation + bias.
    pub struct Actuator {
        /// What it acts on.
        pub transmission: Transmission,
        /// Joint, or [`NONE`].
        pub joint: u32,
        /// Tendon, or [`NONE`].
        pub tendon: u32,
        /// MJCF body, or [`NONE`].
        pub body: u32,
        /// First position of the joint.
        pub qpos: u32,
        /// Its frames: of a site one, of two sites two, in [`Model::mounts`].
        pub mounts: Span,
        /// Its moments, one for each degree of freedom on which it acts: these are in [`Model::moment_dofs`], ascending.
        pub moments: Span,
        /// Of two sites, whether the gear has a rotation.
        pub turns: bool,
        /// Whether the gain depends on length or velocity.
        pub gain_affine: bool,
        /// Whether there is a bias.
        pub bias_affine: bool,
        /// Its control, in [`Model::controls`](super::Model::controls); of several the first.
        pub ctrl: u32,
        /// What it does with several, in [`Model::controllers`](super::Model::controllers), or [`NONE`].
        pub controller: u32,
        /// MuJoCo's number of it.
        pub id: u32,
        /// The servo whose it is, in [`Model::servos`](super::Model::servos), or [`NONE`].
        pub servo: u32,
        /// What it is if it is a motor, in [`Model::motors`](super::Model::motors), or [`NONE`].
        pub motor: u32,
        /// Whether the force is clamped.
        pub force_limited: bool,
        /// Whether its group is disabled: no force.
        pub disabled: bool,
        /// Whether a setpoint is a rotation, and as good a turn further.
        pub turning: bool,
        /// How its activation follows its control.
        pub dynamics: Dynamics,
        /// Its activation, or [`NONE`].
        pub act: u32,
        /// Whether the activation is clamped.
        pub act_limited: bool,
        /// Whether it acts with the activation that it has at the end of the step.
        pub early: bool,
        /// Whether a muscle's activation blends its two time constants.
        pub smooth: bool,
        /// Of muscles, what their gain is, in [`Model::muscles`], or [`NONE`].
        pub muscle_gain: u32,
        /// The same of the bias.
        pub muscle_bias: u32,
        real:
        /// Gear.
        pub gear: [T; 6],
        /// Length of a crank's rod.
        pub rod: T,
        /// Gain: constant, per length, per velocity.
        pub gain: [T; 3],
        /// Bias: constant, per length, per velocity.
        pub bias: [T; 3],
        /// Bounds of the force.
        pub force_range: [T; 2],
        /// Of a filter, 1/τ; of a muscle, its time constants of activation and deactivation, and the reciprocal of the width over
        /// which these are blended.
        pub times: [T; 3],
        /// What an activation gains in a step, per unit of its rate.
        pub reach: T,
        /// Bounds of the activation.
        pub act_range: [T; 2],
    } T
}

impl<T> Actuator<T> {
    /// Whether its force is none that grows in proportion to length and velocity.
    fn is_nonlinear(&self) -> bool {
        self.muscle_gain != NONE || self.muscle_bias != NONE || self.motor != NONE
    }

    /// Whether its force may follow its length or its velocity.
    pub fn follows(&self) -> bool {
        !self.disabled && (self.gain_affine || self.bias_affine || self.is_nonlinear())
    }
}
