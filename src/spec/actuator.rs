//! Actuators, as they are written.

use super::{History, Source, Tri};

/// What an actuator acts on.
#[derive(Clone, Debug, PartialEq)]
pub enum Transmission {
    /// A joint; for rotations of ball and free joints the gear is in the child's frame.
    Joint(String),
    /// A joint; for rotations of ball and free joints the gear is in the parent's frame.
    JointInParent(String),
    /// A tendon.
    Tendon(String),
    /// A body, towards which it pulls what touches it.
    Body(String),
    /// A site: force and torque in its axes; with a second, in that one's, and lengths are measured from it.
    Site {
        /// Its name.
        site: String,
        /// The site relative to which it is, if any.
        reference: Option<String>,
    },
    /// A slide along a site's z axis, that a rod joins to a crank.
    SliderCrank {
        /// The site on the crank.
        crank: String,
        /// The site on the slide's axis.
        slider: String,
        /// Length of the rod.
        rod: f64,
    },
}

impl Transmission {
    /// The joint that it acts on, if it does.
    pub fn joint(&self) -> Option<&str> {
        match self {
            Transmission::Joint(name) | Transmission::JointInParent(name) => Some(name),
            _ => None,
        }
    }

    /// The tendon that it acts on, if it does.
    pub fn tendon(&self) -> Option<&str> {
        if let Transmission::Tendon(name) = self { Some(name) } else { None }
    }

    /// The body that it acts on, if it does.
    pub fn body(&self) -> Option<&str> {
        if let Transmission::Body(name) = self { Some(name) } else { None }
    }

    /// The sites that it acts on, with the attributes that name them.
    pub(crate) fn sites(&self) -> Vec<(&'static str, &str)> {
        match self {
            Transmission::Site { site, reference } => {
                let second = reference.iter().map(|name| ("refsite", name.as_str()));
                std::iter::once(("site", site.as_str())).chain(second).collect()
            }
            Transmission::SliderCrank { crank, slider, .. } => vec![("cranksite", crank), ("slidersite", slider)],
            _ => Vec::new(),
        }
    }
}

/// How an actuator's gain follows length and velocity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gain {
    /// `prm[0]`.
    Fixed,
    /// `prm[0] + prm[1]·length + prm[2]·velocity`.
    Affine,
    /// That of a muscle: range of its lengths (two), peak force or -1, scale, lmin, lmax, vmax, fpmax, fvmax.
    Muscle,
    /// A controller: what its bias says of length and velocity pulls towards a position and a velocity. `prm[0]` is its force per integral of
    /// the error in position.
    Pid,
    /// A direct-current motor: resistance, torque constant, what resistance gains with temperature and the temperature at which it is told;
    /// then its controller's torque per error in position, per integral of that, per error in velocity, and its largest voltage.
    DcMotor,
    /// A servo on an orientation: torque per angle by which it is not where it is told to be, along the shortest rotation.
    So3,
}

/// What an actuator with several controls is told, in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Input {
    /// A position.
    Pos,
    /// A velocity.
    Vel,
    /// A force that is added; of a motor, a torque.
    FeedForward,
    /// Of a motor, a voltage.
    Voltage,
}

impl Input {
    /// All, with MJCF's words.
    pub const ALL: &[(&str, Input)] =
        &[("pos", Input::Pos), ("vel", Input::Vel), ("ff", Input::FeedForward), ("voltage", Input::Voltage)];
}

/// How an actuator's activation w follows its control u.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dynamics {
    /// It has none: the control acts.
    None,
    /// w' = u.
    Integrator,
    /// w' = (u - w) / `prm[0]`.
    Filter,
    /// The same, integrated exactly.
    FilterExact,
    /// That of a muscle: time constants of activation and deactivation, width over which they are blended.
    Muscle,
    /// That of a controller: bound of the integral of its error, or 0, and of the rate at which its position is followed, or 0.
    Pid,
    /// That of a motor: time constant of the current, bound of its rate, thermal resistance and capacity, temperature of the air, stiffness
    /// and damping of its bristles, bound of the rate at which the first control is followed, and of the integral. What is 0 is not there.
    DcMotor,
}

/// How an actuator's bias follows length and velocity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bias {
    /// 0.
    None,
    /// `prm[0] + prm[1]·length + prm[2]·velocity`.
    Affine,
    /// That of a muscle, with parameters like those of its gain.
    Muscle,
    /// That of a motor: amplitude, periods and phase of what its magnets do; friction of a moving motor, and at rest, and the velocity at which
    /// the latter fades.
    DcMotor,
    /// What a servo on an orientation has beside its gain: `prm[1]` is minus that, `prm[2]` minus torque per angular velocity.
    So3,
}

/// How lengths of muscles are ranged (MJCF `compiler/lengthrange`).
#[derive(Clone, Debug, PartialEq)]
pub struct LengthRange {
    /// Of which actuators.
    pub mode: LengthRangeMode,
    /// Whether ranges that are given are kept.
    pub useexisting: bool,
    /// Whether the limits of joints and tendons are taken for them.
    pub uselimit: bool,
    /// Norm of the acceleration by which the length is pulled.
    pub accel: f64,
    /// Largest norm of the force that does; 0: any.
    pub maxforce: f64,
    /// Time constant by which velocities die out, s.
    pub timeconst: f64,
    /// Time step, s.
    pub timestep: f64,
    /// How long it is pulled, s.
    pub inttotal: f64,
    /// The last part of that, in which lengths are measured, s.
    pub interval: f64,
    /// How far they may differ then, as a share of the range.
    pub tolrange: f64,
}

/// Which actuators need a range of lengths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LengthRangeMode {
    /// None.
    None,
    /// Muscles.
    Muscle,
    /// All.
    All,
}

impl Default for LengthRange {
    fn default() -> Self {
        LengthRange {
            mode: LengthRangeMode::Muscle,
            useexisting: true,
            uselimit: false,
            accel: 20.0,
            maxforce: 0.0,
            timeconst: 1.0,
            timestep: 0.01,
            inttotal: 10.0,
            interval: 2.0,
            tolrange: 0.05,
        }
    }
}

/// An actuator (MJCF `actuator/*`).
#[derive(Clone, Debug)]
pub struct Actuator {
    /// Name, or empty.
    pub name: String,
    /// What it acts on.
    pub transmission: Transmission,
    /// Scales length and force; six components for ball and free joints, and for sites.
    pub gear: [f64; 6],
    /// Gain kind.
    pub gain: Gain,
    /// Gain parameters; what a kind does not use counts for nothing.
    pub gainprm: [f64; 10],
    /// Bias kind.
    pub bias: Bias,
    /// Bias parameters, likewise.
    pub biasprm: [f64; 10],
    /// How its activation follows its control.
    pub dynamics: Dynamics,
    /// Parameters of that, likewise.
    pub dynprm: [f64; 10],
    /// Range of its activation; `None`: not given.
    pub actrange: Option<[f64; 2]>,
    /// Whether that range is in force.
    pub actlimited: Tri,
    /// Whether it acts with the activation that it has at the end of a step.
    pub actearly: bool,
    /// Range of its lengths; `None`: not given.
    pub lengthrange: Option<[f64; 2]>,
    /// Damping ratio from which the velocity gain of a position servo follows; 0: not used.
    pub dampratio: f64,
    /// Control range as a multiple of the joint's range, or that of the activation if it integrates; 0: not used.
    pub inheritrange: f64,
    /// Control range; `None`: not given.
    pub ctrlrange: Option<[f64; 2]>,
    /// Whether the control range is in force.
    pub ctrllimited: Tri,
    /// Force range; `None`: not given.
    pub forcerange: Option<[f64; 2]>,
    /// Whether the force range is in force.
    pub forcelimited: Tri,
    /// Damping of the actuated joint, reflected through the gear squared: polynomial coefficients.
    pub damping: [f64; 3],
    /// Inertia added to the actuated joint, reflected through the gear squared.
    pub armature: f64,
    /// Of a servo on an orientation, whether it is told a quaternion, and no rotation vector.
    pub quaternion: bool,
    /// What it is told: of a controller any of the first three, of a motor any. Others have one control, whatever is here.
    pub inputs: Vec<Input>,
    /// Ranges of a controller's velocity and force; the control range is that of its position.
    pub velrange: Option<[f64; 2]>,
    /// The latter.
    pub ffrange: Option<[f64; 2]>,
    /// Samples that are kept of its controls.
    pub history: History,
    /// Group, for `actuatorgroupdisable`.
    pub group: i32,
    /// Where it was written.
    pub source: Source,
}

impl Default for Actuator {
    fn default() -> Self {
        Actuator {
            name: String::new(),
            transmission: Transmission::Joint(String::new()),
            gear: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            gain: Gain::Fixed,
            gainprm: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            bias: Bias::None,
            biasprm: [0.0; 10],
            dynamics: Dynamics::None,
            dynprm: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            actrange: None,
            actlimited: Tri::Auto,
            actearly: false,
            lengthrange: None,
            dampratio: 0.0,
            inheritrange: 0.0,
            ctrlrange: None,
            ctrllimited: Tri::Auto,
            forcerange: None,
            forcelimited: Tri::Auto,
            damping: [0.0; 3],
            armature: 0.0,
            quaternion: false,
            inputs: Vec::new(),
            velrange: None,
            ffrange: None,
            history: History::default(),
            group: 0,
            source: Source::default(),
        }
    }
}

impl Actuator {
    /// Number of its controls.
    pub fn controls(&self) -> usize {
        match self.gain {
            Gain::Pid | Gain::DcMotor => self.inputs.len(),
            Gain::So3 if self.quaternion => 4,
            Gain::So3 => 3,
            _ => 1,
        }
    }

    /// Number of its forces.
    pub fn outputs(&self) -> usize {
        if self.gain == Gain::So3 { 3 } else { 1 }
    }

    /// Whether each of what may be activations is one: of a controller, what follows the first control, and the integral; of a motor then
    /// temperature, bristles and current.
    pub(crate) fn states(&self) -> [bool; 5] {
        let [gain, dynamics] = [&self.gainprm, &self.dynprm];
        match self.dynamics {
            Dynamics::None => [false; 5],
            Dynamics::Pid => [dynamics[1] > 0.0, gain[0] != 0.0, false, false, false],
            Dynamics::DcMotor => {
                [dynamics[7] > 0.0, gain[5] > 0.0, dynamics[2] > 0.0, dynamics[5] > 0.0, dynamics[0] > 0.0]
            }
            _ if self.gain == Gain::So3 => [true, true, true, false, false],
            _ => [true, false, false, false, false],
        }
    }

    /// Number of its activations.
    pub fn activations(&self) -> usize {
        self.states().into_iter().filter(|is| *is).count()
    }
}
