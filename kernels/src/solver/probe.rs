//! The steps that the line search tries.
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

/// Of Newton's method, the first searches of a solve are rough: they end where the slope is this part of the one at their start.
const ROUGH: f64 = 0.9;
/// Number of these searches. Where no more iterations are allowed, all are exact: what is left after them then compares with what MuJoCo
/// leaves.
const ROUGH_SEARCHES: u32 = 6;

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
    let precision = if conjugate || options.iterations <= ROUGH_SEARCHES {
        // Conjugacy is lost by a rough search.
        precision(1e-6 * options.ls_tolerance)
    } else {
        let rough = line.searches().le(L::of(f64::from(ROUGH_SEARCHES)));
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
