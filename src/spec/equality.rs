//! Equality constraints.

use super::{SOLIMP, SOLREF, Source};

/// What an equality constraint holds.
#[derive(Clone, Debug, PartialEq)]
pub enum Held {
    /// A point of one body on that point of another with which it coincides in the reference configuration.
    Points {
        /// Names of the bodies; an empty second one is the world.
        bodies: [String; 2],
        /// The point in the first body's frame.
        anchor: [f64; 3],
    },
    /// A site on another's position.
    Sites([String; 2]),
    /// A frame of one body on a frame of another.
    Frames {
        /// Names of the bodies; an empty second one is the world.
        bodies: [String; 2],
        /// The point, in the second body's frame, at which positions are compared.
        anchor: [f64; 3],
        /// Pose of the second body in the first's frame, to be held: position, quaternion. `None`: as in the reference
        /// configuration.
        relpose: Option<([f64; 3], [f64; 4])>,
        /// Length that stands for a radian: how much orientation counts.
        torquescale: f64,
    },
    /// A site on another's position and orientation.
    SiteFrames {
        /// Names of the sites.
        sites: [String; 2],
        /// Length that stands for a radian.
        torquescale: f64,
    },
    /// The position y of a joint, a hinge or a slide, at a polynomial of another's: y - y₀ = Σ aₖ (x - x₀)ᵏ, both counted from
    /// the reference configuration.
    Joints {
        /// Names of the joints; without a second one, the first is held at y₀ + a₀.
        joints: [String; 2],
        /// Coefficients, the constant first.
        polycoef: [f64; 5],
    },
    /// The same of the lengths of tendons.
    Tendons {
        /// Names of the tendons; without a second one, the first is held at y₀ + a₀.
        tendons: [String; 2],
        /// Coefficients, the constant first.
        polycoef: [f64; 5],
    },
}

/// An equality constraint (MJCF `equality/connect`, `weld`, `joint`, `tendon`).
#[derive(Clone, Debug)]
pub struct Equality {
    /// Name, or empty.
    pub name: String,
    /// What it holds.
    pub held: Held,
    /// Whether it acts until a world says otherwise.
    pub active: bool,
    /// Reference parameters.
    pub solref: [f64; 2],
    /// Impedance parameters.
    pub solimp: [f64; 5],
    /// Where it was written.
    pub source: Source,
}

impl Default for Equality {
    fn default() -> Self {
        Equality {
            name: String::new(),
            held: Held::Points { bodies: Default::default(), anchor: [0.0; 3] },
            active: true,
            solref: SOLREF,
            solimp: SOLIMP,
            source: Source::default(),
        }
    }
}
