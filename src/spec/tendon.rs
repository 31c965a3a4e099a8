//! Tendons.

use super::{SOLIMP, SOLREF, Source, Tri};

/// What a tendon's length is of.
#[derive(Clone, Debug, PartialEq)]
pub enum Path {
    /// The sum of positions of joints, each times its coefficient.
    Fixed(Vec<(String, f64)>),
    /// A path from site to site.
    Spatial(Vec<Waypoint>),
}

/// A point of a tendon's path.
#[derive(Clone, Debug, PartialEq)]
pub enum Waypoint {
    /// A site, by name.
    Site(String),
    /// A sphere or a cylinder between two sites, which the path wraps where it is in the way.
    Geom {
        /// Its name.
        geom: String,
        /// Name of a site on whose side the path passes, through the inside if it is there; or empty.
        side: String,
    },
    /// The end of a branch: what follows counts divided by this.
    Pulley(f64),
}

/// A tendon (MJCF `tendon/fixed`, `tendon/spatial`).
#[derive(Clone, Debug)]
pub struct Tendon {
    /// Name, or empty.
    pub name: String,
    /// What its length is of.
    pub path: Path,
    /// Limits of the length, infinite where there is none; `None`: not given.
    pub range: Option<[f64; 2]>,
    /// Whether the range is in force.
    pub limited: Tri,
    /// Distance below which the limit acts.
    pub margin: f64,
    /// Lengths between which the spring rests; both -1: the length where springs of joints rest.
    pub springlength: [f64; 2],
    /// How far the spring is stretched before it yields, and rests elsewhere; 0: it does not yield.
    pub springyield: f64,
    /// Coefficients of the spring force a x + b x² + c x³.
    pub stiffness: [f64; 3],
    /// Coefficients of the damper force a v + b v|v| + c v³.
    pub damping: [f64; 3],
    /// Inertia against changes of the length.
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
    /// Bounds on the total force of its actuators; `None`: not given.
    pub actuatorfrcrange: Option<[f64; 2]>,
    /// Whether those bounds are in force.
    pub actuatorfrclimited: Tri,
    /// Group, for display.
    pub group: i32,
    /// Where it was written.
    pub source: Source,
}

impl Default for Tendon {
    fn default() -> Self {
        Tendon {
            name: String::new(),
            path: Path::Fixed(Vec::new()),
            range: None,
            limited: Tri::Auto,
            margin: 0.0,
            springlength: [-1.0; 2],
            springyield: 0.0,
            stiffness: [0.0; 3],
            damping: [0.0; 3],
            armature: 0.0,
            frictionloss: 0.0,
            solreflimit: SOLREF,
            solimplimit: SOLIMP,
            solreffriction: SOLREF,
            solimpfriction: SOLIMP,
            actuatorfrcrange: None,
            actuatorfrclimited: Tri::Auto,
            group: 0,
            source: Source::default(),
        }
    }
}
