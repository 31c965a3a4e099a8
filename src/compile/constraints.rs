//! Impedance of constraints; limits and dry friction of joints and tendons.

use lanesim_kernels::model::{FrictionLoss, Impedance, Limit, NONE, Tendon};
use lanesim_kernels::options::{Integrator, Options};

use super::bounds;
use super::check::dof_count;
use super::order::Scene;
use crate::spec::{self, Spec, is_limited};

const MINVAL: f64 = 1e-15;
const MINIMP: f64 = 1e-4;
const MAXIMP: f64 = 0.9999;

/// What bounds a row's force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Bound {
    /// It only pushes: limits, contacts.
    Below,
    /// Nothing, or something else: equality, friction.
    Other,
}

/// Impedance and reference from `solref` and `solimp`, clamped to what they may be. In discrete steps, a stiffness of -1 stands for what
/// `refsafe` chooses there, beside the damping ratio in place of b.
pub(crate) fn impedance(options: &Options, bound: Bound, solref: [f64; 2], solimp: [f64; 5]) -> Impedance<f64> {
    let [dmin, dmax, width, midpoint, power] = solimp;
    let dmax = dmax.clamp(MINIMP, MAXIMP);
    let [time, damping] = safe(options, solref);
    let k = if time > 0.0 { 1.0 / (dmax * dmax * time * time * damping * damping) } else { -time / (dmax * dmax) };
    let b = if damping > 0.0 { 2.0 / (dmax * time) } else { -damping / dmax };
    let (k, b) = if bound == Bound::Below && too_stiff(options, solref) { (-1.0, damping) } else { (k, b) };
    let dmin = dmin.clamp(MINIMP, MAXIMP);
    let (width, midpoint, power) = (width.max(0.0), midpoint.clamp(MINIMP, MAXIMP), power.max(1.0));
    let flat = dmin == dmax || width <= MINVAL;
    Impedance {
        flat,
        small_power: if power == 1.0 || power == 2.0 { power as u8 } else { 0 },
        k,
        b,
        dmin,
        dmax,
        inverse_width: if flat { 0.0 } else { 1.0 / width },
        midpoint,
        power,
        low: midpoint.powf(1.0 - power),
        high: (1.0 - midpoint).powf(1.0 - power),
    }
}

/// `solref` with the time constant raised to what the time step can follow.
fn safe(options: &Options, solref: [f64; 2]) -> [f64; 2] {
    if raised(options, solref) { [2.0 * options.timestep, solref[1]] } else { solref }
}

/// Whether the flag `refsafe` changes what a discrete step makes of `solref`, which is stiffer than it can follow.
fn too_stiff(options: &Options, [time, damping]: [f64; 2]) -> bool {
    let discrete = options.integrator == Integrator::Discrete;
    discrete && options.flags.refsafe && time > 0.0 && time * damping < options.timestep
}

/// Damping of rows without stiffness: in a discrete step, with what it has lost by the end.
pub(crate) fn damping(options: &Options, b: f64) -> f64 {
    if options.integrator == Integrator::Discrete { b / options.timestep.mul_add(b, 1.0) } else { b }
}

/// Whether the flag `refsafe` changes `solref`.
pub(crate) fn raised(options: &Options, solref: [f64; 2]) -> bool {
    options.integrator != Integrator::Discrete
        && options.flags.refsafe
        && solref[0] > 0.0
        && solref[0] < 2.0 * options.timestep
}

/// Impedance at zero violation.
fn at_zero(i: &Impedance<f64>) -> f64 {
    if i.flat { 0.5 * (i.dmin + i.dmax) } else { i.dmin }
}

/// What rows on joints and tendons are weighed by.
#[derive(Clone, Copy)]
pub(crate) struct InverseWeights<'a> {
    pub dofs: &'a [f64],
    pub tendons: &'a [f64],
}

/// The tendons that something moves, with their numbers: nothing acts along others.
fn moved<'a>(spec: &'a Spec, tendons: &'a [Tendon<f64>]) -> impl Iterator<Item = (u32, &'a spec::Tendon)> {
    (0..).zip(&spec.tendons).zip(tendons).filter(|(_, table)| table.dofs.len > 0).map(|(written, _)| written)
}

/// The limits in force, in the order of joints, then of tendons.
pub(crate) fn limits(
    spec: &Spec,
    scene: &Scene,
    tendons: &[Tendon<f64>],
    weights: InverseWeights<'_>,
) -> Vec<Limit<f64>> {
    let options = &spec.option;
    if !options.flags.limit || !options.flags.constraint {
        return Vec::new();
    }
    let limited = |(index, j): (usize, &super::order::Joint)| {
        let spec = j.spec;
        let kind = spec.kind;
        let boundless = bounds::are_none(spec.range.unwrap_or_default());
        if kind == crate::spec::JointKind::Free || !is_limited(spec.range, spec.limited) || boundless {
            return None;
        }
        Some(Limit {
            tendon: NONE,
            joint: index as u32,
            dof: j.dof as u32,
            qpos: j.qpos as u32,
            ball: kind == crate::spec::JointKind::Ball,
            range: range_of(spec.range.unwrap_or_default(), kind == crate::spec::JointKind::Ball),
            margin: spec.margin,
            impedance: impedance(options, Bound::Below, spec.solreflimit, spec.solimplimit),
            invweight: weights.dofs[j.dof],
        })
    };
    let of_tendon = |(t, tendon): (u32, &spec::Tendon)| {
        let range = tendon.range.unwrap_or_default();
        let in_force = is_limited(tendon.range, tendon.limited) && !bounds::are_none(range);
        in_force.then(|| Limit {
            tendon: t,
            joint: 0,
            dof: 0,
            qpos: 0,
            ball: false,
            range: range_of(range, false),
            margin: tendon.margin,
            impedance: impedance(options, Bound::Below, tendon.solreflimit, tendon.solimplimit),
            invweight: weights.tendons[t as usize],
        })
    };
    let joints = scene.joints.iter().enumerate().filter_map(limited);
    joints.chain(moved(spec, tendons).filter_map(of_tendon)).collect()
}

/// The range of a limit: of a ball joint, 0 and an angle.
pub(crate) fn range_of(range: [f64; 2], ball: bool) -> [f64; 2] {
    let [lo, hi] = bounds::of_limit(range);
    if ball { [0.0, hi.max(0.0)] } else { [lo, hi] }
}

/// Dry friction in force, in the order of dofs, then of tendons.
pub(crate) fn friction_losses(
    spec: &Spec,
    scene: &Scene,
    tendons: &[Tendon<f64>],
    weights: InverseWeights<'_>,
) -> Vec<FrictionLoss<f64>> {
    let options = &spec.option;
    if !options.flags.frictionloss || !options.flags.constraint {
        return Vec::new();
    }
    let mut losses = Vec::new();
    for j in scene.joints.iter().filter(|j| j.spec.frictionloss > 0.0) {
        let (share, b) = friction(options, j.spec.solreffriction, j.spec.solimpfriction);
        for dof in j.dof..j.dof + dof_count(j.spec.kind) {
            losses.push(FrictionLoss {
                tendon: NONE,
                dof: dof as u32,
                bound: j.spec.frictionloss,
                r: (share * weights.dofs[dof]).max(MINVAL),
                b,
            });
        }
    }
    for (t, tendon) in moved(spec, tendons).filter(|(_, tendon)| tendon.frictionloss > 0.0) {
        let (share, b) = friction(options, tendon.solreffriction, tendon.solimpfriction);
        let r = (share * weights.tendons[t as usize]).max(MINVAL);
        losses.push(FrictionLoss { tendon: t, dof: 0, bound: tendon.frictionloss, r, b });
    }
    losses
}

/// Of dry friction, R over the inverse weight, and the damping of its reference.
fn friction(options: &Options, solref: [f64; 2], solimp: [f64; 5]) -> (f64, f64) {
    let i = impedance(options, Bound::Other, solref, solimp);
    let d = at_zero(&i);
    // In a discrete step, 1 + h b times less, but no less than the largest impedance has.
    let (own, least, b) = ((1.0 - d) / d, (1.0 - MAXIMP) / MAXIMP, damping(options, i.b));
    (if b == i.b { own } else { (own * b / i.b).max(least) }, b)
}

/// Stiffness and damping of each joint with `springdamper`, by joint: (joint, stiffness, damping).
pub(crate) fn springdampers(scene: &Scene, dof_invweight0: &[f64]) -> Vec<(usize, f64, f64)> {
    let mut out = Vec::new();
    for (index, j) in scene.joints.iter().enumerate() {
        let [time, ratio] = j.spec.springdamper;
        if time > 0.0 && ratio > 0.0 {
            let n = dof_count(j.spec.kind);
            let weights = &dof_invweight0[j.dof..j.dof + n];
            let mass = n as f64 / weights.iter().sum::<f64>().max(MINVAL);
            out.push((index, mass / (time * ratio).powi(2), 2.0 * mass / time));
        }
    }
    out
}
