//! The line search along the search direction.
//!
//! Newton's directions want no exact one: a full step is taken if the slope has not grown there (the curvature condition,
//! Nocedal and Wright, Numerical Optimization, 2006, § 3.1), as that is what ends the iteration once no row changes side. A world
//! that has not converged after a few such searches goes on with exact ones, with which Newton's method always converges.

use super::{Problem, SolverWork, equality, joints};
use crate::lane::{Lane, Mask, Real};
use crate::options;

/// Lanes of a block after a trial step.
#[derive(Clone, Copy, Debug)]
pub struct Trial<M> {
    /// Those that search on.
    pub open: M,
    /// Those for which a full step is the end: no row leaves its quadratic piece of the cost, so it lands on the minimum.
    pub full: M,
}

/// What is known along the search direction p, in one array, which generated code can read.
#[derive(Clone, Copy, Debug)]
pub struct Line<L>(pub [L; LINE]);

/// Numbers of a [`Line`].
pub const LINE: usize = 14;

/// Of Newton's method, the first searches of a solve are rough: they end where the slope is this part of the one at their start.
const ROUGH: f64 = 0.9;
/// Number of these searches.
const ROUGH_SEARCHES: f64 = 6.0;

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

/// Looks at the slope where the last step has led, and chooses the next one for the lanes of `open` that are not yet at the
/// minimum: Newton's, or else the middle of the bracket. On the `first` call, of Newton's method, also finds the lanes that
/// need no search.
#[inline(always)]
pub fn probe<L: Lane>(
    problem: &Problem<'_, L>,
    first: bool,
    open: L::Mask,
    work: &mut SolverWork<L>,
) -> Trial<L::Mask> {
    let options = &problem.model.options;
    let SolverWork { y, jp, line, .. } = work;
    let (y, v) = (&y.dof, &jp.dof);
    let conjugate = options.solver == options::Solver::Cg;
    let (mut open, mut full) = (open, L::Mask::splat(false));
    if first && !conjugate {
        full = joints::unchanged(problem, y, v) & line.same().eq(L::one());
        open = open & !full;
    }
    let (alpha, low, high) = (line.step(), line.low(), line.high());
    let mut sum = [alpha.mul_add(line.curvature(), line.slope()), line.curvature()];
    joints::slope(problem, alpha, y, v, &mut sum);
    let [slope, curvature] = [sum[0] + line.contact_slope(), sum[1] + line.contact_curvature()];
    let precision = |part: f64| L::of(part.max(8.0 * L::Real::EPSILON));
    let precision = if conjugate {
        // Conjugacy is lost by a rough search.
        precision(1e-6 * options.ls_tolerance)
    } else {
        let rough = line.searches().le(L::of(ROUGH_SEARCHES));
        L::select(rough, precision(options.ls_tolerance.max(ROUGH)), precision(options.ls_tolerance))
    };
    let tolerance = line.descent().abs() * precision;
    open = open & !slope.abs().le(tolerance);
    let falling = slope.lt(L::zero());
    let low = L::select(open & falling, alpha, low);
    let high = L::select(open & !falling, alpha, high);
    let newton = alpha - slope / curvature;
    let inside = newton.gt(low) & newton.lt(high);
    let middle = (low + high) * L::of(0.5);
    // Without a bracket above, a Newton step that rounding stops is the end.
    let middle = L::select(middle.within(L::Real::MAX), middle, alpha);
    let next = L::select(inside, newton, middle);
    // No representable step left.
    open = open & !next.eq(alpha);
    line.forget_contacts();
    line.set_step(L::select(open, next, alpha));
    equality::slope(problem, line);
    line.set_low(low);
    line.set_high(high);
    Trial { open, full }
}
