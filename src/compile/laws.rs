//! What governs the contacts of a pair of geoms: the numbers on which two geoms agree, and the law that follows from them.

use lanesim_kernels::model::{Impedance, Pair};
use lanesim_kernels::options::Options;

use super::constraints::{Bound, damping, impedance};
use crate::model::Surface;
use crate::spec;

const MINVAL: f64 = 1e-15;
/// Smallest friction coefficient.
const MINMU: f64 = 1e-5;

/// What two geoms agree on for their contacts.
pub(crate) struct Contact {
    pub condim: i32,
    pub friction: [f64; 5],
    pub solref: [f64; 2],
    pub solreffriction: [f64; 2],
    pub solimp: [f64; 5],
    pub margin: f64,
    pub gap: f64,
}

/// What the tables have of that, but for the distance within which contacts are listed.
#[derive(Clone, Debug)]
pub(crate) struct Law {
    pub margin: f64,
    pub friction: [f64; 5],
    pub impedance: Impedance<f64>,
    pub friction_b: f64,
}

impl Contact {
    /// The numbers of an explicit pair.
    pub fn of(p: &spec::Pair) -> Self {
        Contact {
            condim: p.condim,
            friction: p.friction,
            solref: p.solref,
            solreffriction: if p.solreffriction == [0.0; 2] { p.solref } else { p.solreffriction },
            solimp: p.solimp,
            margin: p.margin,
            gap: p.gap,
        }
    }

    /// Those that two geoms mix.
    pub fn mix(a: &Surface, b: &Surface) -> Self {
        let (condim, friction, solref, solimp);
        if a.priority != b.priority {
            let winner = if a.priority > b.priority { a } else { b };
            (condim, friction, solref, solimp) = (winner.condim, winner.friction, winner.solref, winner.solimp);
        } else {
            let weight = match (a.solmix >= MINVAL, b.solmix >= MINVAL) {
                (true, true) => a.solmix / (a.solmix + b.solmix),
                (false, false) => 0.5,
                (true, false) => 1.0,
                (false, true) => 0.0,
            };
            let average = |x: f64, y: f64| weight * x + (1.0 - weight) * y;
            condim = a.condim.max(b.condim);
            friction = std::array::from_fn(|i| a.friction[i].max(b.friction[i]));
            solref = if a.solref[0] > 0.0 && b.solref[0] > 0.0 {
                std::array::from_fn(|i| average(a.solref[i], b.solref[i]))
            } else {
                std::array::from_fn(|i| a.solref[i].min(b.solref[i]))
            };
            solimp = std::array::from_fn(|i| average(a.solimp[i], b.solimp[i]));
        }
        let [slide, spin, roll] = friction;
        Contact {
            condim,
            friction: [slide, slide, spin, roll, roll],
            solref,
            solreffriction: solref,
            solimp,
            margin: a.margin + b.margin,
            gap: a.gap + b.gap,
        }
    }

    /// With what the flag `override` imposes on every contact.
    pub fn overridden(self, options: &Options) -> Self {
        if !options.flags.override_ {
            return self;
        }
        Contact {
            friction: options.o_friction,
            solref: options.o_solref,
            solreffriction: options.o_solref,
            solimp: options.o_solimp,
            margin: options.o_margin,
            ..self
        }
    }

    /// What the tables have of it.
    pub fn law(&self, options: &Options) -> Law {
        Law {
            margin: self.margin,
            friction: self.friction.map(|x| x.max(MINMU)),
            impedance: impedance(options, Bound::Below, self.solref, self.solimp),
            friction_b: damping(options, impedance(options, Bound::Other, self.solreffriction, self.solimp).b),
        }
    }
}

impl Law {
    /// Gives it to a pair.
    pub fn govern(self, pair: &mut Pair<f64>) {
        (pair.margin, pair.friction) = (self.margin, self.friction);
        (pair.impedance, pair.friction_b) = (self.impedance, self.friction_b);
    }
}
