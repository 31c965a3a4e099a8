//! What is known along the search direction.

use crate::lane::Lane;

/// What is known along the search direction p, in one array, which generated code can read.
#[derive(Clone, Copy, Debug)]
pub struct Line<L>(pub [L; LINE]);

/// Numbers of a [`Line`].
pub const LINE: usize = 14;

macro_rules! entries {
    ($($(#[$doc:meta])* $name:ident $set:ident $i:literal;)*) => {
        impl<L: Copy> Line<L> {
            $($(#[$doc])*
            #[inline(always)]
            pub fn $name(&self) -> L {
                self.0[$i]
            }
            $(#[$doc])*
            #[inline(always)]
            pub fn $set(&mut self, x: L) {
                self.0[$i] = x;
            })*
        }
    };
}

entries! {
    /// The step along p that is tried or taken, in units of p.
    step set_step 0;
    /// Step below the minimum.
    low set_low 1;
    /// Step above it.
    high set_high 2;
    /// Slope of the quadratic part of the cost.
    slope set_slope 3;
    /// Its curvature.
    curvature set_curvature 4;
    /// Slope of the whole cost.
    descent set_descent 5;
    /// 1 where no contact leaves its quadratic piece of the cost on a full step, else 0.
    same set_same 6;
    /// Slope of the contacts' cost at the step that is tried.
    contact_slope set_contact_slope 7;
    /// Its curvature there.
    contact_curvature set_contact_curvature 8;
    /// Twice the cost without the warm start.
    cold_cost set_cold_cost 9;
    /// Twice the cost with it.
    warm_cost set_warm_cost 10;
    /// Searches of the solve, with the present one.
    searches set_searches 11;
    /// Slope of the cost of equality constraints at the start of the search.
    equality_slope set_equality_slope 12;
    /// Its curvature.
    equality_curvature set_equality_curvature 13;
}

impl<L: Lane> Line<L> {
    /// All zero.
    pub fn new() -> Self {
        Line([L::zero(); LINE])
    }

    /// Starts the search with a full step.
    #[inline(always)]
    pub fn begin(&mut self) {
        self.set_searches(self.searches() + L::one());
        self.set_step(L::one());
        self.set_low(L::zero());
        self.set_high(L::of(f64::MAX));
        self.set_same(L::one());
        self.forget_contacts();
    }

    /// Forgets the contacts' slope.
    #[inline(always)]
    pub fn forget_contacts(&mut self) {
        self.set_contact_slope(L::zero());
        self.set_contact_curvature(L::zero());
    }
}

impl<L: Lane> Default for Line<L> {
    fn default() -> Self {
        Line::new()
    }
}
